"""Data files of LAMMPS and LIGGGHTS, as `read_data` takes them, of atom styles sphere and granular.

A row of the section Atoms is `id type diameter density x y z` and, at will, three counts of the periods that the
particle has gone; one of Velocities is `id vx vy vz wx wy wz`. Source: LAMMPS documentation, `read_data` command.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from jaxdem.errors import cut
from jaxdem.files.text_table import Line, lines_of, number_of
from jaxdem.particle_files.raw import Raw, Values, refusal
from jaxdem.particle_files.text import split_rows

ATOMS = ["id", "type", "diameter", "density", "x", "y", "z"]
VELOCITIES = ["id", "vx", "vy", "vz", "wx", "wy", "wz"]
STYLES = ("sphere", "granular")
TITLE = re.compile(r"[A-Z][A-Za-z]+( [A-Za-z]+)*( *#.*)?")
"""A line that begins a section."""

ANNOUNCED = re.compile(r"\s*\d+\s+atoms\s*(#.*)?")
"""The line of the head by which such a file is known."""


def is_data_file(text: str) -> bool:
    """Whether a text begins as a data file does."""
    return any(ANNOUNCED.fullmatch(line) for line in text.splitlines()[1:100])


def read_data_file(name: str, text: str) -> Raw:
    """The particles of a data file. The ends of its box may be shrink-wrapped, so that they say nothing of the origin.

    Raises:
        InputError: it is of another atom style, or its rows are not those that it announces.
    """
    lines = lines_of(text.partition("\n")[2])  # the first line is a title, whatever it holds
    lines = [Line(line.number + 1, line.text) for line in lines]
    starts = [k for k, line in enumerate(lines) if TITLE.fullmatch(line.text)]
    head = lines[: starts[0]] if starts else lines
    announced = next((line for line in head if ANNOUNCED.fullmatch(line.text)), None)
    count = int(announced.text.split()[0]) if announced is not None else 0
    sections = {
        lines[k].text.partition("#")[0].strip(): (lines[k], lines[k + 1 : stop])
        for k, stop in zip(starts, [*starts[1:], len(lines)], strict=True)
    }
    if "Atoms" not in sections:
        raise refusal(name, "has no section Atoms", "give a data file with particles")
    title, rows = sections["Atoms"]
    style = title.text.partition("#")[2].strip()
    if style and style not in STYLES:
        limit = f"the atom style is {cut(style, 40)!r}, known are {' and '.join(STYLES)}: {' '.join(ATOMS)}"
        raise refusal(f"line {title.number} of {name}", limit, "write the file with atom_style sphere")
    names = _with_images(ATOMS, rows)
    names, values = names, _section(name, title, rows, names, count)
    if "Velocities" in sections:
        title, moving = sections["Velocities"]
        more = _section(name, title, moving, VELOCITIES, count)
        order = _by_id(name, moving, more[0], values[0])
        names = names + VELOCITIES[1:]
        values += [[column[row] for row in order] for column in more[1:]]
    return Raw(
        names=names,
        values=[list(column) for column in values],
        header=f"line {sections['Atoms'][0].number} of {name}",
        place=lambda row: f"line {rows[row].number} of {name}",
        strict=False,
    )


def _with_images(names: list[str], rows: Sequence[Line]) -> list[str]:
    given = len(rows[0].text.partition("#")[0].split()) if rows else 0
    return [*names, "nx", "ny", "nz"] if given == len(names) + 3 else names


def _section(name: str, title: Line, rows: Sequence[Line], names: list[str], count: int) -> list[Values]:
    """The columns of a section that should have `count` rows."""
    plain = [Line(line.number, line.text.partition("#")[0].strip()) for line in rows]
    if len(plain) != count or not count:
        limit = f"the section has {len(plain)} rows, the head announces {count} atoms"
        raise refusal(f"line {title.number} of {name}", limit, "correct one of the two numbers")
    return [list(column) for column in zip(*split_rows(name, names, plain), strict=True)]


def _by_id(name: str, rows: Sequence[Line], theirs: Values, ours: Values) -> list[int]:
    """The rows of another section in the order of the particles."""
    found = {number_of(text): row for row, text in enumerate(theirs)}
    for row, text in enumerate(ours):
        if number_of(text) not in found:
            limit = f"no row of Velocities has the id {cut(text, 40)} of particle {row}"
            raise refusal(f"line {rows[0].number - 1} of {name}", limit, "give one row for each particle")
    return [found[number_of(text)] for text in ours]

"""Files of particles that a deck names: data files and dumps."""

from __future__ import annotations

from pathlib import Path

from jaxdem.errors import InputError
from jaxdem.files.reading import TABLE_BYTES, read_text
from jaxdem.foreign.atoms import DEFAULT_DENSITY, DEFAULT_DIAMETER, atoms_of
from jaxdem.foreign.model import Deck
from jaxdem.foreign.notes import DIFFERS, TAKEN, Answer, Unknown, unreadable
from jaxdem.foreign.words import integer
from jaxdem.particle_files import Columns, Source, read_columns

HEAD_LINES = 100
"""Of a data file, in which its box stands."""


def read_data(deck: Deck, words: list[str]) -> Answer:
    """`read_data FILE`.

    Raises:
        InputError: the file cannot be read: nothing of the deck is worth a scene without its particles.
    """
    if deck.segment or deck.atoms:
        raise Unknown("a scene has its first particles from one file; join the two data files")
    path = deck.folder / words[1]
    head = _text(deck, words[1], path).splitlines()[1:HEAD_LINES]
    ends: dict[str, list[float]] = {}
    for line in head:
        found = line.partition("#")[0].split()
        if found[1:] == ["atom", "types"]:
            deck.types = integer(found[0])
        if len(found) == 4 and found[2][1:] == "lo" and found[3][1:] == "hi":
            ends[found[2][0]] = [float(value) * deck.unit.length for value in found[:2]]
    if set(ends) == set("xyz"):
        deck.lower, deck.upper = [ends[a][0] for a in "xyz"], [ends[a][1] for a in "xyz"]
    _take(deck, {"name": words[1]}, _columns(deck, words[1], Source(str(path), units=deck.unit.name)))
    odd = [word for word in words[2:] if word not in ("nocoeff",)]
    if odd:
        return DIFFERS, f"particles.file, and the box of that file; {' '.join(odd)} left out"
    return TAKEN, "particles.file, and the box of that file"


def read_dump(deck: Deck, words: list[str]) -> Answer:
    """`read_dump FILE N FIELDS ...`: the particles of time step N."""
    if deck.segment:
        raise Unknown("after a run the particles are as it has left them; begin a deck with the dump")
    step, path = integer(words[2]), deck.folder / words[1]
    lines = _text(deck, words[1], path).splitlines()
    steps = [lines[k + 1].strip() for k, line in enumerate(lines[:-1]) if line.startswith("ITEM: TIMESTEP")]
    if str(step) not in steps:
        raise Unknown(f"{words[1]} has no time step {step}, it has {', '.join(steps[:5]) or 'none'}")
    frame = steps.index(str(step))
    columns = _columns(deck, words[1], Source(str(path), frame=frame, units=deck.unit.name))
    known = deck.atoms.get(0)
    if known is not None and len(known):
        given = atoms_of(columns, 1.0, 1.0)
        if len(given) != len(known):
            raise Unknown(f"the dump has {len(given)} particles, and there are {len(known)}")
        known.position, known.from_file = given.position, False
        for name, column in (("velocity", "vx"), ("spin", "wx"), ("diameter", "radius"), ("density", "density")):
            if column in columns.numbers:
                setattr(known, name, getattr(given, name))
        return TAKEN, "particles.file: the particles that are there, as they are in the dump"
    at = next(k for k, line in enumerate(lines) if line.startswith("ITEM: BOX BOUNDS"))
    ends = [[float(value) * deck.unit.length for value in line.split()[:2]] for line in lines[at + 1 : at + 4]]
    if not deck.lower or words[-2:] != ["box", "no"]:
        deck.lower, deck.upper = [low for low, _ in ends], [high for _, high in ends]
    _take(deck, {"name": words[1], "frame": frame}, columns)
    return TAKEN, "particles.file, and the box of that time step"


def _take(deck: Deck, table: dict[str, object], columns: Columns) -> None:
    unit = deck.unit
    deck.data_file = table
    deck.atoms[0] = atoms_of(columns, DEFAULT_DIAMETER * unit.length, DEFAULT_DENSITY * unit.density)
    if columns.types is not None:
        deck.types = max(deck.types, int(columns.types.max()))


def _text(deck: Deck, name: str, path: Path) -> str:
    try:
        return read_text(path, TABLE_BYTES)
    except (OSError, ValueError) as error:
        limit = f"names the file {path}, which cannot be read ({getattr(error, 'strerror', None) or error})"
        raise unreadable(name, limit, "put it where the deck says") from None


def _columns(deck: Deck, name: str, source: Source) -> Columns:
    try:
        return read_columns(source)
    except InputError as error:
        raise unreadable(name, f"holds no particles that a scene can take: {error}", "correct the file") from None

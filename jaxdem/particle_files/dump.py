"""Dump files of LAMMPS and LIGGGHTS (styles atom and custom), with one time step or several.

Source: LAMMPS documentation, `dump` command, section on the text formats.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jaxdem.errors import InputError, cut
from jaxdem.files.text_table import Line, number_of
from jaxdem.particle_files.columns import AXES, Source
from jaxdem.particle_files.raw import KEY, Raw, Values, at_time, chosen, refusal
from jaxdem.particle_files.text import split_rows

ITEM = "ITEM:"
ENDS = "fpsm"
"""Kinds of ends of the box: fixed, periodic, shrink-wrapped, shrink-wrapped with a minimum."""


class Snapshot(NamedTuple):
    """One time step of a dump: where it lies in the file, and what its head says.

    Attributes:
        names: of the columns.
        header: line of the names.
        first: index of the first row among the lines.
        rows: number of rows.
        bounds: lower and upper end of the box along each axis.
        ends: kinds of both ends of each axis, such as "pp"; "" where the file does not say.
        tilted: whether the box is triclinic.
        time: [s] or None.
        units: system of units, or "".
    """

    names: list[str]
    header: Line
    first: int
    rows: int
    bounds: list[tuple[float, float]]
    ends: tuple[str, str, str]
    tilted: bool
    time: float | None
    units: str


def read_dump(source: Source, text: str) -> Raw:
    """The particles of one time step.

    Raises:
        InputError: the file does not have the form of a dump, ends within the time step, or has no such one.
    """
    lines = text.splitlines()
    snapshots = _snapshots(source.name, lines)
    if source.time is None:
        index = chosen(source.frame, len(snapshots), source.name)
    else:
        times = [snapshot.time for snapshot in snapshots]
        if None in times:
            limit = f"{cut(source.name, 200)} has numbers of time steps and no times (ITEM: TIME)"
            raise InputError(f"{KEY}.time", source.time, limit, "give the number of the time step, from 0, as frame")
        index = at_time(source.time, [time for time in times if time is not None], source.name)
    return _raw(source.name, snapshots[index], lines)


def _snapshots(name: str, lines: list[str]) -> list[Snapshot]:
    found: list[Snapshot] = []
    head: dict[str, tuple[int, list[str]]] = {}
    at = 0
    while at < len(lines):
        line = lines[at].strip()
        if not line:
            at += 1
        elif not line.startswith(ITEM):
            raise refusal(f"line {at + 1} of {name}", f"{cut(repr(line), 80)} is not expected here: it should be an "
                          f"{ITEM} line", "the time step before it has another number of particles than it "
                          "says; write the dump anew")  # fmt: skip
        elif line.startswith(f"{ITEM} ATOMS"):
            found.append(_snapshot(name, head, at, lines))
            at, head = at + 1 + found[-1].rows, {}
        else:
            title = line.removeprefix(ITEM).strip()
            rows = (
                next((k for k in range(1, 4) if lines[at + k : at + k + 1] and lines[at + k].startswith(ITEM)), 4) - 1
            )
            rows = min(rows, 3 if title.startswith("BOX BOUNDS") else 1)
            head[" ".join(title.split()[:2])] = (at, [title, *lines[at + 1 : at + 1 + rows]])
            at += 1 + rows
    if not found:
        raise refusal(name, "has no particles (ITEM: ATOMS)", "give a dump of style atom or custom")
    return found


def _snapshot(name: str, head: dict[str, tuple[int, list[str]]], at: int, lines: list[str]) -> Snapshot:
    def entry(item: str) -> tuple[int, list[str]]:
        if item not in head:
            raise refusal(f"line {at + 1} of {name}", f"there is no '{ITEM} {item}' before it", "write the dump anew")
        return head[item]

    number, (_, *counted) = entry("NUMBER OF")
    count = number_of(counted[0]) if counted else None
    if count is None or count != round(count) or not 0 < count <= len(lines):
        limit = f"{cut(repr(counted[:1]), 60)} is no number of particles that the file can hold"
        raise refusal(f"line {number + 2} of {name}", limit, "give a dump with particles")
    number, (title, *rows) = entry("BOX BOUNDS")
    bounds = [[number_of(field) for field in row.split()] for row in rows]
    if len(bounds) != 3 or any(len(row) < 2 or None in row for row in bounds):
        raise refusal(f"line {number + 2} of {name}", "the box needs three lines of numbers", "write the dump anew")
    words = title.split()[2:]
    ends = [word for word in words if len(word) == 2 and set(word) <= set(ENDS)]
    time = number_of(head["TIME"][1][1]) if len(head.get("TIME", (0, []))[1]) > 1 else None
    units = head["UNITS"][1][1].strip() if len(head.get("UNITS", (0, []))[1]) > 1 else ""
    return Snapshot(
        names=lines[at].split()[2:],
        header=Line(at + 1, lines[at]),
        first=at + 1,
        rows=int(count),
        bounds=[(float(row[0] or 0.0), float(row[1] or 0.0)) for row in bounds],
        ends=(ends[0], ends[1], ends[2]) if len(ends) == 3 else ("", "", ""),
        tilted="xy" in words or "abc" in words,
        time=time,
        units=units,
    )


def _raw(name: str, snapshot: Snapshot, lines: list[str]) -> Raw:
    header = f"line {snapshot.header.number} of {name}"
    rows = lines[snapshot.first : snapshot.first + snapshot.rows]
    whole = [line for line in rows if line.strip() and not line.startswith(ITEM)]
    if len(whole) < snapshot.rows:
        limit = f"the time step should have {snapshot.rows} particles, it has {len(whole)}"
        raise refusal(header, limit, f"it was not written to its end; take the one before: {KEY}.frame = -2")
    numbered = [Line(snapshot.first + 1 + k, line) for k, line in enumerate(rows)]
    columns: list[Values] = [list(column) for column in zip(*split_rows(name, snapshot.names, numbered), strict=True)]
    raw = Raw(
        names=snapshot.names,
        values=columns,
        header=header,
        place=lambda row: f"line {numbered[row].number} of {name}",
        strict=False,
        units=snapshot.units,
        lower={a: b[0] for a, b, e in zip(AXES, snapshot.bounds, snapshot.ends, strict=True) if e[:1] in ("f", "p")},
    )
    return _in_space(raw, snapshot)._replace(names=_plain_names(snapshot.names))


def _plain_names(names: list[str]) -> list[str]:
    """Names of the columns; scaled and unwrapped coordinates have that of the axis where there is no other."""
    for axis in AXES:
        if axis not in names:
            kinds = [kind for kind in (f"{axis}u", f"{axis}su", f"{axis}s") if kind in names]
            names = [axis if kinds and n == kinds[0] else n for n in names]
    return names


def _in_space(raw: Raw, snapshot: Snapshot) -> Raw:
    """Scaled coordinates (xs, xsu) as places: x = xlo + xs (xhi - xlo)."""
    values = list(raw.values)
    for number, axis in enumerate(AXES):
        for column, label in enumerate(raw.names):
            if label not in (f"{axis}s", f"{axis}su"):
                continue
            if snapshot.tilted:
                limit = f"{label} is scaled by a triclinic box"
                raise refusal(raw.header, limit, "write x y z or xu yu zu into the dump")
            low, high = snapshot.bounds[number]
            scaled = [number_of(text) for text in raw.values[column]]
            if None not in scaled:  # else it is refused as text where it is read
                values[column] = low + np.asarray(scaled, np.float64) * (high - low)
    return raw._replace(values=values)

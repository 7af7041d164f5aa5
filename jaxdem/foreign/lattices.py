"""Lattices of `create_atoms`. Source: LAMMPS documentation, `lattice` command."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from jaxdem.foreign.notes import Unknown
from jaxdem.foreign.words import numbers

FACES = ((0.0, 0.0, 0.0), (0.0, 0.5, 0.5), (0.5, 0.0, 0.5), (0.5, 0.5, 0.0))
BASES: dict[str, tuple[tuple[float, ...], ...]] = {
    "none": (),
    "sc": ((0.0, 0.0, 0.0),),
    "bcc": ((0.0, 0.0, 0.0), (0.5, 0.5, 0.5)),
    "fcc": FACES,
    "hcp": ((0.0, 0.0, 0.0), (0.5, 0.5, 0.0), (0.5, 5.0 / 6.0, 0.5), (0.0, 1.0 / 3.0, 0.5)),
    "diamond": (*FACES, *(tuple(c + 0.25 for c in corner) for corner in FACES)),
    "sq": ((0.0, 0.0, 0.0),),
    "sq2": ((0.0, 0.0, 0.0), (0.5, 0.5, 0.0)),
    "hex": ((0.0, 0.0, 0.0), (0.5, 0.5, 0.0)),
}
"""Places in a cell, in sides of it."""

CELLS = {"hcp": (1.0, math.sqrt(3.0), math.sqrt(8.0 / 3.0)), "hex": (1.0, math.sqrt(3.0), 1.0)}
"""Sides of a cell over the lattice constant, where they are not 1."""

MOST = 5_000_000
"""Places of a lattice; more is a slip of its unit."""

ON_THE_END = 1e-6
"""Part of a cell by which a place on the upper end of the box lies outside."""


class Lattice(NamedTuple):
    """A lattice along the axes.

    Attributes:
        basis: places in a cell, in sides of it.
        cell: sides of a cell [m].
        origin: shift of all places, in sides of a cell.
        spacing: what one unit of the lattice means along each axis [m].
    """

    basis: tuple[tuple[float, ...], ...]
    cell: tuple[float, ...]
    origin: tuple[float, ...]
    spacing: tuple[float, ...]

    def places(self, lower: list[float], upper: list[float], dimension: int) -> np.ndarray:
        """(N, 3) all places with lower <= x < upper [m]; in a plane those at z = 0.

        Raises:
            Unknown: there are none, or too many.
        """
        if not self.basis:
            raise Unknown("the lattice has no places; give a lattice such as sc before it")
        cell = np.asarray(self.cell)
        first = np.floor(np.asarray(lower) / cell).astype(int) - 1
        last = np.ceil(np.asarray(upper) / cell).astype(int) + 1
        if dimension == 2:
            first[2], last[2] = 0, 0
        count = len(self.basis) * math.prod((last - first + 1).tolist())
        if count > MOST:
            raise Unknown(f"the lattice has {count:.3g} places, the limit is {MOST}; check its unit")
        steps = np.stack(
            np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(first, last, strict=True)), indexing="ij"), -1
        )
        cells = steps.reshape(-1, 1, 3) + np.asarray(self.origin)
        points = ((cells + np.asarray(self.basis)) * cell).reshape(-1, 3)
        axes, near = slice(0, dimension), ON_THE_END * cell
        inside = (points >= np.asarray(lower) - near)[:, axes].all(axis=1)
        inside &= (points < np.asarray(upper) - near)[:, axes].all(axis=1)
        return points[inside]


def lattice_of(words: list[str], unit: float) -> Lattice:
    """The lattice of `lattice STYLE SCALE [origin x y z] [spacing dx dy dz]`; `unit` is that of length [m].

    Raises:
        Unknown: it is of another style, or turned.
    """
    style, scale = words[1], numbers(words[2:], 1)[0] * unit
    if style not in BASES:
        raise Unknown(f"a lattice {style} has no counterpart; use {', '.join(BASES)}")
    cell = tuple(scale * side for side in CELLS.get(style, (1.0, 1.0, 1.0)))
    origin, spacing, rest = (0.0, 0.0, 0.0), cell, words[3:]
    while rest:
        if rest[0] == "origin":
            origin = tuple(numbers(rest[1:], 3))  # type: ignore[assignment]
        elif rest[0] == "spacing":
            spacing = tuple(unit * value for value in numbers(rest[1:], 3))
        else:
            raise Unknown(f"{rest[0]} of a lattice has no counterpart; write the particles into a text file")
        rest = rest[4:]
    return Lattice(BASES[style], cell, origin, spacing)

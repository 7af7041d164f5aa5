"""Particles that a deck itself names: those of a file, and those that commands create and change."""

from __future__ import annotations

import io
from dataclasses import dataclass, field

import numpy as np

from jaxdem.foreign.region import Region
from jaxdem.particle_files import Columns

DEFAULT_DIAMETER, DEFAULT_DENSITY = 1.0, 1.0
"""Of particles that `create_atoms` makes, in the units of the deck. Source: LAMMPS documentation, `create_atoms`."""


def _rows(width: int) -> np.ndarray:
    return np.zeros((0, width)) if width else np.zeros(0)


@dataclass
class Atoms:
    """Particles, in SI units and in the coordinates of the deck.

    Attributes:
        position, velocity, spin: (N, 3) [m], [m/s], [rad/s].
        diameter: (N,) [m].
        density: (N,) [kg/m3].
        type: (N,) of the deck.
        id: (N,) of the deck.
        waiting: for each row whether its place is still to be drawn in a region, and in which: number in `regions`,
            -1 for none.
        regions: in which places are drawn, with the seed of each.
        from_file: whether they are those of a file, unchanged.
    """

    position: np.ndarray = field(default_factory=lambda: _rows(3))
    velocity: np.ndarray = field(default_factory=lambda: _rows(3))
    spin: np.ndarray = field(default_factory=lambda: _rows(3))
    diameter: np.ndarray = field(default_factory=lambda: _rows(0))
    density: np.ndarray = field(default_factory=lambda: _rows(0))
    type: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    id: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    waiting: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    regions: list[tuple[Region, int]] = field(default_factory=list)
    from_file: bool = False

    COLUMNS = ("position", "velocity", "spin", "diameter", "density", "type", "id", "waiting")

    def __len__(self) -> int:
        return len(self.position)

    def add(self, position: np.ndarray, kind: int, diameter: float, density: float, waiting: int = -1) -> None:
        """Further particles at rest at these places (N, 3)."""
        count, first = len(position), int(self.id.max(initial=0)) + 1
        more = Atoms(
            position, np.zeros((count, 3)), np.zeros((count, 3)), np.full(count, diameter), np.full(count, density),
            np.full(count, kind), first + np.arange(count), np.full(count, waiting),
        )  # fmt: skip
        for name in self.COLUMNS:
            setattr(self, name, np.concatenate([getattr(self, name), getattr(more, name)]))
        self.from_file = False

    def keep(self, rows: np.ndarray) -> None:
        """Only these rows (N,) bool."""
        for name in self.COLUMNS:
            setattr(self, name, getattr(self, name)[rows])
        self.from_file = False

    def as_csv(self, axes: tuple[int, ...], types: bool) -> str:
        """A text with named columns, as `particles.file` reads it.

        Args:
            axes: of the deck that the scene has.
            types: whether the column type is needed.
        """
        names = ["x", "y", "z"] if len(axes) == 3 else ["x", "z"]
        keep = list(axes)
        columns = [(f"{name} [m]", self.position[:, k]) for name, k in zip(names, keep, strict=True)]
        columns += [("radius [m]", 0.5 * self.diameter), ("density [kg/m3]", self.density)]
        if self.velocity.any():
            columns += [(f"v{name} [m/s]", self.velocity[:, k]) for name, k in zip(names, keep, strict=True)]
        if self.spin.any():
            turning = [("wx", 0), ("wy", 1), ("wz", 2)] if len(axes) == 3 else [("w", 2)]
            columns += [(f"{name} [rad/s]", self.spin[:, k]) for name, k in turning]
        if types:
            columns.append(("type", self.type))
        text = io.StringIO()
        text.write(",".join(name for name, _ in columns) + "\n")
        np.savetxt(text, np.stack([values for _, values in columns], axis=1), fmt="%.12g", delimiter=",")
        return text.getvalue()


def atoms_of(columns: Columns, diameter: float, density: float) -> Atoms:
    """The particles of a file; those that it does not give have this diameter [m] and density [kg/m3]."""
    numbers = columns.numbers
    count = len(next(iter(numbers.values())))

    def vector(prefix: str) -> np.ndarray:
        return np.stack([numbers.get(f"{prefix}{axis}", np.zeros(count)) for axis in "xyz"], axis=1)

    radius = numbers.get("radius", np.full(count, 0.5 * diameter))
    kinds = np.ones(count, int) if columns.types is None else columns.types
    return Atoms(
        vector(""), vector("v"), vector("w"), 2.0 * radius, numbers.get("density", np.full(count, density)), kinds,
        1 + np.arange(count), np.full(count, -1), from_file=True,
    )  # fmt: skip

"""All contacts at a time."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics.static import static
from jaxdem.observables.contact_table import columns_of, contact_rows, touching_in_order
from jaxdem.particles.neighbors import Neighbors
from jaxdem.probes.base import Column, Interval, Probe
from jaxdem.state import Parameters, State
from jaxdem.structure import Structure


@static
class ContactsProbe(Probe):
    """The contacts at the times of the rows, a line each; static.

    Attributes:
        name: of the probe.
        axes: names of the axes.
    """

    name: str
    axes: str
    SELECTS: ClassVar[bool] = True

    @property
    def columns(self) -> tuple[Column, ...]:
        """See `Probe`; the columns of `observables.contact_table`."""

        def vector(name: str, unit: str) -> tuple[Column, ...]:
            return tuple(Column(f"{name}_{axis}", unit) for axis in self.axes)

        return (
            *(Column(name, "-") for name in ("first", "second", "wall")),
            *vector("position", "m"),
            Column("overlap", "m"),
            *vector("normal", "-"),
            *vector("force", "N"),
            Column("normal_force", "N"),
            Column("tangential_force", "N"),
            Column("mobilised", "-"),
        )

    def rows(self, state: State, neighbors: Neighbors | None) -> int:
        """See `Probe`: pairs of the list, and particles at walls."""
        listed = required(neighbors, "neighbors")
        springs, count = required(state.particles, "particles").wall_spring, 0
        if springs:
            count = springs[0].shape[0] * listed.reference[0].shape[0]  # on several devices with the ghosts
        return count + (listed.room.pairs if listed.room.slots else 0)

    def measure(self, structure: Structure, parameters: Parameters, interval: Interval) -> dict[str, Array]:
        """See `Probe`."""
        neighbors = required(interval.neighbors, "neighbors")
        table = contact_rows(structure, parameters, interval.after, neighbors)
        dtype = table.overlap.dtype
        return {name: column.astype(dtype) for name, column in columns_of(table, self.axes).items()}

    def written(self, means: dict[str, np.ndarray]) -> np.ndarray:
        """See `Probe`."""
        return touching_in_order(means)

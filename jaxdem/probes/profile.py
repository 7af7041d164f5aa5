"""Means over boxes or slices."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics.static import static
from jaxdem.observables.boxes import Boxes
from jaxdem.observables.profile import (
    FluidSums,
    ParticleSums,
    fluid_means,
    fluid_sums,
    particle_means,
    particle_sums,
)
from jaxdem.probes.base import Column, Interval, Probe
from jaxdem.state import Parameters
from jaxdem.structure import Structure

PARTICLES, FLUID = "particles.", "fluid."
"""Before the names of sums that are measured."""


@static
class ProfileProbe(Probe):
    """Means over boxes or slices; static.

    Sums are averaged over time, and means are made of them: a velocity is weighted by the mass that was there.

    Attributes:
        name: of the probe.
        axes: names of the axes.
        lower, upper, cut, depth: see `observables.Boxes`.
        with_particles, with_fluid: what the scene has.
    """

    name: str
    axes: str
    lower: tuple[tuple[float, ...], ...]
    upper: tuple[tuple[float, ...], ...]
    cut: tuple[int, ...]
    depth: float
    with_particles: bool
    with_fluid: bool
    NUMBERS: ClassVar[tuple[str, ...]] = ("lower", "upper", "depth")

    @property
    def columns(self) -> tuple[Column, ...]:
        """See `Probe`."""
        axes, pairs = self.axes, [a + b for a in self.axes for b in self.axes]
        found: list[Column] = []
        if self.with_particles:
            found += [Column("particles", "-"), Column("solid_fraction", "-")]
            found += [Column(f"velocity_{axis}", "m/s") for axis in axes]
            found += [Column("granular_temperature", "m2/s2"), Column("coordination", "-")]
            found += [Column(f"stress_{pair}", "Pa") for pair in pairs]
            found += [Column(f"streaming_stress_{pair}", "Pa") for pair in pairs]
        if self.with_fluid:
            found += [Column("void_fraction", "-")]
            found += [
                Column(f"{kind}_{axis}", "m/s") for kind in ("fluid_velocity", "superficial_velocity") for axis in axes
            ]
            found += [Column("fluid_pressure", "Pa")]
        return tuple(found)

    @property
    def measured(self) -> tuple[Column, ...]:
        """See `Probe`."""
        size = len(self.axes)
        ranks = {"momentum": 1, "flow": 1, "fluctuation": 2, "contact": 2}
        tables = ((PARTICLES, ParticleSums, self.with_particles), (FLUID, FluidSums, self.with_fluid))
        return tuple(
            Column(f"{table}{name}", "", shape=(size,) * ranks.get(name, 0))
            for table, kind, there in tables
            for name in (kind._fields if there else ())
        )

    @property
    def places(self) -> tuple[tuple[Column, np.ndarray], ...]:
        """See `Probe`."""
        lower, upper = np.asarray(self.lower), np.asarray(self.upper)
        shown = self.cut or tuple(range(len(self.axes)))
        middle = [(Column(self.axes[k], "m"), 0.5 * (lower + upper)[:, k]) for k in shown]
        ends = [
            (Column(f"{self.axes[k]}_{name}", "m"), corner[:, k])
            for k in shown
            for name, corner in (("lower", lower), ("upper", upper))
        ]
        return (*middle, *ends)

    def measure(self, structure: Structure, parameters: Parameters, interval: Interval) -> dict[str, Array]:
        """See `Probe`."""
        boxes, state = Boxes(self.lower, self.upper, self.cut, self.depth), interval.after
        found: dict[str, Array] = {}
        if self.with_particles:
            neighbors = required(interval.neighbors, "neighbors")
            found |= _named(PARTICLES, particle_sums(structure, parameters, boxes, state, neighbors))
        if self.with_fluid:
            found |= _named(FLUID, fluid_sums(structure, parameters, boxes, state))
        return found

    def values(self, means: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """See `Probe`."""
        given: dict[str, Any] = dict(means)
        found: dict[str, Any] = {}
        if self.with_particles:
            particles = particle_means(ParticleSums(*(given[PARTICLES + name] for name in ParticleSums._fields)))
            found |= particles._asdict() | {"particles": particles.number}
        if self.with_fluid:
            fluid = fluid_means(FluidSums(*(given[FLUID + name] for name in FluidSums._fields)))
            found |= {"fluid_velocity": fluid.velocity, "fluid_pressure": fluid.pressure}
            found |= {"superficial_velocity": fluid.superficial_velocity, "void_fraction": fluid.void_fraction}
        columns: dict[str, np.ndarray] = {}
        for name, array in found.items():
            columns |= self._components(name, array)
        return columns

    def _components(self, name: str, array: np.ndarray) -> dict[str, np.ndarray]:
        """Columns of a number, vector or tensor."""
        if array.ndim == 1:
            return {name: array}
        indices = np.ndindex(*array.shape[1:])
        return {f"{name}_{''.join(self.axes[k] for k in index)}": array[(slice(None), *index)] for index in indices}


def _named(table: str, sums: ParticleSums | FluidSums) -> dict[str, Array]:
    return {f"{table}{name}": value for name, value in sums._asdict().items()}

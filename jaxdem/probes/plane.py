"""Flow through a plane."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jax import Array

from jaxdem.numerics.static import static
from jaxdem.observables.flow import Plane, fluid_flow, particle_flow
from jaxdem.probes.base import Column, Interval, Probe
from jaxdem.state import Parameters
from jaxdem.structure import Structure


@static
class PlaneProbe(Probe):
    """Flow of particles and fluid through a plane, along its normal less against it; static.

    Attributes:
        name: of the probe.
        axes: names of the axes.
        axis: that the plane is normal to; None for none: then the flow of the fluid is not measured.
        normal, offset, lower, upper: see `observables.Plane`.
        with_particles, with_fluid: what the scene has.
    """

    name: str
    axes: str
    axis: int | None
    normal: tuple[float, ...]
    offset: float
    lower: tuple[float, ...] | None
    upper: tuple[float, ...] | None
    with_particles: bool
    with_fluid: bool
    NUMBERS: ClassVar[tuple[str, ...]] = ("normal", "offset", "lower", "upper")

    @property
    def columns(self) -> tuple[Column, ...]:
        """See `Probe`."""
        found: list[Column] = []
        if self.with_particles:
            found += [
                Column("number", "-", total=True),
                Column("number_forward", "-", total=True),
                Column("number_flow", "1/s"),
                Column("mass_flow", "kg/s"),
                Column("volume_flow", "m3/s"),
                *(Column(f"momentum_flow_{axis}", "N") for axis in self.axes),
            ]
        if self.with_fluid:
            found += [Column("fluid_volume_flow", "m3/s"), Column("fluid_mass_flow", "kg/s")]
        return tuple(found)

    def measure(self, structure: Structure, parameters: Parameters, interval: Interval) -> dict[str, Array]:
        """See `Probe`."""
        plane = Plane(self.normal, self.offset, self.axis, self.lower, self.upper)
        found: dict[str, Array] = {}
        if self.with_particles:
            flow = particle_flow(structure, parameters, plane, interval.before, interval.moved)
            rate = 1.0 / jnp.asarray(structure.interval, flow.mass.dtype)
            found |= {"number": flow.number, "number_forward": flow.forward, "number_flow": rate * flow.number}
            found |= {"mass_flow": rate * flow.mass, "volume_flow": rate * flow.volume}
            found |= {f"momentum_flow_{axis}": rate * flow.momentum[k] for k, axis in enumerate(self.axes)}
        if self.with_fluid:
            fluid = fluid_flow(structure, parameters, plane, interval.after)
            found |= {"fluid_volume_flow": fluid.volume, "fluid_mass_flow": fluid.mass}
        return {name: value[None] for name, value in found.items()}

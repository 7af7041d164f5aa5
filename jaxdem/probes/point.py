"""The fluid at points."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.numerics.static import static
from jaxdem.observables.point import fluid_at
from jaxdem.probes.base import Column, Interval, Probe
from jaxdem.state import Parameters
from jaxdem.structure import Structure


@static
class PointProbe(Probe):
    """The fluid at points; static.

    Attributes:
        name: of the probe.
        axes: names of the axes.
        points: P of them [m].
    """

    name: str
    axes: str
    points: tuple[tuple[float, ...], ...]
    NUMBERS: ClassVar[tuple[str, ...]] = ("points",)

    @property
    def columns(self) -> tuple[Column, ...]:
        """See `Probe`."""
        velocity = (Column(f"fluid_velocity_{axis}", "m/s") for axis in self.axes)
        return (*velocity, Column("fluid_pressure", "Pa"), Column("void_fraction", "-"))

    @property
    def places(self) -> tuple[tuple[Column, np.ndarray], ...]:
        """See `Probe`."""
        points = np.asarray(self.points)
        return tuple((Column(axis, "m"), points[:, k]) for k, axis in enumerate(self.axes))

    def measure(self, structure: Structure, parameters: Parameters, interval: Interval) -> dict[str, Array]:
        """See `Probe`."""
        found = fluid_at(structure, interval.after, jnp.asarray(self.points))
        velocity = {f"fluid_velocity_{axis}": found.velocity[:, k] for k, axis in enumerate(self.axes)}
        return velocity | {"fluid_pressure": found.pressure, "void_fraction": found.void_fraction}

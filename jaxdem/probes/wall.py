"""Force and torque on a wall."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jax import Array

from jaxdem.numerics.static import static
from jaxdem.observables.walls import (
    fluid_force,
    fluid_torque,
    force_in_fluid,
    mesh_walls,
    side_walls,
    surface_walls,
    torque_in_fluid,
    wall_load,
)
from jaxdem.probes.base import Column, Interval, Probe
from jaxdem.state import Parameters
from jaxdem.structure import Structure


@static
class WallProbe(Probe):
    """What particles and fluid do to a wall; static.

    Attributes:
        name: of the probe.
        axes: names of the axes.
        side: axis and whether upper, of a side of the box; None for a wall of the scene.
        surfaces: numbers of the surfaces of that wall.
        mesh: number of the mesh that it is, from 0; None for another wall.
        about: point of the torque [m].
        turning: components of the torque that have a meaning.
        with_particles, with_fluid: what it measures.
        moves: whether the wall moves, so that the forces on it have a power.
        in_fluid: numbers of its surfaces among those that the fluid sees.
    """

    name: str
    axes: str
    side: tuple[int, bool] | None
    surfaces: tuple[int, ...]
    about: tuple[float, ...]
    turning: tuple[int, ...]
    with_particles: bool
    with_fluid: bool
    moves: bool = False
    mesh: int | None = None
    in_fluid: tuple[int, ...] = ()
    NUMBERS: ClassVar[tuple[str, ...]] = ("about",)

    def walls(self, structure: Structure) -> tuple[int, ...]:
        """Numbers of the walls whose loads by particles it measures."""
        if not self.with_particles:
            return ()
        if self.mesh is not None:
            return mesh_walls(structure, self.mesh)
        return surface_walls(structure, self.surfaces) if self.side is None else side_walls(structure, *self.side)

    @property
    def columns(self) -> tuple[Column, ...]:
        """See `Probe`."""
        found: list[Column] = []
        if self.with_particles:
            found += [Column(f"force_{axis}", "N") for axis in self.axes]
            found += [Column(self._torque(k), "N m") for k in self.turning]
            found += [Column("power", "W")] if self.moves else []
            found += [Column("mass_in_contact", "kg")]
        if self.with_fluid:
            found += [Column(f"fluid_force_{axis}", "N") for axis in self.axes]
            found += [Column(f"fluid_{self._torque(k)}", "N m") for k in self.turning]
        return tuple(found)

    def measure(self, structure: Structure, parameters: Parameters, interval: Interval) -> dict[str, Array]:
        """See `Probe`."""
        found: dict[str, Array] = {}
        if self.with_particles:
            load = wall_load(interval.diagnostics, self.walls(structure), jnp.asarray(self.about))
            found |= {f"force_{axis}": load.force[k] for k, axis in enumerate(self.axes)}
            found |= {self._torque(k): load.torque[k] for k in self.turning}
            found |= {"power": load.power} if self.moves else {}
            found |= {"mass_in_contact": load.mass}
        if self.with_fluid and self.in_fluid:
            force = force_in_fluid(interval.diagnostics, self.in_fluid)
            torque = torque_in_fluid(interval.diagnostics, self.in_fluid, jnp.asarray(self.about))
            found |= {f"fluid_force_{axis}": force[k] for k, axis in enumerate(self.axes)}
            found |= {f"fluid_{self._torque(k)}": torque[k] for k in self.turning}
        if self.with_fluid and self.side is not None:
            force = fluid_force(interval.diagnostics, *self.side)
            torque = fluid_torque(interval.diagnostics, *self.side, jnp.asarray(self.about))
            found |= {f"fluid_force_{axis}": force[k] for k, axis in enumerate(self.axes)}
            found |= {f"fluid_{self._torque(k)}": torque[k] for k in self.turning}
        return {name: value[None] for name, value in found.items()}

    def _torque(self, component: int) -> str:
        return "torque" if len(self.axes) == 2 else f"torque_{self.axes[component]}"

"""A simulation whose box is cut into slabs, one a device."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax
import numpy as np
from jax.sharding import Mesh

from jaxdem.devices.mesh import DIAGNOSTICS, SAME, SLABS, STATE, device_mesh, on_slabs
from jaxdem.devices.refused import require_divisible
from jaxdem.errors import InputError, required
from jaxdem.numerics.blocks import Blocks
from jaxdem.numerics.static import static
from jaxdem.particles.ghosts import Division
from jaxdem.particles.migration import NARROWEST
from jaxdem.particles.neighbors import Neighbors
from jaxdem.simulation import Simulation
from jaxdem.state import Diagnostics, Parameters, State
from jaxdem.step import step

STRAY = 0.5
"""How far particles without a fluid may be out of their slab at the end of an interval, over the largest diameter."""


@static
class DividedSimulation(Simulation):
    """A simulation on several devices; made by `divided`.

    `step` and `jaxdem.rollout` take and give a distributed state; see `jaxdem.devices`.

    Attributes:
        mesh: the devices.
        particles: N, number of all particles that there ever are.
    """

    mesh: Mesh | None = None
    particles: int = 0

    @property
    def division(self) -> Division:
        """How the particles are divided."""
        return required(required(self.contact, "particles").division, "division of the particles")

    @property
    def blocks(self) -> Blocks:
        """The slabs."""
        return self.division.blocks

    def step(
        self, parameters: Parameters, state: State, neighbors: Neighbors | None
    ) -> tuple[State, Neighbors | None, Diagnostics]:
        """Distributed state and list after one coupling interval; see `jaxdem.step`."""
        mapped = on_slabs(
            required(self.mesh, "mesh"),
            lambda *given: step(self, *given),
            (SAME, STATE, SLABS),
            (STATE, SLABS, DIAGNOSTICS),
        )
        found: tuple[State, Neighbors | None, Diagnostics] = mapped(parameters, state, neighbors)
        return found

    def undivided(self) -> Simulation:
        """The same simulation on one device."""
        own = {field.name: getattr(self, field.name) for field in dataclasses.fields(Simulation)}
        if self.contact is not None:
            own["contact"] = dataclasses.replace(self.contact, division=None)
        return Simulation(**own)


def divided(
    simulation: Simulation,
    devices: int | Sequence[jax.Device],
    position: np.ndarray,
    axis: int | None = None,
) -> DividedSimulation:
    """The simulation with its box cut into as many slabs as there are devices.

    Args:
        simulation: from `jaxdem.build`.
        devices: how many, or which.
        position: (N, D) of all particles at the start [m].
        axis: that is cut; the one along which the particles reach farthest if None.

    Raises:
        InputError: there are not so many devices, the slabs would be too narrow, or something in the scene does not
            work on several devices.
    """
    mesh = device_mesh(devices)
    number = mesh.devices.size
    require_divisible(simulation)
    contact, search = required(simulation.contact, "particles"), simulation.search
    if axis is None:
        extent = np.ptp(position, axis=0) if len(position) > 1 else np.asarray(simulation.box)
        axis = int(np.argmax(extent))
    blocks = Blocks(number, axis, simulation.periodic[axis])
    most = int(simulation.box[axis] / (NARROWEST * search.reach))
    if number > max(most, 1):
        limit = f"along the cut axis the box is wide enough for {max(most, 1)} slabs"
        remedy = f"use {max(most, 1)} devices, or a box that is longer along axis {axis}"
        raise InputError("devices", number, limit, remedy)
    division = Division(blocks, simulation.box[axis], STRAY, balanced=True)
    own = {field.name: getattr(simulation, field.name) for field in dataclasses.fields(Simulation)}
    own["contact"] = dataclasses.replace(contact, division=division)
    return DividedSimulation(**own, mesh=mesh, particles=len(position))

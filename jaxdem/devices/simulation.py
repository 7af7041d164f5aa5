"""A simulation whose box is cut into slabs, one a device."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax
import numpy as np
from jax.sharding import Mesh

from jaxdem.devices.cut import STRAY, drift_of, ghosts_by_size, slabs_of
from jaxdem.devices.mesh import DIAGNOSTICS, SLABS, STATE, device_mesh, on_slabs
from jaxdem.devices.parameters import cells_on_devices, in_slabs, of_slabs, on_devices, spread
from jaxdem.errors import required
from jaxdem.numerics.blocks import Blocks
from jaxdem.numerics.static import static
from jaxdem.particles.ghosts import Division
from jaxdem.particles.neighbors import Neighbors
from jaxdem.simulation import Simulation
from jaxdem.state import Diagnostics, Parameters, State
from jaxdem.step import step


@static
class DividedSimulation(Simulation):
    """A simulation on several devices; made by `divided`.

    `step` and `jaxdem.rollout` take and give a distributed state; see `jaxdem.devices`.

    Attributes:
        mesh: the devices.
        blocks: the slabs.
        count: N, number of all particles that there ever are.
        whole: the same simulation on one device.
    """

    mesh: Mesh | None = None
    blocks: Blocks | None = None
    count: int = 0
    # Not a part of what is compiled.
    whole: Simulation | None = dataclasses.field(default=None, compare=False)

    @property
    def slabs(self) -> Blocks:
        """The slabs."""
        return required(self.blocks, "blocks")

    @property
    def division(self) -> Division:
        """How the particles are divided."""
        return required(required(self.contact, "particles").division, "division of the particles")

    def step(
        self, parameters: Parameters, state: State, neighbors: Neighbors | None
    ) -> tuple[State, Neighbors | None, Diagnostics]:
        """Distributed state and list after one coupling interval; see `jaxdem.step`."""
        mapped = on_slabs(
            required(self.mesh, "mesh"),
            lambda *given: step(self, *given),
            (spread(parameters), STATE, SLABS),
            (STATE, SLABS, DIAGNOSTICS),
        )
        found: tuple[State, Neighbors | None, Diagnostics] = mapped(parameters, state, neighbors)
        return found

    def of_slab(self) -> Simulation:
        """What runs within `mesh.on_slabs`: its step is that of one slab, which knows its neighbours."""
        return Simulation(**{field.name: getattr(self, field.name) for field in dataclasses.fields(Simulation)})

    def with_parts(self, parameters: Parameters) -> Parameters:
        """Parameters of one device, in which what belongs to cells is on the devices, of each its slab's part."""
        return cells_on_devices(required(self.mesh, "mesh"), self.in_slabs(parameters))

    def on_devices(self, parameters: Parameters) -> Parameters:
        """The same with all of them on the devices."""
        return on_devices(required(self.mesh, "mesh"), self.in_slabs(parameters))

    def in_slabs(self, parameters: Parameters) -> Parameters:
        """The same on the host."""
        whole = required(self.whole, "whole")
        return in_slabs(self.slabs, whole.walls_in_fluid, parameters)

    def of_whole(self, parameters: Parameters) -> Parameters:
        """The inverse of `with_parts`; every process must call it."""
        return of_slabs(self.slabs, parameters)

    def undivided(self) -> Simulation:
        """The same simulation on one device."""
        return required(self.whole, "whole")


def divided(
    simulation: Simulation,
    devices: int | Sequence[jax.Device],
    position: np.ndarray | None = None,
    count: int | None = None,
    axis: int | None = None,
) -> DividedSimulation:
    """The simulation with its box cut into as many slabs as there are devices.

    Args:
        simulation: from `jaxdem.build`.
        devices: how many, or which.
        position: (M, D) of the particles that there are at the start [m]; None for none.
        count: N, number of all that there ever are; M if None.
        axis: that is cut; None for the best, see `slabs_of`.

    Raises:
        InputError: there are not so many devices, the slabs would be too narrow, or something in the scene does not
            work on several devices.
    """
    mesh, whole = device_mesh(devices), simulation
    blocks = slabs_of(simulation, mesh.devices.size, position, axis)
    own = {field.name: getattr(simulation, field.name) for field in dataclasses.fields(Simulation)}
    if simulation.contact is not None:
        balanced, by_size = simulation.fluid is None, ghosts_by_size(simulation)
        division = Division(blocks, simulation.box[blocks.axis], STRAY, balanced, by_size)
        own["contact"] = dataclasses.replace(simulation.contact, division=division)
    if simulation.fluid is not None:
        drift = drift_of(simulation)
        own["fluid"] = simulation.fluid.in_blocks(blocks, drift)
        if simulation.walls_in_fluid is not None:
            own["walls_in_fluid"] = simulation.walls_in_fluid.in_blocks(blocks)
        if simulation.coupling is not None:
            own["coupling"] = simulation.coupling.in_blocks(blocks, drift)
    if count is None:
        count = 0 if position is None else len(position)
    return DividedSimulation(**own, mesh=mesh, blocks=blocks, count=count, whole=whole)

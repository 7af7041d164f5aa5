"""Where a run has got to, for what it writes. Host side."""

from __future__ import annotations

import dataclasses

import numpy as np
from jax import Array

from jaxdem.coupling.exchange_result import FluidForces
from jaxdem.devices import DividedSimulation
from jaxdem.particles.integrate import ParticleState
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.regions import into_period
from jaxdem.setup.builder import Case
from jaxdem.simulation import Simulation
from jaxdem.state import State


@dataclasses.dataclass(frozen=True)
class InSlabs:
    """A state on several devices.

    Attributes:
        simulation: in slabs.
        state, neighbors: distributed.
    """

    simulation: DividedSimulation
    state: State
    neighbors: Neighbors


@dataclasses.dataclass(frozen=True)
class Instant:
    """Where a run has got to.

    Attributes:
        time: simulated time [s].
        state: at that time.
        neighbors: its list, None without particles and on several devices.
        forces: of the fluid in the interval before, None at the start and without fluid or particles.
        identity: on several devices, of the particles that the rows of the forces belong to.
        slabs: on several devices, the same state in slabs; None without particles.
    """

    time: float
    state: State
    neighbors: Neighbors | None
    forces: FluidForces | None
    identity: Array | None = None
    slabs: InSlabs | None = None


def open_cells(case: Case, instant: Instant) -> np.ndarray | None:
    """Open part of every cell of the fluid, where walls are at an instant [-]; None without walls that it sees."""
    pistons = None if instant.state.particles is None else instant.state.particles.pistons
    ways = None if pistons is None else np.asarray(pistons.displacement, np.float64).tolist()
    return case.fluid_walls.open_cells(case.scene, instant.time, ways)


def wrapped_position(simulation: Simulation, particles: ParticleState) -> np.ndarray:
    """(N, D) centres, inside the box along its periodic axes [m]."""
    position = np.asarray(particles.position)
    if not any(simulation.periodic):
        return position
    # In float64: far from the box the leading part alone is off by more than what grains overlap.
    low = particles.position_low
    centre = position.astype(np.float64) + (0.0 if low is None else np.asarray(low, np.float64))
    inside = into_period(centre, np.asarray(simulation.box)).astype(position.dtype)
    return np.where(simulation.periodic, inside, position)


def present(state: State, count: int) -> np.ndarray:
    """(N,) bool, particles that are there, of `count` that there ever are."""
    active = None if state.particles is None else state.particles.active
    return np.ones(count, bool) if active is None else np.asarray(active)

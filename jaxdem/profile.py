"""Where the time of a run went: measured parts of a step, split by stages that are replayed on their own."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import jax

from jaxdem.coupling.forces import drag_inputs
from jaxdem.coupling.interpolation import deposit_on_faces
from jaxdem.coupling.void_fraction import solid_fraction
from jaxdem.fluid.pressure import pressure_gradient
from jaxdem.particles import vectors
from jaxdem.particles.integrate import split_low
from jaxdem.particles.neighbors import Neighbors, carry_history
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State

if TYPE_CHECKING:
    from jaxdem.records import Totals

WORTH_SPLITTING = 20.0
"""A part of the run shorter than this is not replayed: compiling the stages would take as long [s]."""


def estimate_stages(
    simulation: Simulation,
    parameters: Parameters,
    state: State,
    neighbors: Neighbors | None,
    totals: Totals,
) -> tuple[dict[str, float | None], list[str]]:
    """Wall time by stage [s], and the names of those that are estimates.

    The fluid part and the particle part of every step are measured. Neighbour builds, exchange between
    particles and mesh, and drag law are parts of these; in a run that is long enough they are compiled
    alone, replayed at the final state and multiplied by their counts, the rest being contact and fluid.
    In a short run they are not told apart and stand as null, inside `contact` and `fluid`.
    """
    fluid, particles = totals.stages["fluid_part"], totals.stages["particle_part"]
    stages: dict[str, float | None] = {
        "contact": particles,
        "neighbors": None,
        "coupling": None,
        "drag": None,
        "fluid": fluid,
        "output": totals.stages["output"],
    }
    estimated: list[str] = []
    if neighbors is not None and neighbors.room.slots and particles > WORTH_SPLITTING:
        share = min(_neighbors_time(simulation, state, neighbors) * totals.builds, particles)
        stages |= {"neighbors": share, "contact": particles - share}
        estimated += ["neighbors", "contact"]
    if simulation.fluid is not None and state.particles is not None and fluid > WORTH_SPLITTING:
        drag, coupling = _exchange_times(simulation, parameters, state)
        drag = min(drag * totals.intervals, fluid)
        coupling = min(coupling * (totals.intervals + totals.fluid_steps), fluid - drag)
        stages |= {"drag": drag, "coupling": coupling, "fluid": fluid - drag - coupling}
        estimated += ["drag", "coupling", "fluid"]
    return stages, estimated


def _neighbors_time(simulation: Simulation, state: State, neighbors: Neighbors) -> float:
    assert state.particles is not None
    position = vectors.components(state.particles.position)
    low = split_low(state.particles.position_low, len(position))
    active = state.particles.active

    def rebuild(neighbors: Neighbors, springs: Any, position: Any, low: Any) -> Any:
        new = simulation.search.update(position, low, neighbors, active)
        return new, carry_history(springs, neighbors, new)

    return _seconds(jax.jit(rebuild), neighbors, state.particles.contact_spring, position, low)


def _exchange_times(simulation: Simulation, parameters: Parameters, state: State) -> tuple[float, float]:
    """Seconds of one drag evaluation, and of one round of weights, deposit and interpolation."""
    assert simulation.fluid is not None and simulation.fluid.deposition is not None
    assert state.particles is not None and state.fluid is not None
    interval, fluid, bodies = simulation.fluid, parameters.fluid, parameters.bodies
    deposition = simulation.fluid.deposition
    assert fluid is not None and bodies is not None
    grid, boundary = interval.solver.grid, interval.solver.boundary

    def round_trip(state: State) -> Any:
        assert state.particles is not None and state.fluid is not None
        weights = deposition.weights(grid, state.particles.position, bodies.radius)
        solids = solid_fraction(grid, weights, bodies.volume)
        slope = pressure_gradient(grid, boundary, state.fluid.pressure, continued=True)
        inputs = drag_inputs(
            grid, weights, state.particles.velocity, 2.0 * bodies.radius, state.fluid.face_velocity,
            slope, solids, fluid.density, fluid.viscosity,
        )  # fmt: skip
        return inputs, deposit_on_faces(grid, weights, state.particles.velocity)

    closure: Any = simulation.drag_law if parameters.closure is None else parameters.closure
    inputs = jax.jit(round_trip)(state)[0]
    return _seconds(jax.jit(closure.__call__), inputs), _seconds(jax.jit(round_trip), state)


def _seconds(function: Callable[..., Any], *arguments: Any) -> float:
    """Shortest of three calls after the first [s]."""
    jax.block_until_ready(function(*arguments))
    times = []
    for _ in range(3):
        begin = clock.perf_counter()
        jax.block_until_ready(function(*arguments))
        times.append(clock.perf_counter() - begin)
    return min(times)

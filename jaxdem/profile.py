"""Where the time of a run went: measured parts of a step, split by stages that are replayed on their own."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import jax

from jaxdem.coupling import exchange
from jaxdem.coupling.interpolation import deposit_on_faces, interpolate_faces
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
    worth_splitting: float = WORTH_SPLITTING,
) -> tuple[dict[str, float | None], list[str]]:
    """Wall time by stage [s], and the names of those that are estimates.

    The fluid part and the particle part of every step are measured. Neighbour builds, exchange between
    particles and mesh, and drag law are parts of these; in a run that is long enough they are compiled
    alone, replayed at the final state and multiplied by their counts, the rest being contact and fluid.
    A part shorter than `worth_splitting` [s] is not told apart: its stages stand as null, inside `contact` and `fluid`.
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
    if neighbors is not None and neighbors.room.slots and particles > worth_splitting:
        share = min(_neighbors_time(simulation, state, neighbors) * totals.builds, particles)
        stages |= {"neighbors": share, "contact": particles - share}
        estimated += ["neighbors", "contact"]
    if simulation.fluid is not None and state.particles is not None and fluid > worth_splitting:
        drag, shown, transfer = _exchange_times(simulation, parameters, state)
        drag = min(drag * totals.intervals, fluid)
        coupling = min(shown * totals.intervals + transfer * totals.fluid_steps, fluid - drag)
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


def _exchange_times(
    simulation: Simulation, parameters: Parameters, state: State
) -> tuple[float, float, float]:
    """Seconds an interval takes for the drag law, and for weights and inputs; and a fluid step for its transfers."""
    shown, drag, transfer = exchange_pieces(simulation, parameters)
    seen = jax.jit(shown)(state)
    return (
        _seconds(jax.jit(drag), state, seen),
        _seconds(jax.jit(shown), state),
        _seconds(jax.jit(transfer), state, seen),
    )


def exchange_pieces(
    simulation: Simulation, parameters: Parameters
) -> tuple[Callable[..., Any], Callable[..., Any], Callable[..., Any]]:
    """What the exchange does to show the law the fluid, to evaluate the law, and to carry one fluid step's impulses to and fro.

    The first takes a state, the others a state and what the first gives. The first two are the functions of the exchange.
    """
    interval, fluid, bodies = simulation.fluid, parameters.fluid, parameters.bodies
    assert interval is not None and fluid is not None and bodies is not None
    assert parameters.drag_scale is not None
    grid, boundary, scale = interval.solver.grid, interval.solver.boundary, parameters.drag_scale
    closure: Any = simulation.drag_law if parameters.closure is None else parameters.closure

    def shown(state: State) -> Any:
        assert state.particles is not None and state.fluid is not None
        return exchange.seen_fluid(interval, fluid, bodies, state.fluid, state.particles)

    def drag(state: State, seen: Any) -> Any:
        assert state.particles is not None
        weights, _, inputs, given = seen
        law = exchange.drag_of_model(interval, closure, scale, bodies, weights)
        steady = exchange.steady_force(fluid, bodies, parameters.gravity, state.particles)
        return exchange.interval_drag(interval, law, bodies, inputs, given, state.particles.active, steady)

    def transfer(state: State, seen: Any) -> Any:
        assert state.particles is not None and state.fluid is not None
        weights, velocity = seen[0], state.particles.velocity
        slope = pressure_gradient(grid, boundary, state.fluid.pressure, continued=True)
        there = deposit_on_faces(grid, weights, velocity[:, 0]), deposit_on_faces(grid, weights, velocity)
        return there, interpolate_faces(weights, state.fluid.face_velocity), interpolate_faces(weights, slope)

    return shown, drag, transfer


def _seconds(function: Callable[..., Any], *arguments: Any) -> float:
    """Shortest of three calls after the first [s]."""
    jax.block_until_ready(function(*arguments))
    times = []
    for _ in range(3):
        begin = clock.perf_counter()
        jax.block_until_ready(function(*arguments))
        times.append(clock.perf_counter() - begin)
    return min(times)

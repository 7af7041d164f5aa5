"""Where the time of a run went: measured parts of a step, split by stages that are replayed on their own."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from functools import partial
from typing import Any

import jax

from jaxdem.coupling.interpolation import deposit_on_faces, interpolate_faces
from jaxdem.fluid.pressure import pressure_gradient
from jaxdem.numerics import vectors
from jaxdem.particles.integrate import split_low
from jaxdem.particles.neighbors import Neighbors, carry_history
from jaxdem.run.totals import Totals
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State
from jaxdem.step import advance_fluid

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

    A step is one program. What of its time is the fluid's and what the particles' is measured in a run with `profile`; in a run
    that is long enough the fluid's part is compiled alone, replayed at the final state and multiplied by the number of
    intervals. Neighbour builds, exchange between particles and mesh, and drag law are parts of these two, found in the
    same way; the rest is `contact` and `fluid`. What is shorter than `worth_splitting` [s] is not told apart: its stages are null.
    """
    step, output = totals.stages["step"], totals.stages["output"]
    particles: float | None = totals.stages["particle_part"]
    fluid: float | None = totals.stages["fluid_part"]
    estimated: list[str] = []
    if simulation.fluid is None or simulation.contact is None:
        fluid, particles = (0.0, step) if simulation.fluid is None else (step, 0.0)
    elif not fluid and step > worth_splitting:
        fluid = min(_fluid_time(simulation, parameters, state) * totals.intervals, step)
        particles = step - fluid
        estimated = ["contact", "fluid"]
    elif not fluid:
        fluid = particles = None
    stages: dict[str, float | None] = {
        "step": step,
        "contact": particles,
        "neighbors": None,
        "coupling": None,
        "drag": None,
        "fluid": fluid,
        "output": output,
    }
    if neighbors is not None and neighbors.room.slots and (particles or 0.0) > worth_splitting:
        assert particles is not None
        share = min(_neighbors_time(simulation, state, neighbors) * totals.builds, particles)
        stages |= {"neighbors": share, "contact": particles - share}
        estimated += ["neighbors", "contact"]
    if simulation.coupling is not None and (fluid or 0.0) > worth_splitting:
        assert fluid is not None
        drag, shown, transfer = _exchange_times(simulation, parameters, state)
        drag = min(drag * totals.intervals, fluid)
        coupling = min(shown * totals.intervals + transfer * totals.fluid_steps, fluid - drag)
        stages |= {"drag": drag, "coupling": coupling, "fluid": fluid - drag - coupling}
        estimated += ["drag", "coupling", "fluid"]
    return stages, list(dict.fromkeys(estimated))


def _fluid_time(simulation: Simulation, parameters: Parameters, state: State) -> float:
    """Seconds of the fluid's part of an interval."""
    return _seconds(jax.jit(partial(advance_fluid, simulation)), parameters, state)


def _neighbors_time(simulation: Simulation, state: State, neighbors: Neighbors) -> float:
    assert state.particles is not None
    position = vectors.components(state.particles.position)
    low = split_low(state.particles.position_low, len(position))
    active = state.particles.active

    def rebuild(neighbors: Neighbors, springs: Any, position: Any, low: Any) -> Any:
        new = simulation.search.update(position, low, neighbors, active)
        return new, carry_history(springs, neighbors, new)

    return _seconds(jax.jit(rebuild), neighbors, state.particles.contact_spring, position, low)


def _exchange_times(simulation: Simulation, parameters: Parameters, state: State) -> tuple[float, float, float]:
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
    coupling, mixture = simulation.coupling, parameters.mixture
    assert coupling is not None
    grid, boundary = coupling.interval.solver.grid, coupling.interval.solver.boundary

    def shown(state: State) -> Any:
        assert state.particles is not None and state.fluid is not None
        return coupling.sample(mixture, state.fluid, state.particles)

    def drag(state: State, seen: Any) -> Any:
        assert state.particles is not None and state.fluid is not None
        start = coupling.start(mixture, state.fluid, state.particles, seen)
        return coupling.drag_over(mixture, start, seen, {})

    def transfer(state: State, seen: Any) -> Any:
        assert state.particles is not None and state.fluid is not None
        weights, velocity = seen.weights, state.particles.velocity
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

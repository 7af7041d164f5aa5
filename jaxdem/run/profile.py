"""Where the time of a run went: measured parts of a step, split by stages that are replayed on their own."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxdem.coupling.coupled import SampledFluid
from jaxdem.coupling.exchange import Exchange
from jaxdem.errors import required
from jaxdem.fluid.fluid_state import FluidState, FluidStep
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.clump_forces import updated
from jaxdem.particles.integrate import Motion, ParticleState
from jaxdem.particles.neighbors import Neighbors, carry_history
from jaxdem.run.instant import Instant
from jaxdem.run.totals import Totals
from jaxdem.setup.builder import Case
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State
from jaxdem.step import advance_fluid

WORTH_SPLITTING = 20.0
"""A part of the run shorter than this is not replayed: compiling the stages would take as long [s]."""


def estimate_stages(
    case: Case, instant: Instant, totals: Totals, worth_splitting: float = WORTH_SPLITTING
) -> tuple[dict[str, float | None], list[str]]:
    """Wall time by stage [s], and the names of those that are estimates.

    A step is one program. What of its time is the fluid's and what the particles' is measured in a run with `profile`;
    on one device, in a run that is long enough, the fluid's part is compiled alone, replayed at the final state and
    multiplied by the number of intervals. Neighbour builds, exchange between particles and mesh, and drag law are parts
    of these two, found in the same way; the rest is `contact` and `fluid`. What is shorter than `worth_splitting` [s],
    and on several devices, is not told apart: its stages are null.
    """
    simulation, parameters = case.simulation, case.parameters
    state, neighbors = instant.state, instant.neighbors
    step, output = totals.stages["step"], totals.stages["output"]
    particles: float | None = totals.stages["particle_part"]
    fluid: float | None = totals.stages["fluid_part"]
    estimated: list[str] = []
    if simulation.fluid is None or simulation.contact is None:
        fluid, particles = (0.0, step) if simulation.fluid is None else (step, 0.0)
    elif not fluid and step > worth_splitting and instant.slabs is None:
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
    if neighbors is not None and neighbors.room.slots and particles is not None and particles > worth_splitting:
        share = min(_neighbors_time(simulation, state, neighbors) * totals.builds, particles)
        stages |= {"neighbors": share, "contact": particles - share}
        estimated += ["neighbors", "contact"]
    if simulation.coupling is not None and fluid is not None and fluid > worth_splitting and instant.slabs is None:
        drag, seen, transfer = _exchange_times(simulation, parameters, state)
        drag = min(drag * totals.intervals, fluid)
        coupling = min(seen * totals.intervals + transfer * totals.fluid_steps, fluid - drag)
        stages |= {"drag": drag, "coupling": coupling, "fluid": fluid - drag - coupling}
        estimated += ["drag", "coupling", "fluid"]
    return stages, list(dict.fromkeys(estimated))


def _fluid_time(simulation: Simulation, parameters: Parameters, state: State) -> float:
    """Seconds of the fluid's part of an interval."""
    return _seconds(jax.jit(partial(advance_fluid, simulation)), parameters, state)


def _neighbors_time(simulation: Simulation, state: State, neighbors: Neighbors) -> float:
    @jax.jit
    def rebuild(particles: ParticleState, neighbors: Neighbors) -> tuple[Neighbors, Vector]:
        new = updated(simulation.search, Motion.of(particles), neighbors, particles.active)
        return new, carry_history(particles.contact_spring, neighbors, new)

    return _seconds(rebuild, state.particles, neighbors)


def _exchange_times(simulation: Simulation, parameters: Parameters, state: State) -> tuple[float, float, float]:
    """Seconds an interval takes for the drag law, and for weights and inputs; and a fluid step for its transfers."""
    pieces = exchange_pieces(simulation, parameters)
    begun, result = jax.jit(pieces.begin)(state), blank(pieces.advance, state)
    return (
        _seconds(jax.jit(pieces.drag), state, begun.sampled),
        _seconds(jax.jit(pieces.sample), state),
        _seconds(jax.jit(pieces.transfer), state, begun, result),
    )


class Begun(NamedTuple):
    """The start of an interval: the fluid at the particles, and the arrays of the `Exchange`, by name."""

    sampled: SampledFluid
    arrays: dict[str, Any]


class ExchangePieces(NamedTuple):
    """The exchange's own functions, each alone.

    Attributes:
        sample: of a state, the fluid as the drag law sees it.
        drag: of a state and this sample, evaluates the law.
        begin: of a state, all that is done at the start of an interval.
        advance: of a state, a fluid step without particles.
        transfer: of a state, what has begun and a fluid step's result, carries the impulses of this step to and fro.
    """

    sample: Callable[[State], SampledFluid]
    drag: Callable[[State, SampledFluid], Any]
    begin: Callable[[State], Begun]
    advance: Callable[[State], FluidStep]
    transfer: Callable[[State, Begun, FluidStep], Any]


def exchange_pieces(simulation: Simulation, parameters: Parameters) -> ExchangePieces:
    """The pieces of a step of a coupled simulation that are timed."""
    coupling, mixture = required(simulation.coupling, "coupling"), parameters.mixture
    static = ("interval", "further", "start")

    def both(state: State) -> tuple[FluidState, ParticleState]:
        return required(state.fluid, "fluid"), required(state.particles, "particles")

    def sample(state: State) -> SampledFluid:
        return coupling.sample(mixture, *both(state))

    def drag(state: State, sampled: SampledFluid) -> Any:
        return coupling.drag_over(mixture, coupling.start(mixture, *both(state), sampled), sampled, {})

    def begin(state: State) -> Begun:
        exchange = coupling.begin(mixture, *both(state), simulation.time(parameters, state))
        return Begun(sample(state), {name: value for name, value in vars(exchange).items() if name not in static})

    def advance(state: State) -> FluidStep:
        duration = jnp.asarray(simulation.interval, parameters.gravity.dtype)
        return coupling.interval.solver.step(mixture.properties, both(state)[0], jnp.zeros_like(duration), duration)

    def transfer(state: State, begun: Begun, result: FluidStep) -> Any:
        start = coupling.start(mixture, *both(state), begun.sampled)
        exchange = Exchange(coupling.interval, coupling.forces, start, **begun.arrays)
        carry = exchange.first(both(state)[0])
        explicit = exchange.explicit_terms(carry)
        return exchange.received(carry, explicit, exchange.on_faces(carry, explicit), result)

    return ExchangePieces(sample, drag, begin, advance, transfer)


def blank(function: Callable[..., Any], *arguments: Any) -> Any:
    """Zeros in the shape of a result, which is not computed."""
    return jax.tree.map(lambda array: jnp.zeros(array.shape, array.dtype), jax.eval_shape(function, *arguments))


def _seconds(function: Callable[..., Any], *arguments: Any) -> float:
    """Shortest of three calls after the first [s]."""
    jax.block_until_ready(function(*arguments))
    times = []
    for _ in range(3):
        begin = clock.perf_counter()
        jax.block_until_ready(function(*arguments))
        times.append(clock.perf_counter() - begin)
    return min(times)

"""One step: an interval of the fluid among resting particles, then of the particles under the fluid's forces."""

from __future__ import annotations

from jax import Array, named_scope

from jaxdem.coupling.exchange_result import ExchangeDiagnostics, FluidForces
from jaxdem.errors import required
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.interval import FluidDiagnostics
from jaxdem.particle_step import at_end_of_interval, buried_particles, moved_particles, of_rows, particle_report
from jaxdem.particles.integrate import ParticleState
from jaxdem.particles.neighbors import Neighbors
from jaxdem.scalar_step import FlowOfInterval, advance_scalars, with_buoyancy, with_carried_scalars
from jaxdem.scalars.scalar_state import ScalarState
from jaxdem.state import Diagnostics, Parameters, ParticleDiagnostics, Places, State
from jaxdem.structure import Structure


def step(
    simulation: Structure, parameters: Parameters, state: State, neighbors: Neighbors | None
) -> tuple[State, Neighbors | None, Diagnostics]:
    """State and neighbour list after one coupling interval; pure, differentiable, for jit and vmap."""
    fluid, forces, fluid_report, exchange_report = advance_fluid(simulation, parameters, state)
    scalars = None
    if simulation.scalars is not None:
        flow = FlowOfInterval(fluid, forces, fluid_report)
        scalars, fluid_report = advance_scalars(simulation, parameters, state, neighbors, flow)
    parameters, state = simulation.with_loaded_pistons(parameters, state, fluid_report)
    moved = advance_particles(simulation, parameters, state, neighbors, forces, scalars)
    particles, listed, report, places, scalars = moved
    new = State(particles, fluid, state.step + 1, scalars)
    return new, listed, Diagnostics(report, fluid_report, exchange_report, forces, places)


@named_scope("fluid")
def advance_fluid(
    simulation: Structure, parameters: Parameters, state: State
) -> tuple[FluidState | None, FluidForces | None, FluidDiagnostics | None, ExchangeDiagnostics | None]:
    """The fluid after the interval, among particles that stand still; and the mean forces that it puts on them."""
    if simulation.fluid is None:
        return None, None, None, None
    parameters = with_buoyancy(simulation, simulation.during(parameters, state.step), state)
    parameters = _numbered(parameters, state.step)
    time = simulation.time(parameters, state)
    parameters, fluid = with_carried_scalars(simulation, parameters, state)
    pistons = None if state.particles is None else state.particles.pistons
    parameters, fluid = simulation.with_moved_walls(parameters, fluid, state.step, pistons)
    if simulation.coupling is not None:
        particles = required(state.particles, "state.particles")
        bodies = required(parameters.bodies, "parameters.bodies").of_rows(particles.identity)
        parameters = parameters._replace(bodies=bodies)
        fluid, forces, report, exchange = simulation.coupling.advance(parameters.mixture, fluid, particles, time)
        fluid, report = _told_scalars(parameters, state, fluid, report)
        return fluid, forces, report, exchange
    advanced = simulation.fluid.advance(parameters.flow, fluid, time)
    fluid, report = _told_scalars(parameters, state, *advanced)
    return fluid, None, report, None


def _told_scalars(
    parameters: Parameters, state: State, fluid: FluidState, report: FluidDiagnostics
) -> tuple[FluidState, FluidDiagnostics]:
    """With what scalars need in the report: those that two fluids have carried, and the mesh between walls that change
    their place. In slabs it would be cut twice otherwise: XLA does not join what sends messages."""
    if state.scalars is not None and state.scalars.capacity is not None:
        report = report._replace(cut=required(parameters.fluid, "parameters.fluid").cut)
    report = report._replace(heat=fluid.heat, dissolved=fluid.dissolved)
    return fluid._replace(heat=None, dissolved=None), report


def _numbered(parameters: Parameters, step: Array) -> Parameters:
    """With the number of the interval for a second fluid; the same without one."""
    if parameters.fluid is None or parameters.fluid.second is None:
        return parameters
    second = parameters.fluid.second._replace(number=step)
    return parameters._replace(fluid=parameters.fluid._replace(second=second))


@named_scope("particles")
def advance_particles(
    simulation: Structure,
    parameters: Parameters,
    state: State,
    neighbors: Neighbors | None,
    forces: FluidForces | None,
    scalars: ScalarState | None = None,
) -> tuple[ParticleState | None, Neighbors | None, ParticleDiagnostics | None, Places | None, ScalarState | None]:
    """The particles after the contact steps, under gravity and the mean fluid forces; then who leaves and comes.

    The scalars are those after the interval, with the heat of these counted then.
    """
    if simulation.contact is None:
        return None, None, None, None, scalars
    listed = required(neighbors, "neighbors")
    parameters = simulation.during(parameters, state.step)
    moved = moved_particles(simulation, parameters, state, listed, forces)._replace(scalars=scalars)
    places = None if simulation.cut is None else Places(moved.particles.position, moved.particles.position_low)
    moved = at_end_of_interval(simulation, parameters, state, moved)
    within = buried_particles(simulation, of_rows(parameters, state), moved.before, listed, state.step)
    report = particle_report(simulation, moved, state.step + 1, within)
    return moved.particles, moved.neighbors, report, places, moved.scalars

"""The scalars of a scene after an interval in which fluid and particles have moved; and what warm fluid does to it."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import named_scope

from jaxdem.coupling.exchange_result import FluidForces
from jaxdem.errors import required
from jaxdem.fluid.carried_heat import CarriedHeat
from jaxdem.fluid.dissolved import CarriedScalar
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.interval import FluidDiagnostics
from jaxdem.numerics.blocks import all_of
from jaxdem.particles.clump_forces import as_members
from jaxdem.particles.materials import ContactParameters
from jaxdem.particles.neighbors import Neighbors
from jaxdem.scalars.conduction import Conductances, Touching, conductances
from jaxdem.scalars.flow import FluidFlow, GrainsInFluid
from jaxdem.scalars.scalar_state import ScalarState
from jaxdem.state import Parameters, State
from jaxdem.structure import Structure


class FlowOfInterval(NamedTuple):
    """What the fluid's part of a step gives; None for a part that the scene has not.

    Attributes:
        fluid: state at the end.
        forces: on the particles.
        report: of the fluid.
    """

    fluid: FluidState | None
    forces: FluidForces | None
    report: FluidDiagnostics | None


@named_scope("scalars")
def advance_scalars(
    simulation: Structure,
    parameters: Parameters,
    state: State,
    neighbors: Neighbors | None,
    flow: FlowOfInterval,
) -> tuple[ScalarState, FluidDiagnostics | None]:
    """The scalars after an interval, and the fluid's report without what is for them alone.

    The fluid carries them by the mean flux of the interval, two fluids have carried them in every step; then
    grains and fluid exchange heat, and contacts conduct.
    The grains stand where they stood at its start, as they do for the fluid. What contacts take from the motion, and
    grains that come and leave, follow in `particle_step`.

    Args:
        simulation: static.
        parameters: of the scene.
        state: at the start.
        neighbors: list of that state.
        flow: of the fluid.
    """
    scalars, numbers = required(simulation.scalars, "scalars"), required(parameters.scalars, "parameters.scalars")
    parameters = simulation.during(parameters, state.step)
    found, report = required(state.scalars, "state.scalars"), flow.report
    duration = jnp.asarray(simulation.interval, parameters.gravity.dtype)
    stream = None
    if simulation.fluid is not None and flow.fluid is not None and report is not None:
        solver, fluid = simulation.fluid.solver, required(state.fluid, "state.fluid")
        if report.cut is not None:
            properties = required(parameters.fluid, "parameters.fluid")._replace(cut=report.cut)
            parameters = parameters._replace(fluid=properties)
        stream = FluidFlow(
            solver.grid, solver.boundary, parameters.flow, fluid, flow.fluid,
            report.flux, report.substeps, simulation.fluid.reversible, report.heat, report.dissolved, report.passed,
        )  # fmt: skip
        found = scalars.carried(numbers, found, stream, duration)
        sound = [jnp.all(jnp.isfinite(field)) for field in found.fields]
        sound_everywhere = all_of(simulation.cut, jnp.all(jnp.stack(sound)))
        sound_everywhere = report.finite & sound_everywhere
        report = report._replace(flux=None, heat=None, dissolved=None, cut=None, finite=sound_everywhere)
    particles = state.particles
    if particles is None or found.grains is None:
        return found, report
    bodies = required(parameters.bodies, "parameters.bodies").of_rows(particles.identity)
    if stream is not None and flow.forces is not None and simulation.coupling is not None:
        weights = simulation.coupling.weights(parameters._replace(bodies=bodies).mixture, particles)
        grains = GrainsInFluid(weights, flow.forces.inputs)
        found = scalars.exchanged(numbers, found, stream, bodies, grains, particles.active, duration)
    if scalars.heat is not None and scalars.heat.conduction is not None:
        listed = required(neighbors, "neighbors")
        contacts = contact_conductances(simulation, parameters, state, listed)
        found = scalars.conducted(numbers, found, contacts, listed, bodies, duration, simulation.cut)
    return found, report


def contact_conductances(
    simulation: Structure, parameters: Parameters, state: State, neighbors: Neighbors
) -> Conductances:
    """Of the contacts of a state, of a scene in which contacts conduct heat; in a slab of those with ghosts too
    [W/K]."""
    scalars, numbers = required(simulation.scalars, "scalars"), required(parameters.scalars, "parameters.scalars")
    conduction = required(required(scalars.heat, "heat").conduction, "conduction")
    of_contacts = required(required(numbers.grains, "heat of the grains").conduction, "conduction")
    contact, materials = required(simulation.contact, "particles"), parameters.materials
    bodies = required(parameters.bodies, "parameters.bodies")
    particles, bodies = contact.seen(bodies, required(state.particles, "state.particles"), neighbors)
    if not isinstance(materials, ContactParameters):  # refused by the scene
        raise TypeError("contacts of several materials have no conductance")
    spheres = bodies.spheres(particles.position.shape[0])
    touching = Touching(
        contact.model, materials, as_members(particles, bodies.clumps), spheres.radius, neighbors,
        simulation.surfaces_present(parameters, state.step), simulation.placed(parameters, particles, state.step),
    )  # fmt: skip
    return conductances(conduction, of_contacts, touching)


def with_buoyancy(simulation: Structure, parameters: Parameters, state: State) -> Parameters:
    """The parameters with the acceleration of warm fluid; unchanged where it does not expand."""
    scalars, found = simulation.scalars, state.scalars
    if scalars is None or scalars.heat is None or not scalars.heat.expands or found is None:
        return parameters
    if required(parameters.fluid, "parameters.fluid").second is not None:  # in every step, see `with_carried_scalars`
        return parameters
    numbers, solver = required(parameters.scalars, "parameters.scalars"), required(simulation.fluid, "fluid").solver
    lift = scalars.buoyancy(numbers, found, solver.grid, parameters.gravity)
    return parameters._replace(fluid=required(parameters.fluid, "parameters.fluid")._replace(buoyancy=lift))


def with_carried_scalars(simulation: Structure, parameters: Parameters, state: State) -> tuple[Parameters, FluidState]:
    """Parameters and fluid at the start of an interval in which two fluids carry their heat and what is dissolved in
    them; as they are where there is one fluid, or no scalar."""
    scalars, found, fluid = simulation.scalars, state.scalars, required(state.fluid, "state.fluid")
    properties = required(parameters.fluid, "parameters.fluid")
    if scalars is None or found is None or properties.second is None:
        return parameters, fluid
    numbers, second = required(parameters.scalars, "parameters.scalars"), properties.second
    if scalars.temperature is not None:
        second = second._replace(heat=scalars.of_phases(numbers, properties))
        warm = found.fields[scalars.temperature]
        fluid = fluid._replace(heat=CarriedHeat(warm, jnp.zeros_like(found.supplied.sides[0])))
    if dissolved := scalars.dissolved(numbers):
        second = second._replace(dissolved=dissolved)
        others = (field for number, field in enumerate(found.fields) if number != scalars.temperature)
        zero = jnp.zeros_like(found.supplied.sides[0])
        fluid = fluid._replace(dissolved=tuple(CarriedScalar(field, zero) for field in others))
    return parameters._replace(fluid=properties._replace(second=second)), fluid

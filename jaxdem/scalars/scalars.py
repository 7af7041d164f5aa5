"""Scalars of a scene over a coupling interval: temperatures of fluid and grains, and what else the fluid carries."""

from __future__ import annotations

from typing import Literal, NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.fluid.carried_heat import HeatOfPhases
from jaxdem.fluid.dissolved import Dissolved
from jaxdem.fluid.fluid_state import FluidProperties
from jaxdem.fluid.grid import FaceField, Grid, face_average
from jaxdem.fluid.scalar_transport import ScalarField, ScalarTransport, Stream
from jaxdem.numerics.blocks import Blocks
from jaxdem.numerics.static import static
from jaxdem.particles.integrate import ParticleProperties, ParticleState
from jaxdem.particles.neighbors import Neighbors
from jaxdem.scalars.conduction import Conductances, Conduction, conducted
from jaxdem.scalars.exchange import exchanged
from jaxdem.scalars.flow import FluidFlow, GrainsInFluid, or_one, phases_of
from jaxdem.scalars.in_cells import between_surfaces, conducting, fluid_share, through_openings
from jaxdem.scalars.moving_cells import Change, held_by_cells
from jaxdem.scalars.nusselt import NusseltLaw
from jaxdem.scalars.phases import dissolved_in_phases, heat_of_phases
from jaxdem.scalars.scalar_state import ScalarParameters, ScalarState

TEMPERATURE = "temperature"
"""Name of the field that is the temperature of the fluid."""


@static
class Heat:
    """What heat does in a scene; static.

    Attributes:
        exchange: law of the transfer between grains and fluid; None for none.
        conduction: through contacts; None for none.
        expands: whether the fluid is lighter where it is warmer.
        bed: conductivity of the fluid between grains: "open", in proportion to its volume, or "kuipers".
    """

    exchange: NusseltLaw | None
    conduction: Conduction | None
    expands: bool
    bed: Literal["open", "kuipers"] = "open"


@static
class Scalars:
    """The scalars of a scene; static.

    Attributes:
        fields: that the fluid carries.
        heat: None without temperatures.
    """

    fields: tuple[ScalarField, ...]
    heat: Heat | None

    @property
    def temperature(self) -> int | None:
        """Number of the field of the temperature; None where the fluid has none."""
        names = [field.name for field in self.fields]
        return names.index(TEMPERATURE) if TEMPERATURE in names else None

    def carried(
        self, parameters: ScalarParameters, state: ScalarState, flow: FluidFlow, duration: Array
    ) -> ScalarState:
        """The fields after an interval of flow and diffusion."""
        if flow.after.liquid_fraction is not None:
            return self._carried_by_phases(parameters, state, flow, duration)
        before = or_one(flow.before.void_fraction)
        after = or_one(flow.after.void_fraction)
        on_faces, flux = face_average(flow.grid, after), required(flow.flux, "flux of the fluid")
        change = Change(flow.properties.cut, flux, before, after, duration)
        held = held_by_cells(flow.grid, parameters.walls, state, change)
        fields, passed = [], []
        for number, (field, value) in enumerate(zip(self.fields, held.fields, strict=True)):
            numbers, share, capacity = parameters.fields[number], on_faces, None
            if number == self.temperature and self.heat is not None:
                capacity = flow.properties.density * required(parameters.fluid, "heat of the fluid").capacity
                numbers = numbers._replace(diffusivity=numbers.diffusivity / capacity, flux=numbers.flux / capacity)
                share = tuple(conducting(self.heat.bed, g) for g in on_faces)
            stream = Stream(flux, held.before, held.after, share)
            if held.walls is not None:
                through = held.walls.flux[number]
                on_surfaces = held.walls.value[number], through if capacity is None else through / capacity
                cut = required(flow.properties.cut, "surfaces in the fluid")
                of_cells = after if self.heat is None or capacity is None else conducting(self.heat.bed, after)
                given = numbers.diffusivity, of_cells, *on_surfaces
                stream = between_surfaces(stream, held.walls, cut, field.surfaces, given)
                if cut.openings is not None and held.walls.brought is not None and stream.surfaces is not None:
                    values = [None if one is None else one[number] for one in held.walls.brought]
                    inflow = required(flow.passed, "flow through openings")[-len(values) :, 0]
                    brought = values, inflow, duration
                    surfaces = through_openings(flow.grid, stream, stream.surfaces, cut.openings, brought)
                    stream = stream._replace(surfaces=surfaces)
            transport = ScalarTransport(flow.grid, flow.boundary, field, numbers, stream)
            found, through = transport.advance(value, duration, flow.steps, flow.reversible)
            fields.append(found)
            passed.append(through)
        supplied = state.supplied
        if passed:
            supplied = supplied._replace(sides=supplied.sides + jnp.stack(passed))
        return state._replace(fields=tuple(fields), supplied=supplied, capacity=held.capacity)

    def of_phases(self, parameters: ScalarParameters, properties: FluidProperties) -> HeatOfPhases:
        """What two fluids need to carry their heat."""
        heat, place = required(self.heat, "heat"), required(self.temperature, "temperature of the fluid")
        return heat_of_phases(self.fields[place], heat.expands, parameters, properties)

    def dissolved(self, parameters: ScalarParameters) -> tuple[Dissolved, ...]:
        """What two fluids need to carry the scalars that are no temperature."""
        every = enumerate(zip(self.fields, parameters.fields, strict=True))
        return tuple(dissolved_in_phases(*both) for number, both in every if number != self.temperature)

    def _carried_by_phases(
        self, parameters: ScalarParameters, state: ScalarState, flow: FluidFlow, duration: Array
    ) -> ScalarState:
        """The fields of two fluids, which have carried them, after conduction and diffusion over the interval."""
        phases, others, found = phases_of(parameters, flow), iter(flow.dissolved or ()), []
        for number, field in enumerate(self.fields):
            if number == self.temperature:
                bed, warm = required(self.heat, "heat").bed, required(flow.heat, "heat of two fluids")
                found.append(phases.conducted(field, bed, warm, duration, flow.reversible))
            else:
                found.append(phases.diffused(field, number, next(others), duration, flow.reversible))
        fields, passed = zip(*found, strict=True)
        supplied = state.supplied._replace(sides=state.supplied.sides + jnp.stack(passed))
        return state._replace(fields=fields, supplied=supplied)

    def exchanged(
        self,
        parameters: ScalarParameters,
        state: ScalarState,
        flow: FluidFlow,
        bodies: ParticleProperties,
        grains: GrainsInFluid,
        active: Array | None,
        duration: Array,
    ) -> ScalarState:
        """The temperatures after grains and fluid have exchanged heat; unchanged where no law says how."""
        heat, place, of_grains = self.heat, self.temperature, parameters.grains
        if heat is None or heat.exchange is None or state.grains is None or place is None:
            return state
        of_grains = required(of_grains, "heat of the grains")
        inputs, medium = grains.inputs, _medium(parameters, flow, grains, place, state.capacity)
        nusselt = heat.exchange(inputs.reynolds, medium.prandtl, 1.0 - inputs.solid_fraction)
        conductance = nusselt * medium.conductivity * jnp.pi * inputs.diameter
        if bodies.clumps is not None:  # h of the sphere of the same volume, over the surface of the body
            conductance = conductance / bodies.clumps.sphericity
        if active is not None:
            conductance = jnp.where(active, conductance, 0.0)
        capacities = medium.of_cells, of_grains.of_each(bodies)
        fluid, warmed = exchanged(
            flow.grid, grains.weights, state.fields[place], state.grains, conductance, capacities, duration
        )
        fields = tuple(fluid if k == place else field for k, field in enumerate(state.fields))
        return state._replace(fields=fields, grains=warmed)

    def conducted(
        self,
        parameters: ScalarParameters,
        state: ScalarState,
        found: Conductances,
        neighbors: Neighbors,
        bodies: ParticleProperties,
        duration: Array,
        blocks: Blocks | None = None,
    ) -> ScalarState:
        """The temperatures after conduction through contacts of these conductances; `blocks` as of `conducted`."""
        heat, numbers = self.heat, parameters.grains
        if heat is None or heat.conduction is None or numbers is None or state.grains is None:
            return state
        of_contacts, own = required(numbers.conduction, "conduction"), (numbers.of_each(bodies), bodies.clumps)
        of_grains = heat.conduction, of_contacts, found, neighbors, state.grains, own, duration
        grains, given = conducted(*of_grains, blocks)
        supplied = state.supplied._replace(walls=state.supplied.walls + given)
        return state._replace(grains=grains, supplied=supplied)

    def rubbed(
        self, parameters: ScalarParameters, state: ScalarState, bodies: ParticleProperties, heat: Array
    ) -> ScalarState:
        """The temperatures after contacts have made heat (N,) of motion [J]."""
        numbers, made = required(parameters.grains, "heat of the grains"), state.supplied.friction
        grains = required(state.grains, "temperatures of the grains") + heat / numbers.of_each(bodies)
        supplied = state.supplied._replace(friction=required(made, "heat of friction") + jnp.sum(heat))
        return state._replace(grains=grains, supplied=supplied)

    def renewed(
        self,
        parameters: ScalarParameters,
        state: ScalarState,
        bodies: ParticleProperties,
        before: ParticleState,
        after: ParticleState,
    ) -> ScalarState:
        """With the heat of the grains that came and left counted.

        Args:
            parameters: numbers.
            state: in the rows of `before`.
            bodies: of all grains.
            before, after: of these; in a slab a row may be that of another grain after them.
        """
        if state.grains is None or parameters.grains is None or before.active is None or after.active is None:
            return state
        of_grains, grains, dtype = parameters.grains, state.grains, state.grains.dtype
        if before.identity is None or after.identity is None:
            came = after.active.astype(dtype) - before.active.astype(dtype)
            return _brought(state, jnp.sum(came * of_grains.of_each(bodies) * grains))
        stays = before.active & after.active & (before.identity == after.identity)
        left, new = before.active & ~stays, after.active & ~stays
        if state.coming is not None:
            grains = jnp.where(new, state.coming[jnp.maximum(after.identity, 0)], grains)
        heats = (
            jnp.sum(jnp.where(those, of_grains.of_each(bodies.of_rows(rows.identity)) * own, 0.0))
            for those, rows, own in ((new, after, grains), (left, before, state.grains))
        )
        return _brought(state, next(heats) - next(heats))._replace(grains=grains)

    def buoyancy(self, parameters: ScalarParameters, state: ScalarState, grid: Grid, gravity: Array) -> FaceField:
        """Acceleration of the fluid where it is warmer than the reference, -beta (T - T0) g, on the faces [m/s2].

        Source: J. Boussinesq, Theorie analytique de la chaleur, vol. 2 (1903); D. J. Tritton, Physical Fluid Dynamics,
        2nd ed. (1988), section 14.
        """
        numbers = required(parameters.fluid, "heat of the fluid")
        place = required(self.temperature, "temperature of the fluid")
        above = face_average(grid, state.fields[place] - numbers.reference)
        return tuple(-numbers.expansion * gravity[axis] * warmth for axis, warmth in enumerate(above))


class _Medium(NamedTuple):
    """The fluid to the heat of grains.

    Attributes:
        conductivity: () or (N,) at the grains [W/(m K)].
        prandtl: () or (N,) [-].
        of_cells: heat capacity of the fluid in the cells [J/K].
    """

    conductivity: Array
    prandtl: Array
    of_cells: Array


def _medium(
    parameters: ScalarParameters, flow: FluidFlow, grains: GrainsInFluid, place: int, capacity: Array | None
) -> _Medium:
    """See `_Medium`; of two fluids what is at each grain."""
    if flow.heat is not None:
        phases = phases_of(parameters, flow)
        conductivity, capacity = phases.at_grains(grains.weights)
        prandtl = grains.inputs.dynamic_viscosity * capacity / conductivity
        return _Medium(conductivity, prandtl, flow.grid.cell_volume * phases.content)
    density, own = flow.properties.density, required(parameters.fluid, "heat of the fluid")
    conductivity = parameters.fields[place].diffusivity
    prandtl = flow.properties.viscosity * density * own.capacity / conductivity
    volumes = fluid_share(parameters.walls, flow.properties.cut, or_one(flow.after.void_fraction))
    if capacity is not None:
        volumes = jnp.where(capacity > 0.0, capacity, 1.0)
    return _Medium(conductivity, prandtl, jnp.asarray(density * own.capacity * flow.grid.cell_volume * volumes))


def _brought(state: ScalarState, heat: Array) -> ScalarState:
    return state._replace(supplied=state.supplied._replace(grains=state.supplied.grains + heat))

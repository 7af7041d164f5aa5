"""One step of two immiscible fluids with a sharp surface between them, among particles or alone.

    d(g c)/dt + div(c g u) = 0,   d(g)/dt + div(g u) = 0
    d(g rho u)/dt + div(g rho u u) = g rho g_0 + g (sigma kappa grad c + div(tau) - grad P) - f

c is the liquid fraction, rho = rho_2 + c (rho_1 - rho_2), P the pressure, g_0 gravity and f the force on the
particles. A step is

1. the fraction is carried by the velocity at its start, in closed form in every cell (`volume_of_fluid`);
2. heat is carried by the flux of the capacity that this makes, what is dissolved by that of its fluid, momentum by
   that of mass (`carried_heat`, `dissolved`, `carried_momentum`); stress, weight and tension are those of the new
   place of the surface;
3. the projection, with the new density on the faces.

So the place of the surface and the velocity are half a step apart, as in the leapfrog method: waves keep their
energy, and their period has an error of second order in the time step. The pressure is the whole one of the new
state, since an old one would push at the old place of the surface; the last one is where the solver starts.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.fluid.boundary import Sides, set_normal_velocity
from jaxdem.fluid.carried_heat import CarriedHeat, carried_heat, lightened
from jaxdem.fluid.carried_momentum import carried_momentum
from jaxdem.fluid.curvature import surface_tension_gradient
from jaxdem.fluid.dissolved import CarriedScalar, carried_dissolved
from jaxdem.fluid.fluid_state import FluidProperties, FluidState, FluidStep, ParticleFields
from jaxdem.fluid.grid import CellOrOne, FaceField, box_mean, face_average, face_control_volume, sum_of_fields
from jaxdem.fluid.local_stress import largest_diffusivity, local_stress
from jaxdem.fluid.momentum import FluidSolver
from jaxdem.fluid.momentum_step import or_one
from jaxdem.fluid.passages import passages
from jaxdem.fluid.pressure import pressure_gradient
from jaxdem.fluid.projection import Continuity, product
from jaxdem.fluid.second_fluid import (
    SecondFluid,
    fluidity,
    inflow_of_sides,
    mass_flux,
    mixture_density,
    through_sides,
    with_closed_sides,
    with_outside_pressure,
)
from jaxdem.fluid.surface_weight import surface_weight
from jaxdem.fluid.volume_of_fluid import Carrier, advance_fraction
from jaxdem.numerics.stages import stage
from jaxdem.numerics.static import static


class BalanceOnFaces(NamedTuple):
    """What a step needs on the faces, at its end.

    Attributes:
        void_fraction: g [-].
        mass: g rho, of the fluid by the volume of the box [kg/m3].
        weight: part of pressure gradient, stress and tension that acts on the fluid [-].
        mobility: 1 / (g rho + B), B the resistance of the particles by volume and step [m3/kg].
        shift: what particles give by volume [kg/(m2 s)].
    """

    void_fraction: tuple[CellOrOne, ...]
    mass: FaceField
    weight: tuple[CellOrOne, ...]
    mobility: FaceField
    shift: tuple[Array | float, ...]


@static
class TwoFluidSolver(FluidSolver):
    """The static description of two fluids, and their step; attributes as those of `FluidSolver`.

    Attributes:
        has_tension: whether the surface between them has a tension.
        oblique_gravity: whether gravity has components along two axes or more, at one time or one after the other. Then
            their weight at the surface is that of `surface_weight`; along one axis the mean density of two cells is at
            rest without it.
    """

    has_tension: bool = False
    oblique_gravity: bool = False

    def step(
        self,
        properties: FluidProperties,
        state: FluidState,
        time: Array,
        time_step: Array,
        particles: ParticleFields | None = None,
    ) -> FluidStep:
        """See `FluidSolver.step`."""
        grid, second = self.grid, required(properties.second, "second of the fluid")
        void_fraction = None if particles is None else particles.void_fraction
        growth = self._growth(properties, state, void_fraction, time_step)
        continuity = Continuity(grid, self.boundary, growth, jumps=True)
        flux = product(face_average(grid, or_one(state.void_fraction)), state.face_velocity)
        if void_fraction is not None:
            flux = continuity.corrected(flux)
        fraction, liquid_flux = self._carried_fraction(second, state, flux, (time, time_step), void_fraction)
        faces = self._faces(properties, fraction, particles)
        carried_mass = mass_flux(second, properties.density, flux, liquid_flux)
        sides = self.sides(properties, time)
        old = self._mass(properties, required(state.liquid_fraction, "liquid_fraction"), state.void_fraction)
        # Of the stage: the prediction would compute it anew for every face that it needs it for.
        carried = stage(
            time_step > 0.0,
            lambda: carried_momentum(grid, sides, self.advection, carried_mass, state.face_velocity, old, time_step),
        )
        stress = self._stress(properties, fraction, state.face_velocity, time)
        contents = (or_one(state.void_fraction), or_one(void_fraction)), fraction
        heat, dissolved = self._carried(second, state, (flux, liquid_flux), contents, (time, time_step))
        light = lightened(grid, second.heat, heat, fraction, contents[0][1])
        force = self._force(properties, faces, fraction, stress, light)
        gradient = self._mean_gradient(properties, state, time + 0.5 * time_step)
        force = self._pushed(properties, faces, force, state.pressure, gradient, fraction)
        predicted = tuple(
            (m * u + time_step * (c + f) + s) * k
            for m, u, c, f, s, k in zip(
                old, state.face_velocity, carried, force, faces.shift, faces.mobility, strict=True
            )
        )
        end = self.sides(properties, time + time_step)
        predicted = set_normal_velocity(grid, end, predicted, faces.void_fraction)
        push = tuple(time_step * w * k for w, k in zip(faces.weight, faces.mobility, strict=True))
        velocity, pressure, report, remaining = continuity.projected(
            state.pressure, predicted, faces.void_fraction, push, self._least(properties, time_step)
        )
        came = time_step * through_sides(grid, liquid_flux)
        supplied = required(state.liquid_supplied, "liquid_supplied").at[1:].add(came)
        fluid = FluidState(velocity, pressure, void_fraction, gradient, heat=heat, dissolved=dissolved)
        fluid = fluid._replace(liquid_fraction=fraction, liquid_supplied=supplied)
        # Particles take it times the density of the liquid.
        seen = tuple(s / properties.density for s in stress)
        passed = passages(grid, self.boundary, flux, liquid=liquid_flux)
        told = flux if self.keeps_flux else None
        return FluidStep(fluid, seen, report, remaining, flux=told, passed=passed)

    def resting_pressure(self, properties: FluidProperties, state: FluidState) -> Array:
        """Reduced pressure that balances weight and tension where a state is at rest [Pa]."""
        grid = self.grid
        fraction = required(state.liquid_fraction, "liquid_fraction")
        none = jnp.zeros((), fraction.dtype)
        fields = None if state.void_fraction is None else ParticleFields(state.void_fraction)
        faces = self._faces(properties, fraction, fields)
        force = self._force(properties, faces, fraction, tuple(jnp.zeros_like(u) for u in state.face_velocity))
        force = self._pushed(properties, faces, force, 0.0 * fraction, state.mean_gradient, fraction)
        still = Sides(self.boundary, tuple(jnp.zeros_like(v) for v in properties.side_velocity), none)
        predicted = set_normal_velocity(grid, still, product(force, faces.mobility), faces.void_fraction)
        push = product(faces.weight, faces.mobility)
        least = self._least(properties, 1.0 + none)
        return Continuity(grid, self.boundary, 0.0, jumps=True).projected(
            jnp.zeros_like(fraction), predicted, faces.void_fraction, push, least
        )[1]

    def largest_viscosity(self, properties: FluidProperties, state: FluidState, time: Array) -> Array:
        """() largest viscosity over density, with those of a cell and of the faces around it [m2/s]."""
        second = required(properties.second, "second")
        level = self._level(properties, required(state.liquid_fraction, "liquid_fraction"))
        density = face_average(self.grid, mixture_density(second, properties.density, level))
        there = fluidity(second, properties.density, properties.viscosity, level)
        return largest_diffusivity(self.grid, there, density)

    def slope_at_particles(self, properties: FluidProperties, state: FluidState) -> FaceField:
        """Gradient of the reduced pressure less what acts at the surface with it, as particles see it, on the faces
        [Pa/m].

        At an outlet the pressure is that of the fluids beyond it. Particles take the part 1 - g of both, so that they
        feel no jump of the pressure across a curved surface which the tension balances; see
        `FluidSolver.slope_at_particles`.
        """
        second = required(properties.second, "second of the fluid")
        gravity = required(properties.gravity, "gravity of the fluid")
        slope = super().slope_at_particles(properties, state)
        fraction = required(state.liquid_fraction, "liquid_fraction of the fluid")
        level = self._level(properties, fraction)
        slope = with_outside_pressure(self.grid, self.boundary, second, properties.density, gravity, slope, level)
        pull = self._pull(properties, fraction)
        if pull is None:
            return slope
        pull = with_closed_sides(self.grid, self.boundary, pull)
        return tuple(s - t for s, t in zip(slope, pull, strict=True))

    def _pull(self, properties: FluidProperties, fraction: Array) -> FaceField | None:
        """What acts on the faces at the surface with the gradient of the pressure: tension, and under oblique gravity
        the weight that the mean density of a face misplaces; None without [N/m3]."""
        second, pull = required(properties.second, "second of the fluid"), None
        if self.has_tension:
            pull = surface_tension_gradient(self.grid, fraction, second.tension)
        if not self.oblique_gravity:
            return pull
        gravity = required(properties.gravity, "gravity of the fluid")
        closed = None if properties.cut is None else properties.cut.open_cells == 0.0
        level, difference = self._level(properties, fraction), properties.density - second.density
        weight = surface_weight(self.grid, level, gravity, difference, closed)
        return weight if pull is None else sum_of_fields(weight, pull)

    def _level(self, properties: FluidProperties, fraction: Array) -> Array:
        """The liquid fraction that weighs: of whole cells."""
        return fraction

    def _growth(
        self, properties: FluidProperties, state: FluidState, void_fraction: Array | None, time_step: Array
    ) -> Array | float:
        """Rate of change of the volume of the fluids in every cell, over that of a whole cell [1/s]."""
        if void_fraction is None:
            return 0.0
        rate = (void_fraction - required(state.void_fraction, "void_fraction of the fluid")) / time_step
        return self._taken_up(properties, rate)

    def _taken_up(self, properties: FluidProperties, rate: Array) -> Array:
        """That of a rate of the void fraction, whose mean in a closed box is rounding [1/s]."""
        return rate if self.boundary.has_outlet else rate - box_mean(self.grid, rate)

    def _carried_fraction(
        self,
        second: SecondFluid,
        state: FluidState,
        flux: FaceField,
        times: tuple[Array, Array],
        void_fraction: Array | None,
    ) -> tuple[Array, FaceField]:
        """The liquid fraction at the end of a step of (start, length), and the flux of the liquid on the faces."""
        time, time_step = times
        # Each step begins with another axis than the one before.
        number = second.number_at(time, time_step)
        fraction = required(state.liquid_fraction, "liquid_fraction of the fluid")
        inflow = inflow_of_sides(self.grid, self.boundary, second)
        carrier = Carrier(flux, or_one(state.void_fraction), or_one(void_fraction), inflow)
        return advance_fraction(self.grid, fraction, carrier, time_step, number)

    def _carried(
        self,
        second: SecondFluid,
        state: FluidState,
        fluxes: tuple[FaceField, FaceField],
        contents: tuple[tuple[CellOrOne, CellOrOne], Array],
        times: tuple[Array, Array],
    ) -> tuple[CarriedHeat | None, tuple[CarriedScalar, ...] | None]:
        """Heat and scalars at the end of a step of (start, length), by the fluxes of both fluids and of the liquid,
        with the void fractions at both ends and the new liquid fraction; None without."""
        (old_gaps, gaps), fraction = contents
        old = required(state.liquid_fraction, "liquid_fraction of the fluid")
        heat, dissolved = None, None
        if second.heat is not None and state.heat is not None:
            held = second.heat.content(old, old_gaps), second.heat.content(fraction, gaps)
            order, carrier = second.number_at(*times), second.heat.carrier(*fluxes)
            heat = carried_heat(self.grid, second.heat, state.heat, carrier, held, times[1], order)
        if state.dissolved is not None:
            ends, given = ((old, old_gaps), (fraction, gaps)), (times[1], second.number_at(*times))
            dissolved = carried_dissolved(self.grid, second.dissolved, state.dissolved, fluxes, ends, *given)
        return heat, dissolved

    def _mass(self, properties: FluidProperties, fraction: Array, void_fraction: Array | None) -> FaceField:
        """g rho on the faces: the mean of the two cells [kg/m3]."""
        second = required(properties.second, "second of the fluid")
        mass = or_one(void_fraction) * mixture_density(second, properties.density, fraction)
        return face_average(self.grid, mass)  # type: ignore[return-value]

    def _faces(self, properties: FluidProperties, fraction: Array, particles: ParticleFields | None) -> BalanceOnFaces:
        """See `BalanceOnFaces`."""
        grid = self.grid
        void_fraction = None if particles is None else particles.void_fraction
        exchange = None if particles is None else particles.exchange
        gaps = face_average(grid, or_one(void_fraction))
        mass = self._mass(properties, fraction, void_fraction)
        weight = self._weight(gaps, None if particles is None else particles.weighting)
        if exchange is None:
            return BalanceOnFaces(gaps, mass, weight, tuple(1.0 / m for m in mass), (0.0,) * grid.dimension)
        mobility, shift = [], []
        for axis, m in enumerate(mass):
            volume = face_control_volume(grid, axis).astype(m.dtype)
            mobility.append(1.0 / (m + exchange.resistance[axis] / volume))
            shift.append(exchange.forcing[axis] / volume)
        return BalanceOnFaces(gaps, mass, weight, tuple(mobility), tuple(shift))

    def _stress(self, properties: FluidProperties, fraction: Array, velocity: FaceField, time: Array) -> FaceField:
        """div(tau) on the faces [N/m3]."""
        if not self.viscous:
            return tuple(jnp.zeros_like(u) for u in velocity)
        second = required(properties.second, "second of the fluid")
        there = fluidity(second, properties.density, properties.viscosity, fraction)
        return local_stress(self.grid, self.sides(properties, time), velocity, there)

    def _force(
        self,
        properties: FluidProperties,
        faces: BalanceOnFaces,
        fraction: Array,
        stress: FaceField,
        light: FaceField | None = None,
    ) -> FaceField:
        """Stress, tension, and weight less what the reduced pressure leaves out of it, on the faces [N/m3]; `light` is
        what warm fluid lacks of its mass [kg/m3]."""
        gravity = required(properties.gravity, "gravity of the fluid")
        pull = self._pull(properties, fraction)
        stress = stress if pull is None else sum_of_fields(stress, pull)
        masses = faces.mass if light is None else tuple(m - x for m, x in zip(faces.mass, light, strict=True))
        return tuple(
            weight * own + (mass - weight * properties.density) * gravity[axis]
            for axis, (mass, weight, own) in enumerate(zip(masses, faces.weight, stress, strict=True))
        )

    def _pushed(
        self,
        properties: FluidProperties,
        faces: BalanceOnFaces,
        force: FaceField,
        pressure: Array,
        gradient: Array | None,
        fraction: Array,
    ) -> FaceField:
        """A force less the gradient of a reduced pressure, on the faces [N/m3]."""
        second = required(properties.second, "second of the fluid")
        gravity = required(properties.gravity, "gravity of the fluid")
        slope = pressure_gradient(self.grid, self.boundary, pressure)
        slope = with_outside_pressure(self.grid, self.boundary, second, properties.density, gravity, slope, fraction)
        if gradient is not None:
            slope = tuple(s + gradient[axis] for axis, s in enumerate(slope))
        return tuple(f - w * s for f, w, s in zip(force, faces.weight, slope, strict=True))

    def _least(self, properties: FluidProperties, time_step: Array) -> Array:
        """What weight gives to a velocity in a step, over the size of a cell [1/s]: forces so large balance each
        other in a fluid at rest, and their rounding is no flow."""
        gravity = required(properties.gravity, "gravity of the fluid")
        return time_step * jnp.max(jnp.abs(gravity)) / min(self.grid.spacing)

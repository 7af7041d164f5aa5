"""One step of two immiscible fluids between surfaces within the mesh that are at rest; see `two_fluids`, `cut_cells`.

    d(v g c)/dt + div(c F) = 0,   F = a g u,   d(v g)/dt + div F = 0

    M du/dt = -sum Phi (u_s - u) + a (g rho_e - w rho_1) g_0 - a w grad p + w (sum b mu (u_n - u)/h^2 - mu R u) - f

a is the open fraction of a face, v the open part of a cell with what it has borrowed (`cut_liquid`), Phi the flux of
mass through the surfaces of the control volume of a face, which the transport of the liquid has made, u_s the velocity
that it carries, w the part of pressure and stress that acts on the fluid. In whole control volumes the inertia M is
their mass at the end of the step, and the first term that of `two_fluids`: momentum is carried by the flux of mass and
conserved. In others M = max(a g rho_e, t Phi_in): no more mass comes in during the step t than M stands for. So a step
changes u no further than to what comes in, however small the control volume is, and a uniform velocity stays uniform.
The surfaces take what is not conserved.

rho_e is the density of the whole cells beside the face, walls included, see `cut_liquid`. The flux g a u of the
projection and the gradient that acts on it have the same a, so the matrix is symmetric: of a w g a / (M + B + R), with
the resistance of the particles and the friction of the surfaces.

The surface meets walls at the angle at which the fraction goes on into them along a row. Derived here.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.fluid.boundary import Sides, set_normal_velocity
from jaxdem.fluid.carried_momentum import carried_beside_walls
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.cut_liquid import (
    beyond_walls,
    inflow_between_walls,
    level_of,
    open_volume,
    whole_control_volumes,
)
from jaxdem.fluid.cut_local_stress import cut_local_stress
from jaxdem.fluid.cut_projection import CutContinuity
from jaxdem.fluid.cut_stress import seen_stress
from jaxdem.fluid.fluid_state import FluidProperties, FluidState, FluidStep, ParticleFields
from jaxdem.fluid.grid import CellOrOne, FaceField, face_average, face_control_volume, sum_of_fields
from jaxdem.fluid.momentum_step import or_one
from jaxdem.fluid.passages import passages
from jaxdem.fluid.projection import product
from jaxdem.fluid.second_fluid import SecondFluid, fluidity, inflow_of_sides, mass_flux, mixture_density, through_sides
from jaxdem.fluid.step_loads import StepLoads
from jaxdem.fluid.two_fluids import BalanceOnFaces, TwoFluidSolver
from jaxdem.fluid.volume_of_fluid import Carrier, advance_fraction
from jaxdem.numerics.static import static


class _Stress(NamedTuple):
    """Viscous forces on the faces.

    Attributes:
        within: of the stress between control volumes [N/m3].
        lost: what the surfaces take of it besides [N/m3].
        friction: mu R on the surfaces [kg/(m3 s)].
    """

    within: FaceField
    lost: FaceField
    friction: FaceField


@static
class CutTwoFluidSolver(TwoFluidSolver):
    """The static description of two fluids between surfaces at rest, and their step; attributes as those of
    `TwoFluidSolver`."""

    def step(
        self,
        properties: FluidProperties,
        state: FluidState,
        time: Array,
        time_step: Array,
        particles: ParticleFields | None = None,
    ) -> FluidStep:
        """See `FluidSolver.step`."""
        grid, second, cut = self.grid, required(properties.second, "second of the fluid"), _cut(properties)
        void_fraction = None if particles is None else particles.void_fraction
        growth = self._growth(properties, state, void_fraction, time_step)
        continuity = CutContinuity(grid, self.boundary, growth, cut, jumps=True)
        velocity = state.face_velocity
        flux = product(cut.opened(face_average(grid, or_one(state.void_fraction))), velocity)
        if void_fraction is not None:
            flux = continuity.corrected(flux)
        fraction, liquid_flux = self._carried_between_walls(second, state, flux, (time, time_step), void_fraction, cut)
        carried_mass = mass_flux(second, properties.density, flux, liquid_flux)
        sides, whole = self.sides(properties, time), whole_control_volumes(grid, cut)
        old = self._content(properties, cut, required(state.liquid_fraction, "liquid_fraction"), state.void_fraction)
        new = self._content(properties, cut, fraction, void_fraction)
        carried, into = carried_beside_walls(
            grid, sides, self.advection, carried_mass, velocity, (old, whole), time_step, cut
        )
        faces = self._open_faces(properties, fraction, particles)
        inertia = tuple(
            jnp.where(w > 0.0, m, jnp.maximum(jnp.where(i > 0.0, i, 1.0) * e, time_step * x))
            for w, m, i, e, x in zip(whole, new, cut.open_faces, faces.mass, into, strict=True)
        )
        stress = self._cut_stress(properties, fraction, velocity, sides)
        faces = self._moved(faces, inertia, stress.friction, particles, time_step)
        gradient = self._mean_gradient(properties, state, time + 0.5 * time_step)
        force = self._weighed(properties, faces, fraction, state.pressure, gradient)
        force = tuple(f + w * s for f, w, s in zip(force, faces.share, stress.within, strict=True))
        # In whole control volumes m = n, so that momentum itself is carried.
        predicted = tuple(
            (o * u + (m - n) * u + time_step * (c + f) + s) * k
            for o, m, n, u, c, f, s, k in zip(
                old, inertia, new, velocity, carried, force, faces.shift, faces.mobility, strict=True
            )
        )
        end = self.sides(properties, time + time_step)
        predicted = cut.with_walls(set_normal_velocity(grid, end, predicted, faces.void_fraction))
        push = tuple(time_step * w * k for w, k in zip(faces.weight, faces.mobility, strict=True))
        open_new = cut.opened(faces.void_fraction)
        velocity, pressure, report, remaining = continuity.projected(
            state.pressure, predicted, open_new, push, self._least(properties, time_step)
        )
        came = time_step * through_sides(grid, liquid_flux)
        supplied = required(state.liquid_supplied, "liquid_supplied").at[1:].add(came)
        fluid = FluidState(velocity, pressure, void_fraction, gradient)
        fluid = fluid._replace(liquid_fraction=fraction, liquid_supplied=supplied)
        gained = tuple(c + w * s for c, w, s in zip(carried, faces.share, stress.within, strict=True))
        on_walls = fluid._replace(pressure=self._pressure_on_walls(properties, fraction, pressure))
        loads = StepLoads(
            grid, self.boundary, self.shares_stress, properties, on_walls, faces.share,
            None if particles is None else particles.exchange, time_step,
        )  # fmt: skip
        seen, load = self._on_surfaces(cut, loads, gained, stress, particles)
        passed = passages(grid, self.boundary, flux, liquid=liquid_flux)
        return FluidStep(fluid, seen, report, remaining, surface_load=load, passed=passed)

    def resting_pressure(self, properties: FluidProperties, state: FluidState) -> Array:
        """See `TwoFluidSolver.resting_pressure`."""
        grid, cut = self.grid, _cut(properties)
        fraction = required(state.liquid_fraction, "liquid_fraction")
        none = jnp.zeros((), fraction.dtype)
        faces = self._open_faces(
            properties, fraction, None if state.void_fraction is None else ParticleFields(state.void_fraction)
        )
        mobility = tuple(
            1.0 / (jnp.where(i > 0.0, i, 1.0) * e) for i, e in zip(cut.open_faces, faces.mass, strict=True)
        )
        force = self._weighed(properties, faces, fraction, 0.0 * fraction, state.mean_gradient)
        still = Sides(self.boundary, tuple(jnp.zeros_like(v) for v in properties.side_velocity), none)
        predicted = cut.with_walls(set_normal_velocity(grid, still, product(force, mobility), faces.void_fraction))
        continuity = CutContinuity(grid, self.boundary, jnp.zeros_like(fraction), cut, jumps=True)
        return continuity.projected(
            jnp.zeros_like(fraction), predicted, cut.opened(faces.void_fraction), product(faces.weight, mobility),
            self._least(properties, 1.0 + none),
        )[1]  # fmt: skip

    def _pressure_on_walls(self, properties: FluidProperties, fraction: Array, pressure: Array) -> Array:
        """The pressure; under oblique gravity less what `surface_weight` makes of it in the cells of a level surface:
        with this one load, weight and momentum are in balance, as what is added to the weight acts on open faces alone
        [Pa]."""
        if not self.oblique_gravity:
            return pressure
        second, gravity = required(properties.second, "second"), required(properties.gravity, "gravity of the fluid")
        level = level_of(_cut(properties), fraction)
        step = (properties.density - second.density) * gravity[-1] * self.grid.spacing[-1]
        return pressure - level * (1.0 - level) * step

    def _carried_between_walls(
        self,
        second: SecondFluid,
        state: FluidState,
        flux: FaceField,
        times: tuple[Array, Array],
        void_fraction: Array | None,
        cut: CutCells,
    ) -> tuple[Array, FaceField]:
        """See `TwoFluidSolver._carried_fraction`."""
        time, time_step = times
        before, after = (open_volume(cut, or_one(g)) for g in (state.void_fraction, void_fraction))
        inflow = inflow_between_walls(cut, inflow_of_sides(self.grid, self.boundary, second))

        def around(fraction: Array) -> Array:
            return beyond_walls(self.grid, cut, level_of(cut, fraction))

        carrier = Carrier(flux, before, after, inflow, around)
        fraction = required(state.liquid_fraction, "liquid_fraction of the fluid")
        return advance_fraction(self.grid, fraction, carrier, time_step, second.number_at(time, time_step))

    def _level(self, properties: FluidProperties, fraction: Array) -> Array:
        """That of whole cells, walls included; see `cut_liquid`."""
        cut = _cut(properties)
        return beyond_walls(self.grid, cut, level_of(cut, fraction))

    def _taken_up(self, properties: FluidProperties, rate: Array) -> Array:
        """See `CutCells.growth`."""
        return _cut(properties).growth(self.grid, rate, not self.boundary.has_outlet)

    def _content(
        self, properties: FluidProperties, cut: CutCells, fraction: Array, void_fraction: Array | None
    ) -> FaceField:
        """v g rho on the faces, of what is in the control volumes: the mean of the two cells [kg/m3]."""
        density = mixture_density(required(properties.second, "second"), properties.density, fraction)
        return face_average(self.grid, cut.open_cells * or_one(void_fraction) * density)  # type: ignore[return-value]

    def _open_faces(
        self, properties: FluidProperties, fraction: Array, particles: ParticleFields | None
    ) -> _CutBalance:
        """The faces with g rho_e, without what holds them back."""
        grid, cut = self.grid, _cut(properties)
        gaps = face_average(grid, or_one(None if particles is None else particles.void_fraction))
        second = required(properties.second, "second of the fluid")
        density = face_average(grid, mixture_density(second, properties.density, self._level(properties, fraction)))
        share = self._weight(gaps, None if particles is None else particles.weighting)
        heavy = tuple(g * rho for g, rho in zip(gaps, density, strict=True))
        return _CutBalance(gaps, heavy, cut.opened(share), (), (), share)  # type: ignore[arg-type]

    def _moved(
        self,
        faces: _CutBalance,
        inertia: FaceField,
        friction: FaceField,
        particles: ParticleFields | None,
        time_step: Array,
    ) -> _CutBalance:
        """The faces with the resistance of particles and surfaces."""
        held = tuple(m + time_step * w * r for m, w, r in zip(inertia, faces.share, friction, strict=True))
        exchange = None if particles is None else particles.exchange
        if exchange is None:
            none = (0.0,) * self.grid.dimension
            return faces._replace(mobility=tuple(1.0 / m for m in held), shift=none)
        mobility, shift = [], []
        for axis, m in enumerate(held):
            volume = face_control_volume(self.grid, axis).astype(m.dtype)
            mobility.append(1.0 / (m + exchange.resistance[axis] / volume))
            shift.append(exchange.forcing[axis] / volume)
        return faces._replace(mobility=tuple(mobility), shift=tuple(shift))

    def _weighed(
        self,
        properties: FluidProperties,
        faces: _CutBalance,
        fraction: Array,
        pressure: Array,
        gradient: Array | None,
    ) -> FaceField:
        """a times weight less what a reduced pressure leaves of it, less the gradient of that, on the faces [N/m3]."""
        whole = BalanceOnFaces(faces.void_fraction, faces.mass, faces.share, (), ())  # type: ignore[arg-type]
        force = self._force(properties, whole, fraction, tuple(jnp.zeros_like(m) for m in faces.mass))
        level = self._level(properties, fraction)
        force = self._pushed(properties, whole, force, pressure, gradient, level)
        return product(_cut(properties).open_faces, force)  # type: ignore[no-any-return]

    def _cut_stress(self, properties: FluidProperties, fraction: Array, velocity: FaceField, sides: Sides) -> _Stress:
        """See `_Stress`."""
        none = tuple(jnp.zeros_like(u) for u in velocity)
        if not self.viscous:
            return _Stress(none, none, none)
        second, cut = required(properties.second, "second of the fluid"), _cut(properties)
        level = self._level(properties, fraction)
        there = fluidity(second, properties.density, properties.viscosity, level)
        within, lost = cut_local_stress(self.grid, sides, cut, velocity, there)
        friction = tuple(r / f for r, f in zip(cut.friction, face_average(self.grid, there), strict=True))
        return _Stress(within, lost, friction)

    def _on_surfaces(
        self,
        cut: CutCells,
        loads: StepLoads,
        gained: FaceField,
        stress: _Stress,
        particles: ParticleFields | None,
    ) -> tuple[FaceField, Array]:
        """Stress as particles see it over the density of the liquid [m/s2], and the load on every surface."""
        grid, density = self.grid, loads.properties.density
        held_back = product(stress.friction, loads.fluid.face_velocity)
        own, friction = (tuple(s / density for s in field) for field in (stress.within, held_back))
        seen = seen_stress(grid, self.boundary, cut, own, friction)
        on_faces = sum_of_fields(sum_of_fields(held_back, cut.on_closed(gained)), stress.lost)
        if particles is not None and particles.exchange is not None:
            solids = 1.0 - (particles.void_fraction if particles.weighting is None else particles.weighting)
            on_faces = sum_of_fields(on_faces, loads.taken_from_surfaces(seen, cut.open_cells * solids))
        # The last term is of surfaces that turn.
        return seen, loads.on_surfaces(on_faces, loads.properties.viscosity, self.surfaces)


class _CutBalance(NamedTuple):
    """What a step needs on the faces, at its end: as `BalanceOnFaces`, of cut control volumes.

    Attributes:
        void_fraction: g [-].
        mass: g rho_e [kg/m3].
        weight: a w, part of the pressure gradient that acts on the fluid [-].
        mobility: 1 / (M + B + R) [m3/kg].
        shift: what particles give by volume [kg/(m2 s)].
        share: w [-].
    """

    void_fraction: tuple[CellOrOne, ...]
    mass: FaceField
    weight: FaceField
    mobility: FaceField
    shift: tuple[Array | float, ...]
    share: tuple[CellOrOne, ...]


def _cut(properties: FluidProperties) -> CutCells:
    return required(properties.cut, "cut cells")

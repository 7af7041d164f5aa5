"""The prediction of a fluid step: the stages of advection and stress before the projection."""

from __future__ import annotations

import dataclasses

from jax import Array

from jaxdem.errors import required
from jaxdem.fluid.boundary import set_normal_velocity
from jaxdem.fluid.cut_projection import CutContinuity
from jaxdem.fluid.cut_stress import CutViscosity
from jaxdem.fluid.fluid_state import FluidProperties, FluidState
from jaxdem.fluid.grid import CellOrOne, FaceField
from jaxdem.fluid.momentum_rates import MomentumRates, Rates, weighted
from jaxdem.fluid.projection import Continuity, product
from jaxdem.fluid.surface_response import SurfaceResponse, surface_response
from jaxdem.numerics.stages import stage


@dataclasses.dataclass(frozen=True)
class MomentumStep:
    """What does not change within a step, and its stages; made and used up inside of one trace.

    Attributes:
        terms: advection and stress.
        properties: of the fluid.
        state: at the start, with the mean gradient of this step.
        void_fraction: on the cells at the end; None without particles [-].
        time, time_step: [s].
        whole: void fractions on the faces, at the start and at the end [-].
        open: the same of whole control volumes, which surfaces close in part [-].
        weight: part of pressure gradient and stress that acts on the fluid, on the faces [-].
        continuity: what fluxes must satisfy.
        mobility: 1 / (g + B), on the faces [-].
        shift: forcing per mass of fluid times the step [m/s].
        pull: pressure gradient over density, times `weight` [m/s2].
        at_surfaces: viscosity of the friction on surfaces within the mesh; None without.
    """

    terms: MomentumRates
    properties: FluidProperties
    state: FluidState
    void_fraction: Array | None
    time: Array
    time_step: Array
    whole: tuple[tuple[CellOrOne, ...], tuple[CellOrOne, ...]]
    open: tuple[tuple[CellOrOne, ...], tuple[CellOrOne, ...]]
    weight: tuple[CellOrOne, ...]
    continuity: Continuity | CutContinuity
    mobility: tuple[Array | float, ...]
    shift: tuple[Array | float, ...]
    pull: tuple[Array | float, ...]
    at_surfaces: CutViscosity | None = None

    @property
    def end(self) -> Array:
        """() end of the step [s]."""
        return self.time + self.time_step

    @property
    def open_new(self) -> tuple[CellOrOne, ...]:
        """Void fraction of whole control volumes at the end [-]."""
        return self.open[1]

    @property
    def volume_changes(self) -> bool:
        """Whether continuity at the end of the step asks for another flux than at its start: the volume of the fluid in
        a cell changes, by particles or by surfaces that change their place, or something comes in through these."""
        cut = self.properties.cut
        return self.void_fraction is not None or (cut is not None and (cut.swept is not None or cut.supply is not None))

    def advanced(self, rates: FaceField) -> FaceField:
        """Velocity after the whole step at these rates of g u [m/s2], with implicit drag and the old pressure."""
        terms, cut, (old, new) = self.terms, self.properties.cut, self.whole
        rates = rates if cut is None else cut.on_open(rates)
        parts = zip(old, self.state.face_velocity, rates, self.pull, self.shift, self.mobility, strict=True)
        moved = tuple((g * u + self.time_step * (rate - p) + extra) * m for g, u, rate, p, extra, m in parts)
        moved = set_normal_velocity(terms.grid, terms.sides(self.properties, self.end), moved, new)
        return moved if cut is None else cut.with_walls(moved)

    def rates(self, flux: FaceField, velocity: FaceField, void_fraction: Array | None, time: Array) -> Rates:
        """Of a stage. They are written to memory once, see `numerics.stages`: what is made of them would compute them
        anew, which takes one and a half times as long."""

        def compute() -> Rates:
            return self.terms.of_stage(self.properties, flux, velocity, self.weight, void_fraction, time)

        return stage(self.time_step > 0.0, compute)

    def response(self, count: int) -> SurfaceResponse:
        """Of the loads on `count` surfaces to the speeds of pistons, means over the coupling interval.

        The projection of one step as long as the interval: the inertia of the fluid has the impulse of the first step
        alone, drag and friction that of all."""
        terms, cut = self.terms, required(self.properties.cut, "cut cells")
        viscosity = required(self.at_surfaces, "viscosity at surfaces").on_faces(terms.grid)
        friction = product((self.properties.density * nu for nu in viscosity), cut.friction)
        interval = required(cut.interval, "coupling interval")
        held = zip(self.whole[1], self.mobility, strict=True)
        mobility = (1.0 / (g + interval / self.time_step * (1.0 / m - g)) for g, m in held)
        parts = zip(self.weight, mobility, strict=True)
        push = cut.pushed(tuple(interval / self.properties.density * w * m for w, m in parts))
        coefficient = product(self.open_new, push)
        return surface_response(terms.grid, terms.boundary, cut, coefficient, friction, count)

    def predicted(self) -> tuple[Rates, FaceField]:
        """Mean rates, and the velocity that they lead to, before the projection."""
        start, (open_old, open_new) = self.state, self.open
        flux = product(open_old, start.face_velocity)
        if self.volume_changes:
            flux = self.continuity.corrected(flux)
        stages = [self.rates(flux, start.face_velocity, start.void_fraction, self.time)]
        trial = self.advanced(stages[0].total)
        flux = self.continuity.corrected(product(open_new, trial))
        stages.append(self.rates(flux, trial, self.void_fraction, self.end))
        mean = weighted(stages, (0.5, 0.5))
        predicted = self.advanced(mean.total)
        if self.terms.advection.stages == 3:
            # The third stage is at the middle of the step, which Heun's result is twice as far as.
            velocity = _halfway(start.face_velocity, predicted)
            flux = _halfway(product(open_old, start.face_velocity), product(open_new, predicted))
            flux = self.continuity.corrected(flux)
            g = None if self.void_fraction is None else 0.5 * (or_one(start.void_fraction) + self.void_fraction)
            stages.append(self.rates(flux, velocity, g, self.time + 0.5 * self.time_step))
            mean = weighted(stages, (1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0))
            predicted = self.advanced(mean.total)
        return mean, predicted


def or_one(void_fraction: Array | None) -> CellOrOne:
    """The void fraction, 1 where there are no particles."""
    return 1.0 if void_fraction is None else void_fraction


def _halfway(a: FaceField, b: FaceField) -> FaceField:
    return tuple(0.5 * (x + y) for x, y in zip(a, b, strict=True))

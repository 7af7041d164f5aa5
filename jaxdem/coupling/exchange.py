"""The exchange between fluid and particles over one coupling interval, and the impulses that the particles get.

The particles stand still; their void fraction moves from its last value to the present one. In every fluid
step of length t the drag is implicit on both sides:

    J_p = K_p (u_p - v_p) + k_p,   K_p = (t c_p + m_s) / (1 + (t c_p + m_s) / m_p),   u_p = sum_f W_pf u_f (new time),

with c_p the drag coefficient, m_s the slip masses of the further forces (`forces.protocol`), v_p the velocity that the
particle would reach without the two, and k_p all that is known before the step. A face loses
sum_p W_pf [K_p (u_f - v_p) + k_p]: face by face it follows its own velocity, but the sums over faces and over particles
are equal term by term, so momentum is conserved to round-off whatever the relaxation time, and the particles receive
J_p itself, spread over their contact steps. Slip masses act on the change of the slip; of it a face has its own
velocity at the start, so that nothing is smoothed from face to face.
In model B particles feel no pressure gradient and no stress; the drag stands for them.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.closures.base import DragInputs
from jaxdem.coupling.drag import IntervalDrag
from jaxdem.coupling.exchange_result import ExchangeDiagnostics, FluidForces
from jaxdem.coupling.forces.protocol import Contribution, FluidForce, IntervalStart
from jaxdem.coupling.further_impulses import ForceSums, FurtherImpulses, Motion, convective_acceleration, plus, total
from jaxdem.coupling.interpolation import deposit_on_faces, interpolate_faces
from jaxdem.coupling.open_cells import of_whole_cells, seen_slope
from jaxdem.coupling.presence import present_volume, volume_error
from jaxdem.fluid.fluid_state import FaceExchange, FluidState, FluidStep, ParticleFields
from jaxdem.fluid.grid import FaceField, box_smallest, face_total, sum_of
from jaxdem.fluid.interval import (
    FluidInterval,
    SolverRecord,
    StepSums,
    Substeps,
    solver_record,
)
from jaxdem.numerics.blocks import total as total_of
from jaxdem.particles.integrate import as_column


class _Carry(NamedTuple):
    """What the loop of fluid steps carries.

    Attributes:
        fluid: state.
        pressure: sum over the steps [Pa].
        velocity: (N, D) of the particles, as far as the fluid and steady forces have brought it [m/s].
        drag, pressure_gradient, viscous: (N, D) impulses so far [kg m/s]; explicit further forces are in that of the
            drag.
        balance: (2, D) impulse given to the particles, and lost by the faces [kg m/s].
        terms: () sizes of the terms that make it [kg m/s].
        further: impulses of the further forces that have a slip mass.
        of_fluid: sums over the steps.
    """

    fluid: FluidState
    pressure: Array
    velocity: Array
    drag: Array
    pressure_gradient: Array
    viscous: Array
    balance: Array
    terms: Array
    further: dict[str, ForceSums]
    of_fluid: StepSums


class _ExplicitTerms(NamedTuple):
    """What is known before a fluid step.

    Attributes:
        velocity: velocity without drag and slip masses [m/s].
        impulse: explicit terms k_p, those of the slip masses included [kg m/s].
        others: impulse of the forces that are not exchanged with the faces here [kg m/s].
        motion: of the fluid past the particles; None without slip masses.
    """

    velocity: Array
    impulse: Array
    others: Array
    motion: Motion | None


@dataclasses.dataclass(frozen=True)
class Exchange:
    """The exchange of one coupling interval, with all that does not change from fluid step to fluid step.

    Attributes:
        interval: the fluid's steps; static.
        further: the further forces; static.
        start: the interval's start.
        old_void_fraction: of the cells, of the last interval's positions [-].
        solids: solid fraction of the cells, of the present positions; a small one would be lost in 1 - void fraction
            [-].
        inputs: of the drag law, to be reported.
        drag: of the interval.
        contributions: of the further forces.
        steady: (N, D) contact force and submerged weight [N].
        substeps: the fluid steps.
        slip_mass: m_s, sum of all slip masses () or (N,); None for none [kg].
        attenuation: (N,) 1 / (1 + (t c + m_s) / m), share of a slip that is left when the particle yields to its
            impulse [-].
        response: (N,) K_p [kg].
    """

    interval: FluidInterval
    further: tuple[FluidForce, ...]
    start: IntervalStart
    old_void_fraction: Array
    solids: Array
    inputs: DragInputs
    drag: IntervalDrag
    contributions: dict[str, Contribution]
    steady: Array
    substeps: Substeps
    slip_mass: Array | None
    attenuation: Array
    response: Array

    @property
    def void_fraction(self) -> Array:
        """Void fraction of the cells, of the present positions [-]."""
        return 1.0 - self.solids

    @property
    def impulses(self) -> FurtherImpulses:
        """Of the further forces."""
        return FurtherImpulses(self.further, self.contributions, self.substeps)

    def first(self, fluid: FluidState) -> _Carry:
        """What the loop of fluid steps starts with."""
        velocity = self.start.particles.velocity
        zero = jnp.zeros_like(velocity)
        dimension, dtype = velocity.shape[1], velocity.dtype
        sums = self.impulses.none_yet(zero)
        return _Carry(
            fluid, jnp.zeros_like(fluid.pressure), velocity, zero, zero, zero,
            jnp.zeros((2, dimension), dtype), jnp.zeros((), dtype), sums,
            self.interval.no_sums(fluid, self.start.properties),
        )  # fmt: skip

    def fluid_step(self, carry: _Carry, k: Array, begin: Array) -> tuple[_Carry, SolverRecord]:
        """Fluid step number k of the interval that began at `begin` [s], among particles that gather impulse."""
        step, count, solver = self.substeps.step, self.substeps.number, self.interval.solver
        explicit = self.explicit_terms(carry)
        faces = self.on_faces(carry, explicit)
        change = (self.void_fraction - self.old_void_fraction) / count
        result = solver.step(
            self.substeps.properties(self.start.properties, k), carry.fluid, begin + k * step, step,
            ParticleFields(self.old_void_fraction + (k + 1) * change, faces, self.void_fraction),
        )  # fmt: skip
        return self.received(carry, explicit, faces, result), solver_record(result)

    def explicit_terms(self, carry: _Carry) -> _ExplicitTerms:
        """The terms known before a fluid step."""
        step, mass = self.substeps.step, as_column(self.start.bodies.mass)
        faces, weights = carry.fluid.face_velocity, self.start.weights
        others = step * self.steady
        if self.interval.solver.shares_stress:
            others = others + self._pressure_impulse(carry.fluid)
        terms = [] if self.drag.remainder is None else [step * self.drag.remainder]
        terms += self.impulses.known
        motion = None
        if self.slip_mass is not None:
            fluid = interpolate_faces(weights, faces)
            motion = Motion(fluid, fluid - carry.velocity, 0.0)
            terms.append(-as_column(self.slip_mass) * motion.slip)
        inertia = self.impulses.inertia
        if inertia is not None and motion is not None:
            convected = step * convective_acceleration(self.start.grid, weights, faces)
            motion = motion._replace(convected=convected)
            terms.append(as_column(inertia) * convected)
        impulse = sum_of(terms) if terms else jnp.zeros_like(others)
        return _ExplicitTerms(carry.velocity + (others + impulse) / mass, impulse, others, motion)

    def on_faces(self, carry: _Carry, explicit: _ExplicitTerms) -> FaceExchange:
        """What the particles do to the faces in a fluid step."""
        grid, weights = self.start.grid, self.start.weights
        resistance = deposit_on_faces(grid, weights, self.response)
        forcing = deposit_on_faces(grid, weights, self.response[:, None] * explicit.velocity - explicit.impulse)
        if self.slip_mass is None or explicit.motion is None:
            return FaceExchange(resistance, forcing)
        # Each face's own velocity at the start in place of that seen by the particles, and what faces have still to
        # lose.
        held = self.slip_mass * self.attenuation
        received = plus(held[:, None] * explicit.motion.fluid, *self.impulses.pending)
        own, less = deposit_on_faces(grid, weights, held), deposit_on_faces(grid, weights, received)
        faces = carry.fluid.face_velocity
        forcing = tuple(f + r * u - x for f, r, u, x in zip(forcing, own, faces, less, strict=True))
        return FaceExchange(resistance, forcing)

    def received(self, carry: _Carry, explicit: _ExplicitTerms, faces: FaceExchange, result: FluidStep) -> _Carry:
        """The impulses of a fluid step, added up."""
        step, solver, weights = self.substeps.step, self.interval.solver, self.start.weights
        bodies, response, blocks = self.start.bodies, self.response[:, None], self.start.grid.blocks
        fluid = interpolate_faces(weights, result.state.face_velocity)
        impulse = response * (fluid - explicit.velocity) + explicit.impulse
        pressure = viscous = jnp.zeros_like(impulse)
        if solver.shares_stress:
            pressure = self._pressure_impulse(result.state)
        if solver.shares_stress and solver.viscous:
            stress = interpolate_faces(weights, result.viscous_acceleration)
            viscous = step * self.start.properties.density * as_column(bodies.volume) * stress
        before = carry.velocity, explicit.others, impulse
        further = self.impulses.received(carry.further, explicit.motion, fluid, before, bodies.mass)
        on_moving_bodies = impulse - further.of_faces + further.on_bodies if further.sums else impulse
        lost = _lost(faces, result.state.face_velocity)
        totals = jnp.stack(
            (
                total_of(blocks, jnp.sum(self._own(plus(impulse, *self.impulses.pending)), axis=0)),
                jnp.stack(face_total(self.start.grid, lost)),
            )
        )
        sizes = self._own(response * (jnp.abs(fluid) + jnp.abs(explicit.velocity)) + jnp.abs(explicit.impulse))
        return _Carry(
            result.state,
            carry.pressure + result.state.pressure,
            carry.velocity + (step * self.steady + on_moving_bodies + pressure + viscous) / as_column(further.mass),
            carry.drag + (impulse - further.of_faces if further.sums else impulse),
            carry.pressure_gradient + pressure,
            carry.viscous + viscous,
            carry.balance + totals,
            carry.terms + total_of(blocks, jnp.sum(sizes)),
            further.sums,
            carry.of_fluid.plus(result),
        )

    def forces(self, carry: _Carry) -> FluidForces:
        """Mean forces of the interval."""
        duration = self.interval.duration
        further, drag = self.impulses.means(carry.further, duration, carry.drag / duration)
        return FluidForces(
            drag,
            carry.pressure_gradient / duration,
            carry.viscous / duration,
            self.inputs,
            self.drag.law,
            further,
            total((self.drag.torque, *(c.torque for c in self.contributions.values()))),
            self.drag.memory,
        )

    def diagnostics(self, carry: _Carry) -> ExchangeDiagnostics:
        """How exact the exchange was."""
        given, lost = carry.balance
        particles, solids, grid = self.start.particles, self.solids, self.start.grid
        volume = present_volume(self.start.bodies.volume, particles.velocity.shape[0], particles.active)
        in_cells = of_whole_cells(solids, self.start.properties.cut)
        volume, deposited = total_of(grid.blocks, (volume, jnp.sum(in_cells)))
        return ExchangeDiagnostics(
            jnp.max(jnp.abs(given - lost)) / (carry.terms + jnp.finfo(solids.dtype).tiny),
            volume_error(deposited * grid.cell_volume, volume),
            box_smallest(grid, self.void_fraction),
            total_of(grid.blocks, jnp.sum(self.drag.out_of_range.astype(jnp.int32))),
        )

    def _own(self, rows: Array) -> Array:
        """(N, D) of the particles of this slab: zero for its neighbours' particles, which it knows as well."""
        active = self.start.particles.active
        if self.start.grid.blocks is None or active is None:
            return rows
        return jnp.where(active[:, None], rows, 0.0)

    def _pressure_impulse(self, fluid: FluidState) -> Array:
        """(N, D) -t V grad p [kg m/s]; with the tension of a surface between two fluids -t V (grad p - tension)."""
        properties = self.start.properties
        slope = self.interval.solver.slope_at_particles(properties, fluid)
        slope = seen_slope(self.start.grid, slope, properties.cut)
        volume = as_column(self.start.bodies.volume)
        return -self.substeps.step * volume * interpolate_faces(self.start.weights, slope)


def _lost(faces: FaceExchange, velocity: FaceField) -> FaceField:
    """Impulse that the faces lose [kg m/s]."""
    return tuple(r * u - f for r, u, f in zip(faces.resistance, velocity, faces.forcing, strict=True))

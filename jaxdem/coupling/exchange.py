"""The fluid's part of a coupling interval, and the impulses it gives to the particles.

The particles stand still; their void fraction moves from its last value to the present one. In every fluid
step of length t the drag is implicit on both sides:

    J_p = K_p (u_p - v_p) + t r_p,   K_p = t c_p / (1 + t c_p / m_p),   u_p = sum_f W_pf u_f at the new time,

with v_p the velocity that the particle would reach without the coefficient's drag and r_p the closure's
remainder. A face loses sum_p W_pf [K_p (u_f - v_p) + t r_p]: face by face it follows its own velocity, but
the sums over faces and over particles are equal term by term, so momentum is conserved to round-off
whatever the relaxation time, and the particles receive J_p itself, spread over their contact steps.
Virtual mass and Basset force have a part b (change of the slip) that is implicit in the same way, with t c_p + b
for t c_p; a face follows the change of its own velocity.
In model B particles feel no pressure gradient and no stress; the drag stands for them.

Longer than other modules: what a fluid step gives to the particles and takes from the faces stands in one place, for
momentum rests on the two being the same sum.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.closures.base import Drag, DragClosure, DragInputs
from jaxdem.coupling.coarse_inputs import CoarseInputs
from jaxdem.coupling.deposition import Deposition
from jaxdem.coupling.forces import deconvolved, drag_inputs, drag_of_model_b
from jaxdem.coupling.history import Basset, SlipHistory
from jaxdem.coupling.interpolation import (
    Weights,
    deposit_on_faces,
    interpolate_faces,
)
from jaxdem.coupling.lift import LiftInputs, LiftLaw, rotational_drag, vorticity
from jaxdem.coupling.presence import present_drag, present_volume, present_weights, volume_error
from jaxdem.coupling.self_disturbance import SelfDisturbance, own_solid_fraction
from jaxdem.coupling.stiff_drag import settling_coefficient
from jaxdem.coupling.unsteady import (
    Unsteady,
    UnsteadySums,
    after_step,
    before_step,
    on_faces,
    unsteady_forces,
)
from jaxdem.coupling.virtual_mass import FluidMemory, VirtualMassForce, added_mass, settle_up
from jaxdem.coupling.void_fraction import solid_fraction
from jaxdem.fluid.boundary import coverage, largest_inflow
from jaxdem.fluid.grid import along, face_total, sum_of
from jaxdem.fluid.momentum import FaceExchange, FluidProperties, FluidSolver, FluidState
from jaxdem.fluid.pressure import pressure_gradient
from jaxdem.particles import vectors
from jaxdem.particles.batches import cond_in_batch
from jaxdem.particles.integrate import ParticleProperties, ParticleState, as_column, centres_in_box

SUBSTEPS = (1, 2, 4, 8)
"""Numbers of fluid steps that a coupling interval may be cut into."""


class FluidDiagnostics(NamedTuple):
    """What happened to the fluid in an interval; all ().

    Attributes:
        substeps: number of fluid steps taken.
        courant: largest sum over the axes of |u| t / h of a fluid step.
        viscous: viscosity number nu t sum(1/h^2) of a fluid step with the largest nu, molecular and subgrid;
            see `VISCOUS_STABLE`.
        iterations: of the pressure solver, most of any step.
        divergence: largest after projection, in units of U/h.
        converged: bool, every pressure solve reached its tolerance.
        finite: bool, no velocity and no pressure is NaN or infinite.
        momentum: |impulse of the particles + impulse of the faces| over the sum of the sizes of the terms that make
            it, K (|u| + |v|) and the remainder's: what rounding must be small against, also where drag dies out.
        volume: relative error of the deposited particle volume.
        void_fraction: smallest.
        out_of_range: number of particles where the drag law's floor or fallback acted.
    """

    substeps: Array
    courant: Array
    viscous: Array
    iterations: Array
    divergence: Array
    converged: Array
    finite: Array
    momentum: Array
    volume: Array
    void_fraction: Array
    out_of_range: Array


class FluidForces(NamedTuple):
    """Mean fluid forces on the particles over an interval, and what the drag law saw and gave.

    Attributes:
        drag: (N, D) [N].
        pressure_gradient: (N, D) -V_p grad p of the reduced pressure; zero in model B [N].
        viscous: (N, D) V_p div(tau); zero in model B [N].
        lift: (N, D) sum of the lift laws; None without any [N].
        torque: (N, A) of the rotational drag; None without it [N m].
        inputs: of the drag law, at the start of the interval, of the fluid's own mesh.
        law: (N, D) coefficient (u - v) + remainder as the law gave it for these inputs; f_A / g in model B [N].
        virtual_mass: of the virtual mass; None without it.
        basset: (N, D) Basset force; None without it [N].
        history: of the slip, for the next interval; None without the Basset force.
    """

    drag: Array
    pressure_gradient: Array
    viscous: Array
    lift: Array | None
    torque: Array | None
    inputs: DragInputs
    law: Array
    virtual_mass: VirtualMassForce | None = None
    basset: Array | None = None
    history: SlipHistory | None = None

    @property
    def total(self) -> Array:
        """(N, D) sum [N]; neither the virtual mass nor buoyancy of the hydrostatic pressure is in it."""
        more = [force for force in (self.lift, self.basset) if force is not None]
        return sum_of((self.drag, self.pressure_gradient, self.viscous, *more))


@dataclasses.dataclass(frozen=True)
class FluidInterval:
    """A coupling interval seen by the fluid; static.

    Attributes:
        solver: of the fluid.
        deposition: of the particles on the cells, None without particles.
        duration: of the interval [s].
        substeps: smallest number of fluid steps.
        courant_limit: a fluid step is cut until its Courant number is under this.
        lifts: lift laws, () for none.
        rotational_drag: whether the fluid turns the particles.
        reversible: loops that reverse-mode differentiation can run backwards.
        virtual_mass: coefficient C of the virtual mass, 0 for none [-].
        basset: the Basset force, None for none.
        self_disturbance: correction that gives the drag law the undisturbed slip, None for none.
        coarse_inputs: coarser mesh through which the drag law sees the fluid, None for the fluid's own.
        deconvolution: see `deconvolved`, 0 for none; without `coarse_inputs`, which have their own [-].
    """

    solver: FluidSolver
    deposition: Deposition | None
    duration: float
    substeps: int
    courant_limit: float
    lifts: tuple[LiftLaw, ...]
    rotational_drag: bool
    reversible: bool
    virtual_mass: float = 0.0
    basset: Basset | None = None
    self_disturbance: SelfDisturbance | None = None
    coarse_inputs: CoarseInputs | None = None
    deconvolution: float = 0.0


def advance_fluid(
    interval: FluidInterval, properties: FluidProperties, state: FluidState, time: Array
) -> tuple[FluidState, FluidDiagnostics]:
    """A fluid without particles advanced by one interval."""
    count, courant, viscous = _choose_substeps(interval, properties, state, time)
    step = jnp.asarray(interval.duration, state.pressure.dtype) / count

    def substep(state: FluidState, k: Array) -> tuple[FluidState, tuple[Array, Array, Array]]:
        result = interval.solver.step(properties, state, None, time + k * step, step)
        return result.state, (result.solver.iterations, result.divergence, result.solver.converged)

    state, reports = _substeps(interval, count, substep, state)
    nothing = jnp.zeros((), state.pressure.dtype)
    return state, FluidDiagnostics(
        count,
        courant / count,
        viscous / count,
        *reports,
        _finite(state),
        nothing,
        nothing,
        nothing + 1.0,
        jnp.zeros((), jnp.int32),
    )


def exchange(
    interval: FluidInterval,
    closure: DragClosure,
    drag_scale: Array,
    properties: FluidProperties,
    bodies: ParticleProperties,
    gravity: Array,
    fluid: FluidState,
    particles: ParticleState,
    time: Array,
) -> tuple[FluidState, FluidForces, FluidDiagnostics]:
    """Fluid advanced by one interval among particles, and the mean forces on these.

    The new state's pressure is the mean over the interval, as the forces are; velocity and void fraction are those at its end.

    Args:
        interval: static description.
        closure: drag law.
        drag_scale: () factor on the drag, 1 for the law as it is.
        properties: of the fluid.
        bodies: of the particles.
        gravity: (D,) [m/s2].
        fluid: state at `time`.
        particles: state at `time`.
        time: [s].
    """
    grid = interval.solver.grid
    weights, solids, inputs, shown = seen_fluid(interval, properties, bodies, fluid, particles)
    lift, torque = _rotation(interval, properties, bodies, fluid, particles, weights, inputs)
    steady = steady_force(properties, bodies, gravity, particles)
    unsteady = _unsteady(interval, properties, bodies, particles, inputs)
    law = drag_of_model(interval, closure, drag_scale, bodies, weights)
    drag, acting = interval_drag(
        interval, law, bodies, inputs, shown, particles.active, steady, lift, unsteady
    )
    count, courant, viscous = _choose_substeps(interval, properties, fluid, time)
    step = jnp.asarray(interval.duration, solids.dtype) / count
    grip = step * acting.coefficient + (0.0 if unsteady is None else unsteady.held)
    freedom = 1.0 / (1.0 + grip / bodies.mass)
    if unsteady is not None:
        unsteady = unsteady.per_step(count)
    zero = jnp.zeros_like(particles.velocity)
    carry = _Carry(
        fluid, jnp.zeros_like(fluid.pressure), particles.velocity, zero, zero, zero,
        jnp.zeros((2, grid.dimension), solids.dtype),
        jnp.zeros((), solids.dtype),
        None if unsteady is None else UnsteadySums(zero, zero, zero),
    )  # fmt: skip
    start = fluid.void_fraction
    change = (1.0 - solids - start) / count

    def substep(carry: _Carry, k: Array) -> tuple[_Carry, tuple[Array, Array, Array]]:
        return _substep(
            interval,
            properties,
            bodies,
            weights,
            acting,
            grip,
            steady,
            start + (k + 1) * change,
            1.0 - solids,
            freedom,
            unsteady,
            time + k * step,
            step,
            carry,
        )

    carry, reports = _substeps(interval, count, substep, carry)
    # The first fluid step takes the whole push of particles that stand elsewhere than in the last interval, so that the
    # pressure of the others is none that anything feels. The last void fraction is the deposited one itself, without the
    # rounding of the sum above.
    fluid = carry.fluid._replace(pressure=carry.pressure / count, void_fraction=1.0 - solids)
    forces = FluidForces(
        carry.drag / interval.duration - (0.0 if lift is None else lift),
        carry.pressure_gradient / interval.duration,
        carry.viscous / interval.duration,
        lift,
        torque,
        inputs if interval.coarse_inputs is not None else shown,
        drag.coefficient[:, None] * shown.slip_velocity + (0.0 if drag.remainder is None else drag.remainder),
        **_unsteady_means(interval, unsteady, carry),
    )
    given, lost = carry.balance
    size = carry.terms + jnp.finfo(solids.dtype).tiny
    volume = present_volume(bodies.volume, drag.coefficient.shape[0], particles.active)
    diagnostics = FluidDiagnostics(
        count,
        courant / count,
        viscous / count,
        *reports,
        _finite(fluid),
        jnp.max(jnp.abs(given - lost)) / size,
        volume_error(jnp.sum(solids) * grid.cell_volume, volume),
        jnp.min(fluid.void_fraction),
        jnp.sum(drag.out_of_range.astype(jnp.int32)),
    )
    return fluid, forces, diagnostics


def seen_fluid(
    interval: FluidInterval,
    properties: FluidProperties,
    bodies: ParticleProperties,
    fluid: FluidState,
    particles: ParticleState,
) -> tuple[Weights, Array, DragInputs, DragInputs]:
    """Weights of the particles, solid fraction on the cells, and inputs of the drag law: of the fluid's mesh and as it is shown them."""
    grid = interval.solver.grid
    assert interval.deposition is not None
    centres = centres_in_box(particles, grid.size, grid.periodic)
    weights = interval.deposition.weights(grid, centres, bodies.radius)
    weights = present_weights(weights, particles.active)
    solids = solid_fraction(grid, weights, bodies.volume)
    return weights, solids, *_inputs(interval, properties, bodies, fluid, particles, weights, solids)


def steady_force(
    properties: FluidProperties, bodies: ParticleProperties, gravity: Array, particles: ParticleState
) -> Array:
    """(N, D) force on the particles that does not change over the interval: contacts and weight less buoyancy [N]."""
    return particles.contact_force + as_column(_submerged_mass(bodies, properties)) * gravity[None]


def interval_drag(
    interval: FluidInterval,
    law: Callable[[DragInputs], Drag],
    bodies: ParticleProperties,
    inputs: DragInputs,
    shown: DragInputs,
    active: Array | None,
    steady: Array,
    lift: Array | None = None,
    unsteady: Unsteady | None = None,
) -> tuple[Drag, Drag]:
    """The drag as the law gives it at the start, and the one that acts over the interval; all evaluations of the law are here.

    Args:
        interval: static description.
        law: see `drag_of_model`.
        bodies: of the particles.
        inputs: of the fluid's mesh.
        shown: those that the law is given.
        active: (N,) bool; None where all particles are present.
        steady: see `steady_force`.
        lift: (N, D), acts with the remainder; None without it [N].
        unsteady: virtual mass and Basset force; None without them.
    """
    drag = acting = present_drag(law(shown), active)
    if lift is not None:
        acting = drag._replace(remainder=lift if drag.remainder is None else drag.remainder + lift)
    return drag, _settling(interval, law, bodies, inputs, shown, steady, acting, unsteady)


class _Carry(NamedTuple):
    fluid: FluidState
    pressure: Array
    velocity: Array
    drag: Array
    pressure_gradient: Array
    viscous: Array
    balance: Array
    terms: Array
    unsteady: UnsteadySums | None


def remembered(
    interval: FluidInterval | None,
    properties: FluidProperties | None,
    bodies: ParticleProperties,
    forces: FluidForces | None,
    particles: ParticleState,
    velocity: Array,
) -> ParticleState:
    """The particles at the end of an interval with what virtual mass and Basset force keep for the next one.

    Args:
        interval: static description.
        properties: of the fluid.
        bodies: of the particles.
        forces: over the interval.
        particles: at its end.
        velocity: (N, D) of the particles at its start [m/s].
    """
    if forces is None or particles.fluid_memory is None:
        return particles
    owed, force = None, particles.fluid_force
    if forces.virtual_mass is not None:
        added = added_mass(interval.virtual_mass, bodies, properties.density)
        duration = jnp.asarray(interval.duration, velocity.dtype)
        acted, owed = settle_up(forces.virtual_mass, added, particles.velocity - velocity, duration)
        force = force + acted
    return particles._replace(fluid_force=force, fluid_memory=FluidMemory(owed, forces.history))


def _unsteady(
    interval: FluidInterval,
    properties: FluidProperties,
    bodies: ParticleProperties,
    particles: ParticleState,
    inputs: DragInputs,
) -> Unsteady | None:
    if interval.virtual_mass == 0.0 and interval.basset is None:
        return None
    slip = inputs.slip_velocity
    return unsteady_forces(
        interval.virtual_mass, interval.basset, particles.fluid_memory, properties, bodies, slip,
        jnp.asarray(interval.duration, slip.dtype), particles.active,
    )  # fmt: skip


def _unsteady_means(interval: FluidInterval, unsteady: Unsteady | None, carry: _Carry) -> dict[str, Any]:
    """Mean forces of virtual mass and Basset, by their names in `FluidForces`."""
    if unsteady is None or carry.unsteady is None:
        return {}
    given, drive, trailing = (impulse / interval.duration for impulse in carry.unsteady)
    return {
        "virtual_mass": None if unsteady.added is None else VirtualMassForce(given, drive),
        "basset": None if unsteady.trailing is None else trailing,
        "history": unsteady.history,
    }


def _inputs(
    interval: FluidInterval,
    properties: FluidProperties,
    bodies: ParticleProperties,
    fluid: FluidState,
    particles: ParticleState,
    weights: Weights,
    solids: Array,
) -> tuple[DragInputs, DragInputs]:
    """The fluid at the particles, and what of it the drag law is shown."""
    solver = interval.solver
    inputs = drag_inputs(
        solver.grid,
        weights,
        particles.velocity,
        2.0 * bodies.radius,
        fluid.face_velocity,
        pressure_gradient(solver.grid, solver.boundary, fluid.pressure, continued=True),
        solids,
        properties.density,
        properties.viscosity,
    )
    if interval.coarse_inputs is not None:
        return inputs, interval.coarse_inputs(solver.grid, fluid, solids, particles, bodies, properties)
    if interval.deconvolution > 0.0:
        return inputs, deconvolved(solver.grid, weights, inputs, fluid.face_velocity, interval.deconvolution)
    return inputs, inputs


def drag_of_model(
    interval: FluidInterval,
    closure: DragClosure,
    drag_scale: Array,
    bodies: ParticleProperties,
    weights: Weights,
) -> Callable[[DragInputs], Drag]:
    """The drag law in the form of the fluid's model, scaled, and of the undisturbed slip if asked for."""

    def scaled(inputs: DragInputs) -> Drag:
        drag = closure(inputs)
        if not interval.solver.shares_stress:
            drag = drag_of_model_b(drag, inputs.solid_fraction)
        remainder = None if drag.remainder is None else drag_scale * drag.remainder
        return Drag(drag_scale * drag.coefficient, remainder, drag.out_of_range)

    correction = interval.self_disturbance
    if correction is None:
        return scaled
    own = own_solid_fraction(interval.solver.grid, weights, bodies.volume)
    return lambda inputs: correction(scaled, inputs, own, bodies.volume)


def _settling(
    interval: FluidInterval,
    law: Callable[[DragInputs], Drag],
    bodies: ParticleProperties,
    inputs: DragInputs,
    shown: DragInputs,
    steady: Array,
    drag: Drag,
    unsteady: Unsteady | None,
) -> Drag:
    """The drag with the coefficient that the slip of the coming interval gives it.

    Where the law is shown another velocity than that of the faces, which the coefficient acts on implicitly, the
    remainder makes up for the difference.
    """
    others, mass = steady, bodies.mass
    if unsteady is not None:
        mass = mass + unsteady.held
    if unsteady is not None and unsteady.past is not None:
        others = others + unsteady.past / interval.duration
    if interval.solver.shares_stress:
        others = others - as_column(bodies.volume) * inputs.pressure_gradient
    if drag.remainder is not None:
        others = others + drag.remainder
    duration = jnp.asarray(interval.duration, others.dtype)
    coefficient = settling_coefficient(
        lambda shifted: law(shifted).coefficient,
        shown, drag.coefficient, mass, others, duration,
    )  # fmt: skip
    if shown is inputs:
        return drag._replace(coefficient=coefficient)
    offset = coefficient[:, None] * (shown.fluid_velocity - inputs.fluid_velocity)
    return drag._replace(
        coefficient=coefficient, remainder=offset if drag.remainder is None else drag.remainder + offset
    )


def _rotation(
    interval: FluidInterval,
    properties: FluidProperties,
    bodies: ParticleProperties,
    fluid: FluidState,
    particles: ParticleState,
    weights: Weights,
    inputs: DragInputs,
) -> tuple[Array | None, Array | None]:
    """Sum of the lift laws (N, D) and the torque (N, A), for the fluid at the start of the interval."""
    if not interval.lifts and not interval.rotational_drag:
        return None, None
    around = LiftInputs(
        vectors.components(inputs.slip_velocity),
        vorticity(interval.solver.grid, weights, fluid.face_velocity),
        vectors.components(particles.angular_velocity),
        inputs.diameter,
        inputs.fluid_density,
        inputs.dynamic_viscosity,
    )
    lift = torque = None
    if interval.lifts:
        lift = sum_of(vectors.stack(law(around)) for law in interval.lifts)
    if interval.rotational_drag:
        duration = jnp.asarray(interval.duration, fluid.pressure.dtype)
        torque = vectors.stack(rotational_drag(around, bodies.inertia, duration))
    return lift, torque


def _substep(
    interval: FluidInterval,
    properties: FluidProperties,
    bodies: ParticleProperties,
    weights: Weights,
    drag: Drag,
    grip: Array,
    steady: Array,
    void_fraction: Array,
    weighting: Array,
    freedom: Array,
    unsteady: Unsteady | None,
    time: Array,
    step: Array,
    carry: _Carry,
) -> tuple[_Carry, tuple[Array, Array, Array]]:
    """One fluid step among particles that stand still but gather impulse.

    `grip` is t c_p + a + b with the masses of virtual mass and Basset force, `freedom` 1 / (1 + grip / m).
    """
    solver, grid = interval.solver, interval.solver.grid
    mass, volume = as_column(bodies.mass), as_column(bodies.volume)
    response = grip * freedom
    gripped = response[:, None]
    extra = 0.0 if drag.remainder is None else step * drag.remainder

    def pressure_impulse(pressure: Array) -> Array:
        slope = pressure_gradient(grid, solver.boundary, pressure, continued=True)
        return -step * volume * interpolate_faces(weights, slope)

    others = step * steady
    if solver.shares_stress:
        others = others + pressure_impulse(carry.fluid.pressure)
    known = None
    if unsteady is not None:
        known = before_step(grid, weights, unsteady, carry.velocity, carry.fluid.face_velocity, step)
        extra = extra + known.impulse
    reached = carry.velocity + (others + extra) / mass
    exchange = FaceExchange(
        deposit_on_faces(grid, weights, response),
        deposit_on_faces(grid, weights, gripped * reached - extra),
    )
    if unsteady is not None:
        exchange = on_faces(grid, weights, unsteady, known, freedom, carry.fluid.face_velocity, exchange)
    result = solver.step(properties, carry.fluid, void_fraction, time, step, exchange, weighting)
    seen = interpolate_faces(weights, result.state.face_velocity)
    impulse = gripped * (seen - reached) + extra
    pressure = viscous = jnp.zeros_like(impulse)
    if solver.shares_stress:
        pressure = pressure_impulse(result.state.pressure)
    if solver.shares_stress and solver.viscous:
        stress = interpolate_faces(weights, result.viscous_acceleration)
        viscous = step * properties.density * volume * stress
    lost = tuple(
        r * u - f
        for r, u, f in zip(exchange.resistance, result.state.face_velocity, exchange.forcing, strict=True)
    )
    given, sums, dragged, felt = impulse, carry.unsteady, impulse, impulse
    if unsteady is not None:
        slip = seen - (carry.velocity + (others + impulse) / mass)
        sums, both, driven = after_step(unsteady, known, carry.unsteady, slip, seen)
        dragged = impulse - both
        felt = dragged + driven
        mass = mass if unsteady.added is None else mass + as_column(unsteady.added)
        given = impulse if unsteady.owed is None else impulse + unsteady.owed
    terms = jnp.sum(gripped * (jnp.abs(seen) + jnp.abs(reached)) + jnp.abs(extra))
    balance = jnp.stack((jnp.sum(given, axis=0), jnp.stack(face_total(grid, lost))))
    new = _Carry(
        result.state,
        carry.pressure + result.state.pressure,
        carry.velocity + (step * steady + felt + pressure + viscous) / mass,
        carry.drag + dragged,
        carry.pressure_gradient + pressure,
        carry.viscous + viscous,
        carry.balance + balance,
        carry.terms + terms,
        sums,
    )
    return new, (result.solver.iterations, result.divergence, result.solver.converged)


def _substeps(interval: FluidInterval, count: Array, substep, carry):  # type: ignore[no-untyped-def]
    """`count` fluid steps; the worst of their reports (iterations, divergence, converged)."""
    dtype = carry.pressure.dtype if isinstance(carry, FluidState) else carry.drag.dtype
    worst = (jnp.zeros((), jnp.int32), jnp.zeros((), dtype), jnp.ones((), bool))

    def advance(both, k):  # type: ignore[no-untyped-def]
        carry, (iterations, divergence, converged) = both
        carry, report = substep(carry, k)
        return carry, (
            jnp.maximum(iterations, report[0]),
            jnp.maximum(divergence, report[1]),
            converged & report[2],
        )

    if not interval.reversible:
        return lax.fori_loop(0, count, lambda k, both: advance(both, k), (carry, worst))

    @jax.checkpoint
    def body(both, k):  # type: ignore[no-untyped-def]
        return cond_in_batch(k < count, lambda b: advance(b, k), both), None

    return lax.scan(body, (carry, worst), jnp.arange(SUBSTEPS[-1]))[0]


def _choose_substeps(
    interval: FluidInterval, properties: FluidProperties, state: FluidState, time: Array
) -> tuple[Array, Array, Array]:
    """Number of fluid steps, Courant number and viscosity number of the whole interval."""
    grid, dtype = interval.solver.grid, state.pressure.dtype
    speeds = [jnp.max(jnp.abs(u)) / h for u, h in zip(state.face_velocity, grid.spacing, strict=True)]
    for side in interval.solver.boundary.sides:
        # A jet that is switched on inside the interval counts too, as fast as it has to be between the particles.
        if side.kind == "inlet":
            velocity = properties.side_velocity[2 * side.axis + side.upper]
            inflow = largest_inflow(side, velocity, time, time + interval.duration)
            if state.void_fraction is not None:
                beside = along(state.void_fraction, side.axis, *((-1, None) if side.upper else (0, 1)))
                inflow = inflow / jnp.min(jnp.where(coverage(grid, side) > 0.0, beside, 1.0))
            speeds[side.axis] = jnp.maximum(speeds[side.axis], inflow / grid.spacing[side.axis])
    courant = interval.duration * jnp.sum(jnp.stack(speeds))
    viscous = jnp.zeros((), dtype)
    if interval.solver.viscous:
        largest = interval.solver.largest_viscosity(properties, state, time)
        viscous = jnp.asarray(interval.duration * largest * sum(1.0 / h**2 for h in grid.spacing), dtype)
    needed = jnp.maximum(courant / interval.courant_limit, viscous / VISCOUS_LIMIT)
    needed = lax.stop_gradient(jnp.maximum(needed, interval.substeps))
    choices = jnp.asarray(SUBSTEPS)
    count = choices[jnp.minimum(jnp.searchsorted(choices.astype(dtype), needed), len(SUBSTEPS) - 1)]
    return count, lax.stop_gradient(courant), lax.stop_gradient(viscous)


VISCOUS_STABLE = 0.375
"""Viscosity number nu t sum(1/h^2) up to which a fluid step is stable.

Velocities would be up to 0.5, by Heun's method. But a pressure p left over from the last step enters the trial velocity,
whose stress changes the prediction by -t^2/2 (4/3) nu lap(grad p): the projection leaves a pressure of (8/3) nu t
sum(1/h^2) times the old one in its shortest waves. 4/3 is of the deviatoric stress. Derived here."""

VISCOUS_LIMIT = 0.3
"""Viscosity number that fluid steps are chosen for: a fifth under `VISCOUS_STABLE`."""


def _finite(state: FluidState) -> Array:
    return jnp.all(jnp.asarray([jnp.all(jnp.isfinite(u)) for u in (*state.face_velocity, state.pressure)]))


def _submerged_mass(bodies: ParticleProperties, properties: FluidProperties) -> Array:
    """Mass less that of the water displaced [kg]: gravity on it is weight less hydrostatic buoyancy."""
    return bodies.mass - properties.density * bodies.volume

"""Virtual mass and Basset force inside a fluid step: what both have in common is a mass on the change of the slip.

With a the virtual mass and b the implicit part of the Basset force, u and v at the end of a fluid step of length t, and
u0, v0 at its start,

    J = a (u - u0 + t u0.grad u0 - (v - v0)) + b (u - u0 - (v - v0)) + past:

a drag coefficient (a + b)/t beside the law's, with known terms. At the faces u0 is that of each face: a face follows
the change of its own velocity, so that nothing is smoothed from face to face, and the sums over faces and over
particles are equal all the same.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.coupling.history import Basset, SlipHistory
from jaxdem.coupling.interpolation import Weights, deposit_on_faces, interpolate_faces
from jaxdem.coupling.virtual_mass import FluidMemory, added_mass, convective_acceleration
from jaxdem.fluid.grid import FaceField, Grid, sum_of
from jaxdem.fluid.momentum import FaceExchange, FluidProperties
from jaxdem.particles.integrate import ParticleProperties, as_column


class Unsteady(NamedTuple):
    """Virtual mass and Basset force over an interval; None for the one that is off.

    Attributes:
        added: () or (N,) a of the virtual mass [kg].
        trailing: () or (N,) implicit part b of the Basset force [kg].
        past: (N, D) impulse of the Basset force by earlier changes [kg m/s].
        owed: (N, D) impulse that the faces owe the particles from the last interval [kg m/s].
        history: of the slip.
    """

    added: Array | None
    trailing: Array | None
    past: Array | None
    owed: Array | None
    history: SlipHistory | None

    @property
    def held(self) -> Array:
        """a + b, () or (N,) [kg]."""
        return sum_of(part for part in (self.added, self.trailing) if part is not None)

    def per_step(self, count: Array) -> Unsteady:
        """The impulses divided among fluid steps."""
        past, owed = (None if part is None else part / count for part in (self.past, self.owed))
        return self._replace(past=past, owed=owed)


class UnsteadyStep(NamedTuple):
    """What is known before a fluid step, all (N, D).

    Attributes:
        slip: at its start [m/s].
        seen: fluid velocity at its start [m/s].
        ahead: change of the fluid velocity by convection [m/s]; None without virtual mass.
        impulse: all of the known terms [kg m/s].
    """

    slip: Array
    seen: Array
    ahead: Array | None
    impulse: Array


class UnsteadySums(NamedTuple):
    """Impulses so far, (N, D): of the virtual mass, of a times the fluid's change, of the Basset force [kg m/s]."""

    given: Array
    drive: Array
    trailing: Array


def unsteady_forces(
    coefficient: float,
    basset: Basset | None,
    memory: FluidMemory,
    properties: FluidProperties,
    bodies: ParticleProperties,
    slip: Array,
    duration: Array,
    active: Array | None,
) -> Unsteady:
    """Virtual mass and Basset force of an interval.

    Args:
        coefficient: C of the virtual mass, 0 for none [-].
        basset: the Basset force, None for none.
        memory: of the last interval.
        properties: of the fluid.
        bodies: of the particles.
        slip: (N, D) at the start of the interval [m/s].
        duration: of the interval () [s].
        active: (N,) bool, which particles are present; None where all are. Those that are not have no virtual mass;
            the Basset force is for particles that stay, see `jaxdem.scene_coupling`.
    """
    added = trailing = past = history = None
    if coefficient > 0.0:
        added = added_mass(coefficient, bodies, properties.density)
        added = added if active is None else jnp.where(active, added, 0.0)
    if basset is not None:
        trailing = basset.inertia(bodies, properties.density, properties.viscosity, duration)
        history = basset.advance(memory.history, slip)
        past = as_column(trailing) * basset.impulse(history)
    return Unsteady(added, trailing, past, memory.owed, history)


def before_step(
    grid: Grid, weights: Weights, unsteady: Unsteady, velocity: Array, faces: FaceField, step: Array
) -> UnsteadyStep:
    """The terms known before a fluid step of `step` [s], with the particles' velocity (N, D) so far [m/s]."""
    seen = interpolate_faces(weights, faces)
    slip = seen - velocity
    terms = [-as_column(unsteady.held) * slip]
    ahead = None
    if unsteady.added is not None:
        ahead = step * convective_acceleration(grid, weights, faces)
        terms.append(as_column(unsteady.added) * ahead)
    if unsteady.past is not None:
        terms.append(unsteady.past)
    return UnsteadyStep(slip, seen, ahead, sum_of(terms))


def on_faces(
    grid: Grid,
    weights: Weights,
    unsteady: Unsteady,
    known: UnsteadyStep,
    freedom: Array,
    faces: FaceField,
    exchange: FaceExchange,
) -> FaceExchange:
    """The exchange with each face's own velocity at the start for the one seen, and with what is owed.

    Args:
        grid: the grid.
        weights: of the particles.
        unsteady: the forces.
        known: before the step.
        freedom: () or (N,) 1 / (1 + (t c + a + b) / m) [-].
        faces: velocity at the start [m/s].
        exchange: by drag and the known terms.
    """
    response = jnp.broadcast_to(unsteady.held * freedom, known.slip.shape[:1])
    less = response[:, None] * known.seen
    if unsteady.owed is not None:
        less = less + unsteady.owed
    parts = zip(
        exchange.forcing,
        deposit_on_faces(grid, weights, response),
        faces,
        deposit_on_faces(grid, weights, less),
        strict=True,
    )
    return exchange._replace(forcing=tuple(f + r * u - x for f, r, u, x in parts))


def after_step(
    unsteady: Unsteady, known: UnsteadyStep, sums: UnsteadySums, slip: Array, seen: Array
) -> tuple[UnsteadySums, Array, Array]:
    """Impulses after a step, that of both forces in it, and that which acts on the body of mass m + a.

    Args:
        unsteady: the forces.
        known: before the step.
        sums: before the step.
        slip: (N, D) at the end, as the exchange has it [m/s].
        seen: (N, D) fluid velocity at the end [m/s].
    """
    change = slip - known.slip
    given = drive = trailing = jnp.zeros_like(slip)
    if unsteady.added is not None and known.ahead is not None:
        given = as_column(unsteady.added) * (change + known.ahead)
        drive = as_column(unsteady.added) * (seen - known.seen + known.ahead)
    if unsteady.trailing is not None and unsteady.past is not None:
        trailing = as_column(unsteady.trailing) * change + unsteady.past
    new = UnsteadySums(sums.given + given, sums.drive + drive, sums.trailing + trailing)
    return new, given + trailing, drive + trailing

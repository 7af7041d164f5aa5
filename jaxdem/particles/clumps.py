"""Motion of rigid bodies that are clumps of spheres: how they turn, and where their members are.

The centre of mass moves as a sphere does. The angular velocity w is in the box's axes; orientation is a unit quaternion
that turns the body's principal axes into the box's, in 2-D an angle. Between two kicks by torques a body turns freely:
its angular momentum L = I w stays, and the axes turn by rotations about one principal axis after the other, by
t L_k / I_k. Each of these is the exact motion of one part of the kinetic energy, so all of them together are
symplectic; their order is x y z in the first half of a step and z y x in the second, so they are of second order and
reversible in time.

Source: A. Dullweber, B. Leimkuhler & R. McLachlan, J. Chem. Phys. 107 (1997) 5840-5851, eq. 14 to 18; with quaternions
T. F. Miller et al., J. Chem. Phys. 116 (2002) 8649-8659.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.numerics import compensated, vectors
from jaxdem.numerics import pair_arithmetic as pairs
from jaxdem.numerics.compensated import Low, Pair
from jaxdem.numerics.quotients import quotient
from jaxdem.numerics.stages import stage
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.clump_shape import Clumps, Placed
from jaxdem.particles.integrate import Motion, ParticleProperties

FURTHEST = 0.25
"""Part of the skin of the list by which a body may turn in a step; no sound run comes near it."""


def turned(motion: Motion, clumps: Clumps, time_step: Array, forwards: bool) -> Motion:
    """Bodies that have turned freely for `time_step` [s], about x, y, z or, not `forwards`, about z, y, x."""
    spin = motion.angular_velocity
    if len(spin) == 1:
        angle, low = compensated.advance(motion.orientation[0], motion.orientation_low[0], time_step * spin[0])
        return motion._replace(orientation=(angle,), orientation_low=(low,))
    ratio = _over_first(clumps)
    before = turned_back(motion.orientation, spin)
    momentum = [r * part for r, part in zip(ratio, before, strict=True)]  # over the first principal moment
    excess = _along_axes(motion.orientation, momentum, ratio)
    change: Vector = (jnp.zeros_like(spin[0]),) * 4
    for axis in (0, 1, 2) if forwards else (2, 1, 0):
        half, momentum = _about(axis, time_step * momentum[axis] / ratio[axis], momentum)
        change = vectors.add(vectors.add(change, half), hamilton(change, half))
    increments = hamilton(motion.orientation, change)
    moved = [
        compensated.advance(*part) for part in zip(motion.orientation, motion.orientation_low, increments, strict=True)
    ]
    orientation = tuple(high for high, _ in moved)
    # As a change, which is nothing to the bit for a body whose moments are equal.
    after = _along_axes(orientation, momentum, ratio)
    spin = tuple(w + (a - b) for w, a, b in zip(spin, after, excess, strict=True))
    return motion._replace(
        angular_velocity=spin, orientation=orientation, orientation_low=tuple(low for _, low in moved)
    )


def _over_first(clumps: Clumps) -> Vector:
    """Principal moments over the first one [-]."""
    return tuple(moment / clumps.inertia[0] for moment in clumps.inertia)


def _along_axes(orientation: Vector, momentum: list[Array] | Vector, ratio: Vector) -> Vector:
    """I^-1 L - L/I_1 in the box's axes, of L over I_1 in the principal ones."""
    extra = tuple((1.0 / r - 1.0) * part for r, part in zip(ratio[1:], momentum[1:], strict=True))
    return turned_by(orientation, (jnp.zeros_like(momentum[0]), *extra))


def _about(axis: int, angle: Array, momentum: list[Array]) -> tuple[Vector, list[Array]]:
    """The quaternion less 1 of a turn about a principal axis, and the momentum in the axes that have turned.

    tan(angle/4) by two terms of its series: a turn by nearly this angle, which is symplectic too.
    """
    tangent = 0.25 * angle + angle**3 / 192.0
    scale = 2.0 / (1.0 + tangent**2)
    sine, less = tangent * scale, -(tangent**2) * scale  # of half of the angle, and its cosine less 1
    parts = [less, jnp.zeros_like(less), jnp.zeros_like(less), jnp.zeros_like(less)]
    parts[1 + axis] = sine
    whole_sine, whole_less = 2.0 * sine * (1.0 + less), -2.0 * sine**2
    one, other = momentum[(axis + 1) % 3], momentum[(axis + 2) % 3]
    found = list(momentum)
    found[(axis + 1) % 3] = one + (whole_less * one + whole_sine * other)
    found[(axis + 2) % 3] = other + (whole_less * other - whole_sine * one)
    return tuple(parts), found


def kicked(motion: Motion, force: Vector, torque: Vector, bodies: ParticleProperties, time_step: Array) -> Motion:
    """Velocities changed by force [N] and torque [N m] over `time_step` [s]; see `integrate.kick`."""
    clumps = bodies.rigid
    linear, angular = quotient(time_step, bodies.mass), quotient(time_step, bodies.first_inertia)
    spin = vectors.add_scaled(motion.angular_velocity, angular, torque)
    if len(spin) == 3:
        ratio = _over_first(clumps)
        extra = _along_axes(motion.orientation, turned_back(motion.orientation, torque), ratio)
        spin = vectors.add_scaled(spin, angular, extra)
    return motion._replace(velocity=vectors.add_scaled(motion.velocity, linear, force), angular_velocity=spin)


def spin_energy(spin: Vector, orientation: Vector, bodies: ParticleProperties) -> Array:
    """(N,) w.I w / 2 [J]."""
    moments = tuple(factor * bodies.density * bodies.volume * bodies.radius**2 for factor in bodies.rigid.inertia)
    own = spin if len(spin) == 1 else turned_back(orientation, spin)
    return 0.5 * sum((i * w**2 for i, w in zip(moments, own, strict=True)), jnp.zeros_like(spin[0]))


def angular_momentum(spin: Vector, orientation: Vector, bodies: ParticleProperties) -> Vector:
    """(N,) I w about the centre of mass, in the box's axes [kg m2/s]."""
    moments = tuple(factor * bodies.density * bodies.volume * bodies.radius**2 for factor in bodies.rigid.inertia)
    if len(spin) == 1:
        return (moments[0] * spin[0],)
    own = turned_back(orientation, spin)
    return turned_by(orientation, tuple(i * w for i, w in zip(moments, own, strict=True)))


def hamilton(a: Vector, b: Vector) -> Vector:
    """Product of two quaternions (w, x, y, z)."""
    scalar, vector = a[0] * b[0] - vectors.dot(a[1:], b[1:]), vectors.cross(a[1:], b[1:])
    return (scalar, *(a[0] * y + b[0] * x + z for x, y, z in zip(a[1:], b[1:], vector, strict=True)))


def turned_by(quaternion: Vector, vector: Vector) -> Vector:
    """A vector in the body's axes, in those of the box: v + 2 q x (w v + q x v) of a unit quaternion (w, q)."""
    across = vectors.cross(quaternion[1:], vector)
    inner = vectors.add_scaled(across, quaternion[0], vector)
    return vectors.add_scaled(vector, 2.0, vectors.cross(quaternion[1:], inner))


def turned_back(quaternion: Vector, vector: Vector) -> Vector:
    """The inverse of `turned_by`."""
    return turned_by((-quaternion[0], *quaternion[1:]), vector)


def normalised(motion: Motion) -> Motion:
    """Quaternions with length 1 again, from which rounding has moved them by next to nothing."""
    if len(motion.orientation) == 1:
        return motion
    parts = list(zip(motion.orientation, motion.orientation_low, strict=True))
    squared = pairs.pair_of(-1.0, motion.orientation[0].dtype)
    for part in parts:
        squared = pairs.total(pairs.product(part, part), squared)
    factor = -0.5 * pairs.value(squared)
    moved = [compensated.advance(high, low, factor * high) for high, low in parts]
    return motion._replace(orientation=tuple(high for high, _ in moved), orientation_low=tuple(low for _, low in moved))


def placed(
    position: Vector,
    low: tuple[Low, ...],
    orientation: Vector,
    orientation_low: tuple[Low, ...],
    offset: Vector,
    there: Array | None,
) -> Placed:
    """Bodies and the arms of their members, in pairs of floats."""
    turning = [_row(part) for part in zip(orientation, orientation_low, strict=True)]
    body = [pairs.as_pair(x) for x in offset]
    found = _arms_in_plane(turning[0], body) if len(body) == 2 else _arms_in_space(turning, body)
    arm, arm_low = tuple(high for high, _ in found), tuple(trailing for _, trailing in found)
    return Placed(position, low, orientation, orientation_low, offset, arm, arm_low, there)


def _row(part: Pair) -> Pair:
    return part[0][None], None if part[1] is None else part[1][None]


def _arms_in_plane(angle: Pair, body: list[Pair]) -> list[Pair]:
    turns = pairs.product(angle, pairs.pair_of(0.5 / jnp.pi, angle[0].dtype))
    sine, cosine = pairs.sine_and_cosine(turns)
    return [
        pairs.total(pairs.product(cosine, body[0]), pairs.negative(pairs.product(sine, body[1]))),
        pairs.total(pairs.product(sine, body[0]), pairs.product(cosine, body[1])),
    ]


def _arms_in_space(turning: list[Pair], body: list[Pair]) -> list[Pair]:
    """v + 2 q x (w v + q x v) of pairs."""

    def cross(a: list[Pair], b: list[Pair]) -> list[Pair]:
        return [
            pairs.total(
                pairs.product(a[(k + 1) % 3], b[(k + 2) % 3]),
                pairs.negative(pairs.product(a[(k + 2) % 3], b[(k + 1) % 3])),
            )
            for k in range(3)
        ]

    scalar, vector = turning[0], turning[1:]
    inner = [pairs.total(pairs.product(scalar, v), across) for v, across in zip(body, cross(vector, body), strict=True)]
    twice = [pairs.total(part, part) for part in cross(vector, inner)]
    # The offsets second, as constants must be.
    return [pairs.total(part, v) for v, part in zip(body, twice, strict=True)]


def arm_change(reference: Placed, motion: Motion) -> Vector:
    """D arrays (m, N): how far members have moved about their centres since the list was made [m].

    From the turn p since then, which is small: (p - 1) keeps its leading digits in one float.
    """
    apart = tuple(
        compensated.rounded_difference(*part)
        for part in zip(
            motion.orientation, motion.orientation_low, reference.orientation, reference.orientation_low, strict=True
        )
    )
    if len(apart) == 1:
        angle = apart[0]
        # A stage: they would be computed anew for every member.
        sine, less = stage(
            jnp.any(angle == angle), lambda: (jnp.sin(angle)[None], -2.0 * jnp.sin(0.5 * angle)[None] ** 2)
        )
        x, y = reference.arm
        return less * x - sine * y, less * y + sine * x
    start = reference.orientation
    turn = hamilton(apart, (start[0], *(-x for x in start[1:])))
    vector = tuple(x[None] for x in turn[1:])
    inner = vectors.add_scaled(vectors.cross(vector, reference.arm), (1.0 + turn[0])[None], reference.arm)
    return vectors.scale(2.0, vectors.cross(vector, inner))


def member_places(reference: Placed, motion: Motion, change: Vector) -> tuple[Vector, tuple[Low, ...]]:
    """Centres of the members as pairs, D arrays (m N,)."""
    found = []
    for high, low, arm, arm_low, moved in zip(
        motion.position, motion.low, reference.arm, reference.arm_low, change, strict=True
    ):
        whole = pairs.total(_row((high, low)), (arm, arm_low))
        found.append(compensated.advance(*whole, moved))
    flat = [(high.reshape(-1), None if low is None else low.reshape(-1)) for high, low in found]
    return tuple(high for high, _ in flat), tuple(low for _, low in flat)


def farthest_way(reference: Placed, motion: Motion, time_step: Array) -> Array:
    """(N,) bound of the lengths of `way_ahead` of the members of each body [m].

    A turn by p moves a member at the arm a by at most 2 |p - 1| |a|, in 2-D one by an angle by at most that angle times
    |a|: once for each body, where the ways themselves are found for each member.
    """
    apart, centre = (
        vectors.length(tuple(compensated.rounded_difference(*part) for part in zip(*four, strict=True)))
        for four in (
            (motion.orientation, motion.orientation_low, reference.orientation, reference.orientation_low),
            (motion.position, motion.low, reference.position, reference.low),
        )
    )
    angle = apart if len(motion.orientation) == 1 else 2.0 * apart
    angle = angle + time_step * vectors.length(motion.angular_velocity)
    return centre + angle * jnp.max(vectors.length(reference.arm), axis=0)


def way_ahead(reference: Placed, motion: Motion, time_step: Array, skin: float) -> Vector:
    """D arrays (m N,): motion of the members from the list's build to the end of the coming step [m].

    `motion` has the centres there already, and the orientations and spins before the step.
    """
    change = arm_change(reference, motion)
    centre = tuple(
        compensated.rounded_difference(*part)
        for part in zip(motion.position, motion.low, reference.position, reference.low, strict=True)
    )
    arm = vectors.add(reference.arm, change)
    turning = vectors.scale(time_step, vectors.rotate(tuple(w[None] for w in motion.angular_velocity), arm))
    # After a build this must be within the skin, or the loop would build for ever.
    size = vectors.length(turning)
    turning = vectors.scale(jnp.minimum(1.0, FURTHEST * skin / jnp.where(size > 0, size, 1.0)), turning)
    return tuple((x[None] + a + t).reshape(-1) for x, a, t in zip(centre, change, turning, strict=True))

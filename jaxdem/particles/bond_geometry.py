"""Parallel bonds: beams of cement between two grains, beside their contact, that stretch, shear, bend, twist and break.

A bond is a cylinder of radius R = f min(R_a, R_b), f the radius factor, between the two centres. It has the area
A = pi R^2 and the moments of inertia I = pi R^4/4 and J = 2 I. With its stiffnesses per area, k_n and k_s [Pa/m], it
gives k_n A against stretching, k_s A against shear, k_n I against bending and k_s J against twisting.

Potyondy & Cundall add up increments of force and moment. Here both follow from where the two grains are and how they
are turned, which is the same for small strains. So the bond has an energy, and is its gradient to rounding: momentum
and angular momentum are kept, energy is kept as well as the step resolves it, and a bonded body may turn for ever
without straining its bonds, where sums of increments drift.

With the separation r = d n of the centres, r_0 = L e when the bond was made, the quaternions q_a, q_b and rotations
R_a, R_b of the grains since then, and arms l_a + l_b = L that meet in the middle between the surfaces,

    u = r - l_a R_a e - l_b R_b e           by which the two ends of the cut bond are apart,
    b = 2 Im(q_a q_b*)                      by which one is turned against the other,
    E = (k_n A (u.n)^2 + k_s A |u - (u.n) n|^2 + k_n I |b - (b.n) n|^2 + k_s J (b.n)^2) / 2.

It breaks, for good, where the stress at its rim reaches a strength, with a factor m on the moments:

    k_n (u.n + m R |b - (b.n) n|) >= tensile strength,    k_s (|u - (u.n) n| + m R |b.n|) >= shear strength.

Sources:
    D. O. Potyondy, P. A. Cundall, Int. J. Rock Mech. Min. Sci. 41 (2004) 1329-1364, eqs 10-18.
    D. O. Potyondy, Int. J. Geomech. 15 (2015) 04014087 [the factor on the moments].
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.numerics import compensated, vectors
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.bond_state import Bonding, BondState
from jaxdem.particles.integrate import Motion, ParticleProperties
from jaxdem.particles.pairs import at


class BondParameters(NamedTuple):
    """Numbers of the bonds; traced, (T,) for the T tables of a scene.

    Attributes:
        normal_stiffness: k_n, per area of the bond [Pa/m].
        shear_stiffness: k_s, per area of the bond [Pa/m].
        radius_factor: radius of a bond over that of the smaller of its grains [-].
        tensile_strength: infinite for a bond that does not break so [Pa].
        shear_strength: the same [Pa].
        moment_factor: weight of bending and twisting in the stresses [-].
        damping: ratio to critical damping of the two grains on each of the four springs; None where no bond has any
            [-].
        young_modulus: of the cement, adds itself over the length of a bond to k_n; None where no table has one [Pa].
        shear_modulus: the same to k_s [Pa].
    """

    normal_stiffness: Array
    shear_stiffness: Array
    radius_factor: Array
    tensile_strength: Array
    shear_strength: Array
    moment_factor: Array
    damping: Array | None = None
    young_modulus: Array | None = None
    shear_modulus: Array | None = None

    def of_bonds(self, bonds: BondState) -> BondParameters:
        """(B,) of every bond, with the stiffness of its cement."""
        found: BondParameters = jax.tree.map(lambda x: at((x,), bonds.table)[0], self)
        if found.young_modulus is None or found.shear_modulus is None:
            return found
        length = vectors.length(in_space(bonds.separation))
        return found._replace(
            normal_stiffness=found.normal_stiffness + found.young_modulus / length,
            shear_stiffness=found.shear_stiffness + found.shear_modulus / length,
        )


class BondGeometry(NamedTuple):
    """Where the grains of every bond stand to one another, as vectors of three components in 2-D too.

    Attributes:
        numbers: of every bond.
        separation: r [m].
        distance: d [m].
        normal: n, towards the first grain.
        arms: l_a, l_b [m].
        ends: l_a R_a e and l_b R_b e [m].
        opening: u [m].
        stretch: u.n [m].
        slide: u - (u.n) n [m].
        rotation: b [-].
        cosine: real part of q_a q_b*, the cosine of half the angle between the two grains [-].
        twist: b.n [-].
        bending: b - (b.n) n [-].
        radius: R [m].
    """

    numbers: BondParameters
    separation: Vector
    distance: Array
    normal: Vector
    arms: tuple[Array, Array]
    ends: tuple[Vector, Vector]
    opening: Vector
    stretch: Array
    slide: Vector
    rotation: Vector
    cosine: Array
    twist: Array
    bending: Vector
    radius: Array

    @property
    def area(self) -> Array:
        """A [m2]."""
        return jnp.pi * self.radius**2

    @property
    def stiffness(self) -> tuple[Array, Array, Array, Array]:
        """k_n A, k_s A [N/m], k_n I and k_s J [N m]."""
        normal, shear = self.numbers.normal_stiffness * self.area, self.numbers.shear_stiffness * self.area
        squared = 0.25 * self.radius**2
        return normal, shear, squared * normal, 2.0 * squared * shear

    def stresses(self) -> tuple[Array, Array]:
        """(B,) largest tension and shear at the rim [Pa]."""
        lever = self.numbers.moment_factor * self.radius
        tension = self.stretch + lever * vectors.length(self.bending)
        shear = vectors.length(self.slide) + lever * jnp.abs(self.twist)
        return self.numbers.normal_stiffness * tension, self.numbers.shear_stiffness * shear

    def energy(self) -> Array:
        """(B,) elastic energy [J]."""
        normal, shear, bending, twisting = self.stiffness
        of_forces = normal * self.stretch**2 + shear * vectors.dot(self.slide, self.slide)
        return 0.5 * (of_forces + bending * vectors.dot(self.bending, self.bending) + twisting * self.twist**2)

    def elastic(self) -> tuple[Vector, Vector, Vector]:
        """Force on the first grain (minus that on the second) [N], torque on the first and on the second [N m]: minus
        the gradient of the energy."""
        normal, shear, bending, twisting = self.stiffness
        force = vectors.add_scaled(vectors.scale(shear, self.slide), normal * self.stretch, self.normal)
        moment = vectors.add_scaled(vectors.scale(bending, self.bending), twisting * self.twist, self.normal)
        # The normal turns with the separation.
        leaning = (normal - shear) * self.stretch / self.distance
        turning = (twisting - bending) * self.twist / self.distance
        pull = vectors.add_scaled(vectors.add_scaled(force, leaning, self.slide), turning, self.bending)
        one, other = self.ends
        half = vectors.scale(0.5, vectors.cross(self.rotation, moment))
        straight = vectors.scale(self.cosine, moment)
        on_first = vectors.subtract(vectors.cross(one, force), vectors.add(straight, half))
        on_second = vectors.add(vectors.cross(other, force), vectors.subtract(straight, half))
        return vectors.scale(-1.0, pull), on_first, on_second


def bond_geometry(
    bonding: Bonding, parameters: BondParameters, properties: ParticleProperties, motion: Motion, bonds: BondState
) -> BondGeometry:
    """Where the grains of every bond stand; bonds that do not hold are as they were made."""
    numbers, pairs, intact = parameters.of_bonds(bonds), bonds.pairs, bonds.intact
    one, other = (of_grains(properties.radius, index) for index in (pairs.first, pairs.second))
    change = vectors.where(intact, _change(bonding, motion, bonds), 0.0)
    before = in_space(bonds.separation)
    length = vectors.length(before)
    axis = vectors.scale(1.0 / length, before)
    arms = 0.5 * (length + one - other), 0.5 * (length + other - one)
    first, second = (_quaternion(bonds, index, intact) for index in (pairs.first, pairs.second))
    moved = tuple(vectors.scale(arm, _moved(q, axis)) for arm, q in zip(arms, (first, second), strict=True))
    opening = vectors.subtract(change, vectors.add(*moved))
    separation = vectors.add(before, change)
    distance = vectors.length(separation)
    normal = vectors.scale(1.0 / distance, separation)
    cosine, turn = _relative(bonds, (first, second), intact)
    stretch, twist = vectors.dot(opening, normal), vectors.dot(turn, normal)
    return BondGeometry(
        numbers, separation, distance, normal, arms,
        ends=(vectors.add_scaled(moved[0], arms[0], axis), vectors.add_scaled(moved[1], arms[1], axis)),
        opening=opening,
        stretch=stretch,
        slide=vectors.add_scaled(opening, -stretch, normal),
        rotation=turn,
        cosine=cosine,
        twist=twist,
        bending=vectors.add_scaled(turn, -twist, normal),
        radius=numbers.radius_factor * jnp.minimum(one, other),
    )  # fmt: skip


def _change(bonding: Bonding, motion: Motion, bonds: BondState) -> Vector:
    """r - r_0 of the nearest images [m]; small, hence well resolved in one float, where the body has not turned."""
    found = []
    for axis, (high, low) in enumerate(zip(motion.position, motion.low, strict=True)):
        one, other = (
            (at((high,), index)[0], None if low is None else at((low,), index)[0])
            for index in (bonds.pairs.first, bonds.pairs.second)
        )
        apart = compensated.difference(*one, *other)
        if bonding.periodic[axis]:
            length = bonding.box[axis]
            number = jnp.round((apart[0] - bonds.separation[axis]) / length)
            apart = compensated.difference(*apart, *compensated.whole_periods(number, length))
        before = bonds.separation[axis], bonds.separation_low[axis]
        found.append(compensated.rounded_difference(*apart, *before))
    return in_space(tuple(found))


def _quaternion(bonds: BondState, index: Array, intact: Array) -> Vector:
    """Of the grains (B,), no rotation where the bond does not hold."""
    found = at(bonds.orientation, index)
    return tuple(jnp.where(intact, q, 1.0 if k == 0 else 0.0) for k, q in enumerate(found))


def _relative(bonds: BondState, turned: tuple[Vector, Vector], intact: Array) -> tuple[Array, Vector]:
    """Real part of q_a q_b*, and twice its vector part, from q_a - q_b: so small angles keep their digits."""
    (first, second), pairs = turned, bonds.pairs
    apart = []
    for high, low in zip(bonds.orientation, bonds.orientation_low, strict=True):
        lows = (None, None) if low is None else at((low, low), pairs.first)[:1] + at((low,), pairs.second)
        both = at((high,), pairs.first) + at((high,), pairs.second)
        apart.append(jnp.where(intact, compensated.rounded_difference(both[0], lows[0], both[1], lows[1]), 0.0))
    scalar, axis = apart[0], tuple(apart[1:])
    # (s + v)(w - p) with s + v the difference: its vector part is w v - s p - v x p.
    vector = vectors.add_scaled(vectors.scale(second[0], axis), -scalar, second[1:])
    vector = vectors.subtract(vector, vectors.cross(axis, second[1:]))
    return vectors.dot(first, second), vectors.scale(2.0, vector)


def _moved(quaternion: Vector, axis: Vector) -> Vector:
    """R e - e = 2 p x (w e + p x e), of a quaternion w + p and a vector e."""
    scalar, vector = quaternion[0], quaternion[1:]
    inner = vectors.add(vectors.scale(scalar, axis), vectors.cross(vector, axis))
    return vectors.scale(2.0, vectors.cross(vector, inner))


def in_space(vector: Vector) -> Vector:
    """Three components."""
    return vector if len(vector) == 3 else (*vector, jnp.zeros_like(vector[0]))


def spin_in_space(spin: Vector) -> Vector:
    """Three components of an angular velocity."""
    return spin if len(spin) == 3 else (jnp.zeros_like(spin[0]), jnp.zeros_like(spin[0]), spin[0])


def of_grains(quantity: Array, index: Array) -> Array:
    """() unchanged, of (N,) the rows of these indices."""
    return quantity if quantity.ndim == 0 else at((quantity,), index)[0]

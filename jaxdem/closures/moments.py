"""Moments of the neighbours about a sphere: their density, expanded in distance and direction about an axis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Real

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import InputError, require_whole
from jaxdem.numerics.products import PRECISION
from jaxdem.numerics.static import static

NEAREST = 0.8
"""Distance of two centres, in diameters, under which functions of the distance stay as they are there."""

SMALLEST = 1e-12
"""Square of a distance, in diameters, under which two centres count as one."""


@static
class MomentBasis:
    """Functions of a neighbour's place; static.

    Attributes:
        reach: c, distance in diameters at which neighbours cease to count [-].
        radial: number of functions of the distance.
        degree: largest degree l of the functions of the direction.
        order: largest order m of these.
        stretch: factor by which lengths along the axis are divided before anything else: neighbours within an ellipsoid
            count, `reach` wide to each side and `reach * stretch` long, which resolves wakes [-].
        decay: p, even exponent of the decay towards the reach; a larger one keeps what is far up to near the reach.
    """

    reach: float
    radial: int
    degree: int
    order: int
    stretch: float = 1.0
    decay: int = 2

    def __post_init__(self) -> None:
        """Refuses numbers for which there are no functions."""
        require_whole(self, ("radial",), 1)
        require_whole(self, ("degree", "order"), 0)
        require_whole(self, ("decay",), 2)
        for name, least in (("reach", 1.0), ("stretch", 0.0)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, Real) or not least < float(value) < math.inf:
                raise InputError(name, value, f"must be a number above {least:g}", "Give one.")
        if self.order > self.degree:
            raise InputError("order", self.order, f"is above the degree {self.degree}", "Give a smaller one.")
        if self.decay % 2:
            raise InputError("decay", self.decay, "is odd", "Give an even one.")

    @property
    def length(self) -> float:
        """Distance along the axis at which neighbours cease to count [-]."""
        return self.reach * max(1.0, self.stretch)

    def count(self, order: int) -> int:
        """Number of functions of this order m."""
        return self.radial * (self.degree + 1 - order)


def radial_functions(basis: MomentBasis, distance: Array) -> Array:
    """R_n(r), the number of functions first; r in diameters, of any shape.

    R_n(r) = T_n(2 x - 1) (1 - (r/c)^p)^2 with x = (1/r - 1/c) / (1 - 1/c) and T_n the polynomials of Chebyshev: x is 1
    at contact and 0 at the reach c, and resolves what is near. Value and slope are zero at c, so that a neighbour that
    crosses it changes nothing at once.
    """
    r = jnp.clip(distance, NEAREST, basis.reach)
    argument = 2.0 * (1.0 / r - 1.0 / basis.reach) / (1.0 - 1.0 / basis.reach) - 1.0
    envelope = (1.0 - (r / basis.reach) ** basis.decay) ** 2
    values = [envelope, argument * envelope]
    for _ in range(2, basis.radial):
        values.append(2.0 * argument * values[-1] - values[-2])
    return jnp.stack(values[: basis.radial])


def angular_functions(basis: MomentBasis, direction: tuple[Array, Array, Array]) -> list[list[tuple[Array, Array]]]:
    """Y_lm = N_lm P_lm(cos t) exp(i m f) for m = 0 ... order and l = m ... degree, as real and imaginary parts.

    They are polynomials of the unit vector (x, y, z) with cos t = x, sin t exp(i f) = y + i z, so that they are smooth
    on the axis. N_lm is the norm of real spherical harmonics without their 1 / sqrt(4 pi): the mean square over the
    sphere of Y_l0, and of either part of Y_lm, is one.

    Returns:
        For each order those of all degrees; imaginary parts of order zero are zero.
    """
    x, y, z = direction
    found: list[list[tuple[Array, Array]]] = []
    real, imaginary, first = jnp.ones_like(x), jnp.zeros_like(x), 1.0
    for m in range(basis.order + 1):
        if m:
            real, imaginary, first = real * y - imaginary * z, real * z + imaginary * y, first * (2 * m - 1)
        legendre = [jnp.full_like(x, first)]
        if m < basis.degree:
            legendre.append((2 * m + 1) * x * legendre[0])
        for degree in range(m + 2, basis.degree + 1):
            term = (2 * degree - 1) * x * legendre[-1] - (degree + m - 1) * legendre[-2]
            legendre.append(term / (degree - m))
        of_order = []
        for degree, value in enumerate(legendre, m):
            share = math.factorial(degree - m) / math.factorial(degree + m)
            scaled = math.sqrt((2 * degree + 1) * share * (2 if m else 1)) * value
            of_order.append((scaled * real, scaled * imaginary))
        found.append(of_order)
    return found


Offset = tuple[Array, Array, Array]
"""Three arrays (N, K): neighbour less sphere, in diameters, the first component along the axis."""


def moments(basis: MomentBasis, offset: Offset, present: Array) -> tuple[Array, ...]:
    """A_nlm = sum_j R_n(r_ij) Y_lm(ij) of N spheres over K neighbours each.

    Args:
        basis: the functions.
        offset: see `Offset`.
        present: (N, K) bool, false for a slot without a neighbour.

    Returns:
        For each order m from zero on (N, P, C_m): real part for m = 0, real and imaginary part for others. C_m has
        n in blocks and l within them.
    """
    radial, harmonics = _of_pairs(basis, offset, present)
    parts: list[list[list[Array]]] = []
    for order in range(basis.order + 1):
        of_order = harmonics[order]
        parts.append([[real for real, _ in of_order]])
        if order:
            parts[-1].append([imaginary for _, imaginary in of_order])
    return _summed(radial, parts)


def with_wake(found: Sequence[Array], wake: Sequence[Array]) -> tuple[Array, ...]:
    """Moments of each order with those of a stretched basis, of the first orders, behind them."""
    both = [jnp.concatenate(pair, axis=2) for pair in zip(found, wake, strict=False)]
    return (*both, *found[len(both) :])


def carried_moments(basis: MomentBasis, offset: Offset, present: Array, vector: Offset) -> tuple[Array, Array]:
    """Moments of order zero and one of a vector that each neighbour carries, with its component s along the axis and
    w = v + i u across it: of order zero the sums over j of R_n Y_l0 s and of R_n Re(Y_l1* w), of order one those of
    R_n Y_l1 s, of R_n Y_l0 w and of R_n Y_l2 w*.

    Args:
        basis: the functions, of order two.
        offset, present: see `moments`.
        vector: s, v and u, (N, K) each.

    Returns:
        (N, 1, C) and (N, 2, C'); see `carried_counts`.
    """
    radial, harmonics = _of_pairs(basis, offset, present)
    s, v, u = vector
    scalar, real, imaginary = [], [], []
    for y, _ in harmonics[0]:
        scalar.append(y * s)
        real.append(y * v)
        imaginary.append(y * u)
    for x, y in harmonics[1]:
        scalar.append(x * v + y * u)
        real.append(x * s)
        imaginary.append(y * s)
    for x, y in harmonics[2]:
        real.append(x * v + y * u)
        imaginary.append(y * v - x * u)
    zero, one = _summed(radial, [[scalar], [real, imaginary]])
    return zero, one


def carried_counts(basis: MomentBasis) -> tuple[int, int]:
    """Numbers of `carried_moments` of order zero and one."""
    zero, one, two = (basis.count(order) for order in range(3))
    return zero + one, zero + one + two


Harmonics = list[list[tuple[Array, Array]]]


def _of_pairs(basis: MomentBasis, offset: Offset, present: Array) -> tuple[Array, Harmonics]:
    """R_n (n, N, K), zero where there is no neighbour in reach, and Y_lm (N, K) by order and degree."""
    x, y, z = (jnp.where(present, component, 1.0) for component in offset)
    if basis.stretch != 1.0:
        x = x / basis.stretch
    distance = jnp.sqrt(jnp.maximum(x * x + y * y + z * z, SMALLEST))
    inverse = 1.0 / distance
    counts = present & (distance < basis.reach)
    radial = jnp.where(counts[None], radial_functions(basis, distance), 0.0)
    return radial, angular_functions(basis, (x * inverse, y * inverse, z * inverse))


def _summed(radial: Array, orders: Sequence[Sequence[Sequence[Array]]]) -> tuple[Array, ...]:
    """Sums over the neighbours of products of the functions, (N, P, n l) of each order.

    All orders are one product of matrices for each sphere, with the neighbours last in both factors, where they are in
    the memory: four products of one order each, spheres in the middle, take twice the time.

    Args:
        radial: (n, N, K).
        orders: of each its parts, and of each of these the functions (N, K) of the direction.
    """
    functions = jnp.stack([one for parts in orders for part in parts for one in part], axis=1)
    radial = jnp.moveaxis(radial, 0, 1)
    if radial.shape[2] == 1:  # a product of two vectors, which C code can have
        sums = radial * functions.reshape(-1, 1, functions.shape[1])
    else:
        sums = jnp.einsum("nik,nfk->nif", radial, functions, precision=PRECISION)
    found, first = [], 0
    for parts in orders:
        of_parts = []
        for part in parts:
            of_parts.append(sums[:, :, first : first + len(part)].reshape(sums.shape[0], -1))
            first += len(part)
        found.append(jnp.stack(of_parts, axis=1))
    return tuple(found)

"""A plane that cuts a unit cell: the volume on one side of it, and the plane that leaves a given volume there.

The plane is m.x = offset with normals m >= 0 whose components add up to 1, so the offset runs from 0, where the cell is
empty, to 1, where it is full. With m1 <= m2 <= m3 and offsets up to 1/2, the rest by symmetry,

    V = a^3 / (6 m1 m2 m3)                                                              a < m1
    V = [a (a - m1) + m1^2/3] / (2 m2 m3) - [(a - m2)+^3 + (a - m3)+^3] / (6 m1 m2 m3)  m1 <= a < m1 + m2
    V = (2 a - m1 - m2) / (2 m3)                                                        m1 + m2 <= a.

In 2-D, with m1 <= m2, that is a^2 / (2 m1 m2) for a < m1 and (2 a - m1) / (2 m2) beyond. The terms are so written that
small components do no harm: (a - m2)+ is at most m1 in 3-D.

Source: R. Scardovelli, S. Zaleski, J. Comput. Phys. 164 (2000) 228-237.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
from jax import Array, lax

from jaxdem.fluid.grid import sum_of
from jaxdem.numerics.quotients import quotient

_ITERATIONS = 4
"""Newton's steps for the offset where the section is a polygon of more than four sides: the first is within a fifth of
m1, and each squares the error."""


_SMALL = 1e-30
"""Components of a normal up to this are zero; powers of it are still numbers in float32."""


def volume_below(normal: tuple[Array, ...], offset: Array) -> Array:
    """Volume of the part m.x < offset of the unit cell [-].

    Args:
        normal: D components m >= 0 that add up to 1.
        offset: of the plane; beyond 0 and 1 the cell is empty and full.
    """
    offset = jnp.clip(offset, 0.0, 1.0)
    upper = offset > 0.5  # not the smaller of two: the slope of that is lost where they are equal
    smaller = _smaller_area if len(normal) == 2 else _smaller_volume
    volume = smaller(_sorted(normal), jnp.where(upper, 1.0 - offset, offset))
    return jnp.where(upper, 1.0 - volume, volume)


def volume_of_slab(normal: Sequence[Array], offset: Array, axis: int, far: Array, thickness: Array) -> Array:
    """Part of a slab of the unit cell that lies below its plane [-].

    Args:
        normal: D components m >= 0 that add up to 1.
        offset: of the plane.
        axis: that the slab stands across.
        far: bool, whether it lies at the end of the cell that is full last, else at the other one.
        thickness: of the slab, above 0 [-].
    """
    sizes = list(normal)
    offset = offset - jnp.where(far, sizes[axis] * (1.0 - thickness), 0.0)
    sizes[axis] = sizes[axis] * thickness
    size = sum_of(sizes)
    return volume_below(tuple(m / size for m in sizes), offset / size)


def offset_of(normal: tuple[Array, ...], volume: Array) -> Array:
    """Offset of the plane that leaves a volume below it, the inverse of `volume_below`.

    Args:
        normal: D components m >= 0 that add up to 1.
        volume: between 0 and 1, both excluded [-].
    """
    smaller = _smaller_offset_in_2d if len(normal) == 2 else _smaller_offset
    offset = smaller(_sorted(normal), jnp.where(volume > 0.5, 1.0 - volume, volume))
    return jnp.where(volume > 0.5, 1.0 - offset, offset)


def is_cut(fraction: Array) -> Array:
    """Whether a surface cuts a cell, bool: one that lacks no more than rounding of being full or empty has none.

    Args:
        fraction: of the liquid [-].
    """
    rounding = 8.0 * float(jnp.finfo(fraction.dtype).eps)
    return (fraction > rounding) & (fraction < 1.0 - rounding)


def _sorted(normal: tuple[Array, ...]) -> tuple[Array, ...]:
    """The components in rising order."""
    low, high = jnp.minimum(normal[0], normal[1]), jnp.maximum(normal[0], normal[1])
    if len(normal) == 2:
        return low, high
    third = normal[2]
    return jnp.minimum(low, third), jnp.maximum(low, jnp.minimum(high, third)), jnp.maximum(high, third)


def _smaller_area(m: tuple[Array, ...], a: Array) -> Array:
    """The volume for an offset of at most 1/2, in 2-D; see the module."""
    m1, m2 = m
    beyond = a >= m1
    corner = quotient(a, jnp.where(beyond, 1.0, m1)) * a
    return jnp.where(beyond, 2.0 * a - m1, corner) / (2.0 * m2)


def _smaller_offset_in_2d(m: tuple[Array, ...], v: Array) -> Array:
    """The offset for a volume of at most 1/2, in 2-D."""
    m1, m2 = m
    beyond = v >= m1 / (2.0 * m2)
    return jnp.where(beyond, m2 * v + 0.5 * m1, jnp.sqrt(jnp.where(beyond, 1.0, 2.0 * m1 * m2 * v)))


def _smaller_offset(m: tuple[Array, ...], v: Array) -> Array:
    """The offset for a volume of at most 1/2, in 3-D."""
    m1, m2, m3 = m
    safe_m2 = jnp.where(m2 > _SMALL, m2, 1.0)
    corner = m1 * (m1 / safe_m2) / (6.0 * m3)
    in_corner = v < corner
    flat = (m1 + m2 <= m3) & (v >= (m1 + m2) / (2.0 * m3))
    root = jnp.where(in_corner, 6.0 * m1 * m2 * m3 * v, 1.0)
    offset = jnp.where(in_corner, jnp.cbrt(root), m3 * v + 0.5 * (m1 + m2))
    between = ~(in_corner | flat)
    square = jnp.where(between, m1**2 + 8.0 * m2 * m3 * (v - corner), 1.0)
    offset = jnp.where(between, 0.5 * (m1 + jnp.sqrt(square)), offset)
    return _refined(m, v, offset, between & (offset > m2) & (m1 > _SMALL))


def _smaller_volume(m: tuple[Array, ...], a: Array) -> Array:
    """The volume for an offset of at most 1/2, in 3-D; see the module."""
    m1, m2, m3 = m
    in_corner, flat = (a < m1) & (m1 > _SMALL), a >= m1 + m2
    between = ~(in_corner | flat)
    # Divided by where it is chosen alone, so that slopes of what is not stay finite.
    s1, s2 = jnp.where(in_corner, m1, 1.0), jnp.where(in_corner, m2, 1.0)
    corner = quotient(a, s1) * quotient(a, s2) * a / (6.0 * m3)
    s1, s2 = jnp.where(between & (m1 > _SMALL), m1, 1.0), jnp.where(between & (m2 > _SMALL), m2, 1.0)
    t2, t3 = jnp.maximum(a - m2, 0.0), jnp.maximum(a - m3, 0.0)
    beyond = quotient(t2, s1) * quotient(t2, s2) * t2 + quotient(t3, s1) * quotient(t3, s2) * t3
    section = (quotient(a, s2) * (a - m1) + quotient(m1, s2) * m1 / 3.0) / (2.0 * m3) - beyond / (6.0 * m3)
    return jnp.where(in_corner, corner, jnp.where(flat, (2.0 * a - m1 - m2) / (2.0 * m3), section))


def _refined(m: tuple[Array, ...], v: Array, first: Array, where: Array) -> Array:
    """The root of the cubic by Newton's method from below; the volume is convex up to 1/2, so it converges.

    Its slope is that of the last step, which is the exact one at the root.
    """
    m1, m2, m3 = (jnp.where(where, x, 1.0 / 3.0) for x in m)
    v = jnp.where(where, v, 0.3)

    def step(a: Array) -> Array:
        t2, t3 = jnp.maximum(a - m2, 0.0), jnp.maximum(a - m3, 0.0)
        slope = (2.0 * a - m1) / (2.0 * m2 * m3) - ((t2 / m1) * t2 + (t3 / m1) * t3) / (2.0 * m2 * m3)
        return a - (_smaller_volume((m1, m2, m3), a) - v) / lax.stop_gradient(slope)

    start = jnp.where(where, first, 0.45)
    for _ in range(_ITERATIONS):
        start = jnp.minimum(step(start), 0.5)
    return jnp.where(where, step(lax.stop_gradient(start)), first)

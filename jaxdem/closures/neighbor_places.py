"""The fluctuation that a closure of neighbours gives for spheres whose neighbours are listed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.closures.moments import Offset, carried_moments, moments
from jaxdem.closures.neighbors import NeighborClosure, Response, conditions, presence
from jaxdem.numerics.products import PRECISION
from jaxdem.numerics.vectors import components, row_lengths

Frame = tuple[Array, Array, Array]
"""Three unit vectors (N, 3) at right angles, right-handed, the first along the slip."""
Tree = Any
"""A pytree of arrays; JAX has no type for it."""


class Places(NamedTuple):
    """Where spheres are, and who is near whom.

    Attributes:
        centres: (N, 3) [m].
        others: (N, K) int32, neighbours of each sphere; itself in an empty slot.
        diameter: () or (N,) [m].
        period: (3,) lengths of the box, 0 for a side that is not periodic [m].
    """

    centres: Array
    others: Array
    diameter: Array
    period: Array

    def offset(self, rows: tuple[Array, ...]) -> tuple[Offset, Array]:
        """Neighbours of some spheres in their frames, in diameters, and which slots hold one."""
        others, own, position, size, axes = rows
        apart = self.centres[others] - position[:, None]
        wraps = self.period > 0
        period, share = jnp.where(wraps, self.period, 0.0), 1.0 / jnp.where(wraps, self.period, 1.0)
        apart = apart - period[None, None] * jnp.round(apart * share[None, None])
        return _in_frame(apart / size[:, None, None], axes), others != own[:, None]

    def summed(
        self, frame: Frame, at_once: int | None, function: Callable[[Offset, Array, tuple[Array, ...]], Tree]
    ) -> Tree:
        """A function of offset and presence of the neighbours and of rows, `at_once` spheres after the others."""
        count = self.centres.shape[0]
        own = jnp.arange(count, dtype=self.others.dtype)
        size = jnp.broadcast_to(self.diameter, (count,))
        whole = (self.others, own, self.centres, size, jnp.stack(frame, axis=1))

        @jax.checkpoint  # the functions of every pair would fill the memory of a reverse pass
        def of_some(rows: tuple[Array, ...]) -> Tree:
            return function(*self.offset(rows), rows)

        if at_once is None:
            return of_some(whole)
        parts = -(-count // at_once)
        length = -(-count // parts)

        def in_parts(array: Array) -> Array:
            padding = [(0, parts * length - count)] + [(0, 0)] * (array.ndim - 1)
            return jnp.pad(array, padding).reshape(parts, length, *array.shape[1:])

        done = lax.map(of_some, tuple(map(in_parts, whole)))
        return jax.tree.map(lambda array: array.reshape(parts * length, *array.shape[2:])[:count], done)


def fluctuation(
    closure: NeighborClosure,
    places: Places,
    frame: Frame,
    reynolds: Array,
    solid_fraction: Array,
    at_once: int | None = None,
) -> Response:
    """What the neighbours add to the mean force.

    Args:
        closure: gives it.
        places: of the spheres.
        frame: of each sphere, see `axes_along`.
        reynolds: (N,) of the superficial slip [-].
        solid_fraction: (N,) of the surroundings at large [-].
        at_once: so many spheres are treated at once; all if None.
    """

    def first(offset: Offset, present: Array, rows: tuple[Array, ...]) -> tuple[Any, Array]:
        sums = moments(closure.basis, offset, present)
        return [level.mixed(sums) for level in closure.levels], sums[0][:, 0, 0]

    known = conditions(reynolds, solid_fraction)
    mixed, crowd = places.summed(frame, at_once, first)
    values = closure.levels[0].values(mixed[0], known)
    if closure.carried is not None:
        carried, level = closure.carried, closure.levels[1]
        force = presence(crowd)[:, None] * values[:, :3]
        vector = force[:, :1] * frame[0] + force[:, 1:2] * frame[1] + force[:, 2:] * frame[2]

        def second(offset: Offset, present: Array, rows: tuple[Array, ...]) -> tuple[Array, ...]:
            given = _in_frame(vector[rows[0]], rows[-1])
            return level.mixed(carried_moments(carried, offset, present, given), further=True)

        further = places.summed(frame, at_once, second)
        both = [one + other for one, other in zip(mixed[1], further, strict=False)]
        values = level.values([*both, *mixed[1][2:]], known)
    return closure.response(values, crowd, reynolds, solid_fraction)


def _in_frame(vectors: Array, axes: Array) -> Offset:
    """Components of vectors (N, K, 3) along the axes (N, 3, 3) of each particle."""
    found = jnp.einsum("nkd,nad->ank", vectors, axes, precision=PRECISION)
    return found[0], found[1], found[2]


def axes_along(vector: Array) -> Frame:
    """Three unit vectors (N, 3) at right angles, right-handed, the first along the vector (N, 3).

    Of a zero vector they are some axes; the slopes are finite there too.

    Source: T. Duff et al., J. Comput. Graph. Tech. 6(1) (2017) 1-8.
    """
    size = row_lengths(vector)
    upright = jnp.zeros_like(vector).at[:, 0].set(1.0)
    first = jnp.where((size > 0)[:, None], vector / jnp.where(size > 0, size, 1.0)[:, None], upright)
    x, y, z = components(first)
    sign = jnp.where(z < 0, -1.0, 1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    second = jnp.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1)
    third = jnp.stack([b, sign + y * y * a, -y], axis=1)
    return first, second, third

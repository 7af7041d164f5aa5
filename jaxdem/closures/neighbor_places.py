"""The fluctuation that a closure of neighbours gives for spheres whose neighbours are listed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.closures.moments import Offset, carried_moments
from jaxdem.closures.neighbor_range import conditions, presence
from jaxdem.closures.neighbors import NeighborClosure, Response
from jaxdem.numerics.vectors import components, row_lengths

Frame = tuple[Array, Array, Array]
"""Three unit vectors (N, 3) at right angles, right-handed, the first along the slip."""
Tree = Any
"""A pytree of arrays; JAX has no type for it."""
SLOTS_AT_ONCE = 48
"""Slots of neighbours that are treated at once: fewer pass through memory, and empty ones can be left out."""


class Places(NamedTuple):
    """Where spheres are, and who is near whom.

    Attributes:
        centres: (N, 3) [m]; further rows are of spheres that are only neighbours of the N.
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
        share = jnp.where(self.period > 0, 1.0 / jnp.where(self.period > 0, self.period, 1.0), 0.0)
        apart = []
        for axis in range(3):
            along = self.centres[:, axis][others] - position[:, axis, None]
            apart.append((along - self.period[axis] * jnp.round(along * share[axis])) / size[:, None])
        return _in_frame(apart, axes), others != own[:, None]

    def summed(
        self, frame: Frame, at_once: int | None, function: Callable[[Offset, Array, tuple[Array, ...]], Tree]
    ) -> Tree:
        """Sums over the neighbours: a function of their offset and presence and of rows, `at_once` spheres after the
        others and `SLOTS_AT_ONCE` of their slots. Slots that are empty for all of these spheres cost nothing.

        The rows are the neighbours of some spheres (N, K), their numbers, centres, diameters and axes.
        """
        count = self.others.shape[0]
        own = jnp.arange(count, dtype=self.others.dtype)
        size = jnp.broadcast_to(self.diameter, (count,))
        whole = (self.others, own, self.centres[:count], size, jnp.stack(frame, axis=1))

        @jax.checkpoint  # the functions of every pair would fill the memory of a reverse pass
        def of_slots(rows: tuple[Array, ...]) -> Tree:
            return function(*self.offset(rows), rows)

        if at_once is None:
            return of_slots(whole)
        parts = -(-count // at_once)
        length = -(-count // parts)

        def in_parts(array: Array) -> Array:
            padding = [(0, parts * length - count)] + [(0, 0)] * (array.ndim - 1)
            return jnp.pad(array, padding).reshape(parts, length, *array.shape[1:])

        done = lax.map(lambda rows: _over_slots(of_slots, rows), tuple(map(in_parts, whole)))
        return jax.tree.map(lambda array: array.reshape(parts * length, *array.shape[2:])[:count], done)


def _over_slots(function: Callable[[tuple[Array, ...]], Tree], rows: tuple[Array, ...]) -> Tree:
    """The sum of a function over blocks of slots; a block without a neighbour is left out."""
    others, own, *rest = rows
    slots = others.shape[1]
    blocks = -(-slots // SLOTS_AT_ONCE)
    if blocks <= 1:
        return function(rows)
    empty = jnp.broadcast_to(own[:, None], (len(own), blocks * SLOTS_AT_ONCE - slots))
    cut = jnp.concatenate([others, empty], axis=1).reshape(len(own), blocks, SLOTS_AT_ONCE)

    def of_block(block: Array) -> Tree:
        return function((block, own, *rest))

    def add(total: Tree, block: Array) -> tuple[Tree, None]:
        some = jnp.any(block != own[:, None])
        return lax.cond(some, lambda: jax.tree.map(jnp.add, total, of_block(block)), lambda: total), None

    shapes = jax.eval_shape(of_block, cut[:, 0])
    none = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    return lax.scan(add, none, jnp.moveaxis(cut, 1, 0))[0]


def fluctuation(
    closure: NeighborClosure,
    places: Places,
    frame: Frame,
    reynolds: Array,
    solid_fraction: Array,
    at_once: int | None = None,
    spread: Callable[[Array], Array] | None = None,
) -> Response:
    """What the neighbours add to the mean force.

    Args:
        closure: gives it.
        places: of the spheres.
        frame: of each sphere, see `axes_along`.
        reynolds: (N,) of the superficial slip [-].
        solid_fraction: (N,) of the surroundings at large [-].
        at_once: so many spheres are treated at once; all if None.
        spread: from values (N, 3) of the spheres to those of all rows of `places.centres`; None where these are N.
    """

    known = conditions(reynolds, solid_fraction)
    sums = places.summed(frame, at_once, lambda offset, present, _: closure.moments(offset, present))
    crowd = sums[0][:, 0, 0]
    values = closure.levels[0].values(closure.levels[0].mixed(sums), known)
    if closure.carried is not None:
        carried, level = closure.carried, closure.levels[1]
        force = presence(crowd)[:, None] * values[:, :3]
        vector = force[:, :1] * frame[0] + force[:, 1:2] * frame[1] + force[:, 2:] * frame[2]
        vector = vector if spread is None else spread(vector)

        def second(offset: Offset, present: Array, rows: tuple[Array, ...]) -> tuple[Array, ...]:
            given = _in_frame([vector[:, axis][rows[0]] for axis in range(3)], rows[-1])
            return carried_moments(carried, offset, present, given)

        further = level.mixed(places.summed(frame, at_once, second), further=True)
        mixed = level.mixed(sums)
        both = [one + other for one, other in zip(mixed, further, strict=False)]
        values = level.values([*both, *mixed[2:]], known)
    return closure.response(values, crowd, reynolds, solid_fraction)


def _in_frame(vectors: Sequence[Array], axes: Array) -> Offset:
    """Components of vectors, three arrays (N, K), along the axes (N, 3, 3) of each particle.

    Written out: a product of matrices of three rows for each particle takes longer.
    """
    x, y, z = vectors
    first, second, third = (
        axes[:, row, 0, None] * x + axes[:, row, 1, None] * y + axes[:, row, 2, None] * z for row in range(3)
    )
    return first, second, third


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

"""Moments of the neighbours in the arrays of `spheres`, array by array."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxdem.closures.moments import MomentBasis, Offset, carried_moments, moments, with_wake
from jaxdem.closures.neighbor_range import CONDITIONS, conditions, presence
from jaxdem.closures.neighbors import NeighborClosure, Response
from jaxdem.train.spheres import Floats, SphereGroup

AT_ONCE = 8192
"""Spheres whose channels are evaluated at once."""


class Targets(NamedTuple):
    """What a closure is to give, over the mean force of the group (and d for torques).

    Attributes:
        along: (S,) force along the stream less its mean [-].
        across: (S, 2) [-].
        torque: (S, 3) [-].
    """

    along: Floats
    across: Floats
    torque: Floats


def targets_of(group: SphereGroup) -> Targets:
    """Fluctuations of a group over its mean force along the stream."""
    mean = group.force[:, 0].mean(dtype=np.float64)
    relative = (group.force / mean).astype(np.float32)
    return Targets(relative[:, 0] - 1.0, relative[:, 1:], (group.torque / mean).astype(np.float32))


def group_moments(basis: MomentBasis, group: SphereGroup, wake: MomentBasis | None = None) -> tuple[Floats, ...]:
    """The moments that the first level of a closure with these bases mixes, of all spheres of a group about the stream,
    among the spheres of their array and its images."""
    return _by_array(group, group.position[:, :0], lambda place, box, _: _array_moments(basis, wake, place, box))


def with_carried(closure: NeighborClosure, group: SphereGroup, values: tuple[Floats, ...]) -> tuple[Floats, ...]:
    """The moments of the second level: those of the first, `values`, and those of the forces that it gives."""
    if closure.carried is None:
        return values
    known, crowd = _known(group, len(values[0])), values[0][:, 0, 0]
    force = np.asarray(_in_parts(lambda rows, flow: _level_values(closure, 0, rows, flow), values, known))[:, :3]
    force = np.asarray(_presence(crowd))[:, None] * force
    carried = closure.carried
    further = _by_array(group, force, lambda place, box, vector: _array_carried(carried, place, box, vector))
    both = [np.concatenate(pair, axis=2) for pair in zip(values, further, strict=False)]
    return (*both, *values[2:])


def _by_array(group: SphereGroup, carried: Floats, function: Callable[..., tuple[Array, ...]]) -> tuple[Floats, ...]:
    """A function of the spheres of each array, of its box and of what they carry (S, A); for all spheres."""
    most = int(np.diff(group.start).max())
    parts = []
    for array in range(group.arrays):
        rows = slice(group.start[array], group.start[array + 1])
        count = rows.stop - rows.start
        # Arrays of other numbers share the program.
        place, vector = np.full((most, 3), np.nan, np.float32), np.zeros((most, carried.shape[1]), np.float32)
        place[:count], vector[:count] = group.position[rows], carried[rows]
        found = function(place, group.box[array], vector)
        parts.append([np.asarray(part)[:count] for part in found])
    return tuple(np.concatenate(order) for order in zip(*parts, strict=True))


@partial(jax.jit, static_argnums=(0, 1))
def _array_moments(basis: MomentBasis, wake: MomentBasis | None, position: Array, box: Array) -> tuple[Array, ...]:
    found = moments(basis, *_apart(position, box))
    return found if wake is None else with_wake(found, moments(wake, *_with_images(*_apart(position, box), box)))


def _with_images(offset: Offset, present: Array, box: Array) -> tuple[Offset, Array]:
    """The neighbours, and their images one box up and one down the stream, as a wake is longer than half of the box."""
    x, y, z = (jnp.concatenate([one] * 3, axis=1) for one in offset)
    shift = jnp.repeat(jnp.asarray([0.0, -1.0, 1.0], x.dtype), present.shape[1]) * box[0]
    return (x + shift[None], y, z), jnp.concatenate([present] * 3, axis=1)


@partial(jax.jit, static_argnums=0)
def _array_carried(basis: MomentBasis, position: Array, box: Array, vector: Array) -> tuple[Array, ...]:
    count = len(position)
    s, v, u = (jnp.broadcast_to(component[None], (count, count)) for component in vector.T)
    return carried_moments(basis, *_apart(position, box), (s, v, u))


def _apart(position: Array, box: Array) -> tuple[Offset, Array]:
    """From every sphere of an array to the nearest image of every other, and which there are."""
    apart = position[None] - position[:, None]
    apart = apart - box[None, None] * jnp.round(apart / box[None, None])
    present = jnp.isfinite(apart[..., 0]) & ~jnp.eye(len(position), dtype=bool)
    return (apart[..., 0], apart[..., 1], apart[..., 2]), present


def predicted(closure: NeighborClosure, group: SphereGroup, values: tuple[Floats, ...]) -> Targets:
    """What a closure gives for the spheres of a group with these moments, see `with_carried`."""
    crowd, last = values[0][:, 0, 0], len(closure.levels) - 1
    known = _known(group, len(crowd))
    found = _in_parts(lambda rows, flow: _level_values(closure, last, rows, flow), values, known)
    flows = (np.full(len(crowd), value, np.float32) for value in (group.reynolds, group.solid_fraction))
    response = _response(closure, found, crowd, *flows)
    return Targets(*(np.asarray(part) for part in response[:3]))


# As wholes: outside of `jit` every operation would be compiled by itself.
_presence, _conditions = jax.jit(presence), jax.jit(conditions)


@jax.jit
def _response(
    closure: NeighborClosure, values: Array, crowd: Array, reynolds: Array, solid_fraction: Array
) -> Response:
    return closure.response(values, crowd, reynolds, solid_fraction)


@partial(jax.jit, static_argnums=1)
def _level_values(closure: NeighborClosure, number: int, values: tuple[Array, ...], known: Array) -> Array:
    level = closure.levels[number]
    return level.values(level.mixed(values), known)


def _known(group: SphereGroup, count: int) -> Floats:
    """(count, 3) `conditions` of a group."""
    flows = (np.array([value], np.float32) for value in (group.reynolds, group.solid_fraction))
    return np.broadcast_to(np.asarray(_conditions(*flows)), (count, CONDITIONS))


def _in_parts(function: Callable[..., Array], values: tuple[Floats, ...], known: Floats) -> Floats:
    """A function of moments and conditions, `AT_ONCE` spheres after the others."""
    starts = range(0, len(known), AT_ONCE)
    parts = [
        (tuple(one[first : first + AT_ONCE] for one in values), known[first : first + AT_ONCE]) for first in starts
    ]
    return np.concatenate([np.asarray(function(*part)) for part in parts])


def linear_fit(train: tuple[Floats, ...], targets: Targets, test: tuple[Floats, ...]) -> Targets:
    """Least squares of pairwise terms: every force and torque is a sum over the neighbours of a function of distance
    and angle to the stream, here of those of the moments. By symmetry there is none for the torque about the stream.

    Args:
        train: moments to fit to.
        targets: of these.
        test: moments at which the fit is evaluated.
    """
    along = _with_one(test[0][:, 0]) @ _solved(_with_one(train[0][:, 0]), targets.along)
    across = np.zeros((len(along), 2))
    torque = np.zeros((len(along), 3))
    stacked = train[1].transpose(1, 0, 2).reshape(-1, train[1].shape[2])
    across[:] = test[1] @ _solved(stacked, targets.across.T.ravel())
    turned = np.concatenate([targets.torque[:, 2], -targets.torque[:, 1]])
    turned_fit = test[1] @ _solved(stacked, turned)
    torque[:, 1], torque[:, 2] = -turned_fit[:, 1], turned_fit[:, 0]
    return Targets(along, across, torque)


def _with_one(matrix: Floats) -> Floats:
    return np.concatenate([matrix, np.ones((len(matrix), 1), matrix.dtype)], axis=1)


def _solved(matrix: Floats, wanted: Floats) -> NDArray[np.float64]:
    """Least squares by the normal equations, damped by a part in 1e8."""
    values = matrix.astype(np.float64)
    normal = values.T @ values
    damping = 1e-8 * np.trace(normal) / len(normal)
    return np.linalg.solve(normal + damping * np.eye(len(normal)), values.T @ wanted)

"""Where a rigid body is at a moment, and how it moves.

Also on the host, with arrays of NumPy in float64.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jax import Array

from jaxdem.numerics import pair_arithmetic as pairs
from jaxdem.numerics import vectors
from jaxdem.numerics.compensated import Low, Pair
from jaxdem.numerics.host import namespace
from jaxdem.numerics.vectors import Vector


class Placement(NamedTuple):
    """Rigid placement x = R X + s of the points X of a body, and the velocity v(x) = V + W cross (x - c) of the body's
    points x; in D dimensions, with A = 1 angular component in 2-D and 3 in 3-D.

    X are the coordinates in which the body's shape is given: those of the box if it never moves. In float32 the
    rotation and the shift are pairs of floats, so that a turn or a path adds no noise to overlaps.

    Attributes:
        rotation: (D, D) R, leading part; None for a body that never turns [-].
        rotation_low: (D, D) its trailing part; None in float64, and without a rotation [-].
        shift: (D,) s, leading part [m].
        shift_low: (D,) its trailing part; None in float64 [m].
        velocity: (D,) V, of the point c [m/s].
        angular_velocity: (A,) W; None for a body that never turns [rad/s].
        centre: (D,) c [m].
    """

    rotation: Array | None
    rotation_low: Low
    shift: Array
    shift_low: Low
    velocity: Array
    angular_velocity: Array | None
    centre: Array

    @property
    def dimension(self) -> int:
        """D."""
        return int(self.shift.shape[0])

    def to_body(self, position: Vector, low: tuple[Low, ...]) -> tuple[Vector, tuple[Low, ...]]:
        """X = R^T (x - s), positions in the body's frame, leading and trailing parts.

        Args:
            position: D arrays of any shape, leading part [m].
            low: D arrays, trailing part; or Nones, and then there is one afterwards all the same in float32 [m].
        """
        given = [
            pairs.as_pair(high) if trailing is None else (high, trailing)
            for high, trailing in zip(position, low, strict=True)
        ]
        apart = [pairs.total(part, pairs.negative(pairs.entry(self._shift, k))) for k, part in enumerate(given)]
        if self.rotation is not None:
            turn = (self.rotation, self.rotation_low)
            columns = range(self.dimension)
            apart = [
                _sum([pairs.product(part, pairs.entry(turn, (j, k))) for j, part in enumerate(apart)]) for k in columns
            ]
        return tuple(high for high, _ in apart), tuple(trailing for _, trailing in apart)

    def to_box(self, direction: Vector) -> Vector:
        """R d, a direction of the body's frame in the frame of the box; D arrays of any shape."""
        if self.rotation is None:
            return direction
        rows = range(self.dimension)
        return tuple(vectors.dot(tuple(self.rotation[j, k] for k in rows), direction) for j in rows)

    def position_of(self, point: Array) -> Pair:
        """x = R X + s of one point (D,), as a pair [m]."""
        return pairs.total(self._turned(pairs.as_pair(point)), self._shift)

    def velocity_at(self, position: Vector) -> Vector:
        """v = V + W cross (x - c) [m/s].

        Args:
            position: D arrays of any shape [m].
        """
        velocity = tuple(self.velocity[k] for k in range(self.dimension))
        if self.angular_velocity is None:
            return velocity
        turning = tuple(self.angular_velocity[k] for k in range(self.angular_velocity.shape[0]))
        arm = tuple(x - self.centre[k] for k, x in enumerate(position))
        return vectors.add(velocity, vectors.rotate(turning, arm))

    def after(self, first: Placement) -> Placement:
        """The placement of a body that `first` places, and this one then moves as a whole."""
        shift = pairs.total(self._turned(first._shift), self._shift)
        rotation = self._rotation
        if first.rotation is not None:
            inner = (first.rotation, first.rotation_low)
            rotation = inner if rotation is None else _matrix_product(rotation, inner)
        centre = pairs.value(self.position_of(first.centre))
        own = self.velocity_at(tuple(centre[k] for k in range(self.dimension)))
        velocity = vectors.add(self.to_box(tuple(first.velocity)), own)
        turning = self.angular_velocity
        if first.angular_velocity is not None:
            turned = first.angular_velocity
            if self.dimension == 3:
                turned = _stack(self.to_box(tuple(turned)))
            turning = turned if turning is None else turned + turning
        high, low = (None, None) if rotation is None else rotation
        return Placement(high, low, *shift, _stack(velocity), turning, centre)

    def moved(self, displacement: Pair, direction: tuple[float, ...], speed: Array) -> Placement:
        """The same, further along a fixed direction.

        Args:
            displacement: () pair, how far [m].
            direction: D numbers, a unit vector.
            speed: () its rate [m/s].
        """
        unit = pairs.pair_of(direction, self.shift.dtype)
        way = pairs.product(unit, displacement)
        along = np.asarray(direction).astype(self.shift.dtype)
        high, low = pairs.total(self._shift, way)
        return self._replace(
            shift=high,
            shift_low=low,
            velocity=self.velocity + along * speed,
            centre=self.centre + pairs.value(way),
        )

    @property
    def _shift(self) -> Pair:
        return self.shift, self.shift_low

    @property
    def _rotation(self) -> Pair | None:
        return None if self.rotation is None else (self.rotation, self.rotation_low)

    def _turned(self, point: Pair) -> Pair:
        """R p of one point (D,)."""
        if self._rotation is None:
            return point
        columns = range(self.dimension)
        rotation = [pairs.entry(self._rotation, np.s_[:, k]) for k in columns]
        return _sum([pairs.product(column, pairs.entry(point, k)) for k, column in enumerate(rotation)])


def at_rest(dimension: int, like: Array) -> Placement:
    """A body that does not move, with arrays of the type of `like`."""
    xp = namespace(like)
    zero = xp.zeros(dimension, like.dtype)
    low = pairs.as_pair(zero)[1]
    return Placement(None, None, zero, low, zero, None, zero)


def _sum(terms: list[Pair]) -> Pair:
    found = terms[0]
    for term in terms[1:]:
        found = pairs.total(found, term)
    return found


def _matrix_product(a: Pair, b: Pair) -> Pair:
    """(D, D) of two such."""
    size = range(a[0].shape[0])
    return _sum(
        [
            pairs.product(
                pairs.entry(a, np.s_[:, k : k + 1]),
                pairs.entry(b, np.s_[k : k + 1, :]),
            )
            for k in size
        ]
    )


def _stack(vector: Vector) -> Array:
    return namespace(vector[0]).stack(vector)

"""How much of edges, faces and cells of a mesh lies where a distance is positive, from its values at the corners.

A box is cut into simplices: the paths along its edges from one end of a diagonal to the other. In each the distance is
interpolated linearly, and the part where that is positive is found in closed form. The mean over all diagonals is
taken, so that no direction is preferred. A face of a cell is cut by the same paths as the cell itself. So the areas of
a cell's open faces and of the cut through it close, and where the distance is linear all parts are exact.

Arrays of NumPy or JAX; differentiable where a cut moves within simplices.

Source of the simplices: H. W. Kuhn, IBM J. Res. Dev. 4 (1960) 518-524.
"""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np
from jax import Array

from jaxdem.numerics.host import namespace
from jaxdem.numerics.stages import stage


class PositivePart(NamedTuple):
    """Of every box, the part where the distance is positive.

    Attributes:
        fraction: its share of the box [-].
        integral: of the distance over it, over the size of the box [m].
    """

    fraction: Array
    integral: Array


def positive_part(corners: Array, axes: tuple[int, ...]) -> PositivePart:
    """The positive part of the boxes that a mesh of corners spans.

    Args:
        corners: distance at every corner of the mesh, (n + 1, m + 1, ...) [m].
        axes: along which a box extends: all for cells, all but one for faces. Along others it stands at the corners.
    """
    xp = namespace(corners)
    values = {}
    for offset in itertools.product((0, 1), repeat=len(axes)):
        part = corners
        for axis, upper in zip(axes, offset, strict=True):
            place = (slice(None),) * axis + (slice(1, None) if upper else slice(None, -1),)
            part = part[place]
        values[offset] = part
    if xp is np:
        return _on_cut_boxes(values)
    return stage(xp.any(corners > 0.0), lambda: _mean_over_simplices(values))


def _on_cut_boxes(values: dict[tuple[int, ...], Array]) -> PositivePart:
    """On the host only boxes with both signs are cut."""
    stacked = np.stack(list(values.values()))
    whole = np.all(stacked > 0.0, axis=0)
    mixed = np.any(stacked > 0.0, axis=0) & ~whole
    fraction, integral = whole.astype(stacked.dtype), np.where(whole, np.mean(stacked, axis=0), 0.0)
    if mixed.any():
        part = _mean_over_simplices({offset: value[mixed] for offset, value in values.items()})
        fraction[mixed], integral[mixed] = part
    return PositivePart(fraction, integral)  # type: ignore[arg-type]


def _mean_over_simplices(values: dict[tuple[int, ...], Array]) -> PositivePart:
    """Mean over the simplices along all diagonals."""
    dimension, parts = len(next(iter(values))), []
    for start in itertools.product((0, 1), repeat=dimension - 1):
        for order in itertools.permutations(range(dimension)):
            corner = [0, *start]
            path = [values[tuple(corner)]]
            for axis in order:
                corner[axis] = 1 - corner[axis]
                path.append(values[tuple(corner)])
            parts.append(of_simplex(path))
    share = 1.0 / len(parts)
    fraction, integral = parts[0]
    for part in parts[1:]:
        fraction, integral = fraction + part.fraction, integral + part.integral
    return PositivePart(share * fraction, share * integral)


def of_simplex(values: list[Array]) -> PositivePart:
    """The positive part of simplices with these values at their corners, 2 to 4 of them, all of one shape.

    With one positive corner a it is a smaller simplex, of the share of prod a / (a - x) over the others x; with one
    corner that is not, the whole less such a simplex. A tetrahedron with two of each gives a prism, cut into three.
    """
    xp = namespace(values[0])
    size, ordered = len(values), _falling(values)
    positive: Any = sum((v > 0.0).astype(v.dtype) for v in ordered)
    mean = sum(ordered) / size
    fraction = xp.where(positive == size, xp.ones_like(mean), xp.zeros_like(mean))
    integral = xp.where(positive == size, mean, xp.zeros_like(mean))
    one = positive == 1
    tip = _tip(ordered[0], ordered[1:], one)
    fraction = xp.where(one, tip, fraction)
    integral = xp.where(one, tip * ordered[0] / size, integral)
    if size > 2:
        but_one = positive == size - 1
        tip = _tip(ordered[-1], ordered[:-1], but_one)
        fraction = xp.where(but_one, 1.0 - tip, fraction)
        integral = xp.where(but_one, mean - tip * ordered[-1] / size, integral)
    if size == 4:
        two = positive == 2
        a, b, c, d = (xp.where(two, v, safe) for v, safe in zip(ordered, (2.0, 1.0, -1.0, -2.0), strict=True))
        ac, ad, bc, bd = a / (a - c), a / (a - d), b / (b - c), b / (b - d)
        with_both, rest = ac * ad, ac * (1.0 - ad) * bd + (1.0 - ac) * bc * bd
        fraction = xp.where(two, with_both + rest, fraction)
        integral = xp.where(two, 0.25 * ((a + b) * with_both + b * rest), integral)
    return PositivePart(fraction, integral)


def _falling(values: list[Array]) -> list[Array]:
    """The same values, the largest first: a few exchanges, which compile and run faster than a general sort."""
    xp, found = namespace(values[0]), list(values)
    for last in range(len(found) - 1, 0, -1):
        for k in range(last):
            a, b = found[k], found[k + 1]
            found[k], found[k + 1] = xp.maximum(a, b), xp.minimum(a, b)
    return found


def _tip(value: Array, others: list[Array], there: Array) -> Array:
    """prod value / (value - other), and anything finite where it is not asked for."""
    xp = namespace(value)
    share = xp.ones_like(value)
    for other in others:
        apart = xp.where(there, value - other, 1.0)
        share = share * xp.where(there, value, 1.0) / apart
    return share

"""Transport of a sharp surface between two fluids: volume of fluid with planes in the cells.

    d(g c)/dt + div(c F) = 0

c is the liquid's part of the volume that is open to the fluids, g the void fraction, and F the flux of both fluids,
which satisfies d(g)/dt + div F = 0. In every cell that the surface cuts it is a plane; what lies within reach of a face
passes it. One axis follows the other. A flow along one axis alone is not free of divergence, so each of these sweeps
adds k dF/dx, with k = 1 in cells that were more than half full when the step began, else 0: over all axes that is
-k d(g)/dt, which the last sweep takes out again. So the liquid's volume changes by what passes the sides of the box
alone, to rounding, and in no cell is there less than none or more than the cell is open for, without clipping, up to
`SURFACE_COURANT`. What the flux fails continuity by, in units of the void fraction, is the error of that bound.

Source: G. D. Weymouth, D. K.-P. Yue, J. Comput. Phys. 229 (2010) 2853-2865 (sweeps); E. Aulisa, S. Manservisi, R.
Scardovelli, S. Zaleski, J. Comput. Phys. 225 (2007) 2301-2319, section 2.3 (normals). With a void fraction: derived
here; the sweeps are those of the paper with volumes over that of the fluids in a cell.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, along, box_largest, own_layers, sum_of
from jaxdem.fluid.mesh import Ends, beyond, with_ends
from jaxdem.fluid.plane_cut import is_cut, offset_of, volume_of_slab
from jaxdem.fluid.sweeps import ORDERS, in_order
from jaxdem.numerics.batches import in_any
from jaxdem.numerics.blocks import any_of
from jaxdem.numerics.quotients import quotient

SURFACE_COURANT = 0.5
"""Part of the fluids' volume of a cell that may come in through its faces in a step, and that may leave it: up to it
the fraction is bounded. See `surface_courant`."""

Inflow = tuple[Array | float | None, ...]
"""Of every side, lower before upper: liquid's part of what comes in there, a number or an array of the layer of faces;
None where it is that of the cell at the side [-]."""


class FractionStep(NamedTuple):
    """Result of a step.

    Attributes:
        fraction: c on the cells at its end [-].
        liquid_flux: mean flux of the liquid on the faces, the one that has changed the fraction [m/s].
    """

    fraction: Array
    liquid_flux: FaceField


class Plane(NamedTuple):
    """The surface in every cell, in units of its sides.

    Attributes:
        normal: D components that point from the liquid; their sizes add up to 1.
        offset: of the plane from the corner that is deepest in the liquid, see `plane_cut`.
        cut: bool, whether there is a surface.
    """

    normal: tuple[Array, ...]
    offset: Array
    cut: Array


class Carrier(NamedTuple):
    """The fluids that carry the surface, over a step.

    Attributes:
        flux: F = g u of both on the faces, which satisfies d(g)/dt + div F = 0 over the step [m/s].
        before, after: void fraction on the cells at its start and at its end; 1.0 without particles [-].
        inflow: liquid's part of what comes in through the sides; None: that of the cells there.
        around: gives what normals are taken of for a fraction, where walls cut the cells; None for the fraction itself.
    """

    flux: FaceField
    before: CellOrOne = 1.0
    after: CellOrOne = 1.0
    inflow: Inflow | None = None
    around: Callable[[Array], Array] | None = None


def advance_fraction(grid: Grid, fraction: Array, carrier: Carrier, step: Array, order: Array | int) -> FractionStep:
    """The liquid's fraction after a step.

    Args:
        grid: the grid.
        fraction: c on the cells [-].
        carrier: what carries it.
        step: () [s].
        order: number of the step, which chooses the order of the axes; an int compiles that order alone.
    """
    volume_flux, before, after, inflow, around = carrier
    sweep = _Sweep(grid, before, jnp.where(fraction > 0.5, 1.0, 0.0).astype(fraction.dtype), inflow, around)
    start = fraction * before, jnp.zeros_like(fraction)
    orders = ORDERS[grid.dimension]
    if isinstance(order, int):
        both, liquid = start, {}
        for place, axis in enumerate(orders[order % len(orders)]):
            both, liquid[axis] = sweep(both, volume_flux[axis], step, axis, place == grid.dimension - 1)
        return FractionStep(both[0] / after, tuple(liquid[axis] for axis in range(grid.dimension)))

    def swept(axis: int):  # type: ignore[no-untyped-def]
        def branch(carry, last):  # type: ignore[no-untyped-def]
            both, liquid = carry
            both, own = sweep(both, volume_flux[axis], step, axis, last)
            return both, tuple(own if a == axis else f for a, f in enumerate(liquid))

        return branch

    carry = start, tuple(map(jnp.zeros_like, volume_flux))
    both, found = in_order([swept(axis) for axis in range(grid.dimension)], order, carry)
    return FractionStep(both[0] / after, found)


def surface_courant(grid: Grid, volume_flux: FaceField, step: Array, open_part: CellOrOne = 1.0) -> Array:
    """() largest part of the fluids' volume of a cell that its faces let in, or out, in a step; see `SURFACE_COURANT`.

    Args:
        grid: the grid.
        volume_flux: of both fluids on the faces [m/s].
        step: () [s].
        open_part: void fraction on the cells [-].
    """
    terms = [
        (along(f, axis, None, -1) / grid.spacing[axis], along(f, axis, 1, None) / grid.spacing[axis])
        for axis, f in enumerate(volume_flux)
    ]
    comes_in = sum_of(jnp.maximum(low, 0.0) + jnp.maximum(-high, 0.0) for low, high in terms)
    leaves = sum_of(jnp.maximum(-low, 0.0) + jnp.maximum(high, 0.0) for low, high in terms)
    return box_largest(grid, step * jnp.maximum(comes_in, leaves) / open_part)


def planes(grid: Grid, fraction: Array, around: Callable[[Array], Array] | None = None) -> Plane:
    """The surface in every cell, of the normals of `surface_normal`.

    Args:
        grid: the grid.
        fraction: c on the cells [-].
        around: see `Carrier`.
    """
    cut = is_cut(fraction)
    normal = surface_normal(grid, fraction if around is None else around(fraction))
    sizes = tuple(jnp.abs(m) for m in normal)
    return Plane(normal, offset_of(sizes, jnp.where(cut, fraction, 0.5)), cut)


def planes_of_surface(grid: Grid, fraction: Array, around: Callable[[Array], Array] | None = None) -> Plane:
    """`planes`, by a branch of their own: nothing to do without a surface.

    Without the branch XLA fuses them into what asks for them, and computes them anew for each face that does: the
    transport takes three times as long.
    """

    def nothing(fraction: Array) -> Plane:
        return Plane((jnp.zeros_like(fraction),) * grid.dimension, jnp.zeros_like(fraction), fraction > 2.0)

    there = in_any(any_of(grid.blocks, jnp.any((fraction > 0.0) & (fraction < 1.0))))
    return lax.cond(there, lambda fraction: planes(grid, fraction, around), nothing, fraction)


def surface_normal(grid: Grid, fraction: Array) -> tuple[Array, ...]:
    """Normal of the surface in every cell, from the liquid, in units of the cell's sides; the sizes add up to 1.

    The slopes of the heights of columns of three cells, along the axis that stands most steeply on the surface by them;
    but the gradient of the fraction over the 3^D cells around where that lies less along any one axis.

    Args:
        grid: the grid.
        fraction: c on the cells [-].
    """
    dimension, wide = grid.dimension, fraction
    for axis in range(dimension):
        ends = beyond(grid, axis, wide, (-1,), (0,), own_layers(wide, axis))
        wide = jnp.concatenate((ends[0], wide, ends[1]), axis)
    gradient = _unit([-_stencil(wide, {b: "slope" if b == axis else "smooth" for b in range(dimension)})
                      for axis in range(dimension)])  # fmt: skip
    found, steepest = gradient, jnp.zeros_like(fraction)
    for axis in range(dimension):
        columns = [
            jnp.where(gradient[axis] < 0.0, -1.0, 1.0).astype(fraction.dtype)
            if b == axis
            else -_stencil(wide, {axis: "sum", b: "slope"})
            for b in range(dimension)
        ]
        candidate = _unit(columns)
        better = jnp.abs(candidate[axis]) > steepest
        steepest = jnp.where(better, jnp.abs(candidate[axis]), steepest)
        found = tuple(jnp.where(better, c, f) for c, f in zip(candidate, found, strict=True))
    largest = jnp.max(jnp.stack([jnp.abs(g) for g in gradient]), axis=0)
    use_gradient = steepest > largest
    return tuple(jnp.where(use_gradient, g, f) for g, f in zip(gradient, found, strict=True))


_WEIGHTS = {"smooth": (0.25, 0.5, 0.25), "slope": (-0.5, 0.0, 0.5), "sum": (1.0, 1.0, 1.0), "middle": (0.0, 1.0, 0.0)}
"""Of three layers of cells along an axis."""


def _stencil(wide: Array, along_axes: dict[int, str]) -> Array:
    """Weighted sums over three layers along every axis of an array with one layer more on either end; the middle one
    along axes that are not named."""
    for axis in range(wide.ndim):
        weights = _WEIGHTS[along_axes.get(axis, "middle")]
        count = wide.shape[axis] - 2
        wide = sum_of(w * along(wide, axis, i, i + count) for i, w in enumerate(weights) if w)
    return wide


def _unit(vector: list[Array]) -> tuple[Array, ...]:
    """The vector over the sum of the sizes of its components; along the last axis where there is none."""
    size = sum_of(jnp.abs(x) for x in vector)
    there = size > 1e-30
    whole = jnp.where(there, size, 1.0)
    last = len(vector) - 1
    return tuple(jnp.where(there, quotient(x, whole), 1.0 if axis == last else 0.0) for axis, x in enumerate(vector))


class _Sweep(NamedTuple):
    """The transport along one axis.

    Attributes:
        grid: the grid.
        before: void fraction at the start of the step [-].
        full: 1 in cells that were more than half full then, else 0.
        inflow, around: see `Carrier`.
    """

    grid: Grid
    before: CellOrOne
    full: Array
    inflow: Inflow | None
    around: Callable[[Array], Array] | None = None

    def __call__(
        self, both: tuple[Array, Array], flux: Array, step: Array, axis: int, last: Array | bool
    ) -> tuple[tuple[Array, Array], Array]:
        """The liquid in the cells and the dilation so far after the sweep, and the flux of the liquid.

        Args:
            both: volume of the liquid over that of the cell, and sum of dilations [-].
            flux: of both fluids through the faces of the axis [m/s].
            step: [s].
            axis: of the sweep.
            last: whether it is the last one, which takes out the dilations of the others.
        """
        liquid, dilated = both
        rate = step / self.grid.spacing[axis]
        carried = flux * self.share(liquid / self.before, rate * flux, axis)
        own = rate * (along(flux, axis, 1, None) - along(flux, axis, None, -1))
        dilation = jnp.where(jnp.asarray(last), -dilated, own)
        passed = rate * carried
        change = along(passed, axis, 1, None) - along(passed, axis, None, -1)
        return (liquid - change + self.full * dilation, dilated + dilation), carried

    def share(self, fraction: Array, passing: Array, axis: int) -> Array:
        """Liquid's part of the volume that passes the faces of an axis in the step [-].

        Args:
            fraction: c on the cells [-].
            passing: volume of both fluids that passes over that of a cell; of the lower cell where positive [-].
            axis: of the faces.
        """
        grid, plane = self.grid, planes_of_surface(self.grid, fraction, self.around)
        least = float(jnp.finfo(fraction.dtype).eps) ** 0.5
        upward = passing > 0.0

        def upstream(cells: Array) -> Array:
            ends = beyond(grid, axis, cells, (-1,), (0,), own_layers(cells, axis))
            wide = jnp.concatenate((ends[0], cells, ends[1]), axis)
            return jnp.where(upward, along(wide, axis, None, -1), along(wide, axis, 1, None))

        normal = [upstream(m) for m in plane.normal]
        whole, cut = upstream(fraction), upstream(plane.cut)
        open_part = self.before if isinstance(self.before, float) else upstream(self.before)
        reach = jnp.clip(jnp.abs(passing) / open_part, least, 1.0)
        sizes = [jnp.abs(m) for m in normal]
        # The slab next to the face, from the corner that is deepest in the liquid: far from it or at it.
        far = upward == (normal[axis] > 0.0)
        part = volume_of_slab(sizes, upstream(plane.offset), axis, far, reach)
        share = jnp.where(cut, part, whole)
        if self.inflow is None or grid.periodic[axis]:
            return share
        return with_ends(grid, axis, share, self._through_sides(share, upward, axis))

    def _through_sides(self, share: Array, upward: Array, axis: int) -> Ends:
        """Liquid's part of what passes the sides across an axis."""
        ends = []
        for upper in (False, True):
            place = (-1, None) if upper else (0, 1)
            own = along(share, axis, *place)
            given = None if self.inflow is None else self.inflow[2 * axis + upper]
            if given is not None:
                inward = along(upward, axis, *place) != upper
                own = jnp.where(inward, given, own)
            ends.append(own)
        return ends[0], ends[1]

"""Surfaces within the mesh of the fluid: which parts of faces and cells are open, and what a surface does to the flow.

A face of the staggered grid has an open fraction a, and its velocity is the mean over its open part. The momentum of a
face balances what acts on the open part of its control volume, with V the volume of a whole one:

    M V d(g u)/dt = - sum F u  +  w nu sum b (u_n - u)/h^2 V  -  w nu R (u - u_w) V  -  a w (grad p)/rho V

The flux a g u obeys continuity in every cell, so that the matrix of the pressure is symmetric. b = min(a, a_n) weights
the exchange with the next face n, the same for both. R is the friction on the surface. It is such that a linear shear
flow along a surface is kept exactly, u = d with d the mean distance of a face's open part from the surface:

    R d = sum b (d_n - d)/h^2 - a lap(d)

with the Laplacian of the distance, the curvature of the surface. At a surface on a grid line it is the friction of a
no-slip side, 2/h^2. It is implicit in time. M = max(a, 1/2) is the inertia: a small control volume has that of half a
cell, which no steady flow knows of. So small cells put no limit on the time step. Faces that are open by less than
`LEAST_OPEN` are closed.

Source of the weights: Y. T. Ng, C. Min, F. Gibou, J. Comput. Phys. 228 (2009) 8807-8829 (open fractions in the
projection on a staggered grid). The friction R is derived here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.fluid.boundary import Boundary, Sides, with_ghosts
from jaxdem.fluid.diffusion import to_boundary
from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, along, control_width, divergence, sum_of
from jaxdem.numerics import vectors
from jaxdem.numerics.host import namespace

LEAST_OPEN = 0.01
"""Open fraction under which a face is closed [-]."""

SHARPEST = 0.25
"""Curvature of a surface times the cell size, above which it counts for this much [-]."""

LEAST_INERTIA = 0.5
"""Of a control volume, in parts of a whole one [-]."""


class CutCells(NamedTuple):
    """What surfaces leave open of a mesh; traced.

    Attributes:
        open_faces: a, part of every face that is open; 0 for a closed one [-].
        open_cells: part of the volume of every cell; 0 for one without an open face [-].
        friction: R, on the faces [1/m2].
        velocity: u_w of the nearest surface, on the faces [m/s].
        nearest_to_faces: int32, number of the surface that is nearest to every face.
        nearest_to_cells: the same of every cell.
        spin: (S, A) angular velocity of every surface that turns along itself; None where none does [rad/s].
        deposit_weights: factor of every cell on the weights of particles, zero without an open face; None without
            particles [-].
    """

    open_faces: FaceField
    open_cells: Array
    friction: FaceField
    velocity: FaceField
    nearest_to_faces: FaceField
    nearest_to_cells: Array
    spin: Array | None = None
    deposit_weights: Array | None = None

    @property
    def inertia(self) -> FaceField:
        """M of every face [-]."""
        return tuple(jnp.maximum(a, LEAST_INERTIA) for a in self.open_faces)

    def opened(self, weights: Sequence[CellOrOne]) -> FaceField:
        """Weights on the faces times the open fractions: those of the fluxes."""
        return tuple(a * g for a, g in zip(self.open_faces, weights, strict=True))

    def pushed(self, faces: Sequence[CellOrOne]) -> FaceField:
        """What a gradient on the whole control volumes does to the velocities: times a/M."""
        return tuple(a / m * f for a, m, f in zip(self.open_faces, self.inertia, faces, strict=True))

    def on_open(self, faces: Sequence[CellOrOne]) -> FaceField:
        """The faces, zero where they are closed."""
        return tuple(jnp.where(a > 0.0, f, 0.0) for a, f in zip(self.open_faces, faces, strict=True))

    def growth(self, rate: Array, closed_box: bool) -> Array:
        """Rate of change of the void fraction times the open part of the cells [1/s].

        Args:
            rate: of the void fraction [1/s].
            closed_box: whether there is no outlet. Particles keep their volume, so the mean is rounding then, which no
                flow can take up.
        """
        rate = self.open_cells * rate
        if not closed_box:
            return rate
        fluid = self.open_cells > 0.0
        mean = jnp.sum(rate) / jnp.sum(fluid.astype(rate.dtype))
        return jnp.where(fluid, rate - mean, 0.0)

    def with_walls(self, velocity: FaceField) -> FaceField:
        """The velocity, on closed faces that of the surface [m/s]."""
        zipped = zip(self.open_faces, velocity, self.velocity, strict=True)
        return tuple(jnp.where(a > 0.0, u, w) for a, u, w in zipped)

    def moved(
        self,
        mobility: Sequence[CellOrOne],
        shift: Sequence[CellOrOne],
        void_fraction: Sequence[CellOrOne],
        friction: FaceField,
    ) -> tuple[FaceField, FaceField]:
        """1 / (g + B) and the forcing per mass with the inertia of the open part, and the friction on surfaces in both.

        Args:
            mobility: 1 / (g + B) of whole control volumes.
            shift: forcing per mass of these [m/s].
            void_fraction: g on the faces.
            friction: w nu R times the time step [-].
        """
        moved, pulled = [], []
        for axis, inertia in enumerate(self.inertia):
            g, r = void_fraction[axis], friction[axis]
            moved.append(1.0 / (g + (1.0 / mobility[axis] - g + r) / inertia))
            is_open = self.open_faces[axis] > 0.0
            pulled.append(jnp.where(is_open, (shift[axis] + r * self.velocity[axis]) / inertia, 0.0))
        return tuple(moved), tuple(pulled)

    def surface_value(self, grid: Grid, value: Array, padded: Array, which: int, axis: int) -> Array:
        """What is carried through the surfaces of control volumes; between an open and a closed face the open one's.

        Args:
            grid: the grid.
            value: on the surfaces, as if all were open.
            padded: the component with two layers beyond either end.
            which, axis: component, and axis along which the control volumes follow each other.
        """
        is_open = _padded(grid, self.open_faces, which, axis) > 0.0
        below, above = along(is_open, axis, None, -1), along(is_open, axis, 1, None)
        near = along(padded, axis, 1, -1)
        of_one = jnp.where(below, along(near, axis, None, -1), along(near, axis, 1, None))
        return jnp.where(below & above, value, of_one)


def cut_stress(
    grid: Grid, sides: Sides, cut: CutCells, velocity: FaceField, viscosity: Array, compressed: bool
) -> tuple[FaceField, FaceField]:
    """nu sum b (u_n - u)/h^2 on the faces, without the friction on surfaces [m/s2]; and what closed faces gain of it.

    Where the void fraction changes, nu/3 grad(div u) is added between whole cells. What the same gradient would give to
    other faces is the second result: the surfaces take it.

    Args:
        grid: the grid.
        sides: of the box.
        cut: the open parts.
        velocity: u on the faces [m/s].
        viscosity: () kinematic [m2/s].
        compressed: whether the void fraction changes.
    """
    result, lost = [], []
    expansion = _expansion_of_whole_cells(grid, cut, velocity) if compressed else None
    for which, u in enumerate(velocity):
        terms = []
        for axis in range(grid.dimension):
            near = along(with_ghosts(grid, sides, u, which, axis), axis, 1, -1)
            weight = _padded(grid, cut.open_faces, which, axis)
            link = jnp.minimum(along(weight, axis, None, -1), along(weight, axis, 1, None))
            flux = link * (along(near, axis, 1, None) - along(near, axis, None, -1)) / grid.spacing[axis]
            width = control_width(grid, axis, u.dtype) if which == axis else grid.spacing[axis]
            terms.append((along(flux, axis, 1, None) - along(flux, axis, None, -1)) / width)
        total, outside = sum_of(terms), jnp.zeros_like(u)
        if expansion is not None:
            slope = _inner_slope(grid, expansion, which)
            whole = _between_whole_cells(grid, cut, which)
            total, outside = total + jnp.where(whole, slope, 0.0), jnp.where(whole, 0.0, slope)
        result.append(viscosity * total)
        lost.append(viscosity * outside)
    return tuple(result), tuple(lost)


def seen_stress(grid: Grid, boundary: Boundary, cut: CutCells, stress: FaceField, friction: FaceField) -> FaceField:
    """div(tau)/rho of the fluid on the open part of the faces, as grains see it [m/s2].

    Args:
        grid: the grid.
        boundary: sides.
        cut: the open parts.
        stress: of `cut_stress` [m/s2].
        friction: nu R (u - u_w) [m/s2].
    """
    found = []
    for axis, (a, s, f) in enumerate(zip(cut.open_faces, stress, friction, strict=True)):
        own = jnp.where(a > 0.0, (s - f) / jnp.where(a > 0.0, a, 1.0), 0.0)
        found.append(to_boundary(grid, boundary, own, axis))
    return continued(cut, tuple(found))


def continued(cut: CutCells, faces: FaceField) -> FaceField:
    """A face field whose closed faces have the mean of the open ones next to them along their axis, or zero."""
    found = []
    for axis, (a, f) in enumerate(zip(cut.open_faces, faces, strict=True)):
        is_open = (a > 0.0).astype(f.dtype)
        f = jnp.where(a > 0.0, f, 0.0)
        weight = _next_to(is_open, axis)
        mean = _next_to(f, axis) / jnp.where(weight > 0.0, weight, 1.0)
        found.append(jnp.where(a > 0.0, f, mean))
    return tuple(found)


def _next_to(faces: Array, axis: int) -> Array:
    """Sum of the two neighbours along an axis, zero beyond the ends."""
    nothing = jnp.zeros_like(along(faces, axis, 0, 1))
    before = jnp.concatenate((nothing, along(faces, axis, None, -1)), axis)
    return before + jnp.concatenate((along(faces, axis, 1, None), nothing), axis)


def _expansion_of_whole_cells(grid: Grid, cut: CutCells, velocity: FaceField) -> Array:
    return jnp.where(cut.open_cells >= 1.0, divergence(grid, velocity), 0.0) / 3.0


def _between_whole_cells(grid: Grid, cut: CutCells, axis: int) -> Array:
    whole = cut.open_cells >= 1.0
    inner = along(whole, axis, None, -1) & along(whole, axis, 1, None)
    seam = along(whole, axis, -1, None) & along(whole, axis, 0, 1) & grid.periodic[axis]
    return jnp.concatenate((seam, inner, seam), axis)


def _inner_slope(grid: Grid, cell: Array, axis: int) -> Array:
    """Slope on the faces, zero on sides."""
    h = grid.spacing[axis]
    inner = (along(cell, axis, 1, None) - along(cell, axis, None, -1)) / h
    seam = (along(cell, axis, 0, 1) - along(cell, axis, -1, None)) / h * grid.periodic[axis]
    return jnp.concatenate((seam, inner, seam), axis)


def _padded(grid: Grid, open_faces: FaceField, which: int, axis: int) -> Array:
    """Open fractions of component `which` with one layer more on either end of an axis; beyond a side what is open of
    it."""
    faces, count = open_faces[which], grid.cells[axis]
    xp = namespace(faces)
    if not grid.periodic[axis]:
        ends = _open_side(grid, open_faces, which, axis, False), _open_side(grid, open_faces, which, axis, True)
    elif which == axis:
        ends = along(faces, axis, count - 1, count), along(faces, axis, 1, 2)
    else:
        ends = along(faces, axis, count - 1, count), along(faces, axis, 0, 1)
    return xp.concatenate((ends[0], faces, ends[1]), axis)


def _open_side(grid: Grid, open_faces: FaceField, which: int, axis: int, upper: bool) -> Array:
    """What is open of a side of the box beside every face of a component."""
    side = along(open_faces[axis], axis, *((-1, None) if upper else (0, 1)))
    if which == axis:
        return side
    first, last = along(side, which, 0, 1), along(side, which, -1, None)
    inner = 0.5 * (along(side, which, None, -1) + along(side, which, 1, None))
    if grid.periodic[which]:
        first = last = 0.5 * (first + last)
    return namespace(side).concatenate((first, inner, last), which)


def friction_of(grid: Grid, open_faces: FaceField, distance: FaceField, whole: FaceField) -> FaceField:
    """R of every face next to a surface, see the module [1/m2]; also for arrays of NumPy.

    It is at least 1/h^2 for each neighbour that is closed, which holds in gaps of few cells, where the distance has its
    ridge.

    Args:
        grid: the grid.
        open_faces: a.
        distance: mean over the open part of every face, 0 of closed ones [m].
        whole: mean over the whole of every face, negative in a wall [m].
    """
    result = []
    for which, (a, d, m) in enumerate(zip(open_faces, distance, whole, strict=True)):
        xp, bend = namespace(a), 0.0 * m
        total, least, near = xp.zeros_like(d), xp.zeros_like(d), a < 1.0
        for axis in range(grid.dimension):
            beside, wide = _padded(grid, open_faces, which, axis), _with_distance_beyond(grid, d, which, axis)
            for upper in (False, True):
                ends = (2, None) if upper else (None, -2)
                next_a, next_d = along(beside, axis, *ends), along(wide, axis, *ends)
                total = total + xp.minimum(a, next_a) * (next_d - d) / grid.spacing[axis] ** 2
                least = least + xp.where(next_a <= 0.0, a, 0.0) / grid.spacing[axis] ** 2
                near = near | (next_a < 1.0)
            wide = _with_distance_beyond(grid, m, which, axis)
            bend = bend + (along(wide, axis, 2, None) - 2.0 * m + along(wide, axis, None, -2)) / grid.spacing[axis] ** 2
        # A kink, where two surfaces meet, is no curvature.
        limit = SHARPEST / min(grid.spacing)
        total = total - a * xp.clip(bend, -limit, limit)
        has_distance = (a > 0.0) & (d > 0.0)
        friction = xp.maximum(total / xp.where(has_distance, d, 1.0), least)
        result.append(xp.where(has_distance & near, friction, 0.0))
    return tuple(result)


def _with_distance_beyond(grid: Grid, distance: Array, which: int, axis: int) -> Array:
    """Distances with one layer more on either end of an axis; beyond a side they go on linearly."""
    xp, count = namespace(distance), grid.cells[axis]
    if grid.periodic[axis]:
        first = 1 if which == axis else 0
        ends = along(distance, axis, count - 1, count), along(distance, axis, first, first + 1)
        return xp.concatenate((ends[0], distance, ends[1]), axis)
    beyond = []
    for end, inner in (((0, 1), (1, 2)), ((-1, None), (-2, -1))):
        own, before = along(distance, axis, *end), along(distance, axis, *inner)
        if before.shape[axis] == 0:
            before = own
        beyond.append(2.0 * own - xp.where(before > 0.0, before, own))
    return xp.concatenate((beyond[0], distance, beyond[1]), axis)


class SurfaceShares(NamedTuple):
    """What acts on the surfaces in a fluid step.

    Attributes:
        on_faces: force on the surface that is nearest to every face [N].
        on_cells: D arrays, the same of every cell: of the pressure [N].
    """

    on_faces: FaceField
    on_cells: tuple[Array, ...]


def stress_on_cuts(grid: Grid, cut: CutCells, pressure: Array, dynamic_viscosity: Array) -> tuple[Array, ...]:
    """p A on the cut of every cell, A its area along the normal out of the fluid: the difference of the open parts of
    the cell's opposite faces; and where the surface turns with W, mu W cross A [N].

    The second is what the transposed gradient of the velocity, which the balance of momentum leaves out, does to the
    surface. It has no resultant on a closed surface, but a torque.
    """
    areas = tuple(
        (grid.cell_volume / grid.spacing[axis]) * (along(a, axis, None, -1) - along(a, axis, 1, None))
        for axis, a in enumerate(cut.open_faces)
    )
    found = tuple(pressure * area for area in areas)
    if cut.spin is None:
        return found
    own = cut.spin[cut.nearest_to_cells]
    turned = vectors.rotate(tuple(own[..., k] for k in range(own.shape[-1])), areas)
    return tuple(f + dynamic_viscosity * t for f, t in zip(found, turned, strict=True))


def surface_loads(grid: Grid, cut: CutCells, shares: SurfaceShares, count: int) -> Array:
    """(S, D, 1 + D) force on every surface and its first moments, as `side_forces` has them [N], [N m].

    A force acts at the middle of its face or cell.

    Args:
        grid: the grid.
        cut: the open parts.
        shares: the forces.
        count: S, number of surfaces; static.
    """
    loads = []
    for which in range(grid.dimension):
        faces, cells = shares.on_faces[which], shares.on_cells[which]
        if grid.periodic[which]:
            last = along(faces, which, -1, None)
            faces = jnp.concatenate((along(faces, which, None, -1), 0.0 * last), which)
        row = []
        for k in range(-1, grid.dimension):
            parts = []
            for field, nearest, is_face in (
                (faces, cut.nearest_to_faces[which], True),
                (cells, cut.nearest_to_cells, False),
            ):
                if k == which:
                    parts.append(jnp.zeros(count, field.dtype))
                    continue
                arm = 1.0 if k < 0 else _places(grid, field, k, is_face and k == which)
                parts.append(jnp.zeros(count, field.dtype).at[nearest].add(field * arm))
            row.append(sum_of(parts))
        loads.append(jnp.stack(row, axis=-1))
    return jnp.stack(loads, axis=1)


def _places(grid: Grid, field: Array, axis: int, on_faces: bool) -> Array:
    points = np.arange(field.shape[axis]) + (0.0 if on_faces else 0.5)
    shape = [-1 if a == axis else 1 for a in range(grid.dimension)]
    return jnp.asarray((points * grid.spacing[axis]).reshape(shape), field.dtype)

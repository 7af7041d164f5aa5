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
`open_faces.LEAST_OPEN` are closed.

A surface that changes its place opens and closes cells: the volume that it sweeps is part of continuity, and the
balance is that of a control volume at rest, M V g du/dt = - sum F u + u sum F + ..., which keeps a uniform stream that
moves with a body.

Source of the weights: Y. T. Ng, C. Min, F. Gibou, J. Comput. Phys. 228 (2009) 8807-8829 (open fractions in the
projection on a staggered grid). The friction R is derived here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.grid import CellOrOne, FaceField, Grid, along
from jaxdem.numerics.blocks import total

LEAST_INERTIA = 0.5
"""Of a control volume, in parts of a whole one [-]."""


class OpeningParts(NamedTuple):
    """The part of a surface that is an inlet or outlet, see `openings`; traced.

    Attributes:
        supply: of the cells, area of the opening over the volume of a whole cell [1/m].
        velocity: of what comes in at 1 m/s, the mean over the surface beside every face [-].
        normal: of the surface beside every face, into the fluid [-].
        area: () of the opening [m2].
    """

    supply: Array
    velocity: FaceField
    normal: FaceField
    area: Array


class CutCells(NamedTuple):
    """What surfaces leave open of a mesh; traced.

    Attributes:
        open_faces: a, part of every face that is open; 0 for a closed one [-].
        open_cells: part of the volume of every cell; 0 for one without an open face [-].
        links: of every component and along every axis, what control volumes that follow each other share, see
            `open_faces.links_of` [-].
        friction: R, on the faces [1/m2].
        velocity: u_w of the nearest surface, on the faces [m/s].
        nearest_to_faces: int32, number of the surface that is nearest to every face.
        nearest_to_cells: the same of every cell.
        spin: (S, A) angular velocity of every surface that turns along itself; None where none does [rad/s].
        deposit_weights: factor of every cell on the weights of particles, zero without an open face; None without
            particles [-].
        swept: rate at which surfaces that change their place open the cells, over the volume of a whole cell, with the
            part of it that is fluid; None where all keep their place [1/s].
        distance: from the nearest surface at the corners, where surfaces change their place; None elsewhere [m].
        unit_swept: of every piston, see `coupling.pistons_in_fluid`, `swept` at a speed of 1 m/s alone; None without
            pistons [1/m].
        interval: () length of the coupling interval; None without pistons [s].
        piston_gaps: (H, S) between pistons and the surfaces that they must not meet; None without pistons [m].
        renewed: () bool, a surface has come or vanished since the last interval; None where none does in the run.
        layers: of two fluids, see `cut_liquid`; None of one [-].
        openings: inlets and outlets on the surfaces; None without.
        supply: volume that comes in through them over that of a whole cell, within a step; None without [1/s].
        brought: velocity that it brings to every face, within a step; None without [m/s2].
        speeds: () of each at which fluid comes in there, within a step; None without [m/s].
    """

    open_faces: FaceField
    open_cells: Array
    links: tuple[FaceField, ...]
    friction: FaceField
    velocity: FaceField
    nearest_to_faces: FaceField
    nearest_to_cells: Array
    spin: Array | None = None
    deposit_weights: Array | None = None
    swept: Array | None = None
    distance: Array | None = None
    unit_swept: tuple[Array, ...] | None = None
    interval: Array | None = None
    piston_gaps: Array | None = None
    renewed: Array | None = None
    layers: Array | None = None
    openings: tuple[OpeningParts, ...] | None = None
    supply: Array | None = None
    brought: FaceField | None = None
    speeds: tuple[Array, ...] | None = None

    @property
    def inertia(self) -> FaceField:
        """M of every face [-]."""
        return tuple(jnp.maximum(a, LEAST_INERTIA) for a in self.open_faces)

    def opened(self, weights: Sequence[CellOrOne]) -> FaceField:
        """Weights on the faces times the open fractions: those of the fluxes."""
        return tuple(a * g for a, g in zip(self.open_faces, weights, strict=True))

    def pushed(self, faces: Sequence[CellOrOne]) -> FaceField:
        """What a gradient on the whole control volumes does to the velocities: times a/M."""
        # a/M is 1 or a/LEAST_INERTIA.
        share = (jnp.minimum(a / LEAST_INERTIA, 1.0) for a in self.open_faces)
        return tuple(s * f for s, f in zip(share, faces, strict=True))

    def on_open(self, faces: Sequence[CellOrOne]) -> FaceField:
        """The faces, zero where they are closed."""
        return tuple(jnp.where(a > 0.0, f, 0.0) for a, f in zip(self.open_faces, faces, strict=True))

    def on_closed(self, faces: Sequence[CellOrOne]) -> FaceField:
        """The faces, zero where they are open."""
        return tuple(jnp.where(a > 0.0, 0.0, f) for a, f in zip(self.open_faces, faces, strict=True))

    def growth(self, grid: Grid, rate: Array | float, closed_box: bool) -> Array:
        """Rate of change of the volume of fluid in every cell, over that of a whole cell [1/s].

        Args:
            grid: the grid.
            rate: of the void fraction [1/s].
            closed_box: whether there is no outlet. Particles and bodies keep their volume, so the mean is rounding
                then, which no flow can take up.
        """
        rate = self.open_cells * rate
        if self.swept is not None:
            rate = rate + self.swept
        if not closed_box:
            return rate
        fluid = self.open_cells > 0.0
        changed, cells = total(grid.blocks, (jnp.sum(rate), jnp.sum(fluid.astype(rate.dtype))))
        mean = changed / cells
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

    def surface_value(self, grid: Grid, value: Array, around: Array, which: int, axis: int) -> Array:
        """What is carried through the surfaces of control volumes; between an open and a closed face the open one's.

        Args:
            grid: the grid.
            value: on the surfaces, as if all were open.
            around: the component with two layers beyond either end.
            which, axis: component, and axis along which the control volumes follow each other.
        """
        link, near = self.links[which][axis], along(around, axis, 1, -1)
        of_one = jnp.where(link < 0.0, along(near, axis, 1, None), along(near, axis, None, -1))
        return jnp.where(link > 0.0, value, of_one)

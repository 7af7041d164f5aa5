"""How a particle's volume, and what it gives to the fluid, is spread over the cells.

All of them put the whole of a particle into the box, so that volume is conserved exactly, at walls too, and use
the same weights for interpolation.
"""

from __future__ import annotations

import itertools
import math
from typing import Protocol

import numpy as np
from jax import Array

from jaxdem.coupling.interpolation import Weights
from jaxdem.coupling.kernel import KernelWidth, kernel_weights, point_weights
from jaxdem.fluid.grid import Grid
from jaxdem.numerics.host import namespace
from jaxdem.numerics.static import static


class Deposition(Protocol):
    """A way to spread particles over cells; static."""

    @property
    def half_width(self) -> tuple[float, ...]:
        """How far a particle reaches along every axis from its centre [m]."""
        ...

    def weights(self, grid: Grid, position: Array, radius: Array) -> Weights:
        """Weights of particles at `position` (N, D) [m] of this radius, () or (N,) [m]."""
        ...


@static
class Kernel:
    """A triangular kernel, integrated exactly over the cells; a smooth function of the position.

    Attributes:
        half_width: along every axis [m].
    """

    half_width: tuple[float, ...]

    def weights(self, grid: Grid, position: Array, radius: Array) -> Weights:
        """See `Deposition`."""
        return kernel_weights(grid, self.half_width, position)


@static
class OwnKernel:
    """A `Kernel` of each particle's own width.

    Attributes:
        half_width: of the largest particle along every axis [m].
        width: by the diameter of each.
    """

    half_width: tuple[float, ...]
    width: KernelWidth

    def weights(self, grid: Grid, position: Array, radius: Array) -> Weights:
        """See `Deposition`."""
        xp = namespace(position)
        by_size = xp.broadcast_to(xp.asarray(2.0 * self.width.diameters * radius, position.dtype), position.shape[:1])
        # A radius that is not that of the start, as in a gradient, does not reach beyond the cells that there are.
        own = tuple(
            xp.clip(by_size, self.width.cells * h, half) for h, half in zip(grid.spacing, self.half_width, strict=True)
        )
        return kernel_weights(grid, self.half_width, position, own)


@static
class Centre:
    """All of a particle in the cell of its centre (particle-centroid method). Jumps from cell to cell.

    Attributes:
        half_width: zeros, one for every axis [m].
    """

    half_width: tuple[float, ...]

    def weights(self, grid: Grid, position: Array, radius: Array) -> Weights:
        """See `Deposition`."""
        return point_weights(grid, self.half_width, position[:, None])


@static
class Divided:
    """A sphere divided among the cells that it lies in, by 29 points that stand for equal parts of its volume.

    The points are the centre and, on two shells, the directions of the faces and corners of a cube. In 2-D they
    are seen along the depth.

    Attributes:
        half_width: the largest radius, for every axis [m].

    Source: C. Goniva et al., Particuology 10 (2012) 582-591 (divided void fraction).
    """

    half_width: tuple[float, ...]

    def weights(self, grid: Grid, position: Array, radius: Array) -> Weights:
        """See `Deposition`."""
        xp = namespace(position)
        points = xp.asarray(sphere_points()[:, : grid.dimension], position.dtype)
        radius = xp.broadcast_to(radius, position.shape[:1])
        return point_weights(grid, self.half_width, position[:, None] + radius[:, None, None] * points[None])


@static
class Diffusion:
    """The divided sphere, smoothed by diffusion with zero flux through the sides of the box.

    The smoothed field is exp(s^2/2 Laplacian) of the deposited one, with the exact exponential of the discrete
    Laplacian: a Gaussian of standard deviation s in the inside, conservative and positive at any s. Between surfaces
    see `cut_diffusion`.

    Attributes:
        half_width: of the triangle that has the variance of the Gaussian, s = half_width / sqrt(6), per axis [m].

    Source: R. Sun & H. Xiao, Int. J. Multiphase Flow 77 (2015) 142-157.
    """

    half_width: tuple[float, ...]

    @property
    def deviation(self) -> tuple[float, ...]:
        """s along every axis [m]."""
        return tuple(half / math.sqrt(6.0) for half in self.half_width)

    def weights(self, grid: Grid, position: Array, radius: Array) -> Weights:
        """See `Deposition`."""
        smoothing = tuple(
            namespace(position).asarray(gaussian_matrix(n, h, deviation, periodic), position.dtype)
            for n, h, deviation, periodic in zip(
                grid.whole_cells, grid.spacing, self.deviation, grid.periodic, strict=True
            )
        )
        return Divided(self.half_width).weights(grid, position, radius)._replace(smoothing=smoothing)


def sphere_points() -> np.ndarray:
    """(29, 3) points in the unit sphere that stand for equal parts of its volume [-]."""
    faces = [sign * np.eye(3)[axis] for axis in range(3) for sign in (-1.0, 1.0)]
    corners = [np.array(signs) / math.sqrt(3.0) for signs in itertools.product((-1.0, 1.0), repeat=3)]
    directions = np.array(faces + corners)
    radii = (np.array([1.0, 15.0, 29.0]) / 29.0) ** (1.0 / 3.0)
    inner, outer = radii[:-1], radii[1:]
    # Where the second moment of the shell is: its sphere's variance r^2/5 per axis comes out exactly but for the
    # centre's own part.
    shells = np.sqrt(0.6 * (outer**5 - inner**5) / (outer**3 - inner**3))
    return np.concatenate((np.zeros((1, 3)), *(shell * directions for shell in shells)))


def gaussian_matrix(count: int, spacing: float, deviation: float, periodic: bool) -> np.ndarray:
    """exp(s^2/2 d^2/dx^2) on `count` cells, (count, count), symmetric, rows adding up to one [-]."""
    laplacian = np.zeros((count, count))
    for cell in range(count):
        for other in (cell - 1, cell + 1):
            if periodic or 0 <= other < count:
                laplacian[cell, cell] -= 1.0 / spacing**2
                laplacian[cell, other % count] += 1.0 / spacing**2
    values, vectors = np.linalg.eigh(laplacian)
    return (vectors * np.exp(0.5 * deviation**2 * values)) @ vectors.T

"""The exchange beside surfaces that the fluid sees: particles give to the open part of the cells."""

from __future__ import annotations

from jax import Array

from jaxdem.coupling.cut_diffusion import cut_diffusion
from jaxdem.coupling.deposition import Deposition, Diffusion
from jaxdem.coupling.interpolation import Weights, in_reach
from jaxdem.errors import required
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.grid import FaceField, Grid
from jaxdem.fluid.open_faces import continued
from jaxdem.numerics.host import namespace


def weights_beside(deposition: Deposition, grid: Grid, weights: Weights, cut: CutCells | None) -> Weights:
    """Weights of a deposition beside surfaces: see `open_weights`, and for diffusion `cut_diffusion`."""
    weights = open_weights(weights, cut)
    if cut is None or not isinstance(deposition, Diffusion):
        return weights
    return weights._replace(smoothing=cut_diffusion(grid, cut, deposition.deviation))


def open_weights(weights: Weights, cut: CutCells | None) -> Weights:
    """Weights of particles times a factor v of their cells, over the sum of these: w_pc v_c / sum_c w_pc v_c.

    The factors are such that particles that stand evenly give an even solid fraction, see `setup.even_deposition`. All
    of a particle's volume is in the fluid, and where it is far from a surface nothing changes. Of a particle that
    reaches no open cell the weights stay as they are.

    Args:
        weights: of the N particles.
        cut: the open parts; None without surfaces.
    """
    if cut is None:
        return weights
    xp, factors = namespace(weights.weight), required(cut.deposit_weights, "deposit_weights of the cut cells")
    shares = weights.weight * in_reach(weights, factors)
    total = xp.sum(shares, axis=1, keepdims=True)
    reaches = total > 1e-6
    return weights._replace(weight=xp.where(reaches, shares / xp.where(reaches, total, 1.0), weights.weight))


def over_open_part(cells: Array, cut: CutCells | None) -> Array:
    """A quantity of whole cells, as one of their open parts."""
    if cut is None:
        return cells
    xp = namespace(cells)
    return cells / xp.where(cut.open_cells > 0.0, cut.open_cells, 1.0)


def of_whole_cells(cells: Array, cut: CutCells | None) -> Array:
    """The inverse of `over_open_part`."""
    if cut is None:
        return cells
    xp = namespace(cells)
    return cells * xp.where(cut.open_cells > 0.0, cut.open_cells, 1.0)


def seen_slope(grid: Grid, slope: FaceField, cut: CutCells | None) -> FaceField:
    """A gradient on the faces as particles see it: on closed faces that of the open ones beside them."""
    return slope if cut is None else continued(grid, cut.open_faces, slope)

"""The stress that averages of a fine flow over coarse cells hide, and how much of it simple models explain."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from jaxdem.fluid.grid import Grid
from jaxdem.fluid.remap import remap_cells
from jaxdem.io import Run
from studies.measure import fluid_frame, grid_of, screen_time

EDGE = 1
"""Coarse cells at the sides of the box that are left out: their gradients are one-sided."""


@dataclasses.dataclass(frozen=True)
class HiddenStress:
    """The stress that averaging hides, over all inner cells and output times.

    Attributes:
        share: root-mean-square of it over that of the whole mean momentum flux <g u_i u_j> [-].
        gradient_fit: c_n that explains most of it, with no eddy viscosity [-].
        gradient: part of its squares that c_n = 1/12 explains [-].
        best: part that `gradient_fit` explains [-].
        viscosity_fit: c_1 that explains most of it by itself [-].
    """

    share: float
    gradient_fit: float
    gradient: float
    best: float
    viscosity_fit: float


def hidden_stress(run: Run, cells: tuple[int, ...]) -> HiddenStress:
    """R_ij = <g u_i u_j> - <g u_i> <g u_j> / <g> of a run's fields, averaged to a coarser mesh, against models of it.

    The models are those of `jaxdem.fluid.subgrid_stress`, by central differences of <g u>/<g>:
    g c_n sum_k h_k^2 du_i/dx_k du_j/dx_k, and -2 g c_1 Delta^2 |S| S_ij.

    Args:
        run: the fine run; its output frames after the first, up to the screen time, are used.
        cells: of the coarser mesh, more than twice `EDGE` along every axis.
    """
    fine, until = grid_of(run), screen_time(run)
    coarse = dataclasses.replace(fine, cells=cells)
    sums = np.zeros(6)
    for index, time in enumerate(run.times):
        if time == 0.0 or (until is not None and time > until):
            continue
        frame = fluid_frame(run, index)
        velocity, g = np.asarray(frame["velocity"], float), np.asarray(frame["void_fraction"], float)
        sums += _sums(fine, coarse, [velocity[..., axis] for axis in range(fine.dimension)], g)
    hidden, whole, gradient, with_gradient, eddy, with_eddy = sums
    c_n, c_1 = with_gradient / gradient, with_eddy / eddy

    def explained(c: float) -> float:
        return float(1.0 - (hidden - 2.0 * c * with_gradient + c**2 * gradient) / hidden)

    return HiddenStress(math.sqrt(hidden / whole), float(c_n), explained(1.0 / 12.0), explained(c_n), float(c_1))


def _sums(fine: Grid, coarse: Grid, velocity: list[np.ndarray], void_fraction: np.ndarray) -> np.ndarray:
    """Sums over inner cells of R:R, flux:flux, G:G, R:G, E:E and R:E, G and E the models with coefficients of one."""

    def mean(field: np.ndarray) -> np.ndarray:
        return remap_cells(fine, coarse, field)

    g, dimension = mean(void_fraction), fine.dimension
    flux = [mean(void_fraction * u) for u in velocity]
    seen = [f / g for f in flux]
    inner = (slice(EDGE, -EDGE),) * dimension
    slope = [[np.gradient(u, h, axis=k) for k, h in enumerate(coarse.spacing)] for u in seen]
    strain = [[0.5 * (slope[i][j] + slope[j][i]) for j in range(dimension)] for i in range(dimension)]
    size = np.sqrt(2.0 * sum(s**2 for row in strain for s in row))
    result = np.zeros(6)
    for i in range(dimension):
        for j in range(dimension):
            whole = mean(void_fraction * velocity[i] * velocity[j])
            hidden = whole - flux[i] * flux[j] / g
            gradient = g * sum(h**2 * slope[i][k] * slope[j][k] for k, h in enumerate(coarse.spacing))
            eddy = -2.0 * g * coarse.filter_size**2 * size * strain[i][j]
            squares = [float(np.sum((a * a)[inner])) for a in (hidden, whole, gradient, eddy)]
            with_gradient, with_eddy = (float(np.sum((hidden * a)[inner])) for a in (gradient, eddy))
            result += [*squares[:3], with_gradient, squares[3], with_eddy]
    return result

"""What is measured in a run of the scene `clusters`: slip, drag, and how uneven solids and velocities are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.clusters_runs import RELAXATION, Case, terminal_speed, uniform_drag
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.remap import remap_cells
from jaxdem.io import Run

DROPPED = 10
"""Relaxation times at the start that are not measured."""
FRAMES = 100
"""Largest number of frames from which drag and variances are taken, evenly over the time."""
BLOCKS, BLOCK = 6, 5
"""Equal parts of the rest, whose means give the standard error of the mean: at least so many, and of so many relaxation
times where it is long. The correlation of the slip is zero after 2."""
SCALES = (12, 24)
"""Sides of the cells over which variances are taken, in diameters of the grain."""


def measured(case: Case, run: Run, dropped: float = DROPPED) -> dict[str, Any]:
    """The measures of a run, each as mean and standard error; the first `dropped` relaxation times are left out.

    `slip`: velocity of the gas, mean by its volume, less that of the grains, over the terminal speed of a grain.
    `drag`: vertical drag on a grain over that of the uniform state at the same mean solid fraction and slip.
    `solids_N`, `grains_N`, `gas_N`: variance over cells of N diameters of the solid fraction over its mean squared, of
    the vertical velocity of the grains (mean by mass) and of the gas over the terminal speed squared.
    """
    lines, terminal = run.probes["box"], terminal_speed(case)
    blocks = max(BLOCKS, round((case.times - dropped) / BLOCK))
    slip = lines["fluid_velocity_z"] - lines["velocity_z"]
    steady = lines["time"] > (dropped + 0.25) * RELAXATION
    late = [n for n, now in enumerate(run.times) if now > (dropped - 0.5) * RELAXATION]
    frames = late[:: math.ceil(len(late) / FRAMES)]
    series: dict[str, list[float]] = {"drag": []}
    for frame in frames:
        particles, fluid = run.particles(frame), run.fluid(frame)
        assert fluid is not None
        force = float(particles["drag_force"][:, 1].mean()) / case.parcel**2
        void = fluid["void_fraction"]
        now = float((void * fluid["velocity"][..., 1]).sum() / void.sum() - particles["velocity"][:, 1].mean())
        series["drag"].append(force / float(uniform_drag(case, now)))
        for scale in SCALES:
            for name, value in variances(case, particles, fluid, scale).items():
                series.setdefault(f"{name}_{scale}", []).append(value)
    result = {"slip": with_error(slip[steady] / terminal, blocks)}
    return result | {name: with_error(np.asarray(values), blocks) for name, values in series.items()}


def with_error(values: np.ndarray, number: int = BLOCKS) -> dict[str, float]:
    """Mean of a series in time, and its standard error by the means of so many blocks that follow each other."""
    blocks = [float(block.mean()) for block in np.array_split(values, min(number, len(values)))]
    return {"mean": float(values.mean()), "error": float(np.std(blocks, ddof=1) / math.sqrt(len(blocks)))}


def is_fine(row: dict[str, Any]) -> bool:
    """Whether a row of the table is of a run on cells of 3 diameters, without a model and with grains."""
    return bool(row["cell"] == 3.0 and row["parcel"] == 1 and not row["closure"])


def pooled(rows: Sequence[dict[str, Any]], name: str) -> dict[str, float]:
    """A measure of several runs of one case: mean by the time that is measured, and its standard error.

    With w_i the part of run i in the time, m_i and e_i its mean and error, the error is sqrt(sum w_i^2 e_i^2), times
    Birge's ratio sqrt(sum ((m_i - m) / e_i)^2 / (n - 1)) where that is above one: where runs differ by more than their
    errors say.

    Source: R. T. Birge, Phys. Rev. 40 (1932) 207-227.

    Args:
        rows: each with `times` and the measure.
        name: of the measure.
    """
    mean, error, time = (np.array(values, float) for values in zip(*(_parts(row, name) for row in rows), strict=True))
    part = time / time.sum()
    middle = float(part @ mean)
    ratio = math.sqrt(float((((mean - middle) / error) ** 2).sum()) / (len(rows) - 1)) if len(rows) > 1 else 1.0
    return {"mean": middle, "error": float(np.linalg.norm(part * error)) * max(1.0, ratio)}


def _parts(row: dict[str, Any], name: str) -> tuple[float, float, float]:
    return row[name]["mean"], row[name]["error"], row["times"] - DROPPED


def variances(
    case: Case, particles: dict[str, np.ndarray], fluid: dict[str, np.ndarray], scale: int
) -> dict[str, float]:
    """Of the fields of a frame over cells of `scale` diameters, see `measured`."""
    cells = (round(case.box[0] / scale), round(case.box[1] / scale))
    size, terminal = case.diameter * np.asarray(case.box), terminal_speed(case)
    number, velocity = in_cells(particles["position"][:, :2], particles["velocity"][:, 1], size, cells)
    void = over_cells(fluid["void_fraction"], cells)
    gas = over_cells(fluid["void_fraction"] * fluid["velocity"][..., 1], cells) / void
    mean = float((number * velocity).sum() / number.sum())
    return {
        "solids": float(np.var(number / number.mean())),
        "grains": float((number * (velocity - mean) ** 2).sum() / number.sum()) / terminal**2,
        "gas": float(np.average((gas - np.average(gas, weights=void)) ** 2, weights=void)) / terminal**2,
    }


def in_cells(
    position: np.ndarray, value: np.ndarray, size: np.ndarray, cells: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Number of particles in each cell of a periodic box, each in that of its centre, and the mean of their values,
    0 where there are none; both of the shape `cells`.

    Args:
        position: (N, 2) [m].
        value: (N,).
        size: (2,) of the box [m].
        cells: along either axis.
    """
    index = np.minimum((np.mod(position, size) / size * cells).astype(int), np.asarray(cells) - 1)
    flat, total = np.ravel_multi_index(tuple(index.T), cells), math.prod(cells)
    number = np.bincount(flat, minlength=total).astype(float)
    mean = np.bincount(flat, value, total) / np.maximum(number, 1.0)
    return number.reshape(cells), mean.reshape(cells)


def over_cells(field: np.ndarray, cells: tuple[int, int]) -> np.ndarray:
    """Mean of a field of cells over the cells of another mesh of the box; a finer one repeats the values."""
    if field.shape[0] < cells[0]:
        return np.kron(field, np.ones([fine // coarse for fine, coarse in zip(cells, field.shape, strict=True)]))
    box = (1.0, 1.0), 1.0, (True, True)
    return remap_cells(Grid(field.shape, *box), Grid(cells, *box), field.astype(float))

"""Errors of runs against the fine run, and over the noise of it; until the grains reach the screen."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from jaxdem import metrics
from jaxdem.errors import required
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.remap import remap_cells
from jaxdem.io import Run
from jaxdem.report.runs import history_until

NAMES = tuple(metric.name for metric in metrics.METRICS)

SCREEN = 1.0 / 24.0
"""Part of the box's length before the outlet where grains meet the screen, and from which on nothing is compared."""

History = Mapping[str, np.ndarray]


def screen_time(run: Run) -> float | None:
    """When the run's front comes within `SCREEN` of an outlet on the right; None where it does not.

    The rule of the study: all metrics are compared up to the last output before the reference's front, its run-off,
    passes this place (11.5 m in a box of 12 m), whatever the other run does.
    """
    sides = run.scene.get("boundary", {})
    if sides.get("right", {}).get("kind") != "outlet" or sides["right"].get("particles") == "remove":
        return None
    place = float(run.scene["domain"]["size"][0]) * (1.0 - SCREEN)
    passed = np.flatnonzero(np.asarray(run.history["runoff"]) > place)
    return float(run.history["time"][max(0, passed[0] - 1)]) if len(passed) else None


def whole(runs: Iterable[Run], reference: Run | None) -> list[Run]:
    """Those that go as far as the reference: others end with what is compared. All without a reference."""
    end = -math.inf if reference is None else float(reference.history["time"][-1])
    return [run for run in runs if float(run.history["time"][-1]) >= end]


def errors(run: Run, reference: Run) -> dict[str, float]:
    """Error of every metric, int |m - m_ref| dt / int |m_ref| dt up to the screen time [-]."""
    until = screen_time(reference)
    return metrics.errors(history_until(run, until), history_until(reference, until))


def mean_errors(several: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Mean over runs of the error of every metric; NaN without runs."""
    if not several:
        return dict.fromkeys(NAMES, math.nan)
    return {name: float(np.mean([one[name] for one in several])) for name in NAMES}


def noise_floor(reference: Run, jittered: Sequence[Run]) -> dict[str, float]:
    """Mean error against the reference of runs that differ in the jitter of the pack alone."""
    return mean_errors([errors(run, reference) for run in jittered])


def over(error: Mapping[str, float], floor: Mapping[str, float]) -> dict[str, float]:
    """Error over noise, metric by metric [-]; NaN without a floor."""
    return {n: error[n] / floor[n] if floor[n] > 0.0 else math.nan for n in NAMES if n in error}


def mean_over(error: Mapping[str, float], floor: Mapping[str, float]) -> float:
    """Mean error over mean noise [-], as `jaxdem compare` has it; NaN without a floor.

    Not the mean of the ratios, which belongs to whatever metric has the least noise.
    """
    noise = mean(floor)
    return mean({name: error[name] for name in floor}) / noise if noise > 0.0 else math.nan


def mean(values: Mapping[str, float]) -> float:
    """Mean of those that are finite; NaN without any."""
    finite = [value for value in values.values() if math.isfinite(value)]
    return float(np.mean(finite)) if finite else math.nan


def labelled(values: Mapping[str, float], unit: float = 1.0) -> dict[str, float]:
    """Values over a unit by the labels of the metrics; NaN for those that are missing."""
    return {metric.label: values.get(metric.name, math.nan) / unit for metric in metrics.METRICS}


def band(values: Sequence[float]) -> str | float | None:
    """Mean and range of several values, one value as it is, None without any."""
    if len(values) < 2:
        return values[0] if values else None
    return f"{np.mean(values):.3g} ({min(values):.3g} to {max(values):.3g})"


PERCENT = 0.01


def grid_of(run: Run) -> Grid:
    """The run's grid; its sides do not matter for averages."""
    domain = run.scene["domain"]
    size, cells = tuple(domain["size"]), tuple(run.scene["fluid"]["cells"])
    depth = float(domain.get("depth", 1.0)) if len(size) == 2 else 1.0
    return Grid(cells, size, depth, (False,) * len(size))


def flux_error(
    times: np.ndarray, velocity: Iterable[np.ndarray], void_fraction: Iterable[np.ndarray], reference: Run
) -> float:
    """Error of the field g u on a coarse mesh against the reference's, averaged to that mesh [-].

    sqrt( sum_t sum_c |g u - <g u>_ref|^2 / sum_t sum_c |<g u>_ref|^2 ), over the output times that both have up to
    the reference's screen time.

    Args:
        times: (T,) of the fields [s].
        velocity: T arrays (cells..., D) interstitial, at the centres [m/s].
        void_fraction: T arrays (cells...) [-].
        reference: fine run.
    """
    until, wrong, whole = screen_time(reference), 0.0, 0.0
    own = np.asarray(reference.times, float)
    for time, u, g in zip(times, velocity, void_fraction, strict=True):
        index = int(np.argmin(np.abs(own - time)))
        if abs(own[index] - time) > 1e-6 or (until is not None and time > until) or time == 0.0:
            continue
        for axis, mean_flux in enumerate(averaged(reference, index, g.shape)[0]):
            wrong += float(np.sum((g * u[..., axis] - mean_flux) ** 2))
            whole += float(np.sum(mean_flux**2))
    return math.sqrt(wrong / whole) if whole > 0.0 else math.nan


def averaged(run: Run, index: int, cells: tuple[int, ...]) -> tuple[list[np.ndarray], np.ndarray]:
    """Flux g u, D arrays (cells...) [m/s], and void fraction (cells...) of an output, averaged to a coarser mesh."""
    fine, frame = grid_of(run), fluid_frame(run, index)
    coarse, void_fraction = dataclasses.replace(fine, cells=cells), np.asarray(frame["void_fraction"], float)
    flux = [void_fraction * np.asarray(frame["velocity"][..., axis], float) for axis in range(fine.dimension)]
    return [remap_cells(fine, coarse, f) for f in flux], remap_cells(fine, coarse, void_fraction)


def peak_speed(run: Run, until: float | None, cells: tuple[int, ...] | None = None) -> float:
    """Mean over the outputs after the first, up to a time, of the largest flux |g u| / g of a cell [m/s].

    Args:
        run: the run.
        until: the time [s]; None for all.
        cells: of a coarser mesh, to which the fields are averaged before.
    """
    peaks = []
    for index, time in enumerate(run.times):
        if time > 0.0 and (until is None or time <= until):
            flux, void_fraction = averaged(run, index, cells or grid_of(run).cells)
            peaks.append(float(np.max(np.sqrt(sum(f**2 for f in flux)) / void_fraction)))
    return float(np.mean(peaks))


def run_flux_error(run: Run, reference: Run) -> float:
    """`flux_error` of a run, on its own mesh, which is the reference's or coarser."""
    frames = [fluid_frame(run, index) for index in range(run.number_of_frames)]
    velocity = [np.asarray(frame["velocity"], float) for frame in frames]
    void_fraction = [np.asarray(frame["void_fraction"], float) for frame in frames]
    return flux_error(np.asarray(run.times, float), velocity, void_fraction, reference)


def fluid_frame(run: Run, index: int) -> dict[str, np.ndarray]:
    """Fluid fields of an output of a run that has a fluid."""
    return required(run.fluid(index), "fluid")

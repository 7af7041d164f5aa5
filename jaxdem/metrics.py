"""The observables of a run, each defined once: nine metrics, and the error of one history against another.

Host side and numpy only, so that a comparison on another machine needs no accelerator. Everything is summed in
float64 whatever the precision of the run. Particle arrays here have the solver's D components (the last one is the
vertical), not the three components that the run directory stores.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxdem.errors import InputError

Array = NDArray[np.float64]

PERCENTILE = 99.9
"""Run-off and height are this percentile of the centres' coordinates: one stray grain does not make the front."""


class Metric(NamedTuple):
    """Name (the column of history.csv), SI unit and axis label of one metric."""

    name: str
    unit: str
    label: str


METRICS: tuple[Metric, ...] = (
    Metric("drag_force_mean", "N", "mean drag force"),
    Metric("particle_velocity_mean", "m/s", "mean particle speed"),
    Metric("collision_force_mean", "N", "mean collision force"),
    Metric("kinetic_energy", "J", "kinetic energy"),
    Metric("runoff", "m", "run-off"),
    Metric("height", "m", "height"),
    Metric("fluid_pressure_mean", "Pa", "mean fluid pressure"),
    Metric("fluid_velocity_mean", "m/s", "mean fluid speed"),
    Metric("fluid_velocity_median", "m/s", "median fluid speed"),
)

HISTORY_COLUMNS: tuple[str, ...] = ("time", *(metric.name for metric in METRICS))
"""Columns of history.csv, in order."""


def _norm_mean(vectors: ArrayLike) -> float:
    """Mean over the leading axes of the length of vectors (..., C); NaN where there are none."""
    array = np.asarray(vectors, dtype=np.float64)
    return float(np.linalg.norm(array, axis=-1).mean()) if array.size else float("nan")


def drag_force_mean(drag_force: ArrayLike) -> float:
    """Mean over particles of the size of the drag force (N, D), sum_i |F_i| / N [N]."""
    return _norm_mean(drag_force)


def particle_velocity_mean(velocity: ArrayLike) -> float:
    """Mean speed of the particles of a velocity (N, D), sum_i |v_i| / N [m/s]."""
    return _norm_mean(velocity)


def collision_force_mean(interval_average: float | None) -> float:
    """Mean over particles and contact steps since the last output of |sum of contact forces, walls included| [N].

    A force that lives for one contact in a thousand steps is not seen at output times, so the time loop accumulates
    it and this function passes the average through.

    Args:
        interval_average: what the time loop accumulated [N]; None where there are no contacts to speak of.
    """
    return float("nan") if interval_average is None else float(interval_average)


def kinetic_energy(
    velocity: ArrayLike,
    mass: ArrayLike,
    angular_velocity: ArrayLike | None = None,
    inertia: ArrayLike | None = None,
) -> float:
    """Translation and rotation, sum_i m_i |v_i|^2 / 2 + I_i |w_i|^2 / 2 [J].

    Args:
        velocity: (N, D) [m/s].
        mass: (N,) or one number [kg].
        angular_velocity: (N,), (N, 1) or (N, 3) [rad/s]; without it, translation only.
        inertia: (N,) or one number [kg m2]; needed with `angular_velocity`.

    Raises:
        InputError: an angular velocity without an inertia.
    """
    v = np.asarray(velocity, dtype=np.float64)
    if not v.size:
        return float("nan")
    energy = 0.5 * float(np.sum(np.asarray(mass, dtype=np.float64) * np.sum(v * v, axis=-1)))
    if angular_velocity is None:
        return energy
    if inertia is None:
        raise InputError("inertia", None, "is needed with an angular velocity", "Give the moment of inertia [kg m2].")
    w = np.asarray(angular_velocity, dtype=np.float64).reshape(len(v), -1)
    return energy + 0.5 * float(np.sum(np.asarray(inertia, dtype=np.float64) * np.sum(w * w, axis=-1)))


def _front(position: ArrayLike, axis: int) -> float:
    array = np.asarray(position, dtype=np.float64)
    return float(np.percentile(array[:, axis], PERCENTILE)) if array.size else float("nan")


def runoff(position: ArrayLike) -> float:
    """How far the particles have come: 99.9th percentile (linear interpolation) of the x of the centres (N, D) [m]."""
    return _front(position, 0)


def height(position: ArrayLike) -> float:
    """How high the particles reach: as `runoff`, of the last coordinate of the centres, which is the vertical [m]."""
    return _front(position, -1)


def fluid_pressure_mean(pressure: ArrayLike) -> float:
    """Volume mean of the reduced pressure p - rho g x, which is zero at the outlet, of cells of one size [Pa]."""
    array = np.asarray(pressure, dtype=np.float64)
    return float(array.mean()) if array.size else float("nan")


def fluid_velocity_mean(velocity: ArrayLike) -> float:
    """Volume mean of |u|, u interstitial, at the centres of cells of one size, (cells..., D) [m/s]."""
    return _norm_mean(velocity)


def fluid_velocity_median(velocity: ArrayLike) -> float:
    """Median over the volume of |u|, as `fluid_velocity_mean` [m/s]."""
    array = np.asarray(velocity, dtype=np.float64)
    return float(np.median(np.linalg.norm(array, axis=-1))) if array.size else float("nan")


class Quantities(NamedTuple):
    """What the metrics of a moment are made of; None for what does not exist.

    Attributes:
        position: of the particles (N, D) [m].
        velocity: (N, D) [m/s].
        mass: (N,) or one number [kg].
        angular_velocity: (N,), (N, 1) or (N, 3) [rad/s].
        inertia: (N,) or one number [kg m2].
        drag_force: (N, D) [N].
        collision_force: interval average from the time loop [N].
        fluid_pressure: reduced (cells...) [Pa].
        fluid_velocity: interstitial at cell centres (cells..., D) [m/s].
    """

    position: ArrayLike | None = None
    velocity: ArrayLike | None = None
    mass: ArrayLike | None = None
    angular_velocity: ArrayLike | None = None
    inertia: ArrayLike | None = None
    drag_force: ArrayLike | None = None
    collision_force: float | None = None
    fluid_pressure: ArrayLike | None = None
    fluid_velocity: ArrayLike | None = None


def history_row(time: float, given: Quantities) -> dict[str, float]:
    """One row of history.csv: the time and the nine metrics; what does not exist is NaN.

    Args:
        time: simulated time [s].
        given: at that time.
    """
    row = dict.fromkeys(HISTORY_COLUMNS, float("nan"))
    row["time"] = float(time)
    row["collision_force_mean"] = collision_force_mean(given.collision_force)
    if given.drag_force is not None:
        row["drag_force_mean"] = drag_force_mean(given.drag_force)
    if given.velocity is not None:
        row["particle_velocity_mean"] = particle_velocity_mean(given.velocity)
        if given.mass is not None:
            row["kinetic_energy"] = kinetic_energy(given.velocity, given.mass, given.angular_velocity, given.inertia)
    if given.position is not None:
        row["runoff"], row["height"] = runoff(given.position), height(given.position)
    if given.fluid_pressure is not None:
        row["fluid_pressure_mean"] = fluid_pressure_mean(given.fluid_pressure)
    if given.fluid_velocity is not None:
        row["fluid_velocity_mean"] = fluid_velocity_mean(given.fluid_velocity)
        row["fluid_velocity_median"] = fluid_velocity_median(given.fluid_velocity)
    return row


def _finite_part(times: ArrayLike, values: ArrayLike, key: str) -> tuple[Array, Array]:
    """The samples from the first finite value to the last before another that is not; times strictly increasing."""
    t, m = np.asarray(times, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if t.ndim != 1 or t.shape != m.shape:
        raise InputError(
            key, (t.shape, m.shape), "times and values must have one length", "Give both with the shape (T,)."
        )
    if np.any(~(np.diff(t) > 0.0)):
        raise InputError(key, "times", "must increase strictly", "Look for repeated or unsorted rows in history.csv.")
    good = np.isfinite(m)
    if not good.any():
        return t[:0], m[:0]
    first = int(np.argmax(good))
    bad = np.flatnonzero(~good[first:])
    last = first + int(bad[0]) if bad.size else len(t)
    return t[first:last], m[first:last]


def relative_error(
    times: ArrayLike, values: ArrayLike, reference_times: ArrayLike, reference_values: ArrayLike
) -> float:
    """How far a metric is from the reference's, e = int |m - m_ref| dt / int |m_ref| dt [-].

    Both integrals run over the span that the two histories share, by the trapezoidal rule on all output times of
    both, with linear interpolation between them. A history counts from its first finite value up to the first one
    after it that is not finite.

    Args:
        times: of the run's history (T,) [s].
        values: (T,) in the metric's unit.
        reference_times: of the reference's history (S,) [s].
        reference_values: (S,).

    Returns:
        The error; NaN where either history has no finite value or they share no span of time. Where the integral of
        the reference is zero, 0.0 if the run's is zero as well, and infinity if not.

    Raises:
        InputError: lists of different length, or times that do not increase strictly.
    """
    t, m = _finite_part(times, values, "history")
    t_ref, m_ref = _finite_part(reference_times, reference_values, "reference history")
    if not len(t) or not len(t_ref):
        return float("nan")
    start, end = max(t[0], t_ref[0]), min(t[-1], t_ref[-1])
    if not end > start:
        return float("nan")
    grid = np.union1d(t, t_ref)
    grid = grid[(grid >= start) & (grid <= end)]
    reference = np.interp(grid, t_ref, m_ref)
    difference = float(np.trapezoid(np.abs(np.interp(grid, t, m) - reference), grid))
    scale = float(np.trapezoid(np.abs(reference), grid))
    if scale > 0.0:
        return difference / scale
    return 0.0 if difference == 0.0 else float("inf")


def errors(history: Mapping[str, ArrayLike], reference_history: Mapping[str, ArrayLike]) -> dict[str, float]:
    """`relative_error` of each of the nine metrics [-]; NaN where either history lacks the column.

    Args:
        history, reference_history: columns of history.csv by name, each (T,); `time` is needed.
    """
    result = dict.fromkeys((metric.name for metric in METRICS), float("nan"))
    for name in result.keys() & history.keys() & reference_history.keys():
        reference = reference_history["time"], reference_history[name]
        result[name] = relative_error(history["time"], history[name], *reference)
    return result


def compile_time(summary: Mapping[str, Any]) -> float:
    """What a run spent on tracing, compiling and loading programs from the cache [s]; NaN where not recorded.

    Args:
        summary: content of a run's summary.json.
    """
    stages = summary.get("stages_s")
    return _seconds(stages.get("compile") if isinstance(stages, Mapping) else None)


def run_time(summary: Mapping[str, Any]) -> float:
    """Run time: wall time of the time loop without `compile_time` [s]; NaN where either is not recorded.

    Whether a program was in the cache does not change it, so run times of two runs compare.
    """
    return _seconds(summary.get("wall_time_s")) - compile_time(summary)


def _seconds(value: object) -> float:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else float("nan")


def pareto_front(
    cost: ArrayLike, error: ArrayLike, cost_noise: float = 0.0, error_noise: float = 0.0
) -> NDArray[np.bool_]:
    """The cheapest point, and each dearer one that errs less than all points before it: the points that no other beats.

    Any two of them differ by more than the noise, in cost and in error. Of points that cannot be told apart in either
    the cheapest is taken; one that costs the same within the noise and clearly errs less takes its place.

    Args:
        cost: (P,), e.g. run time [s]; a point with a value that is not finite is never on the front.
        error: (P,), e.g. relative error [-].
        cost_noise: relative difference of two costs that means nothing [-].
        error_noise: difference of two errors that means nothing, in the unit of `error`.

    Returns:
        (P,) bool; two points that are equal to the last digit are both on the front or both not.
    """
    c, e = np.asarray(cost, dtype=np.float64), np.asarray(error, dtype=np.float64)
    candidates = np.flatnonzero(np.isfinite(c) & np.isfinite(e))
    chosen: list[int] = []
    for i in candidates[np.lexsort((e[candidates], c[candidates]))]:
        if chosen and not e[i] < e[chosen[-1]] - error_noise:
            continue
        if chosen and c[i] <= c[chosen[-1]] * (1.0 + cost_noise):
            chosen.pop()
        chosen.append(int(i))
    front = np.zeros(c.shape, bool)
    for i in chosen:
        front |= (c == c[i]) & (e == e[i])
    return front

"""The nine metrics against hand-computed values, and the error against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from jaxdem import metrics
from jaxdem.errors import InputError
from jaxdem.metrics import Quantities

COLUMNS = (
    "time,drag_force_mean,particle_velocity_mean,collision_force_mean,kinetic_energy,runoff,height,"
    "fluid_pressure_mean,fluid_velocity_mean,fluid_velocity_median"
)


def test_columns_are_the_contract() -> None:
    assert ",".join(metrics.HISTORY_COLUMNS) == COLUMNS
    assert ",".join(metrics.history_row(0.0, Quantities())) == COLUMNS
    assert len(metrics.METRICS) == 9


def test_means_of_lengths() -> None:
    vectors = np.array([[3.0, 4.0], [0.0, 1.0]])
    assert metrics.drag_force_mean(vectors) == 3.0
    assert metrics.particle_velocity_mean(vectors) == 3.0
    assert metrics.fluid_velocity_mean(vectors.reshape(1, 2, 2)) == 3.0
    speeds = np.array([1.0, 2.0, 9.0])
    assert metrics.fluid_velocity_median(np.stack([speeds, 0 * speeds], -1)) == 2.0
    assert metrics.fluid_pressure_mean([[1.0, -3.0]]) == -1.0


def test_kinetic_energy() -> None:
    velocity = np.array([[1.0, 0.0], [0.0, 2.0]])
    assert metrics.kinetic_energy(velocity, 2.0) == pytest.approx(5.0)
    assert metrics.kinetic_energy(velocity, [2.0, 1.0]) == pytest.approx(3.0)
    assert metrics.kinetic_energy(velocity, 2.0, [1.0, 3.0], 0.2) == pytest.approx(6.0)
    spin = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 3.0]])
    assert metrics.kinetic_energy(velocity, 2.0, spin, [0.2, 0.2]) == pytest.approx(6.0)
    with pytest.raises(InputError, match="inertia"):
        metrics.kinetic_energy(velocity, 2.0, spin)


def test_percentile_interpolates_and_takes_the_last_axis() -> None:
    x = np.linspace(0.0, 1.0, 1001)
    position = np.stack([x, np.full_like(x, 7.0), 2.0 * x], -1)
    assert metrics.runoff(position) == pytest.approx(0.999)
    assert metrics.height(position) == pytest.approx(1.998)
    assert metrics.height(position[:11, ::2]) == pytest.approx(2 * 0.00999)


def test_float32_input_is_summed_in_float64() -> None:
    pressure = np.full(3_000_000, 0.1, np.float32)
    assert metrics.fluid_pressure_mean(pressure) == pytest.approx(float(np.float32(0.1)), rel=1e-12)


def test_missing_parts_are_nan() -> None:
    moving = Quantities(position=np.ones((2, 2)), velocity=np.ones((2, 2)), mass=1.0, collision_force=4.0)
    particles = metrics.history_row(1.5, moving)
    assert particles["time"] == 1.5 and particles["collision_force_mean"] == 4.0 and particles["runoff"] == 1.0
    assert particles["kinetic_energy"] == pytest.approx(2.0)
    assert all(np.isnan(particles[k]) for k in ("drag_force_mean", "fluid_pressure_mean", "fluid_velocity_median"))
    stream = Quantities(fluid_pressure=np.ones((2, 2)), fluid_velocity=np.ones((2, 2, 2)))
    fluid = metrics.history_row(0.0, stream)
    assert fluid["fluid_velocity_mean"] == pytest.approx(2**0.5)
    assert all(np.isnan(fluid[k]) for k in ("runoff", "height", "kinetic_energy", "collision_force_mean"))
    nothing = Quantities(position=np.ones((0, 2)), velocity=np.ones((0, 2)), mass=1.0)
    empty = metrics.history_row(0.0, nothing)
    assert np.isnan(empty["runoff"]) and np.isnan(empty["kinetic_energy"])


def test_error_of_a_constant_factor_and_of_an_offset() -> None:
    t = np.linspace(0.0, 2.0, 21)
    assert metrics.relative_error(t, 1.25 * np.sin(t), t, np.sin(t)) == pytest.approx(0.25)
    assert metrics.relative_error(t, -t, t, t) == pytest.approx(2.0)
    assert metrics.relative_error(t, t + 0.5, t, t) == pytest.approx(0.5 * 2.0 / 2.0)
    assert metrics.relative_error(t, t, t, t) == 0.0


def test_error_on_different_grids_and_spans() -> None:
    coarse, fine = np.array([0.0, 1.0, 2.0, 3.0]), np.linspace(0.5, 2.5, 17)
    assert metrics.relative_error(coarse, 2 * coarse, fine, 2 * fine) == pytest.approx(0.0, abs=1e-15)
    # over [0.5, 2.5]: int 1 dt / int t dt = 2 / 3
    assert metrics.relative_error(coarse, coarse + 1, fine, fine) == pytest.approx(2.0 / 3.0)
    assert np.isnan(metrics.relative_error(coarse, coarse, coarse + 3.0, coarse))
    assert np.isnan(metrics.relative_error([0.0], [1.0], coarse, coarse))


def test_error_sees_only_the_finite_part() -> None:
    t = np.arange(6.0)
    broken = np.array([np.nan, 2.0, 2.0, 2.0, np.inf, 9.0])
    assert metrics.relative_error(t, broken, t, np.ones(6)) == pytest.approx(1.0)
    assert np.isnan(metrics.relative_error(t, np.full(6, np.nan), t, np.ones(6)))


def test_error_of_a_reference_that_is_zero() -> None:
    t = np.arange(3.0)
    assert metrics.relative_error(t, 0 * t, t, 0 * t) == 0.0
    assert metrics.relative_error(t, 1 + t, t, 0 * t) == float("inf")


def test_unsorted_times_are_refused() -> None:
    with pytest.raises(InputError, match="increase strictly"):
        metrics.relative_error([0.0, 1.0, 1.0], [1, 1, 1], [0.0, 1.0], [1, 1])
    with pytest.raises(InputError, match="one length"):
        metrics.relative_error([0.0, 1.0], [1, 1, 1], [0.0, 1.0], [1, 1])


def test_errors_by_metric() -> None:
    t = np.arange(4.0)
    reference = {"time": t, "runoff": 1 + t, "height": 1 + t}
    result = metrics.errors({"time": t, "runoff": 1.1 * (1 + t)}, reference)
    assert list(result) == [metric.name for metric in metrics.METRICS]
    assert result["runoff"] == pytest.approx(0.1) and np.isnan(result["height"])


def test_pareto_front() -> None:
    cost = [1.0, 2.0, 3.0, 3.0, 2.5, np.nan, 0.5]
    error = [0.5, 0.3, 0.1, 0.2, 0.4, 0.0, np.inf]
    assert metrics.pareto_front(cost, error).tolist() == [True, True, True, False, False, False, False]
    assert metrics.pareto_front([1.0, 1.0], [2.0, 2.0]).tolist() == [True, True]
    assert metrics.pareto_front([], []).tolist() == []


def test_points_of_a_front_differ_by_more_than_the_noise() -> None:
    """A chain whose neighbours are within the noise, and whose ends are not; and runs of one cost but for noise."""
    cost, error = [1.0, 2.0, 3.0, 4.0], [10.0, 9.5, 9.0, 8.5]
    assert metrics.pareto_front(cost, error, error_noise=0.6).tolist() == [True, False, True, False]
    assert metrics.pareto_front([5.8, 1.9, 2.0], [5.1, 5.3, 5.2], 0.1, 0.9).tolist() == [False, True, False]
    assert metrics.pareto_front([1.0, 1.05], [10.0, 5.0], 0.1, 0.9).tolist() == [False, True]
    rng = np.random.default_rng(0)
    for _ in range(50):
        cost, error = rng.uniform(1.0, 4.0, 12), rng.uniform(0.0, 1.0, 12)
        front = np.flatnonzero(metrics.pareto_front(cost, error, 0.1, 0.15))
        order = front[np.argsort(cost[front])]
        assert np.all(cost[order[1:]] > 1.1 * cost[order[:-1]])
        assert np.all(error[order[1:]] < error[order[:-1]] - 0.15)
        assert len(front) and min(error) >= min(error[front]) - 0.15

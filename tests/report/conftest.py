"""Fake runs with the API of `jaxdem.io.Run`: a pack that collapses under a jet, errors growing with the cell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jaxdem.metrics import METRICS
from jaxdem.report import style


class FakeProbes(dict[str, dict[str, np.ndarray]]):
    """Tables of probes by name."""

    def units(self, name: str) -> dict[str, str]:
        return {"time": "s", "z": "m", "force_x": "N", "force_z": "N", "solid_fraction": "-", "fluid_pressure": "Pa"}


STORES = ("translation", "rotation", "potential", "normal", "tangential", "rolling", "surface", "bonds")


@dataclass
class FakeRun:
    """What the report reads of a run."""

    path: Path
    summary: dict[str, Any]
    scene: dict[str, Any]
    history: dict[str, np.ndarray]
    times: np.ndarray
    dimension: int = 2
    count: int = 200
    radius: float = 0.01
    seed: int = 0
    calls: list[int] = field(default_factory=list)
    probes: FakeProbes = field(default_factory=FakeProbes)

    @property
    def number_of_frames(self) -> int:
        return len(self.times)

    def particles(self, i: int) -> dict[str, np.ndarray] | None:
        if not self.count:
            return None
        self.calls.append(i)
        size = self.scene["domain"]["size"]
        columns = max(1, int(np.sqrt(self.count)))
        index = np.arange(self.count)
        rng = np.random.default_rng(self.seed)
        x = 0.5 + 2.05 * self.radius * (index % columns)
        z = self.radius + 2.05 * self.radius * (index // columns)
        x = x + self.times[i] * (0.6 + 0.8 * z) + 0.2 * self.radius * rng.standard_normal(self.count)
        z = np.maximum(self.radius, z * np.exp(-0.3 * self.times[i]))
        position = np.zeros((self.count, 3))
        position[:, 0], position[:, self.dimension - 1] = x, z
        if self.dimension == 3:
            position[:, 1] = rng.uniform(0, size[1], self.count)
        velocity, drag = np.zeros((2, self.count, 3))
        velocity[:, 0], drag[:, 0] = 0.6 + 0.8 * z, 1e-3 * index
        return {
            "position": position,
            "velocity": velocity,
            "drag_force": drag,
            "radius": np.full(self.count, self.radius),
            "id": index,
        }

    def spheres(self, i: int) -> dict[str, np.ndarray] | None:
        """Spheres touch themselves: they are no clumps."""
        return self.particles(i)

    def fluid(self, i: int) -> dict[str, np.ndarray] | None:
        cells = self.scene.get("fluid", {}).get("cells")
        if cells is None:
            return None
        axes = [(np.arange(n) + 0.5) / n for n in cells]
        grid = np.meshgrid(*axes, indexing="ij")
        velocity = np.zeros((*cells, 3))
        velocity[..., 0] = 3.0 * np.exp(-8 * (grid[-1] - 0.2 - 0.1 * np.sin(6 * grid[0] - self.times[i])) ** 2)
        return {"velocity": velocity, "pressure": np.zeros(cells), "void_fraction": np.ones(cells)}


def make_run(
    name: str = "run",
    *,
    cells: tuple[int, ...] | None = (75, 12),
    factor: float = 1.0,
    end: float = 2.0,
    planned: float = 2.0,
    outputs: int = 21,
    wall: float | None = 10.0,
    closure: str = "",
    valid: bool = True,
    size: tuple[float, ...] = (12.0, 2.0),
    count: int = 200,
    device: str = "cpu",
    radius: float = 0.01,
    seed: int = 0,
) -> FakeRun:
    """A run whose every metric is `factor` times the reference's (1 + t)^p."""
    times = np.linspace(0.0, end, outputs)
    history = {"time": times}
    for i, metric in enumerate(METRICS):
        history[metric.name] = factor * (1 + 0.3 * i) * (1 + times) ** (0.5 - 0.2 * i)
        if (metric.name.startswith("fluid") or metric.name.startswith("drag")) and cells is None:
            history[metric.name] = np.full(outputs, np.nan)
    summary: dict[str, Any] = {
        "valid": valid,
        "reason": "" if valid else "CFL exceeded in cell (3, 4)",
        "precision": "float32",
        "device": device,
        "versions": {"jaxdem": "0.1.0", "jax": "0.9"},
        "time_steps": {"contact": 2e-4, "fluid": 0.01},
        "counts": {"particles": count},
        "closure": {"file": closure or None, "out_of_range_fraction": 0.02 if closure else None},
        "residuals": {"mass": 1e-7, "momentum": 2e-6},
        "energy": {"start": dict.fromkeys(STORES, 1.0), "end": dict.fromkeys(STORES, 0.5), "taken": 4.0,
                   "taken_by": ["contacts", "fluid"], "remark": ""},
    }  # fmt: skip
    if wall is not None:
        summary["wall_time_s"] = wall + 3.0
        summary["stages_s"] = {"compile": 3.0}
    scene: dict[str, Any] = {
        "domain": {"size": list(size)},
        "particles": {"count": count, "radius": radius},
        "coupling": {"drag": "koch_hill"},
        "time": {"end": planned},
    }
    if cells is not None:
        scene["fluid"] = {"cells": list(cells)}
    if closure:
        scene["closure"] = {"file": closure}
    return FakeRun(Path("/runs") / name, summary, scene, history, times, len(size), count, radius, seed)


@pytest.fixture
def make() -> Callable[..., FakeRun]:
    """The maker of fake runs."""
    return make_run


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """PNG files of few pixels: the tests look at what is drawn, not at how fine."""
    monkeypatch.setattr(style, "MAX_PIXELS", 500)

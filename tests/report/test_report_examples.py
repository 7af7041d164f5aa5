"""Pictures of the examples, of runs that are made up; what is saved is read as drawn (tests/conftest.py)."""

from __future__ import annotations

import copy
import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import jaxdem

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Loads an example by its name; what it imports from its folder is found."""
    monkeypatch.syspath_prepend(EXAMPLES)

    def load(name: str) -> Any:
        spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return load


@pytest.mark.parametrize(
    ("name", "size", "frames"),
    [
        ("column_collapse", (0.9, 0.36), (0, 1, 2)),
        ("settling", (0.4, 0.6), (0, 1, 2, 3)),
        ("injection", (4.0, 0.8), (0, 1, 2, 3)),
    ],
)
def test_frames_of_a_run(
    example: Any, make: Any, tmp_path: Path, name: str, size: tuple[float, ...], frames: tuple[int, ...]
) -> None:
    cells = None if name == "column_collapse" else (20, 10)
    figure = example(name).picture(make(size=size, cells=cells, outputs=4, radius=0.004), frames)
    figure.savefig(tmp_path / "picture.png")


def test_a_fluidised_bed(example: Any, make: Any, tmp_path: Path) -> None:
    run, velocity = (
        make(size=(0.072, 0.216), cells=(6, 18), outputs=3, radius=0.002),
        np.linspace(0.004, 0.028, 30),
    )
    figure = example("fluidised_bed").picture(run, velocity, 40.0 * velocity, 60.0 * velocity, (0, 1, 2))
    figure.savefig(tmp_path / "picture.png")


def test_a_trained_closure(example: Any, tmp_path: Path) -> None:
    target = np.random.default_rng(0).normal(0.05, 0.03, 500)
    held_out = {"target": target, "base": 0.9 * target, "predicted": target}
    times = np.linspace(0.0, 0.6, 13)
    histories = {name: (times, 0.1 * times) for name in ("fine", "2x coarser", "with the closure")}
    figure = example("train_closure").picture(held_out, {"base": 0.9, "closure": 1.0}, histories)
    figure.savefig(tmp_path / "picture.png")


def test_grains_in_the_fluid_of_another_solver(example: Any, tmp_path: Path) -> None:
    """Pressure and bottom carry the weight of a small fluidised bed, on the mean of its last half."""
    module = example("external_solver")
    tables = copy.deepcopy(module.SCENE)
    tables["domain"]["size"], tables["fluid"]["cells"] = [0.02, 0.06], [5, 15]
    tables["particles"] |= {"count": 60, "pack": tables["particles"]["pack"] | {"stop": [0.02, 0.04]}}
    scene = jaxdem.load_scene(tables)
    seen, particles, water = module.coupled(scene, 0.4)
    weight = module.submerged_weight(scene)
    drop, carried, _ = seen[len(seen) // 2 :].mean(axis=0)
    # The pressure on the bottom comes from a line through two cells, of a bed of four.
    assert drop * 0.02 * 0.002 / weight + carried / weight == pytest.approx(1.0, abs=0.03)
    assert carried < 0.1 * weight
    module.picture(seen[:, :2], seen[:, :2], particles, water).savefig(tmp_path / "picture.png")

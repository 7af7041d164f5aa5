"""A run of the scene `clusters` on another mesh, with other grains, parcels or drag, and what is measured in it."""

from __future__ import annotations

import dataclasses
import json
import math
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import jaxdem
from benchmarks import harness
from jaxdem.closures import DragClosure, WenYu
from jaxdem.io import Run
from jaxdem.scene import Scene

SCENE = Path(__file__).parents[1] / "scenes" / "clusters.toml"
GRAVITY, GRAIN_DENSITY, DENSITY, VISCOSITY = 9.81, 1500.0, 1.3, 1.38e-5
"""Of the scene [m/s2], [kg/m3], [kg/m3], [m2/s]."""
MODULUS = 2e4
"""Of the runs, softer than in the scene: the contact step is longer [Pa]."""
RELAXATION = 0.022
"""Time in which frames follow each other, one relaxation time of the scene's grain [s]."""


@dataclasses.dataclass(frozen=True)
class Case:
    """A run.

    Attributes:
        solid_fraction: mean of the box [-].
        cell: side of the fluid's cells, in diameters.
        seed: of the places of the grains at the start.
        closure: name of what takes the place of the drag law; empty for the law of Wen and Yu.
        parcel: l of `particles.coarse_grain`.
        box: width and height, in diameters.
        diameter: of a grain [m].
        times: relaxation times that the run takes.
        step: fluid step and coupling interval [s].
        samples: relaxation times between samples for training, 0 for none; a tenth where runs are nudged to it.
        changes: further keys of the scene, as pairs.
        name: of the run's folder, where the attributes above do not tell it from others.
    """

    solid_fraction: float = 0.05
    cell: float = 3.0
    seed: int = 0
    closure: str = ""
    parcel: int = 1
    box: tuple[int, int] = (96, 192)
    diameter: float = 75e-6
    times: int = 40
    step: float = 2e-4
    samples: float = 0.0
    changes: tuple[tuple[str, Any], ...] = ()
    name: str = ""

    @property
    def folder(self) -> str:
        """Name of the run's folder."""
        parts = [f"s{self.solid_fraction:g}", f"c{self.cell:g}", self.closure, f"l{self.parcel}" * (self.parcel > 1)]
        parts += [f"b{self.box[0]}x{self.box[1]}" * (self.box != Case.box)]
        parts += [f"d{1e6 * self.diameter:g}" * (self.diameter != Case.diameter), self.name, f"seed{self.seed}"]
        return "_".join(part for part in parts if part)

    @property
    def count(self) -> int:
        """Number of particles: the whole number next to the solid fraction."""
        grains = self.solid_fraction * self.box[0] * self.box[1] * 6.0 / math.pi
        return round(grains / self.parcel**2)

    @property
    def mean_solid_fraction(self) -> float:
        """Of so many particles [-]."""
        return self.count * self.parcel**2 * math.pi / 6.0 / (self.box[0] * self.box[1])

    def scene(self) -> Scene:
        """The scene of the run: the gradient is the weight of grains and gas over the volume of the box."""
        s, size = self.mean_solid_fraction, [self.box[0] * self.diameter, self.box[1] * self.diameter]
        weight = GRAVITY * (s * GRAIN_DENSITY + (1.0 - s) * DENSITY)
        probe = {"name": "box", "kind": "profile", "axis": "z", "cells": 1, "average": True}
        return jaxdem.load_scene(
            SCENE,
            {
                "seed": self.seed,
                "domain.size": size,
                "domain.depth": self.diameter,
                "particles.count": self.count,
                "particles.radius": self.diameter / 2.0,
                "particles.coarse_grain": float(self.parcel),
                "particles.pack.stop": size,
                "contact.young_modulus": MODULUS,
                "fluid.cells": [round(side / self.cell) for side in self.box],
                "fluid.pressure_gradient": [0.0, -weight],
                "fluid.time_step": self.step,
                "coupling.kernel_width.diameters": 3.0 / self.parcel,
                "time.end": self.times * RELAXATION,
                "time.output_interval": RELAXATION,
                "output.samples": RELAXATION * self.samples,
                "probes": [probe | {"interval": RELAXATION / 2.0, "sample_interval": 1e-3}],
                **dict(self.changes),
            },
        )


def simulated(case: Case, folder: Path, closure: DragClosure | None = None) -> Run:
    """The run, made or gone on with; the processor time that it took, and of which processor, is kept beside it."""
    path, scene = folder / case.folder, case.scene()
    took = folder / f"{case.folder}.time.json"
    if took.exists():
        return jaxdem.load_run(path)
    folder.mkdir(parents=True, exist_ok=True)
    marks: list[tuple[float, float]] = []

    def progress(now: float, end: float) -> None:
        marks.append((now, time.process_time()))

    run = jaxdem.simulate(scene, path, closure=closure, resume=path.exists(), progress=progress)
    # Programs are compiled before the first mark, so the time between marks has none of it.
    (first, begin), (last, end) = marks[min(1, len(marks) - 2)], marks[-1]
    seconds = (end - begin) / (last - first) * RELAXATION
    took.write_text(json.dumps({"cpu_s_per_relaxation_time": seconds, "processor": harness.machine()["processor"]}))
    return run


def uniform_drag(case: Case, slip: np.ndarray | float) -> np.ndarray:
    """Drag on a grain of the uniform state at the mean solid fraction and this slip, by the law of the scene [N]."""
    s, viscosity = case.mean_solid_fraction, DENSITY * VISCOSITY
    reynolds = np.abs((1.0 - s) * slip * case.diameter / VISCOSITY)
    multiple = WenYu().stokes_multiple(np.asarray(s), np.asarray(reynolds))
    return 3.0 * math.pi * viscosity * case.diameter * multiple * slip


@cache
def terminal_speed(case: Case) -> float:
    """Of a single grain, by the law of the scene [m/s]."""
    single = dataclasses.replace(case, solid_fraction=0.0)
    weight = math.pi / 6.0 * case.diameter**3 * (GRAIN_DENSITY - DENSITY) * GRAVITY
    low, high = 0.0, 10.0
    for _ in range(60):
        middle = (low + high) / 2.0
        low, high = (middle, high) if uniform_drag(single, middle) < weight else (low, middle)
    return low

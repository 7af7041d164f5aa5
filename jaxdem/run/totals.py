"""Sums and extremes over a run, and where its wall time went."""

from __future__ import annotations

import contextlib
import dataclasses
import time as clock
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from jaxdem.particles.energy import EnergyFlow
from jaxdem.run.chunk import Records
from jaxdem.run.compile_time import compile_clock
from jaxdem.setup.stored import stored

NOT_KEPT = ("stages", "start", "compiled", "at_start")
"""Fields of `Totals` that a checkpoint has under other names or not at all."""

AT_START = "_start"
"""A checkpoint has what a part gave at the start under the name of the part with this behind it."""

STAGES = ("step", "fluid_part", "particle_part", "output", "compile")
"""What a run measures; the parts of a step only where they are timed one by one."""

LARGEST = {
    "courant": "courant",
    "mass": "divergence",
    "momentum": "momentum",
    "volume": "volume",
    "fastest": "fastest",
}
"""Fields of `Totals` that are the largest value of a record."""


class Means(NamedTuple):
    """Means since the last output.

    Attributes:
        collision_force: see `ParticleDiagnostics`; zero before the first interval [N].
        pressure_gradient: (D,) along periodic axes [Pa/m]; None before the first interval, and where nothing drives the
            fluid.
        passed: (2 B,) or (4 B,) see `FluidDiagnostics`, flat; zero before the first interval; None where nothing may
            pass [m3/s].
    """

    collision_force: float
    pressure_gradient: np.ndarray | None
    passed: np.ndarray | None


@dataclasses.dataclass
class Totals:
    """Sums and extremes over a run; they belong to a checkpoint.

    Attributes:
        present: particles that were there, added up over the intervals; 0 where they always are, NaN where a
            checkpoint does not tell.
        at_start: by its name what each part of the scene compares the end with, see `jaxdem.run.parts.part`.
        passed, passed_before: see `Means`, summed over the intervals of the run, and up to the last output; empty
            before the first interval, and where nothing may pass [m3/s].
        passed_intervals: number of intervals since the last output, counted there.
    """

    start: float = 0.0
    compiled: float = 0.0
    resizes: int = 0
    intervals: int = 0
    fluid_steps: int = 0
    collision: float = 0.0
    collision_intervals: int = 0
    gradient: tuple[float, ...] = ()
    gradient_intervals: int = 0
    surface_force: tuple[float, ...] = ()
    passed: tuple[float, ...] = ()
    passed_before: tuple[float, ...] = ()
    passed_intervals: int = 0
    energy: tuple[float, ...] = ()
    out_of_range: float = 0.0
    present: float = 0.0
    spread: float = 0.0
    ensemble_force: float = 0.0
    iterations: int = 0
    courant: float = 0.0
    mass: float = 0.0
    momentum: float = 0.0
    volume: float = 0.0
    fastest: float = 0.0
    builds: int = 0
    waiting: int = 0
    waiting_most: int = 0
    waited: int = 0
    wall: float = 0.0
    at_start: dict[str, float | tuple[float, ...]] = dataclasses.field(default_factory=dict)
    stages: dict[str, float] = dataclasses.field(default_factory=lambda: dict.fromkeys(STAGES, 0.0))

    def begin(self) -> None:
        """The run starts, or goes on, now."""
        self.start, self.compiled = clock.perf_counter(), compile_clock().total

    @contextlib.contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Adds the wall time of a block to a stage, without what was compiled in it."""
        begin, compiled = clock.perf_counter(), compile_clock().total
        yield
        self.stages[stage] += clock.perf_counter() - begin - (compile_clock().total - compiled)

    def add(self, records: Records, count: int) -> None:
        """The first `count` coupling intervals of a chunk."""
        told = {
            name: np.asarray(value)[:count]
            for name, value in records._asdict().items()
            if value is not None and name != "energy"
        }
        self.intervals += count
        if records.collision_force is not None:
            for force in told["collision_force"]:
                self.collision += float(force)
            self.collision_intervals += count
            self.builds = int(told["builds"][-1])
        if records.pressure_gradient is not None:
            self.gradient = _summed(self.gradient, told["pressure_gradient"])
            self.gradient_intervals += count
        if records.surface_load is not None:
            self.surface_force = _summed(self.surface_force, told["surface_load"][..., 0])
        if records.passed is not None:
            self.passed = _summed(self.passed, told["passed"])
            self.passed_intervals += count
        if records.energy is not None:
            rows = np.stack([np.asarray(part)[:count] for part in records.energy], axis=1)
            self.energy = _summed(self.energy, rows)
        if records.waiting is not None:
            self.waiting = int(told["waiting"][-1])
            self.waiting_most = max(self.waiting_most, int(told["waiting"].max()))
            self.waited += int(told["waiting"].sum())
        if records.present is not None:
            self.present += float(told["present"].sum())
        if records.substeps is not None:
            self.fluid_steps += int(told["substeps"].sum())
            self.iterations = max(self.iterations, int(told["iterations"].max()))
        if records.out_of_range is not None:
            self.out_of_range += float(told["out_of_range"].sum())
        for total, name in LARGEST.items():
            if name in told:
                # NaN where one of them is, so that a figure that was lost shows.
                setattr(self, total, float(np.maximum(getattr(self, total), told[name].max())))

    def add_spread(self, spread: float, force: float) -> None:
        """Mean spread and mean force of an ensemble's members in the last interval, at an output [N]."""
        self.spread += spread
        self.ensemble_force += force

    def means(self) -> Means:
        """Means since the last call."""
        collision = self.collision / self.collision_intervals if self.collision_intervals else 0.0
        gradient = np.asarray(self.gradient) / self.gradient_intervals if self.gradient_intervals else None
        self.collision, self.collision_intervals = 0.0, 0
        self.gradient, self.gradient_intervals = (), 0
        passed = None
        if self.passed_intervals:
            before = np.asarray(self.passed_before) if self.passed_before else 0.0
            passed = (np.asarray(self.passed) - before) / self.passed_intervals
        self.passed_before, self.passed_intervals = self.passed, 0
        return Means(collision, gradient, passed)

    def elapsed(self) -> float:
        """Wall time of the run, that of the runs before a restart included [s]."""
        return self.wall + clock.perf_counter() - self.start

    def compile_seconds(self) -> float:
        """Time spent compiling, wherever in the run that was; that of the runs before a restart included [s].

        The stage `compile` has what Python does in it beside what JAX reports.
        """
        return self.stages["compile"] + compile_clock().total - self.compiled

    def save(self) -> dict[str, Any]:
        """Names and values for a checkpoint."""
        fields = [f.name for f in dataclasses.fields(self) if f.name not in NOT_KEPT]
        values = {name: getattr(self, name) for name in fields} | {"wall": self.elapsed()}
        values |= {f"{part}{AT_START}": value for part, value in self.at_start.items()}
        stages = self.stages | {"compile": self.compile_seconds()}
        return values | {f"stage_{name}": value for name, value in stages.items()}

    def load(self, values: Mapping[str, np.ndarray], walls_in_fluid: bool = False) -> None:
        """The inverse of `save`.

        Args:
            values: from a checkpoint.
            walls_in_fluid: whether the fluid sees walls; without them an older checkpoint need not have their force.
                It has no energies and no number of particles either: of the start these stay unknown. Nor has it what
                passed, which counts from the start or not at all.

        Raises:
            InputError: one is missing.
        """
        missing = ("energy",) if walls_in_fluid else ("energy", "surface_force")
        missing = ("passed", "passed_before", *missing)
        unknown = {"passed_intervals": np.zeros(()), "present": np.asarray(np.nan)}
        values = {name: np.zeros(0) for name in missing} | unknown | dict(values)
        for field in dataclasses.fields(self):
            if field.name not in NOT_KEPT:
                setattr(self, field.name, type(getattr(self, field.name))(stored(values, field.name)))
        if len(self.energy) != len(EnergyFlow._fields):  # of a version with other parts; its start counts less too
            self.energy = ()
        of_parts = {name.removesuffix(AT_START): value for name, value in values.items() if name.endswith(AT_START)}
        self.at_start = {part: tuple(v.tolist()) if np.ndim(v) else float(v) for part, v in of_parts.items()}
        self.stages = {name: float(stored(values, f"stage_{name}")) for name in self.stages}


def _summed(so_far: tuple[float, ...], rows: np.ndarray) -> tuple[float, ...]:
    """The sums (S,) with those of some intervals (T, ...) more, one after the other: they are the same however the
    intervals are cut into chunks."""
    rows = np.reshape(rows, (len(rows), -1)).astype(float)
    found = np.asarray(so_far) if so_far else np.zeros(rows.shape[1])
    for row in rows:
        found = found + row
    return tuple(found.tolist())

"""What a study has found so far: runs, closures, datasets and replays by name, with the reason where one is missing."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from jaxdem import metrics
from jaxdem.closures import load_closure, load_subgrid
from jaxdem.errors import InputError
from jaxdem.io import Run, load_run
from jaxdem.study import parity_figures, read_stored
from studies.measure import errors, mean_errors, noise_floor
from studies.replay import Replay, read_replay
from studies.specs import DatasetSpec, Folder, Plan, RunSpec


@dataclasses.dataclass
class Evidence:
    """What is in the study's folder.

    Attributes:
        folder: the folder.
        problems: why something is not there, by name.
        jobs: processes that shared the machine; 0 where that is not known.
        missing: what was asked for and is not there, with the reason.
    """

    folder: Folder
    problems: dict[str, str]
    jobs: int = 1
    missing: dict[str, str] = dataclasses.field(default_factory=dict)
    _runs: dict[str, Run] = dataclasses.field(default_factory=dict)

    @property
    def plan(self) -> Plan:
        """Of the study."""
        return self.folder.plan

    @property
    def out(self) -> Path:
        """The folder."""
        return self.folder.out

    @property
    def sharing(self) -> str:
        """A sentence for tables of times."""
        if self.jobs == 0:
            return "How many processes shared the machine is not known."
        return f"{self.jobs} {'process' if self.jobs == 1 else 'processes'} shared the machine."

    def run(self, name: str) -> Run | None:
        """A run of the plan that is complete and valid."""
        if name not in self.plan.specs:
            return None
        if name not in self._runs:
            if not (self.out / name).is_dir():
                self.missing[name] = self.problems.get(name, "not run")
                return None
            try:
                run = load_run(self.out / name)
                if not (run.summary.get("valid") and run.summary.get("complete")):
                    raise InputError("RUN", name, str(run.summary.get("reason") or "is not complete"), "")
            except InputError as error:
                self.missing[name] = self.problems.get(name) or str(error)
                return None
            self._runs[name] = run
        return self._runs[name]

    def run_time(self, run: Run, reference: str = "fine") -> float | None:
        """Run time without compiling [s]; None where the reference had another device or another JAX."""
        fine = self.run(reference)
        if fine is not None and _computed_by(run) != _computed_by(fine):
            return None
        return metrics.run_time(run.summary)

    def runs(self, names: Iterable[str]) -> list[Run]:
        """Those of the runs that are there."""
        return [run for name in names if (run := self.run(name)) is not None]

    def jittered(self, name: str) -> list[Run]:
        """Runs that differ from this one in the jitter of the pack alone, as far as they have been begun.

        There are none of a run that is not in the plan.
        """
        if name not in self.plan.specs:
            return []
        wanted = _but_for_the_pack(self.plan.run(name))
        return self.runs(
            other
            for other, spec in self.plan.specs.items()
            if isinstance(spec, RunSpec)
            and other != name
            and "seed" in spec.overrides
            and _but_for_the_pack(spec) == wanted
            and (self.out / other).is_dir()
        )

    @cached_property
    def floor(self) -> dict[str, float]:
        """Noise floor of the fine run."""
        fine = self.run("fine")
        return {} if fine is None else noise_floor(fine, self.jittered("fine"))

    def errors(self, name: str, reference: str = "fine") -> dict[str, float] | None:
        """Error of every metric, mean over the packs of a run; None where it or the reference is missing."""
        run, fine = self.run(name), self.run(reference)
        if run is None or fine is None:
            return None
        return mean_errors([errors(one, fine) for one in (run, *self.jittered(name))])

    def packs(self, name: str) -> int:
        """Number of packs that a run was done with."""
        return len(self.runs([name])) + len(self.jittered(name))

    def closure(self, name: str) -> dict[str, Any] | None:
        """Metadata of a closure; where drag and subgrid stress were trained together, the drag's."""
        path = self._path(name, "not trained")
        if path is None:
            return None
        return (load_subgrid if path.name.endswith(".subgrid.h5") else load_closure)(path)[1]

    def dataset(self, name: str) -> Path | None:
        """File of a dataset."""
        return self._path(name, "not made")

    def replay(self, factor: int) -> Replay | None:
        """A replay of the fine run."""
        path = self._path(f"oracle_{factor}", "not made")
        return None if path is None else read_replay(path)

    def _path(self, name: str, why: str) -> Path | None:
        """The first file of something in the plan; where it is not there, it is missing for a reason."""
        path = self.out / self.plan.specs[name].files[0]
        if path.is_file():
            return path
        self.missing[name] = self.problems.get(name, why)
        return None

    def training_seconds(self, *names: str) -> float | None:
        """Wall time that closures took to train, with those that they are made of; without the runs [s].

        None where nothing was trained.
        """
        waiting, seconds = list(names), dict[str, float]()
        while waiting:
            name = waiting.pop()
            if name not in seconds and (found := self.closure(name)) is not None:
                seconds[name] = float(found.get("study_seconds", found.get("seconds", math.nan)))
                needs = self.plan.specs[name].needs
                waiting += [other for other in needs if not isinstance(self.plan.specs[other], RunSpec | DatasetSpec)]
        return sum(seconds.values()) if seconds else None

    def training_of(self, run: str) -> float | None:
        """Wall time of the training of what a run uses [s]."""
        return self.training_seconds(*self.plan.run(run).needs)

    def parity(self, name: str) -> dict[str, dict[str, np.ndarray]]:
        """Arrays for the parity plot, by the mesh that the inputs are averaged to; {} without."""
        path = self.out / f"{name}.parity.npz"
        figures = parity_figures(read_stored(path)) if path.is_file() else {}
        return {f"{name}, {inputs}": arrays for inputs, arrays in figures.items()}


def _computed_by(run: Run) -> tuple[str, str]:
    """Device and version of JAX."""
    return str(run.summary.get("device")), str(run.summary.get("versions", {}).get("jax"))


def _but_for_the_pack(spec: RunSpec) -> tuple[Any, ...]:
    """What a run is, apart from the jitter of its pack, its samples and how far it goes beyond what is compared."""
    aside = ("seed", "output.samples", "time.end")
    kept = {key: value for key, value in spec.overrides.items() if key not in aside}
    return spec.scene, spec.closure, spec.subgrid, kept

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
from jaxdem.studies.arrays import read_stored
from jaxdem.studies.measure import errors, mean_errors, noise_floor
from jaxdem.studies.oracle import Replay, read_replay
from jaxdem.studies.plan import RunSpec, StudyPlan, files_of, made_of


@dataclasses.dataclass
class Evidence:
    """The study's folder.

    Attributes:
        plan: of the study.
        out: its folder.
        problems: why something is not there, by name.
        jobs: processes that shared the machine; 0 where that is not known.
        missing: what was asked for and is not there, with the reason.
    """

    plan: StudyPlan
    out: Path
    problems: dict[str, str]
    jobs: int = 1
    missing: dict[str, str] = dataclasses.field(default_factory=dict)
    _runs: dict[str, Run] = dataclasses.field(default_factory=dict)

    @property
    def sharing(self) -> str:
        """A sentence for tables of times."""
        if self.jobs == 0:
            return "How many processes shared the machine is not known."
        return f"{self.jobs} {'process' if self.jobs == 1 else 'processes'} shared the machine."

    def run(self, name: str) -> Run | None:
        """A run of the plan that is complete and valid."""
        if name not in self.plan.runs:
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
        """Run time without compiling [s]; None where the reference had another device or another JAX: times are for one machine."""
        fine = self.run(reference)
        if fine is not None and _computed_by(run) != _computed_by(fine):
            return None
        return metrics.run_time(run.summary)

    def runs(self, names: Iterable[str]) -> list[Run]:
        """Those of the runs that are there."""
        return [run for name in names if (run := self.run(name)) is not None]

    def jittered(self, name: str) -> list[Run]:
        """Runs of the plan that differ from this one in the jitter of the pack alone, as far as they have been begun; none of
        a run that is not in the plan."""
        if name not in self.plan.runs:
            return []
        wanted = _but_for_the_pack(self.plan.runs[name])
        return self.runs(
            other
            for other, spec in self.plan.runs.items()
            if other != name
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
        """Error of every metric of a run, the mean over all packs that it was run with; None where it or the reference is
        missing."""
        run, fine = self.run(name), self.run(reference)
        if run is None or fine is None:
            return None
        return mean_errors([errors(one, fine) for one in (run, *self.jittered(name))])

    def packs(self, name: str) -> int:
        """Number of packs that a run was done with."""
        return len(self.runs([name])) + len(self.jittered(name))

    def closure_file(self, name: str) -> Path:
        """File of a drag closure."""
        return self.out / files_of(self.plan.closures[name])["drag"]

    def closure(self, name: str) -> dict[str, Any] | None:
        """Metadata of a closure; where drag and subgrid stress were trained together, the drag's."""
        kind, file = next(iter(files_of(self.plan.closures[name]).items()))
        path = self.out / file
        if not path.is_file():
            self.missing[name] = self.problems.get(name, "not trained")
            return None
        return (load_closure if kind == "drag" else load_subgrid)(path)[1]

    def training_seconds(self, *names: str) -> float | None:
        """Wall time that closures took to train, with those that they are made of; without the runs [s].

        None where nothing was trained.
        """
        waiting, seconds = list(names), {}  # type: tuple[list[str], dict[str, float]]
        while waiting:
            name = waiting.pop()
            if name not in seconds and (found := self.closure(name)) is not None:
                seconds[name] = float(found.get("study_seconds", found.get("seconds", math.nan)))
                waiting += made_of(self.plan.closures[name])
        return sum(seconds.values()) if seconds else None

    def training_of(self, run: str) -> float | None:
        """Wall time of the training of what a run uses [s]."""
        return self.training_seconds(*self.plan.runs[run].learned)

    def parity(self, name: str) -> dict[str, dict[str, np.ndarray]]:
        """Arrays for the parity plot, by the mesh that the inputs are averaged to; {} without."""
        path, figures = self.out / f"{name}.parity.npz", {}  # type: tuple[Path, dict[str, dict[str, np.ndarray]]]
        if path.is_file():
            for key, array in read_stored(path).items():
                factor, kind = key.split("/")
                inputs = "fine inputs" if factor == "1" else f"inputs averaged {factor}x"
                figures.setdefault(f"{name}, {inputs}", {})[kind] = array
        return figures

    def dataset(self, name: str) -> Path | None:
        """File of a dataset."""
        path = self.out / f"{name}.h5"
        if path.is_file():
            return path
        self.missing[name] = self.problems.get(name, "not made")
        return None

    def oracle(self, factor: int) -> Replay | None:
        """A replay of the fine run."""
        path = self.out / f"oracle_{factor}.npz"
        if path.is_file():
            return read_replay(path)
        self.missing[path.stem] = self.problems.get(path.stem, "not made")
        return None


def _computed_by(run: Run) -> tuple[str, str]:
    """Device and version of JAX."""
    return str(run.summary.get("device")), str(run.summary.get("versions", {}).get("jax"))


def _but_for_the_pack(spec: RunSpec) -> tuple[Any, ...]:
    """What a run is, apart from the jitter of its pack, its samples and how far it goes beyond what is compared."""
    aside = ("seed", "output.samples", "time.end")
    kept = {key: value for key, value in spec.overrides.items() if key not in aside}
    return spec.scene, spec.closure, spec.subgrid, kept

"""The study of a learned drag closure, run -> dataset -> train -> run -> compare, stage by stage and resumable.

A stage that is done is not done again; a run that was stopped goes on from its checkpoint. Everything that
a stage needs is in the study's folder, so that it can be looked at, moved, and gone on with. The demonstration is here;
the study at full size, which has many runs and shares them among processes, is in `studies`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import time as clock
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from jaxdem.closures import load_closure
from jaxdem.errors import InputError
from jaxdem.files.reading import parse_json, read_text
from jaxdem.io import Run
from jaxdem.io.access import locked
from jaxdem.io.durable import write_bytes
from jaxdem.report import Comparison, compare
from jaxdem.run.simulate import Progress, simulate_once
from jaxdem.scene import Scene, load_scene
from jaxdem.studies import check_request
from jaxdem.studies.arrays import read_stored
from jaxdem.studies.driver import FullStudy, default_jobs
from jaxdem.studies.injection import SHARP, injection_plan
from jaxdem.studies.plan import StudyPlan
from jaxdem.studies.work import fit_to_files
from jaxdem.train.dataset import make_dataset
from jaxdem.train.dataset_file import SEEING
from jaxdem.train.fit_settings import FitSettings

SCENES = Path(__file__).parent / "scenes"


class Listener(Protocol):
    """Who hears how the study goes on; the command line draws bars."""

    def stage(self, name: str, total: float) -> Callable[[float], None]:
        """A stage of the given length starts; the result is called with how much of it is done."""
        ...

    def begin(self, name: str, total: float) -> Callable[[float], None]:
        """One of several pieces of work at once starts; as `stage`."""
        ...

    def end(self, name: str) -> None:
        """That piece is over."""
        ...

    def say(self, message: str) -> None:
        """A line for the reader."""
        ...


@dataclasses.dataclass(frozen=True)
class Plan:
    """What a study does at one scale.

    Attributes:
        scene: name of the scene's file.
        factors: coarse meshes, by the factor on the cell side.
        samples: time between samples of the reference run [s].
        seeds: of further packs, which differ in their jitter alone; every run is done with each of them too, so that the noise is
            known.
        filtered: settings of the recipe `filtered`.
        paper: settings of the recipe `paper`, or None to leave it out.
        sharp: keys of a coarse fluid that smears less, which the closures are trained and run for; without any they are run on
            the scene's own.
    """

    scene: str
    factors: tuple[int, ...]
    samples: float
    seeds: tuple[int, ...]
    filtered: FitSettings
    paper: FitSettings | None
    sharp: Mapping[str, Any] = dataclasses.field(default_factory=dict)


DEMOS: dict[str, Plan] = {
    "injection": Plan(
        scene="injection_demo.toml",
        factors=(4,),
        samples=0.02,
        seeds=(1, 2),
        filtered=FitSettings.filtered(epochs=60, samples=60_000),
        paper=None,
        sharp=SHARP,
    ),
}
"""Demonstrations by the study's name."""

FULL: dict[str, Callable[[], StudyPlan]] = {"injection": injection_plan}
"""Plans at full size by the study's name."""


@dataclasses.dataclass
class Study:
    """A study in its folder."""

    plan: Plan
    scene: Scene
    out: Path
    listener: Listener

    def run(self) -> Comparison:
        """All stages; returns the comparison that the report shows."""
        reference = self.simulation("fine", self.scene, {"output.samples": self.plan.samples})
        noise = self._packs("fine", {})
        dataset = self.dataset(reference)
        fits = {"filtered": self.fit("filtered", dataset, self.plan.filtered)}
        if self.plan.paper is not None:
            fits["paper"] = self.fit("paper", dataset, self.plan.paper)
        runs: dict[str, list[Run]] = {}
        cost: dict[str, float] = {}
        for factor in self.plan.factors:
            name = f"coarse {factor}x"
            runs[name] = self._coarse_runs(factor)
            if self.plan.sharp:
                name += ", sharp"
                runs[name] = self._coarse_runs(factor, "_sharp")
            for recipe, fit in fits.items():
                learned = f"{name} + {recipe}"
                runs[learned] = self._coarse_runs(factor, "_sharp" if self.plan.sharp else "", fit)
                cost[learned] = fit.seconds
        return compare(
            reference,
            [first for first, *_ in runs.values()],
            self.out,
            names=["fine", *runs],
            noise=noise,
            packs={name: others for name, (_, *others) in runs.items()},
            parity=self._parity(fits["filtered"]),
            training_cost=cost,
            notes=self._notes(fits),
            title=f"{self.scene_name}: a learned drag closure on coarse meshes",
        )

    @property
    def scene_name(self) -> str:
        """Name of the scene without its ending."""
        return Path(self.plan.scene).stem

    def simulation(self, name: str, scene: Scene, overrides: dict[str, Any], closure: Path | None = None) -> Run:
        """A run in the study's folder, made, gone on with, or taken as it is."""
        path = self.out / name
        if closure is not None:
            overrides = overrides | {"closure.file": str(closure)}
        scene = load_scene(scene.tables(), overrides)

        def begin() -> Progress:
            advance = self.listener.stage(f"run {name}", scene.time.end)
            return lambda time, _: advance(time)

        return simulate_once(scene, path, begin)

    def dataset(self, reference: Run) -> Path:
        """Training data from the reference run, averaged to its own mesh and to every coarse one."""
        path = self.out / "dataset.h5"
        if not path.is_file():
            factors = (1, *self.plan.factors)
            assert reference.samples is not None
            advance = self.listener.stage("dataset", len(factors) * len(reference.samples.times))
            kernel = {key: value for key, value in self.plan.sharp.items() if key.startswith(SEEING)}
            make_dataset(reference.path, path, factors, lambda done, _: advance(done), overrides=kernel)
        return path

    def fit(self, recipe: str, dataset: Path, settings: FitSettings) -> StudyFit:
        """A closure trained on the dataset, with its parity figures beside it."""
        path, beside = self.out / f"{recipe}.closure.h5", self.out / f"{recipe}.parity.npz"
        if not (path.is_file() and beside.is_file()):
            advance = self.listener.stage(f"train {recipe}", settings.epochs)
            fit_to_files(recipe, [dataset], settings, path, beside, advance)
        metadata = load_closure(path)[1]
        return StudyFit(recipe, path, metadata, read_stored(beside))

    def _coarse_runs(self, factor: int, sharp: str = "", fit: StudyFit | None = None) -> list[Run]:
        """Runs on a coarse mesh, with the scene's pack and with the others; `sharp` is what says so in their names."""
        assert self.scene.fluid is not None
        cells = [max(1, round(count / factor)) for count in self.scene.fluid.cells]
        name = f"coarse_{factor}{sharp}" + ("" if fit is None else f"_{fit.recipe}")
        overrides = {"fluid.cells": cells, **(self.plan.sharp if sharp else {})}
        closure = None if fit is None else fit.path
        return [self.simulation(name, self.scene, overrides, closure), *self._packs(name, overrides, closure)]

    def _packs(self, name: str, overrides: dict[str, Any], closure: Path | None = None) -> list[Run]:
        """The same run with the other packs."""
        return [
            self.simulation(f"{name}_seed_{seed}", self.scene, {**overrides, "seed": seed}, closure)
            for seed in self.plan.seeds
        ]

    def _parity(self, fit: StudyFit) -> dict[str, dict[str, np.ndarray]]:
        figures: dict[str, dict[str, np.ndarray]] = {}
        for name, array in fit.parity.items():
            factor, kind = name.split("/")
            figures.setdefault(f"inputs averaged {factor}x" if factor != "1" else "fine inputs", {})[kind] = array
        return figures

    def _notes(self, fits: dict[str, StudyFit]) -> list[str]:
        notes = [
            "The closures are trained on the fine run that is also the reference: what is tested is whether they give back what they have "
            "seen, not whether they hold elsewhere."
        ]
        if self.plan.sharp:
            settings = ", ".join(f"{key} = {value}" for key, value in self.plan.sharp.items())
            notes.append(f"Sharp is a coarse fluid that smears less: {settings}.")
        for fit in fits.values():
            for factor, figures in fit.metadata.get("r2", {}).items():
                notes.append(
                    f"Recipe {fit.recipe}, inputs averaged {factor}x, held out ({fit.metadata.get('split', '')}): "
                    f"R2 {figures['closure']:.4f}, base law {figures['base']:.4f}, "
                    f"regression {figures['regression']:.4f}."
                )
        return notes


@dataclasses.dataclass(frozen=True)
class StudyFit:
    """A trained closure: recipe, file, metadata, and arrays "factor/name" for the parity plot."""

    recipe: str
    path: Path
    metadata: dict[str, Any]
    parity: dict[str, np.ndarray]

    @property
    def seconds(self) -> float:
        """Wall time of the training [s]."""
        return float(self.metadata["study_seconds"])


@dataclasses.dataclass(frozen=True)
class StudyResult:
    """What a study ended with.

    Attributes:
        comparison: that report.html shows; None where the reference run is missing.
        problems: of the full size: what was not done, name -> why.
    """

    comparison: Comparison | None
    problems: dict[str, str]


def run_study(
    name: str,
    scale: str,
    out: str | Path,
    listener: Listener,
    parts: Sequence[str] = (),
    jobs: int | None = None,
) -> StudyResult:
    """A study by name, at the scale "demo" or "paper", in the folder `out`.

    Args:
        name: of the study.
        scale: "demo" or "paper".
        out: folder.
        listener: hears how it goes on.
        parts: of the full size; all by default.
        jobs: processes at once of the full size, one a core by default; 0 does nothing, and writes the tables and the
            report of what is there.

    Raises:
        InputError: unknown name, scale or part, parts or jobs for a demonstration, or the folder holds another study
            or another scene's run.
        Interrupted: SIGINT or SIGTERM; checkpoints were written.
    """
    check_request(name, scale, Path(out), parts, jobs)
    out, begin = Path(out), clock.perf_counter()
    if scale == "paper":
        full = FullStudy(FULL[name](), SCENES, out, listener, default_jobs() if jobs is None else jobs, tuple(parts))
        assert full.parts, "unknown parts are refused before the folder is touched"
        _claim(out, {"study": name, "scale": scale}, full.plan.files)
        # Tables and report of what is there may be asked for while the runs go on.
        with contextlib.nullcontext() if jobs == 0 else locked(out):
            result = StudyResult(full.run(), full.problems)
    else:
        plan = DEMOS[name]
        _claim(out, {"study": name, "scale": scale, "sharp": dict(plan.sharp), "seeds": list(plan.seeds)})
        with locked(out):
            study = Study(plan, load_scene(SCENES / plan.scene), out, listener)
            result = StudyResult(study.run(), {})
    listener.say(f"The study took {clock.perf_counter() - begin:.0f} s.")
    return result


def _claim(out: Path, identity: dict[str, Any], known: Collection[str] = ()) -> None:
    """Marks the folder as this study's; refuses a folder that holds something else than what is known."""
    marker = out / "study.json"
    if marker.is_file():
        try:
            found = parse_json(read_text(marker))
        except (OSError, ValueError):
            raise InputError(
                "--out", str(out), "has a study.json that is not a study's", "choose another folder"
            ) from None
        if found != identity:
            raise InputError("--out", str(out), f"holds the study {found}", "choose another folder")
        return
    if out.is_dir() and any(entry.name not in known for entry in out.iterdir()):
        raise InputError("--out", str(out), "is not empty and holds no study", "choose another folder")
    try:
        out.mkdir(parents=True, exist_ok=True)
        write_bytes(marker, (json.dumps(identity) + "\n").encode())
    except OSError as error:
        raise InputError("--out", str(out), f"cannot be written ({error.strerror})", "choose another folder") from None

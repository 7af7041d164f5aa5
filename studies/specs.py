"""What a study is made of: runs, datasets, closures and replays, as plain data; each knows how it is made.

`make` runs in a process of its own (`studies.pool`), and takes what it needs from the study's folder by name.
"""

from __future__ import annotations

import dataclasses
import json
import os
import time as clock
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import jax

from jaxdem.closures import SubgridClosure, save_closure
from jaxdem.closures.file import load_single, load_stored
from jaxdem.errors import InputError
from jaxdem.io import load_run, run_folder
from jaxdem.io.run_folder import SCENE
from jaxdem.io.scene_text import without_folders
from jaxdem.run.program_cache import use_program_cache
from jaxdem.run.scene_run import simulate_once
from jaxdem.run.time_loop import Interrupted
from jaxdem.scene import Scene, load_scene
from jaxdem.study import SCENES, fit_to_files
from jaxdem.train.closures import Closures
from jaxdem.train.compress import distill, prune, settings_for
from jaxdem.train.dataset import make_dataset
from jaxdem.train.dataset_file import Dataset, read_dataset
from jaxdem.train.ensemble import put_together
from jaxdem.train.finetune import FinetuneSettings, finetune
from jaxdem.train.fit import RECIPES
from jaxdem.train.fit_settings import FitSettings
from studies.pool import Piece, Report
from studies.replay import replay_to_file

ENDINGS = {"drag": ".closure.h5", "subgrid": ".subgrid.h5"}
"""Of the files of closures, by what they are."""


@dataclasses.dataclass(frozen=True)
class Spec(ABC):
    """Something that a study makes; `name` is that of its file or folder, without ending."""

    name: str

    @property
    def needs(self) -> tuple[str, ...]:
        """Names of what must be there before."""
        return ()

    @property
    @abstractmethod
    def files(self) -> tuple[str, ...]:
        """Names of its files in the study's folder."""

    def is_done(self, folder: Folder) -> bool:
        """Whether it is there; an InputError where something else is."""
        return all((folder.out / file).is_file() for file in self.files)

    def length(self, folder: Folder) -> float:
        """Of the work, in the unit of `report`."""
        return 1.0

    @abstractmethod
    def make(self, folder: Folder, report: Report) -> None:
        """Make it; `report` is told how much is done."""


@dataclasses.dataclass(frozen=True)
class RunSpec(Spec):
    """One run.

    Attributes:
        scene: file name of the scene.
        overrides: dotted key -> value.
        closure: name of the closure that it uses, None for the scene's drag law.
        subgrid: name of the training whose subgrid stress it uses, None for none.
    """

    scene: str
    overrides: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    closure: str | None = None
    subgrid: str | None = None

    @property
    def needs(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(name for name in (self.closure, self.subgrid) if name is not None))

    @property
    def files(self) -> tuple[str, ...]:
        return (self.name,)

    def with_closure(self, closure: str) -> RunSpec:
        """The same run with a closure, under a name that says so."""
        return dataclasses.replace(self, name=f"{self.name}_{closure}", closure=closure)

    def with_stress(self, stress: StressSpec) -> RunSpec:
        """The same run with a subgrid stress, under a name that says so."""
        return dataclasses.replace(self, name=f"{self.name}_{stress.name}", subgrid=stress.name)

    def with_tuned(self, tuned: TuneSpec) -> RunSpec:
        """The same run with what a training through the solver gave, beside what it began with."""
        closure = tuned.name if "drag" in tuned.trained else tuned.start
        subgrid = tuned.name if "subgrid" in tuned.trained else None
        return dataclasses.replace(self, name=f"{self.name}_{tuned.name}", closure=closure, subgrid=subgrid)

    def is_done(self, folder: Folder) -> bool:
        """Whether the run is complete; an InputError where the folder has a run of another scene."""
        require_same_scene(folder.out / self.name, folder.scene(self))
        return run_folder.is_complete(folder.out / self.name)

    def length(self, folder: Folder) -> float:
        return folder.scene(self).time.end

    def make(self, folder: Folder, report: Report) -> None:
        scene = folder.scene(self)
        if scene.precision == "float64":
            jax.config.update("jax_enable_x64", True)
        simulate_once(scene, folder.out / self.name, lambda: lambda time, _: report(time))


@dataclasses.dataclass(frozen=True)
class DatasetSpec(Spec):
    """Training data from a run.

    Attributes:
        run: name of the run, which writes samples.
        coarsen: factors of the mesh.
        every: every so many-th sample is used.
        overrides: of the kernel through which the coarse meshes see the particles.
    """

    run: str
    coarsen: tuple[int, ...]
    every: int = 1
    overrides: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def needs(self) -> tuple[str, ...]:
        return (self.run,)

    @property
    def files(self) -> tuple[str, ...]:
        return (f"{self.name}.h5",)

    def length(self, folder: Folder) -> float:
        scene = folder.scene_of(self.run)
        return len(self.coarsen) * scene.time.end / scene.output.samples / self.every

    def make(self, folder: Folder, report: Report) -> None:
        out = folder.out / self.files[0]
        run = folder.out / self.run
        make_dataset(run, out, self.coarsen, lambda done, _: report(done), self.every, dict(self.overrides))


@dataclasses.dataclass(frozen=True)
class ClosureSpec(Spec):
    """A closure in a file of its own."""

    @property
    def files(self) -> tuple[str, ...]:
        return (f"{self.name}{ENDINGS['drag']}",)


@dataclasses.dataclass(frozen=True)
class FitSpec(ClosureSpec):
    """A closure that is trained on datasets.

    Attributes:
        recipe: "paper" or "filtered".
        settings: of the fit.
        datasets: names of the datasets; the last one's run is held out, for R2 alone.
    """

    recipe: str
    settings: FitSettings
    datasets: tuple[str, ...]

    @property
    def needs(self) -> tuple[str, ...]:
        return self.datasets

    def length(self, folder: Folder) -> float:
        return self.settings.epochs

    def make(self, folder: Folder, report: Report) -> None:
        files = [folder.out / f"{name}.h5" for name in self.datasets]
        fit_to_files(self.recipe, files, self.settings, folder.closure(self.name), report)


@dataclasses.dataclass(frozen=True)
class SmallerSpec(ClosureSpec):
    """A cheaper closure made of another one.

    Attributes:
        teacher: the other one.
        datasets: as for `FitSpec`.
        epochs: of the training.
        hidden: widths of a network that is taught by it; None prunes.
        neurons: part of the neurons that pruning keeps, before it trains on.
    """

    teacher: str
    datasets: tuple[str, ...]
    epochs: int
    hidden: tuple[int, ...] | None = None
    neurons: float = 0.5

    @property
    def needs(self) -> tuple[str, ...]:
        return (self.teacher, *self.datasets)

    def length(self, folder: Folder) -> float:
        return self.epochs

    def make(self, folder: Folder, report: Report) -> None:
        begin, file, data = clock.perf_counter(), folder.closure(self.teacher), folder.data(self.datasets)
        if self.hidden is not None:
            teacher = load_stored(file)[0]
            settings = settings_for(teacher, hidden=self.hidden, epochs=self.epochs)
            found = distill(teacher, data, settings, lambda epoch, *_: report(epoch))
        else:
            closure = load_single(file, "")[0]
            settings = settings_for(closure, epochs=self.epochs)
            found = prune(closure, data, self.neurons, settings, True, lambda epoch, *_: report(epoch))
        _save(folder.closure(self.name), found.closure, found.metadata, begin)


@dataclasses.dataclass(frozen=True)
class EnsembleSpec(ClosureSpec):
    """Closures that differ in their seed as one.

    Attributes:
        members: the closures, each of a `FitSpec`.
    """

    members: tuple[str, ...]

    @property
    def needs(self) -> tuple[str, ...]:
        return self.members

    def make(self, folder: Folder, report: Report) -> None:
        begin, first = clock.perf_counter(), folder.plan.specs[self.members[0]]
        if not isinstance(first, FitSpec):
            raise TypeError(f"{first.name} is not trained on datasets")
        members = [load_single(folder.closure(name), "")[0] for name in self.members]
        problem = RECIPES[first.recipe](folder.data(first.datasets), first.settings)
        found = put_together(problem, members, [], 0.0)
        _save(folder.closure(self.name), found.closure, found.metadata, begin)


@dataclasses.dataclass(frozen=True)
class StressSpec(Spec):
    """A subgrid stress with the same coefficients everywhere, that nothing is learned for.

    Attributes:
        viscosity, gradient: c_1 and c_n, see `SubgridClosure.constant`.
    """

    viscosity: float
    gradient: float

    @property
    def files(self) -> tuple[str, ...]:
        return (f"{self.name}{ENDINGS['subgrid']}",)

    def make(self, folder: Folder, report: Report) -> None:
        stress = SubgridClosure.constant(self.viscosity, self.gradient)
        _save(folder.closure(self.name, "subgrid"), stress, {}, clock.perf_counter())


@dataclasses.dataclass(frozen=True)
class TuneSpec(Spec):
    """Closures trained through coarse runs that follow a finer one.

    Attributes:
        reference: name of the run to follow.
        overrides: of the reference's scene that make it the coarse one.
        settings: of the training.
        start: drag closure to begin with, None for the scene's drag law.
        trained: "drag", "subgrid" or both; a subgrid stress begins as one that gives nothing.
    """

    reference: str
    overrides: Mapping[str, Any]
    settings: FinetuneSettings
    start: str | None = None
    trained: tuple[str, ...] = ("drag",)

    @property
    def needs(self) -> tuple[str, ...]:
        return (*(() if self.start is None else (self.start,)), self.reference)

    @property
    def files(self) -> tuple[str, ...]:
        return tuple(f"{self.name}{ENDINGS[kind]}" for kind in self.trained)

    def length(self, folder: Folder) -> float:
        return self.settings.updates * len(self.settings.horizons or ())

    def make(self, folder: Folder, report: Report) -> None:
        begin = clock.perf_counter()
        drag, before = (None, {}) if self.start is None else load_single(folder.closure(self.start), "")
        start = Closures(drag, SubgridClosure.initial() if "subgrid" in self.trained else None, self.trained)
        scene = load_scene(folder.scene_of(self.reference).tables(), dict(self.overrides))
        reference, progress = folder.out / self.reference, lambda done, *_: report(float(done))
        found = finetune(scene, reference, start, {"drag": before}, self.settings, progress)
        for kind in self.trained:
            _save(folder.closure(self.name, kind), getattr(found.closures, kind), found.metadata[kind], begin)


@dataclasses.dataclass(frozen=True)
class ReplaySpec(Spec):
    """The fine run's particles and forces in the fluid of a mesh `factor` times as coarse."""

    run: str
    factor: int

    @property
    def needs(self) -> tuple[str, ...]:
        return (self.run,)

    @property
    def files(self) -> tuple[str, ...]:
        return (f"{self.name}.npz",)

    def length(self, folder: Folder) -> float:
        return folder.scene_of(self.run).time.end

    def make(self, folder: Folder, report: Report) -> None:
        replay_to_file(load_run(folder.out / self.run), self.factor, folder.out / self.files[0], report)


@dataclasses.dataclass(frozen=True)
class Part:
    """One question of a study, and the names of what it needs; the function of the same name computes its answer."""

    name: str
    needs: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Plan:
    """All of a study: everything by name."""

    specs: Mapping[str, Spec]
    parts: Mapping[str, Part]

    @property
    def files(self) -> set[str]:
        """Names of all files and folders in the study's folder."""
        parities = {f"{name}.parity.npz" for name, spec in self.specs.items() if isinstance(spec, FitSpec)}
        return {file for spec in self.specs.values() for file in spec.files} | parities

    def run(self, name: str) -> RunSpec:
        """A run by its name."""
        spec = self.specs[name]
        if not isinstance(spec, RunSpec):
            raise KeyError(f"{name} is not a run")
        return spec

    def names(self, part: str, kind: type) -> list[str]:
        """Names of what a part needs of a kind."""
        return [name for name in self.parts[part].needs if isinstance(self.specs[name], kind)]


@dataclasses.dataclass(frozen=True)
class Folder:
    """The study's folder `out`, and what is in it by the plan."""

    plan: Plan
    out: Path

    def scene(self, run: RunSpec) -> Scene:
        """Scene of a run."""
        overrides = dict(run.overrides)
        if run.closure is not None:
            overrides["closure.file"] = str(self.closure(run.closure).resolve())
        if run.subgrid is not None:
            overrides["fluid.subgrid"] = str(self.closure(run.subgrid, "subgrid").resolve())
        return load_scene(SCENES / run.scene, overrides)

    def scene_of(self, run: str) -> Scene:
        """Scene of a run by its name."""
        return self.scene(self.plan.run(run))

    def closure(self, name: str, kind: str = "drag") -> Path:
        """File of a closure."""
        return self.out / f"{name}{ENDINGS[kind]}"

    def data(self, datasets: Iterable[str]) -> list[Dataset]:
        """Datasets, read."""
        return [read_dataset(self.out / f"{name}.h5") for name in datasets]

    def pieces(self, parts: Iterable[Part]) -> list[Piece]:
        """The work of these parts, everything after what it needs itself.

        Raises:
            InputError: a run directory of another scene.
        """
        found: dict[str, Piece] = {}

        def add(name: str) -> None:
            spec = self.plan.specs[name]
            for other in spec.needs:
                add(other)
            if name not in found:
                make, done = partial(make_in_process, spec, self), spec.is_done(self)
                found[name] = Piece(name, make, spec.length(self), spec.needs, done)

        for part in parts:
            for name in part.needs:
                add(name)
        return list(found.values())


def make_in_process(spec: Spec, folder: Folder, report: Report) -> None:
    """Make something in a process of its own; it ends where a run is asked to stop."""
    use_program_cache()
    try:
        spec.make(folder, report)
    except Interrupted as stop:
        print(stop, flush=True)
        os._exit(128 + stop.number)  # Python would wait for a compiler that is still at work in a thread


Named = TypeVar("Named", Spec, Part)


def by_name(items: Iterable[Named]) -> dict[str, Named]:
    """Items by their names.

    Raises:
        ValueError: two of one name that are not the same.
    """
    result: dict[str, Named] = {}
    for item in items:
        if result.setdefault(item.name, item) != item:
            raise ValueError(f"two different things are named {item.name}")
    return result


def require_same_scene(out: Path, scene: Scene) -> None:
    """Refuse a run directory of another scene; where its closure's file lies does not matter, nor new defaults, nor
    samples that the study does not ask for.

    Raises:
        InputError: naming the first key that differs.
    """
    if not (out / SCENE).is_file():
        return
    stored, wanted = (_flat(_bare(s)) for s in (load_scene(out / SCENE), scene))
    if not scene.output.samples:
        stored["output.samples"] = wanted["output.samples"]
    for key in {**wanted, **stored}:
        if stored.get(key) != wanted.get(key):
            limit = f"was run with {key} = {stored.get(key)!r}, the study asks for {wanted.get(key)!r}"
            raise InputError("--out", str(out), limit, "Move that run away, or choose another folder.")


def _bare(scene: Scene) -> dict[str, Any]:
    tables = scene.tables()
    tables["output"].pop("checkpoint_interval", None)
    return without_folders(tables)


def _flat(tables: dict[str, Any], prefix: str = "") -> dict[str, str]:
    flat: dict[str, str] = {}
    for key, value in tables.items():
        flat |= _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: json.dumps(value)}
    return flat


def _save(out: Path, closure: Any, metadata: dict[str, Any], begin: float) -> None:
    """Write a closure, with the time since `begin` in its metadata."""
    save_closure(out, closure, {**metadata, "study_seconds": clock.perf_counter() - begin})

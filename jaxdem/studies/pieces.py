"""A study's pieces of work: what its parts need, everything after what it needs itself."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from jaxdem.errors import InputError
from jaxdem.io import RunDirectory
from jaxdem.io.run_directory import SCENE
from jaxdem.io.scene_text import without_folders
from jaxdem.scene import Scene, load_scene
from jaxdem.studies.plan import (
    EnsembleSpec,
    FitSpec,
    Part,
    SmallerSpec,
    StressSpec,
    StudyPlan,
    TuneSpec,
    files_of,
    made_of,
)
from jaxdem.studies.pool import Piece
from jaxdem.train.architecture_table import read_search


@dataclasses.dataclass
class Pieces:
    """The pieces of a plan in a folder.

    Attributes:
        plan: what the study is made of.
        scenes: folder of the scenes' files.
        out: the study's folder.
    """

    plan: StudyPlan
    scenes: Path
    out: Path
    _found: dict[str, Piece] = dataclasses.field(default_factory=dict)

    def of(self, parts: Iterable[Part]) -> list[Piece]:
        """What these parts need.

        Raises:
            InputError: a run directory of another scene.
        """
        for part in parts:
            for name in part.runs:
                self._run(name)
            for name in part.datasets:
                self._dataset(name)
            for name in part.closures:
                self._closure(name)
            for factor in part.oracles:
                self._oracle(factor)
            for name in part.searches:
                self._search(name)
        return list(self._found.values())

    def scene_of(self, name: str) -> Scene:
        """Scene of a run."""
        spec = self.plan.runs[name]
        overrides = dict(spec.overrides)
        if spec.closure is not None:
            overrides["closure.file"] = str(self._file(spec.closure).resolve())
        if spec.subgrid is not None:
            overrides["fluid.subgrid"] = str(self._file(spec.subgrid, "subgrid").resolve())
        return load_scene(self.scenes / spec.scene, overrides)

    def _run(self, name: str) -> None:
        if name in self._found:
            return
        spec, out = self.plan.runs[name], self.out / name
        needs = tuple(self._closure(closure) for closure in spec.learned)
        scene = self.scene_of(name)
        require_same_scene(out, scene)
        work = {"kind": "run", "scene": scene.tables(), "out": str(out)}
        self._found[name] = Piece(name, work, scene.time.end, needs, RunDirectory.is_complete(out))

    def _dataset(self, name: str) -> None:
        if name in self._found:
            return
        spec, out = self.plan.datasets[name], self.out / f"{name}.h5"
        self._run(spec.run)
        scene = self.scene_of(spec.run)
        samples = scene.time.end / scene.output.samples / spec.every
        work = {
            "kind": "dataset", "run": str(self.out / spec.run), "out": str(out), "coarsen": spec.coarsen, "every": spec.every,
            "overrides": dict(spec.overrides),
        }  # fmt: skip
        self._found[name] = Piece(name, work, len(spec.coarsen) * samples, (spec.run,), out.is_file())

    def _closure(self, name: str) -> str:
        """Adds a closure and all that it is made of; returns the name of its piece."""
        piece = f"train {name}"
        if piece in self._found:
            return piece
        spec = self.plan.closures[name]
        files = {kind: self.out / file for kind, file in files_of(spec).items()}
        needs = [self._closure(other) for other in made_of(spec)]
        if isinstance(spec, TuneSpec):
            self._run(spec.reference)
            work, total = self._tuning(spec)
            needs.append(spec.reference)
        elif isinstance(spec, EnsembleSpec):
            first = self.plan.closures[spec.members[0]]
            assert isinstance(first, FitSpec), "an ensemble's members differ in their seed"
            members = [str(self._file(other)) for other in spec.members]
            work, total = {**self._fit(first)[0], "kind": "ensemble", "members": members}, 1.0
        elif isinstance(spec, StressSpec):
            work, total = {"kind": "stress", "viscosity": spec.viscosity, "gradient": spec.gradient}, 1.0
        else:
            for dataset in spec.datasets:
                self._dataset(dataset)
            needs += spec.datasets
            work, total = self._smaller(spec) if isinstance(spec, SmallerSpec) else self._fit(spec)
        if not isinstance(spec, TuneSpec):
            (work["out"],) = map(str, files.values())
        done = all(file.is_file() for file in files.values())
        self._found[piece] = Piece(piece, work, total, tuple(needs), done)
        return piece

    def _fit(self, spec: FitSpec) -> tuple[dict[str, Any], float]:
        work = {
            "kind": "fit", "recipe": spec.recipe, "settings": dataclasses.asdict(spec.settings),
            "datasets": self._files(spec.datasets), "parity": str(self.out / f"{spec.name}.parity.npz"),
        }  # fmt: skip
        return work, spec.settings.epochs

    def _smaller(self, spec: SmallerSpec) -> tuple[dict[str, Any], float]:
        work = {
            "kind": "distill" if spec.hidden else "prune", "teacher": str(self._file(spec.teacher)), "hidden": spec.hidden,
            "neurons": spec.neurons, "epochs": spec.epochs, "datasets": self._files(spec.datasets),
        }  # fmt: skip
        return work, spec.epochs

    def _tuning(self, spec: TuneSpec) -> tuple[dict[str, Any], float]:
        reference, settings = self.plan.runs[spec.reference], spec.settings
        scene = load_scene(self.scenes / reference.scene, {**reference.overrides, **spec.overrides})
        work = {
            "kind": "tune", "scene": scene.tables(), "reference": str(self.out / spec.reference),
            "start": None if spec.start is None else str(self._file(spec.start)), "settings": dataclasses.asdict(settings),
            "outs": {kind: str(self.out / file) for kind, file in files_of(spec).items()},
        }  # fmt: skip
        return work, settings.updates * len(settings.horizons or ())

    def _oracle(self, factor: int) -> None:
        out = self.out / f"oracle_{factor}.npz"
        self._run("fine")
        work = {"kind": "oracle", "run": str(self.out / "fine"), "coarsen": factor, "out": str(out)}
        total = self.scene_of("fine").time.end
        self._found[out.stem] = Piece(out.stem, work, total, ("fine",), out.is_file())

    def _search(self, name: str) -> None:
        spec, out = self.plan.searches[name], self.out / name
        for dataset in spec.datasets:
            self._dataset(dataset)
        work = {
            "kind": "search", "sweep": spec.sweep, "settings": dataclasses.asdict(spec.settings), "out": str(out),
            "datasets": self._files(spec.datasets),
        }  # fmt: skip
        rows = read_search(out)
        number = spec.sweep.count(",") + 1
        done = len(rows) == number and all(row["samples"] or row["reason"] for row in rows)
        self._found[name] = Piece(name, work, number * spec.settings.epochs, spec.datasets, done)

    def _file(self, closure: str, kind: str = "drag") -> Path:
        return self.out / files_of(self.plan.closures[closure])[kind]

    def _files(self, datasets: Iterable[str]) -> list[str]:
        return [str(self.out / f"{dataset}.h5") for dataset in datasets]


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

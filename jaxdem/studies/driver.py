"""A full-size study: its pieces of work through the pool, then every part's tables, and one report."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from jaxdem.errors import InputError
from jaxdem.io import RunDirectory
from jaxdem.io.run_directory import SCENE
from jaxdem.report import Comparison, compare
from jaxdem.scene import Scene, load_scene
from jaxdem.studies.evidence import Evidence
from jaxdem.studies.measure import screen_time
from jaxdem.studies.part_budget import budget_part
from jaxdem.studies.part_closures import closures_part
from jaxdem.studies.part_generalisation import generalisation_part
from jaxdem.studies.part_mesh import mesh_part
from jaxdem.studies.part_pareto import pareto_part
from jaxdem.studies.plan import Part, StudyPlan
from jaxdem.studies.pool import Bars, Piece, Pool
from jaxdem.studies.tables import Section, write_results
from jaxdem.train.architecture_table import read_search

PARTS: dict[str, Callable[[Evidence], Section]] = {
    "mesh": mesh_part,
    "budget": budget_part,
    "closures": closures_part,
    "generalisation": generalisation_part,
    "pareto": pareto_part,
}
"""What answers each part's question."""


@dataclasses.dataclass
class FullStudy:
    """A study in its folder.

    Attributes:
        plan: what it is made of.
        scenes: folder of the scenes' files.
        out: its folder.
        bars: shows how it goes on.
        jobs: processes at once.
        chosen: names of the parts; all by default.
    """

    plan: StudyPlan
    scenes: Path
    out: Path
    bars: Bars
    jobs: int
    chosen: Sequence[str] = ()
    problems: dict[str, str] = dataclasses.field(default_factory=dict)

    @property
    def parts(self) -> list[Part]:
        """The chosen parts, in the plan's order.

        Raises:
            InputError: there is no such part.
        """
        for name in self.chosen:
            if name not in self.plan.parts:
                raise InputError("--parts", name, "is not known", f"known: {', '.join(self.plan.parts)}")
        return [part for part in self.plan.parts.values() if not self.chosen or part.name in self.chosen]

    def run(self) -> Comparison | None:
        """All of it; the comparison that report.html shows, None where the fine run is missing.

        Raises:
            InputError: an unknown part, or a run directory of another scene.
            Interrupted: SIGINT or SIGTERM; the runs have left checkpoints.
        """
        pieces = self.pieces()
        todo = sum(not piece.done for piece in pieces)
        self.bars.say(f"{len(pieces)} pieces of work, {todo} of them to do, {self.jobs} at a time.")
        self.problems = Pool(self.jobs, self.out / "logs", self.bars).do(pieces)
        sections = []
        for part in self.parts:
            evidence = self._evidence()
            sections.append(PARTS[part.name](evidence))
            self.bars.say(
                f"{part.name}: {len(evidence.missing)} missing" if evidence.missing else f"{part.name}: done"
            )
        write_results(self.out, sections, {"jobs": self.jobs}, self.plan.parts)
        return self._report(sections)

    def pieces(self) -> list[Piece]:
        """What the chosen parts need, everything after what it needs itself."""
        found: dict[str, Piece] = {}
        for part in self.parts:
            for name in part.runs:
                self._add_run(found, name)
            for name in part.datasets:
                self._add_dataset(found, name)
            for name in part.fits:
                self._add_fit(found, name)
            for factor in part.oracles:
                self._add_oracle(found, factor)
            for name in part.searches:
                self._add_search(found, name)
        return list(found.values())

    def scene_of(self, name: str) -> Scene:
        """Scene of a run."""
        spec = self.plan.runs[name]
        overrides = dict(spec.overrides)
        if spec.closure is not None:
            overrides["closure.file"] = str(self._evidence().closure_file(spec.closure).resolve())
        return load_scene(self.scenes / spec.scene, overrides)

    def _add_run(self, found: dict[str, Piece], name: str) -> None:
        if name in found:
            return
        spec, out = self.plan.runs[name], self.out / name
        needs: tuple[str, ...] = ()
        if spec.closure is not None:
            self._add_fit(found, spec.closure)
            needs = (f"train {spec.closure}",)
        scene = self.scene_of(name)
        require_same_scene(out, scene)
        tables = scene.model_dump(by_alias=True, exclude_none=True, mode="json")
        work = {"kind": "run", "scene": tables, "out": str(out)}
        found[name] = Piece(name, work, scene.time.end, needs, RunDirectory.is_complete(out))

    def _add_dataset(self, found: dict[str, Piece], name: str) -> None:
        if name in found:
            return
        spec, out = self.plan.datasets[name], self.out / f"{name}.h5"
        self._add_run(found, spec.run)
        scene = self.scene_of(spec.run)
        samples = scene.time.end / scene.output.samples / spec.every
        work = {
            "kind": "dataset", "run": str(self.out / spec.run), "out": str(out), "coarsen": spec.coarsen, "every": spec.every,
        }  # fmt: skip
        found[name] = Piece(name, work, len(spec.coarsen) * samples, (spec.run,), out.is_file())

    def _add_fit(self, found: dict[str, Piece], name: str) -> None:
        piece = f"train {name}"
        if piece in found:
            return
        spec, out = self.plan.fits[name], self._evidence().closure_file(name)
        for dataset in spec.datasets:
            self._add_dataset(found, dataset)
        work = {
            "kind": "fit", "recipe": spec.recipe, "settings": dataclasses.asdict(spec.settings), "out": str(out),
            "datasets": [str(self.out / f"{dataset}.h5") for dataset in spec.datasets],
            "parity": str(self.out / f"{name}.parity.npz"),
        }  # fmt: skip
        found[piece] = Piece(piece, work, spec.settings.epochs, spec.datasets, out.is_file())

    def _add_oracle(self, found: dict[str, Piece], factor: int) -> None:
        out = self.out / f"oracle_{factor}.npz"
        self._add_run(found, "fine")
        work = {"kind": "oracle", "run": str(self.out / "fine"), "coarsen": factor, "out": str(out)}
        total = self.scene_of("fine").time.end
        found[out.stem] = Piece(out.stem, work, total, ("fine",), out.is_file())

    def _add_search(self, found: dict[str, Piece], name: str) -> None:
        spec, out = self.plan.searches[name], self.out / name
        for dataset in spec.datasets:
            self._add_dataset(found, dataset)
        work = {
            "kind": "search", "sweep": spec.sweep, "settings": dataclasses.asdict(spec.settings), "out": str(out),
            "datasets": [str(self.out / f"{dataset}.h5") for dataset in spec.datasets],
        }  # fmt: skip
        rows = read_search(out)
        number = spec.sweep.count(",") + 1
        done = len(rows) == number and all(row["samples"] or row["reason"] for row in rows)
        found[name] = Piece(name, work, number * spec.settings.epochs, spec.datasets, done)

    def _evidence(self) -> Evidence:
        problems = {name.removeprefix("train "): why for name, why in self.problems.items()}
        return Evidence(self.plan, self.out, problems, self.jobs)

    def _report(self, sections: Iterable[Section]) -> Comparison | None:
        """report.html: the injection scene's runs with the first pack, beside the fine run."""
        evidence = self._evidence()
        fine = evidence.run("fine")
        names = [
            name
            for part in ("mesh", "closures")
            for name in self.plan.parts[part].runs
            if name.startswith("coarse_") and "_seed_" not in name
        ]
        found = {name: run for name in dict.fromkeys(names) if (run := evidence.run(name)) is not None}
        if fine is None or not found:
            return None
        cost = {name: evidence.training_seconds(self.plan.runs[name].closure) for name in found}
        return compare(
            fine,
            list(found.values()),
            self.out,
            names=["fine", *found],
            noise=evidence.jittered("fine"),
            parity=evidence.parity("filtered"),
            training_cost={name: seconds for name, seconds in cost.items() if seconds is not None},
            notes=[sentence for section in sections for sentence in section.text],
            until=screen_time(fine),
            title="Injection: a learned drag closure on coarse meshes",
        )


def require_same_scene(out: Path, scene: Scene) -> None:
    """Refuse a run directory of another scene; where its closure's file lies does not matter, nor new defaults.

    Raises:
        InputError: naming the first key that differs.
    """
    if not (out / SCENE).is_file():
        return
    stored, wanted = (_flat(_bare(s)) for s in (load_scene(out / SCENE), scene))
    for key in {**wanted, **stored}:
        if stored.get(key) != wanted.get(key):
            limit = f"was run with {key} = {stored.get(key)!r}, the study asks for {wanted.get(key)!r}"
            raise InputError("--out", str(out), limit, "Move that run away, or choose another folder.")


def _bare(scene: Scene) -> dict[str, Any]:
    tables = scene.model_dump(by_alias=True, exclude_none=True, mode="json")
    tables["output"].pop("checkpoint_interval", None)
    if "file" in tables["closure"]:
        tables["closure"]["file"] = Path(tables["closure"]["file"]).name
    return tables


def _flat(tables: dict[str, Any], prefix: str = "") -> dict[str, str]:
    flat: dict[str, str] = {}
    for key, value in tables.items():
        flat |= (
            _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: json.dumps(value)}
        )
    return flat


def default_jobs() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

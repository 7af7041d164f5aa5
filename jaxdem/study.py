"""The demonstration of a learned drag closure: run, dataset, training, coarse runs, comparison.

A stage that is done is not done again; a run that was stopped goes on from its checkpoint. Everything that a stage
needs is in the study's folder, so the folder may be moved. The study at full size is in `studies` of the source.
"""

from __future__ import annotations

import dataclasses
import io
import json
import math
import time as clock
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from jaxdem.closures import load_closure, save_closure
from jaxdem.errors import InputError, required
from jaxdem.files.durable import write_bytes
from jaxdem.files.reading import parse_json, read_arrays, read_text
from jaxdem.io import Run
from jaxdem.io.access import locked, reason_of
from jaxdem.report import Candidate, Comparison, Page, compare
from jaxdem.run.scene_run import simulate_once
from jaxdem.run.sweep import Listener
from jaxdem.run.time_loop import Progress
from jaxdem.scene import Scene, load_scene
from jaxdem.train.dataset import make_dataset
from jaxdem.train.dataset_file import SEEING, read_dataset
from jaxdem.train.fit import fit_filtered, fit_paper
from jaxdem.train.fit_settings import FitSettings

SCENES = Path(__file__).parent / "scenes"

SHARP: dict[str, Any] = {"fluid.advection": "central", "coupling.kernel_width": {"diameters": 1.5, "cells": 0.5}}
"""A coarse fluid that smears less: of its own momentum, and of what the particles do to it (kernels half as wide)."""


class Coarse(NamedTuple):
    """A cheap way to run the scene.

    Attributes:
        folder: of its runs.
        label: in tables and figures.
        keys: what differs from the scene, beside the mesh.
    """

    folder: str
    label: str
    keys: Mapping[str, Any] = MappingProxyType({})


@dataclasses.dataclass(frozen=True)
class Plan:
    """What a demonstration does.

    Attributes:
        scene: name of the scene's file.
        title: of the page.
        factor: of the coarse mesh on the cell side.
        coarse: the cheap runs, on that mesh; the closure is trained and run for the last of them.
        samples: time between samples of the reference run [s].
        seeds: of further packs, which differ in their random numbers alone; every run is done with each of them too, so
            that the noise is known.
        settings: of the recipe `filtered`.
        kernel: keys with which the reference's grains are seen as the last of the coarse runs sees its particles.
        notes: sentences for the page.
    """

    scene: str
    title: str
    factor: int
    coarse: tuple[Coarse, ...]
    samples: float
    seeds: tuple[int, ...]
    settings: FitSettings
    kernel: Mapping[str, Any]
    notes: tuple[str, ...]


DEMOS: dict[str, Plan] = {
    "clusters": Plan(
        scene="clusters_demo.toml",
        title="Clusters of grains in a gas: parcels on a coarse mesh, with a learned drag closure",
        factor=4,
        coarse=(
            Coarse("coarse", "coarse mesh"),
            Coarse("parcels", "parcels", {"particles.coarse_grain": 2.0, "particles.count": 688}),
        ),
        samples=0.005,
        seeds=(1, 2),
        settings=FitSettings.filtered(epochs=60),
        kernel={"coupling.kernel_width": {"diameters": 6.0, "cells": 0.5}},
        notes=(
            "Coarse mesh: cells four times as wide, of 12 diameters. Parcels: the same mesh, and every particle stands "
            "for four grains.",
        ),
    ),
    "injection": Plan(
        scene="injection_demo.toml",
        title="Injection: a learned drag closure on a coarse mesh",
        factor=4,
        coarse=(Coarse("coarse_4", "coarse 4x"), Coarse("coarse_4_sharp", "coarse 4x, sharp", SHARP)),
        samples=0.02,
        seeds=(1, 2),
        settings=FitSettings.filtered(epochs=60, samples=60_000),
        kernel={key: value for key, value in SHARP.items() if key.startswith(SEEING)},
        notes=(
            "Sharp is a coarse fluid that smears less: "
            + ", ".join(f"{key} = {value}" for key, value in SHARP.items())
            + ".",
        ),
    ),
}
"""Demonstrations by the study's name."""


@dataclasses.dataclass
class Study:
    """A demonstration in its folder."""

    plan: Plan
    scene: Scene
    out: Path
    listener: Listener

    def run(self) -> Comparison:
        """All stages; returns the comparison that the report shows."""
        reference, *noise = self._packs("fine", {}, {"output.samples": self.plan.samples})
        closure = self._closure(self._dataset(reference))
        metadata = load_closure(closure)[1]
        fine = required(self.scene.fluid, "fluid").cells
        cells = {"fluid.cells": [max(1, round(count / self.plan.factor)) for count in fine]}
        candidates = [_candidate(one.label, self._packs(one.folder, {**cells, **one.keys})) for one in self.plan.coarse]
        last = self.plan.coarse[-1]
        keys = {**cells, **last.keys, "closure.file": str(closure)}
        learned = self._packs(f"{last.folder}_closure", keys)
        candidates.append(_candidate(f"{last.label} + closure", learned, float(metadata["study_seconds"])))
        page = Page(self.plan.title, self._notes(metadata), parity_figures(read_stored(parity_file(closure))))
        return compare(Candidate(reference, "fine"), candidates, self.out, noise=noise, page=page)

    def _packs(self, name: str, overrides: Mapping[str, Any], first: Mapping[str, Any] | None = None) -> list[Run]:
        """Runs with the scene's pack, which has the overrides of `first` too, and with the other packs."""
        own = self._simulation(name, {**overrides, **(first or {})})
        others = (self._simulation(f"{name}_seed_{seed}", {**overrides, "seed": seed}) for seed in self.plan.seeds)
        return [own, *others]

    def _simulation(self, name: str, overrides: dict[str, Any]) -> Run:
        """A run in the study's folder, made, gone on with, or taken as it is."""
        scene = load_scene(self.scene.tables(), overrides)

        def begin() -> Progress:
            advance = self.listener.stage(f"run {name}", scene.time.end)
            return lambda time, _: advance(time)

        return simulate_once(scene, self.out / name, begin)

    def _dataset(self, reference: Run) -> Path:
        """Training data from the reference run, averaged to its own mesh and to the coarse one."""
        path, factors = self.out / "dataset.h5", (1, self.plan.factor)
        if not path.is_file():
            times = required(reference.samples, "samples").times
            advance = self.listener.stage("dataset", len(factors) * len(times))
            make_dataset(reference.path, path, factors, lambda done, _: advance(done), overrides=dict(self.plan.kernel))
        return path

    def _closure(self, dataset: Path) -> Path:
        """The closure trained on the dataset, with the arrays of its parity plot beside it."""
        path = self.out / "filtered.closure.h5"
        if not (path.is_file() and parity_file(path).is_file()):
            advance = self.listener.stage("train filtered", self.plan.settings.epochs)
            fit_to_files("filtered", [dataset], self.plan.settings, path, advance)
        return path

    def _notes(self, metadata: dict[str, Any]) -> list[str]:
        notes = [
            "The closures are trained on the fine run that is also the reference: what is tested is whether they give "
            "back what they have seen, not whether they hold elsewhere.",
            *self.plan.notes,
        ]
        for factor, figures in metadata.get("r2", {}).items():
            notes.append(
                f"Recipe filtered, inputs averaged {factor}x, held out ({metadata.get('split', '')}): "
                f"R2 {figures['closure']:.4f}, base law {figures['base']:.4f}, regression {figures['regression']:.4f}."
            )
        return notes


def _candidate(name: str, runs: Sequence[Run], training_cost: float = math.nan) -> Candidate:
    """The runs of one kind, the first with the scene's own pack."""
    return Candidate(runs[0], name, runs[1:], training_cost)


def fit_to_files(
    recipe: str, datasets: Sequence[Path], settings: FitSettings, out: Path, report: Callable[[float], None]
) -> None:
    """Train a closure; write its file and, beside it, the arrays "factor/name" of its parity plot.

    Args:
        recipe: "paper" or "filtered".
        datasets: files.
        settings: of the fit.
        out: closure file; its metadata has the time that all of it took, `study_seconds`.
        report: called with the number of epochs done.
    """
    begin = clock.perf_counter()
    fit = {"filtered": fit_filtered, "paper": fit_paper}[recipe]
    found = fit([read_dataset(path) for path in datasets], settings, progress=lambda epoch, *_: report(epoch))
    arrays = {f"{factor}/{name}": array for factor, plot in found.parity.items() for name, array in plot.items()}
    content = io.BytesIO()
    np.savez(content, **arrays)  # type: ignore[arg-type]
    write_bytes(parity_file(out), content.getvalue())
    save_closure(out, found.closure, {**found.metadata, "study_seconds": clock.perf_counter() - begin})


def parity_file(closure: Path) -> Path:
    """The file of a closure's parity plot."""
    return closure.with_name(closure.name.replace(".closure.h5", ".parity.npz"))


def parity_figures(arrays: Mapping[str, np.ndarray]) -> dict[str, dict[str, np.ndarray]]:
    """Arrays "factor/name" by the mesh that the inputs are averaged to, as `jaxdem.report.compare` takes them."""
    figures: dict[str, dict[str, np.ndarray]] = {}
    for key, array in arrays.items():
        factor, name = key.split("/")
        figures.setdefault("fine inputs" if factor == "1" else f"inputs averaged {factor}x", {})[name] = array
    return figures


def read_stored(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an .npz file of a study.

    Raises:
        InputError: it is damaged.
    """
    try:
        return read_arrays(path)
    except (OSError, ValueError) as error:
        limit = f"cannot be read ({reason_of(error)})"
        raise InputError(path.name, str(path), limit, "Remove it, and the study makes it again.") from error


def run_study(name: str, out: str | Path, listener: Listener) -> Comparison:
    """A demonstration by its study's name, in the folder `out`; `listener` hears how it goes on.

    Raises:
        InputError: there is no such study, or the folder holds another study or another scene's run.
        Interrupted: SIGINT or SIGTERM; checkpoints were written.
    """
    if name not in DEMOS:
        raise InputError("NAME", name, "is not known", f"known: {', '.join(DEMOS)}")
    plan, out, begin = DEMOS[name], Path(out), clock.perf_counter()
    claim(out, identity(name))
    with locked(out):
        comparison = Study(plan, load_scene(SCENES / plan.scene), out, listener).run()
    listener.say(f"The study took {clock.perf_counter() - begin:.0f} s.")
    return comparison


def identity(name: str) -> dict[str, Any]:
    """What marks the folder of a demonstration."""
    plan = DEMOS[name]
    runs = {coarse.folder: dict(coarse.keys) for coarse in plan.coarse}
    return {"study": name, "scale": "demo", "runs": runs, "seeds": list(plan.seeds)}


def claim(out: Path, identity: dict[str, Any], known: Collection[str] = ()) -> None:
    """Mark the folder as this study's; refuse a folder that holds something else than what is known.

    Args:
        out: the folder; made where there is none.
        identity: of the study, kept in study.json.
        known: names that may be in a folder that has no mark yet.

    Raises:
        InputError: it holds another study or something else, or cannot be written.
    """
    marker, remedy = out / "study.json", "choose another folder"
    try:
        if marker.is_file():
            found = parse_json(read_text(marker))
            if found != identity:
                raise InputError("--out", str(out), f"holds the study {found}", remedy)
            return
        if out.is_dir() and any(entry.name not in known for entry in out.iterdir()):
            raise InputError("--out", str(out), "is not empty and holds no study", remedy)
        out.mkdir(parents=True, exist_ok=True)
        write_bytes(marker, (json.dumps(identity) + "\n").encode())
    except ValueError:
        raise InputError("--out", str(out), "has a study.json that is not a study's", remedy) from None
    except OSError as error:
        raise InputError("--out", str(out), f"cannot be written ({error.strerror})", remedy) from None

"""What the processes of a study do: one piece of work each, read as JSON from standard input, told of in JSON lines.

`python -m studies.work` with CORE in the environment stays on that core. Lines are {"done": how much}, then
{"finished": true} or {"failed": why} or {"stopped": signal number}.
"""

from __future__ import annotations

import io
import json
import os
import sys
import time as clock
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

Report = Callable[[float], None]

CORE = "JAXDEM_STUDY_CORE"


def do_run(work: dict[str, Any], report: Report) -> None:
    """A run: `scene` (tables), `out`."""
    from jaxdem.run.simulate import simulate_once
    from jaxdem.scene import load_scene

    simulate_once(load_scene(work["scene"]), Path(work["out"]), lambda: lambda time, _: report(time))


def do_dataset(work: dict[str, Any], report: Report) -> None:
    """Training data: `run`, `out`, `coarsen`, `every`, `overrides`."""
    from jaxdem.train.dataset import make_dataset

    coarsen, every = tuple(work["coarsen"]), int(work["every"])
    make_dataset(work["run"], work["out"], coarsen, lambda done, _: report(done), every, work["overrides"])


def do_fit(work: dict[str, Any], report: Report) -> None:
    """A closure: `recipe`, `settings`, `datasets`, `out`, `parity` (file)."""
    files = [Path(name) for name in work["datasets"]]
    out, parity = Path(work["out"]), Path(work["parity"])
    fit_to_files(work["recipe"], files, _settings(work["settings"]), out, parity, report)


def do_search(work: dict[str, Any], report: Report) -> None:
    """Networks of the recipe `paper` that differ in one setting: `sweep`, `settings`, `datasets`, `out` (folder)."""
    from jaxdem.train.architecture_search import parse_sweep, search

    datasets = _read_all(work["datasets"])
    varied = [parse_sweep(work["sweep"])]
    search(datasets, "paper", _settings(work["settings"]), varied, Path(work["out"]), _Epochs(report))


class _Epochs:
    """Hears how a search goes on, and reports the epochs of all its groups together."""

    def __init__(self, report: Report):
        self.report, self.before = report, 0.0

    def stage(self, _: str, total: float) -> Callable[[float], None]:
        before = self.before
        self.before += total
        return lambda done: self.report(before + done)

    def say(self, message: str) -> None:
        print(message, file=sys.stderr)


def _settings(plain: dict[str, Any]) -> Any:
    from jaxdem.train.fit_settings import FitSettings

    return FitSettings(**_tuples(plain))


def _tuples(plain: dict[str, Any]) -> dict[str, Any]:
    """Settings as they were before they were JSON."""
    return {name: tuple(value) if isinstance(value, list) else value for name, value in plain.items()}


def fit_to_files(recipe: str, datasets: list[Path], settings: Any, out: Path, parity: Path, report: Report) -> None:
    """Train a closure; write its file and, beside it, the arrays "factor/name" for the parity plot.

    Args:
        recipe: "paper" or "filtered".
        datasets: files.
        settings: `FitSettings`.
        out, parity: files.
        report: called with the number of epochs done.
    """
    import numpy as np

    from jaxdem.io.durable import write_bytes
    from jaxdem.train.fit import fit_filtered, fit_paper

    begin = clock.perf_counter()
    fit = {"filtered": fit_filtered, "paper": fit_paper}[recipe]
    found = fit(_read_all(datasets), settings, progress=lambda epoch, *_: report(epoch))
    arrays = {
        f"{factor}/{name}": array for factor, figures in found.parity.items() for name, array in figures.items()
    }  # fmt: skip
    content = io.BytesIO()
    np.savez(content, **arrays)  # type: ignore[arg-type]
    write_bytes(parity, content.getvalue())
    _save(out, found.closure, found.metadata, begin)


def do_tune(work: dict[str, Any], report: Report) -> None:
    """Closures trained through the solver: `scene` (tables, coarse), `reference`, `start` (file), `settings`, `outs`."""
    from jaxdem.closures import SubgridClosure
    from jaxdem.closures.file import load_single
    from jaxdem.scene import load_scene
    from jaxdem.train.closures import Closures
    from jaxdem.train.finetune import FinetuneSettings, finetune

    begin = clock.perf_counter()
    settings, outs = FinetuneSettings(**_tuples(work["settings"])), work["outs"]
    drag, before = (None, {}) if work["start"] is None else load_single(work["start"], "")
    stress = SubgridClosure.initial() if "subgrid" in outs else None
    given = Closures(drag, stress, tuple(outs))
    scene = load_scene(work["scene"])
    found = finetune(scene, work["reference"], given, {"drag": before}, settings, lambda done, *_: report(float(done)))
    for kind, out in outs.items():
        _save(Path(out), getattr(found.closures, kind), found.metadata[kind], begin)


def do_distill(work: dict[str, Any], report: Report) -> None:
    """A small network taught by a closure: `teacher`, `hidden`, `epochs`, `datasets`, `out`."""
    from jaxdem.closures import load_closure
    from jaxdem.train.compress import distill, settings_for

    begin = clock.perf_counter()
    teacher, _ = load_closure(work["teacher"])
    settings = settings_for(teacher, hidden=tuple(work["hidden"]), epochs=work["epochs"])
    found = distill(teacher, _read_all(work["datasets"]), settings, lambda epoch, *_: report(epoch))
    _save(Path(work["out"]), found.closure, found.metadata, begin)


def do_prune(work: dict[str, Any], report: Report) -> None:
    """A closure without its least neurons, trained on: `teacher`, `neurons`, `epochs`, `datasets`, `out`."""
    from jaxdem.closures.file import load_single
    from jaxdem.train.compress import prune, settings_for

    begin = clock.perf_counter()
    closure, _ = load_single(work["teacher"], "")
    settings, data = settings_for(closure, epochs=work["epochs"]), _read_all(work["datasets"])
    found = prune(closure, data, work["neurons"], settings, True, lambda epoch, *_: report(epoch))
    _save(Path(work["out"]), found.closure, found.metadata, begin)


def do_ensemble(work: dict[str, Any], report: Report) -> None:
    """Closures as one: `members` (files), `recipe`, `settings`, `datasets` of the first, `out`."""
    from jaxdem.closures.file import load_single
    from jaxdem.train.ensemble import put_together
    from jaxdem.train.fit import RECIPES

    begin = clock.perf_counter()
    members = [load_single(name, "")[0] for name in work["members"]]
    problem = RECIPES[work["recipe"]](_read_all(work["datasets"]), _settings(work["settings"]))
    found = put_together(problem, members, [], 0.0)
    _save(Path(work["out"]), found.closure, found.metadata, begin)
    report(1.0)


def do_stress(work: dict[str, Any], report: Report) -> None:
    """A subgrid stress of constant coefficients: `viscosity`, `gradient`, `out`."""
    from jaxdem.closures import SubgridClosure

    begin = clock.perf_counter()
    _save(Path(work["out"]), SubgridClosure.constant(work["viscosity"], work["gradient"]), {}, begin)
    report(1.0)


def _save(out: Path, closure: Any, metadata: dict[str, Any], begin: float) -> None:
    """Write a closure, with the time since `begin` in its metadata."""
    from jaxdem.closures import save_closure

    save_closure(out, closure, {**metadata, "study_seconds": clock.perf_counter() - begin})


def _read_all(datasets: Iterable[str | Path]) -> list[Any]:
    from jaxdem.train.dataset_file import read_dataset

    return [read_dataset(Path(name)) for name in datasets]


def do_oracle(work: dict[str, Any], report: Report) -> None:
    """A replay: `run`, `out`, `coarsen`."""
    from jaxdem.io import load_run
    from jaxdem.studies.oracle import replay_to_file

    replay_to_file(load_run(work["run"]), int(work["coarsen"]), Path(work["out"]), report)


WORK: dict[str, Callable[[dict[str, Any], Report], None]] = {
    "run": do_run,
    "dataset": do_dataset,
    "fit": do_fit,
    "tune": do_tune,
    "distill": do_distill,
    "prune": do_prune,
    "ensemble": do_ensemble,
    "stress": do_stress,
    "search": do_search,
    "oracle": do_oracle,
}
"""Kinds of work."""


def main() -> int:
    """Do what standard input says."""
    core = os.environ.get(CORE)
    if core is not None and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {int(core)})
    from jaxdem.errors import JaxdemError
    from jaxdem.run.compilation_cache import use_compilation_cache

    work = json.load(sys.stdin)
    use_compilation_cache()
    import jax

    from jaxdem.run.simulate import Interrupted

    if work.get("scene", {}).get("precision") == "float64":
        jax.config.update("jax_enable_x64", True)
    last = 0.0

    def report(done: float) -> None:
        nonlocal last
        if clock.monotonic() - last > 0.5:
            last = clock.monotonic()
            _tell({"done": float(done)})

    try:
        WORK[work["kind"]](work, report)
    except JaxdemError as error:
        _tell({"failed": str(error)})
        return error.exit_code
    except Interrupted as stop:
        _tell({"stopped": stop.number})
        return 128 + stop.number
    _tell({"finished": True})
    return 0


def _tell(what: dict[str, Any]) -> None:
    print(json.dumps(what), flush=True)


if __name__ == "__main__":
    code = main()
    if code > 128:  # stopped by a signal: Python would wait for a compiler that is still at work in a thread
        os._exit(code)
    sys.exit(code)

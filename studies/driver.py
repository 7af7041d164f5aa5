"""The whole study: its pieces of work through the pool, then every part's tables, and one report."""

from __future__ import annotations

import contextlib
import math
import os
import platform
import sys
import time as clock
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from jaxdem.errors import InputError
from jaxdem.io.access import locked
from jaxdem.report import Candidate, Comparison, Page, compare
from jaxdem.run.summary import versions
from jaxdem.study import claim
from studies.evidence import Evidence
from studies.injection import injection_plan
from studies.measure import screen_time
from studies.part_budget import budget_part
from studies.part_closures import closures_part
from studies.part_generalisation import generalisation_part
from studies.part_mesh import mesh_part
from studies.part_pareto import pareto_part
from studies.part_smaller import smaller_part
from studies.part_solver import solver_part
from studies.pool import Pool
from studies.specs import Folder, Plan, RunSpec
from studies.tables import Section, write_results

PLANS: dict[str, Callable[[], Plan]] = {"injection": injection_plan}
"""Studies by name."""

PARTS: dict[str, Callable[[Evidence], Section]] = {
    "mesh": mesh_part,
    "budget": budget_part,
    "closures": closures_part,
    "solver": solver_part,
    "smaller": smaller_part,
    "generalisation": generalisation_part,
    "pareto": pareto_part,
}
"""What answers each part's question."""


def run_study(
    name: str, out: Path, parts: Sequence[str] = (), jobs: int | None = None, quiet: bool = False
) -> dict[str, str]:
    """A study in the folder `out`; returns what was not done, name -> why.

    Args:
        name: of the study.
        out: folder.
        parts: names of parts; all by default.
        jobs: processes at once, one a core by default; 0 does nothing, and writes tables and report of what is there.
        quiet: show no bars.

    Raises:
        InputError: unknown name or part, or the folder holds another study or another scene's run.
        Stopped: SIGINT or SIGTERM; checkpoints were written.
    """
    if name not in PLANS:
        raise InputError("NAME", name, "is not known", f"known: {', '.join(PLANS)}")
    plan, begin = PLANS[name](), clock.perf_counter()
    for part in parts:
        if part not in plan.parts:
            raise InputError("--parts", part, "is not known", f"known: {', '.join(plan.parts)}")
    if jobs is not None and jobs < 0:
        limit = "must be at least 1, or 0 for the tables of finished runs"
        raise InputError("--jobs", jobs, limit, "Leave it out to use one process per core.")
    claim(out, {"study": name, "scale": "paper"}, plan.files)
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeRemainingColumn())
    bars = Progress(*columns, disable=quiet or not sys.stdout.isatty())
    # Tables and report of what is there may be asked for while the runs go on.
    with contextlib.nullcontext() if jobs == 0 else locked(out), bars:
        problems = do(Folder(plan, out), parts, default_jobs() if jobs is None else jobs, bars)
    bars.console.print(f"The study took {clock.perf_counter() - begin:.0f} s.")
    return problems


def do(folder: Folder, chosen: Sequence[str], jobs: int, bars: Progress) -> dict[str, str]:
    """The chosen parts, all by default: work, tables and report; returns what was not done, name -> why."""
    parts = [part for part in folder.plan.parts.values() if not chosen or part.name in chosen]
    pieces = folder.pieces(parts)
    todo = sum(not piece.done for piece in pieces)
    say(bars, f"{len(pieces)} pieces of work, {todo} of them to do, {jobs} at a time.")
    problems = Pool(jobs, folder.out / "logs", bars).do(pieces) if jobs else {}
    sections = []
    for part in parts:
        evidence = Evidence(folder, problems, jobs)
        sections.append(PARTS[part.name](evidence))
        say(bars, f"{part.name}: {len(evidence.missing)} missing" if evidence.missing else f"{part.name}: done")
    machine = {"processor": platform.processor() or platform.machine(), "cores": os.cpu_count()}
    about: Mapping[str, Any] = {"jobs": jobs, "machine": machine, "versions": versions()}
    report(Evidence(folder, problems, jobs), write_results(folder.out, sections, about, folder.plan.parts))
    return problems


def say(bars: Progress, message: str) -> None:
    """A line for the reader."""
    bars.console.print(message, markup=False, highlight=False, soft_wrap=True)


def report(evidence: Evidence, sections: Sequence[Section]) -> Comparison | None:
    """report.html: the injection scene's runs with the first pack, beside the fine run; None where that is missing."""
    fine, plan = evidence.run("fine"), evidence.plan
    names = [name for part in ("mesh", "closures", "solver") for name in plan.names(part, RunSpec)]
    names = [name for name in dict.fromkeys(names) if name.startswith("coarse_") and "_seed_" not in name]
    found = {name: run for name in names if (run := evidence.run(name)) is not None}
    if fine is None or not found:
        return None
    candidates = [Candidate(run, name, (), evidence.training_of(name) or math.nan) for name, run in found.items()]
    page = Page(
        title="Injection: a learned drag closure on coarse meshes",
        notes=["Runs whose errors alone are used end earlier: their run times are of less simulated time."],
        parity={**evidence.parity("filtered"), **evidence.parity("paper")},
        sections=[section.page() for section in sections],
    )
    noise, until = evidence.jittered("fine"), screen_time(fine)
    return compare(Candidate(fine, "fine"), candidates, evidence.out, noise=noise, until=until, page=page)


def default_jobs() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

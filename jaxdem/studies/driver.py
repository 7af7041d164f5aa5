"""A full-size study: its pieces of work through the pool, then every part's tables, and one report."""

from __future__ import annotations

import dataclasses
import os
import platform
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from jaxdem.errors import InputError
from jaxdem.report import Comparison, compare
from jaxdem.run.records import versions
from jaxdem.studies.evidence import Evidence
from jaxdem.studies.measure import screen_time
from jaxdem.studies.part_budget import budget_part
from jaxdem.studies.part_closures import closures_part
from jaxdem.studies.part_generalisation import generalisation_part
from jaxdem.studies.part_mesh import mesh_part
from jaxdem.studies.part_pareto import pareto_part
from jaxdem.studies.part_smaller import smaller_part
from jaxdem.studies.part_solver import solver_part
from jaxdem.studies.pieces import Pieces
from jaxdem.studies.plan import Part, StudyPlan
from jaxdem.studies.pool import Bars, Piece, Pool
from jaxdem.studies.tables import Section, write_results

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


@dataclasses.dataclass
class FullStudy:
    """A study in its folder.

    Attributes:
        plan: what it is made of.
        scenes: folder of the scenes' files.
        out: its folder.
        bars: shows how it goes on.
        jobs: processes at once; 0 does no work, so that the tables are of what is there.
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
        if self.jobs:
            self.problems = Pool(self.jobs, self.out / "logs", self.bars).do(pieces)
        sections = []
        for part in self.parts:
            evidence = self._evidence()
            sections.append(PARTS[part.name](evidence))
            self.bars.say(f"{part.name}: {len(evidence.missing)} missing" if evidence.missing else f"{part.name}: done")
        return self._report(write_results(self.out, sections, self._about(), self.plan.parts))

    def _about(self) -> dict[str, Any]:
        """Where and with what the tables were made."""
        machine = {"processor": platform.processor() or platform.machine(), "cores": os.cpu_count()}
        return {"jobs": self.jobs, "machine": machine, "versions": versions()}

    def pieces(self) -> list[Piece]:
        """What the chosen parts need, everything after what it needs itself."""
        return Pieces(self.plan, self.scenes, self.out).of(self.parts)

    def _evidence(self) -> Evidence:
        problems = {name.removeprefix("train "): why for name, why in self.problems.items()}
        return Evidence(self.plan, self.out, problems, self.jobs)

    def _report(self, sections: Iterable[Section]) -> Comparison | None:
        """report.html: the injection scene's runs with the first pack, beside the fine run."""
        evidence = self._evidence()
        fine = evidence.run("fine")
        names = [
            name
            for part in ("mesh", "closures", "solver")
            for name in self.plan.parts[part].runs
            if name.startswith("coarse_") and "_seed_" not in name
        ]
        found = {name: run for name in dict.fromkeys(names) if (run := evidence.run(name)) is not None}
        if fine is None or not found:
            return None
        cost = {name: evidence.training_of(name) for name in found}
        return compare(
            fine,
            list(found.values()),
            self.out,
            names=["fine", *found],
            noise=evidence.jittered("fine"),
            parity={**evidence.parity("filtered"), **evidence.parity("paper")},
            training_cost={name: seconds for name, seconds in cost.items() if seconds is not None},
            sections=[section.page() for section in sections],
            until=screen_time(fine),
            notes=[
                "Runs that only errors are taken of end with what is compared: their run times are of less simulated time."
            ],
            title="Injection: a learned drag closure on coarse meshes",
        )


def default_jobs() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

"""All verification cases at full size: figures beside references, gates and run times.

    python benchmarks/verification.py                     every case; writes results/verification.{json,md} and
                                                          the table of docs/verification.md
    python benchmarks/verification.py --only "MFIX,Hertz"  some of them, all figures printed, nothing written

    python benchmarks/verification.py --topics contact,fluid those again; the others stay as they are in the results
    python benchmarks/verification.py --missing              those that are not in the results yet

Topics run in processes of their own, `--jobs` at a time; the results are written after each.

Exit code 1 if a figure is outside its gate.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import subprocess
import sys
import tempfile
import time
import traceback
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jax

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")

from benchmarks import harness  # noqa: E402 - after the settings
from tests.cases import collect  # noqa: E402
from tests.cases.registry import Case, Figure  # noqa: E402

PAGE = Path(__file__).parents[1] / "docs" / "verification.md"
BEGIN, END = "<!-- table: benchmarks/verification.py -->", "<!-- end of the table -->"


@dataclasses.dataclass(frozen=True)
class Outcome:
    """A case that was run; `problem` where it did not end."""

    case: Case
    figures: list[Figure]
    seconds: float
    problem: str = ""

    @property
    def passed(self) -> bool:
        return not self.problem and bool(self.figures) and all(figure.passed for figure in self.figures)

    @property
    def nearest(self) -> Figure | None:
        """The figure that fails, or comes nearest to its gate."""

        def use(figure: Figure) -> tuple[bool, float]:
            share = figure.error / figure.gate if figure.gate > 0.0 else 0.0
            return not figure.passed, share if math.isfinite(share) else math.inf

        return max(self.figures, key=use, default=None)


def run(case: Case) -> Outcome:
    """One case; what goes wrong in it is part of its outcome."""
    start = time.perf_counter()
    try:
        figures, problem = list(case.figures()), ""
    except Exception as error:
        traceback.print_exc()
        figures, problem = [], f"{type(error).__name__}: {error}"
    return Outcome(case, figures, time.perf_counter() - start, problem)


def number(value: float) -> str:
    return "0" if value == 0.0 else f"{value:.4g}"


def row(outcome: Outcome) -> str:
    """Case, source, figures and the one nearest to its gate."""
    case, figure = outcome.case, outcome.nearest
    cells = [case.name, case.source]
    if figure is None:
        cells += [outcome.problem, "", "", "", ""]
    else:
        unit = "" if figure.unit == "-" else f" {figure.unit}"
        cells += [
            figure.what,
            number(figure.expected) + unit,
            number(figure.got) + unit,
            number(figure.error),
            number(figure.gate),
        ]
    met = sum(figure.passed for figure in outcome.figures)
    cells += [f"{met} of {len(outcome.figures)}", f"{outcome.seconds:.0f}"]
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def table(outcomes: list[Outcome]) -> str:
    """A table per topic."""
    lines: list[str] = []
    for topic in dict.fromkeys(outcome.case.topic for outcome in outcomes):
        chosen = [outcome for outcome in outcomes if outcome.case.topic == topic]
        lines += [
            f"**{topic.capitalize()}**",
            "",
            "| case | source | figure nearest to its gate | expected | got | error | gate | met | run time [s] |",
            "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
            *(row(outcome) for outcome in chosen),
            "",
        ]
    met = sum(figure.passed for outcome in outcomes for figure in outcome.figures)
    count = sum(len(outcome.figures) for outcome in outcomes)
    return "\n".join([*lines, f"{met} of {count} figures in {len(outcomes)} cases are within their gates."])


def write_page(text: str) -> None:
    """The table between its marks in docs/verification.md."""
    page = PAGE.read_text()
    before, _, rest = page.partition(BEGIN)
    after = rest.partition(END)[2]
    PAGE.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{after}")


def stored() -> dict[str, dict[str, Any]]:
    """What the results file has of each case, by its name."""
    file = harness.RESULTS / "verification.json"
    return {record["case"]: record for record in json.loads(file.read_text())["cases"]} if file.exists() else {}


def run_topic(topic: str, out: Path, missing: bool) -> None:
    """The cases of a topic in this process, their outcomes into a file after each."""
    known = stored() if missing else {}
    records: list[dict[str, Any]] = []
    for case in collect().values():
        if case.topic != topic or case.name in known:
            continue
        outcome = run(case)
        print(row(outcome), flush=True)
        records.append(
            {
                "case": case.name,
                "topic": topic,
                "source": case.source,
                "run_time_s": round(outcome.seconds, 2),
                "problem": outcome.problem,
                "figures": [dataclasses.asdict(figure) for figure in outcome.figures],
            }
        )
        out.write_text(json.dumps(records))


def run_all(topics: list[str], jobs: int, missing: bool) -> bool:
    """The cases of these topics, in processes of their own; whether all figures are within their gates."""
    records = stored()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(jobs) as pool:

        def child(topic: str) -> list[dict[str, Any]]:
            out = Path(folder) / f"{topic}.json"
            command = [sys.executable, __file__, "--topic", topic, "--out", str(out), *["--missing"] * missing]
            ended = subprocess.run(command, check=False)
            if not out.exists():
                raise SystemExit(f"the cases of {topic!r} ended with code {ended.returncode}")
            return json.loads(out.read_text())

        passed = True
        for found in as_completed([pool.submit(child, topic) for topic in topics]):
            records |= {record["case"]: record for record in found.result()}
            passed = publish(records)
    return passed


def publish(records: dict[str, dict[str, Any]]) -> bool:
    """Writes results and page; whether all figures in them are within their gates."""
    cases = collect()
    kept = [records[name] for name in cases if name in records]
    outcomes = [
        Outcome(
            cases[record["case"]],
            [Figure(**figure) for figure in record["figures"]],
            record["run_time_s"],
            record["problem"],
        )
        for record in kept
    ]
    missing = [name for name in cases if name not in records]
    text = table(outcomes) + (f"\n\nNot run yet: {', '.join(missing)}." if missing else "")
    harness.write("verification", {"cases": kept}, text)
    write_page(text)
    return all(outcome.passed for outcome in outcomes)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="parts of the names of cases, separated by commas")
    parser.add_argument("--topics", default="", help="topics, separated by commas")
    parser.add_argument("--missing", action="store_true", help="only cases that are not in the results yet")
    parser.add_argument("--jobs", type=int, default=1, help="number of topics that run at the same time")
    parser.add_argument("--topic", help=argparse.SUPPRESS)
    parser.add_argument("--out", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.topic:
        run_topic(arguments.topic, arguments.out, arguments.missing)
        return 0
    parts = [part.strip().lower() for part in arguments.only.split(",") if part.strip()]
    if parts:
        return run_some(parts)
    present = stored() if arguments.missing else {}
    known = list(dict.fromkeys(case.topic for case in collect().values() if case.name not in present))
    topics = [topic.strip() for topic in arguments.topics.split(",") if topic.strip()] or known
    if unknown := [topic for topic in topics if topic not in known]:
        print(f"no topic is called {unknown[0]!r}; there are: {', '.join(known)}", file=sys.stderr)
        return 2
    return 0 if run_all(topics, arguments.jobs, arguments.missing) else 1


def run_some(parts: list[str]) -> int:
    """The cases whose names contain one of the parts, with all figures."""
    chosen = [case for case in collect().values() if any(part in case.name.lower() for part in parts)]
    if not chosen:
        print(f"no case is called so; there are: {', '.join(collect())}", file=sys.stderr)
        return 2
    outcomes = []
    for case in chosen:
        outcomes.append(run(case))
        print(row(outcomes[-1]), flush=True)
        for figure in outcomes[-1].figures:
            mark = "   " if figure.passed else "-> "
            print(
                f"{mark}{figure.what}: {figure.got:.6g}, expected {figure.expected:.6g} {figure.unit}, "
                f"error {figure.error:.3g}, gate {figure.gate:.3g}"
            )
    return 0 if all(outcome.passed for outcome in outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())

"""Stiff and extreme cases: computed time-step limits beside those found by trial, extreme scenes run to their end.

    python benchmarks/stability.py [--only WORD ...]

Prints the table of docs/limits.md and writes it there, between its markers, with results/stability.json and .md.
`--only` runs the rows whose name contains one of the words and leaves the others as they are in the results.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

from benchmarks import harness
from tests.cases import extremes, stability, surface_stability

LIMITS = Path(__file__).parents[1] / "docs" / "limits.md"
START, END = "<!-- stability table -->", "<!-- end of the stability table -->"


def all_rows() -> dict[str, tuple[bool, Callable[[], Any]]]:
    """Name -> (whether it computes in float64, the row)."""
    limits = stability.limits() | surface_stability.limits()
    rows = extremes.rows() | surface_stability.rows()
    found = {name: (True, row) for name, row in limits.items()}
    return found | {name: (name.startswith(("drag: ", "surface: ")), row) for name, row in rows.items()}


def _number(value: float | None, form: str = ".2e") -> str:
    return "" if value is None or math.isnan(value) else ("none" if math.isinf(value) else format(value, form))


def table(results: dict[str, dict[str, Any]]) -> str:
    """Both tables as Markdown."""
    limits = [row for row in results.values() if "predicted" in row]
    scenes = [row for row in results.values() if "outcome" in row]
    lines = [
        "| limit | predicted [s] | found by trial [s] | predicted/found | default step [s] |",
        "| --- | --- | --- | --- | --- |",
    ]
    for row in limits:
        ratio = row["predicted"] / row["found"] if row["found"] else math.nan
        note = f" ({row['note']})" if row["note"] else ""
        lines.append(
            f"| {row['group']}: {row['name']}{note} | {_number(row['predicted'])} | {_number(row['found'])} | "
            f"{_number(ratio, '.2f')} | {_number(row['default'])} |"
        )
    lines += [
        "",
        "| extreme case | outcome | contact step [s] | energy/available | volume | momentum | remark |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in scenes:
        lines.append(
            f"| {row['group']}: {row['name']} | {row['outcome']} | {_number(row['contact_step'])} | "
            f"{_number(row['energy'], '.3g')} | {_number(row['volume'], '.0e')} | "
            f"{_number(row['momentum'], '.0e')} | {row['message']} |"
        )
    return "\n".join(lines)


def into_page(text: str) -> None:
    """Puts the table between the markers of docs/limits.md."""
    page = LIMITS.read_text()
    before, _, rest = page.partition(START)
    _, _, after = rest.partition(END)
    LIMITS.write_text(f"{before}{START}\n{text}\n{END}{after}")


def main() -> None:
    """Runs the rows asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[], metavar="WORD")
    arguments = parser.parse_args()
    rows = all_rows()
    results: dict[str, dict[str, Any]] = {}
    stored = harness.RESULTS / "stability.json"
    if arguments.only and stored.exists():
        results = json.loads(stored.read_text())["rows"]
    for name, (double, row) in rows.items():
        if arguments.only and not any(word in name for word in arguments.only):
            continue
        begin = time.perf_counter()
        jax.config.update("jax_enable_x64", double)
        results[name] = dataclasses.asdict(row()) | {"seconds": round(time.perf_counter() - begin, 1)}
        shown = results[name].get("outcome") or f"{results[name]['predicted'] / results[name]['found']:.2f}"
        print(f"{name}: {shown} ({results[name]['seconds']} s)", flush=True)
        # After every row, so that a run that is stopped leaves what it has.
        kept = {key: results[key] for key in rows if key in results}
        stored.write_text(json.dumps({"rows": kept}, indent=1) + "\n")
    text = table(kept)
    harness.write("stability", {"rows": kept}, text)
    into_page(text)


if __name__ == "__main__":
    main()

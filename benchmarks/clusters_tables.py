"""The tables of docs/results/clusters.md and clusters_closures.md, of the measures in benchmarks/results/clusters.json.

    python benchmarks/clusters_tables.py               # all of them
    python benchmarks/clusters_tables.py --table parcels
    python benchmarks/clusters_tables.py --write       # into the pages, behind their marks

In a page the mark `<!-- table: NAME -->` stands before each table.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

from benchmarks import harness
from benchmarks.clusters_measures import DROPPED, is_fine, pooled

RESULTS = Path(__file__).parents[1] / "docs" / "results"
PAGES = (RESULTS / "clusters.md", RESULTS / "clusters_closures.md")
"""What was found, and the closures that were compared on the way."""
BOX = [96, 192]
FRACTIONS = (0.02, 0.05, 0.2)
EVERY = (0.02, 0.03, 0.05, 0.07, 0.1, 0.12, 0.2)
"""Solid fractions of the runs with the closures of `MAIN`."""
MAIN = {
    "": "no model",
    "radl": "Radl & Sundaresan, published",
    "mixed": "learned (`mixed`)",
}
"""Closures of the first page, in words."""
ON_MESHES = ("", "radl", "mixed", "calibrated")
"""Closures of the table of meshes."""
SHOWN = ("", "radl", "regression", "network", "tuned", "network2", "fraction", "bounded", "gradient", "squares",
         "balance", "wide", "matched", "nudged", "nudgedbox", "longmixed", "longboth", "longbox",
         "mixed", "calibrated")  # fmt: skip
"""Closures in the order of the tables."""
VARIANCES = {"solids_24": "solids", "grains_24": "grains", "gas_24": "gas"}
Row = dict[str, Any]


def chosen(rows: Sequence[Row], **wanted: Any) -> list[Row]:
    """The rows in the large box with these values; the closure without its seed. A run of two groups is there once."""
    found: list[Row] = []
    for row in rows:
        closure = row["closure"] if "anew" in row["closure"] else row["closure"].split("_")[0]
        own = row | {"closure": closure}
        fits = list(row["box"]) == BOX and all(own[name] == value for name, value in wanted.items())
        if fits and all(own["slip"] != other["slip"] for other in found):
            found.append(own)
    return found


def fine_runs(rows: Sequence[Row], solid_fraction: float) -> list[Row]:
    """The fine runs at a mean solid fraction."""
    return [row for row in chosen(rows, solid_fraction=solid_fraction) if is_fine(row)]


def over_fine(rows: Sequence[Row], own: Sequence[Row], name: str) -> tuple[float, float]:
    """Mean of runs over that of the fine runs, and the standard error of both together."""
    mine, fine = pooled(own, name), pooled(fine_runs(rows, own[0]["solid_fraction"]), name)
    quotient = mine["mean"] / fine["mean"]
    return quotient, quotient * math.hypot(mine["error"] / mine["mean"], fine["error"] / fine["mean"])


def shown(rows: Sequence[Row]) -> list[str]:
    """The closures of `SHOWN` that there are runs with."""
    there = {row["closure"] for row in chosen(rows)}
    return [closure for closure in SHOWN if closure in there]


def label(closure: str) -> str:
    """Of a closure in a table."""
    return f"`{closure}`" if closure else "no model"


def table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A table of Markdown."""
    return "\n".join("| " + " | ".join(line) + " |" for line in (head, ["---"] * len(head), *lines))


def of_fractions(
    rows: Sequence[Row], own: Sequence[Row], names: Sequence[str], fractions: Sequence[float] = FRACTIONS
) -> list[str]:
    """Quotients to the fine runs by measure and solid fraction, empty where there is no run."""
    found = []
    for name in names:
        for s in fractions:
            here = [row for row in own if row["solid_fraction"] == s]
            found.append("{:.2f} +- {:.2f}".format(*over_fine(rows, here, name)) if here else "")
    return found


def parcels(rows: Sequence[Row], name: str = "", closures: Sequence[str] = SHOWN) -> str:
    """Slip and drag of parcels of 4 on cells of 24 diameters over the fine runs."""
    head = ["closure", *_by_fraction(["slip at", "drag at"])]
    lines = []
    for closure in closures:
        own = chosen(rows, cell=24.0, parcel=4, closure=closure, name=name)
        if own:
            lines.append([label(closure), *of_fractions(rows, own, ("slip", "drag"))])
    return table(head, lines)


def unseen(rows: Sequence[Row], name: str) -> str:
    """A measure of parcels of 4 on cells of 24 diameters over the fine runs, at every solid fraction."""
    lines = []
    for closure, words in MAIN.items():
        own = chosen(rows, cell=24.0, parcel=4, closure=closure, name="")
        lines.append([words, *of_fractions(rows, own, (name,), EVERY)])
    return table(["drag", *(f"{s:g}" for s in EVERY)], lines)


def spreads(rows: Sequence[Row]) -> str:
    """Variances of the fine runs and of parcels of 4 on cells of 24 diameters, at every solid fraction."""
    lines = []
    for name, words in VARIANCES.items():
        for closure in (None, *MAIN):
            given = {"cell": 24.0, "parcel": 4, "closure": closure, "name": ""}
            line = [words, "fine run" if closure is None else MAIN[closure]]
            for s in EVERY:
                own = fine_runs(rows, s) if closure is None else chosen(rows, solid_fraction=s, **given)
                line.append(f"{pooled(own, name)['mean']:.2f}" if own else "")
            lines.append(line)
    return table(["variance of", "run", *(f"{s:g}" for s in EVERY)], lines)


def meshes(rows: Sequence[Row]) -> str:
    """Slip and drag of parcels of 4 on cells of several sizes over the fine runs."""
    fractions = (0.02, 0.05, 0.1, 0.2)
    head = ["cells", "closure", *(f"slip at {s:g}" for s in fractions), *(f"drag at {s:g}" for s in fractions)]
    lines = []
    for cell in (12.0, 16.0, 24.0):
        for closure in ON_MESHES:
            own = chosen(rows, cell=cell, parcel=4, closure=closure, name="")
            if own:
                lines.append([f"{cell:g} d", label(closure), *of_fractions(rows, own, ("slip", "drag"), fractions)])
    return table(head, lines)


def fine(rows: Sequence[Row]) -> str:
    """The fine runs, one by one and together."""
    head = ["solid fraction", "seed", "T measured", "slip", "drag", *(f"var. {n}" for n in VARIANCES.values())]
    lines = []
    for s in EVERY:
        own = fine_runs(rows, s)
        for row in own:
            seed = f"{row['seed']}, long step" if row["name"] == "step" else str(row["seed"])
            lines.append([f"{s:g}", seed, str(row["times"] - DROPPED), *_measures([row])])
        if len(own) > 1:
            total = sum(row["times"] - DROPPED for row in own)
            lines.append([f"{s:g}", "together", str(total), *_measures(own)])
    return table(head, lines)


def one_by_one(rows: Sequence[Row], wanted: Sequence[dict[str, Any]], cells: bool = False) -> str:
    """Runs of one kind a line, together, with quotients to the fine runs and processor times."""
    head = ["solid fraction", *(["cells"] if cells else []), "closure", "runs", "slip", "over fine", "drag",
            "over fine", *(f"var. {n}" for n in VARIANCES.values()), "processor time [s/T]"]  # fmt: skip
    lines = []
    for which in wanted:
        own = chosen(rows, name="", **which)
        if own:
            line = [f"{own[0]['solid_fraction']:g}", *([f"{own[0]['cell']:g} d"] if cells else [])]
            line += [label(which["closure"]), str(len(own))]
            for name in ("slip", "drag"):
                found = pooled(own, name)
                line += [f"{found['mean']:.3f} +- {found['error']:.3f}", f"{over_fine(rows, own, name)[0]:.2f}"]
            lines.append([*line, *_measures(own)[2:], _time(own)])
    return table(head, lines)


def variances(rows: Sequence[Row]) -> str:
    """Variances and processor times of parcels of 4 and of the fine runs, by solid fraction."""
    names = _by_fraction([*VARIANCES.values(), "processor time [s/T]"])
    lines = []
    for closure in (None, *SHOWN):
        if closure is None:
            by = [fine_runs(rows, s) for s in FRACTIONS]
        else:
            given = {"cell": 24.0, "parcel": 4, "closure": closure, "name": ""}
            by = [chosen(rows, solid_fraction=s, **given) for s in FRACTIONS]
        if all(by):
            line = [f"{pooled(own, name)['mean']:.2f}" for name in VARIANCES for own in by]
            lines.append(["fine" if closure is None else label(closure), *line, *(_time(own) for own in by)])
    return table(["run", *names], lines)


def filtered_drag(rows: Sequence[Row]) -> str:
    """The drag that a coarse mesh has to apply, of the fine runs that have samples."""
    head = ["solid fraction", "T measured", "slip", "drag of the fine run", "that a coarse mesh has to apply",
            "quotient"]  # fmt: skip
    lines = []
    for row in sorted(chosen(rows), key=lambda row: row["solid_fraction"]):
        if "filtered_drag" in row:
            parts = [row[name] for name in ("slip", "drag", "filtered_drag")]
            text = [f"{part['mean']:.3f} +- {part['error']:.3f}" for part in parts]
            quotient = f"{parts[2]['mean'] / parts[1]['mean']:.2f}"
            lines.append([f"{row['solid_fraction']:g}", str(row["times"] - DROPPED), *text, quotient])
    return table(head, lines)


def _by_fraction(names: Sequence[str]) -> list[str]:
    """Heads of columns by measure and solid fraction, the measure before its first one."""
    return [f"{name} {s:g}" if k == 0 else f"{s:g}" for name in names for k, s in enumerate(FRACTIONS)]


def _measures(own: Sequence[Row]) -> list[str]:
    text = ["{mean:.3f} +- {error:.3f}".format(**pooled(own, name)) for name in ("slip", "drag")]
    return [*text, *(f"{pooled(own, name)['mean']:.2f}" for name in VARIANCES)]


def _time(own: Sequence[Row]) -> str:
    low, high = (pick(row["cpu_s_per_relaxation_time"] for row in own) for pick in (min, max))
    digits = 1 if high >= 1.0 else 2
    text = [f"{value:.{digits}f}" for value in (low, high)]
    return text[0] if text[0] == text[1] else " to ".join(text)


TABLES: dict[str, Callable[[Sequence[Row]], str]] = {
    "slips": lambda rows: unseen(rows, "slip"),
    "drags": lambda rows: unseen(rows, "drag"),
    "spreads": spreads,
    "meshes": meshes,
    "fine": fine,
    "coarse": lambda rows: one_by_one(
        rows, [{"solid_fraction": s, "cell": c, "parcel": 1, "closure": ""} for c in (12, 24) for s in FRACTIONS], True
    ),
    "filtered": filtered_drag,
    "grains": lambda rows: one_by_one(
        rows, [{"solid_fraction": s, "cell": 24.0, "parcel": 1, "closure": c} for s in FRACTIONS for c in SHOWN]
    ),
    "parcels": parcels,
    "variances": variances,
    "between": lambda rows: one_by_one(
        rows, [{"solid_fraction": 0.1, "cell": 24.0, "parcel": 4, "closure": c} for c in SHOWN]
    ),
    "twelve": lambda rows: one_by_one(
        rows, [{"solid_fraction": s, "cell": 12.0, "parcel": 4, "closure": c} for s in FRACTIONS for c in SHOWN]
    ),
    "smaller": lambda rows: one_by_one(
        rows, [{"solid_fraction": s, "cell": 24.0, "parcel": 2, "closure": c} for s in FRACTIONS for c in SHOWN]
    ),
    "anew": lambda rows: parcels(rows, closures=("regression_anew", "network_anew")),
    "own": lambda rows: parcels(rows, "own"),
    "loss": lambda rows: parcels(rows, "restitution 0.487"),
}  # fmt: skip
"""By name; one of the pages has each behind its mark."""


def marked(page: str) -> list[str]:
    """Names of the tables of a page, in their order."""
    return re.findall(r"<!-- table: (\w+) -->\n", page)


def written(page: str, rows: Sequence[Row]) -> str:
    """The page with its tables as the rows have them."""
    for name in marked(page):
        mark = f"<!-- table: {name} -->\n"
        before, after = page.split(mark)
        page = f"{before}{mark}{TABLES[name](rows)}\n" + re.sub(r"^(\|[^\n]*\n)*", "", after)
    return page


def main() -> None:
    """The tables, on the screen or in the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--table", choices=TABLES, help="one of them; all by default")
    parser.add_argument("--write", action="store_true", help="put them into the pages")
    arguments = parser.parse_args()
    rows = json.loads((harness.RESULTS / "clusters.json").read_text())["rows"]
    if arguments.write:
        for page in PAGES:
            page.write_text(written(page.read_text(), rows))
        return
    for name in [arguments.table] if arguments.table else TABLES:
        print(f"{name}\n\n{TABLES[name](rows)}\n")


if __name__ == "__main__":
    main()

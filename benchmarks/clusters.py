"""Clusters in a gas on fine and coarse meshes, with and without filtered drag, with grains and with parcels.

    python benchmarks/clusters.py --runs DIR [--groups fine,mesh,...] [--minutes M] [--figures DIR]

Runs of `scenes/clusters.toml` in a smaller box, in an order in which each finds what it needs: fine runs, the closures
that are trained on them, coarse runs. All is kept in DIR, and what is complete is used again, so the same command goes
on with a study that was stopped. With --minutes no run begins after so long. `clusters_plan.py` has the runs,
`clusters_runs.py` what a run is, `clusters_measures.py` what is measured; `clusters_closures.py`, `clusters_nudged.py`
and `clusters_matched.py` have the closures. docs/results/clusters.md tells what was found.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

from benchmarks import harness
from benchmarks.clusters_closures import (
    closure_of,
    train,
    train_again,
    train_seen,
    tuned,
)
from benchmarks.clusters_matched import calibrate, match
from benchmarks.clusters_measures import is_fine, measured, pooled
from benchmarks.clusters_nudged import FITTED, LONGER_FITTED, MIXED_AGAIN, MIXED_FITTED, train_nudged
from benchmarks.clusters_plan import (
    CALIBRATED_AT,
    CALIBRATED_ON,
    FINE_TIMES,
    LONGER_ON,
    MATCHED_AT,
    SEEDS,
    SEEN_ON,
    TRAINED_ON,
    TUNED,
    coarse,
    fine,
    plan,
    with_tuned,
)
from benchmarks.clusters_runs import Case, simulated
from benchmarks.clusters_seen import filtered_drag

NAMED = ("solid_fraction", "cell", "parcel", "closure", "seed", "times", "box", "diameter", "name")
"""Attributes of a case that its row has."""


def rows_of(cases: list[Case], folder: Path, until: float) -> Iterator[dict[str, Any]]:
    """A row of the table for each run that is there or can begin before the time `until`, by `time.monotonic`."""
    for case in cases:
        kept = folder / f"{case.folder}.measures.json"
        took = folder / f"{case.folder}.time.json"
        if not kept.exists():
            if time.monotonic() > until and not took.exists():
                continue
            run = simulated(case, folder, closure_of(case, folder))
            found = measured(case, run)
            if case.samples:
                found["filtered_drag"] = filtered_drag(case, run)
            kept.write_text(json.dumps(found))
        yield (
            {name: getattr(case, name) for name in NAMED} | json.loads(took.read_text()) | json.loads(kept.read_text())
        )


def table_of(rows: list[dict[str, Any]]) -> str:
    """One line a run; quotients are those to all fine runs of the same mean solid fraction and grain together.

    Rows may be new ones or read from a file, in which a box is a list.
    """
    rows = [row | {"box": tuple(row["box"])} for row in rows]
    lines = [
        "| solid fraction | cells [d] | parcels | closure | other | slip / u_t | over fine | drag / uniform "
        "| over fine | var. solids 24 d | var. grains 24 d | var. gas 24 d | cpu per relaxation time [s] | processor |",
        "| --- " * 14 + "|",
    ]
    for row in rows:
        same = [r for r in rows if all(r[name] == row[name] for name in ("solid_fraction", "diameter", "box"))]
        fine_runs = [r for r in same if is_fine(r)] or [row]
        parts = [f"{row['solid_fraction']:g}", f"{row['cell']:g}", f"{row['parcel']}", row["closure"] or "none"]
        parts.append(row["name"] or ("" if row["box"] == Case.box else "small box"))
        for name in ("slip", "drag"):
            parts.append(f"{row[name]['mean']:.3f} +- {row[name]['error']:.3f}")
            parts.append(f"{row[name]['mean'] / pooled(fine_runs, name)['mean']:.3f}")
        parts += [f"{row[name]['mean']:.3f} +- {row[name]['error']:.3f}" for name in VARIANCES]
        parts += [f"{row['cpu_s_per_relaxation_time']:.2f}", row.get("processor", "")]  # not kept by earlier runs
        lines.append("| " + " | ".join(parts) + " |")
    return "\n".join(lines)


VARIANCES = ("solids_24", "grains_24", "gas_24")
"""Measures of the table beside slip and drag."""


def kept_rows(groups: list[str]) -> list[dict[str, Any]]:
    """Rows of the results that are not of the groups to come; none where all are to come."""
    if not groups:
        return []
    found = json.loads((harness.RESULTS / "clusters.json").read_text())["rows"]
    return [row for row in found if row["group"] not in groups]


def fine_slip(rows: list[dict[str, Any]], solid_fraction: float) -> float:
    """Mean slip of all fine runs at a mean solid fraction, in terminal speeds [-]."""
    own = [r for r in rows if is_fine(r) and r["solid_fraction"] == solid_fraction and tuple(r["box"]) == Case.box]
    return pooled(own, "slip")["mean"]


def main() -> None:
    """The runs, the table, and the figures if they are wanted."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=Path, required=True, help="folder in which the runs are kept")
    parser.add_argument("--groups", default="", help="parts of the study; all by default")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="no run begins after so long")
    parser.add_argument("--figures", type=Path, help="folder for the figures")
    arguments = parser.parse_args()
    until, groups = time.monotonic() + 60.0 * arguments.minutes, plan()
    names = [part for part in arguments.groups.split(",") if part]
    rows = kept_rows(names)
    for name in names or groups:
        if name in ("models", "seeds", "own", "loss", "tuned") and time.monotonic() < until:
            train(TRAINED_ON, arguments.runs)
        if name in ("seen", "matched", "smaller") and time.monotonic() < until:
            train_seen(SEEN_ON, arguments.runs)
        if name == "nudged" and time.monotonic() < until:
            train_nudged(SEEN_ON, arguments.runs, FITTED)
        if name == "nudged_longer" and time.monotonic() < until:
            train_nudged(LONGER_ON, arguments.runs, LONGER_FITTED)
        if name == "mixed" and time.monotonic() < until:
            train_nudged(CALIBRATED_ON, arguments.runs, MIXED_FITTED)
            for own, seed in MIXED_AGAIN.items():
                train_nudged(CALIBRATED_ON, arguments.runs, {own: MIXED_FITTED["mixed"]}, seed)
        if name in ("anew", "trainings") and time.monotonic() < until:
            train_again(TRAINED_ON, SEEN_ON[0].case, arguments.runs)
        if name == "matched" and time.monotonic() < until:
            slips = []
            for s in MATCHED_AT:
                cases = {one.case for one in SEEN_ON if one.case.solid_fraction == s}
                cases |= {fine(s, seed) for seed in SEEDS if s in FINE_TIMES}
                slips.append(pooled(list(rows_of(list(cases), arguments.runs, until)), "slip")["mean"])
            match(SEEN_ON, [coarse(s, 24.0, parcel=4) for s in MATCHED_AT], slips, arguments.runs)
        if name == "calibrated" and time.monotonic() < until:
            slips = [fine_slip(rows, s) for s, _ in CALIBRATED_AT]
            calibrate(CALIBRATED_ON, [coarse(s, c, parcel=4) for s, c in CALIBRATED_AT], slips, arguments.runs)
        if name == "tuned" and time.monotonic() < until:
            slips = [row["slip"]["mean"] for row in rows_of([fine(0.05)], arguments.runs, until)]
            for cell, parcel in TUNED:
                tuned([coarse(0.05, cell, parcel=parcel)], slips, arguments.runs)
        for row in rows_of(groups[name], arguments.runs, until):
            rows.append({"group": name, **row})
            print(table_of(rows[-1:]).splitlines()[-1], flush=True)
            harness.save("clusters", {"rows": rows}, table_of(rows))
    if arguments.figures:
        from benchmarks.clusters_figures import draw_errors, draw_pair

        shown = [(fine(0.05), "cells of 3 d"), (coarse(0.05, 24.0), "cells of 24 d")]
        shown.append((with_tuned(coarse(0.05, 24.0, parcel=4)), "24 d, parcels of 4, tuned"))
        draw_pair(shown, arguments.runs, arguments.figures / "clusters_snapshots.png")
        draw_errors(rows, arguments.figures / "clusters_errors.png")


if __name__ == "__main__":
    main()

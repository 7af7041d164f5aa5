"""Clusters in a gas on fine and coarse meshes, with and without filtered drag, with grains and with parcels.

    python benchmarks/clusters.py --runs DIR [--groups fine,mesh,...] [--minutes M] [--figures DIR]

Runs of `scenes/clusters.toml` in a smaller box, in an order in which each finds what it needs: fine runs, the closures
that are trained on them, coarse runs. All is kept in DIR, and what is complete is used again, so the same command goes
on with a study that was stopped. With --minutes no run begins after so long. `clusters_runs.py` has what a run is,
`clusters_measures.py` what is measured, `clusters_closures.py` the closures. docs/results/clusters.md tells what was
found.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

from benchmarks import harness
from benchmarks.clusters_closures import (
    AGAIN,
    ANEW,
    MATCHED,
    SEEN_FITS,
    Seen,
    closure_of,
    match,
    train,
    train_again,
    train_seen,
    tuned,
    tuned_name,
)
from benchmarks.clusters_measures import is_fine, measured, pooled
from benchmarks.clusters_nudged import FITTED, LONGER_FITTED, train_nudged
from benchmarks.clusters_runs import Case, simulated
from benchmarks.clusters_seen import filtered_drag

FRACTIONS = (0.02, 0.05, 0.2)
"""Mean solid fractions; 0.1 is for training only, see docs/results/clusters.md."""
TRAINED_ON = (Case(0.05, samples=1), Case(0.1, samples=1, times=11))
"""Fine runs that closures are trained on, see `clusters_closures.FITS`."""
MODELS = ("", "radl", "regression", "network", "network2", "fraction", "bounded", "gradient")
"""Closures that are compared, see `clusters_closures`."""
COARSE = (12.0, 24.0)
"""Sides of coarse cells, in diameters."""
LOSSY = ("", "gradient")
"""Closures of the runs with parcels whose impacts keep the rate of loss of the grains, on cells of 24 diameters."""
OWN = ("", "radl", "gradient")
"""Closures of the runs with parcels that see the volume of a grain in place of their own, on cells of 24 diameters."""
SEEDS = (0, 1)
"""Of the places at the start, for the fine runs and for the closures of `OWN`."""
TUNED = ((24.0, 4),)
"""Cells and parcels for which the network is tuned by statistics."""
FINE_TIMES = {0.02: 110, 0.05: 40, 0.2: 25}
"""Length of a fine run in relaxation times; of coarse runs with grains at most `GRAIN_TIMES`."""
GRAIN_TIMES = 40
PARCEL_STEP, PARCEL_TIMES = 5e-4, 110
"""Fluid step of runs with parcels [s], and their length in relaxation times."""


def fine(solid_fraction: float, seed: int = 0) -> Case:
    """The fine run of a mean solid fraction."""
    samples = int(solid_fraction == TRAINED_ON[0].solid_fraction and seed == 0)
    return Case(solid_fraction, seed=seed, samples=samples, times=FINE_TIMES[solid_fraction])


def coarse(solid_fraction: float, cell: float, closure: str = "", parcel: int = 1, seed: int = 0) -> Case:
    """A coarse run beside it."""
    times = min(FINE_TIMES.get(solid_fraction, GRAIN_TIMES), GRAIN_TIMES)
    case = Case(solid_fraction, cell, seed, closure, parcel, times=times)
    return case if parcel == 1 else replace(case, step=PARCEL_STEP, times=PARCEL_TIMES)


def lossy(case: Case) -> Case:
    """The case with parcels whose impacts keep the rate of loss of the grains."""
    return replace(case, name="loss", changes=(("contact.parcel_loss", "rate"),))


def of_grain(case: Case) -> Case:
    """The case with parcels that see the volume of one grain in place of their own."""
    return replace(case, name="own", changes=(("coupling.own_volume", "grain"),))


def with_long_step(case: Case) -> Case:
    """The case with a contact step of a tenth of an impact in place of a twentieth; it takes half of the time."""
    return replace(case, name="step", changes=(("contact.time_step", 1e-5),))


LONG = with_long_step(Case(0.2, seed=2, times=52, samples=3))
"""A further fine run, for the mean."""
DENSE = tuple(with_long_step(Case(0.2, seed=seed, times=80)) for seed in (3, 4))
"""Longer ones where the slip comes and goes with the clusters, so that its mean needs many relaxation times."""
SEEN_ON = (
    Seen(Case(0.05, seed=2, times=36, samples=0.1), draws=8, dropped=6),
    Seen(with_long_step(Case(0.01, times=30, samples=0.1)), draws=16, dropped=6),
    Seen(with_long_step(Case(0.15, times=15, samples=0.1)), draws=4, dropped=5),
    Seen(with_long_step(Case(0.3, times=13, samples=0.1)), draws=4, dropped=5),
)
"""Fine runs that the closures of `SEEN_FITS` are trained on: their solid fractions lie round those of `FRACTIONS`."""
LONGER_ON = (
    Seen(Case(0.05, seed=3, times=80, samples=0.1), draws=8, dropped=6),
    Seen(with_long_step(Case(0.01, seed=3, times=110, samples=0.1)), draws=16, dropped=6),
    Seen(with_long_step(Case(0.15, seed=3, times=60, samples=0.1)), draws=4, dropped=5),
    Seen(with_long_step(Case(0.3, seed=3, times=60, samples=0.1)), draws=4, dropped=5),
)
"""Longer fine runs, that the closures of `LONGER_FITTED` are trained on."""
SMALLER = {0.02: (0, 1, 2), 0.05: (0, 1)}
"""Solid fractions of the runs with parcels of 2, and the seeds of the places."""
MATCHED_AT = (0.01, 0.05)
"""Solid fractions at which coarse runs are to have the slip of fine ones; the others' are known to 11 % at best."""


def with_tuned(case: Case) -> Case:
    """The case with the closure that is tuned for it."""
    return replace(case, closure=tuned_name(case))


def plan() -> dict[str, list[Case]]:
    """All runs by what they are for, but those on the way to a tuned closure."""
    small = [Case(0.05, cell, box=(48, 96)) for cell in (3.0, 2.0)]
    base = coarse(0.05, 12.0, parcel=4)
    checks = [
        replace(base, name="stiff", changes=(("contact.young_modulus", 2e5),)),
        replace(base, name="wide", changes=(("coupling.kernel_width.cells", 1.0),)),
    ]
    return {
        "fine": [*(fine(s, seed) for seed in SEEDS for s in FRACTIONS), LONG],
        "dense": [*DENSE],
        "training": [one.case for one in SEEN_ON],
        "longer": [one.case for one in LONGER_ON],
        "mesh": [*small, *checks],
        "models": [coarse(s, cell, model) for cell in reversed(COARSE) for model in MODELS for s in FRACTIONS],
        "parcels": [coarse(s, cell, model, 4) for cell in COARSE for model in MODELS for s in FRACTIONS],
        "seeds": [coarse(s, 24.0, model, 4, seed) for model in OWN for s in FRACTIONS for seed in SEEDS[1:]],
        "own": [of_grain(coarse(s, 24.0, model, 4, seed)) for model in OWN for s in FRACTIONS for seed in SEEDS],
        "loss": [lossy(coarse(s, 24.0, model, 4)) for model in LOSSY for s in FRACTIONS],
        "seen": [coarse(s, 24.0, model, 4, seed) for model in SEEN_FITS for s in FRACTIONS for seed in SEEDS],
        "matched": [coarse(s, 24.0, MATCHED, 4, seed) for s in FRACTIONS for seed in SEEDS],
        "smaller": [coarse(s, 24.0, "wide", 2, seed) for s, seeds in SMALLER.items() for seed in seeds],
        "smaller_none": [coarse(s, 24.0, parcel=2) for s in FRACTIONS],
        "nudged": [coarse(s, 24.0, model, 4, seed) for s in FRACTIONS for seed in SEEDS for model in FITTED],
        "nudged_longer": [coarse(s, 24.0, m, 4, seed) for m in LONGER_FITTED for s in FRACTIONS for seed in SEEDS],
        "between": [
            with_long_step(Case(0.1, seed=3, times=80)),
            *(coarse(0.1, 24.0, m, 4, seed) for m in ("", "radl", *LONGER_FITTED) for seed in SEEDS),
        ],
        "anew": [
            *(coarse(0.05, 24.0, model, 4, 2) for model in ("", "radl")),
            *(coarse(s, 24.0, model, 4, seed) for model in ANEW for s in FRACTIONS for seed in (0, 1, 2)),
        ],
        "trainings": [coarse(s, 24.0, model, 4) for model in AGAIN for s in FRACTIONS],
        "tuned": [with_tuned(coarse(s, cell, parcel=parcel)) for cell, parcel in TUNED for s in FRACTIONS],
    }


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
        if name in ("anew", "trainings") and time.monotonic() < until:
            train_again(TRAINED_ON, SEEN_ON[0].case, arguments.runs)
        if name == "matched" and time.monotonic() < until:
            slips = []
            for s in MATCHED_AT:
                cases = {one.case for one in SEEN_ON if one.case.solid_fraction == s}
                cases |= {fine(s, seed) for seed in SEEDS if s in FINE_TIMES}
                slips.append(pooled(list(rows_of(list(cases), arguments.runs, until)), "slip")["mean"])
            match(SEEN_ON, [coarse(s, 24.0, parcel=4) for s in MATCHED_AT], slips, arguments.runs)
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

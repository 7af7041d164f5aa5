"""Cheaper closures: cost of an evaluation, R2 and the coarse run's error, from large networks to a few neurons."""

from __future__ import annotations

import jax
import numpy as np

from jaxdem.closures import DRAG_LAWS
from jaxdem.closures.file import load_single
from studies.evidence import Evidence
from studies.measure import PERCENT, mean, mean_over
from studies.part_closures import evaluation_time
from studies.specs import ClosureSpec
from studies.tables import Cell, Section, Table

FACTOR = 4
"""Of the mesh on which they are run."""


def smaller_part(evidence: Evidence) -> Section:
    """One table, the networks of each kind by their size."""
    section = Section("smaller", "Cheaper closures")
    rows: list[dict[str, Cell]] = [
        {
            "closure": "Koch-Hill",
            "hidden layers": None,
            "weights": None,
            "ns a particle": 1e9 * evaluation_time(DRAG_LAWS["koch_hill"]()),
            "R2 on the fine run, 4x": None,
            **_error(evidence, f"coarse_{FACTOR}"),
        }
    ]
    for name in evidence.plan.names("smaller", ClosureSpec):
        found = evidence.closure(name)
        if found is None:
            continue
        closure, _ = load_single(evidence.folder.closure(name), "")
        rows.append(
            {
                "closure": name,
                "hidden layers": "-".join(str(width) for width in closure.hidden),
                "weights": sum(int(np.size(leaf)) for leaf in jax.tree.leaves(closure.weights)),
                "ns a particle": 1e9 * evaluation_time(closure),
                "R2 on the fine run, 4x": found["r2"].get(str(FACTOR), {}).get("closure"),
                **_error(evidence, f"coarse_{FACTOR}_{name}"),
            }
        )
    note = (
        "Mean error of the coarse run at 16 cm over the nine metrics; times are of 20,000 particles, compiled, the "
        "best of five."
    )
    section.tables.append(Table.of("Cost and error at 16 cm", rows, note))
    section.missing = dict(evidence.missing)
    return section


def _error(evidence: Evidence, run: str) -> dict[str, Cell]:
    error = evidence.errors(run)
    known = (None, None) if error is None else (mean(error) / PERCENT, mean_over(error, evidence.floor))
    return dict(zip(("mean error [%]", "over noise [-]"), known, strict=True))

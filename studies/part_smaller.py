"""Cheaper closures: cost of an evaluation, R2 and the coarse run's error, from large networks to a few neurons."""

from __future__ import annotations

import jax
import numpy as np

from jaxdem.closures import DRAG_LAWS
from jaxdem.closures.file import load_single
from studies.evidence import Evidence
from studies.measure import mean, mean_over
from studies.part_closures import evaluation_time
from studies.specs import ClosureSpec
from studies.tables import Cell, Section, Table

FACTOR = 4
"""Of the mesh on which they are run."""


def smaller_part(evidence: Evidence) -> Section:
    """One table, the networks of each kind by their size."""
    section = Section("smaller", "Cheaper closures")
    plain = evidence.errors(f"coarse_{FACTOR}")
    cost = evaluation_time(DRAG_LAWS["koch_hill"]())
    rows: list[list[Cell]] = [["Koch-Hill", None, None, 1e9 * cost, None, *_error(evidence, plain)]]
    for name in evidence.plan.names("smaller", ClosureSpec):
        found = evidence.closure(name)
        if found is None:
            continue
        closure, _ = load_single(evidence.folder.closure(name), "")
        weights = sum(int(np.size(leaf)) for leaf in jax.tree.leaves(closure.weights))
        r2 = found["r2"].get(str(FACTOR), {}).get("closure")
        hidden = "-".join(str(width) for width in closure.hidden)
        error = evidence.errors(f"coarse_{FACTOR}_{name}")
        rows.append([name, hidden, weights, 1e9 * evaluation_time(closure), r2, *_error(evidence, error)])
    headings = ["closure", "hidden layers", "weights", "ns a particle"]
    headings += ["R2 on the fine run, 4x", "mean error [%]", "over noise [-]"]
    note = (
        "Mean error of the coarse run at 16 cm over the nine metrics; times are of 20,000 particles, compiled, the best "
        "of five."
    )
    section.tables.append(Table("Cost and error at 16 cm", headings, rows, note))
    section.missing = dict(evidence.missing)
    return section


def _error(evidence: Evidence, error: dict[str, float] | None) -> list[Cell]:
    return [None, None] if error is None else [100 * mean(error), mean_over(error, evidence.floor)]

"""Closures trained through the solver: what the training did, and coarse runs with them."""

from __future__ import annotations

from collections.abc import Sequence

from jaxdem.fluid.remap import coarsened
from studies import paper
from studies.evidence import Evidence
from studies.hidden_stress import EDGE, hidden_stress
from studies.measure import PERCENT, grid_of
from studies.part_closures import over_noise
from studies.specs import RunSpec, TuneSpec
from studies.tables import Cell, Section, Table

FLUIDS = {
    "": "",
    "_sharp": ", central, kernels of half a cell",
    "_fourth": ", central of fourth order, kernels of half a cell",
    "_deconvolved": ", central, kernels of half a cell, deconvolved velocity",
    "_wide_deconvolved": ", central, deconvolved velocity",
    "_fourth_deconvolved": ", central of fourth order, kernels of half a cell, deconvolved velocity",
}
"""Coarse fluids, by what stands in the names of their runs."""


def solver_part(evidence: Evidence) -> Section:
    """Loss before and after, cost, and the coarse runs beside those with what the training began with."""
    section = Section("solver", "Trained through the solver")
    section.text.append(
        "Filtered closures and a subgrid stress that begins as none, trained through coarse runs on the sharp fluid "
        "that follow the fine training injection, each alone and both together; no run of injection.toml is in it. "
        "With the stress the loss has the fluid in it too, so that losses are comparable where the same is trained. "
        "Nothing is learned for the gradient stress, which has the coefficients of a smooth flow."
    )
    plan = evidence.plan
    specs = [plan.specs[name] for name in plan.parts["solver"].needs]
    tuned = [spec for spec in specs if isinstance(spec, TuneSpec)]
    names = [spec.name for spec in specs if not isinstance(spec, RunSpec)]
    section.tables += [_hidden(evidence), _trainings(evidence, tuned)]
    section.tables.append(over_noise(evidence, _runs(evidence, names)))
    section.missing = dict(evidence.missing)
    return section


def _hidden(evidence: Evidence) -> Table:
    """What averages over coarse cells hide, and how much of it models of the subgrid stress know."""
    rows: list[dict[str, Cell]] = []
    if (fine := evidence.run("fine")) is not None:
        for factor, mesh in paper.COARSE.items():
            cells = coarsened(grid_of(fine), factor).cells
            if min(cells) > 2 * EDGE:
                found = hidden_stress(fine, cells)
                rows.append(
                    {
                        "mesh": mesh,
                        "of the momentum flux [%]": found.share / PERCENT,
                        "known to c_n = 1/12 [%]": found.gradient / PERCENT,
                        "to the best c_n [%]": found.best / PERCENT,
                        "best c_n": found.gradient_fit,
                        "best c_1 alone": found.viscosity_fit,
                    }
                )
    note = (
        "From the fine run's fields alone: root-mean-square of the subgrid stress over that of the momentum flux; "
        "parts of its squares; inner cells, all outputs up to the screen time."
    )
    return Table.of("Subgrid stress of the fine run, averaged", rows, note)


def _trainings(evidence: Evidence, specs: list[TuneSpec]) -> Table:
    rows: list[dict[str, Cell]] = []
    for spec in specs:
        if (found := evidence.closure(spec.name)) is not None:
            record = found["finetune"]
            rows.append(
                {
                    "closure": spec.name,
                    "trained": " and ".join(spec.trained),
                    "begun with": spec.start or "none",
                    "method": spec.settings.method,
                    "cells": " x ".join(str(n) for n in spec.overrides["fluid.cells"]),
                    "horizons [outputs]": ", ".join(str(n) for n in spec.settings.horizons or ()),
                    "updates": len(record["loss_history"]),
                    "skipped": record["skipped"],
                    "loss before": record["validation_loss_before"],
                    "loss after": record["validation_loss"],
                    "time [s]": record["seconds"],
                }
            )
    note = (
        "Loss of the training injection over the longest horizon, mean of the runs from its first frame and from the "
        "last that leaves room; the best weights are kept, those of the start among them."
    )
    return Table.of("Training", rows, note)


def _runs(evidence: Evidence, names: Sequence[str]) -> list[tuple[str, str, str]]:
    """Mesh, drag and name of the runs: Koch-Hill, the closures that the training starts from, and what came of it."""
    planned = set(evidence.plan.names("solver", RunSpec))
    drags = {"Koch-Hill": "", **{name: f"_{name}" for name in names}}
    drags["filtered and gradient_stress"] = "_filtered_gradient_stress"
    every = [
        (mesh, f"{what}{words}", f"coarse_{factor}{fluid}{end}")
        for factor, mesh in paper.COARSE.items()
        for fluid, words in FLUIDS.items()
        for what, end in drags.items()
    ]
    return [row for row in every if row[2] in planned]

"""What of the coarse mesh's error is the drag law's, seeing averages, and what the coarse fluid's own."""

from __future__ import annotations

import math

from jaxdem import metrics
from jaxdem.io import Run
from jaxdem.report.runs import history_until
from studies import paper
from studies.evidence import Evidence
from studies.measure import (
    LABELS,
    NAMES,
    flux_error,
    mean,
    peak_speed,
    run_flux_error,
    screen_time,
)
from studies.replay import FLUID_METRICS
from studies.tables import Cell, Section, Table

COARSE = "coarse, Koch-Hill"
DRAG = "fine fluid, drag on inputs averaged to this mesh"
VARIANTS = {
    COARSE: "coarse_{factor}",
    DRAG: "fine_inputs_{factor}",
    "coarse, first-order advection": "coarse_{factor}_upwind",
    "coarse, Smagorinsky 0.15": "coarse_{factor}_smagorinsky",
    "coarse, superbee": "coarse_{factor}_superbee",
    "coarse, central": "coarse_{factor}_central",
    "coarse, kernels of half a cell": "coarse_{factor}_narrow",
    "coarse, central and kernels of half a cell": "coarse_{factor}_sharp",
}
"""Runs by what they are."""

ORACLE = "coarse, true drag on the fine run's trajectories"


def budget_part(evidence: Evidence) -> Section:
    """Errors of every variant against the fine run, and how much of the coarse error each has."""
    section = Section("budget", "Error budget")
    section.text.append(
        "Each row is a run that has one of the coarse run's faults only, against the fine run: the drag's (fine fluid, "
        "drag on averaged inputs), the fluid's (coarse fluid, true drag on given trajectories), or the fluid's made "
        "otherwise."
    )
    fine = evidence.run("fine")
    if fine is None:
        section.missing = dict(evidence.missing)
        return section
    section.tables += [_own_mesh(evidence), _peaks(evidence, fine)]
    for factor, mesh in list(paper.MESHES.items())[1:]:
        found: dict[str, dict[str, float]] = {}
        for words, name in VARIANTS.items():
            run, error = evidence.run(name.format(factor=factor)), evidence.errors(name.format(factor=factor))
            if run is not None and error is not None:
                found[words] = error | {"flux": run_flux_error(run, fine)}
            if words == COARSE and (oracle := oracle_errors(evidence, factor)) is not None:
                found[ORACLE] = oracle
        if not found:
            continue
        rows = [_row(words, error) for words, error in found.items()]
        noise: list[Cell] = [
            "noise",
            *(100 * evidence.floor[n] for n in NAMES),
            100 * mean(evidence.floor),
            None,
        ]
        headings = ["what", *LABELS, "mean", "flux of the fluid"]
        section.tables.append(Table(f"Errors at {mesh} [%]", headings, [*rows, noise]))
        section.text += _shares(found, mesh)
    section.missing = dict(evidence.missing)
    return section


def oracle_errors(evidence: Evidence, factor: int) -> dict[str, float] | None:
    """Errors of the fluid's metrics in the replay, and of its flux."""
    fine, replay = evidence.run("fine"), evidence.replay(factor)
    if fine is None or replay is None:
        return None
    until = screen_time(fine)
    history, reference = replay.history(), history_until(fine, until)
    error = {
        name: metrics.relative_error(history["time"], history[name], reference["time"], reference[name])
        for name in FLUID_METRICS
    }
    return error | {"flux": flux_error(replay.time, replay.velocity, replay.void_fraction, fine)}


def _row(words: str, error: dict[str, float]) -> list[Cell]:
    nine = [error.get(name, math.nan) for name in NAMES]
    whole = all(name in error for name in NAMES)
    return [
        words,
        *(100 * e for e in nine),
        100 * mean({n: error[n] for n in NAMES}) if whole else None,
        100 * error["flux"],
    ]


def _shares(found: dict[str, dict[str, float]], mesh: str) -> list[str]:
    """Sentences: the drag's fault alone and the fluid's fault alone, over the coarse run's error."""
    plain, drag = found.get(COARSE), found.get(DRAG)
    sentences = []
    if plain is None:
        return []
    if drag is not None:
        parts = {n: drag[n] / plain[n] for n in (*NAMES, "flux") if plain[n] > 0}
        words = ", ".join(f"{n} {100 * part:.0f} %" for n, part in parts.items())
        sentences.append(f"{mesh}: error with the drag's fault alone, of the coarse run's: {words}.")
    if ORACLE in found:
        fluid = found[ORACLE]
        words = ", ".join(f"{n} {100 * fluid[n] / plain[n]:.0f} %" for n in fluid if plain[n] > 0)
        sentences.append(f"{mesh}: error of the coarse fluid with the true drag, of the coarse run's: {words}.")
    return sentences


def _own_mesh(evidence: Evidence) -> Table:
    """The replay on the fine run's own mesh: what sampling every so often loses."""
    own = oracle_errors(evidence, 1)
    rows: list[list[Cell]] = []
    if own is not None:
        rows.append([100 * own[name] for name in (*FLUID_METRICS, "flux")])
    names = [label for name, label in zip(NAMES, LABELS, strict=True) if name in FLUID_METRICS]
    return Table("Replay on the fine mesh itself [%]", [*names, "flux of the fluid"], rows, "The replay's own error.")


def _peaks(evidence: Evidence, fine: Run) -> Table:
    """What is left of the jet: the fastest water of each mesh."""
    until = screen_time(fine)
    rows: list[list[Cell]] = []
    for factor, mesh in list(paper.MESHES.items())[1:]:
        coarse, drag = evidence.run(f"coarse_{factor}"), evidence.run(f"fine_inputs_{factor}")
        replay, cells = evidence.replay(factor), None if coarse is None else coarse.cells
        row: list[Cell] = [mesh]
        row.append(None if cells is None else peak_speed(fine, until, cells))
        row.append(None if coarse is None else peak_speed(coarse, until))
        row.append(None if drag is None or cells is None else peak_speed(drag, until, cells))
        row.append(None if replay is None else replay.peak_speed(until))
        rows.append(row)
    headings = [
        "mesh",
        "fine run averaged to it",
        "coarse",
        "fine, drag on inputs averaged to it",
        "coarse, true drag",
    ]
    note = f"On the fine mesh itself {peak_speed(fine, until):.3g} m/s. Largest speed of a cell, mean over time."
    return Table("Peak water speed [m/s]", headings, rows, note)

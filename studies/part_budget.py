"""What of the coarse mesh's error is the drag law's, seeing averages, and what the coarse fluid's own."""

from __future__ import annotations

import math

from jaxdem import metrics
from jaxdem.io import Run
from jaxdem.report.runs import history_until
from studies import paper
from studies.evidence import Evidence
from studies.measure import NAMES, PERCENT, flux_error, labelled, mean, peak_speed, run_flux_error, screen_time
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

REPLAYED = "coarse, true drag on the fine run's trajectories"


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
    for factor, mesh in paper.COARSE.items():
        found: dict[str, dict[str, float]] = {}
        for words, name in VARIANTS.items():
            run, error = evidence.run(name.format(factor=factor)), evidence.errors(name.format(factor=factor))
            if run is not None and error is not None:
                found[words] = error | {"flux": run_flux_error(run, fine)}
            if words == COARSE and (replayed := replay_errors(evidence, factor)) is not None:
                found[REPLAYED] = replayed
        if found:
            rows = [_row(words, error) for words, error in {**found, "noise": evidence.floor}.items()]
            section.tables.append(Table.of(f"Errors at {mesh} [%]", rows))
            section.text += _shares(found, mesh)
    section.missing = dict(evidence.missing)
    return section


def replay_errors(evidence: Evidence, factor: int) -> dict[str, float] | None:
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


def _row(words: str, error: dict[str, float]) -> dict[str, Cell]:
    whole = mean({n: error[n] for n in NAMES}) if all(n in error for n in NAMES) else math.nan
    flux = error.get("flux", math.nan)
    return {"what": words, **labelled(error, PERCENT), "mean": whole / PERCENT, "flux of the fluid": flux / PERCENT}


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
    if REPLAYED in found:
        fluid = found[REPLAYED]
        words = ", ".join(f"{n} {100 * fluid[n] / plain[n]:.0f} %" for n in fluid if plain[n] > 0)
        sentences.append(f"{mesh}: error of the coarse fluid with the true drag, of the coarse run's: {words}.")
    return sentences


def _own_mesh(evidence: Evidence) -> Table:
    """The replay on the fine run's own mesh: what sampling every so often loses."""
    own = replay_errors(evidence, 1)
    rows: list[dict[str, Cell]] = []
    if own is not None:
        known = {label: value for label, value in labelled(own, PERCENT).items() if math.isfinite(value)}
        rows.append({**known, "flux of the fluid": own["flux"] / PERCENT})
    return Table.of("Replay on the fine mesh itself [%]", rows, "The replay's own error.")


def _peaks(evidence: Evidence, fine: Run) -> Table:
    """What is left of the jet: the fastest water of each mesh."""
    until = screen_time(fine)
    rows: list[dict[str, Cell]] = []
    for factor, mesh in paper.COARSE.items():
        coarse, drag = evidence.run(f"coarse_{factor}"), evidence.run(f"fine_inputs_{factor}")
        replay, cells = evidence.replay(factor), None if coarse is None else coarse.cells
        averaged = None if cells is None or drag is None else peak_speed(drag, until, cells)
        rows.append(
            {
                "mesh": mesh,
                "fine run averaged to it": None if cells is None else peak_speed(fine, until, cells),
                "coarse": None if coarse is None else peak_speed(coarse, until),
                "fine, drag on inputs averaged to it": averaged,
                "coarse, true drag": None if replay is None else replay.peak_speed(until),
            }
        )
    note = f"On the fine mesh itself {peak_speed(fine, until):.3g} m/s. Largest speed of a cell, mean over time."
    return Table.of("Peak water speed [m/s]", rows, note)

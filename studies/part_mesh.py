"""How much of the injection scene depends on the mesh, and which setting comes nearest to the source study."""

from __future__ import annotations

import numpy as np

from jaxdem.io import Run
from studies import paper
from studies.evidence import Evidence
from studies.measure import (
    PERCENT,
    band,
    errors,
    labelled,
    mean,
    mean_errors,
    mean_over,
    noise_floor,
    screen_time,
    whole,
)
from studies.tables import Cell, Section, Table

SETTINGS = {
    "single layer": "",
    "single layer of 70 MPa": "stiff_",
    "two-layer slab": "slab_",
    "water through the whole side": "whole_",
}
"""By what stands before the names of their runs."""


def mesh_part(evidence: Evidence) -> Section:
    """Run-off and height beside the paper's, errors by mesh over noise, other drag laws, run times."""
    section = Section("mesh", "Mesh dependence")
    section.tables.append(_ends(evidence, section))
    for setting, prefix in SETTINGS.items():
        section.tables += _errors(evidence, setting, prefix, section)
    section.tables += [_laws(evidence), _costs(evidence)]
    section.missing = dict(evidence.missing)
    return section


def packs(evidence: Evidence, prefix: str, factor: int) -> list[Run]:
    """The runs of all packs on a mesh."""
    name = f"{prefix}fine" if factor == 1 else f"{prefix}coarse_{factor}"
    return [*evidence.runs([name]), *evidence.jittered(name)]


def _ends(evidence: Evidence, section: Section) -> Table:
    """Run-off and height at the end, the paper's beside ours."""
    rows: list[dict[str, Cell]] = []
    far: dict[str, dict[tuple[int, str], float]] = {}
    for factor, mesh in paper.MESHES.items():
        row: dict[str, Cell] = {"mesh": mesh}
        for name, label, theirs in (("runoff", "run-off", paper.RUNOFF), ("height", "height", paper.HEIGHT)):
            row[f"{label} [m], paper"] = theirs[factor]
            for setting, prefix in SETTINGS.items():
                runs = whole(packs(evidence, prefix, factor), evidence.run(f"{prefix}fine"))
                values = [float(run.history[name][-1]) for run in runs]
                row[f"{label} [m], {setting}"] = band(values)
                if values:
                    difference = abs(np.mean(values) / theirs[factor] - 1.0)
                    far.setdefault(setting, {})[factor, name] = float(difference)
        rows.append(row)
    common = set.intersection(*(set(values) for values in far.values())) if far else set()
    means = {s: float(np.mean([values[key] for key in common])) for s, values in far.items() if common}
    order = sorted(means, key=means.__getitem__)
    if len(order) > 1:
        words = ", ".join(f"{setting} {100 * means[setting]:.0f} %" for setting in order)
        where = " and ".join(mesh for factor, mesh in paper.MESHES.items() if (factor, "runoff") in common)
        section.text.append(
            f"Mean difference from the paper's run-offs and heights on {where}, where all have a run: {words}; "
            f"the {order[0]} comes nearest."
        )
    note = (
        "Ours: mean and range over packs that differ in their jitter, at the end (of the whole side's runs: 2.5 s, of "
        "the others 5 s), when the front may stand at the screen."
    )
    return Table.of("Run-off and height at the end", rows, note)


def _errors(evidence: Evidence, setting: str, prefix: str, section: Section) -> list[Table]:
    """Errors of the nine metrics by mesh."""
    fine = evidence.run(f"{prefix}fine")
    if fine is None:
        return []
    until, end = screen_time(fine), float(fine.history["time"][-1])
    section.text.append(
        f"{setting[0].upper()}{setting[1:]}: compared "
        + (
            f"over all {end:.3g} s, the fine run's front does not reach the screen."
            if until is None
            else f"up to {until:.3g} s of {end:.3g} s, the last output before the fine run's front comes to the "
            "outlet's screen."
        )
    )
    found = {"noise": noise_floor(fine, evidence.jittered(f"{prefix}fine"))}
    for factor, mesh in paper.COARSE.items():
        if runs := packs(evidence, prefix, factor):
            found[mesh] = mean_errors([errors(run, fine) for run in runs])
    rows: list[dict[str, Cell]] = [
        {"mesh": mesh, **labelled(error, PERCENT), "mean": mean(error) / PERCENT} for mesh, error in found.items()
    ]
    return [Table.of(f"Error against 4 cm, {setting} [%]", rows, "Mean over the packs.")]


def _laws(evidence: Evidence) -> Table:
    """Other drag laws at 8 cm."""
    rows: list[dict[str, Cell]] = []
    laws = {"Koch-Hill": "coarse_2", "Di Felice": "coarse_2_di_felice", "Gidaspow": "coarse_2_gidaspow"}
    for law, name in laws.items():
        run, error = evidence.run(name), evidence.errors(name)
        if run is not None and error is not None:
            rows.append(
                {
                    "drag law": law,
                    "run-off [m]": float(run.history["runoff"][-1]),
                    "height [m]": float(run.history["height"][-1]),
                    "mean error against 4 cm with Koch-Hill [%]": mean(error) / PERCENT,
                    "over noise [-]": mean_over(error, evidence.floor),
                }
            )
    return Table.of("Drag laws at 8 cm, single layer", rows)


def _costs(evidence: Evidence) -> Table:
    """Run time and storage beside the paper's."""
    rows: list[dict[str, Cell]] = []
    for factor, mesh in paper.MESHES.items():
        row: dict[str, Cell] = {"mesh": mesh, "time [s], paper": paper.RUN_TIME[factor]}
        row["storage [GB], paper"] = paper.STORAGE[factor]
        for setting, prefix in SETTINGS.items():
            run = evidence.run(f"{prefix}fine" if factor == 1 else f"{prefix}coarse_{factor}")
            row[f"time [s], {setting}"] = None if run is None else evidence.run_time(run, f"{prefix}fine")
            row[f"storage [GB], {setting}"] = None if run is None else _stored(run) / 1e9
        rows.append(row)
    note = (
        "The paper's on four cores, ours on one core each, or on all for one process at a time, a column with one "
        f"device and one JAX; training samples are not counted as storage. {evidence.sharing}"
    )
    return Table.of("Run time and storage", rows, note)


def _stored(run: Run) -> int:
    """Bytes of a run without its samples."""
    return sum(f.stat().st_size for f in run.path.rglob("*") if f.is_file() and f.stem != "samples")

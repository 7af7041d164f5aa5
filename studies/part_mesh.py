"""How much of the injection scene depends on the mesh, and which setting comes nearest to the source study."""

from __future__ import annotations

import numpy as np

from jaxdem.io import Run
from studies import paper
from studies.evidence import Evidence
from studies.measure import (
    LABELS,
    NAMES,
    errors,
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
    headings = ["mesh", "run-off [m], paper"]
    headings += [f"run-off [m], {setting}" for setting in SETTINGS]
    headings += ["height [m], paper", *(f"height [m], {setting}" for setting in SETTINGS)]
    rows: list[list[Cell]] = []
    far: dict[str, dict[tuple[int, str], float]] = {setting: {} for setting in SETTINGS}
    for factor, mesh in paper.MESHES.items():
        row: list[Cell] = [mesh]
        for name, theirs in (("runoff", paper.RUNOFF), ("height", paper.HEIGHT)):
            row.append(theirs[factor])
            for setting, prefix in SETTINGS.items():
                runs = whole(packs(evidence, prefix, factor), evidence.run(f"{prefix}fine"))
                values = [float(run.history[name][-1]) for run in runs]
                row.append(_spread(values))
                if values:
                    far[setting][factor, name] = float(abs(np.mean(values) / theirs[factor] - 1.0))
        rows.append(row)
    found = {setting: values for setting, values in far.items() if values}
    common = set.intersection(*(set(values) for values in found.values())) if found else set()
    means = {s: float(np.mean([values[key] for key in common])) for s, values in found.items() if common}
    order = sorted(means, key=means.__getitem__)
    if len(order) > 1:
        words = ", ".join(f"{setting} {100 * means[setting]:.0f} %" for setting in order)
        where = " and ".join(mesh for factor, mesh in paper.MESHES.items() if (factor, "runoff") in common)
        section.text.append(
            f"Mean difference from the paper's run-offs and heights on {where}, where all have a run: {words}; "
            f"the {order[0]} comes nearest."
        )
    note = (
        "Ours: mean and range over packs that differ in their jitter, at the end (of the whole side's runs: 2.5 s, of the "
        "others 5 s), when the front may stand at the screen."
    )
    return Table("Run-off and height at the end", headings, rows, note)


def _spread(values: list[float]) -> Cell:
    if len(values) < 2:
        return values[0] if values else None
    return f"{np.mean(values):.3g} ({min(values):.3g} to {max(values):.3g})"


def _errors(evidence: Evidence, setting: str, prefix: str, section: Section) -> list[Table]:
    """Errors of the nine metrics by mesh."""
    fine = evidence.run(f"{prefix}fine")
    if fine is None:
        return []
    floor = noise_floor(fine, evidence.jittered(f"{prefix}fine"))
    until = screen_time(fine)
    end = float(fine.history["time"][-1])
    section.text.append(
        f"{setting[0].upper()}{setting[1:]}: compared over all {end:.3g} s, the fine run's front does not reach the screen."
        if until is None
        else f"{setting[0].upper()}{setting[1:]}: compared up to {until:.3g} s of {end:.3g} s, the last output before the fine run's front "
        "comes to the outlet's screen."
    )
    rows: list[list[Cell]] = [["noise", *(100 * floor[n] for n in NAMES), 100 * mean(floor)]]
    for factor, mesh in list(paper.MESHES.items())[1:]:
        if runs := packs(evidence, prefix, factor):
            error = mean_errors([errors(run, fine) for run in runs])
            rows.append([mesh, *(100 * error[n] for n in NAMES), 100 * mean(error)])
    title = f"Error against 4 cm, {setting} [%]"
    return [Table(title, ["mesh", *LABELS, "mean"], rows, "Mean over the packs.")]


def _laws(evidence: Evidence) -> Table:
    """Other drag laws at 8 cm."""
    rows: list[list[Cell]] = []
    for law, name in (
        ("Koch-Hill", "coarse_2"),
        ("Di Felice", "coarse_2_di_felice"),
        ("Gidaspow", "coarse_2_gidaspow"),
    ):
        run, error = evidence.run(name), evidence.errors(name)
        if run is not None and error is not None:
            ends = [float(run.history[key][-1]) for key in ("runoff", "height")]
            rows.append([law, *ends, 100 * mean(error), mean_over(error, evidence.floor)])
    headings = [
        "drag law",
        "run-off [m]",
        "height [m]",
        "mean error against 4 cm with Koch-Hill [%]",
        "over noise [-]",
    ]
    return Table("Drag laws at 8 cm, single layer", headings, rows)


def _costs(evidence: Evidence) -> Table:
    """Run time and storage beside the paper's."""
    rows: list[list[Cell]] = []
    for factor, mesh in paper.MESHES.items():
        row: list[Cell] = [mesh, paper.RUN_TIME[factor], paper.STORAGE[factor]]
        for prefix in SETTINGS.values():
            run = evidence.run(f"{prefix}fine" if factor == 1 else f"{prefix}coarse_{factor}")
            size = None
            if run is not None:
                size = sum(f.stat().st_size for f in run.path.rglob("*") if f.is_file() and f.stem != "samples")
            row += [
                None if run is None else evidence.run_time(run, f"{prefix}fine"),
                None if size is None else size / 1e9,
            ]
        rows.append(row)
    headings = ["mesh", "time [s], paper", "storage [GB], paper"]
    headings += [f"{what}, {setting}" for setting in SETTINGS for what in ("time [s]", "storage [GB]")]
    note = (
        "The paper's on four cores, ours on one core each, or on all for one process at a time, a column with one device and one JAX; training samples are not "
        f"counted as storage. {evidence.sharing}"
    )
    return Table("Run time and storage", headings, rows, note)

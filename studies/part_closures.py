"""Closures trained on other runs: R2 on the fine run that they have not seen, and coarse runs with them."""

from __future__ import annotations

import time as clock
from collections.abc import Iterable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxdem.closures import DRAG_LAWS, load_closure
from jaxdem.closures.base import DragInputs
from studies import paper
from studies.evidence import Evidence
from studies.injection import SWEEP_EPOCHS, SWEEPS, sweeps
from studies.measure import PERCENT, band, labelled, mean, mean_over, over, whole
from studies.specs import ClosureSpec
from studies.tables import Cell, Section, Table

EVALUATED = 20_000
"""Particles in the measurement of a drag evaluation."""


DRAGS = {
    "Koch-Hill": "",
    "filtered": "_filtered",
    "filtered, with terms": "_filtered_terms",
    "filtered, ensemble": "_filtered_ensemble",
    "paper": "_paper",
}
"""By what stands behind the names of coarse runs; terms and the ensemble at 16 cm only."""


def closures_part(evidence: Evidence) -> Section:
    """R2, coarse runs with closures, the band of seeds and activations, the paper's figures beside ours."""
    section = Section("closures", "Learned closures")
    section.text.append(
        "Closures are trained on other runs than the one they are judged by: a column of another geometry, and an "
        "injection with another pack and inlet. The fine run of injection.toml is held out."
    )
    section.tables += [_held_out(evidence), *_coarse_runs(evidence), _band(evidence), _times(evidence)]
    section.tables += sweep_tables(evidence)
    section.missing = dict(evidence.missing)
    return section


def _trained(evidence: Evidence) -> list[str]:
    """Names of the part's closures but those of the sweeps."""
    names = evidence.plan.names("closures", ClosureSpec)
    return [name for name in names if not name.startswith("sweep_")]


def _held_out(evidence: Evidence) -> Table:
    rows: list[dict[str, Cell]] = []
    for name in _trained(evidence):
        found = evidence.closure(name)
        for factor, r2 in ({} if found is None else found["r2"]).items():
            rows.append(
                {
                    "closure": name,
                    "inputs averaged": f"{factor}x",
                    "R2": float(r2["closure"]),
                    "R2 of Koch-Hill": float(r2["base"]),
                    "R2 of the regression": float(r2["regression"]),
                    "out of range [%]": float(r2["out_of_range"]) / PERCENT,
                }
            )
    return Table.of("R2 on the fine run, which no closure was trained on", rows, digits=4)


def _coarse_runs(evidence: Evidence) -> list[Table]:
    theirs = {"paper": (paper.RUNOFF_CLOSURE, paper.HEIGHT_CLOSURE), "Koch-Hill": (paper.RUNOFF, paper.HEIGHT)}
    ends: list[dict[str, Cell]] = []
    compared: list[tuple[str, str, str]] = []
    for factor, mesh in paper.COARSE.items():
        for what, end in DRAGS.items():
            name = f"coarse_{factor}{end}"
            compared.append((mesh, what, name))
            runoff, height = (table[factor] for table in theirs[what]) if what in theirs else (None, None)
            for run in whole(evidence.runs([name]), evidence.run("fine")):
                outside = float(run.summary["closure"]["out_of_range_fraction"])
                ends.append(
                    {
                        "mesh": mesh,
                        "drag": what,
                        "run-off [m]": float(run.history["runoff"][-1]),
                        "run-off [m], paper": runoff,
                        "height [m]": float(run.history["height"][-1]),
                        "height [m], paper": height,
                        "run time [s]": evidence.run_time(run),
                        "out of range [%]": outside / PERCENT,
                    }
                )
    note = "The paper's fine run: 9.1 m and 0.856 m."
    return [Table.of("Coarse runs at the end", ends, note), over_noise(evidence, compared)]


def over_noise(evidence: Evidence, runs: Iterable[tuple[str, str, str]]) -> Table:
    """Errors of coarse runs over the noise of the fine one, mean over their packs.

    Args:
        evidence: of the study.
        runs: mesh and drag in words, and the run's name.
    """
    rows: list[dict[str, Cell]] = []
    for mesh, what, name in runs:
        if (error := evidence.errors(name)) is not None:
            ratio, mean_ratio = labelled(over(error, evidence.floor)), mean_over(error, evidence.floor)
            row: dict[str, Cell] = {"mesh": mesh, "drag": what, **ratio, "mean": mean_ratio}
            rows.append({**row, "mean error [%]": mean(error) / PERCENT, "packs": evidence.packs(name)})
    return Table.of("Error over noise [-]", rows, "Mean over the packs.")


def _band(evidence: Evidence) -> Table:
    """Seeds and activations of the paper's network at 8 cm; the first has its number of epochs, the others fewer."""
    rows: list[dict[str, Cell]] = []
    kinds = {"filtered": "filtered", "paper, ELU": "paper", "paper, ReLU": "paper_relu"}
    for words, name in {**kinds, "paper, softplus": "paper_softplus"}.items():
        seeds = [fit for fit in _trained(evidence) if fit == name or fit.startswith(f"{name}_seed_")]
        runs = evidence.runs(f"coarse_2_{fit}" for fit in seeds)
        errors = [error for fit in seeds if (error := evidence.errors(f"coarse_2_{fit}")) is not None]
        full = whole(runs, evidence.run("fine"))
        rows.append(
            {
                "closure": words,
                "seeds": len(runs),
                "run-off [m]": band([float(run.history["runoff"][-1]) for run in full]),
                "height [m]": band([float(run.history["height"][-1]) for run in full]),
                "mean error [%]": band([mean(error) / PERCENT for error in errors]),
            }
        )
    note = "Mean, and smallest to largest; ends of whole runs."
    return Table.of("Seeds and activations in the solver at 8 cm", rows, note)


def _times(evidence: Evidence) -> Table:
    """Times of training and of one evaluation, beside the paper's."""
    run = evidence.run("training_column")
    times: list[tuple[str, float | None, float | None]] = [
        ("training, recipe paper", paper.TRAINING_TIME, evidence.training_seconds("paper")),
        ("training, recipe filtered", None, evidence.training_seconds("filtered")),
        ("training run", paper.TRAINING_RUN, None if run is None else evidence.run_time(run)),
        ("drag of a particle, classical", paper.EVALUATION["classical"], evaluation_time(DRAG_LAWS["koch_hill"]())),
    ]
    for name, theirs in (("paper", paper.EVALUATION["learned"]), ("filtered", None)):
        file = evidence.folder.closure(name)
        seconds = evaluation_time(load_closure(file)[0]) if file.is_file() else None
        times.append((f"drag of a particle, {name}", theirs, seconds))
    rows = [{"what": f"{what} [s]", "the paper's": theirs, "ours": ours} for what, theirs, ours in times]
    note = f"Ours: for {EVALUATED} particles at once, compiled, over their number. {evidence.sharing}"
    return Table.of("Times", rows, note)


def evaluation_time(closure: Any, particles: int = EVALUATED) -> float:
    """Time of one evaluation per particle, the best of five [s]; two dimensions."""
    random = np.random.default_rng(0)

    def rows(scale: float) -> jax.Array:
        return jnp.asarray(random.normal(0.0, scale, (particles, 2)), jnp.float32)

    def number(value: float) -> jax.Array:
        return jnp.asarray(value, jnp.float32)

    solids = jnp.asarray(random.uniform(0.05, 0.3, particles), jnp.float32)
    inputs = DragInputs(
        rows(0.5), rows(1.0), solids, rows(1.0), rows(1e4), number(0.02), number(0.08), number(1000.0), number(1e-3)
    )  # fmt: skip
    given = jax.jit(lambda i: closure(i)[:2])
    jax.block_until_ready(given(inputs))
    times = []
    for _ in range(5):
        begin = clock.perf_counter()
        jax.block_until_ready(given(inputs))
        times.append(clock.perf_counter() - begin)
    return min(times) / particles


def sweep_tables(evidence: Evidence) -> list[Table]:
    """R2 by one setting of the paper's network, the paper's beside ours."""
    tables = []
    for what, fits in sweeps().items():
        rows: list[dict[str, Cell]] = []
        for fit, value in zip(fits, SWEEPS[what], strict=True):
            if (found := evidence.closure(fit.name)) is not None:
                rows.append(
                    {
                        what: "-".join(map(str, value)) if isinstance(value, tuple) else str(value),
                        "the paper's (2,000 epochs)": paper.R2[what].get(value),
                        "ours": float(found["r2"]["1"]["closure"]),
                        "s a network": float(found["seconds"]),
                    }
                )
        tables.append(Table.of(f"R2 by {what}, fine inputs, {SWEEP_EPOCHS} epochs", rows, digits=4))
    return tables

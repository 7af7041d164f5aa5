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
from studies.measure import LABELS, NAMES, mean, mean_over, over, whole
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
    section.tables += [_held_out(evidence), *_coarse_runs(evidence), _band(evidence), _figures(evidence)]
    section.tables += sweep_tables(evidence)
    section.missing = dict(evidence.missing)
    return section


def _trained(evidence: Evidence) -> list[str]:
    """Names of the part's closures but those of the sweeps."""
    names = evidence.plan.names("closures", ClosureSpec)
    return [name for name in names if not name.startswith("sweep_")]


def _held_out(evidence: Evidence) -> Table:
    rows: list[list[Cell]] = []
    for name in _trained(evidence):
        found = evidence.closure(name)
        for factor, r2 in ({} if found is None else found["r2"]).items():
            scores = [float(r2[key]) for key in ("closure", "base", "regression")]
            rows.append([name, f"{factor}x", *scores, 100 * float(r2["out_of_range"])])
    headings = [
        "closure",
        "inputs averaged",
        "R2",
        "R2 of Koch-Hill",
        "R2 of the regression",
        "out of range [%]",
    ]
    return Table("R2 on the fine run, which no closure was trained on", headings, rows, digits=4)


def _coarse_runs(evidence: Evidence) -> list[Table]:
    ends: list[list[Cell]] = []
    compared: list[tuple[str, str, str]] = []
    for factor, mesh in list(paper.MESHES.items())[1:]:
        for what, name in DRAGS.items():
            compared.append((mesh, what, f"coarse_{factor}{name}"))
            if not (found := whole(evidence.runs([f"coarse_{factor}{name}"]), evidence.run("fine"))):
                continue
            (run,) = found
            theirs = {
                "paper": (paper.RUNOFF_CLOSURE, paper.HEIGHT_CLOSURE),
                "Koch-Hill": (paper.RUNOFF, paper.HEIGHT),
            }
            given = [table[factor] for table in theirs[what]] if what in theirs else [None, None]
            outside = 100 * float(run.summary["closure"]["out_of_range_fraction"])
            final = [float(run.history[key][-1]) for key in ("runoff", "height")]
            ends.append(
                [
                    mesh,
                    what,
                    final[0],
                    given[0],
                    final[1],
                    given[1],
                    evidence.run_time(run),
                    outside,
                ]
            )
    headings = [
        "mesh",
        "drag",
        "run-off [m]",
        "run-off [m], paper",
        "height [m]",
        "height [m], paper",
        "run time [s]",
        "out of range [%]",
    ]
    return [
        Table("Coarse runs at the end", headings, ends, "The paper's fine run: 9.1 m and 0.856 m."),
        over_noise(evidence, compared),
    ]


def over_noise(evidence: Evidence, runs: Iterable[tuple[str, str, str]]) -> Table:
    """Errors of coarse runs over the noise of the fine one, mean over their packs.

    Args:
        evidence: the study's folder.
        runs: mesh and drag in words, and the run's name.
    """
    rows: list[list[Cell]] = []
    for mesh, what, name in runs:
        if (error := evidence.errors(name)) is not None:
            ratio, whole = over(error, evidence.floor), mean_over(error, evidence.floor)
            packs = evidence.packs(name)
            rows.append([mesh, what, *(ratio[n] for n in NAMES), whole, 100 * mean(error), packs])
    headings = ["mesh", "drag", *LABELS, "mean", "mean error [%]", "packs"]
    return Table("Error over noise [-]", headings, rows, "Mean over the packs.")


def _band(evidence: Evidence) -> Table:
    """Seeds and activations of the paper's network at 8 cm; the first has its number of epochs, the others fewer."""
    rows: list[list[Cell]] = []
    kinds = {
        "filtered": "filtered",
        "paper, ELU": "paper",
        "paper, ReLU": "paper_relu",
        "paper, softplus": "paper_softplus",
    }
    for words, name in kinds.items():
        seeds = [fit for fit in _trained(evidence) if fit == name or fit.startswith(f"{name}_seed_")]
        runs = evidence.runs(f"coarse_2_{fit}" for fit in seeds)
        errors = [error for fit in seeds if (error := evidence.errors(f"coarse_2_{fit}")) is not None]
        full = whole(runs, evidence.run("fine"))
        ends = [[float(run.history[key][-1]) for run in full] for key in ("runoff", "height")]
        rows.append([words, len(runs), *(_band_of(v) for v in ends), _band_of([100 * mean(e) for e in errors])])
    headings = ["closure", "seeds", "run-off [m]", "height [m]", "mean error [%]"]
    return Table(
        "Seeds and activations in the solver at 8 cm",
        headings,
        rows,
        "Mean, and smallest to largest; ends of whole runs.",
    )


def _band_of(values: list[float]) -> Cell:
    return f"{np.mean(values):.3g} ({min(values):.3g} to {max(values):.3g})" if values else None


def _figures(evidence: Evidence) -> Table:
    """Times of training and of one evaluation, beside the paper's."""
    rows: list[list[Cell]] = [
        ["training, recipe paper [s]", paper.TRAINING_TIME, evidence.training_seconds("paper")],
        ["training, recipe filtered [s]", None, evidence.training_seconds("filtered")],
    ]
    run = evidence.run("training_column")
    rows.append(["training run [s]", paper.TRAINING_RUN, None if run is None else evidence.run_time(run)])
    rows.append(
        [
            "drag of a particle, classical [s]",
            paper.EVALUATION["classical"],
            evaluation_time(DRAG_LAWS["koch_hill"]()),
        ]
    )
    for name in ("paper", "filtered"):
        file = evidence.folder.closure(name)
        seconds = evaluation_time(load_closure(file)[0]) if file.is_file() else None
        theirs = paper.EVALUATION["learned"] if name == "paper" else None
        rows.append([f"drag of a particle, {name} [s]", theirs, seconds])
    note = f"Ours: for {EVALUATED} particles at once, compiled, over their number. {evidence.sharing}"
    return Table("Times", ["what", "the paper's", "ours"], rows, note)


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
        rows: list[list[Cell]] = []
        for fit, value in zip(fits, SWEEPS[what], strict=True):
            if (found := evidence.closure(fit.name)) is not None:
                r2 = float(found["r2"]["1"]["closure"])
                words = "-".join(map(str, value)) if isinstance(value, tuple) else str(value)
                rows.append([words, paper.R2.get(what, {}).get(value), r2, float(found["seconds"])])
        title = f"R2 by {what}, fine inputs, {SWEEP_EPOCHS} epochs"
        tables.append(Table(title, [what, "the paper's (2,000 epochs)", "ours", "s a network"], rows, digits=4))
    return tables

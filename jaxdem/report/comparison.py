"""The numbers of a comparison: one row a run, its errors against the reference, the noise floor, what to beware of."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from jaxdem import metrics
from jaxdem.errors import InputError
from jaxdem.io.durable import write_bytes
from jaxdem.report import runs as read
from jaxdem.report.runs import RunLike

NAMES = tuple(metric.name for metric in metrics.METRICS)
NAN = float("nan")


@dataclass(frozen=True)
class Row:
    """One run of a comparison.

    Attributes:
        role: "reference", "run" or "noise" (a reference run again, its pack jittered).
        cells: fluid cells along each axis, None without fluid.
        contact_time_step, training_cost_s: [s]; NaN where not recorded.
        run_time_s, compile_time_s: `metrics.run_time`, which is without compiling, and `metrics.compile_time` [s]; medians
            over the packs.
        valid: what the run's summary says; False where there is no summary.
        complete: whether the history reaches the end that scene and reference ask for.
        end_time, compared_from, compared_until: [s]; last output, and the span shared with the reference.
        final: the nine metrics at the last output, SI.
        errors: `metrics.relative_error` of each [-]; NaN where missing. With several packs the mean over them.
        mean_error: mean of the finite errors [-]; metrics_counted: how many those are.
        packs: (run time [s], mean error [-]) with each pack; one for a run that was done once.
        error_over_noise: mean error over the noise floor's [-]; NaN without noise runs.
        pareto: on the front of mean error against run time, among valid and complete runs; see `Comparison`.
    """

    name: str
    role: str
    path: str
    cells: tuple[int, ...] | None
    particles: float
    closure: str
    drag: str
    precision: str
    contact_time_step: float
    run_time_s: float
    compile_time_s: float
    valid: bool
    complete: bool
    status: str
    end_time: float
    compared_from: float
    compared_until: float
    final: dict[str, float]
    errors: dict[str, float]
    mean_error: float
    metrics_counted: int
    packs: tuple[tuple[float, float], ...] = ()
    training_cost_s: float = NAN
    error_over_noise: float = NAN
    pareto: bool = False

    @property
    def ranked(self) -> bool:
        """Whether the run may stand on the Pareto front: valid and as long as the reference."""
        return self.valid and self.complete

    @property
    def pack_errors(self) -> tuple[float, ...]:
        """Mean error with each pack [-]."""
        return tuple(error for _, error in self.packs)

    @property
    def cells_text(self) -> str:
        """Mesh as "75 x 12"; a dash without fluid."""
        return " x ".join(str(n) for n in self.cells) if self.cells else "-"


@dataclass
class Comparison:
    """Runs against a reference. `rows` has the reference first; `noise_rows` the jittered reference runs.

    Two mean errors, or two run times, that differ by no more than the noise are the same here: on the Pareto front, in the
    findings, everywhere.

    Attributes:
        noise_floor: mean over the noise runs of each metric's error [-]; empty without noise runs.
        noise_mean: mean over the noise runs of their mean error [-]; NaN without.
        warnings: sentences on what limits the comparison.
        sentences: the plain-language summary, one finding each.
        files: what was written, by its short name.
    """

    rows: list[Row]
    noise_rows: list[Row] = field(default_factory=list)
    noise_floor: dict[str, float] = field(default_factory=dict)
    noise_mean: float = NAN
    warnings: list[str] = field(default_factory=list)
    sentences: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    files: dict[str, Path] = field(default_factory=dict)

    @property
    def reference(self) -> Row:
        """The row of the reference."""
        return self.rows[0]

    @property
    def error_noise(self) -> float:
        """Difference of two mean errors that means nothing [-]; NaN where it is not known.

        The noise floor, or half the range of a run's mean error over its packs where that is more.
        """
        known = [half_range(row.pack_errors) for row in self.rows if len(row.packs) > 1]
        return max([*known, *filter(math.isfinite, [self.noise_mean])], default=NAN)

    @property
    def time_noise(self) -> float:
        """Relative difference of two run times that means nothing [-]; NaN where it is not known.

        Half the range over packs of a run, or over reference and noise runs, over the middle of it: the largest.
        """
        reference = [row.run_time_s for row in (self.reference, *self.noise_rows) if row.ranked]
        groups = [reference, *([time for time, _ in row.packs] for row in self.rows)]
        groups = [[time for time in group if time > 0.0] for group in groups]
        known = [2.0 * half_range(group) / (min(group) + max(group)) for group in groups if len(group) > 1]
        return max(known, default=NAN)


@dataclass(frozen=True)
class Entry:
    """A run under its name and role, with the history that is compared (columns (T,), SI).

    Attributes:
        packs: the same run with other packs, each with its history.
    """

    name: str
    role: str
    run: RunLike
    history: dict[str, read.Array]
    packs: tuple[tuple[RunLike, dict[str, read.Array]], ...] = ()


def half_range(values: Sequence[float]) -> float:
    """Half of the largest less the smallest."""
    return 0.5 * (max(values) - min(values))


def choose_names(reference: RunLike, runs: Sequence[RunLike], names: Sequence[str] | None) -> list[str]:
    """Names of the reference and the runs, all different; by default the names of their directories.

    Args:
        names: one a run, or one more with the reference's name first.

    Raises:
        InputError: another number of names, or two that are equal.
    """
    if names is not None:
        if len(names) not in (len(runs), len(runs) + 1):
            raise InputError(
                "names",
                list(names),
                f"must have one name for each of {len(runs)} run(s)",
                "Give that many, or one more with the name of the reference first.",
            )
        chosen = [str(n) for n in names]
        if len(chosen) == len(runs):
            chosen.insert(0, _default_name(reference) if _default_name(reference) not in chosen else "reference")
        if len(set(chosen)) < len(chosen):
            raise InputError("names", chosen, "must all be different", "Rename one of the two.")
        return chosen
    chosen = [_default_name(run) for run in (reference, *runs)]
    longer = [
        f"{Path(run.path).resolve().parent.name}/{name}" for run, name in zip((reference, *runs), chosen, strict=True)
    ]
    if len(set(chosen)) < len(chosen):
        chosen = longer
    return [name if chosen.count(name) == 1 else f"{name} #{i}" for i, name in enumerate(chosen)]


def _default_name(run: RunLike) -> str:
    return Path(run.path).resolve().name or "run"


def make_row(entry: Entry, reference: Entry, training_cost: float, until: float | None) -> Row:
    """Read one run's figures and its errors against the reference; with several packs the means over the sound runs."""
    first = _row_of_one(entry, reference, training_cost, until)
    others = [replace(entry, run=run, history=history, packs=()) for run, history in entry.packs]
    rows = [first, *(_row_of_one(other, reference, training_cost, until) for other in others)]
    rows = [row for row in rows if row.ranked and math.isfinite(row.mean_error)]
    if not first.ranked or len(rows) < 2:
        return first
    return replace(
        first,
        errors={name: float(np.mean([row.errors[name] for row in rows])) for name in NAMES},
        mean_error=float(np.mean([row.mean_error for row in rows])),
        run_time_s=float(np.median([row.run_time_s for row in rows])),
        compile_time_s=float(np.median([row.compile_time_s for row in rows])),
        packs=tuple(pack for row in rows for pack in row.packs),
    )


def _row_of_one(entry: Entry, reference: Entry, training_cost: float, until: float | None) -> Row:
    run, history = entry.run, entry.history
    own, other = history["time"], reference.history["time"]
    errors = metrics.errors(history, reference.history)
    finite = [error for error in errors.values() if math.isfinite(error)]
    shared = (max(own[0], other[0]), min(own[-1], other[-1])) if len(own) and len(other) else (NAN, NAN)
    valid = read.lookup(run.summary, "valid") is True
    end_time = float(own[-1]) if len(own) else NAN
    complete, status = _status(run, valid, end_time, other, until)
    mean_error, time = float(np.mean(finite)) if finite else NAN, metrics.run_time(run.summary or {})
    return Row(
        name=entry.name,
        role=entry.role,
        path=str(run.path),
        cells=read.cells(run),
        particles=read.number(read.lookup(run.summary, "counts.particles", read.lookup(run.scene, "particles.count"))),
        closure=read.closure_file(run),
        drag=str(read.lookup(run.scene, "coupling.drag", "")),
        precision=str(read.lookup(run.summary, "precision", read.lookup(run.scene, "precision", ""))),
        contact_time_step=read.number(
            read.lookup(run.summary, "time_steps.contact", read.lookup(run.scene, "contact.time_step"))
        ),
        run_time_s=time,
        compile_time_s=metrics.compile_time(run.summary or {}),
        valid=valid,
        complete=complete,
        status=status,
        end_time=end_time,
        compared_from=float(shared[0]),
        compared_until=float(shared[1]),
        final={name: float(history[name][-1]) if name in history and len(own) else NAN for name in NAMES},
        errors=errors,
        mean_error=mean_error,
        metrics_counted=len(finite),
        packs=((time, mean_error),),
        training_cost_s=training_cost,
    )


def _status(
    run: RunLike, valid: bool, end_time: float, reference_times: read.Array, until: float | None
) -> tuple[bool, str]:
    """(complete, text): whether the history reaches the planned end, to within half an output interval."""
    planned = read.number(read.lookup(run.scene, "time.end"))
    ends = [end for end in (planned, float(reference_times[-1]) if len(reference_times) else NAN) if math.isfinite(end)]
    wanted = min(max(ends, default=NAN), math.inf if until is None else until)
    interval = float(np.median(np.diff(reference_times))) if len(reference_times) > 1 else 0.0
    complete = bool(math.isfinite(end_time) and end_time >= wanted - 0.5 * interval - 1e-9)
    parts = []
    if not valid:
        reason = read.lookup(run.summary, "reason") or ("no reason recorded" if run.summary else "no summary")
        parts.append(f"INVALID: {reason}")
    if not complete:
        parts.append(
            f"incomplete: ended at {end_time:.4g} s of {wanted:.4g} s" if math.isfinite(end_time) else "no history"
        )
    return complete, "; ".join(parts) or "valid"


def build(
    reference: Entry,
    entries: Sequence[Entry],
    noise: Sequence[Entry],
    cost: Mapping[str, float],
    until: float | None,
) -> Comparison:
    """Rows of all runs, the noise floor, and the Pareto front of mean error against run time.

    The front is over runs that are valid and as long as the reference: a run that stopped early is cheap and has had
    less time to err, and would win for the wrong reason. The reference, whose error is zero by definition, is not on it.
    Its points differ by more than the noise, as far as that is known.
    """
    rows = [make_row(entry, reference, cost.get(entry.name, NAN), until) for entry in (reference, *entries)]
    noise_rows = [make_row(entry, reference, NAN, until) for entry in noise]
    used = [row for row in noise_rows if row.ranked]
    floor, mean = {}, NAN
    if used:
        floor = {name: float(np.mean([row.errors[name] for row in used])) for name in NAMES}
        mean = float(np.mean([row.mean_error for row in used]))
    if mean > 0.0:
        rows = [replace(row, error_over_noise=row.mean_error / mean) for row in rows]
        noise_rows = [replace(row, error_over_noise=row.mean_error / mean) for row in noise_rows]
    result = Comparison(rows=rows, noise_rows=noise_rows, noise_floor=floor, noise_mean=mean)
    candidates = [row.ranked and row.role == "run" for row in rows]
    costs = [row.run_time_s if ok else NAN for row, ok in zip(rows, candidates, strict=True)]
    known = [value if math.isfinite(value) else 0.0 for value in (result.time_noise, result.error_noise)]
    front = metrics.pareto_front(costs, [row.mean_error for row in rows], *known)
    result.rows = [replace(row, pareto=bool(on)) for row, on in zip(rows, front, strict=True)]
    return result


def write_csv(comparison: Comparison, path: Path) -> None:
    """comparison.csv: one row a run, the reference first, noise runs last; missing numbers are `nan`."""
    with_noise = bool(comparison.noise_rows)
    records = [_record(row, with_noise) for row in (*comparison.rows, *comparison.noise_rows)]
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, fieldnames=list(records[0]))
    writer.writeheader()
    writer.writerows(records)
    write_bytes(path, text.getvalue().encode())


def _record(row: Row, with_noise: bool) -> dict[str, Any]:
    record: dict[str, Any] = {
        "name": row.name,
        "cells": "x".join(str(n) for n in row.cells or ()),
        "particle_count": int(row.particles) if math.isfinite(row.particles) else "",
        "closure_file": row.closure,
        "drag_law": row.drag,
        "precision": row.precision,
        "contact_time_step": row.contact_time_step,
        "wall_time_s": row.run_time_s + row.compile_time_s,
        "valid": "true" if row.valid else "false",
        **row.final,
        **{f"error_{name}": error for name, error in row.errors.items()},
        "mean_error": row.mean_error,
    }
    if with_noise:
        record["error_over_noise"] = row.error_over_noise
    return record | {
        "role": row.role,
        "status": row.status,
        "end_time": row.end_time,
        "compared_from": row.compared_from,
        "compared_until": row.compared_until,
        "metrics_counted": row.metrics_counted,
        "run_time_s": row.run_time_s,
        "compile_time_s": row.compile_time_s,
        "packs": len(row.packs),
        "mean_error_lowest": min(row.pack_errors),
        "mean_error_highest": max(row.pack_errors),
        "training_cost_s": row.training_cost_s,
        "pareto": "true" if row.pareto else "false",
        "path": row.path,
    }

"""The numbers of a comparison: one row a run, its errors against the reference, the noise floor, the Pareto front."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from jaxdem import metrics
from jaxdem.errors import InputError
from jaxdem.io import Run
from jaxdem.report import runs as read
from jaxdem.report.runs import NAMES, Array
from jaxdem.report.style import NOISE, RunStyle, styles

NAN = float("nan")
Role = Literal["reference", "run", "noise"]


@dataclass(frozen=True)
class Candidate:
    """A run to be compared.

    Attributes:
        run: as `jaxdem.load_run` gives it.
        name: under which it is shown; by default that of its folder.
        packs: the same run with other packs; its errors are means over all of them, and their scatter is shown.
        training_cost_s: time spent to train its closure [s]; NaN without training.
    """

    run: Run
    name: str = ""
    packs: Sequence[Run] = ()
    training_cost_s: float = NAN


class Trial(NamedTuple):
    """A run with one of its packs: `run_time`, `compile_time` [s] and `errors` [-] of `jaxdem.metrics`."""

    run_time_s: float
    compile_time_s: float
    errors: dict[str, float]

    @property
    def finite_errors(self) -> list[float]:
        """Those that the mean is over."""
        return [error for error in self.errors.values() if math.isfinite(error)]

    @property
    def mean_error(self) -> float:
        """Mean of the finite errors [-]; NaN where there is none."""
        return float(np.mean(self.finite_errors)) if self.finite_errors else NAN


@dataclass(frozen=True, eq=False)
class Row:
    """One run of a comparison.

    Attributes:
        role: "noise" is a reference run again, with another pack.
        history: what is compared of it; columns (T,), SI.
        valid: what the run's summary says; False where there is no summary.
        complete: whether the history reaches the end that scene and reference ask for.
        status: "valid", or in words what is wrong.
        compared_from, compared_until: span shared with the reference [s]; end_time: of the last output [s].
        final: the nine metrics at the last output, SI.
        trials: with each pack that is valid and complete; one for a run that was done once.
        trials_done: how many packs it was done with.
        run_time_s, compile_time_s: medians over the packs [s]; NaN where not recorded.
        errors, mean_error: means over the packs [-]; NaN where missing.
        cells: of the fluid along each axis; None without.
        particles: how many; NaN where not recorded.
        closure: file of the learned closure; empty for a drag law alone.
    """

    name: str
    role: Role
    run: Run
    history: dict[str, Array]
    look: RunStyle
    valid: bool
    complete: bool
    status: str
    compared_from: float
    compared_until: float
    end_time: float
    final: dict[str, float]
    trials: tuple[Trial, ...]
    trials_done: int
    training_cost_s: float
    run_time_s: float
    compile_time_s: float
    errors: dict[str, float]
    mean_error: float
    cells: tuple[int, ...] | None
    particles: float
    closure: str
    drag: str

    @property
    def ranked(self) -> bool:
        """Whether the run may stand on the Pareto front: valid and as long as the reference."""
        return self.valid and self.complete

    @property
    def label(self) -> str:
        """Name in a legend, with what one must know of the run."""
        state = "" if self.ranked else "incomplete" if self.valid else "INVALID"
        remarks = ["reference"] * (self.role == "reference") + [state] * bool(state)
        return f"{self.name} ({', '.join(remarks)})" if remarks else self.name

    @property
    def pack_errors(self) -> list[float]:
        """Mean error with each pack [-]."""
        return [trial.mean_error for trial in self.trials]

    @property
    def metrics_counted(self) -> int:
        """Number of finite errors."""
        return len(self.trials[0].finite_errors)

    @property
    def cells_text(self) -> str:
        """Mesh as "75 x 12"; a dash without fluid."""
        return " x ".join(str(n) for n in self.cells) if self.cells else "-"


@dataclass
class Comparison:
    """Runs against a reference. `rows` has the reference first; `noise_rows` the reference runs with other packs.

    Two mean errors, or two run times, that differ by no more than the noise are the same here: on the Pareto front, in
    the findings, everywhere.

    Attributes:
        until: nothing after this time is compared [s].
        warnings: sentences on what limits the comparison.
        sentences: the plain-language summary, one finding each.
        files: what was written, by its short name.
    """

    rows: list[Row]
    noise_rows: list[Row] = field(default_factory=list)
    until: float | None = None
    warnings: list[str] = field(default_factory=list)
    sentences: list[str] = field(default_factory=list)
    files: dict[str, Path] = field(default_factory=dict)

    @property
    def reference(self) -> Row:
        """The row of the reference."""
        return self.rows[0]

    @property
    def runs(self) -> list[Row]:
        """The rows of the runs that are compared with it."""
        return self.rows[1:]

    @property
    def every(self) -> list[Row]:
        """All rows, those of the noise last."""
        return [*self.rows, *self.noise_rows]

    @property
    def noise_floor(self) -> dict[str, float]:
        """Mean over the sound noise runs of each metric's error [-]; empty without."""
        used = [row.errors for row in self.noise_rows if row.ranked]
        return {name: float(np.mean([errors[name] for errors in used])) for name in NAMES} if used else {}

    @property
    def noise_mean(self) -> float:
        """Mean over the sound noise runs of their mean error [-]; NaN without."""
        used = [row.mean_error for row in self.noise_rows if row.ranked]
        return float(np.mean(used)) if used else NAN

    def over_noise(self, row: Row) -> float:
        """Mean error over the noise floor's [-]; NaN without noise runs."""
        return row.mean_error / self.noise_mean if self.noise_mean > 0.0 else NAN

    @property
    def error_noise(self) -> float:
        """Difference of two mean errors that means nothing [-]; NaN where it is not known.

        The noise floor, or half the range of a run's mean error over its packs where that is more.
        """
        known = [0.5 * float(np.ptp(row.pack_errors)) for row in self.rows if len(row.trials) > 1]
        return max([*known, *filter(math.isfinite, [self.noise_mean])], default=NAN)

    @property
    def time_noise(self) -> float:
        """Relative difference of two run times that means nothing [-]; NaN where it is not known.

        Half the range over packs of a run, or over reference and noise runs, over the middle of it: the largest.
        """
        groups = [[row.run_time_s for row in (self.reference, *self.noise_rows) if row.ranked]]
        groups += [[trial.run_time_s for trial in row.trials] for row in self.rows]
        groups = [[time for time in group if time > 0.0] for group in groups]
        known = [float(np.ptp(group)) / (min(group) + max(group)) for group in groups if len(group) > 1]
        return max(known, default=NAN)

    @property
    def front(self) -> list[Row]:
        """The Pareto front of mean error against run time, cheapest first; see `metrics.pareto_front`.

        It is over runs that are valid and as long as the reference: a run that stopped early is cheap and has had less
        time to err, and would win for the wrong reason. The reference, whose error is zero by definition, is not on it.
        Its points differ by more than the noise, as far as that is known.
        """
        ranked = [row for row in self.runs if row.ranked]
        noise = (value if math.isfinite(value) else 0.0 for value in (self.time_noise, self.error_noise))
        on = metrics.pareto_front([row.run_time_s for row in ranked], [row.mean_error for row in ranked], *noise)
        return sorted((row for row, yes in zip(ranked, on, strict=True) if yes), key=lambda row: row.run_time_s)


def build(
    reference: Candidate, runs: Sequence[Candidate], noise: Sequence[Run] = (), until: float | None = None
) -> Comparison:
    """Rows of all runs.

    Raises:
        InputError: no run, two of one name, a reference without outputs, a history whose times do not increase.
    """
    if not runs:
        raise InputError("runs", list(runs), "needs at least one run", "Name a run to compare with the reference.")
    every = [reference, *runs]
    base = read.history_until(reference.run, until)
    if not len(base["time"]):
        when = "that can be read yet" if until is None else f"until {until:g} s"
        remedy = "wait for its first output, or compare with another run"
        raise InputError("reference", str(reference.run.path), f"has no output {when}", remedy)
    rows = [
        _row(candidate, name, "run" if number else "reference", look, base, until)
        for number, (candidate, name, look) in enumerate(zip(every, _names(every), styles(len(every)), strict=True))
    ]
    grey = RunStyle(NOISE, "solid", "circle", 0.9)
    others = [_row(Candidate(run), f"noise {i}", "noise", grey, base, until) for i, run in enumerate(noise, start=1)]
    return Comparison(rows, others, until)


def row_of_one(run: Run) -> Row:
    """A run by itself."""
    return _row(Candidate(run), folder_name(run), "run", styles(2)[1], read.history_until(run, None), None)


def _names(candidates: Sequence[Candidate]) -> list[str]:
    """All different; those that are not given are the names of the directories, with their parents' where needed."""
    given = [candidate.name for candidate in candidates if candidate.name]
    if len(set(given)) < len(given):
        raise InputError("names", given, "must all be different", "Rename one of the two.")
    names = [candidate.name or folder_name(candidate.run) for candidate in candidates]
    if len(set(names)) < len(names):
        names = [one.name or "/".join(Path(one.run.path).resolve().parts[-2:]) for one in candidates]
    return [name if names.count(name) == 1 else f"{name} #{i}" for i, name in enumerate(names)]


def folder_name(run: Run) -> str:
    """Name of the run's folder."""
    return Path(run.path).resolve().name or "run"


def _row(
    candidate: Candidate, name: str, role: Role, look: RunStyle, reference: dict[str, Array], until: float | None
) -> Row:
    """Read a run's figures and its errors against the reference's history; of its packs those of the sound runs."""
    run, other = candidate.run, reference["time"]
    history = read.history_until(run, until)
    own = history["time"]
    complete, status = _state(run, own, other, until)
    trials = [_trial(run, history, reference)]
    for pack in candidate.packs if status == "valid" else ():
        more = read.history_until(pack, until)
        if _state(pack, more["time"], other, until)[1] == "valid":
            trials.append(_trial(pack, more, reference))
    shared = (max(own[0], other[0]), min(own[-1], other[-1])) if len(own) and len(other) else (NAN, NAN)
    return Row(
        name, role, run, history, look,
        valid=read.lookup(run.summary, "valid") is True,
        complete=complete,
        status=status,
        compared_from=float(shared[0]),
        compared_until=float(shared[1]),
        end_time=float(own[-1]) if len(own) else NAN,
        final={n: float(history[n][-1]) if len(history.get(n, ())) else NAN for n in NAMES},
        trials=tuple(trials),
        trials_done=1 + len(candidate.packs),
        training_cost_s=float(candidate.training_cost_s),
        run_time_s=float(np.median([trial.run_time_s for trial in trials])),
        compile_time_s=float(np.median([trial.compile_time_s for trial in trials])),
        errors={n: float(np.mean([trial.errors[n] for trial in trials])) for n in NAMES},
        mean_error=float(np.mean([trial.mean_error for trial in trials])),
        cells=read.cells(run),
        particles=read.number(read.recorded(run, "counts.particles", "particles.count")),
        closure=str(read.recorded(run, "closure.file", "closure.file") or ""),
        drag=str(read.lookup(run.scene, "coupling.drag", "")),
    )  # fmt: skip


def _trial(run: Run, history: dict[str, Array], reference: dict[str, Array]) -> Trial:
    summary = run.summary or {}
    return Trial(metrics.run_time(summary), metrics.compile_time(summary), metrics.errors(history, reference))


def _state(run: Run, times: Array, reference_times: Array, until: float | None) -> tuple[bool, str]:
    """(complete, in words): whether the history reaches the planned end, to within half an output interval."""
    ends = [read.number(read.lookup(run.scene, "time.end")), *reference_times[-1:]]
    wanted = min(max(filter(math.isfinite, ends), default=NAN), math.inf if until is None else until)
    interval = float(np.median(np.diff(reference_times))) if len(reference_times) > 1 else 0.0
    complete = bool(len(times) and times[-1] >= wanted - 0.5 * interval - 1e-9)
    parts = []
    if read.lookup(run.summary, "valid") is not True:
        reason = read.lookup(run.summary, "reason") or ("no reason recorded" if run.summary else "no summary")
        parts.append(f"INVALID: {reason}")
    if not complete:
        ended = f"incomplete: ended at {times[-1]:.4g} s of {wanted:.4g} s" if len(times) else "no history"
        parts.append(ended)
    return complete, "; ".join(parts) or "valid"

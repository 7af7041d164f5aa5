"""A comparison in words: which run errs by how much, whether a closure helps, what limits the comparison.

Sentences are made from the figures alone and say a loss as plainly as a gain. Two runs are compared in one place,
`judge`, with the noise of the comparison, so that no two sentences contradict each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum

from jaxdem.metrics import METRICS
from jaxdem.report import runs as read
from jaxdem.report.comparison import Comparison, Row

LABEL = {metric.name: metric.label for metric in METRICS}
FRONT_MEANING = "no other run is both faster and more accurate"


def percent(value: float) -> str:
    """An error as a percentage with two digits, e.g. "12 %" or "5.5 %"."""
    if not math.isfinite(value):
        return "not defined"
    hundred = 100.0 * value
    if hundred == 0.0:
        return "0 %"
    return f"{hundred:.0f} %" if hundred >= 9.95 else f"{hundred:.1f} %" if hundred >= 0.1 else f"{hundred:.1g} %"


def duration(seconds: float) -> str:
    """Seconds as text, three digits."""
    return f"{seconds:.3g} s" if seconds < 1000 else f"{seconds:.0f} s"


def times(ratio: float) -> str:
    """A ratio with two digits at least, e.g. "2.4" or "18"."""
    return f"{ratio:.0f}" if ratio >= 9.95 else f"{ratio:.1f}" if ratio >= 0.95 else f"{ratio:.2g}"


class Verdict(Enum):
    """One run's mean error beside another's: what is said where the one has a closure that the other has not."""

    LOWER = "the closure lowers the mean error"
    HIGHER = "the closure raises the mean error"
    SAME = "the run with the learned closure is no better than the run without it; the difference is within the noise"
    MAYBE_LOWER = "the mean error is lower with the closure; because the noise is not known, this may be chance"
    MAYBE_HIGHER = "the mean error is higher with the closure; because the noise is not known, this may be chance"
    UNKNOWN = "it is not known whether the closure helps"


def judge(error: float, other: float, noise: float) -> Verdict:
    """How a mean error stands beside another one; all that is said about two runs follows from this.

    Args:
        error, other: mean errors [-].
        noise: `Comparison.error_noise` [-]; NaN where it is not known.
    """
    if not (math.isfinite(error) and math.isfinite(other)):
        return Verdict.UNKNOWN
    if error == other or abs(error - other) <= noise:
        return Verdict.SAME
    if math.isfinite(noise):
        return Verdict.LOWER if error < other else Verdict.HIGHER
    return Verdict.MAYBE_LOWER if error < other else Verdict.MAYBE_HIGHER


def time_ratio(row: Row, reference: Row, noise: float) -> float:
    """The reference's run time over a run's [-]; exactly 1 where they differ by no more than the noise.

    NaN where not recorded.

    Args:
        row, reference: the two.
        noise: `Comparison.time_noise`; where it is not known, two times that print the same are the same.
    """
    if not (row.run_time_s > 0.0 and reference.run_time_s > 0.0):
        return math.nan
    ratio = reference.run_time_s / row.run_time_s
    alike = max(ratio, 1.0 / ratio) <= 1.0 + noise or times(ratio) == times(1.0)
    return 1.0 if alike else ratio


def sentences(comparison: Comparison) -> list[str]:
    """The findings, one sentence or two each: reference, noise, every run, every closure with its cost, the front."""
    runs = sorted(comparison.runs, key=lambda row: (not row.ranked, _or_inf(row.mean_error)))
    result = [_reference_sentence(comparison.reference), *_noise_sentences(comparison)]
    result.extend(_run_sentence(row, comparison) for row in runs)
    for row in runs:
        if (row.closure or math.isfinite(row.training_cost_s)) and row.ranked:
            result.append(_closure_sentence(row, comparison))
    return result + _front_sentences(comparison, runs)


def _or_inf(value: float) -> float:
    return value if math.isfinite(value) else math.inf


def _reference_sentence(reference: Row) -> str:
    took = f", which took {duration(reference.run_time_s)}" if math.isfinite(reference.run_time_s) else ""
    mesh = f" on {reference.cells_text} cells" if reference.cells else " (no fluid)"
    return (
        f"The reference is {reference.name}{mesh}{took}. Run times do not include compilation. The error of a run in a "
        "metric is the time integral of the absolute difference from the reference, divided by the time integral of "
        "the reference's absolute value. The mean error is the mean over the metrics."
    )


def _noise_sentences(comparison: Comparison) -> list[str]:
    noise, floor = comparison.error_noise, comparison.noise_mean
    if not math.isfinite(noise):
        return [
            "The noise is not known, because no run was repeated with another pack. A small difference between two "
            "errors may be due to chance."
        ]
    result = []
    if math.isfinite(floor):
        used = sum(row.ranked for row in comparison.noise_rows)
        result.append(
            f"Reference runs that differ only in the random numbers of their packs differ by {percent(floor)} "
            f"({used} run(s)). This is the noise; no model can be expected to have a smaller error."
        )
    result.append(f"Two mean errors that differ by {percent(noise)} or less count as equal within the noise.")
    if math.isfinite(comparison.time_noise):
        result.append(
            f"Run times of the same work with other packs vary by {percent(comparison.time_noise)} about their median. "
            "A smaller difference between two run times is not significant."
        )
    return result


def _run_sentence(row: Row, comparison: Comparison) -> str:
    if not math.isfinite(row.mean_error):
        return f"{row.name}: the error is not known ({row.status})."
    known = {name: error for name, error in row.errors.items() if math.isfinite(error)}
    worst, best = max(known, key=known.__getitem__), min(known, key=known.__getitem__)
    text = f"{row.name} has a mean error of {percent(row.mean_error)}"
    if len(row.trials) > 1:
        text += f", {_range(row)}"
    if math.isfinite(over_noise := comparison.over_noise(row)):
        text += f" ({times(over_noise)} times the noise)"
    if known[worst] > known[best]:
        text += f", largest in {LABEL[worst]} ({percent(known[worst])})"
        text += f" and smallest in {LABEL[best]} ({percent(known[best])})"
    ratio = time_ratio(row, comparison.reference, comparison.time_noise)
    if math.isfinite(ratio) and row.ranked:
        faster = f"{times(ratio)} times faster than" if ratio > 1 else f"{times(1 / ratio)} times slower than"
        text += f"; it runs {'as fast as' if ratio == 1.0 else faster} the reference"
    return text + ("." if row.ranked else f". It is not ranked: {row.status}.")


def error_range(row: Row) -> str:
    """Smallest and largest mean error over the packs, e.g. "4.9-5.6 %"."""
    return f"{percent(min(row.pack_errors)).removesuffix(' %')}-{percent(max(row.pack_errors))}"


def _range(row: Row) -> str:
    return f"{error_range(row)} over {len(row.trials)} packs"


def twin_without_closure(row: Row, comparison: Comparison) -> Row | None:
    """The sound run that differs from this one in the closure alone, as far as rows tell: mesh, particles and, if there
    is one, drag law; the best of several."""
    plain = [other for other in comparison.runs if other.ranked and not other.closure and other is not row]
    twins = [other for other in plain if (other.cells, other.particles) == (row.cells, row.particles)]
    twins = [twin for twin in twins if twin.drag == row.drag] or twins
    return min(twins, key=lambda other: _or_inf(other.mean_error), default=None)


def _closure_sentence(row: Row, comparison: Comparison) -> str:
    """The learned run against the run on the same mesh with the drag law alone; what its training costs follows."""
    twin = twin_without_closure(row, comparison)
    if twin is None:
        return (
            f"It is not known whether the closure improves {row.name}: there is no valid run on the same mesh "
            f"({row.cells_text}) without a closure.{_cost(row, Verdict.UNKNOWN, comparison)}"
        )
    pairs = [(row.errors[name], twin.errors[name]) for name in LABEL]
    pairs = [pair for pair in pairs if all(map(math.isfinite, pair))]
    better = sum(mine < theirs for mine, theirs in pairs)
    verdict = judge(row.mean_error, twin.mean_error, comparison.error_noise)
    with_it, without = (f" ({one.name}{', ' + _range(one) if len(one.trials) > 1 else ''})" for one in (row, twin))
    noise = f"; the noise is {percent(comparison.error_noise)}" if verdict is Verdict.SAME else ""
    return (
        f"On {row.cells_text} cells {verdict.value}: {percent(row.mean_error)} with it{with_it} against "
        f"{percent(twin.mean_error)} without{without}, with a smaller error in {better} of {len(pairs)} metrics{noise}."
        f"{_cost(row, verdict, comparison)}"
    )


def _cost(row: Row, verdict: Verdict, comparison: Comparison) -> str:
    """What the training took, and when it pays: only where it made the run better. "" without a training."""
    if not math.isfinite(row.training_cost_s):
        return ""
    start = f" Its training took {duration(row.training_cost_s)}"
    if verdict is Verdict.UNKNOWN:
        return start + "; it is not known whether this time is regained."
    if verdict not in (Verdict.LOWER, Verdict.MAYBE_LOWER):
        return start + ", which is not regained, because the run without the closure needs no training."
    ratio = time_ratio(row, comparison.reference, comparison.time_noise)
    if not math.isfinite(ratio):
        return start + "; run times are not recorded, so it is not known when this time is regained."
    if ratio <= 1.0:
        return start + ". This time is never regained, because the run is no faster than the reference."
    runs = math.ceil(row.training_cost_s / (comparison.reference.run_time_s - row.run_time_s))
    sure = "" if verdict is Verdict.LOWER else ", if the gain is not due to chance"
    return start + f"; compared with the run time of the reference it is regained after {runs} run(s){sure}."


def _front_sentences(comparison: Comparison, runs: Sequence[Row]) -> list[str]:
    """Which runs are worth their time, where there is a choice."""
    front = comparison.front
    if not front or sum(row.ranked for row in runs) < 2:
        return []
    text = f"On the Pareto front ({FRONT_MEANING}): {', '.join(row.name for row in front)}"
    text += " (cheapest first)." if len(front) > 1 else "."
    if not math.isfinite(comparison.error_noise):
        return [text + " Every difference counts, because the noise is not known."]
    others = [row for row in runs if row.ranked and row not in front]
    alike = [row.name for row in others if any(_alike(row, other, comparison) for other in front)]
    text += " Its points differ by more than the noise."
    return [text + (f" Within the noise of a point on it: {', '.join(alike)}." if alike else "")]


def _alike(row: Row, other: Row, comparison: Comparison) -> bool:
    """Whether two runs differ by no more than the noise, in error and in run time."""
    same = judge(row.mean_error, other.mean_error, comparison.error_noise) is Verdict.SAME
    return same and time_ratio(row, other, comparison.time_noise) == 1.0


def warnings(comparison: Comparison) -> list[str]:
    """What limits the comparison: invalid or short runs, unlike scenes or machines, missing figures."""
    reference, runs = comparison.reference, comparison.runs
    result = []
    if not reference.ranked:
        result.append(
            f"The reference is not valid and complete ({reference.status}): do not trust any error on this page."
        )
    if bad := [f"{row.name}: {row.status}" for row in (*runs, *comparison.noise_rows) if not row.ranked]:
        result.append(f"Not ranked, and not on the Pareto front: {'; '.join(bad)}.")
    for row in comparison.rows:
        if (used := len(row.trials)) < row.trials_done:
            result.append(
                f"{row.name}: {used} of {row.trials_done} packs are counted; the others are invalid or incomplete."
            )
    if comparison.noise_rows and not math.isfinite(comparison.noise_mean):
        result.append("No noise run is valid and complete, so the noise is not known.")
    timed = [row for row in runs if math.isfinite(row.compared_until)]
    short = [row for row in timed if row.end_time != reference.end_time]
    if short or len({(row.compared_from, row.compared_until) for row in timed}) > 1:
        listed = ", ".join(f"{row.name} {row.compared_from:.4g} to {row.compared_until:.4g} s" for row in short)
        result.append(
            "The runs differ in length. Each is compared with the reference over the time that both cover"
            + (f": {listed}" if listed else "")
            + ". Final values are those at the last output of each run."
        )
    if comparison.until is not None:
        result.append(f"The comparison ends at {comparison.until:.4g} s.")
    return result + _unlike(comparison)


def _unlike(comparison: Comparison) -> list[str]:
    """Differences between the runs that make errors or run times incomparable."""
    rows, result = comparison.rows, []
    if len({read.domain_size(row.run) for row in comparison.every} - {None}) > 1:
        result.append("The runs have boxes of different size, so the errors compare different scenes.")
    counts = sorted({row.particles * read.grains_per_particle(row.run) for row in rows if math.isfinite(row.particles)})
    if len(counts) > 1:
        result.append(f"The runs have different numbers of grains ({', '.join(f'{n:.0f}' for n in counts)}).")
    devices = {read.text(read.lookup(row.run.summary, "device")) for row in comparison.every}
    if len(devices) > 1:
        result.append(f"Run times are from different machines ({'; '.join(sorted(devices))}) and cannot be compared.")
    if untimed := [row.name for row in rows if not math.isfinite(row.run_time_s)]:
        result.append(
            f"Not in the plot of error against run time, because no run time is recorded: {', '.join(untimed)}."
        )
    if len({row.metrics_counted for row in comparison.runs} - {0}) > 1:
        listed = ", ".join(f"{row.name} {row.metrics_counted}" for row in comparison.runs)
        result.append(f"The mean errors are over different numbers of metrics: {listed}.")
    if infinite := sorted({LABEL[name] for row in rows for name, error in row.errors.items() if math.isinf(error)}):
        result.append(
            f"The reference is zero in {', '.join(infinite)}. There is no relative error for it, and the mean error "
            "leaves it out."
        )
    return result

"""A comparison in words: which run errs by how much, whether a closure helps, what limits the comparison.

Sentences are made from the figures alone and say a loss as plainly as a gain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from jaxdem.metrics import METRICS
from jaxdem.report import runs as read
from jaxdem.report.comparison import Comparison, Entry, Row

LABEL = {metric.name: metric.label for metric in METRICS}


def percent(value: float) -> str:
    """An error as a percentage with two digits, e.g. "12 %" or "5.5 %"."""
    if not math.isfinite(value):
        return "not defined"
    hundred = 100.0 * value
    if hundred == 0.0:
        return "0 %"
    return (
        f"{hundred:.0f} %"
        if hundred >= 9.95
        else f"{hundred:.1f} %"
        if hundred >= 0.1
        else f"{hundred:.1g} %"
    )


def duration(seconds: float) -> str:
    """Seconds as text, three digits."""
    return f"{seconds:.3g} s" if seconds < 1000 else f"{seconds:.0f} s"


def times(ratio: float) -> str:
    """A ratio with two digits at least, e.g. "2.4" or "18"."""
    return f"{ratio:.0f}" if ratio >= 9.95 else f"{ratio:.1f}" if ratio >= 0.95 else f"{ratio:.2g}"


def sentences(comparison: Comparison) -> list[str]:
    """The findings, one sentence or two each: the reference, the noise floor, every run, every closure, the cost."""
    reference = comparison.reference
    result = [
        f"Reference is {reference.name}"
        + (f" on {reference.cells_text} cells" if reference.cells else " (no fluid)")
        + (f", which took {duration(reference.wall_time_s)}" if math.isfinite(reference.wall_time_s) else "")
        + ". Error means the time integral of the difference from it over the time integral of its own size,"
        " averaged over the metrics."
    ]
    if math.isfinite(comparison.noise_mean):
        result.append(
            f"Runs of the reference that differ only in a small jitter of the pack already differ by "
            f"{percent(comparison.noise_mean)} ({len(comparison.noise_rows)} run(s)): no model can be expected to do "
            "better than this noise floor."
        )
    runs = sorted(comparison.rows[1:], key=lambda row: (not row.ranked, _or_inf(row.mean_error)))
    result.extend(_run_sentence(row, comparison) for row in runs)
    result.extend(_closure_sentence(row, comparison) for row in runs if row.closure and row.ranked)
    result.extend(_cost_sentence(row, reference) for row in runs if math.isfinite(row.training_cost_s))
    front = [row.name for row in sorted(runs, key=lambda row: _or_inf(row.wall_time_s)) if row.pareto]
    if front:
        result.append(
            "No other run is both faster and more accurate than "
            + (f"{front[0]}." if len(front) == 1 else f"any of these (cheapest first): {', '.join(front)}.")
        )
    return result


def _or_inf(value: float) -> float:
    return value if math.isfinite(value) else math.inf


def _run_sentence(row: Row, comparison: Comparison) -> str:
    if not math.isfinite(row.mean_error):
        return f"{row.name}: no error can be given ({row.status})."
    known = {name: error for name, error in row.errors.items() if math.isfinite(error)}
    worst, best = max(known, key=known.__getitem__), min(known, key=known.__getitem__)
    parts = [f"{row.name} errs by {percent(row.mean_error)} on average"]
    if math.isfinite(row.error_over_noise):
        parts.append(f" ({times(row.error_over_noise)} times the noise floor)")
    if len(known) > 1:
        parts.append(
            f", most in {LABEL[worst]} ({percent(known[worst])}) and least in {LABEL[best]} ({percent(known[best])})"
        )
    ratio = comparison.reference.wall_time_s / row.wall_time_s if row.wall_time_s > 0 else math.nan
    if math.isfinite(ratio) and row.ranked:
        faster = f"{times(ratio)} times faster" if ratio >= 1 else f"{times(1 / ratio)} times slower"
        parts.append(f"; it runs {faster} than the reference")
    if not row.ranked:
        parts.append(f". It is not ranked: {row.status}")
    return "".join(parts) + "."


def _closure_sentence(row: Row, comparison: Comparison) -> str:
    """The learned run against the run on the same mesh with the drag law alone."""
    twins = [
        other
        for other in comparison.rows[1:]
        if not other.closure
        and other.ranked
        and other.cells == row.cells
        and other.particles == row.particles
    ]
    twins = [twin for twin in twins if twin.drag == row.drag] or twins
    if not twins:
        return (
            f"Whether the closure helps {row.name} cannot be said: there is no valid run on the same mesh "
            f"({row.cells_text}) without a closure."
        )
    twin = min(twins, key=lambda other: _or_inf(other.mean_error))
    pairs = [(row.errors[name], twin.errors[name]) for name in LABEL]
    pairs = [pair for pair in pairs if all(math.isfinite(error) for error in pair)]
    better = sum(mine < theirs for mine, theirs in pairs)
    gain = twin.mean_error - row.mean_error
    figures = (
        f"{percent(row.mean_error)} with it ({row.name}) against {percent(twin.mean_error)} without ({twin.name}), "
        f"better in {better} of {len(pairs)} metrics"
    )
    if not math.isfinite(gain):
        return f"On {row.cells_text} cells the closure cannot be judged: {figures}."
    if abs(gain) <= (comparison.noise_mean if math.isfinite(comparison.noise_mean) else 0.0):
        return f"On {row.cells_text} cells the closure makes no difference beyond the noise floor: {figures}."
    if gain > 0:
        return f"On {row.cells_text} cells the closure lowers the mean error: {figures}."
    return f"On {row.cells_text} cells the closure does not help, it raises the mean error: {figures}."


def _cost_sentence(row: Row, reference: Row) -> str:
    start = f"Training for {row.name} took {duration(row.training_cost_s)} besides"
    saved = reference.wall_time_s - row.wall_time_s
    if not math.isfinite(saved):
        return start + "; run times are not recorded, so when it pays cannot be said."
    if saved <= 0:
        return start + " and, as the run is no faster than the reference, is never earned back."
    runs = math.ceil(row.training_cost_s / saved)
    return start + f"; against the reference's run time it is earned back after {runs} run(s)."


def warnings(comparison: Comparison, entries: Sequence[Entry], until: float | None) -> list[str]:
    """What limits the comparison: invalid or short runs, unlike scenes or machines, missing figures."""
    reference, runs = comparison.reference, comparison.rows[1:]
    result = []
    if not reference.ranked:
        result.append(
            f"The reference itself is not sound ({reference.status}): no error below can be trusted."
        )
    bad = [row for row in (*runs, *comparison.noise_rows) if not row.ranked]
    if bad:
        listed = "; ".join(f"{row.name}: {row.status}" for row in bad)
        result.append(f"Not ranked, and not on the Pareto front: {listed}.")
    if comparison.noise_rows and not math.isfinite(comparison.noise_mean):
        result.append("No noise run is valid and complete: there is no noise floor.")
    spans = {(row.compared_from, row.compared_until) for row in runs if math.isfinite(row.compared_until)}
    short = [row for row in runs if math.isfinite(row.compared_until) and row.end_time != reference.end_time]
    if len(spans) > 1 or short:
        listed = ", ".join(
            f"{row.name} {row.compared_from:.4g} to {row.compared_until:.4g} s" for row in short
        )
        result.append(
            "The runs differ in length. Each is compared with the reference over the span the two share"
            + (f": {listed}" if listed else "")
            + ". Final values are those at each run's own last output."
        )
    if until is not None:
        result.append(f"Nothing after {until:.4g} s is compared.")
    return result + _unlike(comparison, entries)


def _unlike(comparison: Comparison, entries: Sequence[Entry]) -> list[str]:
    """Differences between the runs that make errors or run times incomparable."""
    rows = comparison.rows
    result = []
    sizes = {read.domain_size(entry.run) for entry in entries} - {None}
    if len(sizes) > 1:
        result.append("The runs are of boxes of different size: errors compare different scenes.")
    counts = {row.particles for row in rows if math.isfinite(row.particles)}
    if len(counts) > 1:
        result.append(
            f"The runs have different numbers of particles ({', '.join(f'{n:.0f}' for n in sorted(counts))})."
        )
    devices = {read.text(read.lookup(entry.run.summary, "device")) for entry in entries}
    if len(devices) > 1:
        result.append(
            f"Run times are from different machines ({'; '.join(sorted(devices))}) and not comparable."
        )
    untimed = [row.name for row in rows if not math.isfinite(row.wall_time_s)]
    if untimed:
        result.append(
            f"No run time recorded, so not in the plot of error against run time: {', '.join(untimed)}."
        )
    counted = {row.metrics_counted for row in rows[1:] if row.metrics_counted}
    if len(counted) > 1:
        listed = ", ".join(f"{row.name} {row.metrics_counted}" for row in rows[1:])
        result.append(f"The mean error is not over the same number of metrics in all runs: {listed}.")
    infinite = sorted(
        {LABEL[name] for row in rows for name, error in row.errors.items() if math.isinf(error)}
    )
    if infinite:
        result.append(
            f"The reference is zero in {', '.join(infinite)}: no relative error there, left out of the mean."
        )
    return result

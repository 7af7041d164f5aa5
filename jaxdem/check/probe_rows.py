"""What probes of a scene cost and write, and what they leave out."""

from __future__ import annotations

from jaxdem.particles.neighbors import Neighbors
from jaxdem.probes.base import Schedule
from jaxdem.setup.builder import Case
from jaxdem.state import State

NUMBER_BYTES = 20
"""Of a number in a file, about."""


def probe_rows(case: Case, state: State, neighbors: Neighbors | None) -> tuple[tuple[str, str], ...]:
    """Name of every probe, and how often it measures and writes.

    Args:
        case: of the scene.
        state: its first.
        neighbors: list of it, or its shapes.
    """
    steps, found = case.simulation.steps, []
    intervals = steps.outputs * steps.intervals_per_output
    for described, one in zip(case.scene.probes, case.probes, strict=True):
        lines = one.probe.rows(state, neighbors)
        outputs, measurements = _in_run(case, one.schedule)
        columns = 1 + len(one.probe.places) + len(one.probe.columns)
        size = outputs * lines * columns * NUMBER_BYTES / 1e6
        text = f"{described.kind}, {outputs} rows of {lines} lines and {columns} columns ({size:.2g} MB)"
        share = f"measured in {measurements} of {intervals} coupling intervals"
        found.append((described.name, f"{text}, {share}"))
    return tuple(found)


def _in_run(case: Case, plan: Schedule) -> tuple[int, int]:
    """Rows and measurements of a probe in the run, which begins after the intervals of those before it."""
    before, last = (_up_to(plan, step) for step in _span(case))
    return last[0] - before[0], last[1] - before[1]


def _span(case: Case) -> tuple[int, int]:
    """Coupling intervals that are done when the run begins and when it ends, from the very first run on."""
    steps, first = case.simulation.steps, 0 if case.start is None else case.start.step
    return first, first + steps.outputs * steps.intervals_per_output


def _up_to(plan: Schedule, step: int) -> tuple[int, int]:
    """Rows and measurements of a probe after `step` intervals."""
    rows, passed = divmod(max(step - plan.first, 0), plan.every)
    in_row, still_to_come = (
        (last - 1) // plan.sample + 1 for last in (plan.window, min(plan.window, plan.every - passed))
    )
    return rows, rows * in_row + in_row - still_to_come


def probe_cautions(case: Case) -> tuple[str, ...]:
    """A sentence on every probe whose last row is before the end of the run: what is after it is not written."""
    scene, interval, last = case.scene, case.simulation.steps.interval, _span(case)[1]
    found = []
    for k, (described, one) in enumerate(zip(scene.probes, case.probes, strict=True)):
        left = (last - one.schedule.first) % one.schedule.every
        if left:
            end = scene.time.end
            row = end - left * interval
            first = end - (last - one.schedule.first) * interval
            found.append(
                f"probes.{k}.interval = {described.interval:g}: the last row is at {row:.9g} s, and the run ends at "
                f"{end:.9g} s. What the probe {described.name!r} measures between them is written only by a run that "
                f"begins from this one with the same probe. Use an interval that divides the time from {first:.9g} s "
                "to the end."
            )
    return tuple(found)

"""What probes of a scene cost and write, and what they leave out."""

from __future__ import annotations

from jaxdem.particles.neighbors import Neighbors
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
        plan, lines = one.schedule, one.probe.rows(state, neighbors)
        outputs = (intervals - plan.first) // plan.every
        measurements = outputs * ((plan.window - 1) // plan.sample + 1)
        columns = 1 + len(one.probe.places) + len(one.probe.columns)
        size = outputs * lines * columns * NUMBER_BYTES / 1e6
        text = f"{described.kind}, {outputs} rows of {lines} lines and {columns} columns ({size:.2g} MB)"
        share = f"measured in {measurements} of {intervals} coupling intervals"
        found.append((described.name, f"{text}, {share}"))
    return tuple(found)


def probe_cautions(case: Case) -> tuple[str, ...]:
    """A sentence on every probe whose last row is before the end of the run: what is after it is not written."""
    scene, interval, clock = case.scene, case.simulation.steps.interval, case.simulation.clock
    found = []
    for k, (described, one) in enumerate(zip(scene.probes, case.probes, strict=True)):
        first = described.begin if clock is None else max(described.begin, clock.start)
        left = round((scene.time.end - first) / interval) % one.schedule.every
        if left:
            last, end = scene.time.end - left * interval, scene.time.end
            found.append(
                f"probes.{k}.interval = {described.interval:g}: the last row is at {last:.9g} s, and the run ends at "
                f"{end:.9g} s. What the probe {described.name!r} would measure between them is not written. Use an "
                f"interval that divides the time from {first:.9g} s to the end."
            )
    return tuple(found)

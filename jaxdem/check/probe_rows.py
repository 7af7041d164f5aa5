"""What probes of a scene cost and write."""

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

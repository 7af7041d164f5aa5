"""Forces in contacts as lines between the centres of grains, from the contacts that a probe has listed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from jaxdem.errors import InputError
from jaxdem.io import Run
from jaxdem.report.runs import Array

COLOR = "#00C2D1"
WIDEST, THINNEST = 4.0, 0.25
"""Widths of the line of the largest force, and the least [pt]."""
NEAR = 1e-6
"""Of the time of a frame, by which the time of a list may miss it; as written in both it is the same."""


class ForceLines(NamedTuple):
    """Contacts in the (x, vertical) plane.

    Attributes:
        ends: (C, 2, 2) centre of the first particle, and that of the second or the contact with a wall [m].
        force: (C,) along the normal [N].
    """

    ends: Array
    force: Array

    @property
    def largest(self) -> float:
        """Of the forces [N]."""
        return float(self.force.max(initial=0.0))


def force_lines(run: Run, index: int) -> ForceLines:
    """The contacts at a frame.

    Args:
        run: with a probe of kind "contacts".
        index: of the frame.

    Raises:
        InputError: the run has no such probe, or it has no list at the time of the frame.
    """
    name = next((one["name"] for one in run.scene.get("probes", []) if one.get("kind") == "contacts"), None)
    if name is None or name not in run.probes:
        remedy = 'Add [[probes]] with kind = "contacts" to the scene, and run it.'
        raise InputError("--forces", None, f"{run.path} has no probe that lists contacts", remedy)
    table, time = run.probes[name], float(run.times[index])
    there = np.abs(table["time"] - time) <= NEAR * max(abs(time), NEAR)
    if not there.any() and index == 0:
        limit = "the probe begins after the first frame"
        raise InputError("--forces", time, limit, "Draw a later frame with --time.")
    return _lines({column: values[there] for column, values in table.items()}, run, index)


def _lines(table: dict[str, Array], run: Run, index: int) -> ForceLines:
    """From the contact along the normal to both centres: over a periodic side a line ends outside of the box."""
    axes = ("x", "z")
    normal, place = (np.stack([table[f"{name}_{a}"] for a in axes], axis=1) for name in ("normal", "position"))
    particles = run.particles(index) or {}
    radius = np.asarray(particles["radius"], float)
    first, second = table["first"].astype(int), table["second"].astype(int)
    beyond = np.where(second >= 0, radius[np.maximum(second, 0)], 0.0)
    reach = 0.5 * table["overlap"]
    ends = [
        place + (radius[first] - reach)[:, None] * normal,
        place - np.maximum(beyond - reach, 0.0)[:, None] * normal,
    ]
    return ForceLines(np.stack(ends, axis=1).reshape(-1, 2, 2), np.maximum(table["normal_force"], 0.0))


def draw_force_lines(axis: Axes, lines: ForceLines) -> None:
    """Lines whose width goes with the force."""
    widths = np.maximum(WIDEST * lines.force / (lines.largest or 1.0), THINNEST)
    axis.add_collection(
        LineCollection(list(lines.ends), colors=COLOR, linewidths=list(widths), zorder=2.4), autolim=False
    )

"""What a run of a sweep has beside the nine metrics: further columns of its history, and numbers of its probes."""

from __future__ import annotations

import numpy as np

from jaxdem.io import Run
from jaxdem.io.part_columns import is_of_a_part

ONE_LINE = ("plane", "wall", "point")
"""Kinds of probes that may have one line a time; a profile and a list of contacts are no single numbers."""

PLACES = ("time", "x", "y", "z")


def figures(run: Run) -> dict[str, float]:
    """By the name of a column of sweep.csv, SI; {} without outputs.

    Of every column of `history.csv` that a part of the scene has put there, its value at the last output. Of every
    column of a probe with one line a time PROBE.COLUMN_last, and PROBE.COLUMN_mean over all lines; lines that are not
    finite, such as a mean over no grains, are left out of the mean.
    """
    if not run.number_of_frames:
        return {}
    found = {name: float(column[-1]) for name, column in run.history.items() if is_of_a_part(name)}
    kinds = {one.get("name"): one.get("kind") for one in run.scene.get("probes", [])}
    for probe, table in run.probes.items():
        times = table["time"]
        if kinds.get(probe) not in ONE_LINE or not len(times) or len(np.unique(times)) < len(times):
            continue
        for column, values in table.items():
            if column not in PLACES:
                finite = values[np.isfinite(values)]
                found[f"{probe}.{column}_last"] = float(values[-1])
                found[f"{probe}.{column}_mean"] = float(finite.mean()) if len(finite) else float("nan")
    return found

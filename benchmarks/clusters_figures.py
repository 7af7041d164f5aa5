"""The two figures of docs/results/clusters.md: grains and gas on two meshes, and error against processor time."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from benchmarks.clusters_runs import Case
from jaxdem.io import load_run
from jaxdem.report import style
from jaxdem.report.chart import log_limits, put_plain_numbers

NAMES = {
    "": "no model",
    "radl": "Radl & Sundaresan",
    "regression": "regression",
    "network": "network",
    "network2": "network, two runs",
    "fraction": "solid fraction alone",
    "tuned": "network, tuned",
}
"""Of the closures."""
COLOURS = ("#777777", *style.COLOURS)
"""Of the closures."""
MARKERS = {(12.0, 1): "s", (24.0, 1): "D", (12.0, 4): "o", (24.0, 4): "^"}
"""By the side of the cells in diameters, and by the parcels."""


def draw_pair(cases: Sequence[tuple[Case, str]], folder: Path, path: Path) -> None:
    """The last frame of runs of one box beside each other: speed of the gas along the vertical, and the grains.

    Args:
        cases: runs, each with its title.
        folder: of the runs.
        path: PNG.
    """
    with style.look():
        figure = style.new_figure(2.6 * len(cases) + 1.2, 6.3)
        panels = figure.subplots(1, len(cases), sharey=True, squeeze=False)[0]
        for axes, (case, title) in zip(panels, cases, strict=True):
            run = load_run(folder / case.folder)
            particles, fluid = run.particles(-1), run.fluid(-1)
            assert fluid is not None
            width, height = (1e3 * side * case.diameter for side in case.box)
            colours = axes.imshow(
                fluid["velocity"][..., 1].T, origin="lower", extent=(0.0, width, 0.0, height), cmap="viridis",
                vmin=-0.4, vmax=1.0, aspect="equal", interpolation="nearest",
            )  # fmt: skip
            place = np.mod(1e3 * particles["position"][:, :2], (width, height))
            size = 72.0 * 4.2 / height * 1e3 * case.diameter * case.parcel
            axes.scatter(*place.T, s=size**2, color="white", edgecolors="black", linewidths=0.25)
            axes.set(title=title, xlabel="x [mm]", xlim=(0.0, width), ylim=(0.0, height))
            axes.grid(visible=False)
        panels[0].set_ylabel("z [mm]")
        bar = figure.colorbar(colours, ax=list(panels), shrink=0.8, pad=0.02)
        bar.set_label("vertical velocity of the gas [m/s]")
        style.save(figure, path, dpi=100)


def draw_errors(rows: list[dict[str, Any]], path: Path) -> None:
    """Error of the slip against processor time, a panel a mean solid fraction; bars are two standard errors."""
    fractions = sorted({row["solid_fraction"] for row in rows if row["cell"] == 3.0})
    with style.look():
        figure = style.new_figure(2.3 * len(fractions) + 2.6, 3.8)
        panels = figure.subplots(1, len(fractions), sharey=True, squeeze=False)[0]
        for axes, fraction in zip(panels, fractions, strict=True):
            _errors(axes, [row for row in rows if row["solid_fraction"] == fraction])
            axes.set(title=f"solid fraction {fraction:g}", xscale="log")
            axes.set_xlim(log_limits(axes.get_xlim()))
            put_plain_numbers(axes.xaxis, axes.get_xlim())
            axes.set_xlabel("processor time [s]\nof a relaxation time")
        panels[0].set_ylabel("slip over that of the fine run - 1 [%]")
        entries = [Line2D([], [], color=style.REFERENCE, marker="*", linestyle="", label="fine run")]
        for name, colour in zip(NAMES.values(), COLOURS, strict=True):
            entries.append(Line2D([], [], color=colour, linewidth=3.0, label=name))
        for (cell, parcel), marker in MARKERS.items():
            grains = "grains" if parcel == 1 else f"parcels of {parcel}"
            label = f"{cell:g} d, {grains}"
            entries.append(Line2D([], [], color="#777777", marker=marker, linestyle="", label=label))
        figure.legend(handles=entries, loc="outside right center")
        style.save(figure, path, dpi=100)


def _errors(axes: Axes, rows: list[dict[str, Any]]) -> None:
    """The points of a panel, each with the noise of the fine run in its bar."""
    fine = next(row for row in rows if row["cell"] == 3.0 and row["parcel"] == 1 and row["seed"] == 0)
    reference, noise = fine["slip"]["mean"], fine["slip"]["error"] / fine["slip"]["mean"]
    axes.axhspan(-5.0, 5.0, color="#EEEEEE", zorder=0)
    axes.axhline(0.0, color=style.REFERENCE, linewidth=0.8)
    axes.errorbar(fine["cpu_s_per_relaxation_time"], 0.0, yerr=200.0 * noise, fmt="*", color=style.REFERENCE)
    for (closure, colour), ((cell, parcel), marker) in itertools.product(
        zip(NAMES, COLOURS, strict=True), MARKERS.items()
    ):
        for row in rows:
            if (row["cell"], row["parcel"], row["closure"].split("_")[0]) == (cell, parcel, closure):
                ratio = row["slip"]["mean"] / reference
                bar = 200.0 * ratio * np.hypot(noise, row["slip"]["error"] / row["slip"]["mean"])
                place = row["cpu_s_per_relaxation_time"], 100.0 * (ratio - 1.0)
                axes.errorbar(*place, yerr=bar, fmt=marker, color=colour, capsize=2)

"""The figures of docs/results/clusters.md and clusters_closures.md.

    python benchmarks/clusters_figures.py      # all but one, of the measures in benchmarks/results/clusters.json

That of grains and gas on three meshes needs the folders of runs:
`python benchmarks/clusters.py --runs DIR --figures docs/results`.
"""

from __future__ import annotations

import itertools
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from benchmarks import harness
from benchmarks.clusters_measures import pooled
from benchmarks.clusters_plan import UNSEEN
from benchmarks.clusters_runs import Case
from benchmarks.clusters_tables import EVERY, FRACTIONS, MAIN, RESULTS, chosen, fine_runs, over_fine, shown
from jaxdem.io import load_run
from jaxdem.report import style

KINDS: dict[str, tuple[str, str, float]] = {
    "12 d, grains": ("s", style.REFERENCE, -0.42),
    "24 d, grains": ("D", style.COLOURS[2], -0.28),
    "12 d, parcels of 4": ("o", style.COLOURS[4], -0.14),
    "24 d, parcels of 4": ("^", style.COLOURS[0], 0.0),
    "24 d, parcels of 4, volume of a grain": ("v", style.COLOURS[1], 0.14),
    "24 d, parcels of 4, rate of loss": ("X", style.COLOURS[3], 0.28),
    "24 d, parcels of 2": ("P", style.COLOURS[5 % len(style.COLOURS)], 0.42),
}
"""Marker, colour and place in the line of the kinds of runs, see `kind_of`."""
MEASURES = {"slip": "slip over fine - 1 [%]", "drag": "drag over fine - 1 [%]"}
MAIN_LOOK = {"": ("o", style.COLOURS[1]), "radl": ("s", style.COLOURS[5]), "mixed": ("D", style.COLOURS[0])}
"""Marker and colour of the closures of `MAIN`."""
TIMES = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""Ticks of the axis of processor times [s]."""
IN_FIGURES = {closure: words.replace("`", "") for closure, words in MAIN.items()}
"""Closures of `MAIN`, in words without Markdown."""
LIMITS = (-70.0, 110.0)
"""Of the axis; what lies beyond is written at its end [%]."""


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


def draw_slips(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Slip by solid fraction of fine runs and of parcels of 4 on cells of 24 diameters, and its quotient to the former.

    Bars and the band are two standard errors, of both runs together in the quotient.
    """
    with style.look():
        figure = style.new_figure(9.6, 4.2)
        left, right = figure.subplots(1, 2)
        fine = [pooled(fine_runs(rows, s), "slip") for s in EVERY]
        mean, error = (np.array([one[part] for one in fine]) for part in ("mean", "error"))
        left.errorbar(EVERY, mean, 2.0 * error, color=style.REFERENCE, marker="*", capsize=2, label="fine run")
        right.axhspan(-5.0, 5.0, color="#E8E8E8", zorder=0, label="5 %")
        right.axhline(0.0, color=style.REFERENCE, linewidth=0.8)
        for k, (closure, words) in enumerate(IN_FIGURES.items()):
            own = chosen(rows, cell=24.0, parcel=4, closure=closure, name="")
            there = [s for s in EVERY if any(row["solid_fraction"] == s for row in own)]
            runs = [[row for row in own if row["solid_fraction"] == s] for s in there]
            marker, colour = MAIN_LOOK[closure]
            found = [pooled(some, "slip") for some in runs]
            look: dict[str, Any] = {"color": colour, "marker": marker, "capsize": 2, "markersize": 5}
            left.errorbar(there, [f["mean"] for f in found], [2.0 * f["error"] for f in found], label=words, **look)
            over = np.array([over_fine(rows, some, "slip") for some in runs])
            shifted = np.array(there) * (1.0 + 0.02 * (k - 1))
            right.errorbar(shifted, 100.0 * (over[:, 0] - 1.0), 200.0 * over[:, 1], linestyle="", **look)
        for axes in (left, right):
            axes.set(xscale="log", xlabel="mean solid fraction")
            axes.set_xticks(EVERY, [f"{s:g}" if s != 0.12 else "" for s in EVERY])  # too near to 0.1
            axes.minorticks_off()
        left.set_ylabel("slip over terminal speed")
        right.set_ylabel("slip over that of the fine run - 1 [%]")
        entries = [*left.get_legend_handles_labels()[0], *right.get_legend_handles_labels()[0]]
        figure.legend(handles=entries, loc="outside lower center", ncols=5)
        style.save(figure, path, dpi=100)


def draw_times(rows: Sequence[dict[str, Any]], fractions: Sequence[float], path: Path) -> None:
    """Error of the slip against processor time, at solid fractions whose runs are of one machine.

    Bars are two standard errors of both runs together; a fine run stands at two standard errors of its own.
    """
    with style.look():
        figure = style.new_figure(6.4, 4.6)
        axes = figure.subplots()
        markers = dict(zip(fractions, ("o", "s", "D", "^"), strict=False))
        for fraction, marker in markers.items():
            reference = fine_runs(rows, fraction)
            noise = pooled(reference, "slip")
            look: dict[str, Any] = {"marker": marker, "linestyle": "", "capsize": 2, "markersize": 6}
            height = 200.0 * noise["error"] / noise["mean"]
            axes.errorbar(_seconds(reference), height, color=style.REFERENCE, **look)
            for closure in MAIN:
                own = chosen(rows, cell=24.0, parcel=4, closure=closure, name="", solid_fraction=fraction)
                if own:
                    ratio, error = over_fine(rows, own, "slip")
                    place = _seconds(own), 100.0 * abs(ratio - 1.0)
                    axes.errorbar(*place, yerr=200.0 * error, color=MAIN_LOOK[closure][1], **look)
        axes.axhspan(0.0, 5.0, color="#E8E8E8", zorder=0)
        axes.set(xscale="log", xlabel="processor time of a relaxation time, without compiling [s]")
        axes.set(ylabel="error of the slip [%]", ylim=(0.0, None))
        axes.set_xticks(TIMES, [f"{time:g}" for time in TIMES])
        axes.minorticks_off()
        colours = {"fine run: its noise": style.REFERENCE} | {IN_FIGURES[c]: MAIN_LOOK[c][1] for c in MAIN}
        entries = [Line2D([], [], color=c, marker="o", linestyle="", label=name) for name, c in colours.items()]
        entries += [
            Line2D([], [], color=style.NOISE, marker=m, linestyle="", label=f"solid fraction {s:g}")
            for s, m in markers.items()
        ]
        figure.legend(handles=entries, loc="outside lower center", ncols=2)
        style.save(figure, path, dpi=100)


def _seconds(own: Sequence[dict[str, Any]]) -> float:
    return float(np.mean([row["cpu_s_per_relaxation_time"] for row in own]))


def kind_of(row: dict[str, Any]) -> str:
    """The kind of a run, by its mesh, its parcels, and what they are told."""
    grains = "grains" if row["parcel"] == 1 else f"parcels of {row['parcel']}"
    told = {"own": ", volume of a grain", "loss": ", rate of loss", "restitution 0.487": ", rate of loss"}
    return f"{row['cell']:g} d, {grains}{told.get(row['name'], '')}"


def draw_errors(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Errors of slip and drag by closure, a column a mean solid fraction; bars are two standard errors of the run."""
    with style.look():
        figure = style.new_figure(2.9 * len(FRACTIONS) + 2.0, 13.0)
        panels = figure.subplots(len(MEASURES), len(FRACTIONS), sharex=True, sharey=True, squeeze=False)
        for (name, label), line in zip(MEASURES.items(), panels, strict=True):
            for axes, fraction in zip(line, FRACTIONS, strict=True):
                _errors(axes, rows, fraction, name)
                axes.set(title=f"solid fraction {fraction:g}", xlabel=label, xlim=LIMITS)
                axes.tick_params(labelbottom=True)
        names = shown(rows)
        panels[0, 0].set_yticks(range(len(names)), [closure or "no model" for closure in names])
        panels[0, 0].set_ylim(len(names) - 0.4, -0.7)
        entries = [
            Line2D([], [], color=colour, marker=marker, linestyle="", label=kind)
            for kind, (marker, colour, _) in KINDS.items()
        ]
        figure.legend(handles=entries, loc="outside lower center", ncols=3)
        style.save(figure, path, dpi=100)


def _errors(axes: Axes, rows: Sequence[dict[str, Any]], fraction: float, name: str) -> None:
    """The points of a panel, and two standard errors of the fine runs as lines."""
    reference, here = pooled(fine_runs(rows, fraction), name), chosen(rows, solid_fraction=fraction)
    noise = 200.0 * reference["error"] / reference["mean"]
    axes.axvspan(-5.0, 5.0, color="#E8E8E8", zorder=0)
    axes.axvline(0.0, color=style.REFERENCE, linewidth=0.8)
    for edge in (-noise, noise):
        axes.axvline(edge, color=style.NOISE, linewidth=0.9, linestyle="--")
    for (place, closure), (kind, (marker, colour, shift)) in itertools.product(enumerate(shown(rows)), KINDS.items()):
        runs = [row for row in here if row["closure"] == closure and kind_of(row) == kind]
        if runs:
            found = pooled(runs, name)
            ratio, bar = (100.0 * found[part] / reference["mean"] for part in ("mean", "error"))
            where = ratio - 100.0, place + shift
            axes.errorbar(*where, xerr=2.0 * bar, fmt=marker, color=colour, capsize=2, markersize=5)
            if ratio - 100.0 > LIMITS[1]:
                text = f"{ratio - 100.0:.0f} % \N{RIGHTWARDS ARROW}"
                axes.text(LIMITS[1], place, text, color=colour, ha="right", va="center")


if __name__ == "__main__":
    found = json.loads((harness.RESULTS / "clusters.json").read_text())["rows"]
    draw_slips(found, RESULTS / "clusters_slips.png")
    draw_times(found, UNSEEN, RESULTS / "clusters_times.png")
    draw_errors(found, RESULTS / "clusters_errors.png")

"""Draws docs/pictures/packs.png: the packs of scenes/packs.toml, and its grains by a sieve curve, settled.

python docs/tools/packs.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import EllipseCollection

import jaxdem
from jaxdem.setup.builder import build_case

ROOT = Path(__file__).parents[2]
MM = 1e3
COLORS = ("#4477aa", "#cc6677", "#ddaa33")


def drawn(axes, case, position, title):
    """The particles of every pack in a colour of its own, in mm."""
    counts = [pack.count for pack in case.particles.packs]
    radius = np.broadcast_to(case.particles.present.radius, sum(counts))
    owner = np.repeat(np.arange(len(counts)), counts)
    width, height = case.scene.domain.size
    if case.scene.periodic[0]:
        position = np.column_stack([np.mod(position[:, 0], width), position[:, 1]])
    for k in range(len(counts)):
        rows = owner == k
        shift = (-width, 0.0, width) if case.scene.periodic[0] else (0.0,)  # discs that cross a periodic side
        places = np.concatenate([position[rows] + (along, 0.0) for along in shift])
        size = np.tile(2.0 * MM * radius[rows], len(shift))
        discs = EllipseCollection(
            size, size, np.zeros(len(size)), units="xy", offsets=MM * places, transOffset=axes.transData,
            facecolors=COLORS[k], edgecolors="white", linewidths=0.2,
        )  # fmt: skip
        axes.add_collection(discs)
    axes.set(xlim=(0.0, MM * width), ylim=(0.0, MM * height), aspect="equal", xlabel="x (mm)", ylabel="z (mm)")
    axes.set_title(title, fontsize=9)
    handles = [plt.Line2D([], [], marker="o", linestyle="", color=COLORS[k]) for k in range(len(counts))]
    texts = [f"{pack.pack.kind}, {pack.count} discs" for pack in case.particles.packs]
    axes.legend(handles, texts, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=3, frameon=False, fontsize=8)


def main() -> None:
    """Both pictures, side by side."""
    scene = jaxdem.load_scene(ROOT / "scenes" / "packs.toml")
    case = build_case(scene)
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 3.6), width_ratios=(1.5, 1.0), layout="constrained")
    drawn(left, case, case.particles.position, "scenes/packs.toml at time 0; left and right are periodic")
    tables = scene.tables()
    rain = {"kind": "settled", "start": [0.0, 0.0], "stop": [0.06, 0.06], "solid_fraction": 0.4}
    rain["distribution"] = tables["particles"]["pack"][2]["distribution"]
    tables["particles"]["pack"] = rain
    tables["domain"]["size"] = [0.06, 0.06]
    tables["boundary"] = {}
    rested = build_case(jaxdem.load_scene(tables))
    state, _ = rested.initial_state()
    drawn(right, rested, np.asarray(state.particles.position), "a settled pack at time 0")
    figure.savefig(ROOT / "docs" / "pictures" / "packs.png", dpi=90)


if __name__ == "__main__":
    main()

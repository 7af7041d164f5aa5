"""The picture of the rooms, docs/pictures/house.png: `python docs/tools/house.py`. The floors are those of the import
test."""

from __future__ import annotations

import sys
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from tests.test_imports import FLOORS, PACKAGE  # noqa: E402

HOLDS = {
    "cli": "command line",
    "study": "demonstration study",
    "check": "jaxdem check",
    "train": "datasets, fits, finetune",
    "foreign": "scenes from decks of others",
    "report": "comparison, pictures, pages",
    "run": "time loop, run directory, rollout",
    "setup": "scene -> Simulation, Parameters, State",
    "scene": "what a user describes",
    "devices": "a box on many devices",
    "ensemble": "several runs at once",
    "external": "the fluid of others",
    "simulation": "Simulation",
    "probes": "what a run measures",
    "step": "the algorithm",
    "observables": "quantities of a state",
    "failures": "what can go wrong",
    "scalar_step": "scalars after an interval",
    "particle_step": "particles in an interval",
    "structure": "which parts there are",
    "state": "State, Parameters, Diagnostics",
    "scalars": "temperature and other scalars",
    "particle_files": "particles from files of others",
    "coupling": "weights, exchange of impulses, forces of the fluid",
    "solids": "bodies and their motion",
    "particles": "contacts, lists, motion",
    "fluid": "grid, projection solver",
    "closures": "drag laws, networks",
    "io": "files of a run",
    "files": "reading of any file",
    "metrics": "nine metrics",
    "mixing": "mixing index",
    "errors": "errors",
    "version": "version",
    "numerics": "vectors, pairs of floats",
}
GROUPS = (("use", 12, "#E8F0FA"), ("describe", 10, "#EAF6EC"), ("compute", 2, "#FDF1E4"), ("common", 0, "#F2F2F2"))
"""Name, first floor from 0, colour."""


def main() -> None:
    """Draws the picture."""
    floors = FLOORS[:-1]  # the package's own names are no room
    missing = {room for floor in floors for room in floor} ^ set(HOLDS)
    if missing:
        raise SystemExit(f"{', '.join(sorted(missing))}: in FLOORS or in HOLDS, not in both")
    figure = Figure(figsize=(9.0, 0.52 * len(floors) + 0.4), dpi=130)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, 9.0), ylim=(-0.2, len(floors) + 0.55))
    axes.axis("off")
    for number, floor in enumerate(floors):
        colour = next(colour for _, first, colour in GROUPS if number >= first)
        rooms = sorted(floor, key=lambda room: (not (PACKAGE / room).is_dir(), room))
        axes.text(0.32, number + 0.45, str(number + 1), ha="center", va="center", color="#777777", fontsize=9)
        width = 7.3 / len(rooms)
        for place, room in enumerate(rooms):
            x = 0.6 + place * width
            axes.add_patch(
                FancyBboxPatch(
                    (x + 0.04, number + 0.06), width - 0.08, 0.78, boxstyle="round,pad=0,rounding_size=0.08",
                    facecolor=colour, edgecolor="#888888", linewidth=0.8,
                )
            )  # fmt: skip
            name = room if (PACKAGE / room).is_dir() else f"{room}.py"
            axes.text(x + width / 2, number + 0.58, name, ha="center", va="center", fontsize=10, weight="bold")
            axes.text(x + width / 2, number + 0.26, HOLDS[room], ha="center", va="center", fontsize=8, color="#333333")
    for (name, first, _), last in zip(GROUPS, (len(floors), *(first for _, first, _ in GROUPS)), strict=False):
        axes.text(8.12, 0.5 * (first + last) - 0.05, name, va="center", fontsize=10, color="#555555", rotation=90)
    axes.annotate(
        "",
        xy=(8.6, 0.3),
        xytext=(8.6, len(floors) - 0.3),
        arrowprops={"arrowstyle": "-|>", "color": "#555555", "lw": 1.4},
    )
    axes.text(8.72, 0.5 * len(floors), "imports", rotation=270, va="center", fontsize=10, color="#555555")
    axes.text(0.6, len(floors) + 0.22, "Rooms of jaxdem: each imports only rooms below it", fontsize=11, va="center")
    figure.savefig(ROOT / "docs" / "pictures" / "house.png", metadata={"Software": None})


if __name__ == "__main__":
    main()

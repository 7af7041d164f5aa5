"""Draws docs/pictures/stages.png from the runs of scenes/fluidised_after_filling.toml.

jaxdem run scenes/fluidised_after_filling.toml --out runs/bed && python docs/tools/stages.py runs/bed
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt

import jaxdem
from jaxdem.report import drawing, pictures, style

ROOT = Path(__file__).parents[2]


def main() -> None:
    """Grains that begin to fall, at rest, and in the stream."""
    folder = Path(sys.argv[1])
    fill, fluidise = (jaxdem.load_run(folder / name) for name in ("fill", "fluidise"))
    shots = [pictures.take(fill, 0), pictures.take(fill, -1), pictures.take(fluidise, -1)]
    size = tuple(float(length) for length in fill.scene["domain"]["size"])
    tops = pictures.common_tops([shots[2:]])
    with style.look():
        figure, panels = plt.subplots(1, 3, figsize=(6.5, 6.8), layout="constrained", sharey=True)
        for axes, shot, name in zip(panels, shots, ("fill", "fill", "fluidise"), strict=True):
            drawing.draw(axes, shot, size, size, tops, "velocity")
            axes.set(title=f"{name}, t = {shot.time:.3g} s", xlabel="x [m]")
        panels[0].set_ylabel("z [m]")
        drawing.add_legends(figure, list(panels), shots, tops, "velocity", 5.5)
        figure.savefig(ROOT / "docs" / "pictures" / "stages.png", dpi=85)


if __name__ == "__main__":
    main()

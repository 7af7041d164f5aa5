"""Draws docs/pictures/hopper_opened.png: a run of scenes/hopper_opened.toml before and after its gate vanishes.

jaxdem run scenes/hopper_opened.toml --out runs/hopper_opened
python docs/tools/hopper_opened.py runs/hopper_opened
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
from PIL import Image

import jaxdem
from jaxdem.report import drawing, pictures

ROOT = Path(__file__).parents[2]
TIMES = (0.35, 0.45, 1.0)
"""Of the frames [s]; the gate vanishes at 0.4 s."""


def main(path: str) -> None:
    """Frames side by side."""
    run = jaxdem.load_run(path)
    box = tuple(run.scene["domain"]["size"])
    shown = [pictures.take_nearest(run, time, TIMES[-1]) for time in TIMES]
    tops = pictures.scale_tops([picture for picture in shown if picture])
    figure, panels = plt.subplots(1, len(TIMES), figsize=(9.0, 4.4), layout="constrained", sharey=True)
    for axes, picture in zip(panels, shown, strict=True):
        drawing.draw(axes, picture, box, box, tops, "velocity")
        axes.set(xlabel="x [m]", title=f"{picture.time:.2f} s, {len(picture.radius)} grains")
    panels[0].set_ylabel("z [m]")
    drawing.add_legends(figure, panels, shown, tops, "velocity", 9.0)
    target = ROOT / "docs" / "pictures" / "hopper_opened.png"
    figure.savefig(target, dpi=80)
    with Image.open(target) as drawn:
        drawn.convert("RGB").quantize(200).save(target, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1])

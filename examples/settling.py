"""Grains settle in a box of still water: `scenes/settling.toml`, for a longer time and with more grains.

Prints the residuals of the conservation laws (mass, momentum, volume), which should be small.

Run: python examples/settling.py [PICTURE]
"""

import matplotlib.pyplot as plt
from pictures import SCENES, draw, new_folder, save

import jaxdem

CHANGES = {
    "domain.size": [0.4, 0.6],
    "fluid.cells": [16, 24],
    "particles.count": 200,
    "particles.pack.vertices": [[0.03, 0.25], [0.37, 0.25], [0.37, 0.58], [0.03, 0.58]],
    "time.end": 1.5,
}


def picture(run, frames=(0, 6, 12, 30)):
    """Grains and water at four outputs."""
    figure, axes = plt.subplots(1, 4, figsize=(10.0, 4.2), layout="constrained")
    for axis, frame in zip(axes, frames, strict=True):
        grains, water = draw(axis, run, frame, fastest_grain=0.6, fastest_water=0.5)
    figure.colorbar(grains, ax=axes, label="grain speed [m/s]", shrink=0.8, extend="max")
    figure.colorbar(water, ax=axes, label="water speed [m/s]", shrink=0.8, extend="max")
    return figure


def main() -> None:
    """Run the scene and draw it."""
    scene = jaxdem.load_scene(SCENES / "settling.toml", CHANGES)
    run = jaxdem.simulate(scene, new_folder("settling"))
    save(picture(run), "settling")
    for name, value in run.summary["residuals"].items():
        print(f"residual of {name}: {value:.1e}")


if __name__ == "__main__":
    main()

"""Collapse of a column of grains in air: contact mechanics alone, no fluid.

300 discs of three sizes form a column beside the left wall, three times as high as wide. The column is released.
Prints the run-off relative to the width of the column at the start, and the front of the grains.

Run: python examples/column_collapse.py [PICTURE]
"""

import matplotlib.pyplot as plt
from pictures import draw, new_folder, save

import jaxdem

WIDTH, HEIGHT = 0.11, 0.335
SCENE = {
    "seed": 1,
    "domain": {"size": [0.9, 0.36]},
    "particles": {
        "count": 300,
        "density": 2500.0,
        "species": [
            {"share": 0.4, "radius": 0.0045},
            {"share": 0.3, "radius": 0.0050},
            {"share": 0.3, "radius": 0.0054},
        ],
        "pack": {"kind": "lattice", "start": [0.0, 0.0], "stop": [WIDTH, HEIGHT], "jitter": 0.01},
    },
    "contact": {"young_modulus": 1e7, "restitution": 0.5, "friction": 0.5, "rolling_friction": 0.1},
    "time": {"end": 1.0, "output_interval": 0.05},
}


def picture(run, frames=(4, 8, 20)):
    """The grains at three outputs."""
    figure, axes = plt.subplots(3, 1, figsize=(7.2, 8.4), layout="constrained")
    for axis, frame in zip(axes, frames, strict=True):
        grains, _ = draw(axis, run, frame, fastest_grain=1.2)
    figure.colorbar(grains, ax=axes, label="grain speed [m/s]", shrink=0.5, extend="max")
    return figure


def main() -> None:
    """Run the collapse and draw it."""
    run = jaxdem.simulate(jaxdem.load_scene(SCENE), new_folder("column_collapse"))
    save(picture(run), "column_collapse")
    runoff = run.history["runoff"][-1]
    print(
        f"run-off: {(runoff - WIDTH) / WIDTH:.2f} times the width at the start; front of the grains at {runoff:.3f} m"
    )


if __name__ == "__main__":
    main()

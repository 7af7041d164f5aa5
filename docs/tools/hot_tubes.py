"""Draws docs/pictures/hot_tubes.png from a run of scenes/hot_tubes.toml.

jaxdem run scenes/hot_tubes.toml --out runs/hot_tubes
python docs/tools/hot_tubes.py runs/hot_tubes
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.patches import Circle

import jaxdem

sys.path.insert(0, str(Path(__file__).parent))  # for the script beside this one

from moving_walls import save


def main() -> None:
    """The air at the end, with the tubes."""
    run = jaxdem.load_run(sys.argv[1])
    fluid, size = run.fluid(-1), run.scene["domain"]["size"]
    assert fluid is not None
    figure, axes = plt.subplots(figsize=(9.0, 3.2), layout="constrained")
    shown = axes.imshow(
        fluid["temperature"].T, origin="lower", extent=(0.0, size[0], 0.0, size[1]), cmap="inferno", vmin=300.0,
        vmax=350.0, interpolation="bilinear",
    )  # fmt: skip
    for wall in run.scene["walls"]:
        given = wall.get("temperature")
        text = f"{wall['heat_flux']:g}\nW/m²" if given is None else f"{given:g} K"
        axes.add_patch(Circle(wall["center"], wall["radius"], color="lightgrey"))
        axes.annotate(text, wall["center"], ha="center", va="center", fontsize=7)
    axes.set(title=f"air between tubes, {run.times[-1]:.1f} s", xlabel="x [m]", ylabel="z [m]")
    figure.colorbar(shown, ax=axes, label="temperature [K]", extend="max")
    save(figure, "hot_tubes")


if __name__ == "__main__":
    main()

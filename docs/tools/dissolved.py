"""Draws docs/pictures/dissolved.png from a run of scenes/dyed_jet.toml.

jaxdem run scenes/dyed_jet.toml --out runs/dyed_jet
python docs/tools/dissolved.py runs/dyed_jet
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import jaxdem
from jaxdem.io.load import Run

sys.path.insert(0, str(Path(__file__).parent))  # for the script beside this one

from moving_walls import save

SHOWN = (1.0, 3.0, 6.0)
"""Frames [s]."""


def main() -> None:
    """Dye in the water and smoke in the air, at three times."""
    run = jaxdem.load_run(sys.argv[1])
    figure, panels = plt.subplots(1, 3, figsize=(12.0, 3.0), layout="constrained", sharey=True)
    for axes, time in zip(panels, SHOWN, strict=True):
        dye, smoke = draw(axes, run, time)
    panels[0].set(ylabel="z [m]")
    figure.colorbar(smoke, ax=panels, label="smoke (air at the start = 1) [-]", shrink=0.9, pad=0.01)
    figure.colorbar(dye, ax=panels, label="dye (jet = 1) [-]", shrink=0.9, pad=0.01)
    save(figure, "dissolved")


def draw(axes: plt.Axes, run: Run, time: float) -> list[plt.cm.ScalarMappable]:
    """Each where its fluid has half of a cell; the surface as a line."""
    index = int(np.argmin(np.abs(np.asarray(run.times) - time)))
    fluid, size = run.fluid(index), run.scene["domain"]["size"]
    assert fluid is not None
    liquid, shown = fluid["liquid_fraction"], []
    for name, colours, most, there in (("dye", "Reds", 1.0, liquid >= 0.5), ("smoke", "Greys", 3.0, liquid < 0.5)):
        field, extent = np.where(there, fluid[name], np.nan), (0.0, size[0], 0.0, size[1])
        shown.append(axes.imshow(field.T, origin="lower", extent=extent, cmap=colours, vmin=0.0, vmax=most))
    x, z = ((np.arange(n) + 0.5) * side / n for n, side in zip(liquid.shape, size, strict=True))
    axes.contour(x, z, liquid.T, levels=[0.5], colors="black", linewidths=0.8)
    axes.set(title=f"{run.times[index]:.0f} s", xlabel="x [m]")
    return shown


if __name__ == "__main__":
    main()

"""Shared by the examples: where their output goes, and how grains and fluid speed are drawn with matplotlib."""

import io
import shutil
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import EllipseCollection
from PIL import Image

from jaxdem.report.pictures import GRAINS, WATER
from jaxdem.report.style import COLOURS

ROOT = Path(__file__).parent.parent
SCENES = ROOT / "scenes"
plt.rcParams.update(
    {
        "axes.prop_cycle": plt.cycler(color=COLOURS),
        "axes.spines.top": False,
        "axes.spines.right": False,
        "legend.frameon": False,
    }
)


def new_folder(name: str) -> Path:
    """An empty folder runs/examples/NAME for the runs of an example; what an earlier call left there is removed."""
    folder = ROOT / "runs" / "examples" / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


def picture_path(name: str) -> Path:
    """Where the picture goes: the first argument of the script, or runs/examples/NAME.png."""
    return Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "runs" / "examples" / f"{name}.png"


def draw(axes, run, frame: int, fastest_grain: float, fastest_water: float = 0.0):
    """One frame of a 2-D run: discs of their true size by their speed, over the fluid's speed.

    Args:
        axes: matplotlib's.
        run: from `jaxdem.load_run` or `jaxdem.simulate`.
        frame: number of the output.
        fastest_grain: upper end of the grains' colours [m/s].
        fastest_water: upper end of the fluid's colours [m/s].

    Returns:
        The grains and the fluid (or None) as matplotlib's mappables, for colour bars.
    """
    size = run.scene["domain"]["size"]
    axes.set(xlim=(0, size[0]), ylim=(0, size[1]), aspect="equal", xlabel="x [m]", ylabel="height [m]")
    axes.spines[:].set_visible(True)
    axes.locator_params(nbins=4)
    axes.label_outer()
    axes.set_title(f"t = {run.times[frame]:.2f} s", fontsize=9, loc="left")
    water, fluid = None, run.fluid(frame)
    if fluid is not None:
        speed = np.linalg.norm(fluid["velocity"], axis=-1)
        water = axes.imshow(
            speed.T,
            origin="lower",
            extent=(0, size[0], 0, size[1]),
            cmap=WATER,
            vmin=0,
            vmax=fastest_water,
            interpolation="bilinear",
        )
    particles = run.particles(frame)
    diameter = 2.0 * particles["radius"]
    grains = EllipseCollection(
        diameter,
        diameter,
        np.zeros_like(diameter),
        units="xy",
        offsets=particles["position"][:, :2],
        transOffset=axes.transData,
        array=np.linalg.norm(particles["velocity"], axis=1),
        cmap=GRAINS,
        clim=(0, fastest_grain),
        linewidths=0,
    )
    axes.add_collection(grains)
    return grains, water


def save(figure, name: str) -> None:
    """Write the picture and print its path."""
    path = picture_path(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=100)
    plt.close(figure)
    # 256 colours are enough for these pictures and make them half the size.
    Image.open(buffer).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"Wrote {path}")

"""Draws docs/pictures/silo.png from a run of the scene of this name.

jaxdem run scenes/silo.toml --out runs/silo
python docs/tools/meshes.py runs/silo
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import jaxdem

sys.path.insert(0, str(Path(__file__).parent))  # for the script beside this one

from moving_walls import frames, save

TIMES = (0.0, 0.16, 0.26)
"""Of the frames [s]."""


def main() -> None:
    """Frames of the silo, and the mass that has run out."""
    run = jaxdem.load_run(sys.argv[1])
    figure, panels = plt.subplots(1, len(TIMES) + 1, figsize=(11.0, 4.2), layout="constrained")
    frames(figure, panels[:-1], run, TIMES)
    measured = np.genfromtxt(run.path / "probes" / "outflow.csv", delimiter=",", names=True)
    panels[-1].plot(measured["time"], -measured["mass_flow"], label="run")
    orifice, diameter, bulk = 0.032, 0.004, 1500.0
    law = 0.58 * bulk * 9.81**0.5 * (orifice - 1.4 * diameter) ** 2.5
    panels[-1].axhline(law, color="gray", linestyle="--", label="Beverloo")
    panels[-1].set_ylim(0.0, 0.42)
    panels[-1].legend(loc="upper right")
    panels[-1].set(xlabel="time [s]", ylabel="flow of mass out of the silo [kg/s]")
    save(figure, "silo")


if __name__ == "__main__":
    main()

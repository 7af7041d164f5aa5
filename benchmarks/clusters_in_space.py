"""The study of `benchmarks/clusters.py` in three dimensions, at a size that a processor can do: does the path work?

    python benchmarks/clusters_in_space.py --runs DIR

A box of 24 x 24 x 48 diameters, periodic on all sides, with the grains and the gas of `scenes/clusters.toml`: a fine
run on cells of 3 diameters, a closure that is trained on what cells of 6 diameters see of it, and runs with parcels of
2 (8 grains) on these cells without and with it. The box is too small for clusters, and the time too short for means:
this shows that nothing of the path is of two dimensions. docs/results/clusters.md tells what was found.
"""

from __future__ import annotations

import argparse
import math
import sys
import tomllib
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks.clusters_measures import with_error
from benchmarks.clusters_runs import DENSITY, GRAIN_DENSITY, GRAVITY, MODULUS, RELAXATION, SCENE, Case, terminal_speed
from jaxdem.io import Run
from jaxdem.train.dataset import make_dataset
from jaxdem.train.dataset_file import read_dataset
from jaxdem.train.fit import FitSettings, fit_filtered

BOX, DIAMETER, SOLID_FRACTION = (24, 24, 48), 75e-6, 0.05
CELL, COARSENED, PARCEL = 3, 2, 2
"""Side of a fine cell in diameters, fine cells along a coarse one, l of the parcels."""
TIMES, DROPPED = 4, 2
"""Relaxation times of a run, and those at its start that are not measured."""
FEATURES = ("solid_fraction", "log_solid_fraction", "log_wide_solid_fraction")


def scene(coarsened: int, parcel: int) -> jaxdem.Scene:
    """The scene on cells of so many fine ones along a side, with parcels."""
    tables: dict[str, Any] = tomllib.loads(SCENE.read_text())
    size, cell = [n * DIAMETER for n in BOX], CELL * coarsened
    count = round(SOLID_FRACTION * math.prod(BOX) * 6.0 / math.pi / parcel**3)
    solids = count * parcel**3 * math.pi / 6.0 / math.prod(BOX)
    tables["domain"] = {"size": size, "gravity": [0.0, 0.0, -GRAVITY]}
    tables["particles"] |= {"count": count, "coarse_grain": float(parcel)}
    tables["particles"]["pack"] |= {"start": [0.0] * 3, "stop": size}
    tables["contact"] |= {"young_modulus": MODULUS, "time_step": 1e-5}
    weight = GRAVITY * (solids * GRAIN_DENSITY + (1.0 - solids) * DENSITY)
    tables["fluid"] |= {"cells": [n // cell for n in BOX], "pressure_gradient": [0.0, 0.0, -weight]}
    tables["fluid"]["velocity"] = [0.0, 0.0, 0.2]
    tables["boundary"]["front"] = {"kind": "periodic"}
    tables["coupling"]["kernel_width"] = {"diameters": 3.0 / parcel, "cells": 0.5}
    tables["time"] = {"end": TIMES * RELAXATION, "output_interval": RELAXATION}
    tables["output"] = {"samples": RELAXATION / 2.0 if coarsened == 1 else 0.0}
    return jaxdem.load_scene(tables)


def slip(run: Run) -> dict[str, float]:
    """Mean slip in terminal speeds, with the error of the mean by six blocks."""
    lines = run.probes["box"]
    late = lines["time"] > (DROPPED + 0.25) * RELAXATION
    return with_error((lines["fluid_velocity_z"] - lines["velocity_z"])[late] / terminal_speed(Case()))


def made(folder: Path, name: str, one: jaxdem.Scene, closure: Any = None) -> Run:
    """The run, made or gone on with."""
    path = folder / name
    return jaxdem.simulate(one, path, closure=closure, resume=path.exists())


def main() -> None:
    """The runs and the closure; prints the slip of each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=Path, required=True, help="folder in which the runs are kept")
    folder = parser.parse_args().runs
    folder.mkdir(parents=True, exist_ok=True)
    fine = made(folder, "fine", scene(1, 1))
    print("fine", slip(fine), flush=True)
    coarse, file = scene(COARSENED, PARCEL), folder / "fine.dataset.h5"
    if not file.exists():
        make_dataset(fine.path, file, (COARSENED,))
    settings = FitSettings.filtered(features=FEATURES, loss="balance", bounded=True, epochs=100)
    found = fit_filtered([read_dataset(file)], settings)
    print(
        "closure", {name: round(score, 3) for name, score in found.metadata["r2"][str(COARSENED)].items()}, flush=True
    )
    print("parcels", slip(made(folder, "parcels", coarse)), flush=True)
    print("parcels, closure", slip(made(folder, "parcels_closure", coarse, found.closure)), flush=True)


if __name__ == "__main__":
    main()

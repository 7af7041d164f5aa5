"""Can another program read the files of a run? Four runs are read with the `vtk` package: 2-D, 3-D, without fluid,
fluid alone.

Checked are the names of all arrays, their components and units, the times against the history, that positions lie in
the box, radii are the scene's, the void fraction is in (0, 1], speeds are not above the fastest of the run, and that
means taken from the files are those of history.csv.

Run: python -m benchmarks.read_back
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import vtk
from vtk.util.numpy_support import vtk_to_numpy

import jaxdem
from benchmarks.harness import write
from jaxdem.io.vtkhdf import UNITS

FLUID = {"cells": [8, 6], "viscosity": 1e-6, "time_step": 0.005}
JET = {"left": {"kind": "inlet", "velocity": 0.3}, "right": {"kind": "outlet"}}
GRAINS = {"radius": 0.008, "density": 2650.0, "position": [[0.06, 0.05], [0.1, 0.05], [0.14, 0.08]]}
COMMON = {"contact": {"young_modulus": 1e6}, "time": {"end": 0.05, "output_interval": 0.01}}
FLAT, DEEP = {"size": [0.2, 0.15], "depth": 0.03}, {"size": [0.2, 0.1, 0.15]}
SCENES: dict[str, dict[str, Any]] = {
    "2-D": {"domain": FLAT, "particles": GRAINS, "fluid": FLUID, "boundary": JET, **COMMON},
    "3-D": {
        "domain": DEEP,
        "particles": GRAINS | {"position": [[x, 0.05, z] for x, z in GRAINS["position"]]},
        "fluid": FLUID | {"cells": [8, 4, 6]},
        "boundary": JET,
        **COMMON,
    },
    "no fluid": {"domain": FLAT, "particles": GRAINS, **COMMON},
    "fluid alone": {"domain": FLAT, "fluid": FLUID, "boundary": JET, "time": COMMON["time"]},
}
VECTORS = {"velocity", "angular_velocity", "drag_force", "contact_force"}
NAMES = {"particles": VECTORS | {"radius", "id"}, "fluid": {"velocity", "pressure", "void_fraction"}}


class Count:
    """Checks made so far; the first that fails ends the program."""

    def __init__(self) -> None:
        self.number = 0

    def __call__(self, condition: Any, what: str) -> None:
        """One check."""
        self.number += 1
        if not condition:
            raise SystemExit(f"does not hold: {what}")


def frames(path: Path) -> tuple[list[float], list[Any]]:
    """Times [s] and data of all frames of a file, as vtk gives them."""
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    times = list(reader.GetOutputInformation(0).Get(vtk.vtkStreamingDemandDrivenPipeline.TIME_STEPS()))
    data = []
    for time in times:
        reader.UpdateTimeStep(time)
        copy = reader.GetOutputDataObject(0).NewInstance()
        copy.DeepCopy(reader.GetOutputDataObject(0))
        data.append(copy)
    return times, data


def arrays_of(data: Any, part: str) -> dict[str, np.ndarray]:
    """Arrays by name."""
    held = data.GetPointData() if part == "particles" else data.GetCellData()
    names = [held.GetArrayName(number) for number in range(held.GetNumberOfArrays())]
    return {name: vtk_to_numpy(held.GetArray(name)) for name in names}


def read_back(scene: dict[str, Any], folder: Path, holds: Count) -> None:
    """Run a scene and check its files."""
    run = jaxdem.simulate(jaxdem.load_scene(scene), folder)
    size = scene["domain"]["size"]
    for part in ("particles", "fluid"):
        path = folder / f"{part}.vtkhdf"
        holds(path.exists() == (part in scene), f"{path.name} is there where the scene has {part}")
        if not path.exists():
            continue
        times, data = frames(path)
        holds(times == list(run.times), "times are those of the history")
        with h5py.File(path) as file:
            stored = file["VTKHDF/PointData" if part == "particles" else "VTKHDF/CellData"]
            holds(all(stored[n].attrs["units"] == UNITS[n] for n in stored), "every array names its unit")
        for number, frame in enumerate(data):
            arrays = arrays_of(frame, part)
            holds(set(arrays) == NAMES[part], f"names in {path.name}")
            holds(all(np.isfinite(array).all() for array in arrays.values()), "all finite")
            holds(all(arrays[n].shape[1:] == (3,) for n in VECTORS & set(arrays)), "three components")
            check = check_particles if part == "particles" else check_fluid
            check(run, frame, arrays, number, size, holds)


def check_particles(
    run: Any, frame: Any, arrays: dict[str, np.ndarray], number: int, size: list[float], holds: Count
) -> None:
    """Ranges of one frame of particles."""
    position = vtk_to_numpy(frame.GetPoints().GetData())
    box = np.array([*size, 0.0][:3] if len(size) == 2 else size)
    holds(((position >= 0) & (position <= box)).all(), "positions in the box, the third zero in 2-D")
    holds(np.allclose(arrays["radius"], GRAINS["radius"]), "radii of the scene")
    holds(arrays["id"].tolist() == [0, 1, 2], "row i is particle i")
    if "fluid" not in run.scene:
        holds(not arrays["drag_force"].any(), "no drag without a fluid")
    for name, column in (("velocity", "particle_velocity_mean"), ("drag_force", "drag_force_mean")):
        if np.isfinite(run.history[column][number]):
            mean = np.linalg.norm(arrays[name].astype(float), axis=1).mean()
            holds(
                np.isclose(mean, run.history[column][number], rtol=1e-5, atol=1e-12),
                f"{column} of history.csv",
            )


def check_fluid(
    run: Any, frame: Any, arrays: dict[str, np.ndarray], number: int, size: list[float], holds: Count
) -> None:
    """Ranges of one frame of the fluid."""
    bounds = np.reshape(frame.GetBounds(), (3, 2))
    sides = np.ptp(bounds, axis=1)
    holds(
        np.allclose(sides, size if len(size) == 3 else [*size, 0.03]),
        "the box, in 2-D one layer of its depth",
    )
    least, most = arrays["void_fraction"].min(), arrays["void_fraction"].max()
    holds(0.0 < least <= most <= 1.0 + 1e-6, "void fraction in (0, 1]")
    holds(("particles" in run.scene) == (least < 1.0 - 1e-6), "less than one where there are particles")
    speed = np.linalg.norm(arrays["velocity"].astype(float), axis=1)
    holds(speed.max() < 2.0, "fluid speed of the order of the jet's")
    holds(
        np.isclose(speed.mean(), run.history["fluid_velocity_mean"][number], rtol=1e-5),
        "mean speed of history.csv",
    )


def main() -> None:
    """All scenes, and the count of checks into benchmarks/results."""
    counts: dict[str, int] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, scene in SCENES.items():
            holds = Count()
            read_back(scene, Path(folder) / name, holds)
            counts[name] = holds.number
    lines = [f"| {name} | {number} |" for name, number in counts.items()]
    table = "\n".join(["| run | checks that hold |", "| --- | ---: |", *lines])
    write("read_back", {"vtk": vtk.VTK_VERSION, "checks": counts}, table)


if __name__ == "__main__":
    main()

"""Flow out of a round orifice in a flat bottom that is a mesh, against the law of Beverloo.

A cylinder is filled and comes to rest on a plane. Then the plane is a plate with an orifice, for each diameter.
The flow is the slope of the mass that has left between two times, grains lying over the orifice all the time.

    python benchmarks/orifices.py [--grains 4000] [--radius 9.5] [--diameter 0.004] [--folder runs]
    python benchmarks/orifices.py --fit      the fits alone, to the flows of the results
    python benchmarks/orifices.py --radius 15 --grains 12000 --orifices 5 8 12 --end 0.8 0.8 0.4 --name orifices_wide

With --folder what is there is used again, and a run that was stopped goes on.

The spheres of 4 mm are for a few minutes on one core: orifices of 5 to 8 diameters. All lengths are in diameters, so
--diameter changes the scale alone.

Law: Beverloo, Leniger, van de Velde, Chem. Eng. Sci. 15 (1961) 260: W = C rho_b sqrt(g) (D - k d)^2.5, with C = 0.58,
k = 1.4 (Nedderman 1992) and a bulk density rho_b of 1500 kg/m3.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # run as a script from anywhere

import jaxdem  # noqa: E402
from benchmarks import harness  # noqa: E402
from tests.cases.surfaces import orifice_plate, saved  # noqa: E402

DENSITY, BULK = 2500.0, 1500.0
ORIFICES = (5.0, 6.5, 8.0)
FLOOR, FILLED, HEIGHT = 4.0, 26.0, 32.0
"""Of the bottom, of the region of the grains, and of the box, over the diameter of a grain [-]."""

PARTS = 6
"""Parts of the measured time; from the scatter of their flows is the error of the mean."""

BEGIN = 0.1
"""Time after the opening from which the flow is steady [s]."""


def tables(given: argparse.Namespace) -> dict[str, Any]:
    """The silo, filled above a plane."""
    diameter, grains = given.diameter, given.grains
    middle, floor, radius = [(given.radius + 0.5) * diameter] * 2, FLOOR * diameter, given.radius * diameter
    axis = {"axis": [0, 0, 1], "radius": radius}
    region = {"shape": "cylinder", "base": [*middle, floor], "length": FILLED * diameter, **axis}
    return {
        "seed": 1,
        "domain": {"size": [2.0 * middle[0], 2.0 * middle[1], HEIGHT * diameter]},
        "particles": {
            "radius": 0.5 * diameter,
            "density": DENSITY,
            "pack": {"kind": "settled", "count": grains, "region": region},
        },
        "contact": {
            "young_modulus": 2.5e8 * diameter,
            "poisson_ratio": 0.25,
            "restitution": 0.5,
            "friction": 0.5,
            "speed": 1.0,
        },
        "walls": [
            {"kind": "cylinder", "center": [*middle, 0.0], **axis},
            {"kind": "plane", "point": [*middle, floor], "normal": [0, 0, 1]},
        ],
        "boundary": {"bottom": {"particles": "remove"}},
        "time": {"end": 0.01, "output_interval": 0.01},
    }


def law(orifice: float, diameter: float) -> float:
    """Beverloo's flow [kg/s]."""
    return 0.58 * BULK * math.sqrt(9.81) * (orifice - 1.4 * diameter) ** 2.5


def flow(width: float, end: float, filled: Path, given: argparse.Namespace, folder: Path) -> dict[str, float]:
    """Flow through an orifice of so many diameters, from `BEGIN` until a third of the grains has left or the end."""
    diameter, name = given.diameter, f"{width:g}d"
    orifice, scene = width * diameter, tables(given)
    file = saved(orifice_plate(0.5 * orifice, 1.1 * given.radius * diameter), folder / f"{name}.ply")
    plane = scene["walls"].pop()
    scene["walls"].append({"kind": "mesh", "file": file, "translate": plane["point"]})
    begin = scene["time"]["end"]
    scene |= {"start": {"from": str(filled)}, "time": {"end": begin + end, "output_interval": 0.01}}
    del scene["particles"]["pack"]
    before = time.process_time()
    run = jaxdem.simulate(jaxdem.load_scene(scene), folder / name, resume=(folder / name).exists())
    seconds = time.process_time() - before
    passed, removed = np.asarray(run.history["time"]) - begin, np.asarray(run.history["removed"])
    steady = (passed >= BEGIN) & (removed <= given.grains / 3)
    slope = np.polyfit(passed[steady], removed[steady], 1)[0]
    edges = np.linspace(passed[steady][0], passed[steady][-1], PARTS + 1)
    scatter = np.std(np.diff(np.interp(edges, passed, removed)) / np.diff(edges), ddof=1)
    mass = DENSITY * math.pi / 6.0 * diameter**3
    return {
        "orifice_m": orifice,
        "flow_kg_s": mass * slope,
        "error_kg_s": mass * scatter / math.sqrt(PARTS),
        "law_kg_s": law(orifice, diameter),
        "ratio": mass * slope / law(orifice, diameter),
        "measured_s": float(np.ptp(passed[steady])),
        "grains": float(np.ptp(removed[steady])),
        "processor_s": seconds,
    }


def fitted(rows: list[dict[str, float]], diameter: float) -> str:
    """What the flows W say about the law: its exponent with k given, and k with its exponent given.

    With an exponent of 2.5 W^(2/5) is a line in D, which is zero at k d. Its errors are those of the flows.
    """
    orifice, flow, error = (np.array([row[name] for row in rows]) for name in ("orifice_m", "flow_kg_s", "error_kg_s"))

    def exponent(k: float, flow: np.ndarray = flow) -> float:
        return float(np.polyfit(np.log(orifice - k * diameter), np.log(flow), 1)[0])

    def line(flow: np.ndarray) -> np.ndarray:
        return np.polyfit(orifice, flow**0.4, 1, w=1.0 / deviation)

    deviation = 0.4 * error / flow * flow**0.4
    slope, start = line(flow)
    drawn = flow + error * np.random.default_rng(0).standard_normal((2000, len(flow)))
    lines = np.array([line(one) for one in drawn])
    spread = np.std(-lines[:, 1] / lines[:, 0] / diameter)
    off = float(np.sum(((flow**0.4 - slope * orifice - start) / deviation) ** 2))
    scatter = np.std([exponent(1.4, one) for one in drawn])
    return (
        f"Exponent of D - k d: {exponent(1.4):.3f} +- {scatter:.3f} with k = 1.4, {exponent(1.15):.3f} with 1.15, "
        f"{exponent(1.0):.3f} with 1. With the exponent 2.5: k = {-start / slope / diameter:.3f} +- {spread:.3f}, "
        f"C = {slope**2.5 / (BULK * math.sqrt(9.81)):.3f} at a bulk density of {BULK:g} kg/m3, chi^2 {off:.2f} for "
        f"{len(rows) - 2} degree of freedom."
    )


def main() -> None:
    """Fills the silo, opens it three times, and fits the exponent."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--grains", type=int, default=4000)
    parser.add_argument("--radius", type=float, default=9.5, help="of the silo, in diameters of a grain")
    parser.add_argument("--diameter", type=float, default=0.004, help="of a grain [m]")
    parser.add_argument("--end", type=float, nargs="+", default=[0.4], help="time of each orifice, or of all [s]")
    parser.add_argument("--orifices", type=float, nargs="+", default=ORIFICES, help="in diameters of a grain")
    parser.add_argument("--name", default="orifices", help="of the files of the results")
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--fit", action="store_true")
    given = parser.parse_args()
    if given.fit:
        print(fitted(json.loads((harness.RESULTS / f"{given.name}.json").read_text())["rows"], given.diameter))
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        filled = folder / "filled"
        before = time.process_time()
        jaxdem.simulate(jaxdem.load_scene(tables(given)), filled, resume=filled.exists())
        print(f"filled: {time.process_time() - before:.0f} s", flush=True)
        rows = []
        for orifice, end in zip(given.orifices, given.end * (len(given.orifices) // len(given.end)), strict=True):
            rows.append(flow(orifice, end, filled, given, folder))
            print(rows[-1], flush=True)
        top = float(np.quantile(jaxdem.load_run(filled).particles(0)["position"][:, 2], 0.99))
    free = np.log([row["orifice_m"] - 1.4 * given.diameter for row in rows])
    exponent = float(np.polyfit(free, np.log([row["flow_kg_s"] for row in rows]), 1)[0])
    names = ("orifice_m", "flow_kg_s", "error_kg_s", "law_kg_s", "ratio", "measured_s", "grains", "processor_s")
    lines = [f"| {' | '.join(names)} |", f"|{' --- |' * len(names)}"]
    lines += [f"| {' | '.join(f'{row[name]:.3g}' for name in names)} |" for row in rows]
    lines.append(
        f"\nExponent of D - 1.4 d: {exponent:.3f}; {given.grains} grains, {top / given.diameter - FLOOR:.0f} d high."
    )
    lines.append("\n" + fitted(rows, given.diameter))
    harness.save(given.name, {"rows": rows, "exponent": exponent, "grains": given.grains}, "\n".join(lines))
    print("\n".join(lines))


if __name__ == "__main__":
    main()

"""The three cases of Dosta et al. (2024) as smaller twins: a silo, a drum mixer, and the impact of a ball.

Same geometry, materials but for their stiffness, friction and restitution; larger and fewer spheres, of soft contacts.
`benchmarks/dosta_full.py` has the impact at full size, and what the full cases cost.

    python benchmarks/dosta.py [--only silo,drum,impact] [--folder runs/dosta]

Source: M. Dosta et al., Comput. Phys. Commun. 296 (2024) 109066.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # run as a script from anywhere

import jaxdem  # noqa: E402
from benchmarks import harness  # noqa: E402
from jaxdem.io import Run  # noqa: E402
from jaxdem.io.run_folder import is_complete  # noqa: E402
from jaxdem.mixing import mixing_index  # noqa: E402

M2 = {"density": 2000.0, "restitution": 0.4, "friction": 0.4}
"""Material M2 in place of M1, stiffness apart."""

FILLING = 0.4
"""Time for which spheres fall into a silo before it opens [s]."""


def tables_of(name: str) -> dict[str, Any]:
    """A scene of the package as tables, with absolute names of files."""
    return jaxdem.load_scene(ROOT / "scenes" / f"dosta_{name}.toml").tables()


def run_of(tables: dict[str, Any], folder: Path) -> tuple[Run, float]:
    """A run, used again if it is complete and gone on with if it was stopped; and the processor time that it took,
    compilation included [s]."""
    scene, stamp = jaxdem.load_scene(tables), folder.with_suffix(".seconds")
    spent = float(stamp.read_text()) if stamp.exists() else 0.0
    if not is_complete(folder, scene.to_toml()):
        before = time.process_time()
        try:
            jaxdem.simulate(scene, folder, resume=folder.exists())
        finally:
            spent += time.process_time() - before
            stamp.write_text(f"{spent:.1f}\n")
    return jaxdem.load_run(folder), spent


def cost(run: Run, seconds: float) -> dict[str, float]:
    """What a run took, and how much of it was work."""
    counts = run.summary["counts"]
    work = counts["contact_steps"] * counts["particles"]
    stages = run.summary["stages_s"]
    return {
        "contact_step_s": run.summary["time_steps"]["contact"],
        "particle_steps": work,
        "processor_s": seconds,
        "run_s": run.summary["run_time_s"],
        "million_particle_steps_per_s": 1e-6 * work / run.summary["run_time_s"],
        "stages_s": stages,
    }


def energy(run: Run) -> dict[str, Any]:
    """Balance of energy of a run, in J."""
    found = run.summary["energy"]
    change = {name: found["end"][name] - found["start"][name] for name in found["end"]}
    names = ("work", "dissipated", "time_step", "missing", "gained", "gained_relative")
    return {"change": change, **{name: found[name] for name in names}}


# --- silo ---------------------------------------------------------------------------------------------------------


def silo(folder: Path, material: str, orifice: str, given: argparse.Namespace) -> dict[str, Any]:
    """Fills a silo over a closed orifice for `FILLING`, opens it, and gives the number of spheres inside over time."""
    tables, name = tables_of("silo"), f"silo_{material}_{orifice}"
    diameter, width = 2.0 * given.silo_radius, {"small": 0.04, "large": 0.06}[orifice]
    tables["particles"]["radius"] = given.silo_radius
    above = {"shape": "cylinder", "base": [0.105, 0.105, 0.115], "axis": [0, 0, 1], "radius": 0.095, "length": 0.16}
    tables["particles"]["pack"] |= {"kind": "random", "count": given.silo_count, "region": above}
    tables["materials"][0]["young_modulus"] = 2e6
    tables["contact"] |= {"speed": 2.0, "time_step": "auto"}
    if material == "M2":
        tables["materials"][0] |= M2 | {"young_modulus": 0.5 * tables["materials"][0]["young_modulus"]}
        tables["particles"]["density"] = M2["density"]
    for wall in tables["walls"]:
        wall.pop("end", None)
        if wall["name"] == "silo":
            wall["file"] = str(ROOT / "scenes" / f"dosta_silo_{orifice}.stl")
    filling = tables | {"time": {"end": FILLING, "output_interval": 0.1}, "probes": []}
    _, filled_s = run_of(filling, folder / f"{name}_filled")
    opened = tables | {"walls": [wall for wall in tables["walls"] if wall["name"] != "gate"]}
    opened |= {"start": {"from": str(folder / f"{name}_filled")}, "output": {"energy": True}}
    opened["time"] = {"end": FILLING + given.silo_end, "output_interval": 0.02}
    opened["particles"] = {key: value for key, value in tables["particles"].items() if key not in ("pack", "count")}
    run, seconds = run_of(opened, folder / name)
    passed, gone = np.asarray(run.history["time"]) - FILLING, np.asarray(run.history["removed"])
    steady = (passed >= 0.1) & (gone <= 0.6 * given.silo_count)
    mass = tables["particles"]["density"] * math.pi / 6.0 * diameter**3
    slope = mass * float(np.polyfit(passed[steady], gone[steady], 1)[0])
    bulk = 0.6 * tables["particles"]["density"]
    return {
        "spheres": given.silo_count, "diameter_m": diameter, "orifice_m": width, "material": material,
        "time_s": passed.tolist(), "inside": (given.silo_count - gone).tolist(),
        "flow_kg_s": slope, "beverloo_kg_s": 0.58 * bulk * math.sqrt(9.81) * (width - 1.4 * diameter) ** 2.5,
        "steady_s": float(np.ptp(passed[steady])), "steady_spheres": float(np.ptp(gone[steady])),
        "filling_processor_s": filled_s, "energy": energy(run), **cost(run, seconds),
    }  # fmt: skip


# --- drum ---------------------------------------------------------------------------------------------------------


def drum(folder: Path, given: argparse.Namespace) -> dict[str, Any]:
    """Turns the drum, and gives how many small and large spheres are in two quarters, and how mixed they are."""
    tables, grow = tables_of("drum"), given.drum_grow
    for pack in tables["particles"]["pack"]:  # they fall while the drum begins to turn
        pack["kind"] = "random"
    tables["particles"]["pack"][0] |= {"radius": 0.002 * grow, "count": round(8000 / grow**3)}
    tables["particles"]["pack"][1] |= {"radius": 0.001 * grow, "count": round(30000 / grow**3)}
    tables |= {"time": {"end": given.drum_end, "output_interval": 0.05}, "output": {"energy": True}}
    run, seconds = run_of(tables, folder / "drum")
    radius = np.asarray(run.particles(0)["radius"])
    small, times, middle = radius < 0.0015 * grow, np.asarray(run.times), np.array([0.105, 0.105])
    counts: dict[str, list[int]] = {
        f"{kind}_{place}": [] for place in ("upper_right", "lower_left") for kind in ("small", "large")
    }
    index, slope = [], []
    for frame in range(len(times)):
        x = np.asarray(run.particles(frame)["position"])[:, [0, 2]] - middle
        places = {"upper_right": (x > 0).all(axis=1), "lower_left": (x < 0).all(axis=1)}
        for place, there in places.items():
            for kind, of in (("small", small), ("large", ~small)):
                counts[f"{kind}_{place}"].append(int(np.sum(there & of)))
        index.append(mixing_index(x, small, 0.02, radius**3, origin=(-0.1, -0.1)))
        slope.append(surface_angle(x))
    late = times >= 0.5 * times[-1]
    probe = run.probes["drum"]
    power = sum(np.asarray(run.probes[name]["power"]) for name in ("drum", "front", "back"))
    return {
        "small": int(small.sum()), "large": int((~small).sum()), "time_s": times.tolist(), **counts, "lacey": index,
        "angle_deg": slope, "angle_late_deg": float(np.mean(np.asarray(slope)[late])),
        "power_late_w": -float(np.mean(power[np.asarray(probe["time"]) >= 0.5 * times[-1]])),
        "energy": energy(run), **cost(run, seconds),
    }  # fmt: skip


def surface_angle(x: np.ndarray, columns: int = 8) -> float:
    """Angle of the bed's surface with the horizontal, by a line through the highest spheres of the middle columns."""
    edges = np.linspace(-0.05, 0.05, columns + 1)
    number = np.digitize(x[:, 0], edges) - 1
    tops = [(0.5 * (edges[k] + edges[k + 1]), x[number == k, 1]) for k in range(columns)]
    places = np.array([(middle, np.quantile(z, 0.97)) for middle, z in tops if len(z) > 4])
    return float(np.degrees(np.arctan(np.polyfit(*places.T, 1)[0]))) if len(places) > 2 else math.nan


# --- impact -------------------------------------------------------------------------------------------------------


def impact(folder: Path, given: argparse.Namespace) -> dict[str, Any]:
    """Lets the ball fall on the layer, and gives its depth below the first surface and its speed."""
    tables = tables_of("impact")
    tables |= {"time": {"end": given.impact_end, "output_interval": 0.001}, "output": {"energy": True}}
    run, seconds = run_of(tables, folder / "impact")
    passed, moved = np.asarray(run.history["time"]), np.asarray(run.history["wall_0_displacement"])
    position = np.asarray(run.particles(0)["position"])
    near = np.hypot(*(position[:, :2] - 0.0225).T) < 0.012
    surface = float(position[near, 2].max()) + 0.002
    bottom = 0.046 - 5.0 * passed + (-moved)  # the piston's way is along -z, in the frame of the first velocity
    depth = surface - bottom
    probe = run.probes["ball"]
    speed = -np.gradient(bottom, passed)
    return {
        "spheres": int(run.summary["counts"]["particles"]), "layer_m": surface, "time_s": passed.tolist(),
        "depth_m": depth.tolist(), "speed_m_s": speed.tolist(), "deepest_m": float(depth.max()),
        "stopped_s": float(passed[np.argmax(depth)]),
        "force_time_s": np.asarray(probe["time"]).tolist(), "force_n": np.asarray(probe["force_z"]).tolist(),
        "ball_energy_j": 0.5 * 0.03016 * 25.0, "energy": energy(run), **cost(run, seconds),
    }  # fmt: skip


# --- full cases -----------------------------------------------------------------------------------------------------


def main() -> None:
    """The twins, one after the other; what is done is saved at once."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="impact,silo,drum")
    parser.add_argument("--folder", type=Path, default=ROOT / "runs" / "dosta")
    parser.add_argument("--silo-radius", type=float, default=0.004, help="of a sphere [m]")
    parser.add_argument("--silo-count", type=int, default=3000)
    parser.add_argument("--silo-end", type=float, default=0.5, help="[s]")
    parser.add_argument("--silos", default="M1:large,M1:small,M2:large", help="material:orifice")
    parser.add_argument("--drum-grow", type=float, default=4.0, help="factor on the diameters of the case")
    parser.add_argument("--drum-end", type=float, default=1.5, help="[s]")
    parser.add_argument("--impact-end", type=float, default=0.05, help="[s]")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    known = harness.RESULTS / "dosta.json"
    found = json.loads(known.read_text()) if known.exists() else {}
    found.pop("machine", None)
    for name in given.only.split(","):
        if name == "silo":
            for one in given.silos.split(","):
                material, orifice = one.split(":")
                found[f"silo_{material}_{orifice}"] = silo(given.folder, material, orifice, given)
                harness.save("dosta", found, table(found))
        else:
            found[name] = {"drum": drum, "impact": impact}[name](given.folder, given)
        harness.save("dosta", found, table(found))
    print(table(found))


def table(found: dict[str, Any]) -> str:
    """The main figures."""
    lines = ["| case | figure | value |", "| --- | --- | --- |"]
    for name, one in found.items():
        if not isinstance(one, dict) or "particle_steps" not in one:
            continue
        for key, value in one.items():
            if isinstance(value, float | int):
                lines.append(f"| {name} | {key} | {value:.4g} |")
        balance = one["energy"]
        lines.append(
            f"| {name} | energy that no force explains, over the turned over | {balance['gained_relative']:.2e} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()

"""The impact of Dosta et al. (2024) at full size, 25,000 spheres of 1e9 Pa, and the speed of the full cases.

The layer is a dense disordered pack that falls by some millimetres and comes to rest with soft contacts. Its spheres
are then moved apart until none overlaps, and rest for a moment with stiff contacts: at the overlaps of soft ones they
would burst apart. The ball is one more sphere, put on the layer at the speed of the impact.

    python benchmarks/dosta_full.py             the impact to its end; goes on if it was stopped
    python benchmarks/dosta_full.py --so-far    results of an impact that was stopped
    python benchmarks/dosta_full.py --rate      speed of its steps, with and without the balance of energy

Sources: M. Dosta et al., Comput. Phys. Commun. 296 (2024) 109066; the ball (radius 10 mm, 7,200 kg/m3, steel, free to
turn and to give way) is that of the script of one of the programs, `examples/DEM2020Benchmark/Case3_PenetrationTest.py`
of YADE. The section of the box is not in our sources: `SIDE` is ours.
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

import jax  # noqa: E402

import jaxdem  # noqa: E402
from benchmarks import harness  # noqa: E402
from benchmarks.dosta import energy, run_of, tables_of  # noqa: E402
from jaxdem.io import Run  # noqa: E402
from jaxdem.setup.builder import build_case  # noqa: E402

SPHERES, RADIUS, SIDE = 25_000, 0.002, 0.12
BALL, DENSITY, SPEED = 0.01, 7200.0, 5.0
FRACTION = 0.58
"""Solid fraction of the pack before it comes to rest."""

SOFT, STIFF = 1e7, 1e9
"""Young's modulus while the layer comes to rest, and in the impact [Pa]."""

REST, HEIGHT = 0.04, 0.005
"""Time for which it comes to rest [s]; and distance of the ball from it, which gives it 1 ms more [m]."""


EXPECTED = 0.3
"""Speed for the overlap on which the stability of the contact step stands [m/s]. All contacts are taken to be as deep
as an impact of two such balls makes them; at 0.3 m/s that is 2.2 % of a diameter between spheres."""


def scene(modulus: float, end: float, **more: Any) -> dict[str, Any]:
    """The layer as tables."""
    tables = tables_of("impact")
    kept = {key: tables[key] for key in ("seed", "materials", "material_pairs")}
    kept["materials"][0]["young_modulus"] = modulus
    deep = SPHERES * 4.0 / 3.0 * np.pi * RADIUS**3 / (FRACTION * SIDE**2)
    region = {"shape": "box", "start": [0.0, 0.0, 0.0], "stop": [SIDE, SIDE, round(float(deep), 5)]}
    return kept | {
        "domain": {"size": [SIDE, SIDE, 0.16]},
        "particles": {
            "radius": RADIUS, "density": 2500.0, "material": "M1",
            "pack": {"kind": "grown", "count": SPHERES, "region": region},
        },
        "contact": {"poisson_ratio": 0.2, "wall_material": "steel", "speed": 0.5},
        "coupling": {"interval": 5e-4},
        "time": {"end": end, "output_interval": 0.005},
    } | more  # fmt: skip


def surface(position: np.ndarray) -> float:
    """Height of the layer below the ball [m]: of the highest of its spheres (N, 3) near the middle."""
    near = np.hypot(*(position[:, :2] - 0.5 * SIDE).T) < BALL + RADIUS
    return float(position[near, 2].max()) + RADIUS


def with_ball(rested: Path, duration: float, balance: bool) -> dict[str, Any]:
    """The layer and the ball as tables; the ball has the speed of the impact when it meets the layer."""
    run = jaxdem.load_run(rested)
    position = np.asarray(run.particles(int(np.argmin(np.abs(run.times - REST))))["position"])
    place = [0.5 * SIDE, 0.5 * SIDE, round(surface(position) + BALL + HEIGHT, 6)]
    speed = math.sqrt(SPEED**2 - 2.0 * 9.81 * HEIGHT)
    ball = {"radius": BALL, "density": DENSITY, "material": "steel", "position": [place], "velocity": [[0, 0, -speed]]}
    tables = scene(STIFF, REST + duration, output={"energy": balance})
    del tables["particles"]["pack"]
    tables["contact"]["speed"] = EXPECTED
    tables["time"]["output_interval"] = 0.001
    return tables | {"start": {"from": str(rested), "time": REST, "relax": True, "add": ball}}


def rates(after: Path, time_now: float, repeats: int = 3) -> dict[str, dict[str, float]]:
    """Million steps of a particle in a second of processor time, with and without the balance of energy, in turn.

    Args:
        after: folder of an impact, from whose newest checkpoint the steps go on.
        time_now: of this checkpoint [s].
        repeats: of 100 steps.
    """
    ready = {}
    for name, balance in (("without", False), ("with", True)):
        tables = with_ball(after.parent / "layer", 0.0, balance)
        tables |= {"start": {"from": str(after)}, "time": {"end": time_now + 0.001, "output_interval": 0.001}}
        case = build_case(jaxdem.load_scene(tables | {"coupling": {"interval": 1e-4}}))
        step, (state, neighbors) = jax.jit(case.simulation.step), case.initial_state()
        ready[name] = case, step, *jax.block_until_ready(step(case.parameters, state, neighbors))[:2]
    found: dict[str, list[float]] = {name: [] for name in ready}
    for name in list(ready) * repeats:
        case, step, state, neighbors = ready[name]
        begin = time.process_time()
        state, neighbors, report = jax.block_until_ready(step(case.parameters, state, neighbors))
        work = 1e-6 * (SPHERES + 1) * case.simulation.contact.steps
        found[name].append(work / (time.process_time() - begin))
        assert not bool(report.particles.overflow)
        ready[name] = case, step, state, neighbors
    return {name: harness.spread(values) for name, values in found.items()}


def measured(run: Run) -> dict[str, Any]:
    """Depth and speed of the ball over time since it met the layer, as far as the run has got."""
    frames = [run.particles(k) for k in range(len(run.times))]
    ball = int(np.argmax(np.asarray(frames[0]["radius"])))
    place = np.array([np.asarray(frame["position"])[ball] for frame in frames], float)
    speed = -np.array([np.asarray(frame["velocity"])[ball, 2] for frame in frames], float)
    passed = np.asarray(run.times) - run.times[0]
    before = int(np.searchsorted(passed, 0.001)) - 1  # a frame shortly before
    top = surface(np.delete(np.asarray(frames[before]["position"]), ball, axis=0))
    met = passed[before] + (place[before, 2] - BALL - top) / speed[before]
    depth = top - (place[:, 2] - BALL)
    return {
        "spheres": SPHERES, "side_m": SIDE, "layer_m": top, "time_s": (passed - met).tolist(),
        "depth_m": depth.tolist(), "speed_m_s": speed.tolist(), "deepest_m": float(depth.max()),
        "stopped_s": float(passed[np.argmax(depth)] - met) if depth.argmax() < len(depth) - 1 else None,
        "last_m": float(depth[-1]), "followed_s": float(passed[-1] - met),
        "sideways_m": float(np.hypot(*(place[-1, :2] - place[0, :2]))),
    }  # fmt: skip


def main() -> None:
    """The layer, then the impact, or the speed of its steps."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=ROOT / "runs" / "dosta_full")
    parser.add_argument("--duration", type=float, default=0.101, help="of the impact, 1 ms of fall included [s]")
    parser.add_argument("--rate", action="store_true", help="the speed of its steps instead")
    parser.add_argument("--so-far", action="store_true", help="the results of a run that was stopped")
    parser.add_argument("--no-energy", action="store_true", help="without the balance of energy")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    layer, impact = given.folder / "layer", given.folder / "impact"
    stored = harness.RESULTS / "dosta_full.json"
    known = json.loads(stored.read_text()) if stored.exists() else {}
    known.pop("machine", None)
    if given.rate:
        known["rates"] = rates(impact, jaxdem.load_run(impact).summary["time"])
        harness.write("dosta_full", known, table(known))
        return
    if given.so_far:
        run, seconds = jaxdem.load_run(impact), float(impact.with_suffix(".seconds").read_text())
        rested_s = float(layer.with_suffix(".seconds").read_text())
    else:
        _, rested_s = run_of(scene(SOFT, REST), layer)
        print(f"the layer took {rested_s:.0f} s of processor time", flush=True)
        run, seconds = run_of(with_ball(layer, given.duration, not given.no_energy), impact)
    found = measured(run) | ({"energy": energy(run)} if "work" in run.summary.get("energy", {}) else {})
    counts, step = run.summary["counts"], run.summary["time_steps"]["contact"]
    found |= {"contact_step_s": step, "particle_steps": counts["contact_steps"] * counts["particles"]}
    found |= {"processor_s": seconds, "layer_processor_s": rested_s}
    known[given.folder.name] = found
    harness.write("dosta_full", known, table(known))


def table(found: dict[str, Any]) -> str:
    """The main figures, of each folder."""
    lines = ["| run | figure | value |", "| --- | --- | --- |"]
    for name, one in found.items():
        lines += [f"| {name} | {key} | {value:.4g} |" for key, value in one.items() if isinstance(value, int | float)]
        if "energy" in one:
            lines.append(f"| {name} | `gained` over the energy turned over | {one['energy']['gained_relative']:.2e} |")
    for name, rate in found.get("rates", {}).items():
        spread = f"{rate['median']:.3g} ({rate['lowest']:.3g} to {rate['highest']:.3g})"
        lines.append(
            f"| rates | million steps of a particle in a second of a core, {name} balance of energy | {spread} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()

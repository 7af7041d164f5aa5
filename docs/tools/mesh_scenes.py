"""Draws pictures of the scenes with meshes from runs of them.

python benchmarks/dosta.py --folder runs/dosta
jaxdem run scenes/drum_with_lifters.toml --out runs/lifters
jaxdem run scenes/slope.toml --out runs/slope
jaxdem run scenes/direct_shear.toml --out runs/shear
python docs/tools/mesh_scenes.py runs/dosta/impact runs/dosta/silo_M1_large runs/dosta/drum
python docs/tools/mesh_scenes.py runs/lifters runs/slope runs/shear

The name of the folder says what is drawn.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

import jaxdem
from jaxdem.io.load import Run

sys.path.insert(0, str(Path(__file__).parent))  # for the script beside this one

from moving_walls import frames, save

RESULTS = Path(__file__).parents[2] / "benchmarks" / "results" / "dosta.json"


def panels(count: int, width: float, height: float) -> tuple[Any, Any]:
    """A figure with frames, and a graph at the right."""
    return plt.subplots(1, count + 1, figsize=(width, height), layout="constrained")


def impact(run: Run) -> None:
    """The ball in the layer, and how deep it is over time."""
    found = json.loads(RESULTS.read_text())["impact"]
    figure, axes = panels(3, 10.4, 4.6)
    times = (0.002, 0.005, 0.01)
    frames(figure, axes[:-1], run, times)
    for axis, time in zip(axes[:-1], times, strict=True):
        axis.set(ylim=(0.0, 0.07), title=f"{1e3 * time:.0f} ms")
    axes[-1].plot(1e3 * np.asarray(found["time_s"]), 1e3 * np.asarray(found["depth_m"]))
    axes[-1].set(xlabel="time [ms]", ylabel="depth of the ball's lowest point [mm]", ylim=(0.0, None))
    axes[-1].invert_yaxis()
    save(figure, "dosta_impact")


def silo(run: Run) -> None:
    """The silo while it empties, and the spheres in it over time."""
    found = json.loads(RESULTS.read_text())["silo_M1_large"]
    figure, axes = panels(3, 11.0, 4.4)
    begin = float(run.times[0])
    times = (0.0, 0.1, 0.5)
    frames(figure, axes[:-1], run, tuple(begin + time for time in times))
    # Away from the walls; "outlet" is the side at which spheres leave.
    axes[0].legend(handles=axes[0].get_legend().legend_handles, loc="upper center", bbox_to_anchor=(0.5, 0.9))
    for axis, time in zip(axes[:-1], times, strict=True):
        axis.set(ylim=(0.0, 0.26), title=f"{time:.1f} s")
    axes[-1].plot(found["time_s"], found["inside"], label="run")
    mass = 2500.0 * np.pi / 6.0 * found["diameter_m"] ** 3
    times = np.array([0.08, found["time_s"][-1]])
    first = np.interp(times[0], found["time_s"], found["inside"])
    axes[-1].plot(
        times, first - found["beverloo_kg_s"] / mass * (times - times[0]), "--", color="gray", label="Beverloo"
    )
    axes[-1].set(xlabel="time since it opened [s]", ylabel="spheres in the silo")
    axes[-1].legend()
    save(figure, "dosta_silo")


def drum(run: Run) -> None:
    """The drum as it mixes, and the small spheres in two quarters."""
    found = json.loads(RESULTS.read_text())["drum"]
    figure, axes = panels(3, 12.6, 4.1)
    frames(figure, axes[:-1], run, (0.0, 0.5 * float(run.times[-1]), float(run.times[-1])))
    for name, label in (("upper_right", "upper right"), ("lower_left", "lower left")):
        line = axes[-1].plot(found["time_s"], found[f"small_{name}"], label=f"small, {label}")[0]
        axes[-1].plot(found["time_s"], found[f"large_{name}"], "--", color=line.get_color(), label=f"large, {label}")
    axes[-1].set(xlabel="time [s]", ylabel="spheres in a quarter", ylim=(0.0, 480.0))
    axes[-1].legend(fontsize="small", loc="upper right")
    save(figure, "dosta_drum")


def lifters(run: Run) -> None:
    """The drum with lifters, and the power of its motor."""
    figure, axes = panels(3, 12.6, 4.1)
    end = float(run.times[-1])
    frames(figure, axes[:-1], run, (0.25 * end, 0.5 * end, end))
    measured = run.probes["drum"]
    axes[-1].plot(measured["time"], -np.asarray(measured["power"]))
    axes[-1].set(xlabel="time [s]", ylabel="power of the drum [W]")
    save(figure, "drum_with_lifters")


def slope(run: Run) -> None:
    """The slide, from the side."""
    figure, axes = plt.subplots(3, 1, figsize=(8.0, 8.6), layout="constrained")
    end = float(run.times[-1])
    frames(figure, axes, run, (0.0, 0.5 * end, end))
    for axis in axes:
        axis.set_ylabel("z [m]")
    for axis in axes[:-1]:
        axis.set_xlabel("")
    save(figure, "slope")


def shear(run: Run) -> None:
    """The shear box before and after, and shear stress over normal stress; prints the angles of friction.

    Both stresses are forces over the same section, that of the box.
    """
    figure, axes = panels(2, 11.6, 3.4)
    scene = run.scene
    begin = scene["walls"][1]["motion"][0]["begin"]
    speed = scene["walls"][1]["motion"][0]["velocity"][0]
    frames(figure, axes[:-1], run, (begin, float(run.times[-1])))
    left, right, lid = (run.probes[name] for name in ("left", "right", "lid"))
    time = np.asarray(lid["time"])
    section = 0.1 * scene["domain"]["depth"]
    shear_force = -sum(np.asarray(one["force_x"]) for one in (left, right, lid))  # that pushes the upper half
    ratio, moved = shear_force / np.asarray(lid["force_z"]), speed * (time - begin)
    shown = moved > 0.0
    axes[-1].plot(1e3 * moved[shown], 1e-3 * shear_force[shown] / section)
    normal = 1e-3 * float(np.mean(np.asarray(lid["force_z"])[shown])) / section
    axes[-1].set(xlabel="displacement of the upper half [mm]", ylabel="shear stress [kPa]", ylim=(0.0, None))
    axes[-1].set_title(f"under {normal:.0f} kPa", fontsize="medium")
    late = moved > 0.01
    peak, rest = float(np.max(ratio[shown])), float(np.mean(ratio[late]))
    for name, value, style in (("largest", peak, ":"), ("mean from 10 mm on", rest, "--")):
        angle = np.degrees(np.arctan(value))
        axes[-1].axhline(normal * value, color="gray", linestyle=style, label=f"{name}: {angle:.1f} degrees")
        print(f"{name}: ratio {value:.3f}, angle of friction {angle:.1f} degrees")
    print(f"largest at {1e3 * moved[shown][np.argmax(ratio[shown])]:.1f} mm; normal stress {normal:.1f} kPa")
    axes[-1].legend(fontsize="small", loc="lower right")
    save(figure, "direct_shear")


def main() -> None:
    """All runs that are named."""
    drawn = {"impact": impact, "silo": silo, "drum": drum, "lifters": lifters, "slope": slope, "shear": shear}
    for name in sys.argv[1:]:
        drawn[Path(name).name.partition("_")[0]](jaxdem.load_run(name))


if __name__ == "__main__":
    main()

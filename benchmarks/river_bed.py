"""Bed load over the Shields number: loose grains under a driven stream, beside two laws of flume experiments.

    python benchmarks/river_bed.py [--speeds 0.5,0.7,...] [--packs 0,1] [--runs DIR] [--picture FILE] [--also RUN ...]

`scenes/river_bed.toml` at several bulk velocities, each with several packs. With --runs the runs are kept in DIR, and
those that are complete are used again. --also measures further runs of the scene with other keys, which the result
and the picture tell apart.

The volume of grains that passes a width and a time is q_s = sum(V v_x) / (length x width of the bed), from the frames.
The bed's surface is where the solid fraction, averaged along the bed and in time, falls to half of that within the bed.
The stress there is the force of the mean pressure gradient G on all that lies above: tau = -G (H - z), with H the
height of the box. The block means of q_s and of tau over equal parts of the time give their standard errors.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from jaxdem.io import Run

SCENE = Path(__file__).parents[1] / "scenes" / "river_bed.toml"
SPEEDS = (0.3, 0.4, 0.5, 0.6, 0.7)
"""Bulk velocities [m/s]."""
BEGIN = 0.6
"""Part of `time.end` that passes before the flow and the bed are taken as steady."""
LOWEST = (0.2, 0.35)
"""Smallest Shields numbers of the runs over which the scatter is stated."""
SLICES_PER_DIAMETER = 8


class Bed(NamedTuple):
    """Profiles over the height, averaged along the bed and in time.

    Attributes:
        height: (K,) middle of the slices [m].
        solid_fraction: (K,) [-].
        grain_flux: (K,) volume of grains that passes an area in a time [m/s].
        fluid_height: (M,) middle of the cells [m].
        fluid_velocity: (M,) along the stream, interstitial [m/s].
    """

    height: np.ndarray
    solid_fraction: np.ndarray
    grain_flux: np.ndarray
    fluid_height: np.ndarray
    fluid_velocity: np.ndarray


def law_of_meyer_peter(shields: np.ndarray | float) -> np.ndarray:
    """q* = 8 (theta - 0.047)^1.5 (E. Meyer-Peter, R. Mueller, Proc. 2nd meeting IAHR, Stockholm 1948, 39-64)."""
    return 8.0 * np.maximum(np.asarray(shields) - 0.047, 0.0) ** 1.5


def law_of_wong(shields: np.ndarray | float) -> np.ndarray:
    """q* = 3.97 (theta - 0.0495)^1.5 (M. Wong, G. Parker, J. Hydraul. Eng. 132 (2006) 1159-1168)."""
    return 3.97 * np.maximum(np.asarray(shields) - 0.0495, 0.0) ** 1.5


LAWS = {"meyer_peter": law_of_meyer_peter, "wong": law_of_wong}


def volume_below(edges: np.ndarray, centre: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """(K, N) volume of each sphere (N,) below each height (K,): a spherical cap of height h has pi h^2 (r - h/3)."""
    cap = np.clip(edges[:, None] - centre + radius, 0.0, 2.0 * radius)
    return np.pi * cap**2 * (radius - cap / 3.0)


def fluxes(run: Run, frames: range) -> np.ndarray:
    """Volume of grains that passes a width and a time [m2/s], at each of the frames."""
    length, width, _ = run.scene["domain"]["size"]
    result = []
    for frame in frames:
        grains = run.particles(frame)
        volume = 4.0 / 3.0 * np.pi * grains["radius"].astype(float) ** 3
        result.append(np.sum(volume * grains["velocity"][:, 0]) / (length * width))
    return np.array(result)


def profiles(run: Run, frames: range) -> Bed:
    """Means over the frames."""
    length, width, top = run.scene["domain"]["size"]
    diameter = 2.0 * float(np.mean(run.particles(0)["radius"]))
    edges = np.linspace(0.0, top, round(SLICES_PER_DIAMETER * top / diameter) + 1)
    slice_volume = length * width * (edges[1] - edges[0])
    solid, moved, water = [], [], []
    for frame in frames:
        grains, fluid = run.particles(frame), run.fluid(frame)
        assert fluid is not None
        position, radius = grains["position"][:, 2].astype(float), grains["radius"].astype(float)
        parts = np.diff(volume_below(edges, position, radius), axis=0) / slice_volume
        solid.append(parts.sum(axis=1))
        moved.append(parts @ grains["velocity"][:, 0])
        water.append(fluid["velocity"][..., 0].mean(axis=(0, 1)))
    cells = len(water[0])
    return Bed(
        0.5 * (edges[1:] + edges[:-1]),
        np.mean(solid, axis=0),
        np.mean(moved, axis=0),
        (np.arange(cells) + 0.5) * top / cells,
        np.mean(water, axis=0),
    )


def surface(bed: Bed, diameter: float) -> tuple[float, float]:
    """Height of the bed's surface [m], and the solid fraction within the bed, two to four diameters above the floor."""
    within = (bed.height > 2.0 * diameter) & (bed.height < 4.0 * diameter)
    solid = float(bed.solid_fraction[within].mean())
    last = int(np.flatnonzero(bed.solid_fraction >= 0.5 * solid)[-1])
    beside = bed.solid_fraction[last : last + 2]
    part = (beside[0] - 0.5 * solid) / (beside[0] - beside[1])
    return float(bed.height[last] + part * (bed.height[last + 1] - bed.height[last])), solid


def measure(run: Run) -> dict[str, Any]:
    """Shields number and flux of a run, with their standard errors in time, and its profiles."""
    first = int(np.searchsorted(run.times, BEGIN * run.scene["time"]["end"] - 1e-9))
    frames = range(first, run.number_of_frames)
    fluid, gravity = run.scene["fluid"], -run.scene["domain"]["gravity"][2]
    radius = run.particles(0)["radius"].astype(float)
    diameter = float(2.0 * np.mean(radius**3) ** (1.0 / 3.0))
    weight = (run.scene["particles"]["density"] / fluid["density"] - 1.0) * gravity  # submerged, per mass of fluid
    bed = profiles(run, frames)
    height, solid = surface(bed, diameter)
    depth = run.scene["domain"]["size"][2] - height
    stress = -run.history["pressure_gradient_x"][first:] * depth
    shields = stress / (fluid["density"] * weight * diameter)
    flux = fluxes(run, frames) / np.sqrt(weight * diameter**3)
    return {
        "shields": float(shields.mean()),
        "shields_error": harness.standard_error(shields),
        "flux": float(flux.mean()),
        "flux_error": harness.standard_error(flux),
        "flux_blocks": [float(part.mean()) for part in np.array_split(flux, 5)],
        "stress_pa": float(stress.mean()),
        "depth_m": depth,
        "bed_surface_diameters": height / diameter,
        "bed_solid_fraction": solid,
        "diameter_m": diameter,
        "grains": len(radius),
        "profiles": {name: np.round(values, 6).tolist() for name, values in bed._asdict().items()},
    }


def run_of(speed: float, seed: int, folder: Path) -> dict[str, Any]:
    """A run of the scene with this bulk velocity [m/s] and pack, measured."""
    held = [[0.0, "free", "free"], [speed, "free", "free"]]
    overrides = {"seed": seed, "fluid.bulk_velocity": held, "output.checkpoint_interval": 1e9, "probes": []}
    run = jaxdem.simulate(jaxdem.load_scene(SCENE, overrides), folder, resume=folder.exists())
    found = measure(run)
    laws = {name: float(law(found["shields"])) for name, law in LAWS.items()}
    found |= {"valid": run.summary["valid"], "wall_s": harness.time_of(run), "end": float(run.times[-1])}
    return found | laws


def scatter(rows: list[dict[str, Any]], lowest: float) -> dict[str, dict[str, float]]:
    """By law: mean, root mean square and largest size of log10(flux / law), for Shields numbers from `lowest` on."""
    result = {}
    for name in LAWS:
        some = [row for row in rows if row["shields"] >= lowest and row["flux"] > 0.0 and row[name] > 0.0]
        logs = np.log10([row["flux"] / row[name] for row in some])
        if len(logs):
            found = float(logs.mean()), float(np.sqrt(np.mean(logs**2))), float(np.abs(logs).max())
            result[name] = dict(zip(("mean_log10", "rms_log10", "largest"), found, strict=True)) | {"runs": len(logs)}
    return result


def other_settings(path: Path) -> dict[str, Any]:
    """A run with other keys, as far as it has come, measured; and the keys that are likely to differ."""
    run = jaxdem.load_run(path)
    fluid, coupling = run.scene["fluid"], run.scene["coupling"]
    names = ("cells", "smagorinsky", "bed_mixing", "bulk_velocity", "drive_times")
    keys = {name: fluid.get(name) for name in names} | {name: coupling[name] for name in ("kernel_width", "lift")}
    keys |= {"young_modulus": run.scene["contact"]["young_modulus"]}
    return {"name": path.name, "keys": keys, "end": float(run.times[-1])} | measure(run)


def draw(rows: list[dict[str, Any]], others: list[dict[str, Any]], path: Path) -> None:
    """The flux over the Shields number, and profiles of three of the runs."""
    from jaxdem.report import style

    with style.look():
        figure = style.new_figure(9.0, 3.8)
        left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
        theta = np.geomspace(0.048, 3.0, 300)
        left.plot(theta, law_of_meyer_peter(theta), color="black", label="Meyer-Peter & Mueller 1948")
        left.plot(theta, law_of_wong(theta), color="black", linestyle="--", label="Wong & Parker 2006")
        left.axvline(0.047, color=style.NOISE, linestyle=":", label="threshold 0.047")
        for seed in sorted({row["seed"] for row in rows}):
            some = [row for row in rows if row["seed"] == seed]
            left.errorbar(
                [row["shields"] for row in some], [row["flux"] for row in some],
                xerr=[row["shields_error"] for row in some], yerr=[row["flux_error"] for row in some],
                fmt="os^D"[seed % 4], color=style.COLOURS[seed % len(style.COLOURS)], capsize=2, label=f"pack {seed}",
            )  # fmt: skip
        if others:
            there = [row for row in others if row["flux"] > 0.0]
            left.plot(
                [row["shields"] for row in there], [row["flux"] for row in there], "x", color=style.NOISE,
                label="other settings",
            )  # fmt: skip
        left.set(xscale="log", yscale="log", xlim=(0.04, 3.0), ylim=(1e-4, 30.0))
        left.set(xlabel="Shields number [-]", ylabel="bed load q* [-]")
        left.legend(loc="lower right")
        some = sorted((row for row in rows if row["seed"] == 0), key=lambda row: row["shields"])
        for number, row in enumerate(some[:: max(1, (len(some) - 1) // 2)]):
            profile, diameter, colour = row["profiles"], row["diameter_m"], style.COLOURS[number]
            height = np.array(profile["fluid_height"]) / diameter
            label = f"water, Shields number {row['shields']:.2f}"
            right.plot(profile["fluid_velocity"], height, color=colour, label=label)
            solid = np.array(profile["solid_fraction"])
            there = solid > 1e-3
            speed = np.array(profile["grain_flux"])[there] / solid[there]
            right.plot(speed, np.array(profile["height"])[there] / diameter, color=colour, linestyle=":")
        right.plot([], [], color="black", linestyle=":", label="grains")
        right.set(xlabel="velocity along the stream [m/s]", ylabel="height over the floor [d]")
        right.legend(loc="lower right")
        style.save(figure, path, dpi=110)


STUDY = harness.Study(
    "river_bed",
    "speed",
    SPEEDS,
    run_of,
    {
        "bulk velocity [m/s]": "{speed:.2f}",
        "pack": "{seed}",
        "Shields number": "{shields:.3f} +- {shields_error:.3f}",
        "q*": "{flux:.3f} +- {flux_error:.3f}",
        "Meyer-Peter & Mueller": "{meyer_peter:.3f}",
        "Wong & Parker": "{wong:.3f}",
        "stress [Pa]": "{stress_pa:.1f}",
        "surface [d]": "{bed_surface_diameters:.2f}",
        "run [s]": "{wall_s:.0f}",
    },
    lambda rows: {"begin": BEGIN} | {f"scatter_from_{low:g}": scatter(rows, low) for low in LOWEST},
)


def main() -> None:
    """All runs, then the table, the scatter and the picture."""
    parser = STUDY.arguments(__doc__ or "")
    parser.add_argument("--also", type=Path, nargs="*", default=[], help="run directories of other settings")
    given = parser.parse_args()
    others = [other_settings(path) for path in given.also]
    study = STUDY._replace(about=lambda rows: STUDY.about(rows) | {"other_settings": others})
    rows = study.run(given)
    for low in LOWEST:
        print(f"Shields number from {low:g} on:", scatter(rows, low))
    if given.picture:
        draw(rows, others, given.picture)


if __name__ == "__main__":
    main()

"""Friction of a dense granular flow over its inertial number, in a shear cell of constant volume, beside the law mu(I).

    python benchmarks/shear_cell.py [--sizes 1.0,0.98,...] [--packs 0,1] [--runs DIR] [--picture FILE]

`scenes/shear_cell.toml` with all radii times several factors, each of which sets a solid fraction, and with several
packs. With --runs the runs are kept in DIR, and those that are complete are used again. (Other distances of the plates
would do the same, but each would compile a program of its own.)

All is measured in the middle half of the cell, by the probe `layers`: stress of Love and Weber and of the velocity
fluctuations, solid fraction, and the slope of the velocity. With P the normal stress on the plates, friction is
mu = |tau| / P and the inertial number I = shear rate x d / sqrt(P / rho). The means over five parts of the time give
standard errors.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks import harness
from jaxdem.io import Run

SCENE = Path(__file__).parents[1] / "scenes" / "shear_cell.toml"
SIZES = (1.005, 1.0, 0.99, 0.98, 0.965)
"""Factors on all radii."""
RADII = (0.4e-3, 0.6e-3)
"""Smallest and largest of the scene [m]."""
SETTLED = 0.3
"""Part of the time under shear that passes before the flow is taken as steady."""


def friction_law(inertial_number: np.ndarray | float) -> np.ndarray:
    """mu = mu_s + (mu_2 - mu_s) / (1 + I_0 / I), for glass beads.

    mu_s = tan 20.9 degrees = 0.382, mu_2 = tan 32.76 degrees = 0.643, I_0 = 0.279.

    Source: P. Jop, Y. Forterre, O. Pouliquen, Nature 441 (2006) 727-730.
    """
    low, high = np.tan(np.radians([20.9, 32.76]))
    inertial_number = np.asarray(inertial_number)
    return low + (high - low) * inertial_number / (0.279 + inertial_number)


def solid_fraction_law(inertial_number: np.ndarray | float) -> np.ndarray:
    """phi = 0.6 - 0.1 I, for glass beads.

    Source: O. Pouliquen, C. Cassar, P. Jop, Y. Forterre, M. Nicolas, J. Stat. Mech. (2006) P07020.
    """
    return 0.6 - 0.1 * np.asarray(inertial_number)


def measure(run: Run) -> dict[str, Any]:
    """Friction, inertial number and solid fraction of a run, and its velocity profile."""
    lines, scene = run.probes["layers"], run.scene
    times = np.unique(lines["time"])
    begin = run.times[0] + SETTLED * (run.times[-1] - run.times[0])
    layers = len(lines["time"]) // len(times)
    table = {name: column.reshape(len(times), layers)[times > begin + 1e-9] for name, column in lines.items()}
    height, top = table["z"][0], scene["domain"]["size"][2]
    middle = (height > 0.25 * top) & (height < 0.75 * top)
    stress = {
        pair: (table[f"stress_{pair}"] + table[f"streaming_stress_{pair}"])[:, middle].mean(axis=1)
        for pair in ("xx", "yy", "zz", "xz")
    }
    radius = run.particles(0)["radius"].astype(float)
    diameter, density = 2.0 * float(radius.mean()), scene["particles"]["density"]
    rate = np.array([np.polyfit(height[middle], row[middle], 1)[0] for row in table["velocity_x"]])
    normal, friction = np.abs(stress["zz"]), np.abs(stress["xz"] / stress["zz"])
    inertial = rate * diameter / np.sqrt(normal / density)
    return {
        "friction": float(np.abs(stress["xz"].mean() / stress["zz"].mean())),
        "friction_error": harness.standard_error(friction),
        "inertial_number": float(rate.mean() * diameter / np.sqrt(normal.mean() / density)),
        "inertial_number_error": harness.standard_error(inertial),
        "solid_fraction": float(table["solid_fraction"][:, middle].mean()),
        "coordination": float(table["coordination"][:, middle].mean()),
        "pressure_pa": float(normal.mean()),
        "pressure_error_pa": harness.standard_error(normal),
        "normal_stress_ratios": [float(stress[pair].mean() / stress["zz"].mean()) for pair in ("xx", "yy")],
        "pressure_over_modulus": float(normal.mean() / scene["contact"]["young_modulus"]),
        "shear_rate": float(rate.mean()),
        "diameter_m": diameter,
        "grains": len(radius),
        "height_m": top,
        "z_m": height.tolist(),
        "velocity": table["velocity_x"].mean(axis=0).tolist(),
        "solid_fraction_by_layer": table["solid_fraction"].mean(axis=0).tolist(),
    }


def sheared(size: float, seed: int, path: Path) -> dict[str, Any]:
    """A run with all radii times this factor, measured."""
    radii = [size * radius for radius in RADII]
    scene = jaxdem.load_scene(SCENE, {"seed": seed, "particles.distribution.radii": radii})
    run = jaxdem.simulate(scene, path, resume=path.exists())
    found = measure(run)
    inertial = found["inertial_number"]
    found |= {"law": float(friction_law(inertial)), "solid_fraction_law": float(solid_fraction_law(inertial))}
    return found | {"valid": run.summary["valid"], "wall_s": harness.time_of(run)}


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Friction and solid fraction over the inertial number, and velocity profiles."""
    from jaxdem.report import style

    with style.look():
        figure = style.new_figure(10.0, 3.4)
        left, middle, right = figure.subplots(1, 3)
        inertial = np.geomspace(0.01, 1.0, 200)
        left.plot(inertial, friction_law(inertial), color="black", label="glass beads, Jop 2006")
        for number, seed in enumerate(sorted({row["seed"] for row in rows})):
            some = [row for row in rows if row["seed"] == seed]
            x, x_error = ([row[name] for row in some] for name in ("inertial_number", "inertial_number_error"))
            how = {"fmt": "os^D"[number % 4], "color": style.COLOURS[number], "capsize": 2, "label": f"pack {seed}"}
            error = [row["friction_error"] for row in some]
            left.errorbar(x, [row["friction"] for row in some], xerr=x_error, yerr=error, **how)
            middle.errorbar(x, [row["solid_fraction"] for row in some], xerr=x_error, **how)
        middle.plot(inertial, solid_fraction_law(inertial), color="black", label="glass beads, Pouliquen 2006")
        middle.legend(loc="lower left")
        left.set(
            xscale="log",
            xlim=(0.01, 1.0),
            xlabel="inertial number I [-]",
            ylabel="friction tau / P [-]",
            ylim=(0.2, 0.8),
        )
        middle.set(
            xscale="log",
            xlim=(0.01, 1.0),
            ylim=(0.48, 0.62),
            xlabel="inertial number I [-]",
            ylabel="solid fraction [-]",
        )
        left.legend(loc="upper left")
        for number, row in enumerate(row for row in rows if row["seed"] == rows[0]["seed"]):
            right.plot(
                row["velocity"], np.array(row["z_m"]) / row["height_m"], color=style.COLOURS[number % 6],
                label=f"I = {row['inertial_number']:.2f}",
            )  # fmt: skip
        right.set(xlabel="velocity [m/s]", ylabel="height / distance of the plates [-]", ylim=(0.0, 1.0))
        right.legend(loc="lower right")
        style.save(figure, path, dpi=110)


STUDY = harness.Study(
    "shear_cell",
    "size",
    SIZES,
    sheared,
    {
        "radii over those of the scene": "{size:g}",
        "pack": "{seed}",
        "I": "{inertial_number:.4f} +- {inertial_number_error:.4f}",
        "mu": "{friction:.3f} +- {friction_error:.3f}",
        "law of mu": "{law:.3f}",
        "solid fraction": "{solid_fraction:.4f}",
        "law of it": "{solid_fraction_law:.3f}",
        "pressure [Pa]": "{pressure_pa:.3g}",
        "pressure / E": "{pressure_over_modulus:.1e}",
        "contacts a grain": "{coordination:.2f}",
        "run [s]": "{wall_s:.0f}",
    },
    lambda rows: {"settled": SETTLED},
)


def main() -> None:
    """All runs, then the table and the picture."""
    given = STUDY.arguments(__doc__ or "").parse_args()
    rows = STUDY.run(given)
    if given.picture:
        draw(rows, given.picture)


if __name__ == "__main__":
    main()

"""Pressure drop of a bed of spheres against the velocity of a liquid from below.

The inflow is constant for 2 s and then falls slowly (`boundary.bottom.times` and `velocities`). While the bed is
fluidised, the pressure drop equals the submerged weight over the area. At lower velocities the bed is fixed, and the
pressure drop follows Ergun's equation. The change is where Ergun's equation gives the submerged weight.

Run: python examples/fluidised_bed.py [PICTURE]
"""

import math

import matplotlib.pyplot as plt
import numpy as np
from pictures import draw, new_folder, save

import jaxdem

DIAMETER, COUNT, WIDTH = 4e-3, 360, 0.072
FLUID, SOLID, VISCOSITY, GRAVITY = 1000.0, 2000.0, 1e-5, 9.81
HELD, LET_DOWN, FASTEST, SLOWEST = 2.0, 6.0, 0.028, 0.004
SCENE = {
    "domain": {"size": [WIDTH, 0.216], "depth": DIAMETER},
    "particles": {
        "count": COUNT,
        "radius": DIAMETER / 2,
        "density": SOLID,
        "pack": {"kind": "lattice", "start": [0.0, 0.0], "stop": [WIDTH, 0.16], "jitter": 0.005},
    },
    "contact": {"young_modulus": 1e6, "restitution": 0.5, "friction": 0.2, "speed": 0.2},
    "fluid": {"cells": [12, 36], "density": FLUID, "viscosity": VISCOSITY, "time_step": 0.001},
    "boundary": {
        "left": {"kind": "free_slip"},
        "right": {"kind": "free_slip"},
        "bottom": {"kind": "inlet", "times": [HELD, LET_DOWN], "velocities": [FASTEST, SLOWEST]},
        "top": {"kind": "outlet"},
    },
    "coupling": {"drag": "ergun"},
    "time": {"end": 6.2, "output_interval": 0.1},
}


def ergun(velocity: np.ndarray, solid_fraction: float, height: float) -> np.ndarray:
    """Pressure drop of a fixed bed [Pa]: Ergun (1952), superficial velocity."""
    s, g = solid_fraction, 1.0 - solid_fraction
    viscous = 150.0 * FLUID * VISCOSITY * velocity * s**2 / (g**3 * DIAMETER**2)
    return height * (viscous + 1.75 * FLUID * velocity**2 * s / (g**3 * DIAMETER))


def main() -> None:
    """Run the bed, compare its pressure drop with Ergun's equation and the bed's weight, and draw both."""
    run = jaxdem.simulate(jaxdem.load_scene(SCENE), new_folder("fluidised_bed"))
    first = round(HELD / SCENE["time"]["output_interval"])
    frames = range(first, run.number_of_frames)
    pressure = np.array([run.fluid(i)["pressure"].mean(axis=0) for i in frames])
    drop = pressure[:, 0] - pressure[:, -1]
    velocity = np.interp(run.times[first:], [HELD, LET_DOWN], [FASTEST, SLOWEST])
    volume = COUNT * math.pi / 6.0 * DIAMETER**3
    weight = volume * (SOLID - FLUID) * GRAVITY / (WIDTH * DIAMETER)
    height = run.history["height"][-1] + DIAMETER / 2
    fixed = ergun(velocity, volume / (WIDTH * DIAMETER * height), height)
    save(picture(run, velocity, drop / weight, fixed / weight), "fluidised_bed")
    print(f"pressure drop over submerged weight, fluidised (1 is expected): {np.mean(drop[:10]) / weight:.3f}")


def picture(run, velocity: np.ndarray, measured: np.ndarray, fixed: np.ndarray, frames=(0, 20, 62)):
    """Pressure drops over the submerged weight against the velocity, and the bed at three outputs."""
    figure = plt.figure(figsize=(10.4, 4.8), layout="constrained")
    curve, *panels = figure.subplots(1, 4, width_ratios=(2.6, 1, 1, 1))
    curve.plot(1e3 * velocity, measured, "o", ms=4, label="measured")
    curve.plot(1e3 * velocity, fixed, "k--", lw=1, label="Ergun, fixed bed")
    curve.axhline(1.0, color="k", lw=0.8, label="submerged weight")
    curve.set(xlabel="superficial velocity [mm/s]", ylabel="pressure drop over weight [-]", ylim=(0, 1.6))
    curve.legend()
    for axis, frame in zip(panels, frames, strict=True):
        grains, water = draw(axis, run, frame, fastest_grain=0.03, fastest_water=0.1)
        axis.locator_params(axis="x", nbins=2)
    panels[0].set_ylabel("height [m]")
    panels[0].tick_params(labelleft=True)
    figure.colorbar(grains, ax=panels, label="grain speed [m/s]", shrink=0.8, extend="max")
    figure.colorbar(water, ax=panels, label="water speed [m/s]", shrink=0.8, extend="max")
    return figure


if __name__ == "__main__":
    main()

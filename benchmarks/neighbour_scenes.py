"""What a closure of neighbours changes in runs: a stream through fixed grains, and grains that settle.

    python benchmarks/neighbour_scenes.py [--closure scenes/neighbours.closure.h5] [--scenes stream settling]

Both scenes are boxes of 12 diameters that are periodic on all sides, with 660 grains (solid fraction 0.2). Each runs
with Tang's law alone and with the closure, which has this law as its mean law.

- stream: grains too heavy to move in a stream of a given volume flow, Re 10. After 30 intervals the fluid is steady.
  The mean force on a grain is then that of the law in a homogeneous array; the scatter between grains is compared with
  that of the particle-resolved data at this Re and solid fraction.
- settling: `scenes/suspension.toml`. Velocities of the grains between 0.05 s, when they have their speed, and 0.2 s,
  before columns of the mesh convect.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem
from benchmarks.neighbours import SIDES, scattered
from jaxdem.closures import NeighborClosure, load_closure
from jaxdem.scene.reading import load_scene

DIAMETER, SIDE, COUNT, NU, RHO = 1e-3, 12.0, 660, 1e-6, 1000.0
REYNOLDS, HEAVY = 10.0, 1e9
INTERVALS = {"stream": (30, 30), "settling": (5, 20)}
"""First and last interval whose figures count."""


class Figures(NamedTuple):
    """Of one interval.

    Attributes:
        speed: mean superficial slip of the grains [m/s].
        force: mean force of the whole fluid along the slip [N].
        along, across: standard deviations of the force over that mean, of one component across.
        vertical, horizontal: standard deviations of the velocities of the grains over the mean superficial slip.
        outside: fraction of grains out of range.
        near: mean of P2(cos) of the angle between slip and the line between grains nearer than 1.5 diameters.
    """

    speed: float
    force: float
    along: float
    across: float
    vertical: float
    horizontal: float
    outside: float
    near: float


def stream() -> jaxdem.Scene:
    """Heavy grains in a stream along the first axis."""
    return jaxdem.Scene.model_validate(
        {
            "precision": "float32",
            "domain": {"size": [SIDE * DIAMETER] * 3, "gravity": [0.0, 0.0, 0.0]},
            "particles": {
                "radius": DIAMETER / 2,
                "density": HEAVY,
                "position": (scattered(COUNT, SIDE) * DIAMETER).tolist(),
            },
            "contact": {"young_modulus": 1e4, "friction": 0.1, "speed": 1e-9},
            "fluid": {
                "cells": [5, 5, 5],
                "viscosity": NU,
                "density": RHO,
                "time_step": 0.01,
                "bulk_velocity": [REYNOLDS * NU / DIAMETER, 0.0, 0.0],
                "velocity": [1.25 * REYNOLDS * NU / DIAMETER, 0.0, 0.0],
            },
            "boundary": {name: {"kind": "periodic"} for name in SIDES},
            "coupling": {"drag": "tang", "kernel_width": {"diameters": 1.5, "cells": 0.5}},
            "time": {"end": 0.3, "output_interval": 0.3},
        }
    )


def measured(position: np.ndarray, velocity: np.ndarray, found: Any, axis: int) -> Figures:
    """Figures of an interval from places, velocities and diagnostics."""
    inputs = found.forces.inputs
    slip = np.asarray(inputs.fluid_velocity - inputs.particle_velocity, np.float64)
    superficial = (1.0 - np.asarray(inputs.solid_fraction, np.float64))[:, None] * slip
    mean = superficial.mean(axis=0)
    speed = float(np.linalg.norm(mean))
    sign = np.sign(mean[axis])
    force = np.asarray(found.forces.drag + found.forces.pressure_gradient, np.float64)
    across = [k for k in range(3) if k != axis]
    whole = sign * force[:, axis].mean()
    apart = position[None] - position[:, None]
    apart -= SIDE * DIAMETER * np.round(apart / (SIDE * DIAMETER))
    distance = np.linalg.norm(apart, axis=2) + 1e9 * np.eye(len(position))
    cosine = (apart[..., axis] / distance)[distance < 1.5 * DIAMETER]
    return Figures(
        speed,
        whole,
        force[:, axis].std() / whole,
        float(np.sqrt((force[:, across] ** 2).mean())) / whole,
        velocity[:, axis].std() / speed,
        float(np.sqrt((velocity[:, across] - velocity[:, across].mean(axis=0)).var())) / speed,
        int(found.exchange.out_of_range) / len(position),
        float((1.5 * cosine**2 - 0.5).mean()),
    )


def run(scene: jaxdem.Scene, closure: NeighborClosure | None, axis: int, counted: tuple[int, int]) -> list[Figures]:
    """Figures of the intervals that count."""
    options = {} if closure is None else {"closure": closure}
    simulation, parameters = jaxdem.build(scene, **options)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    step = jax.jit(lambda parameters, state, neighbors: simulation.step(parameters, state, neighbors))
    found = []
    for interval in range(1, counted[1] + 1):
        before = state.particles
        state, neighbors, diagnostics = step(parameters, state, neighbors)
        if interval >= counted[0]:
            places, velocity = (
                np.asarray(jnp.stack(part, -1) if isinstance(part, tuple) else part, np.float64)
                for part in (before.position, before.velocity)
            )
            found.append(measured(places, velocity, diagnostics, axis))
    return found


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--closure", default="scenes/neighbours.closure.h5")
    parser.add_argument("--scenes", nargs="*", default=list(INTERVALS), choices=list(INTERVALS))
    options = parser.parse_args()
    closure = load_closure(options.closure)[0]
    for name in options.scenes:
        scene, axis = (stream(), 0) if name == "stream" else (load_scene("scenes/suspension.toml"), 2)
        for label, law in (("law alone", None), ("closure", closure)):
            begin = time.process_time()
            rows = np.array(run(scene, law, axis, INTERVALS[name]))
            values = ", ".join(
                f"{field} {value:.4g}" for field, value in zip(Figures._fields, rows.mean(axis=0), strict=True)
            )
            print(f"{name}, {label}: {values}; {time.process_time() - begin:.0f} s", flush=True)


if __name__ == "__main__":
    main()

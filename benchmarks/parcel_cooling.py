"""How fast an agitated gas of parcels loses its energy, beside that of its grains (`contact.parcel_loss`).

    python benchmarks/parcel_cooling.py [--ratio 2] [--restitution 0.9]

400 smooth discs in a periodic box without a fluid, area fraction 0.25. The gas of grains is the same picture: radii
of grains that are l times smaller, seen l times larger, so that its time runs l times as long.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # run as a script from anywhere

import jaxdem

RADIUS, ALONG, AREA_FRACTION, SPEED = 1e-3, 20, 0.25, 0.1
"""Of a disc [m]; discs along a side at the start; of the box; one component of the velocities [m/s]."""
INTERVAL, INTERVALS = 0.02, 12
"""Coupling interval [s], and the number of them for parcels."""


def logarithm_lost(ratio: float, restitution: float, loss: str, intervals: int) -> float:
    """ln(E_0 / E) of the kinetic energy after some intervals."""
    side = float(np.sqrt(ALONG**2 * np.pi * RADIUS**2 / AREA_FRACTION))
    generator, spacing = np.random.default_rng(0), side / ALONG
    line = (np.arange(ALONG) + 0.5) * spacing
    position = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    position = position + generator.uniform(-0.3, 0.3, position.shape) * (spacing - 2.0 * RADIUS)
    velocity = generator.normal(0.0, SPEED, position.shape)
    velocity -= velocity.mean(axis=0)
    end = intervals * INTERVAL
    scene = jaxdem.load_scene(
        {
            "precision": "float32",
            "domain": {"size": [side, side], "gravity": [0.0, 0.0]},
            "particles": {
                "radius": RADIUS / ratio,
                "density": 2500.0,
                "position": position.tolist(),
                "velocity": velocity.tolist(),
                "coarse_grain": ratio,
            },
            "contact": {
                "young_modulus": 5e4,
                "restitution": restitution,
                "friction": 0.0,
                "speed": 4.0 * SPEED,
                "parcel_loss": loss,
            },
            "boundary": {name: {"kind": "periodic"} for name in ("left", "right", "bottom", "top")},
            "coupling": {"interval": INTERVAL},
            "time": {"end": end, "output_interval": end},
        }
    )
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    step = jax.jit(simulation.step)
    for _ in range(intervals):
        state, neighbors, _ = step(parameters, state, neighbors)
    return float(-np.log(np.sum(np.asarray(state.particles.velocity) ** 2) / np.sum(velocity**2)))


def main() -> None:
    """Print the losses."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ratio", type=int, default=2)
    parser.add_argument("--restitution", type=float, default=0.9)
    options = parser.parse_args()
    grains = logarithm_lost(1.0, options.restitution, "impact", options.ratio * INTERVALS)
    print(f"grains: ln(E_0 / E) = {grains:.3f}", flush=True)
    for loss in ("impact", "rate"):
        found = logarithm_lost(float(options.ratio), options.restitution, loss, INTERVALS)
        print(f"parcels, {loss}: {found:.3f}, {found / grains:.3f} of that of the grains", flush=True)


if __name__ == "__main__":
    main()

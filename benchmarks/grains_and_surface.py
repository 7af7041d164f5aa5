"""Grains in two fluids at the size of scenes: what is kept, and gradients through the motion of the surface.

    python benchmarks/grains_and_surface.py

- `scenes/collapse_into_water.toml` and `scenes/dam_break_over_grains.toml` in float64 up to 0.4 s: the liquid's volume,
  how far its fraction is outside of 0 ... 1, and the balance of the exchange.
- Grains that shoot through both surfaces of a periodic 3-D box without gravity: momentum of the three phases over that
  of the grains, volume of the liquid.
- A grain that falls into the liquid and one that rises in it, 12 intervals: derivative of their heights and of the
  liquid's by density and viscosity of the fluids, against central differences.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # run as a script from anywhere

jax.config.update("jax_enable_x64", True)

import jaxdem  # noqa: E402 - after the setting
from benchmarks import harness  # noqa: E402
from tests.cases.grains_in_two_fluids import SIZE, after, liquid, momentum, tables  # noqa: E402

SCENES = ("collapse_into_water", "dam_break_over_grains")


def kept_in_scenes() -> dict[str, dict[str, float]]:
    """What the summaries of the two scenes say."""
    found = {}
    for name in SCENES:
        scene = jaxdem.load_scene(ROOT / "scenes" / f"{name}.toml").tables()
        scene["precision"] = "float64"
        scene["time"] |= {"end": 0.4, "output_interval": 0.04}
        with tempfile.TemporaryDirectory() as folder:
            summary = jaxdem.simulate(jaxdem.load_scene(scene), Path(folder) / "run").summary
        phase = summary["liquid_phase"]
        found[name] = {
            "volume": phase["missing_relative"],
            "beyond bounds": phase["beyond_bounds"],
            "exchange of momentum": summary["residuals"]["momentum"],
            "Courant number": summary["time_steps"]["courant_max"],
        }
    return found


def kept_in_3d() -> dict[str, float]:
    """Grains of a third of a cell that stir up both fluids."""
    size = [0.06, 0.06, 0.08]
    grains = [(0.012, 0.01, 0.02), (0.03, 0.02, 0.035), (0.05, 0.03, 0.06)]
    names = ("left", "right", "front", "back", "bottom", "top")
    scene = tables(
        grains, 0.045, 2500.0, 4e-3, domain={"size": size, "depth": None, "gravity": [0.0, 0.0, 0.0]},
        fluid={"cells": [6, 6, 8], "viscosity": 3e-4}, surface={"viscosity": 1e-2},
        boundary={name: {"kind": "periodic"} for name in names},
    )  # fmt: skip
    del scene["domain"]["depth"]
    speeds = jnp.asarray([[0.3, 0.1, 0.5], [-0.2, 0.2, 0.4], [0.1, -0.3, -0.6]])

    def shot(state: Any) -> Any:
        return state._replace(particles=state.particles._replace(velocity=speeds))

    simulation, parameters, start, end = after(scene, 60, shot)
    before, later = (momentum(simulation, parameters, state) for state in (start, end))
    scale = float(jnp.sum(parameters.mixture.bodies.mass * jnp.abs(speeds)))
    return {
        "momentum": float(np.abs(sum(later) - sum(before)).max()) / scale,
        "given to the fluids": float(np.abs(later[1] - before[1]).max()) / scale,
        "volume": liquid(simulation, end) / liquid(simulation, start) - 1.0,
        "fraction moved": float(jnp.abs(end.fluid.liquid_fraction - start.fluid.liquid_fraction).max()),
    }


def slopes() -> dict[str, list[float]]:
    """Of 12 intervals, by factors on the gas's density, its viscosity, and the liquid's viscosity."""
    thin = {"fluid": {"viscosity": 1e-4}, "surface": {"viscosity": 1e-3}}
    places = [(0.02, 0.064), (0.045, 0.03)]
    scene = jaxdem.load_scene(tables(places, 0.0625, 2500.0, 3e-3, domain={"size": SIZE, "depth": 0.01}, **thin))
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    particles = state.particles._replace(velocity=jnp.asarray([[0.0, -0.4], [0.1, 0.2]]))
    state, flow = state._replace(particles=particles), parameters.flow

    def heights(factors: jax.Array) -> jax.Array:
        second = flow.second._replace(
            density=flow.second.density * factors[0], viscosity=flow.second.viscosity * factors[1]
        )
        fluid = parameters.fluid._replace(second=second, viscosity=flow.viscosity * factors[2])
        end = jaxdem.rollout(simulation, parameters._replace(fluid=fluid), state, neighbors, 12).state
        rows = jnp.arange(end.fluid.liquid_fraction.shape[1], dtype=factors.dtype)
        return jnp.sum(end.particles.position[:, 1]) + 1e-3 * jnp.sum(end.fluid.liquid_fraction * rows[None, :])

    one, value, step = jnp.ones(3), jax.jit(heights), 1e-4
    exact = jax.jit(jax.grad(heights))(one)
    central = [(value(one.at[k].add(step)) - value(one.at[k].add(-step))) / (2.0 * step) for k in range(3)]
    return {"derivative": [float(x) for x in exact], "central difference": [float(x) for x in central]}


def main() -> None:
    """All of them."""
    result: dict[str, Any] = {"3-D": kept_in_3d(), "slopes": slopes(), **kept_in_scenes()}
    rows = ["| case | figure | value |", "| --- | --- | --- |"]
    for name in (*SCENES, "3-D"):
        rows += [f"| {name} | {figure} | {value:.2g} |" for figure, value in result[name].items()]
    pairs = zip(*result["slopes"].values(), strict=True)
    for name, (exact, central) in zip(("gas density", "gas viscosity", "liquid viscosity"), pairs, strict=True):
        rows.append(f"| derivative by the {name} | over its central difference, less 1 | {exact / central - 1.0:.1e} |")
    harness.write("grains_and_surface", result, "\n".join(rows) + "\n")


if __name__ == "__main__":
    main()

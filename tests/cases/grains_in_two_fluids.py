"""Grains in two fluids between walls, step by step: the scene, the states, volume of the liquid and momentum."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxdem
from jaxdem.failures import failures
from jaxdem.fluid.grid import face_average, face_total
from jaxdem.fluid.second_fluid import mixture_density
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State

CONTACT = {"young_modulus": 2e5, "poisson_ratio": 0.25, "friction": 0.3, "restitution": 0.2, "speed": 0.1}
CELLS, SIZE = [6, 12], [0.06, 0.12]


def tables(grains: Any, level: float, density: Any = 2500.0, radius: float = 1e-4, **changes: Any) -> dict[str, Any]:
    """Grains at places in oil below a level and a viscous gas above it, between walls."""
    scene: dict[str, Any] = {
        "precision": "float64",
        "domain": {"size": SIZE, "depth": 1.0},
        "particles": {"radius": radius, "density": density, "position": [list(g) for g in grains]},
        "contact": CONTACT,
        "fluid": {"cells": CELLS, "density": 1000.0, "viscosity": 1e-3, "time_step": 1e-3},
        "surface": {"density": 10.0, "viscosity": 1e-2, "level": level},
        "coupling": {"drag": "stokes", "interval": 1e-3},
        "time": {"end": 1.0, "output_interval": 0.1},
    }
    for key, value in changes.items():
        scene[key] = {**scene.get(key, {}), **value}
    return scene


@jax.jit
def march(
    simulation: Simulation, parameters: Parameters, state: State, neighbors: Any, steps: int
) -> tuple[State, jax.Array]:
    """The state after so many intervals, and whether anything failed; one program for all numbers of them."""

    def one(_: Any, carry: Any) -> Any:
        state, neighbors, code = carry
        state, neighbors, diagnostics = simulation.step(parameters, state, neighbors)
        return state, neighbors, code | failures(simulation, diagnostics)

    state, _, code = jax.lax.fori_loop(0, steps, one, (state, neighbors, jnp.zeros((), jnp.int32)))
    return state, code


def after(
    tables: dict[str, Any], steps: int, change: Callable[[State], State] = lambda state: state
) -> tuple[Simulation, Parameters, State, State]:
    """Simulation, parameters, the first state and that after so many intervals."""
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    start, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    start = change(start)
    end, code = march(simulation, parameters, start, neighbors, steps)
    assert int(code) == 0
    return simulation, parameters, start, end


def liquid(simulation: Simulation, state: State) -> float:
    """Volume of the liquid [m3]."""
    grid = simulation.fluid.solver.grid
    return float(jnp.sum(state.fluid.void_fraction * state.fluid.liquid_fraction)) * grid.cell_volume


def momentum(simulation: Simulation, parameters: Parameters, state: State) -> tuple[np.ndarray, np.ndarray]:
    """Of both fluids and the grains [kg m/s]."""
    grid, flow, fluid = simulation.fluid.solver.grid, parameters.flow, state.fluid
    mass = fluid.void_fraction * mixture_density(flow.second, flow.density, fluid.liquid_fraction)
    on_faces = face_average(grid, mass)
    carried = face_total(grid, tuple(m * u for m, u in zip(on_faces, fluid.face_velocity, strict=True)))
    bodies = parameters.mixture.bodies
    grains = jnp.sum(bodies.mass * state.particles.velocity, axis=0)
    return grid.cell_volume * np.asarray(jnp.stack(carried)), np.asarray(grains)


def layer_under_a_lake(level: float) -> dict[str, Any]:
    """A layer of grains on the floor, held by its contacts, under a still lake or with the surface within it."""
    grains = [(x, 0.004) for x in (0.006, 0.018, 0.03, 0.042, 0.054)]
    return tables(grains, level, 2500.0, 4e-3, domain={"size": SIZE, "depth": 0.01}, fluid={"viscosity": 1e-2})


def dry_bed_and_a_column() -> dict[str, Any]:
    """Cells full of grains that hold gas, and a column of liquid that is let go above them."""
    grains = [(0.004 + 0.0083 * k, 0.004 + 0.0081 * row) for row in range(3) for k in range(7)]
    scene = tables(
        grains, 0.0, 2500.0, 4e-3, domain={"size": SIZE, "depth": 0.008},
        surface={"regions": [{"shape": "box", "start": [0.0, 0.035], "stop": [0.04, 0.075]}]},
    )  # fmt: skip
    del scene["surface"]["level"]
    return scene

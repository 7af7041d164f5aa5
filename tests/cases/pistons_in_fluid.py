"""Walls that a force holds in the fluid: a piston before a column of water, and a plate on a layer."""

from __future__ import annotations

import numpy as np

from jaxdem import build, initial_state, load_scene
from tests.cases.registry import case, relative
from tests.cases.steps import compiled_step

DENSITY, DEPTH, STEP = 1000.0, 0.02, 0.005
"""Of the water [kg/m3], of the slab [m], and of the coupling [s]."""


def scene_of(wall, size, cells, **changes):
    """A box of water with a wall and one grain of the same density, which goes along with it."""
    given = {
        "precision": "float64",
        "domain": {"size": size, "depth": DEPTH, "gravity": [0.0, 0.0]},
        "particles": {"radius": 0.002, "density": DENSITY, "position": [[0.3, 0.1]]},
        "contact": {"young_modulus": 1e5, "speed": 0.1},
        "coupling": {"interval": STEP},
        "fluid": {"cells": cells, "density": DENSITY, "viscosity": 1e-6, "time_step": STEP},
        "walls": [wall],
        "time": {"end": 2.0, "output_interval": 0.1},
    }
    for key, value in changes.items():
        given[key] = given.get(key, {}) | value
    return given


def march(given, steps):
    """Displacement and velocity of the piston after every interval, (steps, 2), and the last state and report."""
    scene = load_scene(given)
    simulation, parameters = build(scene)
    state, neighbors = initial_state(scene, simulation, parameters)
    step, found = compiled_step(simulation), []
    for _ in range(steps):
        state, neighbors, told = step(parameters, state, neighbors)
        pistons = state.particles.pistons
        found.append([float(pistons.displacement[0]), float(pistons.velocity[0])])
    return np.asarray(found), state, told


def before_column(mass, cells=20):
    """A scene of a piston of a mass [kg], pushed by 2 N towards water 0.35 m long and 0.2 m high."""
    wall = {
        "kind": "plane", "point": [0.05, 0.0], "normal": [1.0, 0.0], "fluid": "free_slip",
        "piston": {"direction": [1.0, 0.0], "force": 2.0, "mass": mass},
    }  # fmt: skip
    sides = {"right": {"kind": "outlet"}, "top": {"kind": "free_slip"}, "bottom": {"kind": "free_slip"}}
    return scene_of(wall, [0.4, 0.2], [cells, cells // 2], boundary=sides)


def column(mass, steps):
    """Its displacement and velocity, (m + rho A (l - x)) dv/dt = F, by small steps."""
    x, v, found, h = 0.0, 0.0, [], STEP / 50
    for _ in range(steps):
        for _ in range(50):
            a = 2.0 / (mass + DENSITY * DEPTH * 0.2 * (0.35 - x))
            x, v = x + h * (v + 0.5 * h * a), v + h * a
        found.append([x, v])
    return np.asarray(found)


@case(
    "Piston before a column of water",
    "fluid",
    "closed form: (m + rho A (l - x)) dv/dt = F, with 1.4 kg of water",
    fast={"masses": (0.01,), "cells": 20, "gate": 0.015},
)
def light_piston(masses=(10.0, 1.0, 0.1, 0.001), cells=80, gate=0.005):
    """Speed after 16 coupling intervals; the mass of the column is right to a part of a cell."""
    found = []
    for mass in masses:
        got, _, _ = march(before_column(mass, cells), 16)
        found.append(relative(f"speed, piston of {mass:g} kg", column(mass, 16)[-1, 1], got[-1, 1], gate, "m/s"))
    return found


@case(
    "Plate that a force draws over a layer",
    "fluid",
    "closed form: F h/(mu A)",
    fast={"cells": (10,), "steps": 240},
)
def drawn_plate(cells=(10, 20), steps=400):
    """Terminal speed of a plate with the mass of a cell's water or less, a quarter of a cell off the grid lines."""
    viscosity, width, found = 0.02, 0.04, []
    for n in cells:
        height = 0.1 - 0.15 / n
        plate = {
            "kind": "plane", "point": [0.0, height], "normal": [0.0, -1.0], "fluid": "no_slip",
            "piston": {"direction": [1.0, 0.0], "force": 0.1, "mass": 0.01},
        }  # fmt: skip
        sides = {"left": {"kind": "periodic"}, "right": {"kind": "periodic"}}
        grain = {"position": [[0.02, 0.02]], "radius": 0.0005}
        shorter = (n // cells[0]) ** 2  # Viscosity limits the step by the square of the cells.
        own = {"viscosity": viscosity, "time_step": STEP / shorter}
        given = scene_of(
            plate, [width, 0.1], [4, n], boundary=sides, fluid=own, particles=grain,
            coupling={"interval": STEP / shorter},
        )  # fmt: skip
        got, _, _ = march(given, steps * shorter)
        speed = 0.1 * height / (DENSITY * viscosity * width * DEPTH)
        # The slowest part has decayed, with nu (pi/2 h)^2, to 4e-4 after 240 intervals; the grain is 1e-4 of the layer.
        found.append(relative(f"speed, {n} cells", speed, got[-1, 1], 0.003, "m/s"))
    return found

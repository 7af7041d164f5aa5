"""Walls that move in the fluid, and meshes in it, from scenes: against closed forms and against each other."""

from __future__ import annotations

import math

import jax
import numpy as np

from jaxdem import build, initial_state, load_scene
from tests.cases.registry import absolute, case, relative

DIAMETER, SPEED, VISCOSITY = 0.1, 0.1, 5e-4
"""Of a cylinder at Re = 20 [m], [m/s], [m2/s]."""


def marched(given, steps, every=1):
    """Loads on the first surface, (steps / every, D), and the last state, of a scene without grains."""
    scene = load_scene(given)
    simulation, parameters = build(scene)
    state, _ = initial_state(scene, simulation, parameters)

    @jax.jit
    def on(state):
        def body(state, _):
            state, _, told = simulation.step(parameters, state, None)
            return state, told.fluid.surface_load[0, :, 0]

        return jax.lax.scan(body, state, None, length=every)

    loads = []
    for _ in range(steps // every):
        state, load = on(state)
        loads.append(np.asarray(load).mean(axis=0))
    return np.asarray(loads), state, simulation


def stream(wall, moves, cells, size=(16, 8)):
    """A scene of a cylinder of the diameter in a box with free-slip sides: in a stream, or moving through fluid at
    rest."""
    inlet = {"kind": "inlet", "velocity": [SPEED, 0.0], "ramp_time": 0.0}
    # Before the body nothing flows through the box in its own frame of rest: else it would drag all of the fluid along.
    ends = {"left": {"kind": "free_slip"} if moves else inlet, "right": {"kind": "outlet"}}
    return {
        "precision": "float64",
        "domain": {"size": [n * DIAMETER for n in size], "depth": 1.0, "gravity": [0.0, 0.0]},
        "fluid": {
            "cells": [n * cells for n in size],
            "density": 1.0,
            "viscosity": VISCOSITY,
            "velocity": [0.0 if moves else SPEED, 0.0],
            "time_step": 0.4 * DIAMETER / cells / (2.0 * SPEED),
            "advection": "central",
        },
        "walls": [wall],
        "boundary": ends | {name: {"kind": "free_slip"} for name in ("top", "bottom")},
        "time": {"end": 6.0, "output_interval": 0.1},
    }


def cylinder(x):
    """A cylinder in the middle of the height, a little off the grid lines."""
    centre = [x, 4.013 * DIAMETER]
    return {
        "kind": "cylinder",
        "center": centre,
        "radius": 0.5 * DIAMETER,
        "inside": False,
        "fluid": "no_slip",
    }


def drag(wall, moves, cells, time=4.0):
    """Drag coefficient, mean over the last diameter of `time` D/U after a sudden start."""
    given = stream(wall, moves, cells)
    simulation, _ = build(load_scene(given))
    steps = round(time * DIAMETER / SPEED / simulation.interval)
    loads, _, _ = marched(given, steps)
    last = loads[-round(steps / time) :, 0].mean()
    return abs(last) / (0.5 * SPEED**2 * DIAMETER)


@case(
    "Cylinder that moves through fluid at rest",
    "fluid",
    "Galileo: the same cylinder at rest in a stream",
    fast=None,
    tested=False,
)
def moving_cylinder(cells=(10,)):
    """Drag at Re = 20 after a sudden start, in both frames."""
    found = []
    for n in cells:
        still = drag(cylinder(5.0 * DIAMETER), False, n)
        moving = cylinder(9.0 * DIAMETER)
        moving["motion"] = [{"kind": "translation", "velocity": [-SPEED, 0.0]}]
        found.append(relative(f"drag, {n} cells a diameter", still, drag(moving, True, n), 0.03))
    return found


@case(
    "Cylinder as a mesh of lines in a stream",
    "fluid",
    "the analytic cylinder of the same area",
    fast=None,
    tested=False,
)
def polygon_in_stream(corners=(16, 64), gates=(0.02, 0.003), cells=10):
    """Drag at Re = 20 of polygons."""
    wall = cylinder(5.0 * DIAMETER)
    exact, found = drag(wall, False, cells), []
    for count, gate in zip(corners, gates, strict=True):
        angle = 2.0 * np.pi * (np.arange(count) + 0.37) / count
        radius = 0.5 * DIAMETER * math.sqrt(2.0 * np.pi / (count * math.sin(2.0 * np.pi / count)))
        points = np.asarray(wall["center"]) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        mesh = {"kind": "mesh", "points": points.tolist(), "closed": True, "fluid": "no_slip"}
        found.append(relative(f"drag, {count} corners", exact, drag(mesh, False, cells), gate))
    return found


@case("Stokes's layer over a wall that swings in its own plane", "fluid", "closed form", fast=None, tested=False)
def oscillating_wall(cells=(24, 48), gates=(0.01, 0.005)):
    """Largest error of the velocity over the speed of the wall, after five periods; 1/k is 15 % of the box."""
    found, rate, viscosity, amplitude, height = [], 2.0 * np.pi, 4e-3, 0.05, 0.24
    for n, gate in zip(cells, gates, strict=True):
        h = height / n
        place = 1.7 * h
        wall = {"kind": "plane", "point": [0.0, place], "normal": [0.0, 1.0], "fluid": "no_slip"}
        wall["motion"] = [{"kind": "oscillation", "direction": [1.0, 0.0], "amplitude": amplitude, "frequency": 1.0}]
        given = {
            "precision": "float64",
            "domain": {"size": [2.0 * h, height], "depth": 1.0, "gravity": [0.0, 0.0]},
            "fluid": {"cells": [2, n], "density": 1.0, "viscosity": viscosity, "time_step": 0.0025 * (24 / n) ** 2},
            "walls": [wall],
            "boundary": {"left": {"kind": "periodic"}, "right": {"kind": "periodic"}},
            "time": {"end": 6.0, "output_interval": 0.1},
        }
        simulation, _ = build(load_scene(given))
        steps = round(5.0 / simulation.interval)
        _, state, _ = marched(given, steps, steps)
        k, y = math.sqrt(rate / (2.0 * viscosity)), (np.arange(n) + 0.5) * h - place
        exact = rate * amplitude * np.exp(-k * y) * np.cos(rate * 5.0 - k * y)
        error = np.abs(np.asarray(state.fluid.face_velocity[0])[0] - exact)[y > 0.0].max()
        found.append(absolute(f"velocity, {n} cells", 0.0, error / (rate * amplitude), gate))
    return found

"""Fixed beds in a round pipe that the fluid sees: their pressure drop against Ergun's equation."""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import numpy as np

from jaxdem import build, initial_state, load_scene
from tests.cases.beds import ergun_drop
from tests.cases.registry import DATA, case, relative


class Stream(NamedTuple):
    """A stream through a bed.

    Attributes:
        speed: superficial [m/s].
        density: [kg/m3].
        viscosity: kinematic [m2/s].
    """

    speed: float = 0.02
    density: float = 1000.0
    viscosity: float = 1e-6


def bed_drop(walls, side, height, mesh, positions, diameter, stream=Stream(), speed="auto"):  # noqa: B008
    """Pressure drop of a bed of grains that stand still in a stream along z, between two heights [Pa/m].

    Args:
        walls: tables of the scene.
        side: width of the box [m].
        height: of the box, which the bed fills [m].
        mesh: cells along each axis.
        positions: (N, 3) [m].
        diameter: of the grains [m].
        stream: the fluid.
        speed: of impacts as deep as the grains reach into each other [m/s].
    """
    given = {
        "precision": "float64",
        "domain": {"size": [side, side, height], "gravity": [0.0, 0.0, 0.0]},
        "fluid": {
            "cells": list(mesh), "density": stream.density, "viscosity": stream.viscosity, "time_step": 2e-3,
        },
        "particles": {"radius": 0.5 * diameter, "density": 1e9, "position": np.asarray(positions).tolist()},
        "contact": {"young_modulus": 1e9, "maximum_overlap": 0.5, "time_step": 1e-4, "speed": speed},
        "coupling": {"drag": "ergun"},
        "walls": walls,
        "boundary": {name: {"kind": "free_slip"} for name in ("left", "right", "front", "back")}
        | {"bottom": {"kind": "inlet", "velocity": [0.0, 0.0, stream.speed]}, "top": {"kind": "outlet"}},
        "time": {"end": 0.02, "output_interval": 0.02},
    }  # fmt: skip
    scene = load_scene(given)
    simulation, parameters = build(scene)
    state, _ = initial_state(scene, simulation, parameters)
    advance = jax.jit(lambda fluid: simulation.coupling.advance(parameters.mixture, fluid, state.particles, 1.0)[0])
    fluid = state.fluid
    for _ in range(12):
        fluid = advance(fluid)
    pressure, cut = np.asarray(fluid.pressure), parameters.fluid.cut
    weight = np.ones(pressure.shape) if cut is None else np.asarray(cut.open_cells)
    profile = (pressure * weight).sum(axis=(0, 1)) / weight.sum(axis=(0, 1))
    first, last = len(profile) // 4, 3 * len(profile) // 4
    return (profile[first] - profile[last]) / ((last - first) * height / len(profile))


BED_SPACING = 0.006
"""Distance of the layers of grains [m]."""


def pipe_wall(side, radius):
    """A smooth pipe along z in the middle of the box."""
    axis = {"kind": "cylinder", "center": [0.5 * side, 0.5 * side, 0.0], "radius": radius, "axis": [0.0, 0.0, 1.0]}
    return axis | {"fluid": "free_slip"}


def spiral(count, layers, radius, side, spacing):
    """Centres of as many grains in every layer, evenly in a pipe: on a spiral with the golden angle, (N, 3) [m]."""
    k = np.arange(count)
    spread, angle = radius * np.sqrt((k + 0.5) / count), math.pi * (3.0 - math.sqrt(5.0)) * k
    layer = np.stack([0.5 * side + spread * np.cos(angle), 0.5 * side + spread * np.sin(angle)], axis=-1)
    heights = (np.arange(layers) + 0.5) * spacing
    return np.concatenate([np.column_stack([layer, np.full(count, z)]) for z in heights])


@case(
    "Fixed bed in a round pipe and in a square duct",
    "exchange",
    "Ergun's equation, and the same area",
    fast={"mesh": (16, 16, 16), "layers": 8, "count": 8, "with_duct": False},
)
def bed_in_pipe(mesh=(16, 16, 32), layers=16, count=14, with_duct=True):
    """The pressure drop in both, against each other and against Ergun's equation for the superficial velocity.

    The duct has the pressure drop of Ergun's equation to 1e-6, so the tests save themselves its program.
    """
    diameter = (6.0 * 0.3 / math.pi) ** (1.0 / 3.0) * BED_SPACING
    duct = count * BED_SPACING
    radius = duct / math.sqrt(math.pi)
    heights = (np.arange(layers) + 0.5) * BED_SPACING
    grid = (np.arange(count) + 0.5) * BED_SPACING
    in_duct = np.stack([x.ravel() for x in np.meshgrid(grid, grid, heights, indexing="ij")], axis=-1)
    side, height = 2.04 * radius, layers * BED_SPACING
    in_pipe = spiral(count**2, layers, radius, side, BED_SPACING)
    drop = bed_drop([pipe_wall(side, radius)], side, height, mesh, in_pipe, diameter)
    ergun = ergun_drop(0.3, diameter, 1e-6, 0.02)
    found = [relative("pressure drop of the pipe", ergun, drop, 0.01, "Pa/m")]
    if with_duct:
        of_duct = bed_drop([], duct, height, mesh, in_duct, diameter)
        found.insert(0, relative("pressure drop of the pipe over that of the duct", 1.0, drop / of_duct, 0.01))
    return found


@case(
    "Bed of CFDEM's Ergun case in a round pipe",
    "exchange",
    "Ergun's equation with the numbers of ErgunTestMPI of CFDEMcoupling, below minimum fluidisation",
    fast={"speeds": (0.008,)},
)
def cfdem_bed(speeds=(0.002, 0.008, 0.014), mesh=(16, 16, 10)):
    """Pressure drop of 10,000 spheres of 1 mm, which in 20 layers reach into each other: in a pipe whose section they
    fill to the void fraction and length of the case. Finer cells are filled where spheres lie on each other."""
    table = np.genfromtxt(DATA / "ergun_cfdem.csv", delimiter=",", names=True, skip_header=2)
    length, solids, diameter, layers, found = 0.0156, 1.0 - 0.451335, 1e-3, 20, []
    radius = math.sqrt(10_000 * diameter**3 / 6.0 / (solids * length))
    side = 2.04 * radius
    positions = spiral(500, layers, radius, side, length / layers)
    for speed in speeds:
        stream = Stream(speed, 10.0, 1.5e-4)
        drop = bed_drop([pipe_wall(side, radius)], side, length, mesh, positions, diameter, stream, 0.235)
        expected = float(table["dp_Ergun_Pa"][table["U_superficial_m_s"] == speed][0])
        found.append(relative(f"pressure drop at {speed:g} m/s", expected, drop * length, 0.01, "Pa"))
    return found

"""Scenes of a fluid, with and without particles, on one device and in slabs of the box on several."""

from __future__ import annotations

import random
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from jaxdem.devices.message_order import in_one_order
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.slabs import fluid_in_slabs, fluid_of_slabs
from jaxdem.numerics.blocks import MESH_AXIS, Blocks
from tests.cases.flows import random_faces

SLABS, SAME = PartitionSpec(MESH_AXIS), PartitionSpec()
PERIODIC = {"kind": "periodic"}
ALONG_X = {"left": PERIODIC, "right": PERIODIC}


def fluid_scene(cells: list[int], boundary: dict[str, Any], **fluid: Any) -> dict[str, Any]:
    """A fluid alone on cells of 0.1 m, stirred at random by `stirred`."""
    tables: dict[str, Any] = {
        "precision": "float64",
        "domain": {"size": [0.1 * n for n in cells]},
        "fluid": {"cells": cells, "viscosity": 1e-2, "time_step": 0.01, **fluid},
        "boundary": boundary,
        "time": {"end": 0.1, "output_interval": 0.1},
    }
    if len(cells) == 2:
        tables["domain"]["depth"] = 1.0
    return tables


FLUIDS: dict[str, dict[str, Any]] = {
    "closed": fluid_scene([8, 6], {"top": {"kind": "moving_wall", "velocity": [0.5, 0.0]}}),
    "jet": fluid_scene(
        [8, 6],
        {
            "left": {"kind": "inlet", "velocity": 0.5, "from": 0.05, "to": 0.23, "profile": "parabolic"},
            "right": {"kind": "outlet"},
        },
        advection="central",
        smagorinsky=0.2,
    ),
    "updraft": fluid_scene(
        [8, 6],
        {
            "bottom": {"kind": "inlet", "velocity": 0.5, "from": 0.13, "to": 0.47},
            "top": {"kind": "outlet", "from": 0.1, "to": 0.6},
            "left": {"kind": "free_slip"},
        },
        advection="superbee",
    ),
    "stream": fluid_scene([8, 6], ALONG_X | {"top": {"kind": "free_slip"}}, bulk_velocity=[0.5, 0.0], bed_mixing={}),
    "jet, 3-D": fluid_scene(
        [4, 4, 6],
        {
            "bottom": {"kind": "inlet", "velocity": 0.5, "from": [0.05, 0.05], "to": [0.25, 0.33]},
            "top": {"kind": "outlet"},
        },
    ),
}
"""Every kind of side, drive, eddy viscosity and advection."""


def coupled_scene(dimension: int, boundary: dict[str, Any], model: str = "A", **coupling: Any) -> dict[str, Any]:
    """A dozen grains in a stream."""
    size = [0.4, 0.2] if dimension == 2 else [0.2, 0.1, 0.2]
    tables: dict[str, Any] = {
        "precision": "float64",
        "domain": {"size": size},
        "particles": {"radius": 0.006, "density": 2650.0, "position": places(size)},
        "contact": {"young_modulus": 5e6, "friction": 0.3},
        "fluid": {
            "cells": [8, 4] if dimension == 2 else [8, 4, 8],
            "viscosity": 1e-4,
            "time_step": 0.002,
            "velocity": [0.1, *[0.0] * (dimension - 1)],
            "model": model,
        },
        "boundary": boundary,
        "coupling": coupling,
        "time": {"end": 0.02, "output_interval": 0.02},
    }
    if dimension == 2:
        tables["domain"]["depth"] = 0.04
    return tables


def places(size: list[float], count: int = 12, radius: float = 0.006) -> list[list[float]]:
    """Centres of grains that do not touch, at random; one on the plane that two slabs share."""
    draw, found = random.Random(3), [[0.5 * s for s in size]]
    while len(found) < count:
        x = [draw.uniform(1.2 * radius, s - 1.2 * radius) for s in size]
        if all(sum((a - b) ** 2 for a, b in zip(x, y, strict=True)) > (2.05 * radius) ** 2 for y in found):
            found.append(x)
    return found


def stirred(grid: Grid, fluid: FluidState) -> FluidState:
    """The fluid with a random velocity added, none through walls."""
    more = random_faces(grid)
    faces = tuple(jnp.asarray(u + 0.2 * v) for u, v in zip(fluid.face_velocity, more, strict=True))
    return fluid._replace(face_velocity=faces)


def on_slabs(number, function, given, result):
    """A function of one slab as one of `number` slabs, to be jitted.

    Args:
        number: of slabs, each on a device.
        function: of one slab.
        given: for every argument `SLABS`, or `SAME` for one that is the same in all slabs.
        result: one of the two.
    """
    mesh = Mesh(np.array(jax.devices()[:number]), (MESH_AXIS,))

    def of_one(*arguments):
        arguments = [
            jax.tree.map(lambda x: x[0], a) if spec == SLABS else a for spec, a in zip(given, arguments, strict=True)
        ]
        found = in_one_order(function)(*arguments)
        return jax.tree.map(lambda x: x[None], found) if result == SLABS else found

    return jax.shard_map(of_one, mesh=mesh, in_specs=tuple(given), out_specs=result, check_vma=False)


def run_on_slabs(number, function, given, arguments):
    """What a function of one slab gives in all of them, and the text of the compiled program."""
    mesh = Mesh(np.array(jax.devices()[:number]), (MESH_AXIS,))
    placed = [
        jax.device_put(jax.tree.map(np.asarray, a), NamedSharding(mesh, spec))
        for spec, a in zip(given, arguments, strict=True)
    ]
    compiled = jax.jit(on_slabs(number, function, given, SLABS)).lower(*placed).compile()
    return compiled(*placed), compiled.as_text()


class Comparison(NamedTuple):
    """Largest differences between a fluid in slabs and the fluid on one device, over the largest value."""

    velocity: float
    pressure: float
    void_fraction: float


def compared(blocks: Blocks, slabs: FluidState, fluid: FluidState) -> Comparison:
    """Of a fluid in slabs and one on one device."""
    whole = fluid_of_slabs(blocks, slabs)
    speed = max(float(jnp.abs(u).max()) for u in fluid.face_velocity)
    pairs = zip(whole.face_velocity, fluid.face_velocity, strict=True)
    apart = max(float(np.abs(a - np.asarray(b)).max()) for a, b in pairs)
    largest = max(float(np.abs(fluid.pressure).max()), np.finfo(float).tiny)
    pressure = np.abs(whole.pressure - np.asarray(fluid.pressure)).max() / largest
    void = 0.0 if fluid.void_fraction is None else np.abs(whole.void_fraction - np.asarray(fluid.void_fraction)).max()
    return Comparison(apart / speed, float(pressure), float(void))


def in_slabs(grid: Grid, number: int, axis: int, fluid: FluidState) -> tuple[Blocks, FluidState]:
    """Slabs of a box, and its fluid in them."""
    blocks = Blocks(number, axis, grid.periodic[axis])
    return blocks, fluid_in_slabs(blocks, fluid)

"""What walls that the fluid sees need of memory, and what several devices send because of them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import jax
from jax.extend.core import ClosedJaxpr, Jaxpr
from jax.sharding import AbstractMesh

from jaxdem.devices.mesh import SAME, SLABS, on_slabs
from jaxdem.devices.parameters import in_slabs, spread
from jaxdem.fluid.slabs import fluid_in_slabs
from jaxdem.numerics.blocks import MESH_AXIS, Blocks
from jaxdem.setup.builder import Case
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State

OF_CELLS = "mesh cut by walls"
"""Name of the memory of what walls leave open of the mesh of the fluid; each of several devices has that of its
cells."""

OF_BODIES = "meshes in the fluid"
"""Name of the memory of distances from meshes that move in the fluid; each of several devices has all of them."""


def wall_memory(simulation: Simulation, parameters: Parameters) -> dict[str, int]:
    """Memory of the numbers that walls in the fluid are known by, by name [B]."""
    fluid, scalars = parameters.fluid, parameters.scalars
    if fluid is None or fluid.cut is None:
        return {}
    of_scalars = None if scalars is None else scalars.walls
    known = bytes_of((fluid.cut, fluid.still, of_scalars))
    bodies = 0
    if fluid.still is not None and simulation.walls_in_fluid is not None:
        own = (s.number for s in simulation.walls_in_fluid.change_place if s.shape is not None)
        bodies = bytes_of([fluid.still.distances[number] for number in own])
    return {OF_CELLS: known - bodies, OF_BODIES: bodies}


def bytes_of(tree: object) -> int:
    """Of all arrays of a tree, or of their shapes."""
    return sum(math.prod(leaf.shape) * leaf.dtype.itemsize for leaf in jax.tree.leaves(tree))


def sent_for_walls(case: Case, blocks: Blocks, state: State) -> int:
    """What a slab sends at most in an interval to cut its mesh anew, 0 where all walls keep their place [B].

    The program for it is traced, and what it sends is added up; for that no device is needed.
    """
    walls, fluid = case.simulation.walls_in_fluid, state.fluid
    if walls is None or fluid is None or not walls.change_place:
        return 0
    of_slab = dataclasses.replace(case.simulation, walls_in_fluid=walls.in_blocks(blocks))
    parameters = in_slabs(blocks, walls, case.parameters)
    pistons = None if state.particles is None else state.particles.pistons

    def moved(*given: Any) -> Any:
        now, fluid = of_slab.with_moved_walls(*given)
        return now.flow.cut, fluid

    mesh: Any = AbstractMesh((blocks.number,), (MESH_AXIS,))
    program = on_slabs(mesh, moved, (spread(parameters), SLABS, SAME, SAME), SLABS)
    return sent_by(jax.make_jaxpr(program)(parameters, fluid_in_slabs(blocks, fluid), state.step, pistons).jaxpr)


def sent_by(program: Jaxpr) -> int:
    """What `ppermute` sends in a program of a slab: of branches that which sends most, of a loop that ends on a
    condition once [B]."""
    total = 0
    for equation in program.eqns:
        inner = [sent_by(one) for value in equation.params.values() for one in _programs(value)]
        if equation.primitive.name == "ppermute":
            total += bytes_of([operand.aval for operand in equation.invars])
        elif equation.primitive.name == "cond":
            total += max(inner)
        else:
            total += int(equation.params.get("length", 1)) * sum(inner)
    return total


def _programs(value: Any) -> Iterator[Jaxpr]:
    """Those within a parameter of an equation."""
    for one in value if isinstance(value, tuple | list) else (value,):
        if isinstance(one, ClosedJaxpr):
            yield one.jaxpr
        elif isinstance(one, Jaxpr):
            yield one

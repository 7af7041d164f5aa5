"""Parameters of a box in slabs: of what belongs to cells each slab has its part, all else is the same everywhere."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
from jax.sharding import Mesh, PartitionSpec

from jaxdem.coupling.walls_in_fluid import WallsInFluid
from jaxdem.devices.mesh import SAME, SLABS, on_host, put
from jaxdem.errors import InputError, required
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.fluid_state import StillDistances
from jaxdem.fluid.slabs import (
    cells_in_slabs,
    cells_of_slabs,
    cut_in_slabs,
    cut_of_slabs,
    still_in_slabs,
    still_of_slabs,
)
from jaxdem.numerics.blocks import Blocks
from jaxdem.state import Parameters

OF_CELLS = ("lent", "exchange", "area")
"""Fields of `ScalarWalls` that every cell has an entry of."""


def spread(parameters: Parameters) -> Any:
    """How parameters in slabs are spread over devices: `SAME`, or a tree of `SAME` and `SLABS`, a prefix of them.

    Raises:
        InputError: they are those of one device, and the fluid sees walls.
    """
    fluid = parameters.fluid
    if fluid is None or fluid.cut is None:
        return SAME
    if fluid.cut.open_cells.ndim == len(fluid.cut.open_faces):
        limit = "those of one device have the cells of the whole box beside walls that the fluid sees"
        raise InputError("parameters", "of one device", limit, "take those of jaxdem.build(scene, devices=...)")
    return _changed(parameters, Changes(lambda cut: SLABS, _spread_still, lambda field: SLABS, lambda part: SAME))


def in_slabs(blocks: Blocks, walls: WallsInFluid | None, parameters: Parameters) -> Parameters:
    """Parameters of one device, with arrays of NumPy (B, ...) of what belongs to the cells of B slabs.

    Args:
        blocks: the slabs.
        walls: that the fluid sees and that move; None for none.
        parameters: of one device.
    """
    own = () if walls is None else walls.change_place
    changing = {surface.number for surface in own if surface.shape is not None}

    def of_still(still: StillDistances) -> StillDistances:
        return still_in_slabs(blocks, still, [k not in changing for k in range(len(still.distances))])

    return _changed(parameters, Changes(partial(cut_in_slabs, blocks), of_still, partial(cells_in_slabs, blocks)))


def of_slabs(blocks: Blocks, parameters: Parameters) -> Parameters:
    """Parameters of one device from those in slabs, wherever these are; every process must call it."""

    def cut_of(cut: CutCells) -> CutCells:
        return cut_of_slabs(blocks, on_host(cut))

    def still_of(still: StillDistances) -> StillDistances:
        return still_of_slabs(blocks, on_host(still), _divided(still))

    return _changed(parameters, Changes(cut_of, still_of, lambda field: cells_of_slabs(blocks, on_host(field))))


def cells_on_devices(mesh: Mesh, parameters: Parameters) -> Parameters:
    """What `in_slabs` gives, with the parts of the slabs on their devices."""

    def of_still(still: StillDistances) -> StillDistances:
        parts = zip(still.distances, _divided(still), strict=True)
        distances = tuple(put(mesh, d) if divided else d for d, divided in parts)
        return still._replace(distances=distances, open_faces=put(mesh, still.open_faces))

    return _changed(parameters, Changes(partial(put, mesh), of_still, partial(put, mesh)))


def on_devices(mesh: Mesh, parameters: Parameters) -> Parameters:
    """What `in_slabs` gives, all of it on the devices."""
    found: Parameters = jax.tree.map(
        lambda spec, part: put(mesh, part, spec),
        spread(parameters),
        parameters,
        is_leaf=lambda x: isinstance(x, PartitionSpec),
    )
    return found


def _divided(still: StillDistances) -> list[bool]:
    """Of every surface whether its distance is one at the corners of slabs: such arrays have one axis more. Where no
    open faces are kept, all surfaces keep their place."""
    faces = still.open_faces
    return [faces is None or d.ndim > len(faces) for d in still.distances]


def _spread_still(still: StillDistances) -> Any:
    distances = tuple(SLABS if divided else SAME for divided in _divided(still))
    return StillDistances(distances, SAME, SLABS)


class Changes(NamedTuple):
    """What is done with the parts of parameters that belong to cells, and with all others."""

    of_cut: Callable[[CutCells], Any]
    of_still: Callable[[StillDistances], Any]
    of_field: Callable[[Any], Any]
    of_rest: Callable[[Any], Any] = lambda part: part


def _changed(parameters: Parameters, changes: Changes) -> Any:
    """The tree of the parameters after these changes; the same without walls in the fluid."""
    if parameters.fluid is None or parameters.fluid.cut is None:
        return parameters
    fluid, scalars = parameters.fluid, parameters.scalars

    def rest_of(part: Any) -> Any:
        return type(part)(*map(changes.of_rest, part))

    still = None if fluid.still is None else changes.of_still(fluid.still)
    cut = changes.of_cut(required(fluid.cut, "cut cells"))
    found = rest_of(parameters)._replace(fluid=rest_of(fluid)._replace(cut=cut, still=still))
    if scalars is None or scalars.walls is None:
        return found
    own = {name: changes.of_field(getattr(scalars.walls, name)) for name in OF_CELLS}
    walls = rest_of(scalars.walls)._replace(**own)
    return found._replace(scalars=rest_of(scalars)._replace(walls=walls))

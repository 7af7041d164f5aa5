"""The fluid of the whole box, and what surfaces leave open of its mesh, as those of its slabs, and back; on the host.

The fluid of the slabs has one axis more in front, of the length of the number of slabs. Cells are in one slab each; a
face between two slabs is in both. What is one for the whole box every slab has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from jax import Array

from jaxdem.fluid.cut_cells import CutCells, OpeningParts
from jaxdem.fluid.fluid_state import FluidState, StillDistances
from jaxdem.fluid.grid import FaceField
from jaxdem.numerics.blocks import Blocks


def cells_in_slabs(blocks: Blocks, field: Array, more: int = 0) -> np.ndarray:
    """A field of every slab of a box, from that of the whole box.

    Args:
        blocks: the slabs.
        field: on cells, whose number along the cut axis is a multiple of the number of slabs; or on faces.
        more: 1 for faces across the cut axis.
    """
    rows = np.moveaxis(np.asarray(field), blocks.axis, 0)
    count = (len(rows) - more) // blocks.number
    parts = [rows[k * count : (k + 1) * count + more] for k in range(blocks.number)]
    return np.stack([np.moveaxis(part, 0, blocks.axis) for part in parts])


def cells_of_slabs(blocks: Blocks, field: Array, more: int = 0) -> np.ndarray:
    """The field of the whole box: the inverse of `cells_in_slabs`."""
    rows = np.moveaxis(np.asarray(field), 1 + blocks.axis, 1)
    parts = [part[: len(part) - more] for part in rows]
    return np.moveaxis(np.concatenate([*parts, rows[-1][len(rows[-1]) - more :]]), 0, blocks.axis)


def fluid_in_slabs(blocks: Blocks, fluid: FluidState) -> FluidState:
    """The fluid of every slab of a box, arrays of NumPy, from that of the whole box."""

    def cut(field: Array, more: int = 0) -> Any:
        return cells_in_slabs(blocks, field, more)

    def counted(array: Array) -> Any:
        return np.stack([np.asarray(array), *[np.zeros_like(array)] * (blocks.number - 1)])

    return _each_part(blocks, fluid, cut, partial(_everywhere, blocks), counted)


def fluid_of_slabs(blocks: Blocks, fluid: FluidState) -> FluidState:
    """The fluid of the whole box, arrays of NumPy: the inverse of `fluid_in_slabs`."""

    def joined(field: Array, more: int = 0) -> Any:
        return cells_of_slabs(blocks, field, more)

    return _each_part(blocks, fluid, joined, _of_first, partial(np.sum, axis=0))


def _everywhere(blocks: Blocks, array: Array) -> Any:
    return np.stack([np.asarray(array)] * blocks.number)


def _of_first(array: Array) -> Any:
    return np.asarray(array)[0]


def cut_in_slabs(blocks: Blocks, cut: CutCells) -> CutCells:
    """The open parts of the mesh of every slab, arrays of NumPy, from those of the whole box at the start of a run."""
    found = _each_part_of_cut(blocks, cut, partial(cells_in_slabs, blocks), partial(_everywhere, blocks))
    if cut.layers is None:
        return found
    layers: Any = np.stack([cells_in_slabs(blocks, layer) for layer in np.asarray(cut.layers)], axis=1)
    return found._replace(layers=layers)


def cut_of_slabs(blocks: Blocks, cut: CutCells) -> CutCells:
    """The open parts of the mesh of the whole box, arrays of NumPy: the inverse of `cut_in_slabs`."""
    found = _each_part_of_cut(blocks, cut, partial(cells_of_slabs, blocks), _of_first)
    if cut.layers is None:
        return found
    layers: Any = np.stack([cells_of_slabs(blocks, layer) for layer in np.moveaxis(np.asarray(cut.layers), 1, 0)])
    return found._replace(layers=layers)


def still_in_slabs(blocks: Blocks, still: StillDistances, divided: Sequence[bool]) -> StillDistances:
    """What does not change of the mesh of every slab, arrays of NumPy, from that of the whole box.

    Args:
        blocks: the slabs.
        still: of the whole box.
        divided: of every surface whether its distance is one at the corners of the mesh: the others, and what says
            which surfaces stick, are the same everywhere.
    """
    return _each_part_of_still(blocks, still, partial(cells_in_slabs, blocks), divided)


def still_of_slabs(blocks: Blocks, still: StillDistances, divided: Sequence[bool]) -> StillDistances:
    """The inverse of `still_in_slabs`."""
    return _each_part_of_still(blocks, still, partial(cells_of_slabs, blocks), divided)


def _each_part_of_still(
    blocks: Blocks, still: StillDistances, of_field: Callable[..., Any], divided: Sequence[bool]
) -> StillDistances:
    distances = tuple(of_field(d, 1) if own else d for d, own in zip(still.distances, divided, strict=True))
    faces = still.open_faces
    if faces is not None:
        faces = tuple(of_field(f, int(axis == blocks.axis)) for axis, f in enumerate(faces))
    return still._replace(distances=distances, open_faces=faces)


def _each_part_of_cut(
    blocks: Blocks, cut: CutCells, of_field: Callable[..., Any], of_box: Callable[[Array], Any]
) -> CutCells:
    def of_faces(faces: FaceField, more: int = 0) -> FaceField:
        return tuple(of_field(f, more + (axis == blocks.axis)) for axis, f in enumerate(faces))

    # Along their own axis control volumes of faces have a surface more than there are faces.
    links = tuple(of_faces(row, int(which == blocks.axis)) for which, row in enumerate(cut.links))
    weights, spin, openings = cut.deposit_weights, cut.spin, cut.openings
    if openings is not None:
        openings = tuple(
            OpeningParts(of_field(o.supply), of_faces(o.velocity), of_faces(o.normal), of_box(o.area)) for o in openings
        )
    return CutCells(
        of_faces(cut.open_faces), of_field(cut.open_cells), links, of_faces(cut.friction), of_faces(cut.velocity),
        of_faces(cut.nearest_to_faces), of_field(cut.nearest_to_cells), None if spin is None else of_box(spin),
        deposit_weights=None if weights is None else of_field(weights), openings=openings,
    )  # fmt: skip


def _each_part(
    blocks: Blocks,
    fluid: FluidState,
    of_field: Callable[..., Any],
    of_box: Callable[[Array], Any],
    of_sum: Callable[..., Any],
) -> FluidState:
    """With fields, what is one for the box, and what each slab counts, changed."""
    void_fraction, gradient, change = fluid.void_fraction, fluid.mean_gradient, fluid.pressure_change
    fraction, supplied = fluid.liquid_fraction, fluid.liquid_supplied
    return FluidState(
        tuple(of_field(f, int(axis == blocks.axis)) for axis, f in enumerate(fluid.face_velocity)),
        of_field(fluid.pressure),
        None if void_fraction is None else of_field(void_fraction),
        None if gradient is None else of_box(gradient),
        liquid_fraction=None if fraction is None else of_field(fraction),
        liquid_supplied=None if supplied is None else of_sum(supplied),
        pressure_change=None if change is None else of_field(change),
    )

"""A state and its neighbour list as named arrays and back, exact to the bit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxdem.errors import InputError
from jaxdem.particles.neighbors import Room

Tree = TypeVar("Tree")
Arrays = Mapping[str, np.ndarray]

COLUMN_MARGIN = 8
"""A column of the search's table has room for all particles at most when it is made; it grows with the list."""

SLAB_COUNT = "slabs"
"""Attribute of a checkpoint of a run on several devices: their number."""

SLAB_AXIS = "slab_axis"
"""Attribute of such a checkpoint: the axis of the box that is cut."""

ROWS = "particle_rows"
"""Attribute of such a checkpoint: number of all particles that there ever are."""

REMEDY = "resume with the scene and version that wrote the checkpoint"


def named(prefix: str, tree: object) -> dict[str, np.ndarray]:
    """The arrays of a tree by name: `prefix` and where each stands."""
    leaves = jax.tree_util.tree_flatten_with_path(tree)[0]
    return {prefix + jax.tree_util.keystr(path): np.asarray(leaf) for path, leaf in leaves}


def restored(prefix: str, template: Tree, arrays: Arrays) -> Tree:
    """The inverse of `named`, for a tree of the same structure.

    Raises:
        InputError: an array is missing or has another shape or type.
    """
    leaves, structure = jax.tree_util.tree_flatten_with_path(template)
    found = []
    for path, leaf in leaves:
        name = prefix + jax.tree_util.keystr(path)
        value = stored(arrays, name)
        if value.shape != leaf.shape or value.dtype != leaf.dtype:
            there, here = f"{name}: {value.dtype}{list(value.shape)}", f"{leaf.dtype}{list(leaf.shape)}"
            raise InputError("checkpoint.h5", there, f"this scene has {here}", REMEDY)
        found.append(jnp.asarray(value))
    return jax.tree_util.tree_unflatten(structure, found)


def stored(arrays: Arrays, name: str) -> np.ndarray:
    """An array of a checkpoint.

    Raises:
        InputError: it is missing.
    """
    if name not in arrays:
        raise InputError("checkpoint.h5", name, "is missing", REMEDY)
    return arrays[name]


def stored_room(arrays: Arrays) -> Room:
    """The room of a stored neighbour list, which is made anew: not more than that list has.

    Raises:
        InputError: the list has another room than is said of it.
    """
    room = Room.of([int(number) for number in stored(arrays, "room")])
    slots, count = stored(arrays, "neighbors.index").shape
    pairs = len(stored(arrays, "neighbors.overlap"))
    if room.rows is not None:
        width, rows = stored(arrays, "neighbors.pairs.entry").shape
        pairs = pairs if (room.rows.width, count + room.rows.further) == (width, rows) else -1
    if (room.slots, room.pairs) != (slots, pairs) or not 0 < room.cell <= COLUMN_MARGIN * (count + 1):
        limit = f"the list in it has {slots} slots and {pairs} pairs of {count} particles"
        raise InputError("checkpoint.h5", room.numbers, limit, "Start the run anew in another folder.")
    return room

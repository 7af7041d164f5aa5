"""The neighbour list of a run as another goes on with it, and the springs of its contacts."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import jax
import numpy as np
from jax import Array

from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.pairs import Pairs
from jaxdem.setup.stored import restored

Arrays = Mapping[str, np.ndarray]


def widened_list(arrays: Arrays, shapes: Neighbors, radius: Array, reference: tuple[np.ndarray, ...]) -> Neighbors:
    """The stored list with more rows, slots and pairs, all of them empty; with as many, the stored one bit for bit.

    Args:
        arrays: of a checkpoint, whose list has at least one slot.
        shapes: of the list that is wanted.
        radius: () or (N,) [m].
        reference: D arrays (N,), centres, of which those of the stored rows do not count [m].
    """

    if shapes.pairs.owned is not None:  # of as many rows, see `Beginning`
        return dataclasses.replace(restored("neighbors", shapes, arrays), radius=radius)

    def put(values: np.ndarray) -> Array:
        return jax.device_put(values)

    def get(name: str) -> np.ndarray:
        return arrays[f"neighbors.{name}"]

    slots, count = get("index").shape
    before, after = len(get("overlap")), shapes.overlap.shape[0]

    def pair_values(name: str) -> np.ndarray:
        # The last pair is the empty one, and what is new is like it.
        return np.concatenate([get(name)[:-1], np.repeat(get(name)[-1:], after - before + 1)])

    def row_values(name: str, new: np.ndarray) -> np.ndarray:
        return np.concatenate([get(name), new[count:]])

    wide, rows = shapes.index.shape
    index = np.tile(np.arange(rows, dtype=np.int32), (wide, 1))
    index[:slots, :count] = get("index")
    entry = np.full((wide, rows), after - 1, np.int32)
    old = get("pairs.entry")
    # p of the first, P + p of the second, P - 1 of nobody: see `Pairs`.
    entry[:slots, :count] = np.where(old == before - 1, after - 1, np.where(old >= before, old + after - before, old))
    axes = range(len(reference))
    blank = [np.zeros_like(x) for x in reference]
    has_low = "neighbors.reference_low[0]" in arrays
    low = [put(row_values(f"reference_low[{k}]", blank[k])) for k in axes] if has_low else [None for _ in axes]
    return Neighbors(
        index=put(index),
        pairs=Pairs(put(pair_values("pairs.first")), put(pair_values("pairs.second")), put(entry)),
        separation=tuple(put(pair_values(f"separation[{k}]")) for k in axes),
        radius=radius,
        overlap=put(pair_values("overlap")),
        reference=tuple(put(row_values(f"reference[{k}]", reference[k])) for k in axes),
        reference_low=tuple(low),
        overflow=put(get("overflow")),
        builds=put(get("builds")),
        cell_slots=shapes.cell_slots,
    )


def carried_springs(arrays: Arrays, springs: list[np.ndarray], new: Neighbors) -> list[np.ndarray]:
    """Values of the stored pairs at the places of another list, by the identity of the two particles.

    Args:
        arrays: of a checkpoint.
        springs: (P,) each, of the stored pairs.
        new: list with P' pairs.

    Returns:
        (P',) each; zero for pairs that were not listed before.
    """
    old = arrays["neighbors.pairs.first"].astype(np.int64), arrays["neighbors.pairs.second"].astype(np.int64)
    now = np.asarray(new.pairs.first).astype(np.int64), np.asarray(new.pairs.second).astype(np.int64)
    rows = new.index.shape[1]
    known, sought = old[0] * rows + old[1], now[0] * rows + now[1]
    order = np.argsort(known, kind="stable")
    place = np.minimum(np.searchsorted(known[order], sought), max(len(order) - 1, 0))
    found = (now[0] != now[1]) & (len(order) > 0)
    if len(order):
        place = order[place]
        found &= known[place] == sought
        return [np.where(found, spring[place], 0.0).astype(spring.dtype) for spring in springs]
    return [np.zeros(len(sought), spring.dtype) for spring in springs]

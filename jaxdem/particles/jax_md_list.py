"""Neighbour lists that a user has made with jax-md, for the contact kernel. jax-md itself is not imported."""

from __future__ import annotations

import dataclasses
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.errors import InputError
from jaxdem.numerics import compensated, vectors
from jaxdem.numerics.compensated import Low, Pair
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.integrate import ParticleState, split_low
from jaxdem.particles.list_room import tree_of
from jaxdem.particles.neighbor_search import NeighborSearch
from jaxdem.particles.neighbors import Neighbors, carry_history, displacement_since_build, with_radius

FORMATS = ("Dense", "Sparse", "OrderedSparse")


class JaxMdList(Protocol):
    """A `jax_md.partition.NeighborList`, as far as it is read.

    Attributes:
        idx: (N, M) the others of every particle (Dense), or (2, M) the two of every pair; N where there is none.
        reference_position: (N, D) positions of which the list is [m].
        error: with the flags of what it had no room for in `code`.
        format: member of `jax_md.partition.NeighborListFormat`.
        cell_size: r_cutoff + dr_threshold; None for a list made without cells [m].
    """

    idx: Array
    reference_position: Array
    error: Any
    format: Any
    cell_size: float | None


def listed_by_jax_md(
    search: NeighborSearch, particles: ParticleState, neighbors: Neighbors, given: JaxMdList
) -> tuple[ParticleState, Neighbors]:
    """Particles and list after `given` has taken the place of `neighbors`; see `jaxdem.neighbors_from_jax_md`."""
    _check_kind(search, particles, given)
    if neighbors.room.slots == 0:
        return particles, neighbors
    after, new = _taken_over(search, particles, neighbors, given)
    if not any(isinstance(array, jax.core.Tracer) for array in jax.tree.leaves((particles, new))):
        _check_values(search, particles, new)
    return after, new


def _check_kind(search: NeighborSearch, particles: ParticleState, given: JaxMdList) -> None:
    """Refuses what can be told without values: also while a function is traced."""
    if search.members > 1:
        limit = "is of particles, and clumps touch by their members"
        raise InputError("neighbor_list", None, limit, "use the list of the simulation")
    kind = getattr(getattr(given, "format", None), "name", None)
    if kind not in FORMATS:
        raise InputError(
            "neighbor_list", type(given).__name__, "it is no jax_md.partition.NeighborList",
            "give what allocate or update of jax_md.partition.neighbor_list returns",
        )  # fmt: skip
    ours, theirs = particles.position, given.reference_position
    if theirs.shape != ours.shape:
        raise InputError(
            "neighbor_list.reference_position", f"array of shape {theirs.shape}",
            f"the scene has {ours.shape[0]} particles in {ours.shape[1]} dimensions",
            "make the list of state.particles.position",
        )  # fmt: skip
    if theirs.dtype != ours.dtype:
        raise InputError(
            "neighbor_list.reference_position", str(theirs.dtype), f"positions of the scene are {ours.dtype}",
            "make the list of state.particles.position",
        )  # fmt: skip
    if given.cell_size is not None and float(given.cell_size) < search.reach * (1.0 - 1e-6):
        raise InputError(
            "neighbor_list.cell_size", float(given.cell_size), f"the list must reach {search.reach:.6g} m",
            _remedy(search),
        )  # fmt: skip


def _remedy(search: NeighborSearch) -> str:
    cutoff, skin = search.geometry.cutoff, search.geometry.skin
    return (
        f"give jax_md.partition.neighbor_list r_cutoff = {cutoff:.6g} and dr_threshold = {skin:.6g} (their sum counts),"
        " box and displacement of the scene, no mask and no fractional coordinates"
    )


def _check_values(search: NeighborSearch, particles: ParticleState, new: Neighbors) -> None:
    """Refuses a list of other positions, and one without a pair that is in reach."""
    position = vectors.components(particles.position)
    moved = displacement_since_build(position, split_low(particles.position_low, len(position)), new)
    present = np.full(len(position[0]), True) if particles.active is None else np.asarray(particles.active)
    distance = np.where(present, np.sqrt(np.asarray(vectors.dot(moved, moved))), 0.0)
    if not np.all(np.isfinite(distance)):
        raise InputError("state.particles.position", "nan or infinity", "positions must be finite", "use a sound state")
    worst = int(np.argmax(distance))
    if distance[worst] > 0.5 * search.geometry.skin:
        raise InputError(
            "neighbor_list.reference_position", f"particle {worst} is {distance[worst]:.3g} m from there",
            f"a list is good for moves up to half of the skin, {0.5 * search.geometry.skin:.3g} m",
            "call neighbor_list.update with state.particles.position, not in fractional coordinates",
        )  # fmt: skip
    if bool(new.overflow):
        return
    # What is nearer than the reach by more than the distances in the dtype of the positions are rounded.
    rounding = 8.0 * float(jnp.finfo(position[0].dtype).eps) * max(search.geometry.box)
    wanted = tree_of(search, new.reference).query_pairs(search.reach - rounding, output_type="ndarray")
    wanted = np.sort(wanted[present[wanted].all(axis=1)], axis=1).astype(np.int64)
    reaches = search.reaches(new.radius)
    if reaches is not None:
        apart = _distances(search, new.reference, wanted)
        wanted = wanted[apart < np.asarray(reaches, float)[wanted].sum(axis=1) - rounding]
    count = len(present)
    found = np.asarray(new.pairs.first, np.int64) * count + np.asarray(new.pairs.second)
    missing = wanted[~np.isin(wanted[:, 0] * count + wanted[:, 1], found)]
    if len(missing):
        first, second = map(int, missing[0])
        raise InputError(
            "neighbor_list.idx", f"{len(missing)} pairs are missing, such as particles {first} and {second}",
            f"a list must have all pairs nearer than {search.reach:.6g} m", _remedy(search),
        )  # fmt: skip


def _distances(search: NeighborSearch, position: Vector, pairs: np.ndarray) -> np.ndarray:
    """(P,) of the nearest images of pairs (P, 2) [m]."""
    squared = np.zeros(len(pairs))
    for x, length, wraps in zip(position, search.geometry.box, search.geometry.periodic, strict=True):
        apart = np.asarray(x, float)[pairs[:, 0]] - np.asarray(x, float)[pairs[:, 1]]
        squared += (apart - length * np.round(apart / length) if wraps else apart) ** 2
    return np.sqrt(squared)


@jax.jit
def _taken_over(
    search: NeighborSearch, particles: ParticleState, neighbors: Neighbors, given: JaxMdList
) -> tuple[ParticleState, Neighbors]:
    """The particles, their springs moved to the places of the new list, and this list in the room of `neighbors`."""
    count, slots = particles.position.shape[0], neighbors.room.slots
    one, other = _ends_in_reach(search, particles.active, given, neighbors.radius)
    # A format has a pair from one side or from both, and a mask may take one of them away: each from both sides, once.
    one, other = lax.sort((jnp.concatenate((one, other)), jnp.concatenate((other, one))), num_keys=2)
    again = (one[1:] == one[:-1]) & (other[1:] == other[:-1])
    kept = (one < count) & ~jnp.append(jnp.zeros(1, bool), again)
    if search.levels is not None:
        size, theirs = neighbors.radius[one], neighbors.radius[other]
        kept = kept & ((theirs > size) | ((theirs == size) & (other > one)))
    before = jnp.cumsum(kept, dtype=jnp.int32) - kept
    start = jnp.searchsorted(one, jnp.arange(count + 1, dtype=jnp.int32))
    rank = before - before[start[one]]
    index = jnp.broadcast_to(jnp.arange(count, dtype=jnp.int32), (slots, count))
    index = index.at[jnp.where(kept, rank, slots), one].set(other, mode="drop")
    overflow = neighbors.overflow | (given.error.code != 0) | jnp.any(kept & (rank >= slots))
    reference, low = _reference(search, particles, given.reference_position)
    radius = neighbors.radius
    new = search.listed(index, reference, low, lax.stop_gradient(radius), neighbors.room, overflow)
    new = dataclasses.replace(with_radius(new, radius), builds=neighbors.builds + 1)
    return particles._replace(contact_spring=carry_history(particles.contact_spring, neighbors, new)), new


def _ends_in_reach(
    search: NeighborSearch, active: Array | None, given: JaxMdList, radius: Array
) -> tuple[Array, Array]:
    """The two of every pair of the list that is in reach and present, (M,) int32 each; N and N for the others."""
    geometry, count = search.geometry, given.reference_position.shape[0]
    if given.format.name == "Dense":
        other = given.idx.reshape(-1)
        one = jnp.repeat(jnp.arange(count), given.idx.shape[1])
    else:
        one, other = given.idx
    real = (one < count) & (other < count) & (one != other)
    one, other = jnp.where(real, one, 0).astype(jnp.int32), jnp.where(real, other, 0).astype(jnp.int32)
    squared = jnp.zeros(one.shape, given.reference_position.dtype)
    for x, length, wraps in zip(
        vectors.components(given.reference_position), geometry.box, geometry.periodic, strict=True
    ):
        apart = x[one] - x[other]
        if wraps:
            apart = apart - length * jnp.round(apart / length)
        squared = squared + apart * apart
    reaches = search.reaches(radius)
    reach = search.reach if reaches is None else reaches[one] + reaches[other]
    real = real & (squared < reach**2)
    if active is not None:
        real = real & active[one] & active[other]
    return jnp.where(real, one, count), jnp.where(real, other, count)


def _reference(search: NeighborSearch, particles: ParticleState, given: Array) -> tuple[Vector, tuple[Low, ...]]:
    """The list's positions as many whole periods away as the particles are, which are never wrapped into the box."""
    geometry, pairs = search.geometry, []
    given, position = lax.stop_gradient((given, particles.position))
    for k, x in enumerate(vectors.components(given)):
        pair: Pair = (x, None if particles.position_low is None else jnp.zeros_like(x))
        if geometry.periodic[k]:
            number = jnp.round((x - position[:, k]) / geometry.box[k])
            pair = compensated.difference(*pair, *compensated.whole_periods(number, geometry.box[k]))
        pairs.append(pair)
    return tuple(high for high, _ in pairs), tuple(low for _, low in pairs)

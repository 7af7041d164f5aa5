"""Bonds of a box in slabs, and back. Host, numpy."""

from __future__ import annotations

import math
from typing import Any

import jax
import numpy as np

from jaxdem.errors import InputError
from jaxdem.particles.bond_state import LEFT, BondRecord, BondState, KeptBonds, entries_of
from jaxdem.particles.integrate import ParticleProperties
from jaxdem.particles.neighbor_search import NeighborSearch
from jaxdem.particles.pairs import Pairs

STRETCH = 1.1
"""How much longer than now a bond may get: its grains must be in reach of the neighbour list."""


def require_in_reach(search: NeighborSearch, bodies: ParticleProperties, bonds: BondState | None) -> None:
    """Refuses bonds along which ghosts are not chosen, so that a slab would not know both grains.

    Args:
        search: of the list.
        bodies: of all particles.
        bonds: of the whole box; None for none.

    Raises:
        InputError: the longest one is too long.
    """
    if bonds is None:
        return
    squared: Any = sum(np.asarray(x, float) ** 2 for x in bonds.separation)
    wanted = STRETCH * float(np.sqrt(np.max(squared[:-1], initial=0.0)))
    if wanted <= search.body_reach:
        return
    # The key counts largest diameters, rounded up here.
    diameter, cutoff = 2.0 * float(np.max(np.asarray(bodies.radius, float))), search.geometry.cutoff
    skin, needed = (search.body_reach - cutoff) / diameter, math.ceil(1e3 * (wanted - cutoff) / diameter) / 1e3
    limit = (
        f"on several devices the neighbour list, which reaches {search.body_reach:.4g} m, must reach {STRETCH:g} "
        f"times as far as the longest bond of {wanted / STRETCH:.4g} m"
    )
    raise InputError("contact.skin", float(f"{skin:.4g}"), limit, f"set it to {needed:g} or more, or use one device")


def bonds_in_slabs(bonds: BondState, table: np.ndarray, changes: bool) -> BondState:
    """What the grains of every slab keep, arrays of NumPy (B, ...), from the bonds of the whole box; not listed yet.

    Args:
        bonds: of the whole box.
        table: (B, R) identities of the rows, -1 for none.
        changes: whether grains leave.
    """
    number, there = np.maximum(table, 0), table >= 0
    bond = np.asarray(bonds.pairs.entry) % len(bonds.status)
    first, second = (np.asarray(index)[bond] for index in (bonds.pairs.first, bonds.pairs.second))
    partner = np.where(bond < len(bonds.status) - 1, first + second - np.arange(bond.shape[1]), -1)

    def of_slabs(values: Any, otherwise: int = 0) -> Any:
        """(B, K, R) of (K, N), or (B, R) of (N,)."""
        array = np.asarray(values)
        rows = np.moveaxis(array[..., number], -2, 0)
        return np.where(there if rows.ndim == 2 else there[:, None], rows, otherwise).astype(array.dtype)

    def of_bonds(values: Any, otherwise: int = 0) -> Any:
        return of_slabs(np.asarray(values)[bond], otherwise)

    each: tuple[Any, Any] = jax.tree.map(of_bonds, (bonds.separation, bonds.separation_low))
    status = of_bonds(bonds.status, LEFT)
    kept = KeptBonds(
        of_slabs(partner.astype(np.int32), -1), *each, of_bonds(bonds.table), status, of_slabs(bond.astype(np.int32))
    )
    turned: tuple[Any, Any] = jax.tree.map(of_slabs, (bonds.orientation, bonds.orientation_low))
    nothing: Any = None
    return BondState(nothing, (), (), nothing, nothing, *turned, kept, _record(bonds, len(table), changes))


def _record(bonds: BondState, number: int, changes: bool) -> BondRecord:
    """The record of so many slabs, arrays of NumPy (B, ...)."""
    size = -(-len(bonds.status) // number)

    def shares(values: Any) -> Any:
        filled = np.pad(np.asarray(values), (0, number * size - len(values)), constant_values=-1)
        return filled.reshape(number, size)

    known: Any = np.stack([np.asarray(bonds.status).astype(np.int8)] * number) if changes else None
    parts = BondRecord(bonds.pairs.first, bonds.pairs.second, bonds.table, bonds.separation, bonds.separation_low, None)
    found: BondRecord = jax.tree.map(shares, parts)
    return found._replace(status=known)


def bonds_of_slabs(bonds: BondState, identity: np.ndarray, there: np.ndarray, count: int) -> BondState:
    """The bonds of the whole box, arrays of NumPy, in the order that they had.

    Args:
        bonds: (B, ...) of the slabs.
        identity: (B, R) of the rows.
        there: (B, R) bool, rows with a grain.
        count: N.
    """
    kept: Any = bonds.kept
    record: Any = bonds.record
    own = there[:, None] & (kept.partner >= 0)
    number = np.count_nonzero(record.first >= 0)
    status = np.zeros(number, np.int32) if record.status is None else record.status.max(axis=0).astype(np.int32)
    np.maximum.at(status, kept.number[own], kept.status[own])
    status[-1] = LEFT  # of the empty one, which no grain keeps

    def of_bonds(values: Any) -> Any:
        return values.reshape(-1)[:number]

    def of_grains(values: Any, otherwise: float = 0.0) -> Any:
        whole = np.full(count, otherwise, values.dtype)
        whole[identity[there]] = values[there]
        return whole

    parts: Any = (record.first, record.second, record.separation, record.separation_low, record.table)
    first, second, separation, low, table = jax.tree.map(of_bonds, parts)
    entry: Any = entries_of(first[:-1], second[:-1], count).astype(np.int32)
    known: Any = status
    # Grains that are not there are not turned.
    turned = tuple(of_grains(q, 0.0 if k else 1.0) for k, q in enumerate(bonds.orientation))
    turned_low = tuple(None if q is None else of_grains(q) for q in bonds.orientation_low)
    return BondState(Pairs(first, second, entry), separation, low, table, known, turned, turned_low)


def blank_kept(bonds: BondState, blank: Any, changes: bool) -> BondState:
    """The bonds of the whole box with a place for what grains and slabs keep, as a template of a checkpoint; `changes`
    is whether grains leave."""
    parts: tuple[Any, Any] = jax.tree.map(lambda x: blank, (bonds.separation, bonds.separation_low))
    record = BondRecord(blank, blank, blank, *parts, blank if changes else None)
    return bonds._replace(kept=KeptBonds(blank, *parts, blank, blank, blank), record=record)

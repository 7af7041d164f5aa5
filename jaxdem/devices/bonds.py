"""Bonds of a box in slabs, and back. Host, numpy."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from jaxdem.errors import InputError
from jaxdem.particles.bond_state import LEFT, BondState, KeptBonds, entries_of
from jaxdem.particles.neighbor_search import NeighborSearch
from jaxdem.particles.pairs import Pairs

STRETCH = 1.1
"""How much longer than now a bond may get: its grains must be in reach of the neighbour list."""


def require_in_reach(search: NeighborSearch, bonds: BondState | None) -> None:
    """Refuses bonds that the neighbour list does not reach along, so that a slab would not know both grains.

    Raises:
        InputError: the longest one is too long.
    """
    if bonds is None:
        return
    squared: Any = sum(np.asarray(x, float) ** 2 for x in bonds.separation)
    longest = float(np.sqrt(np.max(squared[:-1], initial=0.0)))
    if STRETCH * longest > search.reach:
        limit = (
            f"on several devices the neighbour list, which reaches {search.reach:.4g} m, must reach {STRETCH:g} times "
            f"as far as the longest bond of {longest:.4g} m"
        )
        raise InputError("contact.skin", f"{search.geometry.skin:.4g} m", limit, "raise it")


def bonds_in_slabs(bonds: BondState, table: np.ndarray) -> BondState:
    """What the grains of every slab keep, arrays of NumPy (B, ...), from the bonds of the whole box; not listed yet.

    Args:
        bonds: of the whole box.
        table: (B, R) identities of the rows, -1 for none.
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
    kept = KeptBonds(of_slabs(partner.astype(np.int32), -1), *each, of_bonds(bonds.table), of_bonds(bonds.status, LEFT))
    turned: tuple[Any, Any] = jax.tree.map(of_slabs, (bonds.orientation, bonds.orientation_low))
    nothing: Any = None
    return BondState(nothing, (), (), nothing, nothing, *turned, kept)


def bonds_of_slabs(bonds: BondState, identity: np.ndarray, there: np.ndarray, count: int) -> BondState:
    """The bonds of the whole box, arrays of NumPy, in the order of their grains.

    Args:
        bonds: (B, ...) of the slabs.
        identity: (B, R) of the rows.
        there: (B, R) bool, rows with a grain.
        count: N.
    """
    kept: Any = bonds.kept
    owner = np.broadcast_to(identity[:, None], kept.partner.shape)
    # Both grains keep a bond: that of the first one is taken.
    own = there[:, None] & (kept.partner > owner)
    first, second = owner[own], kept.partner[own]
    order = np.lexsort((second, first))
    first, second = first[order], second[order]

    def of_bonds(values: Any, last: float) -> Any:
        return np.append(values[own][order], last).astype(values.dtype)

    def of_grains(values: Any) -> Any:
        whole = np.zeros(count, values.dtype)
        whole[identity[there]] = values[there]
        return whole

    rows: tuple[Any, Any] = (np.append(first, 0).astype(np.int32), np.append(second, 0).astype(np.int32))
    entry: Any = entries_of(first, second, count).astype(np.int32)
    separation = tuple(of_bonds(x, float(axis == 0)) for axis, x in enumerate(kept.separation))
    low = tuple(None if x is None else of_bonds(x, 0.0) for x in kept.separation_low)
    turned: tuple[Any, Any] = jax.tree.map(of_grains, (bonds.orientation, bonds.orientation_low))
    return BondState(
        Pairs(*rows, entry), separation, low, of_bonds(kept.table, 0), of_bonds(kept.status, LEFT), *turned
    )


def blank_kept(bonds: BondState, blank: Any) -> BondState:
    """The bonds of the whole box with a place for what grains of slabs keep, as a template of a checkpoint."""
    parts: tuple[Any, Any] = jax.tree.map(lambda x: blank, (bonds.separation, bonds.separation_low))
    return bonds._replace(kept=KeptBonds(blank, *parts, blank, blank))

"""Bonds of a slab: what its grains keep of them, and the list of those that act on its grains.

Each of two bonded grains keeps the bond, by the identity of the other, so that it goes to other slabs with either. When
a neighbour list is made the bonds are listed by rows: those between own grains once, those across a border in both
slabs, where both find the same load and the same end of the bond. No force travels.

Of a bond that has lost a grain the other one knows that it has ended. Of one that has lost both nobody would, so that
the slab notes how the bonds of a grain ended before its row is free for another: `BondRecord.status`. No bond comes
back, so that of all that slabs and grains know of a bond the largest number holds.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics.blocks import Blocks
from jaxdem.numerics.compensated import Low
from jaxdem.particles.bond_state import INTACT, LEFT, BondState, KeptBonds
from jaxdem.particles.ghosts import Ghosts, with_ghosts
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.pairs import Pairs, at, pairs_of


def relisted(blocks: Blocks, neighbors: Neighbors, bonds: BondState | None) -> tuple[Neighbors, BondState | None]:
    """A list that has just been made, and the bonds by its rows. The list has overflown, for good, where the partner of
    a bond that holds is not among own grains and ghosts.

    Args:
        blocks: the slabs.
        neighbors: of the slab.
        bonds: with what the own grains keep; all else is made anew.
    """
    if bonds is None:
        return neighbors, None
    ghosts, kept = required(neighbors.ghosts, "ghosts of a list"), required(bonds.kept, "what grains keep of bonds")
    slots, rows = kept.partner.shape
    partner = jnp.where(ghosts.own[None], kept.partner, -1)
    both = with_ghosts(blocks, ghosts, (*partner, *kept.status))
    pairs, place = _listed(ghosts.identity, rows, jnp.stack(both[:slots]))
    there, own = pairs.first != pairs.second, place[:, :rows]
    lost = jnp.any((partner >= 0) & (own == _nowhere(pairs)) & (kept.status == INTACT))
    # Where rounding has let a bond end in one slab alone, it has ended.
    ended = jnp.zeros(there.shape, jnp.int32).at[place].max(jnp.stack(both[slots:]), mode="drop")

    def of_pairs(values: Array, blank: float) -> Array:
        return jnp.full(there.shape, blank, values.dtype).at[own].set(values, mode="drop")

    # Bonds that are none are of length one, so that nothing is divided by zero.
    separation = tuple(of_pairs(x, float(axis == 0)) for axis, x in enumerate(kept.separation))
    low: tuple[Low, ...] = tuple(None if x is None else of_pairs(x, 0.0) for x in kept.separation_low)
    status = jnp.where(there, ended, LEFT)
    listed = bonds._replace(
        pairs=pairs, separation=separation, separation_low=low, table=of_pairs(kept.table, 0), status=status
    )
    narrow = dataclasses.replace(ghosts, narrow=ghosts.narrow | lost)
    return dataclasses.replace(neighbors, ghosts=narrow, overflow=neighbors.overflow | lost), listed


def noted(bonds: BondState) -> BondState:
    """The bonds with how those of the list have ended in what the own grains keep."""
    kept, place = required(bonds.kept, "what grains keep of bonds"), _place(bonds.pairs)
    own = place[:, : kept.partner.shape[1]]
    known = at((bonds.status,), jnp.minimum(own, len(bonds.status) - 1))[0]
    status = jnp.where(own == _nowhere(bonds.pairs), kept.status, known)
    return bonds._replace(kept=kept._replace(status=status))


def without_those_gone(ghosts: Ghosts, bonds: BondState, stays: Array) -> BondState:
    """The bonds after own grains have left, whose bonds are in the record. Of ghosts that have left see
    `without_ghosts_gone`.

    Args:
        ghosts: of the slab.
        bonds: with what the own grains keep.
        stays: (R,) bool, whose grain has not left.
    """
    beside = jnp.ones(len(ghosts.identity) - ghosts.rows, bool)
    bonds = noted(bonds.without(jnp.concatenate((stays, beside))))
    kept, record = required(bonds.kept, "what grains keep of bonds"), required(bonds.record, "record of the bonds")
    known = required(record.status, "status of the record")
    left = (ghosts.own & ~stays)[None] & (kept.partner >= 0)
    number = jnp.where(left, kept.number, len(known))
    known = known.at[number].max(kept.status.astype(known.dtype), mode="drop")
    return bonds._replace(record=record._replace(status=known))


def without_ghosts_gone(blocks: Blocks, ghosts: Ghosts, bonds: BondState | None, stays: Array) -> BondState | None:
    """The bonds with those ended of which the neighbours' grain has left. Arguments as above."""
    if bonds is None or required(bonds.record, "record of the bonds").status is None:  # nobody leaves
        return bonds
    (there,) = with_ghosts(blocks, ghosts, (stays.astype(jnp.int32),))
    return noted(bonds.without(there > 0))


def with_new_grains(bonds: BondState, new: Array) -> BondState:
    """The bonds with grains in new rows (R,) bool: they have none, and are not turned."""
    kept = required(bonds.kept, "what grains keep of bonds")
    turned = tuple(jnp.where(new, 0.0 if k else 1.0, q) for k, q in enumerate(bonds.orientation))
    low: tuple[Low, ...] = tuple(None if q is None else jnp.where(new, 0.0, q) for q in bonds.orientation_low)
    kept = kept._replace(partner=jnp.where(new[None], -1, kept.partner))
    return bonds._replace(kept=kept, orientation=turned, orientation_low=low)


def rows_first(bonds: BondState) -> BondState:
    """What goes along with the grains, with the axis of the rows in front; list and record do not."""
    nothing: dict[str, Any] = {"pairs": None, "separation": (), "separation_low": (), "table": None, "status": None}
    nothing["record"] = None
    kept: KeptBonds = jax.tree.map(jnp.transpose, bonds.kept)
    return bonds._replace(**nothing, kept=kept)


def rows_last(rows: BondState, before: BondState) -> BondState:
    """The inverse; the list is still that of the bonds before."""
    kept: KeptBonds = jax.tree.map(jnp.transpose, rows.kept)
    return before._replace(kept=kept, orientation=rows.orientation, orientation_low=rows.orientation_low)


def _listed(identity: Array, rows: int, partner: Array) -> tuple[Pairs, Array]:
    """The bonds with at least one own grain, and the place (K, n) of each that a row keeps.

    Args:
        identity: (n,) of own rows, and of ghosts behind them; -1 for none.
        rows: number of own ones.
        partner: (K, n) identities, -1 for none.
    """
    own = jnp.arange(identity.shape[0], dtype=jnp.int32)
    order = jnp.argsort(identity).astype(jnp.int32)
    row = order[jnp.minimum(jnp.searchsorted(identity[order], partner), len(order) - 1)]
    found = (partner >= 0) & (identity[row] == partner) & (identity >= 0)[None]
    index = jnp.where(found & ((own < rows)[None] | (row < rows)), row, own[None])
    # Each bond is kept by two rows, so that there is always room.
    pairs, _ = pairs_of(index, index.size // 2 + 1, identity)
    return pairs, _place(pairs)


def _place(pairs: Pairs) -> Array:
    """(K, n) place among the pairs of what every row keeps; `_nowhere` of what is not listed."""
    room = pairs.first.shape[0]
    place = jnp.where(pairs.entry >= room, pairs.entry - room, pairs.entry)
    return jnp.where(place == room - 1, _nowhere(pairs), place)


def _nowhere(pairs: Pairs) -> int:
    return pairs.first.shape[0]

"""Particles of the neighbouring slabs that a drag law looks at, farther out than contacts reach.

They are found anew whenever the law looks, once an interval at most: no list of contacts and no message of a contact
step is longer for them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax

from jaxdem.numerics.vectors import components, stack
from jaxdem.particles.ghosts import Division, Ghosts, chosen_ghosts, with_ghosts

DENSEST_PACK = 0.8
"""Solid fraction above that of any pack of equal spheres, 0.74."""


class FarGhosts(NamedTuple):
    """Rows of a slab's own particles (R,) and, behind them, of ghosts from both neighbours: (n,) in all.

    Attributes:
        division: of the box.
        ghosts: who they are.
        centres: (n, D) in the box [m].
        lacking: () bool, there was no room for all of them in some slab.
    """

    division: Division
    ghosts: Ghosts
    centres: Array
    lacking: Array

    @property
    def there(self) -> Array:
        """(n,) bool, rows with a particle."""
        return self.ghosts.identity >= 0

    def spread(self, own: Array) -> Array:
        """(n, C) of the own values (R, C); those of the ghosts come from their slabs."""
        return _with_ghosts(self.division, self.ghosts, own)


def far_ghosts(division: Division, reach: float, centres: Array, there: Array, most: int) -> FarGhosts:
    """Who of the neighbouring slabs is in reach of a slab of equal width.

    Args:
        division: of the box, at planes that do not move.
        reach: [m].
        centres: (R, D) in the box [m].
        there: (R,) bool, rows with a particle.
        most: particles of a neighbour that may be in reach.
    """
    rows, number = len(centres), division.blocks.number
    room = min(rows, most)
    planes = jnp.arange(1, number, dtype=centres.dtype) * (division.length / number)
    # Here a row needs no name: that there is a particle in it says enough.
    identity = jnp.concatenate((jnp.where(there, 0, -1), jnp.full(2 * room, -1))).astype(jnp.int32)
    nobody, zero = jnp.full(room, rows, jnp.int32), jnp.zeros((), jnp.int32)
    none = Ghosts(planes, identity, nobody, nobody, jnp.zeros(3, jnp.int32), zero > 0, zero, zero, 0)
    position = components(lax.stop_gradient(centres))
    ghosts = chosen_ghosts(division, none, position, (None,) * len(position), reach)
    every = _with_ghosts(division, ghosts, centres)
    return FarGhosts(division, ghosts, every, division.blocks.any(ghosts.needed[1] > room))


def _with_ghosts(division: Division, ghosts: Ghosts, own: Array) -> Array:
    return stack(with_ghosts(division.blocks, ghosts, components(own)))


def most_in_reach(thickness: float, area: float, diameter: float) -> int:
    """Equal spheres whose centres are in a layer of the densest pack [m, m2, m]."""
    return math.ceil(DENSEST_PACK * (thickness + diameter) * area / (math.pi / 6.0 * diameter**3))

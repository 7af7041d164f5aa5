"""What the list of a slab is made of: its own particles and the ghosts behind them, of clumps their members.

A clump has m rows in the list: row k n + i is member k of the clump in row i of n, own ones and ghosts. Of a ghost its
slab sends where the centre of mass is and how it lies; where its members are follows from that, by the same operations
in both slabs.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.numerics.blocks import Blocks
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.clump_forces import members_at
from jaxdem.particles.clump_shape import Placed, bodies_of, differs, member_rows
from jaxdem.particles.ghosts import Ghosts, with_ghosts
from jaxdem.particles.integrate import Motion, ParticleProperties

Tree = TypeVar("Tree")


class Sizes(NamedTuple):
    """What a list asks of N particles.

    Attributes:
        radius: () or (N,) of spheres; () or (m, N) of the members of clumps, (m, 1) where these are alike [m].
        offset: D arrays (m, N) or (m, 1), see `Clumps`; none of spheres [m].
        there: (m, N) bool, which rows are members; None where all are.
    """

    radius: Array
    offset: Vector = ()
    there: Array | None = None

    @classmethod
    def of(cls, bodies: ParticleProperties) -> Sizes:
        """Of spheres or clumps."""
        clumps = bodies.clumps
        return cls(bodies.radius) if clumps is None else cls(clumps.radius, clumps.offset, clumps.there)

    def of_rows(self, number: Array | slice) -> Sizes:
        """Of the particles with these numbers, from those of all."""
        found: Sizes = jax.tree.map(lambda x: bodies_of(x, number), self)
        return found

    def rows(self, count: int) -> Array:
        """() or (m n,) radius of the rows of a list over `count` particles [m]."""
        if not self.offset or self.radius.ndim == 0:
            return self.radius
        return member_rows(self.radius, len(self.offset[0]), count)


class Standing(NamedTuple):
    """Particles where a list is made, N of them; what is not of clumps is empty of spheres.

    Attributes:
        position, low: D arrays (N,), low also Nones [m].
        sizes: of the same particles.
        orientation, orientation_low: of clumps, see `Motion`.
    """

    position: Vector
    low: tuple[Low, ...]
    sizes: Sizes
    orientation: Vector = ()
    orientation_low: tuple[Low, ...] = ()

    @classmethod
    def of(cls, motion: Motion, sizes: Sizes, count: int) -> Standing:
        """The first `count` of the particles of a motion."""

        def own(x: Array) -> Array:
            return bodies_of(x, slice(count))

        given = cls(motion.position, motion.low, sizes, motion.orientation, motion.orientation_low)
        found: Standing = jax.tree.map(own, given)
        return found

    def spheres(self) -> tuple[Placed | None, Vector, tuple[Low, ...], Array]:
        """What the rows of a list are: of clumps how they lie; places, D arrays (m N,) and their trailing parts; and
        radii [m]."""
        radius = self.sizes.rows(len(self.position[0]))
        if not self.sizes.offset:
            return None, self.position, self.low, radius
        still = Motion(self.position, self.low, (), (), (), ())
        lying = still._replace(orientation=self.orientation, orientation_low=self.orientation_low)
        return *members_at(lying, self.sizes.offset, self.sizes.there), radius


def rows_beside(blocks: Blocks, ghosts: Ghosts, own: Tree) -> Tree:
    """Arrays (n,) or (m, n) with what the ghosts have, of (R,) or (m, R), or of another list's n; in one message.

    Numbers that all particles share, () and (m, 1), stay as they are.
    """
    leaves, tree = jax.tree.flatten(own)
    sent = [x for x in leaves if differs(x)]
    if not sent:
        return own
    kind = next(x.dtype for x in sent if x.dtype != bool)
    flat = [row if row.dtype == kind else row.astype(kind) for x in sent for row in ((x,) if x.ndim == 1 else x)]
    filled = iter(with_ghosts(blocks, ghosts, tuple(flat)))

    def with_them(x: Array) -> Array:
        if not differs(x):
            return x
        rows = next(filled) if x.ndim == 1 else jnp.stack([next(filled) for _ in range(len(x))])
        return rows if x.dtype == kind else rows > 0.5

    found: Tree = jax.tree.unflatten(tree, [with_them(x) for x in leaves])
    return found

"""Particles of a box in slabs, one a device: who belongs where, and the neighbours' particles near a border.

A slab has rows of its own particles, and after them rows of ghosts: particles of the two neighbours that may touch its
own. Who is a ghost is found when the neighbour list is built. In between a contact step sends position, velocity and
spin of the ghosts, one message a direction. A contact across a border is computed by both slabs, with the particle of
the lower identity first, so that both have the same numbers and no force travels.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.numerics import compensated
from jaxdem.numerics.blocks import Blocks
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector

NEVER = 2**30
"""Number of a contact step that does not come."""

ROUNDING = 4.0
"""Ghosts are chosen this many units of the last place of the box's length farther out than the list reaches."""


@static
class Division:
    """How the particles of a box are divided among slabs; static.

    Attributes:
        blocks: the slabs.
        length: of the box along the axis that is cut [m].
        stray: how far out of its slab a particle may be at the end of a coupling interval, over the reach of a contact;
            with 0 all are in their slabs then. Within an interval they stay where they began, however far they get [-].
        balanced: whether the cut planes move, so that all slabs have equally many.
        by_size: whether ghosts are chosen by their sizes, where the list is one by levels of size.
    """

    blocks: Blocks
    length: float
    stray: float
    balanced: bool
    by_size: bool = False

    @property
    def hops(self) -> int:
        """Messages after which what a slab knows is known to all."""
        return self.blocks.number // 2 if self.blocks.periodic else self.blocks.number - 1

    def bounds(self, planes: Array) -> tuple[Array, Array]:
        """() and (), lower and upper end of this slab [m]."""
        low, high = jnp.zeros_like(planes, shape=1), jnp.full_like(planes, self.length, shape=1)
        ends, own = jnp.concatenate((low, planes, high)), self.blocks.index()
        return ends[own], ends[own + 1]

    def steps_to(self, planes: Array, position: Vector, low: tuple[Low, ...]) -> Array:
        """(R,) int32, by how many slabs, upwards, the slab that a particle is in is away from this one."""
        axis, number = self.blocks.axis, self.blocks.number
        wraps = self.blocks.periodic
        (inside,) = compensated.into_box((position[axis],), (low[axis],), (self.length,), (wraps,))
        place = jnp.sum((inside[None] >= planes[:, None]).astype(jnp.int32), axis=0)
        steps = place - self.blocks.index()
        return jnp.mod(steps + number // 2, number) - number // 2 if wraps else steps

    def from_middle(self, planes: Array, position: Vector, low: tuple[Low, ...]) -> tuple[Array, Array]:
        """(R,) distance along the axis from the middle of this slab, upwards; and () half the width of the slab [m]."""
        axis = self.blocks.axis
        lower, upper = self.bounds(planes)
        apart, _ = compensated.difference(position[axis], low[axis], 0.5 * (lower + upper), _no_low(low[axis]))
        if self.blocks.periodic:
            apart = apart - self.length * jnp.round(apart / self.length)
        return apart, 0.5 * (upper - lower)


def _no_low(low: Low) -> Low:
    return None if low is None else jnp.zeros((), low.dtype)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Ghosts:
    """Who is whose ghost, of a slab with R rows of its own, G of ghosts from below and G of those from above.

    Attributes:
        planes: (B - 1,) where the box is cut [m].
        identity: (n,) int32 of the particles of all n = R + 2 G rows, -1 where there is none.
        lower: (G,) int32, own rows of which the slab below has ghosts; R where it has fewer.
        upper: (G,) int32, the same of the slab above.
        needed: (3,) int32, most rows, ghosts of one neighbour, and particles that went to one neighbour at
            once, so far.
        narrow: () bool, a slab was too narrow: particles of slabs that are not neighbours may have touched.
        migrations: () int32, times that particles went to other slabs.
        cuts: () int32, times that the cut planes moved.
        migrating: room for particles that go to one neighbour at once; static.
        members: m, rows of a list that a particle has: row k n + i is member k of the clump in row i; 1 of spheres;
            static.
    """

    planes: Array
    identity: Array
    lower: Array
    upper: Array
    needed: Array
    narrow: Array
    migrations: Array
    cuts: Array
    migrating: int = dataclasses.field(metadata={"static": True})
    members: int = dataclasses.field(default=1, metadata={"static": True})

    @property
    def rows(self) -> int:
        """R, rows of own particles."""
        return self.identity.shape[0] - 2 * self.lower.shape[0]

    @property
    def own(self) -> Array:
        """(R,) bool, rows with a particle of this slab."""
        return self.identity[: self.rows] >= 0

    def body(self, row: Array) -> Array:
        """The row of the particle that rows of a list belong to."""
        return row if self.members == 1 else row % self.identity.shape[0]

    def own_number(self, row: Array) -> Array:
        """Number k R + i of the member in a row of a list, among those of own particles; m R of all others, for spheres
        the row itself."""
        if self.members == 1:
            return row
        body, member = self.body(row), row // self.identity.shape[0]
        own = (body < self.rows) & (member < self.members)
        return jnp.where(own, member * self.rows + body, self.members * self.rows)

    def of_own(self, values: Array) -> Array:
        """(K m, R) of own particles, of values (K, m n) of the rows of a list."""
        return values.reshape(-1, self.identity.shape[0])[:, : self.rows]

    @property
    def touching(self) -> Array:
        """(m n,) int32, who is in the rows of a list: of member k of a clump `member_stride(m)` k + its identity, so
        that members are in the order that they have on one device; -1 where there is nobody."""
        if self.members == 1:
            return self.identity
        member = member_stride(self.members) * jnp.arange(self.members, dtype=jnp.int32)
        return jnp.where(self.identity[None] >= 0, member[:, None] + self.identity[None], -1).reshape(-1)


def member_stride(members: int) -> int:
    """By how much the identities of two members of a clump that follow each other differ: as far as int32 reaches."""
    return (2**31 - 1) // members


def beside(blocks: Blocks, ghosts: Ghosts, own: Vector) -> Vector:
    """What the ghosts have of quantities (R,) or (n,) of one type: (2 G,) each, those from below first."""
    return tuple(jnp.split(exchanged(blocks, ghosts, own, None)[0].reshape(-1), len(own)))


def with_ghosts(blocks: Blocks, ghosts: Ghosts, own: Vector) -> Vector:
    """(n,) each of quantities (R,) of one type, those of the ghosts behind the own ones."""
    parts = zip(own, beside(blocks, ghosts, own), strict=True)
    return tuple(jnp.concatenate((x[: ghosts.rows], new)) for x, new in parts)


def exchanged(blocks: Blocks, ghosts: Ghosts, own: Vector, due: Array | None) -> tuple[Array, Array]:
    """(C, 2 G) what the ghosts have of C quantities; and the earliest `due` of this slab and its neighbours.

    Args:
        blocks, ghosts: of the slab.
        own: arrays (R,) or (n,) of one type.
        due: () int32, number of a contact step, sent with them; None for nothing.
    """

    def packed(rows: Array) -> Array:
        # One gather an array: XLA would compute a stack of all rows first.
        chosen = jnp.stack([x.at[rows].get(mode="clip") for x in own])
        if due is None:
            return chosen
        return jnp.concatenate((chosen, jnp.broadcast_to(due.astype(chosen.dtype), (len(own), 1))), axis=1)

    def filled(from_below: Array, from_above: Array) -> Array:
        # A row without a ghost is like the first of the slab's own: zeros, as of a radius, would make slopes infinite.
        there = ghosts.identity[ghosts.rows :] >= 0
        first = jnp.stack([x[0] for x in own])[:, None]
        return jnp.where(there[None], jnp.concatenate((from_below, from_above), axis=1), first)

    from_below, from_above = blocks.from_both(ghosts.lower, ghosts.upper, packed)
    if due is None:
        return filled(from_below, from_above), jnp.full((), NEVER, jnp.int32)
    heard = lax.stop_gradient(jnp.stack((from_below[0, -1], from_above[0, -1])))
    # At an end there is no neighbour, and zeros come from there.
    ends = jnp.stack((blocks.is_first(), blocks.is_last()))
    earliest = jnp.min(jnp.where(ends, NEVER, heard.astype(jnp.int32)))
    return filled(from_below[:, :-1], from_above[:, :-1]), jnp.minimum(due, earliest)


def chosen_ghosts(
    division: Division,
    ghosts: Ghosts,
    position: Vector,
    low: tuple[Low, ...],
    reach: float,
    radius: Array | None = None,
) -> Ghosts:
    """The ghosts of both neighbours at these positions (R,) of the own particles; their identities come with them.

    A neighbour gets who is within reach of the farthest that its own particles stand outside of it. With radii (R,) it
    gets whose surfaces are, of where the surfaces of its own reach, which may be inside of it: among grains of very
    different sizes few small ones are ghosts where no large one stands at the border.
    """
    blocks, own = division.blocks, ghosts.own
    away, half = division.from_middle(ghosts.planes, position, low)
    reach = reach + ROUNDING * float(jnp.finfo(away.dtype).eps) * division.length
    least = 0.0 if radius is None else -division.length

    def beyond(x: Any) -> Any:  # a number stays one
        return x if radius is None else x + radius

    below = jnp.max(jnp.where(own, beyond(-half - away), least), initial=least)
    above = jnp.max(jnp.where(own, beyond(away - half), least), initial=least)
    below, above = jnp.where(blocks.is_first(), least, below), jnp.where(blocks.is_last(), least, above)
    out_of_lower, out_of_upper = blocks.from_both(below, above)
    to_upper = own & (half - away < beyond(reach) + out_of_upper) & ~blocks.is_last()
    to_lower = own & (half + away < beyond(reach) + out_of_lower) & ~blocks.is_first()
    if blocks.number == 1:  # it finds its own pairs across a periodic side
        to_upper = to_lower = jnp.zeros_like(own)
    if blocks.number == 2 and blocks.periodic:  # both neighbours are one
        to_lower = to_lower & ~to_upper
    narrow = (blocks.number > 2) & (2.0 * half < out_of_lower + out_of_upper + reach)
    room, rows = ghosts.lower.shape[0], ghosts.rows

    def listed(sent: Array) -> Array:
        return jnp.nonzero(sent, size=room, fill_value=rows)[0].astype(jnp.int32)

    lower, upper = listed(to_lower), listed(to_upper)
    most = jnp.maximum(jnp.sum(to_lower), jnp.sum(to_upper)).astype(jnp.int32)
    needed = ghosts.needed.at[1].max(most)

    def identities(rows: Array) -> Array:
        return jnp.concatenate((ghosts.identity[: ghosts.rows], jnp.full(1, -1, jnp.int32)))[rows]

    from_below, from_above = blocks.from_both(identities(lower), identities(upper))
    from_below = jnp.where(blocks.is_first(), -1, from_below)
    from_above = jnp.where(blocks.is_last(), -1, from_above)
    identity = jnp.concatenate((ghosts.identity[: ghosts.rows], from_below, from_above))
    return dataclasses.replace(
        ghosts, identity=identity, lower=lower, upper=upper, needed=needed, narrow=ghosts.narrow | narrow
    )

"""What clumps of overlapping spheres are: arrays of rigid bodies and of their members.

A body has m members. Arrays of members are (m, N) of N bodies, and as rows of contacts and lists (m N,): member k of
body i is row k N + i. Bodies with fewer members than others have rows that are not there.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.numerics.compensated import Low
from jaxdem.numerics.vectors import Vector


class Clumps(NamedTuple):
    """Members and inertia of N bodies, in their principal axes; of equal bodies () for (N,) and (m, 1) for (m, N).

    Attributes:
        offset: D arrays (m, N), centres of the members from the centre of mass [m].
        radius: (m, N) of the members; () where all are equal [m].
        inertia: principal moments over m r^2, r the radius of the sphere of the same volume: 3 in 3-D; in 2-D one,
            about the axis normal to the plane [-].
        share: (m, N) parts of the body's volume that its members stand for; they add up to 1 [-].
        reach: of the sphere about the centre of mass that holds the body, over r [-].
        sphericity: surface of the sphere of the same volume over that of the body [-].
        shadow: D, areas of the projections along the principal axes over pi r^2 [-].
        there: (m, N) bool, which rows are members; None where all are.
    """

    offset: Vector
    radius: Array
    inertia: Vector
    share: Array
    reach: Array
    sphericity: Array
    shadow: Vector
    there: Array | None = None

    @property
    def members(self) -> int:
        """m, rows of a body."""
        return self.share.shape[0]

    def rows(self, quantity: Array, bodies: int) -> Array:
        """See `member_rows`."""
        return member_rows(quantity, self.members, bodies)

    def of_rows(self, number: Array) -> Clumps:
        """The bodies with these numbers (R,), from all bodies."""
        return jax.tree.map(lambda x: bodies_of(x, number), self)


class Placed(NamedTuple):
    """Where the bodies stood when a neighbour list was made, and their members about them.

    Attributes:
        position: D arrays (N,), leading part [m].
        low: D arrays (N,) or Nones, trailing part [m].
        orientation: 4 arrays (N,), unit quaternion (w, x, y, z); in 2-D one, an angle [rad].
        orientation_low: trailing part of the same, or Nones.
        offset: see `Clumps`.
        arm: D arrays (m, N), from the centre of mass to the members, leading part [m].
        arm_low: trailing part, or Nones.
        there: see `Clumps`.
    """

    position: Vector
    low: tuple[Low, ...]
    orientation: Vector
    orientation_low: tuple[Low, ...]
    offset: Vector
    arm: Vector
    arm_low: tuple[Low, ...]
    there: Array | None = None

    def active_rows(self, active: Array | None) -> Array | None:
        """See `active_rows`."""
        members, bodies = self.arm[0].shape
        return active_rows(self.there, active, members, bodies)


def member_rows(quantity: Array, members: int, bodies: int) -> Array:
    """(m N,) of the members, of (m, N), (m, 1) or, of the bodies, (N,); () unchanged."""
    if quantity.ndim == 0:
        return quantity
    table = quantity if quantity.ndim == 2 else quantity[None]
    return jnp.broadcast_to(table, (members, bodies)).reshape(-1)


def differs(quantity: Array) -> bool:
    """Whether an array has an entry for every body: (N,) and (m, N) have, () and (m, 1) have not."""
    return quantity.ndim == 1 or (quantity.ndim == 2 and quantity.shape[1] > 1)


def bodies_of(quantity: Array, number: Array | slice) -> Array:
    """What the bodies with these numbers have, of a number of each body or member; of equal bodies unchanged."""
    return quantity[..., number] if differs(quantity) else quantity


def active_rows(there: Array | None, active: Array | None, members: int, bodies: int) -> Array | None:
    """(m N,) bool, which rows are members of bodies that are present; None where all are.

    Args:
        there: (m, N) or (m, 1) bool, which rows are members; None where all are.
        active: (N,) bool, which bodies are present; None where all are.
        members, bodies: m and N.
    """
    if there is None and active is None:
        return None
    table = jnp.ones((members, bodies), bool) if there is None else jnp.broadcast_to(there, (members, bodies))
    return (table if active is None else table & active[None]).reshape(-1)

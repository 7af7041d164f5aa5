"""What the fluid does at a side of the box: a class for each kind of side, and the protocol for one of one's own."""

from __future__ import annotations

import dataclasses
from typing import Protocol

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.grid import CellOrOne


class SideCondition(Protocol):
    """A kind of side; immutable and static. What it needs to know is in its own attributes."""

    @property
    def sets_pressure(self) -> bool:
        """Whether the pressure is zero outside and drives the flow through the side."""
        ...

    def normal(self, inner: Array, speed: Array, void_fraction: CellOrOne, upper: bool) -> Array:
        """Normal velocity of the faces of the side [m/s], positive along the axis.

        Args:
            inner: normal velocity of the next faces inside [m/s].
            speed: normal superficial velocity that the scene gives the side, zero beyond its patch [m/s].
            void_fraction: on the faces of the side.
            upper: whether the side is at the upper end of its axis.
        """
        ...

    def ghosts(self, mirrored: Array, speed: Array, covered: Array, distance: Array) -> Array:
        """Tangential velocity in the two layers outside [m/s], at the mirror images of those inside.

        Args:
            mirrored: tangential velocity at these images [m/s].
            speed: that the scene gives the side [m/s].
            covered: part of each face that the patch covers [-].
            distance: of the layers from the side, broadcast along its axis [m].
        """
        ...


@dataclasses.dataclass(frozen=True)
class Wall:
    """Nothing passes, and the fluid sticks to it; it may move along itself."""

    sets_pressure: bool = dataclasses.field(default=False, init=False)

    def normal(self, inner: Array, speed: Array, void_fraction: CellOrOne, upper: bool) -> Array:
        """Zero."""
        return jnp.zeros_like(inner)

    def ghosts(self, mirrored: Array, speed: Array, covered: Array, distance: Array) -> Array:
        """Mirrored about the wall's velocity."""
        return 2.0 * covered * speed - mirrored


@dataclasses.dataclass(frozen=True)
class FreeSlip(Wall):
    """Nothing passes, and nothing drags; a patch is free, the rest a wall."""

    def ghosts(self, mirrored: Array, speed: Array, covered: Array, distance: Array) -> Array:
        """The values themselves on the patch."""
        return covered * mirrored - (1.0 - covered) * mirrored


@dataclasses.dataclass(frozen=True)
class Inlet(Wall):
    """The superficial velocity is given."""

    def normal(self, inner: Array, speed: Array, void_fraction: CellOrOne, upper: bool) -> Array:
        """The superficial velocity over the void fraction."""
        return jnp.zeros_like(inner) + speed / void_fraction


@dataclasses.dataclass(frozen=True)
class Outlet(FreeSlip):
    """The pressure is zero outside, where the fluid is at rest."""

    sets_pressure: bool = dataclasses.field(default=True, init=False)

    def normal(self, inner: Array, speed: Array, void_fraction: CellOrOne, upper: bool) -> Array:
        """That of the nearest inner face where it leaves (the projection may still draw some in)."""
        return jnp.maximum(inner, 0.0) if upper else jnp.minimum(inner, 0.0)


CONDITIONS: dict[str, SideCondition] = {
    "no_slip": Wall(),
    "free_slip": FreeSlip(),
    "moving_wall": Wall(),
    "inlet": Inlet(),
    "outlet": Outlet(),
    "periodic": Wall(),  # never asked: the axis has no sides
}
"""By the name in a scene, `boundary.<side>.kind`."""

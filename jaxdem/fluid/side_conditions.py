"""What the fluid does at a side of the box: a class for each kind of side, and the protocol for one of one's own."""

from __future__ import annotations

import dataclasses
from typing import Protocol

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.grid import CellOrOne
from jaxdem.numerics.static import static


class SideCondition(Protocol):
    """A kind of side; immutable and static. What it needs to know is in its own attributes."""

    @property
    def sets_pressure(self) -> bool:
        """Whether the pressure is zero outside and drives the flow through the side."""
        ...

    def normal(self, predicted: Array, speed: Array, void_fraction: CellOrOne, upper: bool) -> Array:
        """Normal velocity of the faces of the side [m/s], positive along the axis.

        Args:
            predicted: by the balance of momentum: of the faces of the side where it sets the pressure, else of the next
                faces inside [m/s].
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


@static
class Wall:
    """Nothing passes, and the fluid sticks to it; it may move along itself."""

    sets_pressure: bool = dataclasses.field(default=False, init=False)

    def normal(self, predicted: Array, speed: Array, void_fraction: CellOrOne, upper: bool) -> Array:
        """Zero."""
        return jnp.zeros_like(predicted)

    def ghosts(self, mirrored: Array, speed: Array, covered: Array, distance: Array) -> Array:
        """Mirrored about the wall's velocity."""
        return 2.0 * covered * speed - mirrored


@static
class FreeSlip(Wall):
    """Nothing passes, and nothing drags; a patch is free, the rest a wall."""

    def ghosts(self, mirrored: Array, speed: Array, covered: Array, distance: Array) -> Array:
        """The values themselves on the patch."""
        return covered * mirrored - (1.0 - covered) * mirrored


@static
class Inlet(Wall):
    """The superficial velocity is given."""

    def normal(self, predicted: Array, speed: Array, void_fraction: CellOrOne, upper: bool) -> Array:
        """The superficial velocity over the void fraction."""
        return jnp.zeros_like(predicted) + speed / void_fraction


@static
class Outlet(FreeSlip):
    """The pressure is zero where fluid leaves, and where it comes in the total pressure of the normal velocity.

    The directional do-nothing condition, with u_n the velocity along the normal n that points outwards:

        -p n + mu du/dn = rho/2 min(u_n, 0) u,

    that is p = -rho u_n^2/2 where fluid is drawn in from rest. Without the right-hand side what comes in would bring
    energy that nothing limits; with it the side can only take energy out of the box. In the balance of momentum it
    stands as half of the momentum that comes in, see `advection`.

    Source: C.-H. Bruneau, P. Fabrie, Int. J. Numer. Meth. Fluids 19 (1994) 693-705; M. Braack, P. B. Mucha, J. Comput.
    Math. 32 (2014) 507-521; compared with others by C. Bertoglio et al., Int. J. Numer. Meth. Biomed. Engng 34 (2018)
    e2929.
    """

    sets_pressure: bool = dataclasses.field(default=True, init=False)

    def normal(self, predicted: Array, speed: Array, void_fraction: CellOrOne, upper: bool) -> Array:
        """What the balance of momentum gives."""
        return predicted


CONDITIONS: dict[str, SideCondition] = {
    "no_slip": Wall(),
    "free_slip": FreeSlip(),
    "moving_wall": Wall(),
    "inlet": Inlet(),
    "outlet": Outlet(),
    "periodic": Wall(),  # never asked: the axis has no sides
}
"""By the name in a scene, `boundary.<side>.kind`."""

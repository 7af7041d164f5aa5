"""Bonds between grains: who is bonded to whom, which bonds still hold, and how the bonded grains are turned."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.numerics import compensated, vectors
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.pairs import Pairs, at

INTACT, TENSION, SHEAR, LEFT = 0, 1, 2, 3
"""Of a bond: it holds; it broke in tension, or in shear; one of its grains has left. No bond comes back."""

STATUS_NAMES = {INTACT: "intact", TENSION: "tension", SHEAR: "shear", LEFT: "left"}


@static
class Bonding:
    """The space that bonded grains are in; static.

    Attributes:
        box: side lengths [m].
        periodic: whether each axis is periodic.
    """

    box: tuple[float, ...]
    periodic: tuple[bool, ...]


class BondState(NamedTuple):
    """B bonds between N grains; traced.

    The elastic force of a bond follows from where its two grains are and how they are turned, see `bonds`. So nothing
    is summed up from step to step, and the rotation of a bonded body strains no bond, however long it turns.

    Attributes:
        pairs: who is bonded; the last one of the B is empty. They never change.
        separation: D arrays (B,), centre of the first less centre of the second when the bond was made, leading part
            [m].
        separation_low: D arrays (B,), trailing part; Nones in float64.
        table: (B,) int32, number of the table of the scene that made the bond.
        status: (B,) int32, `INTACT` or why it does not hold any more.
        orientation: 4 arrays (N,), unit quaternion that turns a grain from where it was when the bonds were made,
            scalar part first, leading part; in 2-D too, where it has the first and the last component [-].
        orientation_low: 4 arrays (N,), trailing part; Nones in float64.
    """

    pairs: Pairs
    separation: Vector
    separation_low: tuple[Low, ...]
    table: Array
    status: Array
    orientation: Vector
    orientation_low: tuple[Low, ...]

    @property
    def intact(self) -> Array:
        """(B,) bool, which bonds hold."""
        return self.status == INTACT

    def turned(self, spin: Vector, time_step: Array) -> BondState:
        """The grains turned with their angular velocity (A arrays) [rad/s] over a time [s].

        A quaternion q becomes (1 - h^2 + 2 h) q / (1 + h^2) with h = w dt/4: of length one as it was, by the angle
        4 atan(w dt/4). What is added is small, and is added in pairs of floats.
        """
        zero = jnp.zeros_like(spin[0])
        spin = spin if len(spin) == 3 else (zero, zero, spin[0])
        quarter = vectors.scale(0.25 * time_step, spin)
        squared = vectors.dot(quarter, quarter)
        scalar, axis = self.orientation[0], self.orientation[1:]
        product = (
            -vectors.dot(quarter, axis),
            *vectors.add(vectors.scale(scalar, quarter), vectors.cross(quarter, axis)),
        )
        factor = 2.0 / (1.0 + squared)
        change = (factor * (p - squared * q) for p, q in zip(product, self.orientation, strict=True))
        parts = zip(self.orientation, self.orientation_low, change, strict=True)
        new = [compensated.advance(high, low, increment) for high, low, increment in parts]
        return self._replace(orientation=tuple(high for high, _ in new), orientation_low=tuple(low for _, low in new))

    def without(self, stays: Array) -> BondState:
        """The same after grains have left; `stays` (N,) bool says which have not."""
        both = at((stays,), self.pairs.first)[0] & at((stays,), self.pairs.second)[0]
        return self._replace(status=jnp.where(self.intact & ~both, LEFT, self.status))

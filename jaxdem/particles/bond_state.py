"""Bonds between grains: who is bonded to whom, which bonds still hold, and how the bonded grains are turned."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
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


class KeptBonds(NamedTuple):
    """What each of the R own grains of a slab keeps of its bonds, in K places; see `slab_bonds`.

    Attributes:
        partner: (K, R) int32, identity of the other grain; -1 where there is no bond.
        separation, separation_low: D arrays (K, R) or Nones, see `BondState`; of the grain of the lower identity.
        table, status: (K, R) int32.
        number: (K, R) int32, of the bond among all B of the box.
    """

    partner: Array
    separation: Vector
    separation_low: tuple[Low, ...]
    table: Array
    status: Array
    number: Array


class BondRecord(NamedTuple):
    """All B bonds of a box in slabs, the empty one too, whether their grains are still there or not; see `BondState`.

    Attributes:
        first, second, table: (S,) int32, of the share of this slab: bonds k S to (k + 1) S of slab k, -1 beyond the
            last one. They never change.
        separation, separation_low: D arrays (S,) or Nones, the same.
        status: (B,) int8, of bonds of which a grain has left this slab how they had ended, of others what was known
            when the slabs were made; the largest of all slabs and grains counts. None where no grain ever leaves.
    """

    first: Array
    second: Array
    table: Array
    separation: Vector
    separation_low: tuple[Low, ...]
    status: Array | None


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
        kept: in a slab, whose list of pairs is of its rows and is made anew with that of the neighbours; None on one
            device.
        record: in a slab; None on one device.
    """

    pairs: Pairs
    separation: Vector
    separation_low: tuple[Low, ...]
    table: Array
    status: Array
    orientation: Vector
    orientation_low: tuple[Low, ...]
    kept: KeptBonds | None = None
    record: BondRecord | None = None

    @property
    def counted(self) -> Array | None:
        """(B,) bool, which bonds belong to this slab: one across a border is in the lists of both, and is counted with
        its first grain. None on one device."""
        return None if self.kept is None else self.pairs.first < self.kept.partner.shape[1]

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


def entries_of(first: np.ndarray, second: np.ndarray, count: int) -> np.ndarray:
    """(K, N) places of the bonds of each of N grains, see `Pairs`; of bonds (B,) and the empty one. Host, numpy."""
    number = len(first) + 1
    grain = np.concatenate([first, second])
    place = np.concatenate([np.arange(number - 1), number + np.arange(number - 1)])
    order = np.argsort(grain, kind="stable")
    grain, place = grain[order], place[order]
    starts = np.searchsorted(grain, np.arange(count))
    rank = np.arange(len(grain)) - starts[grain]
    table = np.full((int(rank.max(initial=0)) + 1, count), number - 1)
    table[rank, grain] = place
    return table

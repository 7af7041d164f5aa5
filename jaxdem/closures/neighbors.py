"""The drag, side force and torque that the places of the neighbours add to a mean law."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.base import Drag, DragInputs
from jaxdem.closures.correlation import Correlation
from jaxdem.closures.moments import MomentBasis, Offset, carried_counts, moments, with_wake
from jaxdem.closures.neighbor_level import LARGE, ORDER, Level, Width
from jaxdem.closures.neighbor_range import conditions, presence, quartic, range_weight
from jaxdem.closures.network import base_law, constant
from jaxdem.closures.tang import Tang
from jaxdem.errors import InputError, is_whole, require_kinds
from jaxdem.numerics.products import PRECISION

SCALE = (0.25, 0.18, 0.01, 0.03)
"""Scatter of force along, force across, torque about and torque across before it is known, over the mean force."""
SMALLEST_MULTIPLE = 0.2
"""Multiple of the mean drag under which a lower one is approached exponentially, so that the drag stays positive."""


class Response(NamedTuple):
    """What the neighbours of N spheres add, over the mean force of the whole fluid F (and F d for torques).

    Attributes:
        along: (N,) force along the slip [-].
        across: (N, 2) force along the two axes across it [-].
        torque: (N, 3) about the slip and the two axes across it [-].
        weight: (N,) 1 in the range of the data, 0 far from it; the others have it as a factor [-].
    """

    along: Array
    across: Array
    torque: Array
    weight: Array


ORDERS = {"basis": ORDER, "carried": ORDER - 1, "wake": 1}
"""Largest order of the moments of each basis."""


def _require(basis: object, carried: object, wake: object, widths: object, seed: object) -> None:
    """Refuses arguments of `NeighborClosure.initial` that are of another kind."""
    remedy = "Give a MomentBasis of jaxdem.closures.moments."
    given = {"basis": basis} | {name: one for name, one in (("carried", carried), ("wake", wake)) if one is not None}
    require_kinds(remedy, **{name: (one, MomentBasis) for name, one in given.items()})
    for name, one in given.items():
        if isinstance(one, MomentBasis) and one.order != ORDERS[name]:
            limit = f"has the order {one.order}, and its moments are of {ORDERS[name]}"
            raise InputError(name, one, limit, "Give a basis of that order.")
    needed = 1 if carried is None else 2
    if not isinstance(widths, Sequence) or len(widths) < needed or not all(map(_is_width, widths)):
        limit = f"is no list of {needed} or more widths"
        raise InputError("widths", widths, limit, "Give (Width(scalars, channels, (hidden, ...)), ...).")
    if not is_whole(seed) or seed < 0:  # type: ignore[operator]
        raise InputError("seed", seed, "must be a whole number from 0 up", "Give one.")


def _is_width(value: object) -> bool:
    if not isinstance(value, tuple) or len(value) != 3 or not isinstance(value[2], Sequence):
        return False
    return all(is_whole(size) and size >= 1 for size in (*value[:2], *value[2]))


@partial(
    jax.tree_util.register_dataclass,
    data_fields=["levels", "scale", "mean"],
    meta_fields=["base", "basis", "carried", "wake"],
)
@dataclasses.dataclass(frozen=True, eq=False)
class NeighborClosure:
    """Mean law, and a fluctuation that the places of the neighbours give, for equal spheres in 3-D.

    The first level sees the neighbours' density about a sphere, expanded in distance and direction about its slip
    (`moments`). A second one, if there is one, sees in addition the same expansion of the force that the first gives
    for the neighbours (`carried_moments`): what shields a neighbour is felt beyond the reach.

    The fluctuation is one of the force of the whole fluid F over its mean at this Re and solid fraction. `mean` is
    taken from it, so that the mean over a homogeneous array is zero. It is zero without neighbours, and beyond the data
    it fades: see `range_weight`. Neighbours count up to `basis.reach` diameters, with value and slope zero there.

    Scale and mean are constants to differentiation. Called as a drag law, without neighbours, it is the mean law.

    Attributes:
        levels: one or two.
        scale: (4, 6) logarithms of the scatter of force along, force across, torque about and torque across in the
            data, over F and F d: factors of 1, a, s, a^2, a s, s^2, with a and s the first and last of `conditions`.
        mean: (8,) the same factors of the mean of the fluctuation, and those of s^3 and s^4 [-].
        base: mean law, of model A.
        basis: of the moments.
        carried: of the second level's moments of forces; None with one level.
        wake: of further moments of order zero and one, stretched along the slip, that both levels see; None for none.

    Source: ours, of moments as in R. Drautz, Phys. Rev. B 99 (2019) 014104, about an axis; data: arXiv 2507.20767.
    """

    levels: tuple[Level, ...]
    scale: Array
    mean: Array
    base: Correlation
    basis: MomentBasis
    carried: MomentBasis | None = None
    wake: MomentBasis | None = None

    @classmethod
    def initial(
        cls,
        basis: MomentBasis,
        carried: MomentBasis | None = None,
        widths: Sequence[Width] = (LARGE, LARGE),
        seed: int = 0,
        base: Correlation | None = None,
        wake: MomentBasis | None = None,
    ) -> NeighborClosure:
        """Random weights, which the host draws; the bases have orders `ORDER`, two and one, the widths are of each
        level.

        Raises:
            InputError: an argument is of another kind.
        """
        _require(basis, carried, wake, widths, seed)
        counts = [basis.count(order) for order in range(ORDER + 1)]
        if wake is not None:
            counts[:2] = [count + wake.count(order) for order, count in enumerate(counts[:2])]
        levels = [Level.initial(counts, widths[0], seed)]
        if carried is not None:
            zero, one = carried_counts(carried)
            further = [counts[0] + zero, counts[1] + one, *counts[2:]]
            levels.append(Level.initial(further, widths[1], seed + 1))
        scale = np.zeros((4, 6), np.float32)
        scale[:, 0] = np.log(SCALE)
        law = base_law(base, Tang())
        return cls(tuple(levels), jnp.asarray(scale), jnp.zeros(8, jnp.float32), law, basis, carried, wake)

    @property
    def regions(self) -> tuple[tuple[float, float], ...]:
        """Half lengths along the slip and across it of the ellipsoids in which neighbours count [diameters]."""
        bases = [basis for basis in (self.basis, self.carried, self.wake) if basis is not None]
        every = {(basis.reach * basis.stretch, basis.reach) for basis in bases}
        return tuple(sorted(one for one in every if not any(_holds(other, one) for other in every - {one})))

    @property
    def reach(self) -> float:
        """Diameters within which neighbours count [-]."""
        return max(max(region) for region in self.regions)

    @property
    def half_box(self) -> float:
        """Half of the narrowest periodic box of data for it [diameters]: within it each neighbour counts once, and in
        a wake, which is narrow, its images along the stream beside it, but not the sphere's own."""
        round_ones = max(basis.reach for basis in (self.basis, self.carried, self.wake) if basis is not None)
        return round_ones if self.wake is None else max(round_ones, 0.5 * self.wake.length)

    def moments(self, offset: Offset, present: Array) -> tuple[Array, ...]:
        """What the first level mixes: the moments of `basis`, and those of `wake` behind them; see `moments`."""
        found = moments(self.basis, offset, present)
        return found if self.wake is None else with_wake(found, moments(self.wake, offset, present))

    def __call__(self, inputs: DragInputs) -> Drag:
        """The mean law, with `out_of_range` where less than half of the fluctuation would act."""
        drag = self.base(inputs)
        outside = range_weight(inputs.reynolds, inputs.solid_fraction) < 0.5
        return drag._replace(out_of_range=drag.out_of_range | outside)

    def response(self, values: Array, crowd: Array, reynolds: Array, solid_fraction: Array) -> Response:
        """The fluctuation.

        Args:
            values: (N, 6) of the last level.
            crowd: (N,) the moment of n = l = m = 0, a number of neighbours [-].
            reynolds: (N,) of the superficial slip [-].
            solid_fraction: (N,) of the surroundings at large [-].
        """
        weight = range_weight(reynolds, solid_fraction) * presence(crowd)
        known = quartic(conditions(reynolds, solid_fraction))
        factors = constant(self.scale, values.dtype)
        scale = jnp.exp(jnp.dot(known[:, :6], factors.T, precision=PRECISION))
        along = scale[:, 0] * values[:, 0] - jnp.sum(known * constant(self.mean, values.dtype)[None], axis=1)
        across = scale[:, 1:2] * values[:, 1:3]
        torque = jnp.concatenate([scale[:, 2:3] * values[:, 3:4], scale[:, 3:] * values[:, 4:]], axis=1)
        return Response(weight * along, weight[:, None] * across, weight[:, None] * torque, weight)


def _holds(larger: tuple[float, float], smaller: tuple[float, float]) -> bool:
    return all(a >= b for a, b in zip(larger, smaller, strict=True))


def positive_multiple(multiple: Array) -> Array:
    """The multiple where it is not small, else one that approaches zero exponentially; once differentiable [-]."""
    small = multiple < SMALLEST_MULTIPLE
    exponent = jnp.where(small, multiple / SMALLEST_MULTIPLE - 1.0, 0.0)
    return jnp.where(small, SMALLEST_MULTIPLE * jnp.exp(exponent), multiple)

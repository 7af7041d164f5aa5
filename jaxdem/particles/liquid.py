"""The liquid of capillary bridges: taken from the films of grains that touch, given back when a bridge ruptures.

Every grain holds a film. Two bodies that touch and have no bridge make one: it takes from each grain a part of its
film, `bridge_share`, or an equal part of all of it if more bridges than 1 / `bridge_share` form on a grain at once. A
grain with more liquid than the wettest one had at the start gives as that one, so that no bridge is longer than the
list's reach. A bridge keeps its volume until it ruptures; then each grain gets half of it, so liquid goes from wet
grains to dry ones. A wall has no film: at a wall the bridge takes from the grain alone, and all of it goes back.
Nothing else moves liquid: it does not drain, evaporate or flow along surfaces, and films do not change how grains
touch. Films and bridges together keep their volume to rounding. A bridge acts from the step after its making.

Source: a simple form of D. Shi, J. J. McCarthy, Powder Technol. 184 (2008) 64-75.
"""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.particles.cohesion import CohesionConstants, rupture_distance
from jaxdem.particles.pairs import Pairs, at, sum_over_pairs
from jaxdem.particles.stages import stage


def with_pairs(
    overlap: Array, volume: Array, film: Array, pairs: Pairs, constants: CohesionConstants
) -> tuple[Array, Array]:
    """Volumes (P,) of the bridges between grains, and films (N,), after those that form and rupture now [m3].

    Args:
        overlap: (P,) negative for a gap [m].
        volume: (P,) of the bridges, 0 for none [m3].
        film: (N,) liquid of every grain that is in no bridge [m3].
        pairs: of the list.
        constants: of the liquid.
    """

    def per_grain(value: Array) -> Array:
        return sum_over_pairs(value, value, pairs)

    def taken(offer: Array) -> tuple[Array, Array]:
        return at((offer,), pairs.first)[0], at((offer,), pairs.second)[0]

    return _exchanged(overlap, volume, film, constants, (per_grain, taken, 0.5))


def with_walls(overlap: Array, volume: Array, film: Array, constants: CohesionConstants) -> tuple[Array, Array]:
    """The same of bridges (S, N) between the grains and S walls."""

    def per_grain(value: Array) -> Array:
        return jnp.sum(value, axis=0)

    def taken(offer: Array) -> tuple[Array, Array]:
        return jnp.broadcast_to(offer[None], volume.shape), jnp.zeros((), offer.dtype)

    return _exchanged(overlap, volume, film, constants, (per_grain, taken, 1.0))


_Bodies = tuple[Callable[[Array], Array], Callable[[Array], tuple[Array, Array]], float]
"""Sum over the bridges of every grain; what two bodies give, from what every grain offers; part that each gets back."""


def _exchanged(
    overlap: Array, volume: Array, film: Array, constants: CohesionConstants, bodies: _Bodies
) -> tuple[Array, Array]:
    per_grain, taken, part = bodies
    exists = volume > 0
    limit = rupture_distance(jnp.where(exists, volume, 1.0), constants)
    ruptures, forms = exists & (-overlap > limit), ~exists & (overlap > 0)

    def change() -> tuple[Array, Array]:
        number = per_grain(forms.astype(film.dtype))
        share = jnp.minimum(required(constants.bridge_share, "bridge_share"), 1.0 / jnp.maximum(number, 1.0))
        offer = share * jnp.minimum(film, required(constants.largest_film, "largest_film"))
        one, other = taken(offer)
        made, returned = jnp.where(forms, one + other, 0.0), jnp.where(ruptures, volume, 0.0)
        return made - returned, part * per_grain(returned) - number * offer

    more, back = stage(jnp.any(ruptures | forms), change)
    return jnp.where(ruptures, 0.0, volume + more), film + back

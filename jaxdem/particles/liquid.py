"""The liquid of capillary bridges: taken from the films of grains that touch, given back when a bridge ruptures.

Every grain holds a film. Two bodies that touch and have no bridge make one: it takes from each grain the part
`bridge_share` of its film. That is so small that all bridges for which there is room may form at once. A grain with
more liquid than the wettest one had at the start gives as that one, so that no bridge is longer than the list's reach.
A bridge keeps its volume until it ruptures; then each grain gets half of it, so liquid goes from wet
grains to dry ones. A wall has no film: at a wall the bridge takes from the grain alone, and all of it goes back.
Nothing else moves liquid: it does not drain, evaporate or flow along surfaces, and films do not change how grains
touch. Films and bridges together keep their volume to rounding. A bridge acts from the step after its making.

Source: a simple form of D. Shi, J. J. McCarthy, Powder Technol. 184 (2008) 64-75.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics.stages import stage
from jaxdem.particles.cohesion import CohesionConstants, rupture_factor
from jaxdem.particles.pairs import Pairs, at, sum_over_pairs


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
    forms, ruptures = _changes(overlap, volume, constants)

    def change() -> tuple[Array, Array]:
        offer = _offer(film, constants)
        one, other = (jnp.where(forms, at((offer,), who)[0], 0.0) for who in (pairs.first, pairs.second))
        back = jnp.where(ruptures, 0.5 * volume, 0.0)
        return one + other, sum_over_pairs(back - one, back - other, pairs)

    made, gained = stage(jnp.any(ruptures | forms), change)
    return jnp.where(ruptures, 0.0, volume + made), film + gained


def with_walls(overlap: Array, volume: Array, film: Array, constants: CohesionConstants) -> tuple[Array, Array]:
    """The same of bridges (S, N) between the grains and S walls."""
    forms, ruptures = _changes(overlap, volume, constants)

    def change() -> tuple[Array, Array]:
        made = jnp.where(forms, _offer(film, constants)[None], 0.0)
        return made, jnp.sum(jnp.where(ruptures, volume, 0.0) - made, axis=0)

    made, gained = stage(jnp.any(ruptures | forms), change)
    return jnp.where(ruptures, 0.0, volume + made), film + gained


def _changes(overlap: Array, volume: Array, constants: CohesionConstants) -> tuple[Array, Array]:
    """Which bridges form, and which rupture."""
    exists = volume > 0
    return ~exists & (overlap > 0), exists & ((-overlap) ** 3 > rupture_factor(constants) ** 3 * volume)


def _offer(film: Array, constants: CohesionConstants) -> Array:
    """What every grain gives to a bridge [m3]."""
    largest = required(constants.largest_film, "largest_film")
    return required(constants.bridge_share, "bridge_share") * jnp.minimum(film, largest)

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

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxdem.errors import required
from jaxdem.numerics.batches import cond_in_batch
from jaxdem.numerics.stages import stage
from jaxdem.particles.capillary_bridge import rupture_factor
from jaxdem.particles.cohesion import CohesionConstants
from jaxdem.particles.contact_pair import sum_slots
from jaxdem.particles.pairs import Pairs, at, sum_over_pairs

FEW = 16
"""So many bridges that form or rupture in a step are taken one by one; of more the sums over all pairs are cheaper."""

BLOCK = 2048
"""Pairs of a block in which they are looked for."""


def changes(overlap: Array, volume: Array, constants: CohesionConstants) -> Array:
    """bool, bridges that form now, where there is none, or rupture, where there is one; elementwise.

    Args:
        overlap: negative for a gap [m].
        volume: of the bridge, 0 for none [m3].
        constants: of the liquid.
    """
    ruptures = (-overlap) ** 3 > rupture_factor(constants) ** 3 * volume
    return jnp.where(volume > 0, ruptures, overlap > 0)


def with_pairs(
    changed: Array, volume: Array, film: Array, pairs: Pairs, constants: CohesionConstants, sparsely: bool = False
) -> tuple[Array, Array]:
    """Volumes (P,) of the bridges between grains, and films (N,), after those that form and rupture now [m3].

    Args:
        changed: (P,) bool, see `changes`.
        volume: (P,) of the bridges, 0 for none [m3].
        film: (N,) liquid of every grain that is in no bridge [m3].
        pairs: of the list.
        constants: of the liquid.
        sparsely: few changes are taken one by one, which cannot be run backwards; static.
    """
    given = volume, film
    if not sparsely or jax.default_backend() != "cpu":
        return _all_at_once(changed, given, film, pairs, constants)
    taken, bound, left = _one_by_one(changed, given, pairs, constants)

    def rest(now: tuple[Array, Array]) -> tuple[Array, Array]:
        before = jnp.arange(len(changed), dtype=jnp.int32) < bound
        return _all_at_once(changed & before, now, film, pairs, constants)

    return cond_in_batch(left, rest, taken)


def _all_at_once(
    changed: Array, now: tuple[Array, Array], film: Array, pairs: Pairs, constants: CohesionConstants
) -> tuple[Array, Array]:
    """Volumes and films after these changes; every grain gives of `film`."""
    volume, films = now
    forms, ruptures = changed & ~(volume > 0), changed & (volume > 0)

    def change() -> tuple[Array, Array]:
        offer = _offer(film, constants)
        one, other = (jnp.where(forms, at((offer,), who)[0], 0.0) for who in (pairs.first, pairs.second))
        back = jnp.where(ruptures, 0.5 * volume, 0.0)
        return one + other, sum_over_pairs(back - one, back - other, pairs)

    made, gained = stage(jnp.any(changed), change)
    return jnp.where(ruptures, 0.0, volume + made), films + gained


class _Taken(NamedTuple):
    """Changes that have been taken one by one.

    Attributes:
        number: of them.
        places, volumes: (FEW,) where they are, and of the bridges there from now on [m3].
        films: (N,) [m3].
        bound: those at this place and behind it are taken.
        marks: (blocks,) bool, blocks with some that are not.
    """

    number: Array
    places: Array
    volumes: Array
    films: Array
    bound: Array
    marks: Array


def _one_by_one(
    changed: Array, now: tuple[Array, Array], pairs: Pairs, constants: CohesionConstants
) -> tuple[tuple[Array, Array], Array, Array]:
    """Volumes and films after the last few changes; the place before which others are; and whether there are any.

    Volumes are written at the end, so that the array changes where it stands in memory.
    """
    (volume, film), size = now, min(BLOCK, len(changed))
    whole = (len(changed) - 1) // size  # the last block may be shorter
    marks = [jnp.any(changed[: whole * size].reshape(whole, size), axis=1), jnp.any(changed[whole * size :])[None]]
    blocks, own = jnp.arange(whole + 1, dtype=jnp.int32), jnp.arange(size, dtype=jnp.int32)

    def take(taken: _Taken) -> _Taken:
        block = jnp.max(jnp.where(taken.marks, blocks, -1))
        start = jnp.minimum(block * size, len(changed) - size)
        here = start + own
        among = lax.dynamic_slice_in_dim(changed, start, size) & (here >= block * size) & (here < taken.bound)
        place = jnp.max(jnp.where(among, here, -1))
        before, made, films = volume[place], jnp.zeros((), film.dtype), taken.films
        for who in (pairs.first[place], pairs.second[place]):
            gives = jnp.where(before > 0, 0.0, _offer(film[who], constants))
            films, made = films.at[who].add(0.5 * before - gives), made + gives
        return _Taken(
            taken.number + 1,
            taken.places.at[taken.number].set(place),
            taken.volumes.at[taken.number].set(made),
            films,
            place,
            taken.marks.at[block].set(jnp.any(among & (here < place))),
        )

    none = jnp.full(FEW, len(changed), jnp.int32)
    start = _Taken(jnp.int32(0), none, jnp.zeros(FEW, volume.dtype), film, none[0], jnp.concatenate(marks))
    taken = lax.while_loop(lambda taken: (taken.number < FEW) & jnp.any(taken.marks), take, start)
    volumes = volume.at[taken.places].set(taken.volumes, mode="drop")
    return (volumes, taken.films), taken.bound, jnp.any(taken.marks)


def with_walls(overlap: Array, volume: Array, film: Array, constants: CohesionConstants) -> tuple[Array, Array]:
    """The same of bridges (S, N) between the grains and S walls, at these overlaps [m]."""
    changed = changes(overlap, volume, constants)

    def change(now: tuple[Array, Array]) -> tuple[Array, Array]:
        volumes, films = now
        made = jnp.where(changed & ~(volumes > 0), _offer(films, constants)[None], 0.0)
        back = jnp.where(changed, volumes, 0.0)
        return volumes + made - back, films + sum_slots(back - made)

    if jax.default_backend() != "cpu":  # a branch makes the host wait for other devices
        return change((volume, film))
    return cond_in_batch(jnp.any(changed), change, (volume, film))


def _offer(film: Array, constants: CohesionConstants) -> Array:
    """What every grain gives to a bridge [m3]."""
    largest = required(constants.largest_film, "largest_film")
    return required(constants.bridge_share, "bridge_share") * jnp.minimum(film, largest)

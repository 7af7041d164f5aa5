"""Many scenes as one: states and parameters stacked along a leading axis, for vmap.

Example:
    >>> members = [jaxdem.initial_state(scene, simulation, parameters) for scene in scenes]  # doctest: +SKIP
    >>> states, neighbors = stack_states(simulation, members)  # doctest: +SKIP
    >>> many = jax.vmap(lambda p, s, n: jaxdem.rollout(simulation, p, s, n, 100))  # doctest: +SKIP
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp

from jaxdem.errors import InputError
from jaxdem.particles.neighbors import Neighbors, Room
from jaxdem.simulation import Simulation
from jaxdem.state import State

Tree = TypeVar("Tree")


def stack(members: Sequence[Tree]) -> Tree:
    """Trees of arrays of one structure as one tree, each array with a leading axis for the members: `Parameters`, say.

    Raises:
        InputError: none is given, or arrays differ in shape or structure.
    """
    if not members:
        raise InputError("members", [], "needs at least one member", "Give a list of states or parameters.")
    wanted = _shapes(members[0])
    for number, member in enumerate(members):
        if _shapes(member) != wanted:
            limit = "must have the arrays and shapes of member 0"
            remedy = "A batch is one compiled program: same number of particles, cells and options."
            raise InputError(f"members[{number}]", type(member).__name__, limit, remedy)
    return jax.tree.map(lambda *arrays: jnp.stack(arrays), *members)


def stack_states(
    simulation: Simulation, members: Sequence[tuple[State, Neighbors | None]]
) -> tuple[State, Neighbors | None]:
    """States with their neighbour lists stacked; each list gets the room of the largest.

    Args:
        simulation: that all of them belong to.
        members: as `jaxdem.initial_state` gives them.

    Raises:
        InputError: see `stack`.
    """
    lists = [neighbors for _, neighbors in members if neighbors is not None]
    if lists and len(lists) == len(members):
        room = functools.reduce(Room.covering, (one.room for one in lists))
        members = [
            (state, neighbors) if neighbors.room == room else simulation.with_room(state, neighbors, room)
            for (state, _), neighbors in zip(members, lists, strict=True)
        ]
    return stack(list(members))


def _shapes(tree: Any) -> Any:
    return jax.tree.structure(tree), [(jnp.shape(leaf), jnp.result_type(leaf)) for leaf in jax.tree.leaves(tree)]

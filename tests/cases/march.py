"""A scene run for stretches of any length, with the mean of what is observed: what the studies share."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

import jaxdem
from jaxdem.failures import Failure, failures, first_meaning
from jaxdem.particles.integrate import split_low
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.surfaces import DistanceFunction
from jaxdem.simulation import Simulation
from jaxdem.state import Diagnostics, Parameters, State

Observe = Callable[[State, Diagnostics], Any]
"""Numbers or arrays, from the state after an interval and the interval's report."""


class March:
    """A simulation, its state, and one compiled loop for stretches of any length.

    Attributes:
        scene: as read.
        simulation: static structure.
        parameters: may be replaced between stretches; nothing is compiled again.
        place: what the movable walls are given; may be replaced too.
        state: reached so far.
        neighbors: its neighbour list.
    """

    def __init__(
        self,
        tables: Mapping[str, Any],
        observe: Observe | None = None,
        walls: Sequence[Callable[[Array, Array], Array]] = (),
        place: float = 0.0,
    ):
        """Builds the scene of these tables.

        Args:
            tables: of the scene file.
            observe: what `advance` gives the mean of; nothing when not given.
            walls: signed distances (place, x (D,) [m]) -> () [m] of walls that may be elsewhere in each stretch.
            place: where the walls stand at first.
        """
        self.scene = jaxdem.load_scene(dict(tables))
        self.simulation, self.parameters = jaxdem.build(
            self.scene, walls=[partial(wall, jnp.asarray(place)) for wall in walls]
        )
        self.state, self.neighbors = jaxdem.initial_state(self.scene, self.simulation, self.parameters)
        self.place = place
        self._walls = tuple(walls)
        self._observe = observe or (lambda state, diagnostics: ())
        self._stretch = jax.jit(self._run)

    @property
    def position(self) -> np.ndarray:
        """(N, D) centres [m]."""
        assert self.state.particles is not None
        return np.asarray(self.state.particles.position, float)

    def restart(self, position: np.ndarray) -> None:
        """Particles at rest at other places (N, D) [m], in a scene without a fluid."""
        particles, old = self.state.particles, self.neighbors
        assert particles is not None and old is not None
        leading = jnp.asarray(position, particles.position.dtype)
        low = particles.position_low
        if low is not None:
            low = jnp.asarray(position - np.asarray(leading, float), low.dtype)
        particles = jax.tree.map(jnp.zeros_like, particles)._replace(position=leading, position_low=low)
        self.state = State(particles, None, jnp.zeros_like(self.state.step))
        axes = tuple(leading.T)
        # As many slots as the list has, so that the compiled loop still fits.
        self.neighbors = self.simulation.search.allocate(axes, split_low(low, len(axes)), old.radius, old.room)
        self._fit(old.room.pairs)

    def advance(self, duration: float) -> Any:
        """The mean of the observations over `duration` [s], rounded to whole coupling intervals.

        Raises:
            RuntimeError: an interval failed; if the neighbour list was too short it is repeated with a longer one.
        """
        count = max(1, round(duration / self.simulation.interval))
        while True:
            state, neighbors, code, mean = self._stretch(self.place, self.parameters, self.state, self.neighbors, count)
            # What follows an overflow means nothing: the stretch is repeated.
            if not int(code) & Failure.OVERFLOW:
                break
            assert self.neighbors is not None
            self.state, self.neighbors = self.simulation.with_room(
                self.state, self.neighbors, self.neighbors.room.enlarged()
            )
        if int(code):
            raise RuntimeError(first_meaning(int(code))[0])
        self.state, self.neighbors = state, neighbors
        return mean

    def _fit(self, pairs: int) -> None:
        """Contact springs of so many pairs, all zero."""
        particles = self.state.particles
        assert particles is not None
        springs = tuple(jnp.zeros(pairs, x.dtype) for x in particles.contact_spring)
        self.state = self.state._replace(particles=particles._replace(contact_spring=springs))

    def _placed(self, place: Array) -> Simulation:
        """The simulation with its movable walls where they stand."""
        if not self._walls or self.simulation.contact is None:
            return self.simulation
        surfaces = tuple(DistanceFunction(partial(wall, place)) for wall in self._walls)
        model = dataclasses.replace(self.simulation.contact.model, surfaces=surfaces)
        return dataclasses.replace(self.simulation, contact=dataclasses.replace(self.simulation.contact, model=model))

    def _run(
        self, place: Array, parameters: Parameters, state: State, neighbors: Neighbors | None, count: Array
    ) -> tuple[State, Neighbors | None, Array, Any]:
        simulation = self._placed(place)

        def one(carry: Any) -> tuple[Any, Any]:
            state, neighbors, diagnostics = simulation.step(parameters, *carry)
            return (state, neighbors), (self._observe(state, diagnostics), failures(simulation, diagnostics))

        shapes = jax.eval_shape(one, (state, neighbors))[1]
        total, flags = jax.tree.map(lambda shape: jnp.zeros(shape.shape, shape.dtype), shapes)

        def body(_: Array, carry: Any) -> Any:
            both, total, flags = carry
            both, (seen, code) = one(both)
            return both, jax.tree.map(jnp.add, total, seen), flags | code

        (state, neighbors), total, flags = lax.fori_loop(0, count, body, ((state, neighbors), total, flags))
        return state, neighbors, flags, jax.tree.map(lambda x: x / count, total)

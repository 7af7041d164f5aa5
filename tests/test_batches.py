"""Scenes run as a batch give what each gives alone, rebuild their lists only when one must, and have gradients."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.ensemble import stack, stack_states
from jaxdem.errors import InputError
from jaxdem.numerics.batches import cond_in_batch

SCENE = {
    "precision": "float64",
    "domain": {"size": [0.2, 0.2]},
    "particles": {"radius": 0.01, "density": 2650.0, "position": [[0.05, 0.05], [0.0702, 0.05], [0.15, 0.1]]},
    "contact": {"young_modulus": 1e6, "skin": 0.001},
    "time": {"end": 0.1, "output_interval": 0.01},
}


@pytest.fixture(scope="module")
def batch():
    """Simulation, and three members that differ in their velocities and gravity."""
    scene = jaxdem.load_scene(SCENE)
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    members, numbers = [], []
    for speed in (0.0, 0.4, 2.0):
        velocity = jnp.asarray([[speed, 0.0], [0.0, 0.0], [0.0, speed]])
        members.append((state._replace(particles=state.particles._replace(velocity=velocity)), neighbors))
        numbers.append(parameters._replace(gravity=parameters.gravity * (1.0 + speed)))
    # The list of one has more room than the others.
    members[1] = simulation.with_room(*members[1], neighbors.room.enlarged())
    return simulation, stack(numbers), *stack_states(simulation, members)


def test_a_batch_gives_what_its_members_give_alone(batch):
    """Alone: among copies of itself, in the same compiled program."""
    simulation, *arguments = batch

    @jax.jit
    @jax.vmap
    def run(parameters, state, neighbors):
        end = jaxdem.rollout(simulation, parameters, state, neighbors, 2, reversible=False)
        return end.state.particles, end.neighbors.builds, end.failures

    together = run(*arguments)
    for number in range(3):
        alone = run(*jax.tree.map(lambda array, n=number: array[jnp.full(3, n)], arguments))
        for given, wanted in zip(jax.tree.leaves(together), jax.tree.leaves(alone), strict=True):
            np.testing.assert_array_equal(given[number], wanted[number])
    builds, failures = together[1:]
    assert builds[0] < builds[2], "members rebuild at different times"
    assert not failures.any()


def test_a_branch_is_taken_for_all_where_one_needs_it_and_kept_by_those_that_do():
    """The branch stays one in the compiled program, gradients pass, and a batch of batches is a batch."""
    taken = []

    def change(x):
        jax.debug.callback(lambda _: taken.append(1), x)
        return x**2

    def run(condition, x):
        return cond_in_batch(condition, change, x)

    no, some = jnp.zeros(3, bool), jnp.asarray([False, True, False])
    x = jnp.asarray([2.0, 3.0, 4.0])
    many = jax.jit(jax.vmap(run))
    assert many(no, x).tolist() == [2.0, 3.0, 4.0]
    jax.effects_barrier()
    assert not taken, "computed by none where none needs it"
    assert many(some, x).tolist() == [2.0, 9.0, 4.0]
    jax.effects_barrier()
    assert taken
    assert jax.jit(jax.vmap(jax.vmap(run)))(jnp.stack([no, some]), jnp.stack([x, x])).tolist() == [
        [2.0, 3.0, 4.0],
        [2.0, 9.0, 4.0],
    ]

    def square(x):
        return cond_in_batch(x > 2.5, lambda x: x**2, x)

    assert jax.vmap(jax.grad(square))(x).tolist() == [1.0, 6.0, 8.0]
    assert jax.grad(lambda x: jax.vmap(square)(x).sum())(x).tolist() == [1.0, 6.0, 8.0]


def test_what_is_not_alike_cannot_be_stacked():
    with pytest.raises(InputError, match="at least one"):
        stack([])
    with pytest.raises(InputError, match=r"members\[1\]"):
        stack([{"a": np.zeros(2)}, {"a": np.zeros(3)}])

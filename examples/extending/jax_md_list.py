"""Neighbour lists of jax-md: it finds who is near whom, and jaxdem computes the contacts.

Grains fall into a box with a periodic side. jax-md updates its list before every step of jaxdem, in the same compiled
loop. The motion is compared with that of a run that makes its own lists.

Run: python examples/extending/jax_md_list.py
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax_md import partition

import jaxdem
from jaxdem.particles.integrate import centres_in_box

SIZE, STEPS = (0.2, 0.2), 200
SCENE = {
    "precision": "float64",
    "domain": {"size": list(SIZE)},
    "particles": {
        "radius": 0.01,
        "density": 2500.0,
        "position": [[0.02 + 0.04 * i + 0.011 * j, 0.012 + 0.03 * j] for i in range(5) for j in range(5)],
        "velocity": [[0.3, 0.0]] * 25,
    },
    "contact": {"young_modulus": 1e6, "restitution": 0.5, "friction": 0.4},
    "boundary": {"left": {"kind": "periodic"}, "right": {"kind": "periodic"}},
    "time": {"end": 0.2, "output_interval": 0.001},
}


def displacement(a: Array, b: Array, **_: Any) -> Array:
    """From b to a, to the nearest image across the periodic side."""
    apart = a - b
    return apart.at[0].add(-SIZE[0] * jnp.round(apart[0] / SIZE[0]))


def main() -> tuple[np.ndarray, np.ndarray, int]:
    """Positions (25, 2) at the end with lists of jax-md, and with jaxdem's own [m]; number of own lists beside
    jax-md's."""
    scene = jaxdem.load_scene(SCENE)
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    own = jax.jit(lambda s, n: jaxdem.rollout(simulation, parameters, s, n, STEPS, reversible=False))(state, neighbors)

    # The list must reach the largest diameter and the skin; jax-md rebuilds it after moves of half of its threshold.
    near = simulation.search.geometry
    cutoff, threshold = near.cutoff + 0.6 * near.skin, 0.4 * near.skin
    functions = partition.neighbor_list(displacement, np.array(SIZE), cutoff, threshold)

    def position(state: Any) -> Array:
        return centres_in_box(state.particles, simulation.box, simulation.periodic)

    def step(_: int, carry: Any) -> Any:
        state, neighbors, listed, overflow = carry
        listed = functions.update(position(state), listed)
        state, neighbors = jaxdem.neighbors_from_jax_md(simulation, state, neighbors, listed)
        state, neighbors, report = simulation.step(parameters, state, neighbors)
        return state, neighbors, listed, overflow | report.particles.overflow

    listed = functions.allocate(position(state), extra_capacity=8)  # room for the pile that is to come
    jaxdem.neighbors_from_jax_md(simulation, state, neighbors, listed)  # once outside of jit: that refuses a wrong list
    carry = state, neighbors, listed, jnp.zeros((), bool)
    end, last, _, overflow = jax.jit(lambda carry: lax.fori_loop(0, STEPS, step, carry))(carry)
    assert not overflow, "allocate the list anew, enlarge that of jaxdem by Simulation.with_room, and start again"
    made = int(last.builds) - int(neighbors.builds) - STEPS
    found, expected = np.asarray(end.particles.position), np.asarray(own.state.particles.position)
    print(f"after {STEPS} steps the positions differ by {np.abs(found - expected).max():.1e} m at most")
    print(f"lists that jaxdem made of its own: {made}")
    return found, expected, made


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()

"""Your own cohesion: adhesive elastic spheres, compared with the rebound that Thornton and Ning have published.

Two grains meet at several speeds. Below the sticking speed they stay together; above it they lose the work of the neck
that forms between them when they touch and is drawn out before it tears.

Run: python examples/extending/cohesion.py
"""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import jaxdem
from jaxdem.particles.cohesion import Attraction, CohesionConstants, Gap


@dataclasses.dataclass(frozen=True)
class AdhesiveSpheres:
    """F = 4 E* a^3 / (3 R*) - sqrt(8 pi w E* a^3), a the contact radius: d = a^2/R* - sqrt(2 pi w a / E*).

    The contact law is evaluated at the overlap a^2/R*, where Hertz's force is the first term. The second is the pull. A
    contact begins at d = 0 and ends where a(d) ends, at d = -3/4 (pi^2 w^2 R* / E*^2)^(1/3).

    Attributes:
        steps: of Newton's method for a.
    """

    steps: int = 12
    memory = 1  # values that a contact keeps: whether it has begun
    sudden = True  # the pull begins and ends at once with the contact

    def reach(self, gap: Gap, constants: CohesionConstants) -> Array:
        """Largest gap at which two bodies act on each other [m]."""
        ratio = math.pi * constants.strength / gap.modulus
        return 0.75 * jnp.cbrt(ratio**2 * gap.effective_radius)

    def __call__(self, gap: Gap, constants: CohesionConstants, memory: tuple[Array, ...]) -> Attraction:
        """See `jaxdem.particles.cohesion.Cohesion`."""
        has_begun = memory[0] > 0
        end = jnp.where(has_begun, -self.reach(gap, constants), 0.0)
        depth = gap.overlap - end
        overlap = jnp.maximum(gap.overlap, end)
        # Newton's method comes down from above, for the function is convex.
        ratio = 2.0 * math.pi * constants.strength / gap.modulus
        radius = jnp.sqrt(gap.effective_radius * jnp.maximum(overlap, 0.0))
        radius = radius + 2.0 * jnp.cbrt(ratio * gap.effective_radius**2)
        for _ in range(self.steps):
            value = radius**2 / gap.effective_radius - jnp.sqrt(ratio * radius) - overlap
            slope = 2.0 * radius / gap.effective_radius - 0.5 * jnp.sqrt(ratio / radius)
            radius = radius - value / slope
        pull = jnp.sqrt(8.0 * math.pi * constants.strength * gap.modulus * radius**3)
        touches = (depth > 0).astype(overlap.dtype)
        return Attraction(
            depth=depth,
            overlap=radius**2 / gap.effective_radius,
            pull=pull,
            friction=3.0 * math.pi * constants.strength * gap.effective_radius - pull,  # Coulomb: mu |F + 2 F_pulloff|
            damping=None,
            kept=(touches,),
            holds=has_begun,
        )


RADIUS, DENSITY, MODULUS, POISSON, WORK = 1e-3, 2500.0, 1e7, 0.3, 0.1
FACTORS = np.array([0.9, 1.1, 1.5, 2.0, 4.0])
"""Speeds over the sticking speed."""

HALF_GAP = 1e-6
SCENE = {
    "precision": "float64",
    "domain": {"size": [0.01, 0.01], "gravity": [0.0, 0.0]},
    "particles": {
        "radius": RADIUS,
        "density": DENSITY,
        "position": [[0.005 - RADIUS - HALF_GAP, 0.005], [0.005 + RADIUS + HALF_GAP, 0.005]],
    },
    # The table gives the numbers and the reach; the kind is replaced by the one above.
    "contact": {
        "young_modulus": MODULUS,
        "poisson_ratio": POISSON,
        "restitution": 1.0,
        "friction": 0.0,
        "speed": 0.04,
        "cohesion": {"kind": "jkr", "work_of_adhesion": WORK},
    },
    "time": {"end": 0.006, "output_interval": 0.006},
}


def main() -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of restitution, and those of Thornton and Ning, e = sqrt(1 - (V_s/V)^2), 0 below V_s.

    V_s = (14.18/m*)^(1/2) (w^5 R*^4 / E*^2)^(1/6). Source: C. Thornton, Z. Ning, Powder Technol. 99 (1998) 154-162.
    """
    effective_modulus, effective_radius = MODULUS / (2.0 * (1.0 - POISSON**2)), 0.5 * RADIUS
    effective_mass = 0.5 * DENSITY * 4.0 / 3.0 * math.pi * RADIUS**3
    work = (WORK**5 * effective_radius**4 / effective_modulus**2) ** (1.0 / 3.0)
    sticking = math.sqrt(14.18 * work / effective_mass)
    expected = np.sqrt(np.maximum(1.0 - FACTORS**-2.0, 0.0))

    scene = jaxdem.load_scene(SCENE)
    simulation, parameters = jaxdem.build(scene, cohesion=AdhesiveSpheres())
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    steps = simulation.steps.outputs * simulation.steps.intervals_per_output

    def rebound(speed: Array) -> Array:
        """Speed at which two grains part, over that at which they meet; 0 if they stay together."""
        velocity = 0.5 * speed * jnp.asarray([[1.0, 0.0], [-1.0, 0.0]])
        particles = state.particles._replace(velocity=velocity)
        end = jaxdem.rollout(simulation, parameters, state._replace(particles=particles), neighbors, steps)
        after = end.state.particles
        apart = after.position[1, 0] - after.position[0, 0] > 2.0 * RADIUS + 2e-6
        return jnp.where(apart, (after.velocity[1, 0] - after.velocity[0, 0]) / speed, 0.0)

    found = np.asarray(jax.jit(jax.vmap(rebound))(jnp.asarray(sticking * FACTORS)))
    for factor, e, reference in zip(FACTORS, found, expected, strict=True):
        print(f"{factor:.1f} v_s, v_s = {sticking:.4f} m/s: restitution {e:.3f}, expected {reference:.3f}")
    return found, expected


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()

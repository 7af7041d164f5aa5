"""Your own contact law: Hertz and Mindlin with cohesion.

Two grains touch and attract each other until the elastic force balances the cohesion. Their overlap is then compared
with the closed form.

Run: python examples/extending/contact_law.py
"""

import dataclasses
import math

import jax
import numpy as np

import jaxdem
from jaxdem.particles.contact import Contact, ContactForce, ContactMaterial, HertzMindlin


@dataclasses.dataclass(frozen=True)
class CohesiveHertz:
    """F_n = F_Hertz - k A, with Hertz's contact area A = pi R* d. Coulomb's limit uses F_Hertz alone.

    Attributes:
        cohesion: k, force per contact area [Pa].
    """

    cohesion: float

    def __call__(self, contact: Contact, material: ContactMaterial) -> ContactForce:
        """See `jaxdem.particles.contact.ContactLaw`."""
        force = HertzMindlin()(contact, material)
        area = math.pi * contact.effective_radius * contact.overlap
        return force._replace(normal=force.normal - self.cohesion * area)


RADIUS, MODULUS, POISSON = 0.01, 1e7, 0.3
SCENE = {
    "domain": {"size": [0.2, 0.2], "gravity": [0.0, 0.0]},
    "particles": {
        "radius": RADIUS,
        "density": 2500.0,
        "position": [[0.1 - RADIUS + 1e-6, 0.1], [0.1 + RADIUS - 1e-6, 0.1]],
    },
    "contact": {"young_modulus": MODULUS, "poisson_ratio": POISSON, "restitution": 0.2, "speed": 0.2},
    "time": {"end": 0.03, "output_interval": 0.03},
}


def main() -> tuple[float, float]:
    """Overlap at rest, and the expected one, sqrt(d) = 3 pi k sqrt(R*) / (4 E*) [m]."""
    law = CohesiveHertz(cohesion=3e5)
    scene = jaxdem.load_scene(SCENE)
    simulation, parameters = jaxdem.build(scene, contact_law=law)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    steps = simulation.steps.outputs * simulation.steps.intervals_per_output
    end = jax.jit(lambda p, s, n: jaxdem.rollout(simulation, p, s, n, steps))(parameters, state, neighbors)
    effective_modulus, effective_radius = MODULUS / (2.0 * (1.0 - POISSON**2)), RADIUS / 2.0
    expected = (3.0 * math.pi * law.cohesion * math.sqrt(effective_radius) / (4.0 * effective_modulus)) ** 2
    position = np.asarray(end.state.particles.position, float)
    found = 2.0 * RADIUS - float(np.linalg.norm(position[1] - position[0]))
    print(f"the grains overlap by {1e6 * found:.2f} micrometres, expected {1e6 * expected:.2f}")
    return found, expected


if __name__ == "__main__":
    main()

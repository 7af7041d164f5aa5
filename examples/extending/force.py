"""Your own force of the fluid: particles that swim, each with a thrust along its own axis.

A force-free swimmer pushes the fluid back as it goes forwards. Its speed through the fluid is that at which the drag
equals the thrust, F / (3 pi mu d) by Stokes.

Run: python examples/extending/force.py
"""

import math
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

import jaxdem
from jaxdem.coupling.forces.protocol import Contribution, FluidForce, IntervalStart
from jaxdem.numerics.static import static


@static
class Thrust(FluidForce):
    """F along the first axis on every particle; the fluid gets the opposite.

    Attributes:
        size: F [N].
    """

    name: ClassVar[str] = "thrust"
    label: ClassVar[str] = "thrust of swimmers"
    size: float

    def begin(self, start: IntervalStart, memory: Any) -> Contribution:
        """See `FluidForce`; (N, D), constant over the interval."""
        return Contribution(force=jnp.zeros_like(start.slip).at[:, 0].set(self.size))


RADIUS, DENSITY, VISCOSITY, THRUST = 1e-3, 1000.0, 1e-4, 1e-7
SCENE = {
    "domain": {"size": [0.4, 0.4], "depth": 0.4, "gravity": [0.0, 0.0]},
    "particles": {"radius": RADIUS, "density": DENSITY, "position": [[0.2, 0.2]]},
    "contact": {"young_modulus": 1e6, "speed": 0.1},
    "fluid": {"cells": [8, 8], "density": DENSITY, "viscosity": VISCOSITY, "time_step": 0.005},
    "boundary": {"left": {"kind": "periodic"}, "bottom": {"kind": "free_slip"}, "top": {"kind": "free_slip"}},
    "coupling": {"drag": "stokes"},
    "time": {"end": 0.1, "output_interval": 0.1},
}


def main() -> tuple[float, float, float]:
    """Speed of the swimmer and the expected one [m/s], and the momentum of fluid and swimmer together over that of the
    swimmer [-]."""
    scene = jaxdem.load_scene(SCENE)
    simulation, parameters = jaxdem.build(scene, forces=[Thrust(size=THRUST)])
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    end = jax.jit(lambda p, s, n: jaxdem.rollout(simulation, p, s, n, steps=20))(parameters, state, neighbors)
    found, expected = float(end.state.particles.velocity[0, 0]), THRUST / (6.0 * math.pi * DENSITY * VISCOSITY * RADIUS)
    print(f"the swimmer has {1e6 * found:.3f} micrometres a second, expected {1e6 * expected:.3f}")
    own = 4.0 / 3.0 * math.pi * RADIUS**3 * DENSITY * found
    velocity = np.asarray(end.state.fluid.face_velocity[0][:-1], float)  # the last face is the first one again
    of_fluid = DENSITY * float(velocity.sum()) * 0.4 * (0.4 / 8) ** 2
    print(f"momentum of the swimmer {own:.4g} kg m/s, of the fluid {of_fluid:.4g} kg m/s")
    return found, expected, (own + of_fluid) / own


if __name__ == "__main__":
    main()

"""A kind of side of one's own for the fluid: a wall along which the fluid slips in proportion to its shear (Navier).

The velocity at the wall is b du/dn, with the slip length b. Between such a wall and one that moves with U a height H above it, the
velocity of a steady flow is U (y + b) / (H + b) (Navier 1823); the example compares it.

Run: python examples/extending/slip_wall.py
"""

import dataclasses

import jax
import numpy as np
from jax import Array

import jaxdem
from jaxdem.fluid.side_conditions import Wall


@dataclasses.dataclass(frozen=True)
class NavierSlip(Wall):
    """Nothing passes, as with its parent; a line through the fluid's velocity is zero at the slip length behind the wall.

    Attributes:
        slip_length: b [m].
    """

    slip_length: float = 0.0

    def ghosts(self, mirrored: Array, speed: Array, covered: Array, distance: Array) -> Array:
        """u(-y) = u(y) (b - y) / (b + y), with the velocity u over that of the wall."""
        return speed + (mirrored - speed) * (self.slip_length - distance) / (self.slip_length + distance)


SPEED, HEIGHT, SLIP = 0.1, 0.1, 0.04
SCENE = {
    "domain": {"size": [0.04, HEIGHT]},
    "fluid": {"cells": [2, 6], "viscosity": 1e-2, "time_step": 0.005},
    "boundary": {
        "left": {"kind": "periodic"},
        "right": {"kind": "periodic"},
        "top": {"kind": "moving_wall", "velocity": [SPEED, 0.0]},
    },
    "time": {"end": 3.0, "output_interval": 3.0},
}


def main() -> tuple[np.ndarray, np.ndarray]:
    """Velocity of the six layers of cells after 3 s [m/s], and that of the formula."""
    scene = jaxdem.load_scene(SCENE)
    simulation, parameters = jaxdem.build(scene, side_conditions={"bottom": NavierSlip(slip_length=SLIP)})
    state, _ = jaxdem.initial_state(scene, simulation, parameters)
    end = jax.jit(lambda p, s: jaxdem.rollout(simulation, p, s, None, steps=600))(parameters, state)
    found = np.asarray(end.state.fluid.face_velocity[0][0], float)
    height = (np.arange(6) + 0.5) * HEIGHT / 6
    expected = SPEED * (height + SLIP) / (HEIGHT + SLIP)
    print("velocity [m/s]:", np.round(found, 5))
    print("by the formula:", np.round(expected, 5))
    return found, expected


if __name__ == "__main__":
    main()

"""Your own boundary condition of the fluid: a wall with a slip velocity proportional to the shear (Navier).

The velocity at the wall is b du/dn, with the slip length b. Another wall, at the height H above it, moves with the
velocity U. The steady velocity in between is U (y + b) / (H + b) (Navier 1823). The example compares it.

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
    """No flow passes, as with `Wall`. The velocity profile, extended linearly, is zero at the slip length behind the
    wall.

    Attributes:
        slip_length: b [m].
    """

    slip_length: float = 0.0

    def ghosts(self, mirrored: Array, speed: Array, covered: Array, distance: Array) -> Array:
        """u(-y) = u(y) (b - y) / (b + y), with the velocity u relative to the wall."""
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
    """Velocity of the six layers of cells after 3 s, and that of the formula [m/s]."""
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

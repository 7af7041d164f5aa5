"""Your own inlet profile: the 1/7 power law of turbulent channel flow.

A profile is given by its integral, so the flow rate is the same on every mesh. The example compares it with the
exact one.

Run: python examples/extending/inlet_profile.py
"""

import dataclasses

import jax
import numpy as np

import jaxdem


@dataclasses.dataclass(frozen=True)
class PowerLaw:
    """(n + 1)/n (1 - |2 s - 1|)^(1/n), s from 0 to 1 across the patch, of mean 1.

    Attributes:
        exponent: n, 7 for a turbulent channel [-].
    """

    exponent: float = 7.0

    @property
    def peak(self) -> float:
        """Value in the middle [-]."""
        return (self.exponent + 1.0) / self.exponent

    def integral(self, position: np.ndarray, start: float, stop: float) -> np.ndarray:
        """Integral from `start` to `position` [m]: (2 s)^((n + 1)/n) / 2 in the lower half, mirrored in the upper."""
        s = (position - start) / (stop - start)
        below = 0.5 * (2.0 * np.minimum(s, 1.0 - s)) ** self.peak
        return (stop - start) * np.where(s < 0.5, below, 1.0 - below)


SPEED, HEIGHT = 0.5, 0.2
SCENE = {
    "domain": {"size": [0.4, HEIGHT]},
    "fluid": {"cells": [8, 6], "viscosity": 1e-4, "time_step": 0.01},
    "boundary": {
        "left": {"kind": "inlet", "velocity": SPEED, "ramp_time": 0.0},
        "right": {"kind": "outlet"},
    },
    "time": {"end": 0.1, "output_interval": 0.1},
}


def main() -> tuple[np.ndarray, float]:
    """Velocity of the inlet's faces [m/s], and the flow rate through them [m2/s]."""
    scene = jaxdem.load_scene(SCENE)
    simulation, parameters = jaxdem.build(scene, inlet_profiles={"left": [PowerLaw()]})
    state, _ = jaxdem.initial_state(scene, simulation, parameters)
    end = jax.jit(lambda p, s: jaxdem.rollout(simulation, p, s, None, steps=10))(parameters, state)
    inflow = np.asarray(end.state.fluid.face_velocity[0][0], float)
    rate = float(inflow.mean() * HEIGHT)
    print("inflow velocity over its mean:", np.round(inflow / SPEED, 3))
    print(f"flow rate {rate:.6f} m2/s, expected {SPEED * HEIGHT:.6f}")
    return inflow, rate


if __name__ == "__main__":
    main()

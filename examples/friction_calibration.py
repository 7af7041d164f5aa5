"""Calibration of friction from the run-off of a collapsing column, by gradients through the solver.

A column of 48 discs with friction 0.3 collapses; its run-off is measured every 20 ms, to 0.1 mm. From another guess the
friction is found again by Gauss-Newton steps. The derivative of every predicted run-off comes from forward-mode
differentiation through all contact steps.

This works because each prediction starts from the measured state 20 ms before. Over the whole collapse the derivative
is exact but useless, because impacts amplify every change: it is the slope of a curve as rough as the dots of the right
picture, not the slope of their trend. The script prints both slopes.

Run: python examples/friction_calibration.py [PICTURE]
"""

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402 - after the precision is set
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from pictures import save  # noqa: E402

import jaxdem  # noqa: E402

TRUE, GUESS, NOISE = 0.3, 0.6, 1e-4
WINDOW, WINDOWS = 2, 20
SCENE = {
    "precision": "float64",
    "domain": {"size": [0.5, 0.14]},
    "particles": {
        "count": 48,
        "density": 2500.0,
        "species": [{"share": 0.5, "radius": 0.0046}, {"share": 0.5, "radius": 0.0052}],
        "pack": {"kind": "lattice", "start": [0.0, 0.0], "stop": [0.066, 0.11], "jitter": 0.02},
    },
    "contact": {"young_modulus": 3e5, "restitution": 0.3, "rolling_friction": 0.4, "speed": 1.0},
    "time": {"end": 0.4, "output_interval": 0.01},
}

SEEDS = range(3)

simulation, parameters = jaxdem.build(jaxdem.load_scene(SCENE))
# Made once for each pack: the first neighbour list compiles programs, which takes longer than a collapse.
packs = [jaxdem.initial_state(jaxdem.load_scene(SCENE, {"seed": n}), simulation, parameters) for n in SEEDS]


def with_friction(friction: jax.Array):
    """The parameters with this friction. Walls have the same friction, because the scene gives them none of their
    own."""
    return parameters._replace(contact=parameters.contact._replace(friction=friction))


def smooth_runoff(position: jax.Array) -> jax.Array:
    """(sum x^9)^(1/9), near the largest x and differentiable [m]."""
    return jnp.sum(position[:, 0] ** 9) ** (1.0 / 9.0)


@jax.jit
def predict(friction, state, neighbors):
    """Run-off a window later [m], its derivative with respect to the friction [m], and the state and list at that
    time."""

    def ahead(value):  # forward mode stores no intermediate states
        end = jaxdem.rollout(simulation, with_friction(value), state, neighbors, WINDOW, reversible=False)
        runoff = jnp.where(end.failures == 0, smooth_runoff(end.state.particles.position), jnp.nan)
        return runoff, (end.state, end.neighbors)

    runoff, slope, (later, listed) = jax.jvp(ahead, (friction,), (jnp.ones_like(friction),), has_aux=True)
    return runoff, slope, later, listed


def collapse(pack: tuple, friction: float) -> tuple[list, np.ndarray]:
    """States and lists at the start of every window, and the run-off at its end [m]."""
    states, seen = [pack], []
    for _ in range(WINDOWS):
        runoff, _, *after = predict(jnp.asarray(friction), *states[-1])
        states.append(after)
        seen.append(float(runoff))
    return states[:-1], np.array(seen)


def compared(friction: float, states: list, measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Predicted minus measured run-off of every window [m], and its derivative with respect to the friction [m]."""
    found = [predict(jnp.asarray(friction), *start)[:2] for start in states]
    return np.array([float(r) for r, _ in found]) - measured, np.array([float(s) for _, s in found])


def calibrate(states: list, measured: np.ndarray) -> list[float]:
    """The first guess and the friction after every Gauss-Newton step. A step is at most 0.15."""
    path = [GUESS]
    for _ in range(6):
        residual, slope = compared(path[-1], states, measured)
        print(f"friction {path[-1]:.4f}: rms error {1e3 * np.sqrt(np.mean(residual**2)):.4f} mm")
        step = np.clip(-slope @ residual / (slope @ slope), -0.15, 0.15)
        path.append(float(np.clip(path[-1] + step, 0.01, 1.0)))
    return path


@jax.jit
def whole_slope(friction, state, neighbors):
    """Derivative of the run-off at the end of the whole collapse with respect to the friction [m]."""

    def runoff(value):
        end = jaxdem.rollout(simulation, with_friction(value), state, neighbors, WINDOW * WINDOWS, reversible=False)
        return smooth_runoff(end.state.particles.position)

    return jax.jvp(runoff, (friction,), (jnp.ones_like(friction),))[1]


def main() -> None:
    """Calibrate, compare with the whole collapse, and draw both."""
    states, runoff = collapse(packs[0], TRUE)
    measured = runoff + NOISE * np.random.default_rng(0).standard_normal(WINDOWS)
    path = calibrate(states, measured)
    print(f"found {path[-1]:.4f}, true {TRUE}")

    values = np.linspace(0.1, 0.7, 9)
    final = np.array([[collapse(pack, mu)[1][-1] for pack in packs] for mu in values])
    trend = np.polyfit(values, final.mean(axis=1), 2)
    through, fitted = whole_slope(jnp.asarray(TRUE), *states[0]), np.polyval(np.polyder(trend), TRUE)
    print(
        f"slope of the final run-off at friction {TRUE}: {through:.3g} m through the solver, "
        f"{fitted:.3g} m from the trend"
    )

    scan = np.linspace(0.1, 0.7, 19)
    errors = [1e3 * np.sqrt(np.mean(compared(mu, states, measured)[0] ** 2)) for mu in scan]
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.0), layout="constrained")
    left.plot(scan, errors, "k-", lw=1, label="20 ms ahead of measured states")
    left.plot(path, np.interp(path, scan, errors), "o-", color="#D55E00", ms=5, label="Gauss-Newton steps")
    left.axvline(TRUE, color="k", lw=0.8, ls=":", label="true friction")
    left.legend()
    left.set(xlabel="friction [-]", ylabel="error of the run-off [mm]", ylim=0)
    dots = right.plot(values, final, "o", color="#0072B2", ms=4)
    dots[0].set_label("whole collapse, three packs")
    fine = np.linspace(values[0], values[-1], 100)
    right.plot(fine, np.polyval(trend, fine), "k-", lw=1, label="trend")
    right.legend()
    right.set(xlabel="friction [-]", ylabel="run-off after 0.4 s [m]")
    save(figure, "friction_calibration")


if __name__ == "__main__":
    main()

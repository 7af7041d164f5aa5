"""Gradients through many coupled steps against central differences, away from contact switches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

import jaxdem
from jaxdem.closures import InvariantClosure, KochHill

STEPS, INTERVAL = 100, 0.002
RADIUS, DENSITY, GRAVITY, MODULUS, POISSON = 0.01, 1500.0, 9.81, 1e6, 0.3
NAMES = ("drag_scale", "viscosity", "inlet", "stiffness", "network")


def resting_overlap():
    """Overlap under the submerged weight: 4/3 E* sqrt(R) d^1.5 = (m - rho V) g, a wall as soft as the grain [m]."""
    weight = 4 / 3 * np.pi * RADIUS**3 * (DENSITY - 1000.0) * GRAVITY
    modulus = 0.5 * MODULUS / (1.0 - POISSON**2)
    return (weight / (4 / 3 * modulus * np.sqrt(RADIUS))) ** (2 / 3)


class Channel:
    """A jet over a grain that rests on the floor, and two that swim freely; a learned closure with small weights.

    The grain's contact lasts, and sticks (friction 20): no switch is near. The drag moves it sideways on its
    tangential spring, so that the stiffness matters to first order.
    """

    def __init__(self):
        positions = [[0.06, RADIUS - resting_overlap()], [0.11, 0.075], [0.16, 0.12]]
        tables = dict(
            precision="float64",
            domain=dict(size=[0.24, 0.16], depth=0.04, gravity=[0.0, -GRAVITY]),
            particles=dict(radius=RADIUS, density=DENSITY, position=positions),
            contact=dict(young_modulus=MODULUS, poisson_ratio=POISSON, friction=20.0, speed=0.05),
            fluid=dict(cells=[6, 4], viscosity=1e-4, time_step=INTERVAL),
            boundary=dict(
                left={"kind": "inlet", "velocity": 0.1, "ramp_time": 0.0, "from": 0.0, "to": 0.09},
                right=dict(kind="outlet"),
            ),
            time=dict(end=1.0, output_interval=0.1),
        )
        scene = jaxdem.load_scene(tables)
        closure = InvariantClosure.initial(KochHill(), hidden=(6,), terms=("void_fraction_gradient",), seed=3)
        flat, self.unravel = ravel_pytree(closure.weights)
        random = np.random.default_rng(0)
        self.weights = jnp.asarray(random.normal(0.0, 0.1, flat.shape))
        self.direction = jnp.asarray(random.normal(0.0, 0.1, flat.shape))
        self.closure = closure
        self.simulation, self.parameters = jaxdem.build(scene, closure)
        self.state, self.neighbors = jaxdem.initial_state(scene, self.simulation, self.parameters)
        self.gradient = jax.jit(jax.value_and_grad(self.observed, has_aux=True))

    def scaled(self, factor):
        """Parameters with the five scaled; the network's weights moved along a fixed direction."""
        p, c = self.parameters, self.closure
        weights = self.unravel((self.weights + (factor[4] - 1.0) * self.direction).astype(jnp.float64))
        return p._replace(
            drag_scale=p.drag_scale * factor[0],
            fluid=p.fluid._replace(
                viscosity=p.fluid.viscosity * factor[1],
                side_velocity=tuple(v * factor[2] for v in p.fluid.side_velocity),
            ),
            contact=p.contact._replace(
                young_modulus=p.contact.young_modulus * factor[3],
                wall_young_modulus=p.contact.wall_young_modulus * factor[3],
            ),
            closure=type(c)(
                **{f: weights if f == "weights" else getattr(c, f) for f in c.__dataclass_fields__}
            ),
        )

    def observed(self, factor):
        """A number that every part has a share in; flags and contact of the grain at every step."""
        result = jaxdem.rollout(
            self.simulation,
            self.scaled(factor),
            self.state,
            self.neighbors,
            STEPS,
            lambda state: state.particles.contact_force,
        )
        particles, fluid = result.state.particles, result.state.fluid
        moved = (particles.position - self.state.particles.position) / RADIUS
        # The grain on the floor is held by a spring: its motion is small, and weighted up.
        share = jnp.sum(moved * jnp.asarray([[1e3, 1e3], [1.0, -0.5], [0.7, 0.3]]))
        speed = jnp.mean(fluid.face_velocity[0] ** 2) + jnp.mean(fluid.face_velocity[1] ** 2)
        return share + 30.0 * speed, (result.failures, result.observations)


@pytest.fixture(scope="module")
def channel():
    return Channel()


@pytest.fixture(scope="module")
def gradient(channel):
    (value, aux), slope = channel.gradient(jnp.ones(5))
    return float(value), aux, np.asarray(slope)


def test_the_scene_has_a_lasting_contact_and_free_grains(gradient):
    _, (code, force), _ = gradient
    assert int(code) == 0
    force = np.asarray(force)
    assert force.shape == (STEPS, 3, 2)
    assert force[:, 0, 1].min() > 0.0 and not np.any(force[:, 1:])
    # It sticks: under half of Coulomb's limit.
    assert np.all(np.abs(force[:, 0, 0]) < 20.0 * 0.5 * force[:, 0, 1])


def test_gradient_is_finite_at_zero_slip_and_in_empty_cells(channel):
    """No inflow: the slip is exactly zero at first, and most cells hold nothing but water at rest."""
    (_, (code, _)), slope = channel.gradient(jnp.asarray([1.0, 1.0, 0.0, 1.0, 1.0]))
    assert int(code) == 0
    assert np.all(np.isfinite(slope))
    assert np.any(slope != 0.0)


@pytest.mark.parametrize("number", range(5), ids=NAMES)
def test_gradient_is_that_of_central_differences(channel, gradient, number):
    slope = gradient[2][number]
    step = 1e-4 if number != 4 else 1e-3

    def central(h):
        e = jnp.zeros(5).at[number].set(h)
        # The gradient's own value: a compilation less.
        return float(channel.gradient(1.0 + e)[0][0] - channel.gradient(1.0 - e)[0][0]) / (2.0 * h)

    # Richardson: the error of two central differences cancels to fourth order.
    difference = (4.0 * central(0.5 * step) - central(step)) / 3.0
    print(NAMES[number], slope, difference, abs(slope / difference - 1.0))
    assert abs(slope) > 1e-3 * abs(gradient[0])
    # The gate. Rounding: values of order 1 over steps of 1e-4 leave 1e-11 of them.
    assert slope == pytest.approx(difference, rel=1e-5)

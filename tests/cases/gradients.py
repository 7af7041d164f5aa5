"""Gradients through many coupled steps against central differences, away from contact switches."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

import jaxdem
from jaxdem.closures import InvariantClosure, KochHill
from tests.cases.registry import Figure, at_least, below, case, relative

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

    def __init__(self, dimension: int = 2):
        flat = dimension == 2
        positions = [[0.06, RADIUS - resting_overlap()], [0.11, 0.075], [0.16, 0.12]]
        size, cells, start, stop = [0.24, 0.16], [6, 4], [0.0], [0.09]
        if not flat:  # the same in a slab two cells thick, the grains at different depths
            positions = [[x, y, z] for (x, z), y in zip(positions, (0.04, 0.035, 0.05), strict=True)]
            size, cells, start, stop = [0.24, 0.08, 0.16], [6, 2, 4], [0.0, 0.0], [0.08, 0.09]
        tables = dict(
            precision="float64",
            domain=dict(size=size, gravity=[*[0.0] * (dimension - 1), -GRAVITY]),
            particles=dict(radius=RADIUS, density=DENSITY, position=positions),
            contact=dict(young_modulus=MODULUS, poisson_ratio=POISSON, friction=20.0, speed=0.05),
            fluid=dict(cells=cells, viscosity=1e-4, time_step=INTERVAL),
            boundary=dict(
                left={"kind": "inlet", "velocity": 0.1, "ramp_time": 0.0, "from": start, "to": stop},
                right=dict(kind="outlet"),
            ),
            time=dict(end=1.0, output_interval=0.1),
        )
        if flat:
            tables["domain"]["depth"] = 0.04
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
            contact=p.contact._replace(young_modulus=p.contact.young_modulus * factor[3]),
            closure=type(c)(**{f: weights if f == "weights" else getattr(c, f) for f in c.__dataclass_fields__}),
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
        share = jnp.sum(moved[:, jnp.asarray([0, -1])] * jnp.asarray([[1e3, 1e3], [1.0, -0.5], [0.7, 0.3]]))
        speed = sum(jnp.mean(u**2) for u in fluid.face_velocity)
        return share + 30.0 * speed, (result.failures, result.observations)


def central(channel: Channel, number: int, step: float) -> float:
    """Derivative by differences; Richardson: the error of two central differences cancels to fourth order."""

    def difference(h: float) -> float:
        shift = jnp.zeros(5).at[number].set(h)
        # The gradient's own value: a compilation less.
        return float(channel.gradient(1.0 + shift)[0][0] - channel.gradient(1.0 - shift)[0][0]) / (2.0 * h)

    return (4.0 * difference(0.5 * step) - difference(step)) / 3.0


@case("gradients over 100 coupled steps", "gradients", "central differences", fast={"dimensions": (2,)})
def rollout_gradients(dimensions: tuple[int, ...] = (2, 3)) -> list[Figure]:
    """By drag scale, viscosity, inlet velocity, stiffness and weights of a network [1e-5].

    Rounding: values of order 1 over steps of 1e-4 leave 1e-11 of them. And finite without inflow, where the slip
    is exactly zero at first and most cells hold nothing but water at rest.
    """
    figures = []
    for dimension in dimensions:
        channel, where = Channel(dimension), f"{dimension}-D"
        (value, (code, force)), slope = channel.gradient(jnp.ones(5))
        slope, force, sound = np.asarray(slope), np.asarray(force), int(code) == 0
        figures += [
            at_least(f"{where}: a contact that lasts", 1e-12, force[:, 0, -1].min() if sound else np.nan, "N"),
            below(f"{where}: other contacts", np.abs(force[:, 1:]).max(), 0.0, "N"),
            # Under half of Coulomb's limit it sticks.
            below(f"{where}: tangential over normal force", np.abs(force[:, 0, 0] / force[:, 0, -1]).max(), 10.0),
        ]
        for number, name in enumerate(NAMES):
            expected = central(channel, number, 1e-4 if number != 4 else 1e-3)
            figures.append(relative(f"{where}: by {name}", expected, slope[number], 1e-5))
            figures.append(at_least(f"{where}: |{name}| matters", 1e-3, abs(slope[number] / float(value))))
        (_, (code, _)), still = channel.gradient(jnp.asarray([1.0, 1.0, 0.0, 1.0, 1.0]))
        lost = int(code) + int(np.sum(~np.isfinite(still))) + int(not np.any(still))
        figures.append(below(f"{where}: without inflow, slopes that are not finite", lost, 0.0))
    return figures

"""A held bed of spheres in a column with an inlet below, for the cases and the tests of the exchange."""

from __future__ import annotations

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

import jaxdem
from jaxdem.closures import DRAG_LAWS
from jaxdem.coupling.coupled import Mixture
from jaxdem.coupling.kernel import kernel_weights
from jaxdem.coupling.void_fraction import solid_fraction

LAWS = tuple(DRAG_LAWS)
H, DEPTH, INTERVAL, RAMP = 0.04, 0.02, 0.01, 0.05
RHO = 1000.0


@partial(jax.tree_util.register_dataclass, data_fields=["law"], meta_fields=[])
@dataclasses.dataclass(frozen=True, eq=False)
class AnyLaw:
    """Any correlation, chosen by a traced number: one compilation for all."""

    law: jax.Array

    def __call__(self, inputs):
        return lax.switch(self.law, [DRAG_LAWS[name]() for name in LAWS], inputs)


class Column:
    """160 held spheres, two by two in the cells of ten middle rows, and a tiny one among them that may move."""

    def __init__(self, model="A"):
        x, z = np.meshgrid((np.arange(8) + 0.5) * 0.02, 0.12 + (np.arange(20) + 0.5) * 0.02, indexing="ij")
        bed = np.stack((x.ravel(), z.ravel()), axis=1)
        self.position = np.concatenate((bed, [[0.08, 0.32]]))
        tables = dict(
            precision="float64",
            domain=dict(size=[4 * H, 16 * H], depth=DEPTH, gravity=[0.0, 0.0]),
            particles=dict(radius=[0.009] * 160 + [5e-5], density=2650.0, position=self.position.tolist()),
            contact=dict(speed=1.0),
            fluid=dict(cells=[4, 16], density=RHO, viscosity=1e-5, time_step=INTERVAL, model=model),
            boundary=dict(
                left=dict(kind="free_slip"),
                right=dict(kind="free_slip"),
                bottom=dict(kind="inlet", velocity=0.01, ramp_time=RAMP),
                top=dict(kind="outlet"),
            ),
            coupling=dict(interval=INTERVAL, kernel_width=dict(diameters=0.5, cells=1.0)),
            time=dict(end=1.0, output_interval=0.1),
        )
        scene = jaxdem.load_scene(tables)
        self.simulation, self.parameters = jaxdem.build(scene)
        self.start, _ = jaxdem.initial_state(scene, self.simulation, self.parameters)
        self.coupling = self.simulation.coupling
        self.grid = self.coupling.interval.solver.grid
        self.jitted = self.compiled()

    def compiled(self):
        """A fresh compilation, which sees what a test has patched."""
        return jax.jit(lambda *arguments: self._run(*arguments))

    def _run(self, law, scale, properties, bodies, gravity, fluid, particles, free, steps):
        """Fluid, velocities and the last forces; only the `free` ones gather velocity, nobody moves."""

        def once(k, fluid, particles):
            time = k * jnp.asarray(INTERVAL)
            mixture = Mixture(AnyLaw(law), scale, properties, bodies, gravity)
            return self.coupling.advance(mixture, fluid, particles, time)[:3]

        def body(k, carry):
            fluid, velocity, _, good = carry
            now = particles._replace(velocity=velocity)
            fluid, forces, report = once(k, fluid, now)
            weight = (bodies.mass - properties.density * bodies.volume)[:, None] * gravity[None]
            faster = velocity + INTERVAL * (forces.total + weight) / bodies.mass[:, None]
            good = good & report.converged & (report.divergence < 1e-10)
            return fluid, jnp.where(free[:, None], faster, velocity), forces, good

        shapes = jax.eval_shape(once, 0, fluid, particles)[1]
        zeros = jax.tree.map(lambda shape: jnp.zeros(shape.shape, shape.dtype), shapes)
        return lax.fori_loop(0, steps, body, (fluid, particles.velocity, zeros, jnp.asarray(True)))

    def run(self, law, radius, velocity, viscosity, steps, scale=1.0, gravity=0.0, density=2650.0, run=None):
        """Fluid, velocities, forces at the end; bed of this radius, held by its weight of 1e12 kg/m3."""
        number = partial(jnp.asarray, dtype=jnp.float64)
        bodies = self.parameters.bodies._replace(
            radius=number([radius] * 160 + [5e-5]), density=number([1e12] * 160 + [density])
        )
        # Contacts carry the bed's weight, as they would in a column with a floor.
        held = np.zeros((161, 2))
        held[:160, 1] = gravity * float((bodies.mass - RHO * bodies.volume)[0])
        particles = self.start.particles._replace(contact_force=number(held))
        side = [np.zeros(2)] * 4
        side[2] = np.array([0.0, velocity])
        properties = self.parameters.fluid._replace(
            viscosity=number(viscosity), side_velocity=tuple(number(v) for v in side)
        )
        weights = kernel_weights(self.grid, self.coupling.deposition.half_width, number(self.position))
        solids = solid_fraction(self.grid, weights, bodies.volume)
        fluid = self.start.fluid._replace(void_fraction=1.0 - solids)
        fluid, speeds, forces, good = (run or self.jitted)(
            jnp.asarray(LAWS.index(law), jnp.int32),
            number(scale),
            properties,
            bodies,
            number([0.0, -gravity]),
            fluid,
            particles,
            jnp.arange(161) == 160,
            steps,
        )
        assert bool(good)
        return fluid, np.asarray(speeds), forces

    @staticmethod
    def solid(radius):
        return 4 / 3 * np.pi * radius**3 / (0.02**2 * DEPTH)


def pressure_slope(fluid):
    """Gradient within the bed, three cells from its ends: two kernels see each other's end there [Pa/m]."""
    rows = np.asarray(fluid.pressure).mean(axis=0)
    return (rows[9] - rows[6]) / (3 * H)


def ergun_drop(s: float, diameter: float, viscosity: float, speed: float) -> float:
    """150 mu U s^2 / (g^3 d^2) + 1.75 rho U^2 s / (g^3 d), g = 1 - s (Ergun 1952) [Pa/m]."""
    g, mu = 1.0 - s, RHO * viscosity
    return 150 * mu * speed * s**2 / (g**3 * diameter**2) + 1.75 * RHO * speed**2 * s / (g**3 * diameter)

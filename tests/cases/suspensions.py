"""Spheres in a box of fluid that is periodic all round, for the cases and the tests of the exchange."""

from __future__ import annotations

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

import jaxdem
from jaxdem.closures import DRAG_LAWS
from jaxdem.closures.base import Drag
from jaxdem.coupling.kernel import kernel_weights
from jaxdem.coupling.void_fraction import solid_fraction
from jaxdem.failures import failures
from jaxdem.fluid.grid import face_average, face_total

LAWS = tuple(DRAG_LAWS)
SIDE, CELLS, RADIUS, DEPTH = 0.24, 6, 0.01, 0.04
STOKES_TIME = 2.0 / 9.0 * 2650.0 * RADIUS**2 / (1000.0 * 1e-5)  # m / (3 pi mu d) of the sphere as given [s]


@partial(jax.tree_util.register_dataclass, data_fields=["law", "lift"], meta_fields=[])
@dataclasses.dataclass(frozen=True, eq=False)
class AnyLaw:
    """Any correlation, chosen by a traced number, and a remainder across the slip: one compilation for all."""

    law: jax.Array
    lift: jax.Array

    def __call__(self, inputs):
        drag = lax.switch(self.law, [DRAG_LAWS[name]() for name in LAWS], inputs)
        slip = inputs.slip_velocity
        across = jnp.stack((-slip[:, 1], slip[:, 0]), axis=1)
        return Drag(drag.coefficient, self.lift * drag.coefficient[:, None] * across, drag.out_of_range)


def closure(law="stokes", lift=0.0):
    return AnyLaw(jnp.asarray(LAWS.index(law), jnp.int32), jnp.asarray(lift, jnp.float64))


class Suspension:
    """36 spheres in a box that is periodic all round; density, drag, viscosity and gravity are traced."""

    def __init__(self, model="A", advection="limited"):
        line = (np.arange(CELLS) + 0.5) * SIDE / CELLS
        self.lattice = np.stack([a.ravel() for a in np.meshgrid(line, line, indexing="ij")], axis=1)
        tables = dict(
            precision="float64",
            domain=dict(size=[SIDE, SIDE], depth=DEPTH, gravity=[0.0, 0.0]),
            particles=dict(radius=RADIUS, density=100.0, position=self.lattice.tolist()),
            contact=dict(young_modulus=1e5, friction=0.4, restitution=0.6, speed=0.5),
            fluid=dict(cells=[CELLS, CELLS], viscosity=1e-5, time_step=0.01, model=model, advection=advection),
            boundary={side: dict(kind="periodic") for side in ("left", "right", "bottom", "top")},
            coupling=dict(interval=0.01),
            time=dict(end=1.0, output_interval=0.1),
        )
        scene = jaxdem.load_scene(tables)
        self.simulation, self.parameters = jaxdem.build(scene, closure())
        start, neighbors = jaxdem.initial_state(scene, self.simulation, self.parameters)
        # Stirred fast, the spheres come closer together than they start.
        self.start, self.neighbors = self.simulation.with_room(start, neighbors, neighbors.room.enlarged())
        self.grid = self.simulation.fluid.solver.grid
        self.run = self.compiled()

    def compiled(self):
        """A fresh compilation, which sees what a test has patched."""
        return jax.jit(lambda *arguments: self._run(*arguments))

    def _run(self, parameters, state, steps):
        def body(_, carry):
            state, neighbors, code, _, worst = carry
            state, neighbors, diagnostics = self.simulation.step(parameters, state, neighbors)
            report, exact = diagnostics.fluid, diagnostics.exchange
            worst = jnp.maximum(worst, jnp.stack((report.substeps * 1.0, exact.momentum, exact.volume)))
            return state, neighbors, code | failures(self.simulation, diagnostics), diagnostics.forces, worst

        shapes = jax.eval_shape(self.simulation.step, parameters, state, self.neighbors)[2].forces
        zeros = jax.tree.map(lambda shape: jnp.zeros(shape.shape, shape.dtype), shapes)
        carry = (state, self.neighbors, jnp.zeros((), jnp.int32), zeros, jnp.zeros(3))
        state, _, code, forces, worst = lax.fori_loop(0, steps, body, carry)
        return state, code, forces, worst

    def given(
        self,
        density=2650.0,
        drag=1.0,
        viscosity=1e-5,
        gravity=0.0,
        law="stokes",
        lift=0.0,
        radius=RADIUS,
        smagorinsky=None,
    ):
        """Parameters with these numbers, of the same types, so that nothing is compiled again but a subgrid model."""
        p, number = self.parameters, partial(jnp.asarray, dtype=jnp.float64)
        eddies = None if smagorinsky is None else number(smagorinsky)
        return p._replace(
            gravity=number([0.0, -gravity]),
            bodies=p.bodies._replace(density=number(density), radius=number(radius)),
            fluid=p.fluid._replace(viscosity=number(viscosity), smagorinsky=eddies),
            drag_scale=number(drag),
            closure=closure(law, lift),
        )

    def state(self, position=None, velocity=(0.0, 0.0), fluid=(0.0, 0.0), radius=RADIUS):
        """Particles here with these velocities (rows or one for all); fluid with a velocity or face fields."""
        particles, number = self.start.particles, partial(jnp.asarray, dtype=jnp.float64)
        position = number(self.lattice if position is None else position)
        velocity = jnp.broadcast_to(number(velocity), position.shape)
        shapes = [self.grid.face_shape(a) for a in range(2)]
        faces = tuple(jnp.broadcast_to(number(u), s) for u, s in zip(fluid, shapes, strict=True))
        weights = kernel_weights(self.grid, self.simulation.coupling.deposition.half_width, position)
        volume = number(4 / 3 * np.pi * radius**3)
        solids = solid_fraction(self.grid, weights, volume)
        return self.start._replace(
            particles=particles._replace(position=position, velocity=velocity),
            fluid=self.start.fluid._replace(face_velocity=faces, void_fraction=1.0 - solids),
        )

    def momentum(self, parameters, state):
        """(2,) of particles and of the fluid [kg m/s]."""
        g = face_average(self.grid, state.fluid.void_fraction)
        flux = tuple(a * u for a, u in zip(g, state.fluid.face_velocity, strict=True))
        mass = self.grid.cell_volume * parameters.fluid.density
        fluid = np.array([float(x) for x in face_total(self.grid, flux)]) * float(mass)
        return float(parameters.bodies.mass) * np.asarray(state.particles.velocity).sum(axis=0), fluid

    def stirred(self, speed, seed=0, particle_speed=None):
        """Particles at random places (apart) and speeds, an eddy with a mean stream in the fluid."""
        random, fluid_speed = np.random.default_rng(seed), speed
        speed = speed if particle_speed is None else particle_speed
        position = self.lattice + random.uniform(-0.009, 0.009, self.lattice.shape)
        velocity = random.normal(0.0, 0.3 * speed, position.shape) + [0.4 * speed, -0.2 * speed]
        k, h = 2 * np.pi / SIDE, SIDE / CELLS
        faces, centres = np.arange(CELLS + 1) * h, (np.arange(CELLS) + 0.5) * h
        speed = fluid_speed
        u = 0.5 * speed * np.sin(k * faces)[:, None] * np.cos(k * centres)[None] + 0.3 * speed
        w = -0.5 * speed * np.cos(k * centres)[:, None] * np.sin(k * faces)[None]
        return self.state(position, velocity, (u, w))

    def drift(self, parameters, state, steps=60, run=None):
        """Change of the total momentum over the sum of its parts' sizes; exchanged share; worst diagnostics."""
        end, code, _, worst = (run or self.run)(parameters, state, steps)
        before, after = self.momentum(parameters, state), self.momentum(parameters, end)
        mass = float(parameters.bodies.mass)
        size = mass * np.abs(state.particles.velocity).sum() + np.abs(before[1]).sum() + np.abs(after[1]).sum()
        exchanged = np.abs(after[0] - before[0]).max() / size
        return np.abs(sum(after) - sum(before)).max() / size, exchanged, int(code), np.asarray(worst)

"""Clumps of spheres: scenes, and what mechanics says of them in closed form."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

import jaxdem
from jaxdem.particles.clumps import angular_momentum, spin_energy, turned
from jaxdem.particles.integrate import Motion

BENT = {"name": "bent", "centres": [[0.0, 0.0, 0.0], [1.1, 0.0, 0.0], [1.1, 0.8, 0.3]], "radii": [1.0, 0.8, 0.6]}
"""A shape with three different moments of inertia."""

ROD = {"name": "rod", "centres": [[-1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], "radii": [1.0, 1.0, 1.0]}


def two_bodies(shape=BENT, **changes):
    """Tables of two clumps far apart in a box of 1 m, without gravity."""
    tables = {
        "precision": "float64",
        "domain": {"size": [1.0, 1.0, 1.0], "gravity": [0.0, 0.0, 0.0]},
        "particles": {
            "radius": 0.03,
            "density": 1000.0,
            "shape": shape["name"],
            "shapes": [shape],
            "position": [[0.3, 0.5, 0.5], [0.7, 0.5, 0.5]],
            "orientation": [[0.6, 0.0, 0.8, 0.0], [0.5, 0.5, -0.5, 0.5]],
        },
        "contact": {"young_modulus": 1e9, "friction": 0.0, "restitution": 1.0, "speed": 2.0},
        "time": {"end": 0.1, "output_interval": 0.01},
    }
    for key, value in changes.items():
        tables[key] = {**tables.get(key, {}), **value} if isinstance(value, dict) else value
    return tables


def built(tables):
    """Simulation, parameters, state and list of a scene."""
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    return simulation, parameters, *jaxdem.initial_state(scene, simulation, parameters)


def momenta(bodies, particles):
    """Energy, momentum and angular momentum about the origin of all bodies."""
    motion = Motion.of(particles)
    mass = np.broadcast_to(np.asarray(bodies.mass), len(particles.position))
    spin = np.stack(angular_momentum(motion.angular_velocity, motion.orientation, bodies), axis=1)
    turning = spin_energy(motion.angular_velocity, motion.orientation, bodies)
    energy = float(np.sum(0.5 * mass * np.sum(np.asarray(particles.velocity) ** 2, axis=1)) + np.sum(turning))
    linear = mass[:, None] * np.asarray(particles.velocity)
    around = np.cross(np.asarray(particles.position), linear) if spin.shape[1] == 3 else 0.0
    return energy, linear.sum(axis=0), np.sum(around + spin, axis=0)


def free_top(bodies, particles, turns, steps_per_turn, gyroscopic=True):
    """Largest relative change of |L| and of the energy of a body that turns freely about no principal axis."""
    motion = Motion.of(particles)
    size = float(jnp.linalg.norm(particles.angular_velocity[0]))
    half = 0.5 * 2.0 * np.pi / (size * steps_per_turn)

    def measured(motion):
        momentum = angular_momentum(motion.angular_velocity, motion.orientation, bodies)
        squared = momentum[0] ** 2 + momentum[1] ** 2 + momentum[2] ** 2
        return jnp.sqrt(squared[0]), spin_energy(motion.angular_velocity, motion.orientation, bodies)[0]

    start = measured(motion)

    def step(_, carry):
        motion, worst = carry
        before = motion.angular_velocity
        motion = turned(turned(motion, bodies.rigid, half, True), bodies.rigid, half, False)
        if not gyroscopic:
            motion = motion._replace(angular_velocity=before)
        now = measured(motion)
        return motion, tuple(jnp.maximum(w, jnp.abs(a / b - 1.0)) for w, a, b in zip(worst, now, start, strict=True))

    still = (jnp.zeros(()), jnp.zeros(()))
    run = jax.jit(lambda motion: lax.fori_loop(0, turns * steps_per_turn, step, (motion, still))[1])
    return tuple(float(x) for x in run(motion))


def impulse_on_floor(bodies, arm, axes, speed, restitution=1.0):
    """Velocity (3,) and spin (3,) after a frictionless impact of a falling body on a floor, closed form.

    J = (1 + e) v / (1/m + (a x n).I^-1 (a x n)), a from the centre of mass to the point that touches.

    Args:
        bodies: of one clump.
        arm: (3,) a [m].
        axes: (3, 3) principal axes, columns.
        speed: downwards [m/s].
    """
    normal, mass = np.asarray([0.0, 0.0, 1.0]), float(np.asarray(bodies.mass))
    moments = np.asarray([float(i) for i in bodies.rigid.inertia]) * mass * float(np.asarray(bodies.radius)) ** 2
    inverse = axes @ np.diag(1.0 / moments) @ axes.T
    lever = np.cross(arm, normal)
    impulse = (1.0 + restitution) * speed / (1.0 / mass + lever @ inverse @ lever)
    return (impulse / mass - speed) * normal, inverse @ (impulse * lever)

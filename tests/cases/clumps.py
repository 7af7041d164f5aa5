"""Clumps of spheres: scenes, and what mechanics says of them in closed form."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from scipy.optimize import brentq

import jaxdem
from jaxdem.particles.clumps import angular_momentum, spin_energy, turned
from jaxdem.particles.integrate import Motion
from jaxdem.particles.union import shadows, union_of_spheres
from tests.cases.correlations import haider_levenspiel_coefficient, hoelzer_sommerfeld_coefficient
from tests.cases.registry import at_least, below, case, relative

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


AIR, VISCOSITY, GRAIN, GRAVITY = 1.2, 1.5e-5, 2000.0, 9.81
"""Of the settling rod: density and kinematic viscosity of the air, density of the rod, acceleration."""


def settling_rod(law):
    """Tables of a rod of 0.1 mm alone in air, in 2-D with a metre of depth; gravity is given in the parameters, since
    the box is periodic along it."""
    return {
        "precision": "float64",
        "domain": {"size": [0.2, 0.2], "depth": 1.0, "gravity": [0.0, 0.0]},
        "particles": {
            "radius": 5e-5,
            "density": GRAIN,
            "position": [[0.1, 0.15]],
            "shape": "rod",
            "shapes": [{"name": "rod", "centres": [[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]], "radii": [1.0, 1.0, 1.0]}],
            "orientation": [0.0],
        },
        "contact": {"young_modulus": 1.0, "speed": 1e-3},  # touches nothing: one contact step in a fluid step
        "fluid": {"cells": [4, 4], "density": AIR, "viscosity": VISCOSITY, "time_step": 1e-3},
        "boundary": {side: {"kind": "periodic"} for side in ("left", "right", "bottom", "top")},
        "coupling": {"drag": law, "kernel_width": {"diameters": 0.0, "cells": 0.5}},
        "time": {"end": 0.27, "output_interval": 0.01},
    }


def settled_speed(simulation, parameters, state, neighbors, angle, law):
    """Speed of the rod after 0.6 s; the speed at which the law carries its weight; and that of the sphere.

    Args:
        simulation, parameters, state, neighbors: of `settling_rod`.
        angle: of the rod [rad].
        law: name of the drag law.
    """
    down = parameters._replace(gravity=jnp.asarray([0.0, -GRAVITY]))
    turned_rod = state.particles._replace(orientation=jnp.asarray([[angle]]))
    start = state._replace(particles=turned_rod)

    @jax.jit
    def run(parameters, start, neighbors):
        def body(_, carry):
            return simulation.step(parameters, *carry)[:2]

        return lax.fori_loop(0, 600, body, (start, neighbors))[0].particles.velocity[0, 1]

    got = -float(run(down, start, neighbors))
    union = union_of_spheres(np.asarray(ROD["centres"]), np.ones(3))
    along = shadows(np.asarray(ROD["centres"]), np.ones(3))[0 if math.sin(angle) > 0.5 else 2]
    shape = union.sphericity, math.pi * union.radius**2 / along
    return got, terminal_speed(law, *shape), terminal_speed(law, 1.0, 1.0)


def terminal_speed(law, sphericity, crosswise):
    """Speed at which C_D pi/8 d^2 rho v^2 is the submerged weight, by bisection."""
    diameter = 1e-4

    def excess(speed):
        reynolds = speed * diameter / VISCOSITY
        if law == "haider_levenspiel":
            coefficient = haider_levenspiel_coefficient(reynolds, sphericity)
        else:
            coefficient = hoelzer_sommerfeld_coefficient(reynolds, sphericity, crosswise)
        drag = coefficient * math.pi / 8.0 * diameter**2 * AIR * speed**2
        return drag - (GRAIN - AIR) * math.pi / 6.0 * diameter**3 * GRAVITY

    return brentq(excess, 1e-6, 10.0, xtol=1e-12)


@case("two unit spheres one apart", "clumps", "two caps, by hand: 9 pi/4; capabilities table 0.4250")
def lens():
    """Volume, surface and inertia of the union, not of the sum [1e-9]."""
    found = union_of_spheres(np.asarray([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), np.ones(2))
    return [
        relative("volume", 2.25 * math.pi, found.volume, 1e-9, "m3"),
        relative("surface", 6.0 * math.pi, found.surface, 1e-8, "m2"),
        relative("I_xx/m", 0.425, found.moments[0, 0], 1e-9, "m2"),
    ]


@case("torque-free top", "clumps", "angular momentum and energy are kept", fast={"turns": 20})
def top(turns=10_000):
    """A body with three different moments, 1,500 steps a turn, float64 [1e-6]; |L| is lost without the gyroscopic
    term."""
    _, parameters, state, _ = built(two_bodies())
    spinning = state.particles._replace(angular_velocity=jnp.asarray([[3.0, 5.0, -2.0], [0.0, 0.0, 0.0]]))
    momentum, energy = free_top(parameters.bodies, spinning, turns, 1500)
    without, _ = free_top(parameters.bodies, spinning, min(turns, 20), 1500, gyroscopic=False)
    return [
        below(f"change of |L| in {turns} turns", momentum, 1e-6),
        below(f"change of the energy in {turns} turns", energy, 1e-6),
        at_least("change of |L| without the gyroscopic term", 1e-4, without),
    ]


@case("settling of a rod", "clumps", "Haider & Levenspiel 1989; Hoelzer & Sommerfeld 2008, at their sphericities",
      tested=False)  # fmt: skip
def settling():
    """Terminal speed of three spheres in a row in air, broadside and end on, through the whole step [0.1 %]."""
    figures = []
    for law in ("haider_levenspiel", "hoelzer_sommerfeld"):
        simulation, parameters, state, neighbors = built(settling_rod(law))
        for angle, name in ((0.0, "broadside"), (0.5 * math.pi, "end on")):
            got, expected, _ = settled_speed(simulation, parameters, state, neighbors, angle, law)
            figures.append(relative(f"{law}, {name}", expected, got, 1e-3, "m/s"))
    return figures

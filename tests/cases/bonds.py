"""Bonds against closed forms: one bond under each load, beams of bonded grains, strength, motion that strains nothing.

A strand is a row of equal grains along x, a hundredth of a diameter apart, so that no contact acts. Its first grain is
so heavy that it stands for a clamp. References are of beams and of bodies, computed here by hand.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import jaxdem
from jaxdem.particles.bond_state import INTACT, SHEAR, TENSION
from jaxdem.particles.bonds import bond_forces, bond_loads
from jaxdem.particles.integrate import Motion, ParticleState, kinetic_energy
from jaxdem.particles.loop import contact_interval
from jaxdem.particles.materials import surroundings
from jaxdem.state import Parameters
from tests.cases.registry import Figure, at_least, below, case, relative

RADIUS, DENSITY, CLAMP = 5e-3, 2500.0, 1e12
SPACING = 2.02 * RADIUS
NORMAL, SHEARING = 1e10, 4e9
AREA, INERTIA = math.pi * RADIUS**2, 0.25 * math.pi * RADIUS**4
MASS = DENSITY * 4.0 / 3.0 * math.pi * RADIUS**3
SPIN_INERTIA = 0.4 * MASS * RADIUS**2
SOURCE = "Potyondy & Cundall 2004"


class Strand(NamedTuple):
    """A strand that is ready to be moved."""

    simulation: Any
    parameters: Parameters
    particles: ParticleState
    neighbors: Any

    def with_bonds(self, **numbers: float) -> Strand:
        """The same with other numbers of its bonds."""
        bonds = required(self.parameters.bonds)
        changed = bonds._replace(**{name: jnp.full_like(bonds.normal_stiffness, x) for name, x in numbers.items()})
        return self._replace(parameters=self.parameters._replace(bonds=changed))


def undamped(of: Strand) -> Strand:
    """The same without dashpots."""
    return of.with_bonds(damping=0.0)


def required(value: Any) -> Any:
    """The value, which is there."""
    assert value is not None
    return value


def tables_of(count: int, dimension: int = 3, **changes: Any) -> dict[str, Any]:
    """Tables of a strand."""
    size = (count + 3) * SPACING
    height = [0.5 * size] * (dimension - 1)
    return {
        "precision": "float64",
        "domain": {"size": [size] * dimension, "gravity": [0.0] * dimension},
        "particles": {
            "position": [[(k + 2) * SPACING, *height] for k in range(count)],
            "radius": RADIUS,
            "density": DENSITY,
        },
        "contact": {"speed": 0.1, "young_modulus": 1e7},
        "bonds": [
            {"gap": 0.05 * RADIUS, "normal_stiffness": NORMAL, "shear_stiffness": SHEARING, "damping": 0.3}
        ],
        "time": {"end": 1.0, "output_interval": 0.1},
    } | changes  # fmt: skip


@functools.cache
def strand(count: int, dimension: int = 3, precision: str = "float64") -> Strand:
    """`count` grains, the first of which is clamped."""
    scene = jaxdem.load_scene(tables_of(count, dimension, precision=precision))
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    density = jnp.asarray([CLAMP * DENSITY, *[DENSITY] * (count - 1)], precision)
    parameters = parameters._replace(bodies=required(parameters.bodies)._replace(density=density))
    return Strand(simulation, parameters, required(state.particles), neighbors)


def time_step(of: Strand) -> float:
    """Half of the stable step for the bonds [s]."""
    return float(0.5 * of.simulation.steps.limits["bond_stability"])


class Pushed(NamedTuple):
    """What grains did that were pushed, at T times: position (T, N, D), velocity, spin and status of the bonds."""

    position: Array
    velocity: Array
    spin: Array
    status: Array
    particles: ParticleState


@functools.partial(jax.jit, static_argnames=("simulation", "calls", "steps", "reversible"))
def pushed(
    simulation: Any,
    parameters: Parameters,
    start: tuple[ParticleState, Any],
    load: tuple[Array, Array],
    numbers: tuple[Array, Array, Array],
    calls: int,
    steps: int,
    reversible: bool = False,
) -> Pushed:
    """Grains under forces and torques that grow evenly to (N, D) and (N, A), slowed down by -a m v and -a I w.

    Args:
        simulation, parameters: of the strand.
        start: particles and list.
        load: forces [N] and torques [N m] that are reached.
        numbers: contact step [s]; a [1/s]; part of the time in which the load grows, 0 for at once.
        calls, steps: so many times so many contact steps.
        reversible: for reverse mode.
    """
    particles, neighbors = start
    step, slowing, growing = numbers
    bodies = required(parameters.bodies)
    interval = dataclasses.replace(simulation.contact, search=None, steps=steps, reversible=reversible)
    around = surroundings(parameters.materials, (jnp.zeros_like(parameters.gravity),) * len(interval.model.sides))
    around = around._replace(bonds=parameters.bonds)
    mass, inertia = bodies.mass[:, None], bodies.inertia[:, None]

    def one(particles: ParticleState, number: Array) -> tuple[ParticleState, Any]:
        part = jnp.where(growing > 0.0, jnp.minimum((number + 0.5) / calls / jnp.maximum(growing, 1e-9), 1.0), 1.0)
        force = part * load[0] - slowing * mass * particles.velocity
        torque = part * load[1] - slowing * inertia * particles.angular_velocity
        after, _, _ = contact_interval(interval, around, bodies, particles, neighbors, force, step, torque)
        kept = after.position, after.velocity, after.angular_velocity, required(after.bonds).status
        return after, kept

    end, kept = jax.lax.scan(one, particles, jnp.arange(calls))
    return Pushed(*kept, end)


def push(
    of: Strand, force: Any = None, torque: Any = None, *, slowing: float = 0.0, growing: float = 0.0, calls: int = 100,
    steps: int = 20, velocity: Any = None, spin: Any = None, step: float | None = None,
) -> Pushed:  # fmt: skip
    """See `pushed`; forces and torques are those on the last grain."""
    particles, count = of.particles, len(of.particles.position)
    loads = []
    for given, like in ((force, particles.velocity), (torque, particles.angular_velocity)):
        load = np.zeros(like.shape)
        if given is not None:
            load[count - 1] = given
        loads.append(jnp.asarray(load, like.dtype))
    if velocity is not None:
        particles = particles._replace(velocity=jnp.asarray(velocity, particles.velocity.dtype))
    if spin is not None:
        particles = particles._replace(angular_velocity=jnp.asarray(spin, particles.velocity.dtype))
    real = particles.position.dtype
    numbers = tuple(jnp.asarray(x, real) for x in (time_step(of) if step is None else step, slowing, growing))
    return pushed(of.simulation, of.parameters, (particles, of.neighbors), tuple(loads), numbers, calls, steps)


def loads_of(of: Strand, particles: ParticleState) -> Any:
    """What every bond carries, without the empty one."""
    parameters = of.parameters
    found = bond_loads(of.simulation.contact.model.bonds, parameters.bonds, parameters.bodies, particles)
    return type(found)(*(x[:-1] for x in found))


# --- one bond -----------------------------------------------------------------------------------------------


def rotation(axis: np.ndarray) -> np.ndarray:
    """(3, 3) rotation by |axis| about an axis (Rodrigues)."""
    angle = float(np.linalg.norm(axis))
    k = axis / angle
    across = np.array([[0.0, -k[2], k[1]], [k[2], 0.0, -k[0]], [-k[1], k[0], 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * across + (1.0 - math.cos(angle)) * across @ across)


def quaternion(axis: np.ndarray) -> np.ndarray:
    """(4,) unit quaternion of the same rotation."""
    angle = float(np.linalg.norm(axis))
    return np.concatenate([[math.cos(0.5 * angle)], math.sin(0.5 * angle) * axis / angle])


def times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Product of two quaternions."""
    vector = a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
    return np.concatenate([[a[0] * b[0] - a[1:] @ b[1:]], vector])


def strained(
    of: Strand, shift: np.ndarray, turns: tuple[np.ndarray, np.ndarray], whole: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Force on both grains of a pair, and torque on both, (2, 3) each, after a strain and a rotation of the whole.

    Args:
        of: a strand of two grains.
        shift: (3,) by which the second grain is displaced [m].
        turns: by which the first and the second are turned [rad].
        whole: (3,) by which all of it is turned afterwards [rad].
    """
    centre = np.asarray(of.particles.position)
    turn, place = rotation(whole), centre.copy()
    place[1] += shift
    place = centre[0] + (place - centre[0]) @ turn.T
    quaternions = np.stack([times(quaternion(whole), quaternion(own)) for own in turns], axis=1)
    bonds = required(of.particles.bonds)._replace(orientation=tuple(jnp.asarray(q) for q in quaternions))
    particles = of.particles._replace(position=jnp.asarray(place), bonds=bonds)
    force, torque = _forces(of.simulation, of.parameters, particles)
    return np.stack(force, axis=1), np.stack(torque, axis=1)


@functools.partial(jax.jit, static_argnums=0)
def _forces(simulation: Any, parameters: Parameters, particles: ParticleState) -> tuple[Any, Any]:
    motion, model = Motion.of(particles), simulation.contact.model
    return bond_forces(model.bonds, parameters.bonds, parameters.bodies, motion, motion.velocity)[:2]


TINY = 1e-7


@case("bond: the four springs, however the pair is turned", "bonds", SOURCE)
def springs() -> list[Figure]:
    """Force and moment of one bond that is stretched, sheared, bent and twisted by 1e-7, after any rotation."""
    of, none = strand(2), np.full(3, 1e-15)
    whole, figures = np.array([1.1, -0.7, 2.0]), []
    turn = rotation(whole)
    stretch, aside = np.array([TINY * SPACING, 0.0, 0.0]), np.array([0.0, TINY * SPACING, 0.0])
    bend, twist = np.array([0.0, 0.0, TINY]), np.array([TINY, 0.0, 0.0])
    force, _ = strained(of, stretch, (none, none), whole)
    pull = NORMAL * AREA * TINY * SPACING
    figures.append(relative("stretched: pull", pull, (force[0] @ turn)[0], 1e-6, "N"))
    force, torque = strained(of, aside, (none, none), whole)
    pull = SHEARING * AREA * TINY * SPACING
    figures.append(relative("sheared: force", pull, (force[0] @ turn)[1], 1e-6, "N"))
    figures.append(relative("sheared: torque", pull * 0.5 * SPACING, (torque[1] @ turn)[2], 1e-6, "N m"))
    # Turned by halves against each other, the ends meet in the middle: no shear.
    _, torque = strained(of, np.zeros(3), (-0.5 * bend, 0.5 * bend), whole)
    figures.append(relative("bent: moment", -NORMAL * INERTIA * TINY, (torque[1] @ turn)[2], 1e-6, "N m"))
    _, torque = strained(of, np.zeros(3), (none, twist), whole)
    figures.append(relative("twisted: moment", -2.0 * SHEARING * INERTIA * TINY, (torque[1] @ turn)[0], 1e-6, "N m"))
    # A large strain: the loads are in balance, and the force is minus the slope of the energy.
    shift, turns = np.array([0.03, -0.05, 0.02]) * SPACING, (np.array([0.1, 0.2, -0.1]), np.array([-0.2, 0.05, 0.1]))
    force, torque = strained(of, shift, turns, whole)
    centre = np.asarray(of.particles.position)
    arm = turn @ (centre[1] + shift - centre[0])
    size = np.linalg.norm(torque)
    balance = np.linalg.norm(np.cross(arm, force[1]) + torque.sum(axis=0)) / size
    figures.append(below("strained by 5 %: torques against the forces", balance, 1e-13))
    figures.append(
        below("the same: sum of the forces", np.linalg.norm(force.sum(axis=0)) / np.linalg.norm(force), 1e-14)
    )
    return figures


@case("bond: rotation of the whole strains nothing", "bonds", "rigid body")
def turning() -> list[Figure]:
    """Two bonded grains that turn about each other: no shear, however long; at rest in any attitude no force."""
    of = strand(2)
    turns = [np.array([0.3, -0.2, 0.9]) * k for k in (1e-6, 1.0, 2.5)]
    unit = NORMAL * AREA * SPACING
    at_rest = max(
        float(np.abs(force).max() / unit + np.abs(torque).max() / (unit * RADIUS))
        for force, torque in (strained(of, np.zeros(3), (np.full(3, 1e-15),) * 2, whole) for whole in turns)
    )
    found = spun(of, turns=10.0)
    return [
        below("force and moment after a rotation, over k_n A d", at_rest, 1e-14),
        relative("pull on a grain that goes round, m w^2 d", found[0], found[1], 2e-3, "N"),
        below("shear after 10 turns, over the pull", found[2], 4e-4),  # about the angle of a step
    ]


def spun(of: Strand, turns: float) -> tuple[float, float, float]:
    """A pair whose second grain goes round the clamped first one: m w^2 d, the pull of the bond, and shear over
    pull."""
    of = undamped(of)
    rate = 1e-3 * math.sqrt(NORMAL * AREA / MASS)
    place = np.array(of.particles.position)
    place[1, 0] += 1e-6 * SPACING
    velocity, spin = np.zeros((2, 3)), np.zeros((2, 3))
    velocity[1, 1], spin[:, 2] = rate * (1.0 + 1e-6) * SPACING, rate
    of = of._replace(particles=of.particles._replace(position=jnp.asarray(place)))
    count = int(turns * 2.0 * math.pi / rate / time_step(of) / 100.0)
    loads = loads_of(of, push(of, velocity=velocity, spin=spin, calls=count, steps=100).particles)
    pull = float(loads.normal_force[0])
    return MASS * rate**2 * SPACING, pull, float(loads.shear_force[0]) / pull


# --- beams --------------------------------------------------------------------------------------------------


def first_frequency(count: int) -> float:
    """3.516 sqrt(E I / (m L^4)) of a beam of `count` free grains, up to the end of the last one [rad/s]."""
    length, stiffness = (count + 0.5) * SPACING, NORMAL * SPACING * INERTIA
    return 3.516 * math.sqrt(stiffness / (MASS / SPACING * length**4))


def deflection(count: int, load: float) -> tuple[float, float]:
    """Of the tip of `count` free grains: P L^3 / (3 E I); and the sum over the bonds, which bend in their middles and
    shear [m]."""
    levers = (np.arange(count) + 0.5) * SPACING
    exact = float(np.sum(levers**2)) / (NORMAL * INERTIA) + count / (SHEARING * AREA)
    return load * (count * SPACING) ** 3 / (3.0 * NORMAL * SPACING * INERTIA), load * exact


@case("beam of bonded grains: cantilever under a load at its tip", "bonds", SOURCE)
def cantilever() -> list[Figure]:
    """P L^3/(3 E I) of eight grains in 2-D and 3-D, which are slowed down until they rest."""
    figures = []
    for dimension in (2, 3):
        of, free = strand(9, dimension), 8
        load = 1e-5 * NORMAL * AREA * SPACING
        slender, exact = deflection(free, load)
        rate = first_frequency(free)
        calls = int(14.0 / rate / time_step(of) / 20.0)
        force = [0.0] * (dimension - 1) + [-load]
        end = push(of, force, slowing=1.7 * rate, calls=calls).particles
        sunk = float(of.particles.position[-1, -1] - end.position[-1, -1])
        figures.append(relative(f"{dimension}-D: tip, P L^3 / (3 E I)", slender, sunk, 0.02, "m"))
        figures.append(relative(f"{dimension}-D: tip, summed over the bonds", exact, sunk, 1e-3, "m"))
        loads = loads_of(of, end)
        levers = (free - 0.5 - np.arange(free)) * SPACING
        wrong = float(np.max(np.abs(np.asarray(loads.bending_moment) / (load * levers) - 1.0)))
        figures.append(below(f"{dimension}-D: moments along the beam, P x", wrong, 5e-3))
        figures.append(
            relative(f"{dimension}-D: shear force at the root", load, float(loads.shear_force[0]), 5e-3, "N")
        )
    return figures


@case("beam of bonded grains: first frequency", "bonds", SOURCE)
def frequency() -> list[Figure]:
    """3.516 sqrt(E I/(m L^4)) of fifteen grains that are struck in the shape of the first mode."""
    of, free = undamped(strand(16)), 15
    length = (free + 0.5) * SPACING
    b = 1.8751041
    ratio = (math.cosh(b) + math.cos(b)) / (math.sinh(b) + math.sin(b))
    z = b * np.arange(free + 1) * SPACING / length
    shape = np.cosh(z) - np.cos(z) - ratio * (np.sinh(z) - np.sin(z))
    slope = (np.sinh(z) + np.sin(z) - ratio * (np.cosh(z) - np.cos(z))) * b / length
    rate = first_frequency(free)
    speed = 1e-4 * SPACING * rate
    velocity, spin = np.zeros((free + 1, 3)), np.zeros((free + 1, 3))
    velocity[:, 2], spin[:, 1] = speed * shape, -speed * slope
    steps = 10
    calls = int(1.2 * math.pi / rate / time_step(of) / steps)
    places = np.asarray(push(of, velocity=velocity, spin=spin, calls=calls, steps=steps).position)[:, :, 2]
    moved = (places - np.asarray(of.particles.position)[None, :, 2]) @ shape
    crossed = int(np.argmax(moved < 0.0))
    assert crossed > calls // 2
    fraction = moved[crossed - 1] / (moved[crossed - 1] - moved[crossed])
    half = (crossed + fraction) * steps * time_step(of)
    return [relative("angular frequency", rate, math.pi / half, 0.02, "rad/s")]


# --- strength -----------------------------------------------------------------------------------------------

STRENGTH = 1e-4 * NORMAL * SPACING


def breaking_load(of: Strand, force: Any = None, torque: Any = None, rate: float = 0.0) -> tuple[float, int, int]:
    """Part of a load, which grows from 0 to 1.1 times it, at which the first bond breaks; which bond, and how."""
    rate = rate or 0.3 * math.sqrt(NORMAL * AREA / MASS)
    # Slow enough that neither inertia nor what slows the grains down counts, 0.3/150 of the load.
    steps = 1 + int(0.05 / rate / time_step(of))
    calls = int(150.0 / rate / time_step(of) / steps)
    grown = [None if x is None else 1.1 * np.asarray(x) for x in (force, torque)]
    status = np.asarray(push(of, *grown, slowing=0.3 * rate, growing=1.0, calls=calls, steps=steps).status)[:, :-1]
    broken = (status != INTACT).any(axis=1)
    assert broken[-1] and not broken[0], "it breaks while the load grows"
    when = int(np.argmax(broken))
    bond = int(np.argmax(status[when] != INTACT))
    return 1.1 * (when + 0.5) / calls, bond, int(status[when, bond])


@case("bond: strength", "bonds", SOURCE)
def strengths() -> list[Figure]:
    """Load at which a bond breaks in tension, shear and twisting, and the root of a beam in bending."""
    pair = strand(2)
    figures, unit = [], STRENGTH * AREA
    load, _, how = breaking_load(pair.with_bonds(tensile_strength=STRENGTH), [unit, 0.0, 0.0])
    figures += [relative("tension: load over strength times A", 1.0, load, 0.01), below("as tension", how - TENSION, 0)]
    load, _, how = breaking_load(
        pair.with_bonds(shear_strength=STRENGTH), None, [2.0 * STRENGTH * INERTIA / RADIUS, 0, 0]
    )
    figures += [
        relative("twisting: torque over strength times J/R", 1.0, load, 0.01),
        below("as shear", how - SHEAR, 0),
    ]
    load, _, how = breaking_load(pair.with_bonds(shear_strength=STRENGTH), [0.0, unit, 0.0])
    figures += [relative("shear: load over strength times A", 1.0, load, 0.01), below("as shear", how - SHEAR, 0)]
    lever = 0.5 * SPACING
    load, _, how = breaking_load(
        pair.with_bonds(shear_strength=STRENGTH, moment_factor=0.0), [0.0, unit, 0.0], [0.0, 0.0, -unit * lever]
    )
    figures += [relative("shear without bending: the same", 1.0, load, 0.01)]
    beam, free = strand(5), 4
    tip = STRENGTH * INERTIA / RADIUS / ((free - 0.5) * SPACING)
    load, bond, how = breaking_load(
        beam.with_bonds(tensile_strength=STRENGTH), [0.0, 0.0, -tip], rate=first_frequency(free)
    )
    figures += [
        relative("bending: load over strength times I/(R x) at the root", 1.0, load, 0.01),
        below("number of the bond that breaks, from the root", bond, 0),
        below("as tension", how - TENSION, 0),
    ]
    return figures


# --- what is kept -------------------------------------------------------------------------------------------


def free_strand(count: int, dimension: int) -> Strand:
    """A strand without a clamp, and without dashpots."""
    of = undamped(strand(count, dimension))
    bodies = required(of.parameters.bodies)
    bodies = bodies._replace(density=jnp.full_like(bodies.density, DENSITY))
    return of._replace(parameters=of.parameters._replace(bodies=bodies))


def balance(of: Strand, particles: ParticleState) -> tuple[float, np.ndarray, np.ndarray]:
    """Energy [J], momentum [kg m/s] and angular momentum [kg m2/s]."""
    x, v, w = (np.asarray(a) for a in (particles.position, particles.velocity, particles.angular_velocity))
    moment = np.cross(x, v).sum(axis=0) if x.shape[1] == 3 else (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]).sum()
    energy = kinetic_energy(particles, of.parameters.bodies) + jnp.sum(loads_of(of, particles).energy)
    return float(energy), MASS * v.sum(axis=0), MASS * moment + SPIN_INERTIA * w.sum(axis=0)


@case("bonds: energy, momentum and angular momentum of a free strand", "bonds", "invariant")
def kept() -> list[Figure]:
    """Five grains that tumble and vibrate: kept to rounding, the energy with the square of the step."""
    figures = []
    for dimension in (2, 3):
        of, noise = free_strand(5, dimension), np.random.default_rng(1)
        turned = of.particles.angular_velocity.shape[1]
        velocity, spin = noise.normal(0.0, 0.1, (5, dimension)), noise.normal(0.0, 10.0, (5, turned))
        first = balance(of, of.particles._replace(velocity=jnp.asarray(velocity), angular_velocity=jnp.asarray(spin)))
        errors, step = [], 0.1 * time_step(of)
        for half in (1, 2):
            given: dict[str, Any] = {"step": step / half, "calls": 5, "steps": 100}
            end = push(of, velocity=velocity, spin=spin, **given).particles
            if half == 2:
                end = push(of._replace(particles=end), **given).particles
            last = balance(of, end)
            errors.append(abs(last[0] / first[0] - 1.0))
        figures.append(below(f"{dimension}-D: energy, step of a twentieth of the limit", errors[0], 1e-3))
        figures.append(below(f"{dimension}-D: energy, half the step, over a quarter", errors[1] / errors[0], 0.4))
        for name, before, after in zip(("momentum", "angular momentum"), first[1:], last[1:], strict=True):
            off = float(np.max(np.abs(after - before)) / np.max(np.abs(before)))
            figures.append(below(f"{dimension}-D: {name}", off, 1e-12))
        damped = push(of.with_bonds(damping=0.3), velocity=velocity, spin=spin, step=step, calls=5, steps=100).particles
        last = balance(of, damped)
        off = float(np.max(np.abs(last[2] - first[2])) / np.max(np.abs(first[2])))
        figures.append(below(f"{dimension}-D, with dashpots: angular momentum", off, 1e-12))
        figures.append(
            at_least(f"{dimension}-D, with dashpots: part of the energy lost", 0.05, 1.0 - last[0] / first[0])
        )
    return figures

"""Walls that move: belt, turntable, shaken plate, piston, rotating drum."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxdem
from jaxdem.failures import failures
from jaxdem.observables import contacts
from jaxdem.observables.walls import measuring_walls, surface_walls, wall_load
from jaxdem.particles.integrate import kinetic_energy
from jaxdem.run.differentiable import measured_rollout
from tests.cases.registry import Figure, absolute, at_least, below, case, relative

GRAVITY, RADIUS, DENSITY = 9.81, 0.005, 2500.0
MASS = DENSITY * 4.0 / 3.0 * np.pi * RADIUS**3
BELT = 0.4
"""Speed of the belt [m/s]."""


class Path(NamedTuple):
    """What a run has seen after each of its K intervals.

    Attributes:
        time: (K,) [s].
        position, velocity: (K, N, D) [m, m/s].
        spin: (K, N, A) [rad/s].
        load: (K, ...) force, torque about the origin, power and mass of the first wall beside the box, as `WallLoad`.
        pistons: state of the pistons, arrays (K, H); None without.
    """

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    load: Any
    pistons: Any


def path(tables: Mapping[str, Any], change: Callable[[Any], Any] | None = None) -> Path:
    """A scene run to its end.

    Args:
        tables: of the scene.
        change: of the parameters before the run.
    """
    scene = jaxdem.load_scene(dict(tables))
    simulation, parameters = jaxdem.build(scene)
    first = surface_walls(simulation, (0,))
    simulation = measuring_walls(simulation, first)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    parameters = parameters if change is None else change(parameters)
    steps = round(scene.time.end / simulation.interval)
    about = np.zeros(scene.dimension, parameters.gravity.dtype)

    def measure(state: Any, diagnostics: Any) -> Any:
        particles = state.particles
        seen = particles.position, particles.velocity, particles.angular_velocity
        return *seen, wall_load(diagnostics, first, about), particles.pistons

    found = _run(simulation, parameters, state, neighbors, steps, measure)
    assert int(found.failures) == 0
    seen = jax.tree.map(np.asarray, found.observations)
    return Path((np.arange(steps) + 1) * simulation.interval, *seen)


def _run(simulation: Any, parameters: Any, state: Any, neighbors: Any, steps: int, measure: Any) -> Any:
    run = functools.partial(measured_rollout, steps=steps, measure=measure)
    return jax.jit(run, static_argnums=0)(simulation, parameters, state, neighbors)


def grain(dimension: int, **contact: Any) -> dict[str, Any]:
    """Tables of one grain that lies on a plane at a height of 2 radii."""
    lift = [0.5] * (dimension - 1)
    constants = {"young_modulus": 2e7, "poisson_ratio": 0.3, "friction": 0.3, "restitution": 0.5} | contact
    stiff = (4.0 / 3.0) * constants["young_modulus"] / (2.0 * (1.0 - 0.3**2)) * np.sqrt(RADIUS)
    overlap = (MASS * GRAVITY / stiff) ** (2.0 / 3.0)
    return {
        "precision": "float64",
        "domain": {"size": [1.0] * dimension, "gravity": [0.0] * (dimension - 1) + [-GRAVITY]},
        "particles": {"radius": RADIUS, "density": DENSITY, "position": [[*lift, 3.0 * RADIUS - overlap]]},
        "contact": constants,
        "coupling": {"interval": 1e-3},
        "walls": [{"kind": "plane", "point": [*lift, 2.0 * RADIUS], "normal": [*([0.0] * (dimension - 1)), 1.0]}],
        "time": {"end": 0.25, "output_interval": 0.05},
    }


def on_belt(dimension: int, **contact: Any) -> dict[str, Any]:
    """The same, the plane a belt along x from t = 0."""
    tables = grain(dimension, **contact)
    motion = {"kind": "translation", "velocity": [BELT, *([0.0] * (dimension - 1))]}
    tables["walls"][0]["motion"] = [motion]
    return tables


@case(
    "grain on a belt",
    "moving walls",
    "Coulomb friction: a grain that cannot roll slides until v/(mu g); one that rolls until 2 v/(7 mu g), at 2/7 v",
    fast={"dimensions": (2,)},
)
def belt(dimensions: Sequence[int] = (2, 3)) -> list[Figure]:
    """A grain lies on a belt that starts."""
    figures = []
    for dimension in dimensions:
        # With this much rolling resistance the grain does not turn.
        held = path(on_belt(dimension, rolling_friction=2.0, rolling_model="epsd"))
        speed = held.velocity[:, 0, 0]
        sliding = speed < 0.95 * BELT
        slope = np.polyfit(held.time[sliding], speed[sliding], 1)[0]
        rolling = path(on_belt(dimension))
        way = 0.3 * GRAVITY
        figures += [
            relative(f"{dimension}-D, time to the belt's speed", BELT / way, BELT / slope, 5e-3, "s"),
            relative(f"{dimension}-D, speed after", BELT, speed[-1], 1e-3, "m/s"),
            # The arm is shorter than the radius by half of the overlap.
            relative(f"{dimension}-D, speed where it rolls", BELT / 3.5, rolling.velocity[-1, 0, 0], 2e-3, "m/s"),
            below(f"{dimension}-D, force along the belt at the end", held.load.force[-1, 0] / (MASS * GRAVITY), 1e-9),
        ]
    return figures


@case(
    "ball on a turntable",
    "moving walls",
    "a homogeneous ball that rolls on a table that turns at W moves in a circle at 2/7 W: laws of motion and of "
    "rolling",
    fast={"end": 0.5},
)
def turntable(end: float = 2.0, rate: float = 6.0) -> list[Figure]:
    """The ball starts with the velocity and spin of pure rolling."""
    tables = grain(3, friction=2.0, restitution=0.9, young_modulus=1e8)
    tables["walls"][0]["motion"] = [{"kind": "rotation", "rate": rate, "center": [0.5, 0.5, 0.0], "axis": [0, 0, 1]}]
    tables["time"] = {"end": end, "output_interval": end}
    away = 0.05
    # Any circle about any point: here about the axis with the velocity 2/7 W r across, spin for rolling contact.
    speed = 2.0 / 7.0 * rate * away
    position = tables["particles"]["position"][0]
    tables["particles"]["position"] = [[0.5 + away, 0.5, position[2]]]
    tables["particles"]["velocity"] = [[0.0, speed, 0.0]]
    # v + s x (-R z) = W x r:  (-s_y R, v + s_x R) = (0, W away).
    tables["particles"]["angular_velocity"] = [[(rate * away - speed) / RADIUS, 0.0, 0.0]]
    found = path(tables)
    x, y = (found.position[:, 0, k] - 0.5 for k in range(2))
    angle = np.unwrap(np.arctan2(y, x))
    turned_by = (angle[-1] - angle[0]) / (found.time[-1] - found.time[0])
    return [
        relative("angular velocity of its path", 2.0 / 7.0 * rate, turned_by, 3e-3, "rad/s"),
        relative("distance from the axis at the end", away, np.hypot(x[-1], y[-1]), 5e-3, "m"),
    ]


@case(
    "grain on a shaken plate",
    "moving walls",
    "z = A sin(w t): a grain leaves where A w^2 sin(w t) = g and flies v^2/(2 g) higher; it stays where A w^2 < g",
    fast={},
)
def shaken() -> list[Figure]:
    """A plate that oscillates along the vertical axis."""

    frequency = 25.0
    w = 2.0 * np.pi * frequency

    def shaken_by(strength: float) -> tuple[Path, float]:
        """It starts at rest in its lowest place, A below the middle."""
        tables, amplitude = grain(2, young_modulus=5e8, restitution=0.1), strength * GRAVITY / w**2
        motion = {"kind": "oscillation", "direction": [0, 1], "amplitude": amplitude, "frequency": frequency}
        tables["walls"][0]["motion"] = [motion | {"phase": -np.pi / 2}]
        tables["particles"]["position"][0][1] -= amplitude
        tables["coupling"]["interval"] = 2e-4
        tables["time"] = {"end": 0.12, "output_interval": 0.04}
        return path(tables), amplitude

    weak, _ = shaken_by(0.9)
    strong, amplitude = shaken_by(1.6)
    late = weak.time > 0.04
    leaves = (0.5 * np.pi + np.arcsin(1.0 / 1.6)) / w
    speed, place = amplitude * np.cos(np.arcsin(1.0 / 1.6)) * w, amplitude / 1.6
    flying = (strong.load.mass == 0.0) & (strong.time > 0.5 * leaves)
    height = strong.position[strong.time < 0.04, 0, 1].max() - 3.0 * RADIUS
    load = -weak.load.force[late, 1] / (MASS * GRAVITY)
    # The last contact is known to an interval, and the grain's overlap takes 0.4 ms to go.
    return [
        below("strength 0.9: part of the time without contact", np.mean(weak.load.mass == 0.0), 0.0),
        relative("strength 0.9: mean load over the weight", 1.0, load.mean(), 5e-3),
        relative("strength 0.9: largest load over the weight", 1.9, load.max(), 1e-2),
        absolute("strength 1.6: time of the last contact", leaves, strong.time[np.argmax(flying)], 1e-3, "s"),
        relative("strength 1.6: height of the flight", place + speed**2 / (2 * GRAVITY), height, 1e-2, "m"),
    ]


DRUM = 0.05
"""Radius of the drum [m]."""


class Turned(NamedTuple):
    """A drum that has turned for some time.

    Attributes:
        work: that the drum has done, from force and torque on it [J].
        lost: in all contacts, from the velocities of the bodies at the contacts [J].
        gained: kinetic energy and energy of height [J].
        angle: of the bed: direction of the drum's centre from the centre of mass, from the vertical; mean over the
            second half [degrees].
    """

    work: float
    lost: float
    gained: float
    angle: float


def drum_tables(rate: float, friction: float, radius: float, end: float) -> dict[str, Any]:
    """Tables of a half-filled drum in 2-D, a circle that turns from z to x as seen in pictures (clockwise)."""
    middle = 1.2 * DRUM
    inside = {"shape": "sphere", "center": [middle, middle], "radius": 0.98 * DRUM}
    motion = [{"kind": "rotation", "rate": rate}]
    return {
        "precision": "float64",
        "seed": 1,
        "domain": {"size": [2.0 * middle] * 2},
        "particles": {
            "count": round(0.4 * (DRUM / radius) ** 2),
            "radius": radius,
            "density": DENSITY,
            "pack": {"kind": "settled", "region": inside},
        },
        "contact": {"young_modulus": 5e5, "friction": friction, "restitution": 0.5, "speed": 1.0},
        "walls": [{"kind": "cylinder", "center": [middle, middle], "radius": DRUM, "motion": motion}],
        "coupling": {"interval": 1e-4},
        "time": {"end": end, "output_interval": end},
    }


def contact_loss(found: Any, particles: Any, radius: Any, turning: Any, middle: Any) -> Any:
    """Power that contacts take, minus the sum of f.(v_one - v_other) at the contacts [W]; 2-D, all of one radius.

    Written anew from the contacts of a state: positions, velocities and spins, and the drum's angular velocity.
    """
    x, v, w = particles.position, particles.velocity, particles.angular_velocity[:, 0]

    def across(spin: Any, arm: Any) -> Any:
        return spin[:, None] * jnp.stack([-arm[:, 1], arm[:, 0]], axis=1)

    normal, force = (jnp.stack(part, axis=1) for part in (found.between.normal, found.between.force))
    one, other = found.first, found.second
    arm = (radius - 0.5 * found.between.overlap)[:, None] * normal
    slip = v[one] - v[other] + across(w[one], -arm) - across(w[other], arm)
    total = -jnp.sum(force * slip)
    drum = -1  # the last wall
    normal, force = (jnp.stack([c[drum] for c in part], axis=1) for part in (found.walls.normal, found.walls.force))
    arm = (radius - 0.5 * jnp.maximum(found.walls.overlap[drum], 0.0))[:, None] * normal
    of_wall = across(jnp.broadcast_to(turning, w.shape), x - arm - middle[None])
    return total - jnp.sum(force * (v + across(w, -arm) - of_wall))


def turned(rate: float, friction: float, radius: float, end: float, settle: float = 0.3) -> Turned:
    """A drum that has been turned for `settle` and then for the rest of the time.

    Args:
        rate: angular velocity [rad/s].
        friction: of all contacts [-].
        radius: of the grains [m].
        end: time [s].
        settle: part of it before energies are counted [-].
    """
    scene = jaxdem.load_scene(drum_tables(rate, friction, radius, end))
    simulation, parameters = jaxdem.build(scene)
    wall = surface_walls(simulation, (0,))
    simulation = measuring_walls(simulation, wall)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    middle = jnp.asarray(scene.walls[0].center)
    bodies, gravity = parameters.bodies, jnp.asarray([0.0, -GRAVITY])
    turning = jnp.asarray(rate)

    def energy(particles: Any) -> Any:
        height = jnp.sum(bodies.mass * (particles.position @ -gravity))
        return height + kinetic_energy(particles, bodies)

    def one(carry: Any, _: None) -> Any:
        state, neighbors, code = carry
        state, neighbors, report = simulation.step(parameters, state, neighbors)
        load = wall_load(report, wall, middle)
        touching = contacts(simulation, parameters, state, neighbors)
        loss = contact_loss(touching, state.particles, bodies.radius, turning, middle)
        centre = jnp.mean(state.particles.position, axis=0) - middle
        seen = -load.torque[0] * rate, -load.power, loss, energy(state.particles), centre
        return (state, neighbors, code | failures(simulation, report)), seen

    steps = round(end / simulation.interval)
    run = jax.jit(lambda *carry: jax.lax.scan(one, carry, None, length=steps))
    (_, _, code), seen = run(state, neighbors, jnp.zeros((), jnp.int32))
    assert int(code) == 0
    torque_power, power, loss, held, centre = map(np.asarray, seen)
    np.testing.assert_allclose(torque_power, power, rtol=1e-9, atol=1e-12)
    first = round(settle * steps)
    dt = simulation.interval
    centre = centre[steps // 2 :].mean(axis=0)
    return Turned(
        float(torque_power[first:].sum() * dt),
        float(loss[first:].sum() * dt),
        float(held[-1] - held[first - 1]),
        float(np.degrees(np.arctan2(abs(centre[0]), -centre[1]))),
    )


@case(
    "half-filled drum",
    "moving walls",
    "energy: torque times angular velocity = what contacts take + change of energy; the bed leans more the rougher the "
    "grains and the faster the drum",
    fast={"radius": 0.005, "end": 0.3, "rates": (2.0,)},
)
def drum(radius: float = 0.0025, end: float = 2.0, rates: Sequence[float] = (2.0, 8.0)) -> list[Figure]:
    """A drum of 0.1 m in 2-D; 40 grains are too few to tell angles of different speeds apart."""
    runs = [turned(rate, 0.5, radius, end) for rate in rates]
    figures = [
        relative(f"work of the drum, {rate:g} rad/s, friction 0.5", one.lost + one.gained, one.work, 1e-2, "J")
        for rate, one in zip(rates, runs, strict=True)
    ]
    if len(runs) == 1:
        return figures
    more = runs[0].angle - turned(rates[0], 0.15, radius, end).angle
    figures.append(at_least("angle with friction 0.5 less that with 0.15", 1.0, more, "degrees"))
    more = runs[1].angle - runs[0].angle
    figures.append(at_least(f"angle at {rates[1]:g} rad/s less that at {rates[0]:g}", 1.0, more, "degrees"))
    return figures


def pressed(damping: float, dimension: int = 2, precision: str = "float64") -> dict[str, Any]:
    """Tables of a grain between the floor and a heavy lid that a force holds, all just touching."""
    side = [0.5] * (dimension - 1)
    tables = grain(dimension)
    contact = {"law": "linear_spring_dashpot", "normal_stiffness": 1e5, "restitution": 1.0, "friction": 0.0}
    down = [*([0.0] * (dimension - 1)), -1.0]
    piston = {"direction": down, "force": 10.0, "mass": 1.0, "damping": damping}
    return tables | {
        "precision": precision,
        "particles": {"radius": RADIUS, "density": DENSITY, "position": [[*side, RADIUS]]},
        "contact": contact,
        "walls": [{"kind": "plane", "point": [*side, 2.0 * RADIUS], "normal": down, "piston": piston}],
        "time": {"end": 0.1, "output_interval": 0.05},
    }


@case(
    "lid on a spring",
    "moving walls",
    "a lid of mass M under F + M g on two springs k in series: s = (F + M g)/(k/2) (1 - cos(sqrt(k/(2 M)) t))",
    fast={"dimensions": (2,)},
)
def lid(dimensions: Sequence[int] = (2, 3)) -> list[Figure]:
    """A piston on a grain of the linear law: free swinging, and at rest with damping."""
    figures = []
    for dimension in dimensions:
        load, rate = 10.0 + GRAVITY, np.sqrt(0.5e5)
        free = path(pressed(0.0, dimension))
        closed = load / 0.5e5 * (1.0 - np.cos(rate * free.time))
        off = np.abs(free.pistons.displacement[:, 0] - closed).max() / (load / 0.5e5)
        rest = path(pressed(200.0, dimension))
        way = rest.pistons.displacement[-1, 0]
        figures += [
            # The grain's own mass is 1/800 of the lid's: it slows the swing by about as much in three periods.
            below(f"{dimension}-D, largest difference over the swing, of its size", off, 2e-2),
            relative(f"{dimension}-D, way at rest", (2.0 * load + MASS * GRAVITY) / 1e5, way, 1e-4, "m"),
            relative(f"{dimension}-D, force on the lid at rest", load, rest.load.force[-1, -1], 1e-4, "N"),
            relative(f"{dimension}-D, mass in contact", MASS, rest.load.mass[-1], 1e-12, "kg"),
        ]
    return figures

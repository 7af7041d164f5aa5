"""What must not change the motion: order, place, orientation, handedness, a third dimension, and how it is computed."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxdem
from jaxdem.coupling.void_fraction import solid_fraction
from jaxdem.particles.neighbors import Room
from tests.cases.registry import Figure, at_least, below, case
from tests.cases.worlds import Track, batch, constants, track, world

# --- particles alone --------------------------------------------------------------------------------------

SIDE, FRAMES, EVERY, STEP = 0.5, 20, 100, 2e-5
# Discs of 0.3 to 1 cm that fall on each other and on the floor, with spin: a few collisions each.
RADIUS = np.array([0.01, 0.008, 0.01, 0.003, 0.007])
DENSITY = np.array([2500.0, 1000.0, 2500.0, 7000.0, 2000.0])
POSITION = np.array([[0.10, 0.0101], [0.122, 0.010], [0.111, 0.031], [0.095, 0.027], [0.13, 0.028]])
VELOCITY = np.array([[0.3, -0.1], [-0.4, 0.0], [0.1, -0.6], [0.2, -0.5], [-0.3, -0.4]])
SPIN = np.array([[10.0], [-20.0], [5.0], [0.0], [30.0]])
MATERIAL = constants(young_modulus=5e6, restitution=0.7, friction=0.4)
GRAVITY = np.array([0.0, -9.81])
ORDER = np.array([3, 0, 4, 2, 1])
TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])  # rows times this: (x, y) -> (-y, x)

# Different orders of summation and other rounding of x: 1e-16 of 0.5 m, grown by tens in each of the three
# or four collisions of a particle (measured 8e-12 m). A contact of 1 ms turns an error of place into one of
# velocity 3e3 times as large, and that into one of spin by 2.5 / r of the smallest disc, some 1e3 times.
TOLERANCE = 1e-10


def scene(position, velocity, spin, gravity=GRAVITY, radius=RADIUS, density=DENSITY, periodic=None):
    return world(
        position, velocity, spin, radius=radius, density=density, box=(SIDE,) * position.shape[1],
        gravity=gravity, rebuild=False, material=MATERIAL, periodic=periodic,
    )  # fmt: skip


@functools.cache
def variants() -> dict[str, Track]:
    """The same scene as it is, in another order, further right, turned by 90 degrees, and mirrored; one program."""
    middle, mirror = SIDE / 2, np.array([-1.0, 1.0])
    scenes = {
        "plain": scene(POSITION, VELOCITY, SPIN),
        "order": scene(POSITION[ORDER], VELOCITY[ORDER], SPIN[ORDER], radius=RADIUS[ORDER], density=DENSITY[ORDER]),
        "translation": scene(POSITION + np.array([0.2, 0.0]), VELOCITY, SPIN),
        "rotation": scene((POSITION - middle) @ TURN + middle, VELOCITY @ TURN, SPIN, GRAVITY @ TURN),
        "reflection": scene((POSITION - middle) * mirror + middle, VELOCITY * mirror, -SPIN),
    }
    _, seen = track(batch(list(scenes.values())), np.full(len(scenes), STEP), FRAMES, EVERY)
    runs = {name: Track(*(field[number] for field in seen)) for number, name in enumerate(scenes)}
    back, turned, mirrored = np.argsort(ORDER), runs["rotation"], runs["reflection"]
    return runs | {
        "order": Track(*(field[:, back] for field in runs["order"])),
        "translation": runs["translation"]._replace(position=runs["translation"].position - np.array([0.2, 0.0])),
        "rotation": turned._replace(
            position=(turned.position - middle) @ TURN.T + middle, velocity=turned.velocity @ TURN.T
        ),
        "reflection": mirrored._replace(
            position=(mirrored.position - middle) * mirror + middle,
            velocity=mirrored.velocity * mirror,
            spin=-mirrored.spin,
        ),
    }


def as_layer(rows: np.ndarray, value: float = 0.0) -> np.ndarray:
    """Rows (x, z) as (x, y, z)."""
    return np.insert(rows, 1, value, axis=1)


def differences(what: str, plain: Track, other: Track) -> list[Figure]:
    """Largest difference of position, velocity and spin."""
    gates = (
        ("position", TOLERANCE, "m"),
        ("velocity", 1e3 * TOLERANCE, "m/s"),
        ("spin", 1e5 * TOLERANCE, "1/s"),
    )
    return [
        below(f"{what}: {name}", np.abs(getattr(other, name) - getattr(plain, name)).max(), gate, unit)
        for name, gate, unit in gates
    ]


@case("invariance of contacts", "invariance", "symmetry of the laws of motion")
def contacts() -> list[Figure]:
    """Five discs that fall on each other: in another order, moved, turned, mirrored, and as spheres in a layer.

    In 3-D the plane is y = 0.25 m, and nothing leaves it; the 2-D spin runs from x to z, which is about -y.
    """
    runs = variants()
    plain = runs["plain"]
    figures = [
        at_least("least contact force of a disc", 1e-3, np.abs(plain.force).max(axis=(0, 2)).min(), "N"),
        at_least("least change of spin of a disc", 1.0, np.ptp(plain.spin, axis=0).min(), "1/s"),
    ]
    for name in ("order", "translation", "rotation", "reflection"):
        figures += differences(name, plain, runs[name])
    spin = np.zeros((5, 3))
    spin[:, 1] = -SPIN[:, 0]
    # Periodic across: the side walls are out of reach, and need not be compiled.
    layer = scene(
        as_layer(POSITION, 0.25), as_layer(VELOCITY), spin, np.array([0, 0, -9.81]),
        periodic=(True, True, False),
    )  # fmt: skip
    _, seen = track(layer, STEP, FRAMES, EVERY)
    flat = seen._replace(
        position=seen.position[..., [0, 2]], velocity=seen.velocity[..., [0, 2]], spin=-seen.spin[..., 1:2]
    )
    figures += differences("layer of spheres", plain, flat)
    figures.append(below("layer: out of the plane", np.abs(seen.position[..., 1] - 0.25).max(), 0.0, "m"))
    return figures


# --- particles in a fluid ---------------------------------------------------------------------------------

CELLS, PLACES = (6, 4), np.array([[0.03, 0.0101], [0.07, 0.05], [0.088, 0.062], [0.15, 0.03], [0.19, 0.1]])
SPEEDS = np.array([[0.1, 0.0], [0.3, 0.1], [-0.2, -0.1], [0.0, -0.3], [0.1, -0.2]])
COUPLED_TOLERANCE = 1e-11
"""Solves of the pressure leave 2e-12 of U/h (m, m/s, kPa); measured 1e-14 at most."""


class Coupled(NamedTuple):
    """A scene of five grains in a channel that is periodic along x, and a compiled march."""

    simulation: Any
    parameters: Any
    state: Any
    neighbors: Any
    march: Any

    def run(self, steps: int, state: Any = None, neighbors: Any = None) -> Any:
        """State, list and failures after so many intervals."""
        state = self.state if state is None else state
        neighbors = self.neighbors if neighbors is None else neighbors
        return self.march(self.parameters, state, neighbors, steps)


def coupled(up: int = 1, layer: bool = False) -> Coupled:
    """The channel with gravity along axis 1, or turned so that `up` is 0; or as a 3-D layer one cell thick."""
    size, cells, gravity = [0.24, 0.16], list(CELLS), [0.0, -9.81]
    place, speed = PLACES, SPEEDS
    kinds = {"left": "periodic", "right": "periodic", "bottom": "no_slip", "top": "free_slip"}
    if up == 0:
        size, cells, gravity, place, speed = (
            size[::-1],
            cells[::-1],
            gravity[::-1],
            place[:, ::-1],
            speed[:, ::-1],
        )
        kinds = {"bottom": "periodic", "top": "periodic", "left": "no_slip", "right": "free_slip"}
    if layer:
        size, cells, gravity = [0.24, 0.04, 0.16], [6, 1, 4], [0.0, 0.0, -9.81]
        place, speed = as_layer(place, 0.02), as_layer(speed)
        kinds |= {"front": "free_slip", "back": "free_slip"}
    scene = jaxdem.load_scene(dict(
        precision="float64",
        domain=dict(size=size, gravity=gravity) | ({} if layer else {"depth": 0.04}),
        particles=dict(radius=0.01, density=2000.0, position=place.tolist(), velocity=speed.tolist()),
        contact=dict(young_modulus=1e6, friction=0.4, restitution=0.6, speed=0.5),
        fluid=dict(cells=cells, viscosity=1e-4, time_step=0.004),
        boundary={side: dict(kind=kind) for side, kind in kinds.items()},
        coupling=dict(drag="di_felice"),
        time=dict(end=1.0, output_interval=0.1),
    ))  # fmt: skip
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)

    def march(parameters, state, neighbors, steps):  # type: ignore[no-untyped-def]
        def body(_, carry):  # type: ignore[no-untyped-def]
            state, neighbors, good = carry
            state, neighbors, report = simulation.step(parameters, state, neighbors)
            return state, neighbors, good & report.fluid.converged & ~report.particles.overflow

        return jax.lax.fori_loop(0, steps, body, (state, neighbors, jnp.asarray(True)))

    return Coupled(simulation, parameters, state, neighbors, jax.jit(march))


def moved(start: Coupled, position: np.ndarray, velocity: np.ndarray) -> tuple[Any, Any]:
    """State and list with the particles elsewhere, the water around them at rest."""
    particles = start.state.particles._replace(position=jnp.asarray(position), velocity=jnp.asarray(velocity))
    coupling, parameters = start.simulation.coupling, start.parameters
    grid = coupling.interval.solver.grid
    weights = coupling.deposition.weights(grid, particles.position, parameters.bodies.radius)
    solids = solid_fraction(grid, weights, parameters.bodies.volume)
    fluid = start.state.fluid._replace(void_fraction=1.0 - solids)
    return start.state._replace(particles=particles, fluid=fluid), start.simulation.allocate(
        start.parameters, particles
    )


def compared(what: str, gate: float, pairs: dict[str, tuple[Any, Any]]) -> list[Figure]:
    """Largest difference of each quantity (m, m/s, Pa over 1000)."""
    return [
        below(f"{what}: {name}", np.abs(np.asarray(a) - np.asarray(b)).max(), gate) for name, (a, b) in pairs.items()
    ]


@case(
    "invariance of particles in a fluid", "invariance", "symmetry; the same equations",
    fast={"programs": ()},
)  # fmt: skip
def in_fluid(programs: tuple[str, ...] = ("batch", "slots", "rotation", "layer")) -> list[Figure]:
    """Five grains that fall, meet and stir a channel: in another order, moved along by a cell, in two chunks, in a
    batch, with more slots in the list, turned by 90 degrees, and as a 3-D layer one cell thick.
    """
    one, steps = coupled(), 30
    end, _, good = one.run(steps)
    x, v, p = end.particles.position, end.particles.velocity, end.fluid.pressure / 1000.0
    u = end.fluid.face_velocity
    moving = float(np.abs(v).max()) if bool(good) else np.nan
    figures = [
        at_least("largest speed of the grains", 0.1, moving, "m/s"),
        at_least("largest speed of the water", 0.01, max(float(np.abs(f).max()) for f in u), "m/s"),
        at_least("largest contact force", 1e-4, float(np.abs(end.particles.contact_force).max()), "N"),
    ]
    back = np.argsort(ORDER)
    other = one.run(steps, *moved(one, PLACES[ORDER], SPEEDS[ORDER]))[0]
    figures += compared("order", COUPLED_TOLERANCE, {
        "position": (x, other.particles.position[back]), "velocity": (v, other.particles.velocity[back]),
        "face velocity": (u[0], other.fluid.face_velocity[0]), "pressure": (p, other.fluid.pressure / 1000.0),
    })  # fmt: skip
    # One cell further along the periodic axis; x is not wrapped by the time that it is compared.
    other = one.run(steps, *moved(one, PLACES + np.array([0.04, 0.0]), SPEEDS))[0]
    along = np.mod(np.asarray(other.particles.position)[:, 0] - 0.04, 0.24)
    figures += compared("translation by a cell", COUPLED_TOLERANCE, {
        "position": (np.mod(x[:, 0], 0.24), along), "velocity": (v, other.particles.velocity),
        "pressure": (p, np.roll(np.asarray(other.fluid.pressure), -1, axis=0) / 1000.0),
    })  # fmt: skip
    half, list_, _ = one.run(steps // 2)
    other = one.run(steps - steps // 2, half, list_)[0]
    figures += compared("two chunks", 0.0, {
        "position": (x, other.particles.position), "face velocity": (u[1], other.fluid.face_velocity[1]),
    })  # fmt: skip
    if "batch" in programs:
        # Gravities of one half, one and two: the middle one is the scene.
        scale = jnp.asarray([0.5, 1.0, 2.0])
        many = jax.jit(jax.vmap(
            lambda s: one.march(
                one.parameters._replace(gravity=s * one.parameters.gravity), one.state, one.neighbors, steps)
        ))(scale)[0]  # fmt: skip
        figures += compared("batch", COUPLED_TOLERANCE, {
            "position": (x, many.particles.position[1]), "velocity": (v, many.particles.velocity[1]),
            "face velocity": (u[0], many.fluid.face_velocity[0][1]),
        })  # fmt: skip
        figures.append(
            at_least("batch: members differ", 1e-3, float(np.abs(many.particles.position[2] - x).max()), "m")
        )
    if "slots" in programs:
        room = one.neighbors.room
        more = Room(room.slots + 5, room.pairs + 7, room.cell + 3)
        wider = one.simulation.with_room(one.state, one.neighbors, more)
        other = one.run(steps, *wider)[0]
        figures += compared("capacity of the list", COUPLED_TOLERANCE, {
            "position": (x, other.particles.position), "velocity": (v, other.particles.velocity),
        })  # fmt: skip
    if "rotation" in programs:
        other = coupled(up=0).run(steps)[0]
        figures += compared("rotation by 90 degrees", COUPLED_TOLERANCE, {
            "position": (x, other.particles.position[:, ::-1]), "velocity": (v, other.particles.velocity[:, ::-1]),
            "face velocity": (u[0], other.fluid.face_velocity[1].T), "pressure": (p, other.fluid.pressure.T / 1000.0),
        })  # fmt: skip
    if "layer" in programs:
        other = coupled(layer=True).run(steps)[0]
        figures += compared("layer of spheres", COUPLED_TOLERANCE, {
            "position": (x, other.particles.position[:, [0, 2]]), "velocity": (v, other.particles.velocity[:, [0, 2]]),
            "face velocity": (u[1], other.fluid.face_velocity[2][:, 0]),
            "pressure": (p, other.fluid.pressure[:, 0] / 1000.0),
            "out of the plane": (other.particles.position[:, 1], 0.02),
        })  # fmt: skip
    return figures

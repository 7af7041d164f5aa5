"""Contact: what must be conserved, and what float32 must resolve."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import scipy.spatial

from jaxdem.particles.contact import HertzMindlin
from jaxdem.particles.contact_interval import ContactInterval
from jaxdem.particles.contact_model import ContactModel
from tests.cases.registry import Figure, at_least, below, case
from tests.cases.worlds import World, constants, forces, track, world

# --- momentum ---------------------------------------------------------------------------------------------

FRICTION = constants(young_modulus=1e7, restitution=0.6, friction=0.4)


def totals(scene: World, seen):
    """Linear and angular momentum about the origin at every frame; spin counts with 2/5 m r^2."""
    count = seen.position.shape[1]
    mass = np.broadcast_to(np.asarray(scene.properties.mass), (count,))
    inertia = np.broadcast_to(np.asarray(scene.properties.inertia), (count,))
    linear = np.einsum("i,tid->td", mass, seen.velocity)
    x, p = seen.position, mass[None, :, None] * seen.velocity
    flat = x.shape[2] == 2
    orbital = (x[..., :1] * p[..., 1:] - x[..., 1:] * p[..., :1]) if flat else np.cross(x, p)
    angular = np.sum(orbital + inertia[None, :, None] * seen.spin, axis=1)
    return linear, angular


def cluster(dimension):
    """Six particles of two sizes (five in 2-D) that fall towards their centre with spin, no walls."""
    generator = np.random.default_rng(3)
    angle = np.arange(5) * 2 * np.pi / 5
    flat, axes = np.stack([np.cos(angle), np.sin(angle)], 1), np.concatenate([np.eye(3), -np.eye(3)])
    corners = flat if dimension == 2 else axes
    position = 0.022 * corners + generator.uniform(-1e-3, 1e-3, corners.shape)
    count = len(position)
    radius = np.where(np.arange(count) % 2 == 0, 0.01, 0.007)
    spin = generator.uniform(-30, 30, (count, 1 if dimension == 2 else 3))
    velocity = -30.0 * position + generator.uniform(-0.2, 0.2, position.shape)
    return world(position, velocity, spin, radius=radius, walls=False, rebuild=False, material=FRICTION)


@case("linear and angular momentum of contacts", "contact", "Newton's third law")
def contact_momentum() -> list[Figure]:
    """Both forces of a pair are equal and opposite, and the arms r - d/2 meet in one point [round-off].

    2,000 steps with some ten contacts at a time: round-off of 1e-16 in every one of 1e4 terms, random, is
    1e-14 of the momentum exchanged; ten times that is allowed. Positions are 0.03 m at most.
    """
    figures = []
    for dimension in (2, 3):
        scene = cluster(dimension)
        _, seen = track(scene, 2e-5, 80, 25)
        linear, angular = totals(scene, seen)
        scale = np.sum(np.asarray(scene.properties.mass)[:, None] * np.abs(np.asarray(scene.state.velocity)))
        where = f"{dimension}-D"
        figures += [
            at_least(f"{where}: largest contact force", 0.1, np.abs(seen.force).max(), "N"),
            at_least(f"{where}: largest change of spin", 5.0, np.ptp(seen.spin, axis=0).max(), "1/s"),
            below(f"{where}: linear momentum", np.abs(linear - linear[0]).max() / scale, 1e-13),
            below(f"{where}: angular momentum over 1 m", np.abs(angular - angular[0]).max() / scale, 1e-14),
        ]
    return figures


# --- energy -----------------------------------------------------------------------------------------------


@case(
    "energy of an elastic gas", "contact", "conservation of energy",
    fast={"count": 8, "dimension": 2, "steps": 5_000},
)  # fmt: skip
def elastic_gas(count: int = 10, dimension: int = 3, steps: int = 100_000) -> list[Figure]:
    """Elastic, frictionless spheres at t_H/60 of the mean speed: the energy drifts by under 1e-3.

    count^dimension of them, 1,000 at full size; kinetic energy and that of the compressed contacts, 8/15 E*
    sqrt(R*) d^(5/2) each, in 200 moments. The box is periodic but for the walls below and above.
    """
    generator = np.random.default_rng(5)
    radius, density, pitch, modulus = 0.008, 2500.0, 0.04, 1e8
    side = pitch * count
    axes = np.meshgrid(*[np.arange(count)] * dimension, indexing="ij")
    position = (np.stack(axes, -1).reshape(-1, dimension) + 0.5) * pitch
    position = position + generator.uniform(-0.01, 0.01, position.shape)
    velocity = generator.normal(0.0, 1.0, position.shape)
    scene = world(
        position, velocity, radius=radius, density=density, box=(side,) * dimension,
        periodic=(True,) * (dimension - 1) + (False,), skin=0.5, material=constants(young_modulus=modulus),
    )  # fmt: skip
    mass = density * 4 / 3 * np.pi * radius**3
    effective = modulus / 1.82
    step = 2.868 * ((mass / 2) ** 2 / (radius / 2 * effective**2 * 1.4)) ** 0.2 / 60
    after, seen = track(scene, step, 200, steps // 200)
    energy = np.array([
        0.5 * mass * np.sum(v**2) + elastic_energy(x, radius, side, effective)
        for x, v in zip(seen.position, seen.velocity, strict=True)
    ])  # fmt: skip
    start = 0.5 * mass * np.sum(velocity**2)
    touching = np.mean(np.abs(seen.force).max(axis=2) > 0.0)
    met = np.ptp(seen.velocity, axis=0).max(axis=1) > 0.0
    return [
        below(
            f"energy drift over {steps} steps, {touching:.1%} in contact",
            np.abs(energy / start - 1).max(),
            1e-3,
        ),
        below("spin", np.abs(seen.spin).max(), 0.0, "1/s"),
        at_least("share of particles that met another", 0.8, met.mean()),
        at_least("builds of the list", 5, int(after.neighbors.builds)),
        below("overflow of the list", float(after.neighbors.overflow), 0.0),
    ]


def elastic_energy(position, radius, side, effective) -> float:
    """Sum of 8/15 E* sqrt(R*) d^(5/2) over pairs and the two walls of a box of periodic sides [J]."""
    wrapped = position.copy()
    wrapped[:, :-1] %= side
    wrapped[:, -1] = np.clip(wrapped[:, -1], 0.0, side * (1 - 1e-12))
    box = [side] * (position.shape[1] - 1) + [2 * side]  # no image across the walls
    pairs = scipy.spatial.cKDTree(wrapped, boxsize=box).query_pairs(2 * radius, output_type="ndarray")
    apart = position[pairs[:, 0]] - position[pairs[:, 1]]
    apart[:, :-1] -= side * np.round(apart[:, :-1] / side)
    overlap = 2 * radius - np.linalg.norm(apart, axis=1)
    height = position[:, -1]
    wall = np.maximum(radius - np.concatenate([height, side - height]), 0.0)
    sums = np.sqrt(radius / 2) * np.sum(overlap**2.5) + np.sqrt(radius) * np.sum(wall**2.5)
    return float(8 / 15 * effective * sums)


# --- single precision -------------------------------------------------------------------------------------

RADIUS, DENSITY, BOX = 0.01, 5650.0, (12.0, 2.0)


def pack(overlap):
    """28 discs in a hexagonal pack whose contacts overlap by 0.3 to 1.7 times `overlap`, in float64."""
    generator = np.random.default_rng(1)
    rows = [
        [0.011 + 0.02 * column + 0.01 * (row % 2), 0.011 + row * 0.02 * np.sqrt(0.75)]
        for row in range(4) for column in range(7)
    ]  # fmt: skip
    position = np.array(rows) * (1 - overlap / 0.02)
    return position + generator.uniform(-0.25, 0.25, position.shape) * overlap


@functools.cache
def compiled(pairs):
    """Contact forces of a pack in float32, one program for all scenes here: they differ in numbers only."""
    static = ContactInterval(ContactModel(HertzMindlin(), None, ()), None, 1, False)
    return jax.jit(lambda arrays: forces(World(static, *arrays))[0])


def loads(scene, position, modulus):
    """Contact forces in float32 at a position that the particles reached from that of the list."""
    high = position.astype(np.float32)
    low = (position - high).astype(np.float32)
    state = scene.state._replace(position=jnp.asarray(high), position_low=jnp.asarray(low))
    moved = scene._replace(constants=constants(jnp.float32, young_modulus=modulus), state=state)
    # The room in a cell plays no part here, and would compile anew for every box.
    moved = moved._replace(neighbors=dataclasses.replace(scene.neighbors, cell_slots=0))
    return np.asarray(compiled(scene.neighbors.room.pairs)(tuple(moved[1:])))


def reference(position, modulus):
    """Hertz forces of all pairs in float64, by numpy."""
    difference = position[:, None] - position[None]
    distance = np.linalg.norm(difference, axis=2)
    np.fill_diagonal(distance, 1.0)
    overlap = np.maximum(2 * float(np.float32(RADIUS)) - distance, 0.0)
    stiffness = 4 / 3 * modulus / (2 * (1 - 0.3**2)) * np.sqrt(RADIUS / 2)
    return np.sum((stiffness * overlap**1.5 / distance)[..., None] * difference, axis=1)


def turned(position, angle):
    """Rotated about the first disc: no overlap changes, and neighbours move past each other by 0.02 angle."""
    c, s = np.cos(angle), np.sin(angle)
    return (position - position[0]) @ np.array([[c, s], [-s, c]]) + position[0]


@functools.cache
def listed(overlap, shift, precise):
    """The pack in float32 with its neighbour list."""
    return world(
        pack(overlap) + np.array([shift, 0.0]), radius=RADIUS, density=DENSITY, box=BOX, walls=False,
        dtype=jnp.float32, precise=precise,
    )  # fmt: skip


def worst(modulus, overlap, shift, angle, precise=True):
    """Largest error of a disc's force over the mean force; the discs have turned by `angle` since the
    list."""
    start, offset = pack(overlap), np.array([shift, 0.0])
    scene = listed(overlap, shift, precise)
    now = turned(start, angle)
    held = (now + offset).astype(np.float32).astype(float) if not precise else now + offset
    truth = reference(now, modulus)
    return np.abs(loads(scene, held, modulus) - truth).max() / np.linalg.norm(truth, axis=1).mean()


@case("forces of a pile in float32", "contact", "Hertz in float64, by numpy")
def single_precision() -> list[Figure]:
    """A pack with the overlap of its own weight, 1.6e-5 m at 70 MPa and 1.6e-7 m at 70 GPa, at x = 0 and shifted by
    10 m, after neighbours have moved by 1e-5 m against each other [1e-4 at 70 MPa].

    At 70 GPa the change of distance is D.(2 r0 + D)/(...), D = 3e-5 m at the far discs, rounded at 2^-24: 2e-12 m or
    1.5e-5 of the overlap, times 1.5 for the force and a few contacts. Just after a build of the list it is less;
    after relative motions of 1e-3 m, half the skin, 3e-3.
    """
    figures = []
    for shift in (0.0, 10.0):
        for name, modulus, overlap, angle, gate in (
            ("70 MPa", 7e7, 1.6e-5, 5e-4, 1e-4),
            ("70 GPa", 7e10, 1.6e-7, 5e-4, 1e-4),
            ("70 GPa, just after a build", 7e10, 1.6e-7, 0.0, 1e-5),
        ):
            error = worst(modulus, overlap, shift, angle)
            figures.append(below(f"{name}, at {shift:g} m, largest error over the mean force", error, gate))
    return figures

"""Cohesion against closed forms: forces of pairs, impacts that stick, a grain that hangs from a plate, liquid.

References are computed here by hand, from the contact radius of JKR as the parameter and by quadrature, and not by the
functions of `jaxdem.particles.cohesion`.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxdem.particles.adhesion import (
    DerjaguinMullerToporov,
    JohnsonKendallRoberts,
    SimplifiedJKR,
    VanDerWaals,
)
from jaxdem.particles.capillary_bridge import CapillaryBridge
from jaxdem.particles.surfaces import Plane
from tests.cases.registry import Figure, absolute, at_least, below, case, relative
from tests.cases.worlds import World, batch, constants, forces, track, world

RADIUS, MODULUS, POISSON, WORK, DENSITY = 1e-3, 1e7, 0.3, 0.1, 2500.0
EFFECTIVE_MODULUS = MODULUS / (2.0 * (1.0 - POISSON**2))
EFFECTIVE_RADIUS = 0.5 * RADIUS
EFFECTIVE_MASS = 0.5 * DENSITY * 4.0 / 3.0 * math.pi * RADIUS**3
JKR_SOURCE = "Johnson, Kendall & Roberts 1971"


def two(gap: float, kind: Any, strength: float, *, radius: float = RADIUS, held: float = 0.0, **given: Any) -> World:
    """Two equal spheres with a gap (negative: an overlap); `held` is what their contact remembers."""
    numbers = {name: given.pop(name) for name in ("minimum_gap", "cutoff", "contact_angle", "liquid_viscosity",
                                                  "bridge_share", "largest_film") if name in given}  # fmt: skip
    material = {"restitution": 1.0, "friction": 0.0, "young_modulus": MODULUS, "poisson_ratio": POISSON}
    material |= given.pop("material", {})
    place = [[-radius - 0.5 * gap, 0.0, 0.0], [radius + 0.5 * gap, 0.0, 0.0]]
    made = world(
        place, radius=radius, density=DENSITY, walls=False, rebuild=False, cohesion=kind,
        material=constants(**material, cohesion={"strength": strength} | numbers), **given,
    )  # fmt: skip
    if kind is None or not kind.memory:
        return made
    springs = made.state.contact_spring
    memory = jnp.zeros_like(springs[-1]).at[0].set(held)
    return made._replace(state=made.state._replace(contact_spring=(*springs[:-1], memory)))


@functools.cache
def _force_of(interval: Any) -> Any:
    def one(arrays: Any) -> Any:
        return forces(World(interval, *arrays))[0][1, 0]

    return jax.jit(jax.vmap(one))


def normal_forces(worlds: list[World]) -> np.ndarray:
    """Force that parts the two spheres of each world, negative where they attract each other [N]."""
    stacked = batch(worlds)
    return np.asarray(_force_of(stacked.interval)(tuple(stacked[1:])))


def jkr_branch(radii: np.ndarray, work: float = WORK) -> tuple[np.ndarray, np.ndarray]:
    """Overlap and force of JKR with the contact radius as the parameter [m, N]."""
    overlap = radii**2 / EFFECTIVE_RADIUS - np.sqrt(2.0 * math.pi * work * radii / EFFECTIVE_MODULUS)
    force = 4.0 * EFFECTIVE_MODULUS * radii**3 / (3.0 * EFFECTIVE_RADIUS)
    return overlap, force - np.sqrt(8.0 * math.pi * work * EFFECTIVE_MODULUS * radii**3)


def jkr_radii() -> dict[str, float]:
    """Contact radii at the largest pull, at the end of the branch, at first touch and at rest [m]."""
    cube = math.pi * WORK * EFFECTIVE_RADIUS**2 / EFFECTIVE_MODULUS
    return {"pull-off": (9.0 * cube / 8.0) ** (1 / 3), "end": (cube / 8.0) ** (1 / 3), "touch": (2.0 * cube) ** (1 / 3),
            "rest": (4.5 * cube) ** (1 / 3)}  # fmt: skip


def work_lost() -> float:
    """Work of the loop of JKR: forms at touch, ends at the end of the neck; by quadrature over the branch [J]."""
    radii = jkr_radii()
    overlap, force = jkr_branch(np.linspace(radii["end"], radii["touch"], 20001))
    return -float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(overlap)))


@case("JKR: pull-off, contact radius and force", "contact", JKR_SOURCE)
def jkr_force() -> list[Figure]:
    """Largest pull, its contact radius, the whole branch, the neck's end, and Hertz without adhesion."""
    named = jkr_radii()
    radii = np.concatenate([np.linspace(1.01 * named["end"], 4.0 * named["rest"], 60), [named["pull-off"]]])
    overlap, force = jkr_branch(radii)
    kind = JohnsonKendallRoberts()
    found = normal_forces([two(-d, kind, WORK, held=1.0) for d in overlap])
    end = float(jkr_branch(np.array([named["end"]]))[0][0])
    beyond, before = normal_forces([two(-(1.0 + s) * end, kind, WORK, held=1.0) for s in (1e-6, -1e-6)])
    apart, touch = normal_forces([two(gap, kind, WORK) for gap in (1e-12, -1e-12)])
    # The contact radius at rest: where the kernel's force vanishes, from the overlap by the roots of the polynomial.
    low, high = float(jkr_branch(np.array([named["pull-off"]]))[0][0]), 5e-6
    for _ in range(3):
        tried = np.linspace(low, high, 61)
        pressed = normal_forces([two(-d, kind, WORK, held=1.0) for d in tried])
        first = int(np.argmax(pressed > 0.0))
        low, high = tried[first - 1], tried[first]
    root = np.roots([1.0 / EFFECTIVE_RADIUS, 0.0, 0.0, -math.sqrt(2.0 * math.pi * WORK / EFFECTIVE_MODULUS), -high])
    resting = max(root[np.abs(root.imag) < 1e-9].real) ** 2
    depths = np.geomspace(1e-9, 1e-5, 61)
    hertz = normal_forces([two(-d, None, 0.0) for d in depths])
    none = normal_forces([two(-d, kind, 0.0) for d in depths])
    little = normal_forces([two(-d, kind, 1e-18) for d in depths])
    off = 1.5 * math.pi * WORK * EFFECTIVE_RADIUS
    return [
        relative("pull-off force", 2.356e-4, -found[-1], 2e-4, "N"),
        relative("pull-off force, closed form", off, -np.min(found), 1e-12, "N"),
        relative("contact radius at rest", 40.07e-6, resting, 1e-4, "m"),
        below("force over the branch, over the pull-off force", np.max(np.abs(found - force)) / off, 1e-10),
        relative("pull at first touch", 8.0 / 9.0 * off, -touch, 1e-5, "N"),
        relative("pull where the neck ends", 5.0 / 9.0 * off, -before, 5e-3, "N"),  # its slope is infinite there
        below("pull beyond the neck", beyond, 0.0, "N"),
        below("pull before touch", apart, 0.0, "N"),
        below("w = 0 against Hertz", np.max(np.abs(none / hertz - 1.0)), 1e-15),
        below("w = 1e-18 against Hertz", np.max(np.abs(little / hertz - 1.0)), 1e-8),
    ]


@case("DMT, van der Waals and SJKR: closed forms", "contact", "Derjaguin et al. 1975, Hamaker 1937, LIGGGHTS's page")
def simple_forces() -> list[Figure]:
    """Pull at rest and over the gap; contact area of two intersecting spheres."""
    dmt, waals = DerjaguinMullerToporov(), VanDerWaals()
    depth = 1e-6
    hertz = 4.0 / 3.0 * EFFECTIVE_MODULUS * math.sqrt(EFFECTIVE_RADIUS) * depth**1.5
    light, pressed = normal_forces([two(-d, dmt, WORK) for d in (1e-12, depth)])
    radius, hamaker = 5e-5, 1e-19
    gaps = np.array([-1e-12, 0.2e-9, 0.4e-9, 1e-9, 3.99e-8, 4.01e-8])
    numbers = {"radius": radius, "minimum_gap": 0.4e-9, "cutoff": 4e-8}
    pull = -normal_forces([two(gap, waals, hamaker, **numbers) for gap in gaps])
    expected = hamaker * 0.5 * radius / (6.0 * np.maximum(gaps, 0.4e-9) ** 2)
    density = 1e5
    found = normal_forces([two(-1e-5, SimplifiedJKR(), density)])[0]
    hertz_deep = 4.0 / 3.0 * EFFECTIVE_MODULUS * math.sqrt(EFFECTIVE_RADIUS) * 1e-5**1.5
    area = math.pi * (RADIUS**2 - (RADIUS - 0.5e-5) ** 2)  # the circle half an overlap below either top
    return [
        relative("DMT pull-off", 3.142e-4, -light, 2e-4, "N"),
        relative("DMT at 1 um", hertz - 2.0 * math.pi * WORK * EFFECTIVE_RADIUS, pressed, 1e-12, "N"),
        relative("van der Waals in contact", 2.60e-6, pull[0], 2e-3, "N"),
        below("van der Waals over the gap", np.max(np.abs(pull[1:-1] / expected[1:-1] - 1.0)), 2e-11),
        below("beyond the cut-off", pull[-1], 0.0, "N"),
        relative("SJKR: Hertz less energy density times area", hertz_deep - density * area, found, 1e-10, "N"),
    ]


@case("liquid bridge: pull and rupture", "contact", "Lian et al. 1993, Willett et al. 2000, Pitois et al. 2000")
def bridge_force() -> list[Figure]:
    """Pull at contact and over the gap, at an angle; viscous part; where it ruptures."""
    kind, tension = CapillaryBridge(), 0.073
    dry = {"contact_angle": 0.0, "bridge_share": 0.05, "largest_film": 1e-11}
    tiny = -normal_forces([two(1e-15, kind, tension, held=1e-18, **dry)])[0]
    volume, angle = 1e-12, 0.3
    wet = dry | {"contact_angle": angle}
    gaps = np.array([1e-9, 1e-5, 5e-5, 1e-4])
    scaled = gaps * math.sqrt(RADIUS / volume)
    expected = 2.0 * math.pi * RADIUS * tension * math.cos(angle) / (1.0 + 1.05 * scaled + 2.5 * scaled**2)
    found = -normal_forces([two(gap, kind, tension, held=volume, **wet) for gap in gaps])
    # At a speed that nothing changes: a viscous pull alone, from two worlds that differ in the speed.
    viscosity, gap, speed = 1e-3, 1e-5, 1e-3
    moving = [
        two(gap, kind, tension, held=volume, minimum_gap=1e-6, liquid_viscosity=viscosity, **wet,
            velocity=[[0.0] * 3, [v, 0.0, 0.0]])
        for v in (0.0, speed)
    ]  # fmt: skip
    still, parting = normal_forces(moving)
    wetted = 1.0 - 1.0 / math.sqrt(1.0 + 2.0 * volume / (math.pi * RADIUS * gap**2))
    squeeze = 1.5 * math.pi * viscosity * RADIUS**2 * wetted**2 / gap * speed
    limit = (1.0 + 0.5 * angle) * volume ** (1 / 3)
    speed, step = 0.02, 1e-4 * limit / 0.02
    apart = two(0.9 * limit, kind, tension, held=volume, liquid=[0.0, 0.0], **wet,
                velocity=[[0.0] * 3, [speed, 0.0, 0.0]], material={"young_modulus": 1e5})  # fmt: skip
    apart = apart._replace(properties=apart.properties._replace(density=jnp.asarray(1e9)))  # the pull does not stop it
    _, seen = track(apart, step, 1500)
    places = seen.position[:, 1, 0] - seen.position[:, 0, 0] - 2.0 * RADIUS
    slow = np.diff(seen.velocity[:, 1, 0] - seen.velocity[:, 0, 0])
    ruptured = places[1:][int(np.argmax(np.abs(slow) == 0.0))]
    return [
        relative("pull at contact, volume -> 0", 4.587e-4, tiny, 2e-4, "N"),
        below("pull over the gap", np.max(np.abs(found / expected - 1.0)), 1e-10),
        relative("viscous pull at 1 mm/s", squeeze, still - parting, 1e-9, "N"),
        relative("gap at rupture", limit, ruptured, 5e-4, "m"),
    ]


def _restitution(kind: Any, strength: float, speeds: np.ndarray, step: float, **numbers: float) -> np.ndarray:
    """Rebound over approach speed of elastic impacts; 0 where they stick."""
    worlds = [two(1e-7, kind, strength, velocity=[[0.5 * v, 0, 0], [-0.5 * v, 0, 0]], **numbers) for v in speeds]
    steps = np.full(len(speeds), step)
    _, seen = track(batch(worlds), steps, 60, 50)
    apart = seen.position[:, -1, 1, 0] - seen.position[:, -1, 0, 0] - 2.0 * RADIUS
    speed = seen.velocity[:, -1, 1, 0] - seen.velocity[:, -1, 0, 0]
    return np.where(apart > 3e-6, speed / speeds, 0.0)


@case("JKR: sticking speed and the energy lost", "contact", "Thornton & Ning 1998; loop by quadrature")
def sticking() -> list[Figure]:
    """Below sqrt(2 W / m*) an elastic impact sticks, above it e = sqrt(1 - (v_s/v)^2); other kinds lose nothing."""
    loop = work_lost()
    sticking_speed = math.sqrt(2.0 * loop / EFFECTIVE_MASS)
    factors = np.array([0.5, 0.95, 0.99, 1.01, 1.05, 1.5, 3.0, 10.0])
    kind, step = JohnsonKendallRoberts(), 4e-6  # a hundredth of an impact
    found = _restitution(kind, WORK, factors * sticking_speed, step)
    expected = np.sqrt(np.maximum(1.0 - factors**-2, 0.0))
    closed = 7.09 * (WORK**5 * EFFECTIVE_RADIUS**4 / EFFECTIVE_MODULUS**2) ** (1 / 3)
    elastic = _restitution(DerjaguinMullerToporov(), WORK, factors[3:] * sticking_speed, step)
    waals = _restitution(VanDerWaals(), 1e-17, np.array([0.01, 0.02]), step, minimum_gap=1e-8, cutoff=1e-6)
    return [
        relative("work of the loop against 7.09 (w^5 R*^4/E*^2)^(1/3)", closed, loop, 2e-3, "J"),
        below("rebound at 0.5, 0.95 and 0.99 of the sticking speed", np.max(found[:3]), 0.0),
        at_least("rebound at 1.01 of it", 0.05, found[3]),
        relative("energy lost at 1.5 of it", loop, _lost(found[5], factors[5] * sticking_speed), 5e-3, "J"),
        relative("energy lost at 3 of it", loop, _lost(found[6], factors[6] * sticking_speed), 0.02, "J"),
        below("restitution from 1.05 of it on", np.max(np.abs(found[4:] - expected[4:])), 0.01),
        below("DMT: restitution against 1", np.max(np.abs(elastic - 1.0)), 2e-3),
        below("van der Waals: restitution against 1", np.max(np.abs(waals - 1.0)), 2e-3),
    ]


def _lost(restitution: float, speed: float) -> float:
    return 0.5 * EFFECTIVE_MASS * speed**2 * (1.0 - restitution**2)


@case("a grain hangs from a plate up to Bond number 1", "contact", "pull-off force = weight, by bisection")
def bond_number() -> list[Figure]:
    """Largest weight that a wall holds, over the pull-off force: 16 weights at once, twice."""
    found = []
    for kind, strength, off in (
        (JohnsonKendallRoberts(), WORK, 1.5 * math.pi * WORK * RADIUS),
        (DerjaguinMullerToporov(), WORK, 2.0 * math.pi * WORK * RADIUS),
    ):
        low, high = 0.51, 2.03
        for _ in range(2):
            tried = np.linspace(low, high, 16)
            held = _hangs(kind, strength, off, tried)
            first = int(np.argmin(held))
            low, high = tried[first - 1], tried[first]
        found.append(relative(f"{type(kind).__name__}: weight over pull-off", 1.0, 0.5 * (low + high), 0.01))
    return found


def _hangs(kind: Any, strength: float, off: float, factors: np.ndarray) -> np.ndarray:
    """Whether a sphere under a plate is still there, for weights of so many times the pull-off force.

    It starts at the overlap of the largest pull, from where it is drawn in or falls.
    """
    modulus, mass = 2.0 * EFFECTIVE_MODULUS, 2.0 * EFFECTIVE_MASS  # of the wall's pair: rigid, and the grain's own
    cube = 9.0 * math.pi * WORK * RADIUS**2 / (8.0 * modulus)
    radius = cube ** (1 / 3)
    depth = radius**2 / RADIUS - math.sqrt(2.0 * math.pi * WORK * radius / modulus) if kind.memory else 1e-7
    worlds = []
    for factor in factors:
        material = constants(
            restitution=0.1, young_modulus=MODULUS, poisson_ratio=POISSON, wall_young_modulus=np.inf,
            cohesion={"strength": strength},
        )  # fmt: skip
        made = world(
            [[0.0, 0.0, -RADIUS + depth]], radius=RADIUS, density=DENSITY, walls=False, rebuild=False,
            material=material, surfaces=(Plane((0.0, 0.0, 0.0), (0.0, 0.0, -1.0)),), cohesion=kind,
            gravity=[0.0, 0.0, -factor * off / mass],
        )  # fmt: skip
        springs = made.state.wall_spring
        if kind.memory:
            springs = (*springs[:-1], jnp.ones_like(springs[-1]))
        worlds.append(made._replace(state=made.state._replace(wall_spring=springs)))
    _, seen = track(batch(worlds), np.full(len(factors), 1e-5), 20, 50)
    return seen.position[:, -1, 0, 2] > -1.05 * RADIUS


@case("JKR: Coulomb's limit mu |F + 2 F_pulloff|", "contact", "Thornton 1991")
def coulomb() -> list[Figure]:
    """A sphere that is held at an overlap and slides: the tangential force without load, and with one."""
    friction, off = 0.3, 1.5 * math.pi * WORK * EFFECTIVE_RADIUS
    resting = jkr_branch(np.array([jkr_radii()["rest"]]))[0][0]
    figures = []
    for name, kind, depth, pull in (
        ("JKR at rest", JohnsonKendallRoberts(), resting, off),
        ("JKR pressed", JohnsonKendallRoberts(), 3.0 * resting, off),
        ("DMT pressed", DerjaguinMullerToporov(), 3.0 * resting, 2.0 * math.pi * WORK * EFFECTIVE_RADIUS),
    ):
        # A tangential spring far beyond the limit is cut to it.
        made = two(-depth, kind, WORK, held=1.0, material={"friction": friction})
        springs = list(made.state.contact_spring)
        springs[1] = springs[1].at[0].set(1e-3)
        made = made._replace(state=made.state._replace(contact_spring=tuple(springs)))
        force = np.asarray(jax.jit(lambda scene=made: forces(scene)[0])())[1]
        limit = friction * (force[0] + 2.0 * pull)
        figures.append(relative(name, limit, math.hypot(force[1], force[2]), 1e-10, "N"))
        if name == "JKR at rest":
            figures.append(below("its normal force over the pull-off", abs(force[0]) / off, 1e-10))
    return figures


@case("liquid is shared and kept", "contact", "sum of films and bridges")
def liquid_kept() -> list[Figure]:
    """A wet sphere hits a dry one, and a cloud of wet and dry ones in a box: the liquid is shared, none is lost."""
    kind, share, film = CapillaryBridge(), 0.1, 1e-12
    numbers = {"contact_angle": 0.0, "bridge_share": share, "largest_film": film}
    hit = two(1e-6, kind, 1e-4, velocity=[[0.1, 0, 0], [-0.1, 0, 0]], liquid=[film, 0.0], **numbers)
    after, _ = track(hit, 5e-6, 10, 60)
    films = np.asarray(after.state.liquid)
    random = np.random.default_rng(0)
    grid = 2.5 * RADIUS * (0.5 + np.stack(np.meshgrid(*[np.arange(3)] * 3), -1).reshape(-1, 3))
    first = np.where(np.arange(27) % 2 == 0, film, 0.0)
    crowd = world(
        grid, random.normal(0.0, 0.2, grid.shape), radius=RADIUS, density=DENSITY, box=(7.5 * RADIUS,) * 3,
        rebuild=False, cohesion=kind, liquid=first,
        material=constants(restitution=0.9, young_modulus=MODULUS, cohesion={"strength": 0.01} | numbers),
    )  # fmt: skip
    crowd, _ = track(crowd, 1e-5, 10, 200)
    state = crowd.state
    now = float(jnp.sum(state.liquid) + jnp.sum(state.contact_spring[-1]) + jnp.sum(state.wall_spring[-1]))
    return [
        relative("film of the wet sphere after an impact", (1.0 - 0.5 * share) * film, films[0], 1e-12, "m3"),
        relative("film of the dry one", 0.5 * share * film, films[1], 1e-12, "m3"),
        relative("all liquid of 27 spheres, 2000 steps", float(np.sum(first)), now, 1e-12, "m3"),
        at_least("spheres that were dry and are wet", 5, int(np.sum(np.asarray(state.liquid)[1::2] > 0.0))),
        absolute("films below zero", 0, int(np.sum(np.asarray(state.liquid) < 0.0)), 0),
    ]


@case("cohesive spheres: momentum and energy", "contact", "third law; kinetic and potential energy of JKR")
def balances() -> list[Figure]:
    """Four JKR spheres that hold each other keep their momentum, an elastic pair its energy while it holds."""
    d, height = 2.0 * RADIUS, math.sqrt(0.75)
    place = d * np.array([[0, 0, 0], [1, 0, 0], [0.5, height, 0], [0.5, height / 3, math.sqrt(2 / 3)]])
    random = np.random.default_rng(1)
    velocity, spin = random.normal(0.0, 2e-3, place.shape), random.normal(0.0, 1.0, place.shape)
    kind = JohnsonKendallRoberts()
    cluster = world(
        place, velocity, spin, radius=RADIUS, density=DENSITY, walls=False, rebuild=False, cohesion=kind,
        material=constants(restitution=1.0, friction=0.3, young_modulus=MODULUS, cohesion={"strength": WORK}),
    )  # fmt: skip
    after, seen = track(cluster, 5e-6, 10, 100)
    mass, inertia = 2.0 * EFFECTIVE_MASS, 0.4 * 2.0 * EFFECTIVE_MASS * RADIUS**2

    def angular(x: np.ndarray, v: np.ndarray, w: np.ndarray) -> np.ndarray:
        return np.sum(mass * np.cross(x, v) + inertia * w, axis=0)

    linear = mass * (np.sum(seen.velocity[-1], 0) - np.sum(velocity, 0))
    turned = angular(seen.position[-1], seen.velocity[-1], seen.spin[-1]) - angular(place, velocity, spin)
    turning = np.linalg.norm(angular(place, velocity, spin))
    pair = two(-1e-9, kind, WORK, held=1.0)
    _, seen = track(pair, 1e-6, 400, 5)
    distance = seen.position[:, 1, 0] - seen.position[:, 0, 0]
    kinetic = 0.5 * EFFECTIVE_MASS * (seen.velocity[:, 1, 0] - seen.velocity[:, 0, 0]) ** 2
    radii = np.linspace(jkr_radii()["end"], 3.0 * jkr_radii()["rest"], 40001)
    overlap, force = jkr_branch(radii)
    potential = np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(overlap))])
    total = kinetic + np.interp(2.0 * RADIUS - distance, overlap, potential)
    return [
        below("change of momentum over m v", np.max(np.abs(linear)) / (mass * 2e-3), 1e-12),
        below("change of angular momentum, relative", np.max(np.abs(turned)) / turning, 1e-3),
        at_least("spheres that still touch the first", 3, int(np.sum(np.asarray(after.state.contact_spring[-1])[:3]))),
        below("energy of an elastic pair, relative", np.ptp(total) / np.max(kinetic), 5e-3),
    ]

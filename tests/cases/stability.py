"""Time-step limits found by trial, beside those that jaxdem predicts: contacts, fluid, drag.

A trial runs 16 steps at once, evenly spaced in their logarithm, and a second time between the largest stable and the
smallest unstable one: a bisection by sixteenths, to 1.5 %.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import jaxdem
from jaxdem.fluid.interval import VISCOUS_LIMIT, VISCOUS_STABLE
from jaxdem.particles.clump_forces import clump_forces
from jaxdem.particles.contact_step import ContactStep
from jaxdem.particles.forces import contact_forces
from jaxdem.particles.integrate import Motion, kinetic_energy
from jaxdem.particles.loop import contact_interval
from jaxdem.particles.materials import surroundings
from jaxdem.particles.union import union_of
from jaxdem.setup import stability
from jaxdem.setup.contact_bodies import contact_bodies
from jaxdem.setup.contact_stability import contact_stability
from jaxdem.setup.contact_step import ATTRACTION
from jaxdem.setup.fluid_step import AUTO_COURANT
from jaxdem.setup.particles import particle_setup
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State
from tests.cases.steps import time_steps

WIDTH = 16
"""Steps tried at once."""


@dataclasses.dataclass(frozen=True)
class Limit:
    """A row: what was predicted, what is true; nan or inf where there is no such step.

    Attributes:
        group: contact, impact, bonds, fluid or drag.
        name: what is tried.
        predicted: largest step that jaxdem calls stable [s].
        found: largest step that is [s].
        default: automatic step, chosen for accuracy [s].
        note: what happens beyond, or what the row is about.
    """

    group: str
    name: str
    predicted: float
    found: float
    default: float
    note: str = ""

    @property
    def ratio(self) -> float:
        """predicted / found, safe and tight in [0.5, 1]."""
        return self.predicted / self.found


def largest_stable(stable: Callable[[Array], Array], guess: float, low: float, high: float) -> float:
    """Largest step below which all are stable, within guess x low ... guess x high [s].

    Args:
        stable: steps (B,) [s] -> (B,) bool.
        guess: [s].
        low, high: factors; the result is NaN if the smallest is not stable, infinite if the largest is.
    """
    steps = guess * np.geomspace(low, high, WIDTH)
    for start in (low, None):
        good = np.asarray(stable(jnp.asarray(steps)))
        first = len(good) if good.all() else int(np.argmin(good))
        if start is not None and first == 0:
            return math.nan
        if start is not None and first == len(good):
            return math.inf
        found = float(steps[max(first - 1, 0)])
        if start is not None:
            # The lower end is known to be stable; the upper one, known not to be, is left out.
            steps = np.geomspace(steps[first - 1], steps[first], WIDTH + 1)[:-1]
    return found


# --- contacts ---------------------------------------------------------------------------------------------

RADIUS, DENSITY = 0.01, 2500.0
DEPTH = 1e-7
"""Overlap of all contacts over the diameter. So small, because a constant force lets a pair that it presses together
slip aside, as it would let a real one: at a rate of sqrt(overlap/radius) times that of the contact."""

TRIAL_STEPS = 1000
"""Contact steps of a trial: over 300 periods of the fastest motion at its limit, in which a step 1 % too long
multiplies a perturbation by more than 1e20 (without damping)."""

GROWTH = 100.0
"""A perturbation's energy may grow by this. Just under the limit a leapfrog shows up to 1/(1 - (w dt/2)^2) times the
energy that there is, and no more however long it runs: 100 times within 0.5 % of the limit. Above the limit a growth
may end where contacts pull, for then they have no friction: at 150 times or more."""

MATERIALS = {
    "e = 1, mu = 0": (1.0, 0.0),
    "e = 1, mu = 10": (1.0, 10.0),
    "e = 0.5, mu = 10": (0.5, 10.0),
    "e = 0, mu = 0": (0.0, 0.0),
    "e = 0, mu = 10": (0.0, 10.0),
}


def _hexagonal(columns: int, rows: int, spacing: float) -> np.ndarray:
    """(N, 2) centres of a hexagonal layer from (0, 0)."""
    row, column = np.divmod(np.arange(columns * rows), columns)
    return np.stack((spacing * (column + 0.5 * (row % 2)), spacing * row * math.sqrt(0.75)), axis=1)


def _cluster_at_a_large_one(ratio: float) -> dict[str, Any]:
    """Tables of a hexagon of 37 small particles in closest packing, one of which touches a large one."""
    r, small = RADIUS, ratio * RADIUS
    small_gap, mixed_gap = (1.0 - DEPTH) * 2.0 * small, r + small - DEPTH * 2.0 * small
    corners = [(i, j) for i in range(-3, 4) for j in range(-3, 4) if abs(i + j) <= 3]
    cluster = 4.0 * r + small_gap * np.array([(i + 0.5 * j, j * math.sqrt(0.75)) for i, j in corners])
    return {
        "size": [10.0 * r, 10.0 * r],
        "radius": [*[small] * len(cluster), r],
        "position": [*cluster.tolist(), [4.0 * r + 3.0 * small_gap + mixed_gap, 4.0 * r]],
    }


def arrangements() -> dict[str, dict[str, Any]]:
    """Tables [domain], [particles], [boundary] of particles pressed together by `DEPTH` diameters everywhere."""
    r, d = RADIUS, 2.0 * RADIUS
    gap = (1.0 - DEPTH) * d  # distance of two centres
    near = r - DEPTH * d  # of a centre from a wall
    periodic = {"kind": "periodic"}
    cube = math.sqrt(2.0) * gap
    fcc = cube * (
        np.stack([a.ravel() for a in np.meshgrid(*[np.arange(3)] * 3, indexing="ij")], 1)[:, None]
        + 0.25
        + np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])[None]
    ).reshape(-1, 3)
    layer = _hexagonal(4, 4, gap) + [0.25 * gap, 0.25 * gap]
    sheet = [4.0 * gap, 4.0 * math.sqrt(0.75) * gap]
    x_periodic = {"left": periodic, "right": periodic}
    plane = x_periodic | {"bottom": periodic, "top": periodic}
    space = plane | {"front": periodic, "back": periodic}
    between = _hexagonal(4, 4, gap) + [0.25 * gap, near]
    standing = np.insert(layer, 1, near, axis=1)
    return {
        "pair": {
            "size": [5 * d, 5 * d],
            "position": [[2 * d, 2 * d], [2 * d + gap, 2 * d]],
            "boundary": plane,
        },
        "on a wall": {"size": [5 * d, 5 * d], "position": [[2 * d, near]], "boundary": x_periodic},
        "in a corner": {"size": [5 * d, 5 * d], "position": [[near, near]]},
        "in a corner, 3-D": {"size": [5 * d] * 3, "position": [[near] * 3]},
        "between two walls": {
            "size": [5 * d, 2.0 * near],
            "position": [[2 * d, near]],
            "boundary": x_periodic,
        },
        "size ratio 10": _cluster_at_a_large_one(0.1) | {"boundary": plane},
        "size ratio 50": _cluster_at_a_large_one(0.02) | {"boundary": plane},
        "hexagonal pack": {"size": sheet, "position": layer.tolist(), "boundary": plane},
        "pack between walls": {
            "size": [4.0 * gap, 2.0 * near + 3.0 * math.sqrt(0.75) * gap],
            "position": between.tolist(),
            "boundary": x_periodic,
        },
        "layer between walls, 3-D": {
            "size": [sheet[0], 2.0 * near, sheet[1]],
            "position": standing.tolist(),
            "boundary": plane,
        },
        "close pack, 3-D": {"size": [3.0 * cube] * 3, "position": fcc.tolist(), "boundary": space},
    }


def oblique_walls() -> dict[str, dict[str, Any]]:
    """The same of a grain that touches walls which are not at right angles."""
    r, d = RADIUS, 2.0 * RADIUS
    near, low = r - DEPTH * d, [2.5 * d, d]

    def between(angle: float) -> dict[str, Any]:
        half = math.radians(0.5 * angle)
        wedge = {"kind": "wedge", "apex": low, "directions": [[s * math.sin(half), math.cos(half)] for s in (-1, 1)]}
        return {"size": [5 * d] * 2, "position": [[low[0], low[1] + near / math.sin(half)]], "walls": [wedge]}

    slope = math.radians(15.0)
    ways = [(1, 0), (-1, 0), (0, 1), (0, -1)]
    planes = [
        {"kind": "plane", "point": [low[0], *low], "normal": [*(math.sin(slope) * x for x in way), math.cos(slope)]}
        for way in ways
    ]
    ramp = {"kind": "plane", "point": [0.0, d], "normal": [-math.sin(slope), math.cos(slope)]}
    mesh = {"kind": "mesh", "points": [[-d, d - d * math.tan(slope)], [5 * d, d + 5 * d * math.tan(slope)]]}
    height = d + (near + near * math.sin(slope)) / math.cos(slope)
    at_side = {"size": [5 * d] * 2, "position": [[near, height]]}
    return {
        "in a wedge of 150 degrees": between(150.0),
        "in a wedge of 40 degrees": between(40.0),
        "in a pit of four planes, 3-D": {
            "size": [5 * d] * 3, "walls": planes, "position": [[low[0], low[0], d + near / math.cos(slope)]],
        },
        "on a ramp, at a side": at_side | {"walls": [ramp]},
        "on a mesh, at a side": at_side | {"walls": [mesh]},
    }  # fmt: skip


ROD = {"name": "rod", "centres": [[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]], "radii": [1.0, 1.0, 1.0]}
"""Three discs in a row, each of `RADIUS`."""


def rods() -> dict[str, dict[str, Any]]:
    """The same of rods."""
    r, d = RADIUS, 2.0 * RADIUS
    gap, near = (1.0 - DEPTH) * d, r - DEPTH * d
    periodic = {"kind": "periodic"}
    x_periodic = {"left": periodic, "right": periodic}
    union = union_of(tuple((x, 0.0, z) for x, z in ROD["centres"]), (1.0,) * 3)  # type: ignore[attr-defined]
    shape = {"size": [12 * r, 12 * r], "radius": union.radius * r, "shape": "rod", "shapes": [ROD]}
    plane = x_periodic | {"bottom": periodic, "top": periodic}
    return {
        "two rods, end on end": shape | {
            "position": [[4 * r, 4 * r], [5 * r, 4 * r + gap + r]], "orientation": [0.0, 0.5 * math.pi],
            "boundary": plane,
        },
        "two rods, side by side": shape | {
            "position": [[4 * r, 4 * r], [4 * r, 4 * r + gap]], "orientation": [0.0, 0.0], "boundary": plane,
        },
        "two rods, each member between two": shape | {
            "position": [[4 * r, 4 * r], [4.5 * r, 4 * r + math.sqrt(gap**2 - 0.25 * r**2)]], "orientation": [0.0, 0.0],
            "boundary": plane,
        },
        "a rod that lies on a wall": shape | {
            "position": [[4 * r, near]], "orientation": [0.0], "boundary": x_periodic,
        },
    }  # fmt: skip


HARD = {"materials": [{"name": "soft"}, {"name": "hard", "young_modulus": 2.1e10}]}
"""Grains of the modulus of the others, and some 300 times as stiff."""


def hard_ones() -> dict[str, dict[str, Any]]:
    """One hard grain among soft ones, as large as they are and five times as large; and as many hard ones as soft."""
    pack, ball = arrangements()["hexagonal pack"], _cluster_at_a_large_one(0.2)
    names = ["soft", "hard"]
    return {
        "pack with one hard grain": pack | {"material": [names[k == 5] for k in range(16)]} | HARD,
        "pack of soft and hard grains": pack | {"material": [names[k % 2] for k in range(16)]} | HARD,
        "hard ball, size ratio 5": ball | {"boundary": arrangements()["size ratio 10"]["boundary"]}
        | {"material": ["soft"] * 37 + ["hard"]} | HARD,
    }  # fmt: skip


def pressed_scene(arrangement: dict[str, Any], restitution: float, friction: float, **contact: Any) -> Any:
    """A scene of an arrangement whose expected impact overlaps by `DEPTH` (of the smallest particle's diameter)."""
    given = dict(arrangement)
    size, boundary, materials = given.pop("size"), given.pop("boundary", {}), given.pop("materials", [])
    walls = given.pop("walls", [])
    smallest = RADIUS if "shape" in given else float(np.min(given.get("radius", RADIUS)))
    contact = {"young_modulus": 7e7, "poisson_ratio": 0.3, "maximum_overlap": 0.5, "skin": 0.05} | contact
    modulus = 0.5 * contact["young_modulus"] / (1.0 - contact["poisson_ratio"] ** 2)
    mass = 2.0 / 3.0 * math.pi * smallest**3 * DENSITY
    depth = DEPTH * 2.0 * smallest
    speed = math.sqrt(16.0 * modulus * math.sqrt(0.5 * smallest) * depth**2.5 / (15.0 * mass))
    if contact.get("law") == "linear_spring_dashpot":
        speed = depth * math.sqrt(contact["normal_stiffness"] / mass)
    return jaxdem.load_scene(
        {
            "precision": "float64",
            "domain": {"size": size, "gravity": [0.0] * len(size)},
            "particles": {"radius": RADIUS, "density": DENSITY} | given,
            "contact": {"restitution": restitution, "friction": friction, "speed": speed} | contact,
            "boundary": boundary,
            "materials": materials,
            "walls": walls,
            "time": {"end": 1.0, "output_interval": 1.0},
        }
    )


@functools.cache
def _growth(key: str, simulation: Simulation) -> Callable[..., Array]:
    """Compiled: energy of a perturbation after `TRIAL_STEPS` over that at the start, for steps (B,)."""
    assert simulation.contact is not None
    interval = dataclasses.replace(simulation.contact, search=None, steps=TRIAL_STEPS)

    def one(time_step: Array, parameters: Parameters, state: State, neighbors: Any) -> Array:
        particles = state.particles
        around = surroundings(parameters.contact, simulation.wall_velocity(parameters, jnp.zeros(())))
        args = (around, parameters.bodies)
        rest = Motion.of(
            particles._replace(
                velocity=jnp.zeros_like(particles.velocity),
                angular_velocity=jnp.zeros_like(particles.angular_velocity),
            )
        )
        forces_of = contact_forces if parameters.bodies.clumps is None else clump_forces
        if rest.liquid is not None:  # the bridges of contacts act from the step after this one
            _, rest = forces_of(ContactStep(interval.model, *args, rest, rest.velocity, jnp.zeros(())), neighbors)
            particles = particles._replace(contact_spring=rest.contact_spring, liquid=rest.liquid)
        sums, _ = forces_of(ContactStep(interval.model, *args, rest, rest.velocity, jnp.zeros(())), neighbors)
        # A constant force on every particle, and on a clump a torque, holds the arrangement: what is tried is whether
        # it rests stably.
        holding = -jnp.stack(sums.force, axis=1)
        turning = None if parameters.bodies.clumps is None else -jnp.stack(sums.torque, axis=1)
        start = particles._replace(contact_force=-holding)
        end, _, _ = contact_interval(interval, *args, start, neighbors, holding, time_step, turning)
        return kinetic_energy(end, parameters.bodies) / kinetic_energy(start, parameters.bodies)

    return jax.jit(jax.vmap(one, in_axes=(0, None, None, None)))


_simulations: dict[str, Simulation] = {}


def contact_limit(name: str, material: str, **contact: Any) -> Limit:
    """The row of an arrangement and a material."""
    scene = pressed_scene(
        (arrangements() | oblique_walls() | rods() | hard_ones())[name], *MATERIALS[material], **contact
    )
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    key = f"{name} {contact.get('law')} {contact.get('cohesion', {}).get('kind')}"
    simulation = _simulations.setdefault(key, simulation)  # one program for all materials
    depth = DEPTH * 2.0 * (RADIUS if scene.particles.has_clumps else float(np.min(scene.particles.radius)))
    grains = particle_setup(scene)
    predicted = contact_stability(grains, contact_bodies(grains), 0.0, depth)
    shape = state.particles.velocity.shape
    # So slow that no contact opens or slides before the growth is plain.
    noise = np.random.default_rng(0).normal(0.0, 1e-4 * depth / predicted, shape)
    turning = state.particles.angular_velocity
    spin = np.random.default_rng(1).normal(0.0, 1e-4 * depth / predicted / RADIUS, turning.shape)
    particles = state.particles._replace(velocity=jnp.asarray(noise), angular_velocity=jnp.asarray(spin))
    run = _growth(key, simulation)

    def stable(steps: Array) -> Array:
        return run(steps, parameters, state._replace(particles=particles), neighbors) < GROWTH

    found = largest_stable(stable, predicted, 0.5, 8.0)
    told = [f"{k} = {v:.3g}" for k, v in contact.items() if k not in ("law", "cohesion")]
    label = ", ".join([name, material, *told])
    if "cohesion" in contact:
        label += f", held by {contact['cohesion']['kind']}"
    if "law" in contact:
        label += ", linear law"
    return Limit("contact", label, predicted, found, time_steps(scene).limits["contact_automatic"])


HELD = {
    "jkr": {"kind": "jkr", "work_of_adhesion": 1.8e-5},
    "dmt": {"kind": "dmt", "work_of_adhesion": 6e-7},
    "sjkr": {"kind": "sjkr", "energy_density": 5.2e3},
    "capillary": {"kind": "capillary", "surface_tension": 3e-7, "contact_angle": 0.0, "liquid_content": 0.01},
}
"""Cohesion by which two particles rest at about the overlap of `DEPTH`, without another force."""

HELD_OF_SIZES = {
    "jkr": HELD["jkr"] | {"work_of_adhesion": 1.8e-6},
    "capillary": HELD["capillary"] | {"surface_tension": 3e-8, "liquid_content": 2e-4, "bridge_share": 0.02},
}
"""The same for the smallest radius of a size ratio of 10; bridges there reach less than half of that radius."""


# --- bonds ------------------------------------------------------------------------------------------------

BONDED = {
    "pair": [[0, 0]],
    "chain of 8": [[k, 0] for k in range(7)],
    "square lattice of 5 x 5": [[k, j] for j in range(5) for k in range(5)],
}
"""Places of bonded grains in spacings; the pair has one more beside."""


def bond_limit_of(name: str, shear: float, damping: float) -> Limit:
    """Grains that bonds alone hold, a hundredth of a diameter apart, perturbed a little.

    The prediction is that of the bonds by themselves: contacts, which the step of a run counts too, are not there.
    """
    places = np.asarray([*BONDED[name], [1, 0]] if name == "pair" else BONDED[name], float)
    spacing, stiffness = 2.02 * RADIUS, 1e10
    position = (places + 3.0) * spacing
    bond = {"gap": 0.05 * RADIUS, "normal_stiffness": stiffness, "shear_stiffness": shear * stiffness}
    scene = jaxdem.load_scene(
        {
            "precision": "float64",
            "domain": {"size": [12.0 * spacing] * 2, "gravity": [0.0, 0.0]},
            "particles": {"radius": RADIUS, "density": DENSITY, "position": position.tolist()},
            "contact": {"speed": 1e-3},
            "bonds": [bond | {"damping": damping}],
            "time": {"end": 1.0, "output_interval": 1.0},
        }
    )
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    limits = time_steps(scene).limits
    interval = dataclasses.replace(simulation.contact, search=None, steps=TRIAL_STEPS)
    still = (jnp.zeros(2),) * len(interval.model.sides)
    around = surroundings(parameters.contact, still)._replace(bonds=parameters.bonds)
    noise, force = np.random.default_rng(0), jnp.zeros_like(state.particles.velocity)
    velocity, spin = (
        jnp.asarray(noise.normal(0.0, 1e-9, x.shape))
        for x in (state.particles.velocity, state.particles.angular_velocity)
    )
    start = state.particles._replace(velocity=velocity, angular_velocity=spin / RADIUS)

    def growth(step: Array) -> Array:
        end, _, _ = contact_interval(interval, around, parameters.bodies, start, neighbors, force, step)
        return kinetic_energy(end, parameters.bodies) / kinetic_energy(start, parameters.bodies)

    run = jax.jit(jax.vmap(growth))
    found = largest_stable(lambda steps: run(steps) < GROWTH, limits["bond_stability"], 0.5, 8.0)
    label = f"bonded {name}, k_s = {shear:g} k_n" + (f", damping {damping:g}" if damping else "")
    return Limit("bonds", label, limits["bond_stability"], found, limits["contact_automatic"])


# --- impacts ----------------------------------------------------------------------------------------------

IMPACTS = 200
GAIN = 1.1


def impact_limit(speed: float, young_modulus: float) -> Limit:
    """Elastic ball between two walls: no impact of 200, in eight phases, may leave 10 % more energy."""
    d = 2.0 * RADIUS
    scene = jaxdem.load_scene(
        {
            "precision": "float64",
            "domain": {"size": [2 * d, 2 * d], "gravity": [0.0, 0.0]},
            "particles": {"radius": RADIUS, "density": DENSITY, "position": [[d, d]]},
            "contact": {
                "young_modulus": young_modulus,
                "restitution": 1.0,
                "friction": 0.0,
                "speed": speed,
                "maximum_overlap": 0.5,
            },
            "time": {"end": 1.0, "output_interval": 1.0},
        }
    )
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    interval = dataclasses.replace(simulation.contact, search=None, steps=20)
    predicted = time_steps(scene).limits["contact_stability"]

    def largest_energy(time_step: Array, phase: Array, count: int) -> Array:
        particles = state.particles._replace(
            position=state.particles.position + jnp.stack((phase * 0.5 * d, phase * 0.0))[None],
            velocity=jnp.asarray([[speed, 0.0]]),
        )
        start = kinetic_energy(particles, parameters.bodies)
        around = surroundings(parameters.contact, simulation.wall_velocity(parameters, jnp.zeros(())))

        def some(_: Array, carry: Any) -> Any:
            particles, worst = carry
            particles, _, _ = contact_interval(
                interval,
                around,
                parameters.bodies,
                particles,
                neighbors,
                jnp.zeros_like(particles.velocity),
                time_step,
            )
            energy = kinetic_energy(particles, parameters.bodies) / start
            return particles, jnp.maximum(worst, jnp.where(jnp.isfinite(energy), energy, jnp.inf))

        return jax.lax.fori_loop(0, count, some, (particles, jnp.ones(())))[1]

    travel = d / speed
    phases = jnp.linspace(0.0, 0.9, 8)

    @functools.partial(jax.jit, static_argnums=1)
    def run(steps: Array, count: int) -> Array:
        each = jax.vmap(jax.vmap(functools.partial(largest_energy, count=count), (None, 0)), (0, None))
        return jnp.max(each(steps, phases), axis=1) <= GAIN

    count = math.ceil(IMPACTS * travel / (0.02 * predicted * interval.steps))
    found = largest_stable(lambda steps: run(steps, count), predicted, 0.02, 2.0)
    label = f"ball between walls, {speed:g} m/s, E = {young_modulus:.0e}"
    default = time_steps(scene).limits["contact_automatic"]
    return Limit("impact", label, predicted, found, default, "energy kept within 10 %: accuracy, not stability")


def attraction_limit() -> Limit:
    """Two elastic spheres that meet slowly and attract each other: the rebound may differ by 10 % in energy.

    Five phases of the step; the speed is twice that which the attraction gives.
    """
    cohesion = {"kind": "van_der_waals", "hamaker_constant": 1e-15, "minimum_gap": 1e-7, "cutoff": 1e-5}
    speed, gap = 2e-3, 1.2e-5
    scene = jaxdem.load_scene(
        {
            "precision": "float64",
            "domain": {"size": [0.01, 0.01], "gravity": [0.0, 0.0]},
            "particles": {"radius": 1e-3, "density": DENSITY, "position": [[0.003, 0.005], [0.005 + gap, 0.005]]},
            "contact": {
                "young_modulus": 1e7,
                "restitution": 1.0,
                "friction": 0.0,
                "speed": speed,
                "cohesion": cohesion,
            },
            "time": {"end": 1.0, "output_interval": 1.0},
        }
    )
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    limits = time_steps(scene).limits
    predicted = ATTRACTION * limits["contact_attraction"]
    interval = dataclasses.replace(simulation.contact, search=None, steps=2000)
    around = surroundings(parameters.contact, ())._replace(
        wall_velocity=simulation.wall_velocity(parameters, jnp.zeros(()))
    )

    def rebound(time_step: Array, phase: Array) -> Array:
        shift = phase * speed * time_step
        particles = state.particles._replace(
            position=state.particles.position.at[1, 0].add(shift), velocity=jnp.asarray([[speed, 0.0], [0.0, 0.0]])
        )
        force = jnp.zeros_like(particles.velocity)
        for _ in range(3):
            particles, _, _ = contact_interval(
                interval, around, parameters.bodies, particles, neighbors, force, time_step
            )
        return ((particles.velocity[1, 0] - particles.velocity[0, 0]) / speed) ** 2

    @jax.jit
    def stable(steps: Array) -> Array:
        each = jax.vmap(jax.vmap(rebound, (None, 0)), (0, None))(steps, jnp.linspace(0.0, 0.8, 5))
        return jnp.all(jnp.abs(each - 1.0) < 0.1, axis=1)

    found = largest_stable(stable, predicted, 0.1, 20.0)
    name = "spheres that van der Waals attracts"
    return Limit(
        "impact",
        name,
        predicted,
        found,
        limits["contact_automatic"],
        "energy kept within 10 %: accuracy, not stability",
    )


# --- fluid ------------------------------------------------------------------------------------------------

FLUID_STEPS = 400


def fluid_limit(name: str, stream: tuple[float, float], viscosity: float, advection: str) -> Limit:
    """Stirred stream in a periodic box: the energy of its eddies may grow by a tenth, and no more, in 400 steps."""
    scene = jaxdem.load_scene(
        {
            "precision": "float64",
            "domain": {"size": [1.0, 1.0], "gravity": [0.0, 0.0]},
            "fluid": {
                "cells": [16, 16],
                "viscosity": viscosity,
                "velocity": list(stream),
                "advection": advection,
                "time_step": 1e-6,
            },
            "boundary": {side: {"kind": "periodic"} for side in ("left", "right", "bottom", "top")},
            "time": {"end": 1.0, "output_interval": 1.0},
        }
    )
    simulation, parameters = jaxdem.build(scene)
    state = jaxdem.initial_state(scene, simulation, parameters)[0].fluid
    solver, noise = simulation.fluid.solver, np.random.default_rng(0)
    faces = []
    for axis, u in enumerate(state.face_velocity):
        shaken = np.array(u + noise.normal(0.0, 0.05, u.shape))
        np.moveaxis(shaken, axis, 0)[-1] = np.moveaxis(shaken, axis, 0)[0]
        faces.append(jnp.asarray(shaken))
    # A tiny step only makes the noise free of divergence.
    state = solver.step(
        parameters.fluid, state._replace(face_velocity=tuple(faces)), jnp.zeros(()), jnp.asarray(1e-9)
    ).state
    state = state._replace(pressure=jnp.zeros_like(state.pressure))

    def eddies(state: Any) -> Array:
        return sum(jnp.sum((u - jnp.mean(u)) ** 2) for u in state.face_velocity)

    @jax.jit
    @jax.vmap
    def stable(step: Array) -> Array:
        def one(_: Array, carry: Any) -> Any:
            state, worst = carry
            state = solver.step(parameters.fluid, state, jnp.zeros(()), step).state
            energy = eddies(state)
            return state, jnp.maximum(worst, jnp.where(jnp.isfinite(energy), energy, jnp.inf))

        return jax.lax.fori_loop(0, FLUID_STEPS, one, (state, eddies(state)))[1] < 1.1 * eddies(state)

    spacing = solver.grid.spacing
    rate = sum(float(jnp.max(jnp.abs(u))) / h for u, h in zip(state.face_velocity, spacing, strict=True))
    courant = scene.fluid.courant_limit / rate
    viscous = stability.viscous_time(viscosity, spacing, VISCOUS_STABLE)
    predicted = min(courant, viscous)
    found = largest_stable(stable, predicted, 0.5, 8.0)
    default = min(AUTO_COURANT / rate, stability.viscous_time(viscosity, spacing, VISCOUS_LIMIT))
    number = "Courant" if courant < viscous else "viscosity"
    value = found * (rate if courant < viscous else VISCOUS_STABLE / viscous)
    return Limit("fluid", name, predicted, found, default, f"stable to a {number} number of {value:.2f}")


def liquid_limit(wall: bool, bridge: bool) -> Limit:
    """A sphere within the roughness of another one, or of a wall, in a liquid that stops it faster than contacts part
    it, or that touches it and has a bridge of such a liquid: a perturbation of its speed, of its sliding and of its
    spin may not grow."""
    liquid = {"lubrication": {"cutoff": 1e-5, "roughness": 1e-6, "viscosity": 20.0}}
    gap = 5e-7
    if bridge:  # with next to no pull
        table = {"surface_tension": 1e-9, "liquid_content": 0.1, "liquid_viscosity": 20.0, "minimum_gap": 1e-6}
        liquid, gap = {"cohesion": {"kind": "capillary", "contact_angle": 0.0} | table}, -1e-9
    near = [[0.005, 1e-3 + gap]] if wall else [[0.003, 0.005], [0.005 + gap, 0.005]]
    sides = ("left", "right") if wall else ("left", "right", "bottom", "top")
    scene = jaxdem.load_scene(
        {
            "precision": "float64",
            "domain": {"size": [0.01, 0.01], "gravity": [0.0, 0.0]},
            "particles": {"radius": 1e-3, "density": DENSITY, "position": near},
            "contact": {"young_modulus": 1e7, "restitution": 1.0, "friction": 0.0, "speed": 1e-3} | liquid,
            "boundary": {side: {"kind": "periodic"} for side in sides},
            "time": {"end": 1.0, "output_interval": 1.0},
        }
    )
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    limits = time_steps(scene).limits
    interval = dataclasses.replace(simulation.contact, search=None, steps=200)
    velocity = simulation.wall_velocity(parameters, jnp.zeros(()))
    around = surroundings(parameters.contact, velocity)
    speeds = jnp.asarray([[1e-9, -1e-9]] if wall else [[1e-9, 1e-9], [-1e-9, -1e-9]])
    start = state.particles._replace(velocity=speeds, angular_velocity=jnp.full((len(near), 1), 1e-6))

    @jax.jit
    @jax.vmap
    def stable(time_step: Array) -> Array:
        force = jnp.zeros_like(start.velocity)
        end, _, _ = contact_interval(interval, around, parameters.bodies, start, neighbors, force, time_step)
        return kinetic_energy(end, parameters.bodies) < GROWTH * kinetic_energy(start, parameters.bodies)

    found = largest_stable(stable, limits["contact_stability"], 0.5, 8.0)
    names = ("two near spheres in a liquid", "a sphere near a wall in a liquid")
    if bridge:
        names = ("two spheres with a viscous bridge", "a sphere with a viscous bridge to a wall")
    name = names[wall]
    return Limit("contact", name, limits["contact_stability"], found, limits["contact_automatic"])


def limits() -> dict[str, Callable[[], Limit]]:
    """Every row by name; each is run when called."""
    table: dict[str, Callable[[], Limit]] = {}

    def contact(name: str, material: str, label: str = "", **settings: Any) -> None:
        key = f"contact: {name}, {material}{label}"
        table[key] = functools.partial(contact_limit, name, material, **settings)

    for name in [*arrangements(), *oblique_walls()]:
        for material in MATERIALS:
            contact(name, material)
    for name in [*rods(), *hard_ones()]:
        for material in ("e = 1, mu = 0", "e = 1, mu = 10", "e = 0, mu = 10"):
            contact(name, material)
    for modulus in (1e5, 7e10):
        for name in ("pair", "hexagonal pack"):
            contact(name, "e = 1, mu = 10", f", {modulus:.0e} Pa", young_modulus=modulus)
    for name in ("pair", "hexagonal pack"):
        for material in ("e = 1, mu = 10", "e = 0, mu = 10"):
            law = {"law": "linear_spring_dashpot", "normal_stiffness": 1e4}
            contact(name, material, ", linear law", **law)
    for speed, modulus in ((1.0, 7e7), (100.0, 7e10)):
        name = f"impact: ball between walls, {speed:g} m/s"
        table[name] = functools.partial(impact_limit, speed, modulus)
    for kind, cohesion in HELD.items():
        for name, material in (
            ("pair", "e = 1, mu = 0"),
            ("hexagonal pack", "e = 1, mu = 10"),
            ("pair", "e = 0, mu = 10"),
        ):
            contact(name, material, f", held by {kind}", cohesion=cohesion)
    for kind, cohesion in HELD_OF_SIZES.items():
        for material in ("e = 1, mu = 10", "e = 0, mu = 10"):
            contact("size ratio 10", material, f", held by {kind}", cohesion=cohesion)
    table["impact: spheres that van der Waals attracts"] = attraction_limit
    for name, shear, damping in (
        *((name, 0.4, 0.0) for name in BONDED), ("pair", 0.01, 0.0), ("pair", 0.4, 0.3), ("chain of 8", 0.4, 0.3)
    ):  # fmt: skip
        table[f"bonds: {name}, {shear:g}, {damping:g}"] = functools.partial(bond_limit_of, name, shear, damping)
    for wall, name in ((False, "two near spheres"), (True, "a sphere near a wall")):
        table[f"contact: {name} in a liquid"] = functools.partial(liquid_limit, wall, False)
        table[f"contact: {name}, bridge"] = functools.partial(liquid_limit, wall, True)
    streams = {
        "stream along x, limited": ((1.0, 0.0), 1e-6, "limited"),
        "stream along x, upwind": ((1.0, 0.0), 1e-6, "upwind"),
        "diagonal stream, limited": ((1.0, 1.0), 1e-6, "limited"),
        "stream along x, superbee": ((1.0, 0.0), 1e-6, "superbee"),
        "diagonal stream, superbee": ((1.0, 1.0), 1e-6, "superbee"),
        "stream along x, central": ((1.0, 0.0), 1e-6, "central"),
        "diagonal stream, central": ((1.0, 1.0), 1e-6, "central"),
        "stream along x, central_4": ((1.0, 0.0), 1e-6, "central_4"),
        "diagonal stream, central_4": ((1.0, 1.0), 1e-6, "central_4"),
        "eddies, viscous": ((0.0, 0.0), 1.0, "limited"),
    }
    for name, settings in streams.items():
        table[f"fluid: {name}"] = functools.partial(fluid_limit, name, *settings)
    return table

"""Particles that fall and come to rest before a run begins: contacts, walls and gravity of the scene, without fluid."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.errors import InputError, required
from jaxdem.failures import Failure, failures, first_meaning
from jaxdem.numerics.host import on_device
from jaxdem.particles.contact_model import MaterialIndex
from jaxdem.particles.integrate import ParticleProperties, ParticleState
from jaxdem.particles.moving_walls import HeldMotion, SurfaceMotion
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.walls import box_sides
from jaxdem.setup.particles import ParticleSetup
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State

REST_ENERGY = 1e-7
"""At rest the mean kinetic energy of a particle is below this part of the mean m g d."""

REST_FORCE = 0.01
"""At rest the mean of |contact forces + weight| is below this part of the mean weight."""

FALLS_THROUGH_BOX, FALLS_THROUGH_DIAMETER = 10.0, 200.0
"""In the longest time that settling may take by default."""

Progress = Callable[[float, float], None]
"""Called with the time since the particles began to fall, and the longest time that they may take [s]."""


def settled(
    particles: ParticleSetup, simulation: Simulation, parameters: Parameters, progress: Progress | None
) -> Callable[[State, Neighbors], tuple[State, Neighbors]]:
    """A function that lets the particles of a state fall and come to rest; the fluid and the time stay as they are.

    They move as in the scene without its fluid, under its gravity and among its walls at time 0. All sides of the box
    are walls, also those at which particles leave during the run, and stand still. They are at rest when the mean
    kinetic energy is below `REST_ENERGY` m g d and contact forces and weight balance but for `REST_FORCE`.

    Args:
        particles: of the scene.
        simulation, parameters: of it.
        progress: called now and then.
    """
    dry, numbers = _without_fluid(particles, simulation), _at_rest_outside(simulation, parameters)
    gravity = float(np.linalg.norm(np.asarray(parameters.gravity)))
    diameter, height = 2.0 * float(np.mean(particles.present.radius)), math.hypot(*simulation.box)
    fall = math.sqrt(2.0 * diameter / gravity)
    longest = _longest(particles) or (
        FALLS_THROUGH_BOX * math.sqrt(2.0 * height / gravity) + FALLS_THROUGH_DIAMETER * fall
    )
    count = max(1, round(fall / simulation.interval))

    def settle(state: State, neighbors: Neighbors) -> tuple[State, Neighbors]:
        model = required(dry.contact, "simulation.contact").model
        given = required(state.particles, "state.particles")
        walls = tuple(jnp.zeros((model.analytic_walls, s.shape[1]), s.dtype) for s in given.wall_spring)
        falling = State(given._replace(wall_spring=walls, pistons=None), None, state.step)
        done, energy, force = 0, math.inf, math.inf
        while not (energy < REST_ENERGY and force < REST_FORCE):
            if done * simulation.interval >= longest:
                raise _restless(particles, longest, energy, force)
            falling, neighbors = _block(dry, numbers, falling, neighbors, count)
            done += count
            energy, force = _unrest(numbers, required(falling.particles, "particles"), gravity, diameter)
            if progress is not None:
                progress(done * simulation.interval, longest)
        kept = [model.sides.index(side) for side in required(simulation.contact, "contact").model.sides]
        rows = np.asarray([*kept, *range(len(model.sides), model.analytic_walls)], int)
        rested = required(falling.particles, "particles")
        springs = tuple(spring[rows] for spring in rested.wall_spring)
        rested = rested._replace(wall_spring=springs, pistons=given.pistons, mesh_wear=given.mesh_wear)
        return state._replace(particles=rested), dataclasses.replace(neighbors, builds=jnp.zeros_like(neighbors.builds))

    return settle


def _without_fluid(particles: ParticleSetup, simulation: Simulation) -> Simulation:
    """The contacts of a simulation alone, with walls at all sides."""
    parts = {field.name: getattr(simulation, field.name) for field in dataclasses.fields(Simulation)}
    contact = required(simulation.contact, "simulation.contact")
    model, table = contact.model, particles.materials
    sides, index = box_sides(simulation.box, simulation.periodic), model.materials
    if table is not None:
        walls = table.of_walls(len(sides), len(model.surfaces), len(model.meshes))
        index = MaterialIndex.of(particles.contact_material, walls, table.pair)
    times = None if model.wall_times is None else model.wall_times.held(0.5 * simulation.interval)
    motions = tuple(None if one is None else _still(one) for one in model.motions)
    model = dataclasses.replace(
        model,
        sides=sides,
        materials=index,
        wall_times=times,
        motions=motions if any(motions) else (),
        pistons=(),
        travel=None,
    )
    contact = dataclasses.replace(contact, model=model)
    without = dict.fromkeys(("fluid", "coupling", "population", "scalars", "walls_in_fluid"))
    return Simulation(**parts | without | {"contact": contact})


def _still(surface: SurfaceMotion) -> SurfaceMotion | None:
    """A surface where it is at time 0, at rest; a piston is where the scene has it."""
    return None if surface.motion is None else SurfaceMotion(HeldMotion(surface.motion, 0.0), surface.wall)


def _at_rest_outside(simulation: Simulation, parameters: Parameters) -> Parameters:
    """The numbers without a fluid, for sides that stand still."""
    dimension, dtype = len(simulation.box), parameters.gravity.dtype
    still = on_device(np.zeros(dimension), dtype)
    return parameters._replace(fluid=None, closure=None, drag_scale=None, side_velocity=(still,) * (2 * dimension))


def _longest(particles: ParticleSetup) -> float | None:
    """The longest time that a pack of the scene gives [s]."""
    return max((pack.pack.settling_time or 0.0 for pack in particles.packs), default=0.0) or None


def check_settling_time(particles: ParticleSetup, interval: float) -> None:
    """Refuses packs that may settle for less than a coupling interval [s], by which their particles move.

    Raises:
        InputError: they may.
    """
    longest = _longest(particles)
    if particles.settles and longest is not None and longest < interval:
        limit = f"is less than the coupling interval of {interval:.4g} s, by which the particles move while they settle"
        raise InputError(f"{_settled_key(particles)}.settling_time", longest, limit, "raise it, or remove this key")


def _settled_key(particles: ParticleSetup) -> str:
    """The key of the first settled pack, with the longest time where one is given."""
    packs = [pack for pack in particles.packs if pack.pack.kind == "settled"]
    return max(packs, key=lambda pack: pack.pack.settling_time or 0.0).key


def _block(
    simulation: Simulation, parameters: Parameters, state: State, neighbors: Neighbors, count: int
) -> tuple[State, Neighbors]:
    """`count` intervals; more room where the neighbour list ran out of it.

    Raises:
        InputError: a particle flew off.
    """
    while True:
        after, found, code = _advanced(simulation, parameters, state, neighbors, on_device(count, np.int32))
        if not int(code):
            return after, found
        if int(code) & ~Failure.OVERFLOW:
            reason, remedy = first_meaning(int(code) & ~Failure.OVERFLOW)
            raise InputError("particles.pack", "settled", f"while the particles settle, {reason}", remedy)
        state, neighbors = simulation.with_room(state, neighbors, neighbors.room.enlarged())


@jax.jit
def _advanced(
    simulation: Simulation, parameters: Parameters, state: State, neighbors: Neighbors, count: Array
) -> tuple[State, Neighbors, Array]:
    """State and list after `count` () intervals, the time of the state as it was; it ends early with a failure."""
    Carry = tuple[State, Neighbors, Array, Array]

    def interval(carry: Carry) -> Carry:
        new, found, report = simulation.step(parameters, carry[0], carry[1])
        at = new._replace(step=carry[0].step)
        return at, required(found, "neighbors"), failures(simulation, report), carry[3] + 1

    zero = jnp.zeros((), jnp.int32)
    going = lax.while_loop(lambda carry: (carry[3] < count) & (carry[2] == 0), interval, (state, neighbors, zero, zero))
    return going[0], going[1], going[2]


def _unrest(parameters: Parameters, particles: ParticleState, gravity: float, diameter: float) -> tuple[float, float]:
    """Mean kinetic energy over m g d, and mean unbalanced force over the mean weight [-]."""
    bodies: ParticleProperties = required(parameters.bodies, "parameters.bodies")
    mass, inertia = (
        np.broadcast_to(np.asarray(a, float), len(particles.position)) for a in (bodies.mass, bodies.inertia)
    )
    velocity, spin, force = (
        np.asarray(a, float) for a in (particles.velocity, particles.angular_velocity, particles.contact_force)
    )
    rows = np.ones(len(mass), bool) if particles.active is None else np.asarray(particles.active)
    energy = 0.5 * mass * np.sum(velocity**2, axis=1) + 0.5 * inertia * np.sum(spin**2, axis=1)
    net = np.linalg.norm(force + mass[:, None] * np.asarray(parameters.gravity, float), axis=1)
    weight = gravity * float(np.mean(mass[rows]))
    return float(np.mean(energy[rows])) / (weight * diameter), float(np.mean(net[rows])) / weight


def _restless(particles: ParticleSetup, longest: float, energy: float, force: float) -> InputError:
    """The error of particles that do not come to rest."""
    limit = (
        f"the particles are not at rest after {longest:.4g} s: their mean kinetic energy is {energy:.2g} m g d (limit "
        f"{REST_ENERGY:g}), the mean unbalanced force {force:.2g} of the weight (limit {REST_FORCE:g})"
    )
    remedy = "raise it; or give the contacts more friction, rolling friction or a lower restitution; or soften them"
    return InputError(f"{_settled_key(particles)}.settling_time", longest, limit, remedy)

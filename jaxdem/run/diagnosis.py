"""Where a run failed, and what did it: for the message of a failed interval. Host side, plain numbers."""

from __future__ import annotations

import math

import numpy as np

from jaxdem.errors import required
from jaxdem.failures import MEANING, Failure, first_flag
from jaxdem.particle_step import buried_particles
from jaxdem.particles.integrate import ParticleState
from jaxdem.particles.walls_present import late_walls
from jaxdem.simulation import Simulation
from jaxdem.state import Diagnostics, Parameters, State

SIDES = ("left", "right", "front", "back", "bottom", "top")
"""Sides in 3-D, axis by axis, lower before upper; in 2-D without the middle pair."""

OF_ONE_PARTICLE = (Failure.PARTICLES_NOT_FINITE, Failure.PARTICLE_LOST, Failure.TOO_FAST, Failure.WALL_COMES)
"""Flags that one particle raises."""

STEADY = 1.0
"""A force of the fluid through a side counts as what pushed from this multiple of the particle's weight on [-]."""

REMEDY_OF_A_PRESS = (
    "the load pressed the particle through the wall: stiffen the contact (contact.young_modulus, "
    "contact.normal_stiffness) or raise contact.speed until the wall holds (`jaxdem check` prints the overlap under "
    "the load of the fluid)"
)


def diagnosis(
    simulation: Simulation,
    parameters: Parameters,
    code: int,
    before: State,
    reached: State,
    told: Diagnostics | None = None,
) -> tuple[str, str, str]:
    """Reason, place and remedy of a failed interval.

    Args:
        simulation, parameters: of the run.
        code: flags of the interval, see `jaxdem.failures`.
        before: state at its start.
        reached: state at its end.
        told: its figures, for a piston.
    """
    flag = first_flag(code)
    reason, remedy = MEANING[flag]
    particles = reached.particles
    if flag in (Failure.PISTON_GONE, Failure.PISTON_MEETS):
        return reason, _ends_of_ways(simulation, before, told) or _pistons(simulation, flag, before, told), remedy
    if before.particles is None or particles is None or flag not in OF_ONE_PARTICLE:
        return reason, _cell(simulation, flag, reached), remedy
    if flag == Failure.WALL_COMES:
        index, wall = _buried(simulation, parameters, before)
    else:
        index, wall = _particle(simulation, flag, particles), ""
    point = ", ".join(f"{x:.5g}" for x in np.asarray(before.particles.position[index]))
    where = f"particle {index}, last at ({point}) m{wall}"
    speed = float(np.linalg.norm(np.asarray(particles.velocity[index], float)))
    if flag == Failure.TOO_FAST:
        where += f", at {speed:.3g} m/s; the limit is {simulation.steps.speed_limit or 0.0:.3g} m/s"
    if flag == Failure.PARTICLE_LOST:
        side, outward = _side_left(simulation, np.asarray(particles.position[index], float))
        where += f", through the {side} side at {speed:.3g} m/s"
        push = _fluid_push(parameters, particles, index, outward)
        if push > STEADY:
            where += f"; the fluid pushes it out with {push:.2g} times its weight"
            if not speed > (simulation.steps.speed_limit or math.inf):
                remedy = REMEDY_OF_A_PRESS
    return reason, where, remedy


def _ends_of_ways(simulation: Simulation, before: State, told: Diagnostics | None) -> str:
    """Which of the walls that a force holds and that the fluid does not see meets which wall, and where it is."""
    met = None if told is None or told.particles is None else told.particles.met
    contact, particles = simulation.contact, before.particles
    if met is None or contact is None or contact.model.travel is None or particles is None:
        return ""
    ways = np.asarray(required(particles.pistons, "pistons").displacement)
    found: dict[int, list[str]] = {}
    travel = contact.model.travel
    for (wall, other), at_end in zip(travel.names, np.asarray(met), strict=True):
        if at_end:
            found.setdefault(wall, []).append(other)
    return ", ".join(
        f"walls.{wall} (meets {' and '.join(others)}), {ways[travel.pistons.index(wall)]:.4g} m from where the scene "
        f"has it"
        for wall, others in found.items()
    )


def _pistons(simulation: Simulation, flag: Failure, before: State, told: Diagnostics | None) -> str:
    """Which of the walls that a force holds has no fluid beside it, or meets which wall, and where it is."""
    response = required(required(required(told, "figures").fluid, "fluid").response, "response of the fluid")
    pistons = required(simulation.walls_in_fluid, "walls in the fluid").pistons
    ways = np.asarray(required(required(before.particles, "particles").pistons, "pistons").displacement)
    found = {}
    for one, gaps in zip(pistons, np.asarray(required(response.gap, "gaps of pistons")), strict=True):
        met = sorted({wall for number, wall in (*one.apart, *one.along) if gaps[number] <= 0.0})
        if met if flag == Failure.PISTON_MEETS else not bool(one.touches(response)):
            others = " and ".join(f"walls.{k}" for k in met)
            found[one] = f" (meets {others})" if met else ""
    return ", ".join(
        f"walls.{one.wall}{met}, {ways[one.number]:.4g} m from where the scene has it" for one, met in found.items()
    )


def _buried(simulation: Simulation, parameters: Parameters, before: State) -> tuple[int, str]:
    """The first particle within a wall that comes, and which wall it is, in words."""
    contact, particles = required(simulation.contact, "particles"), required(before.particles, "particles")
    neighbors = simulation.allocate(parameters, particles)
    buried = required(buried_particles(simulation, parameters, particles, neighbors, before.step), "walls")
    found = np.asarray(buried.found)
    index = int(np.argmax(found.any(axis=0)))
    number = late_walls(contact.model)[int(np.argmax(found[:, index]))]
    times = required(contact.model.wall_times, "walls")
    surfaces = contact.model.surfaces
    wall = surfaces[number] if number < len(surfaces) else f"mesh {number - len(surfaces)} (the first is 0)"
    return index, f", within the wall that comes at {times.windows[number].begin:g} s: {wall}"


def _particle(simulation: Simulation, flag: Failure, particles: ParticleState) -> int:
    """The particle that a flag is about; those that have been removed are none."""
    position, velocity = np.asarray(particles.position, float), np.asarray(particles.velocity, float)
    present = np.ones(len(position), bool) if particles.active is None else np.asarray(particles.active)
    spin = np.asarray(particles.angular_velocity, float)
    finite = np.isfinite(np.concatenate([position, velocity, spin], axis=1)).all(axis=1)
    if flag == Failure.PARTICLES_NOT_FINITE:
        return int(np.argmin(finite))
    if flag == Failure.TOO_FAST:
        return int(np.argmax(np.where(present, np.linalg.norm(velocity, axis=1), -1.0)))
    beyond = np.maximum(-position, position - np.asarray(simulation.box))
    beyond = np.where(np.asarray(simulation.periodic), -np.inf, beyond).max(axis=1)
    return int(np.argmax(np.where(present & ~np.isnan(beyond), beyond, -np.inf)))


def _side_left(simulation: Simulation, position: np.ndarray) -> tuple[str, np.ndarray]:
    """Side of the box that lies furthest behind a particle, and the unit vector out of it."""
    beyond = np.stack([-position, position - np.asarray(simulation.box)], axis=1)
    beyond[np.asarray(simulation.periodic)] = -np.inf
    axis, upper = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
    names = SIDES if len(position) == 3 else SIDES[:2] + SIDES[4:]
    outward = np.zeros(len(position))
    outward[axis] = 1.0 if upper else -1.0
    return names[2 * int(axis) + int(upper)], outward


def _fluid_push(parameters: Parameters, particles: ParticleState, index: int, outward: np.ndarray) -> float:
    """Force of the fluid out of the box over the particle's weight, or its mass times 9.81 m/s2 without gravity."""
    bodies = parameters.bodies
    if particles.fluid_force is None or bodies is None:
        return 0.0
    mass = float(np.broadcast_to(np.asarray(bodies.mass), len(particles.position))[index])
    gravity = float(np.linalg.norm(np.asarray(parameters.gravity), axis=-1).max()) or 9.81
    return float(np.asarray(particles.fluid_force[index], float) @ outward) / (mass * gravity)


def _cell(simulation: Simulation, flag: Failure, reached: State) -> str:
    """The cell that a flag is about."""
    if reached.fluid is None or simulation.fluid is None:
        return "everywhere"
    grid = simulation.fluid.solver.grid
    if flag == Failure.VOID_FRACTION and reached.fluid.void_fraction is not None:
        cell = np.unravel_index(int(np.argmin(reached.fluid.void_fraction)), grid.cells)
    else:
        speed = sum(np.abs(np.diff(np.asarray(u), axis=a)) for a, u in enumerate(reached.fluid.face_velocity))
        cell = np.unravel_index(int(np.argmax(np.nan_to_num(speed, nan=np.inf))), grid.cells)
    return f"cell {tuple(int(i) for i in cell)}"

"""What particles and fluid do to the walls, as a step has measured it."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple, TypeVar

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import InputError, require_kinds, required
from jaxdem.fluid.two_fluids import TwoFluidSolver
from jaxdem.numerics import vectors
from jaxdem.observables.arguments import require_arguments, require_numbers
from jaxdem.state import Diagnostics
from jaxdem.structure import Structure

AnyStructure = TypeVar("AnyStructure", bound=Structure)


class WallLoad(NamedTuple):
    """Means over an interval.

    Attributes:
        force: (D,) of the particles on a wall [N].
        torque: (A,) of the same about a point [N m].
        power: () of the same at the velocity of the wall: what the particles give to it, negative where it drives them
            [W].
        mass: () of the particles that touch it [kg].
    """

    force: Array
    torque: Array
    power: Array
    mass: Array


def measuring_walls(
    simulation: AnyStructure, walls: tuple[int, ...] | None = None, sides: tuple[int, ...] | None = None
) -> AnyStructure:
    """The simulation with steps that measure the loads on walls; `Diagnostics` has them.

    Args:
        simulation: from `jaxdem.build`.
        walls: numbers of the walls whose loads by particles are measured, from `side_walls` and `surface_walls`; all
            if not given.
        sides: of the box on which the load by the fluid is measured: 2 times the axis, and 1 more for the upper one;
            all if not given.
    """
    require_kinds("give what jaxdem.build makes", simulation=(simulation, Structure))
    contact, fluid, coupling = simulation.contact, simulation.fluid, simulation.coupling
    if contact is not None:
        measured = tuple(range(contact.model.walls))
        if walls is not None:  # pistons need their loads in any case
            measured = tuple(sorted({*walls, *(wall for piston in contact.model.pistons for wall in piston.walls)}))
        contact = dataclasses.replace(contact, model=dataclasses.replace(contact.model, measured=measured))
    if fluid is not None:
        chosen = tuple(range(2 * len(simulation.box))) if sides is None else tuple(sorted(set(sides)))
        if chosen and isinstance(fluid.solver, TwoFluidSolver):
            limit = "the force of two fluids on a side of the box is not measured"
            raise InputError("probes", "a side of the box", limit, "remove the probe, or [surface]")
        if chosen and fluid.solver.surfaces > 0:
            limit = "the force of the fluid on a side of the box is not measured beside walls that the fluid sees"
            raise InputError("probes", "a side of the box", limit, "measure the walls, or set their fluid to none")
        fluid = dataclasses.replace(fluid, solver=dataclasses.replace(fluid.solver, measured_sides=chosen))
        coupling = None if coupling is None else dataclasses.replace(coupling, interval=fluid)
    return dataclasses.replace(simulation, contact=contact, fluid=fluid, coupling=coupling)


def side_walls(structure: Structure, axis: int, upper: bool) -> tuple[int, ...]:
    """Number of the wall that a side of the box is to the particles; none where they leave."""
    require_arguments(structure=structure)
    sides = required(structure.contact, "particles").model.sides
    return tuple(k for k, side in enumerate(sides) if (side.axis, side.inward < 0) == (axis, upper))


def mesh_walls(structure: Structure, mesh: int) -> tuple[int, ...]:
    """Number of the wall that a mesh is, of the meshes in the order of the scene."""
    return (required(structure.contact, "particles").model.analytic_walls + mesh,)


def surface_walls(structure: Structure, surfaces: tuple[int, ...]) -> tuple[int, ...]:
    """Numbers of the walls that these surfaces are."""
    require_arguments(structure=structure)
    first = len(required(structure.contact, "particles").model.sides)
    return tuple(first + k for k in surfaces)


def wall_load(diagnostics: Diagnostics, walls: tuple[int, ...], about: Array) -> WallLoad:
    """Mean force of the particles on some walls over an interval, and its torque about a point:

        F = -sum f,    T = -sum [ (x - a) cross f + t ],

    over all contacts and contact steps, with f the force and t the torque about its centre that a wall puts on a
    particle at x, and a the point. So the change of the particles' momentum, and of their angular momentum about a, is
    minus this, to rounding, beside what gravity and fluid do. In 2-D the torque turns from the first axis to the
    second. The power is F.v + T.w at every contact step, with v the velocity of the wall at the point and w its angular
    velocity.

    Along a periodic axis positions go on, so components of the torque with such an arm have no meaning: about an axis
    all others must not be periodic.

    Args:
        diagnostics: of a step of a simulation from `measuring_walls`.
        walls: numbers, from `side_walls` or `surface_walls`.
        about: (D,) the point a [m].
    """
    require_arguments(diagnostics=diagnostics)
    loads = required(required(diagnostics.particles, "particles").walls, "walls of the diagnostics")
    chosen = list(walls)
    require_numbers("walls", chosen, loads[0][0].shape[0], "walls")
    force, about_origin, power, mass = (tuple(jnp.sum(x[jnp.asarray(chosen, int)]) for x in vector) for vector in loads)
    arm = tuple(about[k] for k in range(about.shape[0]))
    torque = vectors.subtract(about_origin, vectors.moment(arm, force))
    return WallLoad(jnp.stack(force), jnp.stack(torque), power[0], mass[0])


def fluid_force(diagnostics: Diagnostics, axis: int, upper: bool) -> Array:
    """(D,) mean force of the fluid on a side of the box over an interval: pressure and viscous stress [N].

    The pressure is the reduced one. See `fluid.side_forces` for the balance that it closes.

    Args:
        diagnostics: of a step of a simulation from `measuring_walls`.
        axis: that the side is normal to.
        upper: whether it is the upper one.
    """
    return _side_load(diagnostics, axis, upper)[:, 0]


def force_in_fluid(diagnostics: Diagnostics, surfaces: tuple[int, ...]) -> Array:
    """(D,) mean force of the fluid on surfaces that it sees, over an interval: pressure and viscous stress [N].

    The pressure is the reduced one. Of a mean gradient along periodic axes it has no part.

    Args:
        diagnostics: of a step.
        surfaces: their numbers among those that the fluid sees.
    """
    return _surface_load(diagnostics, surfaces)[:, 0]


def torque_in_fluid(diagnostics: Diagnostics, surfaces: tuple[int, ...], about: Array) -> Array:
    """(A,) mean torque of the fluid on surfaces that it sees, about a point a [N m]; see `fluid_torque`.

    A force acts at the middle of its face or cell, so the arms are right to the size of a cell.

    Args:
        diagnostics: of a step.
        surfaces: their numbers among those that the fluid sees.
        about: (D,) the point a [m].
    """
    return _torque_of(_surface_load(diagnostics, surfaces), about)


def _surface_load(diagnostics: Diagnostics, surfaces: tuple[int, ...]) -> Array:
    require_arguments(diagnostics=diagnostics)
    loads = required(required(diagnostics.fluid, "fluid").surface_load, "surface_load of the diagnostics")
    require_numbers("surfaces", surfaces, loads.shape[0], "surfaces that the fluid sees")
    return jnp.sum(loads[jnp.asarray(surfaces)], axis=0)


def fluid_torque(diagnostics: Diagnostics, axis: int, upper: bool, about: Array) -> Array:
    """(A,) mean torque of the fluid on a side of the box over an interval, about a point a [N m]:

        T = sum (x - a) cross f,

    over the faces of the side, with f the force of `fluid_force` on each, at its middle x. In 2-D it turns from the
    first axis to the second. For components with an arm along a periodic axis see `wall_load`.

    Args:
        diagnostics: of a step of a simulation from `measuring_walls`.
        axis: that the side is normal to.
        upper: whether it is the upper one.
        about: (D,) the point a [m].
    """
    return _torque_of(_side_load(diagnostics, axis, upper), about)


def _torque_of(load: Array, about: Array) -> Array:
    """(A,) from force and first moments (D, 1 + D)."""
    moment, dimension = load[:, 1:] - load[:, :1] * about[None], load.shape[0]
    # moment[k, j] is the sum of (x_j - a_j) f_k.
    planes = ((0, 1),) if dimension == 2 else ((1, 2), (2, 0), (0, 1))
    return jnp.stack([moment[k, j] - moment[j, k] for j, k in planes])


def _side_load(diagnostics: Diagnostics, axis: int, upper: bool) -> Array:
    """(D, 1 + D), see `fluid.side_forces`."""
    require_arguments(diagnostics=diagnostics)
    loads = required(required(diagnostics.fluid, "fluid").side_load, "side_load of the diagnostics")
    require_numbers("axis", (axis,), loads.shape[0] // 2, "axes")
    return loads[2 * axis + upper]

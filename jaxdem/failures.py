"""What can go wrong inside a compiled step: traced flags, and what they mean on the host."""

from __future__ import annotations

import enum
import functools

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.interval import VISCOUS_STABLE
from jaxdem.state import Diagnostics
from jaxdem.structure import Structure


class Failure(enum.IntFlag):
    """Flags of a step; several may be up at once."""

    NONE = 0
    OVERFLOW = 1
    PARTICLES_NOT_FINITE = 2
    PARTICLE_LOST = 4
    FLUID_NOT_FINITE = 8
    COURANT = 16
    VISCOUS = 32
    SOLVER = 64
    VOID_FRACTION = 128
    TOO_FAST = 256
    WALL_COMES = 512
    PISTON_GONE = 1024
    PISTON_MEETS = 2048


MEANING = {
    Failure.WALL_COMES: (
        "a wall comes where particles are: it overlaps them by more than contact.maximum_overlap",
        "change begin of the wall, or place it where no particle is at that time",
    ),
    Failure.PISTON_GONE: (
        "a wall that a force holds and that the fluid sees has no fluid beside it",
        "it is outside of the box, or has pushed the fluid out: place it inside, end the run before, change its force "
        "or damping, or make the box longer",
    ),
    Failure.PISTON_MEETS: (
        "a wall that a force holds meets another wall, and walls do not push each other",
        "end the run before, place the walls further apart, put grains between them, change its force or damping, or "
        "change begin of a gate",
    ),
    Failure.COURANT: (
        "the Courant number is above fluid.courant_limit with 8 fluid steps in a coupling interval",
        "lower fluid.time_step or coupling.interval, or use larger cells",
    ),
    Failure.VISCOUS: (
        "the viscosity number is above its limit with 8 fluid steps in a coupling interval",
        "lower fluid.time_step or coupling.interval, or use larger cells",
    ),
    Failure.VOID_FRACTION: (
        "a cell holds almost no fluid",
        "widen coupling.kernel_width, use larger cells, or use a larger domain.depth",
    ),
    Failure.OVERFLOW: (
        "the neighbour list ran out of room",
        "simulate() enlarges the list and repeats the interval; for a rollout allocate a larger list "
        "(Simulation.with_room)",
    ),
    Failure.PARTICLE_LOST: (
        "a particle's centre has left the box through a wall",
        "the particle moved too fast for the contact step: raise contact.speed, stiffen the contact or "
        "lower contact.time_step",
    ),
    Failure.TOO_FAST: (
        "a particle is so fast that an impact would overlap by more than contact.maximum_overlap",
        "raise contact.speed to the speeds that occur, stiffen the contact, or find out what accelerates the particle",
    ),
    Failure.SOLVER: (
        "the pressure solve did not converge",
        'lower fluid.time_step, widen coupling.kernel_width, or use precision = "float64"',
    ),
    Failure.FLUID_NOT_FINITE: (
        "the fluid's velocity or pressure is not finite",
        "lower fluid.time_step or coupling.interval",
    ),
    Failure.PARTICLES_NOT_FINITE: (
        "a particle's position, velocity or rotation is not finite",
        "lower contact.time_step or raise contact.speed to the speeds that occur",
    ),
}
"""Reason and remedy of every flag, causes before their consequences."""

OF_PARTICLES = Failure.OVERFLOW | Failure.PARTICLES_NOT_FINITE | Failure.PARTICLE_LOST | Failure.TOO_FAST
"""Flags of the motion of the particles, which may come of contacts that a full neighbour list has left out."""

MINIMUM_VOID_FRACTION = 0.05
"""Below this void fraction the volume-averaged equations mean nothing."""


def failures(simulation: Structure, diagnostics: Diagnostics) -> Array:
    """() int32, the flags of a step; jittable."""
    found: list[tuple[Failure, Array]] = []
    particles, fluid = diagnostics.particles, diagnostics.fluid
    if particles is not None:
        found.append((Failure.OVERFLOW, particles.overflow))
        found.append((Failure.PARTICLES_NOT_FINITE, ~particles.finite))
        found.append((Failure.PARTICLE_LOST, particles.lost > 0))
        limit = 0.0 if simulation.steps.speed_limit is None else simulation.steps.speed_limit
        found.append((Failure.TOO_FAST, particles.fastest > limit))
        if particles.buried is not None:
            found.append((Failure.WALL_COMES, particles.buried > 0))
        if particles.met is not None:
            found.append((Failure.PISTON_MEETS, particles.met.any()))
    if fluid is not None and simulation.fluid is not None:
        found.append((Failure.FLUID_NOT_FINITE, ~fluid.finite))
        # The limits are written so that NaN does not pass them.
        found.append((Failure.COURANT, ~(fluid.courant <= 1.001 * simulation.fluid.courant_limit)))
        found.append((Failure.VISCOUS, ~(fluid.viscous <= VISCOUS_STABLE)))
        found.append((Failure.SOLVER, ~fluid.converged))
        if fluid.response is not None and simulation.walls_in_fluid is not None:
            beside = [piston.touches(fluid.response) for piston in simulation.walls_in_fluid.pistons]
            found.append((Failure.PISTON_GONE, ~jnp.stack(beside).all()))
            if fluid.response.gap is not None:
                found.append((Failure.PISTON_MEETS, (fluid.response.gap <= 0.0).any()))
    if diagnostics.exchange is not None:
        lowest = diagnostics.exchange.void_fraction
        found.append((Failure.VOID_FRACTION, ~(lowest >= MINIMUM_VOID_FRACTION)))
    codes = (jnp.where(condition, jnp.int32(flag), jnp.int32(0)) for flag, condition in found)
    return functools.reduce(jnp.bitwise_or, codes, jnp.zeros((), jnp.int32))


def first_flag(code: int) -> Failure:
    """The most telling flag of a code: causes before their consequences."""
    return next(flag for flag in MEANING if flag in Failure(code))


def first_meaning(code: int) -> tuple[str, str]:
    """Reason and remedy of the most telling flag of a code."""
    return MEANING[first_flag(code)]

"""What can go wrong inside a compiled step: traced flags, and what they mean on the host."""

from __future__ import annotations

import enum

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


MEANING = {
    Failure.OVERFLOW: (
        "the neighbour list ran out of room",
        "simulate() enlarges the list and repeats the interval; for a rollout allocate a larger list (Simulation.with_room)",
    ),
    Failure.PARTICLES_NOT_FINITE: (
        "a particle's position, velocity or rotation is not finite",
        "lower contact.time_step or raise contact.speed to the speeds that occur",
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
    Failure.FLUID_NOT_FINITE: (
        "the fluid's velocity or pressure is not finite",
        "lower fluid.time_step or coupling.interval",
    ),
    Failure.COURANT: (
        "the Courant number is above fluid.courant_limit with 8 fluid steps in a coupling interval",
        "lower fluid.time_step or coupling.interval, or use larger cells",
    ),
    Failure.VISCOUS: (
        "the viscosity number is above its limit with 8 fluid steps in a coupling interval",
        "lower fluid.time_step or coupling.interval, or use larger cells",
    ),
    Failure.SOLVER: (
        "the pressure solve did not converge",
        'lower fluid.time_step, widen coupling.kernel_width, or use precision = "float64"',
    ),
    Failure.VOID_FRACTION: (
        "a cell holds almost no fluid",
        "widen coupling.kernel_width, use larger cells, or use a larger domain.depth",
    ),
}
"""Reason and remedy of every flag."""

OF_PARTICLES = Failure.OVERFLOW | Failure.PARTICLES_NOT_FINITE | Failure.PARTICLE_LOST | Failure.TOO_FAST
"""Flags of the particles' part of a step."""

MINIMUM_VOID_FRACTION = 0.05
"""Below this void fraction the volume-averaged equations mean nothing."""


def failures(simulation: Structure, diagnostics: Diagnostics) -> Array:
    """() int32, the flags of a step; jittable."""
    code = jnp.zeros((), jnp.int32)

    def raise_flag(code: Array, condition: Array, flag: Failure) -> Array:
        return code | jnp.where(condition, jnp.int32(flag), jnp.int32(0))

    particles, fluid = diagnostics.particles, diagnostics.fluid
    if particles is not None:
        code = raise_flag(code, particles.overflow, Failure.OVERFLOW)
        code = raise_flag(code, ~particles.finite, Failure.PARTICLES_NOT_FINITE)
        code = raise_flag(code, particles.lost > 0, Failure.PARTICLE_LOST)
        limit = simulation.steps.speed_limit or 0.0
        code = raise_flag(code, particles.fastest > limit, Failure.TOO_FAST)
    if fluid is not None and simulation.fluid is not None:
        code = raise_flag(code, ~fluid.finite, Failure.FLUID_NOT_FINITE)
        # The limits are written so that NaN does not pass them.
        code = raise_flag(code, ~(fluid.courant <= 1.001 * simulation.fluid.courant_limit), Failure.COURANT)
        code = raise_flag(code, ~(fluid.viscous <= VISCOUS_STABLE), Failure.VISCOUS)
        code = raise_flag(code, ~fluid.converged, Failure.SOLVER)
    if diagnostics.exchange is not None:
        lowest = diagnostics.exchange.void_fraction
        code = raise_flag(code, ~(lowest >= MINIMUM_VOID_FRACTION), Failure.VOID_FRACTION)
    return code


def first_flag(code: int) -> Failure:
    """The most telling flag of a code: causes before their consequences."""
    order = (
        Failure.COURANT,
        Failure.VISCOUS,
        Failure.VOID_FRACTION,
        Failure.OVERFLOW,
        Failure.PARTICLE_LOST,
        Failure.TOO_FAST,
        Failure.SOLVER,
        Failure.FLUID_NOT_FINITE,
        Failure.PARTICLES_NOT_FINITE,
    )
    flags = Failure(code)
    return next(flag for flag in order if flag in flags)


def first_meaning(code: int) -> tuple[str, str]:
    """Reason and remedy of the most telling flag of a code."""
    return MEANING[first_flag(code)]

"""The time steps of a scene and how they fit each other. Host side, plain numbers."""

from __future__ import annotations

import dataclasses
from fractions import Fraction

from jaxdem.errors import InputError
from jaxdem.scene import Scene
from jaxdem.setup.boundaries import boundary_speed
from jaxdem.setup.contact_step import ContactStep, contact_step
from jaxdem.setup.fluid import FluidSetup
from jaxdem.setup.fluid_step import LONGEST_INTERVAL, fluid_steps, given_interval, whole
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.wall_functions import NO_FUNCTIONS, WallFunctions
from jaxdem.setup.wall_motion import check_displacement, check_pistons
from jaxdem.structure import Clock, TimeSteps

MOST_CONTACT_STEPS = 1_000_000
"""Contact steps in a coupling interval; more would run for minutes without a word, and for years in all."""

MOST_INTERVALS = 2**31 - 1
"""Coupling intervals of a run, which an integer of 32 bits counts."""


def time_steps(
    scene: Scene,
    fluid: FluidSetup | None,
    particles: ParticleSetup | None,
    begin: Fraction = Fraction(0),
    own_walls: WallFunctions = NO_FUNCTIONS,
) -> TimeSteps:
    """The steps of a scene, the automatic ones chosen, the given ones checked.

    Args:
        scene: the scene.
        fluid: of it.
        particles: of it.
        begin: time at which it begins [s].
        own_walls: of the user.

    Raises:
        InputError: a given step is unstable or does not fit the others.
    """
    output, speed = scene.time.output_interval, boundary_speed(scene)
    if fluid is not None:
        interval, substeps, limits = fluid_steps(fluid, speed)
    else:
        interval, substeps, limits = given_interval(scene) or min(output, LONGEST_INTERVAL), 1, {}
    outputs, per_output = scene.time.check_outputs(begin), _intervals_per_output(scene, interval)
    interval = simulated_time(output, 1, per_output)
    if outputs * per_output > MOST_INTERVALS:
        raise InputError(
            "time.end",
            scene.time.end,
            f"needs {outputs * per_output:.3g} coupling intervals of {interval:.3g} s, the limit is {MOST_INTERVALS}",
            "lower time.end, or raise the short step: coupling.interval, fluid.time_step, or its limit by "
            "fluid.viscosity",
        )
    steps = TimeSteps(
        interval=interval,
        intervals_per_output=per_output,
        outputs=outputs,
        contact=None,
        contacts_per_interval=0,
        fluid_substeps=substeps,
        limits=limits,
        expected_speed=None,
        expected_overlap=None,
        speed_limit=None,
    )
    return steps if particles is None else _with_contacts(steps, contact_step(particles, speed, own_walls), particles)


def clock_of(begin: Fraction, step: int, interval: float) -> Clock | None:
    """Where the time of a run begins; None where it is the number of intervals done times the interval.

    Args:
        begin: time at which it begins [s].
        step: intervals done by then.
        interval: of the run [s].
    """
    start = float(begin)
    return None if abs(step * interval - start) <= 1e-9 * interval else Clock(start, step)


def simulated_time(output_interval: float, intervals: int, per_output: int) -> float:
    """The float next to n/m times the output interval as it is written; three outputs of 0.05 s are 0.15 s [s].

    Args:
        output_interval: of the scene [s].
        intervals: n, number of coupling intervals.
        per_output: m, coupling intervals from one output to the next.
    """
    return float(exact_time(output_interval, intervals, per_output))


def exact_time(output_interval: float, intervals: int, per_output: int) -> Fraction:
    """`simulated_time` before it is rounded to a float [s]."""
    return Fraction(repr(float(output_interval))) * Fraction(intervals, per_output)


def _intervals_per_output(scene: Scene, interval: float) -> int:
    """Number of coupling intervals from one output to the next; refuses a given interval that does not divide it."""
    output = scene.time.output_interval
    per_output = whole(output / interval)
    if given_interval(scene) is not None and abs(per_output * interval - output) > 1e-9 * output:
        raise InputError(
            "coupling.interval",
            interval,
            f"must divide time.output_interval = {output} s",
            f"use, for example, coupling.interval = {output / per_output:.6g}",
        )
    return per_output


def _with_contacts(steps: TimeSteps, found: ContactStep, particles: ParticleSetup) -> TimeSteps:
    """The steps of a scene with particles; the contact step divides the interval."""
    interval, longest = steps.interval, found.longest
    if not longest * MOST_CONTACT_STEPS >= interval:
        raise InputError(
            "contact.time_step",
            particles.contact.time_step,
            f"makes contact steps of {longest:.3g} s, more than {MOST_CONTACT_STEPS} in a coupling interval "
            f"of {interval:.3g} s",
            "soften the contact, use larger particles, lower contact.speed, or shorten coupling.interval",
        )
    count = whole(interval / longest)
    check_displacement(particles.scene, interval / count, particles.spheres.smallest_radius)
    check_pistons(particles, interval / count, found.limits["contact_stability"])
    return dataclasses.replace(
        steps,
        contact=interval / count,
        contacts_per_interval=count,
        limits={**steps.limits, **found.limits},
        expected_speed=found.speed,
        expected_overlap=found.overlap,
        speed_limit=found.speed_limit,
    )

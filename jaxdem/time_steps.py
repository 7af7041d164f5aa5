"""The time steps of a scene: the automatic ones chosen, the given ones checked. Host side, plain numbers."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from jaxdem import stability
from jaxdem.coupling.exchange import SUBSTEPS, VISCOUS_LIMIT
from jaxdem.errors import InputError
from jaxdem.fluid.inlet import InletProfile, LinearTable, Parabola
from jaxdem.initial import initial_count, rows_of
from jaxdem.scene import Contact, Scene, parabolic_axes

AUTO_COURANT = 0.5
"""Courant number of the automatic fluid step at the largest boundary speed."""


class TimeSteps(NamedTuple):
    """The steps of a run and what they were chosen from; None where a part does not exist.

    Attributes:
        interval: coupling interval, the step of the time loop [s].
        intervals_per_output: number of intervals between frames.
        outputs: number of frames after the first.
        contact: contact step [s].
        contacts_per_interval: number of contact steps in an interval.
        fluid_substeps: smallest number of fluid steps in an interval.
        limits: named limits [s], for the check and the summary.
        expected_speed: that the contact limits stand on [m/s].
        expected_overlap: at that speed, over the diameter [-].
        speed_limit: at which an impact reaches `contact.maximum_overlap`; faster particles stop a run [m/s].
    """

    interval: float
    intervals_per_output: int
    outputs: int
    contact: float | None
    contacts_per_interval: int
    fluid_substeps: int
    limits: dict[str, float]
    expected_speed: float | None
    expected_overlap: float | None
    speed_limit: float | None


def time_steps(scene: Scene) -> TimeSteps:
    """The steps of a scene, the automatic ones chosen, the given ones checked.

    Raises:
        InputError: a given step is unstable or does not fit the others.
    """
    limits: dict[str, float] = {}
    output = scene.time.output_interval
    outputs = round(scene.time.end / output)
    substeps = 1
    speed = overlap = contact_step = speed_limit = None
    if scene.fluid is not None:
        interval, fluid_step = _fluid_steps(scene, limits)
        substeps = _substeps_for(interval, fluid_step, limits)
        _check_courant(scene, interval)
    else:
        interval = min(output, 0.01)
    per_output = _whole(output / interval)
    given = scene.coupling is not None and scene.coupling.interval != "auto"
    if given and abs(per_output * interval - output) > 1e-9 * output:
        raise InputError(
            "coupling.interval",
            interval,
            f"must divide time.output_interval = {output} s",
            f"for example coupling.interval = {output / per_output:.6g}",
        )
    interval = output / per_output
    count = 0
    if scene.particles is not None and scene.contact is not None:
        speed, overlap = _contact_limits(scene, limits)
        # The overlap grows with v^0.8 in Hertz's law and with v in the linear one.
        power = 1.0 if scene.contact.law == "linear_spring_dashpot" else 1.25
        speed_limit = speed * (scene.contact.maximum_overlap / overlap) ** power
        contact_step = _contact_step(scene, limits)
        count = _whole(interval / contact_step)
        contact_step = interval / count
    return TimeSteps(
        interval, per_output, outputs, contact_step, count, substeps, limits, speed, overlap, speed_limit
    )


def boundary_speed(scene: Scene) -> float:
    """Largest speed that a boundary, or the initial fluid, imposes [m/s]."""
    speeds = [0.0]
    for name, side in scene.boundary.items():
        profiles = inlet_profiles(scene, name) or ()
        peak = math.prod(profile.peak for profile in profiles if profile is not None)
        for velocity in (side.velocity, *(side.velocities or ())):
            if isinstance(velocity, tuple):
                speeds.append(peak * math.hypot(*velocity))
    if scene.fluid is not None and scene.fluid.velocity is not None:
        speeds.append(math.hypot(*scene.fluid.velocity))
    return max(speeds)


def inlet_profiles(scene: Scene, name: str) -> tuple[InletProfile | None, ...] | None:
    """Profile of a side for each of its axes, None where it is even; None if it is so in all."""
    side = scene.boundary[name]
    if side.profile == "parabolic":
        return tuple(Parabola() if zero else None for zero in parabolic_axes(scene, name, side))
    if side.positions is not None and side.values is not None:
        return (None,) * (scene.dimension - 2) + (LinearTable(side.positions, side.values),)
    return None


def _fluid_steps(scene: Scene, limits: dict[str, float]) -> tuple[float, float]:
    """Coupling interval and fluid step [s], and their limits."""
    fluid, output = scene.fluid, scene.time.output_interval
    assert fluid is not None
    spacing = tuple(length / n for length, n in zip(scene.domain.size, fluid.cells, strict=True))
    speed = boundary_speed(scene)
    limits["courant"] = stability.courant_time(speed, spacing, fluid.courant_limit)
    limits["viscous"] = stability.viscous_time(fluid.viscosity, spacing, VISCOUS_LIMIT)
    if fluid.time_step != "auto":
        step = fluid.time_step
    else:
        step = min(stability.courant_time(speed, spacing, AUTO_COURANT), limits["viscous"], output, 0.01)
    given = scene.coupling.interval if scene.coupling is not None else "auto"
    interval = step if given == "auto" else given
    if interval > output * (1.0 + 1e-9):
        key = "fluid.time_step" if given == "auto" else "coupling.interval"
        raise InputError(key, interval, f"must not exceed time.output_interval = {output} s", "lower it")
    return output / _whole(output / interval) if given == "auto" else interval, step


def _substeps_for(interval: float, fluid_step: float, limits: dict[str, float]) -> int:
    """Smallest number of fluid steps in an interval; refuses what 8 of them cannot do."""
    needed = interval / min(fluid_step, limits["viscous"])
    for count in SUBSTEPS:
        if count >= needed - 1e-6:
            return count
    allowed = SUBSTEPS[-1] * min(fluid_step, limits["viscous"])
    raise InputError(
        "fluid.time_step" if limits["viscous"] < fluid_step else "coupling.interval",
        interval,
        f"a coupling interval has at most {SUBSTEPS[-1]} fluid steps, so it is at most {allowed:.4g} s here "
        f"(viscous limit {limits['viscous']:.4g} s)",
        f"set coupling.interval or fluid.time_step to {allowed:.3g} or less, or use larger cells",
    )


def _check_courant(scene: Scene, interval: float) -> None:
    """Refuses an interval in which the initial fluid, or an inlet, certainly passes more cells than 8 steps may."""
    fluid = scene.fluid
    assert fluid is not None and fluid.velocity is not None
    spacing = [length / n for length, n in zip(scene.domain.size, fluid.cells, strict=True)]
    rates = [sum(abs(u) / h for u, h in zip(fluid.velocity, spacing, strict=True))]
    for number, name in enumerate(scene.sides):
        side, axis = scene.boundary[name], number // 2
        others = [h for a, h in enumerate(spacing) if a != axis]
        # A patch of two cells holds one whole face of a cell; a profile or a table may be anything in between.
        patch = side.from_ is None or side.to is None
        whole = patch or all(
            b - a >= 2.0 * h for a, b, h in zip(side.from_ or (), side.to or (), others, strict=True)
        )
        even = side.profile == "uniform" and isinstance(side.velocity, tuple)
        if side.kind == "inlet" and whole and even and scene.time.end >= (side.ramp_time or 0.0):
            rates.append(abs(side.velocity[axis]) / spacing[axis])  # type: ignore[index]
    allowed = SUBSTEPS[-1] * fluid.courant_limit / max(*rates, 1e-300)
    if interval > allowed * (1.0 + 5e-4):
        given = scene.coupling is not None and scene.coupling.interval != "auto"
        raise InputError(
            "coupling.interval" if given else "fluid.time_step",
            interval,
            f"the fluid passes {interval * max(rates):.3g} cells in it, {SUBSTEPS[-1]} fluid steps of a Courant number "
            f"of {fluid.courant_limit} pass {SUBSTEPS[-1] * fluid.courant_limit:.3g}",
            f"set it to {allowed:.3g} or less, or use larger cells",
        )


def _contact_limits(scene: Scene, limits: dict[str, float]) -> tuple[float, float]:
    """Limits of the contact step [s], into `limits`; returns expected speed and overlap over diameter."""
    contact, particles = scene.contact, scene.particles
    assert contact is not None and particles is not None
    radius = float(np.min(particles.radius))
    density = float(np.min(particles.density))
    heaviest = 4.0 / 3.0 * math.pi * float(np.max(particles.radius)) ** 3 * float(np.max(particles.density))
    mass = 4.0 / 3.0 * math.pi * radius**3 * density
    speed = expected_speed(scene)
    ratio = stability.damping_ratio(contact.restitution)
    if contact.law == "linear_spring_dashpot":
        stiffness = contact.normal_stiffness or 0.0
        limits["contact_duration"] = stability.linear_duration(0.5 * mass, stiffness, ratio)
        overlap = stability.linear_overlap(heaviest, stiffness, speed)
    else:
        modulus = 0.5 * contact.young_modulus / (1.0 - contact.poisson_ratio**2)
        limits["rayleigh"] = stability.rayleigh_time(
            radius, density, contact.young_modulus, contact.poisson_ratio
        )
        limits["contact_duration"] = stability.hertz_duration(0.5 * mass, 0.5 * radius, modulus, speed)
        overlap = stability.hertz_overlap(0.5 * mass, 0.5 * radius, modulus, speed)
    limits["contact_stability"] = contact_stability(scene, speed)
    relative = overlap / (2.0 * radius)
    if relative > contact.maximum_overlap:
        key = (
            "contact.normal_stiffness" if contact.law == "linear_spring_dashpot" else "contact.young_modulus"
        )
        value = contact.normal_stiffness if contact.law == "linear_spring_dashpot" else contact.young_modulus
        raise InputError(
            key,
            value,
            f"an impact at {speed:.3g} m/s would overlap by {100 * relative:.3g} % of a diameter, "
            f"the limit is {100 * contact.maximum_overlap:.3g} %",
            "stiffen the contact, lower contact.speed, or raise contact.maximum_overlap",
        )
    return speed, relative


def contact_stability(scene: Scene, speed: float, overlap: float | None = None) -> float:
    """Stability limit of the contact step for this scene's materials, sizes and walls [s].

    Every contact that a particle has room for is taken to be as deep as an impact of the heaviest particle at
    `speed`, on the lightest, makes it, up to `contact.maximum_overlap`.

    Args:
        scene: with particles.
        speed: largest to expect [m/s].
        overlap: of all contacts in place of the expected one [m].
    """
    contact, particles = scene.contact, scene.particles
    assert contact is not None and particles is not None
    small, large = float(np.min(particles.radius)), float(np.max(particles.radius))
    light = 4.0 / 3.0 * math.pi * small**3 * float(np.min(particles.density))
    heavy = 4.0 / 3.0 * math.pi * large**3 * float(np.max(particles.density))
    # Light particles touch each other and heavy ones. These move less: their factor 1 + q is such that the bound
    # over a heavy particle's contacts, of which it has more, is the same.
    more = (0.5 * (1.0 + large / small)) ** (scene.dimension - 1)
    kinds = [(2.0, 0.5 * light, 0.5 * small)]
    if heavy > light:
        reduced = light * heavy / (light + heavy)
        kinds.append((1.0 + more * light / heavy, reduced, small * large / (small + large)))
    depths = {}
    for wall in (False, True):
        modulus = _effective_moduli(contact, wall)[0]
        deepest = stability.hertz_overlap(
            heavy if wall else 0.5 * heavy, small if wall else 0.5 * small, modulus, speed
        )
        depths[wall] = overlap or min(deepest, contact.maximum_overlap * 2.0 * small)

    def linearised(mass: float, radius: float, wall: bool) -> stability.LinearContact:
        rough = ((contact.wall_friction or 0.0) if wall else contact.friction) > 0.0
        if contact.law == "linear_spring_dashpot":
            spring, across = contact.normal_stiffness or 0.0, contact.tangential_stiffness or 0.0
            result = stability.linear_contact(mass, spring, across, contact.restitution, rough)
        else:
            moduli = _effective_moduli(contact, wall)
            result = stability.hertz_mindlin_contact(
                mass, radius, *moduli, depths[wall], contact.restitution, rough
            )
        if contact.rolling_friction > 0.0 and contact.rolling_model == "epsd":
            result = _with_rolling_spring(result, contact, radius / small, mass)
        return result

    pairs = [(factor, linearised(mass, radius, wall=False)) for factor, mass, radius in kinds]
    thin = sum(
        not wraps and length <= 2.0 * large
        for wraps, length in zip(scene.periodic, scene.domain.size, strict=True)
    )
    walls = min(scene.dimension, scene.periodic.count(False) + len(scene.walls))
    return stability.contact_stability_limit(
        light,
        scene.dimension,
        pairs,
        linearised(light, small, wall=True),
        initial_count(scene) - 1,
        walls,
        thin,
    )


def _with_rolling_spring(
    contact: stability.LinearContact, settings: Contact, arm: float, mass: float
) -> stability.LinearContact:
    """With the spring of epsd, 9/4 (mu_r R*)^2 F_e/d, and its dashpot; `arm` is R* over the particle's radius."""
    secant = contact.normal * (2.0 / 3.0 if settings.law == "hertz_mindlin" else 1.0)
    spring = 2.25 * (settings.rolling_friction * arm) ** 2 * secant
    dashpot = 2.0 * settings.rolling_damping * math.sqrt(1.4 * mass * spring)
    return contact._replace(rolling=spring, rolling_damping=dashpot)


def _effective_moduli(contact: Contact, wall: bool) -> tuple[float, float]:
    """E* and G* of two particles, or of a particle and a wall [Pa]; see `jaxdem.particles.materials`."""

    def compliances(young: float, poisson: float) -> tuple[float, float]:
        return (1.0 - poisson**2) / young, 2.0 * (1.0 + poisson) * (2.0 - poisson) / young

    normal, shear = compliances(contact.young_modulus, contact.poisson_ratio)
    other = (normal, shear)
    if wall:
        young = contact.wall_young_modulus
        rigid = not isinstance(young, float)
        poisson = contact.poisson_ratio if contact.wall_poisson_ratio is None else contact.wall_poisson_ratio
        other = (0.0, 0.0) if rigid else compliances(float(young), poisson)  # type: ignore[arg-type]
    return 1.0 / (normal + other[0]), 1.0 / (shear + other[1])


def expected_speed(scene: Scene) -> float:
    """Largest speed to expect of particles [m/s]: boundary, initial velocities, a fall through the box."""
    contact, particles = scene.contact, scene.particles
    assert contact is not None and particles is not None
    if contact.speed != "auto":
        return contact.speed
    gravity = scene.domain.gravity or ()
    fall = math.sqrt(2.0 * sum(abs(g) * length for g, length in zip(gravity, scene.domain.size, strict=True)))
    given = rows_of("particles.velocity", particles.velocity, scene.dimension)
    fastest = 0.0 if given is None or len(given) == 0 else float(np.linalg.norm(given, axis=1).max())
    return max(boundary_speed(scene), fall, 2.0 * fastest, 1e-3)


def _contact_step(scene: Scene, limits: dict[str, float]) -> float:
    contact = scene.contact
    assert contact is not None
    limits["contact_automatic"] = min(
        0.2 * limits.get("rayleigh", math.inf),
        limits["contact_duration"] / 20.0,
        limits["contact_stability"],
    )
    if contact.time_step == "auto":
        return limits["contact_automatic"]
    stable = min(limits["contact_stability"], limits.get("rayleigh", math.inf))
    # The message gives four digits; the step that it names must be accepted.
    if contact.time_step > stable * (1.0 + 5e-4):
        raise InputError(
            "contact.time_step",
            contact.time_step,
            f"the stable step is {stable:.4g} s (2/omega_max {limits['contact_stability']:.4g} s, "
            f"Rayleigh {limits.get('rayleigh', math.inf):.4g} s)",
            f'set contact.time_step = "auto" ({limits["contact_automatic"]:.4g} s) or soften the contact',
        )
    return contact.time_step


def _whole(ratio: float) -> int:
    """The ratio rounded up to a whole number, unless it is one up to round-off."""
    return max(1, math.ceil(ratio - 1e-9 * max(ratio, 1.0)))

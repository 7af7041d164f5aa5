"""The time steps of a scene: the automatic ones chosen, the given ones checked. Host side, plain numbers."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from jaxdem.errors import InputError
from jaxdem.fluid.inlet import InletProfile, LinearTable, Parabola
from jaxdem.fluid.interval import SUBSTEPS, VISCOUS_LIMIT
from jaxdem.particles.materials import TANGENTIAL_SHARE
from jaxdem.scene import Contact, Scene
from jaxdem.scene.boundary import parabolic_axes
from jaxdem.scene.population import inlet_speed
from jaxdem.scene.rows import rows_of
from jaxdem.setup import stability
from jaxdem.setup.arrivals import arrivals
from jaxdem.setup.bodies import material_table, wall_materials
from jaxdem.setup.initial import initial_count, scene_bodies
from jaxdem.structure import TimeSteps

MOST_CONTACT_STEPS = 1_000_000
"""Contact steps in a coupling interval; more would run for minutes without a word, and for years in all."""

MOST_INTERVALS = 2**31 - 1
"""Coupling intervals of a run, which an integer of 32 bits counts."""

LONGEST_INTERVAL = 0.01
"""Longest automatic fluid step, and interval without a fluid [s]."""

AUTO_COURANT = 0.5
"""Courant number of the automatic fluid step at the largest boundary speed."""


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
        interval = _given_interval(scene) or min(output, LONGEST_INTERVAL)
    per_output = _whole(output / interval)
    if _given_interval(scene) is not None and abs(per_output * interval - output) > 1e-9 * output:
        raise InputError(
            "coupling.interval",
            interval,
            f"must divide time.output_interval = {output} s",
            f"use, for example, coupling.interval = {output / per_output:.6g}",
        )
    interval = simulated_time(output, 1, per_output)
    if outputs * per_output > MOST_INTERVALS:
        raise InputError(
            "time.end",
            scene.time.end,
            f"needs {outputs * per_output:.3g} coupling intervals of {interval:.3g} s, the limit is {MOST_INTERVALS}",
            "lower time.end, or raise the short step: coupling.interval, fluid.time_step, or its limit by fluid.viscosity",
        )
    count = 0
    if scene.particles is not None and scene.contact is not None:
        speed, overlap = _contact_limits(scene, limits)
        # The overlap grows with v^0.8 in Hertz's law and with v in the linear one.
        power = 1.0 if scene.contact.law == "linear_spring_dashpot" else 1.25
        speed_limit = speed * (scene.contact.maximum_overlap / overlap) ** power
        contact_step = _contact_step(scene, limits)
        if not contact_step * MOST_CONTACT_STEPS >= interval:
            raise InputError(
                "contact.time_step",
                scene.contact.time_step,
                f"makes contact steps of {contact_step:.3g} s, more than {MOST_CONTACT_STEPS} in a coupling interval "
                f"of {interval:.3g} s",
                "soften the contact, use larger particles, lower contact.speed, or shorten coupling.interval",
            )
        count = _whole(interval / contact_step)
        contact_step = interval / count
    return TimeSteps(interval, per_output, outputs, contact_step, count, substeps, limits, speed, overlap, speed_limit)


def simulated_time(output_interval: float, intervals: int, per_output: int) -> float:
    """The float next to n/m times the output interval as it is written, so that the third output of 0.05 s is at 0.15 s [s].

    Args:
        output_interval: of the scene [s].
        intervals: n, number of coupling intervals.
        per_output: m, coupling intervals from one output to the next.
    """
    return float(Fraction(repr(float(output_interval))) * Fraction(intervals, per_output))


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
        step = min(stability.courant_time(speed, spacing, AUTO_COURANT), limits["viscous"], output, LONGEST_INTERVAL)
    given = _given_interval(scene)
    if given is not None:
        return given, step
    if step > output * (1.0 + 1e-9):
        raise InputError(
            "fluid.time_step",
            step,
            f"must not exceed time.output_interval = {output} s",
            "lower the fluid step",
        )
    return output / _whole(output / step), step


def _given_interval(scene: Scene) -> float | None:
    """`coupling.interval` [s], None where it is automatic; refuses one that is longer than the time between outputs."""
    interval = "auto" if scene.coupling is None else scene.coupling.interval
    if interval == "auto":
        return None
    if interval > scene.time.output_interval * (1.0 + 1e-9):
        limit = f"must not exceed time.output_interval = {scene.time.output_interval} s"
        raise InputError("coupling.interval", interval, limit, "lower the interval")
    return interval


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
        whole = patch or all(b - a >= 2.0 * h for a, b, h in zip(side.from_ or (), side.to or (), others, strict=True))
        even = side.profile == "uniform" and isinstance(side.velocity, tuple)
        if side.kind == "inlet" and whole and even and scene.time.end >= (side.ramp_time or 0.0):
            rates.append(abs(side.velocity[axis]) / spacing[axis])  # type: ignore[index]
    allowed = SUBSTEPS[-1] * fluid.courant_limit / max(*rates, 1e-300)
    if interval > allowed * (1.0 + 5e-4):
        raise InputError(
            "coupling.interval" if _given_interval(scene) is not None else "fluid.time_step",
            interval,
            f"the fluid crosses {interval * max(rates):.3g} cells in this time; {SUBSTEPS[-1]} fluid steps with a Courant number "
            f"of {fluid.courant_limit} allow {SUBSTEPS[-1] * fluid.courant_limit:.3g}",
            f"set it to {allowed:.3g} or less, or use larger cells",
        )


def _contact_limits(scene: Scene, limits: dict[str, float]) -> tuple[float, float]:
    """Limits of the contact step [s], into `limits`; returns expected speed and overlap over diameter."""
    contact = scene.contact
    assert contact is not None
    speed = expected_speed(scene)
    bodies = _contact_bodies(scene)
    linear = contact.law == "linear_spring_dashpot"
    durations, overlaps = [], []
    for one, other in itertools.combinations_with_replacement(bodies, 2):
        if math.isinf(min(one.mass, other.mass)):
            continue  # two walls
        mass, radius = _effective(one.mass, other.mass), _effective(one.radius, other.radius)
        if linear:
            stiffness = contact.normal_stiffness or 0.0
            heaviest = max(body.mass for body in bodies if math.isfinite(body.mass))
            durations.append(stability.linear_duration(mass, stiffness, _least_damping(scene)))
            overlap = stability.linear_overlap(heaviest, stiffness, speed)
        else:
            modulus = _effective(one.modulus, other.modulus)
            durations.append(stability.hertz_duration(mass, radius, modulus, speed))
            overlap = stability.hertz_overlap(mass, radius, modulus, speed)
        overlaps.append((overlap / (2.0 * min(one.radius, other.radius)), one, other))
    if not linear:
        limits["rayleigh"] = min(
            stability.rayleigh_time(body.radius, body.density, body.young_modulus, body.poisson_ratio)
            for body in bodies
            if math.isfinite(body.mass)
        )
    limits["contact_duration"], limits["contact_stability"] = min(durations), contact_stability(scene, speed)
    relative, one, other = max(overlaps, key=lambda found: found[0])
    if relative > contact.maximum_overlap:
        soft = min(one, other, key=lambda body: body.young_modulus)
        raise InputError(
            "contact.normal_stiffness" if linear else soft.key,
            contact.normal_stiffness if linear else soft.young_modulus,
            f"an impact at {speed:.3g} m/s would overlap by {100 * relative:.3g} % of a diameter, "
            f"the limit is {100 * contact.maximum_overlap:.3g} %",
            "stiffen the contact, lower contact.speed, or raise contact.maximum_overlap",
        )
    return speed, relative


class _ContactBody(NamedTuple):
    """The smallest and lightest, or largest and heaviest, particle that there may be of a material; or a wall."""

    radius: float
    density: float
    mass: float
    young_modulus: float
    poisson_ratio: float
    key: str

    @property
    def modulus(self) -> float:
        """E / (1 - nu^2) [Pa]; two of them make E* as two masses make m*."""
        return self.young_modulus / (1.0 - self.poisson_ratio**2)


def _contact_bodies(scene: Scene) -> list[_ContactBody]:
    """The extremes of every material: among their pairs are the shortest contact and the deepest overlap."""
    contact, table = scene.contact, material_table(scene)
    assert contact is not None
    sizes = scene_bodies(scene)
    radius, density, material = np.broadcast_arrays(*sizes)
    found = []
    for number in np.unique(material):
        young, poisson, key = contact.young_modulus, contact.poisson_ratio, "contact.young_modulus"
        if table is not None:
            young, poisson = float(table.young_modulus[number]), float(table.poisson_ratio[number])
            key = f"materials.{number}.young_modulus"
        here = material == number
        extremes = {(float(f(radius[here])), float(f(density[here]))) for f in (np.min, np.max)}
        for r, rho in sorted(extremes):
            found.append(_ContactBody(r, rho, 4.0 / 3.0 * math.pi * r**3 * rho, young, poisson, key))
    if table is None:
        # Walls as hard as the particles, or harder, are left to the margins of step and overlap (15 % more than of a pair).
        soft, ratio = contact.of_walls("young_modulus"), contact.of_walls("poisson_ratio")
        if found and isinstance(soft, float):
            wall = _ContactBody(math.inf, math.inf, math.inf, soft, ratio, "contact.wall_young_modulus")
            if wall.modulus < found[0].modulus:
                found.append(wall)
        return found
    model_walls = wall_materials(scene, table, 1, 1 + 2 * len(scene.walls))
    for number in np.unique(model_walls):
        young, poisson = float(table.young_modulus[number]), float(table.poisson_ratio[number])
        wall = number == len(table.names) - 1
        key = "contact.wall_young_modulus" if wall else f"materials.{number}.young_modulus"
        found.append(_ContactBody(math.inf, math.inf, math.inf, young, poisson, key))
    return found


def _effective(a: float, b: float) -> float:
    """1 / (1/a + 1/b); half of two equal numbers, exactly."""
    return 0.5 * a if a == b else 1.0 / (1.0 / a + 1.0 / b)


def _least_damping(scene: Scene) -> float:
    """Damping ratio of the pair with the highest restitution, whose contacts are the shortest [-]."""
    table = material_table(scene)
    assert scene.contact is not None
    restitution = scene.contact.restitution if table is None else float(table.restitution.max())
    return stability.damping_ratio(restitution)


def contact_stability(scene: Scene, speed: float, overlap: float | None = None) -> float:
    """Stability limit of the contact step for this scene's materials, sizes and walls [s].

    Every contact that a particle has room for is taken to be as deep as an impact of the heaviest particle at
    `speed`, on the lightest, makes it, up to `contact.maximum_overlap`; with several materials, of the stiffest and
    most damped pair there is.

    Args:
        scene: with particles.
        speed: largest to expect [m/s].
        overlap: of all contacts in place of the expected one [m].
    """
    contact = scene.contact
    assert contact is not None and scene.particles is not None
    bodies = [body for body in _contact_bodies(scene) if math.isfinite(body.mass)]
    small, large = min(body.radius for body in bodies), max(body.radius for body in bodies)
    light, heavy = min(body.mass for body in bodies), max(body.mass for body in bodies)
    # Light particles touch each other and heavy ones. These move less: their factor 1 + q is such that the bound
    # over a heavy particle's contacts, of which it has more, is the same.
    more = (0.5 * (1.0 + large / small)) ** (scene.dimension - 1)
    kinds = [(2.0, 0.5 * light, 0.5 * small)]
    if heavy > light:
        reduced = light * heavy / (light + heavy)
        kinds.append((1.0 + more * light / heavy, reduced, small * large / (small + large)))
    worst = {wall: _worst_constants(scene, wall) for wall in (False, True)}
    depths = {}
    for wall in (False, True):
        deepest = stability.hertz_overlap(
            heavy if wall else 0.5 * heavy, small if wall else 0.5 * small, worst[wall].modulus, speed
        )
        depths[wall] = overlap or min(deepest, contact.maximum_overlap * 2.0 * small)

    def linearised(mass: float, radius: float, wall: bool) -> stability.LinearContact:
        constants = worst[wall]
        if contact.law == "linear_spring_dashpot":
            spring, across = contact.normal_stiffness or 0.0, contact.tangential_stiffness
            across = TANGENTIAL_SHARE * spring if across is None else across
            result = stability.linear_contact(mass, spring, across, constants.restitution, constants.rough)
        else:
            result = stability.hertz_mindlin_contact(
                mass,
                radius,
                constants.modulus,
                constants.shear_modulus,
                depths[wall],
                constants.restitution,
                constants.rough,
            )
        if constants.rolling_friction > 0.0 and contact.rolling_model == "epsd":
            result = _with_rolling_spring(result, contact, constants.rolling_friction, radius / small, mass)
        return result

    pairs = [(factor, linearised(mass, radius, wall=False)) for factor, mass, radius in kinds]
    thin = sum(
        not wraps and length <= 2.0 * large for wraps, length in zip(scene.periodic, scene.domain.size, strict=True)
    )
    walls = min(scene.dimension, scene.periodic.count(False) + len(scene.walls))
    return stability.contact_stability_limit(
        light,
        scene.dimension,
        pairs,
        linearised(light, small, wall=True),
        _row_count(scene) - 1,
        walls,
        thin,
    )


def _row_count(scene: Scene) -> int:
    """Number of particles that a scene ever has."""
    return initial_count(scene) + sum(len(arrival.time) for arrival in arrivals(scene))


def _with_rolling_spring(
    contact: stability.LinearContact, settings: Contact, friction: float, arm: float, mass: float
) -> stability.LinearContact:
    """With the spring of epsd, 9/4 (mu_r R*)^2 F_e/d, and its dashpot; `arm` is R* over the particle's radius."""
    secant = contact.normal * (2.0 / 3.0 if settings.law == "hertz_mindlin" else 1.0)
    spring = 2.25 * (friction * arm) ** 2 * secant
    dashpot = 2.0 * settings.rolling_damping * math.sqrt(1.4 * mass * spring)
    return contact._replace(rolling=spring, rolling_damping=dashpot)


class _Constants(NamedTuple):
    """E*, G* [Pa], restitution, whether there is friction, rolling friction."""

    modulus: float
    shear_modulus: float
    restitution: float
    rough: bool
    rolling_friction: float


def _worst_constants(scene: Scene, wall: bool) -> _Constants:
    """Of contacts between particles, or with walls: the largest moduli and friction, and the least restitution."""
    contact, table = scene.contact, material_table(scene)
    assert contact is not None

    def compliances(young: float, poisson: float) -> tuple[float, float]:
        return (1.0 - poisson**2) / young, 2.0 * (1.0 + poisson) * (2.0 - poisson) / young

    if table is None:
        own = compliances(contact.young_modulus, contact.poisson_ratio)
        other = own
        if wall:
            young, poisson = contact.of_walls("young_modulus"), contact.of_walls("poisson_ratio")
            other = compliances(young, poisson) if isinstance(young, float) else (0.0, 0.0)
        friction = contact.of_walls("friction") if wall else contact.friction
        return _Constants(
            1.0 / (own[0] + other[0]),
            1.0 / (own[1] + other[1]),
            contact.restitution,
            friction > 0.0,
            contact.rolling_friction,
        )
    particles = np.unique(np.atleast_1d(scene_bodies(scene).material))
    walls = np.unique(wall_materials(scene, table, 1, 1 + 2 * len(scene.walls)))
    found = []
    for one, other_ in itertools.product(particles, walls if wall else particles):
        first, second = (
            compliances(float(table.young_modulus[k]), float(table.poisson_ratio[k])) for k in (one, other_)
        )
        k = table.pair[one, other_]
        found.append(
            _Constants(
                1.0 / (first[0] + second[0]),
                1.0 / (first[1] + second[1]),
                float(table.restitution[k]),
                bool(table.friction[k] > 0.0),
                float(table.rolling_friction[k]),
            )
        )
    moduli, shears, restitutions, rough, rolling = zip(*found, strict=True)
    return _Constants(max(moduli), max(shears), min(restitutions), any(rough), max(rolling))


def expected_speed(scene: Scene) -> float:
    """Largest speed to expect of particles [m/s]: boundary, initial velocities, a fall through the box."""
    contact, particles = scene.contact, scene.particles
    assert contact is not None and particles is not None
    if contact.speed != "auto":
        return contact.speed
    gravity = scene.domain.gravity or ()
    fall = math.sqrt(2.0 * sum(abs(g) * length for g, length in zip(gravity, scene.domain.size, strict=True)))
    given = rows_of("particles.velocity", particles.velocity, scene.dimension, of_frame=True)
    fastest = 0.0 if given is None or len(given) == 0 else float(np.linalg.norm(given, axis=1).max())
    fastest = max(fastest, inlet_speed(particles))
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

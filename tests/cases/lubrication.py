"""Lubrication against closed forms: the force in a gap, impacts through a liquid, friction by the Sommerfeld number."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxdem
from jaxdem.particles.contact_pair import ContactLoad, ContactPair, on_bodies
from jaxdem.particles.film_load import film_load
from jaxdem.particles.lubrication import Lubrication, LubricationConstants, wet_friction
from tests.cases.energy import BOX, MASS, RADIUS, balance_of, ball_on_wall, with_tables
from tests.cases.registry import Figure, absolute, at_least, below, case, relative

LIQUID: dict[str, float] = {"cutoff": 1e-4, "roughness": 1e-6, "viscosity": 1e-3}
DATA = Path(__file__).parents[1] / "data"

DRY = 0.97
"""Restitution of steel and glass in air, as in Gondret et al."""


SPEED = 0.2
"""Of the balls that meet the bottom [m/s]."""


def viscosity_of(number: float) -> float:
    """At which St = m v / (6 pi mu R^2), the same as rho d v / (9 mu), has a value at `SPEED` [Pa s]."""
    return MASS * SPEED / (6.0 * math.pi * number * RADIUS**2)


def wet_impact(**liquid: float) -> dict[str, Any]:
    """A ball that meets the bottom through a liquid, without gravity."""
    end = 8e-3  # those that stay have come to rest
    given = {"young_modulus": 1e8, "restitution": DRY, "friction": 0.0, "time_step": 1e-6}
    return with_tables(
        ball_on_wall((0.0, SPEED), **given, lubrication=LIQUID | liquid),
        particles={"position": [[0.01, RADIUS + 1.5 * LIQUID["cutoff"]]]},
        time={"end": end, "output_interval": end},
    )


@functools.cache
def _rebound() -> Any:
    """Compiled: rebound over impact speed, for viscosities (B,) and heights of bumps (B,)."""
    scene = jaxdem.load_scene(wet_impact())
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)

    def one(viscosity: Any, roughness: Any) -> Any:
        film = parameters.contact.lubrication._replace(viscosity=viscosity, roughness=roughness)
        own = parameters._replace(contact=parameters.contact._replace(lubrication=film))
        return simulation.step(own, state, neighbors)[0].particles.velocity[0, 1] / SPEED

    return jax.jit(jax.vmap(one))


def rebounds(numbers: Sequence[float], roughness: float = LIQUID["roughness"]) -> np.ndarray:
    """Rebound over impact speed at Stokes numbers [-]."""
    viscosity = jnp.asarray([viscosity_of(number) for number in numbers])
    return np.asarray(_rebound()(viscosity, jnp.full(len(numbers), roughness)))


@case("lubrication: 6 pi mu R*^2 v / h", "contact", "Brenner 1961; Costa et al. 2015", tested=True)
def force() -> list[Figure]:
    """In the gap, within the roughness, in contact and beyond the cut-off; the mean over a step that is long."""
    film, constants = Lubrication(), LubricationConstants(*(jnp.asarray(LIQUID[k]) for k in
                                                            ("viscosity", "roughness", "cutoff")))  # fmt: skip
    radius, unit = jnp.asarray(5e-4), 6.0 * math.pi * LIQUID["viscosity"] * 5e-4**2

    of_gap = jax.jit(lambda gap, speed, step: film.damping(-gap, speed, radius, step, constants))

    def damping(gap: float, speed: float, step: float) -> float:
        return float(of_gap(gap, speed, step))

    gaps = np.array([2e-6, 3e-5, 9.9e-5])
    slow = [damping(gap, 1e-3, 1e-7) for gap in gaps]
    # From 5e-5 m to contact in one step: the roughness counts 1, the rest its logarithm.
    swept = (1.0 + math.log(5e-5 / LIQUID["roughness"])) / 5e-5
    return [
        below("in the gap", np.max(np.abs(np.array(slow) * gaps / unit - 1.0)), 1e-6),
        relative("within the roughness", unit / LIQUID["roughness"], damping(4e-7, 1e-3, 1e-7), 1e-12, "N s/m"),
        below("in contact", damping(-1e-7, 1e-3, 1e-7), 0.0, "N s/m"),
        below("beyond the cut-off", damping(1.01e-4, 1e-3, 1e-7), 0.0, "N s/m"),
        relative("mean over a long step", unit * swept, damping(2.5e-5, 1.0, 5e-5), 1e-12, "N s/m"),
    ]


def _sheared(pair: ContactPair) -> tuple[Any, Any, Any]:
    """Force on the one of two bodies, and torque on either, by the film between them (`LIQUID`)."""
    constants = LubricationConstants(*(jnp.asarray(LIQUID[k]) for k in ("viscosity", "roughness", "cutoff")))
    step: Any = SimpleNamespace(model=SimpleNamespace(lubrication=Lubrication()), time_step=jnp.asarray(1e-12))
    film = film_load(step, SimpleNamespace(lubrication=constants), pair)  # type: ignore[arg-type]
    return on_bodies(ContactLoad(film.along, film.across, film.resistance, ()), pair)


_sheared_jit = jax.jit(_sheared)


def sheared(
    radii: tuple[float, float | None], gap: float, normal: Any, velocity: Any, spins: tuple[Any, Any]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same of bodies that move like this; a second radius of None is a plane, whose spin is the second one.

    Args:
        radii: of both [m].
        gap: between them [m].
        normal: (D,) unit vector to the first.
        velocity: (D,) of the first against the second [m/s]; of a plane at the place of the contact.
        spins: (A,) each [rad/s].
    """
    one, other = radii

    def vector(values: Any) -> tuple[Any, ...]:
        return tuple(jnp.full((1,), x) for x in values)

    first, second = jnp.full((1,), one), jnp.zeros((1,)) if other is None else jnp.full((1,), other)
    effective = one if other is None else one * other / (one + other)
    plane = other is None
    pair = ContactPair(
        jnp.full((1,), -gap), vector(normal), vector(velocity), vector(velocity), vector(spins[0]),
        None if plane else vector(spins[1]), first, second, jnp.full((1,), effective), first, first,
        vector(spins[1]) if plane else None,
    )  # fmt: skip
    force, torque, opposite = _sheared_jit(pair)
    found = (np.array([float(x[0]) for x in part]) for part in (force, torque, opposite))
    return next(found), next(found), next(found)


@case("lubrication: sliding and rolling", "contact", "Jeffrey & Onishi 1984; Goldman et al. 1967")
def shear() -> list[Figure]:
    """The terms with ln(1/h) of two spheres and of one at a plane; what they must not do; in space and in the plane.

    Of two spheres with radii a and b = k a, all over mu ln(1/h): 6 pi a 4 k (2 + k + 2 k^2)/(15 (1 + k)^3) is force
    over velocity, 4 pi a^2 k (4 + k)/(5 (1 + k)^2) torque over velocity and force over spin, 16 pi a^3 k/(5 (1 + k))
    torque over the own spin and 4 pi a^3 k^2/(5 (1 + k)) over that of the other.
    """
    generator, a, viscosity = np.random.default_rng(3), 1e-2, LIQUID["viscosity"]
    largest, turning, moment, power = 0.0, 0.0, 0.0, math.inf
    for ratio in (1.0, 0.3, 4.0, 30.0):
        b, gap = ratio * a, 2e-6
        normal = generator.normal(size=3)
        normal /= np.linalg.norm(normal)
        velocity, *spins = generator.normal(size=(3, 3)) * np.array([[0.1], [100.0], [100.0]])
        velocity -= normal * (velocity @ normal)
        spins[1] /= ratio
        force, *torques = sheared((a, b), gap, normal, velocity, (spins[0], spins[1]))

        def twist(k: float, r: float) -> float:
            return 4.0 * math.pi * r**2 * k * (4.0 + k) / (5.0 * (1.0 + k) ** 2)

        def own(k: float, r: float) -> float:
            return 16.0 * math.pi * r**3 * k / (5.0 * (1.0 + k))

        log = viscosity * math.log(min(a, b) / gap)
        slide = 8.0 * math.pi * a * ratio * (2.0 + ratio + 2.0 * ratio**2) / (5.0 * (1.0 + ratio) ** 3)
        twists, other = (
            (twist(ratio, a), twist(1.0 / ratio, b)),
            4.0 * math.pi * a**3 * ratio**2 / (5.0 * (1.0 + ratio)),
        )
        flat = [spin - normal * (spin @ normal) for spin in spins]
        wanted = log * (-slide * velocity + sum(k * np.cross(w, normal) for k, w in zip(twists, flat, strict=True)))
        largest = max(largest, np.linalg.norm(force - wanted) / np.linalg.norm(wanted))
        owns = own(ratio, a), own(1.0 / ratio, b)
        for k in (0, 1):
            wanted = log * (twists[k] * np.cross(normal, velocity) - owns[k] * flat[k] - other * flat[1 - k])
            largest = max(largest, np.linalg.norm(torques[k] - wanted) / np.linalg.norm(wanted))
        total = torques[0] + torques[1] + (a + b + gap) * np.cross(normal, force)
        moment = max(moment, np.linalg.norm(total) / np.linalg.norm(torques[0]))
        power = min(power, -(force @ velocity + torques[0] @ spins[0] + torques[1] @ spins[1]))
        # The pair turns as one body.
        spin = generator.normal(size=3)
        as_one = sheared((a, b), gap, normal, np.cross(spin, (a + b + gap) * normal), (spin, spin))
        turning = max(turning, np.linalg.norm(as_one[0]) / (log * a**2 * np.linalg.norm(spin)))
    return [
        below("two spheres in space, ratios 0.3 to 30: off by", largest, 1e-3),
        below("sum of the torques about a point", moment, 1e-12),
        below("two spheres that turn as one body: force", turning, 1e-9),
        at_least("power that the film takes", 0.0, power),
        *_at_a_plane(viscosity),
    ]


def _at_a_plane(viscosity: float) -> list[Figure]:
    """Sphere at a plane: 8/15, 2/15 and 2/5 of 6 pi mu a U, 6 pi mu a^2 W and 8 pi mu a^3 W, times ln(a/h)."""
    a, gap = 1e-3, 1.5e-6
    log = viscosity * math.log(a / gap)
    figures = []
    for name, normal, along, axis in (
        ("in space", (0.0, 0.0, 1.0), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])),
        ("in the plane", (0.0, 1.0), np.array([1.0, 0.0]), np.array([-1.0])),
    ):  # a spin about `axis` makes the sphere roll `along`
        still = 0.0 * axis
        force, torque, _ = sheared((a, None), gap, normal, 0.3 * along, (still, still))
        turned, turning, _ = sheared((a, None), gap, normal, 0.0 * along, (7.0 * axis, still))
        as_one = sheared((a, None), gap, normal, 7.0 * (a + 0.5 * gap) * along, (7.0 * axis, 7.0 * axis))
        unit = math.pi * log
        figures += [
            relative(f"{name}: force of sliding", -6.0 * unit * a * 8.0 / 15.0 * 0.3, force @ along, 2e-3, "N"),
            relative(f"{name}: torque of sliding", 8.0 * unit * a**2 / 10.0 * 0.3, torque @ axis, 2e-3, "N m"),
            relative(f"{name}: force of turning", 6.0 * unit * a**2 * 2.0 / 15.0 * 7.0, turned @ along, 5e-3, "N"),
            relative(f"{name}: torque of turning", -8.0 * unit * a**3 * 2.0 / 5.0 * 7.0, turning @ axis, 3e-3, "N m"),
            below(f"{name}: it turns with the plane", np.linalg.norm(as_one[0]) / np.linalg.norm(force), 1e-12),
        ]
    return figures


@case("lubrication: a sphere that slides over a film", "contact", "m U' = F, 2/5 m a^2 W' = T")
def slides() -> list[Figure]:
    """A sphere within the roughness of the floor, without gravity: U and W decay to rest, in 2-D and in 3-D."""
    gap, speed, end = 5e-7, 0.1, 5e-3
    viscosity = 0.05
    unit = math.pi * viscosity * RADIUS * math.log(RADIUS / LIQUID["roughness"]) / MASS
    # Of U and a W, W about the axis that makes it roll forwards.
    rates = np.array([[-3.2, 0.8], [2.0, -8.0]]) * unit
    values, vectors = np.linalg.eig(rates)
    wanted = (vectors @ (np.exp(values * end) * np.linalg.solve(vectors, [speed, 0.0]))).real
    figures = []
    for dimension in (2, 3):
        place, sides = [0.01] * dimension, ("left", "right", "front", "back")[: 2 * dimension - 2]
        place[-1] = RADIUS + gap
        tables = with_tables(
            BOX,
            domain={"size": [0.02] * dimension, "gravity": [0.0] * dimension},
            particles={
                "position": [place], "velocity": [[speed] + [0.0] * (dimension - 1)],
                "angular_velocity": [[0.0] * (1 if dimension == 2 else 3)],
            },
            contact={"young_modulus": 1e6, "time_step": 5e-6, "lubrication": LIQUID | {"viscosity": viscosity}},
            boundary={side: {"kind": "periodic"} for side in sides},
            time={"end": end, "output_interval": end},
        )  # fmt: skip
        scene = jaxdem.load_scene(tables)
        simulation, parameters = jaxdem.build(scene)
        given = jaxdem.initial_state(scene, simulation, parameters)
        particles = jax.jit(simulation.step)(parameters, *given)[0].particles
        spin = -particles.angular_velocity[0, 0] if dimension == 2 else particles.angular_velocity[0, 1]
        figures += [
            relative(f"{dimension}-D: speed", wanted[0], float(particles.velocity[0, 0]), 3e-3, "m/s"),
            relative(f"{dimension}-D: speed of the surface", wanted[1], RADIUS * float(spin), 3e-3, "m/s"),
        ]
    return figures


NUMBERS = (15.0, 20.0, 30.0, 60.0, 100.0, 300.0, 1000.0)
"""Stokes numbers of impacts after which the ball leaves."""


@case("lubrication: impacts through a liquid", "contact", "e - (1 + e) L / St, L = 1 + ln(cutoff/roughness)")
def impacts() -> list[Figure]:
    """Restitution of a ball at a wall, and what the liquid takes."""
    length = 1.0 + math.log(LIQUID["cutoff"] / LIQUID["roughness"])
    figures = [
        absolute(f"restitution at St = {number:g}", DRY - (1.0 + DRY) * length / number, found, 5e-4)
        for number, found in zip(NUMBERS, rebounds(NUMBERS), strict=True)
    ]
    number = 30.0
    lost = SPEED * length / number
    inside = SPEED - lost
    taken = 0.5 * MASS * (SPEED**2 - inside**2 + (DRY * inside) ** 2 - (DRY * inside - lost) ** 2)
    found = balance_of(wet_impact(viscosity=viscosity_of(number)))["dissipated"]
    return [*figures, relative("energy that the liquid takes", taken, found["liquid"], 1e-3, "J")]


CRITICAL = 10.0
"""Gondret, Lance & Petit 2002: below about this Stokes number balls do not rebound."""


@case("lubrication: wet restitution over the Stokes number", "contact", "Gondret et al. 2002")
def gondret() -> list[Figure]:
    """Bumps of 2e-4 to 2e-3 of the radius, the film from a tenth of it: the scatter is that of the roughness.

    The critical number of a closed form is (1 + 1/e) (1 + ln(cutoff/roughness)): 14.6 and 10.0.
    """
    figures = []
    numbers = [5.0, 8.0, 20.0, 30.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0]
    for part in (2e-4, 2e-3):
        found = rebounds(numbers, part * RADIUS) / DRY
        # The line through St = 20 and 30 over 1/St, to where it is zero.
        slope = (found[3] - found[2]) / (1.0 / numbers[2] - 1.0 / numbers[3])
        critical = slope / (found[3] + slope / numbers[3])
        figures += [
            absolute(f"critical Stokes number, bumps of {part:g} R", CRITICAL, critical, 5.0),
            below(f"rebound at St = 5 and 8, bumps of {part:g} R", np.max(np.abs(found[:2])), 0.01),
            absolute(f"restitution over that of a dry impact at St = 2000, bumps of {part:g} R", 1.0, found[-1], 0.05),
            below("largest fall while the Stokes number rises", np.max(-np.diff(found[2:]), initial=0.0), 0.0),
        ]
    return figures


BALL = {"diameter": 3e-3, "density": 7800.0, "viscosity": 0.01}
"""Of the steel ball and the silicone oil of `gondret_st152.csv`."""

BOUNCES = ((7, 8), (49, 50), (72, 73), (84, 85))
"""Last line before and first line after each impact."""


def measured_bounces() -> list[tuple[float, float]]:
    """Stokes number and restitution of four impacts, by parabolas through the four points on either side of each; the
    first impact is at the terminal speed, a straight line."""
    time, height = np.loadtxt(DATA / "gondret_st152.csv", delimiter=",", skiprows=2).T
    found = []
    for number, (last, first) in enumerate(BOUNCES):
        before, after = slice(last - 3, last + 1), slice(first, first + 4)
        fall = np.polyfit(time[before], height[before], 2 if number else 1)
        rise = np.polyfit(time[after], height[after], 2)
        roots = np.roots(fall).real
        touch = roots[np.argmin(np.abs(roots - time[last]))]
        speed, back = -np.polyval(np.polyder(fall), touch), np.polyval(np.polyder(rise), touch)
        stokes = BALL["density"] * BALL["diameter"] * speed / (9.0 * BALL["viscosity"])
        found.append((float(stokes), float(back / speed)))
    return found


@case("lubrication: a steel ball that bounces in oil", "contact", "measured by Gondret et al. 2002")
def bounces() -> list[Figure]:
    """Four impacts of one ball, St = 153 to 23, bumps of 2e-4 R: scatter 0.2 in the restitution.

    The model has the film alone. The liquid around, which is accelerated too, takes more where the ball leaves fast;
    without the film the restitution would be 0.97 at all of them, which is off by 0.65 at the last.
    """
    measured = measured_bounces()
    numbers = [number for number, _ in measured]
    found = rebounds([*numbers, *[1000.0] * 6], 2e-4 * RADIUS)
    figures = [
        absolute(f"restitution at St = {number:.0f}", own, float(ours), 0.2)
        for (number, own), ours in zip(measured, found, strict=False)
    ]
    dry = abs(DRY - measured[-1][1])
    return [*figures, at_least("off without the film at the last impact", 0.5, dry)]


@case("friction by the Sommerfeld number", "contact", "Fernandez et al. 2013, Bo & Pavelescu 1982", tested=True)
def friction() -> list[Figure]:
    """The coefficient, and a ball that slides on a plane: its slip falls at 7/2 mu g until it rolls."""
    dry, wet, scale, viscosity = 0.4, 0.05, 1e-3, 1e-2
    liquid = LIQUID | {"viscosity": viscosity, "wet_friction": wet, "sommerfeld_number": scale}
    constants = LubricationConstants(
        *(jnp.asarray(liquid[k]) for k in ("viscosity", "roughness", "cutoff", "wet_friction", "sommerfeld_number"))
    )

    wetted = jax.jit(wet_friction)

    def coefficient(number: float) -> float:
        normal, radius = 1e-4, 5e-4
        slip = number * normal / (viscosity * radius)
        return float(wetted(dry, normal, slip, radius, constants))

    gravity, speed, end = 9.81, 1.0, 5e-3
    held = MASS * gravity  # the ball lies on the plane
    depth = (0.75 * held / (1e7 / (2.0 * (1.0 - 0.09)) * math.sqrt(RADIUS))) ** (2.0 / 3.0)
    tables = with_tables(
        BOX,
        domain={"size": [0.04, 0.02], "gravity": [0.0, -gravity]},
        particles={"position": [[0.01, RADIUS - depth]], "velocity": [[speed, 0.0]], "angular_velocity": [[0.0]]},
        contact={"young_modulus": 1e7, "restitution": 0.3, "friction": dry, "time_step": 1e-6, "lubrication": liquid},
        time={"end": end, "output_interval": end},
    )

    # d slip / dt = -7/2 mu(slip) g by a fine step of Runge and Kutta.
    def rate(slip: float) -> float:
        return -3.5 * gravity * (wet + (dry - wet) * math.exp(-viscosity * slip * RADIUS / held / scale))

    slip, steps = speed, 2000
    for _ in range(steps):
        h = end / steps
        slip += h * rate(slip + 0.5 * h * rate(slip))
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    given = jaxdem.initial_state(scene, simulation, parameters)
    particles = jax.jit(simulation.step)(parameters, *given)[0].particles
    found = float(particles.velocity[0, 0]) + RADIUS * float(particles.angular_velocity[0, 0])
    back = float(particles.velocity[0, 0]) - RADIUS * float(particles.angular_velocity[0, 0])
    found = found if abs(found - slip) < abs(back - slip) else back  # the sign of a spin in the plane
    return [
        relative("slow: dry", dry, coefficient(1e-3 * scale), 1e-3),
        relative("at the scale", wet + (dry - wet) / math.e, coefficient(scale), 1e-12),
        relative("fast: wet", wet, coefficient(30.0 * scale), 1e-6),
        relative("slip of a ball", speed - slip, speed - found, 1e-2, "m/s"),
    ]

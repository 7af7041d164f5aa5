"""Lubrication against closed forms: the force in a gap, impacts through a liquid, friction by the Sommerfeld number."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxdem
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

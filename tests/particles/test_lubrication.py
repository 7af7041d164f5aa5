"""Lubrication in scenes: what is refused, the fluid's viscosity, space and walls, gradients, limits.

Forces, impacts and friction against closed forms are cases, `tests/cases/lubrication.py`, which
tests/physics/test_contact_cases.py runs. That a run with a liquid is resumed bit for bit is in `test_energy.py`, that
meshes act as planes in `test_gaps_at_meshes.py`.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
import pytest

import jaxdem
from jaxdem.check.check import check_scene
from jaxdem.errors import InputError
from jaxdem.particles.loop import contact_interval
from jaxdem.particles.materials import surroundings
from tests.cases.energy import BOX, DENSITY, MASS, RADIUS, balance_of, in_space, tilted, with_tables

FILM = {"cutoff": 2e-4, "roughness": 2e-6, "viscosity": 2e-3}
WET = FILM | {"wet_friction": 0.05, "sommerfeld_number": 1e-3}
GRAINS = with_tables(BOX, contact={"time_step": 5e-6, "lubrication": FILM})


def film(**changes):
    table = {key: value for key, value in (FILM | changes).items() if value is not None}
    return with_tables(GRAINS, contact={"lubrication": table})


WRONG = {
    "a cutoff within the roughness": (film(cutoff=1e-6), "contact.lubrication.cutoff", "larger than roughness"),
    "a wide gap": (film(cutoff=6e-4), "contact.lubrication.cutoff", "half of the smallest radius"),
    "a gap that is wide for a member": (
        with_tables(film(cutoff=2e-4), contact={"time_step": 1e-6}, particles={"shape": "bent", "shapes": [
            {"name": "bent", "centres": [[0.0, 0.0], [1.0, 0.0]], "radii": [1.0, 0.3]}]}),
        "contact.lubrication.cutoff", "half of the smallest radius"),
    "no viscosity": (film(viscosity=None), "contact.lubrication.viscosity", "without \\[fluid\\]"),
    "half of a friction": (film(wet_friction=0.1), "contact.lubrication.sommerfeld_number", "wet_friction"),
    "parcels": (with_tables(GRAINS, particles={"coarse_grain": 2.0}), "contact.lubrication", "parcels"),
    "bridges": (with_tables(GRAINS, contact={"cohesion": {"kind": "capillary", "surface_tension": 0.07,
                                                         "liquid_content": 0.01}}), "contact.lubrication", "bridges"),
    "a step that is too long": (with_tables(film(viscosity=50.0), contact={"time_step": 2e-6}), "contact.time_step",
                                "stable step"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_work_is_refused(name):
    tables, key, words = WRONG[name]
    with pytest.raises(InputError, match=words) as found:
        jaxdem.build(jaxdem.load_scene(tables))
    assert found.value.key == key


def test_limits_reach_and_check():
    """The liquid at a wall stops a grain in m h / (6 pi mu R^2); the list reaches as far as the film."""
    report = check_scene(jaxdem.load_scene(GRAINS))
    stops = MASS * FILM["roughness"] / (6.0 * math.pi * FILM["viscosity"] * RADIUS**2)
    assert report.limits["contact_lubrication"] == pytest.approx(stops, rel=1e-12)
    assert "lubrication" in report.compiled_in
    thick = check_scene(jaxdem.load_scene(with_tables(film(viscosity=5.0), contact={"time_step": "auto"})))
    assert thick.limits["contact_stability"] < 0.1 * report.limits["contact_stability"]
    assert thick.time_steps["contact"] <= thick.limits["contact_lubrication"]
    simulation = jaxdem.build(jaxdem.load_scene(GRAINS))[0]
    assert simulation.search.geometry.cutoff == pytest.approx(2.0 * RADIUS + FILM["cutoff"], rel=1e-12)


def test_the_viscosity_of_the_fluid_is_that_of_the_film():
    """Of kinematic 2e-6 m2/s and 1000 kg/m3; a grain nears a wall, and the derivative by the viscosity is the slope."""
    tables = with_tables(film(viscosity=None), fluid={"cells": [4, 4], "density": 1000.0, "viscosity": 2e-6},
                         output={"energy": False}, contact={"time_step": "auto"})  # fmt: skip
    parameters = jaxdem.build(jaxdem.load_scene(tables))[1]
    assert float(parameters.materials.lubrication.viscosity) == pytest.approx(2e-3, rel=1e-12)
    slope = jax.grad(lambda nu: parameters._replace(fluid=parameters.fluid._replace(viscosity=nu))
                     .materials.lubrication.viscosity)(parameters.fluid.viscosity)  # fmt: skip
    assert float(slope) == pytest.approx(1000.0, rel=1e-12)


ALL = with_tables(
    in_space(GRAINS), contact={"lubrication": WET, "time_step": 4e-7, "rolling_friction": 0.1},
    walls=[tilted(point=[0.0135, 0.0, 0.0], normal=[-1.0, 0.0, 0.2])],
)  # fmt: skip


def test_a_closed_box_with_a_liquid_keeps_its_energy_in_space():
    found = balance_of(ALL)
    turned_over = found["gained"] / found["gained_relative"]
    assert abs(found["gained_relative"]) < 1e-6
    assert abs(found["missing"]) < 1e-11 * turned_over
    assert found["dissipated"]["liquid"] > 1e-2 * turned_over


def test_what_sliding_and_rolling_take_is_told_as_taken_by_the_liquid():
    """Two grains of different sizes that pass each other in a gap and do not touch; without shear nothing is taken."""
    passing = with_tables(
        GRAINS,
        domain={"gravity": [0.0, 0.0]},
        boundary={side: {"kind": "periodic"} for side in ("left", "right", "bottom", "top")},
        particles={"position": [[0.01, 0.01], [0.01, 0.01 + 1.6 * RADIUS + 5e-5]], "radius": [RADIUS, 0.6 * RADIUS],
                   "velocity": [[0.02, 0.0], [-0.03, 0.0]], "angular_velocity": [[5.0], [-20.0]]},
        time={"end": 4e-4, "output_interval": 4e-4},
    )  # fmt: skip
    found = balance_of(passing)
    before, after = (found[when]["translation"] + found[when]["rotation"] for when in ("start", "end"))
    lost, dissipated = before - after, found["dissipated"]
    assert lost > 1e-3 * before
    assert dissipated["liquid"] == pytest.approx(lost, rel=1e-9)
    assert all(abs(part) < 1e-9 * lost for name, part in dissipated.items() if name != "liquid")
    along = balance_of(with_tables(passing, contact={"lubrication": FILM | {"shear": False}}))
    assert along["dissipated"]["liquid"] < 0.1 * lost


def test_gradients_of_an_approach():
    """Two grains that near each other in a liquid: what is left of their speed, and its derivative in reverse mode."""
    gap, speed, step, steps = 1e-4, 0.2, 5e-6, 60
    tables = with_tables(
        GRAINS,
        domain={"gravity": [0.0, 0.0]},
        boundary={side: {"kind": "periodic"} for side in ("left", "right", "bottom", "top")},
        particles={"position": [[0.009, 0.01], [0.011 + gap, 0.01]], "velocity": [[speed, 0.0], [0.0, 0.0]],
                   "angular_velocity": [[0.0], [0.0]]},
        output={"energy": False},
    )  # fmt: skip
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    interval = dataclasses.replace(simulation.contact, search=None, steps=steps, reversible=True)

    def closing(viscosity):
        liquid = parameters.contact.lubrication._replace(viscosity=viscosity)
        around = surroundings(parameters.contact._replace(lubrication=liquid), ())
        none = jnp.zeros_like(state.particles.velocity)
        given = around, parameters.bodies, state.particles, neighbors, none, jnp.asarray(step)
        particles = contact_interval(interval, *given)[0]
        return particles.velocity[0, 0] - particles.velocity[1, 0], particles.position[1, 0] - particles.position[0, 0]

    @jax.jit
    def both(viscosity):
        (speed, distance), pull = jax.vjp(closing, viscosity)
        return speed, distance, pull((jnp.ones(()), jnp.zeros(())))[0]

    found, distance, slope = both(parameters.contact.lubrication.viscosity)
    resistance = 6.0 * math.pi * (0.5 * RADIUS) ** 2 / (0.5 * DENSITY * 4.0 / 3.0 * math.pi * RADIUS**3)
    remaining = float(distance) - 2.0 * RADIUS
    assert FILM["roughness"] < remaining < gap
    assert float(found) == pytest.approx(speed - resistance * FILM["viscosity"] * math.log(gap / remaining), rel=1e-4)
    # The gap that is left depends on the viscosity too: against the two neighbours.
    change = 1e-6
    sides = [float(both(FILM["viscosity"] + sign * change)[0]) for sign in (1.0, -1.0)]
    assert float(slope) == pytest.approx((sides[0] - sides[1]) / (2.0 * change), rel=1e-5)
    assert float(slope) < 0.0

"""The numbers of `jaxdem check`: velocities against closed forms, loads, costs, and what looks like another unit."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from jaxdem import build, load_scene
from jaxdem.check.cautions import cautions
from jaxdem.check.check import check_scene
from jaxdem.check.compile_cost import compile_seconds
from jaxdem.check.engineering import DragInFluid, screen_load
from jaxdem.check.run_cost import FACTOR, run_cost
from jaxdem.check.unit_warnings import unit_warnings
from jaxdem.closures import DRAG_LAWS
from jaxdem.particles.neighbors import Room
from jaxdem.setup.particles import particle_setup

SCENES = Path(__file__).parents[1] / "scenes"
DIAMETER, DENSITY, FLUID, VISCOSITY = np.array([1e-4, 2e-2]), np.array([2650.0, 1200.0]), 1000.0, 1e-6
"""A grain of sand and a pebble hardly heavier than water: Re from 1 to thousands."""

BED = {
    "precision": "float64",
    "domain": {"size": [0.2, 0.4]},
    "particles": {
        "count": 20,
        "radius": 0.01,
        "density": 2650.0,
        "pack": {"kind": "lattice", "start": [0.0, 0.0], "stop": [0.2, 0.2], "spacing": 1.2},
    },
    "contact": {"young_modulus": 7e7},
    "fluid": {"cells": [5, 10]},
    "coupling": {"drag": "wen_yu"},
    "time": {"end": 0.1, "output_interval": 0.1},
}


def drag_by(name):
    return DragInFluid.of(DRAG_LAWS[name](), FLUID, VISCOSITY)


def scene_with(**tables):
    given = copy.deepcopy(BED)
    for table, keys in tables.items():
        given.setdefault(table, {}).update(keys)
    return load_scene(given)


# --- Velocities ----------------------------------------------------------------------------------------


def test_terminal_velocity_by_stokes_is_his_formula():
    """u = (rho_p - rho) g d^2 / (18 mu)."""
    found = drag_by("stokes").terminal_velocity(DIAMETER, DENSITY, 9.81)
    np.testing.assert_allclose(found, (DENSITY - FLUID) * 9.81 * DIAMETER**2 / (18.0 * FLUID * VISCOSITY), rtol=1e-9)


@pytest.mark.parametrize("reynolds", [0.1, 30.0, 900.0, 1e5])
def test_terminal_velocity_by_wen_and_yu_has_the_drag_coefficient_of_one_sphere(reynolds):
    """Cd = 24/Re (1 + 0.15 Re^0.687), 0.44 above Re = 1000; Ar = 3/4 Cd Re^2 gives the gravity of that fall."""
    drag = 24.0 / reynolds * (1.0 + 0.15 * reynolds**0.687) if reynolds < 1000.0 else 0.44
    archimedes = 0.75 * drag * reynolds**2
    gravity = archimedes * VISCOSITY**2 / (1.65 * DIAMETER[0] ** 3)
    found = drag_by("wen_yu").terminal_velocity(DIAMETER[:1], DENSITY[:1], gravity)
    np.testing.assert_allclose(found * DIAMETER[0] / VISCOSITY, reynolds, rtol=1e-9)


@pytest.mark.parametrize("solid", [0.4, 0.6])
def test_minimum_fluidisation_by_ergun_is_the_root_of_his_pressure_drop(solid):
    """1.75 Re^2 / g^3 + 150 (1 - g) Re / g^3 = Ar, Re of the superficial velocity."""
    found = drag_by("ergun").minimum_fluidisation_velocity(DIAMETER, DENSITY, 9.81, solid)
    void = 1.0 - solid
    archimedes = 9.81 * (DENSITY / FLUID - 1.0) * DIAMETER**3 / VISCOSITY**2
    a, b = 1.75 / void**3, 150.0 * solid / void**3
    root = (np.sqrt(b**2 + 4.0 * a * archimedes) - b) / (2.0 * a)
    np.testing.assert_allclose(found * DIAMETER / VISCOSITY, root, rtol=1e-9)


@pytest.mark.parametrize("name", sorted(DRAG_LAWS))
def test_every_law_gives_finite_velocities_and_light_grains_rise(name):
    """A pack is carried by less than what carries one grain; without a difference of density nothing falls."""
    density = np.array([500.0, FLUID])
    alone = drag_by(name).terminal_velocity(DIAMETER, density, 9.81)
    packed = drag_by(name).minimum_fluidisation_velocity(DIAMETER, density, 9.81, 0.6)
    assert np.isfinite(alone).all() and alone[1] == 0.0 == packed[1]
    if name not in ("stokes", "schiller_naumann"):  # these know nothing of a pack
        assert 0.0 < packed[0] < alone[0]


def test_the_check_has_the_numbers_of_its_scene():
    report = check_scene(
        scene_with(boundary={"bottom": {"kind": "inlet", "velocity": 0.05}, "top": {"kind": "outlet"}})
    )
    numbers = {number.name.strip(): number for number in report.numbers}
    assert numbers["Archimedes number"].low == pytest.approx(9.81 * 1.65 * 0.02**3 / 1e-12)
    # Newton's regime: Cd = 0.44.
    assert numbers["terminal velocity"].low == pytest.approx(math.sqrt(4.0 / 3.0 * 1.65 * 9.81 * 0.02 / 0.44))
    assert numbers["particle Reynolds number"].high == pytest.approx(0.05 * 0.02 / 1e-6)
    assert numbers["Stokes number"].high == pytest.approx(2.65 * 0.02**2 / 18e-6 * 0.05 / 0.2)
    assert report.warnings == () and report.screen_load is None  # the stream carries nothing


# --- What the stream presses on a screen ---------------------------------------------------------------


def test_the_load_on_a_screen_is_the_drag_of_all_that_is_carried_there():
    """With Stokes' law and no gravity: N grains of 3 pi mu d U / g^2 each, on W / d of them; Hertz's overlap."""
    flow = {"bottom": {"kind": "inlet", "velocity": 3.0}, "top": {"kind": "outlet"}}
    still = {"domain": {"gravity": [0.0, 0.0]}, "contact": {"speed": 0.5}}
    scene = scene_with(boundary=flow, coupling={"drag": "stokes"}, fluid={"viscosity": 1.0}, **still)
    simulation, parameters = build(scene)
    load = screen_load(scene, simulation, parameters, particle_setup(scene).bodies, 20)
    void = 1.0 - 0.85 * 2.0 / 3.0
    force = 20 / 10 * 3.0 * math.pi * 1000.0 * 0.02 * 3.0 / void**2
    assert load.side == "top"
    assert load.weights == pytest.approx(force / (4.0 / 3.0 * math.pi * 0.01**3 * 2650.0 * 9.81))
    modulus = 7e7 / (2.0 * (1.0 - 0.3**2))
    assert load.overlap == pytest.approx((0.75 * force / (modulus * math.sqrt(0.005))) ** (2 / 3) / 0.02)
    soft = scene.model_copy(update={"contact": scene.contact.model_copy(update={"young_modulus": 1e6})})
    assert load.overlap * 70.0 ** (2 / 3) > 0.2  # the softer contact's, above contact.maximum_overlap
    said = [one for one in check_scene(soft).warnings if "top" in one]
    assert said and said[0].startswith("contact.young_modulus = 1e+06")
    removed = scene_with(boundary={**flow, "top": {"kind": "outlet", "particles": "remove"}})
    assert screen_load(removed, *build(removed), particle_setup(removed).bodies, 20) is None


# --- Costs ---------------------------------------------------------------------------------------------


def listed(count, *room):
    return SimpleNamespace(reference=(np.zeros(count),), room=Room(*room))


def test_the_estimate_is_within_its_factor_of_what_was_measured():
    """docs/performance.md: the injection scene on 4 cm takes 75 s a simulated second on one core, 94 % in contacts."""
    simulation, _ = build(load_scene(SCENES / "injection.toml"))
    cost = run_cost(simulation, listed(20_000, 8, 65_001, 6))
    measured = 75.0 * 5.0
    assert measured / FACTOR < cost.total < FACTOR * measured
    assert 0.85 < cost.contacts / (cost.contacts + cost.fluid) < 0.99


COMPILED = {"chute": 4.0, "cavity": 8.4, "dam_break": 18.7, "injection": 24.7, "pier": 39.2, "slide_into_lake": 55.4}
"""Processor time of a run of one coupling interval with an empty cache [s]."""


@pytest.mark.parametrize("name", COMPILED)
def test_the_time_to_compile_goes_by_what_is_in_the_program(name):
    simulation, _ = build(load_scene(SCENES / f"{name}.toml"))
    assert compile_seconds(simulation) == pytest.approx(COMPILED[name], rel=0.2)


def test_one_large_grain_among_small_ones_is_dear_and_said_so():
    """1,000 grains of 1 mm and one of 5 cm: 52 times the cost of equal ones, measured."""
    scene = scene_with(particles={"count": 2, "radius": [0.0002, 0.01]})
    simulation, _ = build(scene)
    cost = run_cost(simulation, listed(1001, 893, 315_172, 652))
    assert 52.0 / FACTOR < cost.over_equal < 52.0 * FACTOR
    assert run_cost(simulation, listed(1001, 8, 3255, 6)).over_equal == pytest.approx(1.0, rel=0.01)
    dear, one_law = cautions(scene, particle_setup(scene).bodies, None, None, cost)
    assert "particles.radius" in dear and "893" in dear
    assert "coupling.drag = 'wen_yu'" in one_law and "1 : 50" in one_law
    dry = scene.model_copy(update={"fluid": None})
    assert list(cautions(dry, particle_setup(scene).bodies, None, None, cost)) == [dear]


def test_cells_under_a_diameter_are_said():
    (said,) = check_scene(scene_with(fluid={"cells": [20, 40]})).warnings
    assert said.startswith("fluid.cells: the cell side is 0.5 of the largest diameter")


# --- Units ---------------------------------------------------------------------------------------------


WARM = {
    "fluid_heat_capacity": 4180.0, "fluid_conductivity": 0.6, "fluid_temperature": 300.0,
    "particle_heat_capacity": 800.0, "particle_temperature": 300.0,
}  # fmt: skip
WET = {"kind": "capillary", "surface_tension": 72.0, "contact_angle": 0.1, "liquid_content": 0.01, "bridge_share": 0.1}


@pytest.mark.parametrize(
    ("tables", "key", "meant"),
    [
        ({"domain": {"size": [200.0, 400.0]}, "particles": {"radius": 10.0}}, "particles.radius = 10 m", "0.01"),
        ({"domain": {"size": [200.0, 400.0]}}, "domain.size = 400 m", "write 0.4"),
        ({"domain": {"gravity": [0.0, -9810.0]}}, "domain.gravity = 9810", "write 9.81"),
        ({"domain": {"gravity": [0.0, 9.81]}}, "domain.gravity = 9.81", "write -9.81"),
        ({"domain": {"gravity": [-9.81, 0.0]}}, "domain.gravity = -9.81 m/s2: it is along x", "write [0.0, -9.81]"),
        ({"contact": {"friction": 30.0}}, "contact.friction = 30:", "write 0.577"),
        ({"fluid": {"density": 1.2e-3, "viscosity": 1.5e-5}}, "fluid.density = 0.0012 ", "write 1.2"),
        ({"heat": WARM | {"particle_heat_capacity": 0.8}}, "heat.particle_heat_capacity = 0.8 J/(kg K)", "write 800"),
        ({"heat": WARM | {"fluid_heat_capacity": 4.18}}, "heat.fluid_heat_capacity = 4.18 J/(kg K)", "write 4180"),
        ({"contact": {"cohesion": WET}}, "contact.cohesion.surface_tension = 72 N/m", "write 0.072"),
        ({"particles": {"density": 2.65}}, "particles.density = 2.65", "write 2650"),
        ({"particles": {"density": 2.65e6}}, "particles.density = 2.65e+06", "write 2650"),
        ({"fluid": {"density": 1.0}}, "fluid.density = 1 ", "write 1000"),
        ({"fluid": {"viscosity": 1e-3}}, "fluid.viscosity = 0.001", "write 1e-06"),
        ({"fluid": {"viscosity": 0.01}}, "fluid.viscosity = 0.01", "St (cm2/s), write 1e-06"),
        ({"fluid": {"viscosity": 1.0}}, "fluid.viscosity = 1 ", "cP, write 1e-06"),
        ({"fluid": {"density": 1.2, "viscosity": 0.018}}, "fluid.viscosity = 0.018", "write 1.5e-05"),
        ({"contact": {"young_modulus": 70.0}}, "contact.young_modulus = 70", "GPa, write 7e+10"),
        ({"contact": {"young_modulus": 7e4}}, "contact.young_modulus = 70000", "MPa, write 7e+10"),
        ({"contact": {"young_modulus": 5e3}}, "contact.young_modulus = 5000", "kPa, write 5e+06"),
        ({"contact": {"wall_young_modulus": 210.0}}, "contact.wall_young_modulus = 210", "write 2.1e+11"),
        ({"particles": {"velocity": [[1500.0, 0.0]] * 20}}, "particles.velocity = 1500", "write 1.5"),
        ({"fluid": {"velocity": [0.0, 1500.0]}}, "fluid.velocity = 1500", "write 1.5"),
        ({"contact": {"speed": 1500.0}}, "contact.speed = 1500", "write 1.5"),
    ],
)  # fmt: skip
def test_what_looks_like_another_unit_is_named_with_what_was_meant(tables, key, meant):
    found = [said for said in unit_warnings(scene_with(**tables)) if said.startswith(key)]
    assert len(found) == 1, unit_warnings(scene_with(**tables))
    assert meant in found[0]


def test_a_soft_contact_on_purpose_is_no_mistake():
    """A larger limit of the overlap says so."""
    contact = {"young_modulus": 1e4, "maximum_overlap": 0.4}
    assert not [said for said in unit_warnings(scene_with(contact=contact)) if "young_modulus" in said]


@pytest.mark.parametrize("name", sorted(path.name for path in SCENES.glob("*.toml")))
def test_shipped_scenes_look_like_what_they_are(name):
    assert unit_warnings(load_scene(SCENES / name)) == ()

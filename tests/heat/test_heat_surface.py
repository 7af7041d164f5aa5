"""Temperatures in scenes with two fluids: grains at the fluid where they are, the balance, the start, slopes."""

import copy
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem import load_run, load_scene, simulate
from jaxdem.fluid.carried_heat import CarriedHeat
from jaxdem.fluid.scalar_transport import ScalarField
from jaxdem.setup.phases import first_temperature
from tests.cases.heat_in_two_fluids import Layers
from tests.cases.tiers import COMBINATION

TANK = {
    "precision": "float64",
    "domain": {"size": [0.2, 0.2], "depth": 0.05, "gravity": [0.0, 0.0]},
    "particles": {"radius": 0.0005, "density": 2500.0, "position": [[0.1, 0.05], [0.1, 0.15]]},
    "contact": {"young_modulus": 5e6, "speed": 1.0},
    "coupling": {"interval": 0.002},
    "fluid": {"cells": [8, 8], "density": 998.0, "viscosity": 1e-6, "time_step": 0.002},
    "surface": {
        "density": 1.2, "viscosity": 1.5e-5, "level": 0.11, "heat_capacity": 1007.0, "conductivity": 0.026,
        "temperature": 320.0,
    },
    "heat": {
        "fluid_heat_capacity": 4180.0, "fluid_conductivity": 0.6, "fluid_temperature": 290.0,
        "particle_heat_capacity": 800.0, "particle_temperature": 400.0, "exchange": "ranz_marshall",
    },
    "boundary": {"bottom": {"temperature": 350.0}, "top": {"heat_flux": 40.0}},
    "time": {"end": 0.02, "output_interval": 0.01},
}  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "tank"
    simulate(load_scene(TANK), out)
    return out


def test_grains_take_the_heat_of_the_fluid_where_they_are(run):
    """At rest Nu = 2: T follows exp(-2 k pi d t / C) with the conductivity of water below, of air above."""
    found = load_run(run).particles(-1)["temperature"]
    capacity = 800.0 * 2500.0 * np.pi / 6.0 * 1e-9
    rates = 2.0 * np.array([0.6, 0.026]) * np.pi * 1e-3 / capacity
    fluid = np.array([290.0, 320.0])
    cooled = (400.0 - found) / (400.0 - fluid)
    np.testing.assert_allclose(cooled, -np.expm1(-0.02 * rates), rtol=2e-3)


def test_a_law_of_ones_own_is_asked_at_every_grain():
    """With the Prandtl number of what is there: nu rho c / k, 6.95 in the water and 0.697 in the air."""
    asked = []

    def law(reynolds, prandtl, void_fraction):
        asked.append((reynolds.shape, void_fraction.shape))
        return prandtl

    scene = load_scene(TANK)
    simulation, parameters = jaxdem.build(scene, nusselt=law)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    found = jax.jit(simulation.step)(parameters, state, neighbors)[0].scalars.grains
    assert asked == [((2,), (2,))]
    prandtl = np.array([1e-6 * 998.0 * 4180.0 / 0.6, 1.5e-5 * 1.2 * 1007.0 / 0.026])
    capacity = 800.0 * 2500.0 * np.pi / 6.0 * 1e-9
    rates = prandtl * np.array([0.6, 0.026]) * np.pi * 1e-3 / capacity
    cooled = (400.0 - np.asarray(found)) / (400.0 - np.array([290.0, 320.0]))
    np.testing.assert_allclose(cooled, -np.expm1(-0.002 * rates), rtol=2e-3)


def test_heat_is_balanced_and_the_sides_are_told(run):
    """The top gives its flux; the bottom what conduction over half a cell brings at first, to 1 %."""
    heat = json.loads((run / "summary.json").read_text())["heat"]
    assert abs(heat["missing_relative"]) < 1e-12
    assert heat["through_sides"]["top"] == pytest.approx(40.0 * 0.02 * 0.2 * 0.05, rel=1e-12)
    assert heat["through_sides"]["bottom"] == pytest.approx(0.6 * 60.0 / 0.0125 * 0.02 * 0.2 * 0.05, rel=1e-2)
    warm = load_run(run).fluid(0)["temperature"]
    np.testing.assert_allclose(warm[0, [0, 7]], [290.0, 320.0])


def test_cells_of_both_fluids_start_with_the_heat_of_both():
    """The temperature that their mixture has; without `surface.temperature` all is at that of the liquid."""
    scene, liquid = load_scene(TANK), np.array([0.0, 0.4, 1.0])
    capacity = np.array([998.0 * 4180.0, 1.2 * 1007.0])
    mixture = (0.4 * capacity[0] * 290.0 + 0.6 * capacity[1] * 320.0) / (0.4 * capacity[0] + 0.6 * capacity[1])
    np.testing.assert_allclose(first_temperature(scene, liquid), [320.0, mixture, 290.0], rtol=1e-14)
    tables = copy.deepcopy(TANK)
    del tables["surface"]["temperature"]
    np.testing.assert_array_equal(first_temperature(load_scene(tables), liquid), 290.0)


def test_the_expansion_of_the_second_fluid_is_its_own():
    """rho beta of both, and a reference that the second fluid alone may need."""
    tables = copy.deepcopy(TANK)
    tables["surface"]["expansion"], tables["heat"]["reference_temperature"] = 3e-3, 310.0
    simulation, parameters = jaxdem.build(load_scene(tables))
    numbers = simulation.scalars.of_phases(parameters.scalars, parameters.flow)
    assert [float(x) for x in numbers.expansion] == pytest.approx([0.0, 3.6e-3])
    assert float(numbers.reference) == 310.0


@pytest.mark.parametrize(("table", "name"), [("surface", "conductivity"), ("heat", "fluid_conductivity")])
def test_heat_that_is_conducted_too_fast_to_follow_is_refused(table, name):
    tables = copy.deepcopy(TANK)
    tables[table][name] = 1e12
    if table == "heat":
        tables["surface"]["heat_capacity"] = 1e16
    with pytest.raises(jaxdem.InputError, match="steps of temperature") as error:
        jaxdem.build(load_scene(tables))
    assert error.value.key == f"{table}.{name}"


@COMBINATION
def test_slopes_go_through_conduction_of_layers():
    """By the conductivity of the second fluid, against central differences."""
    layers = Layers(8, 0.55, (400.0, 300.0))
    field = ScalarField("temperature", layers.kinds, True, 20)
    start = CarriedHeat(jnp.full(layers.box.grid.cells, 300.0), jnp.zeros(4))

    def passed(conductivity):
        second = layers.phases.parameters.second._replace(conductivity=conductivity)
        phases = layers.phases._replace(parameters=layers.phases.parameters._replace(second=second))
        return phases.conducted(field, "open", start, jnp.asarray(3.0), True)[1][2]

    slope = float(jax.jit(jax.grad(passed))(jnp.asarray(0.5)))
    ends = [float(jax.jit(passed)(jnp.asarray(0.5 + d))) for d in (1e-4, -1e-4)]
    assert slope == pytest.approx((ends[0] - ends[1]) / 2e-4, rel=1e-6)


def test_the_balls_of_the_scene_quench_begin_in_the_air_and_end_with_the_pool_at_what_it_says():
    """294.1 K: both heats over both capacities, of the first state."""
    scene = load_scene(Path(__file__).parents[2] / "scenes" / "quench.toml")
    simulation, parameters = jaxdem.build(scene)
    state, _ = jaxdem.initial_state(scene, simulation, parameters)
    grains, heat = scene.particles, scene.heat
    height = np.asarray(state.particles.position)[:, 1]
    assert height.shape == (60,) and height.min() > scene.surface.level + grains.radius
    balls = 60 * grains.density * heat.particle_heat_capacity * 4.0 / 3.0 * np.pi * grains.radius**3
    water = float(np.sum(state.fluid.liquid_fraction)) * simulation.fluid.solver.grid.cell_volume
    water *= scene.fluid.density * heat.fluid_heat_capacity
    end = (heat.particle_temperature * balls + heat.fluid_temperature * water) / (balls + water)
    assert end == pytest.approx(294.1, abs=0.05)

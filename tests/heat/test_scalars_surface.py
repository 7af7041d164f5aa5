"""Scalars in scenes with two fluids: files, balance, sides, the run that goes on, slopes."""

import copy
import csv
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem import load_run, load_scene, simulate
from jaxdem.check.check import check_scene
from tests.cases.tiers import COMBINATION

CHANNEL = {
    "precision": "float64",
    "domain": {"size": [0.2, 0.2], "depth": 0.05},
    "particles": {"radius": 0.004, "density": 2500.0, "position": [[0.1, 0.05], [0.1, 0.15], [0.06, 0.116]]},
    "contact": {"young_modulus": 5e6, "speed": 1.0},
    "coupling": {"interval": 0.002},
    "fluid": {"cells": [8, 8], "density": 1000.0, "viscosity": 1e-6, "time_step": 0.002},
    "surface": {"density": 1.2, "viscosity": 1.5e-5, "level": 0.11},
    "scalars": [
        {"name": "salt", "value": 2.0, "diffusivity": 1e-3},
        {"name": "smoke", "value": 0.5, "dissolved_in": "second"},
        {"name": "same", "value": 0.3, "dissolved_in": "both", "diffusivity": 1e-3},
    ],
    "boundary": {
        "left": {"kind": "inlet", "velocity": 0.5, "level": 0.11, "scalars": {"salt": 5.0, "smoke": 1.0, "same": 0.3}},
        "right": {"kind": "outlet", "level": 0.11},
        "bottom": {"scalars": {"salt": 3.0}},
        "top": {"kind": "free_slip"},
    },
    "time": {"end": 0.02, "output_interval": 0.01},
}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "channel"
    simulate(load_scene(CHANNEL), out)
    return out


def test_what_is_dissolved_is_balanced_side_by_side(run):
    """Salt comes in with the water alone and out of the floor, smoke with the air alone."""
    summary = json.loads((run / "summary.json").read_text())
    balance, liquid = summary["scalars"], summary["liquid_phase"]["through_sides"]
    for name in ("salt", "smoke", "same"):
        assert abs(balance[name]["missing_relative"]) < 1e-12
    passed = {name: balance[name]["through_sides"] for name in balance}
    assert liquid["left"] > 0.0
    assert passed["salt"]["left"] == pytest.approx(5.0 * liquid["left"], rel=1e-12)
    assert passed["smoke"]["left"] == pytest.approx(9.0 / 11.0 * liquid["left"], rel=1e-12)
    assert passed["same"]["left"] == pytest.approx(0.3 * 20.0 / 11.0 * liquid["left"], rel=1e-12)
    assert passed["smoke"]["bottom"] == passed["same"]["bottom"] == passed["salt"]["top"] == 0.0
    assert passed["salt"]["bottom"] > 0.0
    assert passed["salt"]["right"] < 0.0 and passed["smoke"]["right"] < 0.0


def test_frames_have_it_where_its_fluid_is(run):
    """Nothing in cells without the fluid, bounds within it, what is the same everywhere to the last digit; the column
    of the history is the mean over the volume of the fluid."""
    found = load_run(run)
    last, liquid = found.fluid(-1), found.fluid(-1)["liquid_fraction"]
    assert np.all(last["salt"][liquid < 1e-12] == 0.0) and np.all(last["smoke"][liquid > 1.0 - 1e-12] == 0.0)
    assert last["salt"].max() <= 5.0 + 1e-12 and last["salt"][liquid > 0.01].min() >= 2.0 - 1e-12
    assert last["smoke"].max() <= 1.0 + 1e-12 and last["smoke"][liquid < 0.99].min() >= 0.5 - 1e-12
    assert last["salt"].max() > 2.2 and last["smoke"].max() > 0.53
    np.testing.assert_array_equal(last["same"], 0.3)
    gaps = last["void_fraction"]
    rows = list(csv.DictReader((run / "history.csv").open()))
    column = next(name for name in rows[-1] if name.startswith("scalar_salt_mean"))
    assert float(rows[-1][column]) == pytest.approx(np.average(last["salt"], weights=gaps * liquid), rel=1e-6)


def test_a_run_that_begins_from_another_takes_it_along(run):
    """On the same liquid with the same concentrations."""
    later = {"time": {"end": 0.04, "output_interval": 0.01}}
    scene = load_scene(CHANNEL | {"start": {"from": str(run)}} | later)
    simulation, parameters = jaxdem.build(scene)
    state, _ = jaxdem.initial_state(scene, simulation, parameters)
    last = load_run(run).fluid(-1)
    for field, name in zip(state.scalars.fields, ("salt", "smoke", "same"), strict=True):
        there = last[name] != 0.0
        np.testing.assert_allclose(np.asarray(field)[there], last[name][there], rtol=1e-6)


def test_check_names_the_fluid_and_refuses_what_diffuses_too_fast():
    report = check_scene(load_scene(CHANNEL))
    assert any("salt in the liquid, smoke in the second fluid, same in both fluids" in p for p in report.compiled_in)
    tables = copy.deepcopy(CHANNEL)
    tables["scalars"][2]["diffusivity"] = 1e9
    with pytest.raises(jaxdem.InputError, match="steps of same") as error:
        jaxdem.build(load_scene(tables))
    assert error.value.key == "scalars.2.diffusivity"


@COMBINATION
def test_slopes_go_through_intervals_of_flow_and_diffusion():
    """Of the salt in the channel after four intervals, by the value of the inlet, the diffusivity and the density of
    the second fluid, against central differences."""
    tables = {key: value for key, value in CHANNEL.items() if key not in ("particles", "contact", "coupling")}
    inlet = CHANNEL["boundary"]["left"] | {"scalars": {"salt": 5.0}}
    salt = {"scalars": CHANNEL["scalars"][:1], "boundary": CHANNEL["boundary"] | {"left": inlet}}
    scene = load_scene(tables | salt)
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)

    @jax.jit
    def squares(given):
        value, diffusivity, density = given
        own = parameters.scalars.fields[0]
        own = own._replace(value=own.value.at[0].set(value), diffusivity=diffusivity)
        second = parameters.fluid.second._replace(density=density)
        here = parameters._replace(
            scalars=parameters.scalars._replace(fields=(own,)), fluid=parameters.fluid._replace(second=second)
        )
        found = jaxdem.rollout(simulation, here, state, neighbors, 4).state
        return jnp.sum((found.fluid.liquid_fraction * found.scalars.fields[0]) ** 2)

    at = jnp.asarray([5.0, 1e-3, 1.2])
    slopes = jax.jit(jax.grad(squares))(at)
    expected = [(squares(at + d) - squares(at - d)) / (2.0 * d.sum()) for d in np.diag([1e-4, 1e-7, 1e-2])]
    np.testing.assert_allclose(slopes, np.asarray(expected), rtol=1e-4)
    assert np.all(np.abs(np.asarray(expected)) > 0.0)

"""Temperatures and scalars between walls that change their place in the fluid: what stays, what is kept, and where it
goes."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem import build, initial_state, load_scene, simulate
from jaxdem.scalars import scalars
from jaxdem.scalars.moving_cells import Held
from tests.cases.steps import compiled_step
from tests.cases.tiers import COMBINATION
from tests.heat.test_cut_heat import pipe_tables
from tests.test_fluid_walls import refusal, tables
from tests.test_moving_fluid_walls import BODY, BOX, PISTON

DYE = {"scalars": [{"name": "dye", "diffusivity": 1e-4, "value": 1.0}]}


def march(given, steps, first=None):
    """Dye and capacities after every interval, from a `first` field, and the simulation."""
    scene = load_scene(given)
    simulation, parameters = build(scene)
    state, _ = initial_state(scene, simulation, parameters)
    if first is not None:
        state = state._replace(scalars=state.scalars._replace(fields=(jnp.asarray(first),)))
    step, found = compiled_step(simulation), [state.scalars]
    for _ in range(steps):
        state, _, told = step(parameters, state, None)
        found.append(state.scalars)
    assert bool(told.fluid.finite)
    return [np.asarray(s.fields[0]) for s in found], [np.asarray(s.capacity) for s in found], simulation


def swinging():
    """A body that swings by three cells in a closed box."""
    wall = BODY | {"center": [0.21, 0.093]}
    wall["motion"] = [{"kind": "oscillation", "direction": [1.0, 0.3], "amplitude": 0.06, "frequency": 1.0}]
    return tables(wall, grains=False, **BOX) | DYE


def test_a_uniform_dye_stays_uniform_and_a_rough_one_is_kept(monkeypatch):
    even, capacities, _ = march(swinging(), 30)
    assert max(np.ptp(dye[w > 0.0]) for dye, w in zip(even, capacities, strict=True)) < 1e-13
    assert np.sum((capacities[0] > 0.0) != (capacities[-1] > 0.0)) > 10  # cells have opened and closed
    rough = np.random.default_rng(0).random((20, 10))
    dyes, capacities, _ = march(swinging(), 30, rough)
    content = [np.sum(w * dye) for dye, w in zip(dyes, capacities, strict=True)]
    np.testing.assert_allclose(content, content[0], rtol=1e-13)
    assert max(dye[w > 0.0].max() for dye, w in zip(dyes, capacities, strict=True)) < rough.max() + 1e-3
    assert min(dye[w > 0.0].min() for dye, w in zip(dyes, capacities, strict=True)) > rough.min() - 1e-3

    # Negative control: with capacities that are the open parts of the cells it does not stay.
    def as_cut(grid, walls, state, change):
        return Held(walls, state.fields, 1.0, 1.0, state.capacity)

    monkeypatch.setattr(scalars, "held_by_cells", as_cut)
    compiled_step.cache_clear()
    even, _, _ = march(swinging(), 30)
    assert np.ptp(even[-1][capacities[-1] > 0.0]) > 1e-2


def test_a_piston_pushes_a_profile_along():
    """c = c0(x - s) with the way s of the piston: right to a tenth of a cell, beside the ends to a cell."""
    sides = {"right": {"kind": "outlet"}, "top": {"kind": "free_slip"}, "bottom": {"kind": "free_slip"}}
    wall = PISTON | {"motion": [{"kind": "translation", "velocity": [0.5, 0.0]}]}
    given = tables(wall, grains=False, boundary=sides, **BOX)
    given["scalars"] = [{"name": "dye", "diffusivity": 0.0, "value": 1.0}]
    x = (np.arange(20) + 0.5) * 0.02
    dyes, capacities, simulation = march(given, 12, np.repeat(x[:, None], 10, axis=1))
    way = 0.5 * 12 * simulation.interval
    assert way > 0.04  # two cells
    off = np.abs(dyes[-1] - (x - way)[:, None])
    assert off[8:-2].max() < 0.1 * 0.02
    assert off[capacities[-1] > 0.0].max() < 0.02
    assert np.abs(np.diff(dyes[-1], axis=1)).max() < 1e-12


@COMBINATION
def test_a_hot_body_that_moves_among_grains_and_the_balance(tmp_path):
    swings = [{"kind": "oscillation", "direction": [0.0, 1.0], "amplitude": 0.003, "frequency": 20.0}]
    run = simulate(load_scene(pipe_tables(name="rod", temperature=350.0, motion=swings)), tmp_path / "hot")
    heat = run.summary["heat"]
    assert abs(heat["missing_relative"]) < 1e-13, heat
    assert 1.0 < heat["from_walls_to_fluid"]["rod"] / (0.05 * 0.03 * np.pi * 0.002 * 50.0) < 15.0
    last = run.fluid(-1)["temperature"]
    assert last.min() > 299.9 and last.max() < 350.1


@pytest.mark.parametrize("key", ["begin", "end"])
def test_gates_and_scalars_are_refused(key):
    assert f"walls.0.{key}" in refusal(tables(BODY | {key: 0.1}, grains=False, **BOX) | DYE)

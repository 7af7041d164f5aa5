"""Temperatures in a scene: what is refused, what `check` tells, slopes, and a run that begins from another."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem import InputError, load_run, load_scene, simulate
from jaxdem.check.check import check_scene
from tests.cases.heat import chain_tables, stream_tables
from tests.cases.small_scenes import changed

CHAIN, STREAM = chain_tables(3, 4000.0, 0.01), stream_tables(1e-3)
DYE = [{"name": "dye"}]


@pytest.mark.parametrize(
    ("tables", "key"),
    [
        (changed(STREAM, heat__fluid_conductivity=None), "heat.fluid_conductivity"),
        (changed(STREAM, heat__particle_temperature=None), "heat.particle_temperature"),
        (changed(CHAIN, heat__fluid_temperature=300.0), "heat.fluid_temperature"),
        (changed(CHAIN, heat__true_young_modulus=None), "heat.true_young_modulus"),
        (changed(STREAM, heat__true_young_modulus=1e9), "heat.true_young_modulus"),
        (changed(STREAM, heat__reference_temperature=300.0), "heat.reference_temperature"),
        (changed(STREAM, boundary__left__temperature=None), "boundary.left.temperature"),
        (changed(STREAM, boundary__bottom__temperature=300.0), "boundary.bottom"),
        (changed(STREAM, boundary__right__heat_flux=3.0), "boundary.right.heat_flux"),
        (changed(CHAIN, boundary__left={"heat_flux": 3.0}), "boundary.left.heat_flux"),
        (
            changed(
                CHAIN,
                heat__particle_conductivity=None,
                heat__true_young_modulus=None,
                boundary__left={"temperature": 3.0},
            ),
            "boundary.left.temperature",
        ),
        (changed(CHAIN, heat=None, boundary__left={"temperature": 3.0}), "boundary.left.temperature"),
        (changed(CHAIN, particles__coarse_grain=2.0), "particles.coarse_grain"),
        (changed(CHAIN, materials=[{"name": "steel"}], particles__material="steel"), "heat.particle_conductivity"),
        (changed(CHAIN, scalars=DYE), "scalars"),
        (changed(STREAM, scalars=DYE), "boundary.left.scalars"),
        (changed(STREAM, scalars=[{"name": "pressure"}]), "scalars.0.name"),
        (changed(STREAM, boundary__right__scalars={"salt": 1.0}), "boundary.right.scalars"),
        (
            changed(STREAM, walls=[{"kind": "plane", "point": [0.002, 0.0], "normal": [1.0, 0.0], "temperature": 1.0}]),
            "walls.0.temperature",
        ),
    ],
)
def test_what_does_not_fit_is_refused_by_its_key(tables, key):
    with pytest.raises(InputError) as caught:
        load_scene(tables)
    assert caught.value.key == key


def test_a_law_of_heat_transfer_needs_an_exchange():
    with pytest.raises(InputError, match="nusselt"):
        jaxdem.build(load_scene(CHAIN), nusselt=lambda reynolds, prandtl, void_fraction: 2.0 + 0.0 * reynolds)


def test_check_tells_nusselt_and_biot():
    """A sphere of 3.6 mm in air of 6 m/s: Nu 21.974, tau 1.8402 s; Bi = Nu k / (6 k_p)."""
    tables = changed(STREAM, heat__particle_conductivity=1.0, heat__true_young_modulus=1e10)
    report = check_scene(load_scene(tables))
    found = {number.name.strip(): number.low for number in report.numbers}
    assert found["Nusselt number"] == pytest.approx(21.974, rel=1e-4)
    assert found["time of warming"] == pytest.approx(1.8402, rel=1e-4)
    assert found["Biot number"] == pytest.approx(21.974 * 0.026 / 6.0, rel=1e-4)
    assert "temperatures" in report.compiled_in and "buoyancy of warm fluid" in report.left_out


def test_slope_by_the_conductivity():
    """d(T)/d(k) and d(T)/d(wall temperature) of the middle grain after 20 intervals, against central differences."""
    tables = changed(CHAIN, boundary={"left": {"temperature": 60.0}})
    scene = load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)

    @jax.jit
    def warmth(factor, wall):
        of_contacts = parameters.scalars.grains.conduction
        numbers = of_contacts._replace(
            conductivity=factor * of_contacts.conductivity, wall_temperature=wall + 0.0 * of_contacts.wall_temperature
        )
        grains = parameters.scalars.grains._replace(conduction=numbers)
        here = parameters._replace(scalars=parameters.scalars._replace(grains=grains))
        return jaxdem.rollout(simulation, here, state, neighbors, 20).state.scalars.grains[1]

    slopes = jax.jit(jax.grad(warmth, (0, 1)))(1.0, 60.0)
    h = 1e-4
    by_factor = (warmth(1.0 + h, 60.0) - warmth(1.0 - h, 60.0)) / (2.0 * h)
    by_wall = (warmth(1.0, 60.0 + h) - warmth(1.0, 60.0 - h)) / (2.0 * h)
    assert float(jnp.abs(by_factor)) > 1e-3
    np.testing.assert_allclose(slopes, [by_factor, by_wall], rtol=1e-6)


def test_a_run_that_begins_from_another_goes_on(tmp_path):
    """Two halves, the second from the state of the first, are the whole, bit for bit; and with another material of the
    grains it begins at the temperatures of the first."""
    given = {"heat__friction": True, "boundary": {"left": {"temperature": 60.0}}}
    tables = changed(CHAIN, **given, time={"end": 0.4, "output_interval": 0.1})
    whole = simulate(load_scene(tables), tmp_path / "whole")
    half = simulate(load_scene(changed(tables, time__end=0.2)), tmp_path / "half")
    onward = changed(tables, start={"from": str(tmp_path / "half")})
    del onward["particles"]
    rest = simulate(load_scene(onward), tmp_path / "rest")
    last = load_run(tmp_path / "rest").particles(-1)["temperature"]
    assert last.tobytes() == whole.particles(-1)["temperature"].tobytes()
    assert half.particles(-1)["temperature"].tobytes() == rest.particles(0)["temperature"].tobytes()
    assert abs(rest.summary["heat"]["missing_relative"]) < 1e-13
    assert rest.summary["heat"]["from_walls_to_grains"] > 0.0
    assert half.summary["heat"]["from_friction"] > 0.0


@pytest.fixture(scope="module")
def dyed(tmp_path_factory):
    """A run of a hot sphere in a stream; a dye comes in, one grain has come in and one waits for room."""
    inlet = {"start": [0.02, 0.01], "stop": [0.024, 0.014], "rate": 4000.0, "total": 2, "radius": 0.0018}
    tables = changed(
        STREAM,
        scalars=[{"name": "dye", "value": 1.0}],
        boundary__left__scalars={"dye": 2.0},
        particles__inlet=[{**inlet, "density": 8850.0, "velocity": [0.0, 0.0], "temperature": 330.0}],
        time={"end": 1e-3, "output_interval": 5e-4},
        coupling__interval=5e-4,
    )
    return tables, simulate(load_scene(tables), tmp_path_factory.mktemp("dyed") / "run")


def first_scalars_after(dyed, **values):
    """Those of a scene that begins from the run."""
    tables, run = dyed
    tables = changed(tables, time__end=2e-3, **values) | {"start": {"from": str(run.path), **values.get("start", {})}}
    tables["particles"] = {"inlet": tables["particles"]["inlet"]}
    scene = load_scene(tables)
    return jaxdem.initial_state(scene, *jaxdem.build(scene))[0].scalars


def test_a_run_that_begins_from_a_frame_has_its_temperatures(dyed):
    frame, cells = dyed[1].particles(1), dyed[1].fluid(1)
    found = first_scalars_after(dyed, start={"time": 5e-4})
    np.testing.assert_array_equal(found.grains, frame["temperature"])
    np.testing.assert_array_equal(found.fields[0], cells["temperature"])
    np.testing.assert_array_equal(found.fields[1], cells["dye"])
    assert cells["dye"].max() > 1.01 and frame["temperature"][0] < 373.15 - 1e-3


def test_a_new_fluid_has_its_own_scalars(dyed):
    """Grains keep their temperatures."""
    given = {"heat__fluid_temperature": 400.0, "fluid__cells": [4, 4]}
    found = first_scalars_after(dyed, start={"fluid": "new"}, **given)
    np.testing.assert_array_equal(found.fields[0], np.full((4, 4), 400.0))
    np.testing.assert_array_equal(found.fields[1], np.ones((4, 4)))
    np.testing.assert_array_equal(found.grains, dyed[1].particles(-1)["temperature"])
    with pytest.raises(InputError, match=r"fluid\.cells.*start\.fluid"):
        first_scalars_after(dyed, **given)


def test_grains_that_wait_come_in_as_warm_as_the_inlet_says_now(dyed):
    tables, run = dyed
    inlet = [tables["particles"]["inlet"][0] | {"temperature": 500.0}]
    frame, found = run.particles(-1), first_scalars_after(dyed, particles__inlet=inlet)
    assert frame["active"].tolist() == [1, 1, 0]
    np.testing.assert_array_equal(found.grains[:2], frame["temperature"][:2])
    assert found.grains[2] == 500.0

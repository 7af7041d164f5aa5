"""Two fluids in a scene: what is refused, what a run writes, and a run that goes on from another on another mesh."""

import dataclasses

import jax
import numpy as np
import pytest
import tomli_w
import trimesh

import jaxdem
from jaxdem import InputError, load_scene, simulate
from jaxdem.check.check import check_scene
from jaxdem.fluid.pressure import pressure_gradient
from jaxdem.fluid.second_fluid import with_closed_sides
from jaxdem.setup.fluid import fluid_setup
from jaxdem.setup.start_point import read_start
from jaxdem.setup.started_fluid import kept_liquid
from jaxdem.setup.surface import fall_speed, first_fraction, surface_limits
from tests.cases import small_scenes

TANK = {
    "precision": "float64",
    "domain": {"size": [0.4, 0.2], "gravity": [0.0, -9.81]},
    "fluid": {"cells": [16, 8], "viscosity": 1e-6, "time_step": 0.002},
    "surface": {
        "density": 1.2,
        "viscosity": 1.5e-5,
        "level": 0.06,
        "regions": [{"shape": "sphere", "center": [0.2, 0.14], "radius": 0.04}],
    },
    "boundary": {"right": {"kind": "outlet", "level": 0.06}, "left": {"kind": "free_slip"}},
    "time": {"end": 0.02, "output_interval": 0.01},
}


def changed(**values):
    """The tank with dotted keys set, or removed with None."""
    return small_scenes.changed(TANK, **values)


REFUSED = {
    "surface.level": {"surface__level": 0.3},
    "surface.density": {"surface__density": 1100.0},
    "surface.viscosity": {"surface__viscosity": 0.0},
    "fluid.advection": {"fluid__advection": "central"},
    "fluid.model": {"fluid__model": "B"},
    "fluid.smagorinsky": {"fluid__smagorinsky": 0.1},
    "fluid.bulk_velocity": {
        "boundary__left": {"kind": "periodic"},
        "boundary__right": {},
        "fluid__bulk_velocity": [0.1, "free"],
    },
    "surface.heat_capacity": {
        "heat": {"fluid_heat_capacity": 1.0, "fluid_conductivity": 1.0, "fluid_temperature": 300.0}
    },
    "surface.conductivity": {"surface__conductivity": 0.03},
    "surface.temperature": {"surface__temperature": 0.0},
    "scalars.0.name": {"scalars": [{"name": "liquid_fraction"}]},
    "scalars.0.dissolved_in": {"scalars": [{"name": "dye", "dissolved_in": "gas"}]},
    "boundary.left.level": {"boundary__left": {"kind": "inlet", "velocity": 0.1}},
    "boundary.top.level": {"boundary__top": {"kind": "free_slip", "level": 0.1}},
    "boundary.right.level": {"surface": None},
    "domain.gravity": {"domain__gravity": [1.0, -9.81]},
    "fluid.time_step": {"surface__tension": 1e3, "fluid__time_step": 0.01},
}


@pytest.mark.parametrize("key", REFUSED)
def test_what_does_not_go_together_is_refused_by_name(key):
    with pytest.raises(InputError) as error:
        check_scene(load_scene(changed(**REFUSED[key])))
    assert error.value.key == key


def test_a_mesh_of_liquid_is_read_beside_the_scene_and_has_its_volume(tmp_path):
    brick = trimesh.creation.box([0.11, 0.12, 0.13])
    brick.apply_translation([0.2, 0.1, 0.1])
    brick.export(tmp_path / "brick.stl")
    tables = {
        "domain": {"size": [0.4, 0.2, 0.2]},
        "fluid": {"cells": [8, 4, 4], "viscosity": 1e-6},
        "surface": {"regions": [{"shape": "mesh", "file": "brick.stl"}]},
        "time": {"end": 0.02, "output_interval": 0.01},
    }
    (tmp_path / "scene.toml").write_text(tomli_w.dumps(tables))
    scene = load_scene(tmp_path / "scene.toml")
    assert scene.surface.regions[0].file == str(tmp_path / "brick.stl")
    assert scene.content == scene.surface.regions[0].digest != ""
    grid = fluid_setup(scene).grid
    assert np.sum(first_fraction(scene, grid)) * grid.cell_volume == pytest.approx(0.11 * 0.12 * 0.13, rel=1e-2)


def test_no_liquid_at_all_is_refused():
    with pytest.raises(InputError, match=r"surface\.level"):
        load_scene(changed(surface={"density": 1.2}))
    empty = {"surface": {"density": 1.2, "level": 0.0}, "boundary__right": {"kind": "outlet"}}
    with pytest.raises(InputError, match=r"surface\.level"):
        load_scene(changed(**empty))
    inlet = {"kind": "inlet", "velocity": 0.1, "level": 0.05}
    load_scene(changed(**empty, boundary__left=inlet))
    with pytest.raises(InputError, match=r"surface\.level"):
        load_scene(changed(**empty, boundary__left={**inlet, "level": 0.0}))


def test_liquid_that_would_fall_for_ever_is_refused():
    sides = {"bottom": {"kind": "periodic"}}
    with pytest.raises(InputError, match="falls for ever") as error:
        load_scene(changed(boundary=sides))
    assert error.value.key == "domain.gravity"
    load_scene(changed(boundary=sides, domain__gravity=[0.0, 0.0]))
    load_scene(changed(boundary=sides, fluid__pressure_gradient=[0.0, -5000.0]))
    along = {"left": {"kind": "periodic"}}  # a film that runs down a slope
    load_scene(changed(boundary=along, domain__gravity=[3.0, -9.0]))


def test_oblique_gravity_counts_whole():
    sides = {"left": {"kind": "free_slip"}}
    upright, oblique = (
        load_scene(changed(boundary=sides, domain__gravity=list(gravity))) for gravity in ((0.0, -10.0), (6.0, -8.0))
    )
    for found in (lambda s: surface_limits(s, (0.1, 0.1)), lambda s: fall_speed(s, fluid_setup(s).grid)):
        assert found(oblique) == pytest.approx(found(upright))
        assert found(upright)


@pytest.mark.parametrize(
    ("gravity", "times", "oblique"),
    [
        ([0.0, -9.81], None, False),
        ([9.81, 0.0], None, False),
        ([0.0, 0.0], None, False),
        ([1.0, -9.81], None, True),
        ([[0.0, -9.81], [0.0, -5.0]], [0.0, 0.01], False),
        ([[0.0, -9.81], [1.0, -9.81]], [0.0, 0.01], True),
        ([[0.0, -9.81], [9.81, 0.0]], [0.0, 0.01], True),
    ],
)
def test_only_oblique_gravity_compiles_the_weight_at_the_surface(gravity, times, oblique):
    """Gravity that turns from one axis to another is oblique in between. Beside walls in the mesh it is the same."""
    domain = {"size": [0.4, 0.2], "gravity": gravity} | ({} if times is None else {"gravity_times": times})
    wall = {"kind": "plane", "point": [0.0, 0.0], "normal": [-0.2, 1.0], "fluid": "no_slip"}
    for walls in ([], [wall]):
        scene = load_scene(changed(boundary={"left": {"kind": "free_slip"}}, domain=domain, walls=walls))
        assert jaxdem.build(scene)[0].fluid.solver.oblique_gravity is oblique


def test_the_force_on_a_side_is_refused():
    probe = {"kind": "wall", "name": "floor", "side": "bottom"}
    with pytest.raises(InputError, match="not measured"):
        check_scene(load_scene(changed(probes=[probe])))


def test_tension_is_continued_to_closed_sides_like_the_pressure():
    """So that both balance for a grain at a wall; at an outlet neither is continued."""
    solver = jaxdem.build(load_scene(changed()))[0].fluid.solver
    pressure = jax.numpy.asarray(np.random.default_rng(1).normal(size=solver.grid.cells))
    plain, expected = (pressure_gradient(solver.grid, solver.boundary, pressure, along) for along in (False, True))
    found = with_closed_sides(solver.grid, solver.boundary, plain)
    for a, b, c in zip(found, expected, plain, strict=True):
        np.testing.assert_array_equal(a, b)
        assert np.abs(np.asarray(b - c)).max() > 0.0


def test_the_liquid_of_the_start_has_the_volume_of_its_parts():
    scene = load_scene(changed(domain__size=[0.4, 0.2], fluid__cells=[40, 20]))
    fraction = first_fraction(scene, fluid_setup(scene).grid)
    volume = float(fraction.sum()) * 0.01**2
    assert volume == pytest.approx(0.4 * 0.06 + np.pi * 0.04**2, rel=2e-5)
    assert fraction.min() == 0.0 and fraction.max() == 1.0


@pytest.mark.parametrize(
    ("side", "inlet", "height"),
    [
        ("left", {"level": 0.15}, 0.15),
        ("left", {"level": 9.0, "from": [0.1], "to": [0.12]}, 0.12),
        ("left", {"level": 0.05, "from": [0.1], "to": [0.12]}, 0.0),
        ("top", {"level": 9.0}, 0.2),
        ("bottom", {"level": 9.0}, 0.0),
    ],
)
def test_the_automatic_step_expects_liquid_that_falls_from_an_inlet(side, inlet, height):
    sides = {side: {"kind": "inlet", "velocity": 0.1, **inlet}, "right": {"kind": "outlet"}}
    scene = load_scene(changed(surface={"density": 1.2, "level": 0.0}, boundary=sides))
    assert fall_speed(scene, fluid_setup(scene).grid) == pytest.approx(np.sqrt(2.0 * 9.81 * height))


@pytest.mark.parametrize(
    ("level", "outlets", "height"),
    [
        (0.12, {"bottom": {}}, 0.12),
        (0.12, {"bottom": {"level": 0.05}}, 0.07),
        (0.12, {"right": {"from": [0.03], "to": [0.05]}}, 0.09),
        (0.12, {"top": {}}, 0.0),
        (0.04, {"bottom": {"level": 0.3}}, 0.26),
        (0.04, {"right": {"from": [0.1], "to": [0.12], "level": 0.09}}, 0.0),
    ],
)
def test_the_automatic_step_expects_liquid_that_runs_out_of_an_outlet(level, outlets, height):
    """Without it a run over a hole in the floor stops: eight steps in an interval are too long for the jet."""
    sides = {"right": {}, **{name: {"kind": "outlet", **more} for name, more in outlets.items()}}
    surface = {"density": 1.2, "level": level}
    scene = load_scene(changed(surface=surface, boundary=sides, fluid__cells=[16, 10]))
    assert fall_speed(scene, fluid_setup(scene).grid) == pytest.approx(np.sqrt(2.0 * 9.81 * height))


def test_a_disc_over_the_corner_of_a_periodic_box_is_one_disc():
    sides = {"left": {"kind": "periodic"}, "bottom": {"kind": "periodic"}}
    surface = {"density": 1.2, "regions": [{"shape": "sphere", "center": [0.0, 0.0], "radius": 0.05}]}
    scene = load_scene(changed(boundary=sides, surface=surface, domain__gravity=[0.0, 0.0], fluid__cells=[40, 20]))
    fraction = first_fraction(scene, fluid_setup(scene).grid)
    assert float(fraction.sum()) * 0.01**2 == pytest.approx(np.pi * 0.05**2, rel=1e-4)
    np.testing.assert_allclose(fraction, fraction[::-1, ::-1], atol=1e-12)


def test_a_run_and_one_that_goes_on_from_it_on_a_coarser_mesh(tmp_path):
    jax.config.update("jax_enable_x64", True)
    run = simulate(load_scene(changed()), tmp_path / "first")
    frame = run.fluid(run.number_of_frames - 1)["liquid_fraction"]
    history, balance = run.history, run.summary["liquid_phase"]
    assert frame.shape == (16, 8) and history["liquid_volume"][-1] == pytest.approx(balance["end"])
    assert abs(balance["missing_relative"]) < 1e-13 and balance["beyond_bounds"] < 1e-9
    assert history["liquid_centre_height"][-1] < history["liquid_centre_height"][0]  # the drop falls
    later = changed(surface={"density": 1.2}, fluid__cells=[8, 4], time__end=0.03)
    later["start"] = {"from": str(tmp_path / "first")}
    kept = kept_liquid(load_scene(later), read_start(load_scene(later)))
    largest = float(np.abs(run.fluid(run.number_of_frames - 1)["velocity"]).max())  # of cells: means of two faces
    assert kept.speed >= largest > 0.1 and kept.fraction.shape == (16, 8)
    own = load_scene(later)
    mesh = fluid_setup(own, kept).grid
    fall = fall_speed(own, mesh, dataclasses.replace(kept, speed=0.0))
    assert fall > 0.3 and fall_speed(own, mesh, kept) == pytest.approx(np.hypot(fall, kept.speed))
    # Of the scene alone, which has no liquid of its own: from the level of the outlet.
    assert fall_speed(own, mesh) == pytest.approx(np.sqrt(2.0 * 9.81 * 0.06))
    on = simulate(own, tmp_path / "second")
    assert on.history["liquid_volume"][0] == pytest.approx(balance["end"], rel=1e-12)
    assert on.summary["liquid_phase"]["start"] == pytest.approx(balance["end"], rel=1e-12)
    one = changed(surface=None, boundary__right={"kind": "outlet"}, time__end=0.03)
    one["start"] = later["start"]
    with pytest.raises(InputError, match=r"start\.fluid"):
        simulate(load_scene(one), tmp_path / "third")

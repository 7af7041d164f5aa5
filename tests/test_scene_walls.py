"""Walls beside the box and random packs from the scene file: what is refused, and what is built and run."""

from __future__ import annotations

import copy
import math

import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem import InputError, build, initial_state, load_scene, simulate
from jaxdem.check.check import check_scene
from jaxdem.particles import random_packing
from jaxdem.particles.random_packing import REACHABLE
from jaxdem.particles.surfaces import Cylinder, DistanceFunction, Plane
from jaxdem.setup.builder import build_case
from jaxdem.setup.particles import particle_setup

PLANE = {"kind": "plane", "point": [0.0, 0.1], "normal": [0.0, 2.0]}
CIRCLE = {"kind": "cylinder", "center": [0.2, 0.2], "radius": 0.15}
TUBE = {"kind": "cylinder", "center": [0.2, 0.2, 0.2], "radius": 0.15, "axis": [0.0, 1.0, 0.0]}
WEDGE = {"kind": "wedge", "apex": [0.2, 0.02], "directions": [[-1.0, 1.0], [1.0, 1.0]]}


def tables(*walls, dimension=2, **particles):
    given = {"radius": 0.01, "density": 2650.0, "position": [[0.2] * dimension]} | particles
    return {
        "precision": "float64",
        "domain": {"size": [0.4] * dimension},
        "particles": {key: value for key, value in given.items() if value is not ...},
        "contact": {"young_modulus": 5e6, "restitution": 0.3},
        "walls": [copy.deepcopy(wall) for wall in walls],
        "time": {"end": 0.02, "output_interval": 0.01},
    }


def refusal(given, act=load_scene):
    with pytest.raises(InputError) as caught:
        act(given)
    assert caught.value.remedy
    return caught.value


def starts(given):
    scene = load_scene(given)
    return initial_state(scene, *build(scene))


# --- Walls ---------------------------------------------------------------------------------------------


def test_the_kinds_become_surfaces():
    scene = load_scene(tables(PLANE, CIRCLE, CIRCLE | {"inside": False}, WEDGE))
    simulation, _ = build(scene, walls=[lambda x: x[0] + 1.0])
    plane, inside, outside, left, right, function = simulation.contact.model.surfaces
    assert plane == Plane((0.0, 0.1), (0.0, 2.0))
    assert inside == Cylinder((0.2, 0.2), 0.15, None, True)
    assert outside == Cylinder((0.2, 0.2), 0.15, None, False)
    # A right angle that opens upwards: the left plane faces right, both face up.
    np.testing.assert_allclose(left.normal, [math.sqrt(0.5)] * 2)
    np.testing.assert_allclose(right.normal, [-math.sqrt(0.5), math.sqrt(0.5)])
    assert isinstance(function, DistanceFunction)
    (tube,) = build(load_scene(tables(TUBE, dimension=3)))[0].contact.model.surfaces
    assert tube == Cylinder((0.2, 0.2, 0.2), 0.15, (0.0, 1.0, 0.0), True)


def test_written_and_read_again_the_walls_are_the_same(tmp_path):
    scene = load_scene(tables(PLANE, CIRCLE, WEDGE))
    path = tmp_path / "scene.toml"
    path.write_text(scene.to_toml())
    again = load_scene(path)
    assert again == scene
    assert "inside = true" in scene.to_toml(), "every default is written out"
    assert load_scene(tables()).walls == ()


@pytest.mark.parametrize(
    ("wall", "change", "key", "words"),
    [
        (PLANE, {"kind": "sphere"}, "kind", "must be"),
        (PLANE, {"pint": [0.0, 0.0]}, "pint", "Did you mean 'point'"),
        (PLANE, {"point": ...}, "point", "point: is needed by kind = plane: a point of the plane. Add this key"),
        (
            WEDGE,
            {"apex": ...},
            "apex",
            "apex: is needed by kind = wedge: a point of the edge where its two planes meet.",
        ),
        (WEDGE, {"directions": ...}, "directions", "two directions, one in each plane, away from the edge"),
        (WEDGE, {"directions": [1.0, -1.0]}, "directions.0", "must be a list. Write it in brackets: [1.0]"),
        (PLANE, {"radius": 1.0}, "radius", "are point, normal"),
        (PLANE, {"inside": True}, "inside", "are point, normal"),
        (PLANE, {"point": [0.0]}, "point", "needs 2 numbers"),
        (PLANE, {"normal": [0.0, 0.0]}, "normal", "must not be zero"),
        (PLANE, {"normal": [0.0, math.nan]}, "normal.1", "finite"),
        (CIRCLE, {"axis": [0.0, 1.0]}, "axis", "3-D scenes only"),
        (CIRCLE, {"radius": 0.0}, "radius", "greater than 0"),
        (CIRCLE, {"inside": "yes"}, "inside", "true or false"),
        (TUBE, {"axis": ...}, "axis", "needed in 3-D"),
        (TUBE, {"axis": [0.0, 0.0, 0.0]}, "axis", "must not be zero"),
        (WEDGE, {"directions": [[1.0, 1.0]]}, "directions", "two planes"),
        (WEDGE, {"directions": [[1.0, 1.0], [-2.0, -2.0]]}, "directions", "between 0 and 180"),
        (WEDGE, {"directions": [[1.0, 1.0], [3.0, 3.0]]}, "directions", "between 0 and 180"),
        (WEDGE, {"directions": [[1.0], [-1.0, 1.0]]}, "directions.0", "needs 2 numbers"),
    ],
)
def test_a_wall_that_cannot_be_is_refused_naming_the_key(wall, change, key, words):
    given = {name: value for name, value in (wall | change).items() if value is not ...}
    error = refusal(tables(PLANE if len(wall.get("center", ())) != 3 else TUBE | {"radius": 0.19}, given,
                           dimension=len(wall.get("center", "2d"))))  # fmt: skip
    assert error.key == f"walls.1.{key}"
    assert words in str(error)


def test_walls_need_particles_and_tables():
    given = tables(PLANE) | {"fluid": {"cells": [4, 4]}}
    del given["particles"], given["contact"]
    assert refusal(given).key == "walls"
    assert refusal(tables() | {"walls": PLANE}).key == "walls"
    shape = refusal(tables(), lambda given: build(load_scene(given), walls=[lambda x: x]))
    assert shape.key == "walls" and "(2,)" in str(shape)
    unknown = refusal(tables(), lambda given: build(load_scene(given), walls=[lambda x: jnp.sqrt(x[1] - 0.05) - 0.1]))
    assert unknown.key == "walls" and "is not a number at [" in str(unknown)


def test_the_stable_step_counts_walls_that_are_functions():
    """A grain alone in a box with a floor, and in a periodic one on a floor that is a function: one limit. Without the
    function there is nothing to be stable against. A slope of 1.04 makes the wall stiffer by as much."""
    around, alone = tables(), tables()
    around["boundary"] = {side: {"kind": "periodic"} for side in ("left", "right")}
    alone["boundary"] = {side: {"kind": "periodic"} for side in ("left", "right", "bottom", "top")}
    around["domain"]["gravity"] = alone["domain"]["gravity"] = [0.0, 0.0]

    def limit(given, *functions):
        return build(load_scene(given), walls=functions)[0].steps.limits["contact_stability"]

    exact = limit(around)
    assert math.isinf(limit(alone)) and limit(alone, lambda x: x[1] - 0.1) == exact
    assert limit(alone, lambda x: 1.04 * (x[1] - 0.1)) == pytest.approx(exact / 1.04, rel=1e-6)
    # In a corner of two functions, as in that of a function and a side of the box.
    corner = limit(around, lambda x: x[0] - 0.1)
    assert limit(alone, lambda x: x[1] - 0.1, lambda x: x[0] - 0.1) == corner < exact
    longer = {**alone, "contact": alone["contact"] | {"time_step": 1.2 * exact, "law": "hertz_mindlin"}}
    error = refusal(longer, lambda given: build(load_scene(given), walls=[lambda x: x[1] - 0.1]))
    assert error.key == "contact.time_step" and "stable" in str(error)


@pytest.mark.filterwarnings("error::RuntimeWarning")  # where a function is not a number, nothing is computed with it
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_function_whose_slope_is_not_one_is_refused(factor):
    """A grain would touch it at twice or half of its radius. Where a smooth union rounds a corner the slope is less."""
    scene = load_scene(tables())
    error = refusal(None, lambda _: build(scene, walls=[lambda x: factor * (x[1] - 0.1 - 0.2 * x[0])]))
    assert error.key == "walls" and f"{1.0 / (factor * math.hypot(1.0, 0.2)):.3g} of its radius" in str(error)
    build(scene, walls=[lambda x: -0.02 * jnp.log(jnp.exp((0.1 - x[0]) / 0.02) + jnp.exp((0.1 - x[1]) / 0.02))])
    build(scene, walls=[lambda x: factor * (x[1] + 1.0)])  # not met in the box


def test_a_wall_must_be_the_same_along_a_periodic_axis():
    sides = {"boundary": {"left": {"kind": "periodic"}, "right": {"kind": "periodic"}}}
    load_scene(tables(PLANE) | sides)
    for wall in (PLANE | {"normal": [0.1, 1.0]}, CIRCLE, WEDGE):
        assert "periodic" in str(refusal(tables(wall) | sides))
    across = {"boundary": {"front": {"kind": "periodic"}, "back": {"kind": "periodic"}}}
    load_scene(tables(TUBE, dimension=3) | across)
    assert "periodic" in str(refusal(tables(TUBE | {"axis": [0.0, 1.0, 1e-3]}, dimension=3) | across))


@pytest.mark.parametrize(
    ("walls", "second", "first"),
    [
        ((PLANE, PLANE | {"point": [0.3, 0.1], "normal": [0.0, 5.0]}), "walls.1", "walls.0"),
        ((PLANE | {"point": [0.1, 0.0]},), "walls.0", "the bottom side of the box"),
        ((PLANE, PLANE | {"point": [0.4, 0.3], "normal": [-1.0, 0.0]}), "walls.1", "the right side"),
        ((PLANE | {"point": [0.0, 1e-4], "normal": [1e-4, 1.0]},), "walls.0", "the bottom side"),
        ((CIRCLE, CIRCLE), "walls.1", "walls.0"),
        ((WEDGE, {"kind": "plane", "point": [0.2, 0.02], "normal": [1.0, 1.0]}), "walls.1", "walls.0"),
    ],
)
def test_a_wall_on_another_is_refused_naming_both(walls, second, first):
    """It would count twice: a ball on two planes in one place rebounds as from a wall of twice the damping."""
    error = refusal(tables(*walls), lambda given: build(load_scene(given)))
    assert error.key == second and first in str(error)


def test_walls_that_only_meet_or_face_away_are_not_one():
    back = PLANE | {"point": [0.0, 0.3], "normal": [0.0, -1.0]}
    lid = [PLANE | {"point": [0.0, 0.4]}]  # faces out of the box: all of it lies behind
    build(load_scene(tables(PLANE, back, CIRCLE, CIRCLE | {"radius": 0.151}, WEDGE)))
    build(load_scene(tables(*lid)))
    open_side = {"boundary": {"bottom": {"particles": "remove"}}}
    build(load_scene(tables(PLANE | {"point": [0.0, 0.0]}) | open_side))
    with pytest.raises(InputError, match="function 0 of walls"):
        build(load_scene(tables(PLANE)), walls=[lambda x: x[1] - 0.1])
    across = [TUBE, TUBE | {"axis": [1.0, 0.0, 0.0]}]  # the same distance at all corners of the box
    build(load_scene(tables(*across, dimension=3)))


@pytest.mark.parametrize(
    ("wall", "place", "depth"),
    [
        (PLANE, [0.3, 0.105], "25 %"),  # 5 mm above the plane
        (PLANE, [0.3, 0.05], "300 %"),  # behind it: 5 cm and a radius
        (CIRCLE, [0.2, 0.055], "25 %"),
        (CIRCLE | {"inside": False}, [0.2, 0.355], "25 %"),
        (WEDGE, [0.2, 0.02 + 0.005 * math.sqrt(2.0)], "25 %"),
    ],
)
def test_a_particle_in_a_wall_is_refused(wall, place, depth):
    given = tables(wall, position=[[0.2, 0.2] if "inside" not in wall else [0.02, 0.02], place])
    error = refusal(given, starts)
    assert error.key == "particles.position"
    assert "particle 1 at" in str(error) and f"reaches {depth} of its diameter" in str(error)
    limit = load_scene(given).contact.maximum_overlap
    assert limit == 0.2 and "the limit is 20 %, contact.maximum_overlap" in str(error)


def test_a_pack_in_a_wall_names_both_and_no_speed_helps():
    """The pack and the wall by their names in the scene; a raised contact.speed allows no more in a pack."""
    pack = {"kind": "lattice", "start": [0.1, 0.05], "stop": [0.3, 0.2]}
    given = tables(PLANE)
    del given["particles"]["position"]
    given["particles"] |= {"pack": pack}
    for speed in (1.0, 4.0):
        error = refusal(given | {"contact": given.get("contact", {}) | {"speed": speed}}, starts)
        assert error.key == "particles.pack" and "walls.0 (plane), the limit is 1 %" in str(error)
        assert "contact.speed" not in str(error) and "normal of a wall points to the particles" in str(error)


def test_a_particle_that_touches_a_wall_is_accepted():
    state, _ = starts(tables(PLANE, position=[[0.3, 0.11], [0.1, 0.1099]]))
    assert state.particles.wall_spring[0].shape == (5, 2)
    assert starts(tables(PLANE, count=0, position=...))[0].particles.wall_spring[0].shape == (5, 0)


def test_overrides_reach_a_wall_by_its_number():
    given = tables(PLANE, WEDGE)
    scene = load_scene(given, {"walls.0.normal": [1.0, 0.0], "walls.1.apex": [0.1, 0.0]})
    assert scene.walls[0].normal == (1.0, 0.0) and scene.walls[1].apex == (0.1, 0.0)
    assert given["walls"][0] == PLANE, "the tables that were given stay as they were"
    for key in ("walls.2.normal", "walls.a.normal", "walls.0", "materials.0.friction"):
        assert "tables" in str(refusal(given, lambda given, key=key: load_scene(given, {key: 1.0})))


@pytest.mark.parametrize("key", ["walls", "materials", "material_pairs", "particles.species", "particles.inlet"])
def test_one_table_where_there_may_be_several_is_refused_with_how_to_write_it(key):
    error = refusal(tables(), lambda given: load_scene(given, {key: {"kind": "plane"}}))
    assert error.limit == "must be a list of tables" and f"Write [[{key}]]" in str(error)


def test_what_is_not_given_is_not_shown_as_none():
    """A table that only `--set` names, a missing key, a key that another one needs."""
    for changes in ({"fluid.viscosity": 1e-3}, {"time": {}}, {"contact.law": "linear_spring_dashpot"}):
        assert "None" not in str(refusal(tables(), lambda given, c=changes: load_scene(given, c)))


def test_the_check_names_the_walls():
    report = check_scene(load_scene(tables(PLANE, WEDGE)))
    assert "additional walls: plane, wedge" in report.compiled_in
    assert "additional walls" in check_scene(load_scene(tables())).left_out
    line = {"kind": "mesh", "points": [[0.01, 0.05], [0.03, 0.05]]}
    assert "additional walls: mesh" in check_scene(load_scene(tables(line))).compiled_in
    fluid = {"fluid": {"cells": [8, 8], "viscosity": 1e-6}}
    parts = check_scene(load_scene(tables(PLANE) | fluid)).compiled_in
    assert "additional walls: plane (for particles only; they do not affect the fluid)" in parts


def test_a_run_with_walls_of_both_sorts(tmp_path):
    """A disc at rest on a plane of the scene, and on a floor that is a function, by its weight.

    F = 4/3 E* sqrt(R) d^1.5 with the particles' modulus for the walls too.
    """
    modulus, mass = 5e6 / (2 * (1 - 0.3**2)), 2650.0 * 4 / 3 * math.pi * 1e-6
    depth = (0.75 * mass * 9.81 / (modulus * math.sqrt(0.01))) ** (2 / 3)
    given = tables({"kind": "plane", "point": [0.0, 0.1], "normal": [0.0, 1.0]}, position=[[0.1, 0.11 - depth]])
    run = simulate(load_scene(given), tmp_path / "plane")
    np.testing.assert_allclose(run.particles(2)["position"][0, 1], 0.11 - depth, atol=1e-3 * depth)
    given = tables(position=[[0.1, 0.11 - depth]])
    run = simulate(load_scene(given), tmp_path / "function", walls=[lambda x: jnp.minimum(x[1] - 0.1, 1.0)])
    np.testing.assert_allclose(run.particles(2)["position"][0, 1], 0.11 - depth, atol=1e-3 * depth)


# --- Random packs --------------------------------------------------------------------------------------


def random(count, dimension=2, **more):
    pack = {"kind": "random", "start": [0.05] * dimension, "stop": [0.35] * dimension} | more
    return tables(dimension=dimension, position=..., count=count, pack=pack)


@pytest.mark.parametrize(("dimension", "count"), [(2, 120), (3, 1000)])
def test_a_random_pack_has_its_count_and_its_seed(dimension, count):
    scene = load_scene(random(count, dimension))
    position = particle_setup(scene).position
    assert position.shape == (count, dimension)
    assert position.min() >= 0.06 and position.max() <= 0.34
    distance = np.linalg.norm(position[:, None] - position[None], axis=2) + np.eye(count)
    assert distance.min() >= 1.01 * 0.02
    np.testing.assert_array_equal(particle_setup(load_scene(random(count, dimension))).position, position)
    other = particle_setup(load_scene(random(count, dimension) | {"seed": 1})).position
    assert np.abs(other - position).max() > 0.01
    starts(random(count, dimension))


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_pack_that_is_too_dense_is_refused_naming_the_limit(dimension):
    """The number of particles at which the limit lies, by hand: accepted or tried below, refused above."""
    unit = math.pi if dimension == 2 else 4 / 3 * math.pi
    most = REACHABLE[dimension] * 0.3**dimension / (unit * 0.01**dimension)
    error = refusal(random(math.ceil(most), dimension, spacing=1.0), lambda t: particle_setup(load_scene(t)).position)
    assert error.key == "particles.count"
    assert f"the limit is {100 * REACHABLE[dimension]:g} %" in str(error) and "use a lattice" in error.remedy


def test_a_box_too_small_for_its_share_ends_with_a_message():
    """Three discs of 1.3 cm, 62 % of a box of 2.53 cm. Centres in a square of 1.23 cm are (sqrt 6 - sqrt 2) 1.23
    = 1.27 cm apart at most."""
    given = random(3, stop=[0.0753, 0.0753], spacing=1.0)
    given["particles"]["radius"] = 0.0065
    error = refusal(given, lambda t: particle_setup(load_scene(t)).position)
    assert error.key == "particles.count" and "have room" in str(error) and "use a lattice" in error.remedy


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"start": ...}, "particles.pack.start"),
        ({"start": [0.1]}, "particles.pack.start"),
        ({"stop": [0.01, 0.3]}, "particles.pack.stop"),
        ({"jitter": 0.1}, "particles.pack.jitter"),
        ({"vertices": [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1]]}, "particles.pack.vertices"),
    ],
)
def test_a_random_pack_that_cannot_be_is_refused_naming_the_key(change, key):
    given = random(3, **change)
    pack = given["particles"]["pack"]
    given["particles"]["pack"] = {name: value for name, value in pack.items() if value is not ...}
    assert refusal(given, lambda t: particle_setup(load_scene(t)).position).key == key
    given = random(3)
    del given["particles"]["count"]
    assert refusal(given).key == "particles.count"


def test_a_random_pack_is_laid_out_once(monkeypatch):
    laid_out = []
    random_pack = random_packing.random_pack
    monkeypatch.setattr(random_packing, "random_pack", lambda *given: laid_out.append(1) or random_pack(*given))
    case = build_case(load_scene(random(20, 2)))
    assert laid_out == []  # the builders need sizes and numbers only
    case.initial_state()
    assert laid_out == [1]

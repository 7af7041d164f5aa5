"""Cohesion in scenes: what is refused, pairs of materials, walls, gradients, precision, limits of the step, resuming.

Forces and impacts against closed forms are cases: `tests/cases/cohesion.py`.
"""

from __future__ import annotations

import copy
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from examples.extending.cohesion import SCENE, AdhesiveSpheres
from jaxdem.check.check import check_scene
from jaxdem.errors import InputError
from jaxdem.particles.adhesion import (
    DerjaguinMullerToporov,
    JohnsonKendallRoberts,
    SimplifiedJKR,
    VanDerWaals,
    contact_root,
)
from jaxdem.particles.capillary_bridge import CapillaryBridge
from jaxdem.particles.materials import surroundings
from tests.cases.cohesion import EFFECTIVE_MODULUS, EFFECTIVE_RADIUS, RADIUS, WORK, jkr_radii, two
from tests.cases.steps import time_steps
from tests.cases.surfaces import flight, grains_scene, plane_mesh, saved
from tests.cases.tiers import COMBINATION, tiered
from tests.cases.worlds import World, advance, constants, forces, track, world

JKR = {"kind": "jkr", "work_of_adhesion": 0.05}
KINDS = {
    "jkr": JKR,
    "dmt": {"kind": "dmt", "work_of_adhesion": 0.05},
    "van_der_waals": {"kind": "van_der_waals", "hamaker_constant": 1e-15, "minimum_gap": 1e-8, "cutoff": 1e-6},
    "capillary": {"kind": "capillary", "surface_tension": 0.07, "liquid_content": 0.01, "liquid_viscosity": 1e-3,
                  "minimum_gap": 1e-5},
    "sjkr": {"kind": "sjkr", "energy_density": 1e4},
}  # fmt: skip
THICK = KINDS["capillary"] | {"liquid_viscosity": 50.0}
TABLES = {
    "precision": "float64",
    "domain": {"size": [0.02, 0.02], "gravity": [0.0, -9.81]},
    "particles": {
        "radius": RADIUS, "density": 2500.0,
        "position": [[0.005, 0.00105], [0.0071, 0.00105], [0.0061, 0.0029], [0.012, 0.004]],
        "velocity": [[0.1, 0.0], [0.0, 0.0], [0.0, -0.1], [-0.3, -0.1]],
    },
    "contact": {"young_modulus": 1e6, "restitution": 0.5, "friction": 0.4, "speed": 0.5, "cohesion": JKR},
    "time": {"end": 0.02, "output_interval": 0.01},
}  # fmt: skip


def tables_of(cohesion=JKR, **changes):
    tables = copy.deepcopy(TABLES)
    tables["contact"]["cohesion"] = cohesion
    for key, value in changes.items():
        if isinstance(value, dict):
            tables[key] = {**tables.get(key, {}), **value}
        else:
            tables[key] = value
    return tables


OF_A = {"particles": TABLES["particles"] | {"material": "a"}}
WRONG = {
    "no strength": ({"kind": "jkr"}, {}, "contact.cohesion.work_of_adhesion", "needed"),
    "strength of another kind": (JKR | {"hamaker_constant": 1e-19}, {}, "contact.cohesion.hamaker_constant",
                                 "not used"),
    "unknown kind": ({"kind": "jkrs"}, {}, "contact.cohesion.kind", "must be"),
    "no gap": ({"kind": "van_der_waals", "hamaker_constant": 1e-19, "cutoff": 1e-6}, {}, "contact.cohesion.minimum_gap",
               "needed"),
    "cutoff within the gap": (KINDS["van_der_waals"] | {"cutoff": 1e-9}, {}, "contact.cohesion.cutoff", "larger"),
    "viscosity without a gap": ({"kind": "capillary", "surface_tension": 0.07, "liquid_content": 0.01,
                                 "liquid_viscosity": 1e-3}, {}, "contact.cohesion.minimum_gap", "liquid_viscosity"),
    "viscosity of jkr": (JKR | {"liquid_viscosity": 1e-3}, {}, "contact.cohesion.liquid_viscosity", "not used"),
    "too far": (KINDS["van_der_waals"] | {"cutoff": 6e-4}, {}, "contact.cohesion.cutoff", "half of the smallest"),
    "too strong": (JKR, {"contact": TABLES["contact"] | {"maximum_overlap": 0.5, "speed": 1e-3,
                   "cohesion": JKR | {"work_of_adhesion": 110.0}}}, "contact.cohesion.work_of_adhesion", "half of"),
    "a thirsty bridge": (KINDS["capillary"] | {"bridge_share": 0.2}, {}, "contact.cohesion.bridge_share",
                         "room for 6"),
    "linear law": (JKR, {"contact": {"law": "linear_spring_dashpot", "normal_stiffness": 1e3, "cohesion": JKR}},
                   "contact.cohesion.kind", "Hertz"),
    "parcels": (JKR, {"particles": TABLES["particles"] | {"coarse_grain": 2.0}}, "contact.cohesion.kind", "parcels"),
    "a step that a thick liquid makes unstable": (THICK, {"contact": TABLES["contact"] | {"time_step": 2e-6,
                                                  "cohesion": THICK}}, "contact.time_step", "stable step"),
    "material without cohesion": (None, {"materials": [{"name": "a", "work_of_adhesion": 0.1}], **OF_A},
                                  "materials.0.work_of_adhesion", "no [contact.cohesion]"),
    "material of another kind": (JKR, {"materials": [{"name": "a", "energy_density": 0.1}], **OF_A},
                                 "materials.0.energy_density", "jkr"),
    "factor with materials": (JKR | {"wall_factor": 0.5}, {"materials": [{"name": "a"}], **OF_A},
                              "contact.cohesion.wall_factor", "one material"),
    "liquid that leaves": (KINDS["capillary"], {"boundary": {"left": {"particles": "remove"}}}, "contact.cohesion.kind",
                           "lost"),
    "liquid on a wall that goes": (KINDS["capillary"], {"walls": [{"kind": "plane", "point": [0.01, 0.0],
                                   "normal": [-1.0, 0.0], "end": 0.01}]}, "contact.cohesion.kind", "begin or end"),
}  # fmt: skip


def test_the_shortest_contact_is_that_of_a_pair_however_many_kinds_there_are():
    """Each pair is as fast as its own attraction makes it; the smallest two decide."""
    place = [[0.002 + 0.0022 * k, 0.01] for k in range(8)]

    def duration(radii):
        particles = {"radius": radii, "density": 2500.0, "position": place[: len(radii)]}
        tables = {key: value for key, value in tables_of().items() if key != "particles"}
        return time_steps(jaxdem.load_scene(tables | {"particles": particles})).limits["contact_duration"]

    radii = [RADIUS * (1.0 + 0.001 * k) for k in range(8)]
    assert duration(radii) == pytest.approx(duration(radii[:1] * 2), rel=1e-12)


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_work_is_refused(name):
    cohesion, changes, key, words = WRONG[name]
    tables = {**tables_of(cohesion), **changes}
    if cohesion is None:
        del tables["contact"]["cohesion"]
    with pytest.raises(InputError) as found:
        jaxdem.build(jaxdem.load_scene(tables))
    assert found.value.key == key
    assert words in str(found.value)


def test_every_pair_of_materials_has_its_own_strength():
    """Own, given for the pair, and geometric mean; the wall follows [contact.cohesion]."""
    tables = tables_of(
        materials=[{"name": "a", "work_of_adhesion": 0.2}, {"name": "b", "work_of_adhesion": 0.3}, {"name": "c"}],
        material_pairs=[{"materials": ["a", "b"], "work_of_adhesion": 0.01}],
        particles=TABLES["particles"] | {"material": ["a", "b", "c", "a"]},
    )
    parameters = jaxdem.build(jaxdem.load_scene(tables))[1]
    strength = surroundings(parameters.contact, ()).pair.cohesion.strength
    mean = math.sqrt
    own, wall = 0.05, 0.05  # a, b, c, wall: aa ab ac aw bb bc bw cc cw ww
    expected = [0.2, 0.01, mean(0.2 * own), mean(0.2 * wall), 0.3, mean(0.3 * own), mean(0.3 * wall), own, own, wall]
    np.testing.assert_allclose(strength, expected, rtol=1e-12)


@pytest.mark.parametrize("factor", [0.0, 0.5])
def test_walls_have_a_factor(factor):
    parameters = jaxdem.build(jaxdem.load_scene(tables_of(JKR | {"wall_factor": factor})))[1]
    around = surroundings(parameters.contact, ())
    assert around.pair.cohesion.strength == 0.05
    assert around.wall.cohesion.strength == 0.05 * factor


def test_the_root_of_the_branch_and_its_slope():
    exact = np.geomspace(4.0 ** (-1.0 / 3.0) * (1.0 + 1e-6), 1e4, 200)
    overlap = jnp.asarray(exact**4 - exact)
    np.testing.assert_allclose(contact_root(overlap), exact, rtol=1e-9)
    np.testing.assert_allclose(contact_root(overlap[20:]), exact[20:], rtol=1e-14)
    slope = jax.vmap(jax.grad(contact_root))(overlap[40:])
    np.testing.assert_allclose(slope, 1.0 / (4.0 * exact[40:] ** 3 - 1.0), rtol=1e-9)
    assert np.isfinite(jax.grad(contact_root)(-3.0 / 16.0 ** (2.0 / 3.0)))


BRIDGE = {
    "contact_angle": 0.1,
    "bridge_share": 0.05,
    "largest_film": 1e-11,
    "minimum_gap": 1e-6,
    "liquid_viscosity": 1e-3,
}
OBJECTS = {
    "jkr": (JohnsonKendallRoberts(), WORK, {}),
    "dmt": (DerjaguinMullerToporov(), WORK, {}),
    "van_der_waals": (VanDerWaals(), 1e-15, {"minimum_gap": 1e-8, "cutoff": 1e-6}),
    "capillary": (CapillaryBridge(), 0.07, BRIDGE | {"liquid": [1e-11, 0.0]}),
    "sjkr": (SimplifiedJKR(), 1e5, {}),
}


@pytest.mark.parametrize("kind", tiered(OBJECTS, first=["capillary"]))
def test_gradients_are_finite_at_touch_and_at_loss(kind):
    """Of where two spheres are after three steps, by start and numbers: apart, exactly touching, at the end of the neck
    or the bridge, at rest."""
    cohesion, strength, numbers = OBJECTS[kind]
    end = jkr_radii()["end"]
    neck = math.sqrt(2.0 * math.pi * WORK * end / EFFECTIVE_MODULUS) - end**2 / EFFECTIVE_RADIUS
    static = two(0.0, cohesion, strength, held=0.0, **numbers)

    def moved(state, material, scene):
        new = advance(scene._replace(state=state, constants=material), 1e-6, 3, reversible=True).state
        return jnp.sum(new.position * jnp.asarray([[1.0, 2.0, 3.0], [4.0, 5.0, 7.0]])) + jnp.sum(new.velocity)

    run = jax.jit(jax.grad(lambda s, c, arrays: moved(s, c, World(static.interval, *arrays)), (0, 1)))
    limit = (1.0 + 0.05) * 1e-12 ** (1 / 3)
    for gap in (-1e-6, 0.0, 1e-9, neck * (1.0 - 1e-12), neck, neck * (1.0 + 1e-12), limit, 1e-7, 1e-4):
        for held in (0.0, 1e-12 if kind == "capillary" else 1.0):
            scene = two(gap, cohesion, strength, held=held, **numbers)
            found = run(scene.state, scene.constants, tuple(scene[1:]))
            assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(found)), (gap, held)


def test_the_gradient_of_a_rest_is_that_of_differences():
    """JKR, damped impact: derivative of the overlap at rest by the work of adhesion."""
    made = two(-1e-6, JohnsonKendallRoberts(), WORK, held=1.0, material={"restitution": 0.2})

    def overlap(work):
        cohesion = made.constants.cohesion._replace(strength=work)
        scene = made._replace(constants=made.constants._replace(cohesion=cohesion))
        position = advance(scene, 1e-5, 400, reversible=True).state.position
        return 2.0 * RADIUS - (position[1, 0] - position[0, 0])

    compiled = jax.jit(jax.value_and_grad(overlap))
    value, slope = compiled(WORK)
    more, less = compiled(WORK * 1.001)[0], compiled(WORK * 0.999)[0]
    assert float(slope) == pytest.approx(float(more - less) / (0.002 * WORK), rel=1e-4)
    assert float(slope) == pytest.approx(2.0 / 3.0 * float(value) / WORK, rel=0.01)  # d ~ w^(2/3) at rest


@pytest.mark.parametrize("dimension", tiered([2, 3], first=[2]))
def test_single_precision_gives_the_same_pull(dimension):
    """In 2-D and 3-D, far from the origin."""
    place = np.array([[0.5, 0.5, 0.5], [0.5 + 2 * RADIUS - 5e-7, 0.5, 0.5]])[:, :dimension]
    found = []
    for dtype in (jnp.float32, jnp.float64):
        made = world(
            place, radius=RADIUS, rebuild=False, walls=False, dtype=dtype, cohesion=JohnsonKendallRoberts(),
            material=constants(dtype, young_modulus=1e7, cohesion={"strength": WORK}),
        )  # fmt: skip
        found.append(np.asarray(jax.jit(lambda made=made: forces(made)[0])()))
    np.testing.assert_allclose(found[0], found[1], rtol=2e-4, atol=1e-12)
    assert found[1][1, 0] < 0.0


def test_a_tangential_spring_lives_in_the_neck():
    """Two spheres that JKR holds apart from each other's surface resist sliding; without memory they do not."""
    neck = 0.5 * (math.sqrt(2.0 * math.pi * WORK * jkr_radii()["end"] / EFFECTIVE_MODULUS)
                  - jkr_radii()["end"] ** 2 / EFFECTIVE_RADIUS)  # fmt: skip
    for held in (0.0, 1.0):
        made = two(
            neck, JohnsonKendallRoberts(), WORK, held=held, material={"friction": 0.5, "restitution": 0.5},
            velocity=[[0.0, 0.0, 0.0], [0.0, 1e-3, 0.0]],
        )  # fmt: skip
        after, _ = track(made, 1e-6, 3, 1)
        spring = float(after.state.contact_spring[1][0])
        assert abs(spring) == pytest.approx(held * 3e-9, rel=0.02, abs=1e-15)


@COMBINATION
@pytest.mark.parametrize("kind", ["dmt", "sjkr"])
def test_a_mesh_pulls_as_a_plane(kind, tmp_path):
    """Grains that fall on a plane of triangles, stick or slide: the same as on a plane wall."""
    path = saved(plane_mesh(10, warp=0.3), tmp_path / "plane.ply")
    place, velocity = [[0.4, 0.5, 0.321], [0.6, 0.5, 0.33]], [[0.2, 0.1, -0.05], [0.3, 0.0, -0.4]]
    cohesion = {"kind": "dmt", "work_of_adhesion": 3.0} if kind == "dmt" else {"kind": "sjkr", "energy_density": 1e5}
    contact = {"young_modulus": 1e7, "restitution": 0.5, "friction": 0.4, "speed": 1.0, "cohesion": cohesion}
    walls = ({"kind": "plane", "point": [0.0, 0.0, 0.3], "normal": [0.0, 0.0, 1.0]},
             {"kind": "mesh", "file": path, "translate": [0.0, 0.0, 0.3]})  # fmt: skip
    plane, mesh = (flight(grains_scene([wall], place, velocity, contact=contact), 16).position for wall in walls)
    del contact["cohesion"]
    bare = flight(grains_scene([walls[0]], place, velocity, contact=contact), 16).position
    assert np.abs(mesh - plane).max() < 1e-12
    assert np.abs(bare - plane).max() > 1e-5
    # A kind of the user's own may reach over a gap, and the list does not where that of the table does not.
    scene = jaxdem.load_scene(grains_scene([walls[1]], place, contact=contact | {"cohesion": cohesion}))
    with pytest.raises(InputError, match="cohesion = 'JohnsonKendallRoberts'"):
        jaxdem.build(scene, cohesion=JohnsonKendallRoberts())


def test_the_list_reaches_as_far_as_the_attraction():
    plain = copy.deepcopy(TABLES)
    del plain["contact"]["cohesion"]
    reach = {}
    for name, tables in {"none": plain, **{kind: tables_of(table) for kind, table in KINDS.items()}}.items():
        reach[name] = jaxdem.build(jaxdem.load_scene(tables))[0].search.geometry.cutoff - 2.0 * RADIUS
    volume = 2.0 * 0.05 * 0.01 * 4.0 / 3.0 * math.pi * RADIUS**3
    modulus = 1e6 / (2.0 * 0.91)
    # With a wall: R* is the radius, and E* for equal moduli that of two particles.
    neck = 3.0 / 16.0 ** (2 / 3) * (2.0 * math.pi * 0.05 / modulus) ** (2 / 3) * RADIUS ** (1 / 3)
    expected = {
        "none": 0.0,
        "jkr": neck,
        "dmt": 0.0,
        "van_der_waals": 1e-6,
        "capillary": volume ** (1 / 3),
        "sjkr": 0.0,
    }
    assert reach == pytest.approx(expected, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_check_knows_the_limits(kind):
    """Overlap and step of a scene with cohesion.

    The attraction of these tables does less work than the impact: overlaps are deeper, by less than a half.
    """
    plain = copy.deepcopy(TABLES)
    del plain["contact"]["cohesion"]
    without, report = (check_scene(jaxdem.load_scene(tables)) for tables in (plain, tables_of(KINDS[kind])))
    assert report.expected_overlap >= without.expected_overlap
    assert report.time_steps["contact"] <= without.time_steps["contact"]
    assert report.expected_overlap == pytest.approx(without.expected_overlap, rel=0.5)
    assert any(f"cohesion {kind}" in part for part in report.compiled_in)
    assert ("contact_attraction" in report.limits) == (kind in ("van_der_waals", "capillary"))


@pytest.mark.parametrize(("kind", "factor"), [("jkr", 1.5), ("dmt", 2.0)])
def test_check_tells_pull_off_force_and_bond_number(kind, factor):
    """Against pi w R* times 3/2 or 2, with R* = r/2, over 4/3 pi r^3 rho g."""
    work = KINDS[kind]["work_of_adhesion"]
    force = factor * np.pi * work * RADIUS / 2
    weight = 4 / 3 * np.pi * RADIUS**3 * 2500.0 * 9.81
    found = {n.name.strip(): (n.low, n.high) for n in check_scene(jaxdem.load_scene(tables_of(KINDS[kind]))).numbers}
    assert found["pull-off force"] == pytest.approx((force, force))
    assert found["Bond number"] == pytest.approx((force / weight, force / weight))


def test_check_tells_no_pull_off_force_where_there_is_none():
    tables = tables_of(KINDS["sjkr"])
    assert not check_scene(jaxdem.load_scene(tables)).numbers
    del tables["contact"]["cohesion"]
    assert not check_scene(jaxdem.load_scene(tables)).numbers


@pytest.mark.parametrize("kind", tiered(["jkr", "capillary"], first=["capillary"]))
def test_a_resumed_run_is_the_whole_run_bit_for_bit(kind, tmp_path):
    """On a floor that is a mesh, above the bottom of the box."""
    floor = {"kind": "mesh", "points": [[-0.01, 3e-5], [0.0105, 3e-5], [0.03, 3e-5]]}
    changes = {"precision": "float32", "output": {"checkpoint_interval": 0.0}, "walls": [floor]}
    scene = jaxdem.load_scene(tables_of(KINDS[kind], **changes))
    whole = jaxdem.simulate(scene, tmp_path / "whole")
    half = jaxdem.load_scene(tables_of(KINDS[kind], **changes, time={"end": 0.01, "output_interval": 0.01}))
    jaxdem.simulate(half, tmp_path / "half")
    jaxdem.simulate(scene, tmp_path / "half", resume=True)
    resumed = jaxdem.load_run(tmp_path / "half")
    if kind == "capillary":
        liquid = resumed.summary["liquid"]
        assert abs(liquid["missing_relative"]) < 1e-6
        assert liquid["bridges_to_walls"] > 0.0 and liquid["films"] < liquid["start"]
    for name in ("position", "velocity", "contact_force"):
        a, b = (run.particles(-1)[name] for run in (whole, resumed))
        np.testing.assert_array_equal(a, b)


def test_a_cohesion_of_the_user_that_remembers_more_than_the_kind_of_the_table_cannot_go_on(tmp_path):
    """What its contacts keep is not told apart from springs in the former run."""
    own = AdhesiveSpheres()
    tables = copy.deepcopy(SCENE)
    tables["contact"]["cohesion"]["kind"] = "dmt"
    jaxdem.simulate(jaxdem.load_scene(tables), tmp_path / "first", cohesion=own)
    del tables["particles"]
    tables |= {"start": {"from": str(tmp_path / "first")}, "time": {"end": 0.012, "output_interval": 0.006}}
    with pytest.raises(InputError, match=r"contact.cohesion.kind = 'dmt'.*keeps 1 of a contact, and this kind 0"):
        jaxdem.simulate(jaxdem.load_scene(tables), tmp_path / "second", cohesion=own)

"""Several materials and species: constants of pairs, sizes that differ, and what a scene says about them."""

from __future__ import annotations

import dataclasses
import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.check.program import compiled_parts
from jaxdem.errors import InputError
from jaxdem.particles.contact_model import MaterialIndex
from jaxdem.particles.materials import SeveralMaterials, surroundings
from jaxdem.particles.rolling import ConstantDirectionalTorque
from jaxdem.particles.surfaces import Plane
from jaxdem.setup.materials import material_table
from jaxdem.setup.particles import particle_setup
from jaxdem.setup.stability import hertz_duration
from jaxdem.setup.wall_motion import check_pistons
from tests.cases.steps import time_steps
from tests.cases.worlds import advance, batch, forces, track, world

ELASTIC = {"soft": (1e9, 0.2), "hard": (1e10, 0.4)}
TABLES = {
    "seed": 3,
    "precision": "float64",
    "domain": {"size": [1.0, 1.0, 1.0], "gravity": [0.0, 0.0, 0.0]},
    "contact": {"speed": 1.0, "friction": 0.0, "restitution": 0.9},
    "materials": [
        {"name": "soft", "young_modulus": 1e9, "poisson_ratio": 0.2, "restitution": 0.9, "friction": 0.4},
        {"name": "hard", "young_modulus": 1e10, "poisson_ratio": 0.4, "restitution": 0.4, "friction": 0.1},
    ],
    "time": {"end": 0.01, "output_interval": 0.01},
}
SOFT_SOFT, SOFT_HARD, SOFT_WALL, HARD_HARD, HARD_WALL, WALL_WALL = range(6)
SPEED, RADIUS, STEPS = 0.5, 0.01, 200


def scene_of(material="soft", radius=0.01, **changes):
    """A scene of two grains apart, one of either material if two names are given."""
    particles = {
        "position": [[0.2, 0.2, 0.2], [0.5, 0.5, 0.5]], "radius": radius, "density": 2500.0, "material": material,
    }  # fmt: skip
    tables = {**TABLES, "particles": particles}
    for key, value in changes.items():
        tables[key] = {**tables[key], **value} if isinstance(value, dict) else value
    return jaxdem.load_scene(tables)


def table_of(constants):
    """The constants of all pairs, as the program has them."""
    return surroundings(constants, ()).pair


def tables_of(**pairs):
    """Constants of a scene in which all pairs have their own, as the geometric means are: one structure for a batch.

    Args:
        **pairs: name -> number of a pair -> value, in place of the mean.
    """
    mixed = table_of(jaxdem.build(scene_of())[1].contact)
    names = (("soft", "hard"), ("soft", "wall"), ("hard", "wall"))
    rows = {number: {"materials": two} for number, two in zip((SOFT_HARD, SOFT_WALL, HARD_WALL), names, strict=True)}
    materials = [dict(material) for material in TABLES["materials"]]
    for name in ("restitution", "friction", "rolling_friction"):
        values = np.asarray(getattr(mixed, name)).copy()
        for number, value in pairs.get(name, {}).items():
            values[number] = value
        for number, row in rows.items():
            row[name] = float(values[number])
        for material, number in zip(materials, (SOFT_SOFT, HARD_HARD), strict=True):
            material[name] = float(values[number])
    return jaxdem.build(scene_of(materials=materials, material_pairs=list(rows.values())))[1].contact


def with_materials(scene, constants, walls=()):
    """A world whose first particle is soft and whose second is hard, on walls of these materials."""
    index = MaterialIndex.of(np.asarray([0, 1]), np.asarray(walls, int), material_table(scene_of()).pair)
    interval = dataclasses.replace(scene.interval, model=dataclasses.replace(scene.interval.model, materials=index))
    return scene._replace(interval=interval, constants=constants)


def pair_of(constants, radius=(RADIUS, RADIUS), gap=1e-9, across=0.0, speed=SPEED):
    """A soft and a hard ball that meet along x, and a two-hundredth of the duration of their impact."""
    position = [[0.5, 0.5], [0.5 + sum(radius) + gap, 0.5]]
    velocity = [[0.5 * speed, across], [-0.5 * speed, -across]]
    scene = world(position, velocity, radius=np.asarray(radius), walls=False, rebuild=False)
    mass = [4.0 / 3.0 * np.pi * r**3 * 2500.0 for r in radius]
    modulus = 1.0 / sum((1.0 - nu**2) / young for young, nu in ELASTIC.values())
    reduced = [a * b / (a + b) for a, b in (mass, radius)]
    step = hertz_duration(*reduced, modulus, speed or 1.0) / STEPS
    return with_materials(scene, constants), step if speed else 1e-15


@pytest.fixture(scope="module")
def impacts():
    """All impacts of a soft and a hard ball, in one program."""
    mixed, said = tables_of(), tables_of(restitution={SOFT_HARD: 0.25})
    rubbing = tables_of(friction={SOFT_HARD: 0.05})
    cases = {
        "mixed": pair_of(mixed),
        "said": pair_of(said),
        "ten to one": pair_of(mixed, (0.05, 0.005)),
        "pressed": pair_of(mixed, (0.01, 0.02), gap=-1e-6, speed=0.0),
        "rubbing": pair_of(rubbing, across=2.0),
        "rubbing, ten to one": pair_of(rubbing, (0.05, 0.005), across=2.0),
    }
    scenes = [scene for scene, _ in cases.values()]
    # One static part for all; particles and walls have the same materials in each.
    _, seen = track(batch(scenes), [step for _, step in cases.values()], STEPS + STEPS // 2)
    return {name: (scenes[k], type(seen)(*(a[k] for a in seen))) for k, name in enumerate(cases)}


@pytest.mark.parametrize(
    ("name", "restitution"),
    [("mixed", np.sqrt(0.9 * 0.4)), ("said", 0.25), ("ten to one", np.sqrt(0.9 * 0.4))],
)
def test_restitution_and_momentum_of_a_pair(impacts, name, restitution):
    """The geometric mean of 0.9 and 0.4, or what the pair says; also where the masses are 1000 to 1.

    A two-hundredth of the impact a step; momentum is that of the start, zero for equals, to round-off."""
    scene, seen = impacts[name]
    ends, mass = seen.velocity[-1], np.asarray(scene.properties.mass)
    assert ends[1, 0] - ends[0, 0] == pytest.approx(restitution * SPEED, rel=0.01)
    before = mass @ np.asarray(scene.state.velocity)
    np.testing.assert_allclose(mass @ ends, before, atol=1e-13 * mass.max() * SPEED)


def test_force_of_two_materials_is_that_of_hertz(impacts):
    """F = 4/3 E* sqrt(R*) d^1.5 with 1/E* = (1 - a^2)/E_a + (1 - b^2)/E_b (Johnson 1985, eqs 4.22 and 4.23)."""
    modulus = 1.0 / sum((1.0 - nu**2) / young for young, nu in ELASTIC.values())
    force = 4.0 / 3.0 * modulus * np.sqrt(0.01 * 0.02 / 0.03) * 1e-6**1.5
    np.testing.assert_allclose(impacts["pressed"][1].force[0, :, 0], [-force, force], rtol=1e-6)


@pytest.mark.parametrize("name", ["rubbing", "rubbing, ten to one"])
def test_sliding_friction_is_that_of_the_pair(impacts, name):
    """|F_t| = mu |F_n| in the middle of an oblique impact, whatever the sizes; and the two spins come from one
    force on arms r - d/2."""
    scene, seen = impacts[name]
    middle = STEPS // 2
    normal = seen.position[middle, 1] - seen.position[middle, 0]
    normal /= np.linalg.norm(normal)
    force = seen.force[middle, 0]
    along = force @ normal
    across = force[1] * normal[0] - force[0] * normal[1]
    assert along < 0.0
    # The normal turns by a step's share of the impact within a frame.
    assert abs(across / along) == pytest.approx(0.05, rel=5e-3)
    spin = np.asarray(scene.properties.inertia) * seen.spin[-1, :, 0]
    np.testing.assert_allclose(spin[0] / spin[1], np.divide(*np.asarray(scene.properties.radius)), rtol=5e-3)


def test_walls_have_materials():
    """Two balls pressed on the floor, of "wall", and on a plane, soft: friction, then rolling, of each pair."""
    position = [[0.3, RADIUS - 1e-6], [0.7, 0.5 + RADIUS - 1e-6]]
    plane = Plane((0.0, 0.5), (0.0, 1.0))
    base = world(
        position, [[1.0, 0.0]] * 2, [[100.0]] * 2, rolling=ConstantDirectionalTorque(), surfaces=(plane,),
        rebuild=False,
    )  # fmt: skip
    # The soft ball is on the floor, which is left where it would be above the plane.
    base = base._replace(state=base.state._replace(position=base.state.position.at[0, 1].set(0.5 + RADIUS - 1e-6)))
    nothing = dict.fromkeys(range(6), 0.0)
    friction = tables_of(friction=nothing | {SOFT_SOFT: 0.13, SOFT_HARD: 0.11})
    rolling = tables_of(friction=nothing, rolling_friction=nothing | {SOFT_SOFT: 0.3, SOFT_HARD: 0.2})
    walls = [2, 2, 2, 2, 0]
    scenes = [with_materials(base, constants, walls) for constants in (friction, rolling)]
    step = 1e-7
    _, seen = track(batch(scenes), [step, step], 1, 1)
    force = seen.force[:, 0]
    np.testing.assert_allclose(force[0, :, 0] / force[0, :, 1], [-0.13, -0.11], rtol=1e-6)
    lost = (100.0 - seen.spin[1, 0, :, 0]) * np.asarray(base.properties.inertia)
    np.testing.assert_allclose(lost, np.asarray([0.3, 0.2]) * force[1, :, 1] * RADIUS * step, rtol=0.01)


def test_gradients_by_the_constants_of_a_pair():
    """Of a damped, sliding contact's force, by the restitution and friction of a material that its pair is mixed from,
    and by a modulus: central differences."""
    scene, _ = pair_of(jaxdem.build(scene_of())[1].contact, gap=-1e-6, across=2.0)
    numbers = scene.constants.numbers

    def force(constants):
        return jnp.sum(forces(scene._replace(constants=constants), 1e-6)[0][0] * jnp.asarray([1.0, 2.0]))

    compiled = jax.jit(jax.value_and_grad(force))
    slopes = compiled(scene.constants)[1]
    assert isinstance(slopes, SeveralMaterials)
    for name in ("restitution", "friction", "young_modulus"):
        values, index = (
            getattr(scene.constants, name),
            getattr(numbers, name).keys.index(f"materials.0.{name}"),
        )
        step = 1e-5 * values[index]
        ahead, behind = (
            compiled(scene.constants._replace(**{name: values.at[index].add(sign * step)}))[0] for sign in (1, -1)
        )
        assert ahead != behind
        np.testing.assert_allclose(getattr(slopes, name)[index], (ahead - behind) / (2.0 * step), rtol=1e-5)
    assert (
        slopes.restitution[numbers.restitution.keys.index("contact.restitution")] == 0.0
    )  # of walls, which there are none


def test_a_constant_of_zero_has_finite_derivatives_in_its_pairs():
    """The geometric mean with 0 is 0, and so is the derivative that is used; nothing becomes NaN for the others."""
    materials = [dict(TABLES["materials"][0], friction=0.0), TABLES["materials"][1]]
    constants = jaxdem.build(scene_of(materials=materials))[1].contact
    assert table_of(constants).friction[SOFT_HARD] == 0.0
    slopes = jax.jacobian(lambda c: table_of(c).friction)(constants).friction
    assert np.isfinite(slopes).all()
    index = constants.numbers.friction.keys.index("materials.0.friction")
    assert slopes[SOFT_SOFT, index] == 1.0


def test_one_material_compiles_no_table():
    """Six pairs of two materials and the wall; without [[materials]] the program knows of none."""
    several, _ = pair_of(tables_of())
    model = dataclasses.replace(several.interval.model, materials=None)
    plain = {name: value for name, value in TABLES.items() if name != "materials"}
    particles = {"position": [[0.2, 0.2, 0.2]], "radius": 0.01, "density": 2500.0}
    simulation, parameters = jaxdem.build(jaxdem.load_scene({**plain, "particles": particles}))
    assert simulation.contact.model.materials is None
    single = several._replace(interval=dataclasses.replace(several.interval, model=model), constants=parameters.contact)

    def program(scene):
        return jax.jit(lambda s: advance(scene._replace(state=s), 1e-6, 3).state).lower(scene.state).as_text()

    assert "tensor<6xf64>" in program(several)
    assert "tensor<6xf64>" not in program(single)


def test_the_build_hands_materials_on():
    """Of particles and walls, a wedge being two; and all constants of the table in the parameters."""
    walls = [
        {"kind": "plane", "point": [0.0, 0.0, 0.1], "normal": [0.0, 0.0, 1.0], "material": "hard"},
        {"kind": "wedge", "apex": [0.5, 0.0, 0.0], "directions": [[1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]]},
    ]
    contact = {"wall_material": "soft"}
    simulation, parameters = jaxdem.build(scene_of(["soft", "hard"], walls=walls, contact=contact))
    index = simulation.contact.model.materials
    assert index.particle == (0, 1)
    assert index.wall == (0,) * 6 + (1, 0, 0)
    table, given = material_table(scene_of()), parameters.contact
    assert float(table_of(given).friction[SOFT_HARD]) == pytest.approx(0.2)  # of 0.4 and 0.1
    assert float(table_of(given).restitution[SOFT_HARD]) == pytest.approx(0.6)  # of 0.9 and 0.4
    for name in ("restitution", "friction", "rolling_friction"):  # host and program have the same
        np.testing.assert_allclose(getattr(table_of(given), name), getattr(table, name), rtol=1e-15)
    keys = ("contact.young_modulus", "materials.0.young_modulus", "materials.1.young_modulus")
    assert given.numbers.young_modulus.keys == keys
    assert given.young_modulus.tolist() == [7e7, 1e9, 1e10]
    assert table.young_modulus.tolist() == [1e9, 1e10, 7e7]
    scene = scene_of(["soft", "hard"], walls=walls, contact=contact)
    assert "materials by pair: soft, hard" in compiled_parts(scene, simulation, parameters)[0]
    assert float(jaxdem.build(scene_of())[0].contact.model.materials.particle) == 0


def test_the_contact_step_stands_on_the_worst_pair():
    """Hard grains decide it, also where they are few; and a hard wall, and the smaller of two sizes."""

    def limits(material="soft", radius=0.01, **contact):
        return time_steps(scene_of(material, radius, contact=contact)).limits

    soft, mixed = (limits(names, wall_material="soft") for names in ("soft", ["soft", "hard"]))
    assert mixed["rayleigh"] == pytest.approx(2.791e-5, rel=1e-3)  # pi r sqrt(rho/G)/(0.1631 nu + 0.8766)
    for name in ("rayleigh", "contact_duration", "contact_stability"):
        assert mixed[name] < soft[name]
    assert limits(wall_material="hard")["contact_duration"] < soft["contact_duration"]
    # A ball between larger ones is the stiffer spring.
    small = limits(radius=0.005, wall_material="soft")["contact_stability"]
    plain = {name: value for name, value in TABLES.items() if name != "materials"}
    particles = {"position": [[0.2, 0.2, 0.2], [0.5, 0.5, 0.5]], "density": 2500.0}
    alike, unlike = (
        time_steps(jaxdem.load_scene({**plain, "particles": {**particles, "radius": radius}})).limits
        for radius in (0.005, [0.005, 0.05])
    )
    assert unlike["contact_stability"] < alike["contact_stability"]
    assert small < soft["contact_stability"]


def test_a_hard_grain_that_is_alone_does_not_meet_another():
    """Its contacts are with soft ones and with walls; a second one brings those of two hard grains."""
    places = [[0.2, 0.2, 0.2], [0.5, 0.5, 0.5], [0.8, 0.8, 0.8]]

    def limits(*materials):
        scene = scene_of(list(materials), particles={"position": places}, contact={"wall_material": "soft"})
        return time_steps(scene).limits

    one, two, all_soft = limits("soft", "soft", "hard"), limits("soft", "hard", "hard"), limits("soft", "soft", "soft")
    for name in ("contact_duration", "contact_stability"):
        assert two[name] < one[name] < all_soft[name]
    assert two["contact_duration"] / one["contact_duration"] < 0.6  # (E* of soft and hard / E* of two hard ones)^(2/5)


def test_friction_of_some_pairs_counts_for_all():
    """Among smooth contacts and rough ones the worst neighbourhood is neither that of the one nor of the other."""
    places = [[0.2, 0.2, 0.2], [0.5, 0.5, 0.5], [0.8, 0.8, 0.8]]

    def limit(alike, unlike):
        tables = {
            "materials": [TABLES["materials"][0] | {"friction": alike}, TABLES["materials"][1]],
            "material_pairs": [{"materials": ["soft", "hard"], "friction": unlike}],
        }
        scene = scene_of(["soft", "soft", "hard"], particles={"position": places}, **tables)
        return time_steps(scene).limits["contact_stability"]

    assert limit(0.5, 0.0) == limit(0.0, 0.5) == limit(0.5, 0.5) < limit(0.0, 0.0)


def test_a_piston_on_grains_of_several_materials_is_as_heavy_as_the_heaviest_ask():
    """2 N m of the material whose smallest grains have the largest m, at the step that is stable just so."""
    piston = {"kind": "plane", "point": [0.5, 0.5, 0.9], "normal": [0.0, 0.0, -1.0]}
    piston |= {"piston": {"direction": [0.0, 0.0, -1.0], "force": 1.0, "mass": 1e-6}}
    scene = scene_of(["soft", "hard"], radius=[0.01, 0.02], walls=[piston])
    with pytest.raises(InputError, match="too light") as caught:
        check_pistons(particle_setup(scene), 1e-6, 1e-6)
    needed = float(str(caught.value).split("needs ")[1].split()[0])
    assert needed == pytest.approx(2.0 * 2 * 4.0 / 3.0 * np.pi * 0.02**3 * 2500.0, rel=1e-2)


SPECIES = [
    {"share": 0.75, "radius": 0.01, "density": 2500.0, "material": "soft"},
    {"share": 0.25, "radius": 0.02, "density": 7800.0, "material": "hard"},
]


def mixed(**particles):
    pack = {"kind": "random", "start": [0.0, 0.0, 0.0], "stop": [1.0, 1.0, 1.0]}
    return jaxdem.load_scene({**TABLES, "particles": {"count": 201, "pack": pack, **particles}})


def test_species_are_mixed_by_share_and_seed():
    """201 particles, 3 to 1: 151 and 50; every particle has the size, density and material of its species."""
    scene = mixed(species=SPECIES)
    bodies = particle_setup(scene).bodies
    assert sorted(np.unique(bodies.radius, return_counts=True)[1].tolist()) == [50, 151]
    np.testing.assert_array_equal(bodies.material, (bodies.radius > 0.015).astype(int))
    np.testing.assert_array_equal(bodies.density, np.where(bodies.radius > 0.015, 7800.0, 2500.0))
    assert 20 < np.flatnonzero(bodies.material).mean() / 201 * 100 < 80
    other = particle_setup(scene.model_copy(update={"seed": 4})).bodies
    assert (other.material != bodies.material).any()
    again = jaxdem.load_scene(tomllib.loads(scene.to_toml()))
    np.testing.assert_array_equal(particle_setup(again).bodies.material, bodies.material)
    assert again == scene
    position = particle_setup(scene).position
    depth = bodies.radius[:, None] + bodies.radius[None] - np.linalg.norm(position[:, None] - position, axis=2)
    assert depth[~np.eye(201, dtype=bool)].max() < 0.0


def test_sizes_and_densities_from_a_file(tmp_path):
    radius = np.linspace(0.005, 0.02, 201)
    np.savetxt(tmp_path / "radius.csv", radius)
    np.save(tmp_path / "density.npy", 1e5 * radius)
    text = mixed(radius=0.01, density=1.0, material="soft").to_toml()
    text = text.replace("radius = 0.01", 'radius = "radius.csv"', 1).replace("density = 1.0", 'density = "density.npy"')
    (tmp_path / "scene.toml").write_text(text)
    bodies = particle_setup(jaxdem.load_scene(tmp_path / "scene.toml")).bodies
    np.testing.assert_allclose(bodies.radius, radius, rtol=1e-14)
    np.testing.assert_allclose(bodies.density, 1e5 * radius, rtol=1e-14)
    np.savetxt(tmp_path / "radius.csv", radius[1:])
    with pytest.raises(InputError, match="201 particles"):
        _ = particle_setup(jaxdem.load_scene(tmp_path / "scene.toml")).bodies


@pytest.mark.parametrize(
    ("particles", "tables", "key", "words"),
    [
        ({"material": "sot"}, {}, "particles.material", "Did you mean 'soft'"),
        ({}, {}, "particles.material", "missing"),
        ({"material": "soft"}, {"materials": []}, "particles.material", "Known: none"),
        ({"species": [{"share": 0.5, "material": "soft"}]}, {}, "particles.species.share", "add up to 1"),
        ({"species": [{"share": 1.0}]}, {}, "particles.species.0.material", "missing"),
        ({"species": [{"share": 1.0, "radios": 1.0}]}, {}, "particles.species.0.radios", "Did you mean 'radius'"),
        ({"material": "soft"}, {"contact": {"wall_material": "steel"}}, "contact.wall_material", "Known"),
        ({"material": "soft"},
         {"contact": {"wall_material": "soft", "wall_friction": 0.1}}, "contact.wall_friction", "Remove one"),
        ({"material": "soft"},
         {"material_pairs": [{"materials": ["soft", "hard"]}]}, "material_pairs.0", "has no constants"),
        ({"material": "soft"},
         {"material_pairs": [{"materials": ["soft", "soft"], "friction": 1.0}]}, "material_pairs.0.materials",
          "own table"),
        ({"material": "soft"},
         {"materials": [{"name": "soft"}, {"name": "soft"}]}, "materials.1.name", "is used twice"),
        ({"material": "soft", "radius": "nowhere.csv"}, {}, "particles.radius", "no such file"),
    ],
)  # fmt: skip
def test_mistakes_are_named(particles, tables, key, words):
    base = {"radius": 0.01, "density": 2500.0, "position": [[0.5, 0.5, 0.5]]}
    with pytest.raises(InputError) as caught:
        _ = particle_setup(jaxdem.load_scene({**TABLES, **tables, "particles": {**base, **particles}})).bodies
    assert caught.value.key == key
    assert words in str(caught.value)

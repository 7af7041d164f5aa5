"""The scene file: what is refused, in which words, and that reading and writing agree."""

from __future__ import annotations

import copy
import math
import re
import tomllib
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from jaxdem import (
    InputError,
    build,
    external_fluid,
    initial_state,
    load_scene,
    neighbors_from_jax_md,
    rollout,
    simulate,
)
from jaxdem.closures import KochHill, SubgridClosure
from jaxdem.fluid.boundary import Side
from jaxdem.fluid.inlet import Parabola
from jaxdem.particles.adhesion import JohnsonKendallRoberts
from jaxdem.particles.contact import HertzMindlin
from jaxdem.run.samples import samples_every
from jaxdem.scene import parse_override
from jaxdem.setup.extensions import Extensions
from jaxdem.setup.overlaps import check_initial_positions
from jaxdem.setup.particles import particle_setup
from tests.cases.steps import time_steps

VALID = {
    "seed": 3,
    "domain": {"size": [0.4, 0.4], "depth": 0.04, "gravity": [0.0, -9.81]},
    "particles": {
        "count": 20,
        "radius": 0.01,
        "density": 2650.0,
        "pack": {"kind": "lattice", "start": [0.05, 0.05], "stop": [0.3, 0.3], "spacing": 1.2},
    },
    "contact": {"young_modulus": 5e6, "restitution": 0.7, "friction": 0.4, "time_step": "auto"},
    "fluid": {"cells": [8, 8], "density": 1000.0, "viscosity": 1e-6, "time_step": 0.005},
    "boundary": {
        "left": {"kind": "inlet", "velocity": 0.1, "from": 0.1, "to": 0.2},
        "right": {"kind": "outlet"},
    },
    "coupling": {"drag": "koch_hill", "kernel_width": {"diameters": 1.5, "cells": 1.0}},
    "time": {"end": 0.1, "output_interval": 0.05},
    "output": {"samples": 0.0},
}


def changed(key, value):
    """The valid tables with one dotted key set, or removed where the value is `...`."""
    tables = copy.deepcopy(VALID)
    *parents, last = key.split(".")
    table = tables
    for part in parents:
        table = table.setdefault(part, {})
    if value is ...:
        del table[last]
    else:
        table[last] = value
    return tables


def refusal(tables, **options):
    with pytest.raises(InputError) as caught:
        load_scene(tables, **options)
    assert caught.value.exit_code == 2
    assert caught.value.remedy
    return caught.value


def placed(*positions, **more):
    """A valid scene with particles at given positions."""
    tables = changed("particles", {"radius": 0.01, "density": 2650.0, "position": [list(p) for p in positions]})
    tables["particles"] |= more
    return tables


def test_the_valid_scene_is_accepted():
    scene = load_scene(VALID)
    assert scene.boundary["left"].velocity == (0.1, 0.0)
    assert scene.boundary["top"].kind == "no_slip"
    assert scene.contact.wall_friction is None and scene.contact.of_walls("friction") == scene.contact.friction


@pytest.mark.parametrize(
    "name", ["[", "(x", "a[0]", "int", "str", "float", "tuple", "function-after", "\x1b[31m", "é\n", ""]
)
@pytest.mark.parametrize(
    ("table", "known"),
    [
        ("", "precision"),
        ("contact.", "friction"),
        ("boundary.left.", "velocity"),
        ("boundary.", "left"),
        ("particles.pack.", "jitter"),
        ("coupling.kernel_width.", "diameters"),
    ],
)
def test_an_unknown_key_may_have_any_name(table, known, name):
    """pydantic's labels of branches look like some of them."""
    error = refusal(VALID, overrides={f"{table}{name}": {"kind": "wall"} if table == "boundary." else 1})
    shown = name.replace("\x1b", "\\x1b").replace("\n", "\\n") or '""'
    assert str(error).startswith(f"{table}{shown} = ") and "unknown key" in str(error)
    assert known in str(error) or "Did you mean" in str(error)
    assert "\x1b" not in str(error) and "\n" not in str(error)


@pytest.mark.parametrize("given", [(None,), (3,), (["a"],), (b"scene.toml",)], ids=str)
def test_what_is_neither_a_path_nor_tables_is_refused(given):
    with pytest.raises(InputError, match=r"^scene = .* is neither a path nor a dict of tables"):
        load_scene(*given)


@pytest.mark.parametrize("overrides", ["time.end=1.0", ["time.end=1.0"], {1: 2.0}], ids=str)
def test_changes_that_are_no_dotted_keys_are_refused(overrides):
    assert refusal(VALID, overrides=overrides).key == "overrides"


@pytest.mark.parametrize("value", [{"float": 1}, {"tuple": [1]}, {"constrained-float": 1}])
def test_a_table_in_place_of_a_number_is_what_is_wrong(value):
    assert refusal(VALID, overrides={"particles.radius": value}).key == "particles.radius"


def test_tables_without_end_are_refused():
    deep = "x"
    for _ in range(500):
        deep = [deep]
    for key, value in ((".".join("a" * 2000), 1), ("particles.position", deep), ("time", {"end": deep})):
        assert "20 deep" in str(refusal(VALID, overrides={key: value}))


@pytest.mark.parametrize(
    ("key", "meant"),
    [
        ("particles.radus", "radius"),
        ("fluid.viscocity", "viscosity"),
        ("contact.youngs_modulus", "young_modulus"),
        ("particles.pack.spacng", "spacing"),
        ("boundary.left.velcity", "velocity"),
        ("boundary.lefft.kind", "left"),
        ("coupling.kernel_width.diameter", "diameters"),
        ("time.ende", "end"),
        ("flud", "fluid"),
    ],
)
def test_an_unknown_key_is_refused_with_the_nearest_name(key, meant):
    error = refusal(changed(key, "no_slip" if key.endswith("kind") else 1.0))
    named = key if not key.startswith("boundary.lefft") else "boundary.lefft"
    assert error.key == named
    assert repr(meant) in str(error)


@pytest.mark.parametrize("value", ["abc", True, [], {}, math.nan, math.inf, -math.inf, -1.0, 0.0])
@pytest.mark.parametrize("key", ["time.end", "fluid.density", "particles.density", "contact.young_modulus"])
def test_a_positive_number_must_be_one(key, value):
    assert refusal(changed(key, value)).key.startswith(key)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("particles.radius", 0.0),
        ("particles.radius", [0.01, -0.01]),
        ("particles.count", -1),
        ("particles.count", 2.5),
        ("domain.size", [0.4, 0.0]),
        ("domain.size", [0.4]),
        ("domain.size", [0.4, 0.4, 0.4, 0.4]),
        ("domain.gravity", [0.0, 0.0, -9.81]),
        ("domain.gravity", [0.0, math.nan]),
        ("fluid.cells", [8, 8, 8]),
        ("fluid.cells", [8, 0]),
        ("fluid.cells", [8.5, 8]),
        ("fluid.viscosity", 0.0),
        ("fluid.viscosity", -1e-6),
        ("fluid.velocity", [0.0]),
        ("fluid.advection", "quick"),
        ("fluid.model", "C"),
        ("fluid.smagorinsky", -0.1),
        ("fluid.smagorinsky", 1.5),
        ("fluid.smagorinsky", "dynamic"),
        ("contact.restitution", 1.5),
        ("contact.poisson_ratio", 0.7),
        ("contact.law", "hooke"),
        ("contact.law", "linear_spring_dashpot"),
        ("boundary.left.velocity", [0.1, 0.0, 0.0]),
        ("boundary.left.velocity", ...),
        ("boundary.right.velocity", 1.0),
        ("boundary.left.times", [0.0, 1.0]),
        ("boundary.left.velocities", [0.0, 1.0]),
        ("boundary.left", {"kind": "inlet", "times": [0.0, 1.0]}),
        ("boundary.left", {"kind": "inlet", "times": [1.0, 0.5], "velocities": [0.0, 1.0]}),
        ("boundary.left", {"kind": "inlet", "times": [0.0, 0.5], "velocities": [0.0, 1.0, 2.0]}),
        ("boundary.left", {"kind": "inlet", "times": [0.0, 0.5], "velocities": [0.0, [1.0]]}),
        ("boundary.left", {"kind": "inlet", "times": [0.0], "velocities": [0.0]}),
        ("boundary.right.times", [0.0, 1.0]),
        ("boundary.right.profile", "parabolic"),
        ("boundary.left.profile", "cubic"),
        ("boundary.left.profile", "table"),
        ("boundary.left.positions", [0.0, 0.4]),
        ("boundary.left", {"kind": "inlet", "velocity": 1.0, "positions": [0.0, 0.4], "values": [1.0, 1.0]}),
        (
            "boundary.left",
            {
                "kind": "inlet",
                "velocity": 1.0,
                "profile": "table",
                "positions": [0.0, 0.3],
                "values": [1.0, 1.0],
            },
        ),
        ("boundary.left.from", ...),
        ("boundary.left.to", 0.5),
        ("boundary.left.from", -0.1),
        ("boundary.left.from", 0.3),
        ("boundary.left.from", [0.1, 0.1]),
        ("boundary.front", {"kind": "no_slip"}),
        ("boundary.top", {"kind": "moving_wall", "velocity": 1.0}),
        ("boundary.top", {"kind": "moving_wall", "velocity": [0.0, 1.0]}),
        ("coupling.kernel_width", 0.0),
        ("time.output_interval", 0.03),
        ("time.output_interval", 0.2),
        ("time.output_interval", 1e-300),
        ("precision", "float16"),
        ("seed", -1),
        ("particles.pack", ...),
        ("particles.position", [[0.1, 0.1]]),
        ("particles.pack.vertices", [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1]]),
        ("particles.pack.start", ...),
        ("particles", ...),
        ("fluid", ...),
    ],
)
def test_what_cannot_work_is_refused_naming_the_key(key, value):
    error = refusal(changed(key, value))
    section = key.split(".")[0]
    owners = {"particles": ("particles", "contact"), "fluid": ("fluid", "coupling")}
    assert error.key.startswith(owners.get(section, (section,)))


CLOSED = {"left": {"kind": "no_slip"}}
DROPS = [{"side": "top", "rate": 10.0, "velocity": 0.1}]


@pytest.mark.parametrize(
    ("section", "tables", "key", "words"),
    [
        (
            "boundary",
            {"left": VALID["boundary"]["left"]},
            "boundary.left.velocity",
            "the inflow exceeds the outflow by 0.0002 m3/s at t = 0.025 s",
        ),
        (
            "boundary",
            VALID["boundary"] | {"right": {"kind": "inlet", "velocity": [0.0999, 0.0], "from": 0.1, "to": 0.2}},
            "boundary.left.velocity",
            "without an outlet",
        ),
        (
            "boundary",
            VALID["boundary"] | {"right": {"kind": "outlet", "from": 0.0, "to": 0.02}},
            "boundary.right.from",
            "less than half of every face",
        ),
        (
            "boundary",
            VALID["boundary"] | {"top": {"kind": "moving_wall", "velocity": [1.0, 0.0], "from": 0.0, "to": 0.2}},
            "boundary.top.from",
            "not the particles",
        ),
        ("particles", VALID["particles"] | {"inlet": DROPS}, "particles.inlet", "no side lets fluid out"),
        ("particles", {"radius": 0.01, "density": 1e3, "count": 5, "inlet": DROPS}, "particles.count", "pack"),
        (
            "particles",
            {"radius": 0.01, "density": 1e3, "count": 0, "position": [[0.1, 0.1]]},
            "particles.count",
            "1 positions",
        ),
        (
            "particles",
            {"radius": 0.01, "density": 1e3, "pack": {"kind": "lattice", "start": [0.1] * 2, "stop": [0.11] * 2}},
            "particles.pack",
            "holds no particle",
        ),
        ("output", {"samples": 0.2}, "output.samples", "ends at 0.1 s"),
        ("output", {"walls": True}, "output.walls", "no [[walls]]"),
    ],
)  # fmt: skip
def test_nothing_that_comes_in_or_is_given_is_lost(section, tables, key, words):
    """Refused before work: flows that no incompressible fluid has, and what would be left out in silence."""
    scene = changed(section, tables)
    if key == "particles.inlet":
        scene["boundary"] = CLOSED
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        loaded = load_scene(scene)
        samples_every(loaded, build(loaded)[0])
    assert caught.value.key == key and caught.value.remedy


def test_an_energy_of_no_particles_is_refused():
    tables = {name: table for name, table in VALID.items() if name not in ("particles", "contact", "coupling")}
    load_scene(tables)
    assert refusal(tables | {"output": {"energy": True}}).key == "output.energy"


def test_what_one_inlet_lets_in_another_may_draw_off():
    """Left in and right out, of the same flow rate on patches of other widths, all through ramp and table."""
    times = {"times": [0.0, 0.03, 0.1], "from": 0.0, "to": 0.1}
    tables = changed("boundary.left", {"kind": "inlet", "velocities": [0.0, 0.2, 0.1], **times})
    drawn = {"kind": "inlet", "times": times["times"], "velocities": [[0.0, 0.0], [0.1, 0.0], [0.05, 0.0]]}
    tables["boundary"]["right"] = {**drawn, "from": 0.1, "to": 0.3}
    build(load_scene(tables))
    tables["boundary"]["right"]["velocities"][1] = [0.11, 0.0]
    with pytest.raises(InputError, match="at t = 0.015 s"):
        build(load_scene(tables))


def test_an_inlet_needs_a_fluid_and_pairs_need_materials():
    dry = changed("fluid", ...)
    del dry["coupling"]
    assert refusal(dry).key == "boundary.left.kind"
    alone = {key: VALID[key] for key in ("domain", "fluid", "boundary", "time")}
    pair = [{"materials": ["glass", "wall"], "friction": 0.1}]
    assert refusal(alone | {"material_pairs": pair}).key == "material_pairs.0.materials.0"


def test_walls_of_the_material_called_wall_are_those_without_one():
    scene = load_scene(changed("contact.wall_material", "wall"))
    assert scene == load_scene(VALID)


def test_an_impact_on_soft_walls_counts_for_the_overlap():
    """Hertz on a wall: (15 m v^2 / (16 E* sqrt(R)))^(2/5), E* of grain and wall."""
    contact = {"young_modulus": 7e7, "wall_young_modulus": 2e5, "speed": 1.0, "poisson_ratio": 0.3}
    assert refusal_of_steps(contact | {"maximum_overlap": 0.1}).key == "contact.wall_young_modulus"
    mass, effective = 2650.0 * 4 / 3 * math.pi * 0.01**3, 1.0 / (0.91 / 7e7 + 0.91 / 2e5)
    overlap = (15 * mass / (16 * effective * math.sqrt(0.01))) ** 0.4 / 0.02
    steps = time_steps(load_scene(changed("contact", contact | {"maximum_overlap": 0.2})))
    assert 0.1 < overlap < 0.2 and steps.expected_overlap == pytest.approx(overlap, rel=1e-12)
    equal, hard = (
        time_steps(load_scene(changed("contact", contact | {"wall_young_modulus": modulus}))).expected_overlap
        for modulus in (7e7, 7e9)
    )
    assert equal == hard < 0.2 * overlap


def refusal_of_steps(contact):
    with pytest.raises(InputError) as caught:
        time_steps(load_scene(changed("contact", contact)))
    return caught.value


def test_a_hair_below_zero_is_on_the_other_side_of_a_periodic_box():
    tables = placed([-1e-18, 0.1], [0.2, 0.1])
    tables["boundary"] = {name: {"kind": "periodic"} for name in ("left", "right")}
    build(load_scene(tables))
    check_initial_positions(particle_setup(load_scene(tables)))


def test_a_parabola_needs_ends_that_hold_the_fluid():
    tables = changed("boundary.left", {"kind": "inlet", "velocity": 0.1, "profile": "parabolic"})
    slip = {"kind": "free_slip"}
    tables["boundary"] |= {"bottom": slip, "top": slip}
    assert refusal(tables).key == "boundary.left.profile"
    tables["boundary"]["left"] |= {"from": 0.1, "to": 0.4}
    assert load_scene(tables).boundary["left"].profile == "parabolic"
    tables["boundary"]["left"] |= {"from": 0.0}
    tables["boundary"]["top"] = {"kind": "no_slip"}
    assert load_scene(tables).boundary["left"].profile == "parabolic"


@pytest.mark.parametrize("key", ["domain", "time", "domain.size", "particles.radius", "particles.density", "time.end"])
def test_a_missing_key_is_named(key):
    error = refusal(changed(key, ...))
    assert error.key == key
    assert "missing" in str(error)


@pytest.mark.parametrize("side", ["left", "right", "bottom", "top"])
def test_one_periodic_side_is_enough(side):
    """The axis is periodic whichever of its sides says so, the scene as run has both, and reads as the same scene."""
    tables = changed("domain.gravity", [0.0, 0.0])
    del tables["boundary"]
    pair = ("left", "right") if side in ("left", "right") else ("bottom", "top")
    one = load_scene(tables | {"boundary": {side: {"kind": "periodic"}}})
    both = load_scene(tables | {"boundary": {name: {"kind": "periodic"} for name in pair}})
    assert one == both
    assert one.periodic == (pair[0] == "left", pair[0] == "bottom")
    written = tomllib.loads(one.to_toml())
    assert [written["boundary"][name]["kind"] for name in pair] == ["periodic", "periodic"]
    assert load_scene(written) == one


def test_a_parabola_knows_that_the_axis_is_periodic():
    """As with both sides given: between periodic sides it does not fall to zero."""
    tables = changed("boundary.left", {"kind": "inlet", "velocity": 0.1, "profile": "parabolic"})
    tables["domain"]["gravity"] = [0.0, 0.0]
    tables["boundary"]["top"] = {"kind": "periodic"}
    assert refusal(tables).key == "boundary.left.profile"


@pytest.mark.parametrize("kind", ["outlet", "no_slip", "wall"])
def test_a_periodic_side_against_another_kind_is_refused_naming_both(kind):
    error = refusal(changed("boundary", {"bottom": {"kind": "periodic"}, "top": {"kind": kind}}))
    assert error.key == "boundary.top.kind"
    assert "boundary.bottom.kind" in str(error)


SLOPE = {
    "domain": {"size": [0.4, 0.4], "depth": 0.04, "gravity": [0.1, -9.81]},
    "fluid": {"cells": [4, 4]},
    "boundary": {"left": {"kind": "periodic"}},
    "time": {"end": 0.1, "output_interval": 0.05},
}
"""Water in a box that is periodic along x, with gravity along it: a slope, as people mean it."""


@pytest.mark.parametrize(("key", "value"), [("closure.file", "x.h5"), ("closure.hold", 2)])
def test_a_closure_needs_fluid_and_grains(key, value):
    dry = {name: table for name, table in SLOPE.items() if name != "fluid"} | {"particles": VALID["particles"]}
    for tables in (SLOPE, dry):
        assert refusal(tables, overrides={key: value}).key == key


@pytest.mark.parametrize("with_grains", [False, True])
def test_gravity_by_default_along_a_periodic_axis_of_a_fluid_is_refused(with_grains):
    """All would fall for ever; a scene that says so may do it (tests/fluid/test_drive.py)."""
    tables = SLOPE | {"boundary": {"bottom": {"kind": "periodic"}}}
    tables["domain"] = {key: value for key, value in tables["domain"].items() if key != "gravity"}
    if with_grains:
        tables["particles"] = VALID["particles"]
    error = refusal(tables)
    assert error.key == "domain.gravity" and "fluid.bulk_velocity" in error.remedy
    for gravity in ([0.0, 0.0], [0.0, -9.81]):
        assert load_scene(tables | {"domain": tables["domain"] | {"gravity": gravity}}).periodic == (False, True)


def test_gravity_acts_along_periodic_axes():
    dry = {key: value for key, value in SLOPE.items() if key != "fluid"} | {"particles": VALID["particles"]}
    assert load_scene(dry).domain.gravity == (0.1, -9.81)
    for gravity, driven in (([0.1, -9.81], (True, False)), ([0.0, -9.81], None)):
        drive = build(load_scene(SLOPE, {"domain.gravity": gravity}))[0].fluid.solver.drive
        assert (drive and drive.driven) == driven


def test_gravity_that_is_set_from_python_is_refused_where_it_is_a_number():
    """`rollout` looks at it before anything is compiled; traced, it has no value and passes, as its docstring says."""
    scene = load_scene(SLOPE, {"domain.gravity": [0.0, -9.81], "precision": "float64"})
    simulation, parameters = build(scene)
    state, neighbors = initial_state(scene, simulation, parameters)
    tilted = parameters._replace(gravity=jnp.asarray([0.1, -9.81]))
    with pytest.raises(InputError, match="domain.gravity has that component"):
        rollout(simulation, tilted, state, neighbors, 1)
    assert jax.eval_shape(lambda p: rollout(simulation, p, state, neighbors, 1).failures, tilted).shape == ()


@pytest.mark.parametrize(
    ("part", "value", "remedy"),
    [
        ("closure", "koch_hill", "drag_law"),
        ("closure", KochHill, "ive an object"),
        ("subgrid", "file.h5", "load_subgrid"),
        ("contact_law", "hertz_mindlin", "contact.law"),
        ("cohesion", "jkr", "contact.cohesion"),
        ("nusselt", "gunn", "heat.exchange"),
        ("walls", lambda x: x[0], "walls="),
        ("walls", [3], "walls="),
        ("forces", [lambda start: None], "FluidForce"),
        ("inlet_profiles", {"left": [3]}, "profile or None"),
        ("inlet_profiles", ["left"], "profile or None"),
        ("side_conditions", {"right": 3}, "sets_pressure"),
        ("devices", 2.5, "jax.devices"),
        ("devices", True, "jax.devices"),
        ("devices", [], "jax.devices"),
        ("devices", [1], "jax.devices"),
        ("devices", np.True_, "jax.devices"),
    ],
)
def test_arguments_of_another_kind_are_refused_when_a_scene_is_built(part, value, remedy):
    with pytest.raises(InputError, match=f"(?s)^{part} = .*{re.escape(remedy)}"):
        build(load_scene(VALID), **{part: value})


def test_parts_that_are_none_are_not_given():
    scene = load_scene(VALID)
    assert build(scene, **dict.fromkeys(Extensions.__annotations__))[0] == build(scene)[0]
    with pytest.raises(TypeError, match="closre.*known: closure"):
        build(scene, closre=None)


def test_a_subgrid_closure_from_python_is_no_second_model_of_the_eddies():
    with pytest.raises(InputError, match="fluid.smagorinsky = 0.1"):
        build(load_scene(VALID, {"fluid.smagorinsky": 0.1}), subgrid=SubgridClosure.constant(0.0, 1 / 12))


def test_an_angle_in_degrees_is_told_in_radians():
    wet = {"kind": "capillary", "surface_tension": 0.07, "contact_angle": 20, "liquid_content": 0.02}
    with pytest.raises(InputError, match=r"contact_angle = 20: .*for 20 degrees write 0\.3491"):
        load_scene(VALID, {"contact.cohesion": wet})


def test_parts_that_nothing_in_the_scene_reads_are_refused():
    """A drag law for dry grains was taken in silence: whoever gave it believed that it acts."""
    dry = load_scene({name: table for name, table in VALID.items() if name not in ("fluid", "coupling", "boundary")})
    water = load_scene({name: VALID[name] for name in ("domain", "time", "fluid")})
    parts = {
        "closure": KochHill(),
        "subgrid": SubgridClosure.constant(0.0, 1 / 12),
        "inlet_profiles": {"left": [Parabola()]},
        "side_conditions": {"left": Side(axis=0, upper=False, kind="outlet").condition},
        "walls": [lambda x: x[0]],
        "contact_law": HertzMindlin(),
        "cohesion": JohnsonKendallRoberts(),
    }
    for scene, names, lacking in (
        (dry, ("closure", "subgrid", "inlet_profiles", "side_conditions"), r"\[fluid\]"),
        (water, ("closure", "walls", "contact_law", "cohesion"), r"\[particles\]"),
    ):
        for name in names:
            with pytest.raises(InputError, match=f"^{name} = .given.: needs {lacking}.*Leave it out"):
                build(scene, **{name: parts[name]})


def test_what_is_no_scene_is_refused(tmp_path):
    for call in (
        build,
        external_fluid,
        lambda scene: initial_state(scene, None, None),
        lambda s: simulate(s, tmp_path),
    ):
        for value in ("scene.toml", VALID, None):
            with pytest.raises(InputError, match=r"(?s)^scene.*jaxdem.load_scene"):
                call(value)
    run = tmp_path / "run"
    for out, options, name in (
        (None, {}, "out"), (run, {"progress": 3}, "progress"), (run, {"resume": "no"}, "resume"),
        (run, {"profile": 2}, "profile"), (run, {"devices": 1.0}, "devices"), (run, {"devices": True}, "devices"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=name):
            simulate(load_scene(VALID), out, **options)


def test_a_start_from_a_damaged_run_names_the_key(tmp_path):
    (tmp_path / "scene.toml").write_text(load_scene(VALID).to_toml())
    (tmp_path / "checkpoint.h5").write_bytes(b"no HDF5")
    with pytest.raises(InputError, match=r"(?s)^start\.from = .*its checkpoint\.h5: "):
        build(load_scene(VALID | {"start": {"from": str(tmp_path)}}))


def test_arguments_of_another_kind_are_refused_by_a_rollout_and_an_initial_state():
    scene = load_scene(VALID)
    simulation, parameters = build(scene)
    state, neighbors = initial_state(scene, simulation, parameters)
    good = (simulation, parameters, state, neighbors, 1)
    for number, value, name in (
        (0, parameters, "simulation"), (1, state, "parameters"), (2, neighbors, "state"), (3, None, "neighbors"),
        (3, state, "neighbors"),
        (4, -1, "steps"), (4, 1.5, "steps"), (4, "3", "steps"), (4, None, "steps"), (4, True, "steps"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=f"^{name}"):
            rollout(*good[:number], value, *good[number + 1 :])
    with pytest.raises(InputError, match="observe"):
        rollout(*good, observe=3)
    with pytest.raises(InputError, match="reversible = 'no'"):
        rollout(*good, reversible="no")
    for first, name in (((state, simulation), "simulation"), ((simulation, parameters), "state")):
        with pytest.raises(InputError, match=f"^{name} = .*in this order"):
            neighbors_from_jax_md(*first, neighbors, None)
    for built, name in (((parameters, simulation), "simulation"), ((simulation, None), "parameters")):
        with pytest.raises(InputError, match=f"^{name} = .*jaxdem.build"):
            initial_state(scene, *built)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"[domain\nsize = 1", "not valid TOML"),
        (b"size = [1, 2", "not valid TOML"),
        ("[domain] # Größe".encode("latin-1"), "not UTF-8"),
        (b"\xff\xfe\x00", "not UTF-8"),
        (b"", "missing"),
    ],
)
def test_a_broken_file_is_refused(tmp_path, content, words):
    path = tmp_path / "scene.toml"
    path.write_bytes(content)
    assert words in str(refusal(path))


def test_a_file_that_is_not_there_or_a_folder_is_refused(tmp_path):
    assert "no such file" in str(refusal(tmp_path / "absent.toml"))
    assert "cannot be read" in str(refusal(tmp_path))


def test_overlapping_particles_are_refused_by_number_and_place():
    scene = load_scene(placed((0.1, 0.1), (0.2, 0.2), (0.215, 0.2)))
    with pytest.raises(InputError, match=r"particles 1 and 2 at .*overlap by 25 %"):
        check_initial_positions(particle_setup(scene))


@pytest.mark.parametrize(("point", "wall"), [((0.005, 0.2), "left"), ((0.2, 0.5), "top"), ((-1.0, 0.2), "left")])
def test_a_particle_outside_the_box_is_refused(point, wall):
    scene = load_scene(placed((0.1, 0.1), point))
    with pytest.raises(InputError, match=rf"particle 1 at .*{wall}"):
        check_initial_positions(particle_setup(scene))


def test_a_pack_that_is_too_small_is_refused_with_what_it_holds():
    scene = load_scene(changed("particles.count", 500))
    with pytest.raises(InputError, match=r"the pack holds \d+ particles") as caught:
        _ = particle_setup(scene).position
    assert caught.value.key == "particles.count"


@pytest.mark.parametrize(
    ("more", "key"),
    [
        ({"count": 3}, "particles.count"),
        ({"velocity": [[0.0, 0.0]]}, "particles.velocity"),
        ({"velocity": [[0.0], [0.0]]}, "particles.velocity"),
        ({"angular_velocity": [1.0]}, "particles.angular_velocity"),
        ({"radius": [0.01, 0.01, 0.01]}, "particles.radius"),
        ({"velocity": "absent.csv"}, "particles.velocity"),
    ],
)
def test_rows_that_do_not_agree_are_refused(more, key):
    with pytest.raises(InputError) as caught:
        scene = load_scene(placed((0.1, 0.1), (0.2, 0.2), **more))
        initial_state(scene, *build(scene))
    assert caught.value.key == key


def test_rows_from_a_file_are_named_relative_to_the_scene(tmp_path):
    (tmp_path / "grains.csv").write_text("x,y\n0.1,0.1\n0.2,0.2\n")
    tables = changed("particles", {"radius": 0.01, "density": 2650.0, "position": "grains.csv"})
    path = tmp_path / "scene.toml"
    path.write_text(load_scene(placed((0.1, 0.1))).to_toml().replace("placed", ""))
    scene = load_scene(path, {"particles": tables["particles"]})
    assert particle_setup(scene).position.tolist() == [[0.1, 0.1], [0.2, 0.2]]


def test_the_papers_unstable_step_is_refused_naming_the_stable_one():
    tables = placed((0.1, 0.1), density=5650.0)
    tables["contact"] = {"young_modulus": 70e9, "poisson_ratio": 0.3, "time_step": 2e-4}
    with pytest.raises(InputError) as caught:
        time_steps(load_scene(tables))
    assert caught.value.key == "contact.time_step"
    assert caught.value.value == 2e-4
    stable = float(re.search(r"stable step is (\S+) s", str(caught.value)).group(1))
    # Half the lattice frequency's limit at most, and under the Rayleigh time of 1.55e-5 s.
    assert 1e-6 < stable < 1.56e-5
    assert '"auto"' in caught.value.remedy
    tables["contact"]["time_step"] = 0.999 * stable
    assert time_steps(load_scene(tables)).contact <= stable


def test_the_stable_step_that_a_message_names_is_accepted():
    tables = placed((0.1, 0.1), density=5650.0)
    tables["contact"] = {"young_modulus": 70e9, "poisson_ratio": 0.3, "time_step": 1e-3}
    with pytest.raises(InputError) as caught:
        time_steps(load_scene(tables))
    named = float(re.search(r"stable step is (\S+) s", str(caught.value)).group(1))  # four digits, so it may be above
    tables["contact"]["time_step"] = named
    assert time_steps(load_scene(tables)).contact <= named


def test_a_soft_contact_is_refused_for_its_overlap():
    tables = changed("contact.young_modulus", 1e4)
    with pytest.raises(InputError, match=r"would overlap by \d+ %"):
        time_steps(load_scene(tables))


@pytest.mark.parametrize(
    "change",
    [
        ("seed", 7),
        ("boundary.left.ramp_time", 0.2),
        ("contact.time_step", 1e-5),
        ("boundary.left.profile", "parabolic"),
        (
            "boundary.left",
            {
                "kind": "inlet",
                "from": 0.1,
                "to": 0.2,
                "times": [0.0, 0.5],
                "velocities": [0.1, [0.2, 0.0]],
                "profile": "table",
                "positions": [0.0, 0.4],
                "values": [1.0, 2.0],
            },
        ),
    ],
)
def test_written_and_read_again_the_scene_is_the_same(tmp_path, change):
    scene = load_scene(changed(*change))
    path = tmp_path / "scene.toml"
    path.write_text(scene.to_toml())
    again = load_scene(path)
    assert again == scene
    assert again.boundary["left"].from_ == (0.1,)
    assert again.boundary["left"].to == (0.2,)
    assert again.to_toml() == scene.to_toml()
    assert "ramp_time" in scene.to_toml(), "every default is written out"


@pytest.mark.parametrize(
    ("text", "key", "value"),
    [
        ("time.end=1", "time.end", 1),
        ("time.end = 1e-1", "time.end", 0.1),
        ("fluid.cells=[3, 4]", "fluid.cells", [3, 4]),
        ("coupling.drag=ergun", "coupling.drag", "ergun"),
        ('coupling.drag="ergun"', "coupling.drag", "ergun"),
        ("boundary.left={kind='outlet'}", "boundary.left", {"kind": "outlet"}),
    ],
)
def test_overrides_are_toml_values(text, key, value):
    assert parse_override(text) == (key, value)


@pytest.mark.parametrize("text", ["time.end", "=3", "fluid.cells=[3", "a={", ""])
def test_a_malformed_override_is_refused(text):
    with pytest.raises(InputError):
        parse_override(text)


def test_overrides_reach_new_and_old_tables():
    scene = load_scene(VALID, {"time.end": 0.2, "output.checkpoint_interval": 5.0, "boundary.top.kind": "outlet"})
    assert (scene.time.end, scene.output.checkpoint_interval) == (0.2, 5.0)
    assert scene.boundary["top"].kind == "outlet"
    assert "not a table" in str(refusal(VALID, overrides={"seed.x": 1}))
    assert "Did you mean 'end'" in str(refusal(VALID, overrides={"time.ent": 1}))


ODD_VALUES = st.one_of(
    st.sampled_from([math.nan, math.inf, -math.inf, 0, -1, 1e308, 5e-324, 10**30, True, "", "auto", "inf", [], {}]),
    st.floats(),
    st.integers(),
    st.text(max_size=5),
    st.lists(st.one_of(st.floats(), st.text(max_size=2)), max_size=4),
    st.dictionaries(st.sampled_from(["kind", "velocity", "from", "x", "diameters"]), st.floats(), max_size=2),
)


def dotted_keys(tables, prefix=""):
    for key, value in tables.items():
        yield prefix + key
        if isinstance(value, dict):
            yield from dotted_keys(value, f"{prefix}{key}.")


@settings(max_examples=400, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    st.dictionaries(
        st.sampled_from(
            [
                *dotted_keys(VALID),
                "boundary.top",
                *(f"boundary.left.{name}" for name in ("times", "velocities", "profile", "positions", "values")),
                "closure.file",
                "fluid.model",
                "fluid.smagorinsky",
                "fluid.subgrid",
                "fluid.velocity",
                "particles.velocity",
                "walls",
            ]
        ),
        st.one_of(ODD_VALUES, st.just(...)),
        min_size=1,
        max_size=3,
    )
)
def test_any_mutation_loads_or_is_refused(mutations):
    tables = copy.deepcopy(VALID)
    for key, value in mutations.items():
        *parents, last = key.split(".")
        table = tables
        for part in parents:
            table = table.get(part) if isinstance(table, dict) else None
        if not isinstance(table, dict):
            continue
        if value is ...:
            table.pop(last, None)
        else:
            table[last] = copy.deepcopy(value)
    try:
        scene = load_scene(tables)
        # A scene that loads can be written, and its steps either be found or be refused.
        assert load_scene_text(scene.to_toml()) == scene
        time_steps(scene)
    except InputError as error:
        assert error.key, "an error names its key"
        assert len(str(error)) < 1000


def load_scene_text(text):
    import tomllib

    return load_scene(tomllib.loads(text))


@pytest.mark.parametrize("name", ["chute", "settling", "injection"])
def test_tables_of_a_scene_are_that_scene(name):
    """Without a fluid, with both, with a patch of a side."""
    scene = load_scene(Path(__file__).parents[1] / "scenes" / f"{name}.toml")
    assert load_scene(scene.tables()).to_toml() == scene.to_toml()


def test_a_keyword_of_another_name_is_refused_by_build_and_simulate(tmp_path):
    scene = load_scene(VALID)
    for work in (lambda: build(scene, wall=[]), lambda: simulate(scene, tmp_path / "run", wall=[])):
        with pytest.raises(TypeError, match="'wall'"):
            work()
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"particles.friction": 0.4}, ("particles.friction", "move it to [contact] or [[materials]]")),
        ({"fluid.drag": "wen_yu"}, ("fluid.drag", "[coupling]")),
        ({"gravity": [0.0, -9.81]}, ("gravity", "[domain]")),
        ({"fluid.heat": 1}, ("fluid.heat", "move it to [heat]")),
        ({"particles.radius": "0.01"}, ("particles.radius", "number in quotes", "remove the quotes")),
        ({"walls": [{"point": [0.1, 0.1]}]}, ("walls.0.kind", "is missing", '"plane"')),
    ],
    ids=lambda given: next(iter(given)) if isinstance(given, dict) else "",
)
def test_what_helps_with_a_slip(overrides, words):
    message = str(refusal(VALID, overrides=overrides)).lower()
    assert all(word.lower() in message for word in words), message


def test_what_is_missing_is_said_with_its_unit():
    assert "[kg/m3]" in refusal(changed("particles.density", ...)).remedy
    assert "duration and output" in refusal({name: table for name, table in VALID.items() if name != "time"}).remedy


def test_the_line_that_is_no_toml_is_shown(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text("[particles]\nradius = 0,01\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"line 2, column 11\): radius = 0,01"):
        load_scene(path)


@pytest.mark.parametrize("parts", [0.7, 1.4, 16.7, 33.4, 1e5 / 3.0])
def test_an_interval_that_is_proposed_divides(parts):
    remedy = refusal(VALID, overrides={"time.end": 2.0, "time.output_interval": 2.0 / parts}).remedy
    proposed = float(remedy.rpartition("=")[2])
    assert load_scene(VALID, {"time.end": 2.0, "time.output_interval": proposed}).time.output_interval == proposed
    assert 0.4 <= 2.0 / proposed / parts <= 2.1

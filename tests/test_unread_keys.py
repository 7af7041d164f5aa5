"""Keys that nothing reads in a scene: what is said of them is what the program does with them."""

from __future__ import annotations

import jax
import numpy as np
import pytest

import jaxdem
from jaxdem.check.check import check_scene
from jaxdem.particles.contact import LinearSpringDashpot
from jaxdem.scene.reference import TOP, rows, tables
from jaxdem.scene.unread import EVERY, conditions, unread_keys
from jaxdem.setup.builder import build_case

GRAINS = {
    "precision": "float64",
    "domain": {"size": [0.1, 0.1]},
    "particles": {
        "radius": 0.005,
        "density": 2500.0,
        "position": [[0.05, 0.00501], [0.0579, 0.0112]],
        "velocity": [[0.1, -0.1], [-0.2, -0.1]],
    },
    "contact": {"time_step": 1e-5, "speed": 1.5},
    "coupling": {"interval": 1e-3},
    "time": {"end": 1e-3, "output_interval": 1e-3},
}
"""A grain that hits the floor, and another one that hits it."""

LINEAR = {"contact.law": "linear_spring_dashpot", "contact.normal_stiffness": 2e4}
MATERIALS = {"materials": [{"name": "glass", "young_modulus": 6e7}], "particles.material": "glass"}
HEAT = {"heat": {"particle_heat_capacity": 800.0, "particle_temperature": 300.0}}
CONDUCTS = {"heat.particle_conductivity": 1.0, "heat.true_young_modulus": 6e10}
WATER = {"fluid": {"cells": [5, 5]}, "coupling": {"interval": 1e-3}}
OUTLETS = {"boundary.top.kind": "outlet", "boundary.bottom.kind": "outlet"}
WARM = {**WATER, "heat": HEAT["heat"] | dict(fluid_heat_capacity=4e3, fluid_conductivity=0.6, fluid_temperature=300.0)}
DYED = {**WATER, "scalars": [{"name": "dye"}]}
EMPTY = {"particles": None, "contact": None, "coupling": None}

CASES = [
    # key, another value, a scene that does not read it, what makes it read
    ("contact.young_modulus", 6e7, LINEAR, {"contact.law": "hertz_mindlin"}),
    ("contact.poisson_ratio", 0.2, LINEAR, {"contact.law": "hertz_mindlin"}),
    ("contact.wall_young_modulus", 6e7, LINEAR, {"contact.law": "hertz_mindlin"}),
    ("contact.wall_poisson_ratio", 0.2, LINEAR, {"contact.law": "hertz_mindlin"}),
    ("contact.normal_stiffness", 3e4, {}, LINEAR),
    ("contact.tangential_stiffness", 1e4, {}, LINEAR),
    ("contact.rolling_damping", 0.5, {}, {"contact.rolling_model": "epsd", "contact.rolling_friction": 0.1}),
    ("contact.rolling_model", "epsd", {}, {"contact.rolling_friction": 0.1}),
    ("contact.parcel_loss", "rate", {}, {"particles.coarse_grain": 1.5}),
    ("materials.0.young_modulus", 5e7, LINEAR | MATERIALS, {"contact.law": "hertz_mindlin"}),
    ("materials.0.poisson_ratio", 0.2, LINEAR | MATERIALS, {"contact.law": "hertz_mindlin"}),
    ("coupling.kernel_width", 2.0, WATER | {"coupling.void_fraction": "centre"}, {"coupling.void_fraction": "kernel"}),
    (
        "coupling.kernel_diameter",
        "own",
        WATER | {"coupling.void_fraction": "centre"},
        {"coupling.void_fraction": "kernel"},
    ),
    ("coupling.own_volume", "grain", WATER, {"particles.coarse_grain": 1.5}),
    ("boundary.top.ramp_time", 0.2, WATER | OUTLETS, {"boundary.top.kind": "inlet"}),
    ("heat.exchange", "ranz_marshall", HEAT, WARM),
    ("heat.bed_conductivity", "open", HEAT, WARM),
    ("scalars.0.dissolved_in", "both", DYED, {"surface": {"level": 0.05}}),
]


def scene_with(*changes):
    """The scene with dotted keys changed one after the other; None removes a table."""
    merged = {key: value for change in changes for key, value in change.items()}
    if merged.get("boundary.top.kind") == "inlet":
        merged["boundary.top.velocity"] = 0.01
    tables = {name: table for name, table in GRAINS.items() if merged.get(name, ...) is not None}
    return jaxdem.load_scene(tables, {key: value for key, value in merged.items() if value is not None})


def same(one, other):
    """Whether two trees have the same leaves, bit for bit."""
    ours, theirs = jax.tree.leaves(one), jax.tree.leaves(other)
    return len(ours) == len(theirs) and all(map(np.array_equal, ours, theirs))


@jax.jit
def interval(simulation, parameters, state, neighbors):
    return simulation.step(parameters, state, neighbors)[0]


def start(scene):
    simulation, parameters = jaxdem.build(scene)
    return simulation, parameters, *jaxdem.initial_state(scene, simulation, parameters)


def outcome(scene):
    return interval(*start(scene))


def program(scene):
    simulation, *given = start(scene)
    return str(jax.make_jaxpr(simulation.step)(*given))


@pytest.mark.parametrize(("key", "value", "base", "more"), CASES, ids=[case[0] for case in CASES])
def test_what_is_said_is_so(key, value, base, more):
    """Where a key is not read, another value gives the same program and, over two impacts, the same bits; where it is,
    another program or other numbers, and nothing is said."""
    plain, changed = scene_with(base), scene_with(base, {key: value})
    told = [sentence for sentence in unread_keys(changed) if sentence.startswith(f"{key} = ")]
    assert len(told) == 1 and "has no effect here" in told[0]
    (simulation, numbers), (other, others) = jaxdem.build(plain), jaxdem.build(changed)
    assert simulation == other or program(plain) == program(changed)
    if not same(numbers, others):
        assert same(outcome(plain), outcome(changed))

    plain, changed = scene_with(base, more), scene_with(base, more, {key: value})
    assert not [sentence for sentence in unread_keys(changed) if sentence.startswith(f"{key} = ")]
    (simulation, numbers), (other, others) = jaxdem.build(plain), jaxdem.build(changed)
    assert simulation != other or not same(numbers, others)


def test_the_impacts_depend_on_what_is_read():
    """The control of the bits: a stiffness that is read changes them."""
    assert not same(outcome(scene_with(LINEAR)), outcome(scene_with(LINEAR, {"contact.normal_stiffness": 2.1e4})))


def test_conditions_together_and_alternatives():
    damped = scene_with({"contact.rolling_damping": 0.5, "contact.rolling_friction": 0.1})
    assert unread_keys(damped) == (
        "contact.rolling_damping = 0.5 has no effect here: it is read with rolling_model = epsd",
    )
    rolls = MATERIALS | {"contact.rolling_model": "epsd", "materials.0.rolling_friction": 0.1}
    assert not unread_keys(scene_with({"contact.rolling_damping": 0.5}, rolls))
    conducts = scene_with(LINEAR, HEAT, CONDUCTS, {"contact.poisson_ratio": 0.2})
    assert not unread_keys(conducts)


def test_a_default_that_is_written_out_is_not_told():
    """`scene.toml` of a run has all of them."""
    scene = scene_with(LINEAR)
    assert not unread_keys(scene) and not unread_keys(jaxdem.load_scene(scene.tables()))


def test_with_a_law_of_ones_own_nothing_is_told():
    scene = scene_with({"contact.normal_stiffness": 2e4})
    assert build_case(scene).unread and not build_case(scene, contact_law=LinearSpringDashpot()).unread


def test_what_is_set_stays_as_it_was():
    """Keys within a table that is set too: the caller's table is not changed."""
    given = {"materials": [{"name": "glass"}], "particles.material": "glass", "materials.0.young_modulus": 6e7}
    assert scene_with(given).materials[0].young_modulus == 6e7
    assert given["materials"] == [{"name": "glass"}]


def test_check_tells_it():
    told = [one for one in check_scene(scene_with({"contact.normal_stiffness": 2e4})).warnings if "no effect" in one]
    assert told == [
        "contact.normal_stiffness = 20000 has no effect here: it is read with contact.law = linear_spring_dashpot"
    ]


def test_conditions_name_keys_that_there_are():
    """A misspelt condition would never hold."""
    paths = {"" if heading == TOP else heading.strip("[]") + ".": model for heading, model in tables()}
    known = {f"{path}{key}" for path, model in paths.items() for key, *_ in rows(model)}
    named = []
    for path, model in paths.items():
        for field in model.model_fields.values():
            for condition in (one for read in conditions(field) for one in read.any_of):
                key = condition.partition(" = ")[0]
                named.append((path[:-1] + key if key[0] == "." else key).replace(f".{EVERY}.", "."))
    assert named and set(named) <= known

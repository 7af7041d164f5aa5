"""One number of a scene is one number to differentiate by: changing the one and building is changing the other."""

from __future__ import annotations

import copy
import tomllib

import jax
import numpy as np
import pytest

from jaxdem import build, load_scene
from jaxdem.particles.materials import surroundings

DRY = {
    "precision": "float64",
    "domain": {"size": [1.0, 1.0], "depth": 0.02, "gravity": [0.5, -9.81]},
    "particles": {"radius": 0.01, "density": 2500.0, "position": [[0.3, 0.3], [0.6, 0.6]]},
    "contact": {
        "speed": 1.0, "time_step": 1e-6, "young_modulus": 1e7, "poisson_ratio": 0.3, "restitution": 0.6,
        "friction": 0.4, "rolling_friction": 0.1, "rolling_model": "epsd",
    },
    "time": {"end": 0.001, "output_interval": 0.001},
}  # fmt: skip
WALLS = {"wall_young_modulus": 2e7, "wall_poisson_ratio": 0.2, "wall_friction": 0.4}
LINEAR = {"law": "linear_spring_dashpot", "normal_stiffness": 1e4}
MATERIALS = {
    "materials": [
        {"name": "soft", "young_modulus": 1e7, "friction": 0.4, "rolling_friction": 0.1},
        {"name": "hard", "restitution": 0.3, "poisson_ratio": 0.1},
    ],
    "material_pairs": [
        {"materials": ["soft", "hard"], "friction": 0.4},
        {"materials": ["hard", "wall"], "restitution": 0.5, "rolling_friction": 0.2},
    ],
}
SPECIES = {
    "density": 2500.0,
    "radius": 0.01,
    "species": [{"share": 0.5, "density": 1500.0}, {"share": 0.5}],
    "position": DRY["particles"]["position"],
    "inlet": [
        {"side": "left", "rate": 1000.0, "velocity": 0.5, "total": 1},
        {"side": "right", "rate": 1000.0, "velocity": 0.5, "density": 2500.0, "total": 1},
    ],
}


def scene(contact=None, **tables):
    return {**DRY, **tables, "contact": DRY["contact"] | (contact or {})}


SCENES = {
    "walls that follow the particles": scene(),
    "walls with numbers of their own": scene(WALLS),
    "one of the walls' numbers": scene({"wall_poisson_ratio": 0.2}),
    "linear law": scene(LINEAR),
    "linear law with a tangential stiffness": scene(LINEAR | {"tangential_stiffness": 3e3}),
    "materials": scene(particles=DRY["particles"] | {"material": ["soft", "hard"]}, **MATERIALS),
    "materials and a wall": scene(
        {"wall_friction": 0.4}, particles=DRY["particles"] | {"material": ["soft", "hard"]}, **MATERIALS
    ),
    "species and inlets": scene(particles=SPECIES),
    "a side that moves": scene(boundary={"top": {"kind": "moving_wall", "velocity": [0.5, 0.0]}}),
    "fluid": scene(
        fluid={"cells": [4, 4], "density": 1000.0, "viscosity": 1e-3, "smagorinsky": 0.1, "time_step": 0.001},
        boundary={"left": {"kind": "inlet", "velocity": 0.5}, "right": {"kind": "outlet"}},
    ),
}

LEAVES = {
    "domain.gravity", "particles.density", "fluid.density", "fluid.viscosity", "fluid.smagorinsky",
    *(f"contact.{name}" for name in ("young_modulus", "poisson_ratio", "restitution", "friction", "rolling_friction",
                                     "rolling_damping", "normal_stiffness", "tangential_stiffness", *WALLS)),
}  # fmt: skip
"""Numbers that are parameters wherever they stand in a scene, besides those of lists of tables and of sides."""


def numbers(tables, key=()):
    """(path, value) of every float of the tables."""
    entries = tables.items() if isinstance(tables, dict) else enumerate(tables)
    for name, value in entries:
        if isinstance(value, dict | list):
            yield from numbers(value, (*key, name))
        elif isinstance(value, float):
            yield (*key, name), value


def is_parameter(path):
    """Whether a number of the scene is one to differentiate by."""
    names = [name for name in path if isinstance(name, str)]
    if names[0] in ("materials", "material_pairs", "boundary") or names[:2] == ["particles", "inlet"]:
        return names[-1] not in ("rate", "ramp_time", "share", "from", "to", "start", "stop", "begin", "end")
    return ".".join(names) in LEAVES or names == ["particles", "species", "density"]


def built(tables):
    return build(load_scene(tables))[1]


def changed(tables, path, value):
    tables = copy.deepcopy(tables)
    holder = tables
    for name in path[:-1]:
        holder = holder[name]
    holder[path[-1]] = value
    return tables


@pytest.mark.parametrize("name", SCENES)
def test_one_number_of_the_scene_is_one_number_to_differentiate_by(name):
    """Of the scene as given and as run: with h more in it, one leaf of the parameters is h more and all others are as
    before.

    In one entry of that leaf, or in those of the particles that have the number: density of a species.
    """
    given = SCENES[name]
    for tables in (given, tomllib.loads(load_scene(given).to_toml())):
        before = jax.tree.leaves(built(tables))
        found = 0
        for path, value in numbers(tables):
            if value == 0.0 or not is_parameter(path):
                continue
            step = 1e-3 * value
            after = jax.tree.leaves(built(changed(tables, path, value + step)))
            moved = [np.asarray(b - a) for a, b in zip(before, after, strict=True) if not np.array_equal(a, b)]
            assert len(moved) == 1, path
            by = moved[0][moved[0] != 0.0]
            np.testing.assert_allclose(np.abs(by), abs(step), rtol=1e-9, err_msg=str(path))
            assert by.size == 1 or path[-1] == "density", path
            found += 1
        assert found >= 8


@pytest.mark.parametrize("name", SCENES)
def test_what_the_contacts_get_is_what_the_scene_says(name):
    """Every constant of a contact between grains, and with a wall, against the scene's numbers by hand."""
    around = surroundings(built(SCENES[name]).contact, ())
    contact = SCENES[name]["contact"]
    if name.startswith("materials"):  # soft, hard, wall: 00 01 02 11 12 22
        wall = contact.get("wall_friction", 0.4)
        mean = np.sqrt
        friction = [0.4, 0.4, mean(0.4 * wall), 0.4, mean(0.4 * wall), wall]
        restitution = [0.6, mean(0.6 * 0.3), 0.6, 0.3, 0.5, 0.6]
        rolling = [0.1, 0.1, 0.1, 0.1, 0.2, 0.1]
        np.testing.assert_allclose(around.wall.friction, friction, rtol=1e-12)
        np.testing.assert_allclose(around.wall.restitution, restitution, rtol=1e-12)
        np.testing.assert_allclose(around.wall.rolling_friction, rolling, rtol=1e-12)
        return
    young, poisson = (
        [contact[key], contact.get(f"wall_{key}", contact[key])] for key in ("young_modulus", "poisson_ratio")
    )
    for material, second in ((around.pair, 0), (around.wall, 1)):
        modulus = 1.0 / sum((1.0 - poisson[k] ** 2) / young[k] for k in (0, second))
        np.testing.assert_allclose(material.effective_young_modulus, modulus, rtol=1e-12)
        assert material.restitution == 0.6
        assert material.friction == 0.4  # of both: the given one is as large
        normal = contact.get("normal_stiffness", 0.0)
        across = contact.get("tangential_stiffness", 2.0 / 7.0 * normal)
        np.testing.assert_allclose(material.tangential_stiffness, across, rtol=1e-12)


def test_friction_of_the_walls_counts_in_a_derivative_by_friction():
    """Of friction at a wall by `contact.friction`: 1 where the walls follow it, 0 where they have their own."""

    def at_wall(contact):
        return surroundings(contact, ()).wall.friction

    assert jax.grad(at_wall)(built(SCENES["walls that follow the particles"]).contact).friction == 1.0
    own = jax.grad(at_wall)(built(SCENES["walls with numbers of their own"]).contact)
    assert (own.friction, own.wall_friction) == (0.0, 1.0)

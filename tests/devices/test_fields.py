"""Nothing of a state is lost on the way into slabs and back; parameters are the same on all devices."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem import devices
from jaxdem.devices.mesh import SAME, put
from jaxdem.particles.integrate import Motion, ParticleState
from jaxdem.particles.slab_steps import own_rows, padded
from tests.cases.fluid_slabs import coupled_scene

NUMBER = 2
OF_CLUMPS = {"orientation", "orientation_low", "coming"}


def marked(tree, draw):
    """The tree with numbers of its own in every array of reals."""
    return jax.tree.map(
        lambda x: jnp.asarray(draw.normal(size=x.shape), x.dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x, tree
    )


@pytest.fixture(scope="module")
def scene():
    """Grains in a fluid in single precision, with all that remembers, and a lid that a force holds."""
    lid = {
        "kind": "plane", "point": [0.0, 0.195], "normal": [0.0, -1.0],
        "piston": {"direction": [0.0, -1.0], "force": 5.0, "mass": 1.0},
    }  # fmt: skip
    tables = coupled_scene(2, {}, virtual_mass=0.5, basset=4, rotational_drag=True)
    tables["contact"] |= {"rolling_friction": 0.1, "rolling_model": "epsd"}
    return jaxdem.load_scene(tables | {"precision": "float32", "walls": [lid]})


@pytest.fixture(scope="module")
def cut(scene):
    """Simulation, parameters, a state of which every array has other numbers, its list, and both in slabs."""
    simulation, parameters = jaxdem.build(scene, devices=NUMBER)
    state, neighbors = jaxdem.initial_state(scene, simulation.undivided(), parameters)
    draw, particles = np.random.default_rng(0), state.particles
    others = marked(particles, draw)._replace(position=particles.position)
    listed = np.asarray(neighbors.pairs.first) != np.asarray(neighbors.pairs.second)
    springs = tuple(jnp.where(listed, x, 0.0) for x in others.contact_spring)
    # Trailing parts that fit the leading ones; and films, which grains in such a fluid have not.
    low, films = 1e-9 * others.position_low, jnp.asarray(draw.random(len(particles.position)), np.float32)
    others = others._replace(contact_spring=springs, position_low=low, liquid=films)
    state = state._replace(particles=others, fluid=marked(state.fluid, draw))
    return simulation, parameters, state, neighbors, devices.distributed(simulation, parameters, state, neighbors)


def test_every_leaf_comes_back_unchanged(cut):
    simulation, parameters, state, _, slabs = cut
    again, _ = devices.on_one_device(simulation, parameters, *devices.gathered(simulation, *slabs))
    springs = state.particles.contact_spring
    assert any(np.any(np.asarray(x)) for x in springs) or not len(springs[0])
    before = dict(jax.tree_util.tree_flatten_with_path(state)[0])
    after = dict(jax.tree_util.tree_flatten_with_path(again)[0])
    assert before.keys() == after.keys()
    for path, leaf in before.items():
        np.testing.assert_array_equal(np.asarray(after[path]), np.asarray(leaf), err_msg=str(path))


def test_all_fields_are_in_some_scene(cut):
    """Those that this scene does not have are said elsewhere to come back."""
    particles = cut[2].particles
    empty = {name for name in ParticleState._fields if not jax.tree.leaves(getattr(particles, name))}
    # tests/devices/test_random_scenes.py, test_meshes.py, test_bonds.py and test_clumps.py
    elsewhere = {"active", "inserted", "identity", "mesh_memory", "mesh_wear", "bonds"}
    assert empty == elsewhere | OF_CLUMPS


def test_parameters_are_the_same_on_all_devices(cut):
    simulation, parameters, *_ = cut
    placed = put(simulation.mesh, parameters, SAME)
    assert jax.tree.structure(placed) == jax.tree.structure(parameters)
    for leaf, own in zip(jax.tree.leaves(placed), jax.tree.leaves(parameters), strict=True):
        assert len(leaf.addressable_shards) == NUMBER
        for part in leaf.addressable_shards:
            np.testing.assert_array_equal(part.data, np.asarray(own))


def test_contact_steps_give_back_all_that_they_change(cut):
    """`own_rows` undoes `padded`, and takes every field of the motion: a piston was lost once."""
    *_, (slabs, lists) = cut
    before, ghosts = jax.tree.map(lambda x: x[0], (slabs.particles, lists.ghosts))
    wide = padded(ghosts, before)
    assert len(wide.position) == len(before.position) + 2 * len(ghosts.lower)
    for one, other in zip(jax.tree.leaves(own_rows(ghosts, wide, before)), jax.tree.leaves(before), strict=True):
        np.testing.assert_array_equal(one, other)
    there = {name for name in ParticleState._fields if jax.tree.leaves(getattr(before, name))}
    not_there = set(Motion._fields) & set(ParticleState._fields) - there - OF_CLUMPS - {"bonds"}
    others = {name: object() for name in not_there}
    moved = jax.tree.map(lambda x: x + 1, wide)._replace(**others)
    found = own_rows(ghosts, moved, before)
    taken = {name for name in ParticleState._fields if getattr(found, name) is not getattr(before, name)}
    unlike = jax.tree.map(lambda x: object(), Motion.of(before))
    marks = Motion(*unlike)._replace(
        position=tuple(x + 1 for x in Motion.of(before).position),
        low=Motion.of(before).low,
        velocity=Motion.of(before).velocity,
        angular_velocity=Motion.of(before).angular_velocity,
        **others,
    )
    changed = {name for name in ParticleState._fields if getattr(marks.into(before), name) is not getattr(before, name)}
    assert taken - {"contact_force", "pistons"} == changed - OF_CLUMPS
    assert {"contact_force", "pistons"} <= taken
    for name in taken & there:
        for one, other in zip(
            jax.tree.leaves(getattr(found, name)), jax.tree.leaves(getattr(before, name)), strict=True
        ):
            np.testing.assert_array_equal(one, other + 1, err_msg=name)

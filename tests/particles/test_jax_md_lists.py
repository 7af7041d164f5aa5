"""Lists made with jax-md: the same pairs as ours, the same contact forces, and what is refused."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.particles.contact_step import ContactStep
from jaxdem.particles.forces import contact_forces
from jaxdem.particles.integrate import Motion
from jaxdem.particles.jax_md_list import listed_by_jax_md
from jaxdem.particles.materials import surroundings
from jaxdem.particles.neighbors import Room
from tests.cases.jax_md_alone import light_jax_md
from tests.cases.lists import entries_of, listed_pairs, pairs_within
from tests.cases.tiers import tiered
from tests.cases.worlds import constants, track, world

with light_jax_md() as jax_md:
    partition = jax_md.partition

FORMATS = tuple(partition.NeighborListFormat)


@pytest.fixture(autouse=True)
def rank_promotion():
    """jax-md relies on it."""
    with jax.numpy_rank_promotion("allow"):
        yield


def jax_md_functions(search, form=FORMATS[0], box=None, **more):
    """allocate and update of jax-md for a search of ours, as a user would write them."""
    geometry = search.geometry
    lengths = np.asarray(box or geometry.box)

    def displacement(a, b, **_):
        apart = a - b
        image = jnp.asarray(lengths, a.dtype) * jnp.round(apart / jnp.asarray(lengths, a.dtype))
        return apart - jnp.where(jnp.asarray(geometry.periodic), image, 0.0)

    given = {"r_cutoff": geometry.cutoff, "dr_threshold": geometry.skin, "format": form} | more
    return partition.neighbor_list(displacement, lengths, **given)


ROOM = Room(24, 400, 16)
"""Of all clouds, which then share programs."""


def cloud(box, periodic, radius, count=60, seed=0, **more):
    """Overlapping grains anywhere, in motion, with friction and random springs, which forces depend on."""
    generator = np.random.default_rng(seed)
    dimension = len(box)
    position = generator.uniform(0.0, 1.0, (count, dimension)) * np.array(box)
    radius = generator.uniform(0.4, 1.0, count) * radius if more.pop("several", False) else radius
    turning = 1 if dimension == 2 else 3
    scene = world(
        position, generator.normal(0.0, 0.1, (count, dimension)), generator.normal(0.0, 5.0, (count, turning)),
        radius=radius, box=box, periodic=periodic, material=constants(friction=0.4, restitution=0.6), walls=False,
        room=ROOM, **more,
    )  # fmt: skip
    pairs = scene.neighbors.pairs
    real = np.asarray(pairs.first != pairs.second)
    dtype = scene.state.position.dtype
    springs = tuple(
        jnp.asarray(np.where(real, generator.normal(0.0, 1e-6, len(real)), 0.0), dtype)
        for _ in scene.state.contact_spring
    )
    return scene._replace(state=scene.state._replace(contact_spring=springs)), position


@functools.cache
def kernel(interval):
    """Compiled: force and torque on every particle."""

    def sums(constants_, wall_velocity, properties, state, neighbors):
        around = surroundings(constants_, wall_velocity)
        motion, step = Motion.of(state), jnp.asarray(1e-5, state.position.dtype)
        return contact_forces(
            ContactStep(interval.model, around, properties, motion, motion.velocity, step), neighbors
        )[0]

    return jax.jit(sums)


def forces(scene, state, neighbors):
    """Force and torque (N,), component by component."""
    sums = kernel(scene.interval)(scene.constants, scene.wall_velocity, scene.properties, state, neighbors)
    return [np.asarray(x) for x in (*sums.force, *sums.torque)]


BOXES = {
    (2, False): (0.3, 0.2),
    (2, True): (0.3, 0.2),
    # Under three reaches across: jax-md compares all pairs then.
    (3, False): (0.15, 0.06, 0.15),
    (3, True): (0.12, 0.12, 0.12),
}
CASES = [(*case, FORMATS[k % 3]) for k, case in enumerate(itertools.product((2, 3), (False, True), (False, True)))] + [
    (2, False, True, FORMATS[2])
]
FIRST = (CASES[1], CASES[2], CASES[6])
"""Both dimensions, with and without periodic sides and several sizes, every format."""


@pytest.mark.parametrize(("dimension", "periodic", "several", "form"), tiered(CASES, first=FIRST))
def test_pairs_and_forces_of_a_jax_md_list_are_those_of_ours(dimension, periodic, several, form):
    """Pair by pair, and numpy's too; forces to the rounding of sums in another order."""
    box = BOXES[dimension, periodic]
    scene, position = cloud(box, (periodic,) * dimension, 0.012, several=several)
    search, ours = scene.interval.search, scene.neighbors
    functions = jax_md_functions(search, form)
    given = functions.allocate(scene.state.position)
    state, theirs = listed_by_jax_md(search, scene.state, ours, given)
    pairs = listed_pairs(theirs)
    assert len(pairs) == len(set(pairs)) > 60
    size = np.broadcast_to(ours.radius, len(position))
    reach = search.geometry.skin + size[:, None] + size  # of two grains of their own sizes
    assert set(pairs) == set(listed_pairs(ours)) == pairs_within(position, reach, box, (periodic,) * dimension)
    assert entries_of(theirs) == 0 and not theirs.overflow and theirs.room == ours.room
    assert int(theirs.builds) == int(ours.builds) + 1
    expected = forces(scene, scene.state, ours)
    assert max(np.abs(x).max() for x in expected) > 1.0
    for one, other in zip(forces(scene, state, theirs), expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-13 * np.abs(other).max())


@pytest.fixture(scope="module")
def row():
    """Twelve discs in a row, a gap of 1 mm between them; and jax-md's functions."""
    position = np.stack([np.arange(12) * 0.021 + 0.02, np.full(12, 0.1)], 1)
    scene = world(position, radius=0.01, box=(0.3, 0.2))
    with jax.numpy_rank_promotion("allow"):
        functions = jax_md_functions(scene.interval.search)
        return scene, functions, functions.allocate(scene.state.position)


def test_inside_jit_with_fixed_shapes_and_flags(row):
    """A list updated and taken over in a compiled program; too little room in jax-md's list, or in ours, is flagged."""
    scene, functions, given = row
    search = scene.interval.search

    @jax.jit
    def moved(position, state, neighbors, given):
        given = functions.update(position, given)
        state, neighbors = listed_by_jax_md(search, state._replace(position=position), neighbors, given)
        return state, neighbors, given

    start = scene.state.position
    shifted = jnp.asarray(np.asarray(start) + [0.03, 0.05])
    state, neighbors, after = moved(shifted, scene.state, scene.neighbors, given)
    assert set(listed_pairs(neighbors)) == {(i, j) for i in range(12) for j in (i - 1, i + 1) if 0 <= j < 12}
    assert not neighbors.overflow and jax.tree.structure(neighbors) == jax.tree.structure(scene.neighbors)
    together = jnp.asarray(np.stack([0.15 + 1e-3 * np.arange(12), np.full(12, 0.1)], 1))
    _, crowded, theirs = moved(together, state, neighbors, after)
    assert int(theirs.did_buffer_overflow) and crowded.overflow
    assert moved(start, state, crowded, given)[1].overflow
    # jax-md has room for what it finds; ours has not.
    for room in (Room(1, 20, 8), Room(8, 10, 8)):
        small = search.allocate((start[:, 0], start[:, 1]), (None, None), scene.neighbors.radius, room)
        small = dataclasses.replace(small, overflow=jnp.zeros((), bool))
        assert moved(start, scene.state, small, given)[1].overflow


def test_a_list_of_other_positions_is_replaced_before_it_can_miss_a_contact(row):
    """Under jit its values are not looked at. The first contact step sees that the particles are far from where jax-md
    saw them, and the scene's own search takes over."""
    scene, functions, given = row
    search = scene.interval.search
    mirrored = jnp.asarray(np.asarray(scene.state.position)[[1, 0, *range(2, 12)]])
    taken = jax.jit(lambda state, neighbors, given: listed_by_jax_md(search, state, neighbors, given))
    state, neighbors = taken(scene.state._replace(position=mirrored), scene.neighbors, given)
    assert int(neighbors.builds) == 2
    end, _ = track(scene._replace(state=state, neighbors=neighbors), 1e-6, 1)
    assert int(end.neighbors.builds) == 3
    assert set(listed_pairs(end.neighbors)) == pairs_within(
        np.asarray(mirrored), search.reach, (0.3, 0.2), (False,) * 2
    )


def changed(**fields):
    return lambda scene, given: dataclasses.replace(given, **{name: make(given) for name, make in fields.items()})


def made(**settings):
    return lambda scene, given: jax_md_functions(scene.interval.search, **settings).allocate(scene.state.position)


def without_the_sixth(index):
    return jnp.where((index == 5) | (jnp.arange(12)[:, None] == 5), 12, index)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda scene, given: given.idx, ("neighbor_list", "ArrayImpl", "jax_md.partition.NeighborList")),
        (made(dr_threshold=0.001), ("cell_size = 0.021", "must reach 0.024 m", "0.02 and dr_threshold = 0.004")),
        # Without cells jax-md tells no reach: a pair is missing.
        (made(r_cutoff=0.016, disable_cell_list=True), ("11 pairs are missing", "particles 0 and 1", "0.024 m")),
        (made(custom_mask_function=without_the_sixth), ("2 pairs are missing, such as particles 4 and 5",)),
        (changed(reference_position=lambda g: g.reference_position[:5]), ("(5, 2)", "12 particles in 2 dimensions")),
        (
            changed(reference_position=lambda g: g.reference_position.astype(jnp.float32)),
            ("float32", "positions of the scene are float64"),
        ),
        (
            changed(reference_position=lambda g: g.reference_position.at[3, 1].add(0.003)),
            ("particle 3 is 0.003 m from there", "half of the skin, 0.002 m", "update"),
        ),
        (changed(reference_position=lambda g: g.reference_position.at[3, 1].set(jnp.nan)), ("finite",)),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(row, make, words):
    scene, _, given = row
    with pytest.raises(jaxdem.InputError) as error:
        listed_by_jax_md(scene.interval.search, scene.state, scene.neighbors, make(scene, given))
    for word in words:
        assert word in str(error.value), str(error.value)


def test_a_list_of_another_period_is_refused():
    """Two discs that touch across the side of the box, and are 2 cm apart in a longer one."""
    scene = world(np.array([[0.009, 0.1], [0.291, 0.1]]), radius=0.01, box=(0.3, 0.2), periodic=(True, False))
    given = jax_md_functions(scene.interval.search, box=(0.32, 0.2)).allocate(scene.state.position)
    with pytest.raises(jaxdem.InputError, match="1 pairs are missing, such as particles 0 and 1"):
        listed_by_jax_md(scene.interval.search, scene.state, scene.neighbors, given)


def test_single_precision_many_periods_away():
    """Two discs 1,000 periods away from the box that overlap by 20 nm: the list of their places in the box, to one
    float, gives the force of ours, which resolves it."""
    period, overlap = 0.3, 2e-8
    position = np.array([[0.1, 0.1], [0.12 - overlap, 0.1]]) + [1000 * period, 0.0]
    scene = world(position, radius=0.01, box=(period, 0.2), periodic=(True, False), dtype=jnp.float32)
    search, state = scene.interval.search, scene.state
    inside = jnp.asarray(position - [1000 * period, 0.0], jnp.float32)
    given = jax_md_functions(search).allocate(inside)
    moved, theirs = listed_by_jax_md(search, state, scene.neighbors, given)
    found, expected = forces(scene, moved, theirs)[0], forces(scene, state, scene.neighbors)[0]
    assert np.abs(expected).max() > 0.0
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_no_module_of_the_package_imports_jax_md():
    """A run needs none: what a user gives is read, not made."""
    for path in Path(jaxdem.__file__).parent.rglob("*.py"):
        assert not re.search(r"^\s*(import|from) jax_md", path.read_text(encoding="utf-8"), re.MULTILINE), path

"""The neighbour list by levels of size: its pairs against brute force, its motion, and when a scene has it."""

from __future__ import annotations

import copy
import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.particles.level_room import pairs_in_reach
from jaxdem.particles.list_room import list_room
from jaxdem.particles.neighbor_search import NeighborSearch
from jaxdem.particles.neighbors import NeighborGeometry, Room, RowRoom
from jaxdem.particles.pairs import sum_over_pairs
from jaxdem.particles.size_levels import LevelTables, SizeLevels
from jaxdem.run.restart import from_arrays, to_arrays
from tests.cases.tiers import COMBINATION, tiered
from tests.cases.worlds import advance, constants, track, world

COUNT, GAP, SKIN, LARGEST = 120, 0.002, 0.04, 0.12
LEVELS = tuple(LARGEST / 4**k for k in (2, 1, 0))
ROOM = Room(60, 1500, 60, rows=RowRoom(8, 500, 60))
"""One program for all ratios of a dimension."""


def pack(dimension, ratio):
    """Random points, two of them in corners and one beyond a periodic side by a hair, and radii over a ratio."""
    generator = np.random.default_rng(dimension)
    box = (1.0, 1.2, 0.9)[:dimension]
    radius = LARGEST * ratio ** -generator.uniform(0.0, 1.0, COUNT)
    radius[:4] = LARGEST * np.array([1.0, 1.0 / ratio, 1.0, 1.0 / ratio])
    if ratio == 1.0:
        radius = np.full(COUNT, 0.4 * LARGEST)
    position = generator.uniform(0.0, 1.0, (COUNT, dimension)) * box
    position[0], position[1], position[2, 0] = 0.0, box, 1.001 * box[0]
    return position, radius, box


def search_in(box):
    """By levels, in a box that is periodic but for the last axis."""
    geometry = NeighborGeometry(box, (True,) * (len(box) - 1) + (False,), 2.0 * LARGEST + GAP, SKIN)
    return NeighborSearch(geometry, LARGEST, levels=SizeLevels.of(LEVELS, GAP, SKIN, box, SKIN))


def allocated(search, position, radius):
    """The list at these positions."""
    columns = tuple(jnp.asarray(x) for x in position.T)
    return search.allocate(columns, (None,) * len(columns), jnp.asarray(radius), ROOM)


def by_brute_force(position, radius, box, periodic):
    """Pairs whose gap is below the reach, as (lower, higher) index."""
    apart = position[:, None] - position[None]
    for axis, wraps in enumerate(periodic):
        if wraps:
            apart[..., axis] -= box[axis] * np.round(apart[..., axis] / box[axis])
    near = np.linalg.norm(apart, axis=2) < radius[:, None] + radius[None] + GAP + SKIN
    return {(int(i), int(j)) for i, j in zip(*np.nonzero(np.triu(near, 1)), strict=True)}


def listed(neighbors):
    """Pairs of the flat list."""
    first, second = map(np.asarray, neighbors.pairs[:2])
    return [(int(i), int(j)) for i, j in zip(first, second, strict=True) if i != j]


PAIRS_OF = [(ratio, dimension) for ratio in (1.0, 10.0, 50.0) for dimension in (2, 3)]


@pytest.mark.parametrize(("ratio", "dimension"), tiered(PAIRS_OF, first=[(10.0, 2), (50.0, 3)]))
def test_pairs_are_those_of_brute_force(dimension, ratio):
    """Each once, with a cohesion's longer reach; and what a particle gathers is of its own pairs.

    Weights of the pairs are whole numbers, so that sums in any order are exact. The pairs from which room is counted,
    on the host, are the same.
    """
    position, radius, box = pack(dimension, ratio)
    search = search_in(box)
    neighbors, periodic = allocated(search, position, radius), search.geometry.periodic
    expected = by_brute_force(position, radius, box, periodic)
    found = listed(neighbors)
    assert len(expected) > 30 and not neighbors.overflow
    assert len(found) == len(set(found)) and set(found) == expected
    one, other = pairs_in_reach(search.geometry, tuple(position.T), radius + 0.5 * (GAP + SKIN))
    assert {(min(p), max(p)) for p in zip(one.tolist(), other.tolist(), strict=True)} == expected
    weight = np.arange(1.0, 1.0 + len(neighbors.overlap))
    weight[np.asarray(neighbors.pairs.first == neighbors.pairs.second)] = 0.0
    gathered = np.zeros(COUNT)
    np.add.at(gathered, np.asarray(neighbors.pairs.first), weight)
    np.add.at(gathered, np.asarray(neighbors.pairs.second), 10.0 * weight)
    given = jnp.asarray(weight)
    np.testing.assert_array_equal(sum_over_pairs(given, 10.0 * given, neighbors.pairs), gathered)


def test_one_table_lists_by_the_sizes_of_both():
    """The pairs of a list without levels are those of brute force too, and the room for them is counted on the host.

    Negative control: with one reach for all, as far as the largest, there are more.
    """
    position, radius, box = pack(2, 10.0)
    search = dataclasses.replace(search_in(box), levels=None)
    columns = tuple(jnp.asarray(x) for x in position.T)
    sizes = jnp.asarray(radius)
    neighbors = search.allocate(columns, (None, None), sizes, list_room(search, columns, radius=sizes))
    expected = by_brute_force(position, radius, box, search.geometry.periodic)
    assert not neighbors.overflow and neighbors.pairs.owned is None
    assert set(listed(neighbors)) == expected and neighbors.room.pairs > len(expected)
    alike = by_brute_force(position, np.full(COUNT, LARGEST), box, search.geometry.periodic)
    assert expected < alike and list_room(search, columns).pairs > len(alike) > 2 * neighbors.room.pairs


def test_cells_that_are_too_narrow_lose_pairs():
    """Negative control: with half as wide cells for the grains of finer levels the set of pairs is another one."""
    position, radius, box = pack(2, 10.0)
    search = search_in(box)
    narrow = tuple(tuple(2 * n for n in cells) for cells in search.levels.across)
    other = dataclasses.replace(search, levels=dataclasses.replace(search.levels, across=narrow))
    assert set(listed(allocated(other, position, radius))) < set(listed(allocated(search, position, radius)))


def test_a_large_grain_among_hundreds_of_small_ones_has_short_rows():
    """One disc that 900 small ones surround: rows stay as narrow as those of the small, and its sum is of all."""
    angle = 2.0 * np.pi * np.arange(900) / 900
    ring = 0.5 + 0.4505 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    position = np.concatenate([[[0.5, 0.5]], ring])
    radius = np.concatenate([[0.45], np.full(900, 0.0005)])
    neighbors = world(position, radius=radius, skin=0.001, levels=[0.0005, 0.45]).neighbors
    room = neighbors.room
    assert room.slots <= 16 and room.rows.width <= 16
    assert room.rows.width * (901 + room.rows.further) < 20 * 901
    ones = jnp.where(neighbors.pairs.first != neighbors.pairs.second, 1.0, 0.0)
    assert float(sum_over_pairs(ones, ones, neighbors.pairs)[0]) == 900.0


def gas(levels):
    """Twelve fast discs, the largest seven times as large as the smallest, one side periodic, with friction."""
    generator = np.random.default_rng(11)
    grid = (np.stack(np.meshgrid(np.arange(4), np.arange(3), indexing="ij"), -1).reshape(-1, 2) + 0.5) * 0.03
    radius = np.resize([0.002, 0.004, 0.008], 12)
    radius[5] = 0.014
    return world(
        grid, generator.normal(0.0, 3.0, (12, 2)), radius=radius, box=(0.12, 0.09), periodic=(True, False),
        rebuild=levels is not None, material=constants(friction=0.3, restitution=0.8), skin=0.1, levels=levels,
    )  # fmt: skip


def test_motion_is_that_of_all_pairs():
    """Springs go along through the rebuilds: the gas is chaotic, and a spring or a contact that is lost shows at once.

    All pairs are in one list of NumPy's. Lists with too little room flag it.
    """
    end, seen = track(gas([0.002, 0.008, 0.014]), 1e-5, 120, 5)
    _, reference = track(gas(None), 1e-5, 120, 5)
    assert int(end.neighbors.builds) > 5
    assert np.count_nonzero(np.abs(reference.force).max(axis=2)) > 50
    np.testing.assert_allclose(seen.position, reference.position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(seen.spin, reference.spin, rtol=0, atol=1e-5)
    room, search = end.neighbors.room, end.interval.search
    given = tuple(end.neighbors.reference), (None, None), end.neighbors.radius
    assert not bool(search.allocate(*given, room).overflow)
    needed = len(listed(end.neighbors))
    for short in (
        dataclasses.replace(room, pairs=needed),
        dataclasses.replace(room, rows=room.rows._replace(width=1, further=0)),
    ):
        assert bool(search.allocate(*given, short).overflow)
    assert Room.of(room.numbers) == room


@COMBINATION
def test_slope_by_the_stiffness_is_that_of_a_small_change():
    """In reverse mode through rebuilds of the list; weights, because momentum keeps the mean place."""
    scene = gas([0.002, 0.008, 0.014])

    @jax.jit
    def place(modulus):
        given = scene._replace(constants=scene.constants._replace(young_modulus=modulus))
        end = advance(given, 1e-5, 600, reversible=True)
        return jnp.dot(jnp.arange(12.0), end.state.position[:, 0]), end.neighbors.builds

    both = jax.jit(jax.value_and_grad(place, has_aux=True))
    modulus = scene.constants.young_modulus
    (_, builds), slope = both(modulus)
    (above, _), _ = both(modulus * (1.0 + 1e-7))
    (below, _), _ = both(modulus * (1.0 - 1e-7))
    assert int(builds) > 2 and slope != 0.0
    np.testing.assert_allclose(slope, (above - below) / (2e-7 * modulus), rtol=1e-3)


TWO_SIZES = {
    "domain": {"size": [0.12, 0.2], "depth": 0.02},
    "particles": {
        "position": [[0.03, 0.03], [0.09, 0.03], *([0.008 + 0.0085 * k, 0.066 + 0.004 * (k % 3)] for k in range(13))],
        "radius": [0.028, 0.028, *[0.004] * 13],
        "density": 2000.0,
    },
    "contact": {"young_modulus": 1e5, "friction": 0.4, "maximum_overlap": 0.5},
    "time": {"end": 0.06, "output_interval": 0.03},
}


def test_a_checkpoint_holds_the_list_bit_for_bit():
    """So does one of a version with a single table: the pairs by levels are then found anew, and keep their springs."""
    scene = jaxdem.load_scene(TWO_SIZES)
    simulation, parameters = jaxdem.build(scene)
    assert len(simulation.search.levels.radii) == 2
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    again, listed_again, _ = from_arrays(simulation, state, to_arrays(state, neighbors, {}))
    before, after = (jax.tree.leaves(given) for given in ((state, neighbors), (again, listed_again)))
    assert jax.tree.structure(neighbors) == jax.tree.structure(listed_again)
    for one, other in zip(before, after, strict=True):
        np.testing.assert_array_equal(one, other)
    single = simulation.without_levels().allocate(parameters, state.particles)

    def value(pairs):
        return jnp.where(pairs.first != pairs.second, 100.0 * pairs.first + pairs.second, 0.0).astype(jnp.float32)

    springs = (value(single.pairs),) * len(state.particles.contact_spring)
    former = state._replace(particles=state.particles._replace(contact_spring=springs))
    again, by_levels, _ = from_arrays(simulation, former, to_arrays(former, single, {}))
    assert set(listed(by_levels)) == set(listed(neighbors)) < set(listed(single))
    np.testing.assert_array_equal(again.particles.contact_spring[0], value(by_levels.pairs))


def test_equal_grains_know_nothing_of_levels(monkeypatch):
    """A scene of equal grains, or of nearly equal ones, is built and listed without a look at the levels."""

    def never(*_, **__):
        raise AssertionError("levels in a scene of equal grains")

    monkeypatch.setattr(LevelTables, "owned", never)
    for radius in (0.004, [0.004, 0.0042] * 5):
        tables = copy.deepcopy(TWO_SIZES)
        tables["particles"] |= {"radius": radius, "position": [[0.01 * k, 0.02] for k in range(1, 11)]}
        scene = jaxdem.load_scene(tables)
        simulation, parameters = jaxdem.build(scene)
        assert simulation.search.levels is None
        assert jaxdem.initial_state(scene, simulation, parameters)[1].pairs.owned is None


def test_the_scene_of_segregation_is_searched_by_levels():
    """One large disc among small ones, 1 : 4."""
    scene = jaxdem.load_scene(Path(__file__).parents[2] / "scenes" / "brazil_nut.toml")
    assert jaxdem.build(scene)[0].search.levels.radii == (0.002, 0.0079)

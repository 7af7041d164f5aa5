"""The neighbour list and the contact history through rebuilds; list against all pairs: `tests/cases/lists.py`."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import KDTree

from jaxdem.particles import cells, list_in_date, neighbors
from jaxdem.particles import pairs as pair_list
from jaxdem.particles.cells import OWN_COLUMNS, CellGrid, neighbors_in_cells
from jaxdem.particles.neighbors import Room, carry_history
from jaxdem.particles.pairs import Pairs, pairs_of, place_of, sum_over_pairs
from tests.cases import worlds
from tests.cases.lists import listed_pairs, pairs_within
from tests.cases.worlds import constants, track, world


def gas(rebuild):
    """Nine fast discs in a small box, one side periodic, with friction: dozens of rebuilds in a thousand
    steps."""
    generator = np.random.default_rng(11)
    grid = (np.stack(np.meshgrid(np.arange(3), np.arange(3), indexing="ij"), -1).reshape(-1, 2) + 0.5) * 0.027
    velocity = generator.normal(0.0, 3.0, (9, 2))
    return world(
        grid, velocity, radius=np.where(np.arange(9) % 3 == 0, 0.005, 0.01), box=(0.081, 0.081),
        periodic=(True, False), rebuild=rebuild, material=constants(friction=0.3, restitution=0.8),
    )  # fmt: skip


@pytest.fixture(scope="module")
def trajectory():
    """The gas with the list: world and frames every five steps."""
    return track(gas(True), 1e-5, 120, 5)


def test_list_is_rebuilt_in_time(trajectory):
    """Along a trajectory of fast particles the list gives the motion of all pairs.

    All pairs are in one list built by numpy at the start; a missed contact would show at once, for the gas is
    chaotic: round-off of 1e-16 grows by some ten times in each of the few collisions of a particle.
    """
    end, seen = trajectory
    _, reference = track(gas(False), 1e-5, 120, 5)
    assert int(end.neighbors.builds) > 5
    assert np.count_nonzero(np.abs(reference.force).max(axis=2)) > 50
    np.testing.assert_allclose(seen.position, reference.position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(seen.spin, reference.spin, rtol=0, atol=1e-5)


def test_a_list_of_many_slots_gives_the_same_motion(trajectory, monkeypatch):
    """What is sought by halving where a large particle has very many neighbours, here where all have eight: rebuilds,
    springs carried along and sums."""
    for module in (cells, neighbors, pair_list):
        monkeypatch.setattr(module, "WRITTEN_OUT", 2)
    _, seen = track(gas(True), 1e-5, 120, 5)
    np.testing.assert_allclose(seen.position, trajectory[1].position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(seen.spin, trajectory[1].spin, rtol=0, atol=1e-5)


def test_a_list_that_is_never_rebuilt_fails(trajectory, monkeypatch):
    """Negative control: with the rebuild switched off the trajectory is another."""
    # Programs are shared by equal descriptions: these are compiled anew, and kept for nobody.
    monkeypatch.setattr(worlds, "runner", worlds.runner.__wrapped__)
    monkeypatch.setattr(list_in_date, "out_of_date", lambda *_: jnp.zeros((), bool))
    end, seen = track(gas(True), 1e-5, 120, 5)
    assert int(end.neighbors.builds) == 1
    assert np.abs(seen.position - trajectory[1].position).max() > 1e-3


def test_one_large_sphere_among_many_small_ones_has_a_short_search():
    """A column of the table holds hundreds: the program is no longer for it, and the list is SciPy's.

    Written out, the search of 650 rows took 25 s to compile; the same with 4,000 small discs 163 s.
    """
    generator = np.random.default_rng(5)
    position = generator.uniform(0.0, 1.0, (150, 2))
    reach, room = 0.3, Room(100, 5000, 70)
    grid = CellGrid((1.0, 1.0), (False, False), reach, len(position))
    columns = tuple(jnp.asarray(x) for x in position.T)

    def search(cell_slots):
        return lambda x: neighbors_in_cells(grid, x, room.slots, cell_slots)

    lengths = [len(str(jax.make_jaxpr(search(rows))(columns))) for rows in (40, room.cell)]
    assert lengths[1] < 1.1 * lengths[0]
    index, crowded = jax.jit(search(room.cell))(columns)
    pairs, too_many = jax.jit(lambda i: pairs_of(i, room.pairs))(index)
    assert not crowded and not too_many
    expected = KDTree(position).query_pairs(reach, output_type="ndarray")
    found = np.stack([np.asarray(pairs.first), np.asarray(pairs.second)], 1)[: len(expected) + 1]
    assert {*map(tuple, found.tolist())} - {(0, 0)} == {*map(tuple, np.sort(expected).tolist())}
    # What a particle gathers from its pairs, by the loop: here how many there are.
    ones = jnp.where(pairs.first != pairs.second, 1.0, 0.0)
    counts = sum_over_pairs(ones, ones, pairs)
    np.testing.assert_array_equal(counts, np.bincount(expected.ravel(), minlength=len(position)))
    place, found = place_of(pairs, pairs.first, pairs.second)
    np.testing.assert_array_equal(found, pairs.first != pairs.second)
    np.testing.assert_array_equal(place[found], np.flatnonzero(found))
    _, with_last = place_of(pairs, jnp.arange(149), jnp.full(149, 149))
    assert {*np.flatnonzero(with_last)} == {int(i) for i, j in np.sort(expected).tolist() if j == 149}
    slope = jax.grad(lambda x: jnp.sum(sum_over_pairs(x, 2.0 * x, pairs)))(ones)
    np.testing.assert_array_equal(slope[: len(expected)], 3.0)


@pytest.mark.parametrize("periodic", [(False, False, False), (True, False, True)])
def test_a_list_whose_cells_share_columns_is_complete(periodic):
    """10,000 spheres in a box of many more cells than the table has columns, in a clump and thinly all over: pairs of
    SciPy."""
    generator = np.random.default_rng(4)
    box, reach = (1.7, 1.5, 1.6), 0.024
    position = generator.uniform(0.0, 1.0, (10_000, 3)) * np.array(box)
    position[:2000] = position[:2000] * 0.12 + np.where(periodic, 0.94, 0.2) * np.array(box)
    position = np.where(periodic, np.mod(position, box), position)
    grid = CellGrid(box, periodic, reach, len(position))
    assert grid.shares and grid.columns == OWN_COLUMNS
    columns = tuple(jnp.asarray(x) for x in position.T)
    room = grid.largest_occupancy(columns)
    index, crowded = jax.jit(lambda x: neighbors_in_cells(grid, x, 60, room))(columns)
    assert not crowded
    found = {(i, int(j)) for row in np.asarray(index) for i, j in enumerate(row) if i != j}
    # SciPy takes a period of zero for none.
    expected = KDTree(position, boxsize=np.where(periodic, box, 0.0)).query_pairs(reach, output_type="ndarray")
    assert len(expected) > 10_000
    assert np.count_nonzero(np.asarray(index) != np.arange(len(position))[None]) == 2 * len(expected)  # none twice
    assert found == {(int(i), int(j)) for a, b in expected for i, j in ((a, b), (b, a))}


def test_a_few_grains_in_a_box_of_1e14_cells():
    """Their pairs, by brute force, and the room for them: cells of such a box would be more than any memory holds."""
    generator = np.random.default_rng(5)
    position = 30.0 + generator.uniform(0.0, 0.008, (60, 3))
    listed = world(position, radius=0.0005, box=(60.0, 60.0, 60.0), walls=False).neighbors
    pairs = pairs_within(position, 2 * 0.0005 * 1.2, (60.0,) * 3, (False,) * 3)
    assert len(pairs) > 20 and not listed.overflow
    assert set(listed_pairs(listed)) == pairs


def test_cells_around_one_at_a_periodic_side_never_share_a_column():
    """Around the corners of periodic boxes of 40 shapes, one of which needs other multipliers than its cells alone: a
    particle in a shared column would be found twice."""
    generator = np.random.default_rng(6)
    for shape in generator.integers(52, 400, (40, 3)):
        grid = CellGrid(tuple(0.01 * shape + 1e-6), (True, True, bool(shape[2] % 2)), 0.01, 10)
        assert grid.shape == tuple(shape) and grid.shares
        low = [0 if wraps else 1 for wraps in grid.periodic]
        corners = np.array([low, low + shape - 1, [low[0], *(low + shape - 1)[1:]]]).T
        columns = np.asarray(grid.around(tuple(jnp.asarray(c, jnp.int32) for c in corners)))
        assert all(len(set(column.tolist())) == 27 for column in columns.T)


def test_a_grain_a_hair_below_a_periodic_side_is_in_a_list_of_shared_columns():
    """Its image lies on the side itself, to round-off; 20 grains have room for 20 in a column, however wide it is."""
    position = np.array([[-1e-17, 1.0, 1.0], [2.9995, 1.0, 1.0], [1.0, 1.0, 1.0]])
    listed = world(position, radius=0.0005, box=(3.0, 3.0, 3.0), periodic=(True, False, False), walls=False).neighbors
    assert set(listed_pairs(listed)) == {(0, 1), (1, 0)}
    assert listed.room.cell <= 3


def test_near_cells_never_share_a_column():
    """Every two of 7 x 7 x 7 cells, anywhere; a pair of cells around a particle that did would list its pairs twice."""
    for most in (10, 100_000):
        grid = CellGrid((3.0, 3.0, 3.0), (False,) * 3, 0.005, most)
        block = np.stack(np.meshgrid(*[np.arange(7)] * 3, indexing="ij"), -1).reshape(-1, 3)
        for corner in ((1, 1, 1), (500, 3, 77), (590, 590, 590)):
            flat = np.asarray(grid.flat(tuple(jnp.asarray(c, jnp.int32) for c in (block + corner).T)))
            assert len(set(flat.tolist())) == len(block)
            assert flat.min() >= 0 and flat.max() < grid.columns


# --- History ------------------------------------------------------------------------------------------------


def shuffled(scene, seed):
    """The same list with the slots of every particle, and the pairs, in another order, history with them."""
    generator = np.random.default_rng(seed)
    neighbors, state = scene.neighbors, scene.state
    slots, count, room = neighbors.room.slots, state.position.shape[0], neighbors.room.pairs
    order = np.argsort(generator.random((slots, count)), axis=0)
    # The empty pair stays the last.
    place = np.append(generator.permutation(room - 1), room - 1)
    whither = jnp.asarray(np.argsort(place), jnp.int32)

    def turn(rows):
        return jnp.take_along_axis(rows, jnp.asarray(order), axis=0)

    pairs, entry = neighbors.pairs, turn(neighbors.pairs.entry)
    entry = jnp.where(entry < room, whither[entry % room], room + whither[entry % room])
    new = dataclasses.replace(
        neighbors,
        index=turn(neighbors.index), pairs=Pairs(pairs.first[place], pairs.second[place], entry),
        separation=tuple(x[place] for x in neighbors.separation), overlap=neighbors.overlap[place],
    )  # fmt: skip
    springs = tuple(x[place] for x in state.contact_spring)
    return scene._replace(neighbors=new, state=state._replace(contact_spring=springs))


def pressed():
    """A disc held in the gap of two others, spun: three sliding or sticking contacts, with springs."""
    position = [[0.05, 0.0099], [0.0698, 0.0099], [0.0599, 0.02705]]
    return world(
        position, None, [0.0, 0.0, 20.0], box=(0.12, 0.06), gravity=(0.0, -9.81),
        material=constants(friction=0.5, restitution=0.5, young_modulus=1e6),
    )  # fmt: skip


def test_history_follows_the_identity_of_the_pair():
    """`carry_history` puts each pair's value where the pair stands in the new list, zero for new pairs."""
    generator = np.random.default_rng(2)
    position = generator.uniform(0, 0.08, (30, 2))
    scene = world(position, box=(0.08, 0.08))
    # The value of pair (i, j) is a function of both, so that it can be recognised.
    value = lambda i, j: (i + 0.01 * j, -1.0 * i * j)  # noqa: E731
    first, second = map(np.asarray, scene.neighbors.pairs[:2])
    history = tuple(jnp.asarray(np.where(first == second, 0.0, x)) for x in value(first, second))
    moved = position + generator.uniform(-0.01, 0.01, position.shape)
    room = scene.neighbors.room
    wider = dataclasses.replace(room, slots=room.slots + 3, pairs=room.pairs + 9)
    new = world(moved, box=(0.08, 0.08), room=wider).neighbors
    carried = np.stack(carry_history(history, scene.neighbors, new), axis=1)
    old_pairs, kept, lost = listed_pairs(scene.neighbors), 0, 0
    for i, j, vector in zip(*map(np.asarray, new.pairs[:2]), carried, strict=True):
        known = (int(i), int(j)) in old_pairs
        np.testing.assert_array_equal(vector, value(i, j) if known else (0.0, 0.0))
        kept, lost = kept + known, lost + (not known and i != j)
    assert kept > 50 and lost > 3


@pytest.mark.parametrize("control", [False, True])
def test_rebuilds_do_not_change_sliding_contacts(monkeypatch, control):
    """Rebuilding at almost every step, and shuffled slots, give the motion of one list kept: to 1e-12.

    The overlap is counted from another build each time: round-off of 1e-17 m against overlaps of 1e-4.
    Negative control: with history dropped at rebuilds the motion is another.
    """
    plain, seen = track(pressed(), 2e-5, 20, 20)
    assert int(plain.neighbors.builds) == 1
    springs = [float(jnp.abs(s).max()) for s in plain.state.contact_spring]
    assert max(springs) > 1e-7  # the contacts hold springs to be lost
    # Programs are shared by equal descriptions: these are compiled anew, and kept for nobody.
    monkeypatch.setattr(worlds, "runner", worlds.runner.__wrapped__)
    monkeypatch.setattr(list_in_date, "out_of_date", lambda d, *_: jnp.max(jnp.abs(d[0]) + jnp.abs(d[1])) > 1e-9)
    if control:
        monkeypatch.setattr(
            list_in_date, "carry_history",
            lambda h, old, new: tuple(jnp.zeros_like(x) for x in h),
        )  # fmt: skip
    rebuilt, again = track(shuffled(pressed(), 4), 2e-5, 20, 20)
    assert int(rebuilt.neighbors.builds) > 50
    difference = np.abs(seen.position - again.position).max()
    turned = np.abs(seen.spin - again.spin).max()
    if control:
        assert difference > 1e-8 or turned > 1e-3
    else:
        assert difference < 1e-13 and turned < 1e-9


def test_overflow_is_flagged():
    """Particles drawn together into one spot exceed the slots, or the pairs: the flag goes up and stays up."""
    spread = np.stack([np.arange(16) * 0.03 + 0.02, np.full(16, 0.1)], 1)
    scene = world(spread, radius=0.01, box=(0.5, 0.2))
    search, low = scene.interval.search, (None, None)
    together = jnp.asarray(np.stack([0.25 + 1e-3 * np.arange(16), np.full(16, 0.1)], 1))
    update = jax.jit(lambda p, n: search.update((p[:, 0], p[:, 1]), low, n))
    assert not bool(update(jnp.asarray(spread), scene.neighbors).overflow)
    crowded = update(together, scene.neighbors)
    assert bool(crowded.overflow)
    assert bool(update(jnp.asarray(spread), crowded).overflow)
    # 15 pairs of neighbours in the row, at a distance that the list reaches: 15 pairs fit, 14 do not.
    row = jnp.asarray(np.stack([np.arange(16) * 0.021 + 0.02, np.full(16, 0.1)], 1))
    for pairs, short in ((15, False), (14, True)):
        listed = search.allocate((row[:, 0], row[:, 1]), low, scene.neighbors.radius, Room(8, pairs + 1, 8))
        assert bool(listed.overflow) == short


@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_particles(count):
    """None, one and two particles: a flight over many skins, straight and without end (the loop must go
    on)."""
    position = np.array([[0.1, 0.1], [0.3, 0.3]])[:count].reshape(count, 2)
    velocity = np.array([[1.0, 0.5], [0.5, 1.0]])[:count].reshape(count, 2)
    scene = world(position, velocity, radius=0.01)
    end, _ = track(scene, 1e-3, 1, 300)
    # 300 roundings of numbers below 1.
    np.testing.assert_allclose(end.state.position, position + 0.3 * velocity, atol=300 * 1.2e-16)

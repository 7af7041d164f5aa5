"""Lists by levels of size in slabs against one device: grains of 1 : 8 to 1 : 50 that touch across borders and periodic
sides, what their contacts keep, who is a ghost, and room."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem import devices
from jaxdem.devices import contacts, distribution
from jaxdem.devices.simulation import divided
from jaxdem.failures import Failure, failures
from jaxdem.particles import slab_history
from jaxdem.particles.neighbors import Room, RowRoom
from jaxdem.run.placement import OneDevice, Slabs
from jaxdem.setup.builder import build_case
from tests.cases.slabs import apart
from tests.cases.tiers import COMBINATION, tiered

PARTS = ("velocity", "angular_velocity", "contact_force")
SIDES = "left", "right", "front", "back", "bottom", "top"
LENGTH = 0.36
LARGE = 0.02
"""Length of the box, and largest radius [m]."""


def scene_of(size, position, radius, velocity, periodic, interval=0.005, **contact):
    names = (
        ("left", "right", "bottom", "top") if len(size) == 2 else ("left", "right", "front", "back", "bottom", "top")
    )
    tables = {
        "precision": "float64",
        "domain": {"size": size, "gravity": [0.0] * len(size)},
        "particles": {
            "position": position.tolist(), "radius": radius.tolist(), "density": 2500.0, "velocity": velocity.tolist()
        },
        "contact": {"young_modulus": 1e6, "friction": 0.4, "restitution": 0.6, "speed": 1.0} | contact,
        "boundary": {name: {"kind": "periodic"} for name in names[: 2 * periodic]},
        "time": {"end": 0.05, "output_interval": interval},
    }  # fmt: skip
    if len(size) == 2:
        tables["domain"]["depth"] = 0.02
    return jaxdem.load_scene(tables)


def pack():
    """Four large discs in small ones, 1 : 8, pressed together on a lattice between two smooth walls. All drift along
    the periodic axis, by three quarters of a diameter of the large ones in eight intervals."""
    small, drift, noise = LARGE / 8, 0.95, np.random.default_rng(1)
    across, up = np.arange(74), np.arange(10)
    lattice = np.stack(np.meshgrid(LENGTH * (across + 0.5) / 74, small + 0.005 * up, indexing="ij"), -1).reshape(-1, 2)
    large = np.stack((LENGTH * (np.arange(4) + 0.3) / 4, np.full(4, 0.025)), -1)
    between = lattice[:, None] - large
    between[..., 0] -= LENGTH * np.round(between[..., 0] / LENGTH)
    lattice = lattice[(np.linalg.norm(between, axis=-1) > LARGE + 0.97 * small).all(axis=1)]
    position = np.concatenate((large, lattice))
    radius = np.where(np.arange(len(position)) < 4, LARGE, small)
    order = noise.permutation(len(position))
    velocity = [drift, 0.0] + 0.01 * noise.normal(size=position.shape)
    rolling = {"rolling_friction": 0.1, "rolling_model": "epsd", "wall_friction": 0.0}
    return scene_of([LENGTH, 0.05], position[order], radius[order], velocity, 1, **rolling)


def planets():
    """Spheres of 1 : 50 in space: two large ones that drift, each with small ones all around that stick to it by an
    attraction and roll, through all sides, which are periodic."""
    small, noise = LARGE / 50, np.random.default_rng(2)
    size, large = [LENGTH, 0.14, 0.14], [[0.07, 0.07, 0.07], [0.28, 0.07, 0.07]]
    found, pressed = [], 0.99
    for centre in large:
        while len(found) % 60 or len(found) < 60 * (large.index(centre) + 1):
            way = noise.normal(size=3) * [1.0, 0.3, 0.3]
            place = centre + (LARGE + pressed * small) * way / np.linalg.norm(way)
            if all(np.linalg.norm(place - other) > 2.0 * pressed * small for other in found):
                found.append(place)
    position = np.concatenate((found, large))
    radius = np.where(np.arange(len(position)) < 120, small, LARGE)
    velocity = [0.9, 0.3, -0.2] + np.where(radius < LARGE, 0.05, 0.0)[:, None] * noise.normal(size=position.shape)
    sticking = {"cohesion": {"kind": "sjkr", "energy_density": 2e4}}
    return scene_of(size, position, radius, velocity, 3, 0.001, **sticking)


class Compared:
    """A scene on one device and in slabs, interval by interval."""

    def __init__(self, scene, number, room=None):
        self.simulation, self.parameters = jaxdem.build(scene)
        self.divided, _ = jaxdem.build(scene, devices=number)
        assert self.divided.search.levels is not None
        self.one = jaxdem.initial_state(scene, self.simulation, self.parameters)
        self.slabs = devices.distributed(self.divided, self.parameters, *self.one, room)
        self.force = 0.0
        self.steps = jax.jit(self.simulation.step), jax.jit(self.divided.step)

    def go_on(self, intervals):
        for _ in range(intervals):
            *self.one, report = self.steps[0](self.parameters, *self.one)
            assert int(failures(self.simulation, report)) == 0
            new = self.steps[1](self.parameters, *self.slabs)
            while int(failures(self.divided, new[2])) & Failure.OVERFLOW:
                self.slabs = devices.enlarged(self.divided, self.parameters, *self.slabs, new[1])
                new = self.steps[1](self.parameters, *self.slabs)
            assert int(failures(self.divided, new[2])) == 0
            self.slabs = new[:2]

    def difference(self):
        """Largest difference of forces, velocities and spins over the largest of each, of forces so far, since they may
        come to cancel; the pairs that touch in the one and not in the other; and how many touch. Momentum is the same.
        """
        whole, found = devices.gathered(self.divided, *self.slabs)
        own, other = (jax.device_get(state.particles) for state in (self.one[0], whole))
        if own.active is not None:
            np.testing.assert_array_equal(own.active, other.active)
            own, other = (
                p._replace(**{name: getattr(p, name) * own.active[:, None] for name in PARTS}) for p in (own, other)
            )
        mass = np.asarray(self.parameters.bodies.mass)[:, None]
        momenta = [np.sum(mass * np.asarray(p.velocity), axis=0) for p in (own, other)]
        rounding = 1e-12 if own.velocity.dtype == np.float64 else 2e-6
        np.testing.assert_allclose(*momenta, rtol=rounding, atol=0.1 * rounding * np.abs(momenta[0]).max())
        kept = contacts.contacts_of_list(own.contact_spring, jax.device_get(self.one[1]))
        pairs = [
            set(zip(np.minimum(c.first, c.second), np.maximum(c.first, c.second), strict=True)) for c in (kept, found)
        ]
        off = [apart(getattr(own, p), getattr(other, p)) for p in PARTS[:2]]
        self.force = max(self.force, np.abs(own.contact_force).max())
        off.append(np.abs(own.contact_force - other.contact_force).max() / self.force)
        return max(off), pairs[0] ^ pairs[1], len(pairs[0])

    def again(self):
        """The slabs from where one device is."""
        self.slabs = devices.distributed(self.divided, self.parameters, *self.one, devices.SlabRoom.of(self.slabs[1]))


@pytest.mark.parametrize("number", tiered([1, 2, 4], first=[4]))
def test_a_pack_of_wide_sizes_that_drifts_through_slabs_keeps_its_contacts(number):
    """Rounding errors grow in a pack of wide sizes, a hundredfold in eight intervals, so that what comes of a single
    interval is compared more strictly. Four slabs have room for all of it: every further room is a program."""
    room = devices.SlabRoom(192, 128, 96, Room(12, 900, 6, rows=RowRoom(8, 64, 4)))
    both = Compared(pack(), number, room if number == 4 else None)
    both.go_on(1)
    off, others, touching = both.difference()
    assert off < 2e-12 and not others and touching > 300
    both.go_on(8)
    off, others, touching = both.difference()
    assert off < 1e-9 and not others and touching > 300
    if number > 1:
        assert devices.counts(both.slabs[1]).migrations > 0
        assert springs_of_both_slabs(both.slabs) > 2 * number
    both.again()
    both.go_on(1)
    off, others, _ = both.difference()
    assert off < 2e-12 and not others
    assert number < 4 or both.steps[1]._cache_size() == 1, "one room, one program"


def all_copies(slabs):
    """The contacts that slabs keep, one across a border twice."""
    particles, lists = jax.device_get((slabs[0].particles, slabs[1]))
    identity, pairs = lists.ghosts.identity, lists.pairs
    everyone = np.ones(identity.shape[1], bool)
    return contacts.contacts_of_rows(particles.contact_spring, everyone, identity, pairs.first, pairs.second)


def springs_of_both_slabs(slabs):
    """How many contacts two slabs keep, with the same springs bit for bit."""
    kept = all_copies(slabs)
    assert np.all(kept.first < kept.second)
    number = np.array([kept.first, kept.second])
    order = np.lexsort(number)
    number, values = number[:, order], kept.values[:, order]
    twice = (number[:, 1:] == number[:, :-1]).all(axis=0)
    np.testing.assert_array_equal(values[:, 1:][:, twice], values[:, :-1][:, twice])
    return int(twice.sum())


@pytest.mark.parametrize("number", [pytest.param(number, marks=COMBINATION) for number in (1, 2, 4)])
def test_spheres_of_one_to_fifty_fly_through_slabs(number):
    both = Compared(planets(), number)
    both.go_on(1)
    off, others, touching = both.difference()
    assert off < 1e-12 and not others and touching > 20
    for _ in range(4):
        for _ in range(4):
            *both.one, _ = both.steps[0](both.parameters, *both.one)
        both.again()
        both.go_on(1)
        off, others, touching = both.difference()
        assert off < 2e-12 and not others and touching > 50


def test_what_a_ghost_keeps_comes_with_it(monkeypatch):
    """A contact across a border whose owner is a ghost: without its message the slab would have forgotten it."""
    both = Compared(pack(), 4)
    *one, _ = both.steps[0](both.parameters, *both.one)

    def copies():
        distribution._first_list.cache_clear()
        kept = all_copies(devices.distributed(both.divided, both.parameters, *one))
        return sorted(zip(kept.first.tolist(), kept.second.tolist(), strict=True))

    found = copies()
    own = contacts.contacts_of_list(one[0].particles.contact_spring, jax.device_get(one[1]))
    assert set(found) == set(zip(own.first.tolist(), own.second.tolist(), strict=True))
    with_ghosts = slab_history._with_ghosts

    def without(blocks, ghosts, table, blank):
        return with_ghosts(blocks, ghosts, table, blank).at[:, ghosts.rows :].set(blank)

    monkeypatch.setattr(slab_history, "_with_ghosts", without)
    assert len(set(found)) + 10 < len(found) and len(copies()) == len(set(found))


@COMBINATION
def test_checkpoints_of_lists_by_levels():
    """In slabs bit for bit, on one device with the same contacts, and from slabs that had one table for all sizes."""
    case = build_case(pack())
    plain, given = case.simulation, (2, case.particles.position, case.particles.total)
    state, lists = case.initial_state()
    *one, _ = jax.jit(plain.step)(case.parameters, state, lists)
    expected = contact_set(contacts.contacts_of_list(one[0].particles.contact_spring, jax.device_get(one[1])))
    new, old = (Slabs(case, divided(one, *given)) for one in (plain, plain.without_levels()))
    for before in (new, old):
        slabs = before.placed(*one)
        saved = before.saved(*slabs, {})
        found = new.restored(case.initial_state()[0], saved.same, saved.attributes)
        assert found[1].pairs.owned is not None
        kept = devices.gathered(new.simulation, *found[:2])[1]
        assert contact_set(kept) == expected
        if before is new:
            jax.tree.map(np.testing.assert_array_equal, found[:2], slabs)
        alone = OneDevice(case).restored(case.initial_state()[0], saved.same, saved.attributes)
        springs = alone[0].particles.contact_spring
        assert contact_set(contacts.contacts_of_list(springs, jax.device_get(alone[1]))) == expected


FURTHER = {
    "bonds, heat and an exit": {
        "bonds": [{"gap": 1e-4, "normal_stiffness": 1e7, "shear_stiffness": 4e6, "damping": 0.2}],
        "heat": {
            "particle_heat_capacity": 500.0, "particle_temperature": 300.0, "friction": True,
            "particle_conductivity": 1e5, "true_young_modulus": 1e10,
        },
        "boundary": {"right": {"particles": "remove"}},
    },
    "bridges and energies": {
        "output": {"energy": True},
        "contact": {
            "young_modulus": 1e6, "friction": 0.4, "restitution": 0.6, "speed": 1.0,
            "cohesion": {
                "kind": "capillary", "surface_tension": 0.07, "contact_angle": 0.3, "liquid_content": 1e-4,
                "bridge_share": 0.03,
            },
        },
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", [pytest.param(kind, marks=COMBINATION) for kind in FURTHER])
def test_what_else_grains_of_wide_sizes_do(kind):
    both = Compared(jaxdem.load_scene(pack().tables() | FURTHER[kind]), 2)
    for _ in range(2):
        both.go_on(1)
        off, others, touching = both.difference()
        assert off < 1e-10 and not others and touching > 50
        if both.one[0].scalars is not None:
            own, found = both.one[0].scalars.grains, devices.gathered(both.divided, *both.slabs)[0].scalars.grains
            there = np.asarray(both.one[0].particles.active)
            np.testing.assert_allclose(found[there], np.asarray(own)[there], rtol=1e-12)
        both.again()
    if both.simulation.population is not None:
        assert np.sum(~np.asarray(both.one[0].particles.active)) > 5


def contact_set(kept):
    """Pairs and the first number that each keeps."""
    low, high = np.minimum(kept.first, kept.second), np.maximum(kept.first, kept.second)
    return set(zip(low.tolist(), high.tolist(), kept.values[0].tolist(), strict=True))


def few_wide():
    """Two large discs in small ones, 1 : 6, that drift over both borders of two slabs."""
    draw, size = np.random.default_rng(5), [0.2, 0.06]
    across, up = np.arange(28), np.arange(8)
    small = np.stack(np.meshgrid(size[0] * (across + 0.5) / 28, 0.0035 + 0.00705 * up, indexing="ij"), -1)
    large = np.array([[0.085, 0.03], [0.18, 0.03]])
    between = small.reshape(-1, 1, 2) - large
    between[..., 0] -= size[0] * np.round(between[..., 0] / size[0])
    small = small.reshape(-1, 2)[(np.linalg.norm(between, axis=-1) > 0.0195 + 0.0035).all(axis=1)]
    position = np.concatenate((large, small))
    radius = np.where(np.arange(len(position)) < 2, 0.0195, 0.0035)
    velocity = [0.95, 0.0] + 0.1 * draw.normal(size=position.shape)
    order = draw.permutation(len(position))
    rolling = {"rolling_friction": 0.1, "rolling_model": "epsd", "wall_friction": 0.0}
    return scene_of(size, position[order], radius[order], velocity[order], 1, **rolling)


@COMBINATION
def test_the_gradient_of_grains_of_wide_sizes_that_change_slabs():
    """Reverse mode through lists by levels, ghosts, and grains that go to the other slab with what their contacts keep:
    by every radius, by all constants of the contacts and by gravity."""
    scene, intervals = few_wide(), 6
    both = Compared(scene, 2)
    parameters = both.parameters

    def objective(simulation, numbers, state, neighbors):
        bodies, contact, gravity = numbers
        own = parameters._replace(bodies=bodies, contact=contact, gravity=gravity)
        end = jaxdem.rollout(simulation, own, state, neighbors, intervals)
        rows = end.state.particles
        there = jnp.ones(rows.position.shape[:-1], bool) if rows.active is None else rows.active
        value = jnp.sum(rows.velocity**2 + jnp.sin(30.0 * rows.position), axis=-1)
        value = value + 1e-4 * jnp.sum(rows.angular_velocity**2, axis=-1)
        return jnp.sum(jnp.where(there, value, 0.0)), end

    numbers = parameters.bodies, parameters.contact, parameters.gravity
    (expected, one), (found, two) = (
        jax.jit(jax.grad(lambda n, *given, s=s: objective(s, n, *given), has_aux=True))(numbers, *start)
        for s, start in ((both.simulation, both.one), (both.divided, both.slabs))
    )
    assert int(one.failures) == int(two.failures) == 0
    assert devices.counts(two.neighbors).migrations > 0 and two.neighbors.pairs.owned is not None
    for wanted, other in zip(*map(jax.tree.leaves, (expected, found)), strict=True):
        np.testing.assert_allclose(other, wanted, rtol=0, atol=1e-10 * max(np.abs(wanted).max(), 1e-12))
    bodies, contact, gravity = expected
    assert np.mean(np.asarray(bodies.radius) != 0.0) > 0.9 and np.all(np.asarray(gravity) != 0.0)
    assert float(contact.friction) != 0.0 and float(contact.rolling_friction) != 0.0


@COMBINATION
def test_wide_sizes_in_single_precision():
    """The same contacts; forces, velocities and spins within 40 roundings of the largest after an interval."""
    both = Compared(jaxdem.load_scene(pack().tables() | {"precision": "float32"}), 2)
    assert both.slabs[0].particles.position.dtype == np.float32
    for _ in range(3):
        both.go_on(1)
        off, others, touching = both.difference()
        assert off < 5e-6 and not others and touching > 300
        both.again()


@COMBINATION
def test_room_that_is_too_small_in_every_way_grows(monkeypatch):
    """Slots, pairs, rows of entries and columns of the tables, of which none is enough."""
    needed = distribution.needed_room

    def little(*given):
        found = needed(*given)
        listed, rows = found.listed, found.listed.rows
        rows = rows._replace(further=2, across=1)
        listed = dataclasses.replace(listed, slots=4, pairs=2 * listed.pairs // 3, cell=2, rows=rows)
        return dataclasses.replace(found, listed=listed, ghosts=3, migrating=1)

    monkeypatch.setattr(distribution, "needed_room", little)
    both = Compared(pack(), 4)
    assert np.all(both.slabs[1].overflow)
    both.go_on(1)
    off, others, touching = both.difference()
    assert off < 2e-12 and not others and touching > 300

"""Particles in slabs against one device: forces, contacts, room, what is sent. Walls that move are in test_meshes.py
and test_probes.py, the gradient in test_fluid.py, who comes and goes in test_random_scenes.py."""

import dataclasses
import functools
import re
import types

import jax
import numpy as np
import pytest

import jaxdem
from jaxdem import devices
from jaxdem.devices import particle_fields
from jaxdem.devices.mesh import SAME, SLABS, device_mesh, on_slabs
from jaxdem.errors import InputError
from jaxdem.failures import Failure, failures
from jaxdem.numerics.blocks import Blocks
from jaxdem.particles.ghosts import Division
from jaxdem.particles.integrate import ParticleState
from jaxdem.particles.migration import _balanced
from jaxdem.run.instant import Instant
from jaxdem.run.parts.liquid import Liquid
from jaxdem.run.placement import OneDevice, Slabs
from jaxdem.run.totals import Totals
from jaxdem.setup.builder import build_case
from tests.cases.slabs import apart
from tests.cases.tiers import COMBINATION, tiered

PARTS = ("contact_force", "velocity", "position", "angular_velocity")
PERIODIC = {name: {"kind": "periodic"} for name in ("left", "right", "bottom", "top")}


def scene_of(**changes):
    """A slow gas of grains of two sizes in 2-D."""
    across, up = np.meshgrid(0.012 + 0.024 * np.arange(8), 0.012 + 0.024 * np.arange(4), indexing="ij")
    count = across.size
    noise = np.random.default_rng(1).normal(size=(count, 2))
    tables = {
        "precision": "float64",
        "domain": {"size": [0.2, 0.1], "depth": 0.02},
        "particles": {
            "position": (np.stack((across, up), axis=-1).reshape(-1, 2) + 0.0008 * noise).tolist(),
            "radius": np.where(np.arange(count) % 3, 0.01, 0.008).tolist(),
            "density": 2500.0,
            "velocity": (0.3 * noise).tolist(),
        },
        "contact": {"young_modulus": 1e6, "friction": 0.4, "restitution": 0.6, "speed": 1.0, "skin": 0.2},
        "time": {"end": 0.05, "output_interval": 0.005},
    }
    return jaxdem.load_scene(tables | changes)


def drifting_pack():
    """Grains pressed together on a lattice that drifts through a box periodic on all sides, in 1,000 contact steps by
    most of its length and of its height."""
    across, up = np.meshgrid(0.0097 + 0.0194 * np.arange(10), 0.0097 + 0.0194 * np.arange(5), indexing="ij")
    position = np.stack((across, up), axis=-1).reshape(-1, 2)
    noise = np.random.default_rng(1).normal(size=position.shape)
    return scene_of(
        domain={"size": [0.194, 0.097], "depth": 0.02, "gravity": [0.0, 0.0]},
        particles={
            "position": position.tolist(),
            "radius": 0.01,
            "density": 2500.0,
            "velocity": ([0.6, 0.4] + 0.01 * noise).tolist(),
        },
        contact={
            "young_modulus": 1e6, "friction": 0.4, "restitution": 0.6, "speed": 1.0, "skin": 0.2,
            "rolling_friction": 0.1, "rolling_model": "epsd",
        },
        boundary=PERIODIC,
    )  # fmt: skip


def pair_of(scene, number):
    """Simulations, parameters and states on one device and in slabs."""
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    divided, _ = jaxdem.build(scene, devices=number)
    slabs = devices.distributed(divided, parameters, state, neighbors)
    return simulation, divided, parameters, (state, neighbors), slabs


@functools.cache
def stepping(simulation):
    """The step of a simulation; equal ones share a program."""
    return jax.jit(simulation.step)


def run(simulation, parameters, state, neighbors, steps):
    """After so many intervals."""
    step = stepping(simulation)
    for _ in range(steps):
        state, neighbors, report = step(parameters, state, neighbors)
        assert int(failures(simulation, report)) == 0
    return state, neighbors, report


def touching(contacts):
    """The pairs that keep something, by identity."""
    low, high = np.minimum(contacts.first, contacts.second), np.maximum(contacts.first, contacts.second)
    return set(zip(low.tolist(), high.tolist(), strict=True))


@pytest.mark.parametrize("number", tiered([1, 4], first=[4]))
def test_a_pack_that_drifts_through_slabs_and_periodic_sides_keeps_its_contacts(number):
    """Two slabs, each on both sides of the other, are in test_clumps.py and, of spheres, in test_random_scenes.py."""
    simulation, divided, parameters, one, slabs = pair_of(drifting_pack(), number)
    steps = -(-1000 // simulation.steps.contacts_per_interval)
    state, neighbors, report = run(simulation, parameters, *one, steps)
    distributed, lists, same = run(divided, parameters, *slabs, steps)
    # XLA gives everything back as the same everywhere where there is one slab.
    assert stepping(divided)._cache_size() == 1 or number == 1, "what slabs begin from and what a step gives lie alike"
    whole, contacts = devices.gathered(divided, distributed, lists)
    own = devices.contacts.contacts_of_list(state.particles.contact_spring, jax.device_get(neighbors))
    assert touching(contacts) == touching(own)
    assert len(touching(own)) > 50
    # The forces on a grain cancel nearly: the largest is that of a contact, by Hertz's law.
    force = 4.0 / 3.0 * (1e6 / (2.0 * (1.0 - 0.3**2))) * np.sqrt(0.005) * 0.0006**1.5
    found = {n: np.abs(getattr(state.particles, n) - getattr(whole.particles, n)).max() for n in PARTS}
    assert found["contact_force"] < 1e-12 * force
    assert found["velocity"] < 1e-12
    assert found["position"] < 1e-12
    means = same.particles.collision_force, report.particles.collision_force
    np.testing.assert_allclose(*means, rtol=0, atol=1e-12 * force)
    momenta = [np.sum(np.asarray(p.velocity), axis=0) for p in (state.particles, whole.particles)]
    np.testing.assert_allclose(*momenta, rtol=1e-13)
    figures = devices.counts(lists)
    assert figures.particles.sum() == 50
    if number > 1:
        assert figures.migrations > 4 and both_copies(distributed.particles, lists) > 5


def both_copies(particles, lists):
    """How many contacts two slabs keep, with the same springs bit for bit."""
    particles, lists = jax.device_get((particles, lists))
    identity = lists.ghosts.identity
    given = identity, lists.pairs.first, lists.pairs.second
    kept = devices.contacts.contacts_of_rows(particles.contact_spring, np.ones(identity.shape[1], bool), *given)
    number = np.array([kept.first, kept.second])
    order = np.lexsort(number)
    same = np.all(np.diff(number[:, order], axis=1) == 0, axis=0)
    one, other = kept.values[:, order[:-1][same]], kept.values[:, order[1:][same]]
    np.testing.assert_array_equal(one, other)
    return int(same.sum())


def test_the_cut_planes_move_until_the_slabs_have_equal_numbers():
    """Most grains are in the first of four slabs: by 8 a time, as far as one message takes, half of 16."""
    draw = np.random.default_rng(3)
    place = np.sort(np.concatenate((draw.uniform(0.0, 0.25, 100), draw.uniform(0.25, 1.0, 28))))
    division = Division(Blocks(4, 0, False), 1.0, 0.0, True)
    search, mesh = types.SimpleNamespace(body_reach=0.01), device_mesh(4)

    def of_slab(planes, away, active, numbers):
        return _balanced(division, search, planes, away, active, numbers, 16)

    moved = jax.jit(on_slabs(mesh, of_slab, (SAME, SLABS, SLABS, SAME), SAME))
    planes, fullest = np.array([0.25, 0.5, 0.75]), []
    while len(fullest) < 12:
        slab = np.searchsorted(planes, place, side="right")
        ends = np.array([0.0, *planes, 1.0])
        active = slab == np.arange(4)[:, None]
        away = place - 0.5 * (ends[:-1] + ends[1:])[:, None]
        numbers = np.bincount(slab, minlength=4)
        assert not fullest or max(numbers.max(), 32) >= fullest[-1] - 8
        fullest.append(int(numbers.max()))
        planes = np.asarray(moved(planes, away, active, numbers.astype(np.int32)))
    assert fullest[0] == 100 and fullest[-1] == 32


@COMBINATION
def test_liquid_bridges_across_a_border():
    """Bridges form and rupture between grains of both slabs: films and forces are those of one device, and no liquid is
    lost."""
    bridges = {
        "kind": "capillary", "surface_tension": 0.07, "liquid_content": 0.02, "liquid_viscosity": 1e-3,
        "minimum_gap": 1e-5,
    }  # fmt: skip
    contact = scene_of().tables()["contact"] | {"cohesion": bridges}
    simulation, divided, parameters, one, slabs = pair_of(scene_of(contact=contact), 2)
    first = float(np.sum(one[0].particles.liquid))
    state, neighbors, _ = run(simulation, parameters, *one, 12)
    distributed, lists, _ = run(divided, parameters, *slabs, 12)
    whole, contacts = devices.gathered(divided, distributed, lists)
    for name in (*PARTS, "liquid", "wall_spring"):
        pairs = (jax.tree.leaves(getattr(s.particles, name)) for s in (state, whole))
        for x, y in zip(*pairs, strict=True):
            assert apart(x, y) < 1e-11, name
    slab = devices.rooms.slab_of(devices.counts(lists).planes, np.asarray(whole.particles.position[:, 0]))
    bridge = contacts.values[-1] > 0.0
    assert np.any(slab[contacts.first[bridge]] != slab[contacts.second[bridge]]), "a bridge across the border"
    held = sum(float(np.sum(x)) for x in (whole.particles.liquid, contacts.values[-1], whole.particles.wall_spring[-1]))
    assert abs(held - first) < 1e-13 * first
    case = build_case(scene_of(contact=contact))
    told = []
    for placement, given in ((OneDevice(case), (state, neighbors)), (Slabs(case, divided), (distributed, lists))):
        instant = placement.whole(Instant(0.0, *given, None))
        told.append(Liquid().summary(case, instant, Totals())["liquid"])
    assert told[0]["bridges_between_particles"] > 0.0 and abs(told[1]["missing_relative"]) < 1e-12
    assert told[0] == pytest.approx(told[1], rel=1e-9, abs=1e-12), "the summary counts the bridges of all slabs"


def test_every_field_of_the_particles_has_its_rule():
    """A field that is added must be cut into slabs, or be the same in all."""
    by_hand = {
        "contact_spring", "active", "identity", "inserted", "pistons", "mesh_memory", "mesh_wear", "bonds", "coming",
    }  # fmt: skip
    rules = [set(particle_fields.AXIS_OF_PARTICLES), by_hand]
    assert set().union(*rules) == set(ParticleState._fields)
    assert sum(map(len, rules)) == len(ParticleState._fields)


def test_too_little_room_is_told_and_the_step_repeated_with_more(monkeypatch):
    """All grains fall to one end, whose slab has no rows for them while the cut planes stand still; until it has got
    more. Every room is a program."""
    monkeypatch.setattr("jaxdem.devices.rooms.LEAST", 1)
    stiff = {"young_modulus": 1e7, "friction": 0.4, "restitution": 0.6, "speed": 4.0, "skin": 0.2}
    scene = scene_of(domain={"size": [0.2, 0.1], "depth": 0.02, "gravity": [-40.0, 0.0]}, contact=stiff)
    simulation, divided, parameters, one, (state, lists) = pair_of(scene, 2)
    division = dataclasses.replace(divided.division, balanced=False)
    divided = dataclasses.replace(divided, contact=dataclasses.replace(divided.contact, division=division))
    room, repeated, intervals = devices.SlabRoom.of(lists), 0, 0
    step = functools.partial(stepping(divided), parameters)
    while devices.SlabRoom.of(lists).rows == room.rows:
        assert intervals < 16
        new = step(state, lists)
        while int(failures(divided, new[2])) & Failure.OVERFLOW:
            state, lists = devices.enlarged(divided, parameters, state, lists, new[1])
            new, repeated = step(state, lists), repeated + 1
        (state, lists, _), intervals = new, intervals + 1
    assert repeated > 0
    assert devices.SlabRoom.of(lists).rows > room.rows
    assert devices.counts(lists).particles.sum() == 32
    whole, _ = devices.gathered(divided, state, lists)
    state, _, _ = run(simulation, parameters, *one, intervals)
    assert apart(state.particles.position, whole.particles.position) < 1e-9


def test_only_neighbours_are_sent_arrays_and_nothing_is_gathered():
    """In the compiled step there is no all-gather, and what all devices add is no longer than their number."""
    _, divided, parameters, _, slabs = pair_of(drifting_pack(), 4)
    program = stepping(divided).lower(parameters, *slabs).compile().as_text()
    assert "collective-permute" in program
    assert not re.search(r"all-gather|all-to-all|reduce-scatter", program)
    reduced = re.findall(r"= \(?([a-z0-9]+)\[([0-9,]*)\][^=]* all-reduce", program)
    assert reduced
    for _, shape in reduced:
        assert np.prod([int(n) for n in shape.split(",") if n], dtype=int) <= 5


def test_one_device_has_a_program_without_any_of_this():
    scene = drifting_pack()
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    text = stepping(simulation).lower(parameters, state, neighbors).as_text()
    assert not re.search("collective|all_reduce|all_gather|shard|manual", text)


def test_a_box_too_short_for_so_many_slabs_is_refused():
    with pytest.raises(InputError, match="the box cannot be cut into 4 slabs"):
        jaxdem.build(scene_of(domain={"size": [0.18, 0.1], "depth": 0.02}), devices=4)
    with pytest.raises(InputError, match="JAX sees 4 devices"):
        jaxdem.build(scene_of(), devices=5)


def test_a_list_of_jax_md_is_refused():
    scene = scene_of()
    divided, _ = jaxdem.build(scene, devices=2)
    state, _ = build_case(scene).first_state()
    with pytest.raises(InputError, match="simulation = 'on several devices'"):
        jaxdem.neighbors_from_jax_md(divided, state, None, None)

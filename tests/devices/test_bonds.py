"""Bonds on several devices, against one device: plates that drift over borders, turn, collide, break and leave."""

import re
import shutil

import jax
import numpy as np
import pytest

import jaxdem
from jaxdem import devices
from jaxdem.devices.bonds import require_in_reach
from jaxdem.errors import InputError
from jaxdem.particles.bond_state import INTACT
from jaxdem.setup.builder import build_case
from tests.cases.slabs import apart
from tests.cases.tiers import COMBINATION, tiered
from tests.devices.test_meshes import stepped

RADIUS = 5e-3
SPACING = 2.02 * RADIUS
BOND = {"gap": 0.05 * RADIUS, "normal_stiffness": 1e9, "shear_stiffness": 4e8, "damping": 0.2}
WEAK = BOND | {"tensile_strength": 1.2e4, "shear_strength": 2e4}


def block(columns, *layers):
    """Places of a lattice of grains, counted along each axis."""
    counts = np.meshgrid(*(np.arange(n) for n in (columns, *layers)), indexing="ij")
    return SPACING * np.stack(counts, axis=-1).reshape(-1, 1 + len(layers)).astype(float)


def turning(places, velocity, spin):
    """Velocities of a body that moves and turns in the plane of its first and last axis."""
    arm = places - places.mean(axis=0)
    found = np.broadcast_to(velocity, places.shape).copy()
    found[:, 0] -= spin * arm[:, -1]
    found[:, -1] += spin * arm[:, 0]
    return found


def tables_of_plates(dimension=2, bond=WEAK, **changes):
    """Two plates that fly at each other through a box periodic along x; one turns."""
    layers = (4,) if dimension == 2 else (2, 3)
    low, high = [0.01] * (dimension - 1), [0.012, 0.016][: dimension - 1]
    one = block(6, *layers) + [0.045, *low]
    other = block(4, *layers) + [0.13, *high]
    rest = [0.0] * (dimension - 1)
    velocity = np.concatenate((turning(one, [1.5, *rest], 8.0), turning(other, [-1.0, *rest], 0.0)))
    spin = np.zeros((len(velocity), 1 if dimension == 2 else 3))
    spin[: len(one), 0 if dimension == 2 else 1] = 8.0 if dimension == 2 else -8.0
    return {
        "precision": "float64",
        "domain": {"size": [0.2, *[0.06] * (dimension - 1)], "depth": 0.01} if dimension == 2 else
        {"size": [0.2, 0.04, 0.06]},
        "particles": {
            "radius": RADIUS, "density": 2500.0, "position": np.concatenate((one, other)).tolist(),
            "velocity": velocity.tolist(), "angular_velocity": spin.tolist(),
        },
        "contact": {"young_modulus": 5e6, "friction": 0.3, "restitution": 0.6, "speed": 3.0, "skin": 0.2},
        "boundary": {"left": {"kind": "periodic"}, "right": {"kind": "periodic"}},
        "bonds": [bond],
        "heat": {"particle_heat_capacity": 500.0, "particle_temperature": 300.0, "friction": True,
                 "particle_conductivity": 1e5, "true_young_modulus": 1e10},
        "output": {"energy": True},
        "time": {"end": 0.06, "output_interval": 0.03},
    } | changes  # fmt: skip


def tables_of_all():
    """The other plate rises and leaves through the top, and grains come in."""
    tables = tables_of_plates()
    tables["boundary"] |= {"top": {"particles": "remove"}}
    tables["particles"]["velocity"] = [[x, z if x > 0.0 else 1.2] for x, z in tables["particles"]["velocity"]]
    tables["particles"]["inlet"] = [
        {"start": [0.0, 0.02], "stop": [0.04, 0.05], "rate": 150.0, "velocity": [0.3, -0.5], "temperature": 320.0,
         "total": 4}
    ]  # fmt: skip
    return tables


HALF = {"time": {"end": 0.03, "output_interval": 0.03}}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The run on one device."""
    return jaxdem.simulate(jaxdem.load_scene(tables_of_all()), tmp_path_factory.mktemp("whole") / "run")


@pytest.fixture(scope="module")
def halves(tmp_path_factory):
    """Its first half, on one device and on two."""
    out, scene = tmp_path_factory.mktemp("halves"), jaxdem.load_scene(tables_of_all() | HALF)
    return [jaxdem.simulate(scene, out / str(number), devices=number) for number in (1, 2)]


@pytest.mark.parametrize("number", tiered([1, 2], first=[1]))
def test_plates_that_break_are_those_of_one_device(whole, halves, number, tmp_path):
    """On two devices up to the middle, and resumed on one or two: the same bonds have broken or gone with a grain, also
    those of which both have gone, the others carry the same loads, and the balance of energy is the same."""
    assert halves[1].summary["devices"]["migrations"] > 2
    shutil.copytree(halves[1].path, tmp_path / "run")
    scene = jaxdem.load_scene(tables_of_all())
    one, other = whole, jaxdem.simulate(scene, tmp_path / "run", devices=number, resume=True)
    told, same = one.summary["bonds"], other.summary["bonds"]
    assert 0 < told["intact"] < told["made"] - 3 and told["left"] > 3
    assert {name: told[name] for name in told if name != "energy"} == {n: same[n] for n in same if n != "energy"}
    for index in range(3):
        expected, found = one.bonds(index), other.bonds(index)
        for name in ("first", "second", "table", "status"):
            np.testing.assert_array_equal(found[name], expected[name], err_msg=name)
        there = one.particles(index)["active"] == 1
        both = there[expected["first"]] & there[expected["second"]]
        ends = np.repeat(both, 2)
        assert apart(expected["position"][ends], found["position"][ends]) < 1e-9
        for name in ("normal_force", "shear_force", "bending_moment", "bond_energy"):
            assert apart(expected[name], found[name]) < 1e-9, name
    neither = ~there[expected["first"]] & ~there[expected["second"]]
    assert neither.sum() > 3 and len(np.unique(expected["status"][neither])) > 1
    for name in ("position", "velocity", "angular_velocity", "contact_force", "temperature"):
        assert apart(one.particles(-1)[name][there], other.particles(-1)[name][there]) < 1e-9, name
    heat, same_heat = (run.summary["heat"]["from_friction"] for run in (one, other))
    assert abs(same_heat - heat) < 1e-9 * heat
    energy, balance = one.summary["energy"], other.summary["energy"]
    scale = sum(energy["start"].values())
    for group in ("start", "end", "dissipated"):
        for name, value in energy[group].items():
            assert abs(balance[group][name] - value) < 1e-9 * scale, (group, name)
    assert abs(balance["missing"]) < 1e-11 * scale
    assert energy["dissipated"]["breaking"] > 1e-4 * scale and energy["dissipated"]["bond_damping"] > 1e-3 * scale


def test_a_run_begins_from_one_in_slabs(halves):
    """The bonds of a run on one device that begins from another, and how its grains are turned."""
    states = []
    for run in halves:
        tables = tables_of_all() | {"start": {"from": str(run.path)}, "time": {"end": 0.04, "output_interval": 0.01}}
        states.append(build_case(jaxdem.load_scene(tables)).unsettled_state()[0].particles)
    there = np.asarray(states[0].active)
    one, other = (
        s.bonds._replace(orientation=tuple(np.asarray(q)[there] for q in s.bonds.orientation)) for s in states
    )
    assert np.any(np.asarray(one.status[:-1]) != INTACT) and np.any(np.asarray(one.status) == INTACT)
    for expected, found in zip(*map(jax.tree.leaves, (one, other)), strict=True):
        assert np.abs(np.asarray(found) - np.asarray(expected)).max() < 1e-9
    np.testing.assert_array_equal(one.pairs.entry, other.pairs.entry)


def cold(tables):
    """The same without temperatures and balance of energy."""
    return {name: table for name, table in tables.items() if name not in ("heat", "output")}


def cut(scene, number):
    """Simulations and states on one device and in slabs; the bonds come back from these bit for bit."""
    simulation, parameters = jaxdem.build(scene)
    start = jaxdem.initial_state(scene, simulation, parameters)
    divided, _ = jaxdem.build(scene, devices=number)
    slabs = devices.distributed(divided, parameters, *start)
    again, _ = devices.on_one_device(divided, parameters, *devices.gathered(divided, *slabs))
    for one, other in zip(*(jax.tree.leaves(s.particles.bonds) for s in (start[0], again)), strict=True):
        np.testing.assert_array_equal(one, other)
    return simulation, divided, parameters, start, slabs


@COMBINATION
def test_bonds_in_single_precision_come_back():
    """The trailing parts too."""
    _, _, _, (state, _), _ = cut(jaxdem.load_scene(cold(tables_of_plates(precision="float32"))), 2)
    assert np.any(np.asarray(state.particles.bonds.separation_low[0]) != 0.0)


@COMBINATION
def test_plates_in_space_on_four_devices():
    """Bonds that hold, of plates that go over all borders."""
    scene = jaxdem.load_scene(cold(tables_of_plates(3, BOND)))
    simulation, divided, parameters, start, slabs = cut(scene, 4)
    state, _ = stepped(simulation, parameters, *start, 6)
    whole, _ = devices.gathered(divided, *stepped(divided, parameters, *slabs, 6))
    assert np.all(whole.particles.bonds.status[:-1] == INTACT)
    for name in ("position", "velocity", "angular_velocity", "bonds"):
        pairs = (jax.tree.leaves(getattr(s.particles, name)) for s in (state, whole))
        for x, y in zip(*pairs, strict=True):
            assert apart(x, y) < 1e-11, name


def always_sent(program):
    """Messages that a program sends whatever happens, and not in a branch or a loop."""
    parts = [getattr(part, "jaxpr", part) for one in program.eqns if one.primitive.name not in ("cond", "while")
             for part in one.params.values()]  # fmt: skip
    own = sum(one.primitive.name == "ppermute" for one in program.eqns)
    return own + sum(always_sent(part) for part in parts if hasattr(part, "eqns"))


def test_no_message_of_its_own_tells_which_grains_have_left():
    """Nothing is sent in an interval outside of its contact steps, as long as nobody leaves, comes or changes slabs."""
    tables = cold(tables_of_all())
    del tables["particles"]["inlet"][0]["temperature"]
    scene = jaxdem.load_scene(tables)
    divided, parameters = jaxdem.build(scene, devices=2)
    start = jaxdem.initial_state(scene, divided, parameters)
    assert start[0].particles.bonds.record.status is not None
    assert always_sent(jax.make_jaxpr(divided.step)(parameters, *start).jaxpr) == 0


def test_what_slabs_would_lose_is_refused(tmp_path):
    """Bonds longer than the neighbour list reaches, before there is a folder. The value is that of the key, and the one
    that the remedy names will do."""
    contact = {"young_modulus": 5e6, "speed": 3.0, "skin": 0.05}
    with pytest.raises(InputError, match="longest bond of 0.0101 m") as caught:
        jaxdem.simulate(jaxdem.load_scene(tables_of_plates(contact=contact)), tmp_path / "run", devices=2)
    assert caught.value.key == "contact.skin" and caught.value.value == 0.05
    assert not (tmp_path / "run").exists()
    wanted = float(re.search(r"set it to ([0-9.]+) or more", caught.value.remedy)[1])
    assert 0.0 < wanted - (1.1 * SPACING / (2.0 * RADIUS) - 1.0) < 1.001e-3
    scene = jaxdem.load_scene(tables_of_plates(contact=contact | {"skin": wanted}))
    simulation, parameters = jaxdem.build(scene)
    bonds = jaxdem.initial_state(scene, simulation, parameters)[0].particles.bonds
    require_in_reach(simulation.search, parameters.bodies, bonds)

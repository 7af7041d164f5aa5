"""Walls that are meshes on several devices, against one device: one that moves and wears, and one held by a force. In
space, and in a gradient, they are beside clumps: test_clumps.py."""

import jax
import numpy as np
import pytest

import jaxdem
from jaxdem import devices
from jaxdem.devices.contacts import contacts_of_list
from jaxdem.failures import Failure, failures
from jaxdem.particles.energy import EnergyFlow
from jaxdem.run.instant import Instant
from jaxdem.run.parts.liquid import Liquid
from jaxdem.run.placement import OneDevice, Slabs
from jaxdem.run.totals import Totals
from jaxdem.setup.builder import build_case
from tests.cases.slabs import apart
from tests.devices.test_particles import PARTS, scene_of

ARCHARD = {"model": "archard", "coefficient": 1e-3, "hardness": 1e9}
BRIDGES = {"kind": "capillary", "surface_tension": 0.07, "liquid_content": 0.02, "liquid_viscosity": 1e-3,
           "minimum_gap": 1e-5}  # fmt: skip


def bowl():
    """Wet grains that fly to the right over the edges of a floor that shakes, under a lid on which all of them press,
    against a plane that shakes."""
    floor = {
        "kind": "mesh", "points": [[-0.05, 0.03], [0.05, 0.004], [0.1, 0.02], [0.15, 0.004], [0.25, 0.03]],
        "motion": [{"kind": "oscillation", "direction": [1.0, 0.3], "amplitude": 0.004, "frequency": 20.0}],
        "wear": ARCHARD,
    }  # fmt: skip
    lid = {
        "kind": "mesh", "points": [[0.25, 0.115], [-0.05, 0.115]],
        "piston": {"direction": [0.0, -1.0], "force": 5.0, "mass": 1.0, "damping": 1.0},
    }  # fmt: skip
    end = {
        "kind": "plane", "point": [0.196, 0.0], "normal": [-1.0, 0.0],
        "motion": [{"kind": "oscillation", "direction": [1.0, 0.0], "amplitude": 0.002, "frequency": 30.0}],
    }  # fmt: skip
    particles = scene_of().tables()["particles"]
    particles["position"] = (np.asarray(particles["position"]) * [1.0, 0.9] + [0.0, 0.021]).tolist()
    particles["velocity"] = (np.asarray(particles["velocity"]) + [0.8, 0.0]).tolist()
    size = {"size": [0.2, 0.13], "depth": 0.02}
    contact = scene_of().tables()["contact"] | {"cohesion": BRIDGES}
    walls = [floor, lid, end]
    return scene_of(domain=size, walls=walls, particles=particles, contact=contact, output={"energy": True})


def compiled(simulation, *given):
    """The program of an interval, in which nothing is gathered."""
    program = jax.jit(simulation.step).lower(*given).compile()
    assert "all-gather" not in program.as_text()
    return program


def stepped(simulation, parameters, state, neighbors, count, flows=None):
    """After so many intervals, with more room where it is needed; `flows` gets their balances of energy."""
    program = compiled(simulation, parameters, state, neighbors)
    for _ in range(count):
        new = program(parameters, state, neighbors)
        if int(failures(simulation, new[2])) & Failure.OVERFLOW:
            state, neighbors = devices.enlarged(simulation, parameters, state, neighbors, new[1])
            program = compiled(simulation, parameters, state, neighbors)
            new = program(parameters, state, neighbors)
        state, neighbors, report = new
        assert int(failures(simulation, report)) == 0
        if flows is not None:
            flows.append(np.asarray(report.particles.energy))
    return state, neighbors


def require_same_memory(one, other):
    """What contacts with meshes keep, by grain."""
    assert len(one.meshes) == len(other.meshes) > 0
    for expected, found in zip(one.meshes, other.meshes, strict=True):
        for x, y in zip(jax.tree.leaves(expected), jax.tree.leaves(found), strict=True):
            assert np.abs(x - y).max() <= 1e-10 * np.abs(x).max()
        assert np.any(np.asarray(expected.spring) != 0.0)


def test_grains_on_meshes_that_move(intervals=14):
    case = build_case(bowl())
    simulation, parameters = case.simulation, case.parameters
    divided, _ = jaxdem.build(bowl(), devices=2)
    start = case.initial_state()
    slabs, lists = devices.distributed(divided, parameters, *start)
    flows = [], []
    state, neighbors = stepped(simulation, parameters, *start, intervals, flows[0])
    slabs, lists = stepped(divided, parameters, slabs, lists, intervals, flows[1])
    assert devices.counts(lists).migrations > 0
    assert apart(*flows) < 1e-10
    assert np.sum(flows[0], axis=0)[EnergyFlow._fields.index("walls")] != 0.0
    whole, kept = devices.gathered(divided, slabs, lists)
    for name in (*PARTS, "pistons", "mesh_wear", "liquid"):
        pairs = (jax.tree.leaves(getattr(s.particles, name)) for s in (state, whole))
        for x, y in zip(*pairs, strict=True):
            assert apart(x, y) < 1e-10, name
    own = contacts_of_list(state.particles.contact_spring, jax.device_get(neighbors), state.particles.mesh_memory)
    require_same_memory(own, kept)
    back, listed = devices.on_one_device(divided, parameters, whole, kept)
    again = contacts_of_list(back.particles.contact_spring, jax.device_get(listed), back.particles.mesh_memory)
    require_same_memory(own, again)

    told = []
    for placement, given in ((OneDevice(case), (state, neighbors)), (Slabs(case, divided), (slabs, lists))):
        instant = placement.whole(Instant(0.0, *given, None))
        told.append(Liquid().summary(case, instant, Totals())["liquid"])
    assert told[0]["bridges_to_walls"] > 0.0 and abs(told[1]["missing_relative"]) < 1e-12
    assert told[0] == pytest.approx(told[1], rel=1e-9, abs=1e-12)

    # A checkpoint gives back the same bits.
    place = Slabs(case, divided)
    saved = place.saved(slabs, lists, {})
    restored = place.restored(case.unsettled_state()[0], dict(saved.same), saved.attributes)[:2]
    for x, y in zip(jax.tree.leaves((slabs, lists)), jax.tree.leaves(restored), strict=True):
        np.testing.assert_array_equal(x, y)

"""Meshes that come and vanish: gates, lids, and what they must not come upon."""

from __future__ import annotations

import dataclasses
import re

import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.errors import InputError
from jaxdem.failures import Failure
from jaxdem.run.diagnosis import diagnosis
from jaxdem.setup.start import with_mesh_memory
from tests.particles.test_walls_in_time import (
    AFTER,
    INTERVAL,
    OPENED,
    SLOPE,
    assert_same_bits,
    run,
    start_of,
    stepped,
    tables,
)

COMES = 0.01
SPEED = -0.1


def gate(at=0.09):
    """Tables of a line across the way of the grains, at rest or with a motion, which comes and vanishes.

    It comes at `at` [m]; its keys have it where it would have been at time 0.
    """
    line = {"kind": "mesh", "points": [[at - COMES * SPEED, z] for z in (-0.1, 0.5)]}
    return line | {"motion": [{"kind": "translation", "velocity": [SPEED, 0.0]}]}


def timed(at=0.09):
    """The scene, its simulation and its start."""
    return start_of(tables(SLOPE, gate(at) | {"begin": COMES, "end": OPENED}))


def without_mesh(state, neighbors):
    """State and list where the mesh has been taken away by hand."""
    particles = state.particles._replace(mesh_memory=())
    return state._replace(particles=particles), dataclasses.replace(neighbors, meshes=())


def compare_bits():
    """A mesh that vanishes is one taken away by hand, for the programs that users have, in a process of its own: see
    `test_walls_in_time`."""
    simulation, parameters, *start = timed()
    held = run(simulation, parameters, *start, round(OPENED / INTERVAL))
    whole, _ = run(simulation, parameters, *held, AFTER)
    bare, numbers, *_ = start_of(tables(SLOPE))
    by_hand, _ = run(bare, numbers, *without_mesh(*held), AFTER)
    assert_same_bits(whole.particles._replace(mesh_memory=()), by_hand.particles)


def test_a_mesh_that_comes_and_vanishes_is_one_put_there_and_taken_away_by_hand():
    """Before and after the grains pass; it comes where its motion has it by then, and not where its keys are."""
    simulation, parameters, *start = timed()
    first, then = round(COMES / INTERVAL), round((OPENED - COMES) / INTERVAL)
    comes = run(simulation, parameters, *start, first)
    held = run(simulation, parameters, *comes, then)
    whole, _ = run(simulation, parameters, *held, 8)
    bare, numbers, *clear = start_of(tables(SLOPE))
    free = run(bare, numbers, *clear, first)
    np.testing.assert_allclose(comes[0].particles.position, free[0].particles.position, rtol=0.0, atol=1e-12)
    always, own, *_ = start_of(tables(SLOPE, gate()))
    room = always.room(own, free[0].particles)
    put = free[0]._replace(particles=with_mesh_memory(free[0].particles, always.contact, room))
    with_gate = run(always, own, put, always.allocate(own, put.particles, room), then)
    np.testing.assert_allclose(held[0].particles.position, with_gate[0].particles.position, rtol=0.0, atol=1e-10)
    assert np.abs(np.asarray(with_gate[0].particles.mesh_memory[0].spring[0])).max() > 0.0, "a grain leans on it"
    assert not any(np.asarray(part).any() for part in whole.particles.mesh_memory[0].spring), "that is gone with it"
    opened, _ = run(bare, numbers, *without_mesh(*with_gate), 8)
    np.testing.assert_allclose(whole.particles.position, opened.particles.position, rtol=0.0, atol=1e-10)
    passed, _ = run(bare, numbers, *free, then)
    assert np.abs(np.asarray(passed.particles.position - held[0].particles.position)).max() > 5e-3


def test_a_mesh_that_comes_into_grains_stops_the_run():
    """It names the grain; where the keys of the mesh are, a grain may be."""
    simulation, parameters, *start = timed(at=0.105)
    before = run(simulation, parameters, *start, round(COMES / INTERVAL))
    reached, _, code = stepped(simulation, parameters, *before)
    assert int(code) & int(Failure.WALL_COMES)
    reason, where, remedy = diagnosis(simulation, parameters, int(Failure.WALL_COMES), before[0], reached)
    assert reason.startswith("a wall comes where particles are") and "begin" in remedy
    assert "particle 0, last at (0.105, 0.0665" in where and "wall that comes at 0.01 s: mesh 0" in where


def test_a_mesh_with_a_solid_behind_it_is_there_from_the_start():
    with pytest.raises(InputError, match=re.escape("walls.0.begin")) as caught:
        start_of(tables(gate() | {"begin": COMES, "touch": "front"}))
    assert 'touch = "both"' in str(caught.value)


def test_a_list_with_more_room_has_the_mesh_where_it_is():
    """What contacts keep stays with them when the list grows, though the keys of the mesh have it elsewhere."""
    simulation, parameters, state, _ = timed(at=0.315)
    particles, step = state.particles, jnp.int32(round(2.0 / INTERVAL))  # by 0.2 m
    placed = simulation.placed(parameters, particles, step)
    room = simulation.room(parameters, particles)
    listed = simulation.allocate(parameters, particles, room, placed)
    row = np.asarray(listed.meshes[0].row)
    assert 0 in row and not (np.asarray(simulation.allocate(parameters, particles, room).meshes[0].row) < 4).any()
    particles = with_mesh_memory(particles, simulation.contact, room)
    own = jnp.broadcast_to(1.0 + row, particles.mesh_memory[0].spring[0].shape)
    memory = particles.mesh_memory[0]._replace(spring=(own,) * len(particles.mesh_memory[0].spring))
    before = state._replace(particles=particles._replace(mesh_memory=(memory,)))
    after, wider = simulation.with_room(before, listed, room.enlarged())
    assert wider.room == room.enlarged() and set(np.asarray(wider.meshes[0].row)) == set(row)
    kept = np.asarray(after.particles.mesh_memory[0].spring[0][0])
    there = np.asarray(wider.meshes[0].row) < 4
    np.testing.assert_array_equal(kept[there], 1.0 + np.asarray(wider.meshes[0].row)[there])

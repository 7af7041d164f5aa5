"""The solid fraction of three cells along every axis, which a closure may ask for."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import Mesh, PartitionSpec

import jaxdem
from jaxdem.closures import EnsembleClosure, InvariantClosure, WenYu
from jaxdem.closures.invariant import WIDE
from jaxdem.coupling.interpolation import interpolate
from jaxdem.fluid.grid import Grid, mean_over_three
from jaxdem.numerics.blocks import MESH_AXIS, Blocks

CELLS, CELL = (6, 4), 4e-3
CLOSURE = InvariantClosure.initial(WenYu(), (2,), features=("solid_fraction", WIDE))


def over_three(field, modes):
    """The mean over three cells along every axis by NumPy; `modes` of `np.pad`, one for each axis."""
    for axis, mode in enumerate(modes):
        wide = np.pad(field, [(1, 1) if k == axis else (0, 0) for k in range(field.ndim)], mode)
        field = sum(np.take(wide, np.arange(n, n + field.shape[axis]), axis) for n in range(3)) / 3.0
    return field


def sampled(closure, floor=0.0, **coupling):
    """Grains at random places beside walls below and above, and the fluid at them; above a floor in the mesh [m]."""
    size = [n * CELL for n in CELLS]
    places = np.random.default_rng(0).uniform(0.05, 0.95, (30, 2)) * [size[0], size[1] - floor] + [0.0, floor]
    plane = {"kind": "plane", "point": [0.0, floor], "normal": [0.0, 1.0], "fluid": "free_slip"}
    scene = jaxdem.load_scene(
        {
            "precision": "float64",
            "domain": {"size": size, "depth": 1e-3},
            "particles": {"radius": 1e-4, "density": 2500.0, "position": places.tolist()},
            "contact": {"young_modulus": 1e6, "speed": 1.0},
            "boundary": {"left": {"kind": "periodic"}},
            "fluid": {"cells": list(CELLS), "density": 1.0, "viscosity": 1e-5},
            "coupling": {"interval": 1e-3, "kernel_width": {"diameters": 3.0, "cells": 0.5}} | coupling,
            "time": {"end": 1e-3, "output_interval": 1e-3},
            "walls": [plane] * (floor > 0.0),
        }
    )
    simulation, parameters = jaxdem.build(scene, closure=closure)
    state, _ = jaxdem.initial_state(scene, simulation, parameters)
    return jax.jit(simulation.coupling.sample)(parameters.mixture, state.fluid, state.particles)


@pytest.mark.parametrize("ensemble", [False, True])
def test_a_closure_that_asks_sees_the_mean_over_three_cells(ensemble):
    found = sampled(EnsembleClosure.of([CLOSURE] * 2) if ensemble else CLOSURE)
    wide = over_three(np.asarray(found.solids), ("wrap", "edge"))
    expected = interpolate(found.weights, (jnp.asarray(wide),))[:, 0]
    seen = np.asarray(found.law_inputs.wide_solid_fraction)
    np.testing.assert_allclose(seen, expected, rtol=1e-12)
    assert np.ptp(seen / np.asarray(found.law_inputs.solid_fraction)) > 0.3


def test_no_other_law_is_given_it():
    assert sampled(WenYu()).law_inputs.wide_solid_fraction is None


def test_cells_behind_a_wall_in_the_mesh_do_not_count():
    """The floor closes the first row of cells and half of the second one."""
    found = sampled(CLOSURE, floor=1.5 * CELL)
    room = np.broadcast_to([0.0, 0.5, 1.0, 1.0], CELLS)
    content, among = (over_three(field, ("wrap", "edge")) for field in (room * np.asarray(found.solids), room))
    expected = interpolate(found.weights, (jnp.asarray(content / among),))[:, 0]
    np.testing.assert_allclose(found.law_inputs.wide_solid_fraction, expected, rtol=1e-9)


def test_on_a_coarser_view_it_is_of_the_coarser_cells():
    """Three coarse columns round the box and two rows between walls: it depends on the height alone."""
    found = sampled(CLOSURE, drag_inputs_coarsened=2)
    coarse = np.asarray(found.solids).reshape(3, 2, 2, 2).mean(axis=(1, 3))
    rows = over_three(coarse, ("wrap", "edge"))
    seen = np.asarray(found.law_inputs.wide_solid_fraction)
    assert seen.max() <= rows.max() * (1.0 + 1e-12) and seen.min() >= rows.min() * (1.0 - 1e-12)
    assert np.ptp(seen) > 0.3 * np.ptp(rows) > 0.0


@pytest.mark.parametrize("periodic", [False, True])
def test_slabs_see_over_their_borders(periodic):
    field = np.random.default_rng(1).random((8, 3))
    whole = Grid((8, 3), (0.8, 0.3), 1.0, (periodic, False))
    slabs = whole.in_blocks(Blocks(4, 0, periodic))
    mesh, spec = Mesh(np.array(jax.devices()[:4]), (MESH_AXIS,)), PartitionSpec(MESH_AXIS)
    own = jax.shard_map(lambda x: mean_over_three(slabs, x), mesh=mesh, in_specs=spec, out_specs=spec, check_vma=False)
    expected = over_three(field, ("wrap" if periodic else "edge", "edge"))
    np.testing.assert_allclose(jax.jit(own)(jnp.asarray(field)), expected, rtol=1e-12)
    np.testing.assert_allclose(mean_over_three(whole, jnp.asarray(field)), expected, rtol=1e-12)

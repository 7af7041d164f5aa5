"""Flow through planes: what crossed is what there is beyond, whatever the axes, sides, inlets and exits."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.errors import InputError
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.observables import Plane, fluid_flow, particle_flow
from jaxdem.particles.integrate import ParticleState
from jaxdem.state import State

NUMBER, STEPS, DENSITY, RADIUS = 7, 6, 2500.0, 0.01


def built(size, precision="float64", periodic=True, **tables):
    """Particles in a box whose first axis is periodic; where they start does not matter."""
    kind = {"kind": "periodic"} if periodic else {"kind": "no_slip"}
    places = np.full((NUMBER, len(size)), 0.5) * size
    places[:, 0] = np.linspace(0.05, 0.95, NUMBER) * size[0]
    scene = {
        "precision": precision,
        "domain": {"size": list(size)},
        "particles": {"radius": RADIUS, "density": DENSITY, "position": places.tolist()},
        "contact": {"young_modulus": 1e6, "speed": 1.0},
        "boundary": {"left": kind},
        "time": {"end": 0.01, "output_interval": 0.01},
    }
    return jaxdem.build(jaxdem.load_scene(scene | tables))


def state_at(position, low=None, active=None, step=0):
    """A state of which the flow looks at positions alone."""
    zero = jnp.zeros_like(position)
    particles = ParticleState(position, low, zero, zero, (), (), zero, None, active=active)
    return State(particles, None, jnp.int32(step))


def walks(size, dtype=np.float64):
    """Positions (STEPS + 1, N, D) that go on over the seam of the first axis and stay inside along the others."""
    random = np.random.default_rng(3)
    places = np.empty((STEPS + 1, NUMBER, len(size)))
    places[0] = random.uniform(0.0, 1.0, places[0].shape) * size
    for k in range(STEPS):
        places[k + 1] = places[k] + random.normal(0.1, 0.5, places[0].shape) * size
        places[k + 1, :, 1:] = np.clip(places[k + 1, :, 1:], 0.0, size[1:])
    return places.astype(dtype)


def summed(simulation, parameters, plane, places, **of_state):
    """The flow of all steps, as numbers."""
    flow = jax.jit(partial(particle_flow, simulation, parameters, plane))
    steps = [
        flow(state_at(jnp.asarray(a), step=k, **of_state), state_at(jnp.asarray(b), step=k + 1, **of_state))
        for k, (a, b) in enumerate(zip(places[:-1], places[1:], strict=True))
    ]
    return jax.tree.map(lambda *values: np.sum(np.stack(values), axis=0), *steps)


@pytest.mark.parametrize("size", [(0.3, 0.2), (0.3, 0.25, 0.2)], ids=["2-D", "3-D"])
def test_what_crossed_is_what_there_is_beyond(size):
    """Along the upper axis the number beyond the plane; along the periodic one the images of the plane passed."""
    simulation, parameters = built(size)
    places, up = walks(np.array(size)), len(size) - 1
    mass = parameters.bodies.mass
    beyond = (places[..., up] > 0.07).sum(axis=1)
    flow = summed(simulation, parameters, Plane.across(up, 0.07, len(size)), places)
    assert flow.number == beyond[-1] - beyond[0] != 0
    assert flow.forward > flow.number
    np.testing.assert_allclose(flow.mass, mass * (beyond[-1] - beyond[0]), rtol=1e-12)
    np.testing.assert_allclose(flow.volume * DENSITY, flow.mass, rtol=1e-12)
    images = np.floor((places[..., 0] - 0.2) / size[0])
    flow = summed(simulation, parameters, Plane.across(0, 0.2, len(size)), places)
    assert flow.number == (images[-1] - images[0]).sum() != 0


def test_an_oblique_plane_counts_what_is_beyond():
    simulation, parameters = built((0.3, 0.25, 0.2))
    places, normal, offset = walks(np.array((0.3, 0.25, 0.2))), (0.0, 0.6, 0.8), 0.15
    beyond = (places @ np.array(normal) > offset).sum(axis=1)
    assert summed(simulation, parameters, Plane(normal, offset), places).number == beyond[-1] - beyond[0] != 0


def test_rectangles_that_cover_a_plane_have_its_flow():
    """Over the seam of the axis along it too: a place is that in the box."""
    simulation, parameters = built((0.3, 0.2))
    places = walks(np.array((0.3, 0.2)))
    whole = summed(simulation, parameters, Plane.across(1, 0.07, 2), places)
    parts = [
        summed(simulation, parameters, Plane.across(1, 0.07, 2, (low,), (high,)), places)
        for low, high in ((0.0, 0.11), (0.11, 0.3))
    ]
    assert all(part.forward > 0 for part in parts)
    for total, *each in zip(whole, *parts, strict=True):
        np.testing.assert_allclose(sum(each), total, rtol=1e-12)


def test_in_single_precision_far_from_the_first_period():
    """A thousand periods away one float does not resolve the plane; the pair of floats does."""
    simulation, parameters = built((0.3, 0.2), "float32")
    exact = np.array([[300.0 + 0.1 - 2e-6, 0.1], [300.0 + 0.1 + 2e-6, 0.1]])
    places = np.repeat(exact[:, None], NUMBER, axis=1)
    leading = places.astype(np.float32)
    low = (places - leading).astype(np.float32)
    assert leading[0, 0, 0] == leading[1, 0, 0]
    flow = jax.jit(partial(particle_flow, simulation, parameters, Plane.across(0, 0.1, 2)))
    before, after = (state_at(jnp.asarray(leading[k]), jnp.asarray(low[k]), step=k) for k in range(2))
    assert flow(before, after).number == NUMBER
    assert flow(after, before).number == -NUMBER


def test_who_leaves_counts_and_who_comes_does_not():
    """Removed ones have moved beyond the side before; new ones appear on the far side of the plane."""
    simulation, parameters = built((0.3, 0.2), periodic=False)
    before = np.full((NUMBER, 2), 0.1)
    after = np.full((NUMBER, 2), [0.31, 0.1])
    present = jnp.arange(NUMBER) < 3
    flow = jax.jit(partial(particle_flow, simulation, parameters, Plane.across(0, 0.3, 2)))
    left = flow(state_at(jnp.asarray(before), active=present), state_at(jnp.asarray(after), active=~present, step=1))
    mean_velocity = (after - before)[0] / simulation.interval
    assert left.number == left.forward == 3
    np.testing.assert_allclose(left.momentum, 3.0 * parameters.bodies.mass * mean_velocity, rtol=1e-12)


FLUID = {
    "precision": "float64",
    "domain": {"size": [0.3, 0.2, 0.4]},
    "fluid": {"cells": [3, 4, 5], "density": 900.0, "time_step": 0.01},
    "time": {"end": 0.01, "output_interval": 0.01},
}


def test_flow_of_the_fluid_is_that_of_its_faces_and_linear_between():
    """u_x = 2 + 30 x + y - z is exact on faces, and so is its integral over a rectangle on whole cells."""
    simulation, parameters = jaxdem.build(jaxdem.load_scene(FLUID))
    grid = simulation.fluid.solver.grid
    across = (h * (np.arange(n) + 0.5) for h, n in zip(grid.spacing[1:], (4, 5), strict=True))
    x, y, z = np.meshgrid(grid.spacing[0] * np.arange(4), *across, indexing="ij")
    faces = [jnp.zeros(grid.face_shape(axis)) for axis in range(3)]
    faces[0] = jnp.asarray(2.0 + 30.0 * x + y - z)
    void = jnp.full(grid.cells, 0.6)
    state = State(None, FluidState(tuple(faces), jnp.zeros(grid.cells), void), jnp.int32(1))

    @jax.jit
    def flow(at, lower, upper):
        return fluid_flow(simulation, parameters, Plane((1.0, 0.0, 0.0), at, 0, lower, upper), state)

    whole = jax.jit(lambda at: fluid_flow(simulation, parameters, Plane((1.0, 0.0, 0.0), at, 0), state))
    for at in (0.0, 0.1, 0.17, 0.3):
        mean = 2.0 + 30.0 * at + 0.1 - 0.2
        np.testing.assert_allclose(whole(at).volume, 0.6 * mean * 0.08, rtol=1e-12)
        np.testing.assert_allclose(whole(at).mass, 900.0 * 0.6 * mean * 0.08, rtol=1e-12)
    # From 0.05 m to 0.15 m in y, two cells, and 0.08 m to 0.16 m in z, one cell.
    part = flow(0.17, jnp.asarray((0.05, 0.08)), jnp.asarray((0.15, 0.16))).volume
    np.testing.assert_allclose(part, 0.6 * (2.0 + 30.0 * 0.17 + 0.1 - 0.12) * 0.1 * 0.08, rtol=1e-12)
    slope = jax.grad(lambda at: fluid_flow(simulation, parameters, Plane((1.0, 0.0, 0.0), at, 0), state).volume)(0.17)
    np.testing.assert_allclose(slope, 0.6 * 30.0 * 0.08, rtol=1e-12)


def test_the_mass_of_two_fluids_that_passes_is_that_of_either_where_it_is():
    tables = {
        "domain": {"size": [0.4, 0.2]},
        "fluid": {"cells": [4, 4], "density": 1000.0, "viscosity": 1e-6},
        "surface": {"density": 1.0, "level": 0.075},
        "time": {"end": 1.0, "output_interval": 0.5},
    }
    simulation, parameters = jaxdem.build(jaxdem.load_scene(tables))
    grid = simulation.fluid.solver.grid
    faces = tuple(jnp.full(grid.face_shape(axis), speed) for axis, speed in enumerate((2.0, 0.0)))
    liquid = jnp.broadcast_to(jnp.asarray((1.0, 0.5, 0.0, 0.0)), grid.cells)
    state = State(None, FluidState(faces, jnp.zeros(grid.cells), None, liquid_fraction=liquid), jnp.int32(1))
    found = fluid_flow(simulation, parameters, Plane((1.0, 0.0), 0.13, 0), state)
    np.testing.assert_allclose(found.volume, 2.0 * 0.2, rtol=1e-6)
    np.testing.assert_allclose(found.mass, 2.0 * (1000.0 * 0.075 + 1.0 * 0.125), rtol=1e-6)


@pytest.mark.parametrize("made", [lambda: Plane((0.0, 2.0), 0.1), lambda: Plane.across(2, 0.1, 2)])
def test_planes_that_nothing_crosses_are_refused(made):
    """A normal of another length, and an axis that there is not."""
    with pytest.raises(InputError, match="unit vector|none of the axes"):
        made()

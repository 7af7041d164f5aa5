"""Surfaces that the fluid sees: linear flows kept exactly, rest, momentum, channels, and what a forgotten part does."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.coupling.open_parts import corner_points, cut_cells, face_points
from jaxdem.fluid.boundary import Sides
from jaxdem.fluid.cut_stress import CutViscosity, cut_stress
from jaxdem.fluid.grid import divergence, face_control_volume, face_total
from jaxdem.fluid.open_faces import LEAST_OPEN
from jaxdem.setup.cut_cells import FluidSurface, cut_cells_of
from jaxdem.solids.clipping import positive_part
from tests.cases.flows import Flow
from tests.cases.tiers import tiered


def on_device(cut):
    return jax.tree.map(jnp.asarray, cut)


@pytest.mark.parametrize("angle", tiered([0.0, 17.0, 45.0, 77.0], first=[17.0]))
def test_a_linear_shear_flow_along_a_tilted_wall_is_kept(angle):
    flow = Flow((12, 10), (1.2, 1.0), ("no_slip",) * 4)
    along = np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))])
    normal = np.array([-along[1], along[0]])
    plane = FluidSurface(lambda x: (x - np.array([0.6, 0.43])) @ normal)
    cut = on_device(cut_cells_of(flow.grid, [plane])[0])
    corners = plane.distance(corner_points(flow.grid))
    velocity = []
    for axis in range(2):
        part = positive_part(corners, (1 - axis,))
        mean = np.where(part.fraction >= LEAST_OPEN, part.integral / np.maximum(part.fraction, LEAST_OPEN), 0.0)
        velocity.append(jnp.asarray(mean * along[axis]))
    # What flows through faces that are open by less than a hundredth is left out.
    lost = LEAST_OPEN**2 * min(flow.grid.spacing)
    assert float(jnp.abs(divergence(flow.grid, cut.opened(velocity))).max()) * 0.1 < lost
    sides = Sides(flow.solver.boundary, flow.properties(1.0).side_velocity, jnp.asarray(0.0))
    stress, _ = cut_stress(flow.grid, sides, cut, tuple(velocity), CutViscosity(jnp.asarray(1.0)), False)
    for axis in range(2):
        force = (stress[axis] - cut.friction[axis] * velocity[axis])[2:-2, 2:-2]
        assert float(jnp.abs(force).max()) < 1e-11
        assert float(cut.friction[axis].min()) >= 0.0


def test_a_wall_on_a_grid_line_is_a_no_slip_side():
    flow = Flow((6, 8), (0.6, 0.8), ("no_slip",) * 4)
    cut, _ = cut_cells_of(flow.grid, [FluidSurface(lambda x: x[..., 1] - 0.3)])
    assert cut.open_faces[0][:, 3] == pytest.approx(1.0)
    assert not cut.open_faces[0][:, :3].any() and not cut.open_faces[1][:, :4].any()
    assert cut.friction[0][2:-2, 3] == pytest.approx(2.0 / 0.1**2)
    assert not cut.friction[0][:, 4:].any()


def test_a_uniform_stream_along_a_tilted_free_slip_wall_is_kept():
    flow = Flow((10, 10), (1.0, 1.0), ("free_slip",) * 4)
    along = np.array([2.0, 1.0]) / math.sqrt(5.0)
    wall = FluidSurface(lambda x: (x - np.array([0.5, 0.31])) @ np.array([-along[1], along[0]]), no_slip=False)
    cut = on_device(cut_cells_of(flow.grid, [wall])[0])
    stream = tuple(jnp.where(a > 0.0, c, 0.0) for a, c in zip(cut.open_faces, along, strict=True))
    properties = flow.properties(1e-2)._replace(cut=cut)
    flux = cut.opened(stream)
    solver = dataclasses.replace(flow.solver, surfaces=1)
    rates = solver.terms.of_stage(properties, flux, stream, (1.0, 1.0), None, jnp.asarray(0.0))
    total = cut.on_open(rates.total)
    inner = [np.asarray(r)[3:-3, 3:-3] for r in total]
    # What the faces that are closed would carry is of the order of LEAST_OPEN; 10/s is the stream over a cell.
    assert max(np.abs(r).max() for r in inner) < 2 * LEAST_OPEN * 10.0
    whole = [np.asarray(r)[3:-3, 7:-2] for r in total]
    assert max(np.abs(r).max() for r in whole) < 1e-12


def test_the_flow_gains_what_the_surfaces_lose_and_every_cell_keeps_its_volume():
    flow = Flow((16, 16), (0.4, 0.4), ("no_slip",) * 4)
    surfaces = [
        FluidSurface(lambda x: 0.19 - np.hypot(x[..., 0] - 0.2, x[..., 1] - 0.2)),
        FluidSurface(lambda x: x[..., 1] - 0.1 + 0.2 * x[..., 0], no_slip=False),
    ]
    cut = on_device(cut_cells_of(flow.grid, surfaces)[0])
    solver = dataclasses.replace(flow.solver, surfaces=2)
    properties = flow.properties(1e-2)._replace(cut=cut)
    rng = np.random.default_rng(0)
    noise = [rng.standard_normal(flow.grid.face_shape(axis)) for axis in range(2)]
    state = flow.state(*[n * (np.asarray(a) > 0.0) for n, a in zip(noise, cut.open_faces, strict=True)])
    step = jax.jit(lambda state: solver.step(properties, state, jnp.asarray(0.0), jnp.asarray(1e-3)))

    def momentum(state):
        volumes = (face_control_volume(flow.grid, axis) for axis in range(2))
        parts = zip(cut.inertia, volumes, state.face_velocity, cut.open_faces, strict=True)
        return np.asarray(face_total(flow.grid, tuple(m * v * u * (a > 0.0) for m, v, u, a in parts)))

    first = step(state)
    second = step(first.state)
    change = (momentum(second.state) - momentum(first.state)) / 1e-3
    load = np.asarray(second.surface_load)[:, :, 0].sum(axis=0)
    scale = np.abs(np.asarray(second.surface_load)[:, :, 0]).sum()
    assert np.abs(change + load).max() < 1e-11 * scale
    assert float(second.divergence) < 1e-11
    flux = cut.opened(second.state.face_velocity)
    assert float(jnp.abs(divergence(flow.grid, flux)).max()) < 1e-9 * float(jnp.abs(flux[0]).max()) / 0.025
    # Negative control: without the open fractions the same flow does not keep the volume.
    plain = float(jnp.abs(divergence(flow.grid, second.state.face_velocity)).max())
    assert plain > 1e-3 * float(jnp.abs(flux[0]).max()) / 0.025


def test_slivers_pockets_and_full_cells():
    grid = Flow((8, 8), (0.8, 0.8), ("no_slip",) * 4).grid
    # A wall that leaves a millionth of a row of cells open, and one a millionth short of a grid line.
    for offset in (1e-7, -1e-7):
        cut, _ = cut_cells_of(grid, [FluidSurface(lambda x, y=offset: x[..., 1] - 0.3 + y)])
        assert all(np.isfinite(part).all() for part in cut.friction)
        assert all(((a == 0.0) | (a >= LEAST_OPEN)).all() for a in cut.open_faces)
    full, _ = cut_cells_of(grid, [FluidSurface(lambda x: -1.0 - 0.0 * x[..., 0])])
    assert not full.open_cells.any()


def test_slopes_by_the_place_of_a_cylinder():
    flow = Flow((12, 12), (0.6, 0.6), ("inlet", "outlet", "no_slip", "no_slip"))
    corners = jnp.asarray(corner_points(flow.grid))
    solver = dataclasses.replace(flow.solver, surfaces=1)
    start = flow.state()

    @jax.jit
    def drag(height):
        distance = jnp.hypot(corners[..., 0] - 0.31, corners[..., 1] - height) - 0.1
        cut = cut_cells(flow.grid, [distance], [True])
        properties = flow.properties(1e-2, {0: np.array([0.1, 0.0])})._replace(cut=cut)
        load = solver.step(properties, start, jnp.asarray(0.0), jnp.asarray(0.02)).surface_load
        return load[0, 1, 0]

    value, slope = jax.value_and_grad(drag)(0.287)
    step = 1e-6
    assert np.isfinite(value)
    assert float(slope) == pytest.approx(float(drag(0.287 + step) - drag(0.287 - step)) / (2 * step), rel=1e-4)


def test_points_of_the_faces():
    grid = Flow((2, 3), (0.2, 0.6), ("no_slip",) * 4).grid
    assert face_points(grid, 0)[2, 0] == pytest.approx([0.2, 0.1])
    assert face_points(grid, 1)[0, 3] == pytest.approx([0.05, 0.6])

"""A fluid in slabs of the box, one a device, does what it does on one device."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.closures import SubgridClosure
from jaxdem.fluid.boundary import Boundary, Side
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.pressure import fast_inverse
from jaxdem.fluid.slabs import fluid_of_slabs
from jaxdem.numerics.blocks import Blocks
from tests.cases.fluid_slabs import FLUIDS, SAME, SLABS, compared, in_slabs, run_on_slabs, stirred
from tests.cases.tiers import COMBINATION

INTERVALS = 20


def built(name, **changes):
    """Interval, numbers and the stirred fluid of a scene; `closed` with a learned subgrid stress."""
    scene = jaxdem.load_scene(FLUIDS[name], changes)
    own = {"subgrid": SubgridClosure.constant(0.02, 0.05, hidden=())} if name == "closed" else {}
    simulation, parameters = jaxdem.build(scene, **own)
    fluid = jaxdem.initial_state(scene, simulation, parameters)[0].fluid
    return simulation.fluid, parameters.flow, stirred(simulation.fluid.solver.grid, fluid)


def marched(interval, properties, fluid, number=INTERVALS):
    """Fluid after some intervals, and what each reports."""

    def body(fluid, k):
        return interval.advance(properties, fluid, k * interval.duration)

    return jax.lax.scan(body, fluid, jnp.arange(number, dtype=fluid.pressure.dtype))


@pytest.mark.parametrize(
    ("name", "number", "axis"),
    [
        pytest.param("closed", 2, 1, marks=COMBINATION),
        ("jet", 4, 0),
        pytest.param("updraft", 3, 1, marks=COMBINATION),
        pytest.param("stream", 2, 0, marks=COMBINATION),
        pytest.param("stream", 3, 1, marks=COMBINATION),
        pytest.param("jet, 3-D", 2, 0, marks=COMBINATION),
    ],
)
def test_fields_and_reports_are_those_of_one_device(name, number, axis):
    """After 20 intervals from a random flow: velocity and pressure within 1e-12 of their largest values, and all
    figures, among them the loads on the sides.

    Both solve the pressure to 2e-12 U/h, with the same number of iterations, so that what differs is rounding: the
    largest seen is 8e-16 of the velocity and 1e-13 of the pressure. No program gathers the cells of the box.
    """
    interval, properties, fluid = built(name)
    grid = interval.solver.grid
    if name in ("jet", "updraft"):
        solver = dataclasses.replace(interval.solver, measured_sides=tuple(range(2 * grid.dimension)))
        interval = dataclasses.replace(interval, solver=solver)
    whole, reports = jax.jit(lambda *given: marched(interval, *given))(properties, fluid)
    blocks, slabs = in_slabs(grid, number, axis, fluid)
    own = interval.in_blocks(blocks)
    given = [SAME, SLABS], [properties, slabs]
    (found, figures), text = run_on_slabs(number, lambda *given: marched(own, *given), *given)
    assert "all-gather" not in text and "collective-permute" in text and "all-to-all" in text
    assert np.max(compared(blocks, found, whole)) < 1e-12
    # A face between two slabs has one velocity.
    border = np.moveaxis(np.asarray(found.face_velocity[axis]), 1 + axis, 1)
    np.testing.assert_array_equal(border[:-1, -1], border[1:, 0])
    assert np.all(figures.converged) and np.all(figures.finite)
    for field in reports._fields:
        one, many = getattr(reports, field), getattr(figures, field)
        if one is None:
            continue
        many, size = np.asarray(many), np.nanmax(np.abs(np.asarray(one, float)))
        for slab in many[1:]:
            np.testing.assert_array_equal(slab, many[0])
        bound = 1e-14 if field == "divergence" else 1e-12 * size
        np.testing.assert_allclose(many[0], one, rtol=0, atol=bound, err_msg=field)


@pytest.mark.parametrize("kinds", [("periodic", "periodic"), ("no_slip", "outlet"), ("outlet", "outlet")])
def test_transforms_of_many_cells(kinds):
    """The inverse of the Laplacian on 256 x 5 cells, by fast transforms along the axis that is cut into four."""
    periodic = (kinds[0] == "periodic", False)
    grid = Grid((256, 5), (2.0, 0.1), 1.0, periodic)
    every = (*kinds, "no_slip", "no_slip")
    boundary = Boundary(tuple(Side(n // 2, bool(n % 2), kind) for n, kind in enumerate(every)))
    cells = np.random.default_rng(0).normal(size=grid.cells)
    whole = np.asarray(jax.jit(fast_inverse(grid, boundary))(cells))
    own = grid.in_blocks(Blocks(4, 0, periodic[0]))
    many, _ = run_on_slabs(4, fast_inverse(own, boundary), [SLABS], [cells.reshape(4, 64, 5)])
    np.testing.assert_allclose(np.asarray(many).reshape(256, 5), whole, rtol=0, atol=1e-13 * np.abs(whole).max())


def test_a_fluid_goes_into_slabs_and_back():
    """Bit for bit, with void fraction and mean gradient, along every axis."""
    interval, _, fluid = built("stream")
    draw = np.random.default_rng(2)
    fluid = fluid._replace(
        pressure=draw.normal(size=fluid.pressure.shape), void_fraction=draw.uniform(size=fluid.pressure.shape)
    )
    for axis in range(2):
        blocks, slabs = in_slabs(interval.solver.grid, 2, axis, fluid)
        back = fluid_of_slabs(blocks, slabs)
        for a, b in zip(jax.tree.leaves(back), jax.tree.leaves(fluid), strict=True):
            np.testing.assert_array_equal(a, b)

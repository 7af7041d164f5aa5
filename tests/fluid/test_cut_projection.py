"""Continuity between surfaces: where the solver begins changes its work and not its result; sums over surfaces."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.fluid import surface_loads
from jaxdem.fluid.cut_projection import CutContinuity
from jaxdem.fluid.grid import divergence
from jaxdem.setup.cut_cells import FluidSurface, cut_cells_of
from tests.cases.flows import Flow


@pytest.fixture(scope="module")
def projection():
    """Velocity, pressure and iterations of the projection of one rough flow, by the trend it begins with."""
    flow = Flow((24, 20), (1.2, 1.0), ("inlet", "outlet", "no_slip", "no_slip"))
    surface = FluidSurface(lambda x: np.hypot(x[..., 0] - 0.51, x[..., 1] - 0.48) - 0.2)
    cut = jax.tree.map(jnp.asarray, cut_cells_of(flow.grid, [surface])[0])
    rng = np.random.default_rng(0)
    velocity = tuple(jnp.where(a > 0.0, rng.standard_normal(a.shape), 0.0) for a in cut.open_faces)
    push = cut.pushed(tuple(jnp.ones_like(a) for a in cut.open_faces))

    @jax.jit
    def projected(trend):
        continuity = CutContinuity(flow.grid, flow.solver.boundary, 0.0, cut, trend)
        none = jnp.zeros(flow.grid.cells)
        return *continuity.projected(none, velocity, cut.open_faces, push), continuity.corrected(cut.opened(velocity))

    return flow, cut, projected, cut.opened(velocity)


def test_the_solver_begins_with_the_trend_and_ends_where_it_does_without(projection):
    flow, cut, projected, given = projection
    velocity, pressure, report, left, _ = projected(jnp.zeros(flow.grid.cells))
    assert int(report.iterations) > 8 and float(left) < 2e-12
    noise = jnp.where(cut.open_cells > 0.0, np.random.default_rng(1).standard_normal(flow.grid.cells), 0.0)
    count, near = int(report.iterations), pressure + 1e-6 * jnp.abs(pressure).max() * noise
    for trend, most in ((-3.0 * pressure, 0), (near, count - 4), (noise, count + 2)):
        other, same, told, rest, _ = projected(trend)
        assert int(told.iterations) <= most and float(rest) < 1e-11
        assert float(jnp.abs(same - pressure).max()) < 1e-10 * float(jnp.abs(pressure).max())
        assert max(float(jnp.abs(a - b).max()) for a, b in zip(velocity, other, strict=True)) < 1e-10
    # The flux within a step keeps the volume to its tolerance, whatever the start.
    largest = max(
        sum(float(jnp.abs(f).max()) for f in given) / 0.05, float(jnp.abs(divergence(flow.grid, given)).max())
    )
    for trend in (pressure, noise):
        assert float(jnp.abs(divergence(flow.grid, projected(trend)[4])).max()) < 1.001e-3 * largest


def test_the_start_has_no_slope(projection):
    flow, _, projected, _ = projection
    pressure = projected(jnp.zeros(flow.grid.cells))[1]
    slope = jax.grad(lambda share: projected(share * pressure)[0][0].sum())(0.7)
    assert float(slope) == 0.0


@pytest.mark.parametrize("dimension", [2, 3])
def test_sums_over_many_surfaces_are_those_over_few(dimension):
    rng, size = np.random.default_rng(2), (5, 4, 3)[:dimension]
    places = [rng.random(count) for count in size]
    field, nearest = rng.standard_normal(size), rng.integers(0, 3, size)
    arms = np.meshgrid(*places, indexing="ij")
    expected = [[np.sum(f * (nearest == k)) for f in (field, *(field * a for a in arms))] for k in range(3)]
    for count in (3, surface_loads.MASKED + 1):
        found = surface_loads._moments(jnp.asarray(field), places, jnp.asarray(nearest), count)
        assert found[:3] == pytest.approx(np.array(expected), abs=1e-13) and not np.asarray(found[3:]).any()
    whole = surface_loads._moments(jnp.asarray(field), places, jnp.asarray(0 * nearest), 1)
    assert whole[0] == pytest.approx(np.sum(expected, axis=0), abs=1e-13)

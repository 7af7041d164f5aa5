"""Smagorinsky's subgrid viscosity in flows whose strain is known, and the limit that it puts on a fluid step."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.fluid.boundary import Boundary, Side, Sides
from jaxdem.fluid.diffusion import strain_rates, stress_divergence
from jaxdem.fluid.grid import Grid, face_total
from jaxdem.fluid.interval import SUBSTEPS, VISCOUS_LIMIT, VISCOUS_STABLE
from jaxdem.fluid.subgrid import eddy_viscosity
from tests.cases.flows import PERIODIC, Flow, linear_faces

CS, A, SIZE = 0.17, 3.0, (0.7, 0.9, 1.2)
TIME = jnp.asarray(0.0)


def box(cells, kinds):
    periodic = tuple(kinds[2 * a] == "periodic" for a in range(len(cells)))
    grid = Grid(cells, SIZE[: len(cells)], 1.0, periodic)
    return grid, Boundary(tuple(Side(n // 2, bool(n % 2), kind) for n, kind in enumerate(kinds)))


# Compiled as wholes: outside of `jit` every operation is a program of its own.
stress_divergence = jax.jit(stress_divergence, static_argnums=0)


@partial(jax.jit, static_argnums=0)
def subgrid_viscosity(grid, sides, velocity):
    return eddy_viscosity(strain_rates(grid, sides, velocity), jnp.asarray(CS * grid.filter_size))


def viscosity_of(grid, boundary, velocity, sides=None):
    still = (jnp.zeros(grid.dimension),) * (2 * grid.dimension)
    sides = Sides(boundary, still if sides is None else sides, TIME)
    return np.asarray(subgrid_viscosity(grid, sides, velocity))


@pytest.mark.parametrize("cells", [(4, 6), (3, 4, 6)])
def test_plane_shear_has_the_shear_rate_as_strain_up_to_the_walls(cells):
    """u = (a z, 0): S:S = a^2/2, so that nu_t = (C_s Delta)^2 a in every cell."""
    d = len(cells)
    sides = ("periodic",) * (2 * d - 2)
    grid, boundary = box(cells, (*sides, "no_slip", "moving_wall"))
    gradient = np.zeros((d, d))
    gradient[0, d - 1] = A
    speeds = [jnp.zeros(d)] * (2 * d)
    speeds[-1] = jnp.zeros(d).at[0].set(A * grid.size[-1])
    nu = viscosity_of(grid, boundary, linear_faces(grid, gradient), tuple(speeds))
    delta = np.prod(grid.spacing) ** (1.0 / d)
    np.testing.assert_allclose(nu, (CS * delta) ** 2 * A, rtol=1e-13)


def test_stretching_and_rotation_away_from_walls():
    """u = (a x, -a z): S:S = 2 a^2, nu_t = (C_s Delta)^2 2 a; a rigid rotation has none."""
    grid, boundary = box((6, 5), ("outlet",) * 4)
    scale = CS**2 * np.prod(grid.spacing)
    stretched = viscosity_of(grid, boundary, linear_faces(grid, [[A, 0.0], [0.0, -A]]))
    np.testing.assert_allclose(stretched[1:-1, 1:-1], scale * 2.0 * A, rtol=1e-13)
    turned = viscosity_of(grid, boundary, linear_faces(grid, [[0.0, -A], [A, 0.0]]))
    np.testing.assert_allclose(turned[1:-1, 1:-1], 0.0, atol=1e-13)


def test_wall_stress_of_plane_shear():
    """Under a stress-free top the fluid loses rho (nu + nu_t) a per wall area, and nothing else."""
    grid, boundary = box((3, 8), ("periodic", "periodic", "no_slip", "free_slip"))
    velocity = linear_faces(grid, [[0.0, A], [0.0, 0.0]])
    still, nu = (jnp.zeros(2),) * 4, jnp.asarray(0.02)
    acceleration = stress_divergence(
        grid, Sides(boundary, still, TIME), velocity, nu, jnp.asarray(CS * grid.filter_size)
    )[0]
    loss = -np.asarray(acceleration).sum(axis=1) * grid.spacing[1]
    np.testing.assert_allclose(loss, (0.02 + CS**2 * np.prod(grid.spacing) * A) * A, rtol=1e-13)


def test_stress_takes_no_momentum_from_a_periodic_box_but_moves_it():
    grid, boundary = box((5, 4, 6), ("periodic",) * 6)
    random, still = np.random.default_rng(0), (jnp.zeros(3),) * 6
    velocity = []
    for axis in range(3):
        f = random.normal(size=grid.face_shape(axis))
        np.moveaxis(f, axis, 0)[-1] = np.moveaxis(f, axis, 0)[0]
        velocity.append(jnp.asarray(f))
    length = jnp.asarray(CS * grid.filter_size)
    stress = stress_divergence(grid, Sides(boundary, still, TIME), tuple(velocity), jnp.asarray(0.0), length)
    size = sum(float(jnp.abs(s).sum()) for s in stress)
    assert size > 1.0
    assert max(abs(float(total)) for total in face_total(grid, stress)) < 1e-14 * size
    # And it takes energy: sum u . div(tau) < 0.
    assert sum(float(t) for t in face_total(grid, [u * s for u, s in zip(velocity, stress, strict=True)])) < 0.0


def test_slope_is_finite_at_rest():
    grid, boundary = box((4, 4), ("no_slip",) * 4)
    still = (jnp.zeros(2),) * 4

    def total(velocity, length):
        stress = stress_divergence(grid, Sides(boundary, still, TIME), velocity, jnp.asarray(0.1), length)
        return sum(jnp.sum(s) for s in stress)

    at_rest = linear_faces(grid, np.zeros((2, 2)))
    slopes = jax.jit(jax.grad(total, (0, 1)))(at_rest, jnp.asarray(CS))
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(slopes))


def sheared(**fluid):
    """A fluid alone in plane shear between a floor and a lid that moves with it."""
    tables = dict(
        precision="float64",
        domain=dict(size=[0.4, 0.4], depth=1.0, gravity=[0.0, 0.0]),
        fluid=dict(cells=[4, 16], density=2.0, viscosity=1e-4, time_step=0.1, courant_limit=1.0) | fluid,
        boundary=dict(
            left=dict(kind="periodic"),
            right=dict(kind="periodic"),
            top=dict(kind="moving_wall", velocity=[0.4 * A, 0.0]),
        ),
        time=dict(end=0.1, output_interval=0.1),
    )
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    state, _ = jaxdem.initial_state(scene, simulation, parameters)
    grid = simulation.fluid.solver.grid
    faces = linear_faces(grid, [[0.0, A], [0.0, 0.0]])
    return simulation.fluid, parameters, state.fluid._replace(face_velocity=faces)


def test_the_viscous_limit_is_that_of_the_shortest_pressure_wave():
    """A chequered pressure over a fluid at rest is multiplied by (8/3) nu t sum(1/h^2) in a step: 1 at the limit."""
    flow = Flow((6, 4), (0.6, 0.8), PERIODIC)
    chequered = np.indices((6, 4)).sum(axis=0) % 2 - 0.5
    inverse = sum(1.0 / h**2 for h in flow.grid.spacing)
    for number in (0.1, VISCOUS_STABLE, 0.5):
        start = flow.state()._replace(pressure=jnp.asarray(chequered))
        state, _, _ = flow.march(flow.properties(1.0), start, 1, number / inverse)
        np.testing.assert_allclose(state.pressure, number / VISCOUS_STABLE * chequered, atol=1e-10)
    assert VISCOUS_LIMIT < VISCOUS_STABLE == 3.0 / 8.0


@pytest.mark.parametrize("coefficient", [0.0, 0.9])
def test_the_viscosity_number_counts_the_subgrid_viscosity(coefficient):
    """nu t (1/hx^2 + 1/hz^2) with nu + (C_s Delta)^2 a: 1.1, for which the two steps of the Courant limit are few."""
    interval, parameters, fluid = sheared(smagorinsky=coefficient)
    state, report = jax.jit(lambda p, f: interval.advance(p, f, TIME))(parameters.fluid, fluid)
    hx, hz = interval.solver.grid.spacing
    nu = 1e-4 + coefficient**2 * hx * hz * A
    whole = nu * 0.1 * (1.0 / hx**2 + 1.0 / hz**2)
    courant = (0.4 - 0.5 * hz) * A / hx * 0.1
    count = next(n for n in SUBSTEPS if n >= max(whole / VISCOUS_LIMIT, courant))
    assert int(report.substeps) == count
    assert float(report.viscous) == pytest.approx(whole / count, rel=1e-12)
    assert count == (4 if coefficient else 2)
    # The shear is the steady solution, whatever the viscosity.
    np.testing.assert_allclose(state.face_velocity[0], fluid.face_velocity[0], atol=1e-12)


@pytest.mark.parametrize("coefficient", [0.0, 0.1])
def test_without_a_coefficient_there_is_no_subgrid_viscosity_in_the_program(coefficient):
    """Its root is the only one of a fluid alone."""
    interval, parameters, fluid = sheared(smagorinsky=coefficient)
    program = jax.jit(lambda p, f: interval.advance(p, f, TIME)).lower(parameters.fluid, fluid)
    assert ("stablehlo.sqrt" in program.as_text()) == (coefficient > 0.0)

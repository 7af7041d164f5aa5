"""The pressure solver against dense linear algebra, and its discrete operators."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.fluid.boundary import Boundary, Side
from jaxdem.fluid.grid import Grid, divergence
from jaxdem.fluid.pressure import pressure_gradient, solve_pressure


def make(cells, periodic, outlets=(), patch=None):
    """A grid with walls, periodic axes, and outlets given as (axis, upper); the patch holds for the outlets."""
    size = tuple(0.1 * n * (1.0 + 0.3 * a) for a, n in enumerate(cells))
    sides = []
    for axis in range(len(cells)):
        for upper in (False, True):
            kind = "periodic" if periodic[axis] else "no_slip"
            corners = (None, None)
            if (axis, upper) in outlets:
                kind, corners = "outlet", (None, None) if patch is None else patch
            sides.append(Side(axis, upper, kind, *corners))
    return Grid(cells, size, 0.1, periodic), Boundary(tuple(sides))


CASES = {
    "walls": make((7, 5), (False, False)),
    "periodic": make((6, 5), (True, True)),
    "periodic and walls, 3-D": make((4, 3, 5), (True, False, False)),
    "outlet": make((7, 5), (False, False), [(0, True)]),
    "outlets on two sides, 3-D": make((4, 3, 3), (False, False, True), [(0, True), (1, False)]),
    "outlet on a patch": make((6, 8), (False, False), [(0, True)], ((0.25,), (0.75,))),
    "one cell thick": make((8, 1), (False, True), [(0, True)]),
    "two cells, periodic": make((2, 4), (True, False)),
}


@pytest.fixture(scope="module", params=CASES, ids=str)
def case(request):
    """Solution with a coefficient that varies hundredfold, and the dense matrix of the operator."""
    grid, boundary = CASES[request.param]
    random = np.random.default_rng(3)
    coefficient = []
    for axis in range(grid.dimension):
        c = 10.0 ** random.uniform(-1.0, 1.0, grid.face_shape(axis))
        if grid.periodic[axis]:
            np.moveaxis(c, axis, 0)[-1] = np.moveaxis(c, axis, 0)[0]
        coefficient.append(jnp.asarray(c))
    source = random.normal(size=grid.cells)
    if not boundary.has_outlet:
        source -= source.mean()
    count = source.size

    def operator(p):
        slope = pressure_gradient(grid, boundary, p)
        return divergence(grid, tuple(c * s for c, s in zip(coefficient, slope, strict=True)))

    @jax.jit
    def compute(source):
        basis = jnp.eye(count).reshape(count, *grid.cells)
        matrix = jax.vmap(operator)(basis).reshape(count, count).T
        return matrix, *solve_pressure(grid, boundary, tuple(coefficient), source, jnp.asarray(1e-11))

    matrix, pressure, report = compute(source)
    return grid, boundary, tuple(coefficient), source, np.asarray(matrix), np.asarray(pressure), report


def test_solution_is_that_of_a_dense_solve(case):
    _, boundary, _, source, matrix, pressure, report = case
    dense = np.linalg.lstsq(matrix, source.ravel(), rcond=1e-13)[0]
    if not boundary.has_outlet:
        assert pressure.mean() == pytest.approx(0.0, abs=1e-14 * np.abs(pressure).max())
        dense -= dense.mean()
    # The residual is under 1e-11 and the smallest eigenvalue of order one.
    np.testing.assert_allclose(pressure.ravel(), dense, atol=1e-9 * np.abs(dense).max())
    assert bool(report.converged)


def test_operator_is_symmetric(case):
    """Conjugate gradients and the adjoint solve need it."""
    matrix = case[4]
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-12 * np.abs(matrix).max())


def test_reported_residual_is_the_true_one(case):
    *_, source, matrix, pressure, report = case
    residual = matrix @ pressure.ravel() - source.ravel()
    # Two evaluations of the same difference of numbers of order 1e3.
    assert float(report.residual) == pytest.approx(np.abs(residual).max(), abs=1e-12)


def test_constant_coefficient_takes_one_iteration():
    """The preconditioner is the exact inverse there; a second one may be spent on round-off."""
    for grid, boundary in (CASES["walls"], CASES["periodic"], CASES["outlet"]):
        source = np.random.default_rng(0).normal(size=grid.cells)
        source = jnp.asarray(source - source.mean())
        ones = (jnp.ones(()),) * grid.dimension
        _, report = jax.jit(lambda s, g=grid, b=boundary, o=ones: solve_pressure(g, b, o, s, 1e-11))(source)
        assert int(report.iterations) <= 2


def test_derivative_is_that_of_the_dense_solve():
    """Reverse mode by implicit differentiation against the dense matrix: d(w.p)/dc and d(w.p)/d(source)."""
    grid, boundary = CASES["outlet"]
    random = np.random.default_rng(5)
    weight = jnp.asarray(random.normal(size=grid.cells))
    source = jnp.asarray(random.normal(size=grid.cells))
    coefficient = tuple(jnp.asarray(random.uniform(0.3, 1.0, grid.face_shape(a))) for a in range(2))

    def iterative(coefficient, source):
        return jnp.sum(weight * solve_pressure(grid, boundary, coefficient, source, jnp.asarray(1e-13))[0])

    def dense(coefficient, source):
        def operator(p):
            slope = pressure_gradient(grid, boundary, p)
            return divergence(grid, tuple(c * s for c, s in zip(coefficient, slope, strict=True)))

        matrix = jax.vmap(operator)(jnp.eye(source.size).reshape(-1, *grid.cells)).reshape(source.size, -1).T
        return jnp.sum(weight.ravel() * jnp.linalg.solve(matrix, source.ravel()))

    both = jax.jit(lambda c, s: (jax.grad(iterative, (0, 1))(c, s), jax.grad(dense, (0, 1))(c, s)))
    ours, truth = both(coefficient, source)
    for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(truth), strict=True):
        # Tolerances of the two solves, 1e-13, times a condition number of order 1e2.
        np.testing.assert_allclose(a, b, atol=1e-10 * float(jnp.abs(b).max()))


@pytest.mark.parametrize("size", [1e-18, 1e-25])
def test_a_source_near_rest_is_solved_in_float32(size):
    """The products in conjugate gradients would underflow: a fluid that came to rest got 0/0."""
    grid, boundary = CASES["walls"]
    noise = np.random.default_rng(0).normal(size=grid.cells)
    coefficient = tuple(
        jnp.asarray(np.random.default_rng(1 + a).uniform(0.5, 2.0, grid.face_shape(a)), jnp.float32) for a in range(2)
    )
    source = jnp.asarray(size * (noise - noise.mean()), jnp.float32)
    solved = jax.jit(lambda c, s: solve_pressure(grid, boundary, c, s, 1e-5 * jnp.max(jnp.abs(s))))
    pressure, report = solved(coefficient, source)
    wanted, _ = solved(coefficient, source / jnp.float32(size))
    assert bool(report.converged)
    np.testing.assert_allclose(pressure / size, wanted, atol=1e-4 * float(jnp.abs(wanted).max()))

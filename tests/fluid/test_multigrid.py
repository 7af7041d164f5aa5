"""The multigrid cycle as a preconditioner: symmetric and positive, and as many iterations at any ratio of densities."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.fluid.boundary import Boundary, Side
from jaxdem.fluid.grid import Grid, face_average
from jaxdem.fluid.multigrid import multigrid
from jaxdem.fluid.pressure import PressureProblem, fast_inverse, solve_preconditioned
from tests.cases.tiers import tiered

MESHES = {
    "closed, odd numbers of cells": ((13, 11), ("free_slip",) * 4),
    "periodic, odd numbers of cells": ((13, 11), ("periodic",) * 4),
    "open above, flat": ((24, 3), ("free_slip",) * 3 + ("outlet",)),
    "3-D, periodic along one axis": ((7, 6, 9), ("periodic",) * 2 + ("free_slip",) * 3 + ("outlet",)),
}


def problem(cells, kinds, ratio, aspect=1.0):
    """1/rho on the faces of a drop of a heavy fluid, off the middle of the box; cells are longer along the first axis
    by the aspect."""
    size = tuple(0.1 * n * (aspect if axis == 0 else 1.0) for axis, n in enumerate(cells))
    grid = Grid(cells, size, 1.0, tuple(kind == "periodic" for kind in kinds[::2]))
    boundary = Boundary(tuple(Side(n // 2, bool(n % 2), kind) for n, kind in enumerate(kinds)))
    middles = np.meshgrid(*[(np.arange(n) + 0.5) / n for n in cells], indexing="ij")
    heavy = sum((x - 0.4) ** 2 for x in middles) < 0.3**2
    density = face_average(grid, jnp.asarray(np.where(heavy, 1.0, 1.0 / ratio)))
    return PressureProblem(grid, boundary, tuple(1.0 / rho for rho in density))


FIRST = ("closed, odd numbers of cells", "3-D, periodic along one axis")


@pytest.mark.parametrize("name", tiered(MESHES, first=FIRST))
def test_a_cycle_is_symmetric_and_positive(name):
    """On vectors of mean zero where no side sets the pressure, as those of conjugate gradients are."""
    asked = problem(*MESHES[name], 1000.0)
    cycle = multigrid(asked.grid, asked.boundary, asked.coefficient)
    vectors = np.random.default_rng(0).normal(size=(8, *asked.grid.cells))
    if not asked.boundary.has_outlet:
        vectors -= vectors.mean(axis=tuple(range(1, vectors.ndim)), keepdims=True)
    images = jax.jit(jax.vmap(cycle))(jnp.asarray(vectors))
    products = np.asarray(vectors).reshape(8, -1) @ np.asarray(images).reshape(8, -1).T
    assert np.abs(products - products.T).max() < 1e-11 * np.abs(products).max()
    assert np.linalg.eigvalsh(0.5 * (products + products.T)).min() > 0.0


@pytest.mark.parametrize("name", tiered(MESHES, first=FIRST))
def test_the_iterations_do_not_grow_with_the_ratio(name):
    """Down to 1e-10 of a random source; the fast inverse, which knows one coefficient, needs more than twice as many.

    That of a drop: of heavy and light cells at random, which no coarser mesh knows, it takes three times as many.
    """
    counts = {}
    for ratio in (2.0, 1000.0):
        asked = problem(*MESHES[name], ratio)
        source = np.random.default_rng(1).normal(size=asked.grid.cells)
        source = jnp.asarray(source if asked.boundary.has_outlet else source - source.mean())
        inverses = {"cycle": multigrid(*asked[:3]), "fast": fast_inverse(*asked[:2])}
        for kind, inverse in inverses.items():
            _, report = solve_preconditioned(asked, source, jnp.asarray(1e-10), inverse)
            counts[kind, ratio] = int(report.iterations)
            assert bool(report.converged) or kind == "fast"
    assert counts["cycle", 1000.0] <= 1.6 * counts["cycle", 2.0] + 2
    assert counts["cycle", 1000.0] < 0.5 * counts["fast", 1000.0]


def test_the_iterations_do_not_grow_with_the_length_of_the_cells():
    """The short axis is coarsened first: 12 and 18 iterations; with all axes alike they are 12 and 101."""
    counts = []
    for aspect in (1.0, 8.0):
        asked = problem((32, 24), ("free_slip",) * 4, 1000.0, aspect)
        source = np.random.default_rng(1).normal(size=asked.grid.cells)
        source = jnp.asarray(source - source.mean())
        counts.append(int(solve_preconditioned(asked, source, jnp.asarray(1e-10), multigrid(*asked[:3]))[1].iterations))
    assert counts[1] < 2 * counts[0]

"""Ways to spread particles over cells: volume, adjointness, moments, and how even the void fraction comes out."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.coupling.deposition import Centre, Diffusion, Divided, Kernel, OwnKernel, gaussian_matrix, sphere_points
from jaxdem.coupling.interpolation import deposit, deposit_on_faces, interpolate_faces
from jaxdem.coupling.kernel import KernelWidth
from jaxdem.coupling.void_fraction import solid_fraction
from jaxdem.fluid.grid import Grid, face_total
from tests.cases import extremes

DIAMETER = 0.02
# Sums of some hundred terms of size one, in float64.
ROUND_OFF = 1e-13


def depositions(grid, width=3.0):
    half = tuple(max(width * DIAMETER, h) for h in grid.spacing)
    return {
        "kernel": Kernel(half),
        "centre": Centre((0.0,) * grid.dimension),
        "divided": Divided((0.5 * DIAMETER,) * grid.dimension),
        "diffusion": Diffusion(half),
    }


NAMES = ("kernel", "centre", "divided", "diffusion")


def places(grid, count=20):
    """Random positions, and corners, side and face centres."""
    inside = np.random.default_rng(0).uniform(0.0, grid.size, (count, grid.dimension))
    special = [(0.0, h, 0.5 * length, length) for length, h in zip(grid.size, grid.spacing, strict=True)]
    return np.concatenate((inside, np.array(list(itertools.product(*special)))))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("ratio", "dimension"), [(1.0, 2), (1.7, 3), (3.3, 2)])
def test_volume_is_exact_and_exchange_adjoint(name, ratio, dimension):
    """Sum of the solid volume is that of the particles, walls and corners included; no cell is negative; and
    sum_p F_p . interpolate(u)_p = sum_f deposit(F)_f u_f."""
    h = ratio * DIAMETER
    cells = (7, 6, 5)[:dimension]
    grid = Grid(cells, tuple(n * h for n in cells), h, (True, False, False)[:dimension])
    position = places(grid)
    random = np.random.default_rng(1)
    force = random.normal(size=position.shape)
    faces = tuple(random.normal(size=grid.face_shape(axis)) for axis in range(dimension))
    np.moveaxis(faces[0], 0, 0)[-1] = faces[0][0]  # periodic: the first and the last face are one
    deposition = depositions(grid)[name]

    @jax.jit
    def compute(position):
        weights = deposition.weights(grid, position, jnp.asarray(0.5 * DIAMETER))
        solids = solid_fraction(grid, weights, jnp.asarray(4.2e-6))
        return solids, deposit_on_faces(grid, weights, force), interpolate_faces(weights, faces)

    solids, on_faces, seen = compute(position)
    volume = float(jnp.sum(solids)) * grid.cell_volume
    assert volume == pytest.approx(4.2e-6 * len(position), rel=ROUND_OFF)
    assert float(jnp.min(solids)) >= -1e-18
    given = sum(float(x) for x in face_total(grid, tuple(a * b for a, b in zip(on_faces, faces, strict=True))))
    assert given == pytest.approx(float(np.sum(force * seen)), abs=1e-11)


def test_points_of_the_sphere():
    """29 points in the unit sphere, their mean at its centre, second moments 1/5 per axis but for the centre's
    share (28/29 of 1 - 29^(-5/3)), and no preferred axis."""
    points = sphere_points()
    assert points.shape == (29, 3)
    assert np.linalg.norm(points, axis=1).max() < 1.0
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-16)
    moments = points.T @ points / 29
    np.testing.assert_allclose(moments, np.eye(3) * 0.2 * (1 - 29 ** (-5 / 3)), atol=1e-15)


def test_divided_volume_is_that_of_the_sphere_within_a_cell():
    """A sphere cut by a plane through 1/4 of its diameter: the cap holds 5/32 of it; within two of 29 points."""
    grid = Grid((2, 2, 2), (0.1, 0.1, 0.1), 1.0, (False,) * 3)
    radius = jnp.asarray(0.02)

    @jax.jit
    def compute(position):
        return deposit(grid, Divided((0.02,) * 3).weights(grid, position, radius), jnp.ones(1))

    shares = np.asarray(compute(np.array([[0.05 + 0.01, 0.025, 0.025]])))
    assert shares[0].sum() == pytest.approx(5 / 32, abs=2 / 29)
    assert shares[:, 0, 0].sum() == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("periodic", [False, True])
def test_diffusion_is_a_gaussian(periodic):
    """The matrix is symmetric, positive, with rows of sum one, and in the inside has the variance s^2, exactly:
    the discrete Laplacian of x^2 is 2."""
    spacing, deviation = 0.1, 0.17
    matrix = gaussian_matrix(60, spacing, deviation, periodic)
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-15)
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, atol=1e-13)
    assert matrix.min() > -1e-15
    x = spacing * (np.arange(60) - 30)
    assert matrix[30] @ x == pytest.approx(0.0, abs=1e-13)
    assert matrix[30] @ x**2 == pytest.approx(deviation**2, rel=1e-9)


def unevenness(name, ratio, width=3.0):
    """Standard deviation over mean of the solid fraction of a square lattice, whose volume is even."""
    h = ratio * DIAMETER
    count = 24
    grid = Grid((count, count), (count * h, count * h), 1.05 * DIAMETER, (True, True))
    number = int(count * ratio / 1.25)
    lattice = np.stack(np.meshgrid(*[(np.arange(number) + 0.5) / number] * 2, indexing="ij"), -1).reshape(-1, 2)
    position = lattice * count * h
    deposition = depositions(grid, width)[name]

    @jax.jit
    def compute(position):
        weights = deposition.weights(grid, position, jnp.asarray(0.5 * DIAMETER))
        return solid_fraction(grid, weights, jnp.asarray(np.pi / 6 * DIAMETER**3))

    solids = np.asarray(compute(position))
    return solids.std() / solids.mean()


@pytest.mark.parametrize("ratio", [1.0, 1.7, 2.0, 3.3])
def test_smooth_methods_stay_even_when_cells_are_as_small_as_particles(ratio):
    """An even layer of grains: a kernel that reaches three diameters sees it even to 1 %, centre and divided do not.

    Diffusion of the same variance damps the pattern that the cells make of the lattice, which may be longer than
    the kernel, to half per axis only: 10 %; with twice the width it is even to 5 %.
    """
    spread = {name: unevenness(name, ratio) for name in NAMES}
    assert spread["kernel"] < 0.01
    assert spread["diffusion"] < 0.11 and unevenness("diffusion", ratio, 6.0) < 0.05
    assert spread["centre"] > spread["divided"] > spread["diffusion"]
    assert spread["centre"] > 0.2


def test_the_volume_of_a_grain_far_smaller_than_a_cell_is_not_rounded_away():
    """A grain of 0.2 mm fills 7e-8 of a cell of 4 cm, half of what 1 - void fraction resolves in float32; its volume is
    that of the sphere to the rounding of a sum."""
    tables = extremes.base(particles__radius=1e-4, particles__position=[[0.12, 0.12]])
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    state, _ = jaxdem.initial_state(scene, simulation, parameters)

    @jax.jit
    def volume_error(state):
        exchange = simulation.coupling.begin(parameters.mixture, state.fluid, state.particles, jnp.zeros(()))
        return exchange.diagnostics(exchange.first(state.fluid)).volume

    assert state.particles.position.dtype == jnp.float32
    assert float(volume_error(state)) < 1e-6


def test_each_grain_has_the_kernel_of_its_own_size():
    """What a grain gives to the cells is what a kernel of its width gives, and the smallest width is that of cells."""
    grid = Grid((9, 8), (0.18, 0.16), 0.02, (True, False))
    position, random = places(grid), np.random.default_rng(2)
    radius = random.choice([0.001, 0.006, 0.02], len(position))
    widest = tuple(max(1.5 * 0.04, 0.5 * h) for h in grid.spacing)
    volume = random.uniform(1.0, 2.0, len(position))

    @jax.jit
    def spread(position, radius, volume):
        return deposit(grid, OwnKernel(widest, KernelWidth(1.5, 0.5)).weights(grid, position, radius), volume)

    expected = np.zeros(grid.cells)
    for size in np.unique(radius):
        own, half = radius == size, tuple(max(3.0 * size, 0.5 * h) for h in grid.spacing)
        weights = Kernel(half).weights(grid, position[own], np.asarray(size))
        expected += deposit(grid, weights, volume[own])
    found = np.asarray(spread(position, radius, volume))
    assert found.sum() == pytest.approx(volume.sum(), rel=ROUND_OFF)
    np.testing.assert_allclose(found, expected, atol=1e-14)
    of_largest = deposit(grid, Kernel(widest).weights(grid, position, radius), volume)
    assert np.max(np.abs(of_largest - expected)) > 0.5


@pytest.mark.parametrize(
    "tables",
    [
        {"coupling": {"deconvolution": 0.1}},
        {"coupling": {"self_disturbance": True}},
        {"walls": [{"kind": "plane", "point": [0.0, 0.03], "normal": [0.0, 1.0], "fluid": "no_slip"}]},
    ],
)
def test_own_kernels_are_refused_where_there_is_one_for_all(tables):
    """Corrections for one kernel, and factors of cells beside walls in the fluid, are made for the kernel of all."""
    scene = {
        "domain": {"size": [0.2, 0.1], "depth": 0.02},
        "particles": {"position": [[0.05, 0.05], [0.15, 0.06]], "radius": [0.01, 0.005], "density": 2500.0},
        "contact": {"young_modulus": 1e7, "speed": 0.1},
        "fluid": {"cells": [10, 5], "density": 1000.0, "viscosity": 1e-4, "time_step": 1e-3},
        "time": {"end": 0.01, "output_interval": 0.01},
    } | tables
    scene["coupling"] = {"kernel_diameter": "own", **tables.get("coupling", {})}
    with pytest.raises(jaxdem.InputError, match="kernel_diameter"):
        jaxdem.build(jaxdem.load_scene(scene))


def test_a_bed_of_two_sizes_with_kernels_of_their_own_keeps_its_momentum():
    """Grains of 2 and 10 mm that sink in water at rest: what they gain the water loses, and all volume is there."""
    random = np.random.default_rng(3)
    position = np.stack(np.meshgrid(np.linspace(0.02, 0.18, 5), np.linspace(0.03, 0.17, 4)), axis=-1).reshape(-1, 2)
    simulation, parameters = jaxdem.build(
        scene := jaxdem.load_scene(
            {
                "precision": "float64",
                "domain": {"size": [0.2, 0.2], "depth": 0.02, "gravity": [0.0, 0.0]},
                "particles": {
                    "position": position.tolist(), "radius": random.choice([0.001, 0.005], len(position)).tolist(),
                    "density": 2500.0, "velocity": random.normal(0.0, 0.1, position.shape).tolist(),
                },
                "contact": {"young_modulus": 1e7, "speed": 0.5},
                "fluid": {"cells": [10, 10], "density": 1000.0, "viscosity": 1e-4, "time_step": 1e-3},
                "boundary": {side: {"kind": "periodic"} for side in ("left", "right", "bottom", "top")},
                "coupling": {"kernel_diameter": "own", "kernel_width": {"diameters": 3.0, "cells": 0.5}},
                "time": {"end": 0.002, "output_interval": 0.002},
            }
        )
    )  # fmt: skip
    assert isinstance(simulation.coupling.deposition, OwnKernel)
    start, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    end, _, told = jax.jit(simulation.step)(parameters, start, neighbors)
    assert float(told.exchange.momentum) < 1e-14
    assert float(told.exchange.volume) < 1e-13
    assert not np.allclose(end.particles.velocity, start.particles.velocity, atol=1e-3)

"""The learned subgrid stress: its formula in known flows, what it conserves and is blind to, its slopes, its limit."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.closures import SubgridClosure
from jaxdem.errors import InputError
from jaxdem.fluid.boundary import Boundary, Side, Sides
from jaxdem.fluid.grid import Grid, face_total
from jaxdem.fluid.subgrid_stress import subgrid_acceleration, subgrid_flow, subgrid_stress
from tests.cases.flows import linear_faces, random_faces

C1, CN, SIZE = 0.03, 0.07, (0.7, 0.9, 1.2)
TIME, VISCOSITY = jnp.asarray(0.0), jnp.asarray(1e-6)


@jax.tree_util.Partial
def constant(strain_rate, *others):
    """C1 and CN everywhere."""
    return jnp.full_like(strain_rate, C1), jnp.full_like(strain_rate, CN)


def shaken(seed=1, size=0.5, hidden=(4,)):
    """A closure with random weights everywhere."""
    closure = SubgridClosure.initial(hidden)
    leaves, structure = jax.tree.flatten(closure.weights)
    generator = np.random.default_rng(seed)
    moved = [leaf + size * generator.normal(size=leaf.shape).astype(leaf.dtype) for leaf in leaves]
    return dataclasses.replace(closure, weights=jax.tree.unflatten(structure, moved))


def box(cells, *kinds):
    """A box with the same kind of side at both ends of each axis."""
    grid = Grid(cells, SIZE[: len(cells)], 1.0, tuple(kind == "periodic" for kind in kinds))
    return grid, Boundary(tuple(Side(axis, upper, kind) for axis, kind in enumerate(kinds) for upper in (False, True)))


@partial(jax.jit, static_argnums=(0, 1))
def stress_of(grid, boundary, law, velocity, void_fraction=None):
    """The stress, and the acceleration that it gives."""
    still = (jnp.zeros(grid.dimension),) * (2 * grid.dimension)
    flow = subgrid_flow(grid, Sides(boundary, still, TIME), law, velocity, VISCOSITY, void_fraction)
    stress = subgrid_stress(grid, flow, void_fraction)
    return stress, subgrid_acceleration(grid, boundary, stress)


def uneven(grid, seed=5):
    return jnp.asarray(np.random.default_rng(seed).uniform(0.4, 1.0, grid.cells))


def random_flow(grid, seed=0):
    return tuple(map(jnp.asarray, random_faces(grid, seed)))


def test_a_linear_flow_has_the_stress_of_the_formula():
    grid, boundary = box((5, 6, 7), *("outlet",) * 3)
    g = np.random.default_rng(3).normal(size=(3, 3))
    strain = 0.5 * (g + g.T)
    magnitude = np.sqrt(2.0 * np.sum(strain**2))
    delta = np.prod(grid.spacing) ** (1 / 3)
    widths = np.diag(np.square(grid.spacing))
    expected = 2.0 * C1 * delta**2 * magnitude * strain - CN * g @ widths @ g.T
    stress, _ = stress_of(grid, boundary, constant, linear_faces(grid, g))
    inside = (slice(2, -2),) * 3
    for (i, j), values in stress.items():
        np.testing.assert_allclose(np.asarray(values)[inside], expected[i, j], rtol=1e-12)


def test_plane_shear_between_walls_has_no_stress_on_them():
    """u = (a z, 0): tau_xz = c_1 Delta^2 a^2 inside, zero on floor and lid; tau_xx = -c_n h_z^2 a^2, tau_zz = 0."""
    grid, boundary = box((3, 6), "periodic", "free_slip")
    stress, _ = stress_of(grid, boundary, constant, linear_faces(grid, [[0.0, 3.0], [0.0, 0.0]]))
    hx, hz = grid.spacing
    np.testing.assert_allclose(stress[0, 1][:, 2:-2], C1 * hx * hz * 9.0, rtol=1e-12)
    assert not np.asarray(stress[0, 1])[:, [0, -1]].any()
    np.testing.assert_allclose(stress[0, 0][:, 1:-1], -CN * hz**2 * 9.0, rtol=1e-12)
    np.testing.assert_allclose(stress[1, 1], 0.0, atol=1e-14)


def test_nothing_in_a_uniform_flow_or_without_training():
    grid, boundary = box((5, 4), "periodic", "periodic")
    uniform = tuple(jnp.full(grid.face_shape(axis), speed) for axis, speed in enumerate((2.0, -0.7)))
    for law, velocity in ((shaken(), uniform), (SubgridClosure.initial((4,)), random_flow(grid))):
        for values in stress_of(grid, boundary, law, velocity, uneven(grid))[1]:
            np.testing.assert_array_equal(values, 0.0)


@pytest.mark.parametrize("cells", [(5, 4), (5, 4, 6)])
def test_momentum_is_moved_and_not_made(cells):
    """In a periodic box none of it; between walls none of the components along them."""
    for last in ("periodic", "no_slip"):
        grid, boundary = box(cells, *("periodic",) * (len(cells) - 1), last)
        _, moved = stress_of(grid, boundary, shaken(), random_flow(grid), uneven(grid))
        totals = face_total(grid, moved)
        size = sum(float(jnp.abs(values).sum()) for values in moved)
        assert size > 0.1
        for total in totals if last == "periodic" else totals[:-1]:
            assert abs(float(total)) < 1e-14 * size


@pytest.mark.parametrize("cells", [(5, 4), (5, 4, 6)])
def test_it_turns_with_the_flow_and_is_the_same_in_a_mirror(cells):
    """Axes exchanged (a mirror image), and one axis reversed: together all turns by 90 degrees."""
    kinds = ("no_slip", "periodic", "free_slip")[: len(cells)]
    grid, boundary = box(cells, *kinds)
    velocity, share, last = random_flow(grid), uneven(grid), len(cells) - 1
    _, moved = stress_of(grid, boundary, shaken(), velocity, share)

    def exchanged(values):
        return tuple(jnp.swapaxes(values[a], 0, last) for a in (last, *range(1, last), 0))

    def reversed_(values):
        return tuple((-1.0 if a == 0 else 1.0) * jnp.flip(f, 0) for a, f in enumerate(values))

    swapped, other = box((cells[last], *cells[1:last], cells[0]), kinds[last], *kinds[1:last], kinds[0])
    swapped = dataclasses.replace(swapped, size=(grid.size[last], *grid.size[1:last], grid.size[0]))
    _, turned = stress_of(swapped, other, shaken(), exchanged(velocity), jnp.swapaxes(share, 0, last))
    _, mirrored = stress_of(grid, boundary, shaken(), reversed_(velocity), jnp.flip(share, 0))
    scale = max(float(jnp.abs(values).max()) for values in moved)
    for found, expected in ((turned, exchanged(moved)), (mirrored, reversed_(moved))):
        for a, b in zip(found, expected, strict=True):
            np.testing.assert_allclose(a, b, atol=1e-13 * scale)


def test_it_is_the_same_in_a_moving_frame():
    grid, boundary = box((5, 4), "periodic", "periodic")
    velocity = random_flow(grid)
    moving = tuple(u + speed for u, speed in zip(velocity, (3.0, -1.0), strict=True))
    at_rest, in_motion = (stress_of(grid, boundary, shaken(), u, uneven(grid))[1] for u in (velocity, moving))
    for a, b in zip(at_rest, in_motion, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12 * float(jnp.abs(a).max()))


def test_the_coefficients_stay_within_their_bounds_and_have_one_slope_at_zero():
    huge = shaken(size=30.0)
    rates = jnp.asarray(np.random.default_rng(2).uniform(0.0, 50.0, (2, 200)))
    rest = (jnp.asarray(0.1), VISCOSITY, jnp.full(200, 0.5), rates[0])
    viscosity, bending = jax.jit(lambda law: law(*rates, *rest))(huge)
    assert -0.02 <= float(viscosity.min()) < float(viscosity.max()) <= 0.1
    assert float(jnp.abs(bending).max()) <= 1 / 4
    assert float(jnp.abs(bending).min()) > 0.1  # the bounds were reached
    for wanted in ((0.05, 1 / 12), (-0.01, -0.2)):
        given = jax.jit(lambda law: law(*rates, *rest))(SubgridClosure.constant(*wanted, hidden=(4,)))
        for values, value in zip(given, wanted, strict=True):
            np.testing.assert_allclose(values, value, rtol=1e-6)
    with pytest.raises(InputError, match="gradient.*0.25"):
        SubgridClosure.constant(0.0, 0.3)


def jet(**fluid):
    """Water at rest into which a jet starts."""
    tables = dict(
        precision="float64",
        domain=dict(size=[0.4, 0.3], depth=1.0),
        fluid=dict(cells=[6, 5], viscosity=1e-5, time_step=0.01) | fluid,
        boundary=dict(
            left={"kind": "inlet", "velocity": 1.0, "from": 0.05, "to": 0.2, "ramp_time": 0.0},
            right=dict(kind="outlet"),
        ),
        time=dict(end=0.02, output_interval=0.02),
    )
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene, subgrid=shaken())
    return simulation, parameters, jaxdem.initial_state(scene, simulation, parameters)[0].fluid


@partial(jax.jit, static_argnums=(0, 1))
@partial(jax.grad, argnums=(2, 3))
def slopes_of(grid, boundary, closure, velocity):
    """Slopes of the sum of all squared accelerations."""
    return sum(jnp.sum(a**2) + jnp.sum(a) for a in stress_of(grid, boundary, closure, velocity)[1])


def test_slopes_are_finite_at_rest_and_those_of_differences():
    """By weights and velocities; through fluid steps: tests/gradients."""
    grid, boundary = box((5, 4), "no_slip", "periodic")
    closure = jax.tree.map(lambda leaf: leaf.astype(jnp.float64), shaken())
    still = tuple(jnp.zeros(grid.face_shape(axis)) for axis in (0, 1))
    at_rest = slopes_of(grid, boundary, closure, still)
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(at_rest))
    start = (closure, random_flow(grid))
    generator = np.random.default_rng(4)
    direction = jax.tree.map(lambda leaf: jnp.asarray(generator.normal(size=leaf.shape)), start)

    def moved(step):
        closure, velocity = jax.tree.map(lambda leaf, d: leaf + step * d, start, direction)
        faces = stress_of(grid, boundary, closure, velocity)[1]
        return sum(float(np.sum(np.square(a)) + np.sum(a)) for a in map(np.asarray, faces))

    slopes = jax.tree.leaves(slopes_of(grid, boundary, *start))
    along = sum(float(jnp.sum(s * d)) for s, d in zip(slopes, jax.tree.leaves(direction), strict=True))
    assert along == pytest.approx((moved(1e-6) - moved(-1e-6)) / 2e-6, rel=1e-6)


def test_the_viscosity_number_counts_the_stress():
    """Plane shear a: nu + c_1 Delta^2 a + 2 c_n h^2 a, for |grad u| = a, over the smallest void fraction."""
    simulation, parameters, fluid = jet()
    solver = simulation.fluid.solver
    grid, a = solver.grid, 7.0
    properties = parameters.fluid._replace(subgrid=constant)
    shear = fluid._replace(face_velocity=linear_faces(grid, [[0.0, a], [0.0, 0.0]]))
    hx, hz = grid.spacing
    # At the walls, which the made-up flow does not know, the strain is another: far from it in a fluid at rest there.
    boundary = Boundary(tuple(dataclasses.replace(side, kind="outlet") for side in solver.boundary.sides))
    solver = dataclasses.replace(solver, boundary=boundary)
    found = [
        solver.largest_viscosity(properties, shear._replace(void_fraction=g), TIME)
        for g in (None, jnp.full(grid.cells, 0.5))
    ]
    expected = C1 * hx * hz * a + 2.0 * CN * max(hx, hz) ** 2 * a
    for value, share in zip(found, (1.0, 0.5), strict=True):
        assert float(value) == pytest.approx(1e-5 + expected / share, rel=1e-12)

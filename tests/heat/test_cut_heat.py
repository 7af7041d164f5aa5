"""Heat and scalars between surfaces within the mesh of the fluid: closed forms, what is kept, and what is refused."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem import InputError, load_scene, simulate
from jaxdem.coupling.open_parts import corner_points, on_corners
from jaxdem.fluid.boundary import Boundary, Side
from jaxdem.fluid.cut_scalar import ScalarWalls
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.scalar_transport import ScalarField, ScalarNumbers, ScalarTransport, Stream
from jaxdem.scalars.in_cells import between_surfaces
from jaxdem.setup.cut_cells import FluidSurface, cut_cells_of
from jaxdem.setup.scalar_walls import LENT, scalar_geometry
from tests.cases.tiers import COMBINATION

DIFFUSIVITY = 0.7


def resting(grid, surfaces, kinds, value, flux):
    """A scalar in fluid at rest between surfaces; what it is carried by, capacity, and the least of the lent one."""
    cut, _ = cut_cells_of(grid, [FluidSurface(distance) for distance in surfaces])
    nearest = np.min([distance(corner_points(grid)) for distance in surfaces], axis=0)
    lent, exchange, area, smallest = scalar_geometry(grid, cut, on_corners(grid, nearest), LENT)
    walls = ScalarWalls(*map(jnp.asarray, (lent, exchange, area, value, flux)))
    cut = jax.tree.map(jnp.asarray, cut)
    still = tuple(jnp.zeros(grid.face_shape(axis)) for axis in range(grid.dimension))
    stream = Stream(still, 1.0, 1.0, (1.0,) * grid.dimension)
    given = jnp.asarray(DIFFUSIVITY), 1.0, walls.value, walls.flux
    stream = between_surfaces(stream, walls, cut, kinds, given)
    kind, ends = "periodic" if grid.periodic[0] else "no_slip", 2 * grid.dimension
    sides = Boundary(tuple(Side(k // 2, bool(k % 2), kind) for k in range(ends)))
    field = ScalarField("dye", ("closed",) * ends, True, 1, kinds)
    numbers = ScalarNumbers(jnp.asarray(DIFFUSIVITY), jnp.zeros(ends), jnp.zeros(ends))
    capacity = jnp.where(cut.open_cells > 0.0, stream.surfaces.capacity(1.0), 0.0)
    return ScalarTransport(grid, sides, field, numbers, stream), capacity, smallest


def after(transport, smallest, start, duration):
    """The scalar after a time, in the steps that it needs."""
    number = duration * DIFFUSIVITY * sum(1.0 / h**2 for h in transport.grid.spacing)
    steps = int(np.ceil(number / (0.4 * min(smallest, 1.0))))
    return jax.jit(lambda value: transport.advance(value, duration, jnp.asarray(steps), False))(start)


CENTRE = (0.503, 0.498, 0.501)


@functools.cache
def annulus(cells, dimension=2):
    """Heat through both surfaces of a ring or shell of radii 0.2 and 0.45, values 1 and 0, over the exact one, and what
    is not kept."""
    grid = Grid((cells,) * dimension, (1.0,) * dimension, 1.0, (False,) * dimension)

    def radius(points):
        return np.sqrt(np.sum((points - np.asarray(CENTRE[:dimension])) ** 2, axis=-1))

    surfaces = (lambda points: radius(points) - 0.2, lambda points: 0.45 - radius(points))
    transport, capacity, smallest = resting(grid, surfaces, ("value", "value"), [1.0, 0.0], [0.0, 0.0])
    start = jnp.zeros(grid.cells)
    value, to_steady = after(transport, smallest, start, 0.15)
    kept = float(jnp.sum(capacity * value)) * grid.cell_volume - float(jnp.sum(to_steady))
    passed = after(transport, smallest, value, 0.01)[1][2 * dimension :] / 0.01
    exact = 2.0 * np.pi * DIFFUSIVITY / (np.log(0.45 / 0.2) if dimension == 2 else 0.5 * (1.0 / 0.2 - 1.0 / 0.45))
    return np.asarray(passed) / exact, kept


def test_heat_through_a_ring():
    """The error falls with the size of the cells, and what the surfaces gave is in the ring to rounding."""
    coarse, fine = annulus(20), annulus(40)
    for passed, kept in (coarse, fine):
        assert passed[0] == pytest.approx(-passed[1], rel=1e-4)
        assert abs(kept) < 1e-13
    errors = [abs(passed[0] - 1.0) for passed, _ in (coarse, fine)]
    assert errors[1] < 0.005 and errors[0] > 3.0 * errors[1], errors


@COMBINATION
def test_heat_between_spheres():
    passed, kept = annulus(20, 3)
    assert abs(kept) < 1e-13
    assert abs(passed[0] - 1.0) < 0.03 and passed[0] == pytest.approx(-passed[1], rel=1e-4)


def test_slope_by_the_value_of_a_surface():
    """Backwards through the steps: what is in the ring, by the value of its inner surface, against a difference."""
    grid = Grid((12, 12), (1.0, 1.0), 1.0, (False, False))

    def distance(points):
        return np.hypot(points[..., 0] - 0.503, points[..., 1] - 0.498) - 0.2

    transport, capacity, _ = resting(grid, (distance,), ("value",), [1.0], [0.0])
    surfaces = transport.stream.surfaces

    @jax.jit
    def held(value):
        given = surfaces._replace(value=value + 0.0 * surfaces.value)
        here = transport._replace(stream=transport.stream._replace(surfaces=given))
        found, _ = here.advance(jnp.zeros((12, 12)), 0.01, jnp.asarray(6), True)
        return jnp.sum(capacity * found**2)

    slope = float(jax.jit(jax.grad(held))(1.0))
    assert slope == pytest.approx(float(held(1.001) - held(0.999)) / 0.002, rel=1e-6)
    assert slope > 1.0


def tilted(cells, kinds, value, flux):
    """A slab of width 0.6 P between planes that are tilted against the mesh, endless by the period P of both axes."""
    grid = Grid((cells, 2 * cells), (1.0, 2.0), 1.0, (True, True))
    period = 2.0 / np.sqrt(5.0)

    def height(points):
        return np.mod((2.0 * points[..., 0] - points[..., 1]) / np.sqrt(5.0) + 0.013, period)

    surfaces = (lambda points: height(points) - 0.2 * period, lambda points: 0.8 * period - height(points))
    return (*resting(grid, surfaces, kinds, value, flux), 0.6 * period)


def test_heat_through_a_tilted_slab():
    """From a wall with a given flux q to one with a value c: c + q x/D, and q times its area passes both."""
    transport, capacity, smallest, width = tilted(16, ("flux", "value"), [0.0, 2.0], [1.5, 0.0])
    start = jnp.full((16, 32), 2.0)
    value, passed = after(transport, smallest, start, 3.0)
    kept = float(jnp.sum(capacity * (value - start))) * transport.grid.cell_volume - float(jnp.sum(passed))
    assert abs(kept) < 1e-12
    rate = np.asarray(after(transport, smallest, value, 0.01)[1][4:]) / 0.01
    np.testing.assert_allclose(rate, [1.5 * np.sqrt(5.0), -1.5 * np.sqrt(5.0)], rtol=2e-3)
    hottest = float(jnp.max(jnp.where(capacity > 0.0, value, 0.0)))
    assert hottest == pytest.approx(2.0 + 1.5 * width / DIFFUSIVITY, rel=0.03)


def test_closed_surfaces_keep_it_and_a_uniform_one_stays():
    transport, capacity, smallest, _ = tilted(12, ("closed", "closed"), [0.0, 0.0], [0.0, 0.0])
    rough = jnp.asarray(np.random.default_rng(3).random((12, 24)))
    value, passed = after(transport, smallest, rough, 0.02)
    assert float(jnp.sum(capacity * value)) == pytest.approx(float(jnp.sum(capacity * rough)), rel=1e-14)
    inside = np.asarray(capacity) > 0.0
    assert np.all(np.asarray(passed) == 0.0) and smallest > 0.2
    assert np.ptp(np.asarray(value)[inside]) < 0.3 * np.ptp(np.asarray(rough)[inside])
    even, _ = after(transport, smallest, jnp.ones((12, 24)), 0.02)
    np.testing.assert_allclose(even, 1.0, rtol=1e-14)
    # What is lent adds up to nothing.
    assert float(jnp.sum(capacity)) * transport.grid.cell_volume == pytest.approx(0.6 * 2.0, rel=1e-3)


def pipe_tables(block=None, **wall):
    """A stream of gas with some grains round a cylinder and a block."""
    block = {"heat_flux": 0.0} if block is None else block
    return {
        "precision": "float64",
        "domain": {"size": [0.04, 0.02], "depth": 0.002, "gravity": [0.0, 0.0]},
        "particles": {
            "radius": 1e-3, "density": 1000.0, "position": [[0.02, 0.0135], [0.012, 0.004], [0.028, 0.0105]],
        },
        "fluid": {"cells": [16, 8], "density": 1.2, "viscosity": 1.5e-5, "velocity": [0.3, 0.0]},
        "boundary": {
            "left": {"kind": "inlet", "velocity": 0.3, "ramp_time": 0.0, "temperature": 300.0},
            "right": {"kind": "outlet"},
        },
        "walls": [
            {"kind": "cylinder", "center": [0.02, 0.0093], "radius": 0.0031, "inside": False, "fluid": "no_slip"}
            | wall,
            {"kind": "mesh", "points": [[0.03, 0.0025], [0.03, 0.0065], [0.036, 0.0065], [0.036, 0.0025]],
             "closed": True, "fluid": "no_slip"} | block,
        ],
        "coupling": {"interval": 1e-3},
        "heat": {
            "fluid_heat_capacity": 1000.0, "fluid_conductivity": 0.03, "fluid_temperature": 300.0,
            "particle_heat_capacity": 500.0, "particle_temperature": 300.0,
        },
        "time": {"end": 0.05, "output_interval": 0.05},
    }  # fmt: skip


def test_a_hot_cylinder_warms_the_stream_and_the_balance_closes(tmp_path):
    block = {"name": "block", "heat_flux": 200.0}
    run = simulate(load_scene(pipe_tables(block, name="rod", temperature=350.0)), tmp_path / "hot")
    heat = run.summary["heat"]
    assert abs(heat["missing_relative"]) < 1e-13, heat
    given = heat["from_walls_to_fluid"]["rod"]
    assert given > 0.0
    # Of the order of Nu k l pi dT: a cylinder of Re 120 has Nu 5.6 (Churchill & Bernstein); its boundary layer is
    # thinner than a cell here.
    assert 1.0 < given / (0.05 * 0.03 * np.pi * 0.002 * 50.0) < 12.0
    # 200 W/m2 from four sides of 4 and 6 mm, 2 mm deep; cells of 2.5 mm cut its corners off.
    area = heat["from_walls_to_fluid"]["block"] / (200.0 * 0.05)
    assert 0.85 < area / (0.02 * 0.002) < 1.0
    means = {name: run.history[f"{name}_temperature_mean"] for name in ("fluid", "particle")}
    capacity = heat["grains"] / means["particle"][-1] if heat["grains"] else 0.0
    at_start = heat["start"] - 300.0 * capacity
    assert heat["fluid"] / means["fluid"][-1] == pytest.approx(at_start / 300.0, rel=1e-12), (
        "the mean is of what holds it"
    )
    last = run.fluid(-1)["temperature"]
    assert last.min() > 299.99 and last.max() < 350.01


@pytest.mark.parametrize(
    ("wall", "key"),
    [
        ({"temperature": 350.0, "heat_flux": 3.0}, "walls.0.heat_flux"),
        ({"fluid": "none", "heat_flux": 3.0}, "walls.0.heat_flux"),
        ({"fluid": "none", "temperature": 350.0}, "walls.0.temperature"),
    ],
)
def test_what_a_wall_cannot_be_is_refused(wall, key):
    with pytest.raises(InputError) as caught:
        load_scene(pipe_tables(**wall))
    assert caught.value.key == key

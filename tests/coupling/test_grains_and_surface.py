"""Grains in two fluids: speeds and buoyancy beside the surface, rest, momentum and volume of three phases."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.errors import InputError
from jaxdem.fluid.curvature import surface_tension_gradient
from jaxdem.fluid.grid import face_total
from jaxdem.fluid.momentum import FluidSolver
from jaxdem.fluid.second_fluid import SecondFluid
from tests.cases.grains_in_two_fluids import (
    CELLS,
    SIZE,
    after,
    dry_bed_and_a_column,
    layer_under_a_lake,
    liquid,
    march,
    momentum,
    tables,
)
from tests.cases.tiers import COMBINATION

G = 9.81


def test_terminal_speed_is_that_of_the_fluid_around():
    """Stokes: 2/9 (rho_s - rho) g r^2 / mu, below the surface and above it."""
    _, _, _, end = after(tables([(0.02, 0.03), (0.04, 0.09)], 0.06), 20)
    fall = -np.asarray(end.particles.velocity)[:, 1]
    expected = [2.0 / 9.0 * (2500.0 - rho) * G * 1e-8 / mu for rho, mu in ((1000.0, 1.0), (10.0, 0.1))]
    np.testing.assert_allclose(fall, expected, rtol=2e-3)


def kernel_part(lower, upper, half_width):
    """Integral of the triangular kernel about 0 between two places."""

    def below(x):
        t = np.clip(x / half_width, -1.0, 1.0)
        return 0.5 + t - 0.5 * t * np.abs(t)

    return below(upper) - below(lower)


def seen_density(height, level):
    """Density that the pressure shows a grain at a height: of the faces, of which one is the level, by its kernel."""
    h = SIZE[1] / CELLS[1]
    edges = h * np.arange(CELLS[1] + 1)
    on_faces = np.where(np.isclose(edges, level), 505.0, np.where(edges < level, 1000.0, 10.0))
    seen = 0.5 * (on_faces[1:] + on_faces[:-1])
    return np.sum(seen * kernel_part(edges[:-1] - height, edges[1:] - height, h))


def floating_height(density, level):
    """Height at which a grain of this density floats."""
    low, high = level - 0.01, level + 0.01
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if seen_density(middle, level) > density else (low, middle)
    return low


FLOATING = np.repeat((300.0, 505.0, 800.0), 2)
START = 0.085


@pytest.fixture(scope="module")
def between():
    """Grains that float, from above and below, and one that falls through the surface; the fluids let them pass."""
    heights = [floating_height(density, 0.06) for density in FLOATING] + np.tile((0.002, -0.003), 3)
    grains = [(0.006 + 0.008 * n, height) for n, height in enumerate((*heights, START))]
    density = [*FLOATING.tolist(), 2500.0]
    thin = {"fluid": {"viscosity": 1e-5}, "surface": {"viscosity": 1e-4}}
    return tables(grains, 0.06, density, 1e-3, **thin)


def test_grain_floats_where_it_displaces_its_weight(between):
    """A grain between both fluids in density; the surface is as sharp as the kernel."""
    _, _, _, end = after(between, 1500)
    expected = [floating_height(density, 0.06) for density in FLOATING]
    assert max(expected) - min(expected) > 0.005
    np.testing.assert_allclose(np.asarray(end.particles.position)[:-1, 1], expected, atol=2e-5)
    np.testing.assert_allclose(np.asarray(end.particles.velocity)[:-1, 1], 0.0, atol=1e-4)


def test_grain_that_enters_the_liquid_follows_its_equation_of_motion(between):
    """Stokes drag and buoyancy with the kernel's viscosity and density, by the classical Runge-Kutta method; the fluids
    hardly move. The interval is a fiftieth of the shorter relaxation time."""
    level, start, step = 0.06, START, 1e-4
    mass, weight = 2500.0, G * 2500.0

    def rate(y):
        part = kernel_part(-1.0 - y[0], level - y[0], 0.01)
        viscosity = 1.0 / (part / 1e-2 + (1.0 - part) / 1e-3)
        return np.array([y[1], (G * seen_density(y[0], level) - weight - 4.5 * viscosity / 1e-6 * y[1]) / mass])

    y, found = np.array([start, 0.0]), {}
    for k in range(1, 1401):
        a = rate(y)
        b = rate(y + 0.5 * step * a)
        c = rate(y + 0.5 * step * b)
        y = y + step / 6.0 * (a + 2.0 * b + 2.0 * c + rate(y + step * c))
        found[k] = y
    for count in (70, 140):
        _, _, _, end = after(between, count)
        height, speed = (float(field[-1, 1]) for field in (end.particles.position, end.particles.velocity))
        assert height - start == pytest.approx(found[10 * count][0] - start, rel=0.01)
        assert speed == pytest.approx(found[10 * count][1], rel=0.02)
    assert found[1400][0] < level - 0.02  # it is through, and the liquid has slowed it down
    assert abs(found[1400][1]) < 0.8 * abs(min(v for _, v in found.values()))


def test_momentum_of_three_phases_is_kept():
    """Grains that fill a third of their cells shoot through the surface of a periodic box and stir it up."""
    grains = [(0.012, 0.02), (0.03, 0.045), (0.02, 0.07), (0.05, 0.1)]
    periodic = {side: {"kind": "periodic"} for side in ("left", "right", "bottom", "top")}
    scene = tables(
        grains, 0.055, 2500.0, 4e-3, domain={"size": SIZE, "depth": 0.01, "gravity": [0.0, 0.0]}, boundary=periodic,
        fluid={"viscosity": 3e-4}, surface={"viscosity": 1e-2},
    )  # fmt: skip
    speeds = jnp.asarray([[0.3, 0.5], [-0.2, 0.4], [0.1, -0.6], [0.2, 0.5]])

    def shot(state):
        return state._replace(particles=state.particles._replace(velocity=speeds))

    simulation, parameters, start, end = after(scene, 60, shot)
    before, later = (momentum(simulation, parameters, state) for state in (start, end))
    size = float(jnp.sum(parameters.mixture.bodies.mass * jnp.abs(speeds)))
    assert np.abs(later[1] - before[1]).max() > 0.05 * size
    np.testing.assert_allclose(sum(later), sum(before), atol=2e-13 * size)
    assert liquid(simulation, end) == pytest.approx(liquid(simulation, start), rel=1e-13)
    moved = np.abs(np.asarray(end.fluid.liquid_fraction - start.fluid.liquid_fraction))
    assert moved.max() > 0.1


TENSION = 0.05


def drop():
    """Grains as dense as the liquid across the surface of a drop in a periodic box without gravity."""
    periodic = {side: {"kind": "periodic"} for side in ("left", "right", "bottom", "top")}
    ball = {"shape": "sphere", "center": [0.03, 0.06], "radius": 0.02}
    grains = [(0.03 + 0.02 * np.cos(t), 0.06 + 0.02 * np.sin(t)) for t in (0.3, 1.5, 2.8, 5.0)]
    scene = tables(
        grains, 0.0, 1000.0, 3e-3, domain={"size": SIZE, "depth": 0.01, "gravity": [0.0, 0.0]}, boundary=periodic,
        fluid={"cells": [12, 24], "viscosity": 1e-4},
        surface={"tension": TENSION, "density": 100.0, "viscosity": 1e-3, "regions": [ball]},
    )  # fmt: skip
    del scene["surface"]["level"]
    return scene


@COMBINATION
def test_grains_in_the_surface_of_a_drop_are_not_pushed_out():
    """They take the tension as they take the jump of the pressure: at rest the sum is zero, where the jump alone would
    give them sigma kappa grad c over their density in every second."""
    simulation, parameters, start, _ = after(drop(), 1)
    solver, flow = simulation.fluid.solver, parameters.flow
    seen = max(float(jnp.abs(s).max()) for s in solver.slope_at_particles(flow, start.fluid))
    jump = max(float(jnp.abs(s).max()) for s in FluidSolver.slope_at_particles(solver, flow, start.fluid))
    assert jump == pytest.approx(TENSION / 0.02 / 0.005, rel=0.35)  # of sigma / R over a cell or two
    assert seen < 0.05 * jump
    end = after(drop(), 20)[3]
    assert float(jnp.abs(end.particles.velocity).max()) < 0.05 * jump / 1000.0 * 0.02


@COMBINATION
def test_momentum_with_tension_changes_by_the_tension_alone():
    """Step by step, of all three phases, by the sum of sigma kappa grad c over the faces and nothing by the grains."""
    speeds = jnp.asarray([[0.1, 0.05], [-0.05, 0.1], [0.1, -0.1], [0.02, 0.1]])
    scene = jaxdem.load_scene(drop())
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    state = state._replace(particles=state.particles._replace(velocity=speeds))
    grid, size = simulation.fluid.solver.grid, float(jnp.sum(parameters.mixture.bodies.mass * jnp.abs(speeds)))
    given, first = 0.0, sum(momentum(simulation, parameters, state))
    for _ in range(12):
        state, _ = march(simulation, parameters, state, neighbors, 1)
        pull = surface_tension_gradient(grid, state.fluid.liquid_fraction, TENSION)
        given = given + 1e-3 * grid.cell_volume * np.asarray(jnp.stack(face_total(grid, pull)))
    last = sum(momentum(simulation, parameters, state))
    np.testing.assert_allclose(last - first, given, atol=1e-12 * size)
    share = 1e-3 * float(parameters.mixture.bodies.volume) * TENSION / 0.02 / 0.005
    assert share > 1e-6 * size  # of one grain in a step: without it the sums would be apart by this


@pytest.mark.parametrize("level", (0.0647, 0.0055))
def test_grains_at_rest_under_a_lake_stay_at_rest(level):
    """A layer on the floor, held by its contacts: below a still lake, and with the surface within the layer.

    What its start leaves dies out to rounding. With a surface on the faces of cells it does not: specks of 1e-8 of a
    cell go round above it, at 1e-8 m/s.
    """
    _, _, start, end = after(layer_under_a_lake(level), 1600)
    velocity = max(float(jnp.abs(u).max()) for u in end.fluid.face_velocity)
    assert velocity < 1e-12
    assert float(jnp.abs(end.particles.velocity).max()) < 1e-12
    assert float(start.fluid.void_fraction.min()) < 0.85
    weight = float(jnp.abs(end.particles.contact_force[:, 1]).min())
    assert weight > 1e-3  # they stand on the floor


def test_grains_that_sink_raise_the_level():
    """By their volume over the area: what they displace has nowhere else to go."""
    grains = [(x, 0.075) for x in (0.01, 0.025, 0.04, 0.053)]
    scene = tables(grains, 0.06, 2500.0, 4e-3, domain={"size": SIZE, "depth": 0.01}, fluid={"viscosity": 1e-3})
    simulation, parameters, start, end = after(scene, 900)
    assert float(end.particles.position[:, 1].max()) < 0.03
    fraction = np.asarray(end.fluid.liquid_fraction)
    assert liquid(simulation, end) == pytest.approx(liquid(simulation, start), rel=1e-13)
    solids = 4 * float(parameters.mixture.bodies.volume)
    level = fraction.sum(axis=1).mean() * SIZE[1] / CELLS[1]
    assert level - 0.06 == pytest.approx(solids / (SIZE[0] * 0.01), rel=1e-3)


def test_steps_are_told_apart_by_their_number_in_long_runs():
    """Beyond 2^24 of them a time in float32 knows every other step, and the order of the axes would stay the same."""
    one = jnp.ones((), jnp.float32)
    second, step = SecondFluid(one, one, one, one), jnp.asarray(1e-3, jnp.float32)
    numbers = np.arange(2**24 + 1, 2**24 + 5)
    by_time = [int(second.number_at(jnp.asarray(n * 1e-3, jnp.float32), step)) for n in numbers]
    assert len(set(by_time)) < 4
    begun = second._replace(number=jnp.asarray(2**23, jnp.int32))
    found = [int(begun.in_step(jnp.asarray(k), jnp.asarray(2)).number_at(one, step)) for k in range(2)]
    assert found == [2**24, 2**24 + 1]
    early = second.number_at(jnp.asarray(0.021, jnp.float32), step)
    assert int(early) == 21 == int(begun._replace(number=jnp.asarray(21)).number_at(one, step))


@COMBINATION
def test_liquid_sinks_into_a_dry_bed():
    """Cells full of grains that hold gas: liquid let go above them fills the pores, within bounds and without loss."""
    simulation, _, start, end = after(dry_bed_and_a_column(), 700)
    assert float(start.fluid.void_fraction.min()) < 0.5
    assert float(start.fluid.liquid_fraction[:, :3].max()) == 0.0
    fraction = np.asarray(end.fluid.liquid_fraction)
    assert fraction[:, 0].max() > 0.5
    assert fraction.min() > -1e-13 and fraction.max() < 1.0 + 1e-13
    assert liquid(simulation, end) == pytest.approx(liquid(simulation, start), rel=1e-13)


@pytest.mark.parametrize(
    "table, key, value",
    [
        ("coupling", "lift", ["magnus"]),
        ("coupling", "rotational_drag", True),
        ("coupling", "virtual_mass", 0.5),
        ("coupling", "basset", 5),
        ("coupling", "drag_inputs_coarsened", 2),
        ("output", "samples", 0.1),
        ("contact", "lubrication", {"cutoff": 2e-5, "roughness": 1e-6}),
    ],
)
def test_models_of_one_fluid_are_refused_by_name(table, key, value):
    name = f"{table}.{key}" + (".viscosity" if key == "lubrication" else "")
    scene = tables([(0.02, 0.03)], 0.06, **{table: {key: value}})
    with pytest.raises(InputError, match=name.replace(".", r"\.")):
        jaxdem.load_scene(scene)
    jaxdem.load_scene({name: part for name, part in scene.items() if name != "surface"})


def test_a_lubrication_of_a_given_viscosity_is_not_refused():
    gaps = {"lubrication": {"cutoff": 2e-5, "roughness": 1e-6, "viscosity": 1e-3}}
    assert jaxdem.load_scene(tables([(0.02, 0.03)], 0.06, contact=gaps)).surface is not None

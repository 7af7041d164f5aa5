"""Patches and ghosts: fractional faces, mirrors about the side's velocity, ramps."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem import build, load_scene
from jaxdem.errors import InputError
from jaxdem.fluid.advection import Upwind, VanLeer, advection
from jaxdem.fluid.boundary import (
    Boundary,
    Side,
    Sides,
    coverage,
    largest_inflow,
    momentum_excess,
    open_fraction,
    ramp,
    set_normal_velocity,
    velocity_at,
    with_ghosts,
    with_outflow,
)
from jaxdem.fluid.grid import Grid, divergence
from jaxdem.fluid.inlet import LinearTable, Parabola
from jaxdem.fluid.side_conditions import FreeSlip
from tests.cases.flows import random_faces
from tests.cases.tiers import COMBINATION


def box(cells, kinds, periodic=(False, False), velocity=None, **patch):
    grid = Grid(cells, (1.0, 1.0), 1.0, periodic)
    sides = tuple(Side(n // 2, bool(n % 2), kind, **(patch if n == 0 else {})) for n, kind in enumerate(kinds))
    velocity = (np.zeros(2),) * 4 if velocity is None else velocity
    return grid, Boundary(sides), tuple(jnp.asarray(v) for v in velocity)


WALLS = ("no_slip",) * 4


@pytest.mark.parametrize("count", [4, 7, 8, 16, 33])
def test_patch_covers_the_same_length_on_every_mesh(count):
    grid, boundary, _ = box((3, count), ("inlet", *WALLS[1:]), start=(0.13,), stop=(0.555,))
    covered = coverage(grid, boundary.sides[0])
    assert covered.shape == (1, count)
    assert covered.sum() * grid.spacing[1] == pytest.approx(0.425, rel=1e-14)
    assert covered.min() >= 0.0 and covered.max() <= 1.0
    # On the faces of the tangential velocity, too, whose control volumes are half ones at the ends.
    tangential = coverage(grid, boundary.sides[0], staggered=1)
    lengths = np.r_[0.5, np.ones(count - 1), 0.5] * grid.spacing[1]
    assert (tangential * lengths).sum() == pytest.approx(0.425, rel=1e-14)


def test_inflow_is_that_of_the_patch_over_the_void_fraction():
    """Superficial velocity in: g u summed over the faces is patch length times speed, with any void fraction."""
    velocity = (np.array([0.4, 0.0]), *(np.zeros(2),) * 3)
    grid, boundary, speeds = box((3, 7), ("inlet", *WALLS[1:]), velocity=velocity, start=(0.2,), stop=(0.9,))
    g = tuple(jnp.asarray(np.random.default_rng(0).uniform(0.4, 1.0, grid.face_shape(a))) for a in range(2))
    faces = tuple(jnp.ones(grid.face_shape(a)) for a in range(2))
    u, w = set_normal_velocity(grid, Sides(boundary, speeds, jnp.asarray(1.0)), faces, g)
    assert float(jnp.sum((g[0] * u)[0])) * grid.spacing[1] == pytest.approx(0.28, rel=1e-14)
    for wall in (u[-1], w[:, 0], w[:, -1]):
        assert not np.any(wall)


def test_faces_of_an_outlet_keep_their_momentum_whether_fluid_leaves_or_comes_in():
    """On its patch; the rest of the side is a wall."""
    kinds = ("outlet", "no_slip", "no_slip", "no_slip")
    grid, boundary, speeds = box((3, 4), kinds, start=(0.0,), stop=(0.75,))
    own = np.array([0.5, -0.3, 0.0, 2.0])
    faces = (jnp.asarray(np.tile(np.arange(4.0)[:, None], (1, 4))).at[0].set(own), jnp.zeros((3, 5)))
    u, _ = set_normal_velocity(grid, Sides(boundary, speeds, jnp.asarray(0.0)), faces, (1.0, 1.0))
    np.testing.assert_array_equal(u[0], [0.5, -0.3, 0.0, 0.0])


def test_more_outflow_is_spread_evenly_over_all_outlets():
    """Cells of 1/3 by 1/4, open on three of four faces at the left and on all three at the top."""
    kinds = ("outlet", "no_slip", "no_slip", "outlet")
    grid, boundary, _ = box((3, 4), kinds, start=(0.0,), stop=(0.75,))
    flux = tuple(map(jnp.asarray, random_faces(grid)))
    more = with_outflow(grid, boundary, flux, jnp.asarray(0.7))
    speed = 0.7 / (0.75 + 1.0)
    np.testing.assert_allclose((more[0] - flux[0])[0], [-speed, -speed, -speed, 0.0], rtol=1e-12)
    np.testing.assert_allclose((more[1] - flux[1])[:, -1], speed, rtol=1e-12)
    change = divergence(grid, more) - divergence(grid, flux)
    assert float(jnp.mean(change)) == pytest.approx(0.7, rel=1e-12)


@pytest.mark.parametrize("upper", [False, True])
def test_what_an_outlet_draws_in_brings_half_of_its_momentum(upper):
    """Out by one half of an outlet and in by the other at 2 m/s, with 3 m/s along the side: what passes a surface of a
    control volume is the flux times the velocity, and half of that where it comes in by the side."""
    kinds = ("no_slip", "outlet") if upper else ("outlet", "no_slip")
    grid, boundary, speeds = box((3, 4), (*kinds, "free_slip", "free_slip"))
    out = 2.0 if upper else -2.0
    normal = jnp.broadcast_to(jnp.asarray([out, out, -out, -out]), (4, 4))
    along, still = jnp.full((3, 5), 3.0), jnp.zeros((3, 5))
    rate = advection(grid, Sides(boundary, speeds, jnp.asarray(0.0)), Upwind(), (normal, still), (normal, along))
    end = -1 if upper else 0
    # The face stands for half a cell, 1/6 m; each second 2 * 2 goes on into the box and 2 * 2 / 2 comes in, outwards
    # positive.
    missing = (4.0 - 2.0) * 6.0
    np.testing.assert_allclose(rate[0][end], np.array([0.0, 0.0, missing, missing]) * (out / 2.0), atol=1e-12)
    # A tangential velocity has a whole cell, 1/3 m: 2 * 3 goes on and 2 * 3 / 2 comes in.
    np.testing.assert_allclose(rate[1][end], [0.0, 0.0, 0.0, -9.0, -9.0], atol=1e-12)


def test_half_covered_faces_decide_for_an_outlet():
    grid, boundary, _ = box((3, 4), ("outlet", *WALLS[1:]), start=(0.0,), stop=(0.6,))
    np.testing.assert_array_equal(open_fraction(grid, boundary.sides[0])[0], [1.0, 1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("kind", "below"),
    [("no_slip", -1.0), ("free_slip", 1.0), ("outlet", 1.0), ("moving_wall", 2 * 0.7 - 1.0)],
)
def test_ghosts_of_a_tangential_velocity(kind, below):
    """Mirrored about the side's velocity at walls, even at free slip and outlets."""
    velocity = (np.zeros(2), np.zeros(2), np.array([0.7 * (kind == "moving_wall"), 0.0]), np.zeros(2))
    grid, boundary, speeds = box((3, 4), ("no_slip", "no_slip", kind, "no_slip"), velocity=velocity)
    padded = with_ghosts(grid, Sides(boundary, speeds, jnp.asarray(0.0)), jnp.ones((4, 4)), 0, 1)
    np.testing.assert_allclose(padded[:, 0], below, atol=1e-15)
    np.testing.assert_allclose(padded[:, 1], below, atol=1e-15)
    np.testing.assert_allclose(padded[:, -1], -1.0, atol=1e-15)


def test_ghosts_of_a_periodic_axis_repeat_it():
    grid, boundary, speeds = box((3, 4), ("no_slip", "no_slip", "periodic", "periodic"), (False, True))
    u = jnp.arange(16.0).reshape(4, 4)
    padded = with_ghosts(grid, Sides(boundary, speeds, jnp.asarray(0.0)), u, 0, 1)
    np.testing.assert_array_equal(padded, np.pad(u, ((0, 0), (2, 2)), mode="wrap"))
    w = jnp.arange(12.0).reshape(3, 4)
    w = jnp.concatenate((w, w[:, :1]), axis=1)
    padded = with_ghosts(grid, Sides(boundary, speeds, jnp.asarray(0.0)), w, 1, 1)
    np.testing.assert_array_equal(padded[:, :-1], np.pad(w[:, :-1], ((0, 0), (2, 2)), mode="wrap"))
    np.testing.assert_array_equal(padded[:, -3:], w[:, :3])


def test_ramp_is_linear_and_ends():
    seen = [float(ramp(0.05, jnp.asarray(t))) for t in (-1.0, 0.0, 0.01, 0.05, 9.0)]
    np.testing.assert_allclose(seen, [0.0, 0.0, 0.2, 1.0, 1.0], atol=1e-15)
    assert float(ramp(0.0, jnp.asarray(0.0))) == 1.0


TABLE = LinearTable((0.0, 0.2, 0.3, 1.0), (1.0, -0.5, 2.0, 0.25))
PROFILES = {
    "parabola": (Parabola(), lambda z: 6.0 * (z - 0.13) * (0.555 - z) / 0.425**2, 0.425),
    # Trapezia of the table's parts in the patch, by hand: ends at z = 0.13 and z = 0.555.
    "table": (
        TABLE,
        lambda z: np.interp(z, TABLE.positions, TABLE.values),
        0.07 * (0.025 - 0.5) / 2 + 0.1 * 1.5 / 2 + 0.255 * (2.0 + 2.0 - 1.75 * 0.255 / 0.7) / 2,
    ),
}


@pytest.mark.parametrize("name", PROFILES)
@pytest.mark.parametrize("count", [1, 4, 7, 33])
def test_profile_means_are_exact_on_every_mesh(name, count):
    """Face means against a midpoint sum of a million points; their sum is the integral, to round-off."""
    profile, function, integral = PROFILES[name]
    grid, boundary, _ = box((3, count), ("inlet", *WALLS[1:]), start=(0.13,), stop=(0.555,), profile=(profile,))
    mean = coverage(grid, boundary.sides[0])
    assert mean.sum() * grid.spacing[1] == pytest.approx(integral, rel=1e-14)
    z = (np.arange(count * 30_000) + 0.5) / (count * 30_000)
    fine = np.where((z > 0.13) & (z < 0.555), function(z), 0.0).reshape(count, -1).mean(axis=1)
    # A point of the sum that the patch cuts through counts as a whole.
    np.testing.assert_allclose(mean[0], fine, atol=1e-4)
    half = coverage(grid, boundary.sides[0], staggered=1)[0]
    assert (half * np.r_[0.5, np.ones(count - 1), 0.5]).sum() * grid.spacing[1] == pytest.approx(integral, rel=1e-13)


def test_profile_over_the_whole_side_and_along_one_axis_of_a_layer():
    grid = Grid((2, 3, 4), (1.0, 0.3, 0.8), 1.0, (False, False, False))
    mean = coverage(grid, Side(0, False, "inlet", profile=(None, Parabola())))
    s = np.arange(5) / 4
    np.testing.assert_allclose(mean, np.tile(4 * np.diff(3 * s**2 - 2 * s**3), (1, 3, 1)), rtol=1e-14)


def test_velocity_follows_its_table():
    """Linear between the times, held outside of them, component by component; the ramp multiplies it."""
    side = Side(0, False, "inlet", times=(0.1, 0.2, 0.4))
    velocity = jnp.asarray([[1.0, 0.0], [3.0, -1.0], [-2.0, 0.5]])
    for time, expected in (
        (0.0, [1.0, 0.0]),
        (0.1, [1.0, 0.0]),
        (0.15, [2.0, -0.5]),
        (0.2, [3.0, -1.0]),
        (0.25, [1.75, -0.625]),
        (0.4, [-2.0, 0.5]),
        (7.0, [-2.0, 0.5]),
    ):
        np.testing.assert_allclose(velocity_at(side, velocity, jnp.asarray(time)), expected, atol=1e-14)
    slow = dataclasses.replace(side, ramp_time=0.3)
    np.testing.assert_allclose(velocity_at(slow, velocity, jnp.asarray(0.15)), [1.0, -0.25], atol=1e-14)


def test_largest_inflow_of_an_interval():
    """At its ends, at the times in between, and the profile's peak on top."""
    side = Side(0, False, "inlet", times=(0.1, 0.2, 0.4))
    velocity = jnp.asarray([[1.0, 0.0], [3.0, 9.0], [-2.0, 0.0]])
    for start, stop, expected in (
        (0.0, 0.05, 1.0),
        (0.12, 0.15, 2.0),
        (0.15, 0.3, 3.0),
        (0.3, 0.4, 2.0),
        (0.5, 0.6, 2.0),
    ):
        found = largest_inflow(side, velocity, jnp.asarray(start), jnp.asarray(stop))
        assert float(found) == pytest.approx(expected, rel=1e-14)
        shaped = dataclasses.replace(side, profile=(Parabola(), None))
        found = largest_inflow(shaped, velocity, jnp.asarray(start), jnp.asarray(stop))
        assert float(found) == pytest.approx(1.5 * expected, rel=1e-14)
    steady = Side(1, True, "inlet", ramp_time=0.1, profile=(LinearTable((0.0, 1.0), (0.5, -4.0)),))
    assert float(largest_inflow(steady, jnp.asarray([5.0, -3.0]), jnp.asarray(0.0), jnp.asarray(0.1))) == 12.0


def test_limiter_is_zero_at_extrema_exact_on_lines_and_bounded():
    """Van Leer's slope: harmonic mean, never more than twice the smaller difference; upwind none at all."""
    a = jnp.asarray([1.0, 1.0, 1.0, -2.0, 0.0, 0.0, 1.0])
    b = jnp.asarray([1.0, -1.0, 3.0, -6.0, 0.0, 5.0, 1e9])
    np.testing.assert_allclose(VanLeer().slope(a, b), [1.0, 0.0, 1.5, -3.0, 0.0, 0.0, 2.0], rtol=1e-8)
    np.testing.assert_allclose(VanLeer().to_surfaces(a, b), [0.5 * VanLeer().slope(a, b)] * 2)
    assert not np.any(Upwind().to_surfaces(a, b))


@pytest.mark.parametrize("cells", [(4, 5), pytest.param((3, 4, 7), marks=COMBINATION)], ids=["2-D", "3-D"])
@pytest.mark.parametrize("upper", [False, True])
def test_an_inlet_brings_the_momentum_of_its_patch_on_any_mesh(cells, upper):
    """What comes in by the surfaces next to the inlet is speed^2 times its area, also where the patch ends within
    faces."""
    others = len(cells) - 1
    grid = Grid(cells, (1.0,) * len(cells), 1.0, (False,) * len(cells))
    inlet = Side(0, upper, "inlet", (0.13,) * others, (0.81,) * others)
    outlet = Side(0, not upper, "outlet")
    walls = (Side(n // 2, bool(n % 2), "no_slip") for n in range(2, 2 * len(cells)))
    boundary = Boundary((outlet, inlet, *walls) if upper else (inlet, outlet, *walls))
    # Columns of fluid that go straight on: the squares of their velocities leave as they come, the excess is left over.
    direction = -1.0 if upper else 1.0
    through = np.broadcast_to(3.0 * direction * coverage(grid, inlet), grid.face_shape(0))
    still = tuple(jnp.zeros(grid.face_shape(axis)) for axis in range(1, len(cells)))
    faces = (jnp.asarray(through), *still)
    nothing = tuple(jnp.zeros(len(cells)) for _ in boundary.sides)
    rates = jax.jit(lambda u: advection(grid, Sides(boundary, nothing, jnp.asarray(0.0)), VanLeer(), u, u))
    rate = np.asarray(rates(faces)[0])
    area = grid.cell_volume / grid.spacing[0]
    brought = np.sum(rate[1:-1]) * grid.cell_volume + direction * np.sum(through[0] ** 2) * area
    assert brought == pytest.approx(direction * 9.0 * 0.68**others, rel=1e-12)
    sucked = np.asarray(rates(tuple(-u for u in faces))[0])
    # Where it sucks nothing is known of how the flow narrows to the patch.
    np.testing.assert_allclose(sucked[1:-1], 0.0, atol=1e-12)


def test_only_inlets_that_end_within_faces_have_more_momentum_than_their_mean():
    """On faces whole, empty, or off by rounding alone there is none, and no program for it; a profile has no part in
    it."""
    grid = Grid((4, 5), (1.0, 1.0), 1.0, (False, False))
    cut = Side(0, False, "inlet", (0.2,), (0.5,))
    for side in (cut, dataclasses.replace(cut, profile=(Parabola(),))):
        np.testing.assert_allclose(momentum_excess(grid, side), [[0.0, 0.0, 1.0, 0.0, 0.0]], atol=1e-12)
    for side in (
        Side(0, False, "inlet"),
        dataclasses.replace(cut, stop=(0.6,)),
        dataclasses.replace(cut, kind="moving_wall"),
    ):
        assert momentum_excess(grid, side) is None


@pytest.mark.parametrize(("side", "key"), [("left", "side_conditions"), ("bottom", "boundary.bottom.from")])
def test_a_condition_of_ones_own_needs_a_whole_side(side, key):
    boundary = {"left": {"kind": "periodic"}, "right": {"kind": "periodic"}}
    boundary["bottom"] = {"kind": "free_slip", "from": 0.0, "to": 0.1}
    tables = {"domain": {"size": [0.2, 0.2]}, "fluid": {"cells": [4, 4]}, "boundary": boundary}
    scene = load_scene(tables | {"time": {"end": 0.1, "output_interval": 0.1}})
    with pytest.raises(InputError) as caught:
        build(scene, side_conditions={side: FreeSlip()})
    assert caught.value.key == key

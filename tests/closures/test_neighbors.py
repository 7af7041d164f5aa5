"""The closure of neighbours: its symmetries, its limits, its slopes."""

import ctypes
import dataclasses
import shutil
import subprocess
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import onnxruntime
import pytest
from jax import export

from jaxdem.closures import DragInputs, NeighborClosure, load_closure, save_closure
from jaxdem.closures.export import export_closure
from jaxdem.closures.export_neighbors_onnx import OF_SPHERES
from jaxdem.closures.moments import MomentBasis, angular_functions, carried_moments, moments, radial_functions
from jaxdem.closures.neighbor_effect import neighbor_effect
from jaxdem.closures.neighbor_level import Width
from jaxdem.closures.neighbor_places import SLOTS_AT_ONCE, Places, axes_along, fluctuation
from jaxdem.closures.neighbor_range import FADING, REYNOLDS, SOLID_FRACTION, conditions, range_weight
from jaxdem.closures.neighbors import SMALLEST_MULTIPLE, positive_multiple
from jaxdem.train.sphere_moments import group_moments, predicted, with_carried
from jaxdem.train.spheres import SphereGroup

BASIS, CARRIED = MomentBasis(2.5, 4, 4, 3), MomentBasis(2.2, 3, 3, 2)
SPHERES, NEIGHBORS = 5, 7
SCENES = Path(__file__).parents[2] / "scenes"
COMPILER = shutil.which("cc")
MEAN = 0.01
"""Part of the mean drag by which the mean over homogeneous arrays may differ."""


@pytest.fixture(scope="module")
def closure():
    """Random weights, larger than those of a trained one, so that nothing is small by chance."""
    found = NeighborClosure.initial(BASIS, CARRIED, [Width(5, 3, (8,)), Width(4, 3, (8,))], seed=1)
    levels = tuple(dataclasses.replace(level, direct=level.direct + 0.1) for level in found.levels)
    return dataclasses.replace(found, levels=levels, mean=jnp.linspace(-0.1, 0.1, 8))


@pytest.fixture(scope="module")
def wakes():
    """The same with moments that are stretched along the slip."""
    wake = MomentBasis(1.5, 3, 2, 1, stretch=3.0, decay=6)
    found = NeighborClosure.initial(BASIS, CARRIED, [Width(5, 3, (8,)), Width(4, 3, (8,))], seed=1, wake=wake)
    return dataclasses.replace(found, mean=jnp.linspace(-0.1, 0.1, 8))


fluctuation = jax.jit(fluctuation, static_argnames="at_once")
neighbor_effect = jax.jit(neighbor_effect, static_argnums=1)
moments = jax.jit(moments, static_argnums=0)
"""Compiled as a whole: by single operations they are hundreds of programs."""


@jax.jit
def response(closure, offset, reynolds=10.0, solid_fraction=0.2, carried=None):
    """Force and torque (N, 3) of spheres with neighbours at (N, K, 3) diameters, NaN for none; the weight.

    The neighbours carry the vectors (N, K, 3), by default their own places.
    """
    present = jnp.isfinite(offset[..., 0])
    vector = jnp.where(present[..., None], offset, 0.0) if carried is None else carried
    place, vector = (tuple(jnp.moveaxis(rows, 2, 0)) for rows in (offset, vector))
    sums = moments(closure.basis, place, present)
    zero, one = carried_moments(closure.carried, place, present, vector)
    both = (jnp.concatenate([sums[0], zero], axis=2), jnp.concatenate([sums[1], one], axis=2), *sums[2:])
    flow = [jnp.full(len(offset), value, offset.dtype) for value in (reynolds, solid_fraction)]
    level = closure.levels[1]
    found = closure.response(level.values(level.mixed(both), conditions(*flow)), sums[0][:, 0, 0], *flow)
    return jnp.concatenate([found.along[:, None], found.across], axis=1), found.torque, found.weight


@pytest.fixture(scope="module")
def offset():
    """Neighbours between contact and beyond the reach; one slot is empty."""
    generator = np.random.default_rng(2)
    direction = generator.normal(size=(SPHERES, NEIGHBORS, 3))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    placed = direction * generator.uniform(1.0, 2.8, (SPHERES, NEIGHBORS, 1))
    placed[:, -1] = np.nan
    return jnp.asarray(placed)


def test_functions_of_the_direction_are_orthonormal():
    """Mean of Y_lm Y_kn over the sphere is one for equal ones, and zero else: by the rule of Gauss and the trapezoidal
    rule, which are exact for these polynomials."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    angle = 2 * np.pi * np.arange(16) / 16
    x, f = (a.ravel() for a in np.meshgrid(nodes, angle, indexing="ij"))
    sine = np.sqrt(1 - x**2)
    share = np.repeat(weights, 16) / 32
    functions = angular_functions(BASIS, (jnp.asarray(x), jnp.asarray(sine * np.cos(f)), jnp.asarray(sine * np.sin(f))))
    parts = [part for m, pairs in enumerate(functions) for pair in pairs for part in pair[: 1 + (m > 0)]]
    values = np.stack([np.asarray(part) for part in parts])
    product = (values * share) @ values.T
    np.testing.assert_allclose(product, np.eye(len(values)), atol=1e-12)


def test_functions_of_the_distance_end_with_slope_zero():
    for order in (0, 1):
        function = lambda r: radial_functions(BASIS, r)  # noqa: E731
        for _ in range(order):
            function = jax.jacfwd(function)
        np.testing.assert_allclose(function(jnp.asarray(BASIS.reach)), 0.0, atol=1e-12)
        assert np.abs(function(jnp.asarray(1.2))).min() > 1e-3


def test_turning_and_mirroring_the_neighbours_about_the_slip(closure, offset):
    force, torque, _ = response(closure, offset)
    assert np.abs(force).min() > 1e-5 and np.abs(torque).min() > 1e-8
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    turned = response(closure, offset @ turn.T)
    np.testing.assert_allclose(turned[0], force @ turn.T, atol=1e-10)
    np.testing.assert_allclose(turned[1], torque @ turn.T, atol=1e-10)
    mirror = np.diag([1.0, 1.0, -1.0])
    mirrored = response(closure, offset @ mirror)
    np.testing.assert_allclose(mirrored[0], force @ mirror, atol=1e-10)
    np.testing.assert_allclose(mirrored[1], -torque @ mirror, atol=1e-10)  # an axial vector
    swapped = response(closure, offset[:, ::-1])
    np.testing.assert_allclose(swapped[0], force, atol=1e-10)


def test_a_turn_in_single_precision(closure, offset):
    single = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), (closure, offset))
    force = response(*single)[0]
    assert force.dtype == jnp.float32
    turn = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], np.float32)
    np.testing.assert_allclose(response(single[0], single[1] @ turn.T)[0], force @ turn.T, atol=1e-6)


def test_nothing_without_neighbours_and_none_beyond_the_reach(closure, offset):
    nobody = response(closure, jnp.full_like(offset, jnp.nan))
    for part in nobody:
        np.testing.assert_array_equal(part, 0.0)
    far = offset.at[:, 0].set(jnp.asarray([BASIS.reach + 1e-9, 0.0, 0.0])[None])
    near = offset.at[:, 0].set(jnp.asarray([BASIS.reach - 1e-5, 0.0, 0.0])[None])
    gone = offset.at[:, 0].set(jnp.nan)
    np.testing.assert_array_equal(response(closure, far)[0], response(closure, gone)[0])
    # Value and slope are zero at the reach: the step is of the square of the distance to it.
    np.testing.assert_allclose(response(closure, near)[0], response(closure, gone)[0], atol=1e-8)


def test_slopes_are_those_of_differences(closure, offset):
    placed = offset.at[:, -1].set(jnp.asarray([1.0, 1.0, 1.0])[None])
    way = jnp.asarray(np.random.default_rng(3).normal(size=placed.shape))

    def total(place):
        force, torque, _ = response(closure, place)
        return jnp.sum(force * jnp.asarray([[1.0, 2.0, -1.0]])) + jnp.sum(torque * jnp.asarray([[1.0, -3.0, 2.0]]))

    slope = jnp.sum(jax.jit(jax.grad(total))(placed) * way)
    step = 1e-6
    difference = (total(placed + step * way) - total(placed - step * way)) / (2 * step)
    assert float(slope) == pytest.approx(float(difference), rel=1e-6)


def test_the_fluctuation_fades_beyond_the_data(closure, offset):
    for reynolds in (REYNOLDS[0], 10.0, REYNOLDS[1]):
        for solid_fraction in SOLID_FRACTION:
            assert float(range_weight(jnp.asarray(reynolds), jnp.asarray(solid_fraction))) == pytest.approx(1.0)
    (slowest, fastest), (thinnest, densest) = FADING
    for flow in ((slowest, 0.2), (fastest, 0.2), (10.0, thinnest), (10.0, densest), (0.0, 0.2), (10.0, 0.0)):
        assert float(range_weight(*map(jnp.asarray, flow))) == 0.0
        for part in response(closure, offset, *flow):
            np.testing.assert_array_equal(part, 0.0)
    half = float(np.sqrt(slowest * REYNOLDS[0]))
    assert float(range_weight(jnp.asarray(half), jnp.asarray(0.2))) == pytest.approx(0.5)


def test_the_multiple_of_the_drag_is_positive_and_smooth():
    values = jnp.linspace(-5.0, 3.0, 801)
    found, slopes = jax.vmap(jax.value_and_grad(positive_multiple))(values)
    assert float(found.min()) > 0.0
    np.testing.assert_array_equal(found[values >= SMALLEST_MULTIPLE], values[values >= SMALLEST_MULTIPLE])
    assert float(jnp.abs(jnp.diff(slopes)).max()) < 0.06  # 0.01 over 0.2 in a step: the slope does not jump


def test_a_file_gives_the_same_closure(closure, offset, tmp_path):
    path = tmp_path / "neighbours.closure.h5"
    save_closure(path, closure, {"recipe": "neighbours"})
    loaded, metadata = load_closure(path)
    assert metadata == {"recipe": "neighbours"}
    assert loaded.basis == BASIS and loaded.base == closure.base
    for found, given in zip(response(loaded, offset), response(closure, offset), strict=True):
        np.testing.assert_array_equal(found, given)


def test_the_exported_module_gives_the_same(closure, tmp_path):
    """Both levels and the mean law, for spheres of two slots among which one is alone, as StableHLO and as ONNX."""
    centres = np.array([[0.0, 0, 0], [1.1, 0.3, 0.2], [9.6, 0.1, -0.4], [5.0, 5.0, 5.0]], np.float32)
    others = np.array([[1, 2], [0, 1], [0, 2], [3, 3]], np.int32)
    slip = np.array([[1.0, 0.2, 0.1]] * 4, np.float32) * 0.01
    flow = (np.full(4, 0.2, np.float32), np.ones(4, np.float32), np.array([10.0, 0, 0], np.float32))
    arguments = (centres, others, slip, *flow, np.float32(1000.0), np.float32(1.0))
    path = tmp_path / "neighbours.bin"
    files = export_closure(closure, {}, "stablehlo", path, "0")
    assert [file.suffix for file in files] == [".bin", ".mlir"]
    found = export.deserialize(bytearray(path.read_bytes())).call(*arguments)
    given = jax.tree.map(jnp.asarray, arguments)
    none = jnp.zeros((4, 3), jnp.float32)
    inputs = DragInputs(none, given[2], given[3], none, none, given[4], given[4], given[6], given[7])
    frame = axes_along(given[2])
    response = fluctuation(closure, Places(*given[:2], *given[4:6]), frame, inputs.reynolds, given[3], at_once=3)
    effect = neighbor_effect(closure.base, "A", response, frame, inputs)
    law = closure.base(inputs)
    np.testing.assert_allclose(found[0], effect.multiple * law.coefficient, rtol=1e-5)
    # Single precision, added in another order: 2e-6 with the passes of XLA that users have, 1.2e-5 with those of tests.
    np.testing.assert_allclose(found[1], effect.across, atol=2e-5 * float(jnp.abs(effect.across).max()))
    np.testing.assert_allclose(found[2], effect.torque, atol=2e-5 * float(jnp.abs(effect.torque).max()))
    assert float(effect.multiple[3]) == 1.0 and np.abs(np.asarray(effect.multiple[:3]) - 1).min() > 1e-4
    assert not np.asarray(effect.across[3]).any()
    assert np.abs(np.asarray(effect.across[:3])).max() > 0  # neighbours across a periodic side count

    own, slot = np.nonzero(others != np.arange(4)[:, None])
    other = others[own, slot]
    offset = centres[other] - centres[own]
    offset[:, 0] -= 10.0 * np.round(offset[:, 0] / 10.0)
    export_closure(closure, {}, "onnx", path, "0")
    session = onnxruntime.InferenceSession(path.read_bytes(), providers=["CPUExecutionProvider"])
    spheres = (slip, *flow[:2], *(np.full(4, value, np.float32) for value in arguments[-2:]))
    rows = {"own": own, "other": other.astype(np.int64), "offset": offset}
    graph = session.run(None, dict(zip(OF_SPHERES, spheres, strict=True)) | rows)
    for one, same in zip(graph, map(np.asarray, found), strict=True):
        if same.dtype == bool:
            np.testing.assert_array_equal(one, same)
        else:  # the logistic function of onnxruntime has an error of 1e-6 itself
            np.testing.assert_allclose(one, same, atol=5e-5 * np.abs(same).max())


WRAPPERS = """
void add(const float *o, float *s) { spheres_add(o, s); }
void force(const float *s, float re, float phi, float *f) { spheres_force(s, re, phi, f); }
void carry(const float *o, const float *f, float *c) { spheres_carry(o, f, c); }
void response(const float *s, const float *c, float re, float phi, float *r) { spheres_response(s, c, re, phi, r); }
"""


@pytest.mark.skipif(COMPILER is None, reason="no C compiler (cc) on this machine")
def test_the_exported_c_gives_the_same(wakes, tmp_path):
    """Both levels and the stretched moments, step by step as the header says, for spheres with slips of their own."""
    header = tmp_path / "spheres.h"
    assert export_closure(wakes, {"recipe": "neighbours"}, "c", header, "0") == (header,)
    (tmp_path / "all.c").write_text(f'#include "spheres.h"\n{WRAPPERS}')
    options = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-Wno-missing-prototypes", "-shared", "-fPIC"]
    subprocess.run([COMPILER, *options, "all.c", "-o", "all.so", "-lm"], cwd=tmp_path, check=True)
    code = ctypes.CDLL(tmp_path / "all.so")
    sizes = {
        line.split()[1]: int(line.split()[2]) for line in header.read_text().splitlines() if "#define spheres_" in line
    }
    generator = np.random.default_rng(5)
    count, lattice = 8, np.stack(np.meshgrid([0.0, 1.2], [0.0, 1.2], [0.0, 1.2]), axis=-1).reshape(-1, 3)
    centres = (lattice + generator.uniform(-0.1, 0.1, (count, 3))).astype(np.float32)
    slip = (np.array([1.0, 0.2, 0.1]) + 0.3 * generator.normal(size=(count, 3))).astype(np.float32)
    others = np.array([[j for j in range(count) if j != i] for i in range(count)], np.int32)
    flow = (np.float32(7.0), np.float32(0.23))
    frame = axes_along(jnp.asarray(slip))
    axes = np.stack([np.asarray(axis) for axis in frame], axis=1)
    given = Places(jnp.asarray(centres), jnp.asarray(others), jnp.float32(1.0), jnp.zeros(3, jnp.float32))
    flows = [jnp.full(count, value) for value in flow]
    expected = fluctuation(wakes, given, frame, *flows)

    def pointer(array):
        return array.ctypes.data_as(ctypes.POINTER(ctypes.c_float))

    def called(name, size, *arguments):
        found = np.zeros(size, np.float32)
        getattr(code, name)(*arguments, pointer(found))
        return found

    reals = [ctypes.c_float(value) for value in flow]
    sums, handed = np.zeros((count, sizes["spheres_SUMS"]), np.float32), []
    for i in range(count):
        for j in others[i]:
            place = np.ascontiguousarray(axes[i] @ (centres[j] - centres[i]))
            sums[i] += called("add", sums.shape[1], pointer(place))
        handed.append(axes[i].T @ called("force", 3, pointer(sums[i]), *reals))
    for i in range(count):
        carried = np.zeros(sizes["spheres_CARRIED"], np.float32)
        for j in others[i]:
            place = np.ascontiguousarray(axes[i] @ (centres[j] - centres[i]))
            vector = np.ascontiguousarray((axes[i] @ handed[j]).astype(np.float32))
            code.carry(pointer(place), pointer(vector), pointer(carried))
        found = called("response", 7, pointer(sums[i]), pointer(carried), *reals)
        wanted = np.concatenate([np.ravel(part[i]) for part in expected])
        np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-6 * np.abs(wanted).max())
    assert min(float(jnp.abs(part).max()) for part in expected) > 1e-3


def random_group(side, count=9):
    """One periodic array without forces, its spheres in a cube at a corner."""
    position = np.random.default_rng(6).uniform(0.0, 5.0, (count, 3)).astype(np.float32)
    none, box = np.zeros_like(position), np.full((1, 3), side, np.float32)
    return SphereGroup("", 7.0, 0.23, np.array([0, count]), position, none, none, box)


def test_the_solver_gives_what_the_training_saw(wakes):
    """Spheres of a periodic array: all pairs at once in the training; a few spheres after the others and their slots in
    blocks, of which most are empty, in the solver."""
    group = random_group(9.2)
    values = with_carried(wakes, group, group_moments(wakes.basis, group, wakes.wake))
    expected = predicted(wakes, group, values)
    count, slots = len(group.position), 2 * SLOTS_AT_ONCE + 5
    others = np.tile(np.arange(count, dtype=np.int32)[:, None], (1, slots))
    for i in range(count):
        # In the first block and in the last one.
        others[i, [0, 1, 2, 3, *range(slots - count + 5, slots)]] = [j for j in range(count) if j != i]
    places = Places(jnp.asarray(group.position), jnp.asarray(others), jnp.float32(1.0), jnp.asarray(group.box[0]))
    frame = tuple(jnp.broadcast_to(axis[None], (count, 3)) for axis in jnp.eye(3, dtype=jnp.float32))
    flow = [jnp.full(count, value, jnp.float32) for value in (7.0, 0.23)]
    for at_once in (4, None):
        found = fluctuation(wakes, places, frame, *flow, at_once)
        for part, wanted in zip(found, expected, strict=False):
            np.testing.assert_allclose(part, wanted, atol=5e-6 * np.abs(wanted).max())
    assert np.abs(expected.along).max() > 1e-3


def test_wakes_in_the_data_reach_beyond_half_of_the_box(wakes):
    """Moments of a stretched basis are sums over the images up and down the stream too."""
    group = random_group(wakes.half_box * 2.0)
    found = group_moments(wakes.basis, group, wakes.wake)
    shifts = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]) * group.box[0]
    apart = group.position[None, :, None] - group.position[:, None, None] + shifts[None, None]
    count = len(group.position)
    present = np.repeat(~np.eye(count, dtype=bool)[:, :, None], 27, axis=2).reshape(count, -1)
    offset = tuple(jnp.asarray(part.reshape(count, -1)) for part in np.moveaxis(apart, 3, 0))
    wanted = moments(wakes.wake, offset, jnp.asarray(present))
    for order, part in enumerate(wanted):
        size = part.shape[2]
        np.testing.assert_allclose(found[order][:, :, -size:], part, atol=2e-5 * float(jnp.abs(part).max()))
    # Without the images of what is nearest the sums are others.
    near = jnp.asarray(present) & (jnp.abs(offset[0]) < wakes.half_box)
    assert float(jnp.abs(moments(wakes.wake, offset, near)[0] - wanted[0]).max()) > 0.01


def placed_at_random(solid_fraction, side=9.0, arrays=12):
    """Arrays of spheres that do not overlap, one after the other."""
    generator, count = np.random.default_rng(11), round(solid_fraction * side**3 / (np.pi / 6))
    found = np.zeros((arrays, count, 3), np.float32)
    for array in found:
        placed = 0
        while placed < count:
            tried = generator.uniform(0, side, 3)
            apart = array[:placed] - tried
            apart -= side * np.round(apart / side)
            if (np.sum(apart**2, axis=1) > 1.0).all():
                array[placed], placed = tried, placed + 1
    position = found.reshape(-1, 3)
    none, box = np.zeros_like(position), np.full((arrays, 3), side, np.float32)
    return SphereGroup("", 10.0, solid_fraction, np.arange(arrays + 1) * count, position, none, none, box)


def test_the_shipped_closure_keeps_the_mean_law():
    """At the Reynolds numbers of the data, in arrays that its training had not, at solid fractions of the data and
    between; and in the arrays of each group that were held out, against their own mean, as the file has it."""
    shipped, metadata = load_closure(SCENES / "neighbours.closure.h5")
    assert metadata["r2"]["all"]["along"] > metadata["r2_linear"]["all"]["along"]
    groups = [row for name, row in metadata["r2"].items() if name != "all"]
    assert len(groups) == 15
    for row in groups:
        assert row["mean_factor"] / row["data_factor"] == pytest.approx(1.0, abs=MEAN), row
    for solid_fraction, flows in ((0.1, (2.0, 40.0)), (0.15, (5.0, 20.0)), (0.25, (10.0,))):
        group = placed_at_random(solid_fraction)
        sums = group_moments(shipped.basis, group, shipped.wake)
        for reynolds in flows:
            flow = dataclasses.replace(group, reynolds=reynolds)
            given = predicted(shipped, flow, with_carried(shipped, flow, sums))
            # An array has a mean of its own, by one or two hundredths; that of twelve is known so well:
            own = given.along.reshape(12, -1).mean(axis=1, dtype=np.float64)
            error = own.std(ddof=1) / np.sqrt(len(own))
            assert error < MEAN
            assert own.mean() == pytest.approx(0.0, abs=MEAN + 2.0 * error), (solid_fraction, reynolds)
            assert 0.1 < float(given.along.std()) < 0.35
            # Across, a pair gives force and counterforce nearly, and no direction is preferred.
            np.testing.assert_allclose(given.across.mean(axis=0), 0.0, atol=MEAN)

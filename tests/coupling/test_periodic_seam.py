"""Walls that the fluid sees across a periodic side: all is as it is in the middle of the box."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem import build, load_scene
from jaxdem.coupling.surface_velocity import slopes_at_faces
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.open_faces import continued, next_to

GRID = Grid((6, 5), (0.6, 0.4), 1.0, (True, True))


def rolled(values, axis, by):
    """Values on cells, faces or corners moved on by some cells; what is stored twice is so again."""
    for k, stored_twice in enumerate(np.array(values.shape) > GRID.cells):
        if k == axis:
            inner = np.roll(np.delete(values, -1, k) if stored_twice else values, by, k)
            values = np.concatenate((inner, np.take(inner, [0], k)), k) if stored_twice else inner
    return values


def field(shape, seed):
    """Random values, one where they are stored twice."""
    values = np.random.default_rng(seed).uniform(-1.0, 1.0, GRID.cells)
    return np.pad(values, [(0, n - m) for n, m in zip(shape, GRID.cells, strict=True)], mode="wrap")


@pytest.mark.parametrize("axis, by", list(itertools.product((0, 1), (1, 3))))
def test_neighbours_and_slopes_know_no_seam(axis, by):
    for shape in ((6, 5), (7, 5)):
        values = field(shape, 1)
        found, moved = (next_to(GRID, jnp.asarray(x), 0) for x in (values, rolled(values, axis, by)))
        np.testing.assert_allclose(rolled(np.asarray(found), axis, by), moved, rtol=1e-14, atol=1e-14)
    corners = field((7, 6), 2)
    for of_faces in (0, 1):
        plain, moved = (slopes_at_faces(GRID, x, of_faces) for x in (corners, rolled(corners, axis, by)))
        for one, other in zip(plain, moved, strict=True):
            np.testing.assert_allclose(rolled(one, axis, by), other, rtol=1e-12, atol=1e-12)
    open_faces = tuple(np.maximum(field(shape, 3), 0.0) for shape in ((7, 5), (6, 6)))
    faces = tuple(field(shape, 4) for shape in ((7, 5), (6, 6)))
    plain = continued(GRID, *(tuple(map(jnp.asarray, x)) for x in (open_faces, faces)))
    moved = continued(GRID, *(tuple(jnp.asarray(rolled(f, axis, by)) for f in x) for x in (open_faces, faces)))
    for one, other in zip(plain, moved, strict=True):
        np.testing.assert_allclose(rolled(np.asarray(one), axis, by), other, rtol=1e-14, atol=1e-14)


def open_cells(low, high):
    """Of a box that is periodic along both axes, with a body between two heights [m]."""
    corners = [[0.103, low], [0.301, low], [0.301, high], [0.103, high]]
    periodic = {name: {"kind": "periodic"} for name in ("left", "right", "bottom", "top")}
    scene = load_scene({
        "precision": "float64",
        "domain": {"size": [0.4, 0.4], "gravity": [0.0, 0.0]},
        "fluid": {"cells": [20, 20], "viscosity": 1e-3},
        "boundary": periodic,
        "walls": [{"kind": "mesh", "points": corners, "closed": True, "fluid": "no_slip"}],
        "time": {"end": 0.1, "output_interval": 0.1},
    })  # fmt: skip
    return np.asarray(build(scene)[1].fluid.cut.open_cells)


def test_a_high_body_across_the_top_of_a_box_that_is_periodic_upwards():
    """Its upper side is outside of the box, farther from it than cells look for surfaces."""
    middle = open_cells(0.101, 0.303)
    assert middle.sum() == pytest.approx(400 - 0.198 * 0.202 / 4e-4, abs=1.0)  # corners are rounded
    np.testing.assert_allclose(np.roll(open_cells(0.301, 0.503), -10, 1), middle, atol=1e-12)

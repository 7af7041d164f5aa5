"""Weight at the surface of two fluids: planes at rest at any angle to the mesh, and how far weight is kept."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.fluid.grid import Grid, face_average
from jaxdem.fluid.surface_weight import surface_weight
from tests.cases.fractions import disc, half_space
from tests.cases.tiers import COMBINATION
from tests.cases.two_fluids import LIQUID, TwoFluids, largest

BOXES = {2: ((16, 12), (0.8, 0.6)), 3: ((8, 7, 6), (0.8, 0.7, 0.6))}
DIRECTIONS = {
    2: [((np.sin(a), np.cos(a)), (0.4, 0.31)) for a in np.radians((10.0, 30.0, 45.0, 60.0, 80.0, 135.0))]
    + [((np.sin(a), np.cos(a)), (0.4, 0.022)) for a in np.radians((10.0, 45.0))],
    3: [((0.17, 0.07, 0.98), (0.4, 0.35, 0.31)), ((0.66, 0.28, 0.71), (0.4, 0.35, 0.31)),
        ((0.5, 0.0, 0.87), (0.4, 0.35, 0.04))],
}  # fmt: skip
"""Upward normals of planes, and points in them: through sides, edges and the floor of a box."""


def curl(force, spacing):
    """Largest curl of a force on the faces at the inner corners and edges of the cells."""
    found = []
    for a in range(len(force)):
        for b in range(a):
            inner = tuple(slice(1, -1) if axis == a else slice(None) for axis in range(len(force)))
            other = tuple(slice(1, -1) if axis == b else slice(None) for axis in range(len(force)))
            found.append(
                jnp.diff(force[a][inner], axis=b) / spacing[b] - jnp.diff(force[b][other], axis=a) / spacing[a]
            )
    return jnp.max(jnp.stack([jnp.max(jnp.abs(f)) for f in found]))


@pytest.mark.parametrize("dimension", (2, 3))
def test_what_is_left_of_the_weight_of_a_plane_surface_is_a_gradient(dimension):
    """Its curl is rounding. That of the weight alone, of the mean density of two cells, is not."""
    cells, size = BOXES[dimension]
    grid = Grid(cells, size, 1.0, (False,) * dimension)

    @jax.jit
    def curls(fraction, gravity):
        weight = tuple(c * g for c, g in zip(face_average(grid, fraction), gravity, strict=True))
        more = surface_weight(grid, fraction, gravity, jnp.ones(()))
        return curl(weight, grid.spacing), curl([w + m for w, m in zip(weight, more, strict=True)], grid.spacing)

    for up, through in DIRECTIONS[dimension]:
        up = np.asarray(up) / np.linalg.norm(up)
        alone, found = curls(jnp.asarray(half_space(grid, up, through)), jnp.asarray(-9.81 * up))
        scale = 9.81 / min(grid.spacing)
        assert float(found) < 1e-12 * scale
        if abs(up[0]) != pytest.approx(abs(up[-1])):  # at 45 degrees both of its terms are the same
            assert float(alone) > 5e-3 * scale


def lake(dimension, oblique=True):
    return TwoFluids(*BOXES[dimension], ("free_slip",) * (2 * dimension), oblique=oblique)


def still(angle, box, steps):
    """Largest speed of water and air that began at rest under gravity at an angle to the last axis [m/s]."""
    up = (np.sin(np.radians(angle)), np.cos(np.radians(angle)))
    properties = box.properties(1000.0, (1e-6, 1.5e-5), tuple(-9.81 * u for u in up))
    found = box.march(properties, box.at_rest(properties, half_space(box.grid, up, (0.4, 0.31))), steps, 0.002)
    assert bool(found.converged)
    return largest(found.state.face_velocity)


def test_a_lake_under_oblique_gravity_is_at_rest():
    """At a density ratio of 1,000, for 200 steps."""
    box = lake(2)
    for angle in (10.0, 30.0, 45.0):
        assert still(angle, box, 200) < 1e-11


@COMBINATION
def test_without_it_the_lake_moves():
    """The negative control: with the weight of the mean density alone."""
    assert still(17.0, lake(2, oblique=False), 200) > 0.5


@COMBINATION
def test_a_lake_in_three_dimensions_is_at_rest():
    box = lake(3)
    up = np.asarray(DIRECTIONS[3][1][0]) / np.linalg.norm(DIRECTIONS[3][1][0])
    properties = box.properties(1000.0, (1e-6, 1.5e-5), tuple(-9.81 * up))
    found = box.march(properties, box.at_rest(properties, half_space(box.grid, up, (0.4, 0.35, 0.31))), 200, 0.002)
    assert bool(found.converged)
    assert largest(found.state.face_velocity) < 1e-11


@pytest.mark.parametrize(("cells", "most"), [(8, 0.04), (16, 0.01), (32, 0.001)])
def test_the_weight_of_a_disc_is_off_by_less_on_finer_meshes(cells, most):
    """Of discs 3, 6 and 13 cells across, anywhere in a cell, under gravity along any direction."""
    grid = Grid((cells, cells), (1.0, 1.0), 1.0, (False, False))
    total = jax.jit(
        lambda fraction, gravity: jnp.stack([jnp.sum(f) for f in surface_weight(grid, fraction, gravity, jnp.ones(()))])
    )
    for place in np.ndindex(4, 4):
        fraction = disc(grid.cells, grid.size, 0.5 + (np.asarray(place) / 4 - 0.4) / cells, 0.2)
        for angle in np.radians((5.0, 30.0, 60.0, 85.0)):
            added = np.asarray(total(jnp.asarray(fraction), jnp.asarray([np.sin(angle), -np.cos(angle)])))
            assert np.linalg.norm(added) < most * fraction.sum()


def test_what_is_added_has_no_sum_along_columns_nor_across_those_of_a_wave():
    """The columns of a disc in the middle of the mesh, and of a wave in a periodic box. Single faces have a part of the
    weight."""
    gravity, difference = jnp.asarray([0.0, -9.81]), jnp.asarray(LIQUID)
    grid = Grid((16, 16), (1.0, 1.0), 1.0, (True, False))
    found = jax.jit(lambda fraction: surface_weight(grid, fraction, gravity, difference))
    drop = disc(grid.cells, grid.size, (0.5, 0.65), 0.2)
    added = np.asarray(found(jnp.asarray(drop))[1])
    assert np.abs(added.sum(axis=1)).max() < 1e-12 * LIQUID * 9.81
    assert np.abs(added).max() > 0.1 * LIQUID * 9.81
    x = (np.arange(16) + 0.5) / 16
    heights = 0.5 + 0.08 * np.cos(2 * np.pi * x) + 0.03 * np.sin(4 * np.pi * x)
    wave = np.clip(heights[:, None] * 16 - np.arange(16), 0.0, 1.0)
    across = np.asarray(found(jnp.asarray(wave))[0])[:-1]
    assert abs(across.sum()) < 1e-12 * np.abs(across).sum()
    assert np.abs(across).max() > 0.05 * LIQUID * 9.81

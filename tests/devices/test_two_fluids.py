"""Two fluids with a sharp surface on several devices, against one device."""

import jax
import numpy as np
import pytest

import jaxdem
from jaxdem import InputError, devices
from jaxdem.fluid.boundary import Boundary, Side
from jaxdem.fluid.mesh import Grid
from jaxdem.fluid.multigrid import multigrid
from jaxdem.fluid.slabs import cells_in_slabs, cells_of_slabs
from jaxdem.numerics.blocks import Blocks
from tests.cases.fluid_slabs import ALONG_X, SLABS, places, run_on_slabs
from tests.cases.slabs import apart
from tests.cases.surface_beside_walls import broken_dam, tank
from tests.cases.tiers import COMBINATION

CHANNEL = {
    "left": {
        "kind": "inlet", "velocity": 0.1, "level": 0.09, "temperature": 320.0, "scalars": {"salt": 1.0, "smoke": 2.0},
    },
    "right": {"kind": "outlet", "level": 0.08},
    "top": {"kind": "free_slip"},
}  # fmt: skip
"""Warm water with salt flows in below air with smoke, and out."""


def scene_of(cells, boundary, **changes):
    """Water and a drop above it in a box of cells of 0.01 m; the density jumps by 100."""
    size = [0.01 * n for n in cells]
    drop = {"shape": "sphere", "center": [0.5 * x for x in size[:-1]] + [0.75 * size[-1]], "radius": 0.03}
    tables = {
        "precision": "float64",
        "domain": {"size": size},
        "fluid": {"cells": cells, "density": 1000.0, "viscosity": 1e-5, "time_step": 2e-3},
        "surface": {"density": 10.0, "viscosity": 1e-4, "tension": 0.5, "level": 0.5 * size[-1], "regions": [drop]},
        "boundary": boundary,
        "time": {"end": 0.1, "output_interval": 0.1},
    }
    if len(cells) == 2:
        tables["domain"]["depth"] = 0.02
    return tables | changes


def warm_grains():
    """Grains that sink in the water and fall into it, heat, and what is dissolved."""
    size = [0.24, 0.16]
    tables = scene_of([24, 16], CHANNEL)
    tables["surface"] |= {"heat_capacity": 500.0, "conductivity": 0.1, "expansion": 3e-3}
    tables["heat"] = {
        "fluid_heat_capacity": 1000.0, "fluid_conductivity": 0.6, "fluid_temperature": 300.0, "expansion": 3e-4,
        "particle_heat_capacity": 100.0, "particle_temperature": 350.0,
    }  # fmt: skip
    tables["scalars"] = [
        {"name": "salt", "diffusivity": 1e-4, "value": 0.5},
        {"name": "smoke", "diffusivity": 1e-4, "dissolved_in": "second"},
    ]
    grains = {"radius": 0.002, "density": 2650.0, "position": places(size, count=20, radius=0.002)}
    tables["particles"] = grains | {"velocity": [[0.3, -0.1]] * 20}
    return tables | {"contact": {"young_modulus": 5e5, "friction": 0.3, "speed": 1.0}}


OBLIQUE = scene_of([16, 32], ALONG_X)
OBLIQUE["domain"]["gravity"] = [4.0, -9.0]


@pytest.mark.parametrize(
    ("tables", "number", "axis"),
    [
        pytest.param(warm_grains(), 2, 0, marks=COMBINATION),
        (scene_of([16, 32], ALONG_X), 4, 1),
        pytest.param(scene_of([8, 8, 32], ALONG_X), 4, 2, marks=COMBINATION),
        pytest.param(OBLIQUE, 4, 1, marks=COMBINATION),
    ],
    ids=["warm grains in a channel", "a drop falls", "a drop falls in space", "under oblique gravity"],
)
def test_two_fluids_are_those_of_one_device(tables, number, axis):
    """After ten intervals the same surface, velocity, pressure, heat and grains within 1e-10, and the same iterations
    of the pressure, since the cycle has the same levels; nothing is gathered."""
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    position = None if state.particles is None else state.particles.position
    divided = devices.divided(simulation, number, position, axis=axis)
    slabs, lists = devices.distributed(divided, parameters, state, neighbors)
    first = state
    one, many = jax.jit(simulation.step), jax.jit(divided.step).lower(parameters, slabs, lists).compile()
    assert "all-gather" not in many.as_text()
    for _ in range(10):
        state, neighbors, report = one(parameters, state, neighbors)
        slabs, lists, figures = many(parameters, slabs, lists)
        assert figures.fluid.converged and figures.fluid.iterations == report.fluid.iterations
    whole, _ = devices.gathered(divided, slabs, lists)
    for (path, expected), found in zip(
        jax.tree_util.tree_flatten_with_path((state.fluid, state.scalars))[0],
        jax.tree.leaves((whole.fluid, whole.scalars)),
        strict=True,
    ):
        assert apart(expected, found) < 1e-10, jax.tree_util.keystr(path)
    fraction = np.asarray(state.fluid.liquid_fraction)
    assert np.abs(fraction - np.asarray(first.fluid.liquid_fraction)).max() > 0.1, "the surface has moved"
    supplied, volume = whole.fluid.liquid_supplied, simulation.fluid.solver.grid.cell_volume
    gaps = 1.0 if whole.fluid.void_fraction is None else whole.fluid.void_fraction
    assert abs(np.sum(gaps * whole.fluid.liquid_fraction) * volume - np.sum(supplied)) < 1e-12 * supplied[0]
    if state.particles is None:
        return
    for name in ("position", "velocity", "fluid_force"):
        assert apart(getattr(state.particles, name), getattr(whole.particles, name)) < 1e-10, name
    assert np.abs(supplied[1:3]).min() > 0.0


def falling_grains():
    """Grains that fall into a lake, between a floor and a slope."""
    floor = {"kind": "plane", "point": [0.0, 0.0135], "normal": [0.0, 1.0], "fluid": "no_slip"}
    slope = {"kind": "plane", "point": [0.048, 0.0135], "normal": [-1.0, 0.7], "fluid": "no_slip"}
    return {
        "precision": "float64",
        "domain": {"size": [0.06, 0.12], "depth": 0.01},
        "particles": {
            "radius": 4e-3, "density": 2500.0, "velocity": [[0.0, -0.4]] * 3,
            "position": [[0.006, 0.07], [0.018, 0.045], [0.03, 0.0385]],
        },
        "contact": {"young_modulus": 2e5, "friction": 0.3, "speed": 0.5},
        "fluid": {"cells": [6, 12], "density": 1000.0, "viscosity": 1e-2, "time_step": 1e-3},
        "surface": {"density": 1.0, "viscosity": 1e-2, "level": 0.0647},
        "coupling": {"drag": "stokes", "interval": 1e-3},
        "walls": [floor, slope],
        "time": {"end": 5.0, "output_interval": 0.1},
    }  # fmt: skip


COLUMN = {"density": 1.0, "viscosity": 1.5e-5, "regions": [{"shape": "box", "start": [0.0, 0.0], "stop": [0.39, 0.4]}]}
ROLLING = broken_dam((16, 16)) | {"surface": COLUMN}
"""A column of water, up to the border between two slabs, that breaks on a slope and a round body across it."""


def dam_in_space():
    """A column of water, up to the border between two slabs, on a plane that is tilted both ways and before a cylinder
    across the border, which is tilted too."""
    walls = [
        {"kind": "plane", "point": [0.3, 0.2, 0.0], "normal": [-0.4, 0.3, 1.0], "fluid": "no_slip"},
        {"kind": "cylinder", "center": [0.4, 0.3, 0.2], "axis": [0.3, 1.0, 0.2], "radius": 0.12,
         "inside": False, "fluid": "free_slip"},
    ]  # fmt: skip
    tables = tank(walls, (8, 6, 8), domain={"size": [0.8, 0.6, 0.6], "gravity": [0.0, 0.0, -9.81]})
    del tables["domain"]["depth"]
    column = {"shape": "box", "start": [0.0, 0.0, 0.0], "stop": [0.39, 0.6, 0.5]}
    return tables | {"surface": COLUMN | {"regions": [column]}}


@pytest.mark.parametrize(
    ("tables", "number", "axis", "intervals"),
    [
        pytest.param(ROLLING, 2, 0, 30, marks=COMBINATION),
        pytest.param(ROLLING, 4, 1, 30, marks=COMBINATION),
        pytest.param(falling_grains(), 3, 1, 30, marks=COMBINATION),
        pytest.param(dam_in_space(), 2, 0, 30, marks=COMBINATION),
        pytest.param(ROLLING | {"domain": ROLLING["domain"] | {"gravity": [4.0, -9.0]}}, 2, 0, 30, marks=COMBINATION),
    ],
    ids=["a dam breaks", "slabs of height", "grains", "in space", "under oblique gravity"],
)
def test_two_fluids_beside_walls_are_those_of_one_device(tables, number, axis, intervals):
    """Fields and loads on the walls within 1e-10, with as many iterations of the pressure; nothing is gathered. The
    parts of the mesh come back from the slabs as they were."""
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    position = None if state.particles is None else state.particles.position
    divided = devices.divided(simulation, number, position, axis=axis)
    own = divided.with_parts(parameters)
    for back, whole in zip(jax.tree.leaves(divided.of_whole(own)), jax.tree.leaves(parameters), strict=True):
        np.testing.assert_array_equal(back, whole)
    slabs, lists = devices.distributed(divided, own, state, neighbors)
    first = np.asarray(state.fluid.liquid_fraction)
    one, many = jax.jit(simulation.step), jax.jit(divided.step).lower(own, slabs, lists).compile()
    assert "all-gather" not in many.as_text()
    for _ in range(intervals):
        state, neighbors, report = one(parameters, state, neighbors)
        slabs, lists, figures = many(own, slabs, lists)
        assert figures.fluid.converged and figures.fluid.iterations == report.fluid.iterations
    whole, _ = devices.gathered(divided, slabs, lists)
    for (path, expected), found in zip(
        jax.tree_util.tree_flatten_with_path(state.fluid)[0], jax.tree.leaves(whole.fluid), strict=True
    ):
        assert apart(expected, found) < 1e-10, jax.tree_util.keystr(path)
    assert apart(report.fluid.surface_load, figures.fluid.surface_load) < 1e-10
    moved = np.moveaxis(np.abs(np.asarray(state.fluid.liquid_fraction) - first), axis, 0)
    assert max(part.max() for part in np.split(moved, number)[1:]) > 0.01, "beyond the first slab"
    if state.particles is not None:
        for name in ("position", "velocity", "fluid_force"):
            assert apart(getattr(state.particles, name), getattr(whole.particles, name)) < 1e-10, name


def test_the_multigrid_cycle_is_that_of_one_device():
    """Bit for bit, of a coefficient that varies a hundredfold: two levels in four slabs, the next one whole."""
    draw = np.random.default_rng(0)
    grid = Grid((64, 32), (6.4, 3.2), 1.0, (True, False))
    sides = Boundary(tuple(Side(n // 2, n % 2 == 1, k) for n, k in enumerate(["periodic"] * 2 + ["no_slip", "outlet"])))
    coefficient = [np.exp(3.0 * draw.normal(size=grid.face_shape(axis))) for axis in range(2)]
    coefficient[0][-1] = coefficient[0][0]
    residual, blocks = draw.normal(size=grid.cells), Blocks(4, 0, True)
    expected = jax.jit(lambda c, r: multigrid(grid, sides, c)(r))(tuple(coefficient), residual)
    given = tuple(cells_in_slabs(blocks, c, int(k == 0)) for k, c in enumerate(coefficient))
    found, text = run_on_slabs(
        4,
        lambda c, r: multigrid(grid.in_blocks(blocks), sides, c)(r),
        [SLABS] * 2,
        (given, cells_in_slabs(blocks, residual)),
    )
    np.testing.assert_array_equal(cells_of_slabs(blocks, found), expected)
    assert "collective-permute" in text and "all-gather" not in text


def test_slabs_that_are_no_multiple_of_four_cells_are_refused():
    with pytest.raises(InputError, match=r"the 12 cells of fluid.cells are no multiple of 8: with two fluids"):
        jaxdem.build(jaxdem.load_scene(scene_of([12, 4], ALONG_X)), devices=2)

"""Two fluids beside walls that the fluid sees: a control of the cases, grains, three dimensions, refusals; the cases
themselves are in tests/physics/test_surface_cases.py."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem import InputError
from jaxdem.coupling.open_cells import seen_slope
from jaxdem.fluid.cut_liquid import fraction_of_level, level_of
from jaxdem.fluid.cut_two_fluids import CutTwoFluidSolver
from jaxdem.numerics.static import static
from tests.cases.surface_beside_walls import BEACH, BODY, TILTED_BOX, broken_dam, run, tank
from tests.cases.tiers import COMBINATION


@static
class WithoutOpenParts(CutTwoFluidSolver):
    """The liquid is carried as if all faces were open."""

    def _carried_between_walls(self, second, state, flux, times, void_fraction, cut):
        flux = tuple(f / jnp.where(a > 0.0, a, 1.0) for f, a in zip(flux, cut.open_faces, strict=True))
        return super()._carried_between_walls(second, state, flux, times, void_fraction, cut)


def test_a_transport_that_forgets_the_open_parts_is_seen():
    """The negative control of "a column that breaks on walls": the fraction leaves its bounds ten thousand times as far
    as its gate."""

    def forgetful(simulation):
        solver = simulation.fluid.solver
        fields = {f.name: getattr(solver, f.name) for f in dataclasses.fields(solver) if f.init}
        return dataclasses.replace(
            simulation, fluid=dataclasses.replace(simulation.fluid, solver=WithoutOpenParts(**fields))
        )

    assert run(broken_dam(), 60, change=forgetful).beyond > 1e-6


def test_levels_of_cut_cells():
    """The height of the liquid is a continuous, invertible function of its fraction, and the fraction in whole cells.

    Water up to one height stands at this height in all cells of a row, whatever is open of them.
    """
    parameters = jaxdem.build(jaxdem.load_scene(tank([TILTED_BOX], (16, 12))))[1]
    cut = parameters.flow.cut
    for level in (0.0, 0.03, 0.4, 0.77, 1.0):
        heights = jnp.full(cut.open_cells.shape, level)
        found = level_of(cut, fraction_of_level(cut.layers, heights))
        assert float(jnp.abs(found - level).max()) < 1e-14
    fractions = jnp.linspace(0.0, 1.0, 41)
    found = jax.vmap(lambda c: level_of(cut, jnp.full(cut.open_cells.shape, c)))(fractions)
    assert float(jnp.diff(found, axis=0).min()) > 0.0
    whole = np.asarray(cut.open_cells == 1.0) & np.all(np.asarray(cut.layers) == 0.125, axis=0)
    assert whole.sum() > 20
    assert np.array_equal(np.asarray(found)[:, whole], np.broadcast_to(fractions[:, None], (41, whole.sum())))


def grains_on_a_floor():
    """Grains on a floor within the mesh, beside a slope, under a lake whose surface is above them."""
    floor = {"kind": "plane", "point": [0.0, 0.0135], "normal": [0.0, 1.0], "fluid": "no_slip"}
    slope = {"kind": "plane", "point": [0.048, 0.0135], "normal": [-1.0, 0.7], "fluid": "no_slip"}
    return {
        "precision": "float64",
        "domain": {"size": [0.06, 0.12], "depth": 0.01},
        "particles": {"radius": 4e-3, "density": 2500.0, "position": [[x, 0.0175] for x in (0.006, 0.018, 0.03)]},
        "contact": {"young_modulus": 2e5, "poisson_ratio": 0.25, "friction": 0.3, "restitution": 0.2, "speed": 0.1},
        "fluid": {"cells": [6, 12], "density": 1000.0, "viscosity": 1e-2, "time_step": 1e-3},
        "surface": {"density": 1.0, "viscosity": 1e-2, "level": 0.0647},
        "coupling": {"drag": "stokes", "interval": 1e-3},
        "walls": [floor, slope],
        "time": {"end": 5.0, "output_interval": 0.1},
    }


@COMBINATION
def test_grains_as_heavy_as_the_liquid_stay_at_rest_between_walls():
    """Beside a floor and a slope, where their void fraction is uneven: neither they nor the fluids move."""
    scene = grains_on_a_floor()
    scene["particles"] |= {"density": 1000.0, "position": [[0.006, 0.02], [0.027, 0.0185], [0.045, 0.03]]}
    found = run(scene, 20)
    assert found.codes == 0
    assert float(found.start.fluid.void_fraction.min()) < 0.9
    assert found.speed < 1e-13
    assert float(jnp.abs(found.end.particles.velocity).max()) < 1e-13


def test_grains_that_fall_into_a_lake_between_walls():
    """Nothing is lost, the fraction keeps its bounds, and the level rises by what the grains displace."""
    scene = grains_on_a_floor()
    scene["particles"]["position"] = [[x, 0.08] for x in (0.006, 0.018, 0.03)]
    found = run(scene, 400)
    assert found.codes == 0
    assert float(found.end.particles.position[:, 1].max()) < 0.06
    assert found.missing < 1e-12 and found.beyond < 1e-9

    def wetted(state):  # liquid and grains in it
        return jnp.sum(found.parameters.flow.cut.open_cells * state.fluid.liquid_fraction)

    cell = 0.01**2 * 0.01
    solids = 3 * float(found.parameters.mixture.bodies.volume)
    assert float(wetted(found.end) - wetted(found.start)) * cell == pytest.approx(solids, rel=0.02)


@COMBINATION
def test_three_dimensions():
    """A lake on a plane that is tilted both ways, round a cylinder that is tilted too."""
    walls = [
        {"kind": "plane", "point": [0.3, 0.2, 0.0], "normal": [-0.4, 0.3, 1.0], "fluid": "no_slip"},
        {"kind": "cylinder", "center": [0.4, 0.5, 0.3], "axis": [0.3, 1.0, 0.2], "radius": 0.15,
         "inside": False, "fluid": "free_slip"},
    ]  # fmt: skip
    domain = {"size": [0.8, 0.7, 0.6], "gravity": [0.0, 0.0, -9.81], "depth": None}
    scene = tank(walls, (8, 7, 12), domain=domain)
    scene["domain"].pop("depth")
    assert run(scene, 8).speed < 1e-12
    scene["surface"] = {"density": 1.0, "viscosity": 1.5e-5}
    scene["surface"]["regions"] = [{"shape": "box", "start": [0.0, 0.0, 0.0], "stop": [0.3, 0.7, 0.5]}]
    found = run(scene, 8)
    assert found.codes == 0 and found.speed > 0.05
    assert found.missing < 1e-12 and found.beyond < 1e-10


@static
class WithFractions(CutTwoFluidSolver):
    """What is beyond outlets stands beside the fractions of cut cells in place of their levels."""

    def _level(self, properties, fraction):
        return fraction


def test_a_lake_between_outlets_at_its_level_is_at_rest():
    """Also where a slope leaves through an outlet just below the surface, in the middle of a row; particles feel no
    pressure along the surface there.

    The negative control: with the fraction of the cut cell they would feel a hundredth of the weight and more.
    """
    slope = {"kind": "plane", "point": [0.3, 0.0], "normal": [-0.62, 1.0], "fluid": "no_slip"}
    sides = {name: {"kind": "outlet", "level": 0.325} for name in ("left", "right")}
    found = run(tank([slope], (16, 12), boundary=sides, surface={"level": 0.325}), 4)
    assert found.codes == 0 and found.speed < 1e-11
    solver, flow = found.simulation.fluid.solver, found.parameters.flow
    weight = float(flow.density) * 9.81

    def along(solver):
        slope = seen_slope(solver.grid, solver.slope_at_particles(flow, found.end.fluid), flow.cut)
        return float(jnp.abs(slope[0]).max()) / weight

    assert along(solver) < 1e-9
    fields = {f.name: getattr(solver, f.name) for f in dataclasses.fields(solver) if f.init}
    assert along(WithFractions(**fields)) > 1e-2


@COMBINATION
def test_gradients_by_the_level_and_the_density_of_the_second_fluid():
    """Of where a tilted lake on a slope sways to, and of a difference of pressures: reverse mode against central
    differences."""
    scene = jaxdem.load_scene(tank([BEACH], (12, 9)))
    simulation, parameters = jaxdem.build(scene)
    start, _ = jaxdem.initial_state(scene, simulation, parameters)
    grid, cut = simulation.fluid.solver.grid, parameters.flow.cut
    x, z = np.meshgrid(*(h * np.arange(n) for n, h in zip(grid.cells, grid.spacing, strict=True)), indexing="ij")

    @jax.jit
    def measured(given):
        level, density = given
        heights = jnp.clip((level + 0.1 * x - z) / grid.spacing[1], 0.0, 1.0)
        fluid = start.fluid._replace(liquid_fraction=fraction_of_level(cut.layers, heights) * (cut.open_cells > 0.0))
        second = parameters.fluid.second._replace(density=density)
        now = parameters._replace(fluid=parameters.fluid._replace(second=second))

        end = jaxdem.rollout(simulation, now, start._replace(fluid=fluid), None, 8).state.fluid
        return jnp.stack([jnp.sum(cut.open_cells * end.liquid_fraction * x), end.pressure[8, 4] - end.pressure[0, 0]])

    at, small = jnp.asarray([0.27, 50.0]), jnp.asarray([1e-5, 1e-2])
    found = jax.jacrev(measured)(at)
    for k in range(2):
        step = jnp.zeros(2).at[k].set(small[k])
        expected = (measured(at + step) - measured(at - step)) / (2.0 * small[k])
        assert np.all(np.abs(np.asarray(expected)) > 0.0)
        np.testing.assert_allclose(found[:, k], expected, rtol=1e-4)


@COMBINATION
def test_a_run_that_goes_on_is_the_whole_run_bit_for_bit(tmp_path):
    """Grains that fall into a lake between a floor and a slope, float32."""
    tables = grains_on_a_floor() | {"precision": "float32", "time": {"end": 0.08, "output_interval": 0.02}}
    tables["particles"]["position"] = [[x, 0.07] for x in (0.006, 0.018, 0.03)]
    half = tables | {"time": {"end": 0.04, "output_interval": 0.02}}
    whole = jaxdem.simulate(jaxdem.load_scene(tables), tmp_path / "whole")
    jaxdem.simulate(jaxdem.load_scene(half), tmp_path / "halves")
    again = jaxdem.simulate(jaxdem.load_scene(tables), tmp_path / "halves", resume=True)
    for part in ("particles", "fluid"):
        one, other = getattr(whole, part)(-1), getattr(again, part)(-1)
        assert sorted(one) == sorted(other) and len(one) > 3
        for name in one:
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)


SLAB = {
    "kind": "mesh", "points": [[0.5, -0.1], [0.6, -0.1], [0.6, 0.7], [0.5, 0.7]],
    "closed": True, "inside": False, "fluid": "no_slip",
}  # fmt: skip


@pytest.mark.parametrize(
    ("surface", "key"),
    [
        ({"level": None, "regions": [{"shape": "box", "start": [0.62, 0.0], "stop": [0.8, 0.4]}]}, "surface.regions"),
        ({"level": 0.1, "density": 1.0}, "surface.level"),
    ],
)
def test_liquid_in_spaces_that_are_left_out_alone_is_refused(surface, key):
    """Beyond a slab that cuts the box in two, where no outlet reaches; within a floor."""
    floor = {"kind": "plane", "point": [0.0, 0.15], "normal": [0.0, 1.0], "fluid": "no_slip"}
    scene = jaxdem.load_scene(tank([SLAB if key.endswith("regions") else floor], (16, 12), surface=surface))
    with pytest.raises(InputError) as caught:
        jaxdem.initial_state(scene, *jaxdem.build(scene))
    assert caught.value.key == key


TURNS = {"motion": [{"kind": "rotation", "rate": 1.0}]}
REFUSED = {
    "surface.tension": {"surface": {"tension": 0.07}},
    "heat": {
        "surface": {"heat_capacity": 1e3, "conductivity": 0.03},
        "heat": {"fluid_heat_capacity": 4e3, "fluid_conductivity": 0.6, "fluid_temperature": 300.0},
    },
    "scalars": {"scalars": [{"name": "dye", "diffusivity": 1e-9}]},
    "walls.0.motion": {"walls": [{**BODY, **TURNS}]},
    "walls.0.end": {"walls": [{**BODY, "end": 0.5}]},
}


@pytest.mark.parametrize("key", REFUSED)
def test_what_is_refused(key):
    with pytest.raises(InputError) as caught:
        jaxdem.load_scene(tank(**{"walls": [BEACH], **REFUSED[key]}))
    assert caught.value.key == key

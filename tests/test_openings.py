"""Inlets and outlets on walls that the fluid sees: volume, radial flow, inlets of the box, bodies, grains, refusals."""

import copy
import functools
import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from jaxdem import InputError, build, initial_state, load_scene
from jaxdem.check.check import check_scene
from jaxdem.coupling.open_parts import face_points
from jaxdem.coupling.openings import OpeningPlace
from jaxdem.fluid.cut_cells import OpeningParts
from jaxdem.fluid.grid import divergence
from jaxdem.scene.openings import Opening as Table
from jaxdem.setup.builder import build_case
from jaxdem.setup.openings import WallOpening
from tests.cases.steps import compiled_step
from tests.cases.tiers import COMBINATION, tiered
from tests.cases.walls_in_fluid import averaged, error_of

FLOW, INNER, OUTER = 0.05, 0.15, 0.46
INLET, OUTLET = {"kind": "inlet", "flow": FLOW, "ramp_time": 0.0}, {"kind": "outlet"}


def tables(cells, walls, **changes):
    found = {
        "precision": "float64",
        "domain": {"size": [1.0] * len(cells), "gravity": [0.0] * len(cells)},
        "fluid": {"cells": list(cells), "density": 1.0, "viscosity": 1e-2},
        "walls": list(walls),
        "time": {"end": 1.0, "output_interval": 0.5},
    }
    return copy.deepcopy(found | changes)


def cylinder(radius, inside, opening, **keys):
    return {
        "kind": "cylinder", "center": [0.5, 0.5], "radius": radius, "inside": inside, "fluid": "no_slip",
        "opening": opening, **keys,
    }  # fmt: skip


def advanced(scene, count):
    """Simulation, parameters, the state after so many intervals and what the last one told."""
    simulation, parameters = build(scene)
    state, neighbors = initial_state(scene, simulation, parameters)
    for _ in range(count):
        state, neighbors, told = compiled_step(simulation)(parameters, state, neighbors)
    return simulation, parameters, state, told


def volumes(simulation, cut, fluid):
    """What leaves every cell [m3/s]."""
    grid = simulation.fluid.solver.grid
    g = 1.0 if fluid.void_fraction is None else fluid.void_fraction
    assert isinstance(g, float), "of a fluid alone"
    flux = tuple(a * u for a, u in zip(cut.open_faces, fluid.face_velocity, strict=True))
    return grid.cell_volume * np.asarray(divergence(grid, flux))


@functools.cache
def annulus(n, count=30, **fluid):
    """Fluid from the whole of a cylinder to the whole of one around it, in a box that is closed otherwise."""
    given = tables((n, n), [cylinder(INNER, False, [INLET]), cylinder(OUTER, True, [OUTLET])])
    given["fluid"] |= fluid
    return advanced(load_scene(given), count)


def radial_error(n):
    """Root of the mean square error over the speed at the source."""
    simulation, parameters, state, _ = annulus(n)
    grid, cut = simulation.fluid.solver.grid, parameters.fluid.cut

    def component(axis):
        def formula(x):
            r = np.hypot(x[..., 0] - 0.5, x[..., 1] - 0.5)
            inside = (r > INNER) & (r < OUTER)
            return FLOW / (2.0 * np.pi * np.where(inside, r, 1.0) ** 2) * (x[..., axis] - 0.5), inside

        return averaged(grid, axis, formula) * (np.asarray(cut.open_faces[axis]) > 0.0)

    exact = [component(axis) for axis in range(2)]
    return error_of(cut, state.fluid.face_velocity, exact) / (FLOW / (2.0 * np.pi * INNER))


def test_the_flow_between_a_source_and_an_outlet_is_radial():
    """u = Q/(2 pi r). The surfaces are chords of the circles: their lengths err with the square of the cells."""
    coarse, fine = radial_error(16), radial_error(32)
    assert coarse < 0.006 and fine < 0.6 * coarse
    off = [1.0 - annulus(n)[1].fluid.cut.openings[0].area / (2.0 * np.pi * INNER) for n in (16, 32)]
    assert 0.0 < off[0] < 0.012 and off[1] < 0.3 * off[0]


def test_ramps_and_tables_in_time_are_those_of_the_scene():
    """Q(t) = ramp(t) q(t), and v = Q/A, as the step and the check of the balance have it; between two times none is
    faster than what the step goes by."""
    wanted = {"times": [0.05, 0.1, 0.3], "ramp_time": 0.12}
    amounts, area, times = np.array([0.01, 0.05, -0.02]), 0.3, np.linspace(0.0, 0.4, 41)
    exact = np.clip(times / 0.12, 0.0, 1.0) * np.interp(times, wanted["times"], amounts)
    for name, by in (("flows", 1.0), ("velocities", area)):
        table = Table.model_validate({"kind": "inlet", name: list(amounts)} | wanted)
        opening = WallOpening("", table, OpeningPlace(0, (0,)), area)
        assert np.allclose([opening.flow(time) for time in times], by * exact, atol=1e-15)
        part = OpeningParts(jnp.zeros(()), (), (), jnp.asarray(area))
        now, most = jax.jit(
            lambda times, opening=opening, part=part: jax.vmap(
                lambda t: (
                    opening.compiled.speed(part, jnp.asarray(amounts), t),
                    opening.compiled.largest_speed(part, jnp.asarray(amounts), t, t + 0.1),
                )
            )(times)
        )(jnp.asarray(times))
        assert np.allclose(area * now, by * exact, atol=1e-15)
        assert all(np.abs(now[k : k + 11]).max() < most[k] + 1e-15 for k in range(31))


def test_volume_is_kept_to_rounding():
    """In every cell as much leaves as its part of the opening brings; the total is the flow that the scene gives."""
    simulation, parameters, state, told = annulus(16)
    source, drain = parameters.fluid.cut.openings
    out = volumes(simulation, parameters.fluid.cut, state.fluid)
    volume = simulation.fluid.solver.grid.cell_volume
    brought = FLOW * (np.asarray(source.supply) / source.area - np.asarray(drain.supply) / drain.area) * volume
    assert np.abs(out - brought).max() < 1e-12 * FLOW
    assert abs(out[np.asarray(source.supply) > 0.0].sum() - FLOW) < 1e-12 * FLOW and abs(out.sum()) < 1e-13 * FLOW
    assert told.fluid.divergence < 1e-11 and told.fluid.converged


@pytest.mark.parametrize("reverse", tiered([False, True], first=[False]), ids=["forward", "reverse"])
def test_the_slope_by_the_flow_is_that_of_differences(reverse, monkeypatch):
    """Of the pressure after two intervals, which is not linear in it; without limiters, and with exact fluxes within
    the steps."""
    monkeypatch.setattr("jaxdem.fluid.cut_projection.FLUX_TOLERANCE", 1e-12)
    simulation, parameters, state, _ = annulus(12, 5, advection="central")

    def pressure(flow):
        given = parameters._replace(fluid=parameters.fluid._replace(openings=(flow, parameters.fluid.openings[1])))
        now = state
        for _ in range(2):
            now = (simulation.reversible() if reverse else simulation).step(given, now, None)[0]
        return now.fluid.pressure[6, 8] - now.fluid.pressure[6, 10]

    forward = functools.partial(jax.jvp, pressure)
    of_flow = jax.value_and_grad(pressure) if reverse else lambda flow: forward((flow,), (jnp.ones_like(flow),))
    found, step = jax.jit(of_flow), 0.02 * FLOW
    slope = found(jnp.asarray(FLOW))[1]
    higher, lower = (found(jnp.asarray(FLOW + way * step))[0] for way in (1.0, -1.0))
    assert abs(slope - (higher - lower) / (2.0 * step)) < 1e-5 * abs(slope) and slope != 0.0


def side_or_wall(lifted, start, stop, velocity=0.4, n=20):
    """An inlet in the floor of the box, or at the same place of a plane two cells above it: velocities above it."""
    floor = 2.0 / n if lifted else 0.0
    changes = {
        "domain": {"size": [1.0, 1.0 + floor], "gravity": [0.0, 0.0]},
        "fluid": {"cells": [n, n + 2 * lifted], "density": 1.0, "viscosity": 2e-3, "time_step": 0.02},
        "boundary": {"top": {"kind": "outlet"}},
    }
    if not lifted:
        changes["boundary"]["bottom"] = {"kind": "inlet", "velocity": velocity, "from": start, "to": stop}
    region = {"shape": "box", "start": [start, floor - 0.1], "stop": [stop, floor + 0.1]}
    plane = {"kind": "plane", "point": [0.0, floor], "normal": [0.0, 1.0], "fluid": "no_slip"}
    plane["opening"] = [{"kind": "inlet", "velocity": velocity, "region": region}]
    simulation, parameters, state, _ = advanced(load_scene(tables((n, n), [plane] * lifted, **changes)), 40)
    if lifted:
        assert float(parameters.fluid.cut.openings[0].area) == pytest.approx(stop - start, rel=1e-12)
    return [np.asarray(u)[:, 2 * lifted :] for u in state.fluid.face_velocity]


def test_an_inlet_in_a_plane_on_a_grid_line_is_that_of_a_side_of_the_box():
    """To 5 % of its speed beside its edges, 0.8 % in the mean; exactly what comes in, where it ends within a cell."""
    for start, stop in ((0.25, 0.5), (0.27, 0.53)):
        of_wall, of_side = (side_or_wall(lifted, start, stop) for lifted in (True, False))
        errors = [a - b for a, b in zip(of_wall, of_side, strict=True)]
        assert max(np.abs(e).max() for e in errors) < 0.05 * 0.4
        assert max(np.sqrt(np.mean(e**2)) for e in errors) < 0.008 * 0.4
        assert abs(of_side[1][:, 10].sum() - of_wall[1][:, 10].sum()) < 1e-11 * of_side[1][:, 10].sum()


MOVES = [
    {"kind": "translation", "velocity": [0.0, 0.25]},
    {"kind": "rotation", "rate": 1.0, "center": [0.5, 0.5]},
]


def test_an_opening_moves_with_its_wall():
    """The right half of a cylinder that rises and turns: the box loses what it brings, to rounding, in every interval.
    Its middle is where the motion takes it."""
    region = {"shape": "box", "start": [0.5, 0.0], "stop": [1.0, 1.0]}
    wall = cylinder(INNER, False, [INLET | {"region": region}], motion=MOVES)
    scene = load_scene(tables((16, 16), [wall], boundary={"top": {"kind": "outlet"}}))
    simulation, parameters, state, told = advanced(scene, 30)
    now = jax.jit(lambda *given: simulation.with_moved_walls(*given)[0].fluid.cut)
    cut = now(parameters, state.fluid, state.step - 1)
    out, time = volumes(simulation, cut, state.fluid), float(state.step) * simulation.interval
    assert abs(out.sum() - FLOW) < 1e-12 * FLOW and told.fluid.divergence < 1e-10
    assert float(cut.openings[0].area) == pytest.approx(np.pi * INNER, rel=0.02)
    places = np.stack(np.meshgrid(*[(np.arange(16) + 0.5) / 16.0] * 2, indexing="ij"))
    middle = np.array([np.average(x, weights=cut.openings[0].supply) for x in places])
    from_axis = 2.0 * INNER / np.pi * np.array([math.cos(time), math.sin(time)])
    centre = np.array([0.5 - 0.25 * time * math.sin(time), 0.5 + 0.25 * time * math.cos(time)])
    assert np.abs(middle - centre - from_axis).max() < 0.5 / 16.0


def test_an_opening_has_slopes_by_the_motion_of_its_wall():
    """By the speed at which it rises and the rate at which it turns, those of differences. The slope of a minimum over
    the sides of the region was NaN in some programs."""
    region = {"shape": "box", "start": [0.5, 0.0], "stop": [1.0, 1.0]}
    wall = cylinder(INNER, False, [INLET | {"region": region}], motion=MOVES)
    scene = load_scene(tables((12, 12), [wall], boundary={"top": {"kind": "outlet"}}))
    simulation, parameters = build(scene)
    fluid, step = initial_state(scene, simulation, parameters)[0].fluid, jnp.asarray(5)
    draw = np.random.default_rng(0)
    weights = [draw.standard_normal(a.shape) for a in jax.tree.leaves(parameters.fluid.cut.openings)]

    @jax.jit
    def figure(numbers, ways):
        def of(numbers):
            given = parameters._replace(wall_motion=(tuple({"rate": rate} for rate in numbers),))
            leaves = jax.tree.leaves(simulation.with_moved_walls(given, fluid, step)[0].fluid.cut.openings)
            return sum(jnp.sum(w * leaf) for w, leaf in zip(weights, leaves, strict=True))

        return jax.jvp(of, (numbers,), (ways,))

    now, size = jnp.asarray([0.25, 1.0]), 1e-6
    for way in (jnp.asarray([1.0, 0.0]), jnp.asarray([0.0, 1.0])):
        slope = float(figure(now, way)[1])
        higher, lower = (float(figure(now + sign * size * way, way)[0]) for sign in (1.0, -1.0))
        assert slope == pytest.approx((higher - lower) / (2.0 * size), rel=1e-5) and slope != 0.0


def test_grains_and_an_opening_share_the_volume():
    """A jet in a sloped floor below sinking grains that come in during the run, in a box closed but for the opening in
    its lid: the lid's opening lets out what jet and new grains bring."""
    slope = {"kind": "plane", "point": [0.2, 0.05], "normal": [0.5, 1.0], "fluid": "no_slip"}
    slope["opening"] = [
        {"kind": "inlet", "velocity": 0.2, "region": {"shape": "sphere", "center": [0.2, 0.05], "radius": 0.06}}
    ]
    lid = {"kind": "plane", "point": [0.2, 0.38], "normal": [0.0, -1.0], "fluid": "free_slip", "opening": [OUTLET]}
    changes = {
        "domain": {"size": [0.4, 0.4], "depth": 0.02, "gravity": [0.0, -9.81]},
        "fluid": {"cells": [16, 16], "density": 1000.0, "viscosity": 1e-4},
        "particles": {
            "radius": 0.008, "density": 2000.0, "position": [[0.15, 0.2], [0.25, 0.22], [0.2, 0.15], [0.2, 0.3]],
            "inlet": [{"start": [0.05, 0.3], "stop": [0.35, 0.36], "rate": 100.0, "velocity": [0.0, 0.0]}],
        },
        "contact": {"young_modulus": 1e7},
        "time": {"end": 0.2, "output_interval": 0.02},
    }  # fmt: skip
    _, _, state, told = advanced(load_scene(tables((16, 16), [slope, lid], **changes)), 5)
    assert told.fluid.divergence < 1e-11 and told.fluid.converged and told.fluid.finite
    assert float(state.particles.active.sum()) > 4.0
    assert told.exchange.momentum < 1e-12 and told.exchange.volume < 1e-12


def test_what_comes_in_brings_its_heat_and_dye():
    """Warm water with dye from a cylinder to one around it. After three times the time to fill the ring nearly all is
    as what comes in, nothing is beyond it, and what is there is what came in less what left, to rounding."""
    inlet = INLET | {"temperature": 320.0, "scalars": {"dye": 2.0}}
    changes = {
        "heat": {"fluid_heat_capacity": 1000.0, "fluid_conductivity": 0.01, "fluid_temperature": 300.0},
        "scalars": [{"name": "dye", "diffusivity": 0.0, "value": 0.5}],
    }
    given = tables((12, 12), [cylinder(INNER, False, [inlet]), cylinder(OUTER, True, [OUTLET])], **changes)
    scene = load_scene(given)
    simulation, parameters = build(scene)
    state, _ = initial_state(scene, simulation, parameters)
    cut = parameters.fluid.cut
    there, room = np.asarray(cut.open_cells) > 0.0, np.asarray(cut.open_cells + parameters.scalars.walls.lent)
    volume = simulation.fluid.solver.grid.cell_volume

    def held(state):
        return [volume * float(np.sum(room * np.where(there, field, 0.0))) for field in state.scalars.fields]

    begin, ring = held(state), np.pi * (OUTER**2 - INNER**2)
    for _ in range(int(3.0 * ring / FLOW / simulation.interval)):
        state, _, _ = compiled_step(simulation)(parameters, state, None)
    kept = zip(held(state), begin, np.asarray(state.scalars.supplied.sides).sum(axis=1), strict=True)
    assert all(abs(end - start - passed) < 1e-12 * end for end, start, passed in kept)
    names = [field.name for field in simulation.scalars.fields]
    warm, dye = (np.asarray(state.scalars.fields[names.index(name)])[there] for name in ("temperature", "dye"))
    assert warm.min() > 300.0 - 1e-9 and warm.mean() > 318.0 and warm.max() < 320.0 + 1e-9
    assert dye.min() > 0.5 - 1e-12 and dye.mean() > 1.9 and dye.max() < 2.0 + 1e-12
    del given["walls"][0]["opening"][0]["temperature"]
    assert "walls.0.opening.0.temperature" in refusal(given)


def test_a_cell_of_an_inlet_and_an_outlet_is_as_warm_as_what_comes_in():
    """Side by side on one cylinder, with their edge within a cell: an outlet has no temperature, and 0 K is none."""
    inlet = INLET | {"temperature": 320.0, "region": {"shape": "box", "start": [0.0, 0.0], "stop": [0.47, 1.0]}}
    outlet = OUTLET | {"region": {"shape": "box", "start": [0.47, 0.0], "stop": [1.0, 1.0]}}
    heat = {"fluid_heat_capacity": 1000.0, "fluid_conductivity": 0.01, "fluid_temperature": 300.0}
    scene = load_scene(tables((12, 12), [cylinder(OUTER, True, [inlet, outlet])], heat=heat))
    _, parameters, state, _ = advanced(scene, 10)
    into, out = (np.asarray(part.supply) for part in parameters.fluid.cut.openings)
    assert ((into > out) & (out > 0.0)).any()
    warm = np.asarray(state.scalars.fields[0])[np.asarray(parameters.fluid.cut.open_cells) > 0.0]
    assert warm.min() > 300.0 - 1e-9 and 302.0 < warm.max() < 320.0 + 1e-9


def test_inlets_that_share_a_cell_bring_the_heat_of_both():
    """A slow cold one beside a fast warm one, with their edge within a cell: Q_1 T_1 + Q_2 T_2 comes in from the wall.
    By area the cell would have another mixture. The check names both."""
    cold = INLET | {"temperature": 300.0, "region": {"shape": "box", "start": [0.0, 0.0], "stop": [0.47, 1.0]}}
    warm = cold | {
        "flow": 4.0 * FLOW,
        "temperature": 400.0,
        "region": {"shape": "box", "start": [0.47, 0.0], "stop": [1.0, 1.0]},
    }
    drain = cylinder(INNER, False, [OUTLET])
    heat = {"fluid_heat_capacity": 1000.0, "fluid_conductivity": 0.01, "fluid_temperature": 300.0}
    scene = load_scene(tables((12, 12), [cylinder(OUTER, True, [cold, warm]), drain], heat=heat))
    simulation, parameters, state, told = advanced(scene, 3)
    (text,) = [one for one in check_scene(scene).warnings if "share" in one]
    assert "walls.0.opening.0 and walls.0.opening.1 share" in text and "mixed there" in text
    np.testing.assert_allclose(told.fluid.passed[:, 0], [FLOW, 4.0 * FLOW, 0.0], rtol=1e-12, atol=0.0)
    came = float(state.scalars.supplied.sides[0][4])  # after the four sides of the box
    exact = (FLOW * 300.0 + 4.0 * FLOW * 400.0) * 3 * simulation.interval
    assert came == pytest.approx(exact, rel=1e-9)


@COMBINATION
def test_the_flow_between_two_spheres_is_radial(tmp_path):
    """u = Q/(4 pi r^2) in 3-D, to 0.6 % of its speed at the source, which has three cells a radius."""
    walls = []
    for name, radius in (("in", 0.2), ("out", 0.46)):
        ball = trimesh.creation.icosphere(3, radius)
        ball.apply_translation([0.5] * 3)
        ball.export(tmp_path / f"{name}.stl")
        wall = {"kind": "mesh", "file": str(tmp_path / f"{name}.stl"), "fluid": "free_slip", "inside": name == "out"}
        walls.append(wall | {"opening": [INLET if name == "in" else OUTLET]})
    simulation, parameters, state, told = advanced(load_scene(tables((16, 16, 16), walls)), 20)
    assert told.fluid.divergence < 1e-11
    grid, cut, errors = simulation.fluid.solver.grid, parameters.fluid.cut, []
    for axis in range(3):
        x = face_points(grid, axis) - 0.5
        r = np.linalg.norm(x, axis=-1)
        away = (r > 0.2 + 0.0625) & (r < 0.46 - 0.0625)
        exact = FLOW / (4.0 * np.pi * r**3) * x[..., axis]
        errors.append((np.asarray(state.fluid.face_velocity[axis]) - exact)[away])
    assert np.sqrt(np.mean(np.concatenate(errors) ** 2)) < 0.006 * FLOW / (4.0 * np.pi * 0.2**2)
    assert float(cut.openings[0].area) == pytest.approx(4.0 * np.pi * 0.2**2, rel=0.04)


def refusal(given):
    with pytest.raises(InputError) as caught:
        build(load_scene(given))
    assert caught.value.remedy
    return str(caught.value)


def test_what_does_not_work_is_refused_by_name():
    open_box = {"boundary": {"top": {"kind": "outlet"}}}

    def with_openings(*openings, wall=None, **changes):
        return tables((8, 8), [cylinder(0.2, False, list(openings), **(wall or {}))], **changes)

    assert "exceeds the outflow by 0.05" in refusal(with_openings(INLET))
    assert "walls.0.opening.0.kind" in refusal(with_openings(OUTLET, **open_box))
    away = {"shape": "sphere", "center": [0.1, 0.1], "radius": 0.05}
    assert "walls.0.opening.0.region" in refusal(with_openings(INLET | {"region": away}, **open_box))
    right = {"shape": "box", "start": [0.5, 0.0], "stop": [1.0, 1.0]}
    both = [INLET | {"region": right}, INLET]
    assert "same as that of walls.0.opening.0" in refusal(with_openings(*both, **open_box))
    left = {"shape": "box", "start": [0.0, 0.0], "stop": [0.5, 1.0]}
    build(load_scene(with_openings(INLET | {"region": right}, INLET | {"region": left, "flow": -FLOW})))
    assert "one of box, cylinder, sphere" in refusal(
        with_openings(INLET | {"region": {"shape": "polygon", "vertices": [[0, 0], [1, 0], [0, 1]]}}, **open_box)
    )
    unseen = {"kind": "plane", "point": [0.0, 0.1], "normal": [0.0, 1.0], "opening": [INLET]}
    grains = {
        "particles": {"radius": 0.01, "density": 2.0, "position": [[0.1, 0.9]]},
        "contact": {"young_modulus": 1e5},
    }
    assert "walls.0.opening" in refusal(tables((8, 8), [unseen], **grains, **open_box))
    assert "walls.0.end" in refusal(with_openings(INLET, wall={"end": 0.5}, **open_box))
    assert "one of velocity, flow" in refusal(with_openings(INLET | {"velocity": 1.0}, **open_box))
    in_time = {"kind": "inlet", "times": [0.0, 1.0], "flows": [0.0, FLOW]}
    assert "walls.0.opening.0.flows" in refusal(with_openings(in_time))
    assert "walls.0.opening.0.flows" in refusal(with_openings(in_time | {"flows": [0.0, 1e4]}, **open_box))
    once = refusal(with_openings(INLET | {"times": [0.0, 1.0]}, **open_box))
    assert "walls.0.opening.0.flow = 0.05" in once and "Give flows in its place" in once
    assert "is of an inlet" in refusal(with_openings(OUTLET | {"flow": 1.0}))
    assert "Set coupling.interval or fluid.time_step" in refusal(with_openings(INLET | {"flow": 1e3}, **open_box))
    enclosed = cylinder(0.2, True, [INLET])
    assert "no outlet" in refusal(tables((8, 8), [enclosed])) or "outflow" in refusal(tables((8, 8), [enclosed]))
    swings = cylinder(0.2, False, [{"kind": "inlet", "velocity": 0.1}, INLET | {"flow": -0.1}], motion=MOVES)
    swings["opening"][0]["region"], swings["opening"][1]["region"] = right, left
    assert "walls.0.opening.0.velocity" in refusal(tables((8, 8), [swings]))
    across = {"kind": "translation", "velocity": [0.0, -0.5]}
    lid = {"kind": "plane", "point": [0.0, 0.9], "normal": [0.0, -1.0], "fluid": "no_slip", "motion": [across]}
    assert "no way out" in refusal(tables((8, 8), [lid]))
    drain = {"kind": "plane", "point": [0.0, 0.125], "normal": [0.0, 1.0], "fluid": "no_slip", "opening": [OUTLET]}
    build(load_scene(tables((8, 8), [lid, drain])))
    high = {"shape": "box", "start": [0.0, 0.5], "stop": [1.0, 1.0]}
    behind = cylinder(0.2, False, [INLET | {"region": high}])
    assert "walls.1.opening.0.region = 'box': is covered" in refusal(tables((8, 8), [lid, behind, drain]))
    surface = {"level": 0.5, "density": 1.0, "viscosity": 1e-3}
    assert "surface" in refusal(with_openings(INLET, surface=surface, **open_box))


def test_areas_of_the_scene_are_those_of_its_arcs():
    """Both openings are parts 20 mm wide of a circle, 2 R asin(10 mm / R) long."""
    case = build_case(load_scene(Path(__file__).parents[1] / "scenes" / "jet_in_tank.toml"))
    arc = 2.0 * 0.095 * math.asin(0.01 / 0.095) * 0.01
    assert [one.area for one in case.fluid_walls.openings] == pytest.approx([arc, arc], rel=1e-3)


def test_check_tells_the_area_beside_that_of_a_finer_mesh():
    report = check_scene(load_scene(tables((8, 8), [cylinder(0.2, False, [INLET]), cylinder(OUTER, True, [OUTLET])])))
    (key, text), (_, other) = report.openings
    coarse, fine = (float(part.split(" m2")[0].split()[-1]) for part in text.split(", "))
    assert key == "walls.0.opening.0" and other.startswith("outlet of 2.")
    exact = 2.0 * np.pi * 0.2
    assert abs(fine - exact) < 0.5 * abs(coarse - exact) < 0.05 * exact
    assert "inlets and outlets on walls" in report.compiled_in
    case = build_case(load_scene(tables((8, 8), [cylinder(0.2, False, None)], boundary={"top": {"kind": "outlet"}})))
    assert case.parameters.fluid.cut.openings is None and case.simulation.fluid.solver.openings == ()

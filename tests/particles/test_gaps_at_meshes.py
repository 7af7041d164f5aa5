"""What acts over a gap at walls that are meshes: as at planes, over edges, on meshes that move; energy."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

import jaxdem
from jaxdem.setup.builder import build_case
from tests.cases.energy import BOX, RADIUS, balance_of, with_tables
from tests.cases.surfaces import flight, grains_scene, plane_mesh, saved
from tests.cases.tiers import COMBINATION, tiered

KINDS = {
    "jkr": {"cohesion": {"kind": "jkr", "work_of_adhesion": 0.05}},
    "van_der_waals": {"cohesion": {"kind": "van_der_waals", "hamaker_constant": 1e-9, "minimum_gap": 2e-5,
                                   "cutoff": 4e-4}},
    "capillary": {"cohesion": {"kind": "capillary", "surface_tension": 0.07, "liquid_content": 0.01,
                               "liquid_viscosity": 1e-3, "minimum_gap": 1e-5}},
    "lubrication": {"lubrication": {"cutoff": 2e-4, "roughness": 2e-6, "viscosity": 2e-3}},
}  # fmt: skip
HEIGHT = 0.005

IN_SPACE = with_tables(
    BOX,
    domain={"size": [0.02, 0.02, 0.02]},
    particles={
        "position": [[0.004, 0.007, HEIGHT + 1.0002 * RADIUS], [0.012, 0.011, HEIGHT + 1.03 * RADIUS],
                     [0.017, 0.014, HEIGHT + 1.08 * RADIUS]],
        "velocity": [[0.5, 0.2, -0.005], [0.3, -0.2, -0.2], [0.0, 0.1, -0.12]],
        "angular_velocity": [[-200.0, 500.0, 5.0], [50.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
    },
    contact={"restitution": 0.6, "time_step": 8e-7},
    time={"end": 0.008, "output_interval": 0.008},
)  # fmt: skip
"""Grains that slide and roll over most of a plane, part from it, and stay away."""

IN_PLANE = with_tables(
    IN_SPACE,
    domain={"size": [0.02, 0.02]},
    particles={
        name: [[row[0], row[-1]] if len(row) == 3 and name != "angular_velocity" else [row[1]] for row in rows]
        for name, rows in IN_SPACE["particles"].items() if isinstance(rows, list)
    },
)  # fmt: skip


def planes_of(dimension, folder, cells):
    """A plane, and the same plane as a mesh."""
    if dimension == 2:
        places = np.linspace(-0.01, 0.03, cells + 1)
        mesh = {"points": [[float(x), HEIGHT] for x in places]}
        return {"kind": "plane", "point": [0.0, HEIGHT], "normal": [0.0, 1.0]}, {"kind": "mesh", **mesh}
    path = saved(plane_mesh(round((cells / 2) ** 0.5), -0.01, 0.03, HEIGHT, 0.3), folder / "plane.ply")
    return {"kind": "plane", "point": [0.0, 0.0, HEIGHT], "normal": [0.0, 0.0, 1.0]}, {"kind": "mesh", "file": path}


def kept_by(state, number, at_mesh):
    """Sums over the contacts with the wall of what they keep."""
    memory = state.particles.mesh_memory[0].spring if at_mesh else state.particles.wall_spring
    return np.asarray([np.sum(np.asarray(part if at_mesh else part[number])) for part in memory])


MOTION = {
    2: [{"kind": "oscillation", "direction": [0.3, 1.0], "amplitude": 1e-5, "frequency": 120.0},
        {"kind": "rotation", "center": [0.01, HEIGHT], "rate": 0.3}],
    3: [{"kind": "oscillation", "direction": [0.0, 0.3, 1.0], "amplitude": 1e-5, "frequency": 120.0},
        {"kind": "rotation", "axis": [0.6, 0.8, 0.2], "center": [0.01, 0.01, HEIGHT], "rate": 0.3}],
}  # fmt: skip
CASES = [(kind, *rest) for kind in KINDS for rest in ((2, 40, True), (3, 2, False), (3, 800, True))]
FIRST = [("jkr", 2, 40, True)]


@pytest.mark.parametrize(("kind", "dimension", "cells", "moves"), tiered(CASES, first=FIRST))
def test_a_mesh_is_a_plane(kind, dimension, cells, moves, tmp_path):
    """Motion, what contacts keep, what is stored and what is taken, part by part; the balance closes."""
    tables = with_tables(IN_SPACE if dimension == 3 else IN_PLANE, contact=KINDS[kind])
    motion = {"motion": MOTION[dimension]} if moves else {}
    walls = [wall | motion for wall in planes_of(dimension, tmp_path, cells)]
    plane, mesh = (balance_of(with_tables(tables, walls=[wall])) for wall in walls)
    expected, found = (one["state"].particles for one in (plane, mesh))
    for name in ("position", "velocity", "angular_velocity"):
        scale = np.abs(getattr(expected, name)).max()
        assert np.abs(getattr(found, name) - getattr(expected, name)).max() < 1e-11 * scale, name
    turned_over = mesh["gained"] / mesh["gained_relative"]
    for part in ("dissipated", "start", "end", "work"):
        for name, value in plane[part].items():
            assert mesh[part][name] == pytest.approx(value, rel=1e-9, abs=1e-13 * turned_over), (part, name)
    assert abs(mesh["gained_relative"]) < 1e-6 and abs(mesh["missing"]) < 1e-11 * turned_over
    assert abs(mesh["end"]["surface"] + mesh["dissipated"]["liquid"]) > 1e-6 * turned_over
    kept = kept_by(plane["state"], 2 * dimension, False)
    assert np.abs(kept).max() > 0.0
    np.testing.assert_allclose(kept_by(mesh["state"], 0, True), kept, rtol=1e-7, atol=1e-9 * np.abs(kept).max())


HILLS = {
    "kind": "mesh", "points": [[-0.01, 0.004], [0.004, 0.004], [0.0065, 0.0052], [0.009, 0.004], [0.03, 0.004]],
    "motion": [{"kind": "oscillation", "direction": [1.0, 0.3], "amplitude": 2e-4, "frequency": 120.0}],
}  # fmt: skip
"""Two concave edges and a convex one between them, that shake."""


@pytest.mark.parametrize("kind", tiered(KINDS, first=["van_der_waals"]))
def test_the_energy_of_grains_that_go_over_edges(kind):
    """One that goes over a concave edge up to the top, and one that goes into another one and out of it.

    An attraction to the side of a concave edge that a grain leaves ends with it, at a gap at which it still acts.
    """
    grains = {
        "position": [[0.003, 0.004 + 1.001 * RADIUS], [0.0105, 0.004 + 1.05 * RADIUS]],
        "velocity": [[0.6, 0.0], [-0.4, -0.01]], "angular_velocity": [[-400.0], [100.0]],
    }  # fmt: skip
    found = balance_of(with_tables(IN_PLANE, contact=KINDS[kind], particles=grains, walls=[HILLS]))
    turned_over = found["gained"] / found["gained_relative"]
    assert abs(found["gained_relative"]) < 1e-6 and abs(found["missing"]) < 1e-11 * turned_over
    assert abs(found["work"]["walls"]) > 1e-4 * turned_over
    if "cohesion" in KINDS[kind]:
        assert abs(found["dissipated"]["adhesion"]) > 1e-4 * turned_over
    particles = found["state"].particles
    assert float(particles.position[0, 0]) > 0.0064
    if kind == "capillary":
        bridges = sum(float(np.sum(x[-1])) for x in (particles.mesh_memory[0].spring, particles.wall_spring))
        start = 2.0 * 0.01 * 4.0 / 3.0 * np.pi * RADIUS**3
        assert 0.0 < bridges == pytest.approx(start - float(np.sum(particles.liquid)), rel=1e-12)


@pytest.mark.parametrize("kind", tiered(["nothing", *KINDS], first=["nothing", "jkr"]))
def test_the_energy_of_a_grain_that_is_pressed_into_a_shallow_concave_edge(kind):
    """It touches both sides; a contact comes and goes with the energy that its springs store at a depth. The first one
    is there from the start."""
    bend, weight = np.radians(4.0), 490.0
    points = [[-0.01, HEIGHT], [0.01, HEIGHT], [0.01 + 0.02 * np.cos(bend), HEIGHT + 0.02 * np.sin(bend)]]
    tables = with_tables(
        IN_PLANE, domain={"size": [0.02, 0.02], "gravity": [0.0, -weight]},
        particles={"position": [[0.0092, HEIGHT + 0.9985 * RADIUS]], "velocity": [[0.5, 0.0]],
                   "angular_velocity": [[-500.0]]},
        contact=KINDS.get(kind, {}) | {"restitution": 0.9, "time_step": 4e-7},
        walls=[{"kind": "mesh", "points": points}], time={"end": 0.0025, "output_interval": 0.0025},
    )  # fmt: skip
    found = balance_of(tables)
    assert float(found["state"].particles.position[0, 0]) > 0.0101
    turned_over = found["gained"] / found["gained_relative"]
    assert abs(found["gained_relative"]) < 1e-7 and abs(found["missing"]) < 1e-11 * turned_over
    assert abs(found["dissipated"]["adhesion"]) > 1e-5 * turned_over


PULLS = {"jkr": 1.5 * np.pi * 0.05 * RADIUS, "capillary": 4.0 * np.pi * 0.02 * RADIUS}
"""Pull-off forces of a sphere and a plane: 3/2 pi w R and 4 pi gamma R [N]."""


@pytest.mark.parametrize("kind", tiered(PULLS, first=["jkr"]))
def test_a_plate_that_a_force_lifts_off_grains(kind):
    """A piston that is a mesh, on two grains that stick to it and to the floor: 0.97 of the weight of the plate and two
    pull-off forces holds it, 1.05 parts it from them, and the balance of energy closes."""
    mass, gravity, low = 4e-5, 9.81, (1.0 - 2e-3) * RADIUS
    table = KINDS[kind]["cohesion"] | ({"surface_tension": 0.02} if kind == "capillary" else {})
    plate = {"kind": "mesh", "points": [[-0.001, 2.0 * low], [0.021, 2.0 * low]]}
    force = [share * (mass * gravity + 2.0 * PULLS[kind]) for share in (0.0, 0.97, 0.97, 1.05)]
    held = {"direction": [0.0, 1.0], "mass": mass, "damping": 0.05, "force": force,
            "force_times": [0.0, 0.006, 0.012, 0.0125]}  # fmt: skip
    tables = with_tables(
        IN_PLANE, domain={"size": [0.02, 0.02], "gravity": [0.0, -gravity]}, walls=[plate | {"piston": held}],
        particles={"position": [[0.006, low], [0.014, low]], "velocity": [[0.0, 0.0]] * 2,
                   "angular_velocity": [[0.0]] * 2},
        contact={"cohesion": table, "time_step": 5e-6, "speed": 0.1}, coupling={"interval": 3e-3},
        time={"end": 0.024, "output_interval": 0.024},
    )  # fmt: skip
    found = balance_of(tables)
    way = np.array([float(state.particles.pistons.displacement[0]) for state in found["states"]]) / RADIUS
    speed = np.array([float(state.particles.pistons.velocity[0]) for state in found["states"]])
    assert abs(way[3]) < 4e-3 and abs(speed[3]) < 1e-4 and way[-1] > 3.0 * way[3] and speed[-1] > 1e-3
    turned_over = found["gained"] / found["gained_relative"]
    assert abs(found["gained_relative"]) < 5e-6 and abs(found["missing"]) < 1e-11 * turned_over
    assert found["end"]["surface"] != 0.0 and float(found["state"].particles.position[0, 1]) < RADIUS


def test_van_der_waals_round_a_cube(tmp_path):
    """A R/(6 h^2) towards the nearest point of a face, an edge or a corner, at gaps h up to the cutoff."""
    size, hamaker, cutoff, step = 0.02, 1e-9, 5e-3, 1e-7
    on = np.array([[i, j, k] for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1) if (i, j, k) != (0, 0, 0)])
    random = np.random.default_rng(0)
    direction = on * random.uniform(0.3, 1.0, on.shape)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    gap = np.geomspace(2e-5, 1.2 * cutoff, len(on))
    random.shuffle(gap)
    flat = np.abs(on) == 0  # anywhere along a face or an edge
    nearest = 0.5 + 0.15 * np.where(flat, random.uniform(-0.3, 0.3, on.shape), on)
    wall = {"kind": "mesh", "file": saved(trimesh.creation.box(), tmp_path / "cube.ply"), "scale": 0.3,
            "translate": [0.5, 0.5, 0.5], "touch": "front", "closed": True}  # fmt: skip
    cohesion = {"kind": "van_der_waals", "hamaker_constant": hamaker, "minimum_gap": 1e-5, "cutoff": cutoff}
    tables = grains_scene(
        [wall], nearest + (size + gap)[:, None] * direction, contact={"cohesion": cohesion, "time_step": step},
        domain={"gravity": [0.0, 0.0, 0.0]}, time={"end": step, "output_interval": step},
    )  # fmt: skip
    expected = np.where(gap < cutoff, hamaker * size / (6.0 * gap**2), 0.0)
    assert np.sum(expected == 0.0) in range(1, 5)
    found = flight(tables, 1).force[0]
    least = expected[expected > 0.0].min()
    np.testing.assert_allclose(found, -expected[:, None] * direction, rtol=1e-9, atol=1e-9 * least)


@pytest.mark.parametrize(("smooth_angle", "sides"), [(10.0, 1), (1.0, 2)])
def test_a_smooth_bend_attracts_as_one_surface(smooth_angle, sides):
    """A grain before the corner of two lines that bend by 7.5 degrees, as seen in a pipe of 48 sides: the sum of two
    attractions, each towards its line, only where the corner counts as an edge."""
    bend, gap, hamaker, step = np.radians(7.5), 1e-4, 1e-9, 1e-7
    along = np.array([np.cos(0.5 * bend), np.sin(0.5 * bend)])
    corner = np.array([0.01, 0.005])
    points = [corner + 0.03 * along * [-1.0, 1.0], corner, corner + 0.03 * along]
    centre = corner + [0.0, (RADIUS + gap) / along[0]]
    wall = {"kind": "mesh", "points": [point.tolist() for point in points], "smooth_angle": smooth_angle}
    cohesion = {"kind": "van_der_waals", "hamaker_constant": hamaker, "minimum_gap": 2e-5, "cutoff": 4e-4}
    tables = with_tables(
        IN_PLANE, domain={"size": [0.02, 0.02], "gravity": [0.0, 0.0]}, walls=[wall],
        particles={"position": [centre.tolist()], "velocity": [[0.0, 0.0]], "angular_velocity": [[0.0]]},
        contact={"cohesion": cohesion, "time_step": step}, output={"energy": False},
        time={"end": step, "output_interval": step},
    )  # fmt: skip
    force = flight(tables, 1).force[0, 0]
    pull = hamaker * RADIUS / (6.0 * gap**2)
    expected = {1: [pull * along[1], pull * along[0]], 2: [0.0, 2.0 * pull * along[0]]}[sides]
    np.testing.assert_allclose(np.abs(force), expected, rtol=1e-9, atol=1e-9 * pull)


def test_every_impact_under_one_bridge_wears_the_mesh(tmp_path):
    """A wet grain that rebounds twice by less than its bridge is long: Finnie's law counts two impacts."""
    wear = {"wear": {"model": "finnie", "coefficient": 0.1, "flow_stress": 1e9}}
    cohesion = {"kind": "capillary", "surface_tension": 0.002, "liquid_content": 0.01}
    tables = with_tables(
        IN_SPACE, contact={"cohesion": cohesion, "restitution": 0.95, "friction": 0.0}, output={"energy": False},
        particles={"position": [[0.01, 0.01, HEIGHT + 1.02 * RADIUS]], "velocity": [[0.3, 0.0, -0.03]],
                   "angular_velocity": [[0.0, 0.0, 0.0]]},
        walls=[planes_of(3, tmp_path, 2)[1] | wear], coupling={"interval": 3e-3},
        time={"end": 0.012, "output_interval": 0.012},
    )  # fmt: skip
    case = build_case(jaxdem.load_scene(tables))
    (state, neighbors), worn, bridges, step = case.initial_state(), [], [], jax.jit(case.simulation.step)
    for _ in range(4):
        state, neighbors, _ = step(case.parameters, state, neighbors)
        worn.append(float(np.sum(state.particles.mesh_wear[0].volume)))
        bridges.append(float(np.sum(state.particles.mesh_memory[0].spring[-1])))
    assert worn[0] > 0.0 and len(set(bridges)) == 1 and bridges[0] > 0.0
    assert 1.8 < worn[-1] / worn[0] < 2.2


@COMBINATION
def test_the_gradient_by_the_work_of_adhesion_is_that_of_differences():
    """Of the speed of two grains after they have touched a mesh, in reverse mode."""
    times = {"coupling": {"interval": 4e-4}, "time": {"end": 4e-4, "output_interval": 4e-4}}
    mesh = planes_of(2, None, 40)[1]
    tables = with_tables(IN_PLANE, contact=KINDS["jkr"], walls=[mesh], output={"energy": False}, **times)
    case = build_case(jaxdem.load_scene(tables))
    simulation, start = case.simulation.reversible(), case.initial_state()

    def speed(work):
        contact = case.parameters.contact
        contact = contact._replace(cohesion=contact.cohesion._replace(strength=work))
        state = simulation.step(case.parameters._replace(contact=contact), *start)[0]
        return jnp.sum(state.particles.velocity[:2, 1])

    both, own = jax.jit(jax.value_and_grad(speed)), case.parameters.contact.cohesion.strength
    more, less = (float(both(own * (1.0 + sign * 1e-4))[0]) for sign in (1.0, -1.0))
    slope = float(both(own)[1])
    assert abs(slope) > 0.01
    assert slope == pytest.approx((more - less) / (2e-4 * float(own)), rel=1e-5)


def test_films_at_both_sides_of_a_shallow_concave_edge_only_slow_a_grain():
    """At the automatic step, which is that of both resistances together."""
    slope, step = np.radians(1.0), 1e-5
    side = 0.02 * np.array([np.cos(slope), np.sin(slope)])
    points = [[0.01 - side[0], HEIGHT + side[1]], [0.01, HEIGHT], [0.01 + side[0], HEIGHT + side[1]]]
    film = {"cutoff": 1e-4, "roughness": 2e-6, "viscosity": 1.0, "shear": False}
    tables = with_tables(
        IN_PLANE, domain={"size": [0.02, 0.02], "gravity": [0.0, 0.0]},
        particles={"position": [[0.01, HEIGHT + 1.0005 * RADIUS / np.cos(slope)]], "velocity": [[0.0, -1e-4]],
                   "angular_velocity": [[0.0]]},
        contact={"friction": 0.0, "time_step": "auto", "speed": 0.1, "lubrication": film}, output={"energy": False},
        walls=[{"kind": "mesh", "points": points}], coupling={"interval": step},
        time={"end": 4 * step, "output_interval": 4 * step},
    )  # fmt: skip
    speed = np.linalg.norm(flight(tables, 4).velocity[:, 0], axis=1)
    assert np.all(np.diff(speed) <= 0.0) and speed[0] < 1e-4

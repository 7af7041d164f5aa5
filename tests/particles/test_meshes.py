"""Grains on meshes: like analytic walls, over edges and corners, in corners and pipes, in float32, and on resume."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

import jaxdem
from jaxdem.errors import InputError
from jaxdem.observables.walls import measuring_walls
from jaxdem.particles import mesh_forces
from jaxdem.particles.contact_step import ContactStep
from jaxdem.particles.forces import contact_forces
from jaxdem.particles.integrate import Motion
from jaxdem.particles.materials import surroundings
from jaxdem.run.restart import from_arrays, to_arrays
from jaxdem.setup.builder import build_case
from tests.cases.steps import compiled_step
from tests.cases.surfaces import flight, grains_scene, pipe_mesh, plane_mesh, saved
from tests.cases.tiers import COMBINATION, tiered

HEIGHT = 0.3
PLANE = {"kind": "plane", "point": [0.0, 0.0, HEIGHT], "normal": [0.0, 0.0, 1.0]}


def on_mesh(path, **given):
    return {"kind": "mesh", "file": str(path), "translate": [0.0, 0.0, HEIGHT], **given}


def twelve():
    """Grains in all directions over the plane: some that fall, some that slide, roll and spin."""
    angle = 2.0 * np.pi * np.arange(12) / 12 + 0.1
    place = np.array([0.5, 0.5]) + 0.2 * np.stack([np.cos(angle), np.sin(angle)], 1)
    height = np.where(np.arange(12) % 2, HEIGHT + 0.02, HEIGHT + 0.03)
    away = np.stack([np.cos(2.1 * angle), np.sin(2.1 * angle), -0.5 * (np.arange(12) % 2 == 0)], 1)
    spin = 10.0 * np.stack([np.sin(angle), np.cos(3 * angle), np.sin(5 * angle)], 1)
    return np.column_stack([place, height]), 0.5 * away, spin


@pytest.fixture(scope="module")
def planes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("planes")
    return {
        cells: saved(plane_mesh(squares, warp=warp), folder / f"{cells}.ply")
        for cells, squares, warp in ((2, 1, 0.0), (200, 10, 0.3), (20000, 100, 0.3))
    }


@pytest.mark.parametrize(
    ("precision", "within", "triangles"),
    [
        ("float64", 1e-12, 20000),
        pytest.param("float64", 1e-12, 2, marks=COMBINATION),
        pytest.param("float32", 1e-6, 200, marks=COMBINATION),
    ],
)
def test_a_plane_of_triangles_is_a_plane(planes, precision, within, triangles):
    """Impact, sliding and rolling over edges and corners in all directions."""
    grains = twelve()
    expected = flight(grains_scene([PLANE], *grains, precision=precision), 16)
    assert np.ptp(expected.position[:, :, 0], axis=0).max() > 0.06  # over many of the triangles
    found = flight(grains_scene([on_mesh(planes[triangles])], *grains, precision=precision), 16)
    assert np.abs(found.position - expected.position).max() < within * 0.04
    assert np.abs(found.spin - expected.spin).max() < 50 * within * np.abs(expected.spin).max()


def test_a_plane_of_triangles_that_moves_is_a_plane_that_moves(planes):
    """It swings, turns and shifts, one on top of the other; in periodic directions too."""
    motion = [
        {"kind": "oscillation", "direction": [0.0, 0.0, 1.0], "amplitude": 0.004, "frequency": 9.0},
        {"kind": "rotation", "axis": [0.0, 1.0, 0.0], "center": [0.5, 0.0, HEIGHT], "rate": 0.4},
        {"kind": "translation", "velocity": [0.3, 0.1, 0.02]},
    ]
    grains = twelve()
    expected = flight(grains_scene([PLANE | {"motion": motion}], *grains), 16)
    found = flight(grains_scene([on_mesh(planes[200], motion=motion)], *grains), 16)
    assert np.abs(found.position - expected.position).max() < 1e-12
    still = flight(grains_scene([PLANE], *grains), 16)  # the program of the test before
    assert np.abs(still.position - expected.position).max() > 1e-3


@COMBINATION
@pytest.mark.parametrize("model", ["epsd", "cdt"])
def test_a_turning_plane_of_triangles_resists_rolling_as_a_turning_plane(planes, model):
    """Rolling resistance is against the spin of the wall; one against the spin in the box would brake the grains."""
    motion = [{"kind": "rotation", "axis": [0.6, 0.8, 0.0], "center": [0.5, 0.5, HEIGHT], "rate": 0.5}]
    contact = {"rolling_friction": 0.1, "rolling_model": model, "speed": 2.0}
    position, velocity, spin = (rows[::2] for rows in twelve())
    grains = position - [0.0, 0.0, 2e-4], velocity * [1.0, 1.0, 0.0], spin
    expected = flight(grains_scene([PLANE | {"motion": motion}], *grains, contact=contact), 6)
    found = flight(grains_scene([on_mesh(planes[200], motion=motion)], *grains, contact=contact), 6)
    assert np.abs(expected.force).max() > 0.0
    assert np.abs(found.spin - expected.spin).max() < 1e-10 * np.abs(expected.spin).max()
    still = flight(grains_scene([PLANE], *grains, contact=contact), 6)
    assert np.abs(still.spin - expected.spin).max() > 0.1


def test_grains_are_looked_for_where_a_mesh_is_at_the_start(planes):
    """Its motion has it a tenth of a metre below the place of its file, and turned by a right angle."""
    motion = [
        {"kind": "table", "angle": [90.0 * np.pi / 180.0] * 2, "times": [0.0, 1.0],
         "axis": [0.0, 1.0, 0.0], "center": [0.5, 0.5, HEIGHT]},
        {"kind": "table", "displacement": [0.1, 0.1], "times": [0.0, 1.0], "direction": [1.0, 0.0, 0.0]},
    ]  # fmt: skip
    for wall in (PLANE | {"normal": [0.0, 0.0, 1.0]}, on_mesh(planes[2], touch="front")):
        walls = [wall | {"motion": motion}]  # now at x = 0.6, its front to larger x
        case = build_case(jaxdem.load_scene(grains_scene(walls, [[0.65, 0.5, HEIGHT], [0.9, 0.2, HEIGHT]])))
        case.initial_state()
        within = grains_scene(walls, [[0.9, 0.5, 0.4], [0.6, 0.5, 0.4]])
        with pytest.raises(InputError, match=r"particle 1 at .* reaches 50 % of its diameter into walls.0"):
            build_case(jaxdem.load_scene(within)).initial_state()


CUBE = {"kind": "mesh", "touch": "front", "closed": True}


def test_directions_are_continuous_over_a_convex_edge_and_corner(tmp_path):
    """The force on a grain that is held at an overlap points from the nearest point of a cube, and jumps nowhere."""
    path = saved(trimesh.creation.box(), tmp_path / "cube.ply")
    corner, way = np.array([0.7, 0.7, 0.7]), np.linspace(0.0, 1.0, 241)
    directions = np.stack([np.cos(np.pi * way), np.sin(np.pi * way), np.full_like(way, 0.4)], 1)
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    over_edge = [0.7, 0.45, 0.7] + 0.0199 * np.stack([np.cos(1.5 * way), 0 * way, np.sin(1.5 * way)], 1)
    for places in (corner + 0.0199 * np.abs(directions[60:180]), over_edge):
        force, normal = held(path, places, scale=0.4, translate=[0.5, 0.5, 0.5])
        nearest = np.clip(places, 0.3, 0.7)
        expected = (places - nearest) / np.linalg.norm(places - nearest, axis=1)[:, None]
        assert np.abs(normal - expected).max() < 1e-9
        assert np.ptp(np.linalg.norm(force, axis=1)) < 1e-6 * np.linalg.norm(force, axis=1).max()


def held(path, places, **given):
    """Forces (N, 3) and their directions on grains held at places, each alone: at rest, without gravity."""
    scene = jaxdem.load_scene(
        grains_scene([CUBE | {"file": path} | given], [[0.1, 0.1, 0.1], [0.9, 0.1, 0.1]], domain={"gravity": [0, 0, 0]})
    )
    case = build_case(scene)
    state, _ = case.initial_state()
    model = case.simulation.contact.model
    around = surroundings(case.parameters.materials, case.simulation.wall_velocity(case.parameters, jnp.zeros(())))
    room = None

    @jax.jit
    def force(place):
        position = state.particles.position.at[0].set(place)
        particles = state.particles._replace(position=position)
        motion = Motion.of(particles)
        listed = case.simulation.search._built(
            motion.position, motion.low, case.parameters.bodies.radius, room, None,
            case.parameters.meshes,
        )  # fmt: skip
        step = ContactStep(model, around, case.parameters.bodies, motion, motion.velocity, jnp.asarray(1e-5))
        sums, _ = contact_forces(step, listed)
        return jnp.stack(sums.force, axis=1)[0], listed.overflow

    room = case.simulation.room(case.parameters, state.particles)
    found, overflow = jax.lax.map(force, jnp.asarray(places))
    assert not overflow.any()
    found = np.asarray(found)
    return found, found / np.linalg.norm(found, axis=1)[:, None]


@pytest.mark.parametrize("smooth_angle", tiered([1.0, 5.0], first=[1.0]))
def test_a_wedge_of_triangles_is_a_wedge(tmp_path, smooth_angle):
    """A concave edge of 90 degrees: two contacts, and the statics of the wedge: each side bears W / sqrt 2."""
    points = [[0.1, 0.9], [0.5, 0.5], [0.9, 0.9]]
    mesh = {"kind": "mesh", "points": points, "smooth_angle": smooth_angle}
    wedge = {"kind": "wedge", "apex": [0.5, 0.5], "directions": [[-1.0, 1.0], [1.0, 1.0]]}
    given = dict(
        position=[[0.5, 0.5 + 0.02 * 2**0.5], [0.52, 0.56]],
        domain={"size": [1.0, 1.0]},
        contact={"restitution": 0.1, "friction": 0.3, "time_step": 1e-4},  # the wedge alone reaches sides of the box
    )
    of_mesh, of_wedge = (flight(grains_scene([wall], **given), 40) for wall in (mesh, wedge))
    assert np.abs(of_mesh.position - of_wedge.position).max() < 1e-12
    weight = 2500.0 * 4.0 / 3.0 * np.pi * 0.02**3 * 9.81
    assert of_mesh.force[-1, 0] == pytest.approx([0.0, weight], abs=1e-3 * weight)


@pytest.mark.parametrize("sides", tiered([12, 48], first=[12]))
def test_a_grain_rests_in_a_pipe_of_flat_sides(tmp_path, sides):
    """As deep as in the cylinder, within R (1 - cos(pi / n)): on a side, and rolling it finds one contact."""
    radius = 0.4
    path = saved(pipe_mesh(sides, radius, 1.0), tmp_path / "pipe.ply")
    mesh = {"kind": "mesh", "file": path, "translate": [0.5, 0.0, 0.5], "touch": "front", "smooth_angle": 30.0}
    grain = dict(position=[[0.5, 0.4, 0.135], [0.5, 0.6, 0.135]], contact={"restitution": 0.1})
    found = flight(grains_scene([mesh], **grain), 25)
    sagitta = radius * (1.0 - np.cos(np.pi / sides))
    above = found.position[-1, 0, 2] - (0.5 - radius + 0.02)
    assert abs(above) < sagitta + 0.01 * 0.04


def test_friction_goes_on_over_an_edge_between_coplanar_triangles(planes, monkeypatch):
    """A grain that slides loses mu g t over all edges. Forgotten springs would show on a slow one, and do."""
    mu = 0.2
    position = [[0.2, 0.31, HEIGHT + 0.02 - 1e-5], [0.2, 0.7, HEIGHT + 0.02 - 1e-5]]
    grains = dict(
        position=position, velocity=[[1.5, 0.2, 0.0], [0.05, 0.0, 0.0]], contact={"friction": mu, "restitution": 0.1}
    )
    expected = flight(grains_scene([PLANE], **grains), 8)
    found = flight(grains_scene([on_mesh(planes[20000])], **grains), 8)
    assert np.abs(found.velocity - expected.velocity).max() < 1e-10
    speed = np.linalg.norm(found.velocity[:, 0, :2], axis=1)
    assert np.diff(speed) == pytest.approx(-mu * 9.81 * 0.01, rel=0.05)
    monkeypatch.setattr(mesh_forces, "remembered", lambda memory, *_: tuple(0.0 * x for x in memory.spring))
    compiled_step.cache_clear()
    forgotten = flight(grains_scene([on_mesh(planes[20000])], **grains), 8)
    assert np.abs(forgotten.velocity - expected.velocity)[:, 1].max() > 1e-3


def test_meshes_that_cannot_be_meant_are_refused(tmp_path):
    mesh = trimesh.creation.box()
    sound = saved(mesh, tmp_path / "sound.ply")
    mesh.faces = np.concatenate([mesh.faces, mesh.faces[:2]])
    twice = saved(mesh, tmp_path / "twice.ply")
    place = {"scale": 0.2, "translate": [0.5, 0.5, 0.5]}
    free = [[0.1, 0.1, 0.1], [0.2, 0.2, 0.9]]
    for wall, position, words in (
        ({"file": sound, "scale": 1000.0}, free, "scale = 0.001"),
        ({"file": sound, **place, "translate": [5.0, 0.5, 0.5]}, free, "outside of the box"),
        ({"file": twice, **place}, free, "2 triangles that are there already"),
        ({"file": str(tmp_path / "none.stl"), **place}, free, "cannot be read"),
        ({"file": sound, **place, "spacing": [1.0, 1.0]}, free, "heights"),
        ({"file": sound, **place}, [[0.61, 0.5, 0.5], [0.2, 0.2, 0.9]], "walls.0"),
        ({"file": sound, **place, "touch": "front"}, [[0.5, 0.5, 0.5], [0.2, 0.2, 0.9]], "lies inside of walls.0"),
    ):
        with pytest.raises(InputError, match=words):
            flight(grains_scene([{"kind": "mesh", **wall}], position), 1)
    # One that moves may come in later.
    far = {"kind": "mesh", "file": sound, **place, "translate": [5.0, 0.5, 0.5]}
    scene = jaxdem.load_scene(
        grains_scene([far | {"motion": [{"kind": "translation", "velocity": [-0.1, 0.0, 0.0]}]}], free)
    )
    assert len(build_case(scene).particles.meshes) == 1
    for region in ({"start": [0.1, 0.1, 0.1], "stop": [0.6, 0.6, 0.6]},
                   {"region": {"shape": "sphere", "center": [0.5, 0.5, 0.75], "radius": 0.16}}):  # fmt: skip
        inlet = region | {"rate": 1000.0, "velocity": [0.0, 0.0, 0.0]}
        tables = grains_scene([{"kind": "mesh", "file": sound, **place}], free, particles={"inlet": [inlet]})
        with pytest.raises(InputError, match=r"particles\.inlet\.0.*walls\.0"):
            flight(tables, 1)
    repaired = grains_scene([{"kind": "mesh", "file": twice, **place, "repair": True}], free)
    build_case(jaxdem.load_scene(repaired)).initial_state()


@COMBINATION
def test_a_resumed_run_is_the_same_bit_for_bit_and_loads_are_measured(planes):
    """State, list and what contacts with the mesh keep go through a checkpoint; the mesh bears the weight."""
    weight = 2500.0 * 4.0 / 3.0 * np.pi * 0.02**3 * 9.81
    position = [[0.31, 0.4, HEIGHT + 0.0199], [0.62, 0.7, HEIGHT + 0.0199]]
    tables = grains_scene(
        [on_mesh(planes[200])], position, velocity=[[0.2, 0.1, 0.0]] * 2, precision="float32",
        contact={"rolling_friction": 0.05, "rolling_model": "epsd", "restitution": 0.2},
    )  # fmt: skip
    case = build_case(jaxdem.load_scene(tables))
    simulation = measuring_walls(case.simulation)
    first, listed = case.initial_state()
    step = jax.jit(simulation.step)

    def after(state, neighbors, count):
        for _ in range(count):
            state, neighbors, report = step(case.parameters, state, neighbors)
        assert not bool(report.particles.overflow)
        return state, neighbors, report

    middle = after(first, listed, 3)
    assert np.abs(np.asarray(middle[0].particles.mesh_memory[0].spring[0])).max() > 0.0
    arrays = to_arrays(middle[0], middle[1], {})
    assert not [name for name in arrays if "surface" in name]
    state, neighbors, _ = from_arrays(simulation, first, arrays, case.parameters.meshes)
    through, straight = after(state, neighbors, 12), after(*middle[:2], 12)
    for one, other in zip(jax.tree.leaves(through[:2]), jax.tree.leaves(straight[:2]), strict=True):
        assert np.array_equal(one, other)
    load = straight[2].particles.walls
    assert float(load.force[2][-1]) == pytest.approx(-2.0 * weight, rel=0.05)
    assert float(load.mass[0][-1]) == pytest.approx(2.0 * weight / 9.81, rel=1e-5)


@pytest.mark.parametrize("dimension", tiered([2, 3], first=[2]))
def test_the_slope_by_friction_is_that_of_differences(planes, dimension):
    across = [[0.4], [0.7]] if dimension == 3 else [[], []]
    position = [[x, *y, HEIGHT + 0.0199] for x, y in zip((0.31, 0.62), across, strict=True)]
    floor = on_mesh(planes[200])
    if dimension == 2:
        floor = {"kind": "mesh", "points": [[x, HEIGHT] for x in (-0.5, 0.318, 0.7, 1.5)]}
    velocity = [[0.9, *[0.1] * (dimension - 2), 0.0]] * 2
    scene = jaxdem.load_scene(grains_scene([floor], position, velocity=velocity, domain={"size": [1.0] * dimension}))
    case = build_case(scene)
    simulation, (state, neighbors) = case.simulation.reversible(), case.initial_state()

    def speed(friction):
        parameters = case.parameters._replace(contact=case.parameters.contact._replace(friction=friction))
        return simulation.step(parameters, state, neighbors)[0].particles.velocity[0, 0]

    both = jax.jit(jax.value_and_grad(speed))
    slope = float(both(0.3)[1])
    assert slope < -0.05
    # What slides loses the impulse of the normal force times the friction: nearly linear, so that a step may be long.
    assert slope == pytest.approx(float(both(0.3 + 1e-4)[0] - both(0.3 - 1e-4)[0]) / 2e-4, rel=1e-7)

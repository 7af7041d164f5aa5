"""Time-step limits against closed forms and against limits found by trial; extreme scenes end sound or are refused.

A few rows of `benchmarks/stability.py`, whose cases these are.
"""

import math

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

import jaxdem
from jaxdem.errors import InputError
from jaxdem.particles.wall_times import WallInTime
from jaxdem.scene.shapes import Shape
from jaxdem.setup import contact_stability
from jaxdem.setup.contact_limit import Neighbours, contact_stability_limit
from jaxdem.setup.particles import particle_setup
from jaxdem.setup.shapes import template
from jaxdem.setup.stability import LinearContact
from jaxdem.setup.time_steps import time_steps
from jaxdem.setup.wall_functions import wall_functions
from jaxdem.solids.features import features_of
from jaxdem.solids.simultaneous_contacts import simultaneous_contacts_of
from jaxdem.solids.surface_mesh import SurfaceMesh
from tests.cases import extremes, stability, steps, surface_stability
from tests.cases.tiers import COMBINATION, tiered

SMOOTH = LinearContact(3.0, 0.0, 0.0, 0.0)
ROUGH = LinearContact(3.0, 2.5, 0.0, 0.0)
NONE = LinearContact(0.0, 0.0, 0.0, 0.0)
ROWS = extremes.rows() | surface_stability.rows()


@pytest.mark.parametrize(
    ("dimension", "neighbors", "contact", "squared"),
    [
        (2, 1, SMOOTH, 2 * 3.0),
        (3, 1, SMOOTH, 2 * 3.0),
        (2, 99, SMOOTH, 6 * 3.0),  # hexagonal lattice, at the edge of its Brillouin zone
        (3, 99, SMOOTH, 8 * 3.0),  # close-packed lattice
        (2, 99, ROUGH, 30 * 2.5),  # all grains spin alike: 2 Z k_t r^2 / (2/5 m r^2)
        (3, 99, ROUGH, 40 * 2.5),
    ],
)
def test_limit_is_2_over_the_largest_frequency(dimension, neighbors, contact, squared):
    """Known frequencies of lattices of unit masses; without walls."""
    limit = contact_stability_limit(1.0, dimension, [Neighbours(contact, 2.0, neighbors, 0)], NONE, 0)
    assert limit == pytest.approx(2.0 / math.sqrt(squared), rel=1e-9)


@pytest.mark.parametrize("ratio", [0.0, 0.1, 0.9])
def test_dashpots_lower_the_limit(ratio):
    """A damped mass on a wall: w dt = sqrt(16 b^2 + 4) - 4 b, the dashpot acting on v + a dt/2 of the step before."""
    wall = LinearContact(3.0, 0.0, 2.0 * ratio * math.sqrt(3.0), 0.0)
    limit = contact_stability_limit(1.0, 2, [], wall, 1)
    expected = math.sqrt(16.0 * ratio**2 + 4.0) - 4.0 * ratio
    assert limit * math.sqrt(3.0) == pytest.approx(expected, rel=1e-9)


LIMITS = [(name, material) for name in ("pair", "hexagonal pack") for material in ("e = 1, mu = 10", "e = 0, mu = 10")]


@pytest.mark.parametrize(("name", "material"), tiered(LIMITS, first=[LIMITS[0], LIMITS[3]]))
def test_predicted_contact_limit_is_safe_and_within_a_factor_of_two(name, material):
    row = stability.contact_limit(name, material)
    # The trial resolves 1.2 %: the largest stable step lies between the one found and the next.
    assert 0.5 <= row.ratio <= 1.012


@pytest.mark.parametrize("name", ["pack with one hard grain", "hard ball, size ratio 5"])
def test_predicted_limit_of_one_hard_grain_among_soft_ones(name):
    """By the contacts that occur: those of two hard ones, of which there is one, would make it 20 times shorter."""
    assert 0.5 <= stability.contact_limit(name, "e = 1, mu = 10").ratio <= 1.012


@pytest.mark.parametrize(("dimension", "number", "along"), [(2, 4, 3.0), (3, 3, 2.5), (3, 4, 3.0), (3, 6, 4.0)])
def test_few_neighbours_may_act_along_one_line(dimension, number, along):
    """Heavy ones, 60 degrees apart: two or three on either side of the line, or one and two. k/m counts sum cos^2."""
    limit = contact_stability_limit(1.0, dimension, [Neighbours(SMOOTH, 1.0, number, 0)], NONE, 0)
    sides = {2.5: [0.0, 30.0, 30.0], 3.0: [30.0] * 4, 4.0: [np.degrees(np.arcsin(1.0 / np.sqrt(3.0)))] * 6}[along]
    assert limit == pytest.approx(2.0 / np.sqrt(3.0 * np.sum(np.cos(np.radians(sides)) ** 2)), rel=1e-9)


def test_a_grain_may_lie_in_a_corner_of_a_mesh():
    """A grain alone between sides that are periodic: a mesh may hold it as a corner of the box does."""

    def limit(*walls, periodic=True):
        tables = {
            "domain": {"size": [1.0, 1.0], "gravity": [0.0, -9.81]},
            "particles": {"radius": 0.01, "density": 2500.0, "position": [[0.5, 0.5]]},
            "contact": {"young_modulus": 1e7, "restitution": 0.5, "friction": 0.5, "speed": 1.0},
            "boundary": {side: {"kind": "periodic"} for side in ("left", "right", "bottom", "top") if periodic},
            "walls": list(walls),
            "time": {"end": 1.0, "output_interval": 1.0},
        }
        return steps.time_steps(jaxdem.load_scene(tables)).limits["contact_stability"]

    mesh = {"kind": "mesh", "points": [[0.3, 0.7], [0.3, 0.3], [0.7, 0.3]]}
    corner = limit(periodic=False)
    assert limit(mesh) == corner < limit()


@pytest.mark.parametrize("bend", [1.5, 50.0])
def test_faces_of_a_mesh_that_face_one_way_count_together(bend):
    """Two lines that bend by an angle hold a smooth grain with 1 + cos of it times the stiffness of one; two that bend
    by less than `smooth_angle` are one."""

    def limit(bend, smooth_angle=1.0):
        up = np.radians(bend)
        points = [[0.1, 0.3], [0.5, 0.3], [0.5 + 0.4 * np.cos(up), 0.3 + 0.4 * np.sin(up)]]
        tables = {
            "domain": {"size": [1.0, 1.0], "gravity": [0.0, -9.81]},
            "particles": {"radius": 0.01, "density": 2500.0, "position": [[0.5, 0.5]]},
            "contact": {"young_modulus": 1e7, "restitution": 1.0, "friction": 0.0, "speed": 1.0},
            "walls": [{"kind": "mesh", "points": points, "smooth_angle": smooth_angle}],
            "time": {"end": 1.0, "output_interval": 1.0},
        }
        return steps.time_steps(jaxdem.load_scene(tables)).limits["contact_stability"]

    flat = limit(0.0)
    assert limit(bend) == pytest.approx(flat / np.sqrt(1.0 + np.cos(np.radians(bend))), rel=1e-9)
    assert limit(0.4 * bend, 0.5 * bend) == flat


def alone(*walls, functions=(), **more):
    """2/omega_max of a smooth grain by itself among walls, in a box."""
    dimension = len(more.pop("size", [1.0, 1.0]))
    scene = jaxdem.load_scene(
        {
            "domain": {"size": [1.0] * dimension},
            "particles": {"radius": 0.01, "density": 2500.0, "position": [[0.5] * dimension]},
            "contact": {"young_modulus": 1e7, "restitution": 1.0, "friction": 0.0, "speed": 0.01},
            "walls": list(walls),
            "time": {"end": 1.0, "output_interval": 1.0},
        }
        | more
    )
    own = wall_functions(functions, scene, np.dtype(np.float32))
    return time_steps(scene, None, particle_setup(scene), own_walls=own).limits["contact_stability"]


def wedge(angle, apex=(0.5, 0.2)):
    half = np.radians(0.5 * angle)
    ways = [[-np.sin(half), np.cos(half)], [np.sin(half), np.cos(half)]]
    return {"kind": "wedge", "apex": list(apex), "directions": ways}


def ramp(slope, height=0.2, **more):
    """A plane that rises to the right."""
    slope = np.radians(slope)
    return {"kind": "plane", "point": [0.0, height], "normal": [-np.sin(slope), np.cos(slope)]} | more


def pit(slope, number):
    slope, turn = np.radians(slope), 2.0 * np.pi * np.arange(number) / number
    ways = np.stack([np.cos(turn) * np.sin(slope), np.sin(turn) * np.sin(slope), np.full(number, np.cos(slope))], 1)
    return [{"kind": "plane", "point": [0.5, 0.5, 0.2], "normal": way.tolist()} for way in ways]


RAMP_OF_LINES = {"kind": "mesh", "points": [[-0.1, 0.2 - 0.1 * np.tan(0.5)], [1.1, 0.2 + 1.1 * np.tan(0.5)]]}
CIRCLE = {"kind": "cylinder", "center": [0.5, 0.5], "radius": 0.4, "inside": True}
FLOOR = {"kind": "plane", "point": [0.0, 0.3], "normal": [0.0, 1.0]}
GATE = {"kind": "plane", "point": [0.55, 0.0], "normal": [1.0, 0.0]}
LID = {"kind": "plane", "point": [0.0, 0.5], "normal": [0.0, 1.0]}
TURNED = {"kind": "oscillation", "center": [0.0, 0.4], "amplitude": 0.2, "frequency": 1.0}


def in_circle(x):
    return 0.4 - jnp.hypot(x[0] - 0.5, x[1] - 0.5)


@pytest.mark.parametrize(
    ("walls", "along", "functions"),
    [
        pytest.param([wedge(150.0)], 1.0 + np.cos(np.radians(30.0)), (), id="wedge, obtuse"),
        pytest.param([wedge(40.0)], 1.0 + np.cos(np.radians(40.0)), (), id="wedge, acute"),
        pytest.param([ramp(20.0)], 1.0 + np.sin(np.radians(20.0)), (), id="plane and side"),
        pytest.param(pit(15.0, 4), 4.0 * np.cos(np.radians(15.0)) ** 2, (), id="four planes"),
        pytest.param(pit(10.0, 7), 7.0 * np.cos(np.radians(10.0)) ** 2, (), id="seven planes"),
        pytest.param([RAMP_OF_LINES], 1.0 + np.sin(0.5), (), id="mesh and side"),
        pytest.param([ramp(0.0, 0.4, motion=[TURNED])], 1.0 + np.sin(0.2), (), id="plane that turns"),
        pytest.param([CIRCLE, FLOOR], 1.0 + 0.19 / 0.39, (), id="circle and plane"),
        pytest.param([FLOOR], 1.0 + 0.19 / 0.39, (in_circle,), id="function and plane"),
        pytest.param(
            [FLOOR], 1.0 + 0.19 / 0.39, (in_circle, WallInTime(lambda x: x[1] - 0.5, end=0.5)), id="function that ends"
        ),
        pytest.param([wedge(150.0), GATE], 1.0 + np.cos(np.radians(75.0)), (), id="wedge cut off by a gate"),
        pytest.param([wedge(150.0), GATE | {"end": 0.5}], 1.0 + np.cos(np.radians(30.0)), (), id="gate that vanishes"),
        pytest.param([CIRCLE, FLOOR, LID | {"end": 0.5}], 1.0 + 0.19 / 0.39, (), id="lid over the plane that vanishes"),
    ],
)
def test_walls_that_are_not_at_right_angles_count_together(walls, along, functions):
    """Two whose normals enclose an angle hold a smooth grain with 1 + |cos| of it times the stiffness of one; n planes
    of a pit of slope a with n cos^2 a. The centre is 0.39 m from that of the circle and 0.19 m below it."""
    size = [1.0] * len(walls[0].get("normal", [0, 0]))
    assert alone(*walls, functions=functions, size=size) == pytest.approx(alone(size=size) / np.sqrt(along), rel=1e-4)


RIGHT = {"kind": "wedge", "apex": [0.2, 0.2], "directions": [[1.0, 0.0], [0.0, 2.0]]}
BLOCK = [[0.3, 0.3], [0.7, 0.3], [0.7, 0.6], [0.3, 0.6]]


@pytest.mark.parametrize(
    "walls",
    [
        pytest.param([RIGHT], id="wedge of 90 degrees"),
        pytest.param([FLOOR, {"kind": "plane", "point": [0.3, 0.0], "normal": [1.0, 0.0]}], id="planes"),
        pytest.param([FLOOR | {"motion": [TURNED | {"direction": [0.0, 1.0]}]}], id="floor that shakes"),
        pytest.param([{"kind": "mesh", "points": BLOCK, "closed": True}], id="block"),
        pytest.param([CIRCLE], id="circle off the sides"),
        pytest.param([wedge(150.0, (0.5, -0.4))], id="wedge below the floor"),
        pytest.param([CIRCLE, FLOOR | {"point": [0.0, 0.05]}], id="circle above a plane"),
    ],
)
def test_walls_at_right_angles_or_apart_do_not_count_together(walls):
    """To the last bit."""
    for wall in walls:
        for motion in wall.get("motion", []):
            motion.pop("center", None)
    assert alone(*walls) == alone()


def test_a_side_that_removes_grains_is_no_wall_beside_a_plane():
    """A plane in the place of a side takes over from it; beside the side it would count with it."""
    plane = {"kind": "plane", "point": [0.0, 0.0], "normal": [1.0, 0.0]}
    assert alone(plane, boundary={"left": {"particles": "remove"}}) == alone()
    assert alone(plane) == pytest.approx(alone() / np.sqrt(2.0))


OBLIQUE = [(name, material) for name in stability.oblique_walls() for material in ("e = 1, mu = 0", "e = 0, mu = 10")]


@pytest.mark.parametrize(("name", "material"), tiered(OBLIQUE, first=[("in a wedge of 150 degrees", "e = 1, mu = 0")]))
def test_predicted_limit_between_walls_that_are_not_at_right_angles(name, material, monkeypatch):
    """Of a smooth elastic grain exact: stable below, not above. Without the sum over the walls it is too long."""
    row = stability.contact_limit(name, material)
    assert (0.98 if material == "e = 1, mu = 0" else 0.5) <= row.ratio <= 1.012
    if name == "in a wedge of 150 degrees":
        monkeypatch.setattr(contact_stability, "contacts_with_planes", lambda *_: ())
        assert stability.contact_limit(name, material).ratio > (1.2 if material == "e = 1, mu = 0" else 1.05)


def test_all_faces_of_a_pit_count_and_those_of_a_box_do_not():
    """The sum of n n^T over N faces of a slope a that meet at a point is N cos^2 a along the axis."""
    sides, slope = 12, np.radians(5.0)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.sin(angle), np.full(sides, np.tan(slope) * np.cos(np.pi / sides))], axis=1)
    cells = np.stack([np.zeros(sides, int), 1 + np.arange(sides), 1 + (np.arange(sides) + 1) % sides], axis=1)
    pit = SurfaceMesh(np.concatenate([np.zeros((1, 3)), ring]), cells)
    faces = features_of(pit, True, np.radians(1.0)).faces
    found = simultaneous_contacts_of(pit, faces.normal, faces.patch)
    assert found.number == sides and found.along == pytest.approx(sides * np.cos(slope) ** 2, rel=1e-9)
    box = trimesh.creation.box()
    box = SurfaceMesh(np.asarray(box.vertices), np.asarray(box.faces))
    faces = features_of(box, True, np.radians(1.0)).faces
    assert simultaneous_contacts_of(box, faces.normal, faces.patch) is None


def test_walls_that_attract_more_than_grains_count_in_the_step():
    """sqrt(m h / (2 F)) at a wall, with its F = f A r/(6 h^2): 10 times shorter for f = 100."""
    radius, hamaker, gap = 1e-3, 1e-12, 1e-6
    mass = 2500.0 * 4.0 / 3.0 * np.pi * radius**3

    def limit(factor):
        cohesion = {"kind": "van_der_waals", "hamaker_constant": hamaker, "minimum_gap": gap, "cutoff": 1e-4}
        tables = {
            "domain": {"size": [0.02, 0.02]},
            "particles": {"radius": radius, "density": 2500.0, "position": [[0.01, 0.01], [0.005, 0.01]]},
            "contact": {"young_modulus": 1e6, "speed": 0.1, "cohesion": cohesion | {"wall_factor": factor}},
            "time": {"end": 1.0, "output_interval": 1.0},
        }
        return steps.time_steps(jaxdem.load_scene(tables)).limits["contact_attraction"]

    with pytest.raises(InputError, match=r"with this pull .* without cohesion by 1\.") as caught:
        limit(1e5)
    assert (caught.value.key, caught.value.value) == ("contact.cohesion.wall_factor", 1e5)
    for factor in (1.0, 100.0):
        pull = factor * hamaker * radius / (6.0 * gap**2)
        assert limit(factor) == pytest.approx(np.sqrt(mass * gap / (2.0 * pull)), rel=1e-9)


def test_one_small_grain_among_large_ones_counts_once():
    """Of grains 180 times smaller a large one has room for hundreds. One, five or all of them have nearly one limit:
    that of a small grain between large ones."""

    def limit(number):
        x = np.stack(np.meshgrid(*[0.02 + 0.02 * np.arange(30)] * 2), axis=-1).reshape(-1, 2)[: number + 5]
        tables = {
            "domain": {"size": [0.64, 0.64], "gravity": [0.0, 0.0]},
            "particles": {"radius": [0.009] * 5 + [5e-5] * number, "density": 2650.0, "position": x.tolist()},
            "contact": {"speed": 1.0},
            "time": {"end": 1e-3, "output_interval": 1e-3},
        }
        return steps.time_steps(jaxdem.load_scene(tables)).limits["contact_stability"]

    limits = [limit(number) for number in (1, 5, 50, 800)]
    assert max(limits) < 1.2 * min(limits)


def neighbours(*numbers):
    """A stiff kind of particles, and a soft one, by how many there are."""
    return [Neighbours(ROUGH._replace(normal=9.0), 2.0, numbers[0], 0), Neighbours(SMOOTH, 2.0, numbers[1], 1)]


def test_a_stiff_neighbour_counts_as_often_as_there_is_one():
    """One among 11 soft ones is worse than none and better than two; 12 leave no room for others, in either order."""
    limits = [contact_stability_limit(1.0, 3, neighbours(n, 99), NONE, 0) for n in (0, 1, 2, 12, 99)]
    assert all(np.diff(limits[:4]) < 0.0) and limits[3] == limits[4]
    assert limits[0] == contact_stability_limit(1.0, 3, neighbours(0, 99)[1:], NONE, 0)
    assert limits[4] == contact_stability_limit(1.0, 3, neighbours(99, 99)[::-1], NONE, 0)
    assert limits[4] == contact_stability_limit(1.0, 3, neighbours(99, 0)[:1], NONE, 0)


@pytest.mark.parametrize(
    ("name", "least"), tiered([("pair", 0.98), ("square lattice of 5 x 5", 0.5)], first=[("pair", 0.98)])
)
def test_predicted_limit_of_bonds_is_exact_for_a_pair_and_safe_for_a_lattice(name, least):
    assert least <= stability.bond_limit_of(name, 0.4, 0.0).ratio <= 1.012


@COMBINATION
def test_predicted_limit_of_smooth_rods_in_the_dips_of_each_other():
    """Five contacts along nearly one line: by the surface of a rod alone the step would be 31 % too long."""
    assert 0.5 <= stability.contact_limit("two rods, each member between two", "e = 1, mu = 0").ratio <= 1.012


SQUARE = [[x, y, 0.0] for x in (0.0, 1.0) for y in (0.0, 1.0)]


@pytest.mark.parametrize(
    ("centres", "dimension", "contacts"),
    [
        ([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], 2, 5.0),
        ([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]], 2, 3.0),
        ([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], 3, 5.0),
        (SQUARE, 3, 9.0),
        ([*SQUARE, [0.5, 0.5, 0.7]], 3, 9.0),
    ],
)
def test_contacts_of_a_clump_with_one_other(centres, dimension, contacts):
    """Of rows, squares, and a pyramid on its base."""
    shape = Shape(name="any", centres=centres, radii=[1.0] * len(centres))
    assert template(shape, dimension).facing == pytest.approx(contacts)


def test_predicted_limit_of_spheres_that_hold_each_other():
    """JKR at rest: the stiffness is 0.6 of that of the contact radius, which the prediction takes."""
    row = stability.contact_limit("pair", "e = 1, mu = 0", cohesion=stability.HELD["jkr"])
    assert row.ratio == pytest.approx(math.sqrt(0.6), rel=0.02)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("the paper: E 70 GPa, step 2e-4 s", ("contact.time_step = 0.0002", "the stable step is", '"auto"')),
        ("start: full overlap", ("particles 0 and 1", "100 %", "Move the particles apart")),
        ("viscosity: 0 with particles", ("fluid.viscosity = 0.0", "Set fluid.viscosity to a value above 0")),
        ("viscosity: 10 m2/s, step 5 ms", ("fluid.time_step", "viscous limit", "larger cells")),
        ("impact: 100 m/s, 70 MPa", ("200 m/s", "the limit is 20 %", "Stiffen")),
        ("Courant number: 20 in an interval", ("fluid.time_step = 0.8", "8 fluid steps", "larger cells")),
        ("void fraction: all-solid cell", ("void fraction", "above 0.05", "kernel_width")),
        ("two fluids: no liquid", ("surface.level", "without liquid")),
    ],
)
def test_what_cannot_work_is_refused_before_the_first_step(name, words):
    row = ROWS[name]()
    assert row.outcome == "refused"
    for word in words:
        assert word in row.message


EXTREME = ["drag: stokes 1e-06", "drag: stokes 1e+03", "restitution, friction: e = 0, mu = 10", "surface: corner"]


@pytest.mark.parametrize("name", tiered(EXTREME, first=EXTREME[:1]))
def test_extreme_rows_end_sound(name):
    """Energy bounded by what there was to get, volume and momentum to round-off."""
    row = ROWS[name]()
    assert row.outcome == "sound", row.message

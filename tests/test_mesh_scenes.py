"""The scenes with meshes beside that of the silo: what their files are, where their grains begin, and short runs with
fewer grains against the balance of momentum."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import h5py
import jax
import numpy as np
import pytest
import trimesh

import jaxdem
from jaxdem.io.vtkhdf import ROOT
from jaxdem.io.wall_file import WALLS
from jaxdem.setup import mesh_sources, wall_motion
from jaxdem.setup.builder import build_case
from tests.cases.moving_walls import path
from tests.cases.tiers import COMBINATION, tiered

SCENES = Path(__file__).parents[1] / "scenes"


def case_of(name, **changes):
    return build_case(jaxdem.load_scene(SCENES / f"{name}.toml", changes))


@pytest.mark.parametrize(
    ("name", "changes", "triangles", "closed"),
    [
        ("dosta_silo", {"particles.pack.count": 20}, 288, False),
        ("dosta_impact", {"particles.pack.count": 20}, 1280, True),
        ("drum_with_lifters", {"particles.count": 20}, 144, False),
        ("slope", {"particles.pack.count": 20}, 2800, False),
    ],
)
def test_the_meshes_are_sound_and_the_grains_before_them(name, changes, triangles, closed):
    """Grains before they fall; a mesh with holes, turned triangles or in a wrong place would be refused."""
    case = case_of(name, **changes)
    (mesh,) = case.particles.meshes
    assert len(mesh.mesh.cells) == triangles and mesh.defects.is_closed == closed
    assert mesh.defects.pieces == 1 and mesh.defects.flipped == 0
    case.first_state()


def test_the_slope_faces_up_and_the_drum_inwards():
    """With touch = "front" grains touch what they should: of the drum its shell and the tops of its lifters."""
    (slope,) = case_of("slope", **{"particles.pack.count": 5}).particles.meshes
    assert (slope.mesh.area_vectors[:, 2] > 0.0).all()
    (drum,) = case_of("drum_with_lifters", **{"particles.count": 5}).particles.meshes
    middles, normal = drum.mesh.corners.mean(axis=1), drum.mesh.area_vectors
    inwards = (np.array([0.11, 0.025, 0.11]) - middles) * [1.0, 0.0, 1.0]
    radius = np.linalg.norm(inwards, axis=1)
    facing = np.einsum("fd,fd->f", inwards, normal) / (radius * np.linalg.norm(normal, axis=1))
    shell_or_top = (radius > 0.098) | (radius < 0.0885)
    assert shell_or_top.sum() > 100 and (facing[shell_or_top] > 0.9).all()


def test_the_ball_falls_freely_before_it_meets_the_layer():
    """Its displacement, in the frame of its first velocity, is g t^2/2."""
    scene = jaxdem.load_scene(
        SCENES / "dosta_impact.toml",
        {"particles.pack.count": 2, "time.end": 0.003, "precision": "float64"},
    )
    tables = scene.tables()
    tables["walls"][0]["translate"] = [0.0225, 0.0225, 0.09]
    found = path(tables)
    fall = 0.5 * 9.81 * found.time**2
    np.testing.assert_allclose(found.pistons.displacement[:, 0], fall, rtol=1e-6, atol=1e-12)


END, INTERVAL = 0.12, 0.02
SHIFT = [{"kind": "translation", "velocity": [0.02, 0.0]}]
LID = {"name": "lid", "kind": "mesh", "points": [[0.06, 0.085], [0.16, 0.085]],
       "piston": {"direction": [0.0, -1.0], "force": 1.0, "mass": 0.1, "damping": 5.0}}  # fmt: skip
"""In place of the plane of the direct shear test."""

SHORT = {
    "drum_with_lifters": {
        "particles.count": 30,
        "particles.pack": {
            "kind": "random",
            "region": {"shape": "box", "start": [0.08, 0.0, 0.03], "stop": [0.14, 0.05, 0.06]},
        },
    },
    "slope": {
        "particles.pack": {
            "kind": "random", "count": 30,
            "region": {"shape": "box", "start": [0.12, 0.15, 0.335], "stop": [0.2, 0.25, 0.4]},
        },
    },
    "direct_shear": {
        "particles.count": 60, "particles.pack.kind": "random", "particles.pack.stop": [0.16, 0.08],
        "walls.1.motion": SHIFT, "walls.2.motion": SHIFT,
    },
}  # fmt: skip


@pytest.fixture(scope="module")
def short_run(tmp_path_factory):
    """The run of a scene, by its name, with a few grains that are let fall; with a probe for every wall."""

    @cache
    def run(name):
        tables = jaxdem.load_scene(SCENES / f"{name}.toml", SHORT[name]).tables()
        if name == "direct_shear":
            tables["walls"][3] = LID
        probes = []
        if name == "drum_with_lifters":  # open at its ends: grains rub on the sides of the box there
            probes = [{"name": side, "kind": "wall", "side": side} for side in ("front", "back")]
        tables |= {"probes": probes, "time": {"end": END, "output_interval": INTERVAL}, "output": {"walls": True}}
        with jax.enable_x64(False):
            return jaxdem.simulate(jaxdem.load_scene(tables), tmp_path_factory.mktemp(name) / "run")

    return run


@pytest.mark.parametrize("name", tiered(SHORT, first=["direct_shear"]))
def test_grains_have_the_momentum_that_walls_and_gravity_gave(short_run, name):
    """All grains are there, and m dv = M g t less the impulse of grains on walls, along x and z, where nothing else is
    touched. Without any of the walls that are touched it fails by more than ten times the tolerance."""
    run = short_run(name)
    first, last = run.particles(0), run.particles(run.number_of_frames - 1)
    assert len(last["position"]) == len(first["position"]) == run.summary["counts"]["particles"]
    bodies = jaxdem.build(jaxdem.load_scene(run.scene))[1].bodies
    mass = np.broadcast_to(np.asarray(bodies.mass, float), len(first["position"]))
    axes = [0, 2] if run.dimension == 3 else [0, 1]
    change = (mass[:, None] * (np.asarray(last["velocity"], float) - np.asarray(first["velocity"], float))).sum(axis=0)
    weight = mass.sum() * np.array([0.0, -9.81]) * END
    given = {
        one: -INTERVAL * np.array([probe[f"force_{axis}"].sum() for axis in "xz"]) for one, probe in run.probes.items()
    }
    scale = mass.sum() * 9.81 * END
    off = np.abs(change[axes] - weight - sum(given.values())) / scale
    assert off.max() < 2e-4, off
    touched = [one for one in given.values() if np.abs(one).max() > 0.0]
    assert touched and all(np.abs(one).max() > 2e-3 * scale for one in touched)


@COMBINATION
def test_the_motor_of_the_drum_turns_it_against_its_torque_and_it_wears(short_run):
    """Power is torque times rate, and the wear of the triangles in the file adds up to that over time."""
    run = short_run("drum_with_lifters")
    drum = run.probes["drum"]
    np.testing.assert_allclose(
        drum["power"], 5.0 * drum["torque_y"], rtol=2e-3, atol=1e-6 * np.abs(drum["power"]).max()
    )
    assert np.abs(drum["power"]).max() > 1e-4
    with h5py.File(run.path / WALLS) as file:
        volume, depth = (file[ROOT]["CellData"][name][...] for name in ("wear_volume", "wear_depth"))
        assert file[ROOT]["Steps"].attrs["NSteps"] == len(run.times)
    assert len(volume) == 144 and 0 < (depth > 0.0).sum() < 144
    np.testing.assert_allclose(volume.sum(), run.history["wall_0_wear"][-1], rtol=1e-5)


@COMBINATION
def test_grains_on_the_slope_lose_energy(short_run):
    """Terrain and gate do no work: kinetic and potential energy together fall from output to output, or stay. By the
    kinetic energy alone this would not hold."""
    run = short_run("slope")
    kinetic = np.asarray(run.history["kinetic_energy"])
    mass = 2500.0 * 4.0 / 3.0 * np.pi * 0.006**3
    potential = [mass * 9.81 * np.asarray(run.particles(k)["position"], float)[:, 2].sum() for k in range(len(kinetic))]
    total = kinetic + potential
    assert (np.diff(total) < 1e-5 * potential[0]).all() and total[-1] < total[0] - 1e-3 * potential[0]
    assert np.diff(kinetic).max() > 1e-4 * potential[0]


def test_a_mesh_that_a_force_moves_is_where_the_force_has_moved_it(short_run):
    """In the file for ParaView of a complete run, at every output time; others are where their motion has them."""
    run = short_run("direct_shear")
    with h5py.File(run.path / WALLS) as file:
        first = file["points"][...]
        places = file[ROOT]["Points"][...].reshape(len(run.times), len(first), 3)[:, :, :2]
        cells, wall = file[ROOT]["Lines/Connectivity"][...].reshape(-1, 2), file[ROOT]["CellData/wall"][...]
    for number, moved in (
        (0, np.zeros((len(run.times), 2))),
        (1, np.outer(run.times, [0.02, 0.0])),
        (3, np.outer(run.history["wall_3_displacement"], [0.0, -1.0])),
    ):
        own = np.unique(cells[wall == number])
        np.testing.assert_allclose(places[:, own], first[own] + moved[:, None], atol=1e-7)
    assert run.history["wall_3_displacement"][-1] > 1e-3


def test_a_file_is_read_once_until_it_changes(tmp_path, monkeypatch):
    """The speed of a wall that turns asks for its mesh several times in a build."""
    file = tmp_path / "body.stl"
    trimesh.creation.box((0.1, 0.1, 0.1)).export(file)
    turn = {"kind": "rotation", "rate": 3.0, "axis": [0.0, 0.0, 1.0], "center": [0.5, 0.5, 0.5]}
    turning = {"kind": "mesh", "file": str(file), "translate": [0.5, 0.5, 0.5], "motion": [turn]}
    scene = jaxdem.load_scene(
        {
            "domain": {"size": [1.0, 1.0, 1.0]},
            "particles": {"radius": 0.01, "density": 2500.0, "position": [[0.8, 0.8, 0.8]]},
            "walls": [turning],
            "time": {"end": 0.01, "output_interval": 0.01},
        }
    )
    reads, plain = [], mesh_sources.triangles_of
    monkeypatch.setattr(mesh_sources, "triangles_of", lambda name: (reads.append(name), plain(name))[1])
    speed = wall_motion.fastest_wall(scene)
    assert mesh_sources.sound_mesh("walls.0", scene.walls[0], scene, 0.01)[0].extent == pytest.approx(0.1)
    assert wall_motion.fastest_wall(scene) == speed and len(reads) == 1
    trimesh.creation.box((0.2, 0.2, 0.1)).export(file)
    os.utime(file, ns=(1, 1))
    assert wall_motion.fastest_wall(scene) > 1.5 * speed and len(reads) == 2

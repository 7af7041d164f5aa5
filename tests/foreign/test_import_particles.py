"""Particles that a deck creates, changes or reads, and those that come through faces of a mesh."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from cases import decks

from jaxdem import load_scene
from jaxdem.foreign.lattices import lattice_of
from jaxdem.foreign.notes import DIFFERS, LEFT, NOTHING, TAKEN
from jaxdem.particles.packing import deepest_overlap
from jaxdem.setup.particles import particle_setup


@pytest.fixture(scope="module")
def created(tmp_path_factory):
    folder = tmp_path_factory.mktemp("created")
    tables, _, made = decks.imported(folder, decks.CREATED, **{"more.deck": decks.MORE})
    return tables, made, particle_setup(load_scene(folder / "scene.toml"))


def test_created_particles_stand_in_a_file_beside_the_scene(created):
    """A lattice of 0.01 m with 3 x 2 x 1 places in the region, one place, ten at random; the box begins at -0.05 m."""
    tables, made, particles = created
    assert tables["particles"] == {"file": {"name": "scene.particles.csv"}}
    assert list(made.files) == ["scene.particles.csv"]
    x = particles.position - [0.03, 0.02, 0.05]
    expected = [[i, j, -0.039] for i in (-0.02, -0.01, 0.0) for j in (-0.01, 0.0, 0.01)]
    np.testing.assert_allclose(sorted(x[:9].tolist()), expected, atol=1e-12)
    np.testing.assert_allclose(x[9], [0.0, 0.0, 0.051], atol=1e-12)
    assert len(x) == 20
    size = np.asarray(particles.scene.domain.size)
    radius = np.broadcast_to(particles.present.radius, 20)
    assert deepest_overlap(particles.position[10:], radius[10:], size, (False,) * 3)[0] <= 0.0
    assert decks.note_on(made, "create_atoms 1 random").kind == DIFFERS


def test_set_and_velocity(created):
    """A new diameter keeps the mass: half of it has eight times the density. West of x = 0 particles have vx."""
    _, made, particles = created
    radius, density = particles.present.radius, particles.present.density
    np.testing.assert_allclose(radius, [0.001] + [0.002] * 19)
    np.testing.assert_allclose(density, [16000.0] + [2000.0] * 19, rtol=1e-9)
    velocity = particles.given_velocity
    np.testing.assert_array_equal(velocity[:, 2], -0.25)
    placed = particles.position[:10, 0] - 0.03
    np.testing.assert_array_equal(velocity[:10, 0], np.where(placed <= 1e-9, 0.5, 0.0))
    assert decks.note_on(made, "set atom 1").kind == TAKEN
    groups = [note.kind for note in made.notes if note.text.startswith("group left")]
    assert groups == [NOTHING, NOTHING]


def test_conditions_are_decided(created):
    tables, made, _ = created
    assert tables["time"]["end"] == pytest.approx(100 * 2e-5)
    first, second, third = [note for note in made.notes if note.text.startswith("if")]
    assert (first.kind, second.kind, third.kind) == (LEFT, NOTHING, TAKEN)
    assert "none is not known" in first.reason and "time.end" in third.reason


@pytest.mark.parametrize(
    ("style", "count"), [("sc", 64), ("bcc", 128), ("fcc", 256), ("diamond", 512), ("hex", 20), ("sq", 16), ("sq2", 32)]
)
def test_lattices_fill_a_box(style, count):
    """Places in a box of four cells along each axis, its upper ends left out; of hex 3 and 2 rows of 4."""
    flat = style in ("hex", "sq", "sq2")
    found = lattice_of(["lattice", style, "1.0"], 0.5).places([0.0] * 3, [2.0] * 3, 2 if flat else 3)
    assert len(found) == count
    gaps = np.linalg.norm(found[:, None] - found, axis=2) + 10.0 * np.eye(len(found))
    nearest = {"bcc": 3**0.5 / 2, "fcc": 0.5**0.5, "diamond": 3**0.5 / 4, "sq2": 0.5**0.5}.get(style, 1.0)
    assert gaps.min() == pytest.approx(0.5 * nearest)


def test_commands_that_a_deck_cannot_have_say_so(tmp_path):
    odd = (
        "create_atoms 1 mesh x\nset type 1 charge 1\nvelocity all create 300 5\ndelete_atoms overlap 0.1 all all\n"
        "set mol 1 density 1\nlattice custom 1\nread_restart old.restart\nrerun dump.x\n"
        "create_atoms 1 region nowhere\nfix r all nve/limit radius 0.1\nfix d all deposit 5 1 10 7 region west\n"
    )
    text = decks.CREATED.partition("include")[0] + odd + "run 10\nvelocity all set 0 0 1\nrun 10\n"
    _, _, made = decks.imported(tmp_path, text)
    for line, words in (
        ("create_atoms 1 mesh", "text file"), ("set type 1 charge", "file of particles"),
        ("velocity all create", "vx vy vz"), ("delete_atoms overlap", "rows"), ("set mol", "use type"),
        ("lattice custom", "use none, sc"), ("read_restart", "write a dump or a data file"),
        ("rerun", "particles.file"),
        ("create_atoms 1 region nowhere", "nowhere was not taken"), ("fix r", "start.relax"), ("fix d", "fix pour"),
        ("velocity all set 0 0 1", "stages.start"),
    ):  # fmt: skip
        note = decks.note_on(made, line)
        assert note.kind == LEFT and words in note.reason, note


DUMP = "".join(
    f"""ITEM: TIMESTEP
{step}
ITEM: NUMBER OF ATOMS
2
ITEM: BOX BOUNDS ff ff ff
-0.1 0.1
0 0.1
0 0.2
ITEM: ATOMS id type x y z vx vy vz radius density
1 1 {x} 0.05 0.1 1 0 0 0.01 2500
2 1 0.05 0.05 0.1 0 0 0 0.02 2500
"""
    for step, x in ((0, -0.05), (500, 0.0))
)


def test_a_time_step_of_a_dump(tmp_path):
    text = f"atom_style sphere\nunits si\nboundary f f f\nread_dump old.dump 500 x y z\n{decks.MATERIAL}run 10\n"
    tables, _, made = decks.imported(tmp_path, text, **{"old.dump": DUMP})
    assert tables["particles"]["file"] == {"name": "old.dump", "frame": 1, "translate": [0.1, 0.0, 0.0]}
    assert tables["domain"]["size"] == [0.2, 0.1, 0.2]
    particles = particle_setup(load_scene(tmp_path / "scene.toml"))
    np.testing.assert_allclose(particles.position, [[0.1, 0.05, 0.1], [0.15, 0.05, 0.1]])
    other = decks.imported(tmp_path, text.replace("units si\n", "units si\nread_dump old.dump 7 x y z\n"),
                           **{"old.dump": DUMP})[2]  # fmt: skip
    assert "has no time step 7, it has 0, 500" in decks.note_on(other, "read_dump old.dump 7").reason


def triangles(corners):
    """A fan of triangles round the first corner."""
    return [(corners[0], corners[k], corners[k + 1]) for k in range(1, len(corners) - 1)]


def stl(faces, binary=False):
    if binary:
        body = b"".join(struct.pack("<12fH", 0, 0, 1, *np.ravel(face), 0) for face in faces)
        return b"\0" * 80 + struct.pack("<I", len(faces)) + body
    text = "".join("".join(f"vertex {x} {y} {z}\n" for x, y, z in face) + "endfacet\n" for face in faces)
    return f"solid face\n{text}endsolid\n".encode()


SQUARE = [(-10, -10, 80), (10, -10, 80), (10, 10, 80), (-10, 10, 80)]
DISC = [(10 * np.cos(t), 10 * np.sin(t), 80) for t in 2 * np.pi * np.arange(24) / 24]
ODD = [(-10, -10, 80), (10, -10, 80), (0, 10, 80)]
TILTED = [(-10, -10, 80), (10, -10, 80), (10, 10, 85), (-10, 10, 85)]
STREAM = f"""{decks.BOX}{decks.MATERIAL}fix z all {decks.WALL} zplane -0.05
fix pts all particletemplate/sphere 1 atom_type 1 density constant 2500 radius gaussian number 0.002 0.0002
fix pdd all particledistribution/discrete 1 1 pts 1.0
fix face all mesh/surface/planar file face.stl type 1 scale 0.001
fix ins all insert/stream seed 7 distributiontemplate pdd nparticles 100 massrate 0.01 insert_every 100 &
    overlapcheck yes all_in no vel constant 0 0 -1 insertion_face face extrude_length 0.02
run 1000
unfix ins
run 1000
"""


@pytest.mark.parametrize("binary", [False, True])
def test_a_stream_through_a_rectangle(tmp_path, binary):
    """A normal distribution is cut at three deviations; the layer at the face is a diameter of the largest thick."""
    (tmp_path / "face.stl").write_bytes(stl(triangles(SQUARE), binary))
    tables, _, made = decks.imported(tmp_path, STREAM)
    (inlet,) = tables["particles"]["inlet"]
    np.testing.assert_allclose(inlet["stop"], [0.04, 0.03, 0.13])
    np.testing.assert_allclose(inlet["start"], [0.02, 0.01, 0.13 - 2.002 * 0.0026])
    assert (inlet["mass_flow"], inlet["total"], inlet["end"], inlet["velocity"]) == (0.01, 100, 0.02, [0.0, 0.0, -1.0])
    assert inlet["distribution"] == {"kind": "normal", "by": "number", "mean": 0.002, "standard_deviation": 0.0002,
                                     "lower": pytest.approx(0.0014), "upper": pytest.approx(0.0026)}  # fmt: skip
    assert decks.note_on(made, "fix face").kind == TAKEN and decks.note_on(made, "unfix ins").kind == TAKEN


def test_a_stream_through_a_disc_and_what_is_neither(tmp_path):
    (tmp_path / "face.stl").write_bytes(stl(triangles(DISC)))
    (inlet,) = decks.imported(tmp_path, STREAM)[0]["particles"]["inlet"]
    assert inlet["region"]["shape"] == "cylinder" and inlet["region"]["radius"] == pytest.approx(0.01)
    np.testing.assert_allclose(inlet["region"]["base"], [0.03, 0.02, 0.13 - 2.002 * 0.0026])
    packed = STREAM.replace("run 1000", "region in block -0.01 0.01 -0.01 0.01 0 0.05 units box\nfix p all insert/pack "
                            "seed 1 distributiontemplate pdd particles_in_region 3 region in\nrun 1000", 1)  # fmt: skip
    for corners, words in ((ODD, "neither a rectangle nor a disc"), (TILTED, "not plane across an axis")):
        (tmp_path / "face.stl").write_bytes(stl(triangles(corners)))
        made = decks.imported(tmp_path, packed)[2]
        assert words in decks.note_on(made, "fix face").reason
        assert decks.note_on(made, "fix ins").kind == LEFT
    (tmp_path / "face.stl").write_bytes(b"nothing")
    assert "no STL file" in decks.note_on(decks.imported(tmp_path, packed)[2], "fix face").reason


def test_inlets_in_regions_that_are_no_block(tmp_path):
    text = decks.HOPPER.replace("region up block -0.02 0.02 -0.02 0.02 0.06 0.08", "region up sphere 0 0 0.06 0.015")
    inlet = decks.imported(tmp_path, text)[0]["particles"]["inlet"][0]
    assert inlet["region"] == {"shape": "sphere", "center": [0.03, 0.02, 0.11], "radius": 0.015}

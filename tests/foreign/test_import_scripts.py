"""Scenes from LIGGGHTS decks: what the deck says stands in the scene, and every line has a note."""

from __future__ import annotations

import math
import tomllib

import numpy as np
import pytest
from typer.testing import CliRunner

from jaxdem import load_scene
from jaxdem.cli.main import app
from jaxdem.errors import InputError
from jaxdem.foreign import import_deck
from jaxdem.foreign.formula import evaluate
from jaxdem.foreign.notes import LEFT, NOTHING, TAKEN, Unknown
from jaxdem.setup.particles import particle_setup

DRUM = """# grains of two materials in an upright tube
atom_style      granular
boundary        m m m
units           si
variable        R equal 0.002
variable        n index 40
region          reg block -0.05 0.05 -0.05 0.05 -0.001 0.2 units box
create_box      2 reg
neighbor        0.002 bin

fix m1 all property/global youngsModulus peratomtype 5.e6 1e7
fix m2 all property/global poissonsRatio peratomtype 0.45 0.3
fix m3 all property/global coefficientRestitution peratomtypepair 2 0.9 0.8 0.8 0.7
fix m4 all property/global coefficientFriction peratomtypepair 2 0.05 0.1 0.1 0.2
fix m5 all property/global k_finnie peratomtypepair 2 1 1 1 1
pair_style gran model hertz tangential history # no cohesion
pair_coeff * *
timestep 0.00001
fix gravi all gravity 9.81 vector 0.0 0.0 -2.0
fix zw1 all wall/gran model hertz tangential history primitive type 2 zplane 0.0
fix zw2 all wall/gran model hertz tangential history primitive type 2 zplane 0.15
fix cyl all wall/gran model hertz tangential history primitive type 2 zcylinder 0.05 0. 0.
region bc cylinder z 0. 0. 0.045 0.00 0.15 units box
fix pts1 all particletemplate/sphere 1 atom_type 1 density constant 2500 radius constant ${R}
fix pts2 all particletemplate/sphere 1 atom_type 2 density constant 2500 radius constant $(x)
fix pts2 all particletemplate/sphere 1 atom_type 2 density constant 2500 radius constant 0.004
fix pdd1 all particledistribution/discrete 1. 2 pts1 0.25 pts2 0.75
fix ins all insert/pack seed 100001 distributiontemplate pdd1 vel constant 0. 0. -0.5 &
    insert_every once overlapcheck yes all_in yes particles_in_region $n region bc
region top block -0.02 0.02 -0.02 0.02 0.12 0.14 units box
fix rain all insert/rate/region seed 7 distributiontemplate pdd1 nparticles 50 particlerate 100 &
    insert_every 1000 vel constant 0 0 -1 region top
fix cad all mesh/surface file meshes/chute.stl type 1
fix integr all nve/sphere
if "${n} > 3" then "print yes"
dump dmp all custom 800 post/dump*.liggghts id type x y z radius
run 4000
run 8000 upto
"""

PILE = """units cgs
atom_style sphere
boundary p f f
read_data grains.data
fix m1 all property/global youngsModulus peratomtype 5e7
fix m2 all property/global poissonsRatio peratomtype 0.3
fix m3 all property/global coefficientRestitution peratomtypepair 1 0.7
pair_style gran model hertz rolling_friction epsd2
timestep 1e-5
fix grav all gravity 981 chute 30
fix z all wall/gran model hertz primitive type 1 zplane 0
thermo_modify lost ignore
run 1000
"""

DATA = """two grains

2 atoms
1 atom types

-10 10 xlo xhi
0 5 ylo yhi
0 8 zlo zhi

Atoms

2 1 1.0 2.5 -3 1 2
1 1 1.0 2.5 4 1 2
"""


def deck(tmp_path, text, name="in.deck"):
    path = tmp_path / name
    path.write_text(text)
    return path


def tables_of(tmp_path, text):
    made = import_deck(deck(tmp_path, text), tmp_path / "scene.toml")
    return tomllib.loads(made.toml), {note.text.split()[1] if note.text.startswith("fix") else note.text: note
                                      for note in made.notes}  # fmt: skip


@pytest.fixture(scope="module")
def drum(tmp_path_factory):
    return tables_of(tmp_path_factory.mktemp("drum"), DRUM)


def test_the_box_ends_at_the_walls_and_begins_at_zero(drum):
    tables, _ = drum
    assert tables["domain"] == {"size": [0.1, 0.1, 0.15], "gravity": [0.0, 0.0, -9.81]}
    assert tables["walls"] == [
        {"kind": "cylinder", "center": [0.05, 0.05, 0.0], "radius": 0.05, "axis": [0.0, 0.0, 1.0], "material": "type2"}
    ]
    assert tables["particles"]["inlet"][0]["start"] == [0.03, 0.03, 0.12]


def test_materials_and_pairs(drum):
    tables, _ = drum
    first, second = tables["materials"]
    assert (first["young_modulus"], first["poisson_ratio"], first["restitution"], first["friction"]) == (
        5e6,
        0.45,
        0.9,
        0.05,
    )
    assert (second["young_modulus"], second["restitution"], second["friction"]) == (1e7, 0.7, 0.2)
    assert tables["material_pairs"] == [{"materials": ["type1", "type2"], "restitution": 0.8, "friction": 0.1}]
    assert tables["contact"]["wall_material"] == "type2"
    assert tables["contact"]["rolling_friction"] == 0.0
    assert tables["time"] == {"end": 0.08, "output_interval": 0.008}


def test_shares_by_mass_are_shares_by_number(drum):
    """A quarter of the mass in grains of an eighth of the mass of the others: 8/3 as many."""
    (pack,) = drum[0]["particles"]["pack"]
    assert pack["count"] == 40
    assert pack["region"] == {"shape": "cylinder", "base": [0.05, 0.05, 0.0], "axis": [0.0, 0.0, 1.0],
                              "radius": 0.045, "length": 0.15}  # fmt: skip
    assert [one["radius"] for one in pack["species"]] == [0.002, 0.004]
    np.testing.assert_allclose([one["share"] for one in pack["species"]], [8 / 11, 3 / 11])
    (inlet,) = drum[0]["particles"]["inlet"]
    assert (inlet["rate"], inlet["total"], inlet["velocity"]) == (100.0, 50, [0.0, 0.0, -1.0])


def test_every_line_has_a_note(drum):
    _, notes = drum
    kinds = {name: note.kind for name, note in notes.items()}
    assert kinds["m1"] == kinds["zw1"] == kinds["rain"] == kinds["ins"] == TAKEN
    assert kinds["m5"] == kinds["cad"] == LEFT
    assert kinds["integr"] == kinds["neighbor        0.002 bin"] == NOTHING
    assert "no triangles" in notes["cad"].reason
    conditions = [note for name, note in notes.items() if name.startswith("if")]
    assert conditions[0].kind == NOTHING
    lines = {int(note.place.rpartition(" ")[2]) for note in notes.values() if "line" in note.place}
    assert {1 + k for k, line in enumerate(DRUM.splitlines()) if line.startswith("fix pts1")} <= lines


def test_a_data_file_in_other_units_with_open_ends(tmp_path):
    deck(tmp_path, DATA, "grains.data")
    tables, notes = tables_of(tmp_path, PILE)
    assert tables["domain"]["size"] == [0.2, 0.05, 0.08]
    np.testing.assert_allclose(tables["domain"]["gravity"], [9.81 / 2, 0.0, -9.81 * math.sqrt(0.75)])
    assert tables["contact"]["young_modulus"] == 5e6
    assert tables["contact"]["friction"] == 0.0
    assert tables["contact"]["rolling_model"] == "epsd"
    assert tables["boundary"] == {"left": {"kind": "periodic"}, "front": {"particles": "remove"},
                                  "back": {"particles": "remove"}, "top": {"particles": "remove"}}  # fmt: skip
    (tmp_path / "scene.toml").write_text(import_deck(tmp_path / "in.deck", tmp_path / "scene.toml").toml)
    case = particle_setup(load_scene(tmp_path / "scene.toml"))
    np.testing.assert_allclose(case.position, [[0.14, 0.01, 0.02], [0.07, 0.01, 0.02]])
    np.testing.assert_allclose(case.present.radius, 0.005)
    np.testing.assert_allclose(case.present.density, 2500.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("run 10\n", r"a box .*a contact model .*particles .*a time step"),
        (PILE.replace("run 1000", ""), "nothing that a scene can take as a run"),
        (PILE.replace("units cgs", "units lj"), r"only si, cgs, micro are converted"),
        (PILE.replace("peratomtype 5e7", ""), "nothing that a scene can take as youngsModulus"),
        (PILE.replace("grains.data", "none.data"), "cannot be read"),
        (PILE.replace("hertz rolling", "jkr rolling"), "the model jkr has no counterpart"),
    ],
)
def test_a_deck_without_a_scene_is_refused(tmp_path, text, words):
    deck(tmp_path, DATA, "grains.data")
    with pytest.raises(InputError, match=words):
        import_deck(deck(tmp_path, text), tmp_path / "scene.toml")


def test_the_command(tmp_path):
    deck(tmp_path, DATA, "grains.data")
    out = tmp_path / "made" / "scene.toml"
    done = CliRunner().invoke(app, ["import", str(deck(tmp_path, PILE)), "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "taken     in.deck, line 1: units cgs" in done.output
    text = out.read_text()
    assert "# Made by `jaxdem import in.deck`" in text
    assert load_scene(out).particles.file.name == str(tmp_path / "grains.data")
    for argument in (tmp_path / "none", deck(tmp_path, "\x00\xff", "garbage")):
        assert CliRunner().invoke(app, ["import", str(argument), "--out", str(out)]).exit_code == 2


def test_formulas():
    assert evaluate("2*v_R^2 + sqrt(4)/-2", {"R": "3"}) == 17.0
    for text in ("bound(all,x)", "__import__('os')", "9^9^9^9^9", "1/0", "v_none", "(" * 500, "x.y"):
        with pytest.raises(Unknown):
            evaluate(text, {})


CASE = {
    "CFD/constant/couplingProperties": """/* a comment */ FoamFile { version 2.0; }
modelType "A"; // A or B
couplingInterval 10;
voidFractionModel divided;//centre;
forceModels ( gradPForce viscForce DiFeliceDrag fancyForce );
twoWayMPIProps { liggghtsPath "../DEM/in.run"; }
""",
    "CFD/constant/transportProperties": "transportModel Newtonian; nu nu [0 2 -1 0 0 0 0] 1.5e-05;",
    "CFD/0/rho": "dimensions [1 -3 0 0 0 0 0]; internalField uniform 1.2; boundaryField {}",
    "CFD/0/U": """internalField uniform (0 0 0);
boundaryField { inlet { type uniformFixedValue; uniformValue table ( (0 (0 0 0.1)) (0.5 (0 0 0.2)) ); }
 outlet { type zeroGradient; } sides { type slip; } }""",
    "CFD/0/p": "boundaryField { inlet { type zeroGradient; } outlet { type fixedValue; value $internalField; } }",
    "CFD/system/controlDict": "deltaT 1e-4; endTime 0.01; writeControl timeStep; writeInterval 50;",
    "CFD/system/blockMeshDict": """convertToMeters 0.01;
vertices ( (0 0 0) (20 0 0) (20 5 0) (0 5 0) (0 0 8) (20 0 8) (20 5 8) (0 5 8) );
blocks ( hex (0 1 2 3 4 5 6 7) (20 5 8) simpleGrading (1 1 1) );
edges ();
boundary ( inlet { type patch; faces ((0 1 2 3)); } outlet { type patch; faces ((4 5 6 7)); }
 sides { type wall; faces ((0 3 7 4) (1 2 6 5) (0 1 5 4) (3 2 6 7)); } );""",
    "DEM/in.run": PILE.replace("boundary p", "boundary f")
    .replace("chute 30", "vector 0 0 -1")
    .replace("run 1000", "run 1")
    + "fix cfd all couple/cfd couple_every 10 mpi\n",
    "DEM/grains.data": DATA.replace("-10 10", "0 20").replace("-3 1 2", "9 1 2"),
}


def case_of(tmp_path, **changes):
    for name, text in (CASE | changes).items():
        path = tmp_path / "case" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return import_deck(tmp_path / "case", tmp_path / "scene.toml")


def test_the_fluid_of_a_case(tmp_path):
    made = case_of(tmp_path)
    tables = tomllib.loads(made.toml)
    assert tables["domain"]["size"] == [0.2, 0.05, 0.08]
    assert tables["fluid"] == {
        "cells": [20, 5, 8],
        "density": 1.2,
        "viscosity": 1.5e-5,
        "time_step": 1e-4,
        "model": "A",
    }
    assert tables["coupling"] == {"interval": 1e-4, "void_fraction": "divided", "drag": "di_felice"}
    assert tables["boundary"]["bottom"] == {"kind": "inlet", "times": [0.0, 0.5],
                                            "velocities": [[0.0, 0.0, 0.1], [0.0, 0.0, 0.2]]}  # fmt: skip
    assert tables["boundary"]["top"] == {"kind": "outlet"}
    assert {tables["boundary"][side]["kind"] for side in ("left", "right", "front", "back")} == {"free_slip"}
    assert tables["time"] == {"end": 0.01, "output_interval": 0.005}
    assert next(note for note in made.notes if note.text == "forceModels fancyForce").kind == LEFT


def test_a_case_whose_mesh_is_no_box(tmp_path):
    mesh = CASE["CFD/system/blockMeshDict"]
    for change, words in (
        (mesh.replace("edges ()", "edges (arc 4 5 (0 1 2))"), "curved edges"),
        (mesh.replace("edges ();", "edges ("), "do not match"),
        (mesh.replace("vertices", "corners"), "has not the form"),
    ):
        with pytest.raises(InputError, match=words):
            case_of(tmp_path, **{"CFD/system/blockMeshDict": change})

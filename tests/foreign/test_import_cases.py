"""CFDEM cases: mesh, sides, coupling and time, and what of them has no counterpart."""

from __future__ import annotations

import re
import tomllib

import pytest
from cases import decks

from jaxdem import load_scene
from jaxdem.errors import InputError
from jaxdem.foreign.notes import DIFFERS, LEFT, NOTHING, TAKEN


def test_the_fluid_of_a_case(tmp_path):
    made = decks.case_of(tmp_path)
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


def tables_of(tmp_path, **changes):
    made = decks.case_of(tmp_path, **changes)
    return tomllib.loads(made.toml), made


def the(made, text):
    (found,) = [note for note in made.notes if note.text.startswith(text)]
    return found


def test_smagorinsky_and_files_without_a_counterpart(tmp_path):
    tables, made = tables_of(tmp_path, **decks.OTHERS)
    assert tables["fluid"]["smagorinsky"] == pytest.approx((0.094 * (0.094 / 1.048) ** 0.5) ** 0.5, abs=5e-4)
    places = {note.place: note.kind for note in made.notes if note.text == "the whole file"}
    assert places["constant/wonderProperties"] == LEFT and places["0/voidfraction"] == NOTHING


MESH = decks.CASE["CFD/system/blockMeshDict"]
BLOCKS = """convertToMeters 0.01;
vertices ( (0 0 0) (8 0 0) (20 0 0) (0 5 0) (8 5 0) (20 5 0) (0 0 8) (8 0 8) (20 0 8) (0 5 8) (8 5 8) (20 5 8) );
blocks ( hex (0 1 4 3 6 7 10 9) (8 5 8) simpleGrading (1 1 1)
         hex (1 4 10 7 2 5 11 8) right (5 8 12) edgeGrading (1 1 1 1 1 1 1 1 1 1 1 1) );
boundary ( inlet { type patch; faces ((0 1 4 3)); } floor { type wall; faces ((1 2 5 4)); }
 outlet { type patch; faces ((6 7 10 9) (7 8 11 10)); }
 sides { type wall; faces ((0 3 9 6) (2 5 11 8) (0 1 7 6) (1 2 8 7) (3 4 10 9) (4 5 11 10)); } );"""


def test_blocks_that_make_a_box(tmp_path):
    """One of 8 and one, whose own axes are turned, of 12 cells along x; the inlet is a patch of the bottom."""
    tables, made = tables_of(tmp_path, **{"CFD/system/blockMeshDict": BLOCKS})
    assert tables["fluid"]["cells"] == [20, 5, 8]
    bottom = tables["boundary"]["bottom"]
    assert (bottom["kind"], bottom["from"], bottom["to"]) == ("inlet", [0.0, 0.0], [0.08, 0.05])
    assert tables["boundary"]["top"] == {"kind": "outlet"}
    assert the(made, "inlet uniformFixedValue").kind == TAKEN


def test_a_case_whose_mesh_is_no_box(tmp_path):
    for change, words in (
        (MESH.replace("edges ()", "edges (arc 4 5 (0 1 2))"), "curved edges"),
        (MESH.replace("edges ();", "edges ("), "do not match"),
        (MESH.replace("vertices", "corners"), "has not the form"),
        (MESH.replace("(1 1 1)", "(1 1 4)"), "graded"),
        (MESH.replace("(20 5 8) (0 5 8)", "(25 5 8) (0 5 8)"), "no box along the axes"),
        (BLOCKS.replace("(8 5 8) s", "(4 5 8) s"), "cells are equal|are equal"),
        (BLOCKS.replace("hex (1 4 10 7 2 5 11 8)", "hex (0 1 4 3 6 7 10 9)").replace("(5 8 12)", "(8 5 8)"), "overlap"),
        (MESH.replace("convert", "#calc 1; convert"), "#calc"),
    ):
        with pytest.raises(InputError, match=words):
            decks.case_of(tmp_path, **{"CFD/system/blockMeshDict": change})


FIELD = decks.CASE["CFD/0/U"]


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ("type fixedValue; value uniform (0 0 0.3);", {"kind": "inlet", "velocity": [0.0, 0.0, 0.3], "ramp_time": 0.0}),
        ("type fixedValue; value uniform (0.2 0 0);",
         {"kind": "moving_wall", "velocity": [0.2, 0.0, 0.0], "ramp_time": 0.0}),
        ("type fixedValue; value uniform (0 0 0);", None),
        ("type surfaceNormalFixedValue; refValue uniform -0.3;", {"kind": "inlet", "velocity": 0.3, "ramp_time": 0.0}),
        ("type flowRateInletVelocity; volumetricFlowRate constant 0.002;",
         {"kind": "inlet", "velocity": 0.2, "ramp_time": 0.0}),
        ("type interstitialInletVelocity; inletVelocity uniform (0 0 1);",
         {"kind": "inlet", "velocity": [0.0, 0.0, 1.0], "ramp_time": 0.0}),
        ('type timeVaryingUniformFixedValue; fileName "$FOAM_CASE/constant/speed";',
         {"kind": "inlet", "times": [0.0, 1.0], "velocities": [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]]}),
        ("type codedFixedValue;", "has no counterpart"),
        ("type uniformFixedValue; uniformValue csvFile;", "not uniform"),
        ("type fixedValue; value nonuniform List<vector> 1((0 0 1));", "is not carried out|the form"),
        ("type flowRateInletVelocity; massFlowRate 0.002;", "massFlowRate"),
        ("type zeroGradient;", "without a fixed pressure"),
    ],
)  # fmt: skip
def test_sides(tmp_path, entry, expected):
    start = FIELD.index("inlet {") + 8
    field = FIELD[:start] + entry + FIELD[FIELD.index("}", start) :]
    others = {"CFD/0/U": field, "CFD/constant/speed": "( (0 (0 0 0)) (1 (0 0 2)) )"}
    tables, made = tables_of(tmp_path, **others)
    (note,) = [note for note in made.notes if note.place.startswith("0/U") and note.text.startswith("inlet ")]
    if isinstance(expected, str):
        assert note.kind == LEFT and re.search(expected, note.reason) and "bottom" not in tables["boundary"]
    else:
        assert note.kind == TAKEN and tables["boundary"].get("bottom") == expected


def test_names_that_are_patterns_and_macros(tmp_path):
    field = """speed (0 0 0.5); internalField uniform (0 0 0.1);
boundaryField { ".*" { type slip; } "(in|out)let" { type fixedValue; value uniform $speed; }
 outlet { type zeroGradient; } }"""
    tables, made = tables_of(tmp_path, **{"CFD/0/U": field})
    assert tables["boundary"]["bottom"]["velocity"] == [0.0, 0.0, 0.5]
    assert tables["boundary"]["top"] == {"kind": "outlet"} and tables["boundary"]["left"] == {"kind": "free_slip"}
    assert tables["fluid"]["velocity"] == [0.0, 0.0, 0.1]


COUPLING = decks.CASE["CFD/constant/couplingProperties"]


def test_models_of_the_coupling(tmp_path):
    """constDiffSmoothing: variance 2 L^2; a triangle of half-width w has w^2/6; particles of 1 cm."""
    text = COUPLING.replace("DiFeliceDrag fancyForce", "GidaspowDrag KochHillDrag virtualMassForce MeiLift Archimedes")
    text += "smoothingModel constDiffSmoothing; constDiffSmoothingProps { smoothingLength 0.006; } oddModel yes;"
    tables, made = tables_of(tmp_path, **{"CFD/constant/couplingProperties": text})
    coupling = tables["coupling"]
    assert (coupling["drag"], coupling["virtual_mass"], coupling["lift"]) == ("gidaspow", 0.5, ["saffman_mei"])
    assert coupling["void_fraction"] == "diffusion"
    width = coupling["kernel_width"]["diameters"] * 0.01
    assert width**2 / 6.0 == pytest.approx(2.0 * 0.006**2)
    assert the(made, "forceModels KochHillDrag").kind == LEFT and the(made, "oddModel").kind == LEFT
    bare = COUPLING.replace("gradPForce viscForce DiFeliceDrag fancyForce", "noDrag")
    tables, made = tables_of(tmp_path, **{"CFD/constant/couplingProperties": bare})
    assert tables["coupling"]["drag_factor"] == 0.0
    assert [note.kind for note in made.notes if "no Archimedes" in note.reason] == [DIFFERS]


CONTROL = decks.CASE["CFD/system/controlDict"]


def test_times(tmp_path):
    """The end is controlDict's, counted from startTime; so are tables. Runs of the script come before."""
    control = CONTROL.replace("endTime 0.01", "startFrom startTime; startTime 0.2; endTime 0.21")
    table = FIELD.replace("(0.5 (0 0 0.2))", "(0.5 (0 0 0.2))").replace("(0 (0 0 0.1))", "(0.2 (0 0 0.1))")
    script = decks.CASE["DEM/in.run"].replace("run 1\n", "run 1000 # settle\n")
    tables, made = tables_of(tmp_path, **{"CFD/system/controlDict": control, "CFD/0/U": table, "DEM/in.run": script})
    assert [(stage["name"], stage["time"]["end"]) for stage in tables["stages"]] == [
        ("settle", 0.01),
        ("coupled", 0.02),
    ]
    assert "fluid" not in tables and tables["stages"][1]["fluid"]["cells"] == [20, 5, 8]
    assert tables["stages"][1]["boundary"]["bottom"]["times"] == pytest.approx([0.01, 0.31])
    assert "stages.1, coupled" in the(made, "endTime").reason
    made.write(tmp_path / "scene.toml")
    assert [stage.name for stage in load_scene(tmp_path / "scene.toml").stages] == ["settle", "coupled"]
    tables, made = tables_of(tmp_path)
    assert the(made, "run 1").kind == NOTHING and "controlDict" in the(made, "run 1").reason
    odd = CONTROL.replace(
        "writeControl timeStep", "writeControl cpuTime; adjustTimeStep yes; stopAt nextWrite; wonder 1"
    )
    tables, made = tables_of(tmp_path, **{"CFD/system/controlDict": odd})
    assert tables["time"] == {"end": 0.01, "output_interval": 0.001}
    kinds = {name: the(made, name).kind for name in ("adjustTimeStep", "stopAt", "wonder", "writeControl")}
    assert kinds == {"adjustTimeStep": DIFFERS, "stopAt": LEFT, "wonder": LEFT, "writeControl": DIFFERS}


def test_cyclic_patches_are_periodic_before_the_fluid_too(tmp_path):
    ends = "ends { type cyclic; faces ((0 3 7 4) (1 2 6 5)); } sides { type wall; faces (("
    mesh = MESH.replace("sides { type wall; faces ((0 3 7 4) (1 2 6 5) (", ends)
    script = decks.CASE["DEM/in.run"].replace("run 1\n", "run 1000\n").replace("boundary f", "boundary p")
    tables, _ = tables_of(tmp_path, **{"CFD/system/blockMeshDict": mesh, "DEM/in.run": script})
    assert tables["boundary"]["left"] == {"kind": "periodic"} and "right" not in tables["boundary"]
    assert "left" not in tables["stages"][1]["boundary"]


def test_plane_walls_and_the_mesh(tmp_path):
    """At its end a side, outside of it noted, inside a wall with the particles on one side."""
    wall = "fix {} all wall/gran model hertz primitive type 1 {}plane {}\n"
    places = {"near": 0.0, "far": 30.0, "gate": 19.5, "split": 6.5}
    walls = "".join(wall.format(name, "x", place) for name, place in places.items())
    script = decks.CASE["DEM/in.run"].replace("fix grav", f"{walls}fix grav")
    tables, made = tables_of(tmp_path, **{"DEM/in.run": script})
    assert the(made, "fix near").reason.startswith("boundary.left, at 0 m")
    assert the(made, "fix far").kind == DIFFERS and "outside of the mesh" in the(made, "fix far").reason
    assert tables["walls"] == [{"kind": "plane", "point": [0.195, 0.0, 0.0], "normal": [-1.0, 0.0, 0.0]}]
    assert the(made, "fix split").kind == LEFT and "both sides" in the(made, "fix split").reason

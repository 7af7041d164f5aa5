"""Scenes from LIGGGHTS decks: what the deck says stands in the scene, and every line has a note."""

from __future__ import annotations

import math
import tomllib

import numpy as np
import pytest
from cases import decks
from typer.testing import CliRunner

from jaxdem import load_scene
from jaxdem.cli.main import app
from jaxdem.errors import InputError
from jaxdem.foreign import import_deck
from jaxdem.foreign.formula import evaluate
from jaxdem.foreign.notes import DIFFERS, LEFT, NOTHING, TAKEN, Unknown
from jaxdem.setup.particles import particle_setup


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
    return tables_of(tmp_path_factory.mktemp("drum"), decks.DRUM)


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
    assert {1 + k for k, line in enumerate(decks.DRUM.splitlines()) if line.startswith("fix pts1")} <= lines


def test_a_data_file_in_other_units_with_open_ends(tmp_path):
    deck(tmp_path, decks.GRAINS, "grains.data")
    tables, notes = tables_of(tmp_path, decks.PILE)
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


def test_energy_density_of_cohesion(tmp_path):
    """SJKR of LIGGGHTS; in a deck without it the density has no effect."""
    density = "fix m5 all property/global cohesionEnergyDensity peratomtypepair 1 3e4\n"
    for words, kind in (("cohesion sjkr", TAKEN), ("", TAKEN), ("cohesion washino", DIFFERS)):
        text = decks.HOPPER.replace("tangential history\ntimestep", f"tangential history {words}\ntimestep")
        tables, _, made = decks.imported(tmp_path, text.replace("fix m4", density + "fix m4"))
        found = tables["contact"].get("cohesion")
        assert found == ({"kind": "sjkr", "energy_density": 3e4} if words == "cohesion sjkr" else None)
        assert decks.note_on(made, "pair_style").kind == kind
        load_scene(tmp_path / "scene.toml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("run 10\n", r"a box .*a contact model .*particles .*a time step"),
        (decks.PILE.replace("run 1000", ""), "nothing that a scene can take as a run"),
        (decks.PILE.replace("units cgs", "units lj"), r"only si, cgs, micro are converted"),
        (decks.PILE.replace("peratomtype 5e7", ""), "nothing that a scene can take as youngsModulus"),
        (decks.PILE.replace("grains.data", "none.data"), "cannot be read"),
        (decks.PILE.replace("hertz rolling", "jkr rolling"), "the model jkr has no counterpart"),
    ],
)
def test_a_deck_without_a_scene_is_refused(tmp_path, text, words):
    deck(tmp_path, decks.GRAINS, "grains.data")
    with pytest.raises(InputError, match=words):
        import_deck(deck(tmp_path, text), tmp_path / "scene.toml")


def test_the_command(tmp_path):
    deck(tmp_path, decks.GRAINS, "grains.data")
    out = tmp_path / "made" / "scene.toml"
    done = CliRunner().invoke(app, ["import", str(deck(tmp_path, decks.PILE)), "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "taken     in.deck, line 1: units cgs" in done.output
    text = out.read_text()
    assert "# Made by `jaxdem import in.deck`" in text
    assert load_scene(out).particles.file.name == str(tmp_path / "grains.data")
    for argument in (tmp_path / "none", deck(tmp_path, "\x00\xff", "garbage")):
        assert CliRunner().invoke(app, ["import", str(argument), "--out", str(out)]).exit_code == 2
    again = ["import", str(tmp_path / "in.deck"), "--out"]
    assert CliRunner().invoke(app, [*again, str(out)]).exit_code == 0 and out.read_text() == text
    lost = CliRunner().invoke(app, [*again, str(tmp_path / "grains.data")])  # what the deck reads
    assert lost.exit_code == 2 and "was not made by `jaxdem import`" in " ".join(lost.stderr.split())
    assert (tmp_path / "grains.data").read_text() == decks.GRAINS


def test_formulas():
    assert evaluate("2*v_R^2 + sqrt(4)/-2", {"R": "3"}) == 17.0
    for text in ("bound(all,x)", "__import__('os')", "9^9^9^9^9", "1/0", "v_none", "(" * 500, "x.y"):
        with pytest.raises(Unknown):
            evaluate(text, {})


def test_a_side_that_moves_and_a_wall_that_comes_later(tmp_path):
    text = decks.HOPPER.replace("xplane 0.03", "xplane 0.03 shear z 0.5").replace(
        "unfix rain", f"unfix rain\nfix lid all {decks.WALL} zplane 0.085"
    )
    tables, _, made = decks.imported(tmp_path, text)
    assert tables["boundary"]["right"] == {"kind": "moving_wall", "velocity": [0.0, 0.0, 0.5]}
    assert tables["walls"][1] == {
        "kind": "plane",
        "point": [0.0, 0.0, 0.135],
        "normal": [0.0, 0.0, -1.0],
        "begin": 0.02,
    }
    assert decks.note_on(made, "fix lid").reason == '[[walls]], kind = "plane", begin = 0.02 s'
    assert "moving_wall" in decks.note_on(made, "fix x2").reason


def test_a_tube_in_a_periodic_box(tmp_path):
    """The sides across which the tube stands are no periodic ones: nothing reaches them."""
    tube = f"fix tube all {decks.WALL} zcylinder 0.02 0 0\n"
    before, _, rest = decks.HOPPER.replace("boundary f f f", "boundary p p f").partition("fix x1")
    text = f"{before}{tube}fix gate{rest.partition('fix gate')[2]}"
    tables, _, made = decks.imported(tmp_path, text)
    assert tables["boundary"] == {"bottom": {"particles": "remove"}}
    assert [note.kind for note in made.notes if note.text == "left and right"] == [DIFFERS]
    assert tables["walls"][0]["kind"] == "cylinder"


def test_planes_across_a_periodic_axis_are_left_out(tmp_path):
    tables, _, made = decks.imported(tmp_path, decks.HOPPER.replace("boundary f f f", "boundary p f f"))
    assert tables["boundary"]["left"] == {"kind": "periodic"}
    assert decks.note_on(made, "fix x1").kind == LEFT and "periodic along x" in decks.note_on(made, "fix x1").reason


def test_dense_packs_grow_and_are_filled_once(tmp_path):
    """8 grains of 4 mm fill a box of 24 x 24 x 8 mm to 0.466, one of 21 x 21 x 8 mm to 0.608."""
    for side, kind in ((0.012, "random"), (0.0105, "grown")):
        text = decks.HOPPER.replace("region above block -0.03 0.03 -0.02 0.02 0.0 0.08",
                                    f"region above block {-side} {side} {-side} {side} 0.0 0.008")  # fmt: skip
        tables, _, made = decks.imported(tmp_path, text.replace("insert_every once", "insert_every 100"))
        assert tables["particles"]["pack"][0]["kind"] == kind
        note = decks.note_on(made, "fix ins")
        assert (
            note.kind == DIFFERS
            and "again every 100 steps" in note.reason
            and ("grown" in note.reason) == (kind == "grown")
        )


def test_a_step_that_is_not_stable_is_the_automatic_one(tmp_path):
    tables, _, made = decks.imported(tmp_path, decks.HOPPER.replace("timestep 2e-5", "timestep 2e-4"))
    assert tables["contact"]["time_step"] == "auto"
    assert tables["stages"][1]["contact"]["time_step"] == 1e-5
    assert "is too long, the stable step is" in decks.note_on(made, "timestep 2e-4").reason


def test_other_particles_than_spheres_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"spheres \(the atom style is superquadric\)"):
        decks.imported(tmp_path, decks.HOPPER.replace("atom_style granular", "atom_style superquadric"))


def test_folders_that_are_no_case(tmp_path):
    with pytest.raises(InputError, match="without constant/couplingProperties"):
        import_deck(tmp_path, tmp_path / "scene.toml")
    decks.written(tmp_path, "solution {}", "constant/kinematicCloudProperties")
    with pytest.raises(InputError, match="a case of DPMFoam"):
        import_deck(tmp_path, tmp_path / "scene.toml")

"""Several runs of a deck: stages of one scene, walls and inlets with times, and a chain that runs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases import decks

from jaxdem import load_scene, simulate
from jaxdem.foreign.notes import DIFFERS, LEFT, NOTHING, TAKEN
from jaxdem.foreign.stages import difference
from jaxdem.scene.stages import scenes_of


@pytest.fixture(scope="module")
def hopper(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hopper")
    return (*decks.imported(folder, decks.HOPPER), folder)


def test_runs_become_stages(hopper):
    """Two runs between which a gate and an inlet end are one; gravity and the time step make the next."""
    tables, _, made, folder = hopper
    assert [stage["name"] for stage in tables["stages"]] == ["fill_it", "run_2", "run_3"]
    assert [stage["time"]["end"] for stage in tables["stages"]] == [0.04, 0.05, 0.06]
    assert tables["time"] == {"end": 0.04, "output_interval": 0.01}
    turned = tables["stages"][1]
    np.testing.assert_allclose(turned["domain"]["gravity"], [9.81 / 2, 0.0, -9.81 * math.sqrt(0.75)])
    assert turned["contact"] == {"time_step": 1e-5} and turned["time"]["output_interval"] == 0.005
    assert decks.note_on(made, "run 1000 upto").reason == "no step is made"
    scenes = scenes_of(load_scene(folder / "scene.toml"))
    assert [scene.time.end for scene in scenes] == [0.04, 0.05, 0.06]
    assert scenes[2].contact.time_step == 1e-5


def test_walls_and_inlets_end_by_their_own_keys(hopper):
    tables, _, made, _ = hopper
    assert tables["walls"] == [{"kind": "plane", "point": [0.0, 0.0, 0.05], "normal": [0.0, 0.0, 1.0], "end": 0.02}]
    assert tables["particles"]["inlet"][0]["end"] == 0.02
    assert tables["boundary"] == {"bottom": {"particles": "remove"}}
    assert tables["domain"]["size"] == [0.06, 0.04, 0.14]
    assert decks.note_on(made, "fix gate").reason == '[[walls]], kind = "plane", end = 0.02 s'
    assert decks.note_on(made, "unfix gate").reason == "walls.end"
    assert decks.note_on(made, "unfix rain").reason == "particles.inlet.end"


def test_walls_change_at_their_times(tmp_path):
    """The gate opens at 4 ms, outputs are 10 and later 5 ms apart: 1 ms divides all. Else the note says so."""
    for steps, expected in ((200, 0.001), (201, None)):
        text = decks.HOPPER.replace("run 1000\nunfix gate", f"run {steps}\nunfix gate")
        text = text.replace("run 1000 # open", f"run {2000 - steps}")
        tables, _, made = decks.imported(tmp_path, text)
        assert tables["walls"][0]["end"] == pytest.approx(steps * 2e-5)
        assert tables.get("coupling") == (None if expected is None else {"interval": expected})
        kinds = [note.kind for note in made.notes if note.text == "coupling.interval"]
        assert kinds == [DIFFERS if expected is None else TAKEN]


def test_walls_that_no_particle_reaches_are_named(hopper):
    made = hopper[2]
    far, behind = decks.note_on(made, "fix far"), decks.note_on(made, "fix behind")
    assert far.kind == LEFT and "outside of the box, which ends at -0.05 m" in far.reason
    assert behind.kind == NOTHING and "behind the plane at 0.09 m" in behind.reason
    assert decks.note_on(made, "fix top").reason == "boundary.top, at 0.09 m"


def test_particles_that_come_and_go_between_runs(hopper):
    start = hopper[0]["stages"][2]["start"]
    assert start["remove"] == [{"shape": "box", "start": [0.0, 0.0, 0.05], "stop": [0.06, 0.04, 0.13]}]
    (pack,) = start["add"]["pack"]
    assert pack["count"] == 2 and pack["region"]["start"] == [0.01, 0.0, 0.11]


def test_what_stands_after_the_last_run_has_no_effect(hopper):
    tables, _, made, _ = hopper
    late = decks.note_on(made, "fix late")
    assert late.kind == NOTHING and "after the last run" in late.reason
    assert len(tables["walls"]) == 1
    assert [note.kind for note in made.notes if note.text == "unfix grav"] == [TAKEN, NOTHING]


FEW = decks.HOPPER.replace("particlerate 200", "particlerate 50").replace("vel constant 0 0 -0.1 &", "&")
FEW = FEW.replace("run 3000 upto\n", "run 2500 upto\n").replace("delete_atoms region above\nrun 1000\n", "run 500\n")
FEW = FEW.replace("thermo_modify lost ignore\n", "").replace("unfix gate\n", "").replace("zplane -0.3", "zplane 0.0")


def test_a_chain_of_stages_runs(tmp_path):
    """The gate stays: every particle that is put in is there at the end, under the gravity of the last stage."""
    tables, _, _ = decks.imported(tmp_path, FEW)
    assert [stage["name"] for stage in tables["stages"]] == ["fill_it", "run_2", "run_3"]
    run = simulate(load_scene(tmp_path / "scene.toml"), tmp_path / "run")
    assert run.summary["valid"], run.summary["reason"]
    assert run.times[-1] == pytest.approx(0.05)
    frame = run.particles(-1)
    assert frame["active"].sum() == 8 + 1 + 2
    assert frame["velocity"][:8, 0].min() > 0.0


RESTART = f"""{decks.BOX.partition("region")[0]}read_restart ../post/filled.restart
{decks.MATERIAL}fix x1 all {decks.WALL} xplane -0.03
fix x2 all {decks.WALL} xplane 0.03
fix y1 all {decks.WALL} yplane -0.02
fix y2 all {decks.WALL} yplane 0.02
fix top all {decks.WALL} zplane 0.09
run 500
"""


def test_a_restart_that_a_script_beside_writes(tmp_path):
    """That script comes first. Walls that are given anew go on; the gate is not, and so it ends."""
    before = decks.HOPPER.partition("unfix gate")[0] + "write_restart post/filled.restart\n"
    tables, _, made = decks.imported(tmp_path, RESTART, **{"in.fill": before})
    assert "stages" not in tables and tables["time"]["end"] == pytest.approx(0.03)
    (gate,) = tables["walls"]
    assert gate["end"] == 0.02 and tables["domain"]["size"] == [0.06, 0.04, 0.14]
    note = decks.note_on(made, "read_restart")
    assert note.kind == TAKEN and "as in.fill leaves them" in note.reason
    first, second = [note for note in made.notes if note.text.startswith("fix x1")]
    assert first.reason == f"goes on as the wall of {second.place}" and second.reason == "boundary.left, at -0.03 m"
    assert {note.place.partition(",")[0] for note in made.notes} == {"in.fill", "in.deck", "scene"}


def test_the_difference_of_tables_laid_over_the_first_gives_the_second():
    before = {"a": {"x": 1, "y": {"z": 2}}, "walls": [1], "gone": {"k": 1}, "same": 3}
    after = {"a": {"x": 1, "y": {"z": 4}}, "same": 3, "new": {"q": 1}}
    assert difference(before, after) == {"a": {"y": {"z": 4}}, "walls": [], "gone": False, "new": {"q": 1}}
    assert difference(before, before) == {}


def test_two_runs_without_a_change_are_one(tmp_path):
    text = decks.HOPPER.partition("unfix gate")[0] + "run 500\nfix_modify x y\nrun 500 # again\n"
    tables, _, made = decks.imported(tmp_path, text)
    assert "stages" not in tables and tables["time"]["end"] == 0.04
    assert decks.note_on(made, "run 1000").reason.endswith("nothing changes between them")

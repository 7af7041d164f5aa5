"""The balance of energy: closed boxes, what one that is wrong shows, runs, what is refused.

Losses of single impacts against closed forms, which tests/physics/test_contact_cases.py runs, and every option in turn
are cases: `tests/cases/energy.py`.
"""

from __future__ import annotations

import json

import jax
import numpy as np
import pytest

import jaxdem
import jaxdem.particles.energy as kernel
from examples.extending.cohesion import AdhesiveSpheres
from jaxdem.cli.terminal import print_run
from jaxdem.errors import InputError
from jaxdem.io.energy import energy_text
from jaxdem.particle_step import stored
from jaxdem.particles.stored_energy import StoredEnergy
from jaxdem.run.parts.energy import balance, taken
from jaxdem.run.parts.springs import is_plain, springs_of
from tests.cases.energy import BOX, OPTIONS, SHAKE, balance_of, in_space, tilted, with_tables
from tests.cases.energy_of_bodies import BODIES, gate, lid, through
from tests.cases.tiers import COMBINATION, tiered

TOGETHER = {
    "walls, epsd and JKR": with_tables(
        BOX, walls=[tilted(motion=SHAKE)],
        contact={"rolling_friction": 0.1, "rolling_model": "epsd", **OPTIONS["JKR"]["contact"]},
    ),
    "liquid bridges, cdt and the linear law": with_tables(
        BOX, contact=OPTIONS["linear law"]["contact"] | OPTIONS["liquid bridges"]["contact"]
        | {"rolling_friction": 0.1}, particles=OPTIONS["two sizes"]["particles"],
    ),
    "van der Waals in space": in_space(with_tables(BOX, **OPTIONS["van der Waals"])),
}  # fmt: skip


@pytest.mark.parametrize("name", tiered(TOGETHER, first=["walls, epsd and JKR"]))
def test_a_closed_box_keeps_its_energy(name):
    """1e-6 of what is turned over; without the error of the springs' step to rounding."""
    found = balance_of(TOGETHER[name])
    turned_over = found["gained"] / found["gained_relative"]
    assert abs(found["gained_relative"]) < 1e-6
    assert abs(found["missing"]) < 1e-11 * turned_over
    for part in ("damping", "sliding", "tangential_damping"):
        assert found["dissipated"][part] > 1e-3 * turned_over, part


CLOSED = {
    "rods": BODIES["rods"],
    "rods, rolling, DMT and a plane that comes": BODIES["rods, rolling, DMT and a plane that comes"],
    "bodies in space": BODIES["bodies in space"],
    "bonds that break": BODIES["bonds that break"],
    "a gate that goes": gate(),
    "grains that come and go": through(),
    "a lid": lid(),
}
NEEDED = {"bonds that break": ("dissipated", "breaking", 1e-2), "a gate that goes": ("work", "wall_changes", 0.3),
          "grains that come and go": ("work", "population", 0.1), "a lid": ("work", "walls", 0.1),
          "rods, rolling, DMT and a plane that comes": ("work", "walls", 0.01)}  # fmt: skip
"""Parts without which the balance would be off by more than so much of what is turned over."""


@pytest.mark.parametrize("name", tiered(CLOSED, first=["bonds that break"]))
def test_bodies_bonds_and_what_comes_and_goes(name):
    found = balance_of(CLOSED[name])
    turned_over = found["gained"] / found["gained_relative"]
    assert abs(found["gained_relative"]) < 1e-6
    assert abs(found["missing"]) < 1e-11 * turned_over
    if name in NEEDED:
        side, part, least = NEEDED[name]
        assert abs(found[side][part]) > least * turned_over


def test_gravity_that_changes_beside_grains_that_come_and_go():
    """It was looked up in its table twice."""
    gravity = {"gravity_times": [0.0, 0.01], "gravity": [[8.0, -9.81], [0.0, -9.81]]}
    scene = jaxdem.load_scene(with_tables(through(), domain={"size": [0.02, 0.02], **gravity}))
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    report = jax.eval_shape(lambda *given: simulation.step(*given), parameters, state, neighbors)[2]
    assert report.particles.energy.population.shape == ()


def test_work_of_the_fluid_by_the_forces_that_a_run_reports():
    """Grains that settle: the sum over the intervals of the mean force of the fluid times the way of each grain."""
    still = {side: {"kind": "no_slip"} for side in ("left", "right", "bottom", "top")}
    tables = with_tables(
        BOX, fluid={"cells": [4, 4], "density": 1000.0, "viscosity": 1e-6, "time_step": 1e-3}, boundary=still,
        domain={"size": [0.02, 0.02], "depth": 0.002}, contact={"time_step": 5e-6}, time={"end": 0.01},
    )  # fmt: skip
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    step, told, work = jax.jit(simulation.step), 0.0, 0.0
    start = stored(simulation, parameters, state.particles, neighbors, state.step)
    flows = []
    for _ in range(10):
        before = state.particles.position
        state, neighbors, report = step(parameters, state, neighbors)
        told += float(report.particles.energy.fluid)
        work += float(np.sum(state.particles.fluid_force * (state.particles.position - before)))
        flows.append({name: float(x) for name, x in report.particles.energy._asdict().items()})
    end = stored(simulation, parameters, state.particles, neighbors, state.step)
    assert abs(work) > 0.05 * float(start.translation)
    assert told == pytest.approx(work, rel=1e-9)
    total = {name: sum(flow[name] for flow in flows) for name in flows[0]}
    found = balance(*({k: float(x) for k, x in moment._asdict().items()} for moment in (start, end)), total)
    assert abs(found["missing"]) < 1e-11 * found["gained"] / found["gained_relative"]


def test_a_balance_without_the_dashpots_of_walls_does_not_close(monkeypatch):
    honest = kernel.work_of_contacts

    def careless(model, found, *given):
        work = honest(model, found, *given)
        return work._replace(damping=0.0 * work.damping) if found.pair.other_spin is None else work

    monkeypatch.setattr(kernel, "work_of_contacts", careless)
    assert abs(balance_of(with_tables(BOX, contact={"time_step": 1e-5}))["gained_relative"]) > 0.02


def scene_of(**changes):
    film = {"cutoff": 2e-4, "roughness": 2e-6, "viscosity": 2e-3, "wet_friction": 0.05, "sommerfeld_number": 1e-3}
    contact = {"time_step": 1e-5, "lubrication": film}
    tables = with_tables(BOX, contact=contact, time={"end": 0.01, "output_interval": 0.005})
    return jaxdem.load_scene(with_tables(tables, **changes))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run with the balance."""
    return jaxdem.simulate(scene_of(), tmp_path_factory.mktemp("energy") / "whole")


def test_the_summary_of_a_run_has_it_and_a_resumed_one_the_same(whole, tmp_path, capsys):
    jaxdem.simulate(scene_of(time={"end": 0.005}), tmp_path / "half")
    resumed = jaxdem.simulate(scene_of(), tmp_path / "half", resume=True)
    figures = whole.summary["energy"]
    assert resumed.summary["energy"] == figures
    assert figures["dissipated"]["liquid"] > 0.0
    for name in ("position", "velocity", "contact_force"):
        np.testing.assert_array_equal(whole.particles(-1)[name], resumed.particles(-1)[name])
    assert figures["missing"] == pytest.approx(0.0, abs=1e-11 * figures["start"]["translation"])
    assert 1e-6 < abs(figures["gained_relative"]) < 1e-3
    print_run(whole)
    assert "balanced but for" in capsys.readouterr().out
    assert json.loads((whole.path / "summary.json").read_text())["energy"] == figures


def test_a_run_without_the_option_tells_what_is_taken_and_moves_alike(whole, tmp_path):
    off = jaxdem.simulate(scene_of(output={"energy": False}), tmp_path / "off")
    told, balanced = off.summary["energy"], whole.summary["energy"]
    for moment in ("start", "end"):
        assert told[moment] == pytest.approx(balanced[moment], rel=1e-9, abs=1e-20)
    assert told["end"]["normal"] > 0.0 and told["end"]["tangential"] > 0.0
    assert told["taken"] == pytest.approx(sum(balanced["dissipated"].values()) - balanced["gained"], rel=1e-9)
    assert told["taken_by"] == ["contacts"] and told["remark"] == ""
    assert energy_text(told).endswith("J taken from the particles by contacts")
    np.testing.assert_allclose(whole.particles(-1)["velocity"], off.particles(-1)["velocity"], rtol=1e-9)


def test_a_closed_box_that_gains_energy_says_so():
    start = dict.fromkeys(StoredEnergy._fields, 0.0) | {"translation": 1.0}
    assert "gained 0.5 J" in taken(start, start | {"translation": 1.5}, [])["remark"]
    assert taken(start, start | {"translation": 1.5}, ["fluid"])["remark"] == ""
    assert taken(start, start | {"translation": 0.5}, [])["taken"] == 0.5
    pile = start | {"translation": 0.0, "potential": 2.0, "normal": 1e-3}
    assert taken(pile, pile | {"normal": 1e-3 * (1.0 + 1e-12)}, [])["remark"] == ""


PRESSED = with_tables(
    BOX, contact={"time_step": 2e-6}, particles={"position": [[0.005, 0.000999], [0.006998, 0.00105], [0.0061, 0.0029],
                                                             [0.012, 0.004]]},
)  # fmt: skip
SPACE = in_space(with_tables(PRESSED, contact=OPTIONS["linear law"]["contact"]))
PLAIN = {
    "in the plane": PRESSED,
    "in space, linear law, two sizes": with_tables(
        SPACE,
        particles=OPTIONS["two sizes"]["particles"]
        | {"position": [[0.005, 0.01, 0.000999], [0.006998, 0.01, 0.00105], *SPACE["particles"]["position"][2:]]},
    ),
}


@pytest.mark.parametrize("name", tiered(PLAIN, first=["in the plane"]))
def test_springs_by_numpy_are_those_of_the_program(name):
    tables = with_tables(PLAIN[name], time={"end": 2e-4, "output_interval": 2e-4})
    simulation, parameters = jaxdem.build(scene := jaxdem.load_scene(tables))
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    state, neighbors, _ = jax.jit(simulation.step)(parameters, state, neighbors)
    known = jax.jit(stored)(simulation, parameters, state.particles, neighbors, state.step)
    model = simulation.contact.model
    assert is_plain(model, parameters.bodies)
    normal, tangential = springs_of(model, parameters.materials, parameters.bodies, state.particles, neighbors)
    assert normal > 0.0 and tangential > 0.0
    assert (normal, tangential) == (pytest.approx(float(known.normal), rel=1e-9),
                                    pytest.approx(float(known.tangential), rel=1e-9))  # fmt: skip


REFUSED = {
    "a law of the user's": (BOX, {"contact_law": lambda contact, material: None}, "StoringLaw"),
    "a cohesion of the user's": (with_tables(BOX, **OPTIONS["JKR"]), {"cohesion": AdhesiveSpheres()}, "cohesion"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_has_no_known_energy_is_refused(name):
    tables, extensions, words = REFUSED[name]
    with pytest.raises(InputError, match=words) as found:
        jaxdem.build(jaxdem.load_scene(tables), **extensions)
    assert found.value.key == "output.energy"


def lost_by_damping(scene):
    """The restitution of a scene, and a function of it: what dashpots take in the first interval [J]."""
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)

    def lost(restitution):
        contact = parameters.contact._replace(restitution=restitution)
        report = simulation.reversible().step(parameters._replace(contact=contact), state, neighbors)[2]
        return report.particles.energy.damping

    return parameters.contact.restitution, lost


@COMBINATION
def test_gradients_pass_through_a_step_with_the_balance():
    scene = scene_of(time={"end": 2e-3, "output_interval": 2e-3})
    restitution, lost = lost_by_damping(scene)
    slope = jax.jit(jax.grad(lost))(restitution)
    assert np.isfinite(slope) and slope < 0.0


@COMBINATION
def test_slopes_of_what_rods_lose_on_a_mesh():
    """Reverse mode through clumps, triangles and the balance at once; the largest part of the time is compiling it."""
    falling = {
        "position": [[0.005, 0.0028], [0.0125, 0.0032]], "velocity": [[0.1, -0.4], [0.0, -0.4]],
        "orientation": [0.3, -0.2], "angular_velocity": [[0.0], [0.0]],
    }  # fmt: skip
    end = {"end": 1.5e-3, "output_interval": 1.5e-3}
    scene = jaxdem.load_scene(
        with_tables(BODIES["rods on a mesh"], contact={"time_step": 5e-6}, particles=falling, time=end)
    )
    restitution, lost = lost_by_damping(scene)
    slope = jax.jit(jax.value_and_grad(lost), compiler_options={"xla_backend_optimization_level": 0})
    at, change = restitution, 1e-6
    difference = (slope(at + change)[0] - slope(at - change)[0]) / (2.0 * change)
    assert difference < 0.0
    assert float(slope(at)[1]) == pytest.approx(float(difference), rel=1e-6)

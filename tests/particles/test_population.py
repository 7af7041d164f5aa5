"""Particles that come in and leave: counts, places, what waits, what the others keep, gradients, resume."""

from __future__ import annotations

import dataclasses
import json
import os
import signal

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.check.program import compiled_parts, population_rows
from jaxdem.coupling.presence import present_volume, volume_error
from jaxdem.errors import InputError
from jaxdem.particle_step import renewed_particles
from jaxdem.run.parts.population import particle_counts
from jaxdem.run.time_loop import Interrupted
from jaxdem.scene.particles import largest_radius

INTERVAL = 0.01
BOX = {
    "seed": 5,
    "precision": "float64",
    "domain": {"size": [1.0, 1.0, 1.0]},
    "particles": {
        "radius": 0.01,
        "density": 2500.0,
        "inlet": [
            {"start": [0.2, 0.2, 0.4], "stop": [0.8, 0.8, 0.6], "rate": 730.0,
             "velocity": [1.0, 2.0, -3.0], "end": 0.105},
            {"side": "top", "mass_flow": 9.0, "velocity": 0.5, "begin": 0.03, "end": 0.1, "species": [
                {"share": 0.5, "radius": 0.01}, {"share": 0.5, "radius": 0.02}]},
        ],
    },
    "contact": {"young_modulus": 1e6, "speed": 1.0},
    "boundary": {"right": {"particles": "remove"}},
    "time": {"end": 0.2, "output_interval": 0.01},
}  # fmt: skip
SHEET = {
    "seed": 2,
    "precision": "float64",
    "domain": {"size": [1.0, 1.0]},
    "particles": {
        "radius": 0.02, "density": 2500.0,
        "position": [[0.97, 0.5], [0.9303, 0.5], [0.8906, 0.5], [0.2, 0.7]],
        "inlet": [{"start": [0.1, 0.6], "stop": [0.3, 0.8], "rate": 100.0, "total": 12, "velocity": [0.0, -1.0]}],
    },
    "contact": {"young_modulus": 1e6, "friction": 0.5, "speed": 1.0},
    "boundary": {"right": {"particles": "remove"}},
    "time": {"end": 0.3, "output_interval": 0.1},
}  # fmt: skip


OPEN = {side: {"particles": "remove"} for side in ("left", "right", "bottom", "top")}
"""No walls: less to compile."""


def built(tables, **particles):
    tables = {**tables, "particles": {**tables["particles"], **particles}}
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    return simulation, parameters, *jaxdem.initial_state(scene, simulation, parameters)


@pytest.fixture(scope="module")
def box():
    return built(BOX)


@pytest.fixture(scope="module")
def sheet():
    return built(SHEET)


def test_check_says_who_comes_and_goes(sheet):
    """The number of rows is known before the run, and so is when they are due."""
    scene = jaxdem.load_scene(SHEET)
    rows = dict(population_rows(scene, sheet[0], sheet[2]))
    assert rows["present at the start"] == "4" and rows["removed at"] == "right"
    assert rows["inlet 0"] == "12 particles at 100 1/s, due from 0.01 to 0.12 s, up to 4 at once"
    compiled_in, left_out = compiled_parts(scene, sheet[0], sheet[1])
    assert {"removal of particles", "particle inlets"} <= set(compiled_in)
    assert "materials by pair" in left_out


def renewal(simulation, parameters):
    return jax.jit(lambda p, n, k: renewed_particles(simulation, parameters, p, n, k))


def listed(neighbors, row):
    """Neighbours of a particle in a list."""
    return {int(other) for other in np.asarray(neighbors.index)[:, row]} - {row}


def test_in_a_free_region_the_rates_are_met_exactly(box):
    """730 per second in intervals of 0.01 s; 9 kg/s to within a grain; all without overlap, inside, at their speed.

    Every interval those who came are put beyond the right side, so that the next finds room and counts them out.
    """
    simulation, parameters, state, neighbors = box
    renew = renewal(simulation, parameters)
    particles, radius = state.particles, np.asarray(parameters.bodies.radius)
    mass = np.asarray(parameters.bodies.mass)
    first, second = simulation.population.inlets
    assert (len(first.due), first.first, second.first) == (76, 0, 76)
    inserted = 0
    for step in range(1, 21):
        before = np.asarray(particles.active)
        particles, neighbors = renew(particles, neighbors, jnp.int32(step))
        active = np.asarray(particles.active)
        came = np.flatnonzero(active)
        assert not (active & before).any()
        counts = particle_counts(simulation, state._replace(particles=particles))
        inserted += len(came)
        assert counts == {
            "initial": 0, "inserted": inserted, "removed": inserted - len(came), "present": len(came)
        }  # fmt: skip
        numbers = np.asarray(particles.inserted)
        assert numbers[0] == np.floor(730.0 * min(step * INTERVAL, 0.105) + 1e-9)
        due = 9.0 * np.clip(step * INTERVAL - 0.03, 0.0, 0.07)
        arrived = mass[76 : 76 + numbers[1]].sum()
        assert due - mass.max() - 1e-12 < arrived <= due + 1e-12
        assert int(simulation.population.waiting(particles.inserted, jnp.int32(step))) == 0
        x, r = np.asarray(particles.position)[came], radius[came]
        gap = np.linalg.norm(x[:, None] - x, axis=2) - r[:, None] - r + np.eye(len(x))
        assert gap.min(initial=1.0) > 0.0
        for inlet, which in ((first, came < 76), (second, came >= 76)):
            assert (x[which] >= inlet.lower + r[which, None] - 1e-12).all()
            assert (x[which] <= inlet.upper - r[which, None] + 1e-12).all()
        velocity = np.where((came < 76)[:, None], [1.0, 2.0, -3.0], [0.0, 0.0, -0.5])
        np.testing.assert_array_equal(np.asarray(particles.velocity)[came], velocity)
        away = np.where(active[:, None], np.asarray([[1.01, 0.5, 0.5]]), np.asarray(particles.position))
        particles = particles._replace(position=jnp.asarray(away))
    assert inserted == particles.position.shape[0] and numbers[1] > 5
    assert int(np.asarray(neighbors.builds)) > 10


def test_what_finds_no_room_waits_and_comes_later(sheet):
    """The inlet is full but for four places of its corners, or less; when it is empty all that wait catch up."""
    simulation, parameters, state, neighbors = sheet
    renew = renewal(simulation, parameters)
    # A crowd over the inlet, in rows of the inlet that have not come: they are far from the others.
    particles = state.particles
    blocked = particles._replace(position=particles.position.at[:4].set(particles.position[3]))
    large = jnp.where(jnp.arange(16) < 4, 0.2, 0.02)
    filled = dataclasses.replace(neighbors, radius=large)
    full, filled = renew(blocked, filled, jnp.int32(5))
    neighbors = dataclasses.replace(filled, radius=neighbors.radius)
    waiting = simulation.population.waiting
    assert int(full.inserted[0]) == 0 and int(waiting(full.inserted, jnp.int32(5))) == 5
    assert int(waiting(full.inserted, jnp.int32(99))) == 12  # all that there are
    free = full._replace(position=full.position.at[:4, 1].set(0.1))
    free, neighbors = renew(free, neighbors, jnp.int32(6))
    batch = simulation.population.inlets[0].batch
    assert batch == 4 and int(free.inserted[0]) == 4
    free, neighbors = renew(free, neighbors, jnp.int32(7))
    assert int(free.inserted[0]) == 7 and int(waiting(free.inserted, jnp.int32(7))) == 0


def test_removal_leaves_the_others_their_history(sheet):
    """Of a row of three that touch, the first is outside: the springs between the others stay, theirs with it go."""
    simulation, parameters, state, neighbors = sheet
    particles = state.particles
    first, second = map(np.asarray, neighbors.pairs[:2])
    assert listed(neighbors, 1) >= {0, 2}
    springs = jnp.asarray(np.where(first != second, 1e-6 * (1 + first + 16 * second), 0.0))
    particles = particles._replace(
        position=particles.position.at[0, 0].set(1.001),
        velocity=particles.velocity.at[:3].set(1.0),
        contact_spring=(springs,),
        wall_spring=tuple(spring.at[:, :3].set(1e-7) for spring in particles.wall_spring),
    )
    particles, after = renewal(simulation, parameters)(particles, neighbors, jnp.int32(0))
    assert np.asarray(particles.active).tolist() == [False, True, True, True] + [False] * 12
    assert listed(after, 0) == set() and listed(after, 1) == {2} and listed(after, 2) == {1}
    kept, first, second = np.asarray(particles.contact_spring[0]), *map(np.asarray, after.pairs[:2])
    np.testing.assert_array_equal(kept, np.where(first != second, 1e-6 * (1 + first + 16 * second), 0.0))
    assert (kept > 0.0).sum() == 1 and (first[0], second[0]) == (1, 2)
    assert not np.asarray(particles.velocity)[0].any() and np.asarray(particles.velocity)[1].all()
    assert not np.asarray(particles.wall_spring[0])[:, 0].any()
    assert np.asarray(particles.wall_spring[0])[:, 1].all()
    assert int(after.builds) == int(neighbors.builds) + 1


def test_gradients_pass_those_who_are_absent():
    """Where they are after three intervals, by gravity and by the inlet's velocity: central differences; one particle
    leaves and two come in."""
    simulation, parameters, state, neighbors = built(
        {
            **SHEET,
            "boundary": OPEN,
            "contact": {"young_modulus": 1e6, "time_step": 9e-4, "speed": 1.0, "maximum_overlap": 0.5},
        },
        velocity=[[4.0, 0.0], [0.0, 0.0], [0.1, 0.0], [-0.1, 0.0]],
    )

    def end(gravity, velocity):
        given = parameters._replace(gravity=gravity, inlet_velocity=(velocity,))
        result = jaxdem.rollout(simulation, given, state, neighbors, 3)
        particles = result.state.particles
        weights = jnp.arange(1.0, 17.0)[:, None] * jnp.asarray([[1.0, 2.0]])
        return jnp.sum(jnp.where(particles.active[:, None], weights * particles.position, 0.0)), result

    compiled = jax.jit(jax.value_and_grad(end, (0, 1), has_aux=True))
    gravity, velocity = parameters.gravity, parameters.inlet_velocity[0]
    (_, result), slopes = compiled(gravity, velocity)
    counts = particle_counts(simulation, result.state)
    assert counts == {"initial": 4, "inserted": 3, "removed": 1, "present": 6}
    assert int(result.failures) == 0
    for k, step in enumerate((jnp.asarray([0.0, 1e-5]), jnp.asarray([1e-6, 0.0]))):
        moved = [
            compiled(*(x + sign * step if number == k else x for number, x in enumerate((gravity, velocity))))
            for sign in (1, -1)
        ]
        slope = (moved[0][0][0] - moved[1][0][0]) / (2.0 * float(step.sum()))
        assert slope != 0.0
        np.testing.assert_allclose(slopes[k] @ (step / step.sum()), slope, rtol=1e-6)


def test_a_scene_without_exits_and_inlets_compiles_neither():
    def program(tables):
        simulation, parameters, state, neighbors = built(tables)
        text = jax.jit(lambda p, s: simulation.step(p, s, neighbors)[0]).lower(parameters, state).as_text()
        return simulation, state.particles, text

    _, particles, text = program({**SHEET, "boundary": OPEN})
    assert particles.active.shape == (16,) and "threefry2x32" in text and "tensor<16xi1>" in text
    plain = {name: value for name, value in SHEET["particles"].items() if name != "inlet"}
    simulation, particles, text = program({**SHEET, "particles": plain, "boundary": {}})
    assert simulation.population is None and particles.active is None and particles.inserted is None
    assert "threefry2x32" not in text


STREAM = {
    "seed": 1,
    "domain": {"size": [0.4, 0.2], "depth": 0.02},
    "particles": {
        "radius": 0.01, "density": 1200.0,
        "position": [[0.05, 0.05], [0.375, 0.06], [0.38, 0.1]],
        "inlet": [{"side": "left", "from": 0.05, "to": 0.15, "rate": 100.0, "velocity": 0.4, "end": 0.15}],
    },
    "contact": {"young_modulus": 1e5, "speed": 1.0, "skin": 0.3},
    "fluid": {"cells": [8, 4], "time_step": 0.01},
    "coupling": {"virtual_mass": 0.5},  # what it keeps for a particle goes with it
    "boundary": {
        "left": {"kind": "inlet", "velocity": 0.5, "ramp_time": 0.0},
        "right": {"kind": "outlet", "particles": "remove"},
    },
    "time": {"end": 0.2, "output_interval": 0.02},
    "output": {"checkpoint_interval": 0.0},
}  # fmt: skip


@pytest.fixture(scope="module")
def streams(tmp_path_factory):
    """A run with a fluid, and the same one stopped in between two outputs and resumed."""
    scene = jaxdem.load_scene(STREAM)
    folder = tmp_path_factory.mktemp("streams")

    def stop(time, end):
        if round(time / INTERVAL) == 9:
            os.kill(os.getpid(), signal.SIGTERM)

    whole = jaxdem.simulate(scene, folder / "whole")
    with pytest.raises(Interrupted), pytest.MonkeyPatch.context() as patch:
        patch.setattr("jaxdem.run.chunk.LONGEST", 0.0)  # the host looks after every interval
        jaxdem.simulate(scene, folder / "resumed", progress=stop)
    return whole, jaxdem.simulate(scene, folder / "resumed", resume=True)


def test_the_error_of_the_volume_counts_those_present():
    """Of three particles of volume 2 the last is absent; and of none present nothing is deposited."""
    active, nobody = jnp.asarray([True, True, False]), jnp.zeros(3, bool)
    for deposited, volume, mask, error in (
        (4.0, 2.0, active, 0.0), (6.0, 2.0, active, 0.5), (5.0, [1.0, 3.0, 7.0], active, 0.25),
        (0.0, 2.0, nobody, 0.0), (5.0, 2.0, None, 1.0 / 6.0),
    ):  # fmt: skip
        total = present_volume(jnp.asarray(volume), 3, mask)
        assert volume_error(jnp.asarray(deposited), total) == pytest.approx(error)
    assert volume_error(jnp.zeros(()), present_volume(jnp.asarray(2.0), 0, None)) == 0.0


def test_with_a_fluid_counts_volume_and_momentum_hold(streams):
    """15 come in, some late; the two that stood at the outlet are washed out; the residuals are rounding."""
    run, _ = streams
    counts = run.summary["counts"]
    assert (counts["initial"], counts["inserted"], counts["particles"]) == (3, 15, 18)
    assert counts["removed"] >= 2
    assert counts["present"] == 18 - counts["removed"]
    history = run.history
    due = np.floor(100.0 * np.minimum(history["time"], 0.15) + 1e-6)
    late = 3 + due - history["present"] - history["removed"]
    # The layer of the inlet empties at 0.4 m/s: some have to wait, none is dropped.
    inlets = run.summary["inlets"]
    assert (late >= 0.0).all() and 0.0 < late.max() <= inlets["waiting_most"] and late[-1] == 0.0
    assert inlets["inserted"] == [15] and inlets["waiting"] == 0
    # The outputs see every other interval, so this is less than the whole of the waiting.
    assert inlets["delay_mean_s"] >= late.sum() * INTERVAL / 15
    assert run.summary["valid"]
    assert run.summary["residuals"]["volume"] < 1e-5
    assert run.summary["residuals"]["momentum"] < 1e-5
    assert run.summary["residuals"]["mass"] < 1e-4
    for frame in range(run.number_of_frames):
        particles, fluid = run.particles(frame), run.fluid(frame)
        active = particles["active"].astype(bool)
        assert particles["active"].dtype == np.uint8 and active.sum() == history["present"][frame]
        assert not particles["velocity"][~active].any() and not particles["contact_force"][~active].any()
        assert not particles["drag_force"][~active].any()
        speed = np.linalg.norm(particles["velocity"][active].astype(float), axis=1).mean()
        assert history["particle_velocity_mean"][frame] == pytest.approx(speed, rel=1e-6)
        assert np.isfinite(fluid["velocity"]).all()
    # The fluid of a frame holds the volume of those who were present one interval earlier, and of no others.
    for frame in range(1, run.number_of_frames):
        solids = (1.0 - run.fluid(frame)["void_fraction"].astype(float)).sum() * 0.05 * 0.05 * 0.02
        number = solids / (4.0 / 3.0 * np.pi * 0.01**3)
        assert number == pytest.approx(round(number), abs=1e-3)
        fewest, most = sorted(history["present"][frame - 1 : frame + 1])
        assert fewest - 1 <= round(number) <= most + 1
    assert history["drag_force_mean"][-1] > 0.0


def test_resumed_it_is_the_same_bit_for_bit(streams):
    whole, resumed = streams
    assert (whole.path / "history.csv").read_bytes() == (resumed.path / "history.csv").read_bytes()
    for frame in range(whole.number_of_frames):
        ours, theirs = whole.particles(frame), resumed.particles(frame)
        assert ours.keys() == theirs.keys()
        assert all(ours[name].tobytes() == theirs[name].tobytes() for name in ours)
    summaries = [json.loads((run.path / "summary.json").read_text()) for run in streams]
    for name in ("counts", "inlets", "residuals"):
        assert summaries[0][name] == summaries[1][name]


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        ({"rate": None}, "particles.inlet.0.rate", "either rate or mass_flow"),
        ({"mass_flow": 1.0}, "particles.inlet.0.rate", "either rate or mass_flow"),
        ({"side": "top"}, "particles.inlet.0.side", "either a side"),
        ({"start": None, "stop": None, "side": "roof"}, "particles.inlet.0.side", "no such side"),
        (
            {"start": None, "stop": None, "side": "top", "velocity": -1.0},
            "particles.inlet.0.velocity",
            "does not point into the box",
        ),
        ({"stop": [0.13, 0.8]}, "particles.inlet.0.stop", "holds no particle"),
        ({"stop": [0.3, 1.8]}, "particles.inlet.0.stop", "inside the box"),
        ({"velocity": 1.0}, "particles.inlet.0.velocity", "vector"),
        ({"rate": 1.0}, "particles.inlet.0.rate", "brings no particle"),
        ({"rate": 1e12, "total": None}, "particles.inlet.0.rate", "up to 3e+11"),
        ({"ratte": 1.0}, "particles.inlet.0.ratte", "Did you mean 'rate'"),
        ({"begin": 0.2, "end": 0.1}, "particles.inlet.0.end", "after begin"),
        ({"material": "glass"}, "particles.inlet.0.material", "no such material"),
    ],
)
def test_mistakes_of_inlets_are_named(changes, key, words):
    inlet = {**SHEET["particles"]["inlet"][0], **changes}
    inlet = {name: value for name, value in inlet.items() if value is not None}
    with pytest.raises(InputError) as caught:
        jaxdem.build(jaxdem.load_scene({**SHEET, "particles": {**SHEET["particles"], "inlet": [inlet]}}))
    assert caught.value.key == key
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("tables", "words", "remedy"),
    [
        ({"right": {"kind": "no_slip", "particles": "remove"}}, "only through an outlet", 'kind = "outlet"'),
        ({"right": {"kind": "outlet", "particles": "remove", "from": 0.0, "to": 0.1}}, "whole side", "from and to"),
        ({"right": {"kind": "outlet", "particles": "delete"}}, "screen", ""),
    ],
)
def test_mistakes_of_exits_are_named(tables, words, remedy):
    with pytest.raises(InputError) as caught:
        jaxdem.load_scene({**STREAM, "boundary": tables})
    assert caught.value.key == "boundary.right.particles"
    assert words in str(caught.value) and remedy in caught.value.remedy


def test_basset_force_is_refused_where_particles_come_and_leave():
    with pytest.raises(InputError, match=r"coupling\.basset = 20.*from the start to the end"):
        jaxdem.load_scene({**STREAM, "coupling": {"basset": 20}})


def test_the_depth_is_that_of_the_largest_that_comes():
    scene = jaxdem.load_scene({**SHEET, "particles": {**SHEET["particles"], "inlet": [
        {**SHEET["particles"]["inlet"][0], "radius": 0.05}]}})  # fmt: skip
    assert scene.domain.depth == 2.0 * largest_radius(scene.particles) == 0.1
    with pytest.raises(InputError, match="enter or leave"):
        tables = {**STREAM, "output": {"samples": 0.02}}
        jaxdem.simulate(jaxdem.load_scene(tables), "unused")


FALLING = {
    "precision": "float64",
    "domain": {"size": [0.1, 1.0], "gravity": [0.0, 0.0]},
    "particles": {
        "radius": 0.01, "density": 2500.0, "position": [[0.05, 0.05]], "velocity": [[0.0, -1.0]],
        "inlet": [{"start": [0.0, 0.9], "stop": [0.1, 1.0], "rate": 100.0, "velocity": [0.0, -1.0], "total": 3}],
    },
    "contact": {"speed": 2.0, "time_step": 2e-5, "young_modulus": 1e7},
    "boundary": {"bottom": {"particles": "remove"}},
    "coupling": {"interval": 0.002},
    "time": {"end": 0.12, "output_interval": 0.06},
}  # fmt: skip


def test_a_dry_scene_has_an_interval_of_its_own(tmp_path):
    """A grain at 1 m/s leaves 5 cm below in the interval in which it gets there, with two outputs in the whole run, and
    three come in, due every 10 ms."""
    scene = jaxdem.load_scene(FALLING)
    simulation, parameters = jaxdem.build(scene)
    assert (simulation.interval, simulation.steps.intervals_per_output) == (0.002, 30)
    run = jaxdem.load_run(jaxdem.simulate(scene, tmp_path / "run").path)
    # By 0.06 s it has passed the bottom by 1 cm at most 2 mm below it: removed ones stay where they left.
    first = run.particles(1)
    assert first["active"].tolist() == [0, 1, 1, 1]
    assert -0.002 - 1e-9 <= first["position"][0, 1] <= 0.0
    # Come in at 10, 20 and 30 ms within 0.92 ... 0.98 m, and have fallen since at 1 m/s.
    height = first["position"][1:, 1] + np.array([0.05, 0.04, 0.03])
    assert ((height >= 0.91 - 1e-9) & (height <= 0.99 + 1e-9)).all()
    assert run.scene["coupling"] == {"interval": 0.002}
    assert jaxdem.load_scene(run.scene) == scene
    assert run.summary["inlets"]["delay_mean_s"] == 0.0


@pytest.mark.parametrize(
    ("coupling", "key", "words"),
    [
        ({"interval": 0.0021}, "coupling.interval", "must divide time.output_interval"),
        ({"interval": 0.07}, "coupling.interval", "must not exceed time.output_interval"),
        ({"drag": "koch_hill"}, "coupling.drag", "the only key of"),
        ({"interval": 0.002, "basset": 20}, "coupling.basset", "the only key of"),
    ],
)
def test_what_a_dry_scene_cannot_couple_is_refused(coupling, key, words):
    with pytest.raises(InputError, match=words) as caught:
        jaxdem.build(jaxdem.load_scene(FALLING | {"coupling": coupling}))
    assert caught.value.key == key


def test_the_automatic_interval_of_a_dry_scene_is_written_out():
    scene = jaxdem.load_scene({key: value for key, value in FALLING.items() if key != "coupling"})
    assert jaxdem.build(scene)[0].interval == pytest.approx(0.01)
    assert '[coupling]\ninterval = "auto"' in scene.to_toml()

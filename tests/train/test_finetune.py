"""Training through the solver: observables, loss and gradient, recovery of a known drag, guards, and what is refused.

A training is tried on a toy world, particles that relax to a uniform stream by the closure's drag, which
compiles in a second. That gradients pass through the coupled solver itself is tested in tests/gradients; what training
through it costs and gives is in benchmarks/results/finetune.md.
"""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem import load_run, load_scene, metrics
from jaxdem.closures import DragInputs, InvariantClosure, PaperNetwork, Stokes, SubgridClosure
from jaxdem.errors import InputError, RunError
from jaxdem.failures import Failure
from jaxdem.fluid.boundary import Boundary, Side, Sides
from jaxdem.fluid.fluid_state import FluidProperties, FluidState
from jaxdem.fluid.grid import Grid, cell_average
from jaxdem.fluid.subgrid_stress import subgrid_acceleration, subgrid_flow, subgrid_stress
from jaxdem.io import RunDirectory
from jaxdem.particles.integrate import ParticleState
from jaxdem.particles.neighbors import Room
from jaxdem.run.differentiable import measured_rollout
from jaxdem.state import Diagnostics, Parameters, ParticleDiagnostics, State
from jaxdem.train.closures import Closures, few_parameters
from jaxdem.train.finetune import PATIENCE, FinetuneSettings, Training
from jaxdem.train.fit_settings import FitSettings
from jaxdem.train.observables import Grains, Observables, observe_fluid, observe_particles
from jaxdem.train.reference import CoarseCase, follow
from jaxdem.train.unrolled import ENLARGEMENTS, Unrolled

COUNT, PER_OUTPUT, OUTPUTS, INTERVAL = 12, 3, 6, 0.02
GRAINS = Grains(jnp.asarray(0.01), jnp.asarray(1e-6), jnp.asarray(4e-6), 4.0)


class Listed(NamedTuple):
    """A neighbour list that is nothing but its room."""

    index: jax.Array

    @property
    def room(self):
        return Room(self.index.shape[0], 4, 4)


class ToyWorld:
    """Particles in a stream of (1, 0.3) m/s; a list of fewer slots than `needed` overflows."""

    steps = SimpleNamespace(speed_limit=1e3)

    def __init__(self, needed=2):
        self.needed = needed

    def reversible(self):
        return self

    def step(self, parameters, state, neighbors):
        particles = state.particles
        fluid = jnp.broadcast_to(jnp.asarray([1.0, 0.3]), particles.velocity.shape)
        inputs = DragInputs(
            particles.velocity, fluid, jnp.full(COUNT, 0.2), jnp.ones((COUNT, 2)), jnp.zeros((COUNT, 2)),
            *map(jnp.asarray, (0.02, 0.08, 1000.0, 1e-3)),
        )  # fmt: skip
        share = INTERVAL * parameters.closure(inputs).coefficient[:, None] / GRAINS.mass
        velocity = (particles.velocity + share * fluid) / (1.0 + share)
        drag = GRAINS.mass * (velocity - particles.velocity) / INTERVAL
        moved = particles._replace(position=particles.position + INTERVAL * velocity, velocity=velocity)
        nothing = jnp.zeros(())
        short = jnp.asarray(neighbors.index.shape[0] < self.needed)
        report = ParticleDiagnostics(
            nothing, jnp.zeros((), int), short, jnp.all(jnp.isfinite(velocity)), jnp.zeros((), int), nothing
        )
        return (
            State(moved, None, state.step + 1),
            neighbors,
            Diagnostics(report, None, None, SimpleForces(drag)),
        )


class SimpleForces(NamedTuple):
    drag: jax.Array


def closure_with(bias):
    """One layer on the features: the factor on the drag is exp(G B(bias)) where its kernel is zero."""
    closure = InvariantClosure.initial(Stokes(), hidden=())
    weights = {"Dense_0": {"kernel": np.zeros_like(closure.weights["Dense_0"]["kernel"]), "bias": np.asarray([bias])}}
    return dataclasses.replace(closure, weights=weights)


class ToyCase:
    """A reference made with a drag factor of its own, in the place of a run on disk."""

    per_output, grains = PER_OUTPUT, GRAINS
    observe, observes_fluid, solver = CoarseCase.observe, CoarseCase.observes_fluid, CoarseCase.solver
    run = SimpleNamespace(number_of_frames=OUTPUTS + 1)

    def __init__(self, world, bias):
        generator = np.random.default_rng(0)
        self.simulation = world
        self.parameters = Parameters(jnp.zeros(2), None, None, None, None, closure_with(bias))
        flat = jnp.asarray(generator.uniform(0.2, 0.8, (COUNT, 2)))
        still = jnp.zeros((COUNT, 2))
        particles = ParticleState(flat, None, still, jnp.zeros((COUNT, 1)), (), (), still, still)
        first = State(particles, None, jnp.zeros((), int))

        def measure(state, diagnostics):
            p = state.particles
            return state, observe_particles(GRAINS, p.position, p.velocity, p.angular_velocity, diagnostics.forces.drag)

        @jax.jit
        def run(parameters):
            listed = Listed(jnp.zeros((8, COUNT)))
            result = measured_rollout(world, parameters, first, listed, OUTPUTS * PER_OUTPUT, measure)
            return jax.tree.map(lambda a: a[PER_OUTPUT - 1 :: PER_OUTPUT], result.observations)

        states, seen = jax.tree.map(np.asarray, run(self.parameters))
        self.states = [first, *(jax.tree.map(lambda a, i=i: a[i], states) for i in range(OUTPUTS))]
        self.targets = jax.tree.map(lambda a: np.concatenate([a[:1], a]), seen)

    def start(self, index):
        return self.states[index]

    def with_list(self, state, room=None):
        return state, Listed(jnp.zeros((2 if room is None else room.slots, COUNT)))


TRUE = 0.6


@pytest.fixture(scope="module")
def case():
    return ToyCase(ToyWorld(), TRUE)


@pytest.fixture(scope="module")
def unrolled(case):
    """Compiled runs that the tests share."""
    return Unrolled(case, Closures(closure_with(0.0)), 2)


def weights_with(bias):
    return Closures(closure_with(bias)).weights


def training(unrolled, stages=(2,), **settings):
    made = Training(unrolled.case, unrolled.closures, FinetuneSettings(stages, **settings), stages)
    made.unrolled = unrolled
    return made


def test_the_truth_has_no_loss_and_the_gradient_is_that_of_differences(unrolled):
    assert unrolled.loss(weights_with(TRUE), 1, 2)[0] == pytest.approx(0.0, abs=1e-20)
    weights = weights_with(0.1)
    value, code, slopes = unrolled.slope(weights, 1, 2)
    assert code == 0 and value > 1e-4
    generator = np.random.default_rng(1)
    direction = jax.tree.map(lambda w: 0.1 * generator.normal(size=w.shape), weights)
    step = 1e-5
    ends = [
        unrolled.loss(jax.tree.map(lambda w, d, s=sign: w + s * step * d, weights, direction), 1, 2)[0]
        for sign in (1, -1)
    ]
    along = sum(jax.tree.leaves(jax.tree.map(lambda g, d: float(np.sum(g * d)), slopes, direction)))
    assert along == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-6)


def test_training_recovers_the_drag_that_the_reference_was_made_with(unrolled):
    made = training(unrolled, updates=60, parameters="few", learning_rate=0.1, starts=3)
    assert made.run(None) == ""
    assert float(made.best["drag"]["Dense_0"]["bias"][0]) == pytest.approx(TRUE, abs=0.02)
    assert min(made.validation) < 1e-3 * made.validation[0]


def test_a_search_without_gradients_recovers_it_too(unrolled):
    before = unrolled.forward_runs
    made = training(unrolled, updates=40, method="gradient-free", starts=2)
    seen = []
    assert made.run(lambda *report: seen.append(report)) == ""
    assert float(made.best["drag"]["Dense_0"]["bias"][0]) == pytest.approx(TRUE, abs=0.02)
    assert len(made.losses) <= 40
    assert made.record()["forward_runs"] - before == 4 + 2 * len(made.losses)
    assert seen[-1][:2] == (len(made.losses), 40)


def test_what_is_worse_than_the_start_is_not_kept(unrolled):
    made = training(unrolled, updates=2, learning_rate=50.0)
    made.run(None)
    assert made.validation[-1] > made.validation[0]
    np.testing.assert_array_equal(made.best["drag"]["Dense_0"]["bias"], 0.0)
    assert made.record()["validation_loss"] == made.record()["validation_loss_before"]


def test_updates_that_are_not_finite_are_skipped_and_counted(unrolled, monkeypatch):
    made, slope = training(unrolled, updates=4, parameters="few"), unrolled.slope
    calls = []

    def now_and_then(*arguments):
        value, code, slopes = slope(*arguments)
        calls.append(value)
        return (value, code, jax.tree.map(lambda s: s * jnp.nan, slopes)) if len(calls) == 2 else (value, code, slopes)

    monkeypatch.setattr(unrolled, "slope", now_and_then)
    assert made.run(None) == ""
    assert made.skipped == 1
    assert made.validation[-1] < made.validation[0] and math.isfinite(made.validation[-1])


def test_several_in_a_row_end_the_training_with_a_message(unrolled, monkeypatch):
    made, slope = training(unrolled, updates=20), unrolled.slope
    monkeypatch.setattr(unrolled, "slope", lambda *a: (math.nan, 0, slope(*a)[2]))
    message = made.run(None)
    assert f"{PATIENCE} updates in a row" in message and "not finite" in message and "learning rate" in message
    assert made.skipped == PATIENCE
    np.testing.assert_array_equal(made.best["drag"]["Dense_0"]["bias"], 0.0)


def test_a_closure_that_cannot_be_run_is_said_at_once(unrolled, monkeypatch):
    monkeypatch.setattr(unrolled, "loss", lambda *_: (1.0, 256))
    with pytest.raises(RunError, match="so fast.*closures as given.*contact.speed"):
        training(unrolled).run(None)


def test_a_full_list_gets_more_room_and_the_run_is_repeated(case, monkeypatch):
    """The rooms seen grow until there are five slots; the program is left out."""
    short, rooms = Unrolled(case, Closures(closure_with(0.0)), 2), []

    def program(weights, state, neighbors, targets, outputs):
        rooms.append(neighbors.room.slots)
        return jnp.asarray(0.5), jnp.asarray(int(Failure.OVERFLOW) if rooms[-1] < 5 else 0)

    monkeypatch.setattr(short, "_loss", program)
    assert short.loss(None, 0, 1) == (0.5, 0)
    assert rooms == [2, 4, 6] and short.resizes == 2 and short.forward_runs == 3
    assert short.loss(None, 1, 1) == (0.5, 0) and rooms[-1] == 6


def test_a_run_that_blows_up_does_not_take_all_memory_for_its_list(case, monkeypatch):
    """It is an update that failed, and the next run has the room of before."""
    short, rooms = Unrolled(case, Closures(closure_with(0.0)), 2), []

    def program(weights, state, neighbors, targets, outputs):
        rooms.append(neighbors.room.slots)
        return jnp.asarray(0.5), jnp.asarray(int(Failure.OVERFLOW | Failure.PARTICLE_LOST) if weights else 0)

    monkeypatch.setattr(short, "_loss", program)
    assert short.loss(True, 0, 1) == (0.5, int(Failure.OVERFLOW | Failure.PARTICLE_LOST))
    assert len(rooms) == ENLARGEMENTS + 1 and rooms[-1] > 2
    assert short.loss(False, 0, 1) == (0.5, 0) and rooms[-1] == 2


def test_starts_leave_the_first_and_the_last_frame_to_the_validation(unrolled):
    made = training(unrolled, starts=3)
    assert made.held_out == [0, 4]
    assert made.starts(2) == [1, 2, 3] and made.starts(1) == [1, 3, 5] and made.starts(OUTPUTS) == [0]
    assert not {frame for outputs in (1, 2) for frame in made.starts(outputs)} & set(made.held_out)


def test_few_parameters_are_a_shift_and_a_factor_of_the_last_layer():
    closure = PaperNetwork.initial(2, hidden=(4,))
    start, weights_of = few_parameters(Closures(closure))
    assert start.shape == (3,)
    np.testing.assert_array_equal(weights_of(start)["drag"]["Dense_1"]["kernel"], closure.weights["Dense_1"]["kernel"])
    moved = weights_of(jnp.asarray([1.0, 2.0, math.log(3.0)], start.dtype))["drag"]
    np.testing.assert_allclose(moved["Dense_1"]["bias"], closure.weights["Dense_1"]["bias"] + np.array([1, 2]))
    np.testing.assert_allclose(moved["Dense_1"]["kernel"], 3 * closure.weights["Dense_1"]["kernel"], rtol=1e-6)
    np.testing.assert_array_equal(moved["Dense_0"]["kernel"], closure.weights["Dense_0"]["kernel"])


def test_horizons_and_settings_that_cannot_work_are_refused():
    assert FinetuneSettings().stages(20) == (1, 2, 4, 8) and FinetuneSettings().stages(5) == (1, 2, 4)
    with pytest.raises(InputError, match="--horizons.*6 outputs"):
        FinetuneSettings((1, 9)).stages(6)
    with pytest.raises(InputError, match="--horizons"):
        FinetuneSettings((0, 1))
    with pytest.raises(InputError, match="learning_rate"):
        FinetuneSettings(learning_rate=0.0)
    for settings, name in (
        ({"updates": True}, "updates"), ({"starts": 1.5}, "starts"), ({"seed": -1}, "seed"), ({"seed": True}, "seed"),
        ({"horizons": (True,)}, "--horizons"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=f"^{name} = "):
            FinetuneSettings(**settings)
    for settings, name in (
        ({"epochs": 2.5}, "epochs"), ({"batch": True}, "batch"), ({"hidden": (8, 0)}, "hidden"),
        ({"seed": True}, "seed"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=f"^{name} = .*whole number"):
            FitSettings(**settings)
    assert FitSettings(epochs=np.int64(3), hidden=[8, 4]).epochs == 3


def test_observables_are_those_of_the_metrics():
    generator = np.random.default_rng(2)
    position, velocity, drag = generator.uniform(0, 4, (3, 500, 2))
    spin = generator.normal(size=(500, 1))
    position[:, 0] = 1.0 + 0.5 * position[:, 0]
    seen = jax.jit(lambda *arrays: observe_particles(GRAINS, *arrays))(position, velocity, spin, drag)
    assert seen.drag_force_mean == pytest.approx(metrics.drag_force_mean(drag), rel=1e-12)
    assert seen.particle_velocity_mean == pytest.approx(metrics.particle_velocity_mean(velocity), rel=1e-12)
    energy = metrics.kinetic_energy(velocity, GRAINS.mass, spin, GRAINS.inertia)
    assert seen.kinetic_energy == pytest.approx(energy, rel=1e-12)
    assert seen.runoff == pytest.approx(metrics.runoff(position), rel=1e-12)
    assert seen.height == pytest.approx(metrics.height(position), rel=1e-12)
    # The profiles hold all particles: the kernel's integral is one, and these lie away from the ends.
    width = GRAINS.length / len(seen.solids_profile)
    assert float(seen.solids_profile.sum() * width) == pytest.approx(500 * 4e-6, rel=1e-6)
    moment = 4e-6 * position[:, 1].sum()
    assert float(seen.height_profile.sum() * width) == pytest.approx(moment, rel=1e-6)


GRID = Grid((8, 4), (0.8, 0.4), 1.0, (True, True))
SIDES = Boundary(tuple(Side(axis, upper, "periodic") for axis in (0, 1) for upper in (False, True)))


def test_the_mean_pressure_is_compared_where_it_is_not_zero_by_convention():
    """In a box without an outlet it is rounding, which no weights should be chosen by."""
    seen = Observables(*[jnp.zeros(())] * 5, jnp.zeros(24), jnp.zeros(24))
    flow = FluidState((jnp.ones((9, 4)), jnp.zeros((8, 5))), jnp.full(GRID.cells, 3.0), jnp.ones(GRID.cells))
    grid = dataclasses.replace(GRID, periodic=(False, True))
    sides = tuple(Side(0, upper, "outlet" if upper else "no_slip") for upper in (False, True)) + SIDES.sides[2:]
    assert observe_fluid(seen, GRID, SIDES, flow).fluid_pressure_mean is None
    assert float(observe_fluid(seen, grid, Boundary(sides), flow).fluid_pressure_mean) == 3.0


class StirredWorld(ToyWorld):
    """The toy world beside a fluid that nothing but the subgrid stress moves."""

    fluid = SimpleNamespace(solver=SimpleNamespace(grid=GRID, boundary=SIDES))

    def step(self, parameters, state, neighbors):
        moved, neighbors, report = super().step(parameters, state, neighbors)
        fluid, numbers = state.fluid, parameters.fluid
        still = Sides(SIDES, (jnp.zeros(2),) * 4, jnp.zeros(()))
        flow = subgrid_flow(GRID, still, numbers.subgrid, fluid.face_velocity, numbers.viscosity, None)
        push = subgrid_acceleration(GRID, SIDES, subgrid_stress(GRID, flow))
        faces = tuple(u + INTERVAL * a for u, a in zip(fluid.face_velocity, push, strict=True))
        return moved._replace(fluid=fluid._replace(face_velocity=faces)), neighbors, report


def stress_with(bias):
    closure = SubgridClosure.initial(hidden=())
    kernel = closure.weights["Dense_0"]["kernel"]
    return dataclasses.replace(closure, weights={"Dense_0": {"kernel": kernel, "bias": jnp.asarray(bias)}})


class StirredCase(ToyCase):
    """A reference with a drag and a subgrid stress of its own."""

    def __init__(self, world, bias, stress):
        super().__init__(world.drag_alone, bias)
        self.simulation = world
        sides = (jnp.zeros(2),) * 4
        fluid = FluidProperties(jnp.asarray(1e3), jnp.asarray(1e-6), sides, None, stress_with(stress))
        self.parameters = self.parameters._replace(fluid=fluid)
        x, z = (np.arange(9.0)[:, None] * np.pi / 4, (np.arange(4) + 0.5)[None] * np.pi / 2)
        u = jnp.asarray(2.0 + np.sin(x) * np.cos(z))
        w = jnp.asarray(
            0.5 + np.cos((np.arange(8) + 0.5)[:, None] * np.pi / 4) * np.sin(np.arange(5.0) * np.pi / 2)[None]
        )
        start = FluidState((u, w), jnp.full(GRID.cells, 3.0), jnp.ones(GRID.cells))
        flows = [start]

        listed = Listed(jnp.zeros((8, COUNT)))

        @jax.jit
        def one(state):
            return jax.lax.fori_loop(0, PER_OUTPUT, lambda _, s: world.step(self.parameters, s, listed)[0], state)

        observed = jax.jit(lambda seen, fluid: observe_fluid(seen, GRID, SIDES, fluid))

        for state in self.states[:-1]:
            flows.append(one(state._replace(fluid=flows[-1])).fluid)
        self.states = [s._replace(fluid=f) for s, f in zip(self.states, flows, strict=True)]
        seen = [observed(jax.tree.map(lambda m, n=n: m[n], self.targets), f) for n, f in enumerate(flows)]
        self.targets = jax.tree.map(lambda *values: np.stack(values), *seen)


def test_a_subgrid_stress_is_trained_by_what_the_fluid_shows():
    """With the drag of the truth beside it: no loss with the truth, little after a search."""
    world = StirredWorld()
    world.drag_alone = ToyWorld()
    case = StirredCase(world, TRUE, [0.8, 0.5])
    closures = Closures(closure_with(TRUE), stress_with([0.0, 0.0]), ("subgrid",))
    unrolled = Unrolled(case, closures, 2)
    assert unrolled.loss({"subgrid": stress_with([0.8, 0.5]).weights}, 1, 2)[0] == pytest.approx(0, abs=1e-20)
    # Without gradients, whose program takes long to compile; tests/gradients has them by the stress's weights.
    made = training(unrolled, updates=80, method="gradient-free", starts=2)
    assert made.run(None) == ""
    assert min(made.validation) < 0.02 * made.validation[0]
    np.testing.assert_allclose(made.best["subgrid"]["Dense_0"]["bias"], [0.8, 0.5], atol=0.2)


@pytest.mark.parametrize("trained", [(), ("subgrid",), ("drags",), ("count",)])
def test_closures_to_train_that_there_are_not_are_refused(trained):
    Closures(closure_with(0.1)).check()
    with pytest.raises(InputError, match="^trained = "):
        Closures(closure_with(0.1), trained=trained).check()


def test_both_closures_have_their_own_few_parameters():
    both = Closures(closure_with(0.1), stress_with([0.2, 0.3]), ("drag", "subgrid"))
    start, weights_of = few_parameters(both)
    assert start.shape == (3,), "the kernels are zero: a factor would do nothing"
    moved = both.with_weights(weights_of(jnp.asarray([1.0, 2.0, 3.0])))
    np.testing.assert_allclose(moved.drag.weights["Dense_0"]["bias"], [1.1])
    np.testing.assert_allclose(moved.subgrid.weights["Dense_0"]["bias"], [2.2, 3.3])
    parameters = moved.put_into(Parameters(None, None, None, FluidProperties(*[None] * 3), None, None))
    assert parameters.closure is moved.drag and parameters.fluid.subgrid is moved.subgrid


SCENE = {
    "precision": "float64",
    "domain": {"size": [0.24, 0.16], "depth": 0.04},
    "particles": {"radius": 0.01, "density": 2650.0, "position": [[0.06, 0.09], [0.11, 0.075], [0.16, 0.12]]},
    "contact": {"young_modulus": 1e6},
    "fluid": {"cells": [6, 4], "viscosity": 1e-6, "time_step": 0.005, "velocity": [0.1, 0.0]},
    "time": {"end": 0.04, "output_interval": 0.01},
}


def scene_with(**changes):
    return load_scene(SCENE, {key.replace("__", "."): value for key, value in changes.items()})


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """A run directory of a finer mesh with made-up frames: a linear shear, particles that move evenly."""
    path = tmp_path_factory.mktemp("reference") / "run"
    x = (np.arange(12) + 0.5) * 0.02
    velocity = np.zeros((12, 8, 2))
    velocity[:, :, 1] = x[:, None]
    start = np.asarray(SCENE["particles"]["position"])
    with RunDirectory.create(path, scene_with(fluid__cells=[12, 8]).to_toml()) as directory:
        for index in range(5):
            particles = {
                "position": start + 0.001 * index,
                "velocity": np.full((3, 2), 0.1),
                "angular_velocity": np.full((3, 1), 2.0),
                "drag_force": np.full((3, 2), 0.3 * index),
                "contact_force": np.zeros((3, 2)),
                "radius": np.full(3, 0.01),
            }
            fluid = {
                "velocity": velocity,
                "pressure": np.full((12, 8), 7.0),
                "void_fraction": np.ones((12, 8)),
            }
            row = metrics.history_row(0.01 * index, metrics.Quantities(position=particles["position"]))
            directory.write_frame(index, 0.01 * index, {"particles": particles, "fluid": fluid}, row)
        directory.finish({"valid": True})
    return path


def test_a_case_starts_from_the_frames_of_its_reference(reference):
    case = follow(scene_with(), load_run(reference), Closures(InvariantClosure.initial()))
    assert case.per_output == 2
    np.testing.assert_allclose(case.targets.drag_force_mean, 0.3 * np.sqrt(2.0) * np.arange(5), rtol=1e-6)
    np.testing.assert_allclose(case.targets.runoff, metrics.runoff([[0.16, 0.0]] * 3) + 0.001 * np.arange(5), atol=1e-4)
    state = case.start(3)
    assert int(state.step) == 6
    np.testing.assert_allclose(state.particles.position, np.asarray(SCENE["particles"]["position"]) + 0.003)
    np.testing.assert_allclose(state.particles.angular_velocity, 2.0)
    np.testing.assert_allclose(state.fluid.pressure, 7.0, rtol=1e-6)
    # The flux of the fine run: u g of the coarse run is the shear, of which a coarse cell has the mean.
    upright = np.asarray(state.fluid.face_velocity[1])[:, 2]
    fraction = np.asarray(state.fluid.void_fraction)[:, 1:3].mean(axis=1)
    np.testing.assert_allclose(upright * fraction, (np.arange(6) + 0.5) * 0.04, rtol=1e-6)
    assert np.abs(cell_average(state.fluid.face_velocity)[0]).max() < 1e-12
    # Nothing flows through walls, whatever the cells beside them have: here 0.22 m/s upwards on average.
    for side in (0, -1):
        np.testing.assert_array_equal(state.fluid.face_velocity[1][:, side], 0.0)
    listed, neighbors = case.with_list(state)
    assert listed.particles.contact_spring[0].shape == (neighbors.room.pairs,)


def test_a_case_has_the_sides_of_its_scene(reference):
    """An inlet of 0.3 m/s on the left: its face has that flux, not the mean of it and the first cell, at rest."""
    sides = {
        "boundary": {
            "left": {"kind": "inlet", "velocity": 0.3, "ramp_time": 0.0},
            "right": {"kind": "outlet"},
        }
    }
    case = follow(load_scene(SCENE | sides), load_run(reference), Closures(InvariantClosure.initial()))
    fluid = case.start(3).fluid
    np.testing.assert_allclose(fluid.face_velocity[0][0] * fluid.void_fraction[0], 0.3, rtol=1e-12)
    np.testing.assert_allclose(fluid.face_velocity[0][1:-1], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"domain__size": [0.24, 0.18]}, ("domain.size", "0.16")),
        ({"fluid__cells": [6, 9]}, ("fluid.cells", r"\(12, 8\)", "fewer")),
        ({"particles__position": [[0.06, 0.09]]}, ("particles.count", "reference 3")),
        ({"particles__radius": 0.009}, ("particles.radius",)),
        (
            {"fluid__time_step": 0.004, "time__output_interval": 0.004},
            ("time.output_interval", "0.004", "coupling"),
        ),
        ({"coupling__virtual_mass": 0.5}, ("coupling.virtual_mass", "Set it to 0")),
    ],
)
def test_a_reference_that_does_not_fit_is_refused(reference, changes, words):
    with pytest.raises(InputError, match=".*".join(words)):
        follow(scene_with(**changes), load_run(reference), Closures(InvariantClosure.initial()))


def test_other_runs_and_closures_are_refused(reference, tmp_path):
    with pytest.raises(InputError, match="--closure.*3-D"):
        follow(scene_with(), load_run(reference), Closures(PaperNetwork.initial(3)))
    grains = {key: value for key, value in SCENE.items() if key != "fluid"}
    with pytest.raises(InputError, match="both"):
        follow(load_scene(grains), load_run(reference), Closures(InvariantClosure.initial()))
    stages = [{"name": "one", "time": SCENE["time"]}, {"name": "two", "time": SCENE["time"] | {"end": 9.0}}]
    with pytest.raises(InputError, match="^stages = .*one.*two"):
        follow(load_scene(SCENE | {"stages": stages}), load_run(reference), Closures(InvariantClosure.initial()))
    with RunDirectory.create(tmp_path / "run", scene_with().to_toml()) as directory:
        directory.finish({"valid": False, "reason": "too fast"})
    with pytest.raises(InputError, match="--reference.*frames"):
        follow(scene_with(), load_run(tmp_path / "run"), Closures(InvariantClosure.initial()))


def test_observables_have_a_scale_each(unrolled):
    assert isinstance(unrolled.scales, Observables)
    assert all(float(scale) > 0 and scale.shape == () for scale in jax.tree.leaves(unrolled.scales))

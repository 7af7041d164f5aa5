"""Times that a run reports: what it took with and without compiling, by stage, and the simulated times it writes."""

import time as clock
from fractions import Fraction

import h5py
import jax
import jax.numpy as jnp
import pytest

import jaxdem
from jaxdem.closures import KochHill
from jaxdem.coupling import exchange, further_impulses
from jaxdem.run.compile_time import CompileClock
from jaxdem.run.profile import exchange_pieces
from jaxdem.run.totals import Totals
from jaxdem.setup.time_steps import simulated_time
from jaxdem.step import advance_fluid
from tests.cases.small_scenes import SMALL_INJECTION


def test_nested_spans_count_once():
    """Tracing reports inner functions before the outer one that contains them."""
    watch = CompileClock()
    for begin, end in ((1.0, 2.0), (2.5, 3.0), (0.5, 4.0), (5.0, 6.0), (5.5, 7.0)):
        watch.add(begin, end)
    assert watch.total == pytest.approx(3.5 + 2.0)


def test_what_is_compiled_within_a_stage_is_compile_time():
    """Also a program that an output compiles is not in the run time, nor in the output's."""
    totals = Totals()
    totals.begin()
    with totals.timed("output"):
        jax.block_until_ready(jax.jit(lambda x: jnp.cos(x) @ jnp.sin(x).T + 0.123)(jnp.ones((7, 7))))
        clock.sleep(0.05)
    wall, compiling = totals.elapsed(), totals.compile_seconds()
    assert compiling > 0.002
    assert 0.05 <= totals.stages["output"] <= wall - compiling
    resumed = Totals()
    resumed.load(totals.save())
    resumed.begin()
    assert resumed.compile_seconds() == pytest.approx(compiling, abs=1e-9)
    assert resumed.elapsed() - resumed.compile_seconds() == pytest.approx(wall - compiling, abs=0.02)


SCENE = SMALL_INJECTION | {"time": {"end": 0.35, "output_interval": 0.05}}


def test_simulated_times_are_the_decimals_of_the_scene():
    """Outputs of 0.05 s and their intervals: 0.15 and 0.35, not 0.15000000000000002; thirds are the nearest floats."""
    for output, per_output in (("0.05", 1), ("0.05", 5), ("0.1", 10), ("0.002", 4), ("2e-05", 2), ("0.3", 3)):
        for number in range(1, 400):
            exact = Fraction(output) * Fraction(number, per_output)
            time = simulated_time(float(output), number, per_output)
            assert time == float(exact) and Fraction(repr(time)) == exact
    assert simulated_time(0.1, 7, 3) == float(Fraction(7, 30)) and simulated_time(0.15, 1, 3) == 0.05


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    scene = jaxdem.load_scene(SCENE, {"output.samples": 0.05})
    return jaxdem.simulate(scene, tmp_path_factory.mktemp("times") / "run")


def test_files_have_the_times_of_the_scene(run):
    wanted = ["0.0", "0.05", "0.1", "0.15", "0.2", "0.25", "0.3", "0.35"]
    lines = (run.path / "history.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in lines[1:]] == wanted
    for name in ("particles", "fluid"):
        with h5py.File(run.path / f"{name}.vtkhdf") as file:
            assert [repr(float(time)) for time in file["VTKHDF/Steps/Values"]] == wanted, name
    assert run.summary["time"] == 0.35 and run.summary["time_steps"]["coupling"] == 0.01
    assert [repr(float(time)) for time in run.samples.times] == [
        "0.04",
        "0.09",
        "0.14",
        "0.19",
        "0.24",
        "0.29",
        "0.34",
    ]


def test_run_time_and_compile_time_make_the_wall_time(run):
    summary = run.summary
    assert summary["run_time_s"] == summary["wall_time_s"] - summary["stages_s"]["compile"]
    measured = sum(summary["stages_s"][name] for name in ("step", "output"))
    assert 0.0 < measured <= summary["run_time_s"]


def test_a_profiled_run_measures_fluid_and_particles_and_computes_the_same(run, tmp_path):
    """As two programs in place of one: numbers agree to rounding, which 0.35 s of collisions amplify."""
    scene = jaxdem.load_scene(SCENE, {"time.end": 0.1})
    profiled = jaxdem.simulate(scene, tmp_path / "run", profile=True)
    stages = profiled.summary["stages_s"]
    assert 0.0 < stages["contact"] + stages["fluid"] <= stages["step"]
    for name in ("kinetic_energy", "fluid_velocity_mean", "runoff"):
        assert profiled.history[name] == pytest.approx(run.history[name][:3], rel=1e-4, abs=1e-9), name


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"coupling.drag_inputs_coarsened": 2},
        {"coupling.deconvolution": 0.1},
        {"boundary.right.particles": "remove"},
    ],
    ids=lambda changes: next(iter(changes), "plain"),
)
def test_the_drag_stage_evaluates_the_law_as_often_as_a_step(changes):
    """An instrumented law counts in the shipped fluid part and in what is timed for `stages_s.drag`."""
    counted = []

    class Counting(KochHill):
        def __call__(self, inputs):
            counted.append(inputs)
            return super().__call__(inputs)

    scene = jaxdem.load_scene(SCENE, {"precision": "float64", **changes})
    simulation, parameters = jaxdem.build(scene, closure=Counting())
    state, _ = jaxdem.initial_state(scene, simulation, parameters)
    jax.eval_shape(lambda s: advance_fluid(simulation, parameters, s), state)
    shipped = len(counted)
    pieces = exchange_pieces(simulation, parameters)
    seen = jax.eval_shape(pieces.sample, state)
    counted.clear()
    jax.eval_shape(pieces.drag, state, seen)
    assert len(counted) == shipped == 2


@pytest.mark.parametrize("force", [{}, {"coupling.virtual_mass": 0.5}], ids=["plain", "virtual mass"])
def test_the_coupling_stage_transfers_as_often_as_a_fluid_step(monkeypatch, force):
    """Deposits on faces and reads of them, counted in a fluid step of the exchange and in what is timed for
    `stages_s.coupling`."""
    counted = []
    for module, name in (
        (exchange, "deposit_on_faces"),
        (exchange, "interpolate_faces"),
        (further_impulses, "interpolate"),
    ):
        function = getattr(module, name)
        monkeypatch.setattr(
            module, name, lambda *given, name=name, function=function: counted.append(name) or function(*given)
        )
    scene = jaxdem.load_scene(SCENE, force)
    simulation, parameters = jaxdem.build(scene)
    state, _ = jaxdem.initial_state(scene, simulation, parameters)

    def fluid_step(state):
        begun = simulation.coupling.begin(parameters.mixture, state.fluid, state.particles, jnp.zeros(()))
        counted.clear()
        begun.fluid_step(begun.first(state.fluid), jnp.int32(0), jnp.zeros(()))
        return jnp.zeros(())

    jax.eval_shape(fluid_step, state)
    shipped = sorted(counted)
    pieces = exchange_pieces(simulation, parameters)
    begun, result = jax.eval_shape(pieces.begin, state), jax.eval_shape(pieces.advance, state)
    counted.clear()
    jax.eval_shape(pieces.transfer, state, begun, result)
    assert sorted(counted) == shipped
    assert {"deposit_on_faces", "interpolate_faces"} <= set(shipped)

"""The start of a run: what is loaded and compiled, what other numbers compile anew, what is kept between processes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.check.check import check_scene
from jaxdem.coupling.deposition import Centre, Diffusion, Divided, Kernel
from jaxdem.coupling.void_fraction import solid_fraction
from jaxdem.fluid.grid import Grid
from jaxdem.particles.surfaces import DistanceFunction
from jaxdem.run import chunk, exported, program_cache
from jaxdem.run.fingerprint import UnknownKind, fingerprint
from jaxdem.run.numbers import NO_NUMBERS, loop_numbers, with_numbers
from jaxdem.setup.builder import build_case
from tests.cases.surfaces import grains_scene

ROOT = Path(__file__).parents[1]
SETTLING = ROOT / "scenes" / "settling.toml"

FIRST_RUN = """
import json, sys
import jax
from jaxdem.cli.main import app
names = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, _, **about: (
        names.append(about.get("fun_name")) if event.endswith("backend_compile_duration") else None
    )
)
try: app(["run", sys.argv[1], "--out", sys.argv[2], "--quiet", *sys.argv[3:]])
except SystemExit as end: assert not end.code
print(json.dumps([len(names), sorted({name.split(".")[0] for name in sys.modules})]))
"""

NOT_FOR_A_RUN = {"flax", "optax", "jax_md", "matplotlib", "plotly", "onnx"}
"""Packages that a run of a plain scene has no use for."""

PROGRAMS = 2
"""That a first run compiles: the neighbour list and the chunk of intervals."""


def test_a_run_loads_and_compiles_what_it_needs(tmp_path):
    """Counted in a process of its own: here others may have compiled some of it."""
    few = ["--set", "particles.count=4", "--set", "time.end=0.01", "--set", "time.output_interval=0.005"]
    command = [sys.executable, "-c", FIRST_RUN, str(SETTLING), str(tmp_path / "run"), *few]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "JAXDEM_CACHE": str(tmp_path / "cache")}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0, done.stderr
    programs, modules = json.loads(done.stdout.splitlines()[-1])
    assert NOT_FOR_A_RUN & set(modules) == set()
    assert programs <= PROGRAMS


@pytest.fixture
def compiled_programs():
    """The number of programs that were compiled, or loaded, since the start of the test."""
    found = []

    def hear(event, *_, **__):
        if event.endswith("backend_compile_duration"):
            found.append(event)

    jax.monitoring.register_event_duration_secs_listener(hear)
    yield lambda: len(found)
    jax.monitoring.unregister_event_duration_listener(hear)


def test_a_check_compiles_nothing(compiled_programs):
    with jax.enable_x64(False):
        report = check_scene(jaxdem.load_scene(SETTLING))
    assert compiled_programs() == 0
    assert report.void_fraction[0] < 1.0


def test_walls_that_move_begin_with_few_programs(compiled_programs):
    """Where they lie on each other, where they are, how deep grains are in them, and the neighbour list. Operation by
    operation the places alone are 40."""
    turning = {"kind": "rotation", "axis": [0.0, 1.0, 0.0], "center": [0.5, 0.0, 0.2], "rate": 0.37}
    drawn = {"kind": "table", "displacement": [0.0, 0.1, 0.1], "times": [0.0, 0.3, 1.0], "direction": [0.0, 0.0, 1.0]}
    wall = {"kind": "plane", "point": [0.5, 0.5, 0.21], "normal": [0.0, 0.0, 1.0], "motion": [turning, drawn]}
    scene = jaxdem.load_scene(grains_scene([wall], [[0.3, 0.5, 0.5], [0.7, 0.5, 0.5], [0.7, 0.5, 0.7]]))
    case = build_case(scene)
    case.initial_state()
    assert 0 < compiled_programs() <= 4


@pytest.mark.parametrize(
    "deposition",
    [Kernel((0.3, 0.25)), Centre((0.0, 0.0)), Divided((0.1, 0.1)), Diffusion((0.4, 0.4))],
    ids=lambda deposition: type(deposition).__name__,
)
def test_the_first_void_fraction_is_the_one_of_the_steps(deposition):
    """NumPy on the host and JAX go through the same formulas."""
    grid = Grid((5, 4), (1.0, 1.2), 0.1, (True, False))
    place = np.random.default_rng(0).uniform(0.0, 1.0, (7, 2))
    radius = np.linspace(0.02, 0.1, 7)
    volume = 4.0 / 3.0 * np.pi * radius**3

    def solids(position, radius, volume):
        return solid_fraction(grid, deposition.weights(grid, position, radius), volume)

    host, traced = solids(place, radius, volume), jax.jit(solids)(place, radius, volume)
    assert isinstance(host, np.ndarray)
    np.testing.assert_allclose(host, traced, rtol=1e-12, atol=1e-15)
    assert np.sum(host) * grid.cell_volume == pytest.approx(np.sum(volume), rel=1e-12)


SAME_PROGRAM = {
    "particles.radius": 0.0099,
    "particles.density": 2500.0,
    "contact.young_modulus": 4e6,
    "contact.restitution": 0.6,
    "contact.friction": 0.5,
    "contact.speed": 1.0,
    "fluid.density": 950.0,
    "fluid.viscosity": 2e-6,
    "fluid.time_step": 0.0025,
    "fluid.courant_limit": 0.5,
    "domain.gravity": (0.0, -9.0),
    "time.end": 0.2,
    "time.output_interval": 0.1,
    "seed": 3,
}
"""Keys that settling may have other numbers of without another program."""


def text_of(overrides):
    with jax.enable_x64(False):
        scene = jaxdem.load_scene(SETTLING, overrides)
        simulation, parameters = jaxdem.build(scene)
        state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
        program = jax.jit(partial(chunk.advance, with_numbers(simulation, NO_NUMBERS)))
        numbers = loop_numbers(simulation, parameters.gravity.dtype)
        return program.lower(numbers, parameters, state, neighbors, jnp.int32(1)).as_text()


def test_other_numbers_are_no_other_program():
    """All at once: where this fails, the first line that differs says which number has become a constant."""
    before, after = text_of({}).splitlines(), text_of(SAME_PROGRAM).splitlines()
    differ = [pair for pair in zip(before, after, strict=True) if pair[0] != pair[1]]
    assert not differ, differ[0]


def grown(grid, values):
    TRACED.append(grid)
    return {"grown": values["a"] * grid.depth, "kept": values["b"]}


TRACED = []
VALUES = {"a": np.arange(3.0), "b": np.ones((2, 2), np.float32)}


@pytest.fixture
def kept(tmp_path):
    exported.keep_in(tmp_path / "traced")
    TRACED.clear()
    yield tmp_path / "traced"
    exported.keep_in(None)


def test_a_traced_program_is_taken_from_the_folder(kept):
    grid = Grid((2, 2), (1.0, 1.0), 3.0, (False, False))
    for number in (1, 1):
        result = exported.compiled(grown, grid, VALUES)(VALUES)
        np.testing.assert_array_equal(result["grown"], 3.0 * VALUES["a"])
        np.testing.assert_array_equal(result["kept"], VALUES["b"])
        assert len(TRACED) == number and len(list(kept.iterdir())) == 1
    (file,) = kept.iterdir()
    whole = file.read_bytes()
    for damaged in (whole[:-1], b"", b"dear", bytes(len(whole)), whole[:-1] + bytes([whole[-1] ^ 1])):
        file.write_bytes(damaged)
        TRACED.clear()
        for _ in range(2):
            np.testing.assert_array_equal(exported.compiled(grown, grid, VALUES)(VALUES)["grown"], 3.0 * VALUES["a"])
        assert len(TRACED) == 1, "a file that is not whole is written anew"


def test_a_program_of_this_process_is_not_traced_again():
    """Of equal structures, which scenes with other numbers have, and of arrays of the same shapes."""
    exported.in_memory.cache_clear()
    TRACED.clear()
    wider = VALUES | {"a": np.arange(4.0)}
    for depth, values, number in ((2.0, VALUES, 1), (2.0, VALUES, 1), (4.0, VALUES, 2), (2.0, wider, 3)):
        result = exported.compiled(grown, Grid((2, 2), (1.0, 1.0), depth, (False, False)), values)(values)
        np.testing.assert_array_equal(result["grown"], depth * values["a"])
        assert len(TRACED) == number
    unhashable = exported.compiled(lambda static, values: static[0] * values["a"], [2.0], VALUES)
    np.testing.assert_array_equal(unhashable(VALUES), 2.0 * VALUES["a"])
    with jax.enable_x64(False):
        one, same, other = (
            with_numbers(jaxdem.build(jaxdem.load_scene(SETTLING, changes))[0], NO_NUMBERS)
            for changes in ({}, SAME_PROGRAM, {"coupling.virtual_mass": 0.5})
        )
    assert one == same and hash(one) == hash(same) and one != other


def test_nothing_is_kept_of_what_has_no_fingerprint_and_nowhere_by_default(kept):
    surface = DistanceFunction(lambda x: x[0])
    assert exported.compiled(lambda static, values: values["a"], surface, VALUES)(VALUES).shape == (3,)
    assert not kept.exists()
    exported.keep_in(None)
    exported.compiled(grown, Grid((2, 2), (1.0, 1.0), 3.0, (False, False)), VALUES)
    assert not kept.exists()


def test_a_fingerprint_tells_apart_what_is_traced_otherwise(monkeypatch):
    grid = Grid((2, 2), (1.0, 1.0), 3.0, (False, False))
    others = [
        fingerprint(grid, VALUES),
        fingerprint(Grid((2, 2), (1.0, 1.0), 3.0000001, (False, False)), VALUES),
        fingerprint(Grid((2, 2), (1.0, 1.0), 3.0, (False, True)), VALUES),
        fingerprint((grid, np.arange(3.0)), VALUES),
        fingerprint((grid, np.arange(3.0) + 1e-16 * np.array([1.0, 0.0, 0.0])), VALUES),
        fingerprint((grid, "a"), VALUES),
        fingerprint((grid, ("a",)), VALUES),
        fingerprint(Kernel((1.0,)), VALUES),
        fingerprint(Divided((1.0,)), VALUES),
        fingerprint(grid, VALUES | {"a": np.arange(4.0)}),
        fingerprint(grid, VALUES | {"a": np.arange(3, dtype=np.int32)}),
        fingerprint(grid, {"a": VALUES["a"], "c": VALUES["b"]}),
        fingerprint(grid, VALUES | {"a": None}),
    ]
    assert fingerprint(grid, VALUES | {"a": np.ones(3)}) == others[0], "the content of arguments does not count"
    monkeypatch.setattr("jaxdem.run.fingerprint._source", lambda: "another version")
    others.append(fingerprint(grid, VALUES))
    assert len(set(others)) == len(others)

    class Own(Grid):
        pass

    for unknown in (lambda x: x, np.sin, Own((2, 2), (1.0, 1.0), 3.0, (False, False)), object()):
        with pytest.raises(UnknownKind):
            fingerprint((grid, unknown), VALUES)


def test_where_programs_are_kept(tmp_path, monkeypatch):
    for name in ("JAXDEM_CACHE", "JAX_COMPILATION_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert program_cache.cache_folder() == tmp_path / ".cache" / "jaxdem"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert program_cache.cache_folder() == tmp_path / "xdg" / "jaxdem"
    assert (tmp_path / "xdg" / "jaxdem").stat().st_mode & 0o077 == 0
    monkeypatch.setenv("JAXDEM_CACHE", str(tmp_path / "own"))
    assert program_cache.cache_folder() == tmp_path / "own"
    (tmp_path / "file").write_text("dear")
    for nowhere in ("", str(tmp_path / "file" / "below")):
        monkeypatch.setenv("JAXDEM_CACHE", nowhere)
        assert program_cache.cache_folder() is None


def test_the_oldest_programs_are_deleted_where_there_are_many(tmp_path, monkeypatch):
    monkeypatch.setattr(program_cache, "LARGEST", 100)
    others = tmp_path / "letter.txt"
    others.write_bytes(bytes(1000))
    os.utime(others, (0.0, 0.0))
    for age in range(12):
        path = tmp_path / "traced" / str(age)
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(bytes(10))
        os.utime(path, (1e9 - age, 1e9 - age))
        program_cache._delete_oldest(tmp_path)
    assert sorted(int(path.name) for path in path.parent.iterdir()) == [0, 1, 2, 3, 4, 11]
    assert others.exists(), "what somebody else put there is left alone"

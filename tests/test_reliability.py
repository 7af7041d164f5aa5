"""Bad scenes, damaged files and checkpoints of other runs: a message, in milliseconds; `benchmarks/reliability.py` in small."""

from __future__ import annotations

import ast
import dataclasses
import itertools
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from benchmarks.cases import damage, hostile
from jaxdem import build, load_scene
from jaxdem.bodies import Bodies
from jaxdem.closures import KochHill, load_closure, save_closure
from jaxdem.closures.network import PaperNetwork
from jaxdem.errors import InputError
from jaxdem.io import RunDirectory
from jaxdem.magnitudes import check_magnitudes
from jaxdem.particles.cells import MOST_CELLS, CellGrid
from jaxdem.restart import origin, require_same_origin
from jaxdem.time_steps import time_steps

DOMAIN = "[domain]\nsize = [0.4, 0.3]\n"


def test_every_key_of_a_scene_is_reached_by_bad_values():
    assert not hostile.untouched_keys()


def test_bad_scenes_are_refused_or_sound():
    """Every 97th of them; which ones they are changes with every key that is added."""
    cases = itertools.islice(hostile.bad_scenes(), 0, None, 97)
    found = [hostile.outcome(case.tables) for case in cases]
    assert len(found) > 200
    assert found.count("refused") > 0.8 * len(found)
    assert "accepted" in found


@pytest.mark.parametrize("kind", damage.KINDS)
def test_damaged_files_are_refused(kind):
    found = damage.read_damaged(kind, 8, 0, damage.CHANGES[:4])
    assert found["refused"] >= (3 if kind == "scene.toml" else 4), "a scene that is cut may still be one"


@pytest.mark.parametrize(
    ("tables", "key"),
    [
        (hostile.changed(hostile.STREAM, "fluid.cells", [100_000] * 3), "fluid.cells"),
        (hostile.changed(hostile.COUPLED, "particles.radius", 1e-9), "particles.pack.stop"),
        (hostile.changed(hostile.RANDOM, "particles.pack.stop", [1e19, 1.0]), "particles.pack.stop"),
        (hostile.changed(hostile.ROWS, "contact", {"young_modulus": 1e20}), "contact.time_step"),
        (hostile.changed(hostile.STREAM, "fluid.time_step", 1e-19), "time.end"),
    ],
)
def test_what_the_machine_cannot_hold_is_refused(tables, key):
    with pytest.raises(InputError) as caught:
        scene = load_scene(tables)
        time_steps(scene)
        build(scene)
    assert caught.value.key == key


def test_products_that_the_floats_do_not_hold_are_refused():
    scene = load_scene(hostile.ROWS)
    small = Bodies(np.asarray(1e-9), np.asarray(2650.0), np.asarray(0))
    with pytest.raises(
        InputError, match=r"moment of inertia of 4\.\d+e-42 kg m2, which float32 does not hold"
    ):
        check_magnitudes(scene, small)
    check_magnitudes(load_scene(hostile.changed(hostile.ROWS, "precision", "float64")), small)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"a = " + b"[" * 5000, "nested"),
        (b"seed = " + b"9" * 6000, "digits"),
        (b"seed = 0x" + b"f" * 9000, "seed"),
    ],
)
def test_toml_that_exhausts_the_reader_is_refused(tmp_path, content, words):
    path = tmp_path / "scene.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=words):
        load_scene(path)


def test_a_device_is_no_scene():
    with pytest.raises(InputError, match="device"):
        load_scene("/dev/zero")


def test_a_few_grains_in_a_vast_box_do_not_fill_the_memory_with_cells():
    shape = CellGrid((1e3, 1e3, 1e3), (False,) * 3, 1e-3).shape
    assert np.prod(shape) <= MOST_CELLS
    assert min(shape) > 100
    assert CellGrid((1.0, 1.0), (False, False), 0.1).shape == (10, 10)


def test_a_closure_with_a_weight_that_is_not_a_number_is_refused(tmp_path):
    path, closure = tmp_path / "closure.h5", PaperNetwork.initial(2, KochHill(), (4,), "elu")
    save_closure(path, dataclasses.replace(closure, output_scale=jnp.asarray([1.0, jnp.nan])), {})
    with pytest.raises(InputError, match="output_scale holds values that are not finite"):
        load_closure(path)


def test_a_checkpoint_belongs_to_one_scene_version_and_closure():
    scene = load_scene(hostile.ROWS)
    _, parameters = build(scene)
    here = origin(scene.to_toml(), parameters)
    require_same_origin(here, origin(scene.to_toml(), parameters))
    heavier = parameters._replace(gravity=2.0 * parameters.gravity)
    for other, words in (
        ({}, "written by jaxdem None"),
        (here | {"jaxdem": "0.0.1"}, "0.0.1"),
        (origin(scene.to_toml() + "# more", parameters), "another scene"),
        (origin(scene.to_toml(), heavier), "another closure"),
    ):
        with pytest.raises(InputError, match=words):
            require_same_origin(other, here)


def test_a_run_killed_before_its_first_checkpoint_starts_over(tmp_path):
    path = tmp_path / "run"
    RunDirectory.create(path, DOMAIN).close()
    (path / ".checkpoint.h5.tmp").write_bytes(b"half")
    with pytest.raises(InputError, match="--resume to go on"):
        RunDirectory.create(path, DOMAIN)
    with RunDirectory.resume(path, DOMAIN) as run:
        assert not run.has_checkpoint
        assert run.frames == 0
    (path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"checkpoint\.h5"):
        RunDirectory.resume(path, DOMAIN)


def test_no_file_that_is_data_can_execute_code():
    """Nothing that unpickles, and nothing that evaluates text, in the whole package."""
    for module in Path(jaxdem.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(module.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            roots = {name.split(".")[0] for name in names}
            assert not roots & {"pickle", "marshal", "shelve", "dill", "joblib", "cloudpickle"}, module
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                assert node.func.id not in ("eval", "exec", "compile", "__import__"), module
            if isinstance(node, ast.keyword) and node.arg == "allow_pickle":
                assert isinstance(node.value, ast.Constant) and node.value.value is False, module

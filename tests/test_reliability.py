"""Bad scenes, damaged files and checkpoints of other runs: a message, in milliseconds; `benchmarks/reliability.py` in
small."""

from __future__ import annotations

import ast
import errno
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

import jaxdem
from jaxdem import build, load_scene, study
from jaxdem.closures import KochHill, load_closure, save_closure
from jaxdem.closures.network import PaperNetwork
from jaxdem.errors import InputError
from jaxdem.files import hdf5
from jaxdem.io import RunDirectory
from jaxdem.particles.cells import OWN_COLUMNS, CellGrid
from jaxdem.report import style
from jaxdem.report.comparison import Comparison, row_of_one
from jaxdem.report.table import write_csv
from jaxdem.run.restart import origin, require_same_origin
from jaxdem.setup.bodies import Bodies
from jaxdem.setup.magnitudes import check_magnitudes
from tests.cases import damage, hostile
from tests.cases.steps import time_steps
from tests.cases.tiers import tiered

DOMAIN = "[domain]\nsize = [0.4, 0.3]\n"


def test_every_key_of_a_scene_is_reached_by_bad_values():
    assert not hostile.untouched_keys()


@pytest.mark.parametrize("every", tiered([487, 97], first=[487]))
def test_bad_scenes_are_refused_or_sound(every):
    """One of so many; which ones they are changes with every key that is added."""
    found = [hostile.outcome(case.tables) for case in hostile.bad_scenes(every)]
    assert len(found) > 200
    assert found.count("refused") > 0.8 * len(found)
    assert "accepted" in found


@pytest.mark.parametrize("kind", [kind for kind in damage.KINDS if kind not in damage.BEFORE_110])
def test_damaged_files_are_refused(kind):
    found = damage.read_damaged(kind, 8, 0, damage.CHANGES[:4])
    assert found["refused"] >= (3 if kind == "scene.toml" else 4), "a scene that is cut may still be one"


HDF5_KINDS = ("closure", "dataset", "checkpoint", "particles.vtkhdf", "fluid.vtkhdf", "samples.h5")


@pytest.mark.parametrize("kind", HDF5_KINDS)
def test_one_altered_bit_is_noticed(kind):
    """Anywhere in the file: refused, or in a place that does not matter; never a hang, never other numbers."""
    found = damage.read_damaged(kind, 25, 1, damage.BIT)
    assert found["refused"] > 12
    assert "read as something else" not in found


def test_files_without_checksums_are_read_by_a_process_of_its_own_first(tmp_path, monkeypatch):
    path, read = damage.KINDS["closure of HDF5 before 1.10"](tmp_path)
    assert path.read_bytes()[8] < hdf5.CHECKED
    trials = []
    monkeypatch.setattr(
        hdf5.subprocess, "run", lambda *a, run=hdf5.subprocess.run, **k: trials.append(1) or run(*a, **k)
    )
    assert read()
    read()
    assert len(trials) == 1, "once for the same content"
    endless = (("-c", "while True: pass"), 0.2, "did not come to an end")
    for trial, seconds, words in (endless, (("-c", "import os; os.abort()"), 60.0, "crashes")):
        monkeypatch.setattr(hdf5, "TRIAL", trial)
        monkeypatch.setattr(hdf5, "TRIAL_SECONDS", seconds)
        hdf5._trial.cache_clear()
        with pytest.raises(InputError, match=words):
            read()
    hdf5._trial.cache_clear()


@pytest.fixture
def full_disk(monkeypatch):
    """Every file of more than a few bytes is refused as by a full disk."""

    def refuse(path, content, opened=Path.open):
        with opened(path, "wb") as file:
            file.write(content[:5])
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(Path, "write_bytes", refuse)


@pytest.mark.parametrize("kind", ["closure", "dataset"])
def test_a_full_disk_leaves_the_earlier_file_and_nothing_beside_it(tmp_path, kind, request):
    path, _ = damage.KINDS[kind](tmp_path)
    before = path.read_bytes()
    request.getfixturevalue("full_disk")
    with pytest.raises(OSError, match="No space left"):
        damage.KINDS[kind](tmp_path)
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_pictures_and_tables_are_whole_or_absent(tmp_path, full_disk):
    figure = style.new_figure(1.0, 1.0)
    row = row_of_one(SimpleNamespace(path=tmp_path, summary={}, scene={}, history={}, times=np.empty(0)))
    with pytest.raises(OSError, match="No space left.*picture.png'$"):
        style.save(figure, tmp_path / "picture.png")
    with pytest.raises(OSError, match="No space left"):
        write_csv(Comparison(rows=[row]), tmp_path / "comparison.csv")
    assert not list(tmp_path.iterdir())


def test_a_study_with_a_marker_that_is_none_is_refused(tmp_path):
    (tmp_path / "study.json").write_text("{")
    with pytest.raises(InputError, match="study.json that is not a study"):
        study.claim(tmp_path, {"study": "injection"})


@pytest.mark.parametrize(
    ("tables", "key"),
    [
        (hostile.changed(hostile.STREAM, "fluid.cells", [100_000] * 3), "fluid.cells"),
        (hostile.changed(hostile.COUPLED, "particles.radius", 1e-9), "particles.pack.stop"),
        (hostile.changed(hostile.RANDOM, "particles.pack.stop", [1e19, 1.0]), "particles.pack.stop"),
        (hostile.changed(hostile.RANDOM, "domain.size", [1e19, 0.2]), "domain.size"),
        (hostile.changed(hostile.ROWS, "contact", {"young_modulus": 1e20}), "contact.time_step"),
        (hostile.changed(hostile.STREAM, "fluid.time_step", 1e-19), "time.end"),
        (
            hostile.changed(hostile.COUPLED, "coupling.kernel_width", {"diameters": 1e8}),
            "coupling.kernel_width",
        ),
    ],
)
def test_what_the_machine_cannot_hold_is_refused(tables, key):
    with pytest.raises(InputError) as caught:
        scene = load_scene(tables)
        time_steps(scene)
        build(scene)
    assert caught.value.key == key


@pytest.mark.parametrize("tables", [hostile.STREAM, hostile.SIZES])
def test_a_number_of_many_digits_in_place_of_a_list_is_refused(tables):
    """Python does not write out more than 4,300 digits; the message must not either."""
    key = "boundary.left.times" if tables is hostile.STREAM else "particles.distribution.diameters"
    with pytest.raises(InputError, match="very many digits") as caught:
        load_scene(hostile.changed(tables, key, 16**9000))
    assert caught.value.key == key


def test_products_that_the_floats_do_not_hold_are_refused():
    scene = load_scene(hostile.ROWS)
    small = Bodies(np.asarray(1e-9), np.asarray(2650.0), np.asarray(0))
    with pytest.raises(InputError, match=r"moment of inertia of 4\.\d+e-42 kg m2, which float32 cannot represent"):
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


def test_an_array_file_with_a_header_that_does_not_end_is_refused(tmp_path):
    path, read = damage.KINDS["positions.npy"](tmp_path)
    path.write_bytes(path.read_bytes().replace(b"(20, 2)", b"(20, 2("))
    with pytest.raises(InputError, match="cannot be read as rows of numbers"):
        read()


def test_a_device_is_no_scene():
    with pytest.raises(InputError, match="not a regular file"):
        load_scene("/dev/zero")


def test_a_few_grains_in_a_vast_box_do_not_fill_the_memory_with_cells():
    vast = CellGrid((1e3, 1e3, 1e3), (False,) * 3, 1e-3, 20)
    assert min(vast.shape) > 10_000
    assert vast.columns == OWN_COLUMNS
    plain = CellGrid((1.0, 1.0), (False, False), 0.1, 20)
    assert plain.shape == (10, 10) and plain.columns == 12 * 12


def test_a_closure_with_a_weight_that_is_not_a_number_is_refused(tmp_path):
    path, closure = tmp_path / "closure.h5", PaperNetwork.initial(2, KochHill(), (4,), "elu")
    save_closure(path, closure, {})
    with h5py.File(path, "r+") as file:
        file["arrays"]["output_scale"][-1] = np.nan
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
        (origin(scene.to_toml() + "\nmore = 1\n", parameters), "another scene"),
        (origin(scene.to_toml(), heavier), "another closure"),
    ):
        with pytest.raises(InputError, match=words):
            require_same_origin(other, here)


def test_a_run_killed_before_its_first_checkpoint_starts_over(tmp_path):
    path = tmp_path / "run"
    RunDirectory.create(path, DOMAIN).close()
    (path / ".checkpoint.h5.4711.tmp").write_bytes(b"half")
    with pytest.raises(InputError, match="--resume to continue"):
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

"""Files that anyone may have written: no plain file, one that names others, or one that claims what it has not."""

from __future__ import annotations

import io
import os

import h5py
import numpy as np
import pytest

from jaxdem import load_run, load_scene
from jaxdem.closures import EnsembleClosure, load_closure, save_closure
from jaxdem.closures.export import files_written
from jaxdem.closures.invariant import InvariantClosure
from jaxdem.closures.network import PaperNetwork
from jaxdem.errors import InputError
from jaxdem.files import hdf5
from jaxdem.files.reading import parse_json, parse_toml, read_arrays
from jaxdem.io.outputs import refuse_what_is_read
from jaxdem.scene.rows import rows_of
from jaxdem.train.dataset import make_dataset
from tests.cases import damage

RUN_FILES = ("scene.toml", "summary.json", "history.csv", "particles.vtkhdf", "fluid.vtkhdf", "samples.h5")
HDF5_FILES = ("closure", "dataset", "checkpoint", "particles.vtkhdf", "fluid.vtkhdf", "samples.h5")
NAN = float("nan")


def position(path, content, width=2, key="particles.position"):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return rows_of(key, str(path), width).tolist()


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff0.1,0.2\n0.3,0.4\n",
        "0.1 0.2\r\n\r\n# a comment\r\n0.3\t0.4 # another\r\n",
        "x z\n0.1 0.2\n0.3 0.4\n",
        'z [m],"x (m)"\n0.2,0.1\n0.4,0.3\n',
        "x,y\n0.1,0.2\n0.3,0.4\n",
    ],
)
def test_no_row_is_lost_and_named_columns_are_used(tmp_path, text):
    assert position(tmp_path / "grains.csv", text) == [[0.1, 0.2], [0.3, 0.4]]


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("O.1 0.2\n0.3 0.4", 1, "'O.1' is no number"),
        ("-0.1e 0.2\n0.3 0.4", 1, "'-0.1e' is no number"),
        ("O.1 O.2\n0.3 0.4", 1, "o.1, o.2 is not used"),
        ("1_0 0.2\n", 1, "'1_0' is no number"),
        ("0.1,,0.2\n", 1, "column 2: nothing"),
        ("0,1;0,2\n", 1, "'1;0' is no number"),
        ("0,1 0,1\n", 1, "'1 0' is no number; a row needs 2 numbers"),
        ("0.1 0.2\n\n0.3 0.4 0.5 0.6\n", 3, "has 4 column"),
        ("0.1 0.2 0.3 0.4\n", 1, "has 4 column"),
        ("0.1 0.2\n0.3\n", 2, "has 1 column"),
        ("x,z,radius\n1,2,3\n", 1, "radius is not used"),
        ("x z x\n1 2 3\n", 1, "x, x is not used"),
        ("x [mm],z [mm]\n1,2\n", 1, r"x \[mm\]"),
        ("x\n1\n", 1, "one is missing"),
        ("0.1 0.2\n0.3 nan\n", 2, "must be finite"),
        ("0.1 1e999\n", 1, "must be finite"),
    ],
)
def test_a_wrong_row_is_named_with_file_line_and_what_is_needed(tmp_path, text, line, words):
    with pytest.raises(InputError, match=words) as caught:
        position(tmp_path / "grains.csv", text)
    assert caught.value.value == f"line {line} of {tmp_path / 'grains.csv'}"
    assert "finite" in words or "2 numbers: x, z [m]" in caught.value.limit


def npy(array, **changes):
    file = io.BytesIO()
    np.save(file, array)
    content = file.getvalue()
    for old, new in changes.values():
        assert old in content
        content = content.replace(old, new)
    return content


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (npy(np.zeros((3, 4))), r"shape \(3, 4\), a row needs 2 numbers: x, z \[m\]"),
        (
            npy(np.zeros((3, 2)), claim=(b"(3, 2), ", b"(9999999999999, 2), ")),
            "header claims 159999999999984",
        ),
        (npy(np.zeros((3, 2)))[:-8], "header claims 48 bytes, it has 40"),
        (npy(np.array([[1.0, NAN]])), "must be finite"),
        (npy(np.float64(3.0)), r"shape \(\)"),
        (b"PK\x03\x04\xff", "cannot be read as rows"),
    ],
)
def test_arrays_of_another_shape_than_they_should_or_claim_to_have_are_refused(tmp_path, content, words):
    with pytest.raises(InputError, match=words):
        position(tmp_path / "grains.npy", content)


def test_rows_in_a_scene_name_the_row():
    for rows in ([[0.1, 0.2], [0.3]], [[0.1, 0.2], [0.1, 0.2, 0.3]]):
        with pytest.raises(InputError, match="'row 1': has . number.s., a row needs 2 numbers: x, z"):
            rows_of("particles.position", rows, 2)


def special_places(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    return [
        tmp_path / "pipe",
        "/dev/zero",
        tmp_path,
        *(["/proc/kmsg"] if os.path.exists("/proc/kmsg") else []),
    ]


def test_pipes_devices_and_what_the_system_makes_up_are_no_files(tmp_path):
    for place in special_places(tmp_path):
        for read in (
            load_scene,
            load_closure,
            lambda name: rows_of("particles.position", str(name), 2),
            hdf5.open_for_reading,
        ):
            with pytest.raises((InputError, OSError), match="file"):
                read(place)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A small run of every kind of file."""
    path, _ = damage.KINDS["samples.h5"](tmp_path_factory.mktemp("files"))
    return path.parent


@pytest.fixture
def copied(run, tmp_path):
    for entry in run.iterdir():
        if entry.is_file():
            (tmp_path / entry.name).write_bytes(entry.read_bytes())
    return tmp_path


def read_whole(path):
    run = load_run(path)
    return [(run.particles(i), run.fluid(i), run.samples.frame(i)) for i in range(run.number_of_frames)]


@pytest.mark.parametrize("name", RUN_FILES)
def test_a_run_with_a_pipe_is_refused(copied, name):
    read_whole(copied)
    (copied / name).unlink()
    os.mkfifo(copied / name)
    with pytest.raises(InputError):
        read_whole(copied)


@pytest.mark.parametrize("name", ["scene.toml", "summary.json"])
@pytest.mark.parametrize(
    "value", ["[" * 5000 + "]" * 5000, "[" * 900 + "]" * 900, "9" * 6000], ids=["5000", "900", "digits"]
)
def test_a_run_with_nested_or_endless_values_is_refused(copied, name, value):
    (copied / name).write_text(f"a = {value}" if name == "scene.toml" else f'{{"a": {value}}}')
    with pytest.raises(InputError, match="cannot be read|is not TOML"):
        load_run(copied)


@pytest.mark.parametrize(
    "text", ["domain = 3", "boundary = []", '[domain]\nsize = ["a", 1]', "[fluid]\ncells = [0, 1]"]
)
def test_a_run_whose_scene_has_other_types_is_refused(copied, text):
    (copied / "scene.toml").write_text(text)
    with pytest.raises(InputError, match=r"scene\.toml"):
        load_run(copied)


def test_a_complete_run_with_fewer_lines_than_frames_is_refused(copied):
    history = copied / "history.csv"
    history.write_text(history.read_text()[:-20])
    with pytest.raises(InputError, match=r"(?s)unequal numbers of outputs.*history\.csv"):
        load_run(copied)
    (copied / "summary.json").unlink()  # as of a run that was killed: what both have is read
    run = load_run(copied)
    assert len(run.times) == run.number_of_frames > 0


def test_dotted_keys_are_tables_within_tables():
    with pytest.raises(ValueError, match="nested"):
        parse_toml("a" + ".a" * 2000 + " = 1")
    with pytest.raises(ValueError, match=r"digits \(a\.b\)"):
        parse_toml(f"a.b = 0x{'f' * 17}")
    assert parse_json('{"a": 1180591620717411303424}') == {"a": 2**70}


def change(path, edit):
    with h5py.File(path, "a") as file:
        edit(file)


def first_array(file):
    found = []
    file.visititems(lambda name, item: found.append(name) if isinstance(item, h5py.Dataset) and item.ndim else None)
    return found[0]


def as_link(file):
    name = first_array(file)
    del file[name]
    file[name] = h5py.ExternalLink("/etc/hostname", "/x")


def as_soft_link(file):
    name = first_array(file)
    del file[name]
    file[name] = h5py.SoftLink("/elsewhere")


def as_external_storage(file, where="/dev/zero"):
    name = first_array(file)
    shape, kind = file[name].shape, file[name].dtype
    del file[name]
    file.create_dataset(name, shape, kind, external=[(where, 0, h5py.h5f.UNLIMITED)])


def as_virtual(file):
    name = first_array(file)
    shape, kind = file[name].shape, file[name].dtype
    del file[name]
    layout = h5py.VirtualLayout(shape, kind)
    layout[...] = h5py.VirtualSource("/tmp/another.h5", "x", shape)
    file.create_virtual_dataset(name, layout)


def as_claim(file):
    name = first_array(file)
    kind = file[name].dtype
    del file[name]
    file.create_dataset(name, (10**12,), kind, chunks=(1000,))


def as_compressed(file):
    name = first_array(file)
    data = file[name][()]
    del file[name]
    file.create_dataset(name, data=np.resize(data, (1 << 16, *data.shape[1:])), compression="gzip")


FOREIGN = {
    as_link: "link",
    as_soft_link: "link",
    as_external_storage: "another file",
    as_virtual: "another file",
    as_claim: "claims",
    as_compressed: "is compressed",
}


@pytest.mark.parametrize("kind", HDF5_FILES)
@pytest.mark.parametrize("edit", FOREIGN)
def test_all_that_is_read_lies_in_the_file_itself(tmp_path, kind, edit):
    path, read = damage.KINDS[kind](tmp_path)
    read()
    change(path, edit)
    with pytest.raises(OSError, match=FOREIGN[edit]):
        hdf5.open_for_reading(path)
    with pytest.raises(InputError):
        read()


def test_the_trial_of_files_in_the_older_format_follows_nothing_either(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "pipe")
    path, read = damage.KINDS["closure of HDF5 before 1.10"](tmp_path)
    read()
    change(path, lambda file: as_external_storage(file, str(tmp_path / "pipe")))
    monkeypatch.setattr(hdf5, "TRIAL_SECONDS", 120.0)  # it would hang
    with pytest.raises(InputError, match="lies in another file"):
        read()


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ({"hidden": np.array([12000, 12000])}, "bytes at least; the file has"),
        ({"hidden": np.array([10**9])}, "bytes at least; the file has"),
        ({"hidden": np.array([-5])}, "claims"),
        ({"members": 10**9}, "bytes at least; the file has"),
        ({"members": -1}, "claims"),
        ({"member_kind": "paper", "dimension": 10**12}, "dimensions"),
    ],
)
def test_a_structure_larger_than_its_file_is_refused_before_it_is_made(tmp_path, names, words):
    path = tmp_path / "closure.h5"
    one = InvariantClosure.initial(hidden=(3,))
    save_closure(path, EnsembleClosure.of([one, one]), {})
    assert load_closure(path)[0].count == 2
    change(path, lambda file: [file.attrs.__setitem__(name, value) for name, value in names.items()])
    with pytest.raises(InputError, match=words):
        load_closure(path)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [("weights/Dense_0/kernel", 1e300, "single precision"), ("input_scale", 1e-60, "not positive")],
)
def test_numbers_that_single_precision_does_not_hold_are_refused(tmp_path, name, value, words):
    path = tmp_path / "closure.h5"
    save_closure(path, PaperNetwork.initial(2, hidden=(3,)), {})

    def edit(file):
        shape = file[f"arrays/{name}"].shape
        del file[f"arrays/{name}"]
        file[f"arrays/{name}"] = np.full(shape, value)

    change(path, edit)
    with pytest.raises(InputError, match=words):
        load_closure(path)


def test_a_dataset_of_numbers_that_training_cannot_hold_is_refused(tmp_path):
    path, read = damage.KINDS["dataset"](tmp_path)

    def edit(file):
        group = next(iter(file.values()))
        values = group["target_force"][()].astype(np.float64)
        del group["target_force"]
        group["target_force"] = np.full(values.shape, 1e300)

    change(path, edit)
    with pytest.raises(InputError, match="target_force holds values that are not finite numbers in single"):
        read()


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"noise"])
def test_arrays_of_a_study_that_are_damaged(tmp_path, content):
    np.savez_compressed(tmp_path / "a.npz", x=np.arange(3.0))
    assert read_arrays(tmp_path / "a.npz")["x"].tolist() == [0.0, 1.0, 2.0]
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(ValueError, match=r"\.npz"):
        read_arrays(tmp_path / "a.npz")


def test_an_output_never_replaces_what_is_read(copied, tmp_path_factory):
    other = tmp_path_factory.mktemp("out")
    os.link(copied / "samples.h5", other / "hard.h5")
    (other / "soft.h5").symlink_to(copied / "history.csv")
    (other / "folder").symlink_to(copied)
    places = [copied / name for name in RUN_FILES] + [
        copied / "checkpoint.h5",
        other / "hard.h5",
        other / "soft.h5",
    ]
    for place in [*places, other / "folder" / "samples.h5"]:
        with pytest.raises(InputError, match="would be lost"):
            refuse_what_is_read("--out", place, [copied])
        with pytest.raises(InputError, match="would be lost"):
            make_dataset(copied, place)
    with pytest.raises(InputError, match="would be lost"):
        refuse_what_is_read("--out", copied / "samples.h5", [])  # of a run that is not read
    refuse_what_is_read("--out", copied / "plots.png", [copied])
    refuse_what_is_read("--out", other / "new.h5", [copied, None])
    closure = other / "a.bin"
    closure.write_bytes(b"")
    assert closure in files_written("stablehlo", other / "a.mlir")

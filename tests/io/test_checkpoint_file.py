import h5py
import numpy as np
import pytest

from jaxdem.errors import InputError
from jaxdem.io import read_checkpoint, write_checkpoint

ARRAYS = {
    "position": np.random.default_rng(1).normal(size=(7, 3)).astype(np.float32),
    "state/velocity": np.array([[-0.0, np.nan], [np.inf, 5e-324]]),
    "state/velocity.slots": np.arange(6, dtype=np.int32).reshape(2, 3).T,
    "touching": np.array([[True, False]]),
    "overflow": np.array(False),
    "step": np.array(12345678901, np.int64),
    "key": np.array([1, 2**32 - 1], np.uint32),
    "nothing": np.zeros((0, 3), np.float32),
    "half": np.array([1.5], np.float16),
    ".": np.arange(3, dtype=np.int8),
    "größe 100%": np.array([1 + 2j]),
}
ATTRIBUTES = {
    "frames": 12,
    "samples": 0,
    "time": 0.1 + 0.2,
    "version": "0.1.0",
    "big": 2**70,
    "nan": float("inf"),
}


def test_round_trip_is_exact(tmp_path):
    path = tmp_path / "checkpoint.h5"
    write_checkpoint(path, ARRAYS, ATTRIBUTES)
    arrays, attributes = read_checkpoint(path)
    assert set(arrays) == set(ARRAYS)
    for name, given in ARRAYS.items():
        read = arrays[name]
        assert isinstance(read, np.ndarray)
        assert (read.dtype, read.shape) == (given.dtype, given.shape), name
        assert read.tobytes() == given.tobytes(), name
    assert attributes == ATTRIBUTES
    assert {name: type(value) for name, value in attributes.items()} == {
        name: type(value) for name, value in ATTRIBUTES.items()
    }


def test_the_newest_replaces(tmp_path):
    path = tmp_path / "checkpoint.h5"
    for frames in (1, 2):
        write_checkpoint(path, {"x": np.full(3, frames)}, {"frames": np.int64(frames)})
    arrays, attributes = read_checkpoint(path)
    assert arrays["x"].tolist() == [2, 2, 2] and attributes == {"frames": 2}
    assert [entry.name for entry in tmp_path.iterdir()] == ["checkpoint.h5"]


def _truncate(path):
    path.write_bytes(path.read_bytes()[:-100])


def _empty(path):
    path.write_bytes(b"")


def _text(path):
    path.write_text("not HDF5")


def _alter_array(path):
    with h5py.File(path, "r+") as file:
        file["arrays/position"][3, 1] += 1


def _alter_attributes(path):
    with h5py.File(path, "r+") as file:
        file["attributes"][12] = ord("3")


def _drop_array(path):
    with h5py.File(path, "r+") as file:
        del file["arrays/step"]


def _foreign(path):
    path.unlink()
    with h5py.File(path, "w") as file:
        file["x"] = 1


def _version(path):
    with h5py.File(path, "r+") as file:
        file.attrs["format_version"] = 99


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (_truncate, "cannot be read as HDF5"),
        (_empty, "cannot be read as HDF5"),
        (_text, "cannot be read as HDF5"),
        (_alter_array, "checksum"),
        (_alter_attributes, "checksum"),
        (_drop_array, "checksum"),
        (_foreign, "not a checkpoint of jaxdem"),
        (_version, "format 99"),
        (lambda path: path.unlink(), "no checkpoint"),
    ],
)
def test_damage_is_refused(tmp_path, damage, message):
    path = tmp_path / "checkpoint.h5"
    write_checkpoint(path, ARRAYS, ATTRIBUTES)
    damage(path)
    with pytest.raises(InputError, match=message) as caught:
        read_checkpoint(path)
    assert str(path) in str(caught.value.value) and caught.value.exit_code == 2


@pytest.mark.parametrize("cut", [0.1, 0.3, 0.5, 0.7, 0.9, 0.99])
def test_any_truncation_is_refused(tmp_path, cut):
    path = tmp_path / "checkpoint.h5"
    write_checkpoint(path, ARRAYS, ATTRIBUTES)
    content = path.read_bytes()
    path.write_bytes(content[: int(cut * len(content))])
    with pytest.raises(InputError):
        read_checkpoint(path)


@pytest.mark.parametrize(
    ("arrays", "attributes"),
    [({"x": np.array(["a"])}, {}), ({"x": np.array([object()])}, {}), ({}, {"x": None}), ({}, {"x": [1]})],
)
def test_what_would_not_read_back_is_refused_and_the_old_kept(tmp_path, arrays, attributes):
    path = tmp_path / "checkpoint.h5"
    write_checkpoint(path, ARRAYS, ATTRIBUTES)
    with pytest.raises(TypeError, match="x:"):
        write_checkpoint(path, arrays, attributes)
    assert read_checkpoint(path)[1] == ATTRIBUTES

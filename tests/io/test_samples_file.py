import h5py
import numpy as np
import pytest
from made_frames import SCENE_2D, sample_arrays, time_of

from jaxdem.errors import InputError
from jaxdem.io import RunDirectory, load_run

ATTRIBUTES = {
    "kernel_width": 0.25,
    "drag": "koch_hill",
    "count": 5,
    "spacing": np.array([0.1, 0.2]),
    "names": ["slip_velocity", "reynolds"],
}


def write_run(path, number, joined):
    with RunDirectory.create(path, SCENE_2D, ATTRIBUTES) as run:
        for index in range(number):
            run.write_sample(index, time_of(index), sample_arrays(index))
        if joined:
            run.finish({})


@pytest.mark.parametrize("joined", [True, False])
@pytest.mark.parametrize("number", [1, 3])
def test_round_trip(tmp_path, number, joined):
    write_run(tmp_path / "run", number, joined)
    samples = load_run(tmp_path / "run").samples
    assert len(samples) == number
    assert samples.times.tolist() == [time_of(index) for index in range(number)]
    assert samples.names == tuple(sorted(sample_arrays(0)))
    for index in (*range(number), -1):
        expected = sample_arrays(index % number)
        frame = samples.frame(index)
        assert set(frame) == set(expected)
        for name, given in expected.items():
            assert frame[name].dtype == np.asarray(given).dtype
            np.testing.assert_array_equal(frame[name], given)
    with pytest.raises(IndexError):
        samples.frame(number)
    read = samples.attributes
    assert {**read, "spacing": None} == {**ATTRIBUTES, "spacing": None}
    assert read["spacing"].tolist() == [0.1, 0.2]


def test_layout_of_the_joined_file(tmp_path):
    write_run(tmp_path / "run", 4, joined=True)
    with h5py.File(tmp_path / "run/samples.h5") as file:
        assert file["slip_velocity"].shape == (4, 5, 2) and file["slip_velocity"].chunks == (1, 5, 2)
        assert file["count"][...].tolist() == [0, 1, 2, 3]
        assert file["time"][...].tolist() == [time_of(index) for index in range(4)]
    samples = load_run(tmp_path / "run").samples
    np.testing.assert_array_equal(samples.frame(2)["slip_velocity"], sample_arrays(2)["slip_velocity"])


def test_names_that_are_taken(tmp_path):
    with RunDirectory.create(tmp_path / "run", SCENE_2D) as run:
        for name in ("time", "a/b"):
            with pytest.raises(ValueError, match="cannot be the name"):
                run.write_sample(0, 0.0, {name: np.zeros(2)})
        assert run.samples == 0


def test_a_changed_shape_is_refused(tmp_path):
    with RunDirectory.create(tmp_path / "run", SCENE_2D) as run:
        run.write_sample(0, 0.0, {"x": np.zeros(2)})
        for other in ({"x": np.zeros(3)}, {"x": np.zeros(2), "y": np.zeros(2)}, {"x": np.zeros(2, int)}):
            with pytest.raises(ValueError, match="after frames of"):
                run.write_sample(1, 1.0, other)
        run.finish({})
    assert len(load_run(tmp_path / "run").samples) == 1


@pytest.mark.parametrize("content", [b"text", "foreign"])
def test_foreign_files_are_refused(tmp_path, content):
    write_run(tmp_path / "run", 4, joined=True)
    path = tmp_path / "run/samples.h5"
    path.unlink()
    assert load_run(tmp_path / "run").samples is None
    if content == "foreign":
        with h5py.File(path, "w") as file:
            file["time"] = np.zeros(3)
    else:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"samples\.h5"):
        load_run(tmp_path / "run").samples  # noqa: B018

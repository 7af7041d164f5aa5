import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxdem.errors import InputError
from jaxdem.io import History, read_history
from jaxdem.io.lines import LineFile, read_columns
from jaxdem.metrics import HISTORY_COLUMNS

HEADER = (
    "time,drag_force_mean,particle_velocity_mean,collision_force_mean,kinetic_energy,runoff,height,"
    "fluid_pressure_mean,fluid_velocity_mean,fluid_velocity_median"
)


def test_header_is_the_contract(tmp_path):
    History(tmp_path / "history.csv")
    assert (tmp_path / "history.csv").read_text() == HEADER + "\n"
    assert all(column.shape == (0,) for column in read_history(tmp_path / "history.csv").values())


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(allow_nan=False), min_size=len(HISTORY_COLUMNS), max_size=len(HISTORY_COLUMNS)))
def test_numbers_read_back_exactly(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("h") / "history.csv"
    history = History(path)
    history.append(dict(zip(HISTORY_COLUMNS, values, strict=True)))
    history.append({"time": np.float32(0.1)})
    table = read_history(path)
    for name, value in zip(HISTORY_COLUMNS, values, strict=True):
        assert table[name][0] == value and math.copysign(1, table[name][0]) == math.copysign(1, value)
    assert table["time"][1] == float(np.float32(0.1))


def test_missing_values_are_empty_and_nan(tmp_path):
    path = tmp_path / "history.csv"
    History(path).append({"time": 0.5, "runoff": None, "height": math.nan, "kinetic_energy": 2.0})
    assert path.read_text().splitlines()[1] == "0.5,,,,2.0,,,,,"
    table = read_history(path)
    assert np.isnan(table["runoff"][0]) and np.isnan(table["height"][0]) and table["kinetic_energy"][0] == 2.0


@pytest.mark.parametrize("tail", ["0.3,1.0,2", "0.3,1,1,1,1,1,1,1,1,1", "\0" * 20, "0.3,1.0\n"])
def test_a_partial_last_line_is_dropped(tmp_path, tail):
    path = tmp_path / "history.csv"
    history = History(path)
    history.append({"time": 0.1, "runoff": 1.0})
    history.append({"time": 0.2, "runoff": 2.0})
    whole = path.read_text()
    path.write_text(whole + tail)
    assert read_history(path)["time"].tolist() == [0.1, 0.2]
    resumed = History(path)
    assert resumed.rows == 2 and path.read_text() == whole
    resumed.append({"time": 0.3})
    assert read_history(path)["time"].tolist() == [0.1, 0.2, 0.3]


def test_cut(tmp_path):
    history = History(tmp_path / "history.csv")
    for index in range(5):
        history.append({"time": float(index)})
    history.cut(2)
    history.append({"time": 7.0})
    assert history.rows == 3
    assert read_history(history.path)["time"].tolist() == [0, 1, 7]


@pytest.mark.parametrize("row", [{"time": 1.0, "drag": 2.0}, {"runoff": 1.0}])
def test_rows_with_other_columns_are_refused(tmp_path, row):
    history = History(tmp_path / "history.csv")
    with pytest.raises(ValueError, match="row of the history"):
        history.append(row)
    assert history.rows == 0 and history.path.read_text() == HEADER + "\n"


@pytest.mark.parametrize(
    ("text", "expected"),
    [("a,b\n1,2\n", "header"), ("", "header"), (HEADER + "\nx\n0.1,,,,,,,,,\n", "line 2"), (None, "read")],
)
def test_foreign_files_are_refused(tmp_path, text, expected):
    path = tmp_path / "history.csv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=expected):
        read_history(path)


def test_an_array_is_written_as_its_rows_are(tmp_path):
    """The same text, one way for tables of probes and one for rows with fields that have no value."""
    table = np.array([[0.0, np.nan, -0.0], [0.1, np.inf, 1e-300], [np.float32(0.3), 2.0**60, np.nan]])
    by_array, by_rows = (LineFile(tmp_path / name, ("time", "a", "b")) for name in ("array.csv", "rows.csv"))
    by_array.append_table(table[:, :1], table[:, 1:])
    by_rows.append_rows(table.tolist())
    assert by_array.path.read_bytes() == by_rows.path.read_bytes() and by_array.rows == by_rows.rows == 3


def test_numbers_of_single_precision_read_back_to_the_bit(tmp_path):
    """All exponents, and both neighbours of powers of ten, where a logarithm or rounding may be one digit off."""
    bits = np.random.default_rng(1).integers(0, 0x7F800000, 60_000).astype(np.uint32)  # finite ones
    powers = np.array([float(f"1e{k}") for k in range(-44, 39)], np.float32)
    beside = [np.nextafter(powers, np.float32(end)) for end in (0.0, np.inf)]
    odd = np.array([0.0, 9999, 10_000, 70_012, 99_999_999, 1e8, 0.5, 99999.99, np.nan, np.inf], np.float32)
    numbers = np.concatenate([bits.view(np.float32), powers, *beside, odd])
    numbers = np.concatenate([numbers, -numbers])[: 6 * (2 * len(numbers) // 6)].reshape(-1, 6)
    leading = np.stack([np.repeat(0.1, len(numbers)), np.arange(len(numbers)) % 7 / 3.0], axis=1)
    file = LineFile(tmp_path / "numbers.csv", ("time", "place", *"abcdef"))
    file.append_table(leading, numbers)
    back = np.stack(list(read_columns(file.path, lambda _: True, "").values()), axis=1)
    np.testing.assert_array_equal(back[:, :2], leading)
    np.testing.assert_array_equal(back[:, 2:].astype(np.float32), numbers)


def test_text_of_numbers_of_single_precision(tmp_path):
    file = LineFile(tmp_path / "numbers.csv", ("time", *"abcdefg"))
    file.append_table(np.array([[0.1]]), np.array([[0.1, -2e-5, 12.0, -70_012.0, 0.0, np.nan, 1e10]], np.float32))
    assert file.path.read_text().splitlines()[1] == "0.1,1.00000001e-01,-1.99999995e-05,12,-70012,0,,1.00000000e+10"

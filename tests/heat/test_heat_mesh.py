"""Grains that touch a mesh with a temperature."""

import numpy as np
import pytest

from tests.cases.heat import advanced, chain_tables
from tests.cases.tiers import tiered

INTERVALS = 30


def beside(wall):
    """A sphere that is pressed between the right side of the box and a wall at 2 mm."""
    tables = chain_tables(1, 4e4, 0.01)
    tables["domain"]["size"] = [tables["domain"]["size"][0] + 0.002, 0.02]
    tables["particles"]["position"] = [[0.007, 0.01]]
    tables["contact"] = tables["contact"] | {"speed": 0.05}  # of which the steps of the conduction are chosen
    return tables | {"walls": [wall]}


def warmed(wall):
    """Temperature of the sphere in the end, and the heat that the wall has given."""
    scalars = advanced(beside(wall), INTERVALS)[2].scalars
    return float(scalars.grains[0]), float(scalars.supplied.walls)


PLANE = {"kind": "plane", "point": [0.002, 0.0], "normal": [1.0, 0.0]}
LINE = {"kind": "mesh", "points": [[0.002, -0.01], [0.002, 0.009], [0.002, 0.03]]}


@pytest.fixture(scope="module")
def beside_a_plane():
    return warmed(PLANE | {"temperature": 60.0})


MOVES = [{"kind": "translation", "velocity": [0.0, 0.01]}]


@pytest.mark.parametrize("motion", tiered([None, MOVES], first=[MOVES]))
def test_a_mesh_of_two_lines_warms_a_grain_as_a_plane_does(beside_a_plane, motion):
    line = LINE | {"temperature": 60.0} | ({} if motion is None else {"motion": motion})
    found = warmed(line)
    np.testing.assert_allclose(found, beside_a_plane, rtol=1e-9)
    assert 21.0 < found[0] < 59.0
    heat = 2000.0 * 500.0 * np.pi / 6.0 * 0.01**3 * (found[0] - 20.0)
    assert found[1] == pytest.approx(heat, rel=1e-12)


def test_a_mesh_without_a_temperature_lets_no_heat_pass():
    assert warmed(LINE) == (20.0, 0.0)

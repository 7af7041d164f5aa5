"""Transforms of the pressure solver against the difference operators that they make diagonal."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from jaxdem.fluid import transforms
from jaxdem.fluid.transforms import Row

ENDS = [None, *((lower, upper) for lower in ("no_flux", "zero") for upper in ("no_flux", "zero"))]


def second_differences(row: Row) -> np.ndarray:
    """(N, N) minus the second differences, by what stands beyond the ends."""
    matrix = 2.0 * np.eye(row.cells) - np.eye(row.cells, k=1) - np.eye(row.cells, k=-1)
    for place, beyond in ((0, -1), (-1, 0)):
        if row.ends is None:
            matrix[place, beyond] -= 1.0
        else:
            matrix[place, place] += 1.0 if row.ends[place] == "zero" else -1.0
    return matrix


@pytest.mark.parametrize("count", [1, 2, 3, 8, 9, 50, 51])
@pytest.mark.parametrize("ends", ENDS)
@pytest.mark.parametrize("fast_from", [0, 1000])
def test_modes_are_the_operator_s_eigenvectors(count, ends, fast_from, monkeypatch):
    monkeypatch.setattr(transforms, "FAST_FROM", fast_from)
    row = Row(count, ends)
    cells = np.random.default_rng(count).normal(size=(count, 3))

    @jax.jit
    def transformed(cells, image):
        modes = row.to_modes(cells, 0)
        return modes, row.to_modes(image, 0), row.to_cells(modes, 0), row.to_modes(cells.T, 1)

    modes, applied, back, along_another = map(np.asarray, transformed(cells, second_differences(row) @ cells))
    # Rounding of float64 times the norm of the operator, 4.
    np.testing.assert_allclose(applied, row.eigenvalues[:, None] * modes, atol=1e-13)
    np.testing.assert_allclose(back, cells, atol=1e-13)
    # Another axis, and a length that is kept.
    np.testing.assert_allclose(along_another, modes.T, atol=1e-13)
    np.testing.assert_allclose(np.sum(modes**2), np.sum(cells**2), rtol=1e-13)

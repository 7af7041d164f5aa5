"""Radii and densities as a scene gives them: one number, numbers, or a file of numbers. Host, numpy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jaxdem.errors import InputError
from jaxdem.scene.rows import given_rows


def column(key: str, value: float | Sequence[float] | np.ndarray | str | None, count: int | None = None) -> np.ndarray:
    """() for one number, else one per particle, from a list or a file.

    Args:
        key: scene key, for the messages.
        value: a number, numbers, or the name of a file of positive numbers.
        count: of particles, if known.
    """
    if isinstance(value, str):
        rows = given_rows(key, value, 1)[:, 0]
        if not (rows > 0.0).all():
            row = int(np.argmin(rows > 0.0))
            raise InputError(key, float(rows[row]), f"row {row} of {value} must be positive", "correct the number")
        value = tuple(rows.tolist())
    if count is not None and isinstance(value, tuple | np.ndarray) and len(value) != count:
        raise InputError(key, f"{len(value)} numbers", f"there are {count} particles", f"give one number or {count}")
    return np.asarray(value, float)

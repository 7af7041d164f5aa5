"""Values of a scene as the arrays that are traced."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jax import Array

from jaxdem.numerics.host import on_device

Values = float | str | np.ndarray | Sequence[float | Sequence[float]] | None
"""What a key of a scene may hold."""


class AsArrays:
    """Makes arrays of one type."""

    def __init__(self, dtype: np.dtype[np.floating]) -> None:
        self._dtype = dtype

    def __call__(self, value: Values) -> Array:
        """One value; zero where there is none, for a constant that the scene's law does not use."""
        rigid = isinstance(value, str) and value == "rigid"
        return on_device(math.inf if rigid else (0.0 if value is None else value), self._dtype)

    def optional(self, value: Values) -> Array | None:
        """The same of a constant that follows another one where the scene gives none of its own."""
        return None if value is None else self(value)

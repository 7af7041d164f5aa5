"""Arrays by name: an .npz file, or what another reader has found. Vectors as (N, 2), (N, 3), or one array a column."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from jaxdem.errors import cut
from jaxdem.particle_files.raw import Raw, Values, refusal

COMPONENTS = {2: ("x", "z"), 3: ("x", "y", "z")}
"""Axes of an array of vectors by its number of columns."""

STEMS = {
    "": ("position", "positions", "points", "pos", "coordinates"),
    "v": ("velocity", "velocities", "vel", "v"),
    "w": ("angular_velocity", "angular_velocities", "omega", "w"),
}
"""Names of arrays of vectors, by what is put before the axis in the name of a column."""


def raw_of_arrays(name: str, arrays: Mapping[str, np.ndarray], strict: bool) -> Raw:
    """The columns of arrays with one row for each particle.

    Raises:
        InputError: the arrays have different numbers of rows, or one has a shape that no quantity has.
    """
    names: list[str] = []
    values: list[Values] = []
    dropped: list[str] = []
    for label, array in arrays.items():
        prefix = next((p for p, stems in STEMS.items() if label.strip().lower() in stems), None)
        if array.ndim == 2 and array.shape[1] in COMPONENTS and prefix is not None:
            names += [f"{prefix}{axis}" for axis in COMPONENTS[array.shape[1]]]
            values += list(array.T)
        elif array.ndim == 1 or (array.ndim == 2 and array.shape[1] == 1):
            names.append(label)
            values.append(array.reshape(-1))
        elif strict:
            limit = f"the array {cut(label, 60)!r} has the shape {array.shape}"
            remedy = "give position, velocity and angular_velocity (N, D), all others (N,)"
            raise refusal(name, limit, remedy)
        else:
            dropped.append(label)
    counts = {label: len(column) for label, column in zip(names, values, strict=True)}
    if len(set(counts.values())) > 1 or not all(counts.values()):
        shown = ", ".join(f"{cut(label, 30)} {count}" for label, count in counts.items())
        limit = f"its arrays must have one row for each particle, they have: {cut(shown, 200)}"
        raise refusal(name, limit, "correct the arrays")
    return Raw(names, values, name, lambda row: f"row {row} of {name}", strict, dropped=tuple(dropped))

"""Frames whose values name the particle, cell and time they belong to."""

from __future__ import annotations

import numpy as np

SCENE_2D = """
seed = 1
[domain]
size = [0.4, 0.3]
depth = 0.02
[fluid]
cells = [4, 3]
"""

SCENE_3D = """
seed = 1
[domain]
size = [0.4, 0.3, 0.4]
[fluid]
cells = [4, 3, 2]
"""


def scene_of(dimension: int) -> str:
    return SCENE_2D if dimension == 2 else SCENE_3D


def particle_arrays(index: int, dimension: int, number: int = 5, dtype=np.float32) -> dict[str, np.ndarray]:
    generator = np.random.default_rng(100 * index + dimension)

    def vector():
        return generator.normal(size=(number, dimension)).astype(dtype)

    spin = generator.normal(size=number if dimension == 2 else (number, 3)).astype(dtype)
    return {
        "position": vector(),
        "velocity": vector(),
        "angular_velocity": spin,
        "drag_force": vector(),
        "contact_force": vector(),
        "radius": np.linspace(0.1, 0.2, number).astype(dtype),
        "id": np.arange(number)[::-1] + 10,
    }


def fluid_arrays(index: int, dimension: int, dtype=np.float32) -> dict[str, np.ndarray]:
    """Pressure 100 ix + 10 iy + iz + 1000 frame: a transposed or shifted file cannot agree."""
    cells = (4, 3, 2)[:dimension]
    weights = (100, 10, 1)[:dimension]
    grid = np.meshgrid(*(np.arange(number) for number in cells), indexing="ij")
    code = sum(weight * axis for weight, axis in zip(weights, grid, strict=True)) + 1000 * index
    velocity = np.stack([code + 0.1 * (axis + 1) for axis in range(dimension)], axis=-1)
    void_fraction = 0.4 + 1e-4 * code
    named = {"velocity": velocity, "pressure": code, "void_fraction": void_fraction}
    return {name: array.astype(dtype) for name, array in named.items()}


def sample_arrays(index: int) -> dict[str, np.ndarray]:
    generator = np.random.default_rng(7000 + index)
    return {
        "slip_velocity": generator.normal(size=(5, 2)),
        "solid_fraction": generator.random(5).astype(np.float32),
        "face_velocity_0": generator.normal(size=(5, 3)),
        "count": np.int32(index),
    }


def row(index: int) -> dict[str, float]:
    return {"drag_force_mean": index / 3.0, "kinetic_energy": 1e-300 * (index + 1), "runoff": 0.1 * index}


def time_of(index: int) -> float:
    """Not representable in float32, so that a time stored so would show."""
    return 0.1 * index + 1e-9


def write_frames(run, first: int, last: int, dimension: int = 2, fluid: bool = True) -> None:
    """Write the frames first .. last-1, each with one sample."""
    for index in range(first, last):
        frame = {"particles": particle_arrays(index, dimension)}
        if fluid:
            frame["fluid"] = fluid_arrays(index, dimension)
        run.write_sample(run.samples, time_of(index), sample_arrays(index))
        run.write_frame(index, time_of(index), frame, row(index))

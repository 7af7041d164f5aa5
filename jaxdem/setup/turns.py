"""Turns of many bodies at once: quaternions (w, x, y, z), in 2-D angles [rad]. Host, numpy."""

from __future__ import annotations

import math

import numpy as np


def turned(orientation: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """(N, m, D) vectors of N bodies in the axes of the box, of those in the bodies' own."""
    if vectors.shape[2] == 2:
        cosine, sine = np.cos(orientation), np.sin(orientation)
        x, y = vectors[..., 0], vectors[..., 1]
        return np.stack((cosine * x - sine * y, sine * x + cosine * y), axis=2)
    scalar, axis = orientation[:, None, :1], orientation[:, None, 1:]
    return vectors + 2.0 * np.cross(axis, scalar * vectors + np.cross(axis, vectors))


def turn_of(axes: np.ndarray, dimension: int) -> np.ndarray:
    """The quaternion of a rotation matrix, in 2-D its angle in the plane of the first and the last axis."""
    if dimension == 2:
        return np.asarray([math.atan2(axes[2, 0], axes[0, 0])])
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(axes).as_quat()
    return np.asarray([w, x, y, z])


def products(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Products of rows of quaternions, in 2-D sums of angles."""
    if one.shape[1] == 1:
        return one + other
    a, u, b, v = one[:, :1], one[:, 1:], other[:, :1], other[:, 1:]
    scalar = a * b - np.sum(u * v, axis=1, keepdims=True)
    return np.concatenate((scalar, a * v + b * u + np.cross(u, v)), axis=1)

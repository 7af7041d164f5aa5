"""The limit of `coupling.deconvolution`. Host side, plain numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def deconvolution_limit(half_width: Sequence[float], spacing: Sequence[float]) -> float:
    """Largest a of `coupling.deconvolution` that does not grow in a pack that holds the fluid as fast as can be [-].

    What is given back is of the velocity u at the start of an interval; the rest of the drag is implicit, face by face.
    For a wave k, with B the resistance of the pack over the fluid's inertia, L = sum_k (2 - 2 cos k_k h_k), and T the
    part of the wave that two faces and the kernel let through to a particle (and, of the force, back to the faces),

        u' = u (1 - a B L <T^2>) / (1 + B),   T = cos(k_c h_c / 2) prod_k |sum_j w_j exp(i j k_k h_k)|

    for component c, the mean taken over the places of particles in a cell: no larger than u for every B where
    a L <T^2> <= 1. Taken is half of that, for drag that varies from grain to grain is worse (measured: by a quarter),
    and no more than 1/(L T^2) with all particles in the middle of cells, where a kernel lets most through.

    Args:
        half_width: (D,) of the kernel, 0 for none [m].
        spacing: (D,) [m].
    """
    wave = np.linspace(0.0, np.pi, 25)
    curvature, anywhere, middle = np.zeros(()), np.ones(()), np.ones(())
    faces = []
    for axis, (width, size) in enumerate(zip(half_width, spacing, strict=True)):
        along = [-1 if other == axis else 1 for other in range(len(spacing))]
        passed = _passed_by_triangle(width / size, wave)
        anywhere = anywhere * np.mean(passed, axis=0).reshape(along)
        middle = middle * passed[len(passed) // 2].reshape(along)
        curvature = curvature + (2.0 - 2.0 * np.cos(wave)).reshape(along)
        faces.append(np.cos(0.5 * wave).reshape(along) ** 2)
    return min(
        share / max(float(np.max(curvature * face * part)) for face in faces)
        for share, part in ((0.5, anywhere), (1.0, middle))
    )


def _passed_by_triangle(half_width: float, wave: NDArray[np.floating]) -> NDArray[np.floating]:
    """|sum_j w_j exp(i j k)|^2 of a triangle at places across a cell, (places, waves).

    Args:
        half_width: of the triangle, in cells; 0 for none.
        wave: (waves,) k h.
    """
    if half_width == 0.0:
        return np.ones((1, len(wave)))
    places = (np.arange(41) + 0.5) / 41 - 0.5
    cells = np.arange(-math.ceil(half_width + 1.0), math.ceil(half_width + 1.0) + 1)
    edges = np.append(cells - 0.5, cells[-1] + 0.5)
    x = np.clip((edges[None] - places[:, None]) / half_width, -1.0, 1.0)
    weights = np.diff(0.5 + x - 0.5 * x * np.abs(x), axis=1)
    return np.abs(weights @ np.exp(1j * np.outer(cells, wave))) ** 2

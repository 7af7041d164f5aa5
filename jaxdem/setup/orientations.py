"""How particles of each shape lie at the start. Host, numpy."""

from __future__ import annotations

import math

import numpy as np

from jaxdem.scene import Particles
from jaxdem.scene.rows import given_rows
from jaxdem.setup.shapes import ShapeTable
from jaxdem.setup.turns import products, turn_of


def orientations(table: ShapeTable, particles: Particles, shape: np.ndarray, present: int, seed: int) -> np.ndarray:
    """(N, 4) unit quaternions that turn the principal axes into those of the box, in 2-D (N, 1) angles [rad].

    Random ones are even over all orientations (K. Shoemake, in Graphics Gems III, 1992, 124-132).

    Args:
        table: the shapes.
        particles: table of the scene.
        shape: (N,) of all particles that there ever are.
        present: at the start; those that come in later are turned at random where these are not aligned.
        seed: of the scene.
    """
    count, width = len(shape), 1 if table.dimension == 2 else 4
    generator = np.random.default_rng([seed, 7])
    if table.dimension == 2:
        given = generator.uniform(0.0, 2.0 * math.pi, (count, 1))
        still = np.zeros(1)
    else:
        u, v, w = generator.uniform(size=(3, count))
        inner, outer = np.sqrt(1.0 - u), np.sqrt(u)
        first, second = 2.0 * math.pi * v, 2.0 * math.pi * w
        given = np.stack(
            (outer * np.cos(second), inner * np.sin(first), inner * np.cos(first), outer * np.sin(second)), axis=1
        )
        still = np.asarray([1.0, 0.0, 0.0, 0.0])
    if particles.orientation == "aligned":
        given = np.broadcast_to(still, (count, width))
    elif not isinstance(particles.orientation, str):
        given = given.copy()
        rows = given_rows("particles.orientation", particles.orientation, width, present)
        given[:present] = rows if width == 1 else rows / np.linalg.norm(rows, axis=1, keepdims=True)
    return products(given, np.stack([turn_of(one.axes, table.dimension) for one in table.templates])[shape])


def as_given(table: ShapeTable, shape: np.ndarray, orientation: np.ndarray) -> np.ndarray:
    """Quaternions, in 2-D angles, of the axes in which shapes are given; the inverse of what `orientations` adds."""
    turn = np.stack([turn_of(one.axes, table.dimension) for one in table.templates])[shape]
    back = -turn if table.dimension == 2 else turn * np.asarray([1.0, -1.0, -1.0, -1.0])
    return products(np.asarray(orientation, float), back)

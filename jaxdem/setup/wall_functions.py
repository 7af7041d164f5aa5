"""The user's walls that are signed-distance functions, as the stability limit of the contact step sees them. Host
side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.errors import InputError
from jaxdem.numerics.tables import Window
from jaxdem.particles.wall_times import WallInTime
from jaxdem.scene import Scene

POINTS = 4096
"""Points of the box from which it is gone to the surface, along the slope."""

STEPS = 8
"""Steps of Newton's method from each of them."""

ON_SURFACE = 1e-3
"""Distance over the size of the box, up to which a point is on the surface [-]."""

LARGEST_SLOPE, SMALLEST_SLOPE = 1.05, 0.95
"""Slope of a signed distance at its surface: the one nowhere above the first, nor all below the second [-]."""


class WallFunctions(NamedTuple):
    """Walls of the user beside those of the scene.

    Attributes:
        number: of them; a grain may touch each.
        slope: the largest at a surface to three digits, at least 1: the overlap grows by so much more than a grain
            moves [-].
        distances: points (P, D) [m] -> their distances (P, n) [m] and slopes (P, n, D); None without.
        lasting: of each, whether it is always there.
    """

    number: int = 0
    slope: float = 1.0
    distances: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    lasting: tuple[bool, ...] = ()


NO_FUNCTIONS = WallFunctions()
"""Of a scene without such walls."""


def wall_functions(functions: Sequence[Callable[[Array], Array]], scene: Scene, dtype: np.dtype) -> WallFunctions:
    """The walls of the user, whose slopes are looked at where their surfaces lie in the box.

    A wall whose slope s at its surface is not one touches a grain at 1/s of its radius, and is s times as stiff.

    Args:
        functions: signed distances, see `Extensions`.
        scene: the scene.
        dtype: of the positions.

    Raises:
        InputError: a function gives something else than one number, or NaN, or its slope at the surface is not one.
    """
    steepest = 1.0
    for number, function in enumerate(functions):
        shape = jax.eval_shape(function, jax.ShapeDtypeStruct((scene.dimension,), dtype)).shape
        if shape != ():
            limit = f"a distance is one number for a point ({scene.dimension},), got the shape {shape}"
            raise InputError("walls", function, limit, "return a scalar")
        undefined, slope = _sampled(function, np.asarray(scene.domain.size, dtype))
        if undefined is not None:
            limit = f"function {number} of walls is not a number at {undefined.tolist()} m in the box"
            raise InputError("walls", function, limit, "return a distance everywhere in the box")
        if len(slope) == 0:
            continue
        if slope.max() > LARGEST_SLOPE or slope.max() < SMALLEST_SLOPE:
            limit = (
                f"the slope of function {number} of walls at its surface is up to {slope.max():.3g}, and that of a "
                f"signed distance is 1: a grain would touch it at {1.0 / slope.max():.3g} of its radius"
            )
            raise InputError("walls", function, limit, "divide the function by the length of its gradient")
        steepest = max(steepest, round(float(slope.max()), 3))
    if not functions:
        return NO_FUNCTIONS
    lasting = tuple(not isinstance(one, WallInTime) or Window(one.begin, one.end).is_always for one in functions)
    return WallFunctions(len(functions), steepest, _distances(functions, dtype), lasting)


def _distances(
    functions: Sequence[Callable[[Array], Array]], dtype: np.dtype
) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """All functions at points, as one program; what is not a number has no slope and is far away."""
    each = [jax.vmap(jax.value_and_grad(function)) for function in functions]

    @jax.jit
    def compiled(x: Array) -> tuple[Array, Array]:
        values, slopes = zip(*(one(x) for one in each), strict=True)
        value, slope = jnp.stack(values, axis=1), jnp.stack(slopes, axis=1)
        known = jnp.isfinite(value) & jnp.isfinite(slope).all(axis=2)
        return jnp.where(known, value, jnp.inf), jnp.where(known[..., None], slope, 0.0)

    def distances(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, slope = compiled(jnp.asarray(x.astype(dtype)))
        return np.asarray(value, float), np.asarray(slope, float)

    return distances


def _sampled(function: Callable[[Array], Array], size: np.ndarray) -> tuple[np.ndarray | None, np.ndarray]:
    """(D,) a point of the box at which the distance is not a number, None where it is one at all [m]; and lengths of
    the gradient at points of the surface in the box, none where it is not met there."""
    start = (np.random.default_rng(0).random((POINTS, len(size))) * size).astype(size.dtype)
    value = jax.vmap(jax.value_and_grad(function))

    @jax.jit
    def approached(x: Array) -> tuple[Array, Array, Array, Array]:
        def step(_: int, x: Array) -> Array:
            distance, slope = value(x)
            squared = jnp.sum(slope**2, axis=1)
            steep = squared > 0.0
            way = jnp.where(steep, distance / jnp.where(steep, squared, 1.0), 0.0)
            return x - way[:, None] * slope

        first = value(x)[0]
        x = jax.lax.fori_loop(0, STEPS, step, x)
        distance, slope = value(x)
        return first, x, distance, jnp.linalg.norm(slope, axis=1)

    first, x, distance, slope = map(np.asarray, approached(jnp.asarray(start)))
    undefined = np.flatnonzero(np.isnan(first))
    there = (np.abs(distance) <= ON_SURFACE * size.max()) & (x >= 0.0).all(axis=1) & (x <= size).all(axis=1)
    return start[undefined[0]] if len(undefined) else None, slope[there & np.isfinite(slope)]

"""How well two kinds of particles are mixed: the index of Lacey. Host side and numpy only, as `jaxdem.metrics`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from jaxdem.errors import InputError

MOST_CELLS = 2.0**53
"""Along an axis from the origin: beyond, a float no longer tells neighbouring whole numbers apart."""


def mixing_index(
    position: ArrayLike,
    kind: ArrayLike,
    cell: float | Sequence[float],
    volume: ArrayLike | None = None,
    origin: ArrayLike | None = None,
) -> float:
    """Lacey's mixing index of two kinds of particles: 0 where they are apart, about 1 where they are mixed at random.

    The particles are counted in cells of one size. With w_i the volume of particle i and b_i = 1 for the first kind and
    0 for the other, W_k = sum w_i and f_k = sum w_i b_i / W_k over the particles whose centre is in cell k, W and
    p = sum w_i b_i / W over all of them,

        M = (s0^2 - s^2) / (s0^2 - sr^2),   s^2 = sum_k W_k (f_k - p)^2 / W,   s0^2 = p (1 - p),
        sr^2 = K sum_i w_i^2 (b_i - p)^2 / W^2,

    with K the number of cells that hold a particle. s0^2 is the variance of what is apart, and sr^2 that which
    particles have that are thrown into the cells at random. For equal ones it is p (1 - p) / n with n = N / K in a
    cell, as in Lacey's paper; for two sizes that of Stange and of Poole, Taylor & Wall, p q (q w_1 + p w_2) / (W / K)
    with q = 1 - p. A pattern that is more even than chance, as a chequerboard, has more than 1; apart is exactly 0 only
    where no cell holds both kinds.

    The index depends on the size of the cells: compare those of the same cells. Take some ten particles in a cell or
    more, and cells smaller than what is to be seen.

    Args:
        position: (N, C) centres; give the columns along which cells are cut, as x and z of a drum [m].
        kind: (N,) bool, whether a particle is of the first kind.
        cell: edge of a cell, or one along each of the C axes [m].
        volume: (N,) of the particles, in any unit; None counts particles.
        origin: (C,) a corner of a cell [m]; the origin of the box if None.

    Raises:
        InputError: shapes do not fit, a number is not finite, a kind is missing, the cells are not positive, or so
            small that chance alone parts the kinds (sr^2 >= s0^2).

    Source: P. M. C. Lacey, J. Appl. Chem. 4 (1954) 257-268. Sizes: K. Stange, Chem. Ing. Tech. 26 (1954) 331-337; K. R.
    Poole, R. F. Taylor, G. P. Wall, Trans. Inst. Chem. Eng. 42 (1964) T305-T315. sr^2 for any sizes is derived here.
    """
    x, first = np.asarray(position, np.float64), np.asarray(kind)
    size = np.ones(first.shape) if volume is None else np.asarray(volume, np.float64)
    _require(x, first, size, cell)
    corner = np.zeros(x.shape[1]) if origin is None else np.asarray(origin, np.float64)
    if corner.shape != x.shape[1:] or not np.isfinite(corner).all():
        limit = f"must be {x.shape[1]} finite numbers"
        raise InputError("origin", origin, limit, "give one for each axis along which cells are cut [m]")
    number = _cell_numbers(x - corner, cell)
    held, of_first = np.bincount(number, size), np.bincount(number, size * first)
    whole = float(held.sum())
    share = float(of_first.sum()) / whole
    apart = share * (1.0 - share)
    found = float(np.sum((of_first - share * held) ** 2 / held)) / whole
    random = len(held) * float(np.sum((size * (first - share)) ** 2)) / whole**2
    if random >= apart:
        limit = f"{len(first)} particles in {len(held)} cells: chance alone parts the kinds as far as they can be"
        raise InputError("cell", cell, limit, "take larger cells")
    return (apart - found) / (apart - random)


def _cell_numbers(x: np.ndarray, cell: float | Sequence[float]) -> np.ndarray:
    """(N,) numbers, from 0, of the cells that hold positions (N, C) from the origin [m], of those that hold any."""
    with np.errstate(over="ignore"):
        places = np.floor(x / np.asarray(cell, np.float64))
    if not (np.abs(places) < MOST_CELLS).all():
        limit = "is too small to number the cells between the origin and the particles"
        raise InputError("cell", cell, limit, "take larger cells, or an origin near the particles")
    number: np.ndarray = np.unique(places.astype(np.int64), axis=0, return_inverse=True)[1].reshape(-1)
    return number


def _require(x: np.ndarray, first: np.ndarray, size: np.ndarray, cell: float | Sequence[float]) -> None:
    """Refuses arguments of `mixing_index` that do not fit."""
    if x.ndim != 2 or first.shape != x.shape[:1] or size.shape != first.shape or first.dtype != bool:
        limit = f"positions {x.shape}, kinds {first.shape} of {first.dtype} and volumes {size.shape} do not fit"
        raise InputError("position", x.shape, limit, "give (N, C), (N,) of bool and (N,)")
    if not (np.isfinite(x).all() and np.isfinite(size).all() and (size > 0.0).all()):
        limit = "must be finite, and volumes positive"
        raise InputError("position", "...", limit, "leave out particles that are not present")
    if not (first.any() and not first.all()):
        limit = "needs particles of both kinds"
        raise InputError("kind", f"{int(first.sum())} of {len(first)}", limit, "give True for one kind and False else")
    lengths = np.asarray(cell, np.float64)
    if lengths.shape not in ((), x.shape[1:]) or not (np.isfinite(lengths).all() and (lengths > 0.0).all()):
        limit = f"must be a positive length, or one for each of the {x.shape[1]} axes"
        raise InputError("cell", cell, limit, "give the edge of a cell [m]")

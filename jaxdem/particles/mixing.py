"""Which given numbers the constants of materials and of their pairs are made of. No JAX, for the host uses it too."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np


@dataclasses.dataclass(frozen=True)
class Mixing:
    """How G numbers that a scene gives make one constant of M materials and of their P = M (M + 1) / 2 pairs; static.

    A material or pair for which none is given follows others, so that every number that is given stands once.

    Attributes:
        keys: of the scene, for each of the G numbers.
        own: the number of each material.
        pair: the number of each pair, -1 where it is mixed from the two; empty for a constant that has no pairs.
    """

    keys: tuple[str, ...]
    own: tuple[int, ...]
    pair: tuple[int, ...] = ()


def of_materials(numbers: Any, mixing: Mixing) -> Any:
    """(M,) constant of each material from the (G,) numbers, a NumPy or JAX array."""
    return numbers[np.asarray(mixing.own)]


def of_pairs(numbers: Any, mixing: Mixing, array: Any) -> Any:
    """(P,) constant of each pair from the (G,) numbers: the one given, else the geometric mean of the two materials'.

    The mean is between the two, and zero if one of them is; there its derivative, which is infinite, is taken as zero.

    Args:
        numbers: (G,) given.
        mixing: which is whose.
        array: the module of the array, `numpy` or `jax.numpy`.
    """
    first, second = (np.asarray(mixing.own)[k] for k in np.triu_indices(len(mixing.own)))
    given = np.asarray(mixing.pair)
    single = np.where(given >= 0, given, np.where(first == second, first, -1))
    positive = numbers > 0.0
    root = array.where(positive, array.sqrt(array.where(positive, numbers, 1.0)), 0.0)
    return array.where(single >= 0, numbers[np.maximum(single, 0)], root[first] * root[second])

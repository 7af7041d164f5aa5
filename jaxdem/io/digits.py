"""Many numbers of single precision as text at once; one by one, in full precision, they would take ten times the time.

Whole numbers below 1e8 are written as such, others with nine digits as 1.23456789e-05: as many as give the same number
back in single precision. NaN is an empty field.
"""

from __future__ import annotations

import functools
import math

import numpy as np

_FIELD = np.dtype(
    [
        ("sign", "u1"), ("lead", "u1"), ("point", "u1"), ("high", "u4"), ("low", "u4"),
        ("e", "u1"), ("exponent_sign", "u1"), ("exponent", "u2"), ("end", "u1"),
    ]
)  # fmt: skip
"""Characters of a number and the separator after it; those that it does not need are 0 and are left out."""

_WHOLE = 1e8
"""Whole numbers below it are written without an exponent."""

_AT_ONCE = 1 << 15
"""Numbers that are treated at once, so that they stay in the cache."""

_GROUP = 10_000
"""Digits are looked up by four."""

_FOUR, _UP_TO_FOUR = (
    np.frombuffer("".join(f"{k}".rjust(4, fill) for k in range(_GROUP)).encode(), "u4") for fill in "0\0"
)
_TWO = np.frombuffer("".join(f"{k:02d}" for k in range(100)).encode(), "u2")

_FIRST = -40
_POWERS = np.array([float(f"1e{k}") for k in range(_FIRST, 60)])
"""Powers of ten from 10^_FIRST on: a number of single precision times one of them has nine digits before the point."""


def text_of(leading: np.ndarray, table: np.ndarray) -> bytes:
    """Lines of a table.

    Args:
        leading: (L, P) float64, numbers in front, written in full precision; few of them differ.
        table: (L, C) float32, C > 0.
    """
    blocks = range(0, len(table), max(_AT_ONCE // table.shape[1], 1))
    return b"".join(_block(leading[at : at + blocks.step], table[at : at + blocks.step]) for at in blocks)


def _block(leading: np.ndarray, table: np.ndarray) -> bytes:
    columns = [_in_full(column.tobytes()) for column in leading.T]
    width = sum(column.shape[1] for column in columns)
    text = np.empty((len(table), width + table.shape[1] * _FIELD.itemsize), np.uint8)
    at = 0
    for column in columns:
        text[:, at : at + column.shape[1]] = column
        at += column.shape[1]
    text[:, width:] = _fields(table).view(np.uint8)
    return text.tobytes().translate(None, b"\0")


@functools.lru_cache(maxsize=32)
def _in_full(column: bytes) -> np.ndarray:
    """(L, width) bytes of numbers of float64 in full precision, each with a comma; those of places come again."""
    values, place = np.unique(np.frombuffer(column), return_inverse=True)
    texts = np.array([("" if math.isnan(x) else repr(x)).encode() + b"," for x in values.tolist()])
    return texts[place].view(np.uint8).reshape(len(place), texts.itemsize)


def _fields(table: np.ndarray) -> np.ndarray:
    """(L, C) of `_FIELD`; a comma after each number, and a new line after the last of a line."""
    numbers = table.astype(np.float64)
    size, text = np.abs(numbers), np.zeros(table.shape, _FIELD)
    finite = np.isfinite(size)
    whole = (size < _WHOLE) & (size == np.floor(size))
    text["sign"][numbers < 0.0] = ord("-")
    text["end"] = ord(",")
    text["end"][:, -1] = ord("\n")
    _put_scientific(text, np.where(finite & ~whole, size, 1.5))
    if whole.any():
        _put_whole(text, whole, size[whole].astype(np.int32))
    if not finite.all():
        for name in ("lead", "point", "high", "low", "e", "exponent_sign", "exponent"):
            text[name][~finite] = 0
        text["high"][np.isinf(size)] = np.frombuffer(b"inf\0", "u4")
    return text


def _put_scientific(text: np.ndarray, size: np.ndarray) -> None:
    """All as d.dddddddde+dd; of positive numbers."""
    power = np.floor(np.log10(size)).astype(np.int32)
    digits = _nine_digits(size, power)
    # The logarithm may be one off at a power of ten, and 9.999999999 is rounded to 10.
    low, high = digits < 100_000_000, digits >= 1_000_000_000
    if low.any() or high.any():
        power = power + high - low
        digits = _nine_digits(size, power)
    upper = digits // _GROUP
    lead = upper // _GROUP
    text["lead"] = lead + ord("0")
    text["point"] = ord(".")
    text["high"] = _FOUR[upper - _GROUP * lead]
    text["low"] = _FOUR[digits - _GROUP * upper]
    text["e"] = ord("e")
    text["exponent_sign"] = np.where(power < 0, ord("-"), ord("+"))
    text["exponent"] = _TWO[np.abs(power)]


def _nine_digits(size: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Digits of numbers of 10^power."""
    return np.rint(size * _POWERS[8 - power - _FIRST]).astype(np.int32)


def _put_whole(text: np.ndarray, whole: np.ndarray, digits: np.ndarray) -> None:
    """Those that are whole, as digits alone."""
    for name in ("lead", "point", "e", "exponent_sign", "exponent"):
        text[name][whole] = 0
    upper = digits // _GROUP
    lower = digits - _GROUP * upper
    text["high"][whole] = np.where(upper > 0, _UP_TO_FOUR[upper], 0)
    text["low"][whole] = np.where(upper > 0, _FOUR[lower], _UP_TO_FOUR[lower])

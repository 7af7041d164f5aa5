"""Numbers among the words of a command."""

from __future__ import annotations

import math

from jaxdem.foreign.notes import Unknown


def numbers(words: list[str], count: int) -> list[float]:
    """The first `count` words as finite numbers.

    Raises:
        Unknown: they are not.
    """
    try:
        found = [float(word) for word in words[:count]]
    except ValueError:
        found = []
    if len(found) < count or not all(math.isfinite(value) for value in found):
        raise Unknown(f"needs {count} number(s), got {' '.join(words[:count]) or 'nothing'}")
    return found


def positive(words: list[str], count: int) -> list[float]:
    """The first `count` words as numbers above 0.

    Raises:
        Unknown: they are not.
    """
    found = numbers(words, count)
    if min(found) <= 0.0:
        raise Unknown(f"needs {count} number(s) above 0, got {' '.join(words[:count])}")
    return found


def integer(word: str) -> int:
    """A word as a whole number.

    Raises:
        Unknown: it is not.
    """
    value = numbers([word], 1)[0]
    if value != round(value):
        raise Unknown(f"needs a whole number, got {word}")
    return int(value)


def option(words: list[str], key: str, unit: float = 1.0) -> float | None:
    """The number after a key, times `unit`; None without the key.

    Raises:
        Unknown: no number stands there.
    """
    return numbers(words[words.index(key) + 1 :], 1)[0] * unit if key in words else None

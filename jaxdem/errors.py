"""Errors a user can act on. Each names the key or place, the value, the limit and the remedy."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Sized
from numbers import Integral
from typing import TypeVar

Part = TypeVar("Part")


class JaxdemError(Exception):
    """Base of all errors that jaxdem raises on purpose; `exit_code` is what the command line returns."""

    exit_code = 1


class InputError(JaxdemError):
    """The input is wrong and no work has started (exit code 2).

    Args:
        key: dotted key of the scene file, or the name of the option, file or argument at fault.
        value: what was given; None for nothing, which is then not shown.
        limit: what is allowed.
        remedy: what to do about it.
    """

    exit_code = 2

    def __init__(self, key: str, value: object, limit: str, remedy: str):
        self.key, self.value, self.limit, self.remedy = key, value, limit, remedy
        named = visible(key).replace("\n", "\\n")
        given = "" if value is None else f" = {cut(_repr(value))}"
        text = f"{cut(named)}{given}: {cut(limit, 600)}. {sentence(cut(remedy, 600))}"
        super().__init__(visible(text))


def number_of_tables(given: Sized) -> str:
    """What a message says was given of an array of tables: how many."""
    return "1 table" if len(given) == 1 else f"{len(given)} tables"


def is_whole(value: object) -> bool:
    """Whether a value is a whole number, of Python or NumPy; True and False are none."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def require_whole(of: object, names: Iterable[str], least: int) -> None:
    """Refuses attributes that are no whole numbers from `least` up, such as 1.5 epochs or a seed of True.

    Raises:
        InputError: naming the first of them; None is a value that is not given.
    """
    for name in names:
        value = getattr(of, name)
        for one in value if isinstance(value, (tuple, list)) else (value,):
            if value is not None and not (is_whole(one) and one >= least):
                raise InputError(name, value, f"must be a whole number from {least} up", "Give one.")


def require_kinds(remedy: str, **given: tuple[object, type]) -> None:
    """Refuses arguments of another kind, such as two in the wrong order.

    Args:
        remedy: what to give.
        given: by the name of each argument its value and the class that it must be of.

    Raises:
        InputError: naming the first of them.
    """
    for name, (value, kind) in given.items():
        if not isinstance(value, kind):
            raise InputError(name, type(value).__name__, f"is no {kind.__name__}", remedy)


def required(part: Part | None, name: str) -> Part:
    """A part that not every scene has, where it is needed.

    Raises:
        InputError: it is None.
    """
    if part is None:
        raise InputError(name, part, "the scene has no such part, and it is needed here", "add the part to the scene")
    return part


class RunError(JaxdemError):
    """A run started and could not go on (exit code 1); what was done until then is kept.

    Args:
        reason: what went wrong.
        where: particle, cell or boundary, with its position.
        time: simulated time [s].
        remedy: what to do about it.
    """

    def __init__(self, reason: str, where: str, time: float, remedy: str):
        self.reason, self.where, self.time, self.remedy = reason, where, time, remedy
        super().__init__(visible(f"{reason} ({where}) at t = {time:.6g} s. {sentence(remedy)}"))


def sentence(text: str) -> str:
    """The text with a capital letter and a full stop, where it starts and ends with a plain word."""
    if re.match(r"(?!jaxdem)[a-z]+[ ,:]", text):
        text = text[0].upper() + text[1:]
    return text + "." if re.search(r"[a-z]\)?$", text) else text


def cut(text: str, length: int = 300) -> str:
    """The text, its end replaced by dots where it is longer than `length`."""
    return text if len(text) <= length else text[: length - 3] + "..."


def visible(text: str) -> str:
    """The text with what does not print, such as the control sequences of a terminal, as escapes; lines stay lines."""
    return "".join(c if c.isprintable() or c == "\n" or unicodedata.category(c) == "Zs" else _escape(c) for c in text)


def _escape(character: str) -> str:
    return character.encode("unicode_escape").decode()


def _repr(value: object) -> str:
    try:
        return repr(value)
    except ValueError:  # Python refuses to write out thousands of digits
        return f"a {type(value).__name__} of very many digits"

"""Rows of text: lines that hold something, their fields, and the numbers that these are."""

from __future__ import annotations

from typing import NamedTuple


class Line(NamedTuple):
    """A line of a text file that holds something: its number, from 1, and what it holds."""

    number: int
    text: str


def lines_of(text: str, comment: str = "") -> list[Line]:
    """The lines that hold something, without blanks at their ends; a `comment` mark ends a line, if there is one."""
    whole = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    kept = (line.partition(comment)[0] if comment else line for line in whole)
    return [Line(number, line) for number, line in enumerate((line.strip() for line in kept), start=1) if line]


def fields_of(line: str) -> list[str]:
    """The fields of a row, separated by commas or blanks."""
    return [field.strip() for field in line.split(",")] if "," in line else line.split()


def number_of(text: str) -> float | None:
    """The number that a text is; Python would take 1_000 and the digits of other scripts too."""
    if "_" in text or not text.isascii():
        return None
    try:
        return float(text)
    except ValueError:
        return None

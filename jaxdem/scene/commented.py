"""Commented scenes to begin with: a scene of `scenes/` with the meaning and unit of every key above it."""

from __future__ import annotations

import difflib
import re
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path

from jaxdem.errors import InputError
from jaxdem.scene.reference import TOP, WIDTH, rows, summary, tables

SCENES = Path(__file__).parents[1] / "scenes"
NAMES = ("bed", "hopper", "chute", "stream", "settling")
"""Files of `scenes/` that are small and quick."""

HEADER, KEY = re.compile(r"^\[{1,2}([\w.]+)\]{1,2}"), re.compile(r"^(\w+) *=")
SIDE = re.compile(r"^boundary\.\w+$")


def beginning(name: str) -> str:
    """The commented scene of a name.

    Raises:
        InputError: there is none of this name; the nearest is given.
    """
    if name not in NAMES:
        near = difflib.get_close_matches(name, NAMES, n=1)
        hint = f"Did you mean {near[0]}? " if near else ""
        raise InputError("NAME", name, "is no scene to begin with", f"{hint}Known: {', '.join(NAMES)}")
    return commented((SCENES / f"{name}.toml").read_text(encoding="utf-8"))


def commented(text: str) -> str:
    """A scene file with what its tables and keys are above them, and the further keys of every table below its header.

    Args:
        text: of a scene file whose keys begin their lines; entries of lists on lines of their own are indented.
    """
    models = {re.sub(r"[\[\]]", "", heading): model for heading, model in tables()}
    given = _keys_by_table(text)
    lines: list[str] = []
    table, place = TOP, 0
    for line in text.splitlines():
        if header := HEADER.match(line):
            table, place = SIDE.sub("boundary.<side>", header[1]), place + 1
            lines += _comment(summary(models[table]))
            absent = [key for key, *_ in rows(models[table]) if key not in given[place] and _is_key(models, table, key)]
            lines.append(line)
            if absent:
                lines += _comment(f"Further keys: {', '.join(absent)}. See `jaxdem scene {header[1]}`.")
        elif key := KEY.match(line):
            _, _, unit, _, meaning = next(row for row in rows(models[table]) if row[0] == key[1])
            lines += [*_comment(meaning + (f" [{unit}]" if unit else "")), line]
        else:
            lines.append(line)
    return "\n".join(lines) + "\n"


def _is_key(models: Mapping[str, object], table: str, key: str) -> bool:
    """Whether a name in a table is a key and not a table of its own."""
    return f"{table}.{key}" not in models


def _keys_by_table(text: str) -> list[set[str]]:
    """The keys under every header of a file in turn, those before the first one at first."""
    found: list[set[str]] = [set()]
    for line in text.splitlines():
        if HEADER.match(line):
            found.append(set())
        elif key := KEY.match(line):
            found[-1].add(key[1])
    return found


def _comment(text: str) -> Iterator[str]:
    """Lines of a comment."""
    yield from textwrap.wrap(text, WIDTH, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False)

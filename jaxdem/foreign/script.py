"""Input scripts of LIGGGHTS: commands with their continuation lines joined and their variables put in."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from jaxdem.files.reading import read_text
from jaxdem.foreign.formula import evaluate
from jaxdem.foreign.notes import TAKEN, Note, Unknown, unreadable

FORM = re.compile(r"\$\{(\w+)\}|\$(\w)")
DEEPEST = 10
"""Files that include each other."""


class Command(NamedTuple):
    """A command: where it stands, its text with variables put in, its words, and what is wrong with it, if anything."""

    place: str
    text: str
    words: list[str]
    problem: str = ""


def commands(path: Path, variables: dict[str, str], notes: list[Note], depth: int = 0) -> Iterator[Command]:
    """The commands of a script in their order; `variable` and `include` are carried out.

    Raises:
        InputError: the file cannot be read as a script.
    """
    for number, line in _joined(path):
        place = f"{path.name}, line {number}"
        try:
            text = FORM.sub(lambda match: _put_in(match, variables), line)
            words = shlex.split(text, comments=False)
        except (Unknown, ValueError) as error:
            yield Command(place, line, line.split(), str(error))
            continue
        if words[:1] == ["variable"] and len(words) > 3:
            try:
                _define(words, variables)
            except Unknown as error:
                yield Command(place, text, words, str(error))
            else:
                notes.append(Note(place, text, TAKEN, f"{words[1]} = {variables[words[1]]}"))
        elif words[:1] == ["include"] and len(words) == 2 and depth < DEEPEST:
            yield from commands(path.parent / words[1], variables, notes, depth + 1)
        elif words:
            yield Command(place, text, words)


def _joined(path: Path) -> Iterator[tuple[int, str]]:
    """Number and text of every command, without comments, with continuation lines (&) joined."""
    try:
        text = read_text(path)
    except FileNotFoundError:
        raise unreadable(str(path), "no such file", "give the path of an input script") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is not text in UTF-8"
        raise unreadable(str(path), f"cannot be read ({reason})", "give the path of an input script") from None
    begun, first = "", 0
    for number, whole in enumerate(text.splitlines(), start=1):
        line = _without_comment(whole).strip()
        first = first if begun else number
        if line.endswith("&"):
            begun += line[:-1] + " "
            continue
        if joined := (begun + line).strip():
            yield first, joined
        begun = ""
    if begun.strip():
        yield first, begun.strip()


def _without_comment(line: str) -> str:
    """The line before a # that does not stand between quotes."""
    quote = ""
    for position, character in enumerate(line):
        if character in "\"'" and quote in ("", character):
            quote = "" if quote else character
        elif character == "#" and not quote:
            return line[:position]
    return line


def _put_in(match: re.Match[str], variables: dict[str, str]) -> str:
    name = match[1] or match[2]
    if name not in variables:
        raise Unknown(f"the variable {name} is not known; write its value into the line")
    return variables[name]


def _define(words: list[str], variables: dict[str, str]) -> None:
    _, name, style, *values = words
    if style in ("index", "string"):
        if style == "string" or name not in variables:  # an index keeps the value that it has
            variables[name] = values[0]
    elif style == "equal":
        variables[name] = f"{evaluate(' '.join(values), variables):.17g}"
    else:
        raise Unknown(f"variables of style {style} are not carried out; write the commands without them")

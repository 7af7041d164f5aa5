"""Input scripts of LIGGGHTS and LAMMPS: commands with their continuation lines joined, their variables put in and their
conditions decided."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from jaxdem.files.reading import read_text
from jaxdem.foreign.formula import evaluate, holds
from jaxdem.foreign.notes import LEFT, NOTHING, TAKEN, Note, Notes, Unknown, unreadable

FORM = re.compile(r"\$\{(\w+)\}|\$\(((?:[^()]|\([^()]*\))*)\)|\$(\w)")
WRITES = re.compile(r"^[ \t]*(?:write_restart|restart[ \t]+\d+)[ \t]+([^\s#]+)", re.M)
DEEPEST = 10
"""Files that include each other."""


class Line(NamedTuple):
    """A command of a file: the number of its first line, its text, and the comment in it or right above it."""

    number: int
    text: str
    comment: str


class Command(NamedTuple):
    """A line of a script: where it stands, its text with variables put in, the commands that it holds as words (several
    where an `if` has them), what is wrong with it, if anything, and the comment in it or above it."""

    place: str
    text: str
    parts: list[list[str]]
    problem: str = ""
    comment: str = ""


def commands(path: Path, variables: dict[str, str], notes: Notes, depth: int = 0) -> Iterator[Command]:
    """The commands of a script in their order; `variable`, `include` and `if` are carried out.

    Raises:
        InputError: the file cannot be read as a script.
    """
    for line in _joined(path):
        place = f"{path.name}, line {line.number}"
        try:
            text = FORM.sub(lambda match: _put_in(match, variables), line.text)
            words = shlex.split(text, comments=False)
            if words[:1] == ["variable"]:
                notes.append(Note(place, text, TAKEN, _define(words, variables)))
            elif words[:1] == ["include"] and len(words) == 2 and depth < DEEPEST:
                notes.append(Note(place, text, TAKEN, f"the lines of {words[1]} follow"))
                yield from commands(path.parent / words[1], variables, notes, depth + 1)
            elif words[:1] == ["read_restart"] and (writer := _writer(path, words)) and depth < DEEPEST:
                yield from commands(writer, {}, notes, depth + 1)
                yield Command(place, text, [[*words, writer.name]])
            elif words[:1] == ["if"]:
                parts = _decided(words, variables)
                if parts:
                    yield Command(place, text, parts, comment=line.comment)
                else:
                    notes.append(Note(place, text, NOTHING, "the condition does not hold, and there is no other part"))
            elif words:
                yield Command(place, text, [words], comment=line.comment)
        except (Unknown, ValueError) as error:
            notes.append(Note(place, line.text, LEFT, str(error)))


def _writer(path: Path, words: list[str]) -> Path | None:
    """The script beside this one that writes a restart file; None without, or where there are several."""
    found = []
    for other in sorted(path.parent.glob("in.*")):
        try:
            text = "" if other == path else read_text(other)
        except (OSError, ValueError):
            continue
        if Path(words[1]).name in [Path(name).name for name in WRITES.findall(text)]:
            found.append(other)
    return found[0] if len(found) == 1 else None


def _joined(path: Path) -> Iterator[Line]:
    """Every command, without comments, with continuation lines (&) joined."""
    try:
        text = read_text(path)
    except FileNotFoundError:
        raise unreadable(str(path), "no such file", "give the path of an input script") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is not text in UTF-8"
        raise unreadable(str(path), f"cannot be read ({reason})", "give the path of an input script") from None
    begun, first, above = "", 0, ""
    for number, whole in enumerate(text.splitlines(), start=1):
        line, comment = _without_comment(whole)
        first = first if begun else number
        if line.endswith("&"):
            begun += line[:-1] + " "
            continue
        if joined := (begun + line).strip():
            yield Line(first, joined, comment or above)
            comment = ""
        begun, above = "", comment
    if begun.strip():
        yield Line(first, begun.strip(), above)


def _without_comment(line: str) -> tuple[str, str]:
    """The line before a # that does not stand between quotes, and what stands after it."""
    quote = ""
    for position, character in enumerate(line):
        if character in "\"'" and quote in ("", character):
            quote = "" if quote else character
        elif character == "#" and not quote:
            return line[:position].strip(), line[position:].strip("# \t")
    return line.strip(), ""


def _put_in(match: re.Match[str], variables: dict[str, str]) -> str:
    if match[2] is not None:
        return _short(evaluate(match[2].partition(":%")[0], variables))
    name = match[1] or match[3]
    if name not in variables:
        raise Unknown(f"the variable {name} is not known; write its value into the line")
    return variables[name]


def _short(value: float) -> str:
    """A number with the fewest digits that give it."""
    return repr(value).removesuffix(".0")


def _define(words: list[str], variables: dict[str, str]) -> str:
    """Carry out a command `variable`, and say what the variable is.

    Raises:
        Unknown: it is of a style, or has a formula, that needs a running simulation.
    """
    if words[2:] == ["delete"]:
        variables.pop(words[1], None)
        return f"{words[1]} is no more"
    if len(words) < 4:
        raise Unknown("a variable has a name, a style and a value")
    _, name, style, *values = words
    if style in ("index", "string"):
        if style == "string" or name not in variables:  # an index keeps the value that it has
            variables[name] = values[0]
    elif style == "equal":
        variables[name] = _short(evaluate(" ".join(values), variables))
    else:
        raise Unknown(f"variables of style {style} are not carried out; write the commands without them")
    return f"{name} = {variables[name]}"


def _decided(words: list[str], variables: dict[str, str]) -> list[list[str]]:
    """The commands of an `if` that are carried out; those that define variables are.

    Raises:
        Unknown: a condition cannot be decided before the run, or what it holds cannot be carried out.
    """
    at = 0
    while at < len(words):
        word = words[at]
        if word != "else" and (word not in ("if", "elif") or words[at + 2 : at + 3] != ["then"] and word == "if"):
            raise Unknown("the command has not the form if CONDITION then COMMAND ... else COMMAND ...")
        applies = word == "else" or holds(words[at + 1], variables)
        begin = at + {"if": 3, "elif": 2, "else": 1}[word]
        end = next((k for k in range(begin, len(words)) if words[k] in ("elif", "else")), len(words))
        if applies:
            parts = [shlex.split(text) for text in words[begin:end]]
            for part in parts:
                if part[:1] in (["include"], ["if"]):
                    raise Unknown(f"{part[0]} within an if is not carried out; write what holds into the deck")
                if part[:1] == ["variable"]:
                    _define(part, variables)
            return parts
        at = end
    return []

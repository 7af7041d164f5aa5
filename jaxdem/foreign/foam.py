"""Dictionaries of OpenFOAM: `key value;`, `key { ... }`, lists in brackets, `$name` and `#include`; no code."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

from jaxdem.errors import cut
from jaxdem.files.reading import read_text
from jaxdem.foreign.notes import LEFT, NOTHING, Note, Notes, unreadable

COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.S)
TOKEN = re.compile(r'"[^"]*"|[{}()\[\];]|[^\s{}()\[\];"]+')
CLOSING = {"(": ")", "[": "]"}
DEEPEST = 50
INCLUDES = ("#include", "#includeIfPresent")


class Token(NamedTuple):
    """A word or bracket, and the number of its line."""

    text: str
    line: int


class Entries(dict[str, Any]):
    """The entries of a dictionary: texts, lists of texts and lists, dictionaries; an entry of several words is a list.

    Attributes:
        lines: number of the line of each.
    """

    def __init__(self) -> None:
        super().__init__()
        self.lines: dict[str, int] = {}

    def matching(self, name: str) -> Any:
        """The entry of that name, or the last whose name, as a regular expression, matches it; None without."""
        if name in self:
            return self[name]
        found = None
        for key, value in self.items():
            try:
                found = value if re.fullmatch(key, name) else found
            except re.error:
                continue
        return found


def read_foam(path: Path, depth: int = 0) -> Entries:
    """The entries of a file.

    Raises:
        InputError: it cannot be read, its brackets do not match, or it holds code.
    """
    try:
        text = read_text(path)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is not text in UTF-8"
        raise unreadable(str(path), f"cannot be read ({reason})", "give the folder of a whole case") from None
    plain = COMMENT.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)
    tokens, line, at = [], 1, 0
    for match in TOKEN.finditer(plain):
        line += plain.count("\n", at, match.start())
        at = match.start()
        tokens.append(Token(match[0], line))
    try:
        found = _Reader(path.parent, tokens[::-1], depth).dictionary("", [])
    except (IndexError, ValueError) as error:
        limit = "its brackets or semicolons do not match"
        if str(error).startswith("#"):
            limit = f"holds {error}, which is not carried out"
        raise unreadable(str(path), limit, "correct the file") from None
    found.pop("FoamFile", None)
    return found


class _Reader:
    """Reads the tokens of a file from the end of a list."""

    def __init__(self, folder: Path, tokens: list[Token], depth: int):
        self.folder, self.tokens, self.depth = folder, tokens, depth

    def dictionary(self, end: str, around: list[Entries]) -> Entries:
        """The entries up to the bracket `end`; `around` are the dictionaries round it, for `$name`."""
        found = Entries()
        scopes = [*around, found]
        while self.tokens:
            key, line = self.tokens.pop()
            if key == end:
                return found
            if key == ";":
                continue
            if key in "{}()[]" or len(scopes) > DEEPEST:
                raise ValueError(key)
            if key in INCLUDES and self.depth < DEEPEST:
                more = read_foam(self.folder / self.tokens.pop().text.strip('"'), self.depth + 1)
                found.update(more)
                found.lines.update(dict.fromkeys(more, line))
                continue
            if key.startswith("#"):
                raise ValueError(key)
            name = key.strip('"')
            found.lines[name] = line
            if self.tokens[-1].text == "{":
                self.tokens.pop()
                found[name] = self.dictionary("}", scopes)
                continue
            words: list[Any] = []
            while (token := self.tokens.pop().text) != ";":
                words.append(self.value(token, scopes))
            if not words and key.startswith("$"):
                value = _looked_up(key, around)
                found.update(value if isinstance(value, dict) else {})
                continue
            found[name] = words[0] if len(words) == 1 else words
        if end:
            raise ValueError(end)
        return found

    def value(self, token: str, scopes: list[Entries]) -> Any:
        """A word, or the list that begins with this bracket."""
        if token.startswith("#"):
            raise ValueError(token)
        if token not in CLOSING:
            if token in "{})]" or len(scopes) > DEEPEST:
                raise ValueError(token)
            return _looked_up(token, scopes) if token.startswith("$") else token.strip('"')
        items: list[Any] = []
        while (inner := self.tokens.pop().text) != CLOSING[token]:
            items.append(self.dictionary("}", scopes) if inner == "{" else self.value(inner, [*scopes, Entries()]))
        return items


def _looked_up(token: str, scopes: list[Entries]) -> Any:
    """What `$name` stands for in the nearest dictionary round it; the word itself where none has it."""
    name = token.lstrip("$").lstrip(".:").strip("{}")
    return next((scope[name] for scope in reversed(scopes) if name in scope), token)


class Sheet:
    """A dictionary of a case whose entries get a note each.

    Args:
        path: of the file.
        notes: that it adds to.
    """

    def __init__(self, path: Path, notes: Notes):
        self.path, self.notes = path, notes
        self.entries = read_foam(path)
        self._told: set[str] = set()

    def get(self, key: str, default: Any = None) -> Any:
        """The value of an entry."""
        return self.entries.get(key, default)

    def say(self, key: str, kind: str, reason: str) -> int:
        """Say what became of an entry, if there is such a one; the number of the note, -1 without."""
        if key not in self.entries:
            return -1
        self._told.add(key)
        return self.note(self.entries.lines.get(key, 1), f"{key} {_shown(self.entries[key])}", kind, reason)

    def note(self, line: int, text: str, kind: str, reason: str) -> int:
        """Add a note on a line of the file; the number of the note."""
        place = f"{self.path.parent.name}/{self.path.name}, line {line}"
        self.notes.append(Note(place, cut(text, 100), kind, reason))
        return len(self.notes) - 1

    def finish(self, no_effect: tuple[str, ...] = (), otherwise: tuple[str, str] | None = None) -> None:
        """Say of all other entries that they have no effect, or that there is no counterpart."""
        for key in self.entries:
            if key in self._told:
                continue
            if key in no_effect or key.endswith("Coeffs"):
                self.say(key, NOTHING, "numerical settings, output or names of fields")
            else:
                self.say(key, *(otherwise or (LEFT, "there is no counterpart")))


def _shown(value: Any) -> str:
    """A value as text."""
    if isinstance(value, dict):
        return "{ " + " ".join(f"{key} {_shown(one)};" for key, one in value.items()) + " }"
    if isinstance(value, list):
        return "(" + " ".join(_shown(one) for one in value) + ")"
    return str(value)

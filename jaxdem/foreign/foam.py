"""Dictionaries of OpenFOAM: `key value;`, `key { ... }` and lists in brackets; no macros and no code."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from jaxdem.files.reading import read_text
from jaxdem.foreign.notes import unreadable

COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.S)
TOKEN = re.compile(r'"[^"]*"|[{}()\[\];]|[^\s{}()\[\];"]+')
CLOSING = {"(": ")", "[": "]"}
DEEPEST = 50


def read_foam(path: Path) -> dict[str, Any]:
    """The entries of a file: texts, lists of texts and lists, dictionaries; an entry of several words is a list.

    Raises:
        InputError: it cannot be read, or its brackets do not match.
    """
    try:
        text = read_text(path)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is not text in UTF-8"
        raise unreadable(str(path), f"cannot be read ({reason})", "give the folder of a whole case") from None
    tokens = TOKEN.findall(COMMENT.sub(" ", text))[::-1]
    try:
        found = _dictionary(tokens, "", 0)
    except (IndexError, ValueError):
        raise unreadable(str(path), "its brackets or semicolons do not match", "correct the file") from None
    found.pop("FoamFile", None)
    return found


def _dictionary(tokens: list[str], end: str, depth: int) -> dict[str, Any]:
    found: dict[str, Any] = {}
    while tokens:
        key = tokens.pop()
        if key == end:
            return found
        if key == ";":
            continue
        if key in "{}()[]" or depth > DEEPEST:
            raise ValueError(key)
        if tokens[-1] == "{":
            tokens.pop()
            found[key.strip('"')] = _dictionary(tokens, "}", depth + 1)
            continue
        words: list[Any] = []
        while (token := tokens.pop()) != ";":
            words.append(_value(token, tokens, depth))
        found[key.strip('"')] = words[0] if len(words) == 1 else words
    if end:
        raise ValueError(end)
    return found


def _value(token: str, tokens: list[str], depth: int) -> Any:
    if token not in CLOSING:
        if token in "{})]" or depth > DEEPEST:
            raise ValueError(token)
        return token.strip('"')
    items: list[Any] = []
    while (inner := tokens.pop()) != CLOSING[token]:
        if inner == "{":
            items.append(_dictionary(tokens, "}", depth + 1))
        else:
            items.append(_value(inner, tokens, depth + 1))
    return items

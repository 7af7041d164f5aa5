"""What became of every line of a deck."""

from __future__ import annotations

from typing import NamedTuple

from jaxdem.errors import InputError

TAKEN, DIFFERS, LEFT, NOTHING = "taken", "differs", "left out", "no effect"
"""Taken as it is; taken with a difference; not taken; of no meaning for a scene (output, parallel work)."""


class Note(NamedTuple):
    """What became of one line: its place, its text, one of the four words above, and why or what to do."""

    place: str
    text: str
    kind: str
    reason: str


class Unknown(Exception):
    """A command that has no counterpart; the reason, and the remedy if there is one."""


def unreadable(name: str, limit: str, remedy: str) -> InputError:
    """The error for a deck that cannot be read at all."""
    return InputError("DECK", name, limit, remedy)

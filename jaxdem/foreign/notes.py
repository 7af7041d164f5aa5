"""What became of every line of a deck."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from jaxdem.errors import InputError

TAKEN, DIFFERS, LEFT, NOTHING = "taken", "differs", "left out", "no effect"
"""Taken as it is; taken with a difference; not taken; of no meaning for a scene (output, parallel work)."""

Answer = tuple[str, str]
"""Kind of note and reason."""

Say = Callable[[str, str, str], None]
"""Adds a note on the scene as a whole: what, kind, reason."""


class Note(NamedTuple):
    """What became of one line: its place, its text, one of the four words above, and why or what to do."""

    place: str
    text: str
    kind: str
    reason: str


class Notes(list[Note]):
    """The notes on a deck in the order of its lines. What a line becomes may turn out later, when the whole deck is
    known: then its note is amended, so that every line has one note that is true."""

    def amend(self, line: int, kind: str, reason: str) -> None:
        """Give the note with this number another kind and reason."""
        self[line] = self[line]._replace(kind=kind, reason=reason)

    def differ(self, line: int, reason: str) -> None:
        """Add a difference to a note that says what was taken; once, however often it is found."""
        note = self[line]
        if reason in note.reason:
            return
        kind = DIFFERS if note.kind == TAKEN else note.kind
        self[line] = note._replace(kind=kind, reason=f"{note.reason}; {reason}")

    def say(self, what: str, kind: str, reason: str) -> None:
        """Add a note on the scene as a whole."""
        self.append(Note("scene", what, kind, reason))


class Unknown(Exception):
    """A command that has no counterpart; the reason, and the remedy if there is one."""


def joined_answer(answers: Sequence[Answer]) -> Answer:
    """The answer to a line that holds several commands: the weightiest kind, and all reasons."""
    kind = next(kind for kind in (LEFT, DIFFERS, TAKEN, NOTHING) if any(one[0] == kind for one in answers))
    return kind, "; ".join(reason for _, reason in answers)


def unreadable(name: str, limit: str, remedy: str) -> InputError:
    """The error for a deck that cannot be read at all."""
    return InputError("DECK", name, limit, remedy)

"""Walls that vanish and insertions that end: by `unfix`, by another fix of the name, and where a script ends."""

from __future__ import annotations

from jaxdem.foreign.model import Deck, DeckWall, Insertion
from jaxdem.foreign.notes import NOTHING, TAKEN, Answer

GRAVITY = "gravity"
"""What the fix of gravity has become."""


def end(deck: Deck, found: list[DeckWall] | Insertion) -> Answer:
    """Walls that vanish, or an insertion that ends."""
    if isinstance(found, Insertion):
        if found.segment == deck.segment:
            deck.insertions.remove(found)
            deck.notes.amend(found.line, NOTHING, "its fix is taken back before a run")
            return TAKEN, "the insertion is never carried out"
        if not found.is_inlet:
            return NOTHING, "its particles are in already"
        found.end = deck.time
        return TAKEN, "particles.inlet.end"
    for one in found:
        one.end = deck.time
        if one.begin == one.end:
            deck.walls.remove(one)
            deck.notes.amend(one.line, NOTHING, "its fix is taken back before a run")
    return TAKEN, "walls.end"


def end_of_script(deck: Deck) -> None:
    """End all fixes: another script goes on from the state of this one, and gives its own."""
    for found in deck.fixes.values():
        if isinstance(found, list | Insertion):
            end(deck, found)
    deck.fixes.clear()
    deck.model.gravity = None


def goes_on(deck: Deck, wall: DeckWall) -> None:
    """Let a wall that is given anew, at the time at which the same one has ended, be that one."""
    for other in deck.walls:
        if other is not wall and other.end == wall.begin and other.place == wall.place:
            deck.walls.remove(other)
            deck.notes.amend(other.line, TAKEN, f"goes on as the wall of {deck.notes[wall.line].place}")
            wall.begin = other.begin
            return

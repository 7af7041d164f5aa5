"""A LIGGGHTS script as a scene, with a note on each of its lines."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w

from jaxdem.errors import InputError, visible
from jaxdem.files.reading import TABLE_BYTES, read_text
from jaxdem.foreign.case import Say, coupling_file, fluid_tables, script_of
from jaxdem.foreign.commands import apply
from jaxdem.foreign.fixes import fix
from jaxdem.foreign.model import Deck
from jaxdem.foreign.notes import DIFFERS, LEFT, NOTHING, TAKEN, Note, unreadable
from jaxdem.foreign.scene_tables import scene_tables
from jaxdem.foreign.script import commands
from jaxdem.scene import load_scene

HEAD_LINES = 100
"""Of a data file, in which its box stands."""


class Imported(NamedTuple):
    """A scene and what became of the lines of its deck."""

    toml: str
    notes: list[Note]

    def number(self, kind: str) -> int:
        """Number of lines of a kind."""
        return sum(note.kind == kind for note in self.notes)


def import_deck(deck: Path, out: Path) -> Imported:
    """The scene of a script, or of a CFDEM case in a folder, valid as far as `load_scene` tells.

    Args:
        deck: the script or the folder.
        out: where the scene will stand; files are named relative to it.

    Raises:
        InputError: the deck cannot be read, or has not enough for a scene: a box, particles, a time step and a run.
    """
    found, notes = Deck(), list[Note]()

    def say(what: str, kind: str, reason: str) -> None:
        notes.append(Note("scene", what, kind, reason))

    fluid: dict[str, Any] = {}
    properties = coupling_file(deck) if deck.is_dir() else None
    if deck.is_dir() and properties is None:
        remedy = "give a LIGGGHTS script, or the folder of a CFDEM case"
        raise unreadable(str(deck), "is a folder without constant/couplingProperties", remedy)
    if properties is not None:
        deck = script_of(properties)
    for command in commands(deck, {}, notes):
        kind, reason = (LEFT, command.problem) if command.problem else apply(found, command.words, fix)
        notes.append(Note(command.place, command.text, kind, reason))
        if command.words[:1] == ["read_data"] and kind == TAKEN:
            _box_of_data_file(found, deck.parent / found.data_file)
    if properties is not None:
        fluid, found.lower, found.upper = _fluid(properties.parents[1], found, say)
    _require_enough(found, deck, notes)
    data_name = os.path.relpath(deck.parent / found.data_file, out.parent) if found.data_file else ""
    tables = scene_tables(found, data_name, say)
    tables |= fluid
    _check(tables, out.parent, deck)
    return Imported(_with_notes(deck, tables, notes), notes)


def _fluid(root: Path, found: Deck, say: Say) -> tuple[dict[str, Any], list[float], list[float]]:
    """The tables of the fluid; the box is that of the mesh, and the sides are those of the fluid."""
    try:
        tables, lower, upper = fluid_tables(root, found.time_step, say)
    except (KeyError, ValueError, TypeError, IndexError, AttributeError) as error:
        limit = f"has not the form that is expected ({type(error).__name__}: {error})"
        raise unreadable(str(root), limit, "correct the dictionaries") from None
    found.planes = [[(c, t) for c, t in planes if low < c < high]
                    for planes, low, high in zip(found.planes, lower, upper, strict=True)]  # fmt: skip
    if any(found.planes):
        say("wall/gran", LEFT, "plane walls within the mesh of the fluid; write them as [[walls]]")
        found.planes = [[], [], []]
    found.lost = "error"  # sides of a fluid hold the grains back
    found.steps = max(found.steps, round(tables["time"]["end"] / found.time_step)) if found.time_step else 0
    found.output_steps = found.steps  # the tables have the time of the fluid
    return tables, lower, upper


def _box_of_data_file(deck: Deck, path: Path) -> None:
    """Box and number of types from the head of a data file."""
    try:
        lines = read_text(path, TABLE_BYTES).splitlines()[1:HEAD_LINES]
    except (OSError, ValueError) as error:
        limit = f"names the data file {path}, which cannot be read ({getattr(error, 'strerror', None) or error})"
        raise unreadable(deck.data_file, limit, "put it where the deck says") from None
    ends: dict[str, list[float]] = {}
    for line in lines:
        words = line.partition("#")[0].split()
        if words[1:] == ["atom", "types"]:
            deck.types = int(words[0])
        if len(words) == 4 and words[2][1:] == "lo" and words[3][1:] == "hi":
            ends[words[2][0]] = [float(words[0]) * deck.length, float(words[1]) * deck.length]
    if set(ends) == set("xyz"):
        deck.lower, deck.upper = [ends[a][0] for a in "xyz"], [ends[a][1] for a in "xyz"]


def _require_enough(found: Deck, deck: Path, notes: list[Note]) -> None:
    lacking = {
        "a box (create_box or read_data)": not found.lower,
        "a contact model (pair_style gran model ...)": not found.contact,
        "particles (read_data, insert/pack or insert/rate/region)": not (found.data_file or found.insertions),
        "a time step (timestep)": found.time_step <= 0.0,
        "a run": found.steps <= 0,
    }
    hooke = ("characteristicVelocity",) if found.contact.get("model") == "hooke" else ()
    for name in ("youngsModulus", "poissonsRatio", "coefficientRestitution", *hooke):
        lacking[f"{name} (fix property/global)"] = name not in found.properties
    if hooke:
        lacking["a size for the stiffness of hooke (particletemplate/sphere)"] = not found.templates
    names = [name for name, lacks in lacking.items() if lacks]
    if names:
        left = "; ".join(f"{note.place}: {note.reason}" for note in notes if note.kind == LEFT)
        limit = f"has nothing that a scene can take as {', nor as '.join(names)}. Left out: {left or 'nothing'}"
        raise unreadable(str(deck), limit, "add these lines, or write a scene by hand")


def _check(tables: dict[str, Any], folder: Path, deck: Path) -> None:
    """Refuses tables that are no scene: the deck asks for something that a scene cannot have."""
    given = {**tables, "particles": dict(tables["particles"])}
    if "file" in given["particles"]:
        file = given["particles"]["file"]
        given["particles"]["file"] = {**file, "name": str((folder / file["name"]).resolve())}
    try:
        load_scene(given)
    except InputError as error:
        raise unreadable(str(deck), f"gives a scene that is refused: {error}", "correct the deck") from None


def _with_notes(deck: Path, tables: dict[str, Any], notes: list[Note]) -> str:
    """The scene as TOML, with the notes before it as comments."""
    lines = [f"# Made by `jaxdem import {deck.name}`. What became of each line:"]
    for kind in (LEFT, DIFFERS, TAKEN, NOTHING):
        some = [note for note in notes if note.kind == kind]
        if some:
            lines += ["#", f"# {kind}:"]
            lines += [f"#   {n.place}: {_one_line(n.text)}" + (f": {_one_line(n.reason)}") for n in some]
    return "\n".join(lines) + "\n\n" + tomli_w.dumps(tables)


def _one_line(text: str) -> str:
    return visible(" ".join(text.split()))

"""A script of LIGGGHTS or LAMMPS, or a CFDEM case, as a scene, with a note on each of its lines."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w

from jaxdem.errors import InputError, visible
from jaxdem.files.durable import write_bytes
from jaxdem.files.reading import open_regular
from jaxdem.foreign.box import box_of
from jaxdem.foreign.case import FluidCase, coupling_file, read_case, script_of
from jaxdem.foreign.commands import apply_all
from jaxdem.foreign.fixes import FIXES
from jaxdem.foreign.model import Deck
from jaxdem.foreign.notes import DIFFERS, LEFT, NOTHING, TAKEN, Note, Notes, unreadable
from jaxdem.foreign.scene_tables import Written, added_tables, inlet_tables, merged, model_tables, shared_tables
from jaxdem.foreign.script import commands
from jaxdem.foreign.stages import Part, joined, part_of, staged
from jaxdem.foreign.steps import check_steps
from jaxdem.scene import Scene, load_scene

MADE = "# Made by `jaxdem import"
"""How a scene begins that is made here."""


class Imported(NamedTuple):
    """A scene and what became of the lines of its deck.

    Attributes:
        toml: the scene.
        notes: one on each line.
        files: texts that belong beside the scene, by name: particles that the deck makes.
    """

    toml: str
    notes: list[Note]
    files: dict[str, str]

    def number(self, kind: str) -> int:
        """Number of lines of a kind."""
        return sum(note.kind == kind for note in self.notes)

    def write(self, out: Path) -> None:
        """Write the scene to `out`, and its files beside it; each whole or as it was."""
        for name, text in self.files.items():
            write_bytes(out.parent / name, text.encode())
        write_bytes(out, self.toml.encode())


def refuse_other_file(option: str, out: Path) -> None:
    """Refuses to replace a file that is no scene made here: it may be of the deck.

    Raises:
        InputError: it is another one.
    """
    try:
        with open_regular(out) as file:
            begins = file.read(len(MADE.encode()))
    except OSError:  # nothing is there, or nothing that can be read: writing will tell
        return
    if begins != MADE.encode():
        limit = "exists, and was not made by `jaxdem import`"
        raise InputError(option, str(out), limit, "name a new file, or delete this one")


def import_deck(deck: Path, out: Path) -> Imported:
    """The scene of a script, or of a CFDEM case in a folder, valid as far as `load_scene` tells.

    Args:
        deck: the script or the folder.
        out: where the scene will stand; files are named relative to it.

    Raises:
        InputError: the deck cannot be read, or has not enough for a scene: a box, particles, a time step and a run.
    """
    properties = coupling_file(deck) if deck.is_dir() else None
    if deck.is_dir() and properties is None:
        remedy = "give a script of LIGGGHTS or LAMMPS, or the folder of a CFDEM case"
        if (deck / "constant" / "kinematicCloudProperties").is_file():
            limit = "is a case of DPMFoam (kinematicCloudProperties), whose contact laws are not read"
            raise unreadable(str(deck), limit, f"write a scene by hand (`jaxdem new bed`), or {remedy}")
        raise unreadable(str(deck), "is a folder without constant/couplingProperties", remedy)
    script = deck if properties is None else script_of(properties)
    notes = Notes()
    found = Deck(notes, script.parent)
    for command in commands(script, {}, notes):
        found.line, found.comment = len(notes), command.comment
        notes.append(Note(command.place, command.text, NOTHING, ""))
        notes.amend(found.line, *apply_all(found, command.parts, FIXES))
    if properties is None:
        _forget_what_follows(found)
    case = None if properties is None else read_case(properties.parents[1], found)
    _require_enough(found, script, case)
    data_name = "" if not found.data_file else os.path.relpath(script.parent / found.data_file["name"], out.parent)
    written = Written(out.stem)
    try:
        tables = _tables(found, written, data_name, case, out.parent)
        _loaded(tables, written, out.parent)
    except InputError as error:
        raise unreadable(str(script), f"gives a scene that is refused: {error}", "correct the deck") from None
    return Imported(_with_notes(script, tables, notes), list(notes), written.texts)


def _forget_what_follows(deck: Deck) -> None:
    """Commands after the last run change nothing."""
    if not deck.segments:
        return
    last = deck.segments[-1].line
    deck.walls = [one for one in deck.walls if one.line < last]
    deck.insertions = [one for one in deck.insertions if one.line < last]
    for one in deck.walls:
        one.end = None if one.end == deck.time else one.end
    for coming in deck.insertions:
        coming.end = None if coming.end == deck.time else coming.end
    deck.atoms.pop(deck.segment, None)
    for line in range(last + 1, len(deck.notes)):
        if deck.notes[line].kind != NOTHING:
            deck.notes.amend(line, NOTHING, "it stands after the last run")


def _tables(deck: Deck, written: Written, data_name: str, case: FluidCase | None, folder: Path) -> dict[str, Any]:
    """The scene; each run of the deck is a part of it, and a case has one more, with the fluid."""
    box = box_of(deck, is_mesh=case is not None)
    shared = shared_tables(deck, box, written, data_name)
    sides = {} if case is None else case.tables["boundary"]
    periodic = {name: table for name, table in sides.items() if table == {"kind": "periodic"}}
    if periodic:  # in the parts without fluid too
        shared = merged(shared, {"boundary": periodic})
    parts = []
    for number, segment in enumerate(deck.segments):
        tables = merged(shared, model_tables(deck, box, segment.model))
        parts.append(part_of(segment, tables, added_tables(deck, box, written, number) if number else {}))
    if case is not None:
        tables = merged(merged(shared, model_tables(deck, box, deck.model)), case.tables)
        start = added_tables(deck, box, written, deck.segment) if deck.segments else {}
        lines = [case.line]
        step = deck.model.time_step_line
        parts.append(Part("coupled", tables, deck.time, deck.time + case.duration, case.output, start, lines, step))
    parts = joined(parts)
    for part in parts:
        inlets = inlet_tables(deck, box, part.end)
        if inlets:
            part.tables = merged(part.tables, {"particles": {"inlet": inlets}})
    check_steps(deck, parts, lambda tables: _loaded(tables, written, folder))
    return staged(deck, parts)


def _require_enough(found: Deck, deck: Path, case: FluidCase | None) -> None:
    lacking = {
        "units (units si)": found.units is None,
        f"spheres (the atom style is {found.odd_particles})": bool(found.odd_particles),
        "a box (create_box or read_data)": not found.lower,
        "a contact model (pair_style)": found.model.contact is None,
        "particles (read_data, create_atoms, insert/pack, insert/rate/region or pour)": not found.has_particles,
        "a time step (timestep)": found.model.time_step <= 0.0,
        "a run": not found.segments and case is None,
    }
    names = [name for name, lacks in lacking.items() if lacks]
    models = [segment.model for segment in found.segments] + ([found.model] if case is not None else [])
    for model in [] if names else models:
        names += [] if model.contact is None else model.contact.lacking(found, model)
    names = list(dict.fromkeys(names))
    if names:
        left = "; ".join(f"{note.place}: {note.reason}" for note in found.notes if note.kind == LEFT)
        limit = f"has nothing that a scene can take as {', nor as '.join(names)}. Left out: {left or 'nothing'}"
        raise unreadable(str(deck), limit, "add these lines, or write a scene by hand")


def _loaded(tables: dict[str, Any], written: Written, folder: Path) -> Scene:
    """The scene of tables that will stand in a folder, with files that are not there yet."""
    with tempfile.TemporaryDirectory() as aside:
        for name, text in written.texts.items():
            (Path(aside) / name).write_text(text, encoding="utf-8")
        return load_scene(_with_places(tables, written, Path(aside), folder))


def _with_places(value: Any, written: Written, aside: Path, folder: Path, key: str = "") -> Any:
    """Tables with absolute names of files."""
    if isinstance(value, list):
        return [_with_places(one, written, aside, folder) for one in value]
    if not isinstance(value, dict):
        return value
    if key == "file" and "name" in value:
        name = value["name"]
        return {**value, "name": str((aside if name in written.texts else folder) / name)}
    return {name: _with_places(one, written, aside, folder, name) for name, one in value.items()}


def _with_notes(deck: Path, tables: dict[str, Any], notes: Notes) -> str:
    """The scene as TOML, with the notes before it as comments."""
    lines = [f"{MADE} {deck.name}`. What became of each line:"]
    for kind in (LEFT, DIFFERS, TAKEN, NOTHING):
        some = [note for note in notes if note.kind == kind]
        if some:
            lines += ["#", f"# {kind}:"]
            lines += [f"#   {n.place}: {_one_line(n.text)}: {_one_line(n.reason)}" for n in some]
    return "\n".join(lines) + "\n\n" + tomli_w.dumps(tables)


def _one_line(text: str) -> str:
    return visible(" ".join(text.split()))

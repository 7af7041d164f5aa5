"""Nothing of a deck is silent: every command has one note, with a reason, and every entry of a case too."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from cases import decks

from jaxdem.foreign import import_deck
from jaxdem.foreign.foam import read_foam
from jaxdem.foreign.notes import DIFFERS, LEFT, NOTHING, TAKEN

SCRIPTS = {
    "hopper": (decks.HOPPER, {}),
    "created": (decks.CREATED, {"more.deck": decks.MORE}),
    "drum": (decks.DRUM, {}),
    "pile": (decks.PILE, {"grains.data": decks.GRAINS}),
    "pour": (decks.POUR, {}),
    "granular": (decks.GRANULAR, {}),
}


def check(made, name, text):
    lines = [int(note.place.rpartition(" ")[2]) for note in made.notes if note.place.startswith(f"{name}, line")]
    counts = Counter(lines)
    assert sorted(counts) == decks.commands_of(text)
    assert set(counts.values()) == {1}
    for note in made.notes:
        assert note.kind in (TAKEN, DIFFERS, LEFT, NOTHING) and note.reason and note.text
        assert f"#   {note.place}: " in made.toml


@pytest.mark.parametrize("name", SCRIPTS)
def test_every_command_has_one_note(tmp_path, name):
    text, others = SCRIPTS[name]
    _, _, made = decks.imported(tmp_path, text, **others)
    check(made, "in.deck", text)
    if "more.deck" in others:
        check(made, "more.deck", decks.MORE)


@pytest.mark.parametrize("path", sorted(decks.DATA.glob("in.*")), ids=lambda path: path.name)
def test_every_command_of_the_benchmark_has_one_note(tmp_path, path):
    check(import_deck(path, tmp_path / "scene.toml"), path.name, path.read_text())


def test_every_entry_of_a_case_has_one_note(tmp_path):
    """Of files that are read whole every entry, of fields every patch too; others have one note as a whole."""
    made = decks.case_of(tmp_path, **decks.OTHERS)
    root = tmp_path / "case" / "CFD"
    for path in sorted(path for path in root.rglob("*") if path.is_file()):
        place = f"{path.parent.name}/{path.name}"
        notes = [note for note in made.notes if note.place == place or note.place.startswith(f"{place}, line")]
        if [note.text for note in notes] == ["the whole file"]:
            assert place in decks.WHOLE
            continue
        counts = Counter(note.text.split()[0] for note in notes)
        entries = read_foam(path)
        patches = entries.get("boundaryField", {}) if path.name in ("U", "p") else {}
        assert {name: counts.pop(name) for name in patches} == dict.fromkeys(patches, 1)
        assert set(counts) == set(entries)
        assert {name for name, count in counts.items() if count > 1} <= {"forceModels"}
    check(made, "in.run", (tmp_path / "case" / "DEM" / "in.run").read_text())


def test_the_reasons_name_the_keys():
    """A line that is taken says what it became; a key of the reason is one of a scene."""
    from jaxdem.scene.reference import explain

    path = Path(decks.DATA / "in.liggghts")
    for note in import_deck(path, Path("scene.toml")).notes:
        if note.kind == TAKEN and note.text.startswith("fix grav"):
            assert note.reason == "domain.gravity" and "domain.gravity" in explain(note.reason)

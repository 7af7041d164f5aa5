"""Nothing of a deck is silent: every command has one note, with a reason, and every entry of a case too."""

from __future__ import annotations

import random
from collections import Counter
from pathlib import Path

import pytest
from cases import decks

from jaxdem.errors import InputError
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
    "silo": (decks.SILO, {}),
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


def damaged(text, random):
    """A script with some words changed, dropped or doubled, and a line taken from elsewhere."""
    lines = text.splitlines()
    words = [word for word in text.split() if not set(word) & set("\"'&#$")] + ["nan", "-1", "0", "NULL", "1e99"]
    for _ in range(random.randint(1, 4)):
        number = random.randrange(len(lines))
        parts = lines[number].split(" ")
        at = random.randrange(len(parts))
        if set(lines[number]) & set("\"'&#"):
            lines.insert(number, random.choice([line for line in lines if "&" not in line]))
        elif random.random() < 0.5:
            lines[number] = " ".join([*parts[:at], random.choice(words), *parts[at + 1 :]])
        else:
            lines[number] = " ".join([*parts[:at], *parts[at + 1 :]])
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("name", ["hopper", "created", "pour", "granular"])
def test_a_damaged_script_is_refused_or_has_a_note_on_every_line(tmp_path, name):
    """No other error than InputError, and nothing is silent."""
    text, others = SCRIPTS[name]
    generator, made = random.Random(7), 0
    for _ in range(30):
        script = damaged(text, generator)
        try:
            found = decks.imported(tmp_path, script, **others)[2]
        except InputError:
            continue
        made += 1
        check(found, "in.deck", script)
    assert made > 3


def test_the_reasons_name_the_keys():
    """A line that is taken says what it became; a key of the reason is one of a scene."""
    from jaxdem.scene.reference import explain

    path = Path(decks.DATA / "in.liggghts")
    for note in import_deck(path, Path("scene.toml")).notes:
        if note.kind == TAKEN and note.text.startswith("fix grav"):
            assert note.reason == "domain.gravity" and "domain.gravity" in explain(note.reason)

"""The commands that write or explain scenes: scene, import, new."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jaxdem.cli import options, terminal
from jaxdem.cli.inputs import prepare_file, prepare_folder
from jaxdem.errors import InputError


def scene(
    key: Annotated[str, typer.Argument(help="A key or a table, such as contact.friction; all without.")] = "",
) -> None:
    """Explain a key of a scene file, or list the keys of a table, or all tables."""
    from jaxdem.scene.reference import explain

    terminal.line(explain(key))


def import_scene(
    deck: options.DeckFile,
    out: Annotated[Path, options.file_out("Scene file to write (TOML).")],
) -> None:
    """Make a scene of a script of LIGGGHTS or LAMMPS or a CFDEM case, and say line by line what became of it."""
    prepare_file(out, deck)
    from jaxdem.foreign import import_deck, refuse_other_file

    refuse_other_file("--out", out)
    made = import_deck(deck, out)
    made.write(out)
    terminal.show_import(made.notes)
    terminal.line(f"Wrote {', '.join(str(place) for place in (out, *(out.parent / name for name in made.files)))}")


def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="bed, hopper, chute, stream or settling.")],
    out: Annotated[Path | None, options.file_out("Scene file to write; it must be new. [NAME.toml]")] = None,
) -> None:
    """Write a commented scene to begin with: bed, hopper, chute, stream or settling."""
    from jaxdem.scene.commented import beginning

    text, place = beginning(name), out or Path(f"{name}.toml")
    prepare_folder(place.parent)
    try:
        with place.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError("--out", str(place), "exists already", "Name another file.") from None
    except OSError as error:  # no half of a scene is left in the way of the next try
        place.unlink(missing_ok=True)
        error.filename = str(place)
        raise
    terminal.line(f"Wrote {place}. Next: jaxdem check {place}")

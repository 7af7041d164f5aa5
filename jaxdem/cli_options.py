"""What the commands share: scenes to read, places to write to, lists of numbers."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jaxdem.errors import InputError

if TYPE_CHECKING:
    from jaxdem.scene import Scene

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (TOML).", show_default=False)]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the scene; may be given many times."),
]


def prepare_file(path: Path, *inputs: str | Path | None, option: str = "--out") -> None:
    """Refuse a place that cannot be written, or that holds what is read, before hours of work, not after them."""
    from jaxdem.io.outputs import refuse_what_is_read

    refuse_what_is_read(option, path, inputs)
    if path.is_dir():
        raise InputError(option, str(path), "is a folder", "Name a file in it.")
    prepare_folder(path.parent)


def prepare_folder(path: Path) -> None:
    """Make the folder, or refuse it."""
    if path.exists() and not path.is_dir():
        raise InputError("--out", str(path), "is not a folder", "Name a folder.")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        limit = f"cannot be written ({error.strerror})"
        raise InputError("--out", str(path), limit, "Choose another place.") from None
    if not os.access(path, os.W_OK):
        raise InputError("--out", str(path), "cannot be written", "Choose another place.")


def whole_numbers(option: str, text: str, separator: str) -> tuple[int, ...]:
    """Positive whole numbers out of a text such as 170-70-30; raises InputError that names the option."""
    try:
        numbers = tuple(int(part) for part in text.split(separator))
    except ValueError:
        numbers = (0,)
    if min(numbers) < 1:
        example = separator.join("421" if separator == "-" else "124")
        limit = f"must be positive whole numbers separated by {separator!r}"
        raise InputError(option, text, limit, f"For example {option} {example}.")
    return numbers


def load(
    path: Path, settings: list[str] | None, closure: Path | None = None, subgrid: Path | None = None
) -> Scene:
    """The scene with the options applied; JAX set to its precision."""
    from jaxdem.scene import load_scene

    scene = load_scene(path, overrides(settings, closure, subgrid))
    import jax

    if scene.precision == "float64":
        jax.config.update("jax_enable_x64", True)
    return scene


def overrides(
    settings: list[str] | None, closure: Path | None = None, subgrid: Path | None = None
) -> dict[str, Any]:
    """Keys of the scene that the options change."""
    from jaxdem.scene import parse_override

    changed = dict(parse_override(text) for text in settings or ())
    # Names in a scene are relative to it, names on the command line to the working directory.
    if closure is not None:
        changed["closure.file"] = str(closure.resolve())
    if subgrid is not None:
        changed["fluid.subgrid"] = str(subgrid.resolve())
    return changed

"""The folder of a scene with stages: a run directory for each, and the list of their names."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from jaxdem.errors import InputError
from jaxdem.files.durable import aside_names, write_bytes
from jaxdem.files.reading import parse_toml, read_text
from jaxdem.io.access import LOCK, OPTION, input_errors

CHAIN = "stages.toml"
"""Names of the stages, in order, as the key `stages`."""


def stage_names(path: Path) -> tuple[str, ...] | None:
    """Names of the stages in a folder, None where it is not that of a scene with stages.

    Raises:
        InputError: the list of the names is damaged.
    """
    if not (path / CHAIN).is_file():
        return None
    try:
        names = parse_toml(read_text(path / CHAIN)).get("stages")
    except (OSError, ValueError):
        names = None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        remedy = "take the file from a backup, or run the scene anew in another folder"
        raise InputError(CHAIN, str(path / CHAIN), "is no list of stages", remedy)
    return tuple(names)


def check_chain(path: Path, names: Sequence[str], resume: bool) -> None:
    """Refuses a folder in which the stages cannot begin or, under `resume`, cannot go on; nothing is made or changed.

    Raises:
        InputError: it holds something, or the stages in it have other names.
    """
    with input_errors(path):
        entries = {entry.name for entry in path.iterdir()} if path.exists() else set()
        entries -= {LOCK, *aside_names(path / CHAIN)}
    before = stage_names(path)
    if not resume and entries:
        again = "or --resume to go on" if before else "or empty this one"
        raise InputError(OPTION, str(path), "is not empty", f"give another folder, {again}")
    if resume and before is None:
        limit = f"--resume needs {CHAIN} in it, and there is none"
        raise InputError(OPTION, str(path), limit, "run the stages without --resume in an empty folder")
    if resume and before is not None and tuple(names[: len(before)]) != before:
        limit = f"the stages in {path} are {', '.join(before)}; only further ones may follow them"
        raise InputError("stages", ", ".join(names), limit, "give these stages, or another --out")


def write_chain(path: Path, names: Sequence[str]) -> None:
    """Stores the names of the stages, durably."""
    with input_errors(path):
        # A list of names in JSON is one in TOML.
        write_bytes(path / CHAIN, f"stages = {json.dumps(list(names))}\n".encode())

"""What a command may not write to: what it reads, and the files of a run."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from jaxdem.errors import InputError
from jaxdem.io.access import LOCK
from jaxdem.io.chain import CHAIN
from jaxdem.io.checkpoint import PARTS
from jaxdem.io.frames import PARTS_FOLDER
from jaxdem.io.pieces import PIECE
from jaxdem.io.probes import PROBES_FILE, PROBES_FOLDER
from jaxdem.io.run_folder import CHECKPOINT, HISTORY, SCENE, START
from jaxdem.io.samples import SampleFormat
from jaxdem.io.series import KINDS
from jaxdem.io.summary import SUMMARY
from jaxdem.io.wall_file import WALLS

FORMATS = (*(kind.format for kind in KINDS.values()), SampleFormat())
OWN_FILES = {SCENE, HISTORY, CHECKPOINT, START, SUMMARY, LOCK, PROBES_FILE, WALLS}
OWN_FILES |= {f"{one.stem}{one.suffix}" for one in FORMATS}
"""Names in a run directory that are the run's."""


def refuse_what_is_read(option: str, out: Path, inputs: Iterable[str | Path | None]) -> None:
    """Refuse an output that would replace an input or a file of a run.

    Args:
        option: what names the output.
        out: file to write.
        inputs: files that are read, and run directories; None is left out.

    Raises:
        InputError: `out` is one of them, is another name of one of them, or is a file of a run.
    """
    place = Path(os.path.realpath(out))
    of_probe = place.parent.name == PROBES_FOLDER and _is_run(place.parent.parent)
    own = place.name in OWN_FILES or PIECE.fullmatch(place.name) is not None
    hidden = {PARTS_FOLDER, PARTS} & set(place.parts)
    own = own and _is_run(place.parent)
    if hidden or of_probe or own or (place.name == CHAIN and place.is_file()):
        raise InputError(option, str(out), "is a file of a run, and would be lost", "Name another file.")
    for one in inputs:
        if one is not None and any(_same(found, out) for found in _files(Path(one))):
            raise InputError(option, str(out), "is what is read, and would be lost", "Name another file.")


def refuse_run_folder(option: str, out: Path) -> None:
    """Refuse a folder for results of several runs that is a run's own.

    Raises:
        InputError: it is a run directory.
    """
    if _is_run(out):
        remedy = f"Name another folder, for example {out / 'results'}."
        raise InputError(option, str(out), "is a run directory, which holds one run and nothing else", remedy)


def _is_run(folder: Path) -> bool:
    """Whether it holds a scene as run and a history, as a run directory does from its first second.

    A scene of that name by itself is none, nor is one beside results of several runs, whose folder has a lock too.
    False also for a name that is too long, which is refused later."""
    return all(os.path.isfile(folder / name) for name in (SCENE, HISTORY))


def _files(place: Path) -> Iterator[Path]:
    """The file itself; of a run directory its files."""
    if not place.is_dir():
        yield place
        return
    for folder in (place, place / PARTS_FOLDER, place / PROBES_FOLDER):
        if folder.is_dir():
            yield from folder.iterdir()


def _same(one: Path, other: Path) -> bool:
    """Whether two names are of one file, be it by a link of either kind."""
    try:
        return os.path.samefile(one, other)
    except OSError:
        return os.path.realpath(one) == os.path.realpath(other)

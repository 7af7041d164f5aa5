"""What a run directory holds, asked before anything is written to it: whether it is free, begun or complete, and of
which scene.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from jaxdem.errors import InputError
from jaxdem.files.durable import aside_names
from jaxdem.io import checkpoint as checkpoint_file
from jaxdem.io import scene_text
from jaxdem.io.access import LOCK, OPTION, input_errors, reason_of
from jaxdem.io.probes import PROBES_FOLDER
from jaxdem.io.summary import read_summary
from jaxdem.io.wall_file import WALLS

SCENE, HISTORY, CHECKPOINT = "scene.toml", "history.csv", "checkpoint.h5"
START = "start.h5"
"""State of another run that a run has begun from, in the form of a checkpoint."""


def require_usable(
    path: str | Path, scene_toml: str, resume: bool, defaults: Mapping[str, object] | None = None
) -> None:
    """Refuse what `RunDirectory.create`, or `resume`, would refuse for what is in a folder; nothing is made or changed.

    Raises:
        InputError: as these two; a complete run of the same scene may be resumed.
    """
    path = Path(path)
    scene_text.parse(scene_toml, "the scene given")
    with input_errors(path):
        if not resume:
            if path.exists() and entries(path):
                raise occupied(path)
            return
        if not ((path / CHECKPOINT).is_file() or just_begun(path) or is_complete(path)):
            limit = f"--resume needs {CHECKPOINT} in it, and there is none"
            raise InputError(OPTION, str(path), limit, "Start the run without --resume in an empty folder.")
    require_same_scene(path, scene_toml, defaults)


def is_complete(path: str | Path, scene_toml: str | None = None) -> bool:
    """Whether `path` holds a valid run that reached its end, and that of `scene_toml`: nothing to resume."""
    try:
        summary = read_summary(Path(path))
    except InputError:
        return False
    if summary.get("valid") is not True or summary.get("complete") is not True:
        return False
    return scene_toml is None or not is_longer(path, scene_toml)


def is_longer(path: str | Path, scene_toml: str) -> bool:
    """Whether a scene goes on beyond the end of the one that is stored in a folder."""
    place = Path(path) / SCENE
    stored = stored_scene(Path(path))
    return scene_text.end_of(scene_text.parse(scene_toml, "the scene given")) > scene_text.end_of(
        scene_text.parse(stored, str(place))
    )


def require_same_scene(path: str | Path, scene_toml: str, defaults: Mapping[str, object] | None = None) -> None:
    """Refuse to go on with another scene than the stored one; a later end is no other scene.

    See `scene_text.first_difference` for `defaults`.

    Raises:
        InputError: naming the first key that differs, or the stored scene cannot be read.
    """
    place = Path(path) / SCENE
    stored = scene_text.parse(stored_scene(Path(path)), str(place))
    given = scene_text.parse(scene_toml, "the scene given")
    ends = scene_text.end_of(stored), scene_text.end_of(given)
    if ends[1] > ends[0]:
        difference = scene_text.first_difference(
            scene_text.without_end(stored), scene_text.without_end(given), defaults
        )
    else:
        difference = scene_text.first_difference(stored, given, defaults)
    if difference is not None:
        key, before, after = difference
        limit = f"the run in {path} has {before!r}, and --resume only continues the same scene, to a later end at most"
        remedy = (
            f"Give {key} as stored in {place}, another {OPTION}, or a scene that begins from this run: [start] from"
        )
        raise InputError(key, after, limit, remedy)


def stored_scene(path: Path) -> str:
    """The text of the scene in a run directory.

    Raises:
        InputError: it cannot be read.
    """
    try:
        return scene_text.read(path / SCENE)
    except OSError as error:
        limit = f"its {SCENE} cannot be read ({reason_of(error)})"
        raise InputError(OPTION, str(path), limit, "Start the run anew in another folder.") from error


def entries(path: Path) -> set[str]:
    """Names in a folder, without the lock and without the scene that a kill left unfinished."""
    return {entry.name for entry in path.iterdir()} - {LOCK, *aside_names(path / SCENE)}


def just_begun(path: Path) -> bool:
    """Whether the folder holds what a run writes before its first checkpoint, and nothing else."""
    if not (path / SCENE).is_file():
        return False
    aside = (name for one in (HISTORY, START, CHECKPOINT) for name in aside_names(path / one))
    begun = {SCENE, HISTORY, START, WALLS, PROBES_FOLDER, checkpoint_file.PARTS, *aside}
    return entries(path) <= begun


def occupied(path: Path) -> InputError:
    """The refusal of a folder that is not empty."""
    if (path / CHECKPOINT).is_file() or just_begun(path):
        remedy = "Give another folder, or --resume to continue the run in it."
    else:
        remedy = "Give another folder, or empty this one (there is no checkpoint to --resume from)."
    return InputError(OPTION, str(path), "is not empty", remedy)

"""Studies: those at full size, and what may be asked for, which is checked without JAX."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from jaxdem.errors import InputError

STUDIES = ("injection",)
SCALES = ("demo", "paper")


def check_request(name: str, scale: str, out: Path, parts: Sequence[str], jobs: int | None) -> None:
    """Refuse a study that there is not, options that do not go together, and a folder that cannot be one.

    Args:
        name: of the study.
        scale: "demo" or "paper".
        out: its folder.
        parts: of the full size.
        jobs: processes at once of the full size.

    Raises:
        InputError: naming the argument or option.
    """
    for key, value, known in (("NAME", name, STUDIES), ("--scale", scale, SCALES)):
        if value not in known:
            raise InputError(key, value, "is not known", f"known: {', '.join(sorted(known))}")
    if scale == "demo" and (parts or jobs is not None):
        key, value = ("--parts", ",".join(parts)) if parts else ("--jobs", str(jobs))
        raise InputError(key, value, "is only used at full size", "Give --scale paper as well.")
    if jobs is not None and jobs < 0:
        raise InputError(
            "--jobs",
            jobs,
            "must be at least 1, or 0 for the tables of finished runs",
            "Leave it out to use one process per core.",
        )
    try:
        if out.exists() and not out.is_dir():
            raise InputError("--out", str(out), "is not a folder", "Name a folder.")
    except OSError as error:
        limit = f"cannot be written ({error.strerror})"
        raise InputError("--out", str(out), limit, "Choose another folder.") from None

"""The folder in which programs are kept between processes: as XLA compiled them, and as they were traced.

What is traced depends on code that a Python session may have replaced, so only the command line keeps programs.
"""

from __future__ import annotations

import hashlib
import os
import platform
from pathlib import Path

from jaxdem.run import exported

VARIABLE = "JAXDEM_CACHE"
"""Names the folder; empty, nothing is kept."""

LARGEST = 2**30
"""Size of the folder at which the programs that were not used for longest are deleted [B]."""


def use_program_cache() -> None:
    """Programs of this process are kept, and taken from where others left them."""
    import jax

    folder = cache_folder()
    if folder is None:
        jax.config.update("jax_enable_compilation_cache", False)
        return
    _delete_oldest(folder)
    exported.keep_in(folder / "traced")
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        jax.config.update("jax_compilation_cache_dir", str(folder / f"xla-{_processor()}"))
    # Small programs too: compiling one takes longer than reading it.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


def cache_folder() -> Path | None:
    """The folder, made if need be; None where none is wanted, or none can be made."""
    given = os.environ.get(VARIABLE)
    if given == "":
        return None
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(given or os.environ.get("JAX_COMPILATION_CACHE_DIR") or Path(base) / "jaxdem")
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


def _processor() -> str:
    """A name for the kind of processor: where a home is shared, a program of one may not run on another."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        text = "\n".join(sorted({line for line in lines if line.startswith(("model name", "flags", "Features"))}))
    except OSError:
        text = platform.processor()
    return hashlib.sha256(f"{platform.machine()} {text}".encode()).hexdigest()[:8]


def _delete_oldest(folder: Path) -> None:
    """Programs deleted, those not used for longest first, until half of `LARGEST` is left; nothing where it is less.

    Only what this module put there: a folder that somebody names may hold other files.
    """
    files = []
    for path in (*folder.glob("traced/*"), *folder.glob("xla-*/*")):
        try:
            if path.is_file():
                files.append((path.stat().st_atime, path.stat().st_size, path))
        except OSError:  # another process has deleted it
            continue
    size = sum(size for _, size, _ in files)
    if size <= LARGEST:
        return
    for _, one, path in sorted(files):
        path.unlink(missing_ok=True)
        size -= one
        if size <= LARGEST // 2:
            return

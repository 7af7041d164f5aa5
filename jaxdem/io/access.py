"""Who may write to a run directory, and what a disk that refuses is called."""

from __future__ import annotations

import errno
import fcntl
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from jaxdem.errors import InputError
from jaxdem.files.durable import remove_leftovers

OPTION = "--out"
LOCK = ".lock"


def acquire_lock(path: Path) -> int:
    """Lock the folder for this process; the system frees it when the process ends, however it ends.

    Returns:
        An open file descriptor; closing it releases the lock.

    Raises:
        InputError: another process has the lock, or the folder cannot be written.
    """
    with input_errors(path):
        descriptor = os.open(path / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
    except BlockingIOError as error:
        owner = os.pread(descriptor, 32, 0).decode(errors="replace").strip()
        os.close(descriptor)
        limit = f"another run (process {owner}) is writing to it"
        raise InputError(OPTION, str(path), limit, "Wait for it, stop it, or give another folder.") from error
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP):
            os.close(descriptor)
            raise unwritable(path, error) from error
        warnings.warn(f"{path}: this file system has no locks; start only one run here", stacklevel=3)
    return descriptor


def still_locked(path: Path, descriptor: int) -> bool:
    """Whether the folder at `path` is the one that was locked, and not another that has taken its place."""
    try:
        found = os.stat(path / LOCK)
    except OSError:
        return False
    return os.path.samestat(found, os.fstat(descriptor))


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """The folder, made if missing, for the files of this process alone; what a killed one left half written is removed.

    Raises:
        InputError: another process has the lock, or the folder cannot be written.
    """
    with input_errors(path):
        path.mkdir(parents=True, exist_ok=True)
    descriptor = acquire_lock(path)
    try:
        remove_leftovers(path)
        yield
    finally:
        os.close(descriptor)


@contextmanager
def input_errors(path: Path) -> Iterator[None]:
    """What the disk refuses before a run has started is a wrong `--out`."""
    try:
        yield
    except OSError as error:
        raise unwritable(path, error) from error


def unwritable(path: Path, error: OSError) -> InputError:
    """The folder `path` cannot be made or written."""
    remedy = "Give a folder that can be made and written to, on a disk with room."
    return InputError(OPTION, str(path), f"cannot be written ({reason_of(error)})", remedy)


def reason_of(error: BaseException) -> str:
    """The reason alone, in one line, without the path that OSError repeats."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error).splitlines()[0] if str(error) else type(error).__name__

"""The process of the command line: its signals, its standard streams, and how it ends.

Nothing beyond Python's own library is imported here, so that signals are handled before the rest is loaded.
"""

from __future__ import annotations

import contextlib
import gc
import io
import os
import select
import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any, NoReturn

BROKEN_PIPE = 128 + signal.SIGPIPE
"""Exit code where who read the output has gone: what a shell reports of a program that SIGPIPE ends."""

GRACE = 0.5
"""Time to clean up after a signal at which nothing is to be saved, or after a second one [s]."""

PATIENCE = 1.0
"""A program that saves its work for longer says so after this time [s]."""

LAUNCHED = "JAXDEM_LAUNCHED"
"""Variable of a process that `--processes` has started (`jaxdem.cli.cluster`): a file for what libraries write to
standard error."""

SAVING = "jaxdem: the run stops after this coupling interval and writes a checkpoint; a second signal ends it at once\n"


def run(commands: Callable[[], Any]) -> NoReturn:
    """Runs the command line, and ends the process with its exit code.

    SIGINT and SIGTERM raise `SystemExit(128 + number)` in the main thread wherever a run does not handle them. Code
    outside Python, such as a compiler, holds that up: after `GRACE` the process ends without it.
    """
    _open_closed_streams()
    if LAUNCHED in os.environ:
        _follow_launcher(os.environ[LAUNCHED])
    # Loading and tracing make objects by the million, nearly all of which are kept: looking through them takes a tenth
    # of a start.
    gc.set_threshold(100_000, 50, 50)
    report = sys.unraisablehook
    # Raised in a destructor the exit is lost; `_watch` ends the process then.
    sys.unraisablehook = lambda lost: None if lost.exc_type is SystemExit else report(lost)
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _stop)
    signal.set_wakeup_fd(writer)
    threading.Thread(target=_watch, args=(reader,), daemon=True).start()
    try:
        commands()
        code: Any = 0
    except SystemExit as end:
        code = 0 if end.code is None else end.code
    except BrokenPipeError:
        code = BROKEN_PIPE
    code = _flush(code)
    if isinstance(code, int) and (code > 128 or (code and _leaves_at_once)):
        # Python would wait for a compiler that is still at work in a thread, and JAX for processes that have ended.
        os._exit(code)
    sys.exit(code)


_messages = 2
"""Where a message past the buffer of standard error goes."""

_leaves_at_once = False


def leave_at_once() -> None:
    """An end with an error does not wait for other processes of the run."""
    global _leaves_at_once
    _leaves_at_once = True


def be_silent() -> None:
    """Another process of the run tells that it is saved."""
    global _messages
    _messages = os.open(os.devnull, os.O_WRONLY)


class _NoTerminal(io.TextIOWrapper):
    """mpirun gives a process a terminal of its own, and what is shown there may go into a file: no bars."""

    def isatty(self) -> bool:
        """Never."""
        return False


def divert_libraries(target: int, of_launcher: bool = False) -> None:
    """What libraries write past Python goes to a file descriptor; what Python writes goes where it went before.

    Args:
        target: which is closed.
        of_launcher: whether standard output belongs to a launcher, such as mpirun, and not to a person.
    """
    global _messages
    shown, messages = os.dup(1), os.dup(2)
    if _messages == 2:  # not silent
        _messages = messages
    for number in (1, 2):
        os.dup2(target, number)
    os.close(target)
    sys.stdout = os.fdopen(shown, "w", buffering=1, closefd=False)
    if of_launcher:
        sys.stdout = _NoTerminal(sys.stdout.detach(), line_buffering=True)
    sys.stderr = os.fdopen(messages, "w", buffering=1, closefd=False)


def _follow_launcher(log: str) -> None:
    """What libraries write past Python goes into a file; the process ends with the launcher.

    Standard input is a pipe that the launcher never writes to: it ends when the launcher does.
    """
    divert_libraries(os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600))

    def wait() -> None:
        with contextlib.suppress(OSError):
            os.read(0, 1)
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, daemon=True).start()


def _stop(number: int, _: FrameType | None) -> NoReturn:
    raise SystemExit(128 + number)


def _watch(reader: int) -> None:
    """Sees every signal at once, also while the main thread is outside Python."""
    first = True
    while True:
        for number in os.read(reader, 1):
            if number not in (signal.SIGINT, signal.SIGTERM):
                continue
            saved_by_run = first and signal.getsignal(number) is not _stop
            first = False
            if select.select([reader], [], [], PATIENCE if saved_by_run else GRACE)[0] and saved_by_run:
                continue
            if not saved_by_run:
                end(128 + number)
            _say(SAVING)


def end(code: int) -> NoReturn:
    """Ends the process from a thread; a progress bar has hidden the cursor."""
    if sys.stdout.isatty():
        _say("\x1b[?25h\n")
    os._exit(code)


def _say(text: str) -> None:
    """To standard error past its buffer, whose lock the main thread may hold."""
    with contextlib.suppress(OSError):  # nobody listens
        os.write(_messages, text.encode())


def _flush(code: Any) -> Any:
    """The exit code, after all output is written; another one where nobody reads it."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except BrokenPipeError:
            # Python flushes once more at its end, and would report the same.
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
            code = BROKEN_PIPE if code == 0 else code
    return code


def _open_closed_streams() -> None:
    """Standard streams that are closed lead nowhere: otherwise the next file to be opened would get their number."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free: this one
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "r" if number == 0 else "w", closefd=False))

"""SIGINT and SIGTERM while a run writes: noted until there is a checkpoint, and not held up by the compiler."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType
from typing import TypeVar

Result = TypeVar("Result")
Handler = Callable[[int, FrameType | None], object] | int | None

POLL = 0.1
"""How often work in a thread is looked after [s]."""


class Stopped(Exception):
    """A signal came; what is under way is not needed."""


class Caught(list[int]):
    """Signals that came, by number."""

    _raises = False

    def note(self, number: int) -> None:
        """Takes down a signal."""
        self.append(number)
        if self._raises:
            raise Stopped

    @contextlib.contextmanager
    def raised(self) -> Iterator[None]:
        """For work that is not needed once a signal has come: that signal raises `Stopped`, one before the work too.

        Python loses an exception that is raised in a destructor or a callback of its garbage collector, and reports it:
        not this one, which `wait_for` and the end of the block raise again.
        """
        report = sys.unraisablehook
        self._raise()
        self._raises = True
        sys.unraisablehook = lambda lost: None if lost.exc_type is Stopped else report(lost)
        try:
            yield
            self._raise()
        finally:
            self._raises = False
            sys.unraisablehook = report

    def wait_for(self, work: Callable[[], Result]) -> Result:
        """What the work gives, done in a thread: a signal is not held up by work outside Python, such as compiling.

        Work that is given up goes on in its thread to its end.
        """
        results: list[Result] = []
        errors: list[BaseException] = []

        def do() -> None:
            try:
                results.append(work())
            except BaseException as error:
                errors.append(error)

        thread = threading.Thread(target=do, daemon=True)
        thread.start()
        while thread.is_alive():
            thread.join(POLL)
            self._raise()
        if errors:
            raise errors[0]
        return results[0]

    def _raise(self) -> None:
        if self:
            raise Stopped


@contextlib.contextmanager
def noted_signals() -> Iterator[Caught]:
    """SIGINT and SIGTERM noted in a list; a second one acts as usual."""
    caught = Caught()
    previous: dict[int, Handler] = {}

    def note(number: int, frame: FrameType | None) -> None:
        handler = previous[number]
        if caught and callable(handler):
            handler(number, frame)
        elif caught:
            signal.signal(number, handler)
            signal.raise_signal(number)
        caught.note(number)

    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            previous[number] = signal.getsignal(number)
            signal.signal(number, note)
    except ValueError:  # not the main thread: the caller handles signals
        yield caught
        return
    try:
        yield caught
    finally:
        for caught_by, handler in previous.items():
            signal.signal(caught_by, handler)

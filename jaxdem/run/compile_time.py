"""How long JAX has traced, lowered and compiled, or loaded programs from its cache, in this process."""

from __future__ import annotations

import functools
import time as clock

import jax

EVENTS = "/jax/core/compile/"
"""What the names of the events begin with by which JAX reports tracing, lowering, and compiling or loading."""


class CompileClock:
    """Length of the union of time spans that are told in the order of their ends, so that nested ones count once.

    Attributes:
        total: [s].
    """

    def __init__(self) -> None:
        self.total = 0.0
        self._spans: list[tuple[float, float]] = []

    def add(self, begin: float, end: float) -> None:
        """A span from `begin` to `end` [s]."""
        while self._spans and self._spans[-1][0] >= begin:
            inner = self._spans.pop()
            self.total -= inner[1] - inner[0]
        if self._spans:
            begin = max(begin, self._spans[-1][1])
        self._spans.append((begin, end))
        self.total += end - begin


@functools.cache
def compile_clock() -> CompileClock:
    """The clock of this process; it runs from the first call on."""
    watch = CompileClock()

    def hear(event: str, duration_secs: float, **_: str | int) -> None:
        if event.startswith(EVENTS):
            now = clock.perf_counter()
            watch.add(now - duration_secs, now)

    jax.monitoring.register_event_duration_secs_listener(hear)
    return watch

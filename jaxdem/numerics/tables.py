"""Values that a scene gives at several times, and spans of time."""

from __future__ import annotations

import math

import jax.numpy as jnp
from jax import Array

from jaxdem.numerics.static import static


def at_time(times: tuple[float, ...] | None, values: Array, time: Array) -> Array:
    """(D,) values at a time: linear between the times of a table, constant before the first and after the last.

    Args:
        times: T of them, increasing [s]; None for values that do not change.
        values: (T, D), or (D,) without times.
        time: () [s].
    """
    if times is None:
        return values
    given = jnp.asarray(times, values.dtype)
    return jnp.stack([jnp.interp(time, given, column) for column in values.T])


def largest_between(times: tuple[float, ...] | None, values: Array, start: Array, stop: Array) -> Array:
    """() largest size of a value between two times, see `at_time`.

    Args:
        times: T of them, increasing [s]; None for a value that does not change.
        values: (T,), or () without times.
        start, stop: () [s].
    """
    size = jnp.abs(values)
    if times is None:
        return size
    given = jnp.asarray(times, values.dtype)
    passed = jnp.max(jnp.where((given >= start) & (given <= stop), size, 0.0))
    ends = [jnp.abs(at_time(times, values[:, None], time)[0]) for time in (start, stop)]
    return jnp.maximum(passed, jnp.maximum(*ends))


def mean_over(times: tuple[float, ...] | None, values: Array, start: Array, duration: Array) -> Array:
    """(D,) mean of `at_time` over a span of time: times the duration it is the integral, to rounding.

    The table is linear in each of its pieces, so the mean over the part of a piece that lies in the span is the value
    in the middle of that part.

    Args:
        times: T of them, increasing [s]; None for values that do not change.
        values: (T, D), or (D,) without times.
        start: () of the span [s].
        duration: () of the span, positive [s].
    """
    if times is None:
        return values
    dtype = values.dtype
    # From the start of the span: differences of late times would lose their digits.
    edges = jnp.asarray(times, dtype) - start
    edges = jnp.concatenate([jnp.zeros(1, dtype), jnp.clip(edges, 0.0, duration), jnp.reshape(duration, 1)])
    parts, middles = jnp.diff(edges), 0.5 * (edges[1:] + edges[:-1])
    rows = [part * at_time(times, values, start + middle) for part, middle in zip(parts, middles, strict=True)]
    return sum(rows[1:], rows[0]) / duration


@static
class Window:
    """A span of time in which something is there, on the steps of a loop; static.

    A step counts with its middle, so the window begins and ends with the steps that begin nearest to its ends.

    Attributes:
        begin: [s].
        end: [s].
    """

    begin: float = 0.0
    end: float = math.inf

    @property
    def is_always(self) -> bool:
        """Whether it holds at all times of a run."""
        return self == Window()

    def holds(self, middle: Array | float) -> Array | bool:
        """Whether it holds in a step; () bool.

        Args:
            middle: time in the middle of the step [s].
        """
        return (middle >= self.begin) & (middle < self.end)

    def meets(self, other: Window) -> bool:
        """Whether there is a time in both."""
        return self.begin < other.end and other.begin < self.end

"""When the walls beside the sides of the box are there: a gate that is opened, a lid that is put on."""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.numerics.static import static
from jaxdem.numerics.tables import Window


@static
class WallTimes:
    """When each of W surfaces is there; static.

    Attributes:
        windows: of each surface.
        maximum_overlap: with grains, over their diameter, at which a wall may come [-].
    """

    windows: tuple[Window, ...]
    maximum_overlap: float

    @property
    def changes(self) -> tuple[float, ...]:
        """Times at which a surface comes or vanishes, increasing [s]."""
        ends = {end for window in self.windows for end in (window.begin, window.end)}
        return tuple(sorted(ends - {Window().begin, Window().end}))

    @property
    def phases(self) -> tuple[tuple[int, ...], ...]:
        """Numbers of the surfaces that are there before the first change, after it, after the second ..."""
        starts = (Window().begin, *self.changes)
        return tuple(tuple(k for k, w in enumerate(self.windows) if w.holds(start)) for start in starts)

    def phase(self, middle: Array) -> Array:
        """() int32, number of the phase of an interval with this middle [s]."""
        changes = jnp.asarray(self.changes, middle.dtype)
        return jnp.sum((changes <= middle).astype(jnp.int32))

    def present(self, middle: Array) -> Array:
        """(W,) bool, which surfaces are there in an interval with this middle [s]."""
        table = [[k in phase for k in range(len(self.windows))] for phase in self.phases]
        return jnp.asarray(np.asarray(table))[self.phase(middle)]

    def held(self, time: float) -> WallTimes:
        """The same with the walls of one time [s] at all times."""
        windows = tuple(Window() if window.holds(time) else Window(begin=Window().end) for window in self.windows)
        return WallTimes(windows, self.maximum_overlap)


@static
class WallInTime:
    """A wall given as a function that is there for a part of the time; for `walls` of `jaxdem.build`.

    Attributes:
        distance: x (D,) [m] -> () [m], positive where particles may be; in JAX's functions.
        begin: it is there from then on [s].
        end: and until then [s].
    """

    distance: Callable[[Array], Array]
    begin: float = Window().begin
    end: float = Window().end

    def __call__(self, x: Array) -> Array:
        """The signed distance [m]."""
        return self.distance(x)

"""What every probe is: the values that it takes from an interval, how they are averaged, and the columns of its
file."""

from __future__ import annotations

import abc
import dataclasses
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from jax import Array
from jax.typing import DTypeLike

from jaxdem.numerics.host import on_device
from jaxdem.numerics.static import static
from jaxdem.particles.neighbors import Neighbors
from jaxdem.state import Diagnostics, Parameters, State
from jaxdem.structure import Structure


@static
class Column:
    """A quantity of a probe; static.

    Attributes:
        name: in the files.
        unit: of SI; "-" for a number.
        total: the sum over the measurements between two rows is written, and not their mean.
        shape: of what is measured in each row, such as (D,) of a vector; what is written has a column for each number.
    """

    name: str
    unit: str
    total: bool = False
    shape: tuple[int, ...] = ()


class Interval(NamedTuple):
    """A coupling interval as a probe sees it.

    Attributes:
        before, after: states at its start and at its end, after particles have left and come.
        neighbors: list of `after`; None without particles.
        diagnostics: of the step.
    """

    before: State
    after: State
    neighbors: Neighbors | None
    diagnostics: Diagnostics

    @property
    def moved(self) -> State:
        """`after` with the particles in the rows of `before`, which on several devices they may have left."""
        places, particles = self.diagnostics.places, self.before.particles
        if places is None or particles is None:
            return self.after
        return self.after._replace(particles=particles._replace(**places._asdict()))


class Probe(abc.ABC):
    """A probe: a `@static` class with a `name`. A kind implements `columns` and `measure`, and the rest where it needs
    it.

    On several devices `measure` is called for every slab, within `shard_map`. It gives what there is in the whole box,
    the same in all of them; a probe that `SELECTS` gives the rows of the slab.

    A measurement is one value of every measured quantity in each of `rows` rows. What is written is their mean over the
    measurements since the last row of the file, and what `values` makes of it.
    """

    name: str
    NUMBERS: ClassVar[tuple[str, ...]] = ()
    """Fields that are traced: floats, or tuples of them. Other numbers in them make no other program."""
    SELECTS: ClassVar[bool] = False
    """Whether only some rows of a measurement are `written`, all as they are at one time: nothing of them is averaged.
    Such a probe has no `places`, and its `values` are what it measures."""

    @property
    @abc.abstractmethod
    def columns(self) -> tuple[Column, ...]:
        """What it writes, after the time and `places`."""

    @property
    def measured(self) -> tuple[Column, ...]:
        """What it measures and averages: `columns` unless these follow from it by `values`."""
        return self.columns

    @property
    def places(self) -> tuple[tuple[Column, np.ndarray], ...]:
        """Columns that never change, (R,) each, such as the position of each of R rows; none for a single row."""
        return ()

    def rows(self, state: State, neighbors: Neighbors | None) -> int:
        """Number R of rows of a measurement."""
        return len(self.places[0][1]) if self.places else 1

    @abc.abstractmethod
    def measure(self, structure: Structure, parameters: Parameters, interval: Interval) -> dict[str, Array]:
        """`measured` by name, (R, *shape) each; pure. No NaN where it is averaged: a mean over nothing belongs into
        `values`."""

    def values(self, means: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """`columns` by name, a number each row, from the means of `measured`, float64; on the host. NaN leaves a field
        empty. The rows are those of several times, or those of one that are `written`."""
        return means

    def written(self, means: dict[str, np.ndarray]) -> np.ndarray:
        """Of a probe that `SELECTS`, numbers of the rows that are written, in their order."""
        raise NotImplementedError

    def numbers(self, dtype: DTypeLike) -> dict[str, Array]:
        """The fields in `NUMBERS` that are not None, as arrays."""
        given = {name: getattr(self, name) for name in self.NUMBERS}
        return {name: on_device(value, dtype) for name, value in given.items() if value is not None}

    def with_numbers(self, numbers: dict[str, Any]) -> Self:
        """The probe with traced numbers; it must not be hashed or compared then."""
        return dataclasses.replace(self, **numbers)  # type: ignore[type-var]


@static
class Schedule:
    """When a probe measures and writes, counted in coupling intervals; static.

    Attributes:
        first: intervals after which it begins; it sees nothing of what was before.
        every: from one row to the next.
        window: last intervals of these in which it measures; 1 for the state at the time of the row alone.
        sample: from one measurement to the next within the window; the last is at the row.
    """

    first: int
    every: int
    window: int
    sample: int


@static
class ScheduledProbe:
    """A probe and when it measures; static."""

    probe: Probe
    schedule: Schedule

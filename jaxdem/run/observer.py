"""The probes of a run on the host: what they have summed, the rows that are due, and their files."""

from __future__ import annotations

import dataclasses
import json
import time as clock
from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax
import numpy as np
from jax.typing import DTypeLike

from jaxdem.errors import InputError
from jaxdem.io import RunDirectory
from jaxdem.particles.neighbors import Neighbors
from jaxdem.probes.base import Probe, ScheduledProbe
from jaxdem.probes.wall import WallProbe
from jaxdem.run.chunk import CHUNK
from jaxdem.run.probing import (
    Memory,
    Probed,
    Rows,
    Watch,
    empty_memory,
    measured_numbers,
    probing_of,
    rows_held,
    unpacked,
)
from jaxdem.setup.builder import Case
from jaxdem.setup.start_point import StartPoint, walls_of
from jaxdem.state import State

PROBES = "probes"
"""Attribute of a checkpoint with `probe_marks`."""

PENDING = 200_000
"""Most numbers that wait to be written together."""

LONGEST = 1.0
"""What has waited so long is written at the next output [s]: a few lines at a time take long for what they are."""


class _Waiting(NamedTuple):
    """What is still to be written of a probe.

    Attributes:
        times: (T,) of the rows; of a probe that `SELECTS` (L,) of the lines [s].
        numbers: (T, K) what was measured; of such a probe (L, C) the lines.
    """

    times: np.ndarray
    numbers: np.ndarray


class _Sheet(NamedTuple):
    """What the lines of a probe are made of.

    Attributes:
        probe: the probe.
        columns: names of what it writes.
        places: columns that never change, (R,) each.
    """

    probe: Probe
    columns: tuple[str, ...]
    places: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, probe: Probe) -> _Sheet:
        """Of a probe."""
        columns = tuple(column.name for column in probe.columns)
        return cls(probe, columns, tuple(place for _, place in probe.places))

    def kept(self, times: np.ndarray, numbers: np.ndarray) -> _Waiting:
        """What is kept of (T, K) numbers that were measured at T times."""
        if not self.probe.SELECTS:
            return _Waiting(times, numbers)
        tables = []
        for one in numbers:
            values = unpacked(self.probe, one[None])
            written = self.probe.written(values)
            tables.append(np.stack([values[name][written] for name in self.columns], axis=1))
        return _Waiting(np.repeat(times, [len(table) for table in tables]), np.concatenate(tables))

    def lines(self, waiting: _Waiting) -> tuple[np.ndarray, np.ndarray]:
        """Time and places (L, P) of all lines, and the columns of the probe (L, C) in the precision of the run."""
        times, numbers = waiting
        if self.probe.SELECTS:
            return times[:, None], numbers
        means = {name: array.astype(np.float64) for name, array in unpacked(self.probe, numbers).items()}
        values, places = self.probe.values(means), [np.tile(place, len(times)) for place in self.places]
        columns = [values[name] for name in self.columns]
        leading = [np.repeat(times, len(columns[0]) // len(times)), *places]
        return np.stack(leading, axis=1), np.stack(columns, axis=1).astype(numbers.dtype)


@dataclasses.dataclass
class Observer:
    """The probes of a run.

    Attributes:
        scheduled: the probes.
        watch: as an argument of the program of a chunk; None without probes.
    """

    scheduled: tuple[ScheduledProbe, ...]
    watch: Watch | None = None

    def __post_init__(self) -> None:
        self._pending: dict[str, list[_Waiting]] = {one.probe.name: [] for one in self.scheduled}
        self._sheets = tuple(_Sheet.of(one.probe) for one in self.scheduled)
        self._written = clock.monotonic()
        self._single: tuple[bool, ...] = ()  # whether a chunk keeps one row of each

    def fit(self, state: State, neighbors: Neighbors | None, dtype: DTypeLike) -> None:
        """Makes the memories, or those anew whose shape is that of a neighbour list that has changed.

        Such a list is written as it is at one time, and nothing of it is summed.
        """
        if not self.scheduled:
            return
        probing = probing_of(self.scheduled, dtype) if self.watch is None else self.watch.probing
        fresh = tuple(empty_memory(one.probe, state, neighbors, dtype) for one in self.scheduled)
        kept = fresh if self.watch is None else self.watch.memory
        memory = tuple(a if _shapes(a) == _shapes(b) else b for a, b in zip(kept, fresh, strict=True))
        numbers = (measured_numbers(one.probe, state, neighbors) for one in self.scheduled)
        self._single = tuple(rows_held(count, CHUNK) < CHUNK for count in numbers)
        self.watch = Watch(probing, memory)

    def next_stop(self, step: int) -> int | None:
        """Number of intervals up to which a chunk may go: the next row of a probe of which it keeps one; None for
        all."""
        stops = []
        for one, single in zip(self.scheduled, self._single, strict=True) if self.watch is not None else ():
            if single:
                plan = one.schedule
                stops.append(plan.first + (max(step - plan.first, 0) // plan.every + 1) * plan.every)
        return min(stops, default=None)

    def take(self, probed: Probed, time: Callable[[int], float], selected: Callable[[Probe, Rows], Rows]) -> None:
        """The rows of a chunk, whose sums the next one goes on with.

        Args:
            probed: of the chunk.
            time: of a number of intervals [s].
            selected: gives the rows of a probe that `SELECTS`, of the whole box.
        """
        if self.watch is None:
            return
        self.watch = self.watch._replace(memory=probed.memory)
        for sheet, rows in zip(self._sheets, probed.rows, strict=True):
            count = int(rows.number)
            if not count:
                continue
            if sheet.probe.SELECTS:
                rows = selected(sheet.probe, rows)
            step, values = jax.device_get((rows.step, rows.values))
            times = np.array([time(int(each)) for each in step[:count]])
            self._pending[sheet.probe.name].append(sheet.kept(times, values[:count]))

    def write(self, directory: RunDirectory, time: float, always: bool = True) -> None:
        """What waits goes into the files.

        Args:
            directory: of the run.
            time: simulated time [s].
            always: also where it is little, and has not waited for long.
        """
        size = sum(one.numbers.size for waiting in self._pending.values() for one in waiting)
        if not always and size < PENDING and clock.monotonic() - self._written < LONGEST:
            return
        self._written = clock.monotonic()
        for sheet in self._sheets:
            waiting = self._pending[sheet.probe.name]
            if waiting:
                together = _Waiting(*(np.concatenate(arrays) for arrays in zip(*waiting, strict=True)))
                directory.write_probe(sheet.probe.name, time, *sheet.lines(together))
                waiting.clear()

    def save(self) -> dict[str, np.ndarray]:
        """The memories as arrays of a checkpoint."""
        found: dict[str, np.ndarray] = {}
        for one, memory in zip(self.scheduled, () if self.watch is None else self.watch.memory, strict=False):
            leaves = jax.tree_util.tree_flatten_with_path(memory)[0]
            found |= {_key(one, path): np.asarray(leaf) for path, leaf in leaves}
        return found

    def go_on(self, start: StartPoint, marks: Mapping[str, str]) -> None:
        """Takes over what the run before has summed since its last rows, of the probes that go on as they were.

        Args:
            start: where that run had got to.
            marks: `probe_marks` of this run.
        """
        if self.watch is None or PROBES not in start.attributes:
            return
        before: dict[str, str] = json.loads(str(start.attributes[PROBES]))
        memory = []
        for one, blank in zip(self.scheduled, self.watch.memory, strict=True):
            name = one.probe.name
            paths, tree = jax.tree_util.tree_flatten_with_path(blank)
            kept = [start.arrays.get(_key(one, path)) for path, _ in paths]
            fits = all(
                old is not None and old.shape == new.shape and old.dtype == new.dtype
                for old, (_, new) in zip(kept, paths, strict=True)
            )
            goes_on = fits and before.get(name) == marks[name]
            memory.append(jax.tree.unflatten(tree, [jax.device_put(array) for array in kept]) if goes_on else blank)
        self.watch = self.watch._replace(memory=tuple(memory))

    def load(self, arrays: Mapping[str, np.ndarray]) -> None:
        """The inverse of `save`, for memories that `fit` has made.

        Raises:
            InputError: an array is missing or has another shape.
        """
        if self.watch is None:
            return
        memory = tuple(
            jax.tree_util.tree_map_with_path(lambda path, leaf, one=one: _stored(arrays, _key(one, path), leaf), blank)
            for one, blank in zip(self.scheduled, self.watch.memory, strict=True)
        )
        self.watch = self.watch._replace(memory=memory)


def probe_marks(case: Case) -> dict[str, str]:
    """By name of the probe, what it measures and when: in a run that begins from another one with the same mark the
    sums of that one go on.

    The mark has the probe, the coupling interval, the clock that its intervals are counted on, and how many grains a
    particle stands for. Of a wall of the scene its number is not enough.
    """
    simulation = case.simulation
    walls = walls_of(case.scene, simulation)
    ratio = 1.0 if case.scene.particles is None else case.scene.particles.coarse_grain
    shared = f"{simulation.interval!r} {simulation.clock!r} {ratio!r}"
    return {
        one.probe.name: f"{one!r} {shared}" + (f" {walls}" if isinstance(one.probe, WallProbe) else "")
        for one in case.probes
    }


def columns_of(scheduled: tuple[ScheduledProbe, ...]) -> dict[str, tuple[tuple[str, str], ...]]:
    """By name of the probe, name and unit of every column of its file."""
    found = {}
    for one in scheduled:
        columns = (*(column for column, _ in one.probe.places), *one.probe.columns)
        found[one.probe.name] = (("time", "s"), *((column.name, column.unit) for column in columns))
    return found


def _shapes(memory: Memory) -> list[tuple[int, ...]]:
    return [leaf.shape for leaf in jax.tree.leaves(memory)]


def _key(one: ScheduledProbe, path: tuple[object, ...]) -> str:
    return f"probes/{one.probe.name}{jax.tree_util.keystr(path)}"


def _stored(arrays: Mapping[str, np.ndarray], name: str, leaf: jax.Array) -> jax.Array:
    value = arrays.get(name)
    if value is None or value.shape != leaf.shape or value.dtype != leaf.dtype:
        limit = "is missing or has another shape"
        raise InputError("checkpoint.h5", name, limit, "resume with the scene and version that wrote the checkpoint")
    return jax.device_put(value)

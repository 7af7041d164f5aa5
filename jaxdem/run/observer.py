"""The probes of a run on the host: what they have summed, the rows that are due, and their files."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping

import jax
import numpy as np
from jax.typing import DTypeLike

from jaxdem.errors import InputError
from jaxdem.io import RunDirectory
from jaxdem.particles.neighbors import Neighbors
from jaxdem.probes.base import ScheduledProbe
from jaxdem.probes.wall import WallProbe
from jaxdem.run.chunk import CHUNK
from jaxdem.run.probing import Memory, Probed, Watch, empty_memory, probing_of, rows_held, unpacked
from jaxdem.setup.builder import Case
from jaxdem.setup.start_point import StartPoint, walls_of
from jaxdem.state import State

PROBES = "probes"
"""Attribute of a checkpoint with `probe_marks`."""

PENDING = 200_000
"""Numbers that wait for the next output before they are written at once."""


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
        self._pending: dict[str, list[np.ndarray]] = {one.probe.name: [] for one in self.scheduled}

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
        self.watch = Watch(probing, memory)

    def next_stop(self, step: int) -> int | None:
        """Number of intervals up to which a chunk may go: the next row of a probe of which it keeps one; None for
        all."""
        stops = []
        for one, memory in zip(self.scheduled, () if self.watch is None else self.watch.memory, strict=False):
            if rows_held(memory, CHUNK) < CHUNK:
                plan = one.schedule
                stops.append(plan.first + (max(step - plan.first, 0) // plan.every + 1) * plan.every)
        return min(stops, default=None)

    def take(self, probed: Probed, time: Callable[[int], float]) -> None:
        """The rows of a chunk, whose sums the next one goes on with.

        Args:
            probed: of the chunk.
            time: of a number of intervals [s].
        """
        if self.watch is None:
            return
        self.watch = self.watch._replace(memory=probed.memory)
        for one, rows in zip(self.scheduled, probed.rows, strict=True):
            count = int(rows.number)
            if not count:
                continue
            step, values = jax.device_get((rows.step, rows.values))
            for k in range(count):
                means = unpacked(one.probe, np.asarray(values[k], np.float64))
                self._pending[one.probe.name].append(_table(one, time(int(step[k])), means))

    def write(self, directory: RunDirectory, time: float, always: bool = True) -> None:
        """What waits goes into the files.

        Args:
            directory: of the run.
            time: simulated time [s].
            always: also where it is little.
        """
        if not always and sum(table.size for tables in self._pending.values() for table in tables) < PENDING:
            return
        for name, tables in self._pending.items():
            if tables:
                directory.write_probe(name, time, np.concatenate(tables))
                tables.clear()

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


def _table(one: ScheduledProbe, time: float, means: dict[str, np.ndarray]) -> np.ndarray:
    """(R, number of columns) lines of the file."""
    values, written = one.probe.values(means), one.probe.written(means)
    columns = [place for _, place in one.probe.places] + [values[column.name] for column in one.probe.columns]
    size = len(columns[0])
    return np.stack([np.full(size, time), *columns], axis=1)[written]


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

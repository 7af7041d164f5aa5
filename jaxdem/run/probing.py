"""Probes inside the compiled chunk of intervals: when they measure, their sums, and the rows that are due."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import DTypeLike

from jaxdem.numerics import compensated
from jaxdem.numerics.compensated import Low
from jaxdem.numerics.host import on_device
from jaxdem.particles.neighbors import Neighbors
from jaxdem.probes.base import Interval, Probe, ScheduledProbe
from jaxdem.state import Parameters, State
from jaxdem.structure import Structure

MOST_HELD = 1 << 17
"""Numbers of the rows that a chunk keeps for each probe; of one with more it keeps one row, and the host looks at
it."""


class Timing(NamedTuple):
    """`Schedule` as numbers of the program; all () int32."""

    first: Array
    every: Array
    window: Array
    sample: Array


class Memory(NamedTuple):
    """What a probe has summed since its last row; part of a checkpoint.

    All numbers of a measurement stand one behind the other, K of them: one operation for all, see `packed`. A probe
    that `SELECTS` its rows has none here: it measures at the time of a row, and that is the row.

    Attributes:
        sums: (K,) leading part.
        low: (K,) trailing part, see `numerics.compensated`; None in float64.
        samples: () int32, number of measurements.
    """

    sums: Array
    low: Low
    samples: Array


class Rows(NamedTuple):
    """Rows that became due in a chunk.

    Attributes:
        values: (M, K), see `Memory`.
        step: (M,) int32, `State.step` at the row.
        number: () int32, of them.
    """

    values: Array
    step: Array
    number: Array


class Probed(NamedTuple):
    """What the probes of a chunk have found, one entry a probe."""

    memory: tuple[Memory, ...]
    rows: tuple[Rows, ...]


class Probing(NamedTuple):
    """The probes of a program: static descriptions, and their numbers and timing, which are traced."""

    probes: tuple[Probe, ...]
    numbers: tuple[dict[str, Array], ...]
    timing: tuple[Timing, ...]


class Watch(NamedTuple):
    """Probes as an argument of the program of a chunk, with what they have summed before."""

    probing: Probing
    memory: tuple[Memory, ...]


def probing_of(scheduled: tuple[ScheduledProbe, ...], dtype: DTypeLike) -> Probing:
    """Arguments of the program of a run with these probes."""
    timing = []
    for one in scheduled:
        plan = one.schedule
        whole = (on_device(n, np.int32) for n in (plan.first, plan.every, plan.window, plan.sample))
        timing.append(Timing(*whole))
    blank = tuple(one.probe.with_numbers(dict.fromkeys(one.probe.NUMBERS)) for one in scheduled)
    return Probing(blank, tuple(one.probe.numbers(dtype) for one in scheduled), tuple(timing))


def measured_numbers(probe: Probe, state: State, neighbors: Neighbors | None) -> int:
    """Number K of numbers of a measurement."""
    return probe.rows(state, neighbors) * sum(math.prod(column.shape) for column in probe.measured)


def rows_held(numbers: int, most: int) -> int:
    """Number M of rows, of so many numbers each, that a chunk of up to `most` intervals keeps of a probe."""
    return most if most * numbers <= MOST_HELD else 1


def empty_memory(probe: Probe, state: State, neighbors: Neighbors | None, dtype: DTypeLike) -> Memory:
    """The memory of a probe that has measured nothing; made on the host."""
    numbers = 0 if probe.SELECTS else measured_numbers(probe, state, neighbors)
    blank = on_device(np.zeros(numbers), dtype)
    return Memory(blank, None if np.dtype(dtype) == np.float64 else blank, on_device(0, np.int32))


def packed(probe: Probe, measured: dict[str, Array]) -> Array:
    """(K,) the numbers of a measurement."""
    return jnp.concatenate([measured[column.name].reshape(-1) for column in probe.measured])


def unpacked(probe: Probe, numbers: np.ndarray) -> dict[str, np.ndarray]:
    """The inverse of `packed`, on the host: (T R, *shape) of (T, K) numbers of T measurements, one after the other."""
    measured = probe.measured
    sizes = [math.prod(column.shape) for column in measured]
    rows = numbers.shape[1] // sum(sizes)
    parts = np.split(numbers, np.cumsum([rows * size for size in sizes])[:-1], axis=1)
    return {column.name: part.reshape(-1, *column.shape) for column, part in zip(measured, parts, strict=True)}


def of_all_slabs(probe: Probe, values: np.ndarray) -> np.ndarray:
    """(M, K') numbers of M measurements of a probe that `SELECTS` in all slabs, from (B, M, K) of each; on the host."""
    sizes = [math.prod(column.shape) for column in probe.measured]
    rows = values.shape[2] // sum(sizes)
    columns = np.split(values, np.cumsum([rows * size for size in sizes])[:-1], axis=2)
    return np.concatenate([np.concatenate(list(column), axis=1) for column in columns], axis=1)


def nothing_yet(watch: Watch, state: State, neighbors: Neighbors | None, most: int) -> Probed:
    """What there is at the start of a chunk of up to `most` intervals, from a state with its list."""

    def room(probe: Probe, memory: Memory) -> Rows:
        numbers = measured_numbers(probe, state, neighbors) if probe.SELECTS else memory.sums.shape[0]
        held = rows_held(numbers, most)
        values = jnp.zeros((held, numbers), memory.sums.dtype)
        return Rows(values, jnp.zeros(held, jnp.int32), jnp.zeros((), jnp.int32))

    return Probed(watch.memory, tuple(map(room, watch.probing.probes, watch.memory)))


def probed(structure: Structure, parameters: Parameters, probing: Probing, interval: Interval, found: Probed) -> Probed:
    """What is found after an interval; a probe is evaluated only where it measures."""
    memories, rows = [], []
    for probe, numbers, timing, memory, held in zip(*probing, *found, strict=True):
        measure = partial(probe.with_numbers(numbers).measure, structure, parameters, interval)
        memory, held = _after(probe, measure, timing, interval.after.step, memory, held)
        memories.append(memory)
        rows.append(held)
    return Probed(tuple(memories), tuple(rows))


def _after(
    probe: Probe, measure: Callable[[], dict[str, Array]], timing: Timing, step: Array, memory: Memory, rows: Rows
) -> tuple[Memory, Rows]:
    """Memory and rows of one probe after `step` intervals."""
    passed = step - timing.first
    left = timing.every - 1 - (passed - 1) % timing.every
    due = (passed > 0) & (left == 0)
    measures = (passed > 0) & (left < timing.window) & (left % timing.sample == 0)

    def added(memory: Memory) -> Memory:
        sums, low = compensated.advance(memory.sums, memory.low, packed(probe, measure()))
        return Memory(sums, low, memory.samples + 1)

    def put(row: Array, rows: Rows) -> Rows:
        values, steps = rows.values.at[rows.number].set(row), rows.step.at[rows.number].set(step)
        return Rows(values, steps, rows.number + 1)

    if probe.SELECTS:
        return memory, lax.cond(due, lambda rows: put(packed(probe, measure()), rows), lambda rows: rows, rows)

    def written(memory: Memory, rows: Rows) -> tuple[Memory, Rows]:
        samples = jnp.maximum(memory.samples, 1).astype(memory.sums.dtype)
        # Numbers of rows are the same for all columns, so that each column is a stretch.
        sizes = [math.prod(column.shape) for column in probe.measured]
        count = memory.sums.shape[0] // sum(sizes)
        totals = np.repeat([column.total for column in probe.measured], [count * size for size in sizes])
        row = jnp.where(jnp.asarray(totals), memory.sums, memory.sums / samples)
        return jax.tree.map(jnp.zeros_like, memory), put(row, rows)

    memory = lax.cond(measures, added, lambda memory: memory, memory)
    return lax.cond(due, written, lambda memory, rows: (memory, rows), memory, rows)

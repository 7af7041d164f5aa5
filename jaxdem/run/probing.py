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

MOST_HELD = 1 << 15
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

    Attributes:
        sums: (R, *shape) of every measured quantity, leading part.
        low: trailing parts, see `numerics.compensated`.
        samples: () int32, number of measurements.
    """

    sums: dict[str, Array]
    low: dict[str, Low]
    samples: Array


class Rows(NamedTuple):
    """Rows that became due in a chunk.

    Attributes:
        values: (M, R, *shape) of every measured quantity.
        step: (M,) int32, `State.step` at the row.
        number: () int32, of them.
    """

    values: dict[str, Array]
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


def rows_held(probe: Probe, rows: int, most: int) -> int:
    """Number M of rows of the file that a chunk of up to `most` intervals keeps.

    Args:
        probe: the probe.
        rows: R, of one measurement.
        most: intervals.
    """
    numbers = rows * sum(math.prod(column.shape) for column in probe.measured)
    return most if most * numbers <= MOST_HELD else 1


def empty_memory(probe: Probe, state: State, neighbors: Neighbors | None, dtype: DTypeLike) -> Memory:
    """The memory of a probe that has measured nothing; made on the host."""
    size = probe.rows(state, neighbors)
    blank = {column.name: on_device(np.zeros((size, *column.shape)), dtype) for column in probe.measured}
    single = np.dtype(dtype) != np.float64
    low: dict[str, Low] = dict(blank) if single else dict.fromkeys(blank)
    return Memory(blank, low, on_device(0, np.int32))


def nothing_yet(watch: Watch, most: int) -> Probed:
    """What there is at the start of a chunk of up to `most` intervals."""
    rows = tuple(_room(probe, memory, most) for probe, memory in zip(watch.probing.probes, watch.memory, strict=True))
    return Probed(watch.memory, rows)


def _room(probe: Probe, memory: Memory, most: int) -> Rows:
    size = len(next(iter(memory.sums.values())))
    held = rows_held(probe, size, most)
    values = {name: jnp.zeros((held, *value.shape), value.dtype) for name, value in memory.sums.items()}
    return Rows(values, jnp.zeros(held, jnp.int32), jnp.zeros((), jnp.int32))


def probed(structure: Structure, parameters: Parameters, probing: Probing, interval: Interval, found: Probed) -> Probed:
    """What is found after an interval; a probe is evaluated only where it measures."""
    memories, rows = [], []
    for probe, numbers, timing, memory, held in zip(*probing, *found, strict=True):
        measure = partial(probe.with_numbers(numbers).measure, structure, parameters, interval)
        totals = {column.name for column in probe.measured if column.total}
        memory, held = _after(measure, totals, timing, interval.after.step, memory, held)
        memories.append(memory)
        rows.append(held)
    return Probed(tuple(memories), tuple(rows))


def _after(
    measure: Callable[[], dict[str, Array]], totals: set[str], timing: Timing, step: Array, memory: Memory, rows: Rows
) -> tuple[Memory, Rows]:
    """Memory and rows of one probe after `step` intervals."""
    passed = step - timing.first
    left = timing.every - 1 - (passed - 1) % timing.every
    due = (passed > 0) & (left == 0)
    measures = (passed > 0) & (left < timing.window) & (left % timing.sample == 0)

    def added(memory: Memory) -> Memory:
        value = measure()
        both = {name: compensated.advance(memory.sums[name], memory.low[name], value[name]) for name in memory.sums}
        sums = {name: high for name, (high, _) in both.items()}
        return Memory(sums, {name: low for name, (_, low) in both.items()}, memory.samples + 1)

    memory = lax.cond(measures, added, lambda memory: memory, memory)
    samples = jnp.maximum(memory.samples, 1)
    row = {name: sums if name in totals else sums / samples for name, sums in memory.sums.items()}
    values = {name: rows.values[name].at[rows.number].set(row[name]) for name in row}
    steps = rows.step.at[rows.number].set(step)
    memory = jax.tree.map(lambda a: jnp.where(due, jnp.zeros_like(a), a), memory)
    return memory, Rows(values, steps, rows.number + due.astype(jnp.int32))

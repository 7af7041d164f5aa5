"""Several coupling intervals as one compiled program: the step that is differentiated, with one look of the host."""

from __future__ import annotations

import math
import time as clock
from functools import partial
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.sharding import Mesh

from jaxdem.devices import DividedSimulation
from jaxdem.devices.mesh import DIAGNOSTICS, SAME, SLABS, STATE, on_slabs, put
from jaxdem.devices.parameters import spread
from jaxdem.errors import required
from jaxdem.failures import failures
from jaxdem.numerics.host import on_device
from jaxdem.particles.energy import EnergyFlow
from jaxdem.particles.neighbors import Neighbors
from jaxdem.probes.base import Interval, Probe
from jaxdem.run.exported import compiled, jitted
from jaxdem.run.numbers import NO_NUMBERS, LoopNumbers, loop_numbers, with_numbers
from jaxdem.run.probing import Probed, Rows, Watch, nothing_yet, probed
from jaxdem.simulation import Simulation
from jaxdem.state import Diagnostics, Parameters, State

CHUNK = 64
"""Most intervals of a chunk. All chunks of a run share one program, whatever their length."""

LONGEST = 0.5
"""A chunk is cut so that the host looks for signals and shows progress after about this time [s]."""


class Records(NamedTuple):
    """Figures of every interval of a chunk, (CHUNK, ...) each; None for a part that the scene has not.

    Attributes:
        collision_force, fastest, builds, waiting, present: see `ParticleDiagnostics`.
        substeps, courant, iterations, divergence, pressure_gradient, surface_load, passed: see
            `FluidDiagnostics`.
        momentum, volume, out_of_range: see `ExchangeDiagnostics`.
        energy: of `ParticleDiagnostics`, (CHUNK,) each.
    """

    collision_force: Array | None = None
    fastest: Array | None = None
    builds: Array | None = None
    waiting: Array | None = None
    present: Array | None = None
    substeps: Array | None = None
    courant: Array | None = None
    iterations: Array | None = None
    divergence: Array | None = None
    pressure_gradient: Array | None = None
    surface_load: Array | None = None
    passed: Array | None = None
    momentum: Array | None = None
    volume: Array | None = None
    out_of_range: Array | None = None
    energy: EnergyFlow | None = None


class Chunk(NamedTuple):
    """What a chunk came to.

    Attributes:
        state, neighbors: after the last interval that was done, the one that failed included.
        diagnostics: of that interval.
        records: of all intervals; those beyond `done` are zero.
        code: () int32, flags of the last interval, see `jaxdem.failures`; 0 where all went well.
        done: () int32, intervals done, the one that failed included.
        probed: of the probes; None without probes.
        identity: on several devices, of the particles that the rows of the last interval's forces belong to.
    """

    state: State
    neighbors: Neighbors | None
    diagnostics: Diagnostics
    records: Records
    code: Array
    done: Array
    probed: Probed | None = None
    identity: Array | None = None


class Program(Protocol):
    """Coupling intervals, compiled for the capacities of a state and its list."""

    @property
    def most(self) -> int:
        """Most intervals that a call may be asked for."""
        ...

    def __call__(
        self, parameters: Parameters, state: State, neighbors: Neighbors | None, count: int, watch: Watch | None = None
    ) -> Chunk:
        """Up to `count` intervals, watched by probes if any; it ends early with one that raises a flag."""
        ...


class ChunkProgram:
    """The program that runs use; compiled when it is made."""

    def __init__(
        self,
        simulation: Simulation,
        parameters: Parameters,
        state: State,
        neighbors: Neighbors | None,
        watch: Watch | None = None,
    ) -> None:
        self._numbers = loop_numbers(simulation, parameters.gravity.dtype)
        structure = with_numbers(simulation, NO_NUMBERS)
        given = (self._numbers, parameters, state, neighbors, on_device(1, np.int32), watch)
        self._compiled = compiled(advance, structure, *given)
        self._seconds = math.inf

    @property
    def most(self) -> int:
        """See `Program`: as many as take about `LONGEST`."""
        return most_intervals(self._seconds)

    def __call__(
        self, parameters: Parameters, state: State, neighbors: Neighbors | None, count: int, watch: Watch | None = None
    ) -> Chunk:
        """See `Program`."""
        begin = clock.perf_counter()
        given = (self._numbers, parameters, state, neighbors, on_device(count, np.int32), watch)
        chunk = jax.block_until_ready(self._compiled(*given))
        self._seconds = max((clock.perf_counter() - begin) / max(int(chunk.done), 1), 1e-9)
        return chunk


class SlabProgram:
    """The same program over several devices, each with a slab of the box; it is not kept between processes."""

    def __init__(
        self,
        simulation: DividedSimulation,
        parameters: Parameters,
        state: State,
        neighbors: Neighbors | None,
        watch: Watch | None = None,
    ) -> None:
        self.simulation, self._mesh = simulation, required(simulation.mesh, "mesh")
        numbers = loop_numbers(simulation, parameters.gravity.dtype)
        self._same = put(self._mesh, numbers, SAME), simulation.on_devices(parameters)
        structure = with_numbers(simulation.of_slab(), NO_NUMBERS)
        probes = None if watch is None else watch.probing.probes
        program = jitted(_advance_in_slabs, (self._mesh, structure, probes))
        self._compiled = program.lower(*self._same, state, neighbors, *self._asked(1, watch)).compile()
        self._seconds = math.inf

    def _asked(self, count: int, watch: Watch | None) -> Any:
        return put(self._mesh, np.int32(count), SAME), put(self._mesh, watch, SAME)

    @property
    def most(self) -> int:
        """See `Program`: as many as take about `LONGEST`."""
        return most_intervals(self._seconds)

    def __call__(
        self, parameters: Parameters, state: State, neighbors: Neighbors | None, count: int, watch: Watch | None = None
    ) -> Chunk:
        """See `Program`; the parameters are those that it was made with."""
        begin = clock.perf_counter()
        chunk: Chunk = jax.block_until_ready(self._compiled(*self._same, state, neighbors, *self._asked(count, watch)))
        self._seconds = max((clock.perf_counter() - begin) / max(int(chunk.done), 1), 1e-9)
        return chunk

    def one_step(
        self, state: State, neighbors: Neighbors, watch: Watch | None = None
    ) -> tuple[float, State, Neighbors]:
        """An interval of a single contact step: seconds by the clock of this process, and what is then."""
        numbers, parameters = self._same
        numbers = numbers._replace(contact_steps=put(self._mesh, np.int32(1), SAME))
        given = numbers, parameters, state, neighbors, *self._asked(1, watch)
        begin = clock.perf_counter()
        chunk: Chunk = jax.block_until_ready(self._compiled(*given))
        seconds = clock.perf_counter() - begin
        return seconds, chunk.state, required(chunk.neighbors, "neighbors")


def _advance_in_slabs(static: tuple[Mesh, Simulation, tuple[Probe, ...] | None], *given: Any) -> Chunk:
    """`advance` of the slabs of several devices; static are these, what each does, and its probes, None for none."""
    mesh, structure, probes = static
    result: Any = Chunk(STATE, SLABS, DIAGNOSTICS, SAME, SAME, SAME, _probed_in_slabs(probes), SLABS)
    spreading: Any = (SAME, spread(given[1]), STATE, SLABS, SAME, SAME)
    chunk: Chunk = on_slabs(mesh, partial(advance, structure), spreading, result)(*given)
    return chunk


def probed_in_slabs(watch: Watch | None) -> Any:
    """How what probes find is spread over slabs, a tree of `SAME` and `SLABS`; None without probes."""
    return _probed_in_slabs(None if watch is None else watch.probing.probes)


def _probed_in_slabs(probes: tuple[Probe, ...] | None) -> Any:
    """What a probe sums up is that of all slabs; of one that selects each slab has its own rows."""
    if probes is None:
        return None
    rows: Any = tuple(Rows(SLABS if probe.SELECTS else SAME, SAME, SAME) for probe in probes)
    found: Any = Probed(SAME, rows)
    return found


def most_intervals(seconds: float) -> int:
    """So many intervals of so many seconds take about `LONGEST`; 1 as long as it is not known."""
    return max(1, min(CHUNK, int(LONGEST / seconds)))


def advance(
    structure: Simulation,
    numbers: LoopNumbers,
    parameters: Parameters,
    state: State,
    neighbors: Neighbors | None,
    count: Array,
    watch: Watch | None = None,
) -> Chunk:
    """`count` coupling intervals, up to `CHUNK` of them; it ends early with one that raises a flag.

    Args:
        structure: from `jaxdem.build`, without `numbers`.
        numbers: its steps and limits.
        parameters: its other numbers.
        state: to start from.
        neighbors: its list.
        count: () int32.
        watch: probes, if any.
    """
    simulation = with_numbers(structure, numbers)
    # Compiled by itself, so that finding the shapes of what it reports does not trace it a second time.
    step = jax.jit(lambda *given: simulation.step(*given))
    shapes = jax.eval_shape(step, parameters, state, neighbors)[2]
    blank = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), shapes)
    records = jax.tree.map(lambda a: jnp.zeros((CHUNK, *a.shape), a.dtype), records_of(shapes))
    zero = jnp.zeros((), jnp.int32)

    def interval(chunk: Chunk) -> Chunk:
        state, neighbors, diagnostics = step(parameters, chunk.state, chunk.neighbors)
        records = jax.tree.map(lambda all_, one: all_.at[chunk.done].set(one), chunk.records, records_of(diagnostics))
        code, seen = failures(simulation, diagnostics), chunk.probed
        if watch is not None and seen is not None:
            seen = probed(
                simulation, parameters, watch.probing, Interval(chunk.state, state, neighbors, diagnostics), seen
            )
        return Chunk(state, neighbors, diagnostics, records, code, chunk.done + 1, seen, identity_of(chunk.state))

    seen = None if watch is None else nothing_yet(watch, state, neighbors, CHUNK)
    start = Chunk(state, neighbors, blank, records, zero, zero, seen, identity_of(state))
    return lax.while_loop(lambda chunk: (chunk.done < count) & (chunk.code == 0), interval, start)


def identity_of(state: State) -> Array | None:
    """Who the rows of a state are; None on one device."""
    return None if state.particles is None else state.particles.identity


def records_of(diagnostics: Diagnostics) -> Records:
    """The figures of an interval."""
    found: dict[str, Any] = {}
    for part in (diagnostics.particles, diagnostics.fluid, diagnostics.exchange):
        if part is not None:
            found |= {name: value for name, value in part._asdict().items() if name in Records._fields}
    return Records(**found)

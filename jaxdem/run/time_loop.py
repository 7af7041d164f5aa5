"""The time loop: coupled steps on the device; errors, signals, progress and when to write on the host."""

from __future__ import annotations

import contextlib
import dataclasses
import time as clock
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any, NoReturn

import jax
from jax import Array

from jaxdem.coupling.exchange_result import FluidForces
from jaxdem.errors import RunError, required
from jaxdem.failures import OF_PARTICLES, Failure
from jaxdem.io import RunDirectory
from jaxdem.particles.neighbors import Neighbors
from jaxdem.run.chunk import CHUNK, Program
from jaxdem.run.diagnosis import diagnosis
from jaxdem.run.instant import Instant
from jaxdem.run.move_cost import with_move_cost
from jaxdem.run.observer import Observer, probe_marks
from jaxdem.run.parts import PARTS
from jaxdem.run.peers import Peers, here
from jaxdem.run.placement import OneDevice, Placement
from jaxdem.run.signals import Caught, Stopped
from jaxdem.run.totals import Totals
from jaxdem.run.writer import RunWriter
from jaxdem.setup.builder import Case
from jaxdem.setup.time_steps import exact_time
from jaxdem.simulation import Simulation
from jaxdem.state import Diagnostics, Parameters, State

Progress = Callable[[float, float], None]
"""Called with the simulated time and the end [s]."""


class Interrupted(Exception):
    """The run was asked to stop; a checkpoint was written.

    Attributes:
        number: of the signal; the command line returns 128 + number.
        time: simulated time reached [s].
        end: that the run goes to [s].
        folder: its run directory.
    """

    def __init__(self, number: int, time: float, end: float, folder: Path):
        self.number, self.time, self.end, self.folder = number, time, end, folder
        super().__init__(f"stopped at t = {time:.6g} s")


@dataclasses.dataclass
class TimeLoop:
    """The loop of one run.

    Attributes:
        case: that runs.
        sample_every: number of coupling intervals between samples, 0 for none.
        profile: whether the parts of a step are compiled and timed one by one.
        done: coupling intervals so far.
        caught: signals that came.
        peers: processes that run this loop alike; what their clocks and signals decide they agree on.
        placement: where the state is; on one device if None.
        forces: of the fluid in the last interval, None before the first and without fluid or particles.
        writer: of the files.
    """

    case: Case
    directory: RunDirectory
    state: State
    neighbors: Neighbors | None
    sample_every: int
    profile: bool = False
    totals: Totals = dataclasses.field(default_factory=Totals)
    done: int = 0
    caught: Caught = dataclasses.field(default_factory=Caught)
    peers: Peers = dataclasses.field(default_factory=here)
    placement: Placement | None = None
    forces: FluidForces | None = None
    writer: RunWriter = dataclasses.field(init=False)
    program: Program = dataclasses.field(init=False)

    def __post_init__(self) -> None:
        self._most, self._failed = 1, False
        self._identity: Array | None = None
        placement = OneDevice(self.case) if self.placement is None else self.placement
        self.writer = RunWriter(self.case, self.directory, placement, Observer(self.case.probes), self.totals)
        self.observer.fit(self.state, self.neighbors, self.parameters.gravity.dtype)
        if self.case.start is not None:
            self.observer.go_on(self.case.start, probe_marks(self.case))

    @property
    def observer(self) -> Observer:
        """The probes."""
        return self.writer.observer

    @property
    def simulation(self) -> Simulation:
        """What is compiled, as on one device."""
        return self.case.simulation

    @property
    def parameters(self) -> Parameters:
        """Its numbers."""
        return self.case.parameters

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self._time_after(self.done))

    @property
    def instant(self) -> Instant:
        """Where the run has got to, with arrays of all particles and cells."""
        return self.writer.placement.whole(self._placed)

    @property
    def _placed(self) -> Instant:
        return Instant(self.time, self.state, self.neighbors, self.forces, self._identity)

    def _time_after(self, intervals: int) -> Fraction:
        per_output = self.simulation.steps.intervals_per_output
        return self.case.begin + exact_time(self.case.scene.time.output_interval, intervals, per_output)

    @property
    def _first(self) -> int:
        """Coupling intervals that were done when the run began."""
        return 0 if self.case.start is None else self.case.start.step

    @property
    def last(self) -> int:
        """Number of coupling intervals of the whole run."""
        return self.simulation.steps.outputs * self.simulation.steps.intervals_per_output

    def run(self, progress: Progress | None, caught: Caught) -> None:
        """From the present state to the end of the scene, with everything written.

        Args:
            progress: called at every output at least.
            caught: signals that came; at the first the interval is finished, or compiling given up, and a checkpoint
                left.
        """
        self.totals.begin()
        self.caught = caught
        try:
            if not self.directory.has_checkpoint:  # first of all: a kill while compiling loses nothing either
                self._write_checkpoint()
            try:
                self.begin()
                self._advance_to_end(progress)
            except Stopped:
                self._leave()
        except RunError as error:
            if self.peers.number > 1 and not self._failed:  # not what all find: the disk of this process, say
                raise
            with contextlib.suppress(RunError):
                self.observer.write(self.directory, self.time)
            # A disk that is full refuses the summary too; what it refused first is what to tell.
            with contextlib.suppress(RunError):
                self.directory.interrupt(self._summary(False, str(error)))
            raise
        self.directory.finish(self._with_measured(self._summary(True, "")))

    def begin(self) -> None:
        """The program, compiled, and the first frame if there is none."""
        self._compile()
        if self.done == 0:
            with self.totals.timed("output"):
                instant = self.instant
                given = {part.name: part.start(self.case, instant) for part in PARTS}
            self.totals.at_start = {name: value for name, value in given.items() if value is not None}
            if self.directory.frames == 0:
                self.writer.frame(self._placed)

    def advance(self) -> bool:
        """Intervals up to the next one after which the host has to look, with what is then due written.

        Returns:
            whether an output was written.
        """
        before, done = Instant(self.time, self.state, None, None), self.done
        self._advance(self._next_stop() - done)
        if self.forces is not None and self._is_sampled(self.done) and self.done > done:
            self.writer.sample(before, dataclasses.replace(self._placed, neighbors=None))
        at_output = self.done % self.simulation.steps.intervals_per_output == 0 and self.done > done
        if at_output:
            self.writer.frame(self._placed)
        return at_output

    def place(self) -> None:
        """The state, of one device until now, goes to where it is to be."""
        self.state, self.neighbors = self.writer.placement.placed(self.state, self.neighbors)
        self.writer.fit_probes(self.state, self.neighbors)

    def restore(self) -> None:
        """State, list and counters from the directory's checkpoint, files cut back to it."""
        self.state, self.neighbors, self.done = self.writer.restored(self.state)

    def _advance_to_end(self, progress: Progress | None) -> None:
        saved = clock.perf_counter()
        while self.done < self.last:
            if self.advance():
                (due,) = self.peers.highest(
                    [clock.perf_counter() - saved >= self.case.scene.output.checkpoint_interval]
                )
                if due or self.done == self.last:
                    self._write_checkpoint()
                    saved = clock.perf_counter()
            if progress is not None:
                progress(self.time, self.case.scene.time.end)
            self._agree()

    def _agree(self) -> None:
        """Once a signal has come, to this process or to another one, all leave; the shortest chunk that one wants is
        that of all.

        Raises:
            Stopped: a signal has come.
        """
        number, shorter = self.peers.highest([self.caught[0] if self.caught else 0, CHUNK - self.program.most])
        self._most = CHUNK - shorter
        if number:
            self.caught[:0] = [number]
            raise Stopped

    def _next_stop(self) -> int:
        """Number of intervals after which the host has to look: at an output, before and after a sampled interval."""
        per_output = self.simulation.steps.intervals_per_output
        stops = [self.last, (self.done // per_output + 1) * per_output]
        if self.sample_every:
            sampled = (self.done // self.sample_every + 1) * self.sample_every
            stops.append(sampled if self.done == sampled - 1 else sampled - 1)
        row = self.observer.next_stop(self._first + self.done)
        return min(stops if row is None else [*stops, row - self._first])

    def _is_sampled(self, number: int) -> bool:
        return self.sample_every > 0 and number % self.sample_every == 0

    def _leave(self) -> NoReturn:
        """The run as a signal leaves it: with a checkpoint, and a summary for which nothing more is compiled."""
        self._write_checkpoint()
        message = f"stopped by signal {self.caught[0]}; continue with --resume"
        self.directory.interrupt(self._summary(False, message, split_stages=False))
        raise Interrupted(self.caught[0], self.time, self.case.scene.time.end, self.directory.path)

    def _advance(self, count: int) -> None:
        """Up to `count` intervals; more room where the neighbour list ran out of it; an error where an interval failed.

        The intervals before one that failed are done again by themselves: it is judged, and gone on from, alone.
        """
        count = min(count, self.program.most if self.peers.number == 1 else self._most)
        given = (self.parameters, self.state, self.neighbors)
        with self.totals.timed("step"), self.peers.held():
            chunk = jax.block_until_ready(self.program(*given, count, self.observer.watch))
            code, done = int(chunk.code), int(chunk.done)
            if code and done > 1:
                chunk = jax.block_until_ready(self.program(*given, done - 1, self.observer.watch))
                code, done = int(chunk.code), int(chunk.done)
        if not code:
            self.state, self.neighbors = chunk.state, chunk.neighbors
            self.forces, self.done = chunk.diagnostics.forces, self.done + done
            self._identity = chunk.identity
            self.totals.add(chunk.records, done)
            if chunk.probed is not None:
                self.writer.rows(chunk.probed, self._time_of, self.time)
        # What else is wrong with particles that missed some of their contacts may come of it.
        elif code & Failure.OVERFLOW and not code & ~OF_PARTICLES and self.neighbors is not None:
            self._enlarge(self.neighbors, required(chunk.neighbors, "neighbors"))
        else:
            self._raise(code, chunk.state, chunk.diagnostics)

    def _raise(self, code: int, reached: State, told: Diagnostics) -> NoReturn:
        """The error of the interval from the present state to `reached`."""
        self._failed = True
        instants = (Instant(self.time, state, self.neighbors, None) for state in (self.state, reached))
        before, after = (self.writer.placement.whole(instant).state for instant in instants)
        reason, where, remedy = diagnosis(self.simulation, self.parameters, code, before, after, told)
        raise RunError(reason, where, self.time, remedy)

    def _enlarge(self, neighbors: Neighbors, failed: Neighbors) -> None:
        """A neighbour list with half as much room again, or on several devices what was lacking; the contact history
        moves along."""
        self.state, self.neighbors = self.writer.placement.enlarged(self.state, neighbors, failed)
        self.totals.resizes += 1
        self.writer.fit_probes(self.state, self.neighbors)
        self._compile()

    def _compile(self) -> None:
        """The step, compiled for the present capacities; given up at a signal.

        Several processes wait for each other until all have compiled, or given up.
        """
        if self.peers.number == 1:
            self._compile_here()
            return
        with contextlib.suppress(Stopped):
            self._compile_here()
        with self.totals.timed("compile"):
            (number,) = self.peers.highest([self.caught[0] if self.caught else 0])
        if number:
            self.caught[:0] = [number]
            raise Stopped

    def _compile_here(self) -> None:
        with self.totals.timed("compile"), self.caught.raised():
            timed = self.totals.timed if self.profile else None
            given = (self.state, self.neighbors, self.observer.watch, timed)
            self.program = self.caught.wait_for(lambda: self.writer.placement.program(*given))

    def _time_of(self, step: int) -> float:
        """Simulated time after so many intervals of this run and the ones that it goes on from [s]."""
        return float(self._time_after(step - self._first))

    def _write_checkpoint(self) -> None:
        self.writer.checkpoint(self.state, self.neighbors, self.done, self._time_after(self.done))

    def _with_measured(self, summary: dict[str, Any]) -> dict[str, Any]:
        """The summary of a run that is done, with what its program can tell now that it is not needed any more."""
        with self.peers.held():
            return with_move_cost(summary, self.program, self.state, self.neighbors, self.observer.watch)

    def _summary(self, valid: bool, reason: str, split_stages: bool = True) -> dict[str, Any]:
        return self.writer.summary(self.instant, self.neighbors, valid, reason, split_stages)

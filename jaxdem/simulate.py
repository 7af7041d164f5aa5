"""The time loop: coupled steps on the device, errors, output, checkpoints and progress on the host."""

from __future__ import annotations

import contextlib
import dataclasses
import time as clock
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

import jax
import numpy as np
from jax import Array

from jaxdem import step as coupled
from jaxdem.build import build, initial_state
from jaxdem.closures.base import DragClosure
from jaxdem.closures.ensemble import EnsembleClosure
from jaxdem.diagnosis import diagnosis
from jaxdem.errors import InputError, RunError
from jaxdem.failures import OF_PARTICLES, Failure, failures
from jaxdem.fluid.inlet import InletProfile
from jaxdem.fluid.side_conditions import SideCondition
from jaxdem.fluid.subgrid_stress import SubgridLaw
from jaxdem.io import Run, RunDirectory, load_run
from jaxdem.io.run_directory import SCENE
from jaxdem.particles.contact import ContactLaw
from jaxdem.particles.neighbors import Neighbors
from jaxdem.records import Totals, frame_of, history_of, run_summary, sample_attributes, sample_of
from jaxdem.restart import (
    from_arrays,
    origin,
    require_same_origin,
    require_same_parameters,
    to_arrays,
)
from jaxdem.scene import Scene
from jaxdem.signals import Caught, Stopped, noted_signals
from jaxdem.simulation import Simulation
from jaxdem.state import Diagnostics, Parameters, State
from jaxdem.time_steps import simulated_time

Progress = Callable[[float, float], None]
"""Called with the simulated time and the end [s]."""


class Interrupted(Exception):
    """The run was asked to stop; a checkpoint was written.

    Attributes:
        number: of the signal; the command line returns 128 + number.
        time: simulated time reached [s].
    """

    def __init__(self, number: int, time: float):
        self.number, self.time = number, time
        super().__init__(f"stopped at t = {time:.6g} s")


def simulate(
    scene: Scene,
    out: str | Path,
    *,
    closure: DragClosure | None = None,
    walls: Sequence[Callable[[Array], Array]] = (),
    contact_law: ContactLaw | None = None,
    inlet_profiles: Mapping[str, Sequence[InletProfile | None]] | None = None,
    subgrid: SubgridLaw | None = None,
    side_conditions: Mapping[str, SideCondition] | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> Run:
    """Runs a scene to its end and writes the run directory.

    Args:
        scene: from `jaxdem.load_scene`.
        out: run directory; must be new or empty unless `resume`.
        closure: drag law or learned closure in place of the scene's, see `jaxdem.build`. This and the next four are
            not in the scene file: a resumed run must be given the same.
        walls: signed distances of further walls.
        contact_law: in place of the scene's.
        inlet_profiles: in place of the scene's, by the side's name.
        subgrid: closure of the subgrid stress in place of the scene's.
        side_conditions: in place of the scene's kinds of sides, by the side's name.
        resume: go on from the directory's checkpoint.
        progress: called after every coupling interval.

    Returns:
        The run, as `jaxdem.load_run` gives it.

    Raises:
        InputError: the scene or the directory cannot be used; nothing was started.
        RunError: the run could not go on; what was done is kept, with `valid: false` in the summary.
        Interrupted: SIGINT or SIGTERM; a checkpoint was written.
    """
    complete = resume and RunDirectory.is_complete(out)
    if complete:
        RunDirectory.require_same_scene(out, scene.to_toml())
    simulation, parameters = build(
        scene, closure, walls, contact_law, inlet_profiles, subgrid, side_conditions
    )
    if complete:
        require_same_parameters(out, origin(scene.to_toml(), parameters))
        return load_run(out)
    every = samples_every(scene, simulation)
    state, neighbors = initial_state(scene, simulation, parameters)
    attributes = sample_attributes(scene, simulation) if every else None
    opener = RunDirectory.resume if resume else RunDirectory.create
    # From the moment that there is a directory a signal is noted only: a checkpoint is left in it.
    with noted_signals() as caught, opener(out, scene.to_toml(), attributes) as directory:
        loop = TimeLoop(scene, simulation, parameters, directory, state, neighbors, every)
        if directory.has_checkpoint:
            loop.restore()
        loop.run(progress, caught)
    return load_run(out)


def simulate_once(scene: Scene, out: Path, begin: Callable[[], Progress]) -> Run:
    """The run of a scene in `out`: made, gone on with from its checkpoint, or taken as it is where it is complete.

    Args:
        scene: from `jaxdem.load_scene`.
        out: run directory; one that was stopped before its first checkpoint is begun anew.
        begin: called where there is something to compute; gives `progress` of `simulate`.

    Raises:
        InputError, RunError, Interrupted: see `simulate`.
    """
    if RunDirectory.is_complete(out):
        require_same_parameters(out, origin(scene.to_toml(), build(scene)[1]))
        return load_run(out)
    return simulate(scene, out, resume=(out / SCENE).is_file(), progress=begin())


@dataclasses.dataclass
class TimeLoop:
    """The loop of one run."""

    scene: Scene
    simulation: Simulation
    parameters: Parameters
    directory: RunDirectory
    state: State
    neighbors: Neighbors | None
    sample_every: int
    totals: Totals = dataclasses.field(default_factory=Totals)
    done: int = 0
    caught: Caught = dataclasses.field(default_factory=Caught)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._time_after(self.done)

    def _time_after(self, intervals: int) -> float:
        per_output = self.simulation.steps.intervals_per_output
        return simulated_time(self.scene.time.output_interval, intervals, per_output)

    @property
    def last(self) -> int:
        """Number of coupling intervals of the whole run."""
        return self.simulation.steps.outputs * self.simulation.steps.intervals_per_output

    def run(self, progress: Progress | None, caught: Caught) -> None:
        """From the present state to the end of the scene, with everything written.

        Args:
            progress: called after every coupling interval.
            caught: signals that came; at the first the interval is finished, or compiling given up, and a checkpoint left.
        """
        self.totals.begin()
        self.caught = caught
        try:
            if not self.directory.has_checkpoint:  # first of all: a kill while compiling loses nothing either
                self._write_checkpoint()
            try:
                self._compile()
                if self.done == 0 and self.directory.frames == 0:
                    self._write_frame(None)
                self._advance_to_end(progress)
            except Stopped:
                self._leave()
        except RunError as error:
            # A disk that is full refuses the summary too; what it refused first is what to tell.
            with contextlib.suppress(RunError):
                self.directory.interrupt(self._summary(False, str(error)))
            raise
        self.directory.finish(self._summary(True, ""))

    def restore(self) -> None:
        """State, list and counters from the directory's checkpoint, files cut back to it."""
        arrays, attributes = self.directory.checkpoint()
        require_same_origin(attributes, self._origin())
        state, neighbors, extra = from_arrays(self.simulation, self.state, arrays)
        self.state, self.neighbors = state, neighbors
        self.totals.load(extra)
        self.done = int(extra["done"])
        self.directory.cut_back(int(attributes["frames"]), int(attributes["samples"]))

    def _advance_to_end(self, progress: Progress | None) -> None:
        per_output = self.simulation.steps.intervals_per_output
        saved = clock.perf_counter()
        while self.done < self.last:
            diagnostics = self._advance()
            if self.sample_every and self.done % self.sample_every == 0 and diagnostics.forces is not None:
                with self.totals.timed("output"):
                    volume = np.asarray(self.parameters.bodies.volume)  # type: ignore[union-attr]
                    sample = sample_of(self.simulation, self._before, self.state, diagnostics.forces, volume)
                    start = self._time_after(self.done - 1)
                    self.directory.write_sample(self.directory.samples, start, sample)
            if self.done % per_output == 0:
                self._write_frame(diagnostics)
                due = clock.perf_counter() - saved >= self.scene.output.checkpoint_interval
                if due or self.done == self.last:
                    self._write_checkpoint()
                    saved = clock.perf_counter()
            if progress is not None:
                progress(self.time, self.scene.time.end)
            if self.caught:
                raise Stopped

    def _leave(self) -> NoReturn:
        """The run as a signal leaves it: with a checkpoint, and a summary for which nothing more is compiled."""
        self._write_checkpoint()
        message = f"stopped by signal {self.caught[0]}; continue with --resume"
        self.directory.interrupt(self._summary(False, message, split_stages=False))
        raise Interrupted(self.caught[0], self.time)

    def _advance(self) -> Diagnostics:
        """One coupling interval; on overflow of the neighbour list again, with more slots."""
        while True:
            with self.totals.timed("fluid_part"):
                fluid, forces, fluid_report = jax.block_until_ready(
                    self._fluid_part(self.parameters, self.state)
                )
            with self.totals.timed("particle_part"):
                particles, neighbors, particle_report = jax.block_until_ready(
                    self._particle_part(self.parameters, self.state, self.neighbors, forces)
                )
            diagnostics = Diagnostics(particle_report, fluid_report, forces)
            code = int(failures(self.simulation, diagnostics))
            # What else is wrong with particles that missed some of their contacts may come of it.
            if not code & Failure.OVERFLOW or code & ~OF_PARTICLES or self.neighbors is None:
                break
            self._enlarge()
        if code:
            self._raise(code, State(particles, fluid, self.state.step))
        self._before = self.state
        self.state = State(particles, fluid, self.state.step + 1)
        self.neighbors = neighbors
        self.done += 1
        self.totals.add(diagnostics)
        return diagnostics

    def _enlarge(self) -> None:
        """A neighbour list with half as much room again; the contact history moves along."""
        old = self.neighbors
        assert old is not None and self.state.particles is not None
        self.state, self.neighbors = self.simulation.with_room(self.state, old, old.room.enlarged())
        self.totals.resizes += 1
        self._compile()

    def _raise(self, code: int, reached: State) -> None:
        reason, where, remedy = diagnosis(self.simulation, self.parameters, code, self.state, reached)
        raise RunError(reason, where, self.time, remedy)

    def _compile(self) -> None:
        """Both parts of a step, compiled for the present capacities; given up at a signal."""
        with self.totals.timed("compile"), self.caught.raised():
            simulation = self.simulation
            fluid = jax.jit(lambda p, s: coupled.fluid_part(simulation, p, s))
            self._fluid_part = self.caught.wait_for(fluid.lower(self.parameters, self.state).compile)
            forces = jax.eval_shape(fluid, self.parameters, self.state)[1]
            particle = jax.jit(lambda p, s, n, f: coupled.particle_part(simulation, p, s, n, f))
            arguments = (self.parameters, self.state, self.neighbors, forces)
            self._particle_part = self.caught.wait_for(particle.lower(*arguments).compile)

    def _write_frame(self, diagnostics: Diagnostics | None) -> None:
        with self.totals.timed("output"):
            forces = None if diagnostics is None else diagnostics.forces
            particles, fluid = frame_of(self.simulation, self.parameters, self.state, forces)
            row = history_of(
                self.simulation, self.parameters, self.state, forces, self.time, self.totals.collision_mean()
            )
            if forces is not None and isinstance(self.parameters.closure, EnsembleClosure):
                self.totals.add_spread(self.parameters.closure, forces)
            self.directory.write_frame(self.directory.frames, self.time, particles, fluid, None, row)

    def _write_checkpoint(self) -> None:
        with self.totals.timed("output"):
            extra = self.totals.save() | {"done": self.done}
            arrays = to_arrays(self.state, self.neighbors, extra)
            attributes = {"frames": self.directory.frames, "samples": self.directory.samples} | self._origin()
            self.directory.write_checkpoint(arrays, attributes)

    def _origin(self) -> dict[str, str]:
        return origin(self.scene.to_toml(), self.parameters)

    def _summary(self, valid: bool, reason: str, split_stages: bool = True) -> dict[str, Any]:
        return run_summary(
            self.scene,
            self.simulation,
            self.parameters,
            self.state,
            self.neighbors,
            self.totals,
            valid=valid,
            reason=reason,
            time=self.time,
            split_stages=split_stages,
        )


def samples_every(scene: Scene, simulation: Simulation) -> int:
    """Number of coupling intervals between samples, 0 for none."""
    wanted = scene.output.samples
    if wanted == 0.0:
        return 0
    if scene.fluid is None or scene.coupling is None:
        raise InputError("output.samples", wanted, "needs both [fluid] and [particles]", "set it to 0")
    if simulation.population is not None:
        raise InputError(
            "output.samples", wanted, "training samples cannot be written where particles enter or leave", "set it to 0"
        )  # fmt: skip
    if wanted > scene.time.end * (1.0 + 1e-9):
        raise InputError(
            "output.samples",
            wanted,
            f"the scene ends at {scene.time.end:g} s, so there would be no sample",
            "lower the time between samples",
        )
    ratio = wanted / simulation.interval
    every = max(1, round(ratio))
    if abs(every - ratio) > 1e-6 * every:
        raise InputError(
            "output.samples",
            wanted,
            f"must be a multiple of the coupling interval, {simulation.interval:.6g} s",
            f"use, for example, {every * simulation.interval:.6g}",
        )
    return every

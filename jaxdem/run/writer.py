"""What the time loop writes into the directory of a run, and reads there when it goes on. Host side."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from fractions import Fraction
from typing import Any

from jaxdem.closures.ensemble import EnsembleClosure
from jaxdem.errors import required
from jaxdem.io import RunDirectory
from jaxdem.particles.neighbors import Neighbors
from jaxdem.run.instant import Instant
from jaxdem.run.observer import PROBES, Observer, probe_marks
from jaxdem.run.placement import Placement
from jaxdem.run.probing import Probed
from jaxdem.run.records import ensemble_spread, frame_of, history_of
from jaxdem.run.restart import about, origin, require_same_origin, require_same_rows
from jaxdem.run.samples import sample_of
from jaxdem.run.summary import run_summary
from jaxdem.run.totals import Totals
from jaxdem.setup.builder import Case
from jaxdem.setup.stored import stored
from jaxdem.state import State


@dataclasses.dataclass(frozen=True)
class RunWriter:
    """Frames, samples, lines of probes, checkpoints and the summary of one run.

    Attributes:
        case: that runs.
        directory: of the run.
        placement: where the state is.
        observer: the probes.
        totals: sums over the run; the time that writing takes is counted there.
    """

    case: Case
    directory: RunDirectory
    placement: Placement
    observer: Observer
    totals: Totals

    def frame(self, instant: Instant) -> None:
        """The next output: a frame and a row of history.csv, of an instant as it is placed."""
        with self.totals.timed("output"):
            instant = self.placement.whole(instant)
            frame = frame_of(self.case, instant)
            row = history_of(self.case, instant, frame, self.totals.means())
            closure = self.case.parameters.closure
            if instant.forces is not None and isinstance(closure, EnsembleClosure):
                spread, force = ensemble_spread(closure, instant.forces)
                self.totals.add_spread(float(spread), float(force))
            self.directory.write_frame(self.directory.frames, instant.time, frame, row)

    def sample(self, before: Instant, after: Instant) -> None:
        """What the drag law saw and gave in the interval between two instants, as they are placed."""
        with self.totals.timed("output"):
            states = [self.placement.whole(instant) for instant in (before, after)]
            forces = required(states[1].forces, "forces")
            sample = sample_of(self.case, states[0].state, states[1].state, forces)
            self.directory.write_sample(self.directory.samples, before.time, sample)

    def rows(self, probed: Probed, time: Callable[[int], float], now: float) -> None:
        """Rows of probes that became due in a chunk; they are on disk before the checkpoint after them.

        Args:
            probed: of the chunk.
            time: of a number of intervals [s].
            now: simulated time [s].
        """
        with self.totals.timed("output"):
            self.observer.take(probed, time, self.placement.selected)
            self.observer.write(self.directory, now, always=False)

    def checkpoint(self, state: State, neighbors: Neighbors | None, done: int, time: Fraction) -> None:
        """All that the run goes on from, after `done` intervals at a simulated time [s]."""
        with self.totals.timed("output"):
            self.observer.write(self.directory, float(time))
            rows, known = about(self.case, time)
            saved = self.placement.saved(state, neighbors, self.totals.save() | {"done": done})
            written = {"frames": self.directory.frames, "samples": self.directory.samples}
            marks = {PROBES: json.dumps(probe_marks(self.case))} if self.case.probes else {}
            attributes = written | known | marks | self._origin() | dict(saved.attributes)
            self.directory.write_checkpoint(saved.same | rows | self.observer.save(), attributes, saved.blocks)

    def restored(self, template: State) -> tuple[State, Neighbors | None, int]:
        """State, list and number of intervals of the last checkpoint; sums are loaded, files cut back to it.

        Args:
            template: a state of the scene, for the structure.

        Raises:
            InputError: it is missing, damaged, or of another run.
        """
        arrays, attributes = self.directory.checkpoint()
        require_same_rows(arrays, template, attributes)
        require_same_origin(attributes, self._origin())
        state, neighbors, extra = self.placement.restored(template, arrays, attributes)
        self.fit_probes(state, neighbors)
        self.observer.load(arrays)
        self.totals.load(extra, bool(self.case.fluid_walls.walls))
        lines = self.directory.lines_before(attributes)
        self.directory.cut_back(int(attributes["frames"]), int(attributes["samples"]), lines)
        return state, neighbors, int(stored(extra, "done"))

    def fit_probes(self, state: State, neighbors: Neighbors | None) -> None:
        """What the probes sum up, in the shapes of the present list."""
        self.observer.fit(*self.placement.seen(state, neighbors), self.case.parameters.gravity.dtype)

    def summary(
        self, instant: Instant, neighbors: Neighbors | None, valid: bool, reason: str, split_stages: bool = True
    ) -> dict[str, Any]:
        """Content of summary.json, see `run_summary`; `neighbors` is the list as it is placed."""
        room = None if neighbors is None else neighbors.room
        summary = run_summary(self.case, instant, room, self.totals, valid, reason, split_stages)
        return summary | self.placement.figures(neighbors)

    def _origin(self) -> dict[str, str]:
        case = self.case
        return origin(case.scene.to_toml(), case.parameters, case.scene.content, case.start)

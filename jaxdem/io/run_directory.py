"""The folder of one run: who may write to it, in which order, and what a disk that refuses means.

Order within one output time: the frames of fluid and particles, each a whole file, then the line of
`history.csv`. The line commits the frame: what a kill leaves beyond it does not count. A checkpoint
names the numbers of frames, samples and lines of probes it follows, and is written after them; `cut_back` returns to
it. The files that grow are in `run_files`. What a folder holds is asked in `run_folder`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from jaxdem.errors import RunError
from jaxdem.files.durable import remove_leftovers, write_bytes
from jaxdem.io import checkpoint as checkpoint_file
from jaxdem.io import scene_text
from jaxdem.io.access import LOCK, acquire_lock, input_errors, reason_of, still_locked
from jaxdem.io.frames import PARTS_FOLDER, Arrays
from jaxdem.io.pieces import Share, regroup
from jaxdem.io.probes import PROBES_FOLDER, Columns
from jaxdem.io.run_files import LINES, RunFiles
from jaxdem.io.run_folder import CHECKPOINT, SCENE, START, entries, occupied, require_usable
from jaxdem.io.samples import sample_frame


class RunDirectory:
    """Writer of a run directory; use as a context manager, so that the lock is released.

    Attributes:
        path: the folder.
        frames: number of committed frames (lines of the history).
        samples: number of samples written.
        sample_attributes: constants stored as attributes of `samples.h5`.
    """

    def __init__(
        self,
        path: Path,
        scene_toml: str,
        lock: int | None,
        sample_attributes: Arrays | None,
        probes: Mapping[str, Columns] | None = None,
        share: Share | None = None,
    ):
        self._share = share
        self.path = path
        self.sample_attributes = dict(sample_attributes or {})
        self._lock = lock
        self._time = 0.0
        self._files = RunFiles(path, scene_text.parse(scene_toml, str(path / SCENE)), share, probes or {})
        self.samples = self._files.samples.count()

    @property
    def frames(self) -> int:
        return self._files.history.rows

    @classmethod
    def create(
        cls,
        path: str | Path,
        scene_toml: str,
        sample_attributes: Arrays | None = None,
        probes: Mapping[str, Columns] | None = None,
        share: Share | None = None,
    ) -> RunDirectory:
        """Start a run in a new or empty folder and store its scene; `probes` are the columns of each probe's file.

        Of several processes the first one does, the others wait for it.

        Raises:
            InputError: the folder holds something, is in use, or cannot be written.
        """
        path = Path(path)
        if share is not None and not share.first:
            share.barrier()
            return cls(path, scene_toml, None, sample_attributes, probes, share)
        require_usable(path, scene_toml, resume=False)
        with input_errors(path):
            path.mkdir(parents=True, exist_ok=True)
        with _locked_for_a_run(path) as lock:
            # Between the look above and the lock another run may have come and gone.
            if entries(path):
                raise occupied(path)
            write_bytes(path / SCENE, scene_toml.encode())
            found = cls(path, scene_toml, lock, sample_attributes, probes, share)
            found._files.meet()
            return found

    @classmethod
    def resume(
        cls,
        path: str | Path,
        scene_toml: str,
        sample_attributes: Arrays | None = None,
        defaults: Mapping[str, object] | None = None,
        probes: Mapping[str, Columns] | None = None,
        share: Share | None = None,
    ) -> RunDirectory:
        """Open the folder of an unfinished run; nothing is cut yet, see `cut_back`.

        A run that was killed before its first checkpoint (see `has_checkpoint`) has its scene only, and starts anew.
        Of several processes the first one opens it, and what another number of them has written becomes theirs.

        Raises:
            InputError: there is no checkpoint, the stored scene is another one, or the folder is in use.
        """
        path = Path(path)
        if share is not None and not share.first:
            share.barrier()
            return cls(path, scene_toml, None, sample_attributes, probes, share)
        require_usable(path, scene_toml, resume=True, defaults=defaults)
        with _locked_for_a_run(path) as lock:
            remove_leftovers(path)
            remove_leftovers(path / PARTS_FOLDER)
            remove_leftovers(path / PROBES_FOLDER)
            checkpoint_file.remove_old_parts(path / CHECKPOINT)
            regroup(path, share)
            found = cls(path, scene_toml, lock, sample_attributes, probes, share)
            found._files.meet()
            return found

    @property
    def has_checkpoint(self) -> bool:
        """Whether there is a restart state."""
        return (self.path / CHECKPOINT).is_file()

    def store_scene(self, scene_toml: str) -> None:
        """Replace the stored scene by the one that the run goes on with.

        Raises:
            RunError: the disk refused.
        """
        if not self._files.first:
            return
        with self._run_errors(self._time):
            write_bytes(self.path / SCENE, scene_toml.encode())

    def write_frame(
        self, index: int, time: float, frame: Mapping[str, Arrays | None], history_row: Mapping[str, float | None]
    ) -> None:
        """Write output `index` at `time` [s] and commit it.

        Args:
            index: must be `frames`, the next one.
            time: simulated time [s]; put into the history.
            frame: arrays by series, see `jaxdem.io.series.KINDS`; None or left out if not of the scene.
            history_row: metrics by column name; what is lacking or None stays empty.

        Raises:
            RunError: the disk refused; earlier frames are kept.
        """
        if index != self.frames:
            raise ValueError(f"frame {index} given, {self.frames} are written")
        with self._run_errors(time):
            self._files.series.write(index, time, frame)
            self._files.meet()
            self._files.history.append({**history_row, "time": float(time)})

    def write_sample(self, index: int, time: float, arrays: Arrays) -> None:
        """Write sample `index` (must be `samples`, the next one) at `time` [s].

        Raises:
            RunError: the disk refused; earlier samples are kept.
        """
        if index != self.samples:
            raise ValueError(f"sample {index} given, {self.samples} are written")
        with self._run_errors(time):
            if self._files.first:
                self._files.samples.write(index, sample_frame(time, arrays, self.sample_attributes))
        self.samples = index + 1

    def write_probe(self, name: str, time: float, leading: np.ndarray, table: np.ndarray) -> None:
        """Add lines to the file of a probe.

        Args:
            name: of the probe.
            time: simulated time [s], for messages.
            leading, table: see `ProbeFiles.append`.

        Raises:
            RunError: the disk refused; earlier lines are kept.
        """
        with self._run_errors(time):
            self._files.probes.append(name, leading, table)

    def write_checkpoint(
        self, arrays: Arrays, attributes: Mapping[str, str | int | float], blocks: Arrays | None = None
    ) -> None:
        """Replace the restart state; `attributes` holds the numbers `frames` and `samples` it follows.

        The lines of probes that it follows are those that are written. Of several processes each gives the `arrays`
        that all have alike, and of those that are distributed along their first axis its `blocks`.

        Raises:
            RunError: the disk refused; the former checkpoint is kept.
        """
        for name, written in (("frames", self.frames), ("samples", self.samples)):
            if not 0 <= int(attributes[name]) <= written:
                raise ValueError(f"checkpoint after {attributes[name]} {name}, {written} are written")
        with self._run_errors(self._time):
            place, known = self.path / CHECKPOINT, {**attributes, **self._files.lines}
            if self._share is None:
                checkpoint_file.write_checkpoint(place, arrays, known)
                checkpoint_file.remove_old_parts(place)
            else:
                checkpoint_file.write_shared_checkpoint(place, self._share, arrays, blocks or {}, known)

    def keep_start(self, arrays: Mapping[str, np.ndarray], attributes: Mapping[str, object]) -> None:
        """Store the state that the run begins from, unless that was done: that other run may go on, or be deleted.

        Raises:
            RunError: the disk refused.
        """
        if self._files.first and not (self.path / START).is_file():
            with self._run_errors(self._time):
                checkpoint_file.write_checkpoint(self.path / START, arrays, attributes)

    def checkpoint(self) -> tuple[dict[str, np.ndarray], checkpoint_file.Attributes]:
        """Arrays and attributes of the newest checkpoint.

        Raises:
            InputError: it is missing or damaged.
        """
        return checkpoint_file.read_checkpoint(self.path / CHECKPOINT)

    def cut_back(self, frames: int, samples: int, lines: Mapping[str, int] | None = None) -> None:
        """Drop every frame and sample after the first `frames` and `samples`, and the old summary.

        Args:
            frames, samples: numbers that a checkpoint follows.
            lines: by name of the probe, the same of the lines of its file; see `lines_before`.

        Raises:
            InputError: the folder holds fewer than that, so the checkpoint cannot be continued.
        """
        lines = lines or {}
        self._files.require_held(frames, (samples, self.samples), lines)
        with self._run_errors(self._time):
            self._files.cut(frames, samples, lines)
            self.samples = samples

    def lines_before(self, attributes: Mapping[str, object]) -> dict[str, int]:
        """By name of the probe, number of lines of its file that a checkpoint follows, from the attributes of it."""
        return {name: int(str(attributes[f"{LINES}{name}"])) for name in self._files.probes.rows}

    def finish(self, summary: Mapping[str, object]) -> None:
        """Join the frames and write `summary.json` with `complete` true (unless given otherwise).

        Raises:
            RunError: the disk refused; all frames stay readable as parts.
        """
        self._close_run({"complete": True, **summary})

    def interrupt(self, summary: Mapping[str, object]) -> None:
        """As `finish` for a run that did not reach its end: `complete` is false."""
        self._close_run({**summary, "complete": False})

    def close(self) -> None:
        """Let another run write here; writing nothing."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _close_run(self, summary: dict[str, object]) -> None:
        with self._run_errors(self._time):
            self._files.join(self.frames, self.samples, summary, self._require_own_folder)

    @contextmanager
    def _run_errors(self, time: float) -> Iterator[None]:
        """Turn what the disk refuses into a message; nothing is written to a folder that is not the run's own."""
        self._time = float(time)
        self._require_own_folder()
        try:
            yield
        except OSError as error:
            reason = f"cannot write to the run directory: {reason_of(error)}"
            remedy = f"Earlier frames are kept ({self.frames}). Free some disk space or correct the permissions, then"
            raise RunError(reason, str(self.path), self._time, f"{remedy} continue with --resume.") from error

    def _require_own_folder(self) -> None:
        """Raise RunError where another folder has taken the place of the one that the run began in."""
        if self._lock is not None and not still_locked(self.path, self._lock):
            reason = f"the run directory was moved, replaced, or its {LOCK} removed while the run wrote to it"
            remedy = "Nothing more was written. Continue with --resume in the place of the moved folder"
            raise RunError(reason, str(self.path), self._time, f"{remedy}, or start a new run.")


@contextmanager
def _locked_for_a_run(path: Path) -> Iterator[int]:
    """The lock of a folder, which stays with the run that opens well; what the disk refuses is a wrong `--out`."""
    lock = acquire_lock(path)
    try:
        with input_errors(path):
            yield lock
    except BaseException:
        os.close(lock)
        raise

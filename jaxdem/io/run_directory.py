"""The folder of one run: who may write to it, in which order, and how it is cut back and joined.

Order within one output time: the frames of fluid and particles, each a whole file, then the line of
`history.csv`. The line commits the frame: what a kill leaves beyond it does not count. A checkpoint
names the numbers of frames, samples and lines of probes it follows, and is written after them; `cut_back` returns to
it. What a folder holds is asked in `run_folder`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from jaxdem.errors import InputError, RunError
from jaxdem.files.durable import remove_leftovers, sync_directory, write_bytes
from jaxdem.io import checkpoint as checkpoint_file
from jaxdem.io import scene_text
from jaxdem.io.access import LOCK, OPTION, acquire_lock, input_errors, reason_of, still_locked
from jaxdem.io.frames import PARTS_FOLDER, Arrays, FrameSeries
from jaxdem.io.history import CountedHistory, History
from jaxdem.io.part_columns import columns_of_parts
from jaxdem.io.pieces import Share, regroup
from jaxdem.io.probes import PROBES_FOLDER, Columns, ProbeFiles
from jaxdem.io.run_folder import CHECKPOINT, HISTORY, SCENE, START, entries, occupied, require_usable
from jaxdem.io.samples import SampleFormat, sample_frame
from jaxdem.io.series import Written
from jaxdem.io.summary import SUMMARY, write_summary

LINES = "lines of probe "
"""Attribute of a checkpoint: number of lines of the file of the probe that is named behind it."""


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
        self._scene = scene_text.parse(scene_toml, str(path / SCENE))
        self._lock = lock
        self._time = 0.0
        self._series = Written(path, self._scene, share)
        self._samples = FrameSeries(path, SampleFormat())
        columns = columns_of_parts(self._scene)
        self._history = (History if self._first else CountedHistory)(path / HISTORY, columns)
        self._probes = ProbeFiles(path, probes or {}, self._first)
        self.samples = self._samples.count()

    @property
    def frames(self) -> int:
        return self._history.rows

    @property
    def _first(self) -> bool:
        """Whether this process writes what there is once."""
        return self._share is None or self._share.first

    def _meet(self) -> None:
        """Waits for the other processes of the run, if any."""
        if self._share is not None:
            self._share.barrier()

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
            found._meet()
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
            found._meet()
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
        if not self._first:
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
            self._series.write(index, time, frame)
            self._meet()
            self._history.append({**history_row, "time": float(time)})

    def write_sample(self, index: int, time: float, arrays: Arrays) -> None:
        """Write sample `index` (must be `samples`, the next one) at `time` [s].

        Raises:
            RunError: the disk refused; earlier samples are kept.
        """
        if index != self.samples:
            raise ValueError(f"sample {index} given, {self.samples} are written")
        with self._run_errors(time):
            if self._first:
                self._samples.write(index, sample_frame(time, arrays, self.sample_attributes))
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
            self._probes.append(name, leading, table)

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
            lines = {f"{LINES}{name}": rows for name, rows in self._probes.rows.items()}
            place, known = self.path / CHECKPOINT, {**attributes, **lines}
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
        if self._first and not (self.path / START).is_file():
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
        wanted = {"frames": frames, "samples": samples} | {f"{LINES}{name}": lines[name] for name in lines}
        held = {"frames": self.frames, "samples": self.samples}
        held |= {f"{LINES}{name}": rows for name, rows in self._probes.rows.items()}
        # A series that has no frame at all is one the scene does not have.
        held["frames"] = min([held["frames"], *(series.count() for series in self._series.there)])
        for name, number in wanted.items():
            if held[name] < number:
                limit = f"the checkpoint follows {number} {name}, only {held[name]} can be read"
                raise InputError(OPTION, str(self.path), limit, "Start the run anew in another folder.")
        with self._run_errors(self._time):
            if self._first:
                (self.path / SUMMARY).unlink(missing_ok=True)
            # The history first: its lines commit frames, so it never counts one that is gone.
            self._history.cut(frames)
            for series in self._series.every.values():
                series.cut(frames)
            if self._first:
                self._samples.cut(samples)
            self._probes.cut(lines)
            self.samples = samples
            for folder in (self.path, self.path / PARTS_FOLDER):
                if folder.is_dir():
                    sync_directory(folder)

    def lines_before(self, attributes: Mapping[str, object]) -> dict[str, int]:
        """By name of the probe, number of lines of its file that a checkpoint follows, from the attributes of it."""
        return {name: int(str(attributes[f"{LINES}{name}"])) for name in self._probes.rows}

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
        every = [(series, self.frames) for series in self._series.every.values()]
        if self._first:
            every.append((self._samples, self.samples))
        with self._run_errors(self._time):
            for series, number in every:
                if series.exists():
                    series.join(number)
                    self._require_own_folder()
            # Parts go only when all joined files are there.
            for series, _ in every:
                series.drop_parts()
            self._meet()
            if self._first:
                self._probes.join()
                parts = self.path / PARTS_FOLDER
                if parts.is_dir() and not any(parts.iterdir()):
                    parts.rmdir()
                write_summary(self.path, summary)
            self._meet()

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

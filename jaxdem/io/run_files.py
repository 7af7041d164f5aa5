"""The files of a run that grow with it: frames, samples, history and lines of probes, cut back and joined together."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from jaxdem.errors import InputError
from jaxdem.files.durable import sync_directory
from jaxdem.io.access import OPTION
from jaxdem.io.frames import PARTS_FOLDER, FrameSeries
from jaxdem.io.history import CountedHistory, History
from jaxdem.io.part_columns import columns_of_parts
from jaxdem.io.pieces import Share
from jaxdem.io.probes import Columns, ProbeFiles
from jaxdem.io.run_folder import HISTORY
from jaxdem.io.samples import SampleFormat
from jaxdem.io.series import Written
from jaxdem.io.summary import SUMMARY, write_summary

LINES = "lines of probe "
"""Attribute of a checkpoint: number of lines of the file of the probe that is named behind it."""


class RunFiles:
    """The files of a run directory that grow with the run.

    Attributes:
        first: whether this process writes what there is once.
        series: of frames.
        samples, history: of them.
        probes: a file each.
    """

    def __init__(self, path: Path, scene: dict[str, Any], share: Share | None, probes: Mapping[str, Columns]):
        self._path, self._share = path, share
        self.first = share is None or share.first
        self.series = Written(path, scene, share)
        self.samples = FrameSeries(path, SampleFormat())
        columns = columns_of_parts(scene)
        self.history = (History if self.first else CountedHistory)(path / HISTORY, columns)
        self.probes = ProbeFiles(path, probes, self.first)

    def meet(self) -> None:
        """Waits for the other processes of the run, if any."""
        if self._share is not None:
            self._share.barrier()

    @property
    def lines(self) -> dict[str, int]:
        """Number of lines of the file of every probe, by the attribute of a checkpoint that has it."""
        return {f"{LINES}{name}": rows for name, rows in self.probes.rows.items()}

    def require_held(self, frames: int, samples: tuple[int, int], lines: Mapping[str, int]) -> None:
        """Refuses a checkpoint that follows more than there is.

        Args:
            frames: that it follows.
            samples: that it follows, and that there are.
            lines: that it follows of each probe, by its name.

        Raises:
            InputError: naming what is missing.
        """
        wanted = {"frames": frames, "samples": samples[0]} | {f"{LINES}{name}": lines[name] for name in lines}
        held = {"frames": self.history.rows, "samples": samples[1]} | self.lines
        # A series that has no frame at all is one the scene does not have.
        held["frames"] = min([held["frames"], *(series.count() for series in self.series.there)])
        for name, number in wanted.items():
            if held[name] < number:
                limit = f"the checkpoint follows {number} {name}, only {held[name]} can be read"
                raise InputError(OPTION, str(self._path), limit, "Start the run anew in another folder.")

    def cut(self, frames: int, samples: int, lines: Mapping[str, int]) -> None:
        """Drops what is behind these numbers, and the old summary; may raise OSError."""
        if self.first:
            (self._path / SUMMARY).unlink(missing_ok=True)
        # The history first: its lines commit frames, so it never counts one that is gone.
        self.history.cut(frames)
        for series in self.series.every.values():
            series.cut(frames)
        if self.first:
            self.samples.cut(samples)
        self.probes.cut(lines)
        for folder in (self._path, self._path / PARTS_FOLDER):
            if folder.is_dir():
                sync_directory(folder)

    def join(self, frames: int, samples: int, summary: Mapping[str, object], joined: Callable[[], None]) -> None:
        """Joins so many frames and samples and writes the summary; may raise OSError.

        Args:
            frames, samples: numbers of them.
            summary: of the run.
            joined: called after each file.
        """
        every = [(series, frames) for series in self.series.every.values()]
        if self.first:
            every.append((self.samples, samples))
        for series, number in every:
            if series.exists():
                series.join(number)
                joined()
        # Parts go only when all joined files are there.
        for series, _ in every:
            series.drop_parts()
        self.meet()
        if self.first:
            self.probes.join()
            parts = self._path / PARTS_FOLDER
            if parts.is_dir() and not any(parts.iterdir()):
                parts.rmdir()
            write_summary(self._path, summary)
        self.meet()

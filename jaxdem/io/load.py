"""Read a run back: `load_run` works on a finished run, an interrupted one and one that was killed."""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from jaxdem.errors import InputError, is_whole
from jaxdem.io import scene_text
from jaxdem.io.chain import stage_names
from jaxdem.io.frames import Frame, FrameSeries
from jaxdem.io.history import read_history
from jaxdem.io.probes import Probes
from jaxdem.io.run_folder import HISTORY, SCENE
from jaxdem.io.samples import SampleFormat, Samples
from jaxdem.io.series import read_series
from jaxdem.io.summary import read_summary

_REMEDY = "Give a folder that `jaxdem run` wrote."


class Run:
    """A run on disk; frames are read when asked for, one at a time.

    Attributes:
        path: the folder.
        scene_toml: the text of the scene as run; `scene` the same as nested dicts.
        summary: `summary.json`, empty while there is none (running, or killed).
        history: float64 (T,) by column of `history.csv`; NaN where there is no value.
        probes: of the probe NAME, `probes["NAME"]`, float64 (L,) by column of its file; see `io.probes.Probes`.
        number_of_frames: T, frames that are committed and readable.
    """

    def __init__(self, path: str | Path):
        if not isinstance(path, (str, os.PathLike)):
            raise InputError("run", type(path).__name__, "is no path", _REMEDY)
        self.path = Path(path)
        if names := stage_names(self.path):
            limit = f"holds the stages {', '.join(names)}, each a run of its own"
            raise InputError("run", str(self.path), limit, f"give the folder of one, such as {self.path / names[-1]}")
        if not (self.path / SCENE).is_file() or not (self.path / HISTORY).is_file():
            limit = f"is not a run directory: it lacks {SCENE} or {HISTORY}"
            raise InputError("run", str(self.path), limit, _REMEDY)
        try:
            self.scene_toml = scene_text.read(self.path / SCENE)
        except OSError as error:
            limit = f"its {SCENE} cannot be read ({error.strerror})"
            raise InputError("run", str(self.path), limit, _REMEDY) from error
        self.scene: dict[str, Any] = scene_text.parse(self.scene_toml, str(self.path / SCENE))
        self.summary = read_summary(self.path)
        self.probes = Probes(self.path, scene_text.probe_names(self.scene))
        self._series = read_series(self.path)
        history = read_history(self.path / HISTORY)
        counts = [len(history["time"]), *(series.count() for series in self._series.values() if series.exists())]
        self.number_of_frames = min(counts)
        if self.summary.get("complete") and max(counts) > self.number_of_frames:
            numbers = f"{self.number_of_frames} to {max(counts)}"
            limit = f"is complete, yet its files have unequal numbers of outputs, {numbers}"
            remedy = f"{HISTORY} or a file of frames was cut off: take it from a backup, or run the scene again"
            raise InputError("run", str(self.path), limit, remedy)
        self.history = {name: column[: self.number_of_frames] for name, column in history.items()}

    @property
    def times(self) -> np.ndarray:
        """Times (T,) [s] of the frames."""
        return self.history["time"]

    @cached_property
    def has_particles(self) -> bool:
        return self._series["particles"].exists()

    @cached_property
    def has_fluid(self) -> bool:
        return self._series["fluid"].exists()

    def particles(self, index: int) -> dict[str, np.ndarray]:
        """Particles at output `index` (negative from the end), {} in a scene without.

        Returns:
            `position` (N, 3) [m], `velocity`, `angular_velocity`, `drag_force`, `contact_force` (N, 3),
            `radius` (N,), `id` (N,), as far as written; `active` (N,) uint8, 1 for those present, where particles
            come and go. In 2-D the components are (x, z, 0), and of the
            angular velocity (0, 0, scalar).

        Raises:
            IndexError: there is no such frame.
        """
        return self._arrays("particles", self._checked(index))

    def spheres(self, index: int) -> dict[str, np.ndarray]:
        """What touches at output `index`: the particles, or the members of clumps.

        Returns:
            `position` (M, 3) [m], `velocity` (M, 3), `radius` (M,), `id` (M,) of the particle or body; `active` (M,)
            as in `particles`.

        Raises:
            IndexError: there is no such frame.
        """
        name = "spheres" if self._series["spheres"].exists() else "particles"
        return self._arrays(name, self._checked(index))

    def fluid(self, index: int) -> dict[str, np.ndarray] | None:
        """Fluid at output `index` (negative from the end), None in a scene without.

        Returns:
            `velocity` cells + (3,) [m/s], `pressure` cells [Pa], `void_fraction` cells, indexed
            [ix, iy(, iz)]; in 2-D the components are (x, z, 0).

        Raises:
            IndexError: there is no such frame.
        """
        return self._arrays("fluid", self._checked(index)) or None

    def bonds(self, index: int) -> dict[str, np.ndarray]:
        """Bonds at output `index` (negative from the end), {} in a scene without.

        Returns:
            `position` (2 B, 3), the centres of the two grains of each bond one after the other [m]; (B,) each: `first`
            and `second`, their identities; `table`; `status` (0 intact, 1 broken in tension, 2 in shear, 3 a grain has
            left); `normal_force`, positive in tension, `shear_force` [N], `bending_moment`, `twisting_moment` [N m],
            `tensile_stress`, `shear_stress` [Pa] and `bond_energy` [J].

        Raises:
            IndexError: there is no such frame.
        """
        return self._arrays("bonds", self._checked(index))

    @cached_property
    def dimension(self) -> int:
        """2 or 3."""
        for series in self._series.values():
            if self.number_of_frames and series.exists():
                return int(series.read(0).attributes["dimension"])
        size = self.scene.get("domain", {}).get("size")
        if not isinstance(size, list):
            raise InputError("domain.size", size, "is not in the scene of a run without frames", _REMEDY)
        return len(size)

    @cached_property
    def cells(self) -> tuple[int, ...] | None:
        """Number (D,) of cells of the fluid along each axis, None without fluid."""
        frame = self._first_fluid
        if frame is not None:
            return tuple(frame.arrays["pressure"].shape)
        cells = self.scene.get("fluid", {}).get("cells")
        return tuple(int(number) for number in cells) if isinstance(cells, list) else None

    @cached_property
    def spacing(self) -> tuple[float, ...] | None:
        """Size (D,) of a cell [m], None without fluid."""
        frame = self._first_fluid
        if frame is not None:
            return tuple(float(length) for length in frame.attributes["spacing"][: self.dimension])
        return None if self.cells is None else scene_text.spacing(self.scene, self.cells)

    @cached_property
    def samples(self) -> Samples | None:
        """What the drag law saw, None where the scene asked for no samples."""
        series = FrameSeries(self.path, SampleFormat())
        return Samples(series, series.count()) if series.exists() else None

    @cached_property
    def _first_fluid(self) -> Frame | None:
        return self._series["fluid"].read(0) if self.number_of_frames and self.has_fluid else None

    def _arrays(self, name: str, index: int) -> dict[str, np.ndarray]:
        """Of frame `index` of a series; {} in a scene without it."""
        series = self._series[name]
        return series.read(index).arrays if series.exists() else {}

    def _checked(self, index: int) -> int:
        if not is_whole(index) or not -self.number_of_frames <= index < self.number_of_frames:
            raise IndexError(f"frame {index} of {self.number_of_frames} in {self.path}")
        return index % self.number_of_frames


def load_run(path: str | Path) -> Run:
    """Open the run directory `path` for reading.

    Raises:
        InputError: it is no run directory, or a file in it is damaged.
    """
    return Run(path)

"""The series of frames that a run directory may have, each in files of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxdem.io import scene_text
from jaxdem.io.bond_file import BondFormat, bond_frame
from jaxdem.io.fluid_file import FluidFormat, fluid_frame
from jaxdem.io.frames import Arrays, Format, Frame, FrameSeries
from jaxdem.io.particle_file import ParticleFormat, SphereFormat, particle_frame
from jaxdem.io.pieces import PieceSeries, Share, SharedSeries, series_of

Tables = Mapping[str, Any]
"""A scene as nested dicts."""


class Kind(NamedTuple):
    """A series of frames.

    Attributes:
        format: of its files.
        frame: makes a frame of a time [s], arrays, and the tables of the scene.
        shared: whether each of several processes writes its part; the first one writes the others.
    """

    format: Format
    frame: Callable[[float, Arrays, Tables], Frame]
    shared: bool = False


def _cells(time: float, arrays: Arrays, scene: Tables) -> Frame:
    spacing = scene_text.spacing(scene, np.asarray(arrays["pressure"]).shape)
    return fluid_frame(time, arrays, spacing, scene_text.depth(scene, spacing))


def _points(time: float, arrays: Arrays, scene: Tables) -> Frame:
    return particle_frame(time, arrays)


def _lines(time: float, arrays: Arrays, scene: Tables) -> Frame:
    return bond_frame(time, arrays)


KINDS: dict[str, Kind] = {
    "fluid": Kind(FluidFormat(), _cells, shared=True),
    "particles": Kind(ParticleFormat(), _points, shared=True),
    "bonds": Kind(BondFormat(), _lines),
    "spheres": Kind(SphereFormat(), _points),
}
"""By name, in the order in which they are written."""


class Written:
    """The series of a run directory, for writing.

    Attributes:
        every: by name, as far as this process writes them.
    """

    def __init__(self, folder: Path, scene: Tables, share: Share | None):
        self._scene = scene
        alone = share is None or share.first
        self.every = {name: _series(folder, kind, share) for name, kind in KINDS.items() if kind.shared or alone}

    def write(self, index: int, time: float, frame: Mapping[str, Arrays | None]) -> None:
        """Frame `index` of every series that has one.

        Args:
            index: the next one.
            time: simulated time [s].
            frame: arrays of each series by name; one that is None or not there is not of the scene.

        Raises:
            ValueError: there is no series of a name.
        """
        if unknown := set(frame) - set(KINDS):
            raise ValueError(f"no series {sorted(unknown)}, known: {list(KINDS)}")
        for name, series in self.every.items():
            arrays = frame.get(name)
            if arrays is not None:
                series.write(index, KINDS[name].frame(time, arrays, self._scene))

    @property
    def there(self) -> list[FrameSeries]:
        """Those that have frames."""
        return [series for series in self.every.values() if series.exists()]


def read_series(folder: Path) -> dict[str, FrameSeries | PieceSeries]:
    """The series of a run directory by name, for reading, whoever has written them."""
    return {name: (series_of if kind.shared else FrameSeries)(folder, kind.format) for name, kind in KINDS.items()}


def _series(folder: Path, kind: Kind, share: Share | None) -> FrameSeries:
    if share is None or not kind.shared:
        return FrameSeries(folder, kind.format)
    return SharedSeries(folder, kind.format, share)

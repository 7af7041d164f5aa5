"""A frame of a run of jaxdem: its folder, or its particles.vtkhdf."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from jaxdem.io import scene_text
from jaxdem.io.particle_file import ParticleFormat
from jaxdem.io.pieces import series_of
from jaxdem.io.run_folder import SCENE
from jaxdem.particle_files.arrays import raw_of_arrays
from jaxdem.particle_files.columns import Source
from jaxdem.particle_files.raw import Raw, at_time, chosen, refusal


def is_frames(path: Path) -> bool:
    """Whether a path is that of a run or of its particles."""
    return path.is_dir() or path.name == particles_name()


def particles_name() -> str:
    """Name of the file of particles in a run directory."""
    return f"{ParticleFormat.stem}{ParticleFormat.suffix}"


def read_frame(source: Source) -> Raw:
    """The particles that are present in a frame: position, velocity, spin, radius and id; of parcels the radius of a
    grain.

    Raises:
        InputError: it is no run, or there is no such frame.
    """
    path = Path(source.name)
    folder = path if path.is_dir() else path.parent
    series = series_of(folder, ParticleFormat())
    if not series.exists() or not (count := series.count()):
        limit = f"holds no frame of particles ({particles_name()})"
        raise refusal(source.name, limit, "give a folder that `jaxdem run` wrote")
    if source.time is None:
        index = chosen(source.frame, count, source.name)
    else:
        index = at_time(source.time, series.times(count).tolist(), source.name)
    frame = series.read(index)
    arrays = {name: np.asarray(array) for name, array in frame.arrays.items()}
    if "radius" in arrays:
        arrays["radius"] = arrays["radius"] / _coarse_grain(folder)
    present = arrays.pop("active", np.ones(len(arrays["position"]))) != 0
    if int(frame.attributes["dimension"]) == 2:
        arrays |= {name: arrays[name][:, :2] for name in ("position", "velocity") if name in arrays}
        if "angular_velocity" in arrays:
            arrays["angular_velocity"] = arrays["angular_velocity"][:, 2]
    return raw_of_arrays(source.name, {name: array[present] for name, array in arrays.items()}, strict=False)


def _coarse_grain(folder: Path) -> float:
    """Radius of the particles of a run over that of the grains for which a scene gives radii; 1 for a run without its
    scene."""
    if not (folder / SCENE).is_file():
        return 1.0
    scene = scene_text.parse(scene_text.read(folder / SCENE), str(folder / SCENE))
    return float(scene.get("particles", {}).get("coarse_grain", 1.0))

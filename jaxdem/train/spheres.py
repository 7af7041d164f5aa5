"""Forces on spheres of particle-resolved simulations: the file that closures of neighbours are trained on."""

from __future__ import annotations

import dataclasses
import os
import re
from functools import lru_cache

import h5py
import numpy as np
from numpy.typing import NDArray

from jaxdem.errors import InputError
from jaxdem.files.hdf5 import UNREADABLE
from jaxdem.files.reading import open_regular

GROUP = re.compile(r"Re_(\d+(?:\.\d+)?)_phi_(\d+(?:\.\d+)?)")
"""Name of a group: Reynolds number, and solid fraction in per cent."""
LAYOUT = "Give a file with groups Re_RR_phi_PP of position, force, torque (S, 3), start (n + 1), box (n, 6) and radius."
FEWEST = 2
"""Arrays that a group must have: one to train on, one held out."""

RANDOM_SIDE, RANDOM_ARRAYS = 9.0, 8
"""Side of the boxes of random arrays in diameters, at least, and their number."""

Floats = NDArray[np.floating]


@dataclasses.dataclass(frozen=True, eq=False)
class SphereGroup:
    """Periodic arrays of fixed spheres in a stream along the first axis, at one Re and solid fraction.

    Lengths are in diameters d, forces in rho U^2 d^2 and torques in rho U^2 d^3, U the superficial velocity. The force
    is that of the whole fluid, the mean pressure gradient included.

    Attributes:
        name: of the group in the file.
        reynolds: U d / nu [-].
        solid_fraction: [-].
        start: (n + 1,) first sphere of every array, and the number of spheres.
        position: (S, 3) centres.
        force: (S, 3).
        torque: (S, 3).
        box: (n, 3) side lengths of every array.
    """

    name: str
    reynolds: float
    solid_fraction: float
    start: NDArray[np.int64]
    position: Floats
    force: Floats
    torque: Floats
    box: Floats

    @property
    def arrays(self) -> int:
        """n, their number."""
        return len(self.box)

    @property
    def of_array(self) -> NDArray[np.int64]:
        """(S,) number of the array of every sphere."""
        return np.repeat(np.arange(self.arrays), np.diff(self.start))

    def select(self, arrays: NDArray[np.int64]) -> SphereGroup:
        """The group with the given arrays only."""
        rows = np.concatenate([np.arange(self.start[a], self.start[a + 1]) for a in arrays])
        start = np.concatenate([[0], np.cumsum(np.diff(self.start)[arrays])])
        parts = {name: getattr(self, name)[rows] for name in ("position", "force", "torque")}
        return dataclasses.replace(self, start=start, box=self.box[arrays], **parts)

    def split(self, fraction: float, seed: int) -> tuple[SphereGroup, SphereGroup]:
        """The arrays to train on, and those held out: a fraction of them, drawn by the seed, one at least."""
        order = np.random.default_rng(seed).permutation(self.arrays)
        held_out = max(1, round(fraction * self.arrays))
        return self.select(np.sort(order[held_out:])), self.select(np.sort(order[:held_out]))


def read_spheres(path: str | os.PathLike[str], reach: float) -> tuple[SphereGroup, ...]:
    """The groups of a file, in the order of their names.

    Args:
        path: HDF5 with groups Re_RR_phi_PP, PP in per cent; of each the attribute `radius` and the datasets `position`,
            `force`, `torque` (S, 3), `start` (n + 1,) and `box` (n, 6), low and high end along each axis.
        reach: `half_box` of the closure in diameters; the boxes must be twice as wide.

    Raises:
        InputError: no such file, or not of this layout.
    """
    try:
        # Data of others may be compressed, which `open_for_reading` refuses.
        with open_regular(path) as raw, h5py.File(raw, "r") as file:
            named = {name: found for name in sorted(file) if (found := GROUP.fullmatch(name))}
            if not named:
                raise _refusal(path, "has no group with a name such as Re_10_phi_20")
            return tuple(_group(file[name], path, found, reach) for name, found in named.items())
    except UNREADABLE as error:
        raise _refusal(path, f"cannot be read ({error})") from error


def _refusal(path: str | os.PathLike[str], limit: str) -> InputError:
    return InputError("DATA", str(path), limit, LAYOUT)


def _group(found: h5py.Group, path: str | os.PathLike[str], named: re.Match[str], reach: float) -> SphereGroup:
    """A group in units of the diameter, checked."""
    name, reynolds, solid_fraction = named[0], float(named[1]), 0.01 * float(named[2])
    missing = [key for key in ("position", "force", "torque", "start", "box") if key not in found]
    if "radius" not in found.attrs:
        missing.append("attribute radius")
    if missing:
        raise _refusal(path, f"has no {', '.join(missing)} in the group {name}")
    start = np.asarray(found["start"][()], np.int64)
    ends, diameter = np.asarray(found["box"][()], np.float64), 2.0 * float(np.ravel(found.attrs["radius"])[0])
    vectors = {key: np.asarray(found[key][()], np.float32) for key in ("position", "force", "torque")}
    spheres = len(vectors["position"])
    shapes = {key: value.shape for key, value in vectors.items()} | {"start": start.shape, "box": ends.shape}
    count = len(start) - 1
    wanted = dict.fromkeys(vectors, (spheres, 3)) | {"start": (count + 1,), "box": (count, 6)}
    for key, shape in wanted.items():
        if shapes[key] != shape:
            raise _refusal(path, f"has {key} of shape {shapes[key]} in the group {name}, and not {shape}")
    if count < FEWEST:
        raise _refusal(path, f"has {count} array(s) in the group {name}, and {FEWEST} are needed at least")
    if start[0] != 0 or start[-1] != spheres or (np.diff(start) < 1).any():
        raise _refusal(path, f"has a start in the group {name} that does not rise from 0 to the {spheres} spheres")
    finite = np.isfinite(ends).all() and all(np.isfinite(value).all() for value in vectors.values())
    if not (finite and diameter > 0):
        raise _refusal(path, f"has values in the group {name} that are not finite numbers, or no positive radius")
    box = (ends[:, 1::2] - ends[:, ::2]) / diameter
    if box.min() < 2.0 * reach:
        limit = f"has a box of {box.min():.4g} diameters in the group {name}, and twice the reach is {2.0 * reach:.4g}"
        raise InputError("DATA", str(path), limit, "Give wider boxes, or a closure with a shorter reach.")
    position = (vectors["position"] / diameter).astype(np.float32)
    return SphereGroup(
        name, reynolds, solid_fraction, start, position, vectors["force"], vectors["torque"], box.astype(np.float32)
    )


@lru_cache(maxsize=16)
def random_positions(solid_fraction: float, side: float) -> Floats:
    """(S, 3) centres of `RANDOM_ARRAYS` arrays of spheres that are added at random where none overlaps, one array after
    the other; up to a solid fraction of about 0.35 [diameters]."""
    generator, count = np.random.default_rng(0), round(solid_fraction * side**3 / (np.pi / 6.0))
    found = np.zeros((RANDOM_ARRAYS, count, 3), np.float32)
    for array in found:
        placed = 0
        while placed < count:
            tried = generator.uniform(0.0, side, 3)
            apart = array[:placed] - tried
            apart -= side * np.round(apart / side)
            if placed == 0 or (apart**2).sum(axis=1).min() > 1.0:
                array[placed] = tried
                placed += 1
    return found.reshape(-1, 3)


def random_group(reynolds: float, solid_fraction: float, side: float) -> SphereGroup:
    """Random arrays without forces, to see what a closure gives in the mean."""
    position = random_positions(solid_fraction, side)
    start = np.arange(RANDOM_ARRAYS + 1) * (len(position) // RANDOM_ARRAYS)
    none, box = np.zeros_like(position), np.full((RANDOM_ARRAYS, 3), side, np.float32)
    return SphereGroup("random", reynolds, solid_fraction, start, position, none, none, box)

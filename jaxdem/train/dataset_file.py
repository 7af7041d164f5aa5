"""The dataset file: what the drag law would see on coarsened fields, and the force that it should give."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Mapping
from typing import Any

import h5py
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxdem.closures.base import DragInputs
from jaxdem.files.hdf5 import attributes_of, image_of, in_memory, store, write_attributes
from jaxdem.files.stored import DATASET, reading, write_whole

ROOT_ATTRIBUTES = ("drag", "fluid_density", "dynamic_viscosity", "dimension", "run", "scene_toml")
GROUP_ATTRIBUTES = ("filter_size", "kernel_width")
SCALARS = ("time", "solid_fraction", "diameter")
VECTORS = (
    "particle_velocity",
    "fluid_velocity",
    "void_fraction_gradient",
    "pressure_gradient",
    "drag_force",
    "target_force",
)

LATER = ("wide_solid_fraction",)
"""Numbers that files of the first versions lack."""

SEEING = ("coupling.kernel_width", "coupling.void_fraction", "coupling.deconvolution")
"""Keys of a scene that say how a mesh sees the particles, and its drag law the fluid."""

RANGES = {"diameter": (0.0, math.inf)}
"""What lies outside cannot be the sample of a run."""

Floats = NDArray[np.floating[Any]]


@dataclasses.dataclass(frozen=True, eq=False)
class Group:
    """Samples of one coarsening: M rows, each a particle at a time, in D dimensions.

    Attributes:
        coarsening: fine cells along a side of the coarse cell; 1 is the fine mesh itself.
        filter_size: size of the coarse cell [m].
        kernel_width: width of the smoothing kernel of the void fraction [m].
        fluid_density: [kg/m3].
        dynamic_viscosity: [Pa s].
        time: (M,) [s].
        particle_velocity: (M, D) [m/s].
        fluid_velocity: (M, D) averaged to the coarse mesh, interstitial, at the particle [m/s].
        solid_fraction: (M,) averaged, at the particle [-].
        void_fraction_gradient: (M, D) of the averaged field [1/m].
        pressure_gradient: (M, D) of the averaged reduced pressure [Pa/m].
        diameter: (M,) [m].
        drag_force: (M, D) what the drag law of the fine run gave, in the form of model A [N].
        target_force: (M, D) fluid force of the fine run less the pressure and viscous force that a run on the
            coarse mesh applies itself [N].
        wide_solid_fraction: (M,) see `DragInputs`; None of a file without [-].
    """

    coarsening: int
    filter_size: float
    kernel_width: float
    fluid_density: float
    dynamic_viscosity: float
    time: Floats
    particle_velocity: Floats
    fluid_velocity: Floats
    solid_fraction: Floats
    void_fraction_gradient: Floats
    pressure_gradient: Floats
    diameter: Floats
    drag_force: Floats
    target_force: Floats
    wide_solid_fraction: Floats | None = None

    def __len__(self) -> int:
        return len(self.time)

    def select(self, rows: NDArray[np.integer | np.bool_]) -> Group:
        """The group with the given rows only (indices or a mask)."""
        arrays = {name: getattr(self, name) for name in SCALARS + VECTORS + LATER}
        arrays = {name: None if array is None else array[rows] for name, array in arrays.items()}
        return dataclasses.replace(self, **arrays)

    def drag_inputs(self) -> DragInputs:
        """What a drag closure is given: JAX arrays in the samples' dtype (float32 where x64 is off)."""
        dtype = jnp.asarray(self.fluid_velocity[:0]).dtype
        given = {name: getattr(self, name) for name in DragInputs._fields}
        arrays: dict[str, Any] = {name: jnp.asarray(own, dtype) for name, own in given.items() if own is not None}
        return DragInputs(**arrays)


@dataclasses.dataclass(frozen=True, eq=False)
class Dataset:
    """Samples of one run at one or more coarsenings.

    Attributes:
        drag: scene name of the drag law of the run.
        fluid_density: [kg/m3].
        dynamic_viscosity: [Pa s].
        dimension: D.
        run: name of the run; data are split by it.
        scene_toml: the scene of the run, with the coarse mesh's kernel where that is another.
        groups: by coarsening, ascending.
    """

    drag: str
    fluid_density: float
    dynamic_viscosity: float
    dimension: int
    run: str
    scene_toml: str
    groups: dict[int, Group]


def write_dataset(
    path: str | os.PathLike[str],
    attributes: Mapping[str, object],
    groups: Mapping[int, Mapping[str, ArrayLike]],
) -> None:
    """Write a dataset file aside, sync it and move it into place.

    Args:
        path: file to write; its folder must exist.
        attributes: all of `ROOT_ATTRIBUTES`: drag, fluid_density [kg/m3], dynamic_viscosity [Pa s],
            dimension, run, scene_toml.
        groups: for every coarsening `GROUP_ATTRIBUTES` [m] and the arrays of `SCALARS` (M,) and `VECTORS` (M,
            D); see `Group`.

    Raises:
        InputError: an attribute or array is missing or has a wrong shape, or the place cannot be written.
    """
    with in_memory("dataset") as file:
        root = {name: _require(attributes, name, str(path)) for name in ROOT_ATTRIBUTES}
        write_attributes(file, {"format": DATASET.format, "version": DATASET.version, **root})
        for coarsening, content in sorted(groups.items()):
            place = f"coarsen_{coarsening}"
            group = file.create_group(place)
            for name in GROUP_ATTRIBUTES:
                group.attrs[name] = float(_require(content, name, str(path), place))
            later = tuple(name for name in LATER if name in content)
            for name in SCALARS + VECTORS + later:
                store(group, name, _require(content, name, str(path), place))
        _read(file, str(path))
        image = image_of(file)
    write_whole(path, image, DATASET.key)


def read_dataset(path: str | os.PathLike[str]) -> Dataset:
    """Read and check a dataset file.

    Raises:
        InputError: no such file, not HDF5 or cut short, not a dataset, of a newer version, without a group,
            or with an array that is missing, of another shape, or not finite (the array is named).
    """
    with reading(path, DATASET) as file:
        return _read(file, str(path))


def _read(file: h5py.File, path: str) -> Dataset:
    own = attributes_of(file)
    root = {name: _require(own, name, path) for name in ROOT_ATTRIBUTES}
    fluid: dict[str, Any] = {name: float(root[name]) for name in ("fluid_density", "dynamic_viscosity")}
    for name, value in fluid.items():
        if not 0.0 < value < math.inf:
            raise DATASET.refusal(path, f"{name} is {value}, it must be positive")
    dimension = int(root["dimension"])
    coarsenings = sorted(int(name.removeprefix("coarsen_")) for name in file if name.startswith("coarsen_"))
    if not coarsenings:
        raise DATASET.refusal(path, "holds no group coarsen_<n>")
    groups = {}
    for coarsening in coarsenings:
        name = f"coarsen_{coarsening}"
        groups[coarsening] = Group(coarsening=coarsening, **fluid, **_read_group(file[name], name, dimension, path))
    text: dict[str, Any] = {name: str(root[name]) for name in ("drag", "run", "scene_toml")}
    return Dataset(**text, **fluid, dimension=dimension, groups=groups)


def _read_group(group: h5py.Group, place: str, dimension: int, path: str) -> dict[str, Any]:
    """Attributes and arrays of one group, checked against each other."""
    content: dict[str, Any] = {name: float(_require(group.attrs, name, path, place)) for name in GROUP_ATTRIBUTES}
    rows = _require(group, "time", path, place).shape[0]
    valid_run = "Make it again from a run whose summary says valid."
    later = tuple(name for name in LATER if name in group)
    for name in SCALARS + VECTORS + later:
        stored = _require(group, name, path, place)
        shape = (rows, dimension) if name in VECTORS else (rows,)
        if stored.shape != shape or rows == 0:
            limit = f"{place}/{name} has shape {stored.shape}, {shape} with at least one row is needed"
            raise DATASET.refusal(path, limit)
        values = content[name] = stored[()]
        if name in RANGES and not (RANGES[name][0] < values.min() and values.max() < RANGES[name][1]):
            limit = f"{place}/{name} reaches from {values.min()} to {values.max()}, beyond {RANGES[name]}"
            raise DATASET.refusal(path, limit, valid_run)
        with np.errstate(over="ignore"):  # training is in single precision
            finite = values.dtype.kind == "f" and np.isfinite(values.astype(np.float32)).all()
        if not finite:
            limit = f"{place}/{name} holds values that are not finite numbers in single precision"
            raise DATASET.refusal(path, limit, valid_run)
    return content


def _require(content: Any, name: str, path: str, place: str = "") -> Any:
    """An entry that must be there."""
    if name not in content:
        raise DATASET.refusal(path, f"{place}/{name} is missing" if place else f"{name} is missing")
    return content[name]

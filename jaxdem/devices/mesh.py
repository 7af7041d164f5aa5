"""Devices as a mesh, and functions of one slab as programs over all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from jaxdem.devices.message_order import in_one_order
from jaxdem.errors import InputError, is_whole
from jaxdem.numerics.blocks import MESH_AXIS
from jaxdem.state import Diagnostics, State

SLABS: Any = PartitionSpec(MESH_AXIS)
"""Of arrays with an axis of slabs in front, one a device."""

SAME: Any = PartitionSpec()
"""Of arrays that are the same on all devices."""

STATE: Any = State(particles=SLABS, fluid=SLABS, step=SAME, scalars=SLABS)
"""How a state is distributed: particles, fluid and scalars by slabs, the step counter the same everywhere."""

DIAGNOSTICS: Any = Diagnostics(particles=SAME, fluid=SAME, exchange=SAME, forces=SLABS, places=SLABS)
"""How what a step reports is distributed: forces and places of particles by slabs, all else of the box."""


def device_mesh(devices: int | Sequence[jax.Device]) -> Mesh:
    """A mesh of devices along `MESH_AXIS`.

    Args:
        devices: the first so many that there are, in all processes, or which.

    Raises:
        InputError: there are not so many, or it is neither a number nor a list of devices.
    """
    if not is_whole(devices) and not (isinstance(devices, Sequence) and devices and all(map(_is_device, devices))):
        limit = "is neither a number of devices nor a list of them"
        raise InputError("devices", devices, limit, "give a whole number, or some of jax.devices()")
    there = jax.devices()
    if not isinstance(devices, Sequence):
        if not 1 <= devices <= len(there):
            more = "on a CPU set XLA_FLAGS=--xla_force_host_platform_device_count=N before JAX starts"
            seen, wanted = ("one device", "1") if len(there) == 1 else (f"{len(there)} devices", f"1 to {len(there)}")
            raise InputError("devices", devices, f"JAX sees {seen}", f"ask for {wanted}; {more}")
        devices = there[:devices]
    return Mesh(np.array(devices), (MESH_AXIS,))


def _is_device(value: object) -> bool:
    return isinstance(value, jax.Device)


def on_slabs(mesh: Mesh, function: Callable[..., Any], given: Any, result: Any) -> Callable[..., Any]:
    """A function of one slab as a function of all, for `jit`, `grad` and loops.

    Args:
        mesh: from `device_mesh`.
        function: of arrays of one slab; may use `jaxdem.numerics.blocks`.
        given: for every argument `SLABS`, `SAME` or a tree of them that is a prefix of the argument, such as `STATE`.
        result: the same of the result.
    """

    # Devices that are processors run parts of a program at once. An abstract mesh has none: nothing is run on it.
    processors = isinstance(mesh, Mesh) and mesh.size > 1 and mesh.devices.flat[0].platform == "cpu"
    own = in_one_order(function) if processors else function

    def of_one(*arguments: Any) -> Any:
        found = own(*_each(lambda x: x[0], given, arguments))
        return _each(lambda x: x[None], result, found)

    # The rows of a slab are told apart by hand: loops start from constants, which the check takes for the same
    # everywhere.
    mapped: Callable[..., Any] = jax.shard_map(of_one, mesh=mesh, in_specs=given, out_specs=result, check_vma=False)
    return mapped


def _each(change: Callable[[Any], Any], specs: Any, tree: Any) -> Any:
    """The tree with the arrays changed that have an axis of slabs."""

    def of_part(spec: PartitionSpec, part: Any) -> Any:
        return jax.tree.map(change, part) if spec == SLABS else part

    return jax.tree.map(of_part, specs, tree, is_leaf=lambda x: isinstance(x, PartitionSpec))


def put(mesh: Mesh, tree: Any, spec: PartitionSpec = SLABS) -> Any:
    """Arrays of the host on the devices; every process has all of them.

    Those without elements are the same everywhere, as XLA gives them back: a step takes what it gave without another
    program.
    """

    def placed(x: Any) -> jax.Array:
        array = np.asarray(x)
        sharding = NamedSharding(mesh, spec if array.size else SAME)
        return jax.make_array_from_callback(array.shape, sharding, lambda index: array[index])

    return jax.tree.map(placed, tree)


def on_host(tree: Any) -> Any:
    """Arrays as NumPy's, all slabs of all processes; every process must call it."""

    def fetched(x: Any) -> np.ndarray:
        if not isinstance(x, jax.Array) or x.is_fully_addressable or x.is_fully_replicated:
            return np.asarray(x)
        # Loaded only where there are several processes.
        from jax.experimental import multihost_utils

        return np.asarray(multihost_utils.process_allgather(x, tiled=True))

    return jax.tree.map(fetched, tree)

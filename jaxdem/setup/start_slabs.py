"""The checkpoint of a run on several devices as that of one device, for another run to begin from. Host, numpy."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxdem.devices.bonds import bonds_of_slabs
from jaxdem.devices.contacts import contacts_of_rows, kept_by_identity
from jaxdem.devices.gathering import rows_by_identity
from jaxdem.devices.particle_fields import AXIS_OF_PARTICLES
from jaxdem.devices.scalars import scalars_of_slabs
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.slabs import fluid_of_slabs
from jaxdem.numerics.blocks import Blocks
from jaxdem.particles.bond_state import BondRecord, BondState, KeptBonds
from jaxdem.scalars.scalar_state import ScalarState, Supplied
from jaxdem.setup.stored import ROWS, SLAB_AXIS, SLAB_COUNT, named, stored

PARTICLES, SPRING = "state.particles.", "state.particles.contact_spring"
FURTHER = ("liquid_fraction", "liquid_supplied", "pressure_change")
BONDS, SCALARS = "state.particles.bonds", "state.scalars"


def on_one_device(
    arrays: Mapping[str, np.ndarray], attributes: Mapping[str, Any]
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Arrays and attributes without slabs, row i of particle i; of the list only the pairs whose contacts keep
    something.

    Args:
        arrays, attributes: of a checkpoint; one of a run on one device is given back as it is.

    Raises:
        InputError: an array is missing.
    """
    if SLAB_COUNT not in attributes:
        return dict(arrays), dict(attributes)
    found = {name: value for name, value in arrays.items() if not name.startswith(("state.", "neighbors."))}
    found["state.step"] = stored(arrays, "state.step")
    blocks = Blocks(int(attributes[SLAB_COUNT]), int(attributes[SLAB_AXIS]), False)
    if "state.fluid.pressure" in arrays:
        found |= named("state.fluid", fluid_of_slabs(blocks, _fluid(arrays)))
    if f"{SCALARS}.supplied.sides" in arrays:
        identity = arrays.get(f"{PARTICLES}identity")
        found |= named(SCALARS, scalars_of_slabs(blocks, _scalars(arrays), identity, int(attributes[ROWS])))
    if f"{PARTICLES}identity" in arrays:
        found |= _particles(arrays, int(attributes[ROWS]))
    told = {name: value for name, value in attributes.items() if name not in (SLAB_COUNT, SLAB_AXIS, ROWS)}
    return found, told


def _fluid(arrays: Mapping[str, np.ndarray]) -> FluidState:
    """The fluid in slabs."""
    faces: Any = _vector(arrays, "state.fluid.face_velocity")
    rest: Any = [arrays.get(f"state.fluid.{name}") for name in ("pressure", "void_fraction", "mean_gradient")]
    further: Any = {name: arrays.get(f"state.fluid.{name}") for name in FURTHER}
    return FluidState(faces, *rest)._replace(**further)


def _scalars(arrays: Mapping[str, np.ndarray]) -> ScalarState:
    """Temperatures and other scalars in slabs."""
    counted: Any = (arrays.get(f"{SCALARS}.supplied.{name}") for name in Supplied._fields)
    of_cells = _vector(arrays, f"{SCALARS}.fields")
    rest: Any = (arrays.get(f"{SCALARS}.{name}") for name in ("grains", "coming", "capacity"))
    grains, coming, capacity = rest
    found: Any = ScalarState(of_cells, grains, Supplied(*counted), coming, capacity)  # type: ignore[arg-type]
    return found


def _bonds(arrays: Mapping[str, np.ndarray]) -> BondState | None:
    """What the grains of slabs keep of their bonds; None without."""
    if f"{BONDS}.kept.partner" not in arrays:
        return None

    def both_parts(name: str) -> dict[str, Any]:
        high = _vector(arrays, f"{BONDS}.{name}")
        low = _vector(arrays, f"{BONDS}.{name}_low") or (None,) * len(high)
        kind = name.split(".")[-1]
        return {kind: high, f"{kind}_low": low}

    def named_parts(place: str, names: tuple[str, ...]) -> dict[str, Any]:
        return both_parts(f"{place}.separation") | {name: stored(arrays, f"{BONDS}.{place}.{name}") for name in names}

    kept = KeptBonds(**named_parts("kept", ("partner", "table", "status", "number")))
    known: Any = arrays.get(f"{BONDS}.record.status")
    record = BondRecord(**named_parts("record", ("first", "second", "table")), status=known)
    nothing: Any = None
    return BondState(nothing, (), (), nothing, nothing, **both_parts("orientation"), kept=kept, record=record)


def _vector(arrays: Mapping[str, np.ndarray], name: str) -> Any:
    """The arrays of a vector."""
    return tuple(arrays[part] for part in _components(arrays, name))


def _components(arrays: Mapping[str, np.ndarray], name: str) -> list[str]:
    """Names of the arrays of a vector, in their order."""
    found: list[str] = []
    while f"{name}[{len(found)}]" in arrays:
        found.append(f"{name}[{len(found)}]")
    return found


def _particles(arrays: Mapping[str, np.ndarray], count: int) -> dict[str, np.ndarray]:
    """The `count` particles, and their contacts."""
    identity, active = (stored(arrays, f"{PARTICLES}{name}") for name in ("identity", "active"))
    there = active & (identity >= 0)
    number = identity[there]
    present = np.zeros(count, bool)
    present[number] = True
    found = {f"{PARTICLES}active": present}
    for name, values in arrays.items():
        field = re.match(r"state\.particles\.(\w+)", name)
        axis = None if field is None else AXIS_OF_PARTICLES.get(field[1])
        if axis is not None:
            found[name] = rows_by_identity(values, there, number, count, axis)
        elif name.startswith(tuple(f"{PARTICLES}{field}" for field in ("inserted", "pistons", "mesh_wear"))):
            found[name] = values[0]
    listed = (stored(arrays, f"neighbors.{name}") for name in ("ghosts.identity", "pairs.first", "pairs.second"))
    springs = _components(arrays, SPRING)
    rows, own = next(listed), identity.shape[1]
    kept = contacts_of_rows(tuple(arrays[name] for name in springs), np.arange(rows.shape[1]) < own, rows, *listed)
    found |= dict(zip(springs, kept.values, strict=True)) | _memory_of_meshes(arrays, identity, count)
    bonds = _bonds(arrays)
    if bonds is not None:
        found |= named(BONDS, bonds_of_slabs(bonds, identity, there, count))
    return found | {"neighbors.pairs.first": kept.first, "neighbors.pairs.second": kept.second}


def _memory_of_meshes(arrays: Mapping[str, np.ndarray], identity: np.ndarray, count: int) -> dict[str, np.ndarray]:
    """What contacts with meshes keep, with a row for every particle."""
    found: dict[str, np.ndarray] = {}
    while (row := f"neighbors.meshes[{len(found)}].row") in arrays:
        found[row] = np.arange(count, dtype=np.int32)
    for number, row in enumerate(list(found)):
        kept = f"{PARTICLES}mesh_memory[{number}]."
        for name in (name for name in arrays if name.startswith(kept)):
            found[name] = kept_by_identity(arrays[name], arrays[row], identity, count)
    return found

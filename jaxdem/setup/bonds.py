"""The bonds of a scene: who is bonded when it begins, the first state of the bonds, and their numbers. Host side."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from jax import Array
from scipy.spatial import KDTree

from jaxdem.errors import InputError, number_of_tables
from jaxdem.numerics.host import on_device
from jaxdem.particles.bond_geometry import BondParameters
from jaxdem.particles.bond_state import INTACT, LEFT, BondState, entries_of
from jaxdem.particles.pairs import Pairs
from jaxdem.scene import Scene
from jaxdem.scene.bonds import Bond
from jaxdem.setup.regions import region_space

FURTHEST = 1.0
"""Largest gap between the surfaces of bonded grains, over the radius of the smaller one."""

STORED = "state.particles.bonds"
"""Prefix of the bonds in a checkpoint."""


class BondList(NamedTuple):
    """The bonds of a scene.

    Attributes:
        first, second: (B,) int64, rows of the two grains of each, the lower one first.
        table: (B,) int64, number of the table that made it.
        separation: (B, D) centre of the first less centre of the second when it was made [m].
        status: (B,) int64, see `bond_state`.
        stored: of a run that goes on, the arrays of its checkpoint; None where the bonds are new.
    """

    first: np.ndarray
    second: np.ndarray
    table: np.ndarray
    separation: np.ndarray
    status: np.ndarray
    stored: Mapping[str, np.ndarray] | None = None

    @property
    def length(self) -> np.ndarray:
        """(B,) distance of the centres when they were made [m]."""
        return np.asarray(np.linalg.norm(self.separation, axis=1))


def bond_list(
    scene: Scene, position: np.ndarray, radius: np.ndarray, active: np.ndarray, foreseen: bool = False
) -> BondList | None:
    """The bonds that a scene begins with; None for a scene without.

    Args:
        scene: the scene.
        position: (N, D) centres at its start [m].
        radius: () or (N,) [m].
        active: () or (N,) bool, which of them are present.
        foreseen: whether the positions are not yet known: then a table may find no pair.

    Raises:
        InputError: a table finds no pair, two tables find the same one, or a listed pair cannot be bonded.
    """
    if not scene.bonds:
        return None
    radius, active = (np.broadcast_to(x, len(position)) for x in (radius, active))
    grains = _Grains(scene, position, radius, active)
    found, tables = [], []
    for number, bond in enumerate(scene.bonds):
        key = f"bonds.{number}"
        listed = bond.listed(f"{key}.pairs")
        pairs = grains.near(key, bond, foreseen) if listed is None else grains.checked(key, listed, foreseen)
        found.append(pairs)
        tables.append(np.full(len(pairs), number, np.int64))
    pairs, table = np.concatenate(found), np.concatenate(tables)
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    pairs, table = pairs[order], table[order]
    twice = np.flatnonzero((pairs[1:] == pairs[:-1]).all(axis=1))
    if len(twice):
        one, other = sorted(int(t) for t in table[twice[0] : twice[0] + 2])
        where = f"grains {pairs[twice[0], 0]} and {pairs[twice[0], 1]}"
        limit = f"are bonded by bonds.{one} already" if one != other else "are a pair twice"
        raise InputError(f"bonds.{other}", where, limit, "bond every pair once: change region or pairs")
    apart = grains.separation(pairs)
    return BondList(pairs[:, 0], pairs[:, 1], table, apart, np.full(len(pairs), INTACT, np.int64))


class _Grains(NamedTuple):
    """The grains that may be bonded; see `bond_list`."""

    scene: Scene
    position: np.ndarray
    radius: np.ndarray
    active: np.ndarray

    def separation(self, pairs: np.ndarray) -> np.ndarray:
        """(P, D) centre of the first less centre of the second, nearest images [m]."""
        apart = self.position[pairs[:, 0]] - self.position[pairs[:, 1]]
        size = np.asarray(self.scene.domain.size)
        return np.where(self.scene.periodic, apart - size * np.round(apart / size), apart)

    def gap(self, pairs: np.ndarray) -> np.ndarray:
        """(P,) between the surfaces [m]."""
        reach = self.radius[pairs[:, 0]] + self.radius[pairs[:, 1]]
        return np.asarray(np.linalg.norm(self.separation(pairs), axis=1) - reach)

    def near(self, key: str, bond: Bond, foreseen: bool) -> np.ndarray:
        """(P, 2) pairs of present grains of the region whose surfaces are at most `bond.gap` apart."""
        gap = bond.gap or 0.0
        there, size = self.active.copy(), np.asarray(self.scene.domain.size)
        inside = np.where(self.scene.periodic, self.position - size * np.floor(self.position / size), self.position)
        if bond.region is not None:
            there &= region_space(f"{key}.region", bond.region, self.scene.box).inside(inside)
        rows = np.flatnonzero(there)
        if len(rows) > 1:
            smallest = float(self.radius[rows].min())
            if gap > FURTHEST * smallest:
                limit = f"grains would be bonded across others; the limit is the smallest radius, {smallest:.4g} m"
                raise InputError(f"{key}.gap", gap, limit, "lower it; grains that touch need no gap")
            reach = 2.0 * float(self.radius[rows].max()) + max(gap, 0.5 * smallest)  # the closest, to tell
            tree = KDTree(inside[rows], boxsize=np.where(self.scene.periodic, size, 0.0))
            pairs = rows[tree.query_pairs(reach * (1.0 + 1e-12), output_type="ndarray")].reshape(-1, 2)
            gaps = self.gap(pairs)
            near = np.sort(pairs[gaps <= gap * (1.0 + 1e-9)], axis=1)
            if len(near) or foreseen:
                return near
            closest = f"the closest are {gaps.min():.4g} m apart" if len(gaps) else "none are near each other"
        elif foreseen:
            return np.zeros((0, 2), np.int64)
        else:
            closest = f"it has {len(rows)} grains to bond"
        where = "" if bond.region is None else " of its region"
        limit = f"bonds no two grains{where}: {closest}"
        raise InputError(f"{key}.gap", gap, limit, "raise it, move the region, or remove the table")

    def checked(self, key: str, pairs: np.ndarray, foreseen: bool) -> np.ndarray:
        """Pairs of a list, the lower identity first.

        Raises:
            InputError: naming the first that cannot be bonded.
        """
        count = len(self.position)
        pairs = np.sort(pairs, axis=1)
        known = pairs[:, 1] < count
        safe = np.minimum(pairs, max(count - 1, 0))
        there = known & self.active[safe].all(axis=1)
        gap = self.gap(safe)
        furthest = FURTHEST * self.radius[safe].min(axis=1)
        reasons = (
            (pairs[:, 0] == pairs[:, 1], "is a grain and itself"),
            (~known, f"names a grain that there is not: identities go from 0 to {count - 1}"),
            (~there, "names a grain that is not present at the start"),
            ((gap > furthest) & (not foreseen), "lies apart by more than the radius of the smaller grain"),
        )
        for wrong, reason in reasons:
            if wrong.any():
                row = int(np.argmax(wrong))
                raise InputError(f"{key}.pairs", f"pair {row}: {pairs[row].tolist()}", reason, "correct the pair")
        return pairs


def stored_bonds(scene: Scene, arrays: Mapping[str, np.ndarray], removed: np.ndarray, source: str) -> BondList | None:
    """The bonds of the run that a scene begins from; None where it had none.

    Args:
        scene: that begins.
        arrays: of the checkpoint.
        removed: rows of grains that are removed at the start.
        source: folder of the run.

    Raises:
        InputError: the scene has fewer tables, or lists other pairs.
    """
    if f"{STORED}.status" not in arrays:
        return None
    table, status = arrays[f"{STORED}.table"][:-1], arrays[f"{STORED}.status"][:-1].astype(np.int64)
    tables = int(table.max(initial=0)) + 1
    if len(scene.bonds) < tables:
        limit = f"the bonds of the run {source}, of {tables} table{'s' * (tables > 1)}, go on with the numbers of these"
        remedy = "give as many tables, in the same order, or leave them out to go on with those of the run"
        raise InputError("bonds", number_of_tables(scene.bonds), limit, remedy)
    first, second = (arrays[f"{STORED}.pairs.{name}"][:-1].astype(np.int64) for name in ("first", "second"))
    for number, bond in enumerate(scene.bonds[:tables]):
        own = table == number
        _check_listed(f"bonds.{number}.pairs", bond, np.stack([first[own], second[own]], axis=1), source)
    gone = np.isin(first, removed) | np.isin(second, removed)
    status = np.where((status == INTACT) & gone, LEFT, status)
    return BondList(first, second, table.astype(np.int64), _pair_sum(arrays, "separation")[:-1], status, arrays)


def _check_listed(key: str, bond: Bond, made: np.ndarray, source: str) -> None:
    """Refuses a list of other pairs than the bonds (P, 2) of a table that go on."""
    listed = bond.listed(key)
    if listed is None or {*map(tuple, np.sort(listed, axis=1).tolist())} == {*map(tuple, made.tolist())}:
        return
    limit = f"the bonds are those of the run {source}, whose {len(made)} pairs of this table are others"
    raise InputError(key, f"{len(listed)} pairs", limit, "give the same list: bonds are made once")


def _pair_sum(arrays: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    """(n, k) of stored components, leading and trailing parts together."""
    columns: list[np.ndarray] = []
    while f"{STORED}.{name}[{len(columns)}]" in arrays:
        column = arrays[f"{STORED}.{name}[{len(columns)}]"].astype(np.float64)
        columns.append(column + arrays.get(f"{STORED}.{name}_low[{len(columns)}]", 0.0))
    return np.stack(columns, axis=1)


def bond_state(bonds: BondList, count: int, dtype: np.dtype[np.floating]) -> BondState:
    """The bonds of the first state, between `count` grains that there ever are."""
    still = np.zeros((count, 4))
    still[:, 0] = 1.0
    # The empty one at the end is of length one, so that nothing is divided by zero.
    apart = np.vstack([bonds.separation, np.eye(1, bonds.separation.shape[1])])

    def column(values: np.ndarray, last: int) -> Array:
        return on_device(np.append(values, last), np.int32)

    def parts(values: np.ndarray, name: str) -> tuple[tuple[Array, ...], tuple[Array | None, ...]]:
        high = values.astype(dtype)
        low = (values - high).astype(dtype)
        arrays, axes = bonds.stored or {}, range(values.shape[1])
        for k in axes if f"{STORED}.{name}[0]" in arrays else ():
            before = arrays[f"{STORED}.{name}[{k}]"]
            own = arrays.get(f"{STORED}.{name}_low[{k}]", np.zeros_like(before))
            if before.dtype != dtype:
                whole = before.astype(np.float64) + own
                before, own = whole.astype(dtype), (whole - whole.astype(dtype)).astype(dtype)
            high[: len(before), k], low[: len(before), k] = before, own
        lows = (None if dtype == np.float64 else on_device(low[:, k], dtype) for k in axes)
        return tuple(on_device(high[:, k], dtype) for k in axes), tuple(lows)

    entry = on_device(entries_of(bonds.first, bonds.second, count), np.int32)
    return BondState(
        Pairs(column(bonds.first, 0), column(bonds.second, 0), entry),
        *parts(apart, "separation"),
        column(bonds.table, 0),
        column(bonds.status, LEFT),
        *parts(still, "orientation"),
    )


def bond_parameters(scene: Scene, number: Callable[[list[float]], Array]) -> BondParameters | None:
    """The numbers of the bonds; None for a scene without.

    Args:
        scene: the scene.
        number: makes an array.
    """
    tables = scene.bonds
    if not tables:
        return None
    of_cement = any(bond.young_modulus is not None for bond in tables)
    return BondParameters(
        normal_stiffness=number([bond.normal_stiffness or 0.0 for bond in tables]),
        shear_stiffness=number([bond.shear_stiffness or 0.0 for bond in tables]),
        radius_factor=number([bond.radius_factor for bond in tables]),
        tensile_strength=number([bond.tensile_strength or math.inf for bond in tables]),
        shear_strength=number([bond.shear_strength or math.inf for bond in tables]),
        moment_factor=number([bond.moment_factor for bond in tables]),
        damping=number([bond.damping for bond in tables]) if any(bond.damping for bond in tables) else None,
        young_modulus=number([bond.moduli[0] for bond in tables]) if of_cement else None,
        shear_modulus=number([bond.moduli[1] for bond in tables]) if of_cement else None,
    )

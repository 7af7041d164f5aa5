"""What `jaxdem check` says of the openings of walls that the fluid sees."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator

import numpy as np

from jaxdem.errors import required
from jaxdem.setup.builder import Case
from jaxdem.setup.cut_cells import FluidSurface, cut_cells_of
from jaxdem.setup.openings import WallOpening, with_openings

FINER = 2
"""Cells of the mesh that areas are compared with, in a length of one of the fluid."""

ROUGH = 0.05
"""Part of its area by which an opening may differ on that mesh without a caution [-]."""


def opening_rows(case: Case) -> tuple[tuple[str, str], ...]:
    """Key and text of every opening: its area on the mesh, and on a finer one."""
    return tuple(
        (
            one.key,
            f"{one.table.kind} of {one.area:.4g} m2 on this mesh, {finer:.4g} m2 on one of half its cell size",
        )
        for one, finer in zip(case.fluid_walls.openings, _finer_areas(case), strict=True)
    )


def opening_cautions(case: Case) -> Iterator[str]:
    """A sentence for every opening whose area the mesh does not resolve, and for every two that share cells."""
    yield from _shared_cells(case)
    for one, finer in zip(case.fluid_walls.openings, _finer_areas(case), strict=True):
        off = one.area / finer - 1.0 if finer > 0.0 else 1.0
        if abs(off) > ROUGH:
            given = "brings as much more or less" if one.table.by_velocity else "has another velocity"
            yield (
                f"{one.key}: its area on this mesh is {100.0 * off:+.2g} % from that on one of half its cell size, so "
                f"that it {given}. Use smaller cells, or a region that reaches further beyond the surface."
            )


def _shared_cells(case: Case) -> Iterator[str]:
    cut = None if case.parameters.fluid is None else case.parameters.fluid.cut
    if cut is None or cut.openings is None:
        return
    supplies = [np.asarray(part.supply) for part in cut.openings]
    for (first, a), (second, b) in itertools.combinations(zip(case.fluid_walls.openings, supplies, strict=True), 2):
        number = int(np.count_nonzero((a > 0.0) & (b > 0.0)))
        if not number:
            continue
        one_way = {_sign(first), _sign(second)} in ({1}, {-1})
        told = "what they bring is mixed there" if one_way else "only the difference of their flows passes there"
        yield (
            f"{first.key} and {second.key} share {number} cell(s) of the fluid: {told}. To keep them apart, move their "
            "regions by a cell."
        )


def _sign(one: WallOpening) -> int:
    """1 of an opening that only brings fluid, -1 of one that only takes it off, else 0."""
    amounts = one.table.amounts
    if one.is_outlet or max(amounts) <= 0.0:
        return -1
    return 1 if min(amounts) >= 0.0 else 0


def _finer_areas(case: Case) -> tuple[float, ...]:
    seen = case.fluid_walls
    if not seen.openings:
        return ()
    grid = required(case.simulation.fluid, "fluid").solver.grid
    finer = dataclasses.replace(grid, cells=tuple(FINER * n for n in grid.cells))
    cut, _ = cut_cells_of(finer, [FluidSurface(s.distance_at_start, s.no_slip) for s in seen.surfaces])
    return tuple(one.area for one in with_openings(finer, cut, seen.surfaces, seen.openings)[1])

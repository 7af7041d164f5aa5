"""Capacity that larger cells lend to small ones between walls that the fluid sees. Host, numpy."""

from __future__ import annotations

import math

import numpy as np

from jaxdem.fluid.grid import Grid, along


def lent_capacity(
    grid: Grid, faces: tuple[np.ndarray, ...], open_cells: np.ndarray, most: float, least: np.ndarray | None = None
) -> tuple[np.ndarray, float]:
    """What larger cells lend to small ones [-], and the least of capacity over need.

    A cell needs as much as its open faces pass of what those of a whole one do. What it lacks it borrows of the largest
    of its neighbours that an open face leads to.

    Args:
        grid: the grid.
        faces: open fractions.
        open_cells: of the cells.
        most: part of its own that a cell lends.
        least: what the cells need; None for what is said above [-].
    """
    places = np.arange(open_cells.size).reshape(open_cells.shape)
    need, largest, lender = np.zeros_like(open_cells), np.full(open_cells.shape, -1.0), places.copy()
    per_face = [1.0 / h**2 for h in grid.spacing]
    for axis, a in enumerate(faces):
        for shift, own in ((1, along(a, axis, None, -1)), (-1, along(a, axis, 1, None))):  # type: ignore[arg-type]
            need += 0.5 * per_face[axis] / sum(per_face) * np.asarray(own)
            is_open = np.asarray(own) > 0.0
            if not grid.periodic[axis]:
                end = 0 if shift == 1 else -1
                is_open[(slice(None),) * axis + (end,)] = False
            beside = np.where(is_open, np.roll(open_cells, shift, axis), -1.0)
            better = beside > largest
            largest = np.where(better, beside, largest)
            lender = np.where(better, np.roll(places, shift, axis), lender)
    need = need if least is None else least
    short = np.where((open_cells > 0.0) & (largest > open_cells), np.maximum(need - open_cells, 0.0), 0.0)
    asked = np.bincount(lender.ravel(), short.ravel(), open_cells.size).reshape(open_cells.shape)
    share = np.minimum(1.0, most * open_cells / np.where(asked > 0.0, asked, 1.0))
    borrowed = short * share.ravel()[lender]
    given = np.bincount(lender.ravel(), borrowed.ravel(), open_cells.size).reshape(open_cells.shape)
    lent = borrowed - given
    there = (open_cells > 0.0) & (need > 0.0)
    least = np.min((open_cells + lent)[there] / need[there], initial=math.inf)
    return lent, float(least)

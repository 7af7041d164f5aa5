"""The bonds of a run for ParaView: `bonds.vtkhdf`, temporal PolyData of VTKHDF with one line a bond.

A line has two points of its own, the centres of its grains: across a periodic side the second one stands outside of the
box, beside the first. The topology, and what never changes, is stored once.
"""

from __future__ import annotations

import h5py
import numpy as np

from jaxdem.io.frames import Arrays, Entries, Frame, extend
from jaxdem.io.vtkhdf import ROOT, PolyDataFormat, append_points, name_unit, write_topology

UNCHANGING = ("first", "second", "table")
"""Cell data that are stored once."""


def bond_frame(time: float, arrays: Arrays) -> Frame:
    """Arrays of bonds as VTK wants them.

    Args:
        time: simulated time [s].
        arrays: `ends` (B, 2, D) centres of the two grains [m]; others as (B,).

    Raises:
        ValueError: an array does not have B rows.
    """
    ends = np.asarray(arrays["ends"])
    number, _, dimension = ends.shape
    points = np.pad(ends.reshape(2 * number, dimension), ((0, 0), (0, 3 - dimension)))
    stored = {name: np.asarray(values) for name, values in arrays.items() if name != "ends"}
    for name, values in stored.items():
        if values.shape != (number,):
            raise ValueError(f"{name} has shape {values.shape}, expected ({number},)")
    return Frame(float(time), {"position": points, **stored}, {"dimension": dimension})


class BondFormat(PolyDataFormat):
    """See the module; the number of bonds is the same in all frames."""

    stem, data, points, content = "bonds", "CellData", 2, "bonds"

    def append(self, file: h5py.File, frame: Frame, growing: bool) -> Entries:
        """See `frames.Format`."""
        names = sorted(set(frame.arrays) - {"position"})
        if ROOT not in file:
            self.head(file, "PolyData", frame, growing)
            write_topology(file[ROOT], "Lines", self.points, len(frame.arrays["position"]) // self.points)
        root = file[ROOT]
        entries, chunk = append_points(root, frame, growing)
        data = root.require_group("CellData")
        for name in names:
            known = name in UNCHANGING and name in data
            start = 0 if known else extend(data, name, frame.arrays[name], growing, chunk)
            entries[f"CellDataOffsets/{name}"] = start
            name_unit(data[name], name)
        return entries

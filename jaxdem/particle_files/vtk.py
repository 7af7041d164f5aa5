"""Points of VTK files, legacy and XML: PolyData, unstructured grids and structured ones.

The `vtk` package reads them in a process of its own: it is not needed for anything else, and a damaged file may crash
it. (`meshio` reads neither PolyData in XML nor most of it in the legacy format.)
"""

from __future__ import annotations

import os
import subprocess
import sys

from jaxdem.errors import cut
from jaxdem.files.reading import TABLE_BYTES, open_regular, parse_arrays
from jaxdem.particle_files import vtk_program
from jaxdem.particle_files.arrays import raw_of_arrays
from jaxdem.particle_files.raw import Raw, refusal

LEGACY = b"# vtk DataFile"
SECONDS, BYTES_PER_SECOND = 60.0, 10e6
"""What reading may take at least, and what a slow disk gives beyond that."""


def is_vtk(head: bytes) -> bool:
    """Whether a file begins as one of VTK does."""
    start = head.lstrip()
    return start.startswith(LEGACY) or (start.startswith((b"<?xml", b"<VTKFile")) and b"<VTKFile" in head)


def read_vtk(name: str) -> Raw:
    """The points of a file with the arrays that it has for them.

    Raises:
        InputError: the package is not there, or it cannot read the file.
        OSError: the file cannot be opened, or is too large.
    """
    with open_regular(name) as file:
        size = os.fstat(file.fileno()).st_size
    if size > TABLE_BYTES:
        raise OSError(f"has {size} bytes, the limit is {TABLE_BYTES}")
    seconds = SECONDS + size / BYTES_PER_SECOND
    try:
        done = subprocess.run(
            [sys.executable, "-P", vtk_program.__file__, name],
            stdin=subprocess.DEVNULL, capture_output=True, check=False, timeout=seconds,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise refusal(name, f"VTK did not come to an end in it within {seconds:.0f} s", "write the file anew") from None
    if done.returncode == vtk_program.NO_PACKAGE:
        raise refusal(
            name,
            "the package `vtk` is needed to read it and is not installed",
            "install it, for instance as the part jaxdem[vtk]",
        )
    if done.returncode != 0:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        reason = said[-1] if said and done.returncode > 0 else f"signal {-done.returncode}"
        remedy = "give a PolyData or an unstructured grid whose points are the centres of the particles"
        raise refusal(name, f"VTK cannot read particles from it ({cut(reason, 200)})", remedy)
    arrays = parse_arrays(done.stdout)
    labels = arrays.pop("names").tolist()
    return raw_of_arrays(name, {label: arrays[f"a{k}"] for k, label in enumerate(labels)}, strict=False)

"""A program: `python vtk_program.py FILE` writes the points of a VTK file and their arrays as .npz to its output.

It imports nothing of jaxdem. It may take so much memory and no more, because a file can claim any number of points.
"""

from __future__ import annotations

import resource
import sys
from typing import Any

import numpy as np

NO_PACKAGE = 3
"""Exit code where `vtk` is not installed."""

MOST_MEMORY = 1 << 34
"""Address space of this program [B]."""


def points_of(path: str) -> dict[str, np.ndarray]:
    """The arrays of a file by name, the points under `points`.

    Raises:
        ValueError: the file is damaged or has no points.
    """
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow
    from vtkmodules.vtkCommonDataModel import vtkPointSet
    from vtkmodules.vtkIOXML import vtkXMLGenericDataObjectReader

    said = vtkStringOutputWindow()  # a reader goes on after most errors, with numbers that are not in the file
    vtkOutputWindow.SetInstance(said)
    with open(path, "rb") as file:
        legacy = file.read(64).lstrip().startswith(b"#")
    reader: Any = _legacy_reader(path) if legacy else vtkXMLGenericDataObjectReader()
    if not legacy:
        reader.SetFileName(path)
    reader.Update()
    output = reader.GetOutput()
    if said.GetOutput().strip() or reader.GetErrorCode():
        lines = [line for line in said.GetOutput().splitlines() if line.strip()]
        raise ValueError(lines[-1] if lines else "it is damaged")
    if not isinstance(output, vtkPointSet) or not output.GetNumberOfPoints():
        raise ValueError("it has no points")
    found = {"points": vtk_to_numpy(output.GetPoints().GetData())}
    data = output.GetPointData()
    for number in range(data.GetNumberOfArrays()):
        array = data.GetArray(number)
        if array is not None and array.GetName() and array.GetNumberOfTuples() == output.GetNumberOfPoints():
            found.setdefault(array.GetName(), vtk_to_numpy(array))
    return found


def _legacy_reader(path: str) -> Any:
    """A reader of all arrays of a legacy file; VTK would read the first of each kind.

    The content ends with a line break: without one VTK does not notice that a file ends within an array.
    """
    from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader

    reader: Any = vtkGenericDataObjectReader()
    reader.ReadAllScalarsOn()
    reader.ReadAllVectorsOn()
    reader.ReadAllFieldsOn()
    with open(path, "rb") as file:
        content = file.read() + b"\n"
    reader.ReadFromInputStringOn()
    reader.SetBinaryInputString(content, len(content))
    return reader


def main(path: str) -> int:
    """Read `path`, write .npz; the exit code."""
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    try:
        found = points_of(path)
    except ImportError:
        return NO_PACKAGE
    except (ValueError, MemoryError, RuntimeError) as error:
        print(error or "it does not fit into the memory", file=sys.stderr)
        return 1
    arrays: dict[str, Any] = {f"a{k}": array for k, array in enumerate(found.values())}
    np.savez(sys.stdout.buffer, names=np.asarray(list(found)), **arrays)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))

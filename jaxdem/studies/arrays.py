"""Arrays that a study keeps beside its runs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from jaxdem.errors import InputError
from jaxdem.files.reading import read_arrays
from jaxdem.io.access import reason_of


def read_stored(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an .npz file of the study.

    Raises:
        InputError: it is damaged.
    """
    try:
        return read_arrays(path)
    except (OSError, ValueError) as error:
        limit = f"cannot be read ({reason_of(error)})"
        raise InputError(path.name, str(path), limit, "Remove it, and the study makes it again.") from error

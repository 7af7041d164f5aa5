"""`summary.json`: what came of a run; floats are finite or null."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jaxdem.errors import InputError
from jaxdem.files.durable import write_bytes
from jaxdem.files.reading import parse_json, read_text

SUMMARY = "summary.json"


def write_summary(folder: Path, summary: Mapping[str, object]) -> None:
    """Replace the summary in `folder`, durably."""
    text = json.dumps(_finite(summary), indent=2, allow_nan=False) + "\n"
    write_bytes(folder / SUMMARY, text.encode())


def read_summary(folder: Path) -> dict[str, Any]:
    """The summary in `folder`, {} if there is none (the run goes on, or was killed).

    Raises:
        InputError: it is there and is not a JSON object.
    """
    path = folder / SUMMARY
    remedy = "Take the file from a backup, or run the scene again."
    try:
        summary = parse_json(read_text(path))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise InputError(SUMMARY, str(path), "cannot be read as JSON", remedy) from error
    if not isinstance(summary, dict):
        raise InputError(SUMMARY, str(path), "is not a JSON object", remedy)
    return summary


def _finite(value: object) -> object:
    """`value` as JSON has it: floats finite or None, numpy's numbers and arrays as Python's."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if isinstance(value, str | int | None) else str(value)

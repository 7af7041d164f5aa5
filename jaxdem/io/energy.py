"""The entry `energy` of a summary in words; it may be of any version, so nothing is taken for granted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def energy_text(told: Mapping[str, Any]) -> str:
    """What the particles have gained or lost that nothing explains, or what was taken from them; "" for nothing told.

    Args:
        told: the entry.
    """
    remark = told.get("remark")
    if isinstance(remark, str) and remark:
        return remark
    gained, less, by = told.get("gained_relative"), told.get("taken"), told.get("taken_by")
    if isinstance(gained, float):
        return f"balanced but for {abs(gained):.2g} of what was turned over"
    if not isinstance(less, float) or not isinstance(by, list) or not by:
        return ""
    names = [str(name) for name in by]
    givers = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    return f"{abs(less):.3g} J {'taken from' if less >= 0.0 else 'given to'} the particles by {givers}"

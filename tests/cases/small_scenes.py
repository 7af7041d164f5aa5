"""Scenes of a few grains, for tests of what surrounds a run; each test gives its own times. And scenes changed."""

import copy
from typing import Any

SMALL_INJECTION: dict[str, Any] = {
    "domain": {"size": [0.4, 0.2], "depth": 0.04},
    "particles": {
        "count": 12,
        "radius": 0.01,
        "density": 2650.0,
        "pack": {"kind": "polygon", "vertices": [[0.05, 0.0], [0.15, 0.0], [0.15, 0.1], [0.05, 0.1]]},
    },
    "contact": {"young_modulus": 5e6, "friction": 0.3},
    "fluid": {"cells": [10, 6], "viscosity": 1e-6, "time_step": 0.01},
    "boundary": {
        "left": {"kind": "inlet", "velocity": 0.5, "from": 0.0, "to": 0.1},
        "right": {"kind": "outlet"},
    },
}


def changed(tables, **values):
    """Tables with keys set, or removed with None; two underscores stand for a dot."""
    found = copy.deepcopy(tables)
    for key, value in values.items():
        *folders, name = key.split("__")
        table = found
        for folder in folders:
            table = table.setdefault(folder, {})
        if value is None:
            table.pop(name)
        else:
            table[name] = value
    return found

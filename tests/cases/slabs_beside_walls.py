"""Scenes of a fluid beside walls that it sees, for boxes on several devices."""

from __future__ import annotations

import math
from typing import Any

from tests.cases.fluid_slabs import ALONG_X, coupled_scene, fluid_scene
from tests.cases.pistons_in_fluid import before_column

CYLINDER = {"kind": "cylinder", "center": [0.37, 0.29], "radius": 0.13, "inside": False, "fluid": "no_slip"}
"""In the middle of a box of 8 x 6 cells of 0.1 m, across both planes between two slabs."""

TURNING = [{"kind": "rotation", "rate": 2.0}]
SWINGING = [{"kind": "rotation", "rate": 1.5, "center": [0.45, 0.6]}]
SLIDING = [{"kind": "translation", "velocity": [0.4, 0.0]}]
RISING = [{"kind": "translation", "velocity": [0.0, 0.4]}]

HEAT = {
    "fluid_heat_capacity": 1000.0, "fluid_conductivity": 0.5, "fluid_temperature": 0.0,
    "particle_heat_capacity": 100.0, "particle_temperature": -20.0,
}  # fmt: skip
"""From zero, so that little heat counts."""

JET = {"left": {"kind": "inlet", "velocity": 0.5}, "right": {"kind": "outlet"}}


def body(middle: tuple[float, float], radius: float, corners: int = 12, **keys: Any) -> dict[str, Any]:
    """A body with so many corners, which periodic boxes may have too."""
    angles = [2.0 * math.pi * (k + 0.37) / corners for k in range(corners)]
    points = [[middle[0] + radius * math.cos(a), middle[1] + radius * math.sin(a)] for a in angles]
    return {"kind": "mesh", "points": points, "closed": True, "fluid": "no_slip", **keys}


def beside_grains(boundary: dict[str, Any], wall: dict[str, Any], **coupling: Any) -> dict[str, Any]:
    """Grains in a stream beside a body of 0.06 m in its middle, some of them within a kernel of it."""
    tables = coupled_scene(2, boundary, **coupling)
    tables["domain"]["size"] = [0.4, 0.3]
    tables["fluid"]["cells"] = [8, 6]
    tables["walls"] = [wall]
    ring = [[0.19 + 0.075 * math.cos(0.7 * k), 0.14 + 0.075 * math.sin(0.7 * k)] for k in range(8)]
    tables["particles"]["position"] = [*ring, [0.05, 0.05], [0.2, 0.28], [0.35, 0.2]]
    return tables


PLATE = {"kind": "mesh", "closed": True, "fluid": "free_slip"} | {
    "points": [[0.17, 0.08], [0.25, 0.08], [0.25, 0.12], [0.17, 0.12]]
}
"""Little thicker than a cell, on the plane between two slabs: closed faces there have open ones on either side."""


SILL = {"kind": "mesh", "closed": True, "fluid": "free_slip"} | {
    "points": [[-0.1, -0.1], [0.5, -0.1], [0.5, 0.1], [0.33, 0.1], [0.33, 0.02], [-0.1, 0.02]]
}
"""A floor that a piston slides along, with an end 0.28 m ahead of it."""


def piston_and_plate() -> dict[str, Any]:
    """A piston that pushes a column of water with grains in it, some of them within a kernel of a plate."""
    tables = before_column(0.5, cells=12)
    tables["walls"] = [*tables["walls"], PLATE, SILL]
    tables["particles"]["position"] = [[0.3, 0.1], [0.21, 0.128], [0.21, 0.072], [0.26, 0.1], [0.16, 0.11], [0.3, 0.16]]
    tables["coupling"] = tables["coupling"] | {"void_fraction": "diffusion"}
    return tables


SCENES: dict[str, dict[str, Any]] = {
    "jet": fluid_scene([8, 6], JET, advection="central") | {"walls": [CYLINDER]},
    "stream": fluid_scene([8, 6], ALONG_X, bulk_velocity=[0.5, 0.0], smagorinsky=0.2)
    | {
        "walls": [
            body((0.37, 0.29), 0.13),
            {"kind": "plane", "point": [0.0, 0.08], "normal": [0.0, 1.0], "fluid": "free_slip"},
        ]
    },
    "jet, 3-D": fluid_scene([4, 4, 6], {"bottom": {"kind": "inlet", "velocity": 0.5}, "top": {"kind": "outlet"}})
    | {"walls": [CYLINDER | {"center": [0.2, 0.2, 0.29], "radius": 0.12, "axis": [0.0, 1.0, 0.0], "motion": TURNING}]},
    "moving": fluid_scene([8, 6], {"right": {"kind": "outlet"}})
    | {
        "walls": [
            CYLINDER | {"center": [0.31, 0.34], "motion": SWINGING},
            {"kind": "plane", "point": [0.0, 0.08], "normal": [0.0, 1.0], "fluid": "no_slip", "motion": SLIDING},
            CYLINDER | {"center": [0.66, 0.3], "end": 0.025},
        ]
    },
    "openings": fluid_scene([8, 6], {})
    | {
        "walls": [
            CYLINDER
            | {
                "center": [0.31, 0.34],
                "motion": SWINGING,
                "opening": [{"kind": "inlet", "flow": 0.05, "ramp_time": 0.0}],
            },
            {"kind": "plane", "point": [0.0, 0.08], "normal": [0.0, 1.0], "fluid": "no_slip"}
            | {
                "opening": [
                    {"kind": "outlet", "region": {"shape": "box", "start": [0.3, -0.1], "stop": [0.65, 0.3]}},
                ]
            },
        ]
    },
    "grains": beside_grains(ALONG_X, body((0.19, 0.14), 0.06, motion=RISING, temperature=50.0)) | {"heat": HEAT},
    "piston, diffusion": piston_and_plate(),
}
"""Walls that stick, slip, turn, move, vanish and are pushed, all kinds of sides, an eddy viscosity, grains."""

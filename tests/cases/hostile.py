"""Bad scenes: every key of every table, missing, misspelt and with every kind of wrong value.

The keys are read from the description itself (`jaxdem.scene`), so a key that is added is tried without a line here;
`untouched_keys` names those that no base scene reaches.
"""

from __future__ import annotations

import copy
import datetime
import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, get_args

import jax
import numpy as np
from pydantic import BaseModel

from jaxdem.errors import InputError
from jaxdem.failures import failures, first_meaning
from jaxdem.scene import Scene, load_scene
from jaxdem.setup.builder import build, initial_state
from jaxdem.setup.overlaps import check_initial_positions
from jaxdem.setup.particles import particle_setup
from tests.cases.steps import time_steps

Tables = dict[str, Any]

LONG = 3000
"""Contact steps in an interval that are not worth the wait."""

COUPLED: Tables = {
    "seed": 3,
    "precision": "float32",
    "domain": {"size": [0.2, 0.2], "depth": 0.04, "gravity": [0.0, -9.81]},
    "particles": {
        "count": 4,
        "radius": 0.01,
        "density": 2650.0,
        "pack": {
            "kind": "lattice",
            "start": [0.05, 0.05],
            "stop": [0.15, 0.15],
            "spacing": 1.2,
            "jitter": 0.01,
        },
        "velocity": [[0.0, 0.0], [0.1, 0.0], [0.0, 0.1], [0.0, 0.0]],
        "angular_velocity": [0.0, 1.0, 0.0, 0.0],
    },
    "contact": {
        "law": "hertz_mindlin",
        "young_modulus": 5e6,
        "poisson_ratio": 0.3,
        "restitution": 0.7,
        "friction": 0.4,
        "rolling_friction": 0.1,
        "rolling_model": "epsd",
        "rolling_damping": 0.3,
        "wall_young_modulus": 1e7,
        "wall_poisson_ratio": 0.2,
        "wall_friction": 0.3,
        "time_step": "auto",
        "speed": 2.0,
        "maximum_overlap": 0.2,
        "skin": 0.2,
        "parcel_loss": "impact",
    },
    "fluid": {
        "cells": [4, 4],
        "density": 1000.0,
        "viscosity": 1e-6,
        "model": "A",
        "smagorinsky": 0.1,
        "time_step": 0.005,
        "advection": "limited",
        "courant_limit": 0.7,
        "velocity": [0.0, 0.0],
    },
    "boundary": {
        "left": {
            "kind": "inlet",
            "velocity": 0.1,
            "from": 0.0,
            "to": 0.1,
            "ramp_time": 0.01,
            "profile": "uniform",
        },
        "right": {"kind": "outlet", "particles": "remove"},
        "top": {"kind": "moving_wall", "velocity": [0.1, 0.0]},
    },
    "coupling": {
        "drag": "koch_hill",
        "void_fraction": "kernel",
        "kernel_width": {"diameters": 1.5, "cells": 1.0},
        "kernel_diameter": "largest",
        "interval": 0.005,
        "lift": ["saffman_mei"],
        "rotational_drag": True,
        "virtual_mass": 0.5,
        "basset": 0,
        "self_disturbance": False,
        "own_volume": "parcel",
        "drag_inputs_coarsened": 1,
        "deconvolution": 0.1,
    },
    "closure": {"hold": 1},
    "time": {"end": 0.02, "output_interval": 0.01},
    "output": {"samples": 0.0, "checkpoint_interval": 60.0, "energy": False},
}
"""Grains and water in a plane."""

GRAINS: Tables = {
    "domain": {"size": [0.2, 0.2, 0.2]},
    "materials": [
        {"name": "glass", "young_modulus": 5e6, "poisson_ratio": 0.2, "restitution": 0.6, "friction": 0.2,
         "rolling_friction": 0.1},
        {"name": "steel"},
    ],
    "material_pairs": [
        {"materials": ["glass", "steel"], "restitution": 0.5, "friction": 0.1, "rolling_friction": 0.05}
    ],
    "particles": {
        "count": 3,
        "radius": 0.01,
        "density": 2650.0,
        "material": "glass",
        "pack": {"kind": "polygon", "vertices": [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]]},
        "species": [
            {"share": 0.5, "radius": 0.012, "density": 3000.0, "material": "steel"},
            {"share": 0.5},
        ],
        "inlet": [
            {"side": "top", "from": [0.05, 0.05], "to": [0.15, 0.15], "rate": 100.0, "velocity": 1.0,
             "begin": 0.0, "end": 0.02, "total": 5, "radius": 0.01, "density": 2000.0, "material": "steel"},
            {"start": [0.05, 0.05, 0.15], "stop": [0.15, 0.15, 0.2], "mass_flow": 1.0, "velocity": [0.0, 0.0, -1.0],
             "species": [{"share": 1.0, "radius": 0.01, "density": 2000.0, "material": "glass"}]},
        ],
    },
    "contact": {
        "law": "linear_spring_dashpot",
        "normal_stiffness": 1e4,
        "tangential_stiffness": 3e3,
        "wall_material": "steel",
        "young_modulus": 5e6,
        "speed": 3.0,
    },
    "walls": [
        {"kind": "plane", "point": [0.0, 0.0, -0.01], "normal": [0.0, 0.0, 1.0], "material": "glass"},
        {"kind": "cylinder", "center": [0.1, 0.1, 0.0], "radius": 0.5, "axis": [0.0, 0.0, 1.0], "inside": True},
        {"kind": "wedge", "apex": [0.0, 0.0, -0.1], "directions": [[-1.0, 0.0, 0.1], [1.0, 0.0, 0.1]]},
    ],
    "boundary": {"left": {"particles": "remove"}},
    "time": {"end": 0.02, "output_interval": 0.01},
    "output": {"walls": True},
}  # fmt: skip
"""Grains of several materials that come and go, in a box with walls of its own."""

STREAM: Tables = {
    "domain": {"size": [0.4, 0.2, 0.2]},
    "fluid": {"cells": [4, 3, 3], "viscosity": 1e-4, "time_step": "auto"},
    "boundary": {
        "left": {"kind": "inlet", "times": [0.0, 0.1], "velocities": [0.0, 0.2], "profile": "table",
                 "positions": [0.0, 0.2], "values": [1.0, 2.0]},
        "right": {"kind": "outlet"},
        "front": {"kind": "periodic"},
        "back": {"kind": "periodic"},
    },
    "time": {"end": 0.02, "output_interval": 0.01},
}  # fmt: skip
"""A fluid alone, from an inlet that has tables."""

RANDOM: Tables = {
    "domain": {"size": [0.2, 0.2]},
    "particles": {
        "count": 5,
        "radius": [0.01, 0.01, 0.01, 0.008, 0.008],
        "density": [2650.0, 2650.0, 2650.0, 2650.0, 2000.0],
        "pack": {"kind": "random", "start": [0.0, 0.0], "stop": [0.2, 0.2], "spacing": 1.1},
    },
    "time": {"end": 0.02, "output_interval": 0.01},
}
"""A random pack of grains that have a size each."""

ROWS: Tables = {
    "domain": {"size": [0.2, 0.2]},
    "particles": {"radius": 0.01, "density": 2650.0, "position": [[0.05, 0.02], [0.1, 0.1]]},
    "time": {"end": 0.02, "output_interval": 0.01},
}
"""Grains with positions."""

COLUMNS: Tables = {
    "domain": {"size": [0.2, 0.2]},
    "particles": {
        "density": 2650.0,
        "file": {"name": str(Path(__file__).parents[1] / "data" / "grains.csv"), "translate": [0.0, 0.01],
                 "types": {"1": "hard", "2": "soft"}, "ignore": ["id"]},
    },
    "materials": [{"name": "hard"}, {"name": "soft", "young_modulus": 1e6}],
    "time": {"end": 0.02, "output_interval": 0.01},
}  # fmt: skip
"""Grains from a file with named columns."""

SIZES: Tables = {
    "domain": {"size": [0.2, 0.2]},
    "particles": {
        "count": 5,
        "density": 2650.0,
        "distribution": {"kind": "table", "by": "volume", "diameters": [0.01, 0.015, 0.03],
                         "cumulative": [0.0, 0.4, 1.0], "lower": 0.006, "upper": 0.014},
        "pack": {"kind": "lattice", "start": [0.0, 0.0], "stop": [0.2, 0.1]},
        "inlet": [
            {"side": "top", "mass_flow": 5.0, "velocity": 0.5, "distribution": {
                "kind": "weibull", "by": "volume", "scale": 0.01, "shape": 2.0, "lower": 0.005, "upper": 0.012}},
        ],
    },
    "time": {"end": 0.02, "output_interval": 0.01},
}  # fmt: skip
"""Grains of sizes by distributions, in a pack and through an inlet."""

PACKS: Tables = {
    "domain": {"size": [0.2, 0.2], "gravity": [[0.0, -9.81], [1.0, -9.81]], "gravity_times": [0.0, 0.1]},
    "materials": [{"name": "hard"}, {"name": "soft", "young_modulus": 1e6}],
    "particles": {
        "density": 2650.0,
        "material": "hard",
        "radius": 0.01,
        "pack": [
            {"kind": "random", "solid_fraction": 0.2, "spacing": 1.02,
             "region": {"shape": "polygon", "vertices": [[0.0, 0.0], [0.2, 0.0], [0.1, 0.1]]}},
            {"kind": "lattice", "jitter": 0.01, "start": [0.0, 0.15], "stop": [0.1, 0.2], "count": 2, "density": 2000.0,
             "radius": 0.005, "material": "soft"},
            {"kind": "grown", "start": [0.12, 0.15], "stop": [0.2, 0.2], "count": 2,
             "species": [{"share": 1.0, "radius": 0.005, "density": 3000.0, "material": "soft"}]},
        ],
        "inlet": [
            {"side": "top", "times": [0.0, 0.01], "rate": [0.0, 500.0], "velocity": 1.0},
            {"region": {"shape": "sphere", "center": [0.15, 0.05], "radius": 0.03}, "rate": 100.0,
             "velocity": [0.0, -1.0]},
        ],
    },
    "contact": {"young_modulus": 5e6, "speed": 1.0},
    "walls": [
        {"name": "gate", "kind": "plane", "point": [0.0, -0.01], "normal": [0.0, 1.0], "begin": 0.005, "end": 0.015},
    ],
    "time": {"end": 0.02, "output_interval": 0.01},
}  # fmt: skip
"""Packs and an inlet in regions, each pack with particles of its own; gravity, an inlet and a wall that change with
time."""

BED: Tables = {
    "domain": {"size": [0.2, 0.2], "gravity": [0.0, -9.81]},
    "particles": {"radius": 0.01, "density": 2650.0, "position": [[0.05, 0.02], [0.1, 0.1]]},
    "fluid": {
        "cells": [4, 4],
        "time_step": 0.005,
        "pressure_gradient": [-10.0, 0.0],
        "bed_mixing": {"von_karman": 0.4},
    },
    "boundary": {"left": {"kind": "periodic"}, "top": {"kind": "free_slip"}},
    "contact": {"young_modulus": 5e6, "speed": 3.0},
    "time": {"end": 0.02, "output_interval": 0.01},
}
"""A stream over a bed, with a mixing length."""

PACK: Tables = {
    "domain": {"size": [0.2, 0.2]},
    "particles": {
        "density": 2650.0,
        "pack": {
            "kind": "random",
            "region": {"shape": "sphere", "center": [0.1, 0.1], "radius": 0.1},
            "distribution": {"kind": "table", "radii": [0.005, 0.008], "cumulative": [0.0, 1.0]},
            "count": 4,
        },
    },
    "time": {"end": 0.02, "output_interval": 0.01},
}
"""One pack in a region, with sizes of its own."""

PROBES: Tables = {
    "domain": {"size": [0.2, 0.2]},
    "particles": {"radius": 0.01, "density": 2650.0, "position": [[0.05, 0.02], [0.1, 0.1]]},
    "fluid": {"cells": [4, 4], "time_step": 0.005},
    "coupling": {"drag_factor": [0.0, 1.0], "drag_times": [0.0, 0.01], "interval": 0.005},
    "contact": {"young_modulus": 5e6, "speed": 3.0},
    "walls": [{"kind": "plane", "point": [0.0, -0.01], "normal": [0.0, 1.0]}],
    "probes": [
        {"name": "a", "kind": "plane", "axis": "x", "at": 0.1, "from": [0.0], "to": [0.1], "interval": 0.01,
         "begin": 0.005},
        {"name": "b", "kind": "profile", "axis": "z", "cells": 3, "average": True, "window": 0.01,
         "sample_interval": 0.005},
        {"name": "c", "kind": "profile", "axis": "z", "edges": [0.0, 0.1, 0.2]},
        {"name": "d", "kind": "profile", "regions": [[[0.0, 0.0], [0.1, 0.1]]]},
        {"name": "e", "kind": "plane", "normal": [1.0, 1.0], "point": [0.1, 0.1]},
        {"name": "f", "kind": "wall", "side": "bottom", "about": [0.0, 0.0]},
        {"name": "g", "kind": "wall", "wall": 0},
        {"name": "h", "kind": "point", "points": [[0.1, 0.1]]},
        {"name": "i", "kind": "contacts"},
    ],
    "time": {"end": 0.02, "output_interval": 0.01},
}  # fmt: skip
"""Probes of all kinds, and a drag that is switched on."""


def _cohesive(name: str, value: float, cohesion: Tables) -> Tables:
    """Grains of two materials that attract each other; the name of the strength, which each has of its own."""
    return {
        "domain": {"size": [0.2, 0.2]},
        "materials": [{"name": "glass", name: value}, {"name": "steel"}],
        "material_pairs": [{"materials": ["glass", "steel"], name: value}],
        "particles": {"radius": 0.01, "density": 2650.0, "position": [[0.05, 0.02], [0.1, 0.1]], "material": "glass"},
        "contact": {"young_modulus": 5e6, "speed": 3.0, "cohesion": {name: value, **cohesion}},
        "time": {"end": 0.02, "output_interval": 0.01},
    }


COHESIVE: dict[str, Tables] = {
    "jkr": _cohesive("work_of_adhesion", 0.1, {"kind": "jkr"}),
    "van der waals": _cohesive(
        "hamaker_constant", 1e-16, {"kind": "van_der_waals", "minimum_gap": 1e-7, "cutoff": 1e-5}
    ),
    "wet": _cohesive(
        "surface_tension",
        0.07,
        {"kind": "capillary", "contact_angle": 0.2, "liquid_content": 0.01, "bridge_share": 0.05}
        | {"liquid_viscosity": 1e-3, "minimum_gap": 1e-5},
    ),
    "sjkr": _cohesive("energy_density", 1e4, {"kind": "sjkr", "wall_factor": 1.0}),
}
"""Grains that attract each other."""

START: Tables = {
    "domain": {"size": [0.2, 0.2]},
    "start": {
        "from": str(Path(__file__).parents[1] / "data" / "former_run"),
        "time": 0.0,
        "remove": [{"shape": "box", "start": [0.0, 0.0], "stop": [0.08, 0.08]}],
        "add": {"radius": 0.01, "density": 2650.0, "position": [[0.05, 0.15]]},
    },
    "contact": {"young_modulus": 5e6, "speed": 3.0},
    "time": {"end": 0.02, "output_interval": 0.01},
}
"""A start from a frame of another run."""

MOVING: Tables = {
    "domain": {"size": [0.2, 0.2]},
    "particles": {"radius": 0.01, "density": 2650.0, "position": [[0.05, 0.02], [0.1, 0.1]]},
    "contact": {"young_modulus": 5e6, "speed": 3.0},
    "walls": [
        {"kind": "plane", "point": [0.0, -0.01], "normal": [0.0, 1.0], "motion": [
            {"kind": "translation", "velocity": [0.1, 0.0], "begin": 0.001, "end": 0.01},
            {"kind": "oscillation", "direction": [0.0, 1.0], "amplitude": 0.001, "frequency": 5.0, "phase": 0.5},
            {"kind": "table", "direction": [1.0, 0.0], "times": [0.0, 0.01], "displacement": [0.0, 0.001]},
        ]},
        {"kind": "cylinder", "center": [0.1, 0.1], "radius": 0.2, "motion": [
            {"kind": "rotation", "center": [0.1, 0.1], "rate": 1.0},
            {"kind": "table", "center": [0.1, 0.1], "times": [0.0, 0.01], "angle": [0.0, 0.1]},
        ]},
        {"kind": "plane", "point": [0.0, 0.15], "normal": [0.0, -1.0], "piston": {
            "direction": [0.0, -1.0], "force": [1.0, 2.0], "force_times": [0.0, 0.01], "mass": 0.5, "damping": 1.0}},
        {"kind": "mesh", "points": [[0.0, 0.19], [0.2, 0.19], [0.2, 0.18]], "closed": True, "translate": [0.0, 0.001]},
    ],
    "time": {"end": 0.02, "output_interval": 0.01},
}  # fmt: skip
"""Walls that move, one that a force holds, and a line."""

MESHES: Tables = {
    "domain": {"size": [0.12, 0.12, 0.25]},
    "particles": {"radius": 0.004, "density": 2650.0, "pack": {"kind": "lattice", "spacing": 1.5, "region": {
        "shape": "mesh", "file": str(Path(__file__).parents[2] / "scenes" / "dosta_ball.stl"), "scale": 1.2,
        "rotate": [0.0, 10.0, 0.0], "translate": [0.06, 0.06, 0.11], "start": [0.0, 0.0, 0.105],
        "stop": [0.12, 0.12, 0.13]}}},
    "contact": {"young_modulus": 5e6, "speed": 3.0},
    "walls": [
        {"kind": "mesh", "file": str(Path(__file__).parents[2] / "scenes" / "silo.stl"), "scale": 0.001,
         "rotate": [0.0, 0.0, 10.0], "translate": [0.06, 0.06, 0.0], "touch": "both", "smooth_angle": 2.0,
         "repair": True, "closed": False, "wear": {"model": "archard", "coefficient": 1e-3, "hardness": 1e9}},
        {"kind": "mesh", "file": str(Path(__file__).parents[1] / "data" / "heights.csv"), "spacing": [0.06, 0.06],
         "touch": "front", "motion": [
             {"kind": "rotation", "center": [0.06, 0.06, 0.0], "axis": [0.0, 0.0, 1.0], "rate": 1.0}]},
    ],
    "time": {"end": 0.02, "output_interval": 0.01},
}  # fmt: skip
"""Walls of triangles from a file, a map of heights that turns, and a pack inside of a mesh."""

CYLINDER: Tables = {
    "domain": {"size": [0.4, 0.2]},
    "fluid": {"cells": [16, 8], "viscosity": 1e-4, "time_step": "auto"},
    "boundary": {"left": {"kind": "inlet", "velocity": 0.1}, "right": {"kind": "outlet"}},
    "walls": [{"kind": "cylinder", "center": [0.15, 0.1], "radius": 0.04, "inside": False, "fluid": "no_slip",
               "end": 0.015}],
    "time": {"end": 0.02, "output_interval": 0.01},
}  # fmt: skip
"""A cylinder in a stream, which vanishes."""

OPENINGS: Tables = {
    "domain": {"size": [0.4, 0.2]},
    "fluid": {"cells": [16, 8], "viscosity": 1e-4},
    "walls": [
        {"kind": "plane", "point": [0.0, 0.03], "normal": [0.0, 1.0], "fluid": "no_slip",
         "opening": [{"kind": "inlet", "velocity": 0.1, "ramp_time": 0.01,
                      "region": {"shape": "box", "start": [0.0, 0.0], "stop": [0.1, 0.2]}},
                     {"kind": "inlet", "times": [0.0, 0.01], "flows": [0.0, 0.002],
                      "region": {"shape": "sphere", "center": [0.3, 0.03], "radius": 0.05}}]},
        {"kind": "plane", "point": [0.0, 0.17], "normal": [0.0, -1.0], "fluid": "free_slip",
         "opening": [{"kind": "outlet", "region": {"shape": "box", "start": [0.2, 0.1], "stop": [0.4, 0.2]}},
                     {"kind": "inlet", "flow": -0.001,
                      "region": {"shape": "box", "start": [0.0, 0.1], "stop": [0.1, 0.2]}},
                     {"kind": "inlet", "times": [0.0, 0.01], "velocities": [0.0, 0.01],
                      "region": {"shape": "box", "start": [0.1, 0.1], "stop": [0.2, 0.2]}}]},
    ],
    "time": {"end": 0.02, "output_interval": 0.01},
}  # fmt: skip
"""Inlets and an outlet on walls that the fluid sees."""

HEAT: Tables = {
    "domain": {"size": [0.4, 0.2]},
    "particles": {
        "radius": 0.01, "density": 2650.0, "position": [[0.05, 0.02], [0.1, 0.1]],
        "inlet": [{"start": [0.2, 0.1], "stop": [0.3, 0.18], "rate": 100.0, "velocity": [0.0, 0.0],
                   "temperature": 300.0}],
    },
    "contact": {"young_modulus": 5e6, "speed": 3.0},
    "fluid": {"cells": [8, 4], "viscosity": 1e-5, "density": 1.2, "velocity": [0.1, 0.0]},
    "boundary": {
        "left": {"kind": "inlet", "velocity": 0.1, "temperature": 300.0, "scalars": {"dye": 1.0}},
        "right": {"kind": "outlet"},
        "bottom": {"heat_flux": 10.0},
    },
    "walls": [
        {"kind": "plane", "point": [0.0, 0.005], "normal": [0.0, 1.0], "temperature": 310.0},
        {"kind": "mesh", "points": [[0.0, 0.197], [0.4, 0.197]], "temperature": 305.0},
        {"kind": "cylinder", "center": [0.36, 0.06], "radius": 0.03, "inside": False, "fluid": "no_slip",
         "heat_flux": 5.0,
         "opening": [{"kind": "inlet", "velocity": 0.01, "temperature": 310.0, "scalars": {"dye": 1.0}}]},
    ],
    "heat": {
        "fluid_heat_capacity": 1000.0, "fluid_conductivity": 0.03, "fluid_temperature": 300.0, "expansion": 3e-3,
        "reference_temperature": 300.0, "exchange": "gunn", "bed_conductivity": "open",
        "particle_heat_capacity": 800.0, "particle_temperature": 310.0, "particle_conductivity": 1.0,
        "wall_conductivity": 2.0, "true_young_modulus": 1e10, "friction": True,
    },
    "scalars": [{"name": "dye", "diffusivity": 1e-6, "value": 0.5}],
    "time": {"end": 0.02, "output_interval": 0.01},
}  # fmt: skip
"""Temperatures, and a dye."""

BONDED: Tables = {
    "domain": {"size": [0.2, 0.2]},
    "particles": {"radius": 0.01, "density": 2650.0, "position": [[0.05, 0.1], [0.07, 0.1], [0.12, 0.1], [0.14, 0.1]]},
    "contact": {"young_modulus": 5e6, "speed": 3.0},
    "bonds": [
        {"gap": 1e-4, "normal_stiffness": 1e9, "shear_stiffness": 1e9, "radius_factor": 1.0, "tensile_strength": 1e6,
         "shear_strength": 1e6, "moment_factor": 1.0, "damping": 0.1,
         "region": {"shape": "box", "start": [0.0, 0.0], "stop": [0.1, 0.2]}},
        {"pairs": [[2, 3]], "young_modulus": 2e7, "shear_modulus": 8e6},
    ],
    "time": {"end": 0.02, "output_interval": 0.01},
}  # fmt: skip
"""Two bonds, by gap in a region and from a list."""

LUBRICATED: Tables = {
    "domain": {"size": [0.2, 0.2]},
    "particles": {"radius": 0.01, "density": 2650.0, "position": [[0.05, 0.02], [0.1, 0.1]]},
    "contact": {"young_modulus": 5e6, "speed": 3.0, "friction": 0.4, "lubrication": {
        "cutoff": 1e-3, "roughness": 1e-5, "viscosity": 1e-3, "shear": True,
        "wet_friction": 0.1, "sommerfeld_number": 1e-3}},
    "time": {"end": 0.02, "output_interval": 0.01},
}  # fmt: skip
"""Grains in a film of liquid."""

CLUMPED: Tables = {
    "domain": {"size": [0.2, 0.2]},
    "particles": {
        "density": 2650.0,
        "shapes": [{"name": "rod", "centres": [[-1.0, 0.0], [1.0, 0.0]], "radii": [1.0, 1.0]},
                   {"name": "bent", "file": str(Path(__file__).parents[1] / "data" / "bent.csv")}],
        "species": [{"share": 1.0, "radius": 0.01, "shape": "rod"}],
        "orientation": "aligned",
        "pack": {"kind": "lattice", "start": [0.0, 0.0], "stop": [0.1, 0.1]},
        "inlet": [{"start": [0.02, 0.15], "stop": [0.18, 0.2], "rate": 100.0, "velocity": [0.0, -0.5],
                   "species": [{"share": 1.0, "radius": 0.008, "shape": "rod"}]}],
    },
    "contact": {"young_modulus": 5e6, "speed": 3.0},
    "time": {"end": 0.02, "output_interval": 0.01},
}  # fmt: skip
"""Rods of two discs."""

SURFACE: Tables = {
    "domain": {"size": [0.4, 0.2], "gravity": [0.0, -9.81]},
    "fluid": {"cells": [8, 4], "viscosity": 1e-6, "density": 1000.0, "time_step": 0.001},
    "surface": {
        "density": 1.2, "viscosity": 1.5e-5, "tension": 0.07, "level": 0.1,
        "regions": [{"shape": "sphere", "center": [0.2, 0.15], "radius": 0.03}],
    },
    "boundary": {
        "left": {"kind": "inlet", "velocity": 0.05, "level": 0.1},
        "right": {"kind": "outlet", "level": 0.1},
        "top": {"kind": "free_slip"},
    },
    "time": {"end": 0.02, "output_interval": 0.01},
}  # fmt: skip
"""Water below air, and a drop."""

WARM_SURFACE: Tables = {
    **SURFACE,
    "surface": {
        **SURFACE["surface"], "heat_capacity": 1000.0, "conductivity": 0.03, "expansion": 3e-3, "temperature": 310.0,
    },
    "boundary": {
        "left": {"kind": "inlet", "velocity": 0.05, "level": 0.1, "temperature": 320.0, "scalars": {"smoke": 1.0}},
        "right": {"kind": "outlet", "level": 0.1},
        "top": {"kind": "free_slip", "heat_flux": 100.0},
    },
    "heat": {
        "fluid_heat_capacity": 4200.0, "fluid_conductivity": 0.6, "fluid_temperature": 300.0, "expansion": 2e-4,
        "reference_temperature": 300.0,
    },
    "scalars": [{"name": "smoke", "diffusivity": 1e-5, "value": 0.5, "dissolved_in": "second"}],
}  # fmt: skip
"""The same with temperatures, and smoke in the air."""

BASES = {
    "coupled": COUPLED,
    "grains": GRAINS,
    "stream": STREAM,
    "random": RANDOM,
    "rows": ROWS,
    "columns": COLUMNS,
    "sizes": SIZES,
    "packs": PACKS,
    "pack": PACK,
    "bed": BED,
    "probes": PROBES,
    "start": START,
    "moving": MOVING,
    "meshes": MESHES,
    "cylinder": CYLINDER,
    "openings": OPENINGS,
    "heat": HEAT,
    "bonded": BONDED,
    "lubricated": LUBRICATED,
    "clumped": CLUMPED,
    "surface": SURFACE,
    "warm surface": WARM_SURFACE,
    **COHESIVE,
}

SAME_TABLES = (
    ("start.add.", "particles."),
    ("start.remove.*.", "particles.pack.region."),
    ("particles.inlet.*.region.", "particles.pack.region."),
    ("bonds.*.region.", "particles.pack.region."),
    ("walls.*.opening.*.region.", "particles.pack.region."),
    ("surface.regions.*.", "particles.pack.region."),
    ("particles.pack.*.", "particles.pack."),
    ("particles.pack.species.", "particles.species."),
)
"""Tables that are described once and stand in two places: what is tried in one need not be in the other."""

MISSING = object()

VALUES: dict[str, Any] = {
    "missing": MISSING,
    "nan": math.nan,
    "inf": math.inf,
    "-inf": -math.inf,
    "zero": 0,
    "zero float": 0.0,
    "minus zero": -0.0,
    "-1": -1,
    "-1.5": -1.5,
    "1": 1,
    "2.5": 2.5,
    "1e-300": 1e-300,
    "1e-45": 1e-45,
    "1e-19": 1e-19,
    "1e-9": 1e-9,
    "1e-4": 1e-4,
    "1e4": 1e4,
    "1e9": 1e9,
    "1e19": 1e19,
    "1e300": 1e300,
    "whole 1e5": 10**5,
    "whole 1e8": 10**8,
    "whole 2^31": 2**31,
    "whole 2^63": 2**63,
    "whole 1e400": 10**400,
    "whole 1e9000": 16**9000,
    "true": True,
    "false": False,
    "empty text": "",
    "text": "abc",
    "auto": "auto",
    "nul": "a\0b",
    "long text": "x" * 5000,
    "number as text": "1.0",
    "brackets": "[red]",
    "device": "/dev/null",
    "folder": "/",
    "empty list": [],
    "list of nan": [math.nan, math.nan],
    "list of inf": [math.inf, 1.0],
    "list of text": ["a", "b"],
    "two": [1.0, 1.0],
    "two zeros": [0.0, 0.0],
    "two negative": [-1.0, -1.0],
    "two huge": [1e19, 1e19],
    "two tiny": [1e-19, 1e-19],
    "two whole huge": [100_000, 100_000],
    "three": [0.1, 0.1, 0.1],
    "falling": [1.0, 0.5],
    "long list": [0.5] * 1000,
    "rows": [[0.1, 0.1], [0.15, 0.15]],
    "ragged rows": [[0.1, 0.1], [0.1]],
    "rows of nan": [[math.nan, 0.1], [0.1, 0.1]],
    "empty rows": [[], []],
    "deep list": [[[[[[1.0]]]]]],
    "empty table": {},
    "table": {"a": 1},
    "kind table": {"kind": "inlet", "velocity": 1e6},
    "list of tables": [{"a": 1}],
    "empty tables": [{}, {}],
    "date": datetime.date(2020, 1, 1),
}
"""Kind -> value; a wrong value for most keys, and a strange but right one for some."""


class BadScene(NamedTuple):
    """A base scene with one key changed.

    Attributes:
        base: name of the base.
        key: dotted.
        kind: of change.
        tables: the scene.
    """

    base: str
    key: str
    kind: str
    tables: Tables


def keys_of(tables: Tables, prefix: str = "") -> Iterator[str]:
    """Dotted keys of all tables and all that is in them, with numbers for lists of tables."""
    for key, value in tables.items():
        yield prefix + key
        if isinstance(value, dict):
            yield from keys_of(value, f"{prefix}{key}.")
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for number, table in enumerate(value):
                yield from keys_of(table, f"{prefix}{key}.{number}.")


def schema_keys(model: type[BaseModel] = Scene, prefix: str = "") -> Iterator[str]:
    """Dotted keys of the description, with `*` for the number in a list of tables and for a side."""
    for name, field in model.model_fields.items():
        key = prefix + (field.alias or name)
        yield key
        for inner, many in _models(field.annotation):
            yield from schema_keys(inner, f"{key}.*." if many else f"{key}.")


def _models(annotation: Any, many: bool = False) -> Iterator[tuple[type[BaseModel], bool]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation, many
    for part in get_args(annotation):
        origin = getattr(annotation, "__origin__", None)
        yield from _models(part, many or origin in (tuple, dict))


def untouched_keys() -> set[str]:
    """Keys of the description that no base scene has a place for."""
    reached = {_once(_starred(key)) for tables in BASES.values() for key in _places(tables)}
    return {_once(key) for key in schema_keys()} - reached


def _once(key: str) -> str:
    """The key of the first place where a table may stand."""
    for place, first in SAME_TABLES:
        if key.startswith(place):
            key = first + key.removeprefix(place)
    return key


def _starred(key: str) -> str:
    parts = key.split(".")
    return ".".join("*" if p.isdecimal() or (k and parts[k - 1] == "boundary") else p for k, p in enumerate(parts))


def _places(tables: Tables) -> set[str]:
    """The keys that a base has, and those that the description allows beside them."""
    present = set(keys_of(tables))
    by_star: dict[str, set[str]] = {}
    for key in present | {""}:
        by_star.setdefault(_starred(key), set()).add(key)
    places = set(present)
    for key in schema_keys():
        parent, _, last = key.rpartition(".")
        # A table that may be one or several is here what it is in the base.
        owners = [own for own in by_star.get(parent, ()) if not own or isinstance(_value(tables, own), dict)]
        places |= {f"{own}.{last}" if own else last for own in owners}
    return places


def changed(tables: Tables, key: str, value: Any) -> Tables:
    """A copy of the tables with one dotted key set, or taken out where the value is `MISSING`."""
    result = copy.deepcopy(tables)
    *parents, last = key.split(".")
    table: Any = result
    for part in parents:
        table = table[int(part)] if isinstance(table, list) else table[part]
    if value is MISSING:
        table.pop(last, None)
    else:
        table[last] = copy.deepcopy(value)
    return result


def misspelt(key: str) -> str:
    """The key without its third letter, or with one more where it is short."""
    head, _, last = key.rpartition(".")
    wrong = last[:2] + last[3:] if len(last) > 3 else last + "x"
    return f"{head}.{wrong}" if head else wrong


def bad_scenes(every: int = 1) -> Iterator[BadScene]:
    """All of them, thousands, or one of so many, in an order that does not change."""
    for base, key, kind, place, value in itertools.islice(_bad_values(), 0, None, every):
        yield BadScene(base, key, kind, changed(BASES[base], place, value))


def _bad_values() -> Iterator[tuple[str, str, str, str, Any]]:
    """Base, key, kind, the place of the change, and what stands there."""
    for base, tables in BASES.items():
        for key in sorted(_places(tables)):
            if key.rpartition(".")[2].isdecimal():
                continue
            for kind, value in VALUES.items():
                yield base, key, kind, key, value
            yield base, key, "misspelt", misspelt(key), 1.0
            # A list's single entries too.
            for kind, entry in (
                ("nan in it", math.nan),
                ("text in it", "a"),
                ("1e19 in it", 1e19),
                ("-1 in it", -1.0),
            ):
                value = _value(tables, key)
                if isinstance(value, list) and value and not isinstance(value[0], dict):
                    yield base, key, kind, key, [entry, *value[1:]]


def _value(tables: Tables, key: str) -> Any:
    table: Any = tables
    for part in key.split("."):
        table = table[int(part)] if isinstance(table, list) else table.get(part)
    return table


def outcome(tables: Tables) -> str:
    """ "refused" with a message that names a key and says what to do, or "accepted"; anything else raises."""
    try:
        scene = load_scene(tables)
        scene.to_toml()
        steps = time_steps(scene)
        if scene.particles is not None:
            check_initial_positions(particle_setup(scene))
    except InputError as error:
        assert error.key and error.limit and error.remedy, error
        assert len(str(error)) < 2000, error
        return "refused"
    assert math.isfinite(steps.interval)
    return "accepted"


def few_steps(tables: Tables, steps: int = 3) -> str:
    """ "finite", or "refused" or "stopped" with a message, within the first coupling intervals; anything else
    raises."""
    scene = load_scene(tables)
    jax.config.update("jax_enable_x64", scene.precision == "float64")
    try:
        simulation, parameters = build(scene)
        state, neighbors = initial_state(scene, simulation, parameters)
    except InputError:
        return "refused"
    if simulation.steps.contacts_per_interval > LONG:
        return "too long to try"
    step = jax.jit(simulation.step)
    for _ in range(steps):
        reached, neighbors, diagnostics = step(parameters, state, neighbors)
        code = int(failures(simulation, diagnostics))
        if code:
            assert first_meaning(code)
            return "stopped"
        state = reached
    for path, leaf in jax.tree_util.tree_flatten_with_path(state)[0]:
        assert np.isfinite(np.asarray(leaf)).all(), f"{jax.tree_util.keystr(path)} is not finite"
    return "finite"

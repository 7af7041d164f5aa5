"""A silo whose walls carry a part of the grains: Janssen's pressure over the depth."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import jaxdem
from tests.cases.registry import Figure, at_least, case, relative

DIAMETER, DENSITY, GRAVITY = 0.01, 2500.0, 9.81
ON_WALL, BETWEEN = 0.2, 0.6
"""Friction at the walls and between the grains: they slide along the walls, and not along each other."""

RISE = 0.02
"""Speed of the walls [m/s]: they slide along the grains upwards, so that all of their friction acts."""

SLICES = 12


class Silo(NamedTuple):
    """Means over the second half of a run.

    Attributes:
        width: w, between the walls [m].
        height: h = Q/(rho_b g), of the grains with the bulk density rho_b of the middle of the silo [m].
        weight: Q, of all grains over the section [Pa].
        floor: vertical stress on the floor [Pa].
        middle: depth of the slice in the middle [m], and the vertical stress in it [Pa].
        normal: mean normal stress on the walls over the height h [Pa].
        mobilised: friction on the walls over the normal force [-].
        ratio: K, normal stress on the walls over the mean vertical stress [-].
    """

    width: float
    height: float
    weight: float
    floor: float
    middle: tuple[float, float]
    normal: float
    mobilised: float
    ratio: float


def tables(columns: int, layers: int, end: float) -> dict[str, Any]:
    """Discs of 0.8 to 1.2 d between two walls that rise slowly, at rest at first."""
    width, height = columns * DIAMETER, 1.3 * layers * DIAMETER
    rising = [{"kind": "translation", "velocity": [0.0, RISE]}]
    walls = [
        {"name": name, "kind": "plane", "point": [x, 0.0], "normal": [inward, 0.0], "motion": rising}
        for name, x, inward in (("first", 0.0, 1.0), ("last", width, -1.0))
    ]
    second_half = {"interval": 0.5 * end, "begin": 0.5 * end, "average": True}
    edges = np.linspace(0.0, height, SLICES + 1).tolist()
    return {
        "seed": 1,
        "domain": {"size": [width, height], "depth": DIAMETER, "gravity": [0.0, -GRAVITY]},
        "particles": {
            "density": DENSITY,
            "distribution": {"kind": "table", "diameters": [0.8 * DIAMETER, 1.2 * DIAMETER], "cumulative": [0.0, 1.0]},
            "pack": {"kind": "settled", "count": columns * layers, "start": [0.0, 0.0], "stop": [width, height]},
        },
        "contact": {
            "young_modulus": 5e6, "restitution": 0.3, "friction": BETWEEN, "wall_friction": ON_WALL, "speed": 1.0,
        },
        "boundary": {"left": {"particles": "remove"}, "right": {"particles": "remove"}},
        "walls": walls,
        "probes": [
            *({"name": name, "kind": "wall", "wall": name, **second_half} for name in ("first", "last")),
            {"name": "floor", "kind": "wall", "side": "bottom", **second_half},
            {"name": "layers", "kind": "profile", "axis": "z", "edges": edges, "sample_interval": 0.01, **second_half},
        ],
        "time": {"end": end, "output_interval": end},
    }  # fmt: skip


def silo(columns: int, layers: int, end: float) -> Silo:
    """A silo of so many mean diameters across and layers of grains, for a time [s]."""
    with tempfile.TemporaryDirectory() as folder:
        run = jaxdem.simulate(jaxdem.load_scene(tables(columns, layers, end)), Path(folder) / "run")
        probes = {name: run.probes[name] for name in ("first", "last", "floor", "layers")}
        names = ("z_lower", "z_upper", "z", "solid_fraction", "stress_zz")
        of_layers = {name: np.asarray(probes["layers"][name]) for name in names}
        radius = np.asarray(run.particles(0)["radius"], float)
    width = columns * DIAMETER
    section = width * DIAMETER
    weight = DENSITY * 4.0 / 3.0 * math.pi * float(np.sum(radius**3)) * GRAVITY / section
    filled = np.flatnonzero(of_layers["solid_fraction"] > 0.5 * of_layers["solid_fraction"].max())
    inner = filled[1:-1]
    bulk = DENSITY * float(of_layers["solid_fraction"][inner].mean())
    height = weight / (bulk * GRAVITY)
    thickness = of_layers["z_upper"] - of_layers["z_lower"]
    mean = float(np.sum(of_layers["stress_zz"] * thickness)) / height
    force = [abs(float(probes[name]["force_x"][-1])) for name in ("first", "last")]
    along = [abs(float(probes[name]["force_z"][-1])) for name in ("first", "last")]
    normal = 0.5 * sum(force) / (height * DIAMETER)
    half = filled[len(filled) // 2]
    middle = height - float(of_layers["z"][half]), float(of_layers["stress_zz"][half])
    floor = abs(float(probes["floor"]["force_z"][-1])) / section
    return Silo(width, height, weight, floor, middle, normal, sum(along) / sum(force), normal / mean)


def janssen(one: Silo, depth: float, ratio: float) -> float:
    """sigma = rho_b g w/(2 mu K) (1 - exp(-2 mu K z/w)) between two walls at a depth z [Pa]."""
    rate = 2.0 * ON_WALL * ratio / one.width
    return one.weight / (rate * one.height) * (1.0 - math.exp(-rate * depth))


@case(
    "Janssen silo",
    "moving walls",
    "H. A. Janssen, Z. Ver. Dtsch. Ing. 39 (1895) 1045-1049: sigma = rho g w/(2 mu K) (1 - exp(-2 mu K z/w))",
    fast={"columns": 8, "layers": (30,), "end": 0.4},
)
def janssen_silo(columns: int = 8, layers: Sequence[int] = (30, 60), end: float = 1.0) -> list[Figure]:
    """In 2-D, between walls that slide along the grains. K is measured in the lowest silo, and the others must follow
    with the same."""
    found, ratio = [], 0.0
    for count in layers:
        one = silo(columns, count, end)
        ratio = ratio or one.ratio
        name = f"{count} layers"
        found += [
            relative(f"{name}: friction on the walls over their normal force", ON_WALL, one.mobilised, 0.01),
            relative(f"{name}: stress on the floor", janssen(one, one.height, ratio), one.floor, 0.1, "Pa"),
            relative(f"{name}: stress in the middle", janssen(one, one.middle[0], ratio), one.middle[1], 0.1, "Pa"),
            at_least(f"{name}: weight of the grains over the force on the floor", 1.5, one.weight / one.floor),
        ]
    return found

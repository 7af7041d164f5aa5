"""The second tier of the tests: combinations of options, each of which is tested by itself in the first tier."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

from tests.cases import names

COMBINATION = pytest.mark.every_combination
"""`make test` leaves tests with this mark out; see CONTRIBUTING.md."""


def tiered(values: Iterable[Any], first: Iterable[Any]) -> list[Any]:
    """Values of a parameter, those that are not in `first` marked as combinations.

    Args:
        values: of one parameter, or tuples of the values of several.
        first: those of the first tier.

    Raises:
        ValueError: one of `first` is no value.
    """
    values, first = list(values), list(first)
    unknown = [value for value in first if value not in values]
    if unknown:
        raise ValueError(f"{unknown} are no values")
    return [value if value in first else _marked(value) for value in values]


def _marked(value: Any) -> Any:
    return pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=COMBINATION)


SECOND = frozenset({
    # Contacts: further impacts of laws that other cases have; gases and piles that run for long.
    "Hertz impact on a rigid plane", "head-on impact with size ratio ten", "MFIX DEM02: bounces",
    "JKR: sticking speed and the energy lost", "a grain hangs from a plate up to Bond number 1",
    "cohesive spheres: momentum and energy", "lubrication: wet restitution over the Stokes number",
    "lubrication: a steel ball that bounces in oil", "energy of an elastic gas",
    "beam of bonded grains: first frequency", "bonds: energy, momentum and angular momentum of a free strand",
    "half-filled drum", "consolidation under a piston", "granular column collapse",
    "Janssen silo",
    # The fluid: the same solver at finer meshes, and beside further walls.
    "Taylor-Green vortices, time alone", "lid-driven cavity",
    "Channels tilted in the mesh with Smagorinsky's viscosity", "Slow flow round a cylinder within another one",
    "Couette flow round a cylinder that begins to turn", "Polygon of 48 corners in place of a turning cylinder",
    "Cylinder in a channel at Re = 20 (2D-1)", "Poiseuille flow in a round pipe",
    "steady flow through a narrow outlet", "an eddy that leaves through the outlet",
    "piston in a tube with an open end", "grains that settle under an open top", "dam break of Martin & Moyce",
    # The exchange of particles and fluid, heat, slopes.
    "Fixed bed in a round pipe and in a square duct", "Bed of CFDEM's Ergun case in a round pipe",
    "one sphere settling, every drag law",
    "two-way settling in a periodic box", "fixed bed with hot gas in", "natural convection in a cavity",
    "hot drop in a stirred stream", "sloshing of warm water", "two layers that touch",
    "arrival of a dam's front by its height", "waves between walls in the mesh",
    "a broad-crested weir",
})  # fmt: skip
"""Verification cases whose code other cases run too, at smaller size."""


def cases_of(topic: str, long_runs: bool = False) -> list[Any]:
    """The cases of a topic that the tests run, those of the second tier marked.

    Args:
        topic: of the cases.
        long_runs: those of the second tier run for longer than their programs take to compile.
    """
    marks = (COMBINATION, pytest.mark.long_runs) if long_runs else (COMBINATION,)
    return [pytest.param(name, marks=marks) if name in SECOND else name for name in names(topic)]

"""The verification cases: code that carries its reference, run by `benchmarks/verification.py` and by the tests.

Each module registers its cases with `registry.case`; `collect` imports them all.
"""

from __future__ import annotations

import importlib

from tests.cases.registry import Case, registered

MODULES = (
    "contact",
    "cohesion",
    "bonds",
    "energy",
    "energy_of_bodies",
    "lubrication",
    "clumps",
    "conservation",
    "granular",
    "silo",
    "moving_walls",
    "meshes",
    "fluid",
    "outlets",
    "walls_in_fluid",
    "beds_in_pipes",
    "moving_in_fluid",
    "pistons_in_fluid",
    "consolidation",
    "exchange",
    "fluidised",
    "hindered",
    "settling",
    "gradients",
    "invariance",
    "lists",
    "heat",
    "two_fluids",
    "surface_beside_walls",
    "surface_at_sides",
    "heat_in_two_fluids",
    "scalars_in_two_fluids",
)


def collect() -> dict[str, Case]:
    """All cases by name, in the order of the modules."""
    for module in MODULES:
        importlib.import_module(f"tests.cases.{module}")
    return registered()


def names(topic: str) -> list[str]:
    """Cases of one topic that the test suite runs."""
    return [name for name, one in collect().items() if one.topic == topic and one.tested]


def checked(name: str) -> None:
    """Runs the fast twin of a case.

    Raises:
        AssertionError: a figure is outside its gate, or there is none.
    """
    figures = collect()[name].figures(fast=True)
    for figure in figures:
        print(figure)
    assert figures, f"{name}: no figures"
    missed = [figure for figure in figures if not figure.passed]
    assert not missed, missed

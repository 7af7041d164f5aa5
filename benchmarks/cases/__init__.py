"""The verification cases: code that carries its reference, run by `benchmarks/verification.py` and by the tests.

Each module registers its cases with `registry.case`; `collect` imports them all.
"""

from __future__ import annotations

import importlib

from benchmarks.cases.registry import Case, registered

MODULES = ("contact", "granular", "fluidised", "hindered")


def collect() -> dict[str, Case]:
    """All cases by name, in the order of the modules."""
    for module in MODULES:
        importlib.import_module(f"benchmarks.cases.{module}")
    return registered()

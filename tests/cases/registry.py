"""What a verification case is: a function that returns figures, each beside its reference and its gate."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

DATA = Path(__file__).parents[2] / "tests" / "data"


@dataclasses.dataclass(frozen=True)
class Figure:
    """One comparison.

    Attributes:
        what: the quantity, with its parameters.
        expected: reference.
        got: what the code gives.
        error: how far it is off, in the measure of the gate.
        gate: largest error accepted.
        unit: of expected and got.
    """

    what: str
    expected: float
    got: float
    error: float
    gate: float
    unit: str = "-"

    @property
    def passed(self) -> bool:
        """Whether the error is within the gate; an error that is not a number is not."""
        return math.isfinite(self.error) and self.error <= self.gate


@dataclasses.dataclass(frozen=True)
class Case:
    """A case of the verification page.

    Attributes:
        name: short, unique.
        topic: heading it stands under: contact, bonds, moving walls, fluid, exchange, gradients, invariance, granular,
            heat, surface.
        source: where the reference comes from.
        run: keyword arguments of `fast`, or none for full size -> figures.
        fast: arguments of the twin in the test suite; None for a case whose full size is run there too, or
            that has no twin because nothing smaller says anything (`tested` is then False).
        tested: whether the suite runs it.
    """

    name: str
    topic: str
    source: str
    run: Callable[..., Sequence[Figure]]
    fast: Mapping[str, Any] | None
    tested: bool

    def figures(self, fast: bool = False) -> Sequence[Figure]:
        """The figures of the case, at full size or as the tests run it."""
        return self.run(**(self.fast or {})) if fast else self.run()


_CASES: dict[str, Case] = {}


def registered() -> dict[str, Case]:
    """The cases registered so far, by name."""
    return dict(_CASES)


def case(
    name: str, topic: str, source: str, *, fast: Mapping[str, Any] | None = None, tested: bool = True
) -> Callable[[Callable[..., Sequence[Figure]]], Callable[..., Sequence[Figure]]]:
    """Registers a function as a case; see `Case`."""

    def register(run: Callable[..., Sequence[Figure]]) -> Callable[..., Sequence[Figure]]:
        if name in _CASES and _CASES[name].run.__qualname__ != run.__qualname__:
            raise ValueError(f"two cases are called {name!r}")
        _CASES[name] = Case(name, topic, source, run, fast, tested)
        return run

    return register


def relative(what: str, expected: float, got: float, gate: float, unit: str = "-") -> Figure:
    """A figure whose error is |got - expected| / |expected|."""
    expected, got = float(expected), float(got)
    return Figure(what, expected, got, abs(got - expected) / abs(expected), gate, unit)


def absolute(what: str, expected: float, got: float, gate: float, unit: str = "-") -> Figure:
    """A figure whose error is |got - expected|."""
    expected, got = float(expected), float(got)
    return Figure(what, expected, got, abs(got - expected), gate, unit)


def below(what: str, got: float, gate: float, unit: str = "-") -> Figure:
    """A figure that should be zero; its error is |got|."""
    return absolute(what, 0.0, got, gate, unit)


def at_least(what: str, least: float, got: float, unit: str = "-") -> Figure:
    """A figure that must reach `least`; its error is what is missing."""
    return Figure(what, float(least), float(got), max(0.0, float(least) - float(got)), 0.0, unit)


def table(name: str) -> np.ndarray:
    """A reference table of tests/data, as records; its first line says where it comes from."""
    return np.genfromtxt(DATA / name, delimiter=",", names=True, skip_header=1, dtype=None, encoding="utf-8")

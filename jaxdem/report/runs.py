"""What a comparison needs of a run, read with tolerance: a summary or a scene may lack keys."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxdem.io import Run
from jaxdem.io.part_columns import is_of_a_part
from jaxdem.metrics import METRICS

Array = NDArray[np.float64]

NAMES = tuple(metric.name for metric in METRICS)


def lookup(mapping: Mapping[str, Any] | None, dotted: str, default: Any = None) -> Any:
    """Value at a dotted key such as "fluid.cells"; `default` where any part of the way is missing or None."""
    value: Any = mapping
    for key in dotted.split("."):
        if not isinstance(value, Mapping) or key not in value:
            return default
        value = value[key]
    return default if value is None else value


def recorded(run: Run, in_summary: str, in_scene: str) -> Any:
    """What the summary has at a dotted key, else what the scene asked for; None where neither tells."""
    return lookup(run.summary, in_summary, lookup(run.scene, in_scene))


def number(value: object) -> float:
    """A float; of a table such as {value = 1e-4, limit = 2e-4} its value; NaN for anything else."""
    if isinstance(value, Mapping):
        value = next((value[key] for key in ("value", "used", "step") if key in value), None)
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        return float("nan")
    return float(value)


def text(value: object, fallback: str = "not recorded") -> str:
    """One line of text for a value of a summary: tables become "key value, key value"."""
    if value is None or value == "" or value == {}:
        return fallback
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {text(item)}" for key, item in value.items())
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list | tuple):
        return ", ".join(text(item) for item in value)
    return str(value)


def history_until(run: Run, until: float | None) -> dict[str, Array]:
    """The history up to and including the time `until` [s]; columns (T,), with `time` first: the metrics, and the
    columns of the parts of the scene.

    Columns of another length than the time are left out (a history cut by a kill), and so are those that tell nothing
    in the run's box, `without_meaning`.
    """
    history, left_out = run.history or {}, without_meaning(run)
    times = np.asarray(history.get("time", run.times), dtype=np.float64)
    keep = np.ones(len(times), bool) if until is None else times <= until * (1 + 1e-9)
    result = {"time": times[keep]}
    for name in (*NAMES, *filter(is_of_a_part, history)):
        values = history.get(name)
        if values is not None and len(values) == len(times) and name not in left_out:
            result[name] = np.asarray(values, dtype=np.float64)[keep]
    return result


def without_meaning(run: Run) -> dict[str, str]:
    """Metrics that tell nothing in the run's box, each with the reason, as far as is known.

    Where no side fixes the pressure its mean is zero by convention, and what is written is rounding. Along a periodic
    axis particles are anywhere in the box, so that they have neither a front nor a top.
    """
    sides = lookup(run.scene, "boundary", {})
    kinds = {name: lookup(side, "kind") for name, side in sides.items()}
    result = {}
    if kinds and "outlet" not in kinds.values():
        result["fluid_pressure_mean"] = "no side fixes the pressure, its mean is zero by convention"
    if kinds.get("left") == "periodic":
        result["runoff"] = "the box is periodic along x"
    if kinds.get("bottom") == "periodic":
        result["height"] = "the box is periodic along the vertical"
    return result


def cells(run: Run) -> tuple[int, ...] | None:
    """Number of fluid cells along each axis; None without fluid."""
    return tuple(map(int, lookup(run.scene, "fluid.cells", ()))) or None


def grains_per_particle(run: Run) -> float:
    """Number of grains that one particle of the run stands for, l^D with `particles.coarse_grain` = l."""
    return float(lookup(run.scene, "particles.coarse_grain", 1.0)) ** len(domain_size(run) or ())


def domain_size(run: Run) -> tuple[float, ...] | None:
    """Box sides [m], the vertical one last; None where the scene does not tell."""
    return tuple(map(float, lookup(run.scene, "domain.size", ()))) or None


def scene_differences(scene: Mapping[str, Any], reference: Mapping[str, Any]) -> dict[str, tuple[object, object]]:
    """Dotted keys in which two scenes differ, each with (value here, value in the reference); None where missing."""
    here, there = dict(_flat(scene or {})), dict(_flat(reference or {}))
    pairs = {key: (here.get(key), there.get(key)) for key in there | here}
    return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}


def _flat(mapping: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, object]]:
    for key, value in mapping.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", list(value) if isinstance(value, tuple) else value

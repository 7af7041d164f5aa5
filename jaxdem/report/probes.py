"""What the figures of probes show: series over time, and profiles along an axis at the last time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from jaxdem.report import style
from jaxdem.report.chart import Panel, Series
from jaxdem.report.comparison import Row
from jaxdem.report.runs import Array

SHOWN = {
    "plane": ("number_flow", "mass_flow", "fluid_volume_flow"),
    "wall": ("force", "torque", "power", "mass_in_contact", "fluid_force", "fluid_torque"),
    "point": ("fluid_velocity", "fluid_pressure"),
    "profile": ("solid_fraction", "velocity", "granular_temperature", "stress", "fluid_velocity", "void_fraction"),
}
"""By kind, the quantities that are drawn; of vectors and tensors every component on the diagonal. Lists of contacts
and the power of a wall that does not move are not drawn."""

COMPONENTS = ("", "_x", "_y", "_z", "_xx", "_yy", "_zz")


def probe_panels(rows: Sequence[Row]) -> list[Panel]:
    """Panels of the probes that the runs have, a series for each run and place; runs share the panel of a name."""
    found: dict[str, Panel] = {}
    for row in rows:
        for name, table in probes_of(row).items():
            described = _described(row, name)
            for column in _shown(described, table):
                if len(rows) == 1 and described.get("kind") == "wall" and not np.any(table[column]):
                    continue  # of a wall that nothing touches
                panel = found.setdefault(f"{name}/{column}", _axes(row, name, column, described))
                if panel.x_label == _axes(row, name, column, described).x_label:
                    found[f"{name}/{column}"] = _with(panel, _series(row, table, column, described, len(rows) == 1))
    return list(found.values())


def probe_differences(reference: Row, rows: Sequence[Row]) -> list[tuple[str, str, str, float, float]]:
    """Run, probe, column, and the mean over all lines of the run and of the reference, of what both have."""
    own, found = probes_of(reference), []
    for row in rows:
        for name, table in probes_of(row).items():
            for column in _shown(_described(row, name), table):
                if name in own and column in own[name]:
                    found.append((row.name, name, column, _mean(table[column]), _mean(own[name][column])))
    return found


def probes_of(row: Row) -> dict[str, dict[str, Array]]:
    """Tables of the probes of a run that have a line and are drawn."""
    probes = row.run.probes
    kinds = {name: _described(row, name).get("kind") for name in probes}
    return {name: probes[name] for name, kind in kinds.items() if kind in SHOWN and len(probes[name]["time"])}


def _mean(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def _described(row: Row, name: str) -> dict[str, Any]:
    return next((one for one in row.run.scene.get("probes", []) if one.get("name") == name), {})


def _shown(described: dict[str, Any], table: dict[str, Array]) -> list[str]:
    names = [stem + end for stem in SHOWN.get(described.get("kind", ""), ()) for end in COMPONENTS]
    known = [name for name in names if name in table and np.isfinite(table[name]).any()]
    return [name for name in known if name != "power" or np.any(table[name])]


def _axes(row: Row, name: str, column: str, described: dict[str, Any]) -> Panel:
    """The panel of a column, without series; a profile has its quantity along x and the axis upwards."""
    unit = row.run.probes.units(name).get(column, "")
    quantity = f"{name}: {column.replace('_', ' ')}" + (f" [{unit}]" if unit else "")
    axis = described.get("axis") if described.get("kind") == "profile" else None
    return Panel(quantity, f"{axis} [m]") if axis else Panel("time [s]", quantity)


def _with(panel: Panel, series: Iterator[Series]) -> Panel:
    return Panel(panel.x_label, panel.y_label, [*panel.series, *series])


def _series(row: Row, table: dict[str, Array], column: str, described: dict[str, Any], alone: bool) -> Iterator[Series]:
    """The last profile; else a line over time for every place: by the dash, of a run alone by the colour."""
    look, axis = row.look, described.get("axis") if described.get("kind") == "profile" else None
    if axis:
        last = table["time"] == table["time"][-1]
        known = table[column][last]
        yield Series(row.label, known, table[axis][last], look.color, look.dash, look.width, _marker(known))
        return
    number = len(table["time"]) // len(np.unique(table["time"]))
    for index in range(number):
        values, place = slice(index, None, number), _place(table, index, number)
        time, known = table["time"][values], table[column][values]
        around, color, dash = divmod(index, len(style.COLOURS)), look.color, look.dash
        if alone and number > 1:
            color, dash = style.COLOURS[around[1]], style.RUN_DASHES[around[0] % len(style.RUN_DASHES)]
        elif number > 1:
            dash = style.RUN_DASHES[(style.RUN_DASHES.index(dash) + index) % len(style.RUN_DASHES)]
        yield Series(row.label, time, known, color, dash, look.width, _marker(known), 6.0, note=place, place=place)


def _place(table: dict[str, Array], index: int, number: int) -> str:
    """What tells a place of a probe from its others: where it is; of its only place nothing."""
    if number == 1:
        return ""
    where = ", ".join(f"{table[axis][index]:g}" for axis in "xyz" if axis in table)
    return f"({where}) m" if where else f"place {index + 1} of {number}"


def _marker(values: Array) -> str:
    """A circle where a line would not be seen, as there are not two points beside each other."""
    known = np.isfinite(values)
    return "" if (known[1:] & known[:-1]).any() else "circle"

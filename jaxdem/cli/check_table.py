"""The scene check as tables for the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from rich.console import Group
from rich.markup import escape
from rich.table import Table

from jaxdem.check.check import CheckReport
from jaxdem.check.engineering import Number
from jaxdem.check.over_devices import DeviceReport
from jaxdem.check.run_cost import FACTOR
from jaxdem.cli.terminal import merge_text
from jaxdem.closures.correlation import VOID_FRACTION_FLOOR
from jaxdem.failures import MINIMUM_VOID_FRACTION

UNEVEN = 1.2
"""Particles of the fullest device over their mean number, above which it is told."""

LIMIT_NAMES = {
    "rayleigh": "Rayleigh time",
    "contact_duration": "duration of an impact",
    "contact_stability": "contact stability 2/omega_max",
    "contact_attraction": "growth of the attraction before touch",
    "contact_lubrication": "the liquid in the narrowest gap",
    "bond_stability": "stability of the bonds alone",
    "contact_automatic": "automatic contact step",
    "courant": "Courant limit",
    "viscous": "viscous limit",
    "viscous_model": "viscous limit of the models",
}


def render(report: CheckReport) -> Group:
    """One table per section; sections without rows are left out."""
    sections = {
        "Scene": _scene(report),
        "Time steps": _steps(report),
        "Resolution": _resolution(report),
        "Meshes": report.meshes,
        "Openings of walls": report.openings,
        "Probes": report.probes,
        "Engineering numbers": [(n.name, _number(n)) for n in report.numbers],
        "Wall time (estimate)": _wall_time(report),
        "Memory (estimate)": [(name, _size(number)) for name, number in report.memory.items()],
        "Devices (estimate)": [] if report.devices is None else _devices(report.devices),
        "Program": [
            ("compiled in", ", ".join(report.compiled_in)),
            ("left out", ", ".join(report.left_out) or "nothing"),
        ],
    }
    tables = []
    for title, section in sections.items():
        rows = list(section)
        if not rows:
            continue
        table = Table(title=title, title_justify="left", title_style="bold", show_header=False, box=None)
        table.add_column(width=30)
        table.add_column(overflow="fold")
        for name, text in rows:
            table.add_row(escape(name), escape(text))
        tables.append(table)
    if report.warnings:
        tables.append(warnings_table(report.warnings))
    return Group(*tables)


def warnings_table(warnings: Iterable[str]) -> Table:
    """A table with one row per warning."""
    table = Table(title="Warnings", title_justify="left", title_style="bold yellow", show_header=False, box=None)
    table.add_column(width=1)
    table.add_column(overflow="fold")
    for warning in warnings:
        table.add_row("!", escape(warning))
    return table


def _scene(report: CheckReport) -> Iterable[tuple[str, str]]:
    yield "box", f"{_times(report.size)} m"
    yield "precision", report.precision
    if report.start:
        yield "begins from", f"{report.start['from']} at t = {report.start['time']:.9g} s"
        changes = [
            ("removed", "removed"),
            ("added", "added"),
            ("never_inserted", "waiting at an inlet that has changed"),
        ]
        told = [f"{report.start[name]} {text}" for name, text in changes if report.start.get(name)]
        if "merged" in report.start:
            told.append(merge_text(report.start["merged"]))
        if "largest_move" in report.start:
            told.append(f"moved apart by up to {report.start['largest_move']:.3g} m")
        if told:
            yield "particles at the start", ", ".join(told)
    if report.particles is not None:
        stands_for = f", parcels of {report.grains_per_parcel:.6g} grains each" if report.grains_per_parcel else ""
        yield "particles" if not report.population else "particles, all rows", f"{report.particles}{stands_for}"
    yield from report.packs
    yield from report.population
    if report.cells is not None and report.spacing is not None:
        yield "mesh", f"{_times(report.cells)} cells of {_times(report.spacing)} m"
    if report.closed_pockets:
        yield "left out of the fluid", f"{report.closed_pockets} cells that walls cut off from the rest of the fluid"
    if report.cells_per_diameter is not None:
        low, high = report.cells_per_diameter
        yield "cell / diameter", f"{low:.3g}" if math.isclose(low, high) else f"{low:.3g} to {high:.3g}"
    if report.kernel_half_width is not None:
        yield "kernel half-width", f"{_times(report.kernel_half_width)} m"
    if report.void_fraction is not None:
        low, mean = report.void_fraction
        text = f"min {low:.3f}, mean {mean:.3f}; limit {MINIMUM_VOID_FRACTION} in a cell"
        yield "void fraction at the start", f"{text}, drag laws are evaluated at {VOID_FRACTION_FLOOR} or more"


def _steps(report: CheckReport) -> Iterable[tuple[str, str]]:
    steps = report.time_steps
    for name, value in report.limits.items():
        text = f"{value:.4g} s" if math.isfinite(value) else "none (no motion, or no viscosity)"
        if name == "courant" and math.isfinite(value):
            text += " at the largest boundary speed; for faster flow an interval has up to 8 fluid steps"
        if name == "contact_duration":
            text += f"; the automatic step is 1/20 of it, {value / 20.0:.4g} s"
        if name == "contact_stability":
            text += " with every contact for which there is room, at the largest expected overlap"
        if name == "viscous_model" and math.isfinite(value):
            text += " at the largest boundary speed; the run stops if the flow needs a shorter step"
        yield LIMIT_NAMES.get(name, name), text
    if "contact" in steps:
        duration = report.limits["contact_duration"] / steps["contact"]
        yield "contact step", f"{steps['contact']:.4g} s, 1/{duration:.0f} of an impact"
        yield "contact steps per interval", f"{steps['contacts_per_interval']:.0f}"
    if "fluid" in steps:
        yield "fluid step", f"{steps['fluid']:.4g} s, at least {steps['fluid_substeps']:.0f} per interval"
    if report.relaxation_time is not None:
        ratio = report.relaxation_time / steps["fluid"]
        text = f"{report.relaxation_time:.4g} s, {ratio:.3g} fluid steps (no stability limit, because drag is implicit)"
        yield "Stokes relaxation time", text
    renewed = "; particles enter and leave at its end" if report.population else ""
    yield "coupling interval", f"{steps['interval']:.4g} s{renewed}"
    total = f"{steps['intervals']:.0f} intervals, {steps['outputs']:.0f} outputs after the first"
    if "contacts_per_interval" in steps:
        total += f", {steps['intervals'] * steps['contacts_per_interval']:.3g} contact steps"
    yield "whole run", total


def _resolution(report: CheckReport) -> Iterable[tuple[str, str]]:
    if report.expected_speed is not None and report.expected_overlap is not None:
        yield "largest expected speed", f"{report.expected_speed:.3g} m/s (contact.speed)"
        text = f"{100 * report.expected_overlap:.2g} % of a diameter"
        if report.maximum_overlap is not None and report.speed_limit is not None:
            text += (
                f"; limit {100 * report.maximum_overlap:.3g} % (contact.maximum_overlap), reached at "
                f"{report.speed_limit:.3g} m/s, at which the run stops"
            )
        yield "overlap at that speed", text
    if report.restitution_error is not None:
        yield "error of the restitution", f"about {report.restitution_error:.2g}"
    if report.slip_error is not None:
        yield (
            "error of the slip after an impact",
            f"up to about {report.slip_error:.2g} of the slip before it",
        )
    if report.resting_overlap is not None:
        yield "overlap under own weight", f"{100 * report.resting_overlap:.2g} % of a diameter"
    load = report.screen_load
    if load is not None:
        text = f"{100 * load.overlap:.2g} % of a diameter: {load.weights:.2g} times a grain's weight on average"
        yield (
            f"overlap under flow at {load.side}",
            f"{text}, if all grains gather there; force chains carry up to three times this load",
        )
    if report.overlap_resolution is not None:
        text = f"{report.overlap_resolution:.1g} of the overlap under own weight"
        if report.overlap_resolution > 1e-2:
            text += '; resting grains will not come fully to rest: soften the contact or use precision = "float64"'
        yield "float32 resolves overlaps to", text
    if report.particles is None:
        yield "particles", "none"


def _number(number: Number) -> str:
    text = f"{number.low:.3g}"
    if not math.isclose(number.low, number.high, rel_tol=1e-3):
        text += f" to {number.high:.3g}"
    if number.unit != "-":
        text += f" {number.unit}"
    return f"{text}; {number.note}" if number.note else text


def _devices(report: DeviceReport) -> Iterable[tuple[str, str]]:
    yield "devices", f"{report.number}, each with a part of the box along axis {report.axis}"
    if report.cells:
        yield "cells of each", str(report.cells)
    if report.particles:
        yield "particles of each", _range(report.particles)
        yield "ghosts of each", f"{_range(report.ghosts)}: particles of its neighbours within reach of the border"
        yield "sent by each", f"{_size(report.sent[0])} in a contact step"
    if report.cells:
        yield "sent by each", f"{_size(report.sent[1])} in an iteration of the pressure"
    if report.sent[2]:
        yield "sent by each", f"{_size(report.sent[2])} in an interval to cut the mesh of the fluid anew"
    yield "memory of each", f"{_size(report.memory)} while running"
    if report.shorter is None or report.useful is None:
        return
    text = f"{report.shorter:.2g} times as fast as on one device"
    if report.useful == 1:
        text += ". Several devices do not help"
    elif report.useful < report.number:
        text += f". So many devices do not help: with {report.useful} it is about as fast"
    else:
        text += f". More than {report.useful} devices do not help"
    yield "contact steps", text
    if report.imbalance > UNEVEN:
        text = f"the fullest device has {report.imbalance:.2g} times the mean number of particles at the start"
        yield "uneven", f"{text}, and sets the pace: with a fluid all have as many cells, and the slabs do not move"


def _range(numbers: Sequence[int]) -> str:
    low, high = min(numbers), max(numbers)
    return str(low) if low == high else f"{low} to {high}"


def _wall_time(report: CheckReport) -> Iterable[tuple[str, str]]:
    cost = report.cost
    parts = [("contacts", cost.contacts), ("fluid and exchange", cost.fluid), ("output", cost.output)]
    shares = ", ".join(f"{name} {_duration(time)}" for name, time in parts if time > 0.0)
    yield "run", f"{_duration(cost.total)} within a factor of {FACTOR:g} ({shares})"
    if report.processes is not None and report.processes.shorter is not None:
        several, times = report.processes.number, report.processes.shorter
        yield "contacts use one core", f"about {times:.2g} times as fast with --processes {several} (docs/devices.md)"
    yield (
        "compilation",
        f"about {cost.compiling:.2g} s of a core the first time, in addition; more with meshes and learned closures",
    )
    text = f"costs per particle, pair and cell, measured on {cost.basis}"
    yield "basis", f"{text}; without learned closures"


def _duration(seconds: float) -> str:
    for unit, size in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.2g} s"


def _times(values: Iterable[float]) -> str:
    return " x ".join(f"{value:.4g}" for value in values)


def _size(number: float) -> str:
    for unit in ("B", "KiB", "MiB", "GiB"):
        if number < 1024.0 or unit == "GiB":
            break
        number /= 1024.0
    return f"{number:.3g} {unit}"

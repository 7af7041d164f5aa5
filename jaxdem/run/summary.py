"""Content of summary.json. Host side."""

from __future__ import annotations

import importlib.metadata
import math
import platform
from typing import Any

import jax
import numpy as np

from jaxdem import metrics
from jaxdem.closures import DRAG_LAWS
from jaxdem.closures.base import FixedClosure
from jaxdem.particles.neighbors import Room
from jaxdem.run.instant import Instant
from jaxdem.run.parts import PARTS
from jaxdem.run.parts.population import particle_counts
from jaxdem.run.profile import WORTH_SPLITTING, estimate_stages
from jaxdem.run.totals import Totals
from jaxdem.scene import Scene
from jaxdem.setup.builder import Case
from jaxdem.state import Parameters
from jaxdem.structure import TimeSteps
from jaxdem.version import __version__


def run_summary(
    case: Case,
    instant: Instant,
    room: Room | None,
    totals: Totals,
    valid: bool,
    reason: str,
    split_stages: bool,
) -> dict[str, Any]:
    """Content of summary.json.

    Args:
        case: that ran.
        instant: that it has reached.
        room: of its list, on several devices of that of each slab; None without particles.
        totals: of the run.
        valid: whether it reached its end soundly.
        reason: why not.
        split_stages: False where nothing may be compiled to tell the stages of a part apart.
    """
    scene, simulation = case.scene, case.simulation
    elapsed, compiled = totals.elapsed(), totals.compile_seconds()
    worth_splitting = WORTH_SPLITTING if split_stages else math.inf
    stages, estimated = estimate_stages(case, instant, totals, worth_splitting)
    stages["compile"] = compiled
    return {
        "valid": valid,
        "reason": reason,
        "time": instant.time,
        "versions": versions(),
        "device": str(jax.devices()[0].device_kind),
        "machine": {"processor": platform.processor() or platform.machine(), "devices": jax.device_count()},
        "precision": scene.precision,
        "wall_time_s": elapsed,
        "run_time_s": metrics.run_time({"wall_time_s": elapsed, "stages_s": stages}),
        "stages_s": stages,
        "estimated": estimated,
        "time_steps": _time_steps(simulation.steps, totals),
        "counts": _counts(case, instant, room, totals),
        **{name: value for part in PARTS for name, value in part.summary(case, instant, totals).items()},
        "fastest_particle": totals.fastest,
        "kernel_half_width": simulation.half_width,
        "residuals": {"mass": totals.mass, "momentum": totals.momentum, "volume": totals.volume},
        "closure": _closure(case, instant, totals),
    }


def _time_steps(steps: TimeSteps, totals: Totals) -> dict[str, Any]:
    return {
        "contact": steps.contact,
        "fluid": steps.interval * totals.intervals / totals.fluid_steps if totals.fluid_steps else None,
        "coupling": steps.interval,
        "limits": steps.limits,
        "courant_max": totals.courant,
    }


def _counts(case: Case, instant: Instant, room: Room | None, totals: Totals) -> dict[str, float]:
    scene, bodies = case.scene, case.parameters.bodies
    found = {
        "particles": _rows(instant),
        "grains_per_particle": 1.0 if bodies is None or bodies.parcels is None else float(bodies.parcels.grains),
        "cells": int(np.prod(scene.fluid.cells)) if scene.fluid else 0,
        "coupling_intervals": totals.intervals,
        "contact_steps": totals.intervals * case.simulation.steps.contacts_per_interval,
        "fluid_steps": totals.fluid_steps,
        "neighbor_builds": totals.builds,
        "neighbor_slots": 0 if room is None else room.slots,
        "pair_slots": 0 if room is None else room.pairs,
        "neighbor_resizes": totals.resizes,
        "solver_iterations_max": totals.iterations,
    }
    return found | particle_counts(case.simulation, instant.state)


def _rows(instant: Instant) -> int:
    """Number of particles that there ever are."""
    particles = instant.state.particles
    return 0 if particles is None else particles.position.shape[0]


def _closure(case: Case, instant: Instant, totals: Totals) -> dict[str, Any]:
    scene = case.scene
    used = totals.present if totals.present > 0.0 else _rows(instant) * max(totals.intervals, 1)
    return {
        "file": scene.closure.file,
        "subgrid_file": None if scene.fluid is None else scene.fluid.subgrid,
        "law": _law_name(scene, case.parameters),
        "out_of_range_fraction": totals.out_of_range / used if used else 0.0,
        # Mean spread over mean force, both over particles and outputs; null without an ensemble.
        "ensemble_spread": totals.spread / totals.ensemble_force if totals.ensemble_force else None,
    }


def _law_name(scene: Scene, parameters: Parameters) -> str | None:
    """The scene's name of the drag law, or the class of one that was given in its place."""
    if scene.coupling is None or scene.fluid is None:
        return None
    law, name = parameters.closure, scene.coupling.drag
    of_scene = scene.closure.file is not None or type(law) is DRAG_LAWS.get(name)
    if isinstance(law, FixedClosure):
        return getattr(law.function, "__name__", type(law.function).__name__)
    return name if of_scene else type(law).__name__


def versions() -> dict[str, str]:
    """Of jaxdem, Python and the packages that numbers depend on."""
    names = ("jax", "jaxlib", "optax", "h5py", "numpy")
    return {
        "jaxdem": __version__,
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in names},
    }

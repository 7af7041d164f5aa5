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
from jaxdem.run.bonds import bond_figures
from jaxdem.run.energy import energy_figures
from jaxdem.run.profile import WORTH_SPLITTING, estimate_stages
from jaxdem.run.records import Instant, particle_counts
from jaxdem.run.scalar_figures import heat_summary
from jaxdem.run.totals import Totals
from jaxdem.run.wear import wear_summary
from jaxdem.scene import Scene
from jaxdem.setup.builder import Case
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State
from jaxdem.version import __version__


def run_summary(
    case: Case, instant: Instant, totals: Totals, valid: bool, reason: str, split_stages: bool
) -> dict[str, Any]:
    """Content of summary.json.

    Args:
        case: that ran.
        instant: that it has reached.
        totals: of the run.
        valid: whether it reached its end soundly.
        reason: why not.
        split_stages: False where nothing may be compiled to tell the stages of a part apart.
    """
    parcels = None if case.parameters.bodies is None else case.parameters.bodies.parcels
    grains = 1.0 if parcels is None else float(parcels.grains)
    scene, simulation, state, neighbors = case.scene, case.simulation, instant.state, instant.neighbors
    count = 0 if state.particles is None else state.particles.position.shape[0]
    elapsed, compiled, steps = totals.elapsed(), totals.compile_seconds(), simulation.steps
    worth_splitting = WORTH_SPLITTING if split_stages else math.inf
    stages, estimated = estimate_stages(case, instant, totals, worth_splitting)
    stages["compile"] = compiled
    used = count * max(totals.intervals, 1)
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
        "time_steps": {
            "contact": steps.contact,
            "fluid": steps.interval * totals.intervals / totals.fluid_steps if totals.fluid_steps else None,
            "coupling": steps.interval,
            "limits": steps.limits,
            "courant_max": totals.courant,
        },
        "counts": {
            "particles": count,
            "grains_per_particle": grains,
            "cells": int(np.prod(scene.fluid.cells)) if scene.fluid else 0,
            "coupling_intervals": totals.intervals,
            "contact_steps": totals.intervals * steps.contacts_per_interval,
            "fluid_steps": totals.fluid_steps,
            "neighbor_builds": totals.builds,
            "neighbor_slots": 0 if neighbors is None else neighbors.room.slots,
            "pair_slots": 0 if neighbors is None else neighbors.room.pairs,
            "neighbor_resizes": totals.resizes,
            "solver_iterations_max": totals.iterations,
        }
        | particle_counts(simulation, state),
        **_pack_figures(case),
        **_inlet_figures(simulation, state, totals),
        **_liquid_figures(case, state),
        **bond_figures(case, state.particles),
        **heat_summary(state, case, totals.heat_start),
        **({"start": case.start_figures} if case.start is not None else {}),
        **_walls_in_fluid(case, totals),
        **wear_summary(case, state),
        **energy_figures(case, instant, totals),
        "fastest_particle": totals.fastest,
        "kernel_half_width": simulation.half_width,
        "residuals": {"mass": totals.mass, "momentum": totals.momentum, "volume": totals.volume},
        "closure": {
            "file": scene.closure.file,
            "subgrid_file": None if scene.fluid is None else scene.fluid.subgrid,
            "law": _law_name(scene, case.parameters),
            "out_of_range_fraction": totals.out_of_range / used if used else 0.0,
            # Mean spread over mean force, both over particles and outputs; null without an ensemble.
            "ensemble_spread": totals.spread / totals.ensemble_force if totals.ensemble_force else None,
        },
    }


def _walls_in_fluid(case: Case, totals: Totals) -> dict[str, Any]:
    """Mean force of the fluid on every wall that it sees, over the run [N]; {} without such walls."""
    owners = case.fluid_walls.walls
    if not owners or not totals.intervals:
        return {}
    forces = np.reshape(totals.surface_force, (len(owners), -1)) / totals.intervals
    found = []
    for number in dict.fromkeys(owners):
        own = forces[[k for k, owner in enumerate(owners) if owner == number]].sum(axis=0)
        name = case.scene.walls[number].name
        found.append({"wall": number, "name": name, "fluid_force_mean": own.tolist()})
    return {"walls_in_fluid": found}


def _law_name(scene: Scene, parameters: Parameters) -> str | None:
    """The scene's name of the drag law, or the class of one that was given in its place."""
    if scene.coupling is None or scene.fluid is None:
        return None
    law, name = parameters.closure, scene.coupling.drag
    of_scene = scene.closure.file is not None or type(law) is DRAG_LAWS.get(name)
    if isinstance(law, FixedClosure):
        return getattr(law.function, "__name__", type(law.function).__name__)
    return name if of_scene else type(law).__name__


def _pack_figures(case: Case) -> dict[str, Any]:
    """Number and solid fraction of every pack, before it settled; {} without."""
    packs = () if case.particles is None else case.particles.packs
    found = [{"kind": pack.pack.kind, "particles": pack.count, "solid_fraction": pack.solid_fraction} for pack in packs]
    return {"packs": found} if found else {}


def _inlet_figures(simulation: Simulation, state: State, totals: Totals) -> dict[str, Any]:
    """What waited for room; {} without inlets."""
    if simulation.population is None or not simulation.population.inlets or state.particles is None:
        return {}
    inserted = np.asarray(state.particles.inserted)
    return {
        "inlets": {
            "inserted": inserted.tolist(),
            "waiting": totals.waiting,
            "waiting_most": totals.waiting_most,
            # Every interval that a particle waits delays it by one; those that still wait count too.
            "delay_mean_s": totals.waited * simulation.interval / max(int(inserted.sum()) + totals.waiting, 1),
        }
    }


def _liquid_figures(case: Case, state: State) -> dict[str, Any]:
    """Where the liquid of capillary bridges is, and what is missing of it; {} without [m3, -]."""
    particles, scene = state.particles, case.scene
    if particles is None or particles.liquid is None or scene.contact is None or scene.contact.cohesion is None:
        return {}
    held = particles.contact_spring[-1:], particles.wall_spring[-1:]
    films = float(np.sum(np.asarray(particles.liquid), dtype=np.float64))
    between, walls = (float(np.sum(np.asarray(volumes), dtype=np.float64)) for volumes in held)
    radius = np.broadcast_to(np.asarray(case.bodies.radius, float), particles.liquid.shape)
    start = (scene.contact.cohesion.liquid_content or 0.0) * float(np.sum(4.0 / 3.0 * np.pi * radius**3))
    missing = start - films - between - walls
    bridges = sum(int(np.count_nonzero(np.asarray(volumes))) for volumes in held)
    return {
        "liquid": {
            "start": start,
            "films": films,
            "bridges_between_particles": between,
            "bridges_to_walls": walls,
            "bridges": bridges,
            "missing_relative": missing / start if start else 0.0,
        }
    }


def versions() -> dict[str, str]:
    """Of jaxdem, Python and the packages that numbers depend on."""
    names = ("jax", "jaxlib", "optax", "h5py", "numpy")
    return {
        "jaxdem": __version__,
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in names},
    }

"""What a run writes: frames, history rows, samples and the summary, from state and diagnostics. Host side."""

from __future__ import annotations

import importlib.metadata
import math
import platform
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem import metrics
from jaxdem.closures import DRAG_LAWS
from jaxdem.closures.base import FixedClosure
from jaxdem.closures.ensemble import EnsembleClosure
from jaxdem.coupling.exchange import FluidForces
from jaxdem.fluid.grid import cell_average
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.packing import into_period
from jaxdem.run.profile import WORTH_SPLITTING, estimate_stages
from jaxdem.run.totals import Totals
from jaxdem.scene import Scene
from jaxdem.setup.builder import Case
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State
from jaxdem.version import __version__

SAMPLE_INPUTS = (
    "particle_velocity",
    "fluid_velocity",
    "solid_fraction",
    "void_fraction_gradient",
    "pressure_gradient",
)
"""Inputs of the drag law that samples.h5 keeps."""


@jax.jit
def ensemble_spread(closure: EnsembleClosure, forces: FluidForces) -> tuple[Array, Array]:
    """Mean over the particles of the spread of the members' forces, and of the size of the ensemble's [N].

    As the closure gives them: before a drag scale, and of model A.
    """
    drag = closure(forces.inputs)
    force = drag.coefficient[:, None] * forces.inputs.slip_velocity
    if drag.remainder is not None:
        force = force + drag.remainder
    return jnp.mean(closure.spread(forces.inputs)), jnp.mean(jnp.linalg.norm(force, axis=1))


def frame_of(
    simulation: Simulation, parameters: Parameters, state: State, forces: FluidForces | None
) -> tuple[dict[str, np.ndarray] | None, dict[str, np.ndarray] | None]:
    """Arrays of one output frame for particles and fluid; None for a part that the scene has not."""
    particles = fluid = None
    if state.particles is not None and parameters.bodies is not None:
        count, dimension = state.particles.position.shape
        drag = np.zeros((count, dimension)) if forces is None else np.asarray(forces.drag)
        particles = {
            "position": wrapped_position(simulation, state),
            "velocity": np.asarray(state.particles.velocity),
            "angular_velocity": np.asarray(state.particles.angular_velocity),
            "drag_force": drag.astype(state.particles.velocity.dtype),
            "contact_force": np.asarray(state.particles.contact_force),
            "radius": np.broadcast_to(np.asarray(parameters.bodies.radius), count).copy(),
        }
        if state.particles.active is not None:
            particles["active"] = np.asarray(state.particles.active).astype(np.uint8)
            # Those removed at the end of the interval had a drag within it.
            particles["drag_force"] = np.where(particles["active"][:, None], particles["drag_force"], 0)
    if state.fluid is not None:
        cells = state.fluid.pressure.shape
        void_fraction = state.fluid.void_fraction
        fluid = {
            "velocity": np.stack([np.asarray(u) for u in cell_average(state.fluid.face_velocity)], axis=-1),
            "pressure": np.asarray(state.fluid.pressure),
            "void_fraction": np.ones(cells, state.fluid.pressure.dtype)
            if void_fraction is None
            else np.asarray(void_fraction),
        }
    return particles, fluid


def history_of(
    simulation: Simulation,
    parameters: Parameters,
    state: State,
    forces: FluidForces | None,
    time: float,
    collision: float | None,
) -> dict[str, float]:
    """One row of history.csv."""
    values: dict[str, Any] = {}
    if state.particles is not None and parameters.bodies is not None:
        values |= {
            "position": wrapped_position(simulation, state),
            "velocity": state.particles.velocity,
            "angular_velocity": state.particles.angular_velocity,
            "mass": parameters.bodies.mass,
            "inertia": parameters.bodies.inertia,
            "collision_force": collision,
        }
        if state.fluid is not None:
            values["drag_force"] = np.zeros_like(state.particles.velocity) if forces is None else forces.drag
    if state.fluid is not None:
        frame = frame_of(simulation, parameters, state._replace(particles=None), None)[1]
        assert frame is not None
        values |= {"fluid_pressure": frame["pressure"], "fluid_velocity": frame["velocity"]}
    arrays: dict[str, Any] = {name: np.asarray(value) for name, value in values.items()}
    if state.particles is None or state.particles.active is None:
        return metrics.history_row(time, **arrays)
    active = np.asarray(state.particles.active)
    for name in ("position", "velocity", "angular_velocity", "mass", "inertia", "drag_force"):
        if name in arrays and arrays[name].ndim:
            arrays[name] = arrays[name][active]
    counts = particle_counts(simulation, state)
    return metrics.history_row(time, **arrays) | {name: float(counts[name]) for name in ("present", "removed")}


def particle_counts(simulation: Simulation, state: State) -> dict[str, int]:
    """How many there were at the start, have come in, have been removed and are present; {} where none comes or goes.

    initial + inserted = removed + present, for a row of the state is used once.
    """
    population, particles = simulation.population, state.particles
    if population is None or particles is None or particles.active is None:
        return {}
    coming = sum(len(inlet.due) for inlet in population.inlets)
    initial = particles.position.shape[0] - coming
    inserted = 0 if particles.inserted is None else int(np.sum(particles.inserted))
    present = int(np.sum(particles.active))
    removed = initial + inserted - present
    return {"initial": initial, "inserted": inserted, "removed": removed, "present": present}


def wrapped_position(simulation: Simulation, state: State) -> np.ndarray:
    """(N, D) centres, inside the box along its periodic axes [m]."""
    assert state.particles is not None
    position = np.asarray(state.particles.position)
    if not any(simulation.periodic):
        return position
    # In float64: far from the box the leading part alone is off by more than what grains overlap.
    low = state.particles.position_low
    centre = position.astype(np.float64) + (0.0 if low is None else np.asarray(low, np.float64))
    inside = into_period(centre, np.asarray(simulation.box)).astype(position.dtype)
    return np.where(simulation.periodic, inside, position)


def sample_of(
    simulation: Simulation, before: State, after: State, forces: FluidForces, volume: np.ndarray
) -> dict[str, np.ndarray]:
    """What the drag law saw and gave at the start of the interval from `before` to `after`, with the fields.

    The law's force and the pressure gradient force belong to that moment; the viscous force is the mean over
    the interval, which the solver has at hand. In model B the drag stands for both, and they are zero.
    """
    assert simulation.fluid is not None
    assert before.particles is not None and before.fluid is not None and after.fluid is not None
    sample = {name: np.asarray(getattr(forces.inputs, name)) for name in SAMPLE_INPUTS}
    volume = np.asarray(volume).reshape(-1, 1) * float(simulation.fluid.solver.shares_stress)
    sample |= {
        "position": wrapped_position(simulation, before),
        "slip_velocity": np.asarray(forces.inputs.slip_velocity),
        "reynolds": np.asarray(forces.inputs.reynolds),
        "drag_force": np.asarray(forces.law),
        "pressure_gradient_force": -volume * sample["pressure_gradient"],
        "viscous_force": np.asarray(forces.viscous),
        "pressure": np.asarray(before.fluid.pressure),
        # The void fraction of `after` was deposited from the positions of `before`.
        "void_fraction": np.asarray(after.fluid.void_fraction),
    }
    return sample | {f"face_velocity_{axis}": np.asarray(u) for axis, u in enumerate(before.fluid.face_velocity)}


def sample_attributes(case: Case) -> dict[str, Any]:
    """Constants that a reader of samples.h5 needs."""
    scene, bodies = case.scene, case.bodies
    fluid, coupling = scene.fluid, scene.coupling
    assert fluid is not None and coupling is not None
    return {
        "drag": coupling.drag,
        "closure": scene.closure.file or "",
        "fluid_density": fluid.density,
        "kinematic_viscosity": fluid.viscosity,
        "cells": np.asarray(fluid.cells),
        "size": np.asarray(scene.domain.size),
        "depth": scene.domain.depth or 1.0,
        "kernel_half_width": np.asarray(case.simulation.half_width),
        "kernel_diameters": coupling.kernel_width.diameters,
        "kernel_cells": coupling.kernel_width.cells,
        "radius": bodies.radius,
        "particle_density": bodies.density,
        "interval": case.simulation.interval,
        "dimension": scene.dimension,
    }


def run_summary(
    scene: Scene,
    simulation: Simulation,
    parameters: Parameters,
    state: State,
    neighbors: Neighbors | None,
    totals: Totals,
    *,
    valid: bool,
    reason: str,
    time: float,
    split_stages: bool = True,
) -> dict[str, Any]:
    """Content of summary.json; without `split_stages` nothing is compiled to tell the stages of a part apart."""
    count = 0 if state.particles is None else state.particles.position.shape[0]
    elapsed, compiled = totals.elapsed(), totals.compile_seconds()
    steps = simulation.steps
    worth_splitting = WORTH_SPLITTING if split_stages else math.inf
    stages, estimated = estimate_stages(simulation, parameters, state, neighbors, totals, worth_splitting)
    stages["compile"] = compiled
    used = count * max(totals.intervals, 1)
    return {
        "valid": valid,
        "reason": reason,
        "time": time,
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
        **_inlet_figures(simulation, state, totals),
        "fastest_particle": totals.fastest,
        "kernel_half_width": simulation.half_width,
        "residuals": {"mass": totals.mass, "momentum": totals.momentum, "volume": totals.volume},
        "closure": {
            "file": scene.closure.file,
            "subgrid_file": None if scene.fluid is None else scene.fluid.subgrid,
            "law": _law_name(scene, parameters),
            "out_of_range_fraction": totals.out_of_range / used if used else 0.0,
            # Mean spread over mean force, both over particles and outputs; null without an ensemble.
            "ensemble_spread": totals.spread / totals.ensemble_force if totals.ensemble_force else None,
        },
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


def versions() -> dict[str, str]:
    """Of jaxdem, Python and the packages that numbers depend on."""
    names = ("jax", "jaxlib", "optax", "h5py", "numpy")
    return {
        "jaxdem": __version__,
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in names},
    }

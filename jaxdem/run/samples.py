"""What the drag law saw and gave, for samples.h5. Host side."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxdem.coupling.exchange_result import FluidForces
from jaxdem.errors import InputError, required
from jaxdem.run.instant import wrapped_position
from jaxdem.scene import Scene
from jaxdem.setup.builder import Case
from jaxdem.simulation import Simulation
from jaxdem.state import State

SAMPLE_INPUTS = (
    "particle_velocity",
    "fluid_velocity",
    "solid_fraction",
    "void_fraction_gradient",
    "pressure_gradient",
)
"""Inputs of the drag law that samples.h5 keeps."""


def sample_of(case: Case, before: State, after: State, forces: FluidForces) -> dict[str, np.ndarray]:
    """What the drag law saw and gave at the start of the interval from `before` to `after`, with the fields.

    The law's force and the pressure gradient force belong to that moment; the viscous force is the mean over
    the interval, which the solver has at hand. In model B the drag stands for both, and they are zero.
    """
    particles, fluid = required(before.particles, "particles"), required(before.fluid, "fluid")
    mixture, coupling = case.parameters.mixture, required(case.simulation.coupling, "coupling")
    sample = {name: np.asarray(getattr(forces.inputs, name)) for name in SAMPLE_INPUTS}
    volume = np.asarray(mixture.bodies.volume).reshape(-1, 1) * float(coupling.interval.solver.shares_stress)
    sample |= {
        "position": wrapped_position(case.simulation, particles),
        "slip_velocity": np.asarray(forces.inputs.slip_velocity),
        "reynolds": np.asarray(forces.inputs.reynolds),
        "drag_force": np.asarray(forces.law),
        "pressure_gradient_force": -volume * sample["pressure_gradient"],
        "viscous_force": np.asarray(forces.viscous),
        "pressure": np.asarray(fluid.pressure),
        # The void fraction of `after` was deposited from the positions of `before`.
        "void_fraction": np.asarray(required(after.fluid, "fluid").void_fraction),
    }
    if fluid.mean_gradient is not None:
        sample["mean_gradient"] = np.asarray(fluid.mean_gradient)
    return sample | {f"face_velocity_{axis}": np.asarray(u) for axis, u in enumerate(fluid.face_velocity)}


def sample_attributes(case: Case) -> dict[str, Any]:
    """Constants that a reader of samples.h5 needs."""
    scene, bodies = case.scene, case.bodies
    fluid, coupling = required(scene.fluid, "[fluid]"), required(scene.coupling, "[coupling]")
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


def samples_every(scene: Scene, simulation: Simulation) -> int:
    """Number of coupling intervals between samples, 0 for none."""
    wanted = scene.output.samples
    if wanted == 0.0:
        return 0
    if scene.fluid is None or scene.coupling is None:
        raise InputError("output.samples", wanted, "needs both [fluid] and [particles]", "set it to 0")
    if simulation.population is not None:
        raise InputError(
            "output.samples", wanted, "training samples cannot be written where particles enter or leave", "set it to 0"
        )  # fmt: skip
    if wanted > scene.time.end * (1.0 + 1e-9):
        raise InputError(
            "output.samples",
            wanted,
            f"the scene ends at {scene.time.end:g} s, so there would be no sample",
            "lower the time between samples",
        )
    ratio = wanted / simulation.interval
    every = max(1, round(ratio))
    if abs(every - ratio) > 1e-6 * every:
        raise InputError(
            "output.samples",
            wanted,
            f"must be a multiple of the coupling interval, {simulation.interval:.6g} s",
            f"use, for example, {every * simulation.interval:.6g}",
        )
    return every

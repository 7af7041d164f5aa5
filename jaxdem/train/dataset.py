"""Training data from a run: what a coarse mesh would show the drag law, and the force it should give.

The fluid fields of each sample are averaged to the coarse mesh, the flux g u and the pressure by area and
volume; the void fraction is deposited from the particles as the coarse solver deposits it, with its kernel;
and all are seen by the particles through the coarse solver's own weights. The target is the fluid force of
the fine run less the pressure and viscous force that the coarse run applies itself:

    F_target = F_drag + (-V grad p + V div tau)_fine - (-V grad p + V div tau)_coarse

That is a drag of model A. A run of model B has all its fluid force in F_drag; its target is of model A too, and so
is the dataset's `drag_force`, g F_drag there, which both recipes learn; the exchange converts what is learned from it
as it converts the correlations.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.base import DragInputs
from jaxdem.coupling.coarse_inputs import CoarseInputs
from jaxdem.coupling.interpolation import interpolate_faces
from jaxdem.coupling.model_b import drag_of_model_a
from jaxdem.errors import InputError, is_whole, required
from jaxdem.fluid.boundary import Sides
from jaxdem.fluid.diffusion import stress_divergence
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.grid import face_average
from jaxdem.fluid.remap import coarsened, remap_cells, remap_flux
from jaxdem.io import Run, load_run
from jaxdem.io.outputs import refuse_what_is_read
from jaxdem.io.samples import Samples
from jaxdem.particles.integrate import ParticleState, as_column
from jaxdem.scene import Scene, load_scene, named_files
from jaxdem.setup.builder import build
from jaxdem.train.dataset_file import SEEING, write_dataset

COLUMNS = (
    "particle_velocity",
    "fluid_velocity",
    "solid_fraction",
    "void_fraction_gradient",
    "pressure_gradient",
    "wide_solid_fraction",
)


def make_dataset(
    run: str | Path,
    out: str | Path,
    coarsen: tuple[int, ...] = (1, 2, 4, 8),
    progress: Callable[[int, int], None] | None = None,
    every: int = 1,
    overrides: dict[str, Any] | None = None,
) -> None:
    """Writes the dataset file of a run.

    Args:
        run: run directory with samples (scene key `output.samples`).
        out: dataset file.
        coarsen: factors of the mesh; 1 is the run's own mesh.
        progress: called with the samples done and their number, all factors together.
        every: use every so many-th sample.
        overrides: keys of `SEEING` in which the coarse runs differ from the fine one; without effect on a factor of 1.

    Raises:
        InputError: `out` is a file of a run or is read, the run is not valid, has no samples, or has
            `coupling.self_disturbance`; a factor is not usable, or another key is to differ.
    """
    if not is_whole(every) or every < 1:
        raise InputError("every", every, "must be a whole number from 1 up", "give 1 for all samples")
    source = load_run(run)
    refuse_what_is_read("--out", Path(out), (run, *named_files(source.scene)))
    samples = _samples(source)
    overrides = overrides or {}
    for key, value in overrides.items():
        if not key.startswith(SEEING):
            limit = f"the keys that can be set for a dataset are {' and '.join(SEEING)}"
            raise InputError(key, value, limit, "leave this key out")
    # Closures are trained in single precision, whatever the run had.
    scene, coarse_scene = (load_scene(source.scene, {"precision": "float32"} | changed) for changed in ({}, overrides))
    _check(scene, coarsen)
    groups, done, numbers = {}, 0, range(0, len(samples.times), every)
    for factor in coarsen:
        # The run's own mesh is seen as the run saw it: its forces belong to that.
        view = CoarseView(scene if factor == 1 else coarse_scene, factor)
        collected = []
        for number in numbers:
            collected.append(view.rows(samples.frame(number), float(samples.times[number])))
            done += 1
            if progress is not None:
                progress(done, len(coarsen) * len(numbers))
        groups[factor] = view.group(collected)
    write_dataset(out, described(source, overrides), groups)


def described(run: Run, overrides: dict[str, Any] | None = None) -> dict[str, Any]:
    """What a dataset tells of the run that it is made of: drag law, fluid, dimensions, name and scene.

    Args:
        run: with samples.
        overrides: keys in which the coarse runs differ from it.
    """
    scene = load_scene(run.scene, overrides)
    fluid = required(scene.fluid, "fluid")
    return {
        "drag": str(_samples(run).attributes["drag"]),
        "fluid_density": fluid.density,
        "dynamic_viscosity": fluid.density * fluid.viscosity,
        "dimension": scene.dimension,
        "run": Path(run.path).resolve().name,
        "scene_toml": scene.to_toml() if overrides else run.scene_toml,
    }


def _check(scene: Scene, coarsen: tuple[int, ...]) -> None:
    """Refuses what no dataset can be made of."""
    if required(scene.particles, "particles").has_clumps:
        limit = "closures are trained on spheres, and this run has clumps"
        raise InputError("particles.shape", None, limit, "give a run of spheres")
    if required(scene.coupling, "coupling").self_disturbance:
        limit = "its drag law received the slip without the wake of the particle, and samples do not contain this slip"
        raise InputError("coupling.self_disturbance", True, limit, "Run the scene without it for training data.")
    if not all(is_whole(factor) and factor >= 1 for factor in coarsen) or len(set(coarsen)) != len(coarsen):
        raise InputError("--coarsen", coarsen, "needs different factors of at least 1", "use, for example, 1,2,4,8")


class CoarseView:
    """A mesh of the run's box, and the fields as its solver would see them."""

    def __init__(self, scene: Scene, factor: int):
        simulation, parameters = build(scene)
        solver = required(simulation.fluid, "fluid").solver
        self.fine, self.of_model_b = solver.grid, not solver.shares_stress
        self.coarse = coarsened(self.fine, factor)
        self.simulation, _ = build(load_scene(scene.tables(), {"fluid.cells": list(self.coarse.cells)}))
        self.coupling = required(self.simulation.coupling, "coupling")
        self.parameters = parameters
        self.bodies, self.properties = parameters.mixture.bodies, parameters.mixture.properties
        self.grains = np.asarray(self.bodies.of_all_grains(jnp.ones(())))
        self._observed = jax.jit(self._observe)

    def rows(self, sample: dict[str, np.ndarray], time: float) -> dict[str, np.ndarray]:
        """One row per particle of everything in the dataset; of a parcel what each of its grains has."""
        inputs, applied, _ = self._on_coarse_mesh(sample, time)
        total = sample["drag_force"] + sample["pressure_gradient_force"] + sample["viscous_force"]
        count, law = len(sample["position"]), sample["drag_force"] / self.grains
        if self.of_model_b:
            law = np.asarray(drag_of_model_a(jnp.asarray(law), jnp.asarray(sample["solid_fraction"])))
        return {name: np.asarray(getattr(inputs, name)) for name in COLUMNS} | {
            "time": np.full(count, time),
            "diameter": np.broadcast_to(2.0 * np.asarray(self.bodies.grain_radius), count).copy(),
            "drag_force": law,
            "target_force": (total - np.asarray(applied)) / self.grains,
        }

    def fluid(self, sample: dict[str, np.ndarray], time: float) -> FluidState:
        """The sampled fluid as a state of a run on the coarse mesh."""
        return self._on_coarse_mesh(sample, time)[2]

    def group(self, collected: list[dict[str, np.ndarray]]) -> dict[str, Any]:
        """The samples of all times, one after the other, with the group's attributes."""
        return {name: np.concatenate([rows[name] for rows in collected]) for name in collected[0]} | {
            "filter_size": self.coarse.filter_size,
            "kernel_width": float(np.mean(self.coupling.deposition.half_width)),
        }

    def _on_coarse_mesh(self, sample: dict[str, np.ndarray], time: float) -> tuple[DragInputs, Array, FluidState]:
        """The sample's fields averaged, and what `_observe` makes of them."""
        dtype = self.parameters.gravity.dtype
        faces = face_average(self.fine, jnp.asarray(sample["void_fraction"].astype(float)))
        flux = tuple(np.asarray(g) * sample[f"face_velocity_{a}"].astype(float) for a, g in enumerate(faces))
        return self._observed(
            tuple(jnp.asarray(f) for f in remap_flux(self.fine, self.coarse, flux)),
            jnp.asarray(remap_cells(self.fine, self.coarse, sample["pressure"].astype(float))),
            jnp.asarray(sample["position"], dtype),
            jnp.asarray(sample["particle_velocity"], dtype),
            jnp.asarray(time, dtype),
            jnp.asarray(sample["mean_gradient"], dtype) if "mean_gradient" in sample else None,
        )

    def _observe(
        self,
        flux: tuple[Array, ...],
        pressure: Array,
        position: Array,
        velocity: Array,
        time: Array,
        mean_gradient: Array | None,
    ) -> tuple[DragInputs, Array, FluidState]:
        """Inputs of the drag law on the coarse mesh, the force that this mesh applies by itself, and its fluid."""
        bodies, fluid, solver, dtype = self.bodies, self.properties, self.coupling.interval.solver, position.dtype
        drag = self.coupling.drag
        seen = self.coupling.deposition, drag.deconvolution, drag.grain_volume
        view = CoarseInputs(self.coarse, solver.boundary, *seen, wide=True)
        particles = ParticleState(position, None, velocity, velocity[:, :0], (), (), velocity, None)
        averaged = tuple(f.astype(dtype) for f in flux), pressure.astype(dtype)
        inputs, state, weights = view.sample(*averaged, particles, bodies, fluid, mean_gradient)
        volume = as_column(bodies.volume)
        applied = -volume * inputs.pressure_gradient
        if solver.viscous:
            sides = Sides(solver.boundary, fluid.side_velocity, time)
            stress = stress_divergence(self.coarse, sides, state.face_velocity, fluid.viscosity, fluid.smagorinsky)
            applied = applied + volume * fluid.density * interpolate_faces(weights, stress)
        return inputs, applied, state


def _samples(run: Run) -> Samples:
    if run.summary.get("valid") is False:
        limit = f"is not a valid run ({run.summary.get('reason', '')})"
        raise InputError("RUN", str(run.path), limit, "Finish it, or run it again.")
    if run.samples is None or len(run.samples.times) == 0:
        remedy = "run the scene again with --set output.samples=0.05 (any multiple of the coupling interval)"
        raise InputError("RUN", str(run.path), "holds no samples", remedy)
    return run.samples

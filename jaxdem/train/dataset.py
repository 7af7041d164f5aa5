"""Training data from a run: what a coarse mesh would show the drag law, and the force it should give.

The fluid fields of each sample are averaged to the coarse mesh, the flux g u and the pressure by area and
volume; the void fraction is deposited from the particles as the coarse solver deposits it, with its kernel;
and all are seen by the particles through the coarse solver's own weights. The target is the fluid force of
the fine run less the pressure and viscous force that the coarse run applies itself:

    F_target = F_drag + (-V grad p + V div tau)_fine - (-V grad p + V div tau)_coarse

That is a drag of model A. A run of model B has all its fluid force in F_drag; its target is of model A too, and so is the
dataset's `drag_force`, g F_drag there, which both recipes learn; the exchange converts what is learned from it as it converts
the correlations.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.coupling.coarse_inputs import CoarseInputs
from jaxdem.coupling.interpolation import interpolate_faces
from jaxdem.coupling.model_b import drag_of_model_a
from jaxdem.errors import InputError
from jaxdem.fluid.boundary import Sides
from jaxdem.fluid.diffusion import stress_divergence
from jaxdem.fluid.grid import face_average
from jaxdem.fluid.momentum import FluidState
from jaxdem.fluid.remap import coarsened, remap_cells, remap_flux
from jaxdem.io import Run, load_run
from jaxdem.io.outputs import refuse_what_is_read
from jaxdem.io.samples import Samples
from jaxdem.particles.integrate import ParticleState
from jaxdem.scene import Scene, load_scene, named_files
from jaxdem.setup.builder import build
from jaxdem.simulation import Simulation
from jaxdem.train.dataset_file import SEEING, write_dataset

COLUMNS = (
    "particle_velocity",
    "fluid_velocity",
    "solid_fraction",
    "void_fraction_gradient",
    "pressure_gradient",
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
        InputError: `out` is a file of a run or is read, the run is not valid, has no samples, or has `coupling.self_disturbance`; a factor is not usable, or
            another key is to differ.
    """
    source = load_run(run)
    refuse_what_is_read("--out", Path(out), (run, *named_files(source.scene)))
    samples = _samples(source)
    for key, value in (overrides or {}).items():
        if not key.startswith(SEEING):
            raise InputError(
                key,
                value,
                f"the keys that can be set for a dataset are {' and '.join(SEEING)}",
                "leave this key out",
            )
    # Closures are trained in single precision, whatever the run had.
    single = {"precision": "float32"}
    scene, coarse_scene = (
        load_scene(source.scene, single),
        load_scene(source.scene, single | (overrides or {})),
    )
    assert scene.coupling is not None
    if scene.coupling.self_disturbance:
        limit = "its drag law received the slip without the wake of the particle, and samples do not contain this slip"
        raise InputError("coupling.self_disturbance", True, limit, "Run the scene without it for training data.")
    if any(factor < 1 for factor in coarsen) or len(set(coarsen)) != len(coarsen):
        raise InputError("--coarsen", coarsen, "needs different factors of at least 1", "use, for example, 1,2,4,8")
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
    assert scene.fluid is not None
    attributes = {
        "drag": str(samples.attributes["drag"]),
        "fluid_density": scene.fluid.density,
        "dynamic_viscosity": scene.fluid.density * scene.fluid.viscosity,
        "dimension": scene.dimension,
        "run": Path(run).resolve().name,
        "scene_toml": load_scene(source.scene, overrides).to_toml() if overrides else source.scene_toml,
    }
    write_dataset(out, attributes, groups)


class CoarseView:
    """A mesh of the run's box, and the fields as its solver would see them."""

    def __init__(self, scene: Scene, factor: int):
        simulation, parameters = build(scene)
        assert simulation.fluid is not None and parameters.bodies is not None
        self.fine = simulation.fluid.solver.grid
        self.coarse = coarsened(self.fine, factor)
        overrides = {"fluid.cells": list(self.coarse.cells)}
        coarse, _ = build(load_scene(scene.tables(), overrides))
        self.simulation: Simulation = coarse
        self.parameters = parameters
        self.of_model_b = not simulation.fluid.solver.shares_stress
        self._see = jax.jit(self._seen)

    def rows(self, sample: dict[str, np.ndarray], time: float) -> dict[str, np.ndarray]:
        """One row per particle of everything in the dataset."""
        seen = self._look(sample, time)[0]
        rows = {name: np.asarray(value) for name, value in seen.items() if name != "applied"}
        total = sample["drag_force"] + sample["pressure_gradient_force"] + sample["viscous_force"]
        count = len(sample["position"])
        assert self.parameters.bodies is not None
        law = sample["drag_force"]
        if self.of_model_b:
            law = np.asarray(drag_of_model_a(jnp.asarray(law), jnp.asarray(sample["solid_fraction"])))
        return rows | {
            "time": np.full(count, time),
            "diameter": np.broadcast_to(2.0 * np.asarray(self.parameters.bodies.radius), count).copy(),
            "drag_force": law,
            "target_force": total - np.asarray(seen["applied"]),
        }

    def fluid(self, sample: dict[str, np.ndarray], time: float) -> FluidState:
        """The sampled fluid as a state of a run on the coarse mesh."""
        return self._look(sample, time)[1]

    def _look(self, sample: dict[str, np.ndarray], time: float) -> tuple[dict[str, Array], FluidState]:
        """The sample's fields averaged, and looked at."""
        dtype = self.parameters.gravity.dtype
        void_fraction = sample["void_fraction"].astype(float)
        faces = face_average(self.fine, jnp.asarray(void_fraction))
        flux = tuple(np.asarray(g) * sample[f"face_velocity_{a}"].astype(float) for a, g in enumerate(faces))
        seen: tuple[dict[str, Array], FluidState] = self._see(
            tuple(jnp.asarray(f) for f in remap_flux(self.fine, self.coarse, flux)),
            jnp.asarray(remap_cells(self.fine, self.coarse, sample["pressure"].astype(float))),
            jnp.asarray(sample["position"], dtype),
            jnp.asarray(sample["particle_velocity"], dtype),
            jnp.asarray(time, dtype),
        )
        return seen

    def group(self, collected: list[dict[str, np.ndarray]]) -> dict[str, Any]:
        """The samples of all times, one after the other, with the group's attributes."""
        arrays = {name: np.concatenate([rows[name] for rows in collected]) for name in collected[0]}
        assert self.simulation.coupling is not None
        return arrays | {
            "filter_size": self.coarse.filter_size,
            "kernel_width": float(np.mean(self.simulation.coupling.deposition.half_width)),
        }

    def _seen(
        self, flux: tuple[Array, ...], pressure: Array, position: Array, velocity: Array, time: Array
    ) -> tuple[dict[str, Array], FluidState]:
        """Inputs of the drag law on the coarse mesh, the force that this mesh applies by itself, and its fluid."""
        coupling = self.simulation.coupling
        assert coupling is not None
        bodies, fluid = self.parameters.bodies, self.parameters.fluid
        assert bodies is not None and fluid is not None
        solver = coupling.interval.solver
        dtype = position.dtype
        view = CoarseInputs(self.coarse, solver.boundary, coupling.deposition, coupling.drag.deconvolution)
        particles = ParticleState(position, None, velocity, velocity[:, :0], (), (), velocity, None)
        averaged = tuple(f.astype(dtype) for f in flux), pressure.astype(dtype)
        inputs, state, weights = view.sample(*averaged, particles, bodies, fluid)
        volume = bodies.volume if bodies.volume.ndim == 0 else bodies.volume[:, None]
        applied = -volume * inputs.pressure_gradient
        if solver.viscous:
            stress = stress_divergence(
                self.coarse,
                Sides(solver.boundary, fluid.side_velocity, time),
                state.face_velocity,
                fluid.viscosity,
                fluid.smagorinsky,
            )
            applied = applied + volume * fluid.density * interpolate_faces(weights, stress)
        return {name: getattr(inputs, name) for name in COLUMNS} | {"applied": applied}, state


def _samples(run: Run) -> Samples:
    if run.summary.get("valid") is False:
        limit = f"is not a valid run ({run.summary.get('reason', '')})"
        raise InputError("RUN", str(run.path), limit, "Finish it, or run it again.")
    if run.samples is None or len(run.samples.times) == 0:
        raise InputError(
            "RUN",
            str(run.path),
            "holds no samples",
            "run the scene again with --set output.samples=0.05 (any multiple of the coupling interval)",
        )
    return run.samples

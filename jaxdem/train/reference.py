"""A reference run as a source of start states and targets for a coarser run of the same scene."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cached_property, partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures import PaperNetwork
from jaxdem.coupling.void_fraction import solid_fraction
from jaxdem.errors import InputError, required
from jaxdem.fluid.boundary import Sides, set_normal_velocity
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.grid import Grid, face_average_along
from jaxdem.fluid.momentum import FluidSolver
from jaxdem.fluid.remap import remap_cells, remap_flux
from jaxdem.io import Run
from jaxdem.numerics.axes import AXES
from jaxdem.particles.integrate import ParticleState
from jaxdem.particles.neighbors import Neighbors, Room
from jaxdem.scene import Scene
from jaxdem.scene.stages import StagedScene
from jaxdem.setup.builder import Case, build_case
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State
from jaxdem.train.closures import Closures
from jaxdem.train.observables import Grains, Observables, observe_fluid, observe_particles

OPTION = "--reference"


@dataclasses.dataclass(frozen=True, eq=False)
class CoarseCase:
    """The coarse simulation of a coupled scene and the reference that it is to follow.

    Attributes:
        simulation, parameters: of the coarse run; the parameters hold the closure.
        grains: masses and sizes of the particles.
        run: the reference.
        particles: those that the scene itself starts from.
        per_output: coupling intervals of the coarse run between two outputs of the reference.
    """

    simulation: Simulation
    parameters: Parameters
    grains: Grains
    run: Run
    particles: ParticleState
    per_output: int

    @property
    def dimension(self) -> int:
        """D."""
        return self.particles.position.shape[1]

    @property
    def solver(self) -> FluidSolver:
        """Of the coarse fluid."""
        return required(self.simulation.fluid, "fluid").solver

    @property
    def observes_fluid(self) -> bool:
        """Whether the fluid is compared: where there is a subgrid stress, of which particles alone say little."""
        fluid = self.parameters.fluid
        return fluid is not None and fluid.subgrid is not None

    def observe(self, particles: ParticleState, fluid: FluidState | None, drag_force: Array) -> Observables:
        """Observables at one time, of the fluid too if it is compared; `drag_force` (N, D) [N]."""
        own = (particles.position, particles.velocity, particles.angular_velocity)
        observed = observe_particles(self.grains, *own, drag_force)
        if fluid is None or not self.observes_fluid:
            return observed
        return observe_fluid(observed, self.solver.grid, self.solver.boundary, fluid)

    @cached_property
    def targets(self) -> Observables:
        """Observables of the reference at all its outputs, (T, ...)."""
        observe, rows = jax.jit(self.observe), []
        for index in range(self.run.number_of_frames):
            fluid = self.start(index).fluid if self.observes_fluid else None
            rows.append(observe(self._particles(index), fluid, self._vectors(index, "drag_force")))
        return jax.tree.map(lambda *values: jnp.stack(values), *rows)

    def start(self, index: int) -> State:
        """The state at output `index` of the reference, its fluid averaged to the coarse mesh.

        A frame has no contact springs (they start at zero) and cell velocities, of which the faces get the mean.
        """
        particles, flow = self._particles(index), required(self.run.fluid(index), "fluid")
        time = jnp.asarray(self.run.times[index], particles.position.dtype)
        step = jnp.asarray(index * self.per_output, jnp.int32)
        fluid = self._fluid(flow, particles.position, time)._replace(mean_gradient=self._mean_gradient(index))
        return State(particles, fluid, step)

    def _mean_gradient(self, index: int) -> Array | None:
        """Of the reduced pressure at output `index`, as the reference had it [Pa/m]; None where nothing drives the
        fluid."""
        drive, flow = self.solver.drive, self.parameters.flow
        if drive is None:
            return None
        names = [f"pressure_gradient_{axis}" for axis in AXES[self.dimension]]
        found = [self.run.history[name][index] if name in self.run.history else 0.0 for name in names]
        gradient = jnp.asarray(found, self.parameters.gravity.dtype) - flow.density * self.parameters.gravity
        return jnp.where(jnp.asarray(drive.driven), gradient, 0.0)

    def _particles(self, index: int) -> ParticleState:
        spin = self.run.particles(index)["angular_velocity"]
        low = self.particles.position_low
        return self.particles._replace(
            position=self._vectors(index, "position"),
            velocity=self._vectors(index, "velocity"),
            contact_force=self._vectors(index, "contact_force"),
            position_low=None if low is None else jnp.zeros_like(low),
            angular_velocity=jnp.asarray(spin if self.dimension == 3 else spin[:, 2:], self.particles.position.dtype),
        )

    def _vectors(self, index: int, name: str) -> Array:
        """(N, D) of a frame, which has three components in two dimensions too."""
        return jnp.asarray(self.run.particles(index)[name][:, : self.dimension], self.particles.position.dtype)

    def with_list(self, state: State, room: Room | None = None) -> tuple[State, Neighbors]:
        """A state with its neighbour list, and springs of the list's size at rest; not jittable."""
        particles, simulation = required(state.particles, "particles"), self.simulation
        neighbors = simulation.allocate(self.parameters, particles, room)
        kept = required(simulation.contact, "particles").model.history_size(self.dimension)
        springs = (jnp.zeros(neighbors.room.pairs, particles.position.dtype),) * kept
        return state._replace(particles=particles._replace(contact_spring=springs)), neighbors

    def _fluid(self, flow: dict[str, np.ndarray], position: Array, time: Array) -> FluidState:
        """The reference's fluid on the coarse mesh: flux by area, pressure by volume, void fraction deposited.

        Faces on the sides have what the coarse run's own conditions say: a frame's cells know nothing of them.
        """
        dtype, coarse = position.dtype, self.solver.grid
        fine = dataclasses.replace(coarse, cells=tuple(flow["pressure"].shape))
        of_cells = (flow["void_fraction"].astype(dtype), flow["velocity"].astype(dtype))
        flux = tuple(np.asarray(f, float) for f in _flux_of_cells(fine, *of_cells))
        void_fraction, gaps = self._deposited(position)
        faces = tuple(
            jnp.asarray(f / np.asarray(g, float), dtype)
            for f, g in zip(remap_flux(fine, coarse, flux), gaps, strict=True)
        )
        sides = Sides(self.solver.boundary, self.parameters.mixture.properties.side_velocity, time)
        faces = set_normal_velocity(coarse, sides, faces, gaps)
        pressure = remap_cells(fine, coarse, flow["pressure"].astype(float))
        return FluidState(faces, jnp.asarray(pressure, dtype), void_fraction)

    @cached_property
    def _deposited(self) -> Callable[[Array], tuple[Array, tuple[Array, ...]]]:
        """Void fraction of the cells and of the faces as a function of the positions, compiled."""
        grid, bodies = self.solver.grid, self.parameters.mixture.bodies
        deposition = required(self.simulation.coupling, "coupling").deposition

        @jax.jit
        def deposited(position: Array) -> tuple[Array, tuple[Array, ...]]:
            weights = deposition.weights(grid, position, bodies.radius)
            void_fraction = 1.0 - solid_fraction(grid, weights, bodies.volume)
            return void_fraction, tuple(face_average_along(grid, void_fraction, axis) for axis in range(grid.dimension))

        return deposited


def follow(scene: Scene, run: Run, closures: Closures) -> CoarseCase:
    """The coarse run of `scene` with closures in it, to follow a reference run.

    Raises:
        InputError: the scene cannot be differentiated or compared: other particles, box or times than the
            reference's, a finer mesh than its, particles that come and go, or forces with a memory.
    """
    _check_scene(scene, closures)
    _check_reference(scene, run)
    case = build_case(scene, closures.drag, subgrid=closures.subgrid)
    simulation, parameters = case.simulation, case.parameters
    _check_grains(case, run)
    per_output = _intervals_per_output(simulation.interval, run)
    if simulation.population is not None:
        limit = "training is not possible where particles enter or leave"
        raise InputError("particles", "inlets or exits", limit, "Take them out of the scene.")
    bodies = parameters.mixture.bodies
    grains = Grains(bodies.mass, bodies.inertia, bodies.volume, scene.domain.size[0])
    particles = required(case.first_state()[0].particles, "particles")
    return CoarseCase(simulation, parameters, grains, run, particles, per_output)


@partial(jax.jit, static_argnums=0)
def _flux_of_cells(grid: Grid, void_fraction: Array, velocity: Array) -> tuple[Array, ...]:
    """Flux g u on the faces from values of the cells (cells..., and three components)."""
    return tuple(
        face_average_along(grid, void_fraction, axis) * face_average_along(grid, velocity[..., axis], axis)
        for axis in range(grid.dimension)
    )


def _check_scene(scene: Scene, closures: Closures) -> None:
    coupling = scene.coupling
    if scene.particles is None or scene.fluid is None or coupling is None:
        raise InputError("SCENE", "", "needs both [particles] and [fluid]", "Give the coarse scene of a coupled run.")
    if isinstance(scene, StagedScene):
        limit = "a training follows one run, and this scene has several"
        raise InputError("stages", [stage.name for stage in scene.stages], limit, "Give a scene file of one stage.")
    if scene.surface is not None:
        raise InputError("surface", "...", "a training does not follow two fluids", "Remove [surface].")
    if scene.heat is not None or scene.scalars:
        key = "heat" if scene.heat is not None else "scalars"
        raise InputError(key, "...", "a training does not follow temperatures and scalars", f"Remove [{key}].")
    if coupling.virtual_mass or coupling.basset:
        raise InputError(
            "coupling.basset" if coupling.basset else "coupling.virtual_mass",
            coupling.basset or coupling.virtual_mass,
            "what it remembers is not in the reference's frames",
            "Set it to 0 for the training.",
        )
    if closures.subgrid is not None and scene.fluid.smagorinsky > 0.0:
        limit = "models the same unresolved eddies as the learned subgrid stress"
        raise InputError("fluid.smagorinsky", scene.fluid.smagorinsky, limit, "Set it to 0.")
    if isinstance(closures.drag, PaperNetwork) and closures.drag.dimension != scene.dimension:
        limit = f"was trained in {closures.drag.dimension}-D, the scene is {scene.dimension}-D"
        raise InputError("--closure", "", limit, "Train one of the scene's dimension.")


def _check_reference(scene: Scene, run: Run) -> None:
    path = str(run.path)
    if not run.has_particles or not run.has_fluid or run.number_of_frames < 2:
        limit = "needs at least two frames of particles and fluid"
        raise InputError(OPTION, path, limit, "Give the run directory of a finer run.")
    if run.summary.get("valid") is False:
        reason = run.summary.get("reason", "")
        raise InputError(OPTION, path, f"is not a valid run ({reason})", "Finish it, or run it again.")
    size = tuple(run.scene.get("domain", {}).get("size", ()))
    if run.dimension != scene.dimension or not np.allclose(size, scene.domain.size, rtol=1e-9):
        limit = f"the scene's box is {scene.domain.size} m, the reference's {size} m"
        raise InputError("domain.size", scene.domain.size, limit, "Take the reference's scene with fewer cells.")
    cells, limits = required(scene.fluid, "fluid").cells, required(run.cells, "fluid")
    if any(coarse > fine for coarse, fine in zip(cells, limits, strict=True)):
        limit = f"is finer than the {limits} of the reference"
        raise InputError("fluid.cells", cells, limit, "Give as many cells as it has, or fewer.")


def _check_grains(case: Case, run: Run) -> None:
    frame = run.particles(0)
    own, count = 0 if case.particles is None else case.particles.count, len(frame["position"])
    remedy = "Take the reference's scene with fewer cells."
    if own != count:
        limit = f"the scene has {own} particles, the reference {count}"
        raise InputError("particles.count", own, limit, remedy)
    radius = np.broadcast_to(case.bodies.radius, count)
    if not np.allclose(radius, frame["radius"], rtol=1e-5):
        limit = "the grains of the reference have other radii"
        raise InputError("particles.radius", radius[:1].tolist(), limit, remedy)


def _intervals_per_output(interval: float, run: Run) -> int:
    times = np.asarray(run.times, float)
    spacing = float(times[1] - times[0])
    ratio = spacing / interval
    per_output = max(1, round(ratio))
    if abs(ratio - per_output) > 1e-4 * per_output or not np.allclose(np.diff(times), spacing, rtol=1e-4):
        raise InputError(
            "time.output_interval",
            f"{spacing:.6g} s in the reference",
            f"must be a multiple of the coarse run's coupling interval, {interval:.6g} s, and "
            "the outputs must be equally spaced",
            "Set coupling.interval, or run the reference with another time.output_interval.",
        )
    return per_output

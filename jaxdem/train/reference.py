"""A reference run as a source of start states and targets for a coarser run of the same scene."""

from __future__ import annotations

import dataclasses
from functools import cached_property, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures import PaperNetwork
from jaxdem.coupling.void_fraction import solid_fraction
from jaxdem.errors import InputError
from jaxdem.fluid.boundary import Sides, set_normal_velocity
from jaxdem.fluid.grid import Grid, face_average_along
from jaxdem.fluid.momentum import FluidState
from jaxdem.fluid.remap import remap_cells, remap_flux
from jaxdem.io import Run
from jaxdem.particles.neighbors import Neighbors, Room
from jaxdem.scene import Scene
from jaxdem.setup.builder import Case, build_case
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State
from jaxdem.train.closures import Closures
from jaxdem.train.observables import Grains, Observables, observe_fluid, observe_particles

OPTION = "--reference"


@dataclasses.dataclass(frozen=True)
class Course:
    """The coarse simulation and the reference that it is to follow.

    Attributes:
        scene: of the coarse run.
        simulation, parameters: built from it; the parameters hold the closure.
        run: the reference.
        template: the state that the scene itself starts from.
        per_output: coupling intervals of the coarse run between two outputs of the reference.
        targets: observables of the reference at all its outputs, (T, ...).
    """

    scene: Scene
    simulation: Simulation
    parameters: Parameters
    run: Run
    template: State
    per_output: int
    targets: Observables

    @property
    def observes_fluid(self) -> bool:
        """Whether the fluid is compared: where there is a subgrid stress, of which particles alone say little."""
        return self.parameters.fluid is not None and self.parameters.fluid.subgrid is not None

    @property
    def grains(self) -> Grains:
        """Masses and sizes of the particles."""
        bodies = self.parameters.bodies
        assert bodies is not None
        return Grains(bodies.mass, bodies.inertia, bodies.volume, self.scene.domain.size[0])

    def start(self, index: int) -> State:
        """The state at output `index` of the reference, its fluid averaged to the coarse mesh.

        A frame has no contact springs (they start at zero) and cell velocities, of which the faces get the mean.
        """
        frame, flow = self.run.particles(index), self.run.fluid(index)
        assert flow is not None
        own = self.template.particles
        assert own is not None
        dtype, dimension = self.parameters.gravity.dtype, self.scene.dimension

        def rows(name: str) -> Array:
            return jnp.asarray(frame[name][:, :dimension], dtype)

        spin = frame["angular_velocity"] if dimension == 3 else frame["angular_velocity"][:, 2:]
        low = own.position_low
        particles = own._replace(
            position=rows("position"),
            position_low=None if low is None else jnp.zeros_like(low),
            velocity=rows("velocity"),
            angular_velocity=jnp.asarray(spin, dtype),
            contact_force=rows("contact_force"),
        )
        step = jnp.asarray(index * self.per_output, jnp.int32)
        time = jnp.asarray(self.run.times[index], dtype)
        return State(particles, self._fluid(flow, particles.position, time), step)

    def with_list(self, state: State, room: Room | None = None) -> tuple[State, Neighbors]:
        """A state with its neighbour list, and springs of the list's size at rest; not jittable."""
        particles, simulation = state.particles, self.simulation
        assert particles is not None and simulation.contact is not None
        neighbors = simulation.allocate(self.parameters, particles, room)
        kept = simulation.contact.model.history_size(self.scene.dimension)
        springs = (jnp.zeros(neighbors.room.pairs, particles.position.dtype),) * kept
        return state._replace(particles=particles._replace(contact_spring=springs)), neighbors

    def _fluid(self, flow: dict[str, np.ndarray], position: Array, time: Array) -> FluidState:
        """The reference's fluid on the coarse mesh: flux by area, pressure by volume, void fraction deposited.

        Faces on the sides have what the coarse run's own conditions say: a frame's cells know nothing of them.
        """
        assert self.simulation.fluid is not None and self.parameters.fluid is not None
        solver, dtype = self.simulation.fluid.solver, position.dtype
        coarse, side_velocity = solver.grid, self.parameters.fluid.side_velocity
        fine = dataclasses.replace(coarse, cells=tuple(flow["pressure"].shape))
        given = (flow["void_fraction"].astype(dtype), flow["velocity"].astype(dtype))
        flux = tuple(np.asarray(f, float) for f in _flux_of_cells(fine, *given))
        void_fraction, gaps = self._deposited(position)
        faces = tuple(
            jnp.asarray(f / np.asarray(g, float), dtype)
            for f, g in zip(remap_flux(fine, coarse, flux), gaps, strict=True)
        )
        faces = set_normal_velocity(coarse, Sides(solver.boundary, side_velocity, time), faces, gaps)
        pressure = remap_cells(fine, coarse, flow["pressure"].astype(float))
        return FluidState(faces, jnp.asarray(pressure, dtype), void_fraction)

    @cached_property
    def _deposited(self) -> Any:
        """Void fraction of the cells and of the faces as a function of the positions, compiled."""
        assert self.simulation.coupling is not None
        assert self.parameters.bodies is not None
        coupling = self.simulation.coupling
        grid, deposition = coupling.interval.solver.grid, coupling.deposition
        bodies = self.parameters.bodies

        @jax.jit
        def deposited(position: Array) -> tuple[Array, tuple[Array, ...]]:
            weights = deposition.weights(grid, position, bodies.radius)
            void_fraction = 1.0 - solid_fraction(grid, weights, bodies.volume)
            faces = (face_average_along(grid, void_fraction, axis) for axis in range(grid.dimension))
            return void_fraction, tuple(faces)

        return deposited


def follow(scene: Scene, run: Run, closures: Closures) -> Course:
    """The coarse run of `scene` with closures in it, to follow a reference run.

    With a subgrid stress among them the fluid is compared too.

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
    template, _ = case.initial_state()
    course = Course(scene, simulation, parameters, run, template, per_output, targets=None)  # type: ignore[arg-type]
    return dataclasses.replace(course, targets=_targets(course))


def _targets(course: Course) -> Observables:
    dimension, dtype = course.scene.dimension, course.parameters.gravity.dtype

    @jax.jit
    def observed(*arrays: Array) -> Observables:
        return observe_particles(course.grains, *arrays)

    fluid = course.simulation.fluid
    assert fluid is not None
    solver = fluid.solver
    fluid_observed = jax.jit(lambda seen, flow: observe_fluid(seen, solver.grid, solver.boundary, flow))
    rows = []
    for index in range(course.run.number_of_frames):
        frame = course.run.particles(index)
        flat = [frame[name][:, :dimension] for name in ("position", "velocity")]
        arrays = (*flat, frame["angular_velocity"], frame["drag_force"][:, :dimension])
        seen = observed(*(jnp.asarray(array, dtype) for array in arrays))
        if course.observes_fluid:
            seen = fluid_observed(seen, course.start(index).fluid)
        rows.append(seen)
    return jax.tree.map(lambda *values: jnp.stack(values), *rows)


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
    assert scene.fluid is not None and run.cells is not None
    if any(coarse > fine for coarse, fine in zip(scene.fluid.cells, run.cells, strict=True)):
        limit = f"is finer than the {run.cells} of the reference"
        raise InputError("fluid.cells", scene.fluid.cells, limit, "Give as many cells as it has, or fewer.")


def _check_grains(case: Case, run: Run) -> None:
    frame = run.particles(0)
    own, count = 0 if case.particles is None else case.particles.count, len(frame["position"])
    remedy = "Take the reference's scene with fewer cells."
    if own != count:
        limit = f"the scene has {own} particles, the reference {count}"
        raise InputError("particles.count", own, limit, remedy)
    radius = np.broadcast_to(case.bodies.radius, count)
    if not np.allclose(radius, frame["radius"], rtol=1e-5):
        raise InputError(
            "particles.radius", radius[:1].tolist(), "the grains of the reference have other radii", remedy
        )


def _intervals_per_output(interval: float, run: Run) -> int:
    times: Any = np.asarray(run.times, float)
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

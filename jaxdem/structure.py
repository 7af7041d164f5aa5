"""The static structure of a scene: which parts there are and how they work together."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
from jax import Array
from jax.typing import DTypeLike

from jaxdem.coupling.coupled import Coupling
from jaxdem.coupling.pistons_in_fluid import FluidOnWalls, numbers_of_interval, under_load
from jaxdem.coupling.walls_in_fluid import WallsInFluid
from jaxdem.errors import required
from jaxdem.fluid.boundary import Boundary, velocity_at
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.interval import FluidDiagnostics, FluidInterval
from jaxdem.numerics import pair_arithmetic as pairs
from jaxdem.numerics.blocks import Blocks
from jaxdem.numerics.compensated import Pair
from jaxdem.numerics.placement import Placement
from jaxdem.numerics.static import static
from jaxdem.numerics.tables import mean_over
from jaxdem.particles.contact_interval import ContactInterval
from jaxdem.particles.integrate import ParticleState
from jaxdem.particles.moving_walls import Numbers, PistonState, WallMotions, placements
from jaxdem.particles.neighbor_search import NeighborSearch
from jaxdem.particles.population import Population
from jaxdem.scalars.scalars import Scalars
from jaxdem.state import Parameters, State


@static
class Clock:
    """Where the time of a run begins whose coupling interval differs from that of the run before it; static.

    Attributes:
        start: simulated time at which it begins [s].
        step: coupling intervals that were done by then.
    """

    start: float
    step: int


@static
class TimeSteps:
    """The steps of a run and what they were chosen from; None where a part does not exist.

    Attributes:
        interval: coupling interval, the step of the time loop [s].
        intervals_per_output: number of intervals between frames.
        outputs: number of frames after the first.
        contact: contact step [s].
        contacts_per_interval: number of contact steps in an interval.
        fluid_substeps: smallest number of fluid steps in an interval.
        limits: named limits [s], for the check and the summary.
        expected_speed: that the contact limits stand on [m/s].
        expected_overlap: at that speed, over the diameter [-].
        speed_limit: at which an impact reaches `contact.maximum_overlap`; faster particles stop a run [m/s].
    """

    interval: float
    intervals_per_output: int
    outputs: int
    contact: float | None
    contacts_per_interval: int
    fluid_substeps: int
    limits: Mapping[str, float] = dataclasses.field(compare=False)
    expected_speed: float | None
    expected_overlap: float | None
    speed_limit: float | None


@static
class Structure:
    """What is compiled of a scene. Numbers one may differentiate by are `Parameters`.

    Attributes:
        interval: coupling interval [s].
        steps: time steps and limits.
        box: side lengths [m].
        periodic: whether each axis is periodic.
        boundary: the sides of the box.
        contact: contact model and steps, None without particles.
        fluid: solver and its steps, None without a fluid.
        coupling: how fluid and particles act on each other, None unless both exist.
        population: how the number of particles changes, None where it does not.
        gravity_times: T increasing times of `Parameters.gravity` (T, D) [s]; None for one that does not change.
        drag_times: the same of `Parameters.drag_scale` (T,) [s].
        clock: where its time begins; None where the time is the number of intervals done times the interval.
        scalars: temperatures and other scalars; None compiles none.
        walls_in_fluid: moving walls that the fluid sees; None where there are none.
    """

    interval: float
    steps: TimeSteps
    box: tuple[float, ...]
    periodic: tuple[bool, ...]
    boundary: Boundary
    contact: ContactInterval | None
    fluid: FluidInterval | None
    coupling: Coupling | None
    population: Population | None = None
    gravity_times: tuple[float, ...] | None = None
    drag_times: tuple[float, ...] | None = None
    clock: Clock | None = None
    scalars: Scalars | None = None
    walls_in_fluid: WallsInFluid | None = None

    def during(self, parameters: Parameters, step: Array) -> Parameters:
        """The parameters of the interval that begins after `step` intervals, with the means over it of gravity and of
        the factor on the drag where these change with time; parameters of an interval stay as they are."""
        if self.gravity_times is None and self.drag_times is None:
            return parameters
        begin, duration = self.time_after(parameters, step), jnp.asarray(self.interval, parameters.gravity.dtype)
        if self.gravity_times is not None and parameters.gravity.ndim == 2:
            gravity = mean_over(self.gravity_times, parameters.gravity, begin, duration)
            parameters = parameters._replace(gravity=gravity)
        if self.drag_times is not None and parameters.drag_scale is not None and parameters.drag_scale.ndim == 1:
            scale = mean_over(self.drag_times, parameters.drag_scale[:, None], begin, duration)[0]
            parameters = parameters._replace(drag_scale=scale)
        return parameters

    def with_moved_walls(
        self, parameters: Parameters, fluid: FluidState, step: Array, pistons: PistonState | None = None
    ) -> tuple[Parameters, FluidState]:
        """Parameters and fluid with the walls that the fluid sees where they are in the interval that begins after
        `step` intervals, with these pistons; the same where none moves."""
        if self.walls_in_fluid is None:
            return parameters, fluid
        start, duration = self._start_pair(parameters, step), jnp.asarray(self.interval, parameters.gravity.dtype)
        properties = required(parameters.fluid, "parameters.fluid")
        numbers = self._motion_of_walls_in_fluid(parameters, pistons, start)
        middles = self.middle(parameters, step - 1), self.middle(parameters, step)
        properties, fluid = self.walls_in_fluid.over(properties, fluid, numbers, (start, duration), middles)
        return parameters._replace(fluid=properties), fluid

    def open_parts(self, parameters: Parameters, state: State) -> CutCells | None:
        """What the walls that the fluid sees leave open of its mesh at a state; None without such walls."""
        properties, walls = required(parameters.fluid, "parameters.fluid"), self.walls_in_fluid
        if walls is None or not walls.change_place:
            return properties.cut
        still, start = (
            required(properties.still, "still surfaces of the fluid"),
            self._start_pair(parameters, state.step),
        )
        pistons = None if state.particles is None else state.particles.pistons
        numbers = self._motion_of_walls_in_fluid(parameters, pistons, start)
        return walls.cut(still, walls.places(still, numbers, start, self.middle(parameters, state.step - 1)))

    def _motion_of_walls_in_fluid(
        self, parameters: Parameters, pistons: PistonState | None, start: Pair
    ) -> Sequence[Numbers]:
        """Of every wall, in an interval that begins at `start` with these pistons."""
        held = required(self.walls_in_fluid, "walls in the fluid").pistons
        if not held:
            return parameters.wall_motion
        state = required(pistons, "pistons of the particles")
        return numbers_of_interval(held, parameters.wall_motion, state, start)

    def with_loaded_pistons(
        self, parameters: Parameters, state: State, report: FluidDiagnostics | None
    ) -> tuple[Parameters, State]:
        """Parameters and state with what the fluid does to the pistons that it sees in the interval that begins with
        the state; the same without."""
        if self.walls_in_fluid is None or not self.walls_in_fluid.pistons:
            return parameters, state
        particles, told = required(state.particles, "particles"), required(report, "report of the fluid")
        load = required(told.surface_load, "loads on the surfaces")[..., 0]
        density = required(parameters.fluid, "parameters.fluid").density
        fluid = FluidOnWalls(load, required(told.response, "response of the surfaces"), density)
        gravity = self.during(parameters, state.step).gravity
        numbers, pistons = under_load(
            self.walls_in_fluid.pistons, parameters.pistons, required(particles.pistons, "pistons"), fluid, gravity,
            jnp.asarray(self.interval, gravity.dtype),
        )  # fmt: skip
        state = state._replace(particles=particles._replace(pistons=pistons))
        return parameters._replace(pistons=numbers), state

    def time(self, parameters: Parameters, state: State) -> Array:
        """() simulated time of a state [s]."""
        return self.time_after(parameters, state.step)

    def middle(self, parameters: Parameters, step: Array) -> Array:
        """() time in the middle of the interval that begins after `step` intervals [s]."""
        return self.time_after(parameters, step) + 0.5 * jnp.asarray(self.interval, parameters.gravity.dtype)

    def wall_motions(self, parameters: Parameters, step: Array) -> WallMotions | None:
        """What the walls that move need in the interval that begins after `step` intervals; None where none does."""
        if self.contact is None or not self.contact.model.motions:
            return None
        start, low = self._start_pair(parameters, step)
        return WallMotions(parameters.wall_motion, parameters.pistons, start, low, parameters.gravity)

    def placed(self, parameters: Parameters, particles: ParticleState, step: Array) -> tuple[Placement | None, ...]:
        """Where each surface is after `step` intervals, None for one at rest; empty where all are."""
        motions = self.wall_motions(parameters, step)
        if motions is None or self.contact is None:
            return ()
        return placements(self.contact.model.motions, motions, jnp.zeros_like(motions.start), particles.pistons)

    def meshes_placed(
        self, parameters: Parameters, particles: ParticleState, step: Array
    ) -> tuple[Placement | None, ...]:
        """The same of the meshes alone."""
        placed = self.placed(parameters, particles, step)
        return placed[len(placed) - len(parameters.meshes) :]

    def _start_pair(self, parameters: Parameters, step: Array) -> Pair:
        """`time_after` as a pair, exact for whole numbers of steps up to 2^31."""
        dtype = parameters.gravity.dtype
        done = step if self.clock is None else step - self.clock.step
        interval = pairs.as_pair(jnp.asarray(self.interval, dtype))
        thousands, rest = jnp.divmod(done, 4096)
        parts = (4096.0 * thousands.astype(dtype), rest.astype(dtype))
        first, second = (pairs.product(pairs.as_pair(part), interval) for part in parts)
        time = pairs.total(first, second)
        return time if self.clock is None else pairs.total(time, pairs.pair_of(self.clock.start, dtype))

    def time_after(self, parameters: Parameters, step: Array) -> Array:
        """() simulated time after `step` intervals [s]."""
        if self.clock is not None:
            dtype = parameters.gravity.dtype
            return self.clock.start + (step - self.clock.step) * jnp.asarray(self.interval, dtype)
        return step * jnp.asarray(self.interval, parameters.gravity.dtype)

    def contact_time_step(self, dtype: DTypeLike) -> Array:
        """() contact step [s]."""
        return jnp.asarray(self.steps.contact, dtype)

    def wall_velocity(self, parameters: Parameters, time: Array) -> tuple[Array, ...]:
        """(D,) velocity of every wall at a time [m/s]; moving sides of the box drag grains along too."""
        gravity = parameters.gravity  # of a scene in which it changes with time one for each of the times
        still = jnp.zeros_like(gravity, shape=gravity.shape[-1:])
        if self.contact is None:
            return ()
        model = self.contact.model
        given = parameters.side_velocity if parameters.fluid is None else parameters.fluid.side_velocity
        velocities = []
        for wall in model.sides:
            number = 2 * wall.axis + (wall.inward < 0)
            side = self.boundary.sides[number]
            velocities.append(velocity_at(side, given[number], time) if side.kind == "moving_wall" else still)
        return (*velocities, *(still,) * (len(model.surfaces) + len(model.meshes)))

    def surfaces_present(self, parameters: Parameters, step: Array) -> Array | None:
        """(W,) bool, the surfaces and meshes beside the sides of the box that are there in the interval after `step`
        others; None where all always are."""
        times = required(self.contact, "particles").model.wall_times
        return None if times is None else times.present(self.middle(parameters, step))

    @property
    def cut(self) -> Blocks | None:
        """The slabs that the box is cut into; None on one device."""
        if self.fluid is not None:
            return self.fluid.solver.grid.blocks
        division = None if self.contact is None else self.contact.division
        return None if division is None else division.blocks

    @property
    def half_width(self) -> tuple[float, ...] | None:
        """How far a particle reaches in the deposition, along every axis; None without an exchange [m]."""
        return None if self.coupling is None else self.coupling.deposition.half_width

    @property
    def search(self) -> NeighborSearch:
        """Builder of the neighbour list of a scene with particles."""
        return required(required(self.contact, "particles").search, "search")

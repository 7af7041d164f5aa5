"""Fluid and particles over one coupling interval: the front door of this package."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.closures.base import DragClosure, DragInputs
from jaxdem.coupling.deposition import Deposition
from jaxdem.coupling.drag import DragModel, IntervalDrag, interval_drag
from jaxdem.coupling.exchange import Exchange
from jaxdem.coupling.exchange_result import ExchangeDiagnostics, FluidForces
from jaxdem.coupling.forces.protocol import Contribution, FluidForce, IntervalEnd, IntervalStart
from jaxdem.coupling.further_impulses import plus, total
from jaxdem.coupling.inputs import MeshFields, drag_inputs
from jaxdem.coupling.interpolation import Weights
from jaxdem.coupling.member_weights import body_weights
from jaxdem.coupling.open_cells import seen_slope, weights_beside
from jaxdem.coupling.presence import present_weights
from jaxdem.coupling.surroundings import MEMORY
from jaxdem.coupling.void_fraction import solid_fraction
from jaxdem.errors import required
from jaxdem.fluid.fluid_state import FluidProperties, FluidState
from jaxdem.fluid.interval import FluidDiagnostics, FluidInterval, diagnostics
from jaxdem.numerics.blocks import Blocks
from jaxdem.numerics.static import static
from jaxdem.particles.integrate import ParticleProperties, ParticleState, as_column, centres_in_box


class Mixture(NamedTuple):
    """Numbers of fluid and particles, and the drag law; traced.

    Attributes:
        closure: the drag law.
        drag_scale: () factor on the drag, 1 for the law as it is [-].
        properties: of the fluid.
        bodies: of the particles.
        gravity: (D,) [m/s2].
    """

    closure: DragClosure
    drag_scale: Array
    properties: FluidProperties
    bodies: ParticleProperties
    gravity: Array

    @property
    def submerged_mass(self) -> Array:
        """Mass less that of the fluid displaced [kg]: gravity on it is weight less hydrostatic buoyancy."""
        return self.bodies.mass - self.properties.density * self.bodies.volume

    @property
    def buoyancy(self) -> Array:
        """(1, D) or (N, D) of the fluid's hydrostatic pressure [N]."""
        return -self.properties.density * as_column(self.bodies.volume) * self.gravity[None]


class SampledFluid(NamedTuple):
    """The fluid at the particles, at the start of an interval.

    Attributes:
        weights: of the particles on the cells.
        solids: solid fraction of the cells, of the particles where they are [-].
        inputs: of a drag law, on the fluid's own mesh.
        law_inputs: as the law sees them; the same where it sees that mesh as it is.
    """

    weights: Weights
    solids: Array
    inputs: DragInputs
    law_inputs: DragInputs


@static
class Coupling:
    """How fluid and particles act on each other; static.

    Attributes:
        interval: the fluid's steps.
        deposition: of the particles on the cells.
        drag: how the drag law is applied.
        forces: the further forces.
    """

    interval: FluidInterval
    deposition: Deposition
    drag: DragModel
    forces: tuple[FluidForce, ...] = ()

    def in_blocks(self, blocks: Blocks, drift: float) -> Coupling:
        """The exchange in one slab of the box; `drift` is how far its particles may stand outside of it [m]."""
        interval = self.interval.in_blocks(blocks, drift)
        return dataclasses.replace(self, interval=interval, drag=self.drag.in_blocks(blocks, drift))

    def advance(
        self, mixture: Mixture, fluid: FluidState, particles: ParticleState, time: Array
    ) -> tuple[FluidState, FluidForces, FluidDiagnostics, ExchangeDiagnostics]:
        """Fluid advanced by one interval among particles, and the mean forces on these.

        The new state's pressure is the mean over the interval, as the forces are; velocity and void fraction are those
        at its end.

        Args:
            mixture: numbers of both, and the drag law.
            fluid: state at `time`.
            particles: state at `time`.
            time: () [s].
        """
        exchange = self.begin(mixture, fluid, particles, time)
        fluid = fluid._replace(void_fraction=exchange.old_void_fraction)
        carry, record = self.interval.loop(
            exchange.substeps.number,
            lambda carry, k: exchange.fluid_step(carry, k, time),
            exchange.first(fluid),
        )
        # The first fluid step takes the whole push of particles that stand elsewhere than in the last interval: the
        # pressure that acts is the mean. The last void fraction is the deposited one itself, without the rounding of
        # its steps.
        fluid = carry.fluid._replace(
            pressure=carry.pressure / exchange.substeps.number, void_fraction=exchange.void_fraction
        )
        report = diagnostics(
            self.interval.solver.grid, exchange.substeps, record, fluid, carry.of_fluid, mixture.properties
        )
        return fluid, exchange.forces(carry), report, exchange.diagnostics(carry)

    def begin(self, mixture: Mixture, fluid: FluidState, particles: ParticleState, time: Array) -> Exchange:
        """The exchange of the interval that begins at `time`."""
        bodies = mixture.bodies
        sampled = self.sample(mixture, fluid, particles)
        start = self.start(mixture, fluid, particles, sampled)
        memory = particles.fluid_memory or {}
        contributions = {force.name: force.begin(start, memory.get(force.name)) for force in self.forces}
        drag = self.drag_over(mixture, start, sampled, contributions)
        substeps = self.interval.choose(mixture.properties, fluid, time)
        slip_mass = total(c.slip_mass for c in contributions.values())
        coefficient = plus(substeps.step * drag.coefficient, slip_mass)
        attenuation = 1.0 / (1.0 + coefficient / bodies.mass)
        reported = sampled.inputs if self.drag.coarse_inputs is not None else sampled.law_inputs
        old_void_fraction = required(fluid.void_fraction, "void_fraction of the fluid")
        renewed = None if mixture.properties.cut is None else mixture.properties.cut.renewed
        if renewed is not None:  # what grains hold of the cells that are open now; see `walls_in_fluid`
            old_void_fraction = jnp.where(renewed, 1.0 - sampled.solids, old_void_fraction)
        return Exchange(
            self.interval, self.forces, start, old_void_fraction, sampled.solids, reported, drag, contributions,
            steady_force(mixture, particles), substeps, slip_mass, attenuation, coefficient * attenuation,
        )  # fmt: skip

    def weights(self, mixture: Mixture, particles: ParticleState) -> Weights:
        """Weights of the particles on the cells."""
        grid = self.interval.solver.grid
        centres = centres_in_box(particles, grid.size, grid.periodic)
        weights = body_weights(self.deposition, grid, particles, centres, mixture.bodies)
        beside = weights_beside(self.deposition, grid, weights, mixture.properties.cut)
        return present_weights(beside, particles.active)

    def sample(self, mixture: Mixture, fluid: FluidState, particles: ParticleState) -> SampledFluid:
        """The fluid at the particles, on its own mesh and as the drag law sees it."""
        solver, bodies, properties = self.interval.solver, mixture.bodies, mixture.properties
        grid, cut = solver.grid, properties.cut
        weights = self.weights(mixture, particles)
        solids = solid_fraction(grid, weights, bodies.volume, cut)
        slope = seen_slope(grid, solver.slope_at_particles(properties, fluid), cut)
        fields = MeshFields(fluid.face_velocity, slope, solids, fluid.liquid_fraction)
        inputs = drag_inputs(grid, weights, fields, particles.velocity, bodies, properties)
        sampled = SampledFluid(weights, solids, inputs, inputs)
        start = self.start(mixture, fluid, particles, sampled)
        return sampled._replace(law_inputs=self.drag.law_inputs(start, inputs, fluid, solids))

    def start(
        self, mixture: Mixture, fluid: FluidState, particles: ParticleState, sampled: SampledFluid
    ) -> IntervalStart:
        """What forces may look at."""
        duration = jnp.asarray(self.interval.duration, particles.velocity.dtype)
        return IntervalStart(
            self.interval.solver.grid, sampled.weights, fluid.face_velocity, sampled.inputs.slip_velocity, particles,
            mixture.bodies, mixture.properties, duration,
        )  # fmt: skip

    def drag_over(
        self, mixture: Mixture, start: IntervalStart, sampled: SampledFluid, contributions: dict[str, Contribution]
    ) -> IntervalDrag:
        """The drag over the interval, beside what the further forces give."""
        bodies = mixture.bodies
        others = plus(steady_force(mixture, start.particles), *(c.force for c in contributions.values()))
        impulses = (c.impulse for c in contributions.values() if c.impulse is not None)
        others = plus(others, *(impulse / start.duration for impulse in impulses))
        if self.interval.solver.shares_stress:
            others = others - as_column(bodies.volume) * sampled.inputs.pressure_gradient
        mass = plus(bodies.mass, total(c.slip_mass for c in contributions.values()))
        neighbors = self.drag.neighbors(mixture.closure, mixture.drag_scale, start, sampled.law_inputs)
        law = self.drag.law(mixture.closure, mixture.drag_scale, start, neighbors)
        drag = interval_drag(law, start, sampled.inputs, sampled.law_inputs, mass, others)
        return drag if neighbors is None else drag._replace(torque=neighbors.torque, memory=neighbors.memory)

    def remember(
        self, mixture: Mixture, forces: FluidForces, before: ParticleState, after: ParticleState
    ) -> ParticleState:
        """The particles at the end of an interval with the force that has acted and what forces keep for the next one.

        Args:
            mixture: numbers of both.
            forces: over the interval.
            before: particles at its start.
            after: at its end.
        """
        if not self.forces and forces.memory is None:
            return after
        duration = jnp.asarray(self.interval.duration, before.velocity.dtype)
        end = IntervalEnd(mixture.bodies, mixture.properties, after.velocity - before.velocity, duration)
        acted = required(after.fluid_force, "fluid_force of the particles")
        memory: dict[str, Any] = {} if forces.memory is None else {MEMORY: forces.memory}
        for force in self.forces:
            mean = forces.further[force.name]
            own, kept = force.end(mean, end)
            if mean.drive is not None:  # the others are in the total of the forces
                acted = plus(acted, own)
            if kept is not None:
                memory[force.name] = kept
        return after._replace(fluid_force=acted, fluid_memory=memory or None)

    @property
    def remembers(self) -> bool:
        """Whether something is kept from one interval to the next."""
        return bool(self.forces) or (self.drag.surroundings is not None and self.drag.surroundings.held > 1)

    def first_memory(self, slip: Array) -> dict[str, Any]:
        """What is kept at the start, of a slip (N, D) that has always been as it is [m/s]."""
        memory = {force.name: force.start(slip) for force in self.forces}
        if self.drag.surroundings is not None:
            memory[MEMORY] = self.drag.surroundings.first_memory(slip)
        return {name: value for name, value in memory.items() if value is not None}

    def with_moving_fluid(self, mixture: Mixture, forces: FluidForces, load: Array) -> tuple[ParticleProperties, Array]:
        """The bodies that the contact steps move, heavier by the fluid that moves with them, and the force on these.

        Args:
            mixture: numbers of both.
            forces: over the interval.
            load: (N, D) force on the particles alone [N].
        """
        return self.moved_bodies(mixture), plus(load, *(mean.drive for mean in forces.further.values()))

    def moved_bodies(self, mixture: Mixture) -> ParticleProperties:
        """The bodies with the fluid that moves with them."""
        added = total(force.added_density(mixture.properties) for force in self.forces)
        return mixture.bodies if added is None else mixture.bodies._replace(added_density=added)


def steady_force(mixture: Mixture, particles: ParticleState) -> Array:
    """(N, D) force that does not change over the interval: contacts, and weight less hydrostatic buoyancy [N]."""
    return particles.contact_force + as_column(mixture.submerged_mass) * mixture.gravity[None]

"""What evolves, what may be differentiated by, and what a step reports: arrays only."""

from __future__ import annotations

from typing import NamedTuple

from jax import Array

from jaxdem.closures.base import DragClosure
from jaxdem.coupling.coupled import Mixture
from jaxdem.coupling.exchange_result import ExchangeDiagnostics, FluidForces
from jaxdem.errors import required
from jaxdem.fluid.fluid_state import FluidProperties, FluidState
from jaxdem.fluid.interval import FluidDiagnostics
from jaxdem.numerics.compensated import Low
from jaxdem.particles.bond_geometry import BondParameters
from jaxdem.particles.contact_sums import WallLoads
from jaxdem.particles.energy import EnergyFlow
from jaxdem.particles.integrate import ParticleProperties, ParticleState
from jaxdem.particles.materials import ContactParameters, SeveralMaterials, needs_liquid, with_liquid
from jaxdem.particles.mesh_surface import MeshSurface
from jaxdem.particles.moving_walls import Numbers, PistonNumbers
from jaxdem.scalars.scalar_state import ScalarParameters, ScalarState


class State(NamedTuple):
    """The state of a simulation.

    Attributes:
        particles: None in a scene without particles.
        fluid: None in a scene without a fluid.
        step: () int32, coupling intervals done; the time is step times the interval.
        scalars: temperatures and other scalars; None in a scene without.
    """

    particles: ParticleState | None
    fluid: FluidState | None
    step: Array
    scalars: ScalarState | None = None


class Parameters(NamedTuple):
    """Everything one may differentiate by; a part that the scene has not is None.

    A number of the scene stands here once; what the scene does not give follows another number.

    Attributes:
        gravity: (D,), or (T, D) at the times of `Structure.gravity_times` [m/s2].
        bodies: radius and density of the particles.
        contact: elastic constants, restitution, friction.
        fluid: density, viscosity, boundary velocities.
        drag_scale: () factor on the drag, 1 for the law as it is; or (T,) at the times of `Structure.drag_times` [-].
        closure: the drag law: a correlation, which has no numbers to differentiate by, or a learned closure with its
            weights.
        inlet_velocity: (D,) with which particles come in, of each inlet [m/s].
        side_velocity: (D,) of every side of the box in a scene without fluid where one moves, else (); a fluid has its
            own [m/s].
        wall_motion: numbers of the motion of every wall of the scene, those of each part by name; () for one at rest,
            and where all are.
        pistons: numbers of the walls that a force holds.
        meshes: the walls that are meshes.
        bonds: stiffness, size and strength of the bonds.
        scalars: of temperatures and other scalars; None in a scene without.
    """

    gravity: Array
    bodies: ParticleProperties | None
    contact: ContactParameters | SeveralMaterials | None
    fluid: FluidProperties | None
    drag_scale: Array | None
    closure: DragClosure | None
    inlet_velocity: tuple[Array, ...] = ()
    side_velocity: tuple[Array, ...] = ()
    wall_motion: tuple[Numbers, ...] = ()
    pistons: tuple[PistonNumbers, ...] = ()
    meshes: tuple[MeshSurface, ...] = ()
    bonds: BondParameters | None = None
    scalars: ScalarParameters | None = None

    @property
    def materials(self) -> ContactParameters | SeveralMaterials:
        """Constants of the contacts, of a scene with particles; liquid between them is that of the scene's fluid."""
        contact = self.contact if self.contact is not None else required(self.contact, "parameters.contact")
        if self.fluid is None or not needs_liquid(contact):
            return contact
        return with_liquid(contact, self.fluid.density * self.fluid.viscosity)

    @property
    def flow(self) -> FluidProperties:
        """Numbers of the fluid, of a scene that has one, with the gravity that may drive it."""
        return required(self.fluid, "parameters.fluid")._replace(gravity=self.gravity)

    @property
    def mixture(self) -> Mixture:
        """What the exchange between fluid and particles needs; for a scene that has both."""
        return Mixture(
            required(self.closure, "parameters.closure"),
            required(self.drag_scale, "parameters.drag_scale"),
            self.flow,
            required(self.bodies, "parameters.bodies"),
            self.gravity,
        )


class ParticleDiagnostics(NamedTuple):
    """What happened to the particles in an interval.

    Attributes:
        collision_force: () mean over particles and contact steps of |sum of contact forces| [N].
        builds: () int32, builds of the neighbour list since the start.
        overflow: () bool, the neighbour list ran out of room: the interval must be repeated with more.
        finite: () bool, no position or velocity is NaN or infinite.
        lost: () int32, number of particles whose centre left the box through a wall.
        fastest: () largest particle speed [m/s].
        waiting: () int32, particles that are due at an inlet and have not found room; None without inlets.
        buried: () int32, particles within a wall that came in this interval; None where all walls always are there.
        walls: mean force and torque on every wall, sides of the box first; None where nothing asks for it.
        energy: what was given and taken; None where no balance of energy is kept.
        met: (K,) bool, which ends of `PistonTravel` are reached; None without.
        present: () int32, particles that are there in this interval; None where all always are.
    """

    collision_force: Array
    builds: Array
    overflow: Array
    finite: Array
    lost: Array
    fastest: Array
    waiting: Array | None = None
    buried: Array | None = None
    walls: WallLoads | None = None
    energy: EnergyFlow | None = None
    met: Array | None = None
    present: Array | None = None


class Places(NamedTuple):
    """Particles at the end of an interval, in the rows that they had at its start.

    Attributes:
        position, position_low: see `ParticleState`.
    """

    position: Array
    position_low: Low


class Diagnostics(NamedTuple):
    """What a coupled step reports; raised as errors on the host.

    Attributes:
        particles: None without particles.
        fluid: None without a fluid.
        exchange: how exact the exchange was; None unless both exist.
        forces: mean fluid forces over the interval and what the drag law saw; None unless both exist.
        places: on several devices, where the particles had got to when some of them left, came or went to other slabs;
            None on one device, where they keep their rows.
    """

    particles: ParticleDiagnostics | None
    fluid: FluidDiagnostics | None
    exchange: ExchangeDiagnostics | None
    forces: FluidForces | None
    places: Places | None = None

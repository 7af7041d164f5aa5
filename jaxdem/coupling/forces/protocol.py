"""What a force of the fluid on the particles is: what it needs, what it gives, what it remembers.

Drag, pressure gradient and viscous force are always there. Every further force is an object of one class, `FluidForce`,
in a file of its own. The exchange asks it once at the start of a coupling interval for its `Contribution`, and once at
the end for what it keeps. What a contribution is made of tells how it is treated in time, so that the exchange knows no
force by its name:

    impulse on a particle in a fluid step of length t =
        t force + (t / T) impulse + slip_mass (change of the slip u - v in the step [+ t u.grad u]),

T the interval. The last term is implicit, as the drag is. What the particles get the faces of the mesh lose, term by
term.
"""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple

from jax import Array

from jaxdem.coupling.interpolation import Weights
from jaxdem.fluid.fluid_state import FluidProperties
from jaxdem.fluid.grid import FaceField, Grid
from jaxdem.particles.integrate import ParticleProperties, ParticleState


@dataclasses.dataclass(frozen=True)
class IntervalStart:
    """What a force may look at, at the start of a coupling interval.

    Attributes:
        grid: of the fluid.
        weights: of the N particles on its cells.
        face_velocity: of the fluid, interstitial [m/s].
        slip: (N, D) fluid less particle velocity [m/s].
        particles: their state.
        bodies: size and density.
        properties: density and viscosity of the fluid.
        duration: () T [s].
    """

    grid: Grid
    weights: Weights
    face_velocity: FaceField
    slip: Array
    particles: ParticleState
    bodies: ParticleProperties
    properties: FluidProperties
    duration: Array


class Contribution(NamedTuple):
    """What a force gives over a coupling interval; None for what it has not.

    Attributes:
        force: (N, D) constant over the interval [N].
        torque: (N, A) constant over the interval; the fluid, whose cells carry no spin, does not feel it [N m].
        slip_mass: () or (N,) mass on the change of the slip, treated implicitly [kg].
        impulse: (N, D) of the whole interval, spread evenly over its fluid steps [kg m/s].
        pending_impulse: (N, D) that the particles have got in the interval before and the faces have still to lose
            [kg m/s].
        memory: pytree for `FluidForce.end`, of arrays (..., N, C).
    """

    force: Array | None = None
    torque: Array | None = None
    slip_mass: Array | None = None
    impulse: Array | None = None
    pending_impulse: Array | None = None
    memory: Any = None


class MeanForce(NamedTuple):
    """What a force came to, in the mean over a coupling interval.

    Attributes:
        given: (N, D) what the faces have lost to the particles in this interval's fluid steps; zero for a torque [N].
        drive: (N, D) slip_mass times the acceleration of the fluid along its path, for a force that is inertia of the
            body; else None [N].
        memory: of the contribution.
    """

    given: Array
    drive: Array | None = None
    memory: Any = None


@dataclasses.dataclass(frozen=True)
class IntervalEnd:
    """What a force may look at when the particles have moved.

    Attributes:
        bodies: size and density of the particles.
        properties: of the fluid.
        velocity_change: (N, D) of the particles over the interval [m/s].
        duration: () T [s].
    """

    bodies: ParticleProperties
    properties: FluidProperties
    velocity_change: Array
    duration: Array


class FluidForce(ABC):
    """A force of the fluid on the particles; a frozen dataclass of static numbers.

    Attributes:
        name: of its mean in `FluidForces.further` and of what it keeps in `ParticleState.fluid_memory`.
        label: its name for readers.
        is_inertia: whether its `slip_mass` is inertia of the body, as the virtual mass is: then the slip changes with
            the fluid's acceleration along its path, and the contact steps move a body that is heavier by
            `added_density`.
        acts_on_velocity: whether it is a force; False for a torque alone.
    """

    name: ClassVar[str]
    label: ClassVar[str]
    is_inertia: ClassVar[bool] = False
    acts_on_velocity: ClassVar[bool] = True

    def __str__(self) -> str:
        """The force and its numbers, as `jaxdem check` shows it."""
        return self.label

    def start(self, slip: Array) -> Any:
        """Memory at the start of a run whose slip (N, D) has always been as it is [m/s]; None for nothing.

        Of arrays (..., N, C), also of one number a particle (C = 1): they move with the particles.
        """
        return None

    @abstractmethod
    def begin(self, start: IntervalStart, memory: Any) -> Contribution:
        """The contribution to the interval that begins, with what was remembered."""

    def end(self, mean: MeanForce, end: IntervalEnd) -> tuple[Array, Any]:
        """Mean force that has acted on the particles (N, D) [N], and what is remembered, of the shapes of `start`."""
        return mean.given, mean.memory

    def added_density(self, properties: FluidProperties) -> Array | None:
        """Density of the fluid that moves with the body, in its mass but not in its moment of inertia [kg/m3]."""
        return None

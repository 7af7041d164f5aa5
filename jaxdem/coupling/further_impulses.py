"""The impulses of the further forces in the exchange: what is known before a fluid step, and what has come of it.

A force with a slip mass m_s acts on the change of the slip; see `exchange` for how it is implicit on both sides, and
`forces.protocol` for what a force gives.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.coupling.forces.protocol import Contribution, FluidForce, MeanForce
from jaxdem.coupling.interpolation import Weights, interpolate
from jaxdem.fluid.grid import FaceField, Grid, cell_average, gradient, sum_of
from jaxdem.fluid.interval import Substeps
from jaxdem.particles.integrate import as_column


class ForceSums(NamedTuple):
    """Impulses of a further force so far, (N, D) [kg m/s]; see `MeanForce`."""

    given: Array
    drive: Array | None


class Motion(NamedTuple):
    """How the fluid moves past the particles at the start of a fluid step, all (N, D); only with slip masses.

    Attributes:
        fluid: its velocity at the particles [m/s].
        slip: the same less that of the particles [m/s].
        convected: change of the fluid velocity along its path by convection in the step; 0 without virtual mass [m/s].
    """

    fluid: Array
    slip: Array
    convected: Array | float


class Received(NamedTuple):
    """What the forces with a slip mass come to in a fluid step.

    Attributes:
        sums: of each so far.
        of_faces: impulse of all together, as the faces give it (N, D) [kg m/s].
        on_bodies: the same as it acts on the bodies that move [kg m/s].
        mass: of these bodies [kg].
    """

    sums: dict[str, ForceSums]
    of_faces: Array | float
    on_bodies: Array | float
    mass: Array


@dataclasses.dataclass(frozen=True)
class FurtherImpulses:
    """The further forces of one coupling interval.

    Attributes:
        forces: static.
        contributions: to the interval, by the name of the force.
        substeps: the fluid steps.
    """

    forces: tuple[FluidForce, ...]
    contributions: dict[str, Contribution]
    substeps: Substeps

    def none_yet(self, zero: Array) -> dict[str, ForceSums]:
        """Sums of the forces with a slip mass before the first step, all `zero` (N, D)."""
        return {
            force.name: ForceSums(zero, zero if force.is_inertia else None)
            for force in self.forces
            if self.contributions[force.name].slip_mass is not None
        }

    @property
    def inertia(self) -> Array | None:
        """Slip mass of the forces that are inertia of the fluid; None for none [kg]."""
        return total(self.contributions[force.name].slip_mass for force in self.forces if force.is_inertia)

    @property
    def known(self) -> list[Array]:
        """Impulses of all in a fluid step that are known at the start of the interval, (N, D) [kg m/s]."""
        return [term for c in self.contributions.values() for term in self.known_of(c)]

    def known_of(self, contribution: Contribution) -> list[Array]:
        """The same of one."""
        force, impulse = contribution.force, contribution.impulse
        terms = [] if force is None else [self.substeps.step * force]
        return terms if impulse is None else [*terms, impulse / self.substeps.number]

    @property
    def pending(self) -> list[Array]:
        """Impulses of the last interval that the faces lose in a fluid step, (N, D) [kg m/s]."""
        pending = (c.pending_impulse for c in self.contributions.values())
        return [impulse / self.substeps.number for impulse in pending if impulse is not None]

    def received(
        self,
        so_far: dict[str, ForceSums],
        motion: Motion | None,
        fluid: Array,
        before: tuple[Array, Array, Array],
        mass: Array,
    ) -> Received:
        """The impulses of the forces with a slip mass in a fluid step.

        Args:
            so_far: sums before it.
            motion: at its start; None without slip masses.
            fluid: velocity at the particles at its end (N, D) [m/s].
            before: velocity of the particles at its start [m/s]; the impulses in it that are not exchanged with the
                faces, and those that are, (N, D) each [kg m/s].
            mass: of the particles [kg].
        """
        if motion is None:
            return Received({}, 0.0, 0.0, mass)
        velocity, others, impulse = before
        slip = fluid - (velocity + (others + impulse) / as_column(mass))
        change, sums = slip - motion.slip, {}
        of_faces, on_bodies = [], []
        for force in self.forces:
            c = self.contributions[force.name]
            if c.slip_mass is None:
                continue
            held, past = as_column(c.slip_mass), so_far[force.name]
            given = held * (change + motion.convected if force.is_inertia else change)
            given = plus(given, *self.known_of(c))
            drive = None
            if force.is_inertia:
                drive = held * (fluid - motion.fluid + motion.convected)
                mass = mass + c.slip_mass
            of_faces.append(given)
            on_bodies.append(given if drive is None else drive)
            sums[force.name] = ForceSums(past.given + given, None if drive is None else plus(drive, past.drive))
        return Received(sums, sum_of(of_faces), sum_of(on_bodies), mass)

    def means(self, sums: dict[str, ForceSums], duration: float, drag: Array) -> tuple[dict[str, MeanForce], Array]:
        """Mean of each force over the interval, and the drag without those that are in its impulse.

        Args:
            sums: of the forces with a slip mass.
            duration: of the interval [s].
            drag: mean of the drag and the explicit further forces (N, D) [N].
        """
        found = {}
        for force in self.forces:
            c = self.contributions[force.name]
            if c.slip_mass is not None:
                own = sums[force.name]
                drive = None if own.drive is None else own.drive / duration
                found[force.name] = MeanForce(own.given / duration, drive, c.memory)
                continue
            explicit = self.known_of(c)
            mean = sum_of(explicit) / self.substeps.step if explicit else jnp.zeros_like(drag)
            found[force.name] = MeanForce(mean, None, c.memory)
            drag = drag - mean if explicit else drag
        return found, drag


def convective_acceleration(grid: Grid, weights: Weights, face_velocity: FaceField) -> Array:
    """u.grad u at the particles, (N, D) [m/s2]; exact for a linear flow away from walls."""
    velocity = cell_average(face_velocity)
    terms = tuple(
        sum_of(u * slope for u, slope in zip(velocity, cell_average(gradient(grid, component)), strict=True))
        for component in velocity
    )
    return interpolate(weights, terms)


def total(parts: Iterable[Array | None]) -> Array | None:
    """Sum of those that are there; None for none."""
    return sum_of(part for part in parts if part is not None)


def plus(first: Array, *parts: Array | None) -> Array:
    """`first` and those that are there."""
    return sum_of((first, *(part for part in parts if part is not None)))

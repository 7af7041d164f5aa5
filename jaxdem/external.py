"""Particles in a fluid that another program solves: its fields come in, what the particles do to it goes out.

Over a coupling interval of length T, in the order of the exchange (`coupling.exchange`):

1. `ExternalFluid.exchange` looks at the particles, and at the fluid at the start of the interval. It returns the void
   fraction, and what the particles do to the fluid: a force per volume of

       F(u) = drag_source - drag_coefficient u,

   u the fluid's velocity at the end of the interval, at the same place.
2. The other solver advances by T, with F(u) in its momentum equation: implicit at its new u, or at its old u.
3. `ExternalFluid.advance` takes the fluid with which F was evaluated. The particles get the impulse that F has taken
   from the fluid, to rounding, and move by T.

The drag is implicit in the velocity of the particles, so that no relaxation time limits T; the lift is constant over T;
virtual mass and Basset force act on the change of the slip. All of them are those of a run with a fluid of our own.
"""

from __future__ import annotations

import dataclasses
from typing import Literal, NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.coupling.coupled import Coupling, Mixture
from jaxdem.coupling.exchange import Exchange
from jaxdem.coupling.exchange_result import FluidForces
from jaxdem.coupling.interpolation import deposit_on_faces
from jaxdem.errors import InputError, require_kinds, required
from jaxdem.failures import failures
from jaxdem.fluid.fluid_state import FaceExchange, FluidState, FluidStep
from jaxdem.fluid.grid import FaceField, Grid, face_control_volume, sum_of
from jaxdem.fluid.pressure import SolverReport
from jaxdem.numerics.static import static
from jaxdem.particles.integrate import ParticleState, as_column
from jaxdem.particles.neighbors import Neighbors
from jaxdem.simulation import Simulation
from jaxdem.state import Diagnostics, Parameters, State
from jaxdem.step import advance_particles

Field = Array | FaceField
"""A vector field: an array (cells..., D), or D arrays of the faces, see `ExternalFluid.placement`."""


class FluidFields(NamedTuple):
    """The fluid of another program at one time. Arrays of NumPy or JAX.

    Attributes:
        velocity: interstitial: the superficial one over the void fraction [m/s].
        pressure_gradient: of the reduced or of the total pressure, see `ExternalFluid.pressure` [Pa/m].
        stress_divergence: of the viscous stress, without the void fraction; None: no viscous force [N/m3].
    """

    velocity: Field
    pressure_gradient: Field
    stress_divergence: Field | None = None


class FluidSources(NamedTuple):
    """What the particles are and do to the fluid over an interval.

    Attributes:
        void_fraction: (cells...) at the start of the interval [-].
        solid_velocity: mean of the particles by volume; 0 where there are none [m/s].
        drag_coefficient: (cells...), or D arrays of the faces, see F(u) of this module [kg/(m3 s)].
        drag_source: see F(u) of this module; further forces included [N/m3].
    """

    void_fraction: Array
    solid_velocity: Field
    drag_coefficient: Field
    drag_source: Field


class ExternalStep(NamedTuple):
    """The particles after an interval, and what the fluid has lost to them.

    Attributes:
        state, neighbors: after the interval.
        force_on_fluid: F(u) of the fluid that was given, mean over the interval [N/m3].
        stress_force_on_fluid: reaction to the pressure and viscous forces on the particles, mean over the interval. It
            is for a momentum equation with the whole of -grad p + div(tau); one with the void fraction before both
            has it already. Zero in model B with the reduced pressure [N/m3].
        impulse: (D,) that the particles have got from both [kg m/s].
        diagnostics: forces on each particle among them; without those of a fluid of our own.
        failures: () int32 flags, 0 for a sound step, see `jaxdem.failures`.
    """

    state: State
    neighbors: Neighbors
    force_on_fluid: Field
    stress_force_on_fluid: Field
    impulse: Array
    diagnostics: Diagnostics
    failures: Array


@static
class ExternalFluid(Simulation):
    """Particles that wait for the fluid of another program; made by `jaxdem.external_fluid`. All methods are pure.

    Attributes:
        placement: "cells": vector fields are arrays (cells..., D) of a collocated solver. "faces": they are D arrays of
            a staggered one, the one of axis a with one entry more along a; on a periodic axis the first and the last
            face are the same.
        pressure: what `FluidFields.pressure_gradient` is of. "reduced": of p - rho g.x (OpenFOAM's p_rgh): the
            hydrostatic buoyancy is added to the particles' weight. "total": of p.
    """

    placement: Literal["cells", "faces"] = "cells"
    pressure: Literal["reduced", "total"] = "reduced"

    def step(
        self, parameters: Parameters, state: State, neighbors: Neighbors | None
    ) -> tuple[State, Neighbors | None, Diagnostics]:
        """Refused: a step needs the fields of the other program, see `advance`.

        Raises:
            InputError: always.
        """
        raise InputError(
            "simulation",
            "an external fluid",
            "has no fluid of its own to take a step with",
            "call its method `advance` with the fields of the other solver",
        )

    def reversible(self) -> ExternalFluid:
        """See `Simulation`: for reverse-mode differentiation."""
        contact = None if self.contact is None else dataclasses.replace(self.contact, reversible=True)
        return dataclasses.replace(self, contact=contact)

    def exchange(self, parameters: Parameters, state: State, start: FluidFields) -> FluidSources:
        """What the particles are and do to the fluid over the coming interval.

        Args:
            parameters: numbers.
            state: of the particles at the start of the interval.
            start: the fluid then.

        Raises:
            InputError: an argument is of another kind, or a field has another shape.
        """
        _require(parameters, state, start=start)
        parameters = self.during(parameters, state.step)
        mixture, fluid = parameters.mixture, self._fluid(parameters, start, "start")
        particles = required(state.particles, "state.particles")
        exchange = self._mixing(start).begin(mixture, fluid, particles, self.time(parameters, state))
        faces = exchange.on_faces(exchange.first(fluid), exchange.explicit_terms(exchange.first(fluid)))
        coefficient = self._density(exchange, faces.resistance)
        return FluidSources(
            exchange.void_fraction,
            self._placed(self._solid_velocity(mixture, exchange, particles)),
            coefficient[0] if self.placement == "cells" else coefficient,
            self._placed(self._density(exchange, faces.forcing)),
        )

    def advance(
        self,
        parameters: Parameters,
        state: State,
        neighbors: Neighbors,
        start: FluidFields,
        end: FluidFields | None = None,
    ) -> ExternalStep:
        """The particles after the interval.

        Args:
            parameters: numbers.
            state, neighbors: at its start.
            start: the fluid at its start, as `exchange` had it.
            end: the fluid at its end, whose velocity is that of F(u); None for an F(u) at the velocity of the start.

        Raises:
            InputError: an argument is of another kind, a field has another shape, or the start has a stress and the end
                none.
        """
        _require(parameters, state, start=start, **({} if end is None else {"end": end}))
        end = start if end is None else end
        if start.stress_divergence is not None and end.stress_divergence is None:
            # The viscous force is by the stress of the end alone, which that of the start does not replace.
            limit = "is missing, and the start has one: the particles would get no viscous force"
            raise InputError("end.stress_divergence", None, limit, "give it, or leave out that of the start too")
        now, before = self.during(parameters, state.step), required(state.particles, "state.particles")
        mixture = now.mixture
        first, last = self._fluid(now, start, "start"), self._fluid(now, end, "end")
        exchange = self._mixing(end).begin(mixture, first, before, self.time(parameters, state))
        carry = exchange.first(first)
        explicit = exchange.explicit_terms(carry)
        faces = exchange.on_faces(carry, explicit)
        carry = exchange.received(carry, explicit, faces, self._solved(parameters, last, end))
        forces = exchange.forces(carry)
        particles, listed, report, _, _ = advance_particles(self, parameters, state, neighbors, forces)
        diagnostics = Diagnostics(report, None, exchange.diagnostics(carry), forces)
        stress = self._stress_force(mixture, forces, before)
        duration = exchange.start.duration
        return ExternalStep(
            State(particles, None, state.step + 1),
            required(listed, "neighbors"),
            self._placed(self._density(exchange, _gained(faces, last.face_velocity))),
            self._placed(self._density(exchange, self._reaction(exchange, duration * stress))),
            carry.balance[0] + duration * jnp.sum(stress, axis=0),
            diagnostics,
            failures(self, diagnostics),
        )

    @property
    def _grid(self) -> Grid:
        return required(self.coupling, "coupling").interval.solver.grid

    def _mixing(self, fields: FluidFields) -> Coupling:
        """The exchange, with a viscous force where the fields have a stress."""
        coupling = required(self.coupling, "coupling")
        solver = dataclasses.replace(coupling.interval.solver, viscous=fields.stress_divergence is not None)
        return dataclasses.replace(coupling, interval=dataclasses.replace(coupling.interval, solver=solver))

    def _fluid(self, parameters: Parameters, fields: FluidFields, name: str) -> FluidState:
        """The fields as a state of the fluid. Its pressure and its former void fraction are not looked at."""
        slope = self._components(fields.pressure_gradient, parameters, f"{name}.pressure_gradient")
        if self.pressure == "total":
            weight = parameters.flow.density * parameters.gravity
            slope = tuple(s - weight[axis] for axis, s in enumerate(slope))
        none = jnp.zeros((), parameters.gravity.dtype)
        velocity = self._components(fields.velocity, parameters, f"{name}.velocity")
        return FluidState(velocity, none, none, pressure_slope=slope)

    def _solved(self, parameters: Parameters, fluid: FluidState, fields: FluidFields) -> FluidStep:
        """The fluid as the result of a step of a solver of our own."""
        acceleration: FaceField = ()
        if fields.stress_divergence is not None:
            stress = self._components(fields.stress_divergence, parameters, "end.stress_divergence")
            acceleration = tuple(s / parameters.flow.density for s in stress)
        none = jnp.zeros((), parameters.gravity.dtype)
        return FluidStep(fluid, acceleration, SolverReport(jnp.zeros((), jnp.int32), none, jnp.ones((), bool)), none)

    def _components(self, field: Field, parameters: Parameters, name: str) -> FaceField:
        """A vector field by component.

        Raises:
            InputError: it has another shape.
        """
        grid, dtype = self._grid, parameters.gravity.dtype
        if self.placement == "cells":
            shape, given = (*grid.cells, grid.dimension), getattr(field, "shape", None)
            if given != shape:
                raise _wrong_shape(name, given or type(field), f"must be an array of the cells, of shape {shape}")
            array = jnp.asarray(field, dtype)
            return tuple(array[..., axis] for axis in range(grid.dimension))
        shapes = tuple(grid.face_shape(axis) for axis in range(grid.dimension))
        given = field if isinstance(field, tuple | list) else (field,)
        found = tuple(getattr(component, "shape", None) for component in given)
        if found != shapes:
            raise _wrong_shape(name, found, f"must be a tuple of arrays of the faces, of the shapes {shapes}")
        return tuple(jnp.asarray(component, dtype) for component in given)

    def _placed(self, field: FaceField) -> Field:
        """A field by component in the form that the other solver has."""
        return jnp.stack(field, axis=-1) if self.placement == "cells" else field

    def _density(self, exchange: Exchange, impulse: FaceField) -> FaceField:
        """Impulses of an interval as force per volume [N/m3]."""
        grid, duration = self._grid, exchange.start.duration
        if grid.collocated:
            return tuple(part / (duration * grid.cell_volume) for part in impulse)
        volumes = (face_control_volume(grid, axis).astype(duration.dtype) for axis in range(grid.dimension))
        return tuple(part / (duration * volume) for part, volume in zip(impulse, volumes, strict=True))

    def _reaction(self, exchange: Exchange, impulse: Array) -> FaceField:
        """What the fluid gains where particles get impulses (N, D) [kg m/s]."""
        return deposit_on_faces(self._grid, exchange.start.weights, -impulse)

    def _solid_velocity(self, mixture: Mixture, exchange: Exchange, particles: ParticleState) -> FaceField:
        """Mean velocity of the particles by volume; 0 where there are none [m/s]."""
        volume = jnp.broadcast_to(mixture.bodies.volume, particles.velocity.shape[:1])
        content = deposit_on_faces(self._grid, exchange.start.weights, volume)
        moving = deposit_on_faces(self._grid, exchange.start.weights, volume[:, None] * particles.velocity)
        return tuple(
            jnp.where(c > 0.0, m / jnp.where(c > 0.0, c, 1.0), 0.0) for m, c in zip(moving, content, strict=True)
        )

    def _stress_force(self, mixture: Mixture, forces: FluidForces, particles: ParticleState) -> Array:
        """(N, D) mean force of pressure and viscous stress, with hydrostatic buoyancy where the pressure is total
        [N]."""
        force: Array = sum_of((forces.pressure_gradient, forces.viscous))
        if self.pressure == "reduced":
            return force
        buoyancy = jnp.broadcast_to(mixture.buoyancy, force.shape)
        return force + (buoyancy if particles.active is None else jnp.where(as_column(particles.active), buoyancy, 0.0))


def _require(parameters: object, state: object, **fields: object) -> None:
    """Refuses arguments of another kind, such as two in the wrong order.

    Raises:
        InputError: naming the first.
    """
    remedy = "give parameters, state, the list where one is asked for, and fields as jaxdem.FluidFields"
    of_fluid = {name: (given, FluidFields) for name, given in fields.items()}
    require_kinds(remedy, parameters=(parameters, Parameters), state=(state, State), **of_fluid)


def _gained(faces: FaceExchange, velocity: FaceField) -> FaceField:
    """Impulse that the fluid gains by drag and further forces [kg m/s]."""
    return tuple(f - r * u for r, f, u in zip(faces.resistance, faces.forcing, velocity, strict=True))


def _wrong_shape(name: str, shape: object, limit: str) -> InputError:
    return InputError(name, shape, limit, "give the field on the mesh fluid.cells; the last axis of the box is up")

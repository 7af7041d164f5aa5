"""What a drag closure is given and what it returns."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple, Protocol, cast

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.numerics.vectors import row_lengths


class DragInputs(NamedTuple):
    """What the drag law sees at every particle, once per coupling interval (N particles, D dimensions).

    Attributes:
        particle_velocity: (N, D) [m/s].
        fluid_velocity: (N, D) interstitial velocity interpolated to the particle [m/s].
        solid_fraction: (N,) 1 - void fraction at the particle; carried itself to avoid cancellation [-].
        void_fraction_gradient: (N, D) gradient of the void fraction at the particle [1/m].
        pressure_gradient: (N, D) gradient of the reduced pressure at the particle [Pa/m].
        diameter: () or (N,) [m].
        filter_size: () width of the averaging that made the fluid fields, the cell size [m].
        fluid_density: () or, of two fluids, (N,) [kg/m3].
        dynamic_viscosity: () or, of two fluids, (N,) [Pa s].
        wide_solid_fraction: (N,) of the field that is averaged over three cells along every axis; None for a law that
            does not ask for it, see `sees_wide` [-].
    """

    particle_velocity: Array
    fluid_velocity: Array
    solid_fraction: Array
    void_fraction_gradient: Array
    pressure_gradient: Array
    diameter: Array
    filter_size: Array
    fluid_density: Array
    dynamic_viscosity: Array
    wide_solid_fraction: Array | None = None

    @property
    def slip_velocity(self) -> Array:
        """(N, D) fluid less particle velocity [m/s]."""
        return self.fluid_velocity - self.particle_velocity

    @property
    def slip_speed(self) -> Array:
        """(N,) length of the slip velocity [m/s], with a finite gradient (zero) at zero slip."""
        return row_lengths(self.slip_velocity)

    @property
    def reynolds(self) -> Array:
        """(N,) particle Reynolds number of the superficial slip, g rho |u - v| d / mu [-]."""
        return (
            (1.0 - self.solid_fraction) * self.fluid_density * self.slip_speed * self.diameter / self.dynamic_viscosity
        )

    @property
    def stokes_coefficient(self) -> Array:
        """() or (N,) Stokes drag per unit slip, 3 pi mu d [kg/s]."""
        return 3.0 * jnp.pi * self.dynamic_viscosity * self.diameter


class Drag(NamedTuple):
    """Drag on every particle: force = coefficient (u - v) + remainder.

    The coefficient is treated implicitly by the coupled step, the remainder explicitly.

    Attributes:
        coefficient: (N,) >= 0 [kg/s].
        remainder: (N, D) [N], or None for laws that have none, so that no such term is compiled.
        out_of_range: (N,) bool, where the inputs lay outside the law's range and a floor or fallback acted.
    """

    coefficient: Array
    remainder: Array | None
    out_of_range: Array


class DragClosure(Protocol):
    """A drag closure: an immutable object and a pytree; its leaves are the weights, if it has any."""

    def __call__(self, inputs: DragInputs) -> Drag:
        """Drag for every particle from what the law sees."""
        ...


def sees_wide(closure: Callable[[DragInputs], Drag]) -> bool:
    """Whether a drag law asks for `DragInputs.wide_solid_fraction`, by an attribute `sees_wide` that is true."""
    return bool(getattr(closure, "sees_wide", False))


def asked_inputs(closure: DragClosure) -> tuple[str, ...]:
    """The fields of `DragInputs` that a closure is given, in their order."""
    return DragInputs._fields if sees_wide(closure) else DragInputs._fields[:-1]


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class FixedClosure:
    """A function of `DragInputs` as a drag closure without weights.

    Attributes:
        function: gives the `Drag`; two of these are the same law if they are the same object.
        sees_wide: see the function `sees_wide`.
    """

    function: Callable[[DragInputs], Drag]
    sees_wide: bool = False

    def __call__(self, inputs: DragInputs) -> Drag:
        """See `DragClosure`."""
        return self.function(inputs)


def as_closure(law: Callable[[DragInputs], Drag]) -> DragClosure:
    """The law as a pytree: as it is where it is one, else a `FixedClosure`."""
    return FixedClosure(law, sees_wide(law)) if jax.tree_util.all_leaves([law]) else cast(DragClosure, law)

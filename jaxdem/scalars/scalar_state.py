"""What evolves of temperatures and other scalars, and their numbers: arrays only."""

from __future__ import annotations

from typing import NamedTuple

from jax import Array

from jaxdem.fluid.cut_scalar import ScalarWalls
from jaxdem.fluid.scalar_transport import ScalarNumbers
from jaxdem.particles.integrate import ParticleProperties
from jaxdem.scalars.conduction import ConductionNumbers


class FluidHeat(NamedTuple):
    """Numbers of the fluid's heat; traced.

    Attributes:
        capacity: () heat capacity [J/(kg K)].
        expansion: () thermal expansion [1/K].
        reference: () temperature at which it has its density [K].
    """

    capacity: Array
    expansion: Array
    reference: Array


class SecondHeat(NamedTuple):
    """Numbers of the heat of a second fluid, whose reference is that of the first; traced.

    Attributes:
        capacity: () heat capacity [J/(kg K)].
        conductivity: () [W/(m K)].
        expansion: () thermal expansion [1/K].
    """

    capacity: Array
    conductivity: Array
    expansion: Array


class GrainHeat(NamedTuple):
    """Numbers of the grains' heat; traced.

    Attributes:
        capacity: () heat capacity [J/(kg K)].
        conduction: of the contacts; None where they conduct nothing.
    """

    capacity: Array
    conduction: ConductionNumbers | None

    def of_each(self, bodies: ParticleProperties) -> Array:
        """() or (N,) heat capacity of a grain, c rho V, without fluid that moves along [J/K]."""
        return self.capacity * bodies.density * bodies.volume


class ScalarParameters(NamedTuple):
    """Numbers of the scalars; traced.

    Attributes:
        fields: of each field; that of the temperature has the conductivity [W/(m K)] in place of the diffusivity, and
            fluxes of heat [W/m2].
        fluid: None without a temperature of the fluid.
        grains: None without temperatures of grains.
        walls: surfaces within the mesh of the fluid; None without.
        second: of a second fluid; None where there is one alone.
    """

    fields: tuple[ScalarNumbers, ...]
    fluid: FluidHeat | None
    grains: GrainHeat | None
    walls: ScalarWalls | None = None
    second: SecondHeat | None = None


class Supplied(NamedTuple):
    """What has come in since the start; on several devices what each slab has counted.

    Attributes:
        sides: (F, 2 D + S) of every field through every side, lower before upper, axis by axis, then through every
            surface within the mesh of the fluid [unit m3]; of two fluids heat [J].
        walls: () heat that walls have given to grains by contact [J].
        grains: () heat that grains have brought which came in, less that of those which left [J].
        friction: () heat that contacts have made of motion; None where that warms nothing [J].
    """

    sides: Array
    walls: Array
    grains: Array
    friction: Array | None = None


class ScalarState(NamedTuple):
    """What evolves.

    Attributes:
        fields: of the fluid, on the cells, in the order of `Scalars.fields`.
        grains: (N,) temperature of the grains; None without [K].
        supplied: since the start.
        coming: on several devices, where grains come in through inlets, (N,) temperature of those to come, by identity;
            None elsewhere: there it stands in their rows [K].
        capacity: W of the cells, where surfaces change their place; None elsewhere [-].
    """

    fields: tuple[Array, ...]
    grains: Array | None
    supplied: Supplied
    coming: Array | None = None
    capacity: Array | None = None

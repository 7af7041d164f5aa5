"""Heat and scalars of two fluids with a sharp surface beside what they carry: conduction, diffusion, and what the heat
is to grains.

A cell of the liquid fraction c holds c of the liquid and 1 - c of the second fluid, of one temperature:

    C = C_2 + c (C_1 - C_2),   1/k = c/k_1 + (1 - c)/k_2.

The capacity by volume keeps the heat. The conductivity is the harmonic mean, in a cell and between two cells, so that
the heat that goes through layers one behind the other is exact wherever the surface lies in a cell. Along a surface
the cells that it cuts conduct too little.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.coupling.interpolation import Weights, interpolate
from jaxdem.errors import required
from jaxdem.fluid.boundary import Boundary
from jaxdem.fluid.carried_heat import CarriedHeat, HeatOfPhases, mixed
from jaxdem.fluid.dissolved import PART, CarriedScalar, Dissolved, middle_of, open_to_diffusion
from jaxdem.fluid.fluid_state import FluidProperties
from jaxdem.fluid.grid import CellOrOne, Grid, face_average
from jaxdem.fluid.scalar_transport import ScalarField, ScalarNumbers, ScalarTransport, Stream
from jaxdem.fluid.second_fluid import mixture_density
from jaxdem.scalars.in_cells import conducting
from jaxdem.scalars.scalar_state import FluidHeat, ScalarParameters, SecondHeat


class Phases(NamedTuple):
    """Two fluids at the end of an interval.

    Attributes:
        grid, boundary: static.
        properties: of both.
        parameters: numbers of the scalars.
        fraction: liquid fraction of the cells [-].
        void_fraction: of the cells [-].
    """

    grid: Grid
    boundary: Boundary
    properties: FluidProperties
    parameters: ScalarParameters
    fraction: Array
    void_fraction: CellOrOne

    @property
    def content(self) -> Array:
        """g C of the cells [J/(m3 K)]."""
        return self.void_fraction * mixed(capacities(self.parameters, self.properties), self.fraction)

    def resistivity(self, fraction: Array) -> Array:
        """1/k at a liquid fraction [m K/W]."""
        liquid, second = conductivities(self.parameters)
        return mixed((1.0 / liquid, 1.0 / second), fraction)

    def conducted(
        self, field: ScalarField, bed: str, heat: CarriedHeat, duration: Array, reversible: bool
    ) -> tuple[Array, Array]:
        """Temperatures of the cells after conduction over an interval [K], and (2 D,) heat that has come in through the
        sides, what the fluids have carried with them included [J].

        Args:
            field: static description of the temperature.
            bed: conductivity between grains, see `conducting`.
            heat: that the fluids have carried.
            duration: of the interval [s].
            reversible: see `ScalarTransport.advance`.
        """
        conductivity = (1.0 / r for r in face_average(self.grid, self.resistivity(self.fraction)))
        gaps = face_average(self.grid, self.void_fraction)
        share = tuple(conducting(bed, g) * k for g, k in zip(gaps, conductivity, strict=True))
        numbers = self.parameters.fields[0]
        numbers = numbers._replace(diffusivity=jnp.ones_like(numbers.diffusivity))
        content = self.content
        transport = ScalarTransport(
            self.grid, self.boundary, field, numbers, Stream(None, content, content, share)
        )  # fmt: skip
        found, through = transport.advance(heat.temperature, duration, jnp.ones((), jnp.int32), reversible)
        return found, heat.through_sides + through

    def diffused(
        self, field: ScalarField, number: int, scalar: CarriedScalar, duration: Array, reversible: bool
    ) -> tuple[Array, Array]:
        """The same of scalar `number` of the fluid, which stays in its phase [unit], [unit m3]; see `dissolved`."""
        if not field.diffuses:
            return scalar
        share, volume = open_to_diffusion(self.grid, field.phase, self.fraction, self.void_fraction)
        middle, numbers = middle_of(self.grid, scalar.value), self.parameters.fields[number]
        numbers = numbers._replace(value=numbers.value - middle)
        transport = ScalarTransport(self.grid, self.boundary, field, numbers, Stream(None, volume, volume, share))
        found, through = transport.advance(scalar.value - middle, duration, jnp.ones((), jnp.int32), reversible)
        return middle + found, scalar.through_sides + through

    def at_grains(self, weights: Weights) -> tuple[Array, Array]:
        """(N,) conductivity [W/(m K)] and heat capacity [J/(kg K)] of the content of cells that has the liquid fraction
        at a grain."""
        there = jnp.clip(interpolate(weights, (self.fraction,))[:, 0], 0.0, 1.0)
        density = mixture_density(required(self.properties.second, "second"), self.properties.density, there)
        return 1.0 / self.resistivity(there), mixed(capacities(self.parameters, self.properties), there) / density


def dissolved_in_phases(field: ScalarField, numbers: ScalarNumbers) -> Dissolved:
    """What two fluids need to carry a scalar."""
    inflow = tuple(numbers.value[n] if kind == "value" else None for n, kind in enumerate(field.sides))
    return Dissolved(PART[field.phase], inflow)


def heat_of_phases(
    field: ScalarField, expands: bool, parameters: ScalarParameters, properties: FluidProperties
) -> HeatOfPhases:
    """What two fluids need to carry their heat, of the numbers of a scene.

    Args:
        field: static description of the temperature.
        expands: whether a fluid is lighter where it is warmer.
        parameters: numbers of the scalars.
        properties: of both fluids.
    """
    of_liquid, of_second = _of_both(parameters)
    densities = properties.density, required(properties.second, "second of the fluid").density
    expansion = densities[0] * of_liquid.expansion, densities[1] * of_second.expansion
    given = parameters.fields[0].value
    inflow = tuple(given[n] if kind == "value" else None for n, kind in enumerate(field.sides))
    capacity = capacities(parameters, properties)
    return HeatOfPhases(capacity, expansion if expands else None, of_liquid.reference, inflow)


def capacities(parameters: ScalarParameters, properties: FluidProperties) -> tuple[Array, Array]:
    """() heat capacity of liquid and second fluid by volume [J/(m3 K)]."""
    of_liquid, of_second = _of_both(parameters)
    second = required(properties.second, "second of the fluid")
    return properties.density * of_liquid.capacity, second.density * of_second.capacity


def conductivities(parameters: ScalarParameters) -> tuple[Array, Array]:
    """() conductivity of liquid and second fluid [W/(m K)]."""
    return parameters.fields[0].diffusivity, _of_both(parameters)[1].conductivity


def _of_both(parameters: ScalarParameters) -> tuple[FluidHeat, SecondHeat]:
    return required(parameters.fluid, "heat of the fluid"), required(parameters.second, "heat of the second fluid")

"""The fluid of an interval, and the grains in it, as scalars see them."""

from __future__ import annotations

from typing import NamedTuple

from jax import Array

from jaxdem.closures.base import DragInputs
from jaxdem.coupling.interpolation import Weights
from jaxdem.errors import required
from jaxdem.fluid.boundary import Boundary
from jaxdem.fluid.carried_heat import CarriedHeat
from jaxdem.fluid.dissolved import CarriedScalar
from jaxdem.fluid.fluid_state import FluidProperties, FluidState
from jaxdem.fluid.grid import CellOrOne, FaceField, Grid
from jaxdem.scalars.phases import Phases
from jaxdem.scalars.scalar_state import ScalarParameters


class FluidFlow(NamedTuple):
    """The fluid of an interval.

    Attributes:
        grid, boundary: static.
        properties: of the fluid.
        before, after: its states.
        flux: mean of the volume flux between the two; None of two fluids, which carry their scalars themselves [m/s].
        steps: () int32, fluid steps.
        reversible: see `ScalarTransport.advance`; static.
        heat: that two fluids have carried; None of one fluid, and without temperatures.
        dissolved: scalars that they have carried; None of one fluid, and without.
        passed: what comes in and leaves, see `FluidDiagnostics`; None where nothing may pass [m3/s].
    """

    grid: Grid
    boundary: Boundary
    properties: FluidProperties
    before: FluidState
    after: FluidState
    flux: FaceField | None
    steps: Array
    reversible: bool
    heat: CarriedHeat | None = None
    dissolved: tuple[CarriedScalar, ...] | None = None
    passed: Array | None = None


class GrainsInFluid(NamedTuple):
    """The grains of an interval, as the fluid sees them.

    Attributes:
        weights: on the cells.
        inputs: of the drag law.
    """

    weights: Weights
    inputs: DragInputs


def phases_of(parameters: ScalarParameters, flow: FluidFlow) -> Phases:
    """Two fluids at the end of an interval."""
    after = flow.after
    fraction = required(after.liquid_fraction, "liquid_fraction of the fluid")
    return Phases(flow.grid, flow.boundary, flow.properties, parameters, fraction, or_one(after.void_fraction))


def or_one(void_fraction: Array | None) -> CellOrOne:
    """The void fraction, 1 without particles [-]."""
    return 1.0 if void_fraction is None else void_fraction

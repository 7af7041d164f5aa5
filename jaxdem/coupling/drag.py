"""The drag of a coupling interval: what the law sees, what it gives, and the coefficient that acts implicitly."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

from jax import Array

from jaxdem.closures.base import Drag, DragClosure, DragInputs
from jaxdem.closures.neighbor_effect import NeighborEffect
from jaxdem.closures.neighbors import NeighborClosure
from jaxdem.closures.shaped import ParticleShape, ShapedCorrelation
from jaxdem.coupling.coarse_inputs import CoarseInputs
from jaxdem.coupling.forces.protocol import IntervalStart
from jaxdem.coupling.inputs import deconvolved, with_wide_solids
from jaxdem.coupling.member_weights import crosswise_sphericity
from jaxdem.coupling.model_b import drag_of_model_b
from jaxdem.coupling.own_volume import with_volume_of_grain
from jaxdem.coupling.polydisperse import sauter_mean, share_of_size
from jaxdem.coupling.presence import present_drag
from jaxdem.coupling.self_disturbance import SelfDisturbance, own_solid_fraction
from jaxdem.coupling.stiff_drag import settling_coefficient
from jaxdem.coupling.surroundings import Surroundings
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.numerics.blocks import Blocks
from jaxdem.numerics.static import static
from jaxdem.particles.integrate import as_column

Law = Callable[[DragInputs], Drag]


@static
class DragModel:
    """How the drag law is applied; static.

    Attributes:
        form: of the equations, "A" or "B".
        self_disturbance: correction that gives the law the undisturbed slip, None for none.
        coarse_inputs: coarser mesh through which the law sees the fluid, None for the fluid's own.
        deconvolution: see `deconvolved`, 0 for none; without `coarse_inputs`, which have their own [-].
        surroundings: finds the neighbours that a `NeighborClosure` asks for, None for other laws.
        polydisperse: whether grains of different sizes share the drag of their mean diameter, see `polydisperse`.
        grain_volume: whether a parcel sees the volume of one grain in place of its own, see `own_volume`; without
            `coarse_inputs`, which have their own.
        wide: whether the law sees the solid fraction of three cells along every axis; without `coarse_inputs`, which
            have their own.
    """

    form: str = "A"
    self_disturbance: SelfDisturbance | None = None
    coarse_inputs: CoarseInputs | None = None
    deconvolution: float = 0.0
    surroundings: Surroundings | None = None
    polydisperse: bool = False
    grain_volume: bool = False
    wide: bool = False

    def in_blocks(self, blocks: Blocks, drift: float) -> DragModel:
        """The same in one slab of the box; `drift` is how far its particles may stand outside of it [m]."""
        coarse, around = self.coarse_inputs, self.surroundings
        if coarse is not None:
            coarse = dataclasses.replace(coarse, grid=coarse.grid.in_blocks(blocks, drift))
        if around is not None:
            around = around.in_blocks(blocks, drift)
        return dataclasses.replace(self, coarse_inputs=coarse, surroundings=around)

    def law_inputs(self, start: IntervalStart, inputs: DragInputs, fluid: FluidState, solids: Array) -> DragInputs:
        """The fluid as the law sees it.

        Args:
            start: of the interval.
            inputs: the fluid at the particles, on its own mesh.
            fluid: its state.
            solids: solid fraction of the cells [-].
        """
        if self.coarse_inputs is not None:
            return self.coarse_inputs(start.grid, fluid, solids, start.particles, start.bodies, start.properties)
        if self.wide:
            inputs = with_wide_solids(start.grid, start.weights, inputs, solids, start.properties.cut)
        if self.grain_volume:
            inputs = with_volume_of_grain(start.grid, start.weights, inputs, start.bodies, start.properties.cut)
        if self.deconvolution > 0.0:
            return deconvolved(start.grid, start.weights, inputs, start.face_velocity, self.deconvolution)
        return inputs

    def neighbors(
        self, closure: DragClosure, scale: Array, start: IntervalStart, law_inputs: DragInputs
    ) -> NeighborEffect | None:
        """What the neighbours add in the interval; None for a law that does not ask for them."""
        if self.surroundings is None or not isinstance(closure, NeighborClosure):
            return None
        return self.surroundings.effect(closure, self.form, start, law_inputs, scale)

    def law(
        self, closure: DragClosure, scale: Array, start: IntervalStart, neighbors: NeighborEffect | None = None
    ) -> Law:
        """The drag law in the form of the equations, scaled, and of the undisturbed slip if asked for.

        A law is of a grain; a parcel has the force of all its grains. What the `neighbors` add is that of the interval.
        """
        scale = start.bodies.of_all_grains(scale)
        clumps = start.bodies.clumps
        mean = sauter_mean(start) if self.polydisperse and start.bodies.grain_radius.ndim else None

        def scaled(own: DragInputs) -> Drag:
            inputs = own if mean is None else own._replace(diameter=mean)
            if clumps is not None and isinstance(closure, ShapedCorrelation):
                across = crosswise_sphericity(start.particles, clumps, inputs.slip_velocity)
                drag = closure.of_shape(inputs, ParticleShape(clumps.sphericity, across))
            else:
                drag = closure(inputs)
            if self.form == "B":
                drag = drag_of_model_b(drag, inputs.solid_fraction)
            if mean is not None:
                drag = share_of_size(drag, own, mean, self.form)
            remainder = None if drag.remainder is None else scale * drag.remainder
            if neighbors is None:
                return Drag(scale * drag.coefficient, remainder, drag.out_of_range)
            outside = drag.out_of_range | neighbors.out_of_range
            return Drag(scale * neighbors.multiple * drag.coefficient, neighbors.across, outside)

        correction, volume = self.self_disturbance, start.bodies.volume
        if correction is None:
            return scaled
        own = own_solid_fraction(start.grid, start.weights, volume, start.properties.cut)
        return lambda inputs: correction(scaled, inputs, own, volume)


class IntervalDrag(NamedTuple):
    """The drag over a coupling interval: force = coefficient (u - v) + remainder, u of the fluid's own mesh.

    Attributes:
        coefficient: (N,) implicit, see `settling_coefficient` [kg/s].
        remainder: (N, D) explicit; None for none [N].
        law: (N, D) the force that the law gave at the start of the interval [N].
        out_of_range: (N,) bool, see `Drag`.
        torque: (N, 3) that comes with the drag; None for none [N m].
        memory: of a closure of neighbours, see `NeighborEffect`; None for none.
    """

    coefficient: Array
    remainder: Array | None
    law: Array
    out_of_range: Array
    torque: Array | None = None
    memory: Array | None = None


def interval_drag(
    law: Law,
    start: IntervalStart,
    inputs: DragInputs,
    law_inputs: DragInputs,
    mass: Array,
    others: Array,
) -> IntervalDrag:
    """The drag of an interval.

    Where the law sees another velocity than that of the faces, which the coefficient acts on implicitly, the remainder
    makes up for the difference.

    Args:
        law: see `DragModel.law`.
        start: of the interval.
        inputs: the fluid at the particles, on its own mesh.
        law_inputs: the fluid as the law sees it.
        mass: () or (N,) inertia of the particles, with slip masses [kg].
        others: (N, D) all other forces on the particles [N].
    """
    drag = present_drag(law(law_inputs), start.particles.active)
    force = drag.coefficient[:, None] * law_inputs.slip_velocity
    remainder = drag.remainder
    if remainder is not None:
        others, force = others + remainder, force + remainder
    coefficient = settling_coefficient(
        lambda later: law(later).coefficient, law_inputs, drag.coefficient, mass, others, start.duration
    )
    if law_inputs is not inputs:
        offset = as_column(coefficient) * (law_inputs.fluid_velocity - inputs.fluid_velocity)
        remainder = offset if remainder is None else remainder + offset
    return IntervalDrag(coefficient, remainder, force, drag.out_of_range)

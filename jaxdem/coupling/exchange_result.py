"""What the exchange between fluid and particles gives: forces on the particles, and how exact it was."""

from __future__ import annotations

from typing import NamedTuple

from jax import Array

from jaxdem.closures.base import DragInputs
from jaxdem.coupling.forces.protocol import MeanForce
from jaxdem.fluid.grid import sum_of


class ExchangeDiagnostics(NamedTuple):
    """How exact the exchange of an interval was; all ().

    Attributes:
        momentum: |impulse of the particles + impulse of the faces| over the sum of the sizes of the terms that make
            it, K (|u| + |v|) and the known ones: what rounding must be small against, also where drag dies out.
        volume: relative error of the deposited particle volume.
        void_fraction: smallest.
        out_of_range: number of particles where the drag law's floor or fallback acted.
    """

    momentum: Array
    volume: Array
    void_fraction: Array
    out_of_range: Array


class FluidForces(NamedTuple):
    """Mean fluid forces on the particles over an interval, and what the drag law saw and gave.

    Attributes:
        drag: (N, D) [N].
        pressure_gradient: (N, D) -V_p grad p of the reduced pressure, with two fluids
            -V_p (grad p - sigma kappa grad c); zero in model B [N].
        viscous: (N, D) V_p div(tau); zero in model B [N].
        inputs: of the drag law, at the start of the interval, of the fluid's own mesh.
        law: (N, D) coefficient (u - v) + remainder as the law gave it for these inputs; f_A / g in model B [N].
        further: means of the further forces by their names.
        torque: (N, A) of the fluid; None without any [N m].
        memory: what a closure of neighbours holds for later intervals; None for nothing.
    """

    drag: Array
    pressure_gradient: Array
    viscous: Array
    inputs: DragInputs
    law: Array
    further: dict[str, MeanForce]
    torque: Array | None
    memory: Array | None = None

    @property
    def total(self) -> Array:
        """(N, D) sum [N], without forces that are inertia of the body and without hydrostatic buoyancy."""
        more = (mean.given for mean in self.further.values() if mean.drive is None)
        return sum_of((self.drag, self.pressure_gradient, self.viscous, *more))

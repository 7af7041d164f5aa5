"""Drag in mixtures of sizes: a law of equal grains at the local mean diameter, shared out among the sizes.

In a mixture of solid fraction s and void fraction g, with the Sauter mean <d> = sum V / sum (V / d) and y = d / <d>,
the whole force of the fluid on a grain, the mean pressure gradient's included, is 3 pi mu d U (g y + s y^2) F, where F
is that of equal grains of diameter <d> at the same s and the Reynolds number of <d>. The pressure gradient acts on a
grain's volume: that is the term in y^2, and the other is the drag of model A,

    f_A = 3 pi mu d y F_A(s, Re of <d>) (u - v),      f_B = 3 pi mu d (g y + s y^2) F_B (u - v),  F_B = F_A / g.

The sum over the sizes is the force on the solids of equal grains of <d> in either model: the share s_i of the solids
has F_i / y_i^2, and sum s_i (g / y_i + s) = s. Grains of one size have the law itself.

The authors propose a further term 0.064 g y^3 for the larger grains of wide mixtures. It is left out: with it the sum
would exceed the law of which it is made, and equal grains would have 1.064 times their drag.

Source: M. A. van der Hoef, R. Beetstra, J. A. M. Kuipers, J. Fluid Mech. 528 (2005) 233-254; R. Beetstra, M. A. van der
Hoef, J. A. M. Kuipers, AIChE J. 53 (2007) 489-501, and for model A their erratum, AIChE J. 53 (2007) 3020.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.closures.base import Drag, DragInputs
from jaxdem.coupling.forces.protocol import IntervalStart
from jaxdem.coupling.interpolation import deposit, interpolate
from jaxdem.particles.integrate import as_column


def sauter_mean(start: IntervalStart) -> Array:
    """(N,) mean diameter sum V / sum (V / d) of the grains around each particle, by the kernel's weights [m].

    It lies between the smallest and the largest diameter, for the weights are not negative.
    """
    bodies = start.bodies
    count = start.particles.position.shape[0]
    diameter = jnp.broadcast_to(2.0 * bodies.grain_radius, (count,))
    volume = jnp.broadcast_to(bodies.volume, (count,)) / start.grid.cell_volume
    fields = tuple(deposit(start.grid, start.weights, quantity) for quantity in (volume, volume / diameter))
    solids, surface = jnp.moveaxis(interpolate(start.weights, fields), 1, 0)
    there = (solids > 0) & (surface > 0)
    return jnp.where(there, jnp.where(there, solids, 1.0) / jnp.where(there, surface, 1.0), diameter)


def share_of_size(drag: Drag, inputs: DragInputs, mean: Array, form: str) -> Drag:
    """The drag of grains of their own diameters, of what the law gives at the mean diameter.

    Args:
        drag: of the law, 3 pi mu <d> F in its coefficient, in the form of the equations.
        inputs: with the grains' own diameters.
        mean: (N,) mean diameter [m].
        form: of the equations, "A" or "B".
    """
    ratio = inputs.diameter / mean
    share = ratio**2
    if form == "B":
        solids = jnp.clip(inputs.solid_fraction, 0.0, 1.0)
        share = share * (1.0 - solids + solids * ratio)
    remainder = None if drag.remainder is None else as_column(share) * drag.remainder
    return Drag(share * drag.coefficient, remainder, drag.out_of_range)

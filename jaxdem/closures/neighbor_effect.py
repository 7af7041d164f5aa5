"""What the neighbours of the particles add to the drag law, in newtons, in both models of the equations."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.closures.base import DragInputs
from jaxdem.closures.correlation import Correlation
from jaxdem.closures.neighbor_places import Frame
from jaxdem.closures.neighbor_range import DENSEST
from jaxdem.closures.neighbors import Response, positive_multiple


class NeighborEffect(NamedTuple):
    """What the neighbours do to each particle, constant over the interval.

    Attributes:
        multiple: (N,) of the mean law's drag coefficient, positive [-].
        across: (N, 3) force across the slip [N].
        torque: (N, 3) [N m].
        out_of_range: (N,) bool, less than half of the fluctuation acts, or there was no room for the neighbours.
        memory: (N, 9) what is held for later intervals; None for nothing.
    """

    multiple: Array
    across: Array
    torque: Array
    out_of_range: Array
    memory: Array | None = None


def neighbor_effect(
    base: Correlation, form: str, found: Response, frame: Frame, inputs: DragInputs, scale: Array | float = 1.0
) -> NeighborEffect:
    """Multiple of the mean drag, force across the slip, and torque.

    With r the fluctuation along the slip over the mean force of the whole fluid F, and g the void fraction: the mean
    drag of model A is g F, the rest of F is the mean pressure gradient, the same for all particles. So the multiple is
    1 + r/g in model A and 1 + r in model B. The forces across and the torques are those of F in both.

    Args:
        base: mean law, of model A.
        form: of the equations, "A" or "B".
        found: from `fluctuation`.
        frame: of each particle.
        inputs: of the drag law.
        scale: () factor on the drag [-].
    """
    void_fraction = 1.0 - jnp.clip(inputs.solid_fraction, 0.0, DENSEST)
    mean = scale * base(inputs).coefficient * inputs.slip_speed / void_fraction
    first, second, third = frame
    across = found.across[:, :1] * second + found.across[:, 1:] * third
    torque = found.torque[:, :1] * first + found.torque[:, 1:2] * second + found.torque[:, 2:] * third
    share = found.along / void_fraction if form == "A" else found.along
    outside = found.weight < 0.5
    return NeighborEffect(
        positive_multiple(1.0 + share), mean[:, None] * across, (mean * inputs.diameter)[:, None] * torque, outside
    )

"""How far a wall that a force holds may go before it meets another wall."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.numerics.static import static
from jaxdem.particles.moving_walls import PistonState


@static
class PistonTravel:
    """The ends of the ways of H pistons, K of them: a piston is at one where sum_h rates_h s_h >= most, s its
    displacement; static.

    Attributes:
        rates: K rows of H numbers [-].
        most: K numbers [m].
        pistons: H numbers of their walls of the scene.
        names: K pairs, number of the wall of the scene that is the piston, and what it meets there, in words.
    """

    rates: tuple[tuple[float, ...], ...]
    most: tuple[float, ...]
    pistons: tuple[int, ...]
    names: tuple[tuple[int, str], ...]

    def met(self, pistons: PistonState) -> Array:
        """(K,) bool, ends that are reached."""
        way = pistons.displacement
        return jnp.asarray(np.asarray(self.rates), way.dtype) @ way >= jnp.asarray(self.most, way.dtype)

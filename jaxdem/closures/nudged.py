"""A drag law with what draws a run to another one, for `jaxdem.train.nudged`."""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.closures.base import Drag, DragClosure, DragInputs


@partial(jax.tree_util.register_dataclass, data_fields=["base", "factor", "stiffness", "slip", "push"], meta_fields=[])
@dataclasses.dataclass(frozen=True, eq=False)
class NudgedDrag:
    """k c w + s c (w - w_r) + f, with the force c w of a law for the slip w.

    The gas loses what the grains get, as with every drag law. The first two terms are implicit in the slip.

    Attributes:
        base: the law that gives c.
        factor: () k [-].
        stiffness: () s [-].
        slip: (N, D) w_r [m/s].
        push: (N, D) f [N].
    """

    base: DragClosure
    factor: Array
    stiffness: Array
    slip: Array
    push: Array

    sees_wide = True
    """So that samples have the wide solid fraction, see `jaxdem.closures.base.sees_wide`."""

    @classmethod
    def of(cls, base: DragClosure, particles: int, dimension: int, dtype: Any = jnp.float32) -> NudgedDrag:
        """The law itself, in a form that can be nudged: for `jaxdem.build`."""
        rows = jnp.zeros((particles, dimension), dtype)
        return cls(base, jnp.ones((), dtype), jnp.zeros((), dtype), rows, rows)

    def __call__(self, inputs: DragInputs) -> Drag:
        """Drag for every particle."""
        drag = self.base(inputs)
        own = drag.coefficient
        remainder = self.push - (self.stiffness * own)[:, None] * self.slip
        if drag.remainder is not None:
            remainder = remainder + self.factor * drag.remainder
        return Drag((self.factor + self.stiffness) * own, remainder, drag.out_of_range)

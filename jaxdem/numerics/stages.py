"""Stages of a step: parts that are left out while nothing needs them, and whose results are written to memory.

XLA:CPU fuses whatever it can into the loop that consumes it, and computes it anew in each of them: the force of a
wall once for every component of every sum, in loops of gathers that are not vectorised. A branch of a conditional is
where its fusion ends. (`lax.optimization_barrier` is taken away before fusion.)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import jax
from jax import Array, lax

from jaxdem.numerics.batches import in_any
from jaxdem.numerics.shapes import with_shapes, zeros_of

Result = TypeVar("Result")


def stage(needed: Array, compute: Callable[[], Result]) -> Result:
    """What `compute` gives; where it is not needed, and it must then be zero, zeros of its shapes.

    Args:
        needed: () bool; in a batch of scenes all are computed where one needs it.
        compute: a function of no arguments, which gives a pytree of arrays.
    """
    computed, shapes = with_shapes(compute)

    def on_cpu() -> Result:
        found: Result = lax.cond(in_any(needed), computed, lambda: zeros_of(shapes()))
        return found

    if jax.default_backend() == "cpu":  # without the other platforms' branch, which would be traced too
        return on_cpu()
    # Elsewhere a branch makes the host wait for the device, and fusion is not what limits.
    return lax.platform_dependent(cpu=on_cpu, default=compute)

"""The coupling interval of a fluid that another program solves."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.fluid.fluid_state import FluidProperties, FluidState
from jaxdem.fluid.interval import FluidInterval, Substeps
from jaxdem.numerics.static import static


@static
class ExternalInterval(FluidInterval):
    """An interval over which the other program takes the fluid, in as many steps as it likes; here it is one."""

    def choose(self, properties: FluidProperties, state: FluidState, time: Array) -> Substeps:
        """One step of the length of the interval; its Courant and viscosity numbers are not known here."""
        duration = jnp.asarray(self.duration, properties.density.dtype)
        unknown = jnp.zeros_like(duration)
        return Substeps(jnp.ones((), jnp.int32), duration, unknown, unknown)

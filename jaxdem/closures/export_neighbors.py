"""A closure of neighbours as StableHLO: of all spheres at once, for what each neighbour feels matters to the others."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import Array, export

from jaxdem.closures.base import DragInputs
from jaxdem.closures.export_stablehlo import LOCATION, without_source_lines
from jaxdem.closures.neighbor_effect import neighbor_effect
from jaxdem.closures.neighbor_places import Places, axes_along, fluctuation
from jaxdem.closures.neighbors import NeighborClosure


def neighbor_module(closure: NeighborClosure) -> tuple[bytes, str]:
    """The closure for any number of spheres and of slots: (artifact, text of the module), as `stablehlo_module`.

    The arguments, all float32 but `others`, of N spheres with K slots for neighbours within the reach:
        centres (N, 3) [m]; others (N, K) int32, the neighbours of each sphere, itself in an empty slot;
        slip (N, 3), interstitial velocity of the fluid less that of the sphere [m/s]; solid_fraction (N,) [-];
        diameter (N,) [m]; period (3,), lengths of the box, 0 for a side that is not periodic [m];
        fluid_density () [kg/m3]; dynamic_viscosity () [Pa s].
    The results, in model A: coefficient (N,) of the drag along the slip [kg/s], force across it (N, 3) [N], torque
    (N, 3) [N m], and whether less than half of the fluctuation acts (N,) bool.
    """
    count, slots = export.symbolic_shape("spheres, slots")

    def drag(*values: Array) -> tuple[Array, ...]:
        centres, others, slip, solid_fraction, diameter, period, density, viscosity = values
        none = jnp.zeros_like(slip)
        inputs = DragInputs(none, slip, solid_fraction, none, none, diameter, diameter, density, viscosity)
        frame = axes_along(slip)
        places = Places(centres, others, diameter, period)
        found = fluctuation(closure, places, frame, inputs.reynolds, solid_fraction)
        effect = neighbor_effect(closure.base, "A", found, frame, inputs)
        law = closure.base(inputs)
        outside = effect.out_of_range | law.out_of_range
        return effect.multiple * law.coefficient, effect.across, effect.torque, outside

    def real(*sizes: object) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct(sizes, jnp.float32)

    index = jax.ShapeDtypeStruct((count, slots), jnp.int32)
    shapes = (real(count, 3), index, real(count, 3), real(count), real(count), real(3), real(), real())
    anywhere = [export.DisabledSafetyCheck.platform()]
    with without_source_lines():
        exported = export.export(jax.jit(drag), platforms=("cpu",), disabled_checks=anywhere)(*shapes)
    return bytes(exported.serialize()), LOCATION.sub("", exported.mlir_module())

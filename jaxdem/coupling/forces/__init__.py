"""The further forces of the fluid on the particles: one file each, one class, `FluidForce`.

A new force is a file here and an entry in `FORCES`.
"""

from jaxdem.coupling.forces.basset import Basset
from jaxdem.coupling.forces.lift import Magnus, SaffmanMei
from jaxdem.coupling.forces.protocol import Contribution, FluidForce, IntervalEnd, IntervalStart, MeanForce
from jaxdem.coupling.forces.rotation import RotationalDrag
from jaxdem.coupling.forces.virtual_mass import VirtualMass

FORCES: tuple[type[FluidForce], ...] = (SaffmanMei, Magnus, RotationalDrag, VirtualMass, Basset)
"""All that there are."""

__all__ = [
    "FORCES",
    "Basset",
    "Contribution",
    "FluidForce",
    "IntervalEnd",
    "IntervalStart",
    "Magnus",
    "MeanForce",
    "RotationalDrag",
    "SaffmanMei",
    "VirtualMass",
]

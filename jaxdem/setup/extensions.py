"""Parts that a program of the user gives to `jaxdem.build` and `jaxdem.simulate` in place of, or beside, the scene's.

They are keyword arguments of both, typed and described once, here. A part that is not given is that of the scene.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypedDict

from jax import Array

from jaxdem.coupling.forces.protocol import FluidForce
from jaxdem.fluid.inlet import InletProfile
from jaxdem.fluid.side_conditions import SideCondition
from jaxdem.fluid.subgrid_stress import SubgridLaw
from jaxdem.particles.cohesion import Cohesion
from jaxdem.particles.contact import ContactLaw
from jaxdem.scalars.nusselt import NusseltLaw


class Extensions(TypedDict, total=False):
    """Keyword arguments of `jaxdem.build` and `jaxdem.simulate`; None stands for one that is not given.

    Attributes:
        walls: signed distances x (D,) [m] -> () [m], positive where particles may be, of walls beside those of
            the scene; see `jaxdem.particles.surfaces.DistanceFunction`.
        contact_law: to use instead of the scene's `contact.law`. The limits of the contact step and the overlap
            stay those of the scene's law: name there the one that is most like it, or stiffer.
        cohesion: to use instead of the kind of the scene's `[contact.cohesion]`, whose numbers it is given. The reach
            of the neighbour list and the limits stay those of that kind: name there the one that is most like it.
        forces: of the fluid on the particles, beside those of the scene; see
            `jaxdem.coupling.forces.protocol.FluidForce`. Not with `[surface]`.
        inlet_profiles: by the side's name, one for each of its other axes or None where it is even, instead of the
            scene's `boundary.<side>.profile`; see `jaxdem.fluid.inlet.InletProfile`. The automatic fluid step
            takes them for even; a faster flow is met by sub-steps, or by a flag.
        subgrid: closure of the subgrid stress to use instead of the scene's `fluid.subgrid`. It goes into the
            parameters, and one may differentiate by its weights.
        side_conditions: by the side's name, what the fluid does there instead of what the scene's
            `boundary.<side>.kind` says; see `jaxdem.fluid.side_conditions.SideCondition`. Checks of the scene and
            limits of the fluid step are those of the kind: name there the one that is most like it.
        nusselt: law of heat transfer between grains and fluid, to use instead of the scene's `heat.exchange`; see
            `jaxdem.scalars.nusselt.NusseltLaw`.
    """

    walls: Sequence[Callable[[Array], Array]] | None
    contact_law: ContactLaw | None
    cohesion: Cohesion | None
    forces: Sequence[FluidForce] | None
    inlet_profiles: Mapping[str, Sequence[InletProfile | None]] | None
    subgrid: SubgridLaw | None
    side_conditions: Mapping[str, SideCondition] | None
    nusselt: NusseltLaw | None


def has_models(extensions: Extensions) -> bool:
    """Whether something stands in place of a model of the scene: walls and forces are beside it."""
    return any(part is not None for name, part in extensions.items() if name not in ("walls", "forces"))

"""What `jaxdem check` says of temperatures and other scalars. Host side."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxdem.check.engineering import Number
from jaxdem.fluid.dissolved import Phase
from jaxdem.scalars.nusselt import NUSSELT_LAWS
from jaxdem.scalars.scalars import TEMPERATURE
from jaxdem.scene import Scene
from jaxdem.setup.boundaries import boundary_speed
from jaxdem.setup.builder import Case
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters

UNEVEN = 0.1
"""Biot number from which a grain has no longer one temperature [-]."""


PLACES: dict[Phase, str] = {"liquid": "the liquid", "second": "the second fluid", "both": "both fluids"}
"""Where a scalar is dissolved."""


def heat_numbers(case: Case) -> tuple[Number, ...]:
    """Prandtl number of the fluid; Nusselt number, time of warming and Biot number of a grain alone at the largest
    speed that a boundary imposes. None without temperatures."""
    scene, grains = case.scene, case.grains
    heat, fluid = scene.heat, scene.fluid
    if heat is None or fluid is None or heat.fluid_heat_capacity is None or heat.fluid_conductivity is None:
        return ()
    prandtl = fluid.density * fluid.viscosity * heat.fluid_heat_capacity / heat.fluid_conductivity
    found = [Number("Prandtl number", prandtl, prandtl, "-", "of the fluid")]
    if grains.radius.size == 0 or heat.particle_heat_capacity is None or heat.exchange == "none":
        return tuple(found)
    law: Any = NUSSELT_LAWS[heat.exchange]  # numbers of the host will do
    sizes = (2.0 * grains.smallest_radius, grains.largest_diameter)
    reynolds = [np.float64(boundary_speed(scene) * size / fluid.viscosity) for size in sizes]
    nusselt = [float(law(number, np.float64(prandtl), 1.0)) for number in reynolds]
    note = "of a grain alone at the speed of the boundary"
    found.append(Number("Nusselt number", nusselt[0], nusselt[1], "-", note))
    capacity = float(grains.density.max()) * heat.particle_heat_capacity
    times = [capacity * d**2 / (6.0 * nu * heat.fluid_conductivity) for d, nu in zip(sizes, nusselt, strict=True)]
    found.append(Number("  time of warming", times[0], times[1], "s", "rho c d^2 / (6 Nu k)"))
    if heat.particle_conductivity is not None:
        share = heat.fluid_conductivity / (6.0 * heat.particle_conductivity)
        biot = [nu * share for nu in nusselt]
        note = "Nu k / (6 k_p): a grain has one temperature"
        if max(biot) > UNEVEN:
            note = f"above {UNEVEN:g}: a grain is warmer outside than inside, which is not computed"
        found.append(Number("  Biot number", biot[0], biot[1], "-", note))
    return tuple(found)


def scalar_parts(scene: Scene, simulation: Simulation, parameters: Parameters) -> list[tuple[str, bool]]:
    """Temperatures, what they do, and what else the fluid carries."""
    scalars = simulation.scalars
    heat = None if scalars is None else scalars.heat
    others = () if scalars is None else tuple(f.name for f in scalars.fields if f.name != TEMPERATURE)
    if scalars is not None and scene.surface is not None:
        others = tuple(f"{f.name} in {PLACES[f.phase]}" for f in scalars.fields if f.name != TEMPERATURE)
    carried = [(f"scalars {', '.join(others)}" if others else "scalars in the fluid", bool(others))]
    if heat is None:
        return [("temperatures", False), *(carried if simulation.fluid is not None else [])]
    law = "" if heat.exchange is None else f" by {_name_of(heat.exchange)}"
    return [
        ("temperatures", True),
        (f"heat exchange of grains and fluid{law}", heat.exchange is not None),
        ("conduction through contacts", heat.conduction is not None),
        ("buoyancy of warm fluid", heat.expands),
        ("heat of friction", simulation.contact is not None and simulation.contact.model.heats),
        *carried,
    ]


def _name_of(law: object) -> str:
    return getattr(law, "__name__", type(law).__name__)

"""What does not work on several devices, refused by name before work starts; what cannot be cut is in `cut`."""

from __future__ import annotations

from collections.abc import Mapping

from jaxdem.errors import InputError
from jaxdem.simulation import Simulation


def require_divisible(simulation: Simulation) -> None:
    """Refuses a simulation with something that does not work on several devices.

    Raises:
        InputError: naming it.
    """
    found = None
    coupling, contact = simulation.coupling, simulation.contact
    if contact is not None and contact.search is not None and contact.search.members > 1:
        found = "particles.shape", "a clump", "with clumps, whose members a slab would have to know with their bodies"
    elif contact is not None and contact.model.energy:
        found = "output.energy", "true", "with a balance of energy"
    elif contact is not None and contact.model.bonds is not None:
        found = "bonds", "...", "with bonds between particles"
    elif simulation.fluid is not None and simulation.fluid.solver.surfaces:
        found = "walls", "fluid", "with walls that the fluid sees"
    elif simulation.scalars is not None:
        found = "heat", "[heat] or [[scalars]]", "with temperatures and other scalars"
    elif coupling is not None and coupling.drag.surroundings is not None:
        # They are farther away than the neighbouring slab's particles that a slab knows.
        found = "closure.file", "a closure of neighbours", "with a drag law that looks at the neighbours of a particle"
    if found is not None:
        key, value, what = found
        raise InputError(key, value, f"several devices do not work {what}", "run it on one device")


def require_plain_run(asked: Mapping[str, tuple[bool, object, str]]) -> None:
    """Refuses what a run does beside its steps, and cannot do on several devices.

    Args:
        asked: by key or option, whether the run asks for it, its value, and a remedy.

    Raises:
        InputError: it asks for one.
    """
    for key, (given, value, remedy) in asked.items():
        if given:
            limit = "does not work on several devices yet"
            raise InputError(key, value, limit, f"{remedy}, or run on one device")

"""What does not work on several devices, refused by name before work starts."""

from __future__ import annotations

from jaxdem.errors import InputError
from jaxdem.simulation import Simulation


def require_divisible(simulation: Simulation) -> None:
    """Refuses a simulation with something that does not work on several devices.

    Raises:
        InputError: naming it.
    """
    found = None
    if simulation.contact is None:
        found = "particles", "none", "without particles"
    elif simulation.fluid is not None:
        found = "fluid", "given", "with a fluid"
    elif simulation.population is not None:
        found = "particles.inlet", "given", "with particles that come in or leave"
    if found is not None:
        key, value, what = found
        raise InputError(key, value, f"several devices do not work {what} yet", "run it on one device")

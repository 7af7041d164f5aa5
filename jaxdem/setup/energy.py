"""What the balance of energy does not work with, refused by name before work starts."""

from __future__ import annotations

from jaxdem.errors import InputError
from jaxdem.particles.cohesion_energy import has_energy
from jaxdem.particles.contact import StoringLaw
from jaxdem.particles.contact_model import ContactModel
from jaxdem.scene import Scene


def check_energy(scene: Scene, model: ContactModel) -> None:
    """Refuses a balance of energy, or heat of friction, of a scene with something whose energy is not known.

    Raises:
        InputError: naming it.
    """
    found = None
    if not model.energy:
        return
    if not isinstance(model.law, StoringLaw):
        found = "a contact law that does not say what its springs store (jaxdem.particles.contact.StoringLaw)"
    elif not has_energy(model.cohesion):
        found = "a cohesion of the user's, whose energy is not known"
    if found is not None:
        key = "heat.friction" if model.heats else "output.energy"
        raise InputError(key, True, f"does not work with {found}", f"set {key} = false")

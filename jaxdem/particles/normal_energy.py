"""What contacts store along their normals: in the springs of the contact law, and by cohesion."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.cohesion_energy import cohesion_energy
from jaxdem.particles.contact import ContactMaterial, StoringLaw
from jaxdem.particles.contact_load import gap_of
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_pair import ContactPair


def normal_energy(
    model: ContactModel, pair: ContactPair, material: ContactMaterial, memory: Vector, law_overlap: Array
) -> tuple[Array, Array]:
    """Energy of every contact: of the material, and of the surfaces or the liquid [J].

    Args:
        model: laws; static.
        pair: the contacts.
        material: their constants.
        memory: what cohesion remembers.
        law_overlap: that the contact law is evaluated at, 0 where nothing touches [m].
    """
    law = model.law
    if not isinstance(law, StoringLaw):  # refused before
        raise TypeError("the contact law does not say what its springs store")
    normal = law.energy(law_overlap, pair.effective_radius, material)
    if model.cohesion is None:
        return normal, jnp.zeros_like(law_overlap)
    beside = cohesion_energy(model.cohesion, gap_of(pair, material), required(material.cohesion, "cohesion"), memory)
    return normal + beside.elastic, beside.surface

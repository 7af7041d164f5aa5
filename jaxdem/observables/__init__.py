"""Quantities of a state, pure and differentiable: flows through planes, profiles over boxes, values at points."""

from jaxdem.observables.boxes import Boxes, slices
from jaxdem.observables.contacts import Contacts, contacts
from jaxdem.observables.flow import FluidFlow, ParticleFlow, Plane, fluid_flow, particle_flow
from jaxdem.observables.point import FluidAt, fluid_at
from jaxdem.observables.profile import FluidProfile, ParticleProfile, fluid_profile, particle_profile

__all__ = [
    "Boxes",
    "Contacts",
    "FluidAt",
    "FluidFlow",
    "FluidProfile",
    "ParticleFlow",
    "ParticleProfile",
    "Plane",
    "contacts",
    "fluid_at",
    "fluid_flow",
    "fluid_profile",
    "particle_flow",
    "particle_profile",
    "slices",
]

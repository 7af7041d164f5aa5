"""Quantities of a state, pure and differentiable: flows through planes, profiles over boxes, values at points."""

from jaxdem.observables.contacts import Contacts, contacts
from jaxdem.observables.flow import FluidFlow, ParticleFlow, Plane, fluid_flow, particle_flow

__all__ = ["Contacts", "FluidFlow", "ParticleFlow", "Plane", "contacts", "fluid_flow", "particle_flow"]

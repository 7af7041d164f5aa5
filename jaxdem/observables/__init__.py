"""Quantities of a state, pure and differentiable: flows through planes, profiles over boxes, values at points."""

from jaxdem.observables.boxes import Boxes, slices
from jaxdem.observables.contact_table import ContactTable, contact_rows, contact_table
from jaxdem.observables.contacts import Contacts, contacts
from jaxdem.observables.flow import FluidFlow, ParticleFlow, Plane, fluid_flow, particle_flow
from jaxdem.observables.point import FluidAt, fluid_at
from jaxdem.observables.profile import FluidProfile, ParticleProfile, fluid_profile, particle_profile
from jaxdem.observables.walls import (
    WallLoad,
    fluid_force,
    fluid_torque,
    measuring_walls,
    side_walls,
    surface_walls,
    wall_load,
)

__all__ = [
    "Boxes",
    "ContactTable",
    "Contacts",
    "FluidAt",
    "FluidFlow",
    "FluidProfile",
    "ParticleFlow",
    "ParticleProfile",
    "Plane",
    "WallLoad",
    "contact_rows",
    "contact_table",
    "contacts",
    "fluid_at",
    "fluid_flow",
    "fluid_force",
    "fluid_profile",
    "fluid_torque",
    "measuring_walls",
    "particle_flow",
    "particle_profile",
    "side_walls",
    "slices",
    "surface_walls",
    "wall_load",
]

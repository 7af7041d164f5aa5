"""The numbers of contacts that are traced: constants of the materials, of cohesion, and of the liquid in gaps."""

from __future__ import annotations

from typing import Any, cast

from jaxdem.particles.lubrication import LubricationConstants
from jaxdem.particles.materials import CohesionParameters, ContactParameters, MaterialNumbers, SeveralMaterials
from jaxdem.scene import Contact
from jaxdem.setup.as_arrays import AsArrays
from jaxdem.setup.cohesion import largest_volume
from jaxdem.setup.materials import MaterialTable
from jaxdem.setup.parcels import impact_loss, share_of_sphere
from jaxdem.setup.particles import ParticleSetup


def contact_numbers(particles: ParticleSetup, number: AsArrays) -> ContactParameters | SeveralMaterials:
    """All numbers of the contacts of a scene's particles."""
    share = share_of_sphere(particles.table.coarse_grain, particles.scene.dimension)
    constants = _constants(particles.contact, particles.materials, number, share)
    if isinstance(constants, ContactParameters):
        constants = constants._replace(impact_loss=number.optional(impact_loss(particles.scene)))
    return constants._replace(
        cohesion=_cohesion(particles, number), lubrication=_lubrication(particles.contact, number)
    )


def _constants(
    contact: Contact, table: MaterialTable | None, number: AsArrays, share: float
) -> ContactParameters | SeveralMaterials:
    """The constants of contacts, with moduli and stiffnesses times `share`, see `share_of_sphere`."""

    def stiff(value: float | str | None) -> float | str | None:
        return share * value if isinstance(value, float) else value

    normal, tangential = number(stiff(contact.normal_stiffness)), number.optional(stiff(contact.tangential_stiffness))
    if table is None:
        return ContactParameters(
            young_modulus=number(stiff(contact.young_modulus)),
            poisson_ratio=number(contact.poisson_ratio),
            restitution=number(contact.restitution),
            friction=number(contact.friction),
            rolling_friction=number(contact.rolling_friction),
            rolling_damping=number(contact.rolling_damping),
            wall_young_modulus=number.optional(stiff(contact.wall_young_modulus)),
            wall_poisson_ratio=number.optional(contact.wall_poisson_ratio),
            wall_friction=number.optional(contact.wall_friction),
            normal_stiffness=normal,
            tangential_stiffness=tangential,
        )
    given = {name: values for name, (values, _) in table.given.items()}
    given["young_modulus"] = share * given["young_modulus"]
    return SeveralMaterials(
        **cast(Any, {name: number(values) for name, values in given.items() if name != "cohesion"}),
        rolling_damping=number(contact.rolling_damping),
        normal_stiffness=normal,
        tangential_stiffness=tangential,
        numbers=MaterialNumbers(**{name: mixing for name, (_, mixing) in table.given.items()}),
        cohesion=None,
    )


def _lubrication(contact: Contact, number: AsArrays) -> LubricationConstants | None:
    """The numbers of the liquid in gaps; None without."""
    table = contact.lubrication
    if table is None:
        return None
    own = number.optional(table.wet_friction), number.optional(table.sommerfeld_number)
    return LubricationConstants(number.optional(table.viscosity), number(table.roughness), number(table.cutoff), *own)


def _cohesion(particles: ParticleSetup, number: AsArrays) -> CohesionParameters | None:
    """The numbers of the cohesion; None without."""
    table, materials = particles.contact.cohesion, particles.materials
    if table is None:
        return None
    largest = None if table.liquid_content is None else number(table.liquid_content * largest_volume(particles))
    return CohesionParameters(
        strength=number(table.strength if materials is None else materials.given["cohesion"][0]),
        wall_factor=number(table.wall_factor) if materials is None else None,
        minimum_gap=number.optional(table.minimum_gap),
        cutoff=number.optional(table.cutoff),
        contact_angle=number.optional(table.contact_angle),
        liquid_viscosity=number(table.liquid_viscosity) if table.liquid_viscosity > 0.0 else None,
        bridge_share=number.optional(table.bridge_share),
        largest_film=largest,
    )

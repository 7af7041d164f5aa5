"""Effective constants of contacts from the constants of the materials."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics.static import static
from jaxdem.particles.cohesion import CohesionConstants
from jaxdem.particles.contact import ContactMaterial
from jaxdem.particles.contact_step import Surroundings
from jaxdem.particles.lubrication import LubricationConstants
from jaxdem.particles.mixing import Mixing, of_materials, of_pairs

TANGENTIAL_SHARE = 2.0 / 7.0
"""Tangential over normal stiffness of the linear law where the scene gives only the normal one [-]."""


class CohesionParameters(NamedTuple):
    """Numbers of the cohesion of a scene; traced. None for those that its kind does not use.

    Attributes:
        strength: () between particles, or the (G,) numbers of `SeveralMaterials`; see `CohesionConstants`.
        wall_factor: () strength at walls over that between particles; None with several materials [-].
        minimum_gap, cutoff, contact_angle, liquid_viscosity, bridge_share, largest_film: see `CohesionConstants`.
    """

    strength: Array
    wall_factor: Array | None = None
    minimum_gap: Array | None = None
    cutoff: Array | None = None
    contact_angle: Array | None = None
    liquid_viscosity: Array | None = None
    bridge_share: Array | None = None
    largest_film: Array | None = None

    def constants(self, strength: Array) -> CohesionConstants:
        """Of contacts of this strength."""
        shared = {name: value for name, value in self._asdict().items() if name in CohesionConstants._fields}
        return CohesionConstants(**(shared | {"strength": strength}))


class ContactParameters(NamedTuple):
    """Constants of the particles and of the walls; each () and traced.

    Every number that a scene gives is one of them; None follows the particles' constant, so that a derivative by that
    one counts everywhere that it acts.

    Attributes:
        young_modulus: of the particles [Pa].
        poisson_ratio: of the particles [-].
        restitution: [-].
        friction: between particles [-].
        rolling_friction: [-].
        rolling_damping: of the rolling spring over critical [-].
        wall_young_modulus: infinite for a rigid wall; None: `young_modulus` [Pa].
        wall_poisson_ratio: None: `poisson_ratio` [-].
        wall_friction: between particles and walls; None: `friction` [-].
        normal_stiffness: of the linear law [N/m].
        tangential_stiffness: of the linear law; None: 2/7 of `normal_stiffness` [N/m].
        cohesion: of the particles; None without.
        lubrication: of the liquid between bodies; None without.
        impact_loss: factor on 1 - e^2 of impacts between particles, e the restitution; None for 1 [-].
    """

    young_modulus: Array
    poisson_ratio: Array
    restitution: Array
    friction: Array
    rolling_friction: Array
    rolling_damping: Array
    wall_young_modulus: Array | None
    wall_poisson_ratio: Array | None
    wall_friction: Array | None
    normal_stiffness: Array
    tangential_stiffness: Array | None
    cohesion: CohesionParameters | None = None
    lubrication: LubricationConstants | None = None
    impact_loss: Array | None = None

    @property
    def pair_restitution(self) -> Array:
        """Restitution of impacts between particles [-]."""
        if self.impact_loss is None:
            return self.restitution
        return jnp.sqrt(1.0 - self.impact_loss * (1.0 - self.restitution**2))


@static
class MaterialNumbers:
    """Which numbers of `SeveralMaterials` the constants of materials and pairs are made of; static."""

    young_modulus: Mixing
    poisson_ratio: Mixing
    restitution: Mixing
    friction: Mixing
    rolling_friction: Mixing
    cohesion: Mixing | None = None


class SeveralMaterials(NamedTuple):
    """Constants of several materials and of their pairs, as the scene gives them; traced.

    A column has the G numbers that the scene gives of it, in the order of `numbers.<name>.keys`, such as
    ("contact.friction", "materials.1.friction", "material_pairs.0.friction"). What is not given follows what is, so
    that each number stands once. Which contact is of which pair: `MaterialIndex`.

    Attributes:
        young_modulus: (G,) infinite for a rigid wall [Pa].
        poisson_ratio: (G,) [-].
        restitution: (G,) [-].
        friction: (G,) [-].
        rolling_friction: (G,) [-].
        rolling_damping: () of the rolling spring over critical [-].
        normal_stiffness: () of the linear law [N/m].
        tangential_stiffness: () of the linear law; None: 2/7 of `normal_stiffness` [N/m].
        numbers: static, which of them is whose.
        cohesion: its `strength` is such a column too; None without.
        lubrication: of the liquid between bodies, the same for all pairs; None without.
    """

    young_modulus: Array
    poisson_ratio: Array
    restitution: Array
    friction: Array
    rolling_friction: Array
    rolling_damping: Array
    normal_stiffness: Array
    tangential_stiffness: Array | None
    numbers: MaterialNumbers
    cohesion: CohesionParameters | None = None
    lubrication: LubricationConstants | None = None


def needs_liquid(parameters: ContactParameters | SeveralMaterials) -> bool:
    """Whether there is lubrication by the scene's fluid, whose viscosity it is still to be given."""
    return parameters.lubrication is not None and parameters.lubrication.viscosity is None


def with_liquid(
    parameters: ContactParameters | SeveralMaterials, viscosity: Array
) -> ContactParameters | SeveralMaterials:
    """The same with the dynamic viscosity of the liquid between bodies [Pa s]."""
    film = required(parameters.lubrication, "lubrication")._replace(viscosity=viscosity)
    if isinstance(parameters, ContactParameters):
        return parameters._replace(lubrication=film)
    return parameters._replace(lubrication=film)


def surroundings(parameters: ContactParameters | SeveralMaterials, wall_velocity: tuple[Array, ...]) -> Surroundings:
    """Materials of the contacts between particles, and between particles and walls.

    1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2 and 1/G* = (2 - nu1)/G1 + (2 - nu2)/G2 with
    G = E / (2 (1 + nu)). A body of infinite modulus adds nothing to either sum.

    With several materials both are (P,) tables, the same for particles and walls.

    Source: K. L. Johnson, Contact Mechanics (1985), eqs 3.41 and 7.42.
    """
    across = parameters.tangential_stiffness
    shared: dict[str, Any] = {
        "rolling_damping": parameters.rolling_damping,
        "normal_stiffness": parameters.normal_stiffness,
        "tangential_stiffness": TANGENTIAL_SHARE * parameters.normal_stiffness if across is None else across,
        "lubrication": parameters.lubrication,
    }
    if isinstance(parameters, SeveralMaterials):
        table = _pair_table(parameters, shared)
        return Surroundings(table, table, wall_velocity)
    shared |= {"rolling_friction": parameters.rolling_friction}
    normal, shear = _compliances(parameters.young_modulus, parameters.poisson_ratio)
    wall_normal, wall_shear = _compliances(
        _or(parameters.wall_young_modulus, parameters.young_modulus),
        _or(parameters.wall_poisson_ratio, parameters.poisson_ratio),
    )
    pair = ContactMaterial(
        effective_young_modulus=0.5 / normal,
        effective_shear_modulus=0.5 / shear,
        restitution=parameters.pair_restitution,
        friction=parameters.friction,
        **shared,
        cohesion=_cohesion(parameters.cohesion, at_wall=False),
    )
    wall = ContactMaterial(
        effective_young_modulus=1.0 / (normal + wall_normal),
        effective_shear_modulus=1.0 / (shear + wall_shear),
        restitution=parameters.restitution,
        friction=_or(parameters.wall_friction, parameters.friction),
        **shared,
        cohesion=_cohesion(parameters.cohesion, at_wall=True),
    )
    return Surroundings(pair, wall, wall_velocity)


def _cohesion(parameters: CohesionParameters | None, at_wall: bool) -> CohesionConstants | None:
    """Of contacts between particles, or of those with walls."""
    if parameters is None:
        return None
    if not at_wall:
        return parameters.constants(parameters.strength)
    return parameters.constants(required(parameters.wall_factor, "wall_factor") * parameters.strength)


def _or(own: Array | None, followed: Array) -> Array:
    return followed if own is None else own


def _pair_table(parameters: SeveralMaterials, shared: dict[str, Any]) -> ContactMaterial:
    """Constants (P,) of the pairs of materials, in the order of `numpy.triu_indices`."""
    numbers = parameters.numbers
    normal, shear = _compliances(
        of_materials(parameters.young_modulus, numbers.young_modulus),
        of_materials(parameters.poisson_ratio, numbers.poisson_ratio),
    )
    first, second = np.triu_indices(normal.shape[0])
    mixed = {
        name: of_pairs(getattr(parameters, name), getattr(numbers, name), jnp)
        for name in ("restitution", "friction", "rolling_friction")
    }
    cohesion = None
    if parameters.cohesion is not None:
        strength = of_pairs(parameters.cohesion.strength, required(numbers.cohesion, "cohesion"), jnp)
        cohesion = parameters.cohesion.constants(strength)
    return ContactMaterial(
        effective_young_modulus=1.0 / (normal[first] + normal[second]),
        effective_shear_modulus=1.0 / (shear[first] + shear[second]),
        **mixed,
        **shared,
        cohesion=cohesion,
    )


def _compliances(young_modulus: Array, poisson_ratio: Array) -> tuple[Array, Array]:
    """(1 - nu^2)/E and (2 - nu)/G [1/Pa]."""
    shear = 2.0 * (1.0 + poisson_ratio) * (2.0 - poisson_ratio) / young_modulus
    return (1.0 - poisson_ratio**2) / young_modulus, shear

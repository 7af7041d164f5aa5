"""Effective constants of contacts from the constants of the materials."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jax import Array

from jaxdem.particles.contact import ContactMaterial
from jaxdem.particles.forces import Surroundings


class ContactParameters(NamedTuple):
    """Constants of the particles and of the walls; each () and traced.

    Attributes:
        young_modulus: of the particles [Pa].
        poisson_ratio: of the particles [-].
        restitution: [-].
        friction: between particles [-].
        rolling_friction: [-].
        rolling_damping: of the rolling spring over critical [-].
        wall_young_modulus: infinite for a rigid wall [Pa].
        wall_poisson_ratio: [-].
        wall_friction: between particles and walls [-].
        normal_stiffness: of the linear law [N/m].
        tangential_stiffness: of the linear law [N/m].
    """

    young_modulus: Array
    poisson_ratio: Array
    restitution: Array
    friction: Array
    rolling_friction: Array
    rolling_damping: Array
    wall_young_modulus: Array
    wall_poisson_ratio: Array
    wall_friction: Array
    normal_stiffness: Array
    tangential_stiffness: Array


class SeveralMaterials(NamedTuple):
    """Constants of M materials and of their P pairs; traced. Which contact is of which pair: `MaterialIndex`.

    A pair stands once for either order, so that action and reaction are equal whatever a derivative is taken by.

    Attributes:
        young_modulus: (M,) infinite for a rigid wall [Pa].
        poisson_ratio: (M,) [-].
        restitution: (P,) [-].
        friction: (P,) [-].
        rolling_friction: (P,) [-].
        rolling_damping: () of the rolling spring over critical [-].
        normal_stiffness: () of the linear law [N/m].
        tangential_stiffness: () of the linear law [N/m].
    """

    young_modulus: Array
    poisson_ratio: Array
    restitution: Array
    friction: Array
    rolling_friction: Array
    rolling_damping: Array
    normal_stiffness: Array
    tangential_stiffness: Array


def surroundings(
    parameters: ContactParameters | SeveralMaterials, wall_velocity: tuple[Array, ...]
) -> Surroundings:
    """Materials of the contacts between particles, and between particles and walls.

    1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2 and 1/G* = (2 - nu1)/G1 + (2 - nu2)/G2 with
    G = E / (2 (1 + nu)). A body of infinite modulus adds nothing to either sum.

    With several materials both are (P,) tables, the same for particles and walls.

    Source: K. L. Johnson, Contact Mechanics (1985), eqs 3.41 and 7.42.
    """
    normal, shear = _compliances(parameters.young_modulus, parameters.poisson_ratio)
    if isinstance(parameters, SeveralMaterials):
        first, second = np.triu_indices(parameters.young_modulus.shape[0])  # the order of the pairs
        table = ContactMaterial(
            effective_young_modulus=1.0 / (normal[first] + normal[second]),
            effective_shear_modulus=1.0 / (shear[first] + shear[second]),
            **{name: getattr(parameters, name) for name in ContactMaterial._fields[2:]},
        )
        return Surroundings(table, table, wall_velocity)
    wall_normal, wall_shear = _compliances(parameters.wall_young_modulus, parameters.wall_poisson_ratio)
    shared = {
        "restitution": parameters.restitution,
        "rolling_friction": parameters.rolling_friction,
        "rolling_damping": parameters.rolling_damping,
        "normal_stiffness": parameters.normal_stiffness,
        "tangential_stiffness": parameters.tangential_stiffness,
    }
    pair = ContactMaterial(
        effective_young_modulus=0.5 / normal,
        effective_shear_modulus=0.5 / shear,
        friction=parameters.friction,
        **shared,
    )
    wall = ContactMaterial(
        effective_young_modulus=1.0 / (normal + wall_normal),
        effective_shear_modulus=1.0 / (shear + wall_shear),
        friction=parameters.wall_friction,
        **shared,
    )
    return Surroundings(pair, wall, wall_velocity)


def _compliances(young_modulus: Array, poisson_ratio: Array) -> tuple[Array, Array]:
    """(1 - nu^2)/E and (2 - nu)/G [1/Pa]."""
    shear = 2.0 * (1.0 + poisson_ratio) * (2.0 - poisson_ratio) / young_modulus
    return (1.0 - poisson_ratio**2) / young_modulus, shear

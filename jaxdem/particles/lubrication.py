"""Lubrication: what the liquid in the gap between two bodies does, and friction of bodies that it wets.

Sources:
    H. Brenner, Chem. Eng. Sci. 16 (1961) 242-251: the leading term of the force, for a sphere at a plane too.
    P. Costa, B. J. Boersma, J. Westerweel, W.-P. Breugem, Phys. Rev. E 92 (2015) 053012: constant below the roughness,
        none while the bodies overlap.
    R. H. Davis, J.-M. Serayssol, E. J. Hinch, J. Fluid Mech. 163 (1986) 479-497: impacts through a film.
    N. Fernandez, R. Mani, D. Rinaldi et al., Phys. Rev. Lett. 111 (2013) 108301: friction of grains in a liquid by
        their Sommerfeld number, from boundary lubrication to a film.
    L. C. Bo, D. Pavelescu, Wear 82 (1982) 277-289: the exponential between the two.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics.static import static

NARROW = 1e-3
"""Change of the gap in a step, over the gap, below which the value in its middle stands for the mean [-]."""

FULL_FILM = 80.0
"""Sommerfeld number over its scale that no bodies exceed: e^-80 of dry friction is none, and slopes stay finite [-]."""


class LubricationConstants(NamedTuple):
    """Numbers of the liquid between bodies; traced, each ().

    Attributes:
        viscosity: dynamic; None before that of the scene's fluid is known [Pa s].
        roughness: gap below which the resistance grows no more [m].
        cutoff: gap beyond which there is none [m].
        wet_friction: Coulomb coefficient of bodies that a film keeps apart; None for the friction of dry ones [-].
        sommerfeld_number: at which friction has gone the part 1 - 1/e of the way from dry to wet [-].
    """

    viscosity: Array | None
    roughness: Array
    cutoff: Array
    wet_friction: Array | None = None
    sommerfeld_number: Array | None = None

    @property
    def dynamic_viscosity(self) -> Array:
        """Of the liquid [Pa s]."""
        return required(self.viscosity, "viscosity of the lubrication")


@static
class Lubrication:
    """Resistance of the liquid in the gap h against approach and parting; immutable, without numbers.

        F = 6 pi mu R*^2 g(h) v,   g = 1/h within roughness < h < cutoff, 1/roughness for 0 < h < roughness,

    and 0 where bodies overlap or are farther apart than the cutoff. v is the speed of approach, R* is the radius at a
    plane. g is the mean over a step, in which the gap goes from h0 to h1: (G(h1) - G(h0)) / (h1 - h0) with
    G = min(h, roughness)/roughness + ln(h/roughness), so that what an approach costs hardly depends on the step, and
    the force is a continuous function of the position.

    An impact through the liquid by which nothing else acts loses the speed 6 pi mu R*^2 / m* (1 + ln(cutoff/roughness))
    on the way in and again on the way out.
    """

    def damping(
        self, overlap: Array, approach_speed: Array, radius: Array, time_step: Array, constants: LubricationConstants
    ) -> Array:
        """6 pi mu R*^2 g, per speed of approach [N s/m].

        Args:
            overlap: in the middle of the step, negative for a gap [m].
            approach_speed: expected there [m/s].
            radius: R* [m].
            time_step: [s].
            constants: numbers.
        """
        change = 0.5 * time_step * approach_speed
        after, before = -overlap - change, -overlap + change
        wide = jnp.abs(change) > NARROW * jnp.maximum(jnp.abs(overlap), constants.roughness)
        rise = _film(before, constants) - _film(after, constants)
        mean = rise / jnp.where(wide, 2.0 * change, 1.0)
        film = jnp.where(wide, mean, _resistance(-overlap, constants))
        return 6.0 * jnp.pi * constants.dynamic_viscosity * radius**2 * film


def _resistance(gap: Array, constants: LubricationConstants) -> Array:
    """g [1/m]."""
    acts = (gap > 0.0) & (gap < constants.cutoff)
    return jnp.where(acts, 1.0 / jnp.maximum(gap, constants.roughness), 0.0)


def _film(gap: Array, constants: LubricationConstants) -> Array:
    """G, the integral of g from contact to a gap [-]."""
    below = jnp.clip(gap, 0.0, constants.roughness) / constants.roughness
    return below + jnp.log(jnp.clip(gap, constants.roughness, constants.cutoff) / constants.roughness)


def wet_friction(dry: Array, normal: Array, slip_speed: Array, radius: Array, constants: LubricationConstants) -> Array:
    """Coulomb coefficient of a wet contact, mu = mu_wet + (mu_dry - mu_wet) exp(-S / S_c), elementwise [-].

    S = mu_f v R* / F is the Sommerfeld number: the liquid's viscosity mu_f, speed of slip v and normal force F. Slow or
    pressed contacts have the friction of dry ones (boundary lubrication), fast or light ones that of a film. The rise
    of friction with speed in a full film is left out: mu_wet is a constant.

    Args:
        dry: coefficient of the pair without liquid [-].
        normal: force of the contact law, friction is none where it pulls [N].
        slip_speed: [m/s].
        radius: R* [m].
        constants: with `wet_friction` and `sommerfeld_number`.
    """
    wet = required(constants.wet_friction, "wet_friction")
    pressed = normal > 0.0
    scale = required(constants.sommerfeld_number, "sommerfeld_number") * jnp.where(pressed, normal, 1.0)
    film = constants.dynamic_viscosity * slip_speed * radius
    thickness = film / jnp.maximum(scale, film / FULL_FILM)
    return wet + (dry - wet) * jnp.where(pressed, jnp.exp(-thickness), 0.0)

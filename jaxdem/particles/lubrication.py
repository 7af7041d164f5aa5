"""Lubrication: what the liquid in the gap between two bodies does, and friction of bodies that it wets.

Sources:
    H. Brenner, Chem. Eng. Sci. 16 (1961) 242-251: the leading term of the force, for a sphere at a plane too.
    D. J. Jeffrey, Y. Onishi, J. Fluid Mech. 139 (1984) 261-290: the leading terms of shear and rotation of two spheres.
    A. J. Goldman, R. G. Cox, H. Brenner, Chem. Eng. Sci. 22 (1967) 637-651: the same of a sphere at a plane.
    P. Costa, B. J. Boersma, J. Westerweel, W.-P. Breugem, Phys. Rev. E 92 (2015) 053012: constant below the roughness,
        none while the bodies overlap.
    R. H. Davis, J.-M. Serayssol, E. J. Hinch, J. Fluid Mech. 163 (1986) 479-497: impacts through a film.
    N. Fernandez, R. Mani, D. Rinaldi et al., Phys. Rev. Lett. 111 (2013) 108301: friction of grains in a liquid by
        their Sommerfeld number, from boundary lubrication to a film.
    L. C. Bo, D. Pavelescu, Wear 82 (1982) 277-289: the exponential between the two.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics.quotients import quotient
from jaxdem.numerics.static import static

NARROW = 1e-3
"""Change of the gap in a step, over the gap, below which the value in its middle stands for the mean [-]."""

ROLLING_SHARE = 0.6
"""Resistance of a film against rolling over that against sliding, see `Lubrication` [-]."""

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
    """Resistance of the liquid in the gap h between two bodies; immutable, without numbers.

    Against approach and parting at the speed v along the normal

        F = 6 pi mu R*^2 g(h) v,   g = 1/h within roughness < h < cutoff, 1/roughness for 0 < h < roughness,

    and 0 where bodies overlap or are farther apart than the cutoff. R* is the radius at a plane. An impact through the
    liquid by which nothing else acts loses the speed 6 pi mu R*^2 / m* (1 + ln(cutoff/roughness)) on the way in and
    again on the way out.

    Against sliding and rolling, with the velocities a and b of the two surfaces in the plane of contact, in the frame
    that turns with the line of centres: s = a - b and d = a + b take the power

        2 pi mu R* l(h) (s^2 + 3/5 d^2),   l = ln(r/h) within roughness < h < cutoff, ln(r/roughness) below,

    with the smaller radius r. That is the sum of all terms with ln(1/h) of Jeffrey and Onishi, of spheres of any two
    radii; at a plane the one of Goldman, Cox and Brenner. A pair that turns as a rigid body has neither s nor d. What
    does not grow as the gap closes, as the resistance to a twist about the normal, is left out.

    g and l are means over a step, in which the gap goes from h0 to h1: so what an approach costs hardly depends on the
    step, and the force is a continuous function of the position.

    Attributes:
        shear: whether sliding and rolling are resisted; without it no such term is compiled.
    """

    shear: bool = True

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
        given = overlap, 0.5 * time_step * approach_speed, constants
        film = _over_step(*given, value=_squeezed, integral=_squeezed_to)
        return 6.0 * jnp.pi * constants.dynamic_viscosity * radius**2 * film

    def sliding(
        self,
        overlap: Array,
        approach_speed: Array,
        radius: Array,
        smaller: Array,
        time_step: Array,
        constants: LubricationConstants,
    ) -> Array:
        """2 pi mu R* l, per speed of sliding; that of rolling is `ROLLING_SHARE` of it [N s/m].

        Args:
            overlap, approach_speed, radius, time_step, constants: see `damping`.
            smaller: radius of the smaller body, of the sphere at a plane [m].
        """
        bumps = jnp.log(smaller / constants.roughness)

        def value(gap: Array, constants: LubricationConstants) -> Array:
            within = bumps - jnp.log(jnp.maximum(gap, constants.roughness) / constants.roughness)
            return jnp.where(_acts(gap, constants), within, 0.0)

        def integral(gap: Array, constants: LubricationConstants) -> Array:
            """Of l from contact to a gap: of ln(r/h) it is h (ln(r/h) + 1) [m]."""
            height = jnp.clip(gap, constants.roughness, constants.cutoff)
            below = jnp.clip(gap, 0.0, constants.roughness) - constants.roughness
            return below * bumps + height * (bumps - jnp.log(height / constants.roughness) + 1.0)

        film = _over_step(overlap, 0.5 * time_step * approach_speed, constants, value=value, integral=integral)
        return 2.0 * jnp.pi * constants.dynamic_viscosity * radius * film


def _over_step(
    overlap: Array,
    change: Array,
    constants: LubricationConstants,
    value: Callable[[Array, LubricationConstants], Array],
    integral: Callable[[Array, LubricationConstants], Array],
) -> Array:
    """Mean of a function of the gap over a step, in whose middle the overlap is `overlap` and in half of which it
    changes by `change` [m]; from its value where that is hardly a change, else from its integral."""
    after, before = -overlap - change, -overlap + change
    wide = jnp.abs(change) > NARROW * jnp.maximum(jnp.abs(overlap), constants.roughness)
    mean = (integral(before, constants) - integral(after, constants)) / jnp.where(wide, 2.0 * change, 1.0)
    return jnp.where(wide, mean, value(-overlap, constants))


def _acts(gap: Array, constants: LubricationConstants) -> Array:
    """Whether there is a film."""
    return (gap > 0.0) & (gap < constants.cutoff)


def _squeezed(gap: Array, constants: LubricationConstants) -> Array:
    """g [1/m]."""
    return jnp.where(_acts(gap, constants), 1.0 / jnp.maximum(gap, constants.roughness), 0.0)


def _squeezed_to(gap: Array, constants: LubricationConstants) -> Array:
    """The integral of g from contact to a gap, min(h, roughness)/roughness + ln(h/roughness) [-]."""
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
    thickness = quotient(film, jnp.maximum(scale, film / FULL_FILM))
    return wet + (dry - wet) * jnp.where(pressed, jnp.exp(-thickness), 0.0)

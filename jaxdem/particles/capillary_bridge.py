"""The liquid bridge between two wet bodies: its pull, its rupture and its viscous force. `liquid` makes bridges.

Sources:
    C. D. Willett, M. J. Adams, S. A. Johnson, J. P. K. Seville, Langmuir 16 (2000) 9396-9405: force of a liquid bridge.
    G. Lian, C. Thornton, M. J. Adams, J. Colloid Interface Sci. 161 (1993) 138-147: its rupture distance.
    O. Pitois, P. Moucheront, X. Chateau, J. Colloid Interface Sci. 231 (2000) 26-31: its viscous force.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics.quotients import quotient
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.cohesion import Attraction, CohesionConstants, Gap, at_overlap


@static
class CapillaryBridge:
    """A liquid bridge between bodies that have touched, until it ruptures.

    With the volume V of the bridge, the gap h (0 in contact), the surface tension s, the contact angle t and R = 2 R*,
        pull = 2 pi R s cos(t) / (1 + 1.05 S + 2.5 S^2),  S = h sqrt(R / V),
    which at contact is that of a small bridge, 4 pi R* s cos(t). It ruptures at h = (1 + t/2) V^(1/3). The liquid
    resists approach and parting by
        6 pi mu R*^2 X^2 / h dh/dt,  X = 1 - 1 / sqrt(1 + 2 V / (pi R h^2)),
    with h at least the minimum gap. What the contact remembers is V, zero for no bridge. `jaxdem.particles.liquid`
    makes and ruptures the bridges. Coulomb's limit is mu times the force of the contact law.

    Range of the closed form: V < 1e-3 R^3 and t up to 50 degrees (Willett et al.).
    """

    memory = 1
    sudden = False

    def reach(self, gap: Gap, constants: CohesionConstants) -> Array:
        """See `Cohesion`."""
        share, film = required(constants.bridge_share, "bridge_share"), required(constants.largest_film, "largest_film")
        return rupture_factor(constants) * jnp.cbrt(2.0 * share * film)

    def begun(self, memory: Vector) -> Array:
        """See `BegunByTouch`."""
        return memory[0] > 0

    def __call__(self, gap: Gap, constants: CohesionConstants, memory: Vector) -> Attraction:
        """See `Cohesion`."""
        (volume,) = memory
        bridge = volume > 0
        safe, radius = jnp.where(bridge, volume, 1.0), 2.0 * gap.effective_radius
        distance = jnp.maximum(-gap.overlap, 0.0)
        length = jnp.sqrt(safe * quotient(1.0, radius))  # S = h / length; without a quotient for either
        angle = required(constants.contact_angle, "contact_angle")
        largest = 2.0 * jnp.pi * radius * constants.strength * jnp.cos(angle)
        square = length**2
        pull = quotient(largest * square, square + distance * (1.05 * length + 2.5 * distance))
        pull = jnp.where(bridge, pull, 0.0)
        attraction = at_overlap(gap, pull)._replace(kept=memory)
        if constants.liquid_viscosity is None:
            return attraction
        distance = jnp.maximum(distance, required(constants.minimum_gap, "minimum_gap"))
        wetted = 1.0 - 1.0 / jnp.sqrt(1.0 + quotient(2.0 * safe, jnp.pi * radius * distance**2))
        damping = 6.0 * jnp.pi * constants.liquid_viscosity * gap.effective_radius**2 * wetted**2 / distance
        return attraction._replace(damping=jnp.where(bridge, damping, 0.0))


def rupture_factor(constants: CohesionConstants) -> Array:
    """1 + t/2, t the contact angle: of the gap at which a bridge ruptures over the cube root of its volume [-]."""
    return 1.0 + 0.5 * required(constants.contact_angle, "contact_angle")

"""Adhesion of dry bodies: JKR, DMT, van der Waals, and the cohesion of LIGGGHTS.

Sources:
    K. L. Johnson, K. Kendall, A. D. Roberts, Proc. R. Soc. Lond. A 324 (1971) 301-313: JKR.
    B. V. Derjaguin, V. M. Muller, Yu. P. Toporov, J. Colloid Interface Sci. 53 (1975) 314-326: DMT.
    C. Thornton, J. Phys. D 24 (1991) 1942-1946: Coulomb's limit of adhesive spheres.
    H. C. Hamaker, Physica 4 (1937) 1058-1072: van der Waals force of spheres.
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.numerics.quotients import quotient
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import Vector
from jaxdem.particles.cohesion import TOUCHING, Attraction, CohesionConstants, Gap, at_overlap


@static
class JohnsonKendallRoberts:
    """Adhesion of soft spheres (JKR); needs a law with Hertz's stiffness.

    The contact radius a of an overlap d follows from d = a^2/R* - sqrt(2 pi w a / E*), and
        F = 4 E* a^3 / (3 R*) - sqrt(8 pi w E* a^3).
    The first term is Hertz's force at the overlap a^2/R*: the contact law is evaluated there, so that its stiffness,
    2 E* a, and its dashpots are those of the contact radius. The second is the pull. A contact begins at d = 0, with a
    pull of 8/9 of the pull-off force 3/2 pi w R*, and ends at d = -3/4 (pi^2 w^2 R* / E*^2)^(1/3), where the branch
    ends, with 5/9 of it. It remembers that it has begun.

    In units of u = (2 pi w / E*)^(2/3) R*^(1/3) for overlaps, a = sqrt(R* u) y^2 with y^4 - y = d/u, and the pull is
    4 pi w R* y^3. Coulomb's limit is mu |F + 2 F_pulloff|. Between mirror-smooth and stiff, small spheres DMT is nearer
    to the truth: see `DerjaguinMullerToporov`.
    """

    memory = 1
    sudden = True

    def reach(self, gap: Gap, constants: CohesionConstants) -> Array:
        """See `Cohesion`."""
        return -END_OF_NECK * jkr_unit(gap, constants.strength)

    def begun(self, memory: Vector) -> Array:
        """See `BegunByTouch`."""
        return memory[0] > 0

    def __call__(self, gap: Gap, constants: CohesionConstants, memory: Vector) -> Attraction:
        """See `Cohesion`."""
        unit = jkr_unit(gap, constants.strength)
        holds = memory[0] > 0
        end = jnp.where(holds, END_OF_NECK * unit, 0.0)
        depth = gap.overlap - end
        touching = depth > 0
        overlap = jnp.where(touching, gap.overlap, end)
        adheres = unit > 0
        root = contact_root(jnp.where(adheres, overlap / jnp.where(adheres, unit, 1.0), 0.0))
        adhesion = jnp.pi * constants.strength * gap.effective_radius
        pull = 4.0 * adhesion * root**3
        equivalent = jnp.maximum(overlap + unit * root, TOUCHING * gap.effective_radius)
        kept = touching.astype(overlap.dtype)
        return Attraction(depth, equivalent, pull, 3.0 * adhesion - pull, None, (kept,), holds)


@static
class DerjaguinMullerToporov:
    """Adhesion of stiff spheres (DMT): a constant pull 2 pi w R* while they touch.

    Between approach and parting there is no difference: an elastic impact keeps its energy. Coulomb's limit is
    mu |F + 2 F_pulloff|, as for JKR.
    """

    memory = 0
    sudden = True

    def reach(self, gap: Gap, constants: CohesionConstants) -> Array:
        """See `Cohesion`."""
        return jnp.zeros((), gap.overlap.dtype)

    def __call__(self, gap: Gap, constants: CohesionConstants, memory: Vector) -> Attraction:
        """See `Cohesion`."""
        pull = 2.0 * jnp.pi * constants.strength * gap.effective_radius
        return at_overlap(gap, pull)._replace(friction=pull)


@static
class VanDerWaals:
    """Van der Waals attraction A R* / (6 h^2) up to a cut-off gap; h is the gap and at least the minimum gap.

    In contact the pull is that at the minimum gap. It has a potential, so an elastic impact keeps its energy. Beyond
    the cut-off, where it is (minimum gap / cut-off)^2 of its largest value, it is zero. Coulomb's limit is mu times
    the force of the contact law.
    """

    memory = 0
    sudden = False

    def reach(self, gap: Gap, constants: CohesionConstants) -> Array:
        """See `Cohesion`."""
        return required(constants.cutoff, "cutoff")

    def __call__(self, gap: Gap, constants: CohesionConstants, memory: Vector) -> Attraction:
        """See `Cohesion`."""
        distance = jnp.maximum(-gap.overlap, required(constants.minimum_gap, "minimum_gap"))
        pull = quotient(constants.strength * gap.effective_radius, 6.0 * distance**2)
        return at_overlap(gap, jnp.where(-gap.overlap < required(constants.cutoff, "cutoff"), pull, 0.0))


@static
class SimplifiedJKR:
    """Cohesion energy density times contact area, what LIGGGHTS calls SJKR: pull = k pi a^2.

    a is the radius of the circle in which the two spheres, or sphere and plane, intersect. The name misleads: the pull
    is zero at first touch and at the end, so there is no pull-off force without a load before. Given for comparison.
    Coulomb's limit is mu times the force of the contact law.

    Source: `cohesion_model_sjkr.h` of LIGGGHTS.
    """

    memory = 0
    sudden = False

    def reach(self, gap: Gap, constants: CohesionConstants) -> Array:
        """See `Cohesion`."""
        return jnp.zeros((), gap.overlap.dtype)

    def __call__(self, gap: Gap, constants: CohesionConstants, memory: Vector) -> Attraction:
        """See `Cohesion`."""
        overlap = jnp.maximum(gap.overlap, 0.0)
        if gap.other_radius is None:
            squared = overlap * (2.0 * gap.radius - overlap)
        else:
            total = gap.radius + gap.other_radius
            distance = total - overlap
            parts = (2.0 * gap.radius - overlap) * (2.0 * gap.other_radius - overlap) * (total + distance)
            squared = overlap * parts / (4.0 * distance**2)
        return at_overlap(gap, constants.strength * jnp.pi * squared)


AT_TOUCH = (DerjaguinMullerToporov, SimplifiedJKR)
"""Kinds that act while bodies overlap, and remember nothing."""

# --- the branch of JKR ----------------------------------------------------------------------------------------

END_OF_NECK = -3.0 / 16.0 ** (2.0 / 3.0)
"""Smallest d/u of y^4 - y = d/u, where a contact ends."""

LAST_ROOT = 4.0 ** (-1.0 / 3.0)
"""y there."""

STEEPEST = 100.0
"""Largest slope dy/d(d/u) in derivatives: it is infinite where a contact ends, and above this in the last 1e-5 of
d/u."""


def jkr_unit(gap: Gap, work: Array) -> Array:
    """u = (2 pi w / E*)^(2/3) R*^(1/3); 0 without adhesion [m]."""
    adheres = work > 0
    # By logarithms, which are vectorised: the library's cube root takes half of a step where sizes differ.
    squared = 2.0 * jnp.log(2.0 * jnp.pi * jnp.where(adheres, work, 1.0) / gap.modulus)
    return jnp.where(adheres, jnp.exp((squared + jnp.log(gap.effective_radius)) / 3.0), 0.0)


@jax.custom_jvp
def contact_root(overlap: Array) -> Array:
    """y >= 4^(-1/3) with y^4 - y = x for x >= -3/16^(2/3), elementwise.

    A fraction in sqrt(x - least x) is within 6e-5; a step of Newton's method brings that to 6e-9, a second one to
    rounding in double precision.
    """
    t = jnp.sqrt(jnp.maximum(overlap - END_OF_NECK, 0.0))
    first, slope = LAST_ROOT**2, math.sqrt(2.0 / 3.0)
    square = first + t * (slope + t * (0.92632959 + 0.11177225 * t)) / (1.0 + t * (0.96548711 + 0.11177225 * t))
    y = jnp.sqrt(square)
    for _ in range(2 if y.dtype == jnp.float64 else 1):
        cube = y**3
        y = y - (y * (cube - 1.0) - overlap) / jnp.maximum(4.0 * cube - 1.0, 1e-6)
    return y


@contact_root.defjvp
def _slope_of_root(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    y = contact_root(*primals)
    return y, tangents[0] * (1.0 / jnp.maximum(4.0 * y**3 - 1.0, 1.0 / STEEPEST))

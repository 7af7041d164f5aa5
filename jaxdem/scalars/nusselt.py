"""Heat transfer between a sphere and the fluid around it: Nusselt numbers Nu = h d / k."""

from __future__ import annotations

from typing import Protocol

from jax import Array

from jaxdem.numerics.powers import power
from jaxdem.numerics.static import static


class NusseltLaw(Protocol):
    """A law of heat transfer; immutable and static, or a plain function."""

    def __call__(self, reynolds: Array, prandtl: Array, void_fraction: Array) -> Array:
        """(N,) Nusselt number.

        Args:
            reynolds: (N,) of the superficial slip, g |u - v| d / nu [-].
            prandtl: () nu / (k / (rho c)); of two fluids (N,), of what is at the sphere [-].
            void_fraction: (N,) g at the sphere [-].
        """
        ...


@static
class RanzMarshall:
    """A sphere alone: Nu = 2 + 0.6 Re^(1/2) Pr^(1/3).

    Source: W. E. Ranz, W. R. Marshall, Chem. Eng. Prog. 48 (1952) 141-146, 173-180; Re up to 200 there.
    """

    def __call__(self, reynolds: Array, prandtl: Array, void_fraction: Array) -> Array:
        """See the class."""
        return 2.0 + 0.6 * power(reynolds, 0.5) * power(prandtl, 1.0 / 3.0)


@static
class Gunn:
    """Spheres in a bed or alone, with g the void fraction, 0.35 to 1, and Re up to 1e5:

    Nu = (7 - 10 g + 5 g^2) (1 + 0.7 Re^0.2 Pr^(1/3)) + (1.33 - 2.4 g + 1.2 g^2) Re^0.7 Pr^(1/3).

    Source: D. J. Gunn, Int. J. Heat Mass Transfer 21 (1978) 467-476.
    """

    def __call__(self, reynolds: Array, prandtl: Array, void_fraction: Array) -> Array:
        """See the class."""
        g, cube_root = void_fraction, power(prandtl, 1.0 / 3.0)
        still = (7.0 - 10.0 * g + 5.0 * g**2) * (1.0 + 0.7 * power(reynolds, 0.2) * cube_root)
        return still + (1.33 - 2.4 * g + 1.2 * g**2) * power(reynolds, 0.7) * cube_root


NUSSELT_LAWS: dict[str, NusseltLaw] = {"ranz_marshall": RanzMarshall(), "gunn": Gunn()}
"""By the name in a scene, `heat.exchange`."""

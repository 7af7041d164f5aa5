"""The Basset force: what is left of the wakes of earlier accelerations.

    F(t) = C int_-inf^t (d(u - v)/dtau) / sqrt(t - tau) dtau,   C = 6 r^2 sqrt(pi rho mu)

The slip s = u - v is taken as linear in time over every coupling interval T, and the integral is done exactly
(product integration), as is that of F over the interval. With ds_m the change of the slip m intervals back, m = 0 the
coming one, the impulse is

    J = 4/3 C sqrt(T) sum_m k_m ds_m,   k_0 = 1,   k_m = (m + 1)^1.5 - 2 m^1.5 + (m - 1)^1.5:

its newest part is implicit, a mass 4/3 C sqrt(T) on the change of the slip. Beyond the window the kernel is a sum of
ten exponentials, for which one vector each is kept. Before the start the slip is taken as it was at the start.

Sources: A. B. Basset, Phil. Trans. R. Soc. A 179 (1888) 43-63; M. A. T. van Hinsbergen, J. H. M. ten Thije Boonkkamp &
H. J. H. Clercx, J. Comput. Phys. 230 (2011) 1465-1478, window and exponentials. Valid for Re well below 1: at finite Re
the kernel decays faster in time (R. Mei & R. J. Adrian, J. Fluid Mech. 237 (1992) 323-341).
"""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.coupling.forces.protocol import Contribution, FluidForce, IntervalStart
from jaxdem.numerics.products import PRECISION
from jaxdem.numerics.static import static
from jaxdem.particles.integrate import as_column

TAIL_TIMES = np.array([0.1, 0.3, 1.0, 3.0, 10.0, 40.0, 190.0, 1000.0, 6500.0, 50000.0])
TAIL_FACTORS = np.array(
    [
        0.23477481312586, 0.28549576238194, 0.28479416718255, 0.26149775537574, 0.32056200511938,
        0.35354490689146, 0.39635904496921, 0.42253908596514, 0.48317384225265, 0.63661146557001,
    ]
)  # fmt: skip
"""1/sqrt(t) ~ sum_i a_i sqrt(e / t_i) exp(-t / (2 t_i)) for t >= 1 (van Hinsbergen et al. 2011, m = 10)."""


class SlipHistory(NamedTuple):
    """What is kept of the slip for the Basset force.

    Attributes:
        slip: (N, D) at the start of the last interval [m/s].
        changes: (window - 1, N, D) of the slip over the last intervals, the newest first [m/s].
        tail: (10, N, D) older changes, each in the exponentials of the tail [m/s].
    """

    slip: Array
    changes: Array
    tail: Array


@static
class Basset(FluidForce):
    """The Basset force with a window; it remembers the history of the slip.

    Attributes:
        window: number of intervals with the exact kernel, at least 2.
    """

    name: ClassVar[str] = "basset"
    label: ClassVar[str] = "Basset force"

    window: int

    def __str__(self) -> str:
        return f"{self.label} over {self.window} intervals and a tail"

    def start(self, slip: Array) -> SlipHistory:
        """See `FluidForce`."""
        zero = jnp.zeros_like(slip)
        return SlipHistory(
            slip,
            jnp.broadcast_to(zero, (self.window - 1, *slip.shape)),
            jnp.broadcast_to(zero, (TAIL_TIMES.size, *slip.shape)),
        )

    def begin(self, start: IntervalStart, memory: SlipHistory) -> Contribution:
        """See `FluidForce`. For particles that stay: the scene refuses it where they come and go."""
        mass = self.slip_mass(start)
        history = self.advance(memory, start.slip)
        return Contribution(slip_mass=mass, impulse=as_column(mass) * self.impulse(history), memory=history)

    def advance(self, history: SlipHistory, slip: Array) -> SlipHistory:
        """The history with the slip (N, D) at the start of the coming interval [m/s]."""
        decay = jnp.asarray(np.exp(-self._rates()), slip.dtype)[:, None, None]
        changes = jnp.concatenate(((slip - history.slip)[None], history.changes))
        return SlipHistory(slip, changes[:-1], decay * history.tail + changes[-1:])

    def impulse(self, history: SlipHistory) -> Array:
        """sum_m k_m ds_m over all but the coming interval, (N, D) [m/s]; times `slip_mass` the impulse."""
        m = np.arange(1, self.window, dtype=float)
        near = (m + 1.0) ** 1.5 - 2.0 * m**1.5 + (m - 1.0) ** 1.5
        rate = self._rates()
        # The double integral of a exp(-t / theta) over two intervals `window` apart, in units of 4/3 T^1.5.
        scale = TAIL_FACTORS * np.sqrt(np.e / (TAIL_TIMES * (self.window - 1)))
        far = 0.75 * scale * (np.expm1(-rate) / rate) ** 2 * np.exp(-(self.window - 1) * rate)

        def weighted(weights: np.ndarray, values: Array) -> Array:
            return jnp.tensordot(jnp.asarray(weights, values.dtype), values, axes=1, precision=PRECISION)

        return weighted(near, history.changes) + weighted(far, history.tail)

    def slip_mass(self, start: IntervalStart) -> Array:
        """4/3 C sqrt(T), C = 6 r^2 sqrt(pi rho mu), () or (N,) [kg]."""
        fluid = start.properties
        coefficient = 6.0 * start.bodies.grain_radius**2 * fluid.density * jnp.sqrt(jnp.pi * fluid.viscosity)
        return start.bodies.of_all_grains(4.0 / 3.0 * coefficient * jnp.sqrt(start.duration))

    def _rates(self) -> np.ndarray:
        """T / (2 t_i) of the exponentials; the window's inner end, where the tail may begin, is one unit."""
        return 1.0 / (2.0 * TAIL_TIMES * (self.window - 1))

"""The undisturbed slip: what the fluid would do at a particle that had not dragged it along.

A particle samples the wake that it has deposited itself. In steady Stokes flow the fluid at the particle follows a
force F on it by -B F, B = M / mu, where M [1/m] belongs to the kernel and the mesh alone:

    M = mean over offsets and axes of
        sum_k |w(k)|^2 cos^2(k_a h_a / 2) (1 - q_a^2 / q^2) / (q^2 L^3) + 2.8373 / (6 pi L)

with w the discrete transform of the weights, q_a = 2/h_a sin(k_a h_a / 2) the symbol of the staggered gradient, the
cosine (twice a root of it) from cells to faces and back, and the last term from a periodic box to an unbounded fluid.
For a Gaussian of deviation S, M = 1 / (6 pi^1.5 S), 0.28 d / S of the slip with Stokes drag; S = 1 / (6 pi^1.5 M) is
our kernel's. Two factors are derived for such a Gaussian:

    inertia, Oseen's equation at R = |s| S / nu:   1 / P = 1 + R (a + (b - a) R / (R + 1.95)),  a = 3 sqrt(pi) / 8,
        b = 4 / (3 sqrt(pi)): within 0.2 % of the integral;
    other particles that hold the fluid, Brinkman's equation with y = S sqrt(n c / mu), n their number per volume:
        Q = 1 - sqrt(pi) y exp(y^2) erfc(y).

The seen slip is then s (1 - x), x = P Q M c / (mu (1 - s_o)), s_o the solid fraction without the particle's own, and
the force that the undisturbed slip asks for is a coefficient c / (1 - x) on the seen one. Of the pressure gradient and
stress that the particle makes itself it must feel nothing: they would add s_own / (1 - s) to the drag, which is
therefore times (1 - s) / (1 - s + s_own).

Steady: at first, over the time S^2/nu in which the wake grows, too much is added. Unbounded: walls are not known.

Sources: J. A. K. Horwitz, G. Iaccarino, J. K. Eaton & A. Mani, arXiv:2004.08480 (2020): discrete Green's function;
F. Evrard, F. Denner & B. van Wachem, J. Comput. Phys. X 8 (2020) 100078, and arXiv:2405.08188 (2024): regularised
Stokes solutions and Oseen's equation at finite Re; H. Hasimoto, J. Fluid Mech. 5 (1959) 317-328: 2.8373; H. C.
Brinkman, Appl. Sci. Res. A 1 (1949) 27-34.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.base import Drag, DragInputs
from jaxdem.coupling.interpolation import Weights, in_reach
from jaxdem.coupling.kernel import each_cell_once
from jaxdem.coupling.open_cells import open_weights
from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.grid import Grid
from jaxdem.numerics.static import static
from jaxdem.numerics.vectors import safe_sqrt

LARGEST_SHARE = 0.75
"""Most of the undisturbed slip that the wake is taken to hide; more is counted as out of range."""

LARGEST_STOKES_SHARE = 0.5
"""Most that the wake may hide by Stokes drag for a scene to be accepted."""

HASIMOTO = 2.837297
CELLS, OFFSETS = 48, 16


@static
class SelfDisturbance:
    """The correction; static.

    Attributes:
        mobility: M, velocity seen per force over viscosity [1/m].
    """

    mobility: float

    @property
    def width(self) -> float:
        """S, deviation of the Gaussian with this mobility [m]."""
        return 1.0 / (6.0 * math.pi**1.5 * self.mobility)

    def __call__(self, law: Callable[[DragInputs], Drag], inputs: DragInputs, own: Array, volume: Array) -> Drag:
        """The drag of the undisturbed slip, as a coefficient on the slip seen; the law is evaluated twice.

        Args:
            law: drag for given inputs.
            inputs: with the fluid as it is seen.
            own: (N,) solid fraction that a particle sees of itself [-].
            volume: () or (N,) of the particles [m3].
        """
        first = law(inputs)
        visible = 1.0 - self.share(first.coefficient, inputs, own, volume)[0]
        slip = inputs.slip_velocity / visible[:, None]
        undisturbed = inputs._replace(particle_velocity=inputs.fluid_velocity - slip)
        second = law(undisturbed)
        hidden, beyond = self.share(second.coefficient, undisturbed, own, volume)
        void = 1.0 - inputs.solid_fraction
        share = void / (void + own)
        remainder = None if second.remainder is None else share[:, None] * second.remainder
        return Drag(second.coefficient * share / (1.0 - hidden), remainder, second.out_of_range | beyond)

    def share(self, coefficient: Array, inputs: DragInputs, own: Array, volume: Array) -> tuple[Array, Array]:
        """x, the part of the undisturbed slip that the wake hides (N,), and where it was too much (N,) bool.

        Args:
            coefficient: (N,) of the drag on the undisturbed slip [kg/s].
            inputs: with the undisturbed slip.
            own: (N,) solid fraction of the particle itself [-].
            volume: () or (N,) of the particles [m3].
        """
        viscosity = inputs.dynamic_viscosity
        others = jnp.maximum(inputs.solid_fraction - own, 0.0)
        inertia = oseen_factor(inputs.slip_speed * self.width * inputs.fluid_density / viscosity)
        screening = brinkman_factor(self.width**2 * others * coefficient / (volume * viscosity))
        share = inertia * screening * self.mobility * coefficient / (viscosity * (1.0 - others))
        return jnp.minimum(share, LARGEST_SHARE), share > LARGEST_SHARE


def oseen_factor(reynolds: Array) -> Array:
    """P(R) of the module's formula: 3/2 int_0^1 (1 - x^2) Q(R x) dx within 0.2 % [-]."""
    first, last = 3.0 * math.sqrt(math.pi) / 8.0, 4.0 / (3.0 * math.sqrt(math.pi))
    return 1.0 / (1.0 + reynolds * (first + (last - first) * reynolds / (reynolds + 1.95)))


def brinkman_factor(squared: Array) -> Array:
    """Q(y) of y^2, within 1 %: 1/Q = 1 + sqrt(pi) y + y^2 (pi - 2 + (4 - pi) y / (y + 2.55)) [-]."""
    y = safe_sqrt(squared)
    bend = math.pi - 2.0 + (4.0 - math.pi) * y / (y + 2.55)
    return 1.0 / (1.0 + math.sqrt(math.pi) * y + y**2 * bend)


def own_solid_fraction(grid: Grid, weights: Weights, volume: Array, cut: CutCells | None = None) -> Array:
    """Solid fraction that a particle sees of itself, V / V_cell sum_c w_c^2 / v_c, (N,) [-].

    v is the part of a cell that surfaces leave open, 1 without. w_c has what a wall mirrors into the cell. For kernels,
    and weights of one point.
    """
    weights = open_weights(each_cell_once(weights), cut)
    squared = weights.weight**2
    if cut is not None:
        open_part = in_reach(weights, cut.open_cells)
        squared = jnp.where(open_part > 0.0, squared / jnp.where(open_part > 0.0, open_part, 1.0), 0.0)
    return volume / grid.cell_volume * jnp.sum(squared, axis=1)


def kernel_mobility(half_width: tuple[float, ...], spacing: tuple[float, ...]) -> float:
    """M of the triangular kernel on a mesh, by the discrete Stokes problem in a large periodic box [1/m].

    Host side, about 0.1 s. The mean over the axes, which differ where cells are not cubes.

    Args:
        half_width: of the kernel along every axis [m].
        spacing: cell sides [m].
    """
    wide = max(max(spacing), max(half_width) / 2.0)
    counts = [round(CELLS * wide / h) for h in spacing]
    waves = [2.0 * math.pi * np.fft.fftfreq(n, h) for n, h in zip(counts, spacing, strict=True)]
    shapes = [[-1 if a == axis else 1 for a in range(3)] for axis in range(3)]
    symbols = [(2.0 / h * np.sin(0.5 * k * h)).reshape(s) ** 2 for h, k, s in zip(spacing, waves, shapes, strict=True)]
    squared = sum(symbols)
    squared[0, 0, 0] = np.inf
    power = np.ones(())
    for axis in range(3):
        power = power * _kernel_power(half_width[axis], spacing[axis], waves[axis]).reshape(shapes[axis])
    volume = math.prod(n * h for n, h in zip(counts, spacing, strict=True))
    seen = 0.0
    for axis in range(3):
        shared = np.cos(0.5 * waves[axis] * spacing[axis]).reshape(shapes[axis]) ** 2
        seen += float(np.sum(power * shared * (1.0 - symbols[axis] / squared) / squared)) / (3.0 * volume)
    return seen + HASIMOTO / (6.0 * math.pi * volume ** (1.0 / 3.0))


def _kernel_power(half_width: float, spacing: float, waves: np.ndarray) -> np.ndarray:
    """Mean over offsets of |sum_c w_c exp(-i k x_c)|^2 along one axis."""
    reach = math.ceil(half_width / spacing) + 2
    total = np.zeros(waves.shape)
    for offset in (np.arange(OFFSETS) + 0.5) / OFFSETS:
        sides = (np.arange(-reach, reach + 2) - offset) * spacing
        x = np.clip(sides / half_width, -1.0, 1.0)
        passed = np.where(x < 0, 0.5 * (1.0 + x) ** 2, 1.0 - 0.5 * (1.0 - x) ** 2)
        centres = 0.5 * (sides[1:] + sides[:-1])
        total += np.abs(np.exp(-1j * np.outer(waves, centres)) @ np.diff(passed)) ** 2
    return total / OFFSETS

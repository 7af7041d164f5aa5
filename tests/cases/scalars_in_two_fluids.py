"""What is dissolved in one of two fluids with a sharp surface: carried, and diffused within its fluid."""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.special import j1

from jaxdem.fluid.dissolved import PART, CarriedScalar, Dissolved, Phase, volume_of
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.scalar_transport import ScalarField, ScalarNumbers
from jaxdem.particles.regions import ball
from jaxdem.scalars.phases import Phases
from jaxdem.scalars.scalar_state import ScalarParameters
from jaxdem.setup.surface import cells_within
from tests.cases.registry import Figure, at_least, below, case, relative
from tests.cases.two_fluids import FREE, TwoFluids

PHASES: tuple[Phase, ...] = ("liquid", "second", "both")
CLOSED = ("closed",) * 4


class Sloshing:
    """Water under air in a closed box, the surface at an angle at the start, with a scalar in the water, one in the air
    and one in both."""

    def __init__(self, cells: int) -> None:
        self.box = TwoFluids((cells, cells), (1.0, 1.0), FREE)
        properties = self.box.properties(1000.0, gravity=(0.0, -9.81))
        dissolved = tuple(Dissolved(PART[phase], (None,) * 4) for phase in PHASES)
        self.properties = properties._replace(second=properties.second._replace(dissolved=dissolved))
        self.surface = self.box.below(0.5 + 0.2 * (self.box.middles(0) - 0.5))

    def after(self, value: Any, steps: int) -> FluidState:
        """The state after so many steps from this concentration of all three; not a number without convergence."""
        cells = self.box.grid.cells
        field = CarriedScalar(jnp.broadcast_to(jnp.asarray(value, float), cells), jnp.zeros(4))
        start = self.box.state(self.surface)._replace(dissolved=(field,) * 3)
        found = self.box.march(self.properties, start, steps, 0.05 / cells[0])
        worst = jnp.where(found.converged, 0.0, jnp.nan)
        return jax.tree.map(lambda leaf: leaf + worst, found.state)  # type: ignore[no-any-return]


def content(phase: Phase, fraction: Any, value: Any) -> float:
    """Of all cells, over the volume of one."""
    return float(jnp.sum(volume_of(phase, jnp.asarray(fraction), 1.0) * value))


@case(
    "what is dissolved in a sloshing tank", "heat", "conservation in one fluid; no new extrema; a uniform one",
    fast={"cells": 12, "steps": 60},
)  # fmt: skip
def sloshing(cells: int = 32, steps: int = 1000) -> list[Figure]:
    """Layers of 0 to 1, and then 0.3 everywhere, in the water, in the air and in both."""
    tank = Sloshing(cells)
    layers = np.broadcast_to(tank.box.middles(1), (cells, cells))
    found, even = tank.after(layers, steps), tank.after(0.3, steps)
    moved = float(jnp.abs(found.liquid_fraction - tank.surface).max())  # type: ignore[operator]
    figures = [at_least("the surface has moved, largest change of a fraction", 0.2, moved)]
    for phase, own, uniform in zip(PHASES, found.dissolved or (), even.dissolved or (), strict=True):
        kept = content(phase, found.liquid_fraction, own.value) / content(phase, tank.surface, layers)
        there = np.asarray(volume_of(phase, jnp.asarray(found.liquid_fraction), 1.0)) > 1e-6
        own_layers = layers[np.asarray(volume_of(phase, jnp.asarray(tank.surface), 1.0)) > 0.0]
        seen = np.asarray(own.value)[there]
        beyond = max(seen.max() - own_layers.max(), own_layers.min() - seen.min(), 0.0)
        figures += [
            below(f"content of {phase}, change over it", kept - 1.0, 1e-12),
            below(f"beyond the first extrema, {phase}", beyond, 1e-9),
            below(f"uniform concentration, change, {phase}", float(jnp.abs(uniform.value - 0.3).max()), 0.0),
        ]
    return figures


class Diffusing:
    """A scalar that diffuses in one of two fluids at rest, with 1 m2/s."""

    def __init__(
        self, box: TwoFluids, fraction: np.ndarray, phase: Phase, kinds: Any = CLOSED, values: Any = (0.0,) * 4
    ):
        numbers = ScalarNumbers(jnp.asarray(1.0), jnp.asarray(values or (0.0,) * 4), jnp.zeros(4))
        parameters = ScalarParameters((numbers,), None, None)
        self.phase, self.kinds, self.fraction = phase, kinds, fraction
        given = box.grid, box.solver.boundary, box.properties(10.0), parameters
        self.phases = Phases(*given, jnp.asarray(fraction), 1.0)

    def after(self, value: Any, duration: float) -> tuple[np.ndarray, np.ndarray]:
        """Concentration after a time [s], and what came in through the sides."""
        grid = self.phases.grid
        steps = math.ceil(duration * sum(1.0 / h**2 for h in grid.spacing) / 0.2)
        field = ScalarField("salt", self.kinds, True, steps, phase=self.phase)
        start = CarriedScalar(jnp.broadcast_to(jnp.asarray(value, float), grid.cells), jnp.zeros(4))
        diffused = jax.jit(lambda start: self.phases.diffused(field, 0, start, jnp.asarray(duration), False))
        found, passed = diffused(start)
        return np.asarray(found), np.asarray(passed)


@case(
    "diffusion in a half-filled tank", "heat", "cosines, and erfc from a wall; nothing through the surface",
    fast={"cells": (16, 32)},
)  # fmt: skip
def half_filled(cells: tuple[int, ...] = (16, 32, 64)) -> list[Figure]:
    """Salt in water that fills 0.53 of a tank, or 0.5: a cosine along the depth, and one along the surface, decay as
    exp(-D k^2 t); from a floor of concentration 1 it comes up as erfc(z / sqrt(4 D t)).

    Source: J. Crank, The Mathematics of Diffusion, 2nd ed. (1975), sections 2.4 and 3.3.
    """
    figures = []
    for level in (0.5, 0.53):
        errors = []
        for n in cells:
            box = TwoFluids((2, n), (2.0 / n, 1.0), FREE)
            fraction = np.asarray(box.below(level))
            still, wave = Diffusing(box, fraction, "liquid"), np.pi / level
            h, z = 1.0 / n, np.arange(n) / n
            top = np.clip(level, z + 1e-12, z + h)
            means = (np.sin(wave * top) - np.sin(wave * z)) / (wave * (top - z))
            found, duration = still.after(2.0 + means, 0.03)[0][0], 0.03
            wet = fraction[0] > 1e-6
            errors.append(float(np.abs(found - 2.0 - means * np.exp(-(wave**2) * duration))[wet].max()))
            kept = float(fraction[0] @ found / (fraction[0] @ (2.0 + means)))
            dry = float(np.abs(found - 2.0 - means)[fraction[0] == 0.0].max())
        order = math.log2(errors[0] / errors[-1]) / (len(errors) - 1)
        figures += [
            below(
                f"cosine along a depth of {level}, error over it, {cells[-1]} cells", errors[-1], 2.0 / cells[-1] ** 2
            ),
            at_least(f"order, depth {level}", 1.7, order),
            below(f"content, change over it, depth {level}", kept - 1.0, 1e-13),
            below(f"what the air has taken, depth {level}", dry, 1e-15),
        ]
    n = cells[-1]
    box = TwoFluids((2, n), (2.0 / n, 1.0), ("periodic", "periodic", "no_slip", "free_slip"))
    kinds = (*CLOSED[:2], "value", "closed")
    floor = Diffusing(box, np.asarray(box.below(0.53)), "liquid", kinds, (0.0, 0.0, 1.0, 0.0))
    found, passed = floor.after(0.0, 0.004)
    exact = np.asarray([math.erfc(z / math.sqrt(4.0 * 0.004)) for z in box.middles(1)[0]])
    figures += [
        below(f"erfc from the floor, largest error, {n} cells", np.abs(found[0] - exact)[box.middles(1)[0] < 0.5].max(),
              12.0 / n**2),
        relative("through the floor", 2.0 * math.sqrt(0.004 / math.pi) * 2.0 / n, float(passed[2]), 24.0 / n**2, "m3"),
    ]  # fmt: skip
    upright = TwoFluids((n, 8), (1.0, 0.5), FREE)
    along = Diffusing(upright, np.asarray(upright.below(0.28)), "second")
    wave = np.cos(np.pi * upright.middles(0)) * np.ones(upright.grid.cells)
    found, _ = along.after(wave, 0.1)
    decayed = wave * math.exp(-(np.pi**2) * 0.1)
    there = along.fraction < 1.0 - 1e-6
    figures.append(
        below("cosine along the surface, in the air above it", np.abs(found - decayed)[there].max(), 0.6 / n**2)
    )
    return figures


@case("diffusion in a disc of liquid", "heat", "J_1(1.8412 r/R) cos(angle) decays as exp(-D (1.8412/R)^2 t)",
      fast={"cells": (16, 32)})  # fmt: skip
def in_a_disc(cells: tuple[int, ...] = (16, 32, 64)) -> list[Figure]:
    """The slowest mode of a drop that nothing leaves, whose surface cuts cells at all angles.

    Source: M. Abramowitz, I. Stegun, Handbook of Mathematical Functions (1964), table 9.5, for the zero of J_1'.
    """
    radius, zero = 0.4, 1.841183781
    duration = 0.5 * radius**2 / zero**2
    errors = []
    for n in cells:
        grid = Grid((n, n), (1.0, 1.0), 1.0, (True, True))
        box = TwoFluids((n, n), (1.0, 1.0), ("periodic",) * 4)
        drop = Diffusing(box, cells_within(ball((0.5, 0.5), radius), grid), "liquid")
        x, y = box.middles(0) - 0.5, box.middles(1) - 0.5
        r = np.hypot(x, y)
        mode = j1(zero * np.minimum(r, radius) / radius) * x / r
        found, _ = drop.after(mode, duration)
        weights = drop.fraction * mode
        decay = float(np.sum(weights * found) / np.sum(weights * mode))
        errors.append(abs(math.log(decay) / 0.5 + 1.0))
    order = math.log2(errors[0] / errors[-1]) / (len(errors) - 1)
    return [
        below(f"rate of decay, {cells[-1]} cells", errors[-1], 0.3 / cells[-1]),
        at_least(f"order, {cells[0]} to {cells[-1]} cells", 0.8, order),
    ]

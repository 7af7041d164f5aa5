"""Heat of two fluids with a sharp surface: carried, conducted through layers, exchanged with grains."""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy import special

from jaxdem.fluid.carried_heat import CarriedHeat, HeatOfPhases
from jaxdem.fluid.fluid_state import FluidProperties, FluidState
from jaxdem.fluid.scalar_transport import ScalarField, ScalarNumbers
from jaxdem.particles.regions import ball
from jaxdem.scalars.phases import Phases
from jaxdem.scalars.scalar_state import FluidHeat, ScalarParameters, SecondHeat
from jaxdem.setup.surface import cells_within
from tests.cases.registry import Figure, at_least, below, case, relative
from tests.cases.two_fluids import TwoFluids

WATER_AND_AIR = (4.18e6, 1.2e3)
"""Heat capacities by volume [J/(m3 K)]."""


class WarmFluids:
    """Two fluids with temperatures, without conduction: what they carry."""

    def __init__(
        self,
        kinds: tuple[str, ...] = ("periodic",) * 4,
        cells: int = 16,
        ratio: float = 1000.0,
        gravity: float = 0.0,
        capacity: tuple[float, float] = WATER_AND_AIR,
        expansion: tuple[float, float] | None = None,
    ):
        self.box = TwoFluids((cells, cells), (1.0, 1.0), kinds)
        pair: Any = jnp.asarray(capacity[0]), jnp.asarray(capacity[1])
        lighter: Any = None if expansion is None else tuple(map(jnp.asarray, expansion))
        numbers = HeatOfPhases(pair, lighter, jnp.asarray(300.0), (None,) * 4)
        properties = self.box.properties(ratio, gravity=(0.0, -gravity))
        self.numbers = numbers
        self.properties: FluidProperties = properties._replace(second=properties.second._replace(heat=numbers))

    @property
    def drop(self) -> np.ndarray:
        """Liquid fraction of a drop in the middle [-]."""
        return cells_within(ball((0.5, 0.5), 0.27), self.box.grid)

    def stirred(self, fraction: np.ndarray, temperature: Any, stir: float) -> FluidState:
        """Fluids in an oblique stream with eddies of the box, of this temperature [K]."""
        n = self.box.grid.cells[0]
        face, middle = 2.0 * np.pi * np.arange(n + 1) / n, 2.0 * np.pi * (np.arange(n) + 0.5) / n
        u = 1.0 + stir * np.sin(face)[:, None] * np.cos(middle)
        v = 0.7 - stir * np.cos(middle)[:, None] * np.sin(face)
        return self.warm(self.box.state(fraction, u, v), temperature)

    def warm(self, state: FluidState, temperature: Any) -> FluidState:
        """With a temperature [K]."""
        field = jnp.broadcast_to(jnp.asarray(temperature, float), self.box.grid.cells)
        return state._replace(heat=CarriedHeat(field, jnp.zeros(4)))

    def march(self, state: FluidState, steps: int, time_step: float) -> FluidState:
        """The state after so many steps; not a number where a solve did not converge."""
        found = self.box.march(self.properties, state, steps, time_step)
        return found.state if bool(found.converged) else self.warm(found.state, jnp.nan)

    def heat(self, state: FluidState) -> float:
        """Of both fluids, over the volume of a cell [J/m3]."""
        content = self.numbers.content(state.liquid_fraction, 1.0)  # type: ignore[arg-type]
        return float(jnp.sum(content * temperature(state)))


def temperature(state: FluidState) -> np.ndarray:
    """On the cells [K]."""
    assert state.heat is not None
    return np.asarray(state.heat.temperature)


@case(
    "hot drop in a stirred stream", "heat", "conservation of heat; no new extrema; a uniform temperature",
    fast={"ratios": (1000.0,), "steps": 60},
)  # fmt: skip
def hot_drop(ratios: tuple[float, ...] = (1.0, 30.0, 1000.0), steps: int = 2000) -> list[Figure]:
    """A drop that is 100 K warmer than the gas, in a periodic box, without conduction; then all at one temperature."""
    figures = []
    for ratio in ratios:
        fluids = WarmFluids(ratio=ratio, capacity=(4.18e6, 4.18e6 / ratio))
        fraction = fluids.drop
        hot = fluids.stirred(fraction, np.where(fraction > 0.0, 400.0, 300.0), 0.5)
        found = fluids.march(hot, steps, 1.0 / 128.0)
        warm, before = temperature(found), fluids.heat(hot)
        even = temperature(fluids.march(fluids.stirred(fraction, 300.0, 0.5), steps, 1.0 / 128.0))
        figures += [
            below(f"heat of both fluids, change over it, ratio {ratio:g}", fluids.heat(found) / before - 1.0, 1e-12),
            below(f"beyond the first extrema, ratio {ratio:g}", max(warm.max() - 400.0, 300.0 - warm.min(), 0.0),
                  1e-9, "K"),
            below(f"uniform temperature, change, ratio {ratio:g}", np.abs(even - 300.0).max(), 1e-10, "K"),
        ]  # fmt: skip
    return figures


@case(
    "sloshing of warm water", "heat", "conservation of heat; a uniform temperature", fast={"cells": 12, "steps": 60},
)  # fmt: skip
def sloshing(cells: int = 32, steps: int = 1000) -> list[Figure]:
    """Water under air in a closed box, the surface at an angle at the start: warm at the top, then all alike."""
    fluids = WarmFluids(("free_slip",) * 4, cells, gravity=9.81)
    box, time_step = fluids.box, 0.05 / cells
    surface = box.below(0.5 + 0.2 * (box.middles(0) - 0.5))
    layered = fluids.warm(box.state(surface), 300.0 + 50.0 * box.middles(1))
    found = fluids.march(layered, steps, time_step)
    even = temperature(fluids.march(fluids.warm(box.state(surface), 350.0), steps, time_step))
    return [
        below("heat of both fluids, change over it", fluids.heat(found) / fluids.heat(layered) - 1.0, 1e-12),
        below("uniform temperature, change", np.abs(even - 350.0).max(), 1e-10, "K"),
        at_least("the surface has moved, largest change of a fraction",
                 0.2, float(jnp.abs(found.liquid_fraction - layered.liquid_fraction).max())),
    ]  # fmt: skip


class Layers:
    """Two layers at rest in a box of 1 m; the fluid below has 10 times the conductivity and capacity."""

    conductivity, capacity = (5.0, 0.5), (500.0, 50.0)

    def __init__(self, cells: int, level: float, walls: tuple[float, float] | None = None):
        number = jnp.asarray
        self.box = TwoFluids((2, cells), (2.0 / cells, 1.0), ("periodic", "periodic", "no_slip", "no_slip"))
        at_sides = (0.0, 0.0, *((0.0, 0.0) if walls is None else walls))
        own = ScalarNumbers(number(self.conductivity[0]), number(at_sides), jnp.zeros(4))
        first = FluidHeat(number(self.capacity[0] / 1000.0), number(0.0), number(300.0))
        second = SecondHeat(number(self.capacity[1] / 100.0), number(self.conductivity[1]), number(0.0))
        parameters = ScalarParameters((own,), first, None, second=second)
        kinds = ("closed", "closed", *(("closed",) * 2 if walls is None else ("value",) * 2))
        self.kinds, self.heights = kinds, self.box.middles(1)[0]
        self.fraction = np.asarray(self.box.below(level))
        boundary, properties = self.box.solver.boundary, self.box.properties(10.0)
        self.phases = Phases(self.box.grid, boundary, properties, parameters, number(self.fraction), 1.0)

    def after(self, temperature: Any, duration: float) -> np.ndarray:
        """(N,) temperatures of the column after conduction [K]."""
        h = self.box.grid.spacing[1]
        steps = math.ceil(duration * 2.0 * 0.01 / h**2 / 0.4)
        field = ScalarField("temperature", self.kinds, True, steps)  # type: ignore[arg-type]
        start = CarriedHeat(jnp.broadcast_to(jnp.asarray(temperature, float), self.box.grid.cells), jnp.zeros(4))
        conducted = jax.jit(lambda heat: self.phases.conducted(field, "open", heat, jnp.asarray(duration), False))
        return np.asarray(conducted(start)[0])[0]


@case("two layers between walls", "heat", "layers in series: q = (T_1 - T_2) / (H_1/k_1 + H_2/k_2)", fast={"cells": 8})
def layers_in_series(cells: int = 32, parts: tuple[float, ...] = (0.0, 0.3)) -> list[Figure]:
    """Liquid and a second fluid between a wall of 400 K and one of 300 K; the surface lies on faces, or in cells."""
    figures = []
    for part in parts:
        level = (cells // 2 + part) / cells
        layers = Layers(cells, level, (400.0, 300.0))
        (k1, k2), heights = layers.conductivity, layers.heights
        through = 100.0 / (level / k1 + (1.0 - level) / k2)
        exact = np.where(heights < level, 400.0 - through * heights / k1, 300.0 + through * (1.0 - heights) / k2)
        found = layers.after(300.0, 1000.0)
        pure = np.abs(layers.fraction[0] - 0.5) > 0.499
        flux = k1 * (400.0 - found[0]) * 2.0 * cells
        figures += [
            relative(f"heat flux, the surface {part:g} of a cell above a face", through, flux, 1e-8, "W/m2"),
            below(f"temperatures of cells full of one fluid, {part:g}", np.abs(found - exact)[pure].max(), 1e-6, "K"),
        ]
    return figures


@case(
    "two layers that touch", "heat", "contact of two half-spaces: T = (e_1 T_1 + e_2 T_2)/(e_1 + e_2), error functions",
    fast={"cells": (16, 32)},
)  # fmt: skip
def contact_of_layers(cells: tuple[int, ...] = (16, 32, 64)) -> list[Figure]:
    """Hot liquid under a cold second fluid, before the warmth has reached the walls: profile by profile.

    e = sqrt(k C) is the effusivity; each side follows an error function of z/sqrt(4 a t) with its own diffusivity a.
    Source: H. S. Carslaw, J. C. Jaeger, Conduction of Heat in Solids, 2nd ed. (1959), section 2.15.
    """
    errors, time = [], 0.8
    for n in cells:
        layers = Layers(n, 0.5)
        both = list(zip(layers.conductivity, layers.capacity, strict=True))
        (a1, a2), (e1, e2) = ([k / c for k, c in both], [math.sqrt(k * c) for k, c in both])
        contact, z = (400.0 * e1 + 300.0 * e2) / (e1 + e2), layers.heights - 0.5
        below_it = contact + (400.0 - contact) * special.erf(-z / math.sqrt(4.0 * a1 * time))
        above_it = contact + (300.0 - contact) * special.erf(z / math.sqrt(4.0 * a2 * time))
        found = layers.after(np.where(z < 0.0, 400.0, 300.0), time)
        errors.append(float(np.abs(found - np.where(z < 0.0, below_it, above_it)).max()))
    order = math.log2(errors[0] / errors[-1]) / (len(errors) - 1)
    return [
        below(f"largest error over the step of 100 K, {cells[-1]} cells", errors[-1] / 100.0, 6.0 / cells[-1] ** 2),
        at_least(f"order, {cells[0]} to {cells[-1]} cells", 1.7, order),
    ]

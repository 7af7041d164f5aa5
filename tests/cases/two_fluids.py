"""Two fluids with a sharp surface: rest, streams, layers, waves, drops, a dam that breaks."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxdem.fluid.advection import VanLeer
from jaxdem.fluid.boundary import Boundary, Side
from jaxdem.fluid.fluid_state import FluidProperties, FluidState
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.second_fluid import SecondFluid
from jaxdem.fluid.two_fluids import TwoFluidSolver

LIQUID = 1000.0
"""Density of the liquid of all cases [kg/m3]."""


class TwoFluids:
    """Two fluids in a box."""

    def __init__(
        self,
        cells: tuple[int, ...],
        size: tuple[float, ...],
        kinds: tuple[str, ...],
        tension: bool = False,
        viscous: bool = True,
    ):
        periodic = tuple(kinds[2 * axis] == "periodic" for axis in range(len(cells)))
        self.grid = Grid(cells, size, 1.0, periodic)
        sides = tuple(Side(n // 2, bool(n % 2), kind) for n, kind in enumerate(kinds))
        self.solver = TwoFluidSolver(self.grid, Boundary(sides), VanLeer(), viscous, has_tension=tension)
        self._march = jax.jit(self._marched)

    def properties(
        self,
        ratio: float = 1000.0,
        viscosity: tuple[float, float] = (1e-6, 1e-6),
        gravity: tuple[float, ...] | None = None,
        tension: float = 0.0,
        levels: dict[int, float] | None = None,
        velocity: dict[int, tuple[float, ...]] | None = None,
    ) -> FluidProperties:
        """Numbers of both fluids; levels and velocities by the number of a side."""
        dimension = self.grid.dimension
        number, none = jnp.asarray, (0.0,) * dimension
        at = [(levels or {}).get(n, 0.0) for n in range(2 * dimension)]
        second = SecondFluid(number(LIQUID / ratio), number(viscosity[1]), number(tension), number(at))
        speeds = tuple(number((velocity or {}).get(n, none)) for n in range(2 * dimension))
        weight = number((*none[1:], -9.81) if gravity is None else gravity)
        return FluidProperties(number(LIQUID), number(viscosity[0]), speeds, gravity=weight, second=second)

    def state(self, fraction: np.ndarray, *faces: Any) -> FluidState:
        """Fluids of this liquid fraction with these face velocities, at rest without; zero pressure."""
        grid = self.grid
        faces = faces or (0.0,) * grid.dimension
        shapes = [grid.face_shape(axis) for axis in range(grid.dimension)]
        field = tuple(jnp.broadcast_to(jnp.asarray(f, float), s) for f, s in zip(faces, shapes, strict=True))
        liquid = jnp.broadcast_to(jnp.asarray(fraction, float), grid.cells)
        supplied = jnp.zeros(1 + 2 * grid.dimension).at[0].set(jnp.sum(liquid) * grid.cell_volume)
        return FluidState(field, jnp.zeros(grid.cells), None, liquid_fraction=liquid, liquid_supplied=supplied)

    def march(self, properties: FluidProperties, state: FluidState, steps: int, time_step: float) -> Marched:
        """The state after so many steps, and the worst of them."""
        return self._march(properties, state, steps, jnp.asarray(time_step))

    def _marched(self, properties: FluidProperties, state: FluidState, steps: int, time_step: jax.Array) -> Marched:
        def body(k: Any, carry: Marched) -> Marched:
            state, worst, iterations, ok = carry
            result = self.solver.step(properties, state, k * time_step, time_step)
            most = jnp.maximum(iterations, result.solver.iterations)
            return Marched(result.state, jnp.maximum(worst, result.divergence), most, ok & result.solver.converged)

        start = Marched(state, jnp.zeros(()), jnp.zeros((), jnp.int32), jnp.asarray(True))
        found: Marched = lax.fori_loop(0, steps, body, start)
        return found

    def middles(self, axis: int) -> np.ndarray:
        """Centres of the cells along an axis, of size 1 along the others [m]."""
        shape = [-1 if a == axis else 1 for a in range(self.grid.dimension)]
        return ((np.arange(self.grid.cells[axis]) + 0.5) * self.grid.spacing[axis]).reshape(shape)

    def below(self, height: Any) -> np.ndarray:
        """Fraction of liquid below a height along the last axis, which may depend on the place along the others."""
        h, last = self.grid.spacing[-1], self.grid.dimension - 1
        return np.broadcast_to(np.clip((height - self.middles(last)) / h + 0.5, 0.0, 1.0), self.grid.cells)


class Marched(NamedTuple):
    """Where a march has got to: state, largest divergence, most iterations, whether every solve converged."""

    state: FluidState
    divergence: jax.Array
    iterations: jax.Array
    converged: jax.Array


def largest(faces: Any) -> float:
    """Largest size of a face field."""
    return max(float(jnp.abs(f).max()) for f in faces)

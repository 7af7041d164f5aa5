"""A fluid in a box, for the cases and the tests of the fluid."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxdem.fluid.advection import VanLeer
from jaxdem.fluid.boundary import Boundary, Side
from jaxdem.fluid.fluid_state import FluidProperties, FluidState, ParticleFields
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.momentum import FluidSolver

PERIODIC = ("periodic",) * 4


class Flow:
    """A fluid in a box: one compilation for any numbers of steps and time step."""

    def __init__(self, cells, size, kinds, patches=None, scheme=None, density=1.0, depth=1.0, inlet=None):
        periodic = tuple(kinds[2 * a] == "periodic" for a in range(len(cells)))
        patches, inlet = patches or {}, inlet or {}
        sides = (
            Side(n // 2, bool(n % 2), k, *patches.get(n, (None, None)), **(inlet if k == "inlet" else {}))
            for n, k in enumerate(kinds)
        )
        self.grid = Grid(cells, size, depth, periodic)
        self.solver = FluidSolver(self.grid, Boundary(tuple(sides)), scheme or VanLeer(), True)
        self.density = density
        self.still = np.zeros(len(cells))
        self.march = jax.jit(self._march)

    def properties(self, viscosity, velocity=None, dtype=jnp.float64, smagorinsky=None):
        """Numbers of the fluid; `velocity` maps the number of a side to its velocity."""
        velocity = velocity or {}
        speeds = (velocity.get(n, self.still) for n in range(2 * len(self.still)))
        numbers = (jnp.asarray(self.density, dtype), jnp.asarray(viscosity, dtype))
        coefficient = None if smagorinsky is None else jnp.asarray(smagorinsky, dtype)
        return FluidProperties(*numbers, tuple(jnp.asarray(v, dtype) for v in speeds), coefficient)

    def state(self, *faces, void_fraction=None, dtype=jnp.float64):
        """Fluid with these face velocities (at rest without), zero pressure."""
        grid = self.grid
        shapes = [grid.face_shape(a) for a in range(grid.dimension)]
        faces = faces or [np.zeros(s) for s in shapes]
        faces = tuple(jnp.broadcast_to(jnp.asarray(f, dtype), s) for f, s in zip(faces, shapes, strict=True))
        g = None if void_fraction is None else jnp.asarray(void_fraction, dtype)
        return FluidState(faces, jnp.zeros(grid.cells, dtype), g)

    def _march(self, properties, state, steps, time_step, void_fraction=None):
        """State after the steps, and the largest divergence reported and iterations taken."""

        def body(k, carry):
            state, worst, ok = carry
            # Once moved, the void fraction stays.
            particles = None if void_fraction is None else ParticleFields(void_fraction)
            result = self.solver.step(properties, state, k * time_step, time_step, particles)
            return result.state, jnp.maximum(worst, result.divergence), ok & result.solver.converged

        zero = jnp.zeros((), state.pressure.dtype)
        return lax.fori_loop(0, steps, body, (state, zero, jnp.asarray(True)))

    def centres(self, axis):
        """Cell centres along an axis."""
        return (np.arange(self.grid.cells[axis]) + 0.5) * self.grid.spacing[axis]

    def faces(self, axis):
        """Faces along their own axis."""
        return np.arange(self.grid.cells[axis] + 1) * self.grid.spacing[axis]


def linear_faces(grid: Grid, gradient: np.ndarray) -> tuple[jax.Array, ...]:
    """The flow u_i = sum_k G_ik x_k on the faces of a box without periodic sides; `gradient` (D, D) [1/s]."""
    faces = []
    for i in range(grid.dimension):
        points = [
            (np.arange(n + 1.0) if a == i else np.arange(n) + 0.5) * h
            for a, (n, h) in enumerate(zip(grid.cells, grid.spacing, strict=True))
        ]
        x = np.meshgrid(*points, indexing="ij")
        faces.append(jnp.asarray(sum(gradient[i][k] * x[k] for k in range(grid.dimension))))
    return tuple(faces)


def random_faces(grid, seed=0):
    """A random velocity field, zero on walls, doubled on periodic axes."""
    random, result = np.random.default_rng(seed), []
    for axis in range(grid.dimension):
        f = random.normal(size=grid.face_shape(axis))
        view = np.moveaxis(f, axis, 0)
        view[-1] = view[0] if grid.periodic[axis] else 0.0
        if not grid.periodic[axis]:
            view[0] = 0.0
        result.append(f)
    return result

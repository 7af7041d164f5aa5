"""Smagorinsky's viscosity beside surfaces: a linear shear flow has one and keeps its stress."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.coupling.open_parts import corner_points
from jaxdem.fluid.boundary import Sides
from jaxdem.fluid.cut_eddy import eddy_beside_surfaces
from jaxdem.fluid.cut_stress import CutViscosity, cut_stress
from jaxdem.fluid.diffusion import strain_rates
from jaxdem.fluid.open_faces import LEAST_OPEN
from jaxdem.fluid.subgrid import eddy_viscosity
from jaxdem.setup.cut_cells import FluidSurface, cut_cells_of
from jaxdem.solids.clipping import positive_part
from tests.cases.flows import Flow
from tests.cases.tiers import tiered

SHEAR, LENGTH, VISCOSITY = 3.0, 0.04, 0.002


@pytest.mark.parametrize("angle", tiered([0.0, 17.0, 45.0], first=[17.0]))
def test_a_linear_shear_flow_along_a_tilted_wall_has_one_eddy_viscosity_and_is_kept(angle):
    flow = Flow((20, 16), (2.0, 1.6), ("no_slip",) * 4)
    along = np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))])
    plane = FluidSurface(lambda x: (x - np.array([1.0, 0.73])) @ np.array([-along[1], along[0]]))
    cut = jax.tree.map(jnp.asarray, cut_cells_of(flow.grid, [plane])[0])
    corners, velocity = plane.distance(corner_points(flow.grid)), []
    for axis in range(2):
        part = positive_part(corners, (1 - axis,))
        mean = np.where(part.fraction >= LEAST_OPEN, part.integral / np.maximum(part.fraction, LEAST_OPEN), 0.0)
        velocity.append(jnp.asarray(SHEAR * mean * along[axis]))
    sides = Sides(flow.solver.boundary, flow.properties(1.0).side_velocity, jnp.asarray(0.0))

    @jax.jit
    def found(cut, velocity):
        eddy = eddy_beside_surfaces(flow.grid, sides, cut.open_faces, velocity, LENGTH)
        viscosity = CutViscosity(jnp.asarray(VISCOSITY), eddy)
        stress, _ = cut_stress(flow.grid, sides, cut, velocity, viscosity, False)
        friction = tuple(
            nu * r * u for nu, r, u in zip(viscosity.on_faces(flow.grid), cut.friction, velocity, strict=True)
        )
        return eddy, eddy_viscosity(strain_rates(flow.grid, sides, velocity), LENGTH), stress, friction

    eddy, plain, stress, friction = (jax.tree.map(np.asarray, part) for part in found(cut, tuple(velocity)))
    inner = np.zeros((20, 16), bool)
    inner[6:-6, 6:-6] = True
    fluid = inner & (np.asarray(cut.open_cells) > 0.0)
    expected = LENGTH**2 * SHEAR
    assert eddy[fluid] == pytest.approx(expected, rel=1e-12)
    # Negative control: differences with cut faces are no slopes.
    assert np.abs(plain[fluid] / expected - 1.0).max() > 0.1
    for s, f in zip(stress, friction, strict=True):
        assert np.abs(s - f)[6:-6, 6:-6].max() < 1e-12
    if angle == 0.0:  # the friction of all rows at the wall is the stress that the flow has
        assert friction[0][10].sum() * 0.1 == pytest.approx((VISCOSITY + expected) * SHEAR, rel=1e-12)


def test_the_flow_gains_what_the_surfaces_lose_with_eddies():
    """Not for a shear flow alone: noise between a cylinder and a plane; and the eddies count."""
    flow = Flow((12, 12), (0.4, 0.4), ("no_slip",) * 4)
    surfaces = [
        FluidSurface(lambda x: 0.19 - np.hypot(x[..., 0] - 0.2, x[..., 1] - 0.2)),
        FluidSurface(lambda x: x[..., 1] - 0.1 + 0.2 * x[..., 0], no_slip=False),
    ]
    cut = jax.tree.map(jnp.asarray, cut_cells_of(flow.grid, surfaces)[0])
    solver = dataclasses.replace(flow.solver, surfaces=2)
    rng = np.random.default_rng(0)
    noise = [0.1 * rng.standard_normal(flow.grid.face_shape(axis)) for axis in range(2)]
    start = flow.state(*[n * (np.asarray(a) > 0.0) for n, a in zip(noise, cut.open_faces, strict=True)])
    volume = flow.grid.cell_volume

    @jax.jit
    def step(coefficient, state):
        properties = flow.properties(1e-3, smagorinsky=coefficient)._replace(cut=cut)
        found = solver.step(properties, state, jnp.asarray(0.0), jnp.asarray(1e-3))
        parts = zip(cut.inertia, found.state.face_velocity, cut.open_faces, strict=True)
        return found, jnp.stack([jnp.sum(m * volume * u * (a > 0.0)) for m, u, a in parts])

    loads = {}
    for coefficient in (0.0, 0.4):
        first, before = step(coefficient, start)
        second, after = step(coefficient, first.state)
        load = np.asarray(second.surface_load)[:, :, 0]
        change = np.asarray(after - before) / 1e-3
        assert np.abs(change + load.sum(axis=0)).max() < 1e-11 * np.abs(load).sum()
        loads[coefficient] = load
    assert np.abs(loads[0.4] - loads[0.0]).max() > 0.01 * np.abs(loads[0.0]).max()

"""The exchange between a fluid in slabs of the box and the particles of each, against that on one device."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.numerics.blocks import Blocks
from tests.cases.fluid_slabs import ALONG_X, SAME, SLABS, compared, coupled_scene, in_slabs, run_on_slabs
from tests.cases.tiers import COMBINATION

SCENES = {
    "centre, closed box": coupled_scene(2, {}, void_fraction="centre"),
    "divided, on a coarser mesh": coupled_scene(
        2,
        ALONG_X,
        void_fraction="divided",
        drag_inputs_coarsened=2,
        deconvolution=0.05,
        lift=["saffman_mei", "magnus"],
        rotational_drag=True,
    ),
    "diffusion, jet, model B": coupled_scene(
        2, {"left": {"kind": "inlet", "velocity": 0.2}, "right": {"kind": "outlet"}}, "B", void_fraction="diffusion"
    ),
    "forces with a memory, 3-D": coupled_scene(3, ALONG_X, virtual_mass=0.5, basset=4),
}


def rows_of(particles, number, axis, width, drift):
    """The particles of every slab as rows (B, R, ...), some of them empty, and their numbers (B, R), -1 for none.

    A particle `drift` above the border of its slab is still one of it.
    """
    place = np.asarray(particles.position)[:, axis] - drift
    slab = np.clip(np.floor(place / width).astype(int), 0, number - 1)
    room = np.bincount(slab, minlength=number).max() + 2
    table = np.full((number, room), -1)
    for k in range(number):
        own = np.flatnonzero(slab == k)
        table[k, : len(own)] = own

    def of(rows, axis=0):
        return np.moveaxis(
            np.moveaxis(np.asarray(rows), axis, 0)[np.maximum(table, 0)], 1, axis if axis < 0 else axis + 1
        )

    rows = jax.tree.map(of, particles._replace(contact_spring=(), wall_spring=(), fluid_memory=None))
    memory = jax.tree.map(lambda x: of(x, -2), particles.fluid_memory)
    return rows._replace(fluid_memory=memory, active=table >= 0), table


@pytest.mark.parametrize(
    ("name", "number", "axis", "drift"),
    [
        pytest.param("centre, closed box", 2, 1, 0.01, marks=COMBINATION),
        pytest.param("divided, on a coarser mesh", 2, 0, 0.0, marks=COMBINATION),
        ("diffusion, jet, model B", 4, 0, 0.0),
        pytest.param("forces with a memory, 3-D", 2, 2, 0.02, marks=COMBINATION),
    ],
)
def test_exchange_is_that_of_one_device(name, number, axis, drift):
    """One coupling interval among resting particles: the same void fraction, velocity, pressure and forces, particle by
    particle; momentum given and taken balances, and no volume is lost, to rounding. Empty rows count for nothing.

    The pressure is solved to 2e-12 U/h, which is what the bounds stand for: they are 1e-11 of the largest value.
    """
    scene = jaxdem.load_scene(SCENES[name])
    simulation, parameters = jaxdem.build(scene)
    state, _ = jaxdem.initial_state(scene, simulation, parameters)
    coupling, grid, mixture = simulation.coupling, simulation.fluid.solver.grid, parameters.mixture
    draw, particles = np.random.default_rng(0), state.particles
    particles = particles._replace(
        velocity=0.1 * draw.normal(size=particles.velocity.shape),
        angular_velocity=draw.normal(size=particles.angular_velocity.shape),
        fluid_memory=jax.tree.map(lambda x: 1e-6 * draw.normal(size=x.shape), particles.fluid_memory),
    )
    start = jnp.zeros(())
    fluid, forces, _, report = jax.jit(coupling.advance)(mixture, state.fluid, particles, start)
    blocks, slabs = in_slabs(grid, number, axis, state.fluid)
    rows, table = rows_of(particles, number, axis, grid.size[axis] / number, drift)
    own = coupling.in_blocks(Blocks(number, axis, grid.periodic[axis]), drift)
    given = [SAME, SLABS, SLABS, SAME], [mixture, slabs, rows, start]
    (found, many, _, figures), text = run_on_slabs(number, own.advance, *given)
    assert "all-gather" not in text
    assert np.max(compared(blocks, found, fluid)) < 1e-11
    there = table >= 0

    def same(rows, exact, what):
        exact = np.asarray(exact)
        whole = np.zeros_like(exact)
        whole[table[there]] = np.asarray(rows)[there]
        np.testing.assert_allclose(whole, exact, rtol=0, atol=1e-11 * max(np.abs(exact).max(), 1e-30), err_msg=what)

    for field in ("drag", "pressure_gradient", "viscous", "law", "torque"):
        if getattr(forces, field) is not None:
            same(getattr(many, field), getattr(forces, field), field)
    for force, mean in forces.further.items():
        same(many.further[force].given, mean.given, force)
    for slab in range(number):
        assert figures.momentum[slab] < 1e-14 and figures.volume[slab] < 1e-14
        np.testing.assert_allclose(figures.void_fraction[slab], report.void_fraction, rtol=1e-14)
        assert figures.out_of_range[slab] == report.out_of_range

"""A drag law that sees the fluid averaged to a coarser mesh: even flow, momentum, what is compiled and what refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.check.check import check_scene
from jaxdem.closures.base import Drag
from jaxdem.coupling.coupled import Mixture
from jaxdem.coupling.kernel import kernel_weights
from jaxdem.coupling.void_fraction import solid_fraction
from jaxdem.errors import InputError
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.grid import face_average, face_total
from jaxdem.particles.integrate import ParticleState

CELLS, SIDE, DURATION = 6, 0.24, 0.01


def law(inputs):
    """A drag that grows with slip and solid fraction, and a force across the slip."""
    slip = inputs.slip_velocity
    coefficient = (0.02 + 0.2 * inputs.slip_speed) * (1.0 + 3.0 * inputs.solid_fraction)
    across = 0.4 * jnp.stack((-slip[:, 1], slip[:, 0]), axis=1)
    return Drag(coefficient, coefficient[:, None] * across, jnp.zeros(len(slip), bool))


class Box:
    """36 spheres in a periodic box of 6 x 6 cells, through one fluid step."""

    def __init__(self):
        line = (np.arange(CELLS) + 0.5) * SIDE / CELLS
        self.lattice = np.stack([a.ravel() for a in np.meshgrid(line, line, indexing="ij")], axis=1)
        scene = jaxdem.load_scene(
            dict(
                precision="float64",
                domain=dict(size=[SIDE, SIDE], depth=0.04, gravity=[0.0, 0.0]),
                particles=dict(radius=0.01, density=2650.0, position=self.lattice.tolist()),
                contact=dict(young_modulus=1e5, speed=0.5),
                fluid=dict(cells=[CELLS, CELLS], viscosity=1e-5, time_step=DURATION),
                boundary={side: dict(kind="periodic") for side in ("left", "right", "bottom", "top")},
                # A kernel with room for two coarse cells on either side in the periodic box.
                coupling=dict(drag_inputs_coarsened=2, kernel_width=dict(diameters=1.0, cells=0.5)),
                time=dict(end=1.0, output_interval=0.1),
            )
        )
        simulation, self.parameters = jaxdem.build(scene)
        self.coupling = simulation.coupling
        self.grid = self.coupling.interval.solver.grid
        self.void_fraction = jax.jit(self._void_fraction)
        self.step = jax.jit(self._step)

    def _step(self, fluid, particles):
        p, now = self.parameters, jnp.zeros(())
        mixture = Mixture(law, p.drag_scale, p.fluid, p.bodies, p.gravity)
        fluid, forces, _, report = self.coupling.advance(mixture, fluid, particles, now)
        return fluid, forces, report

    def state(self, position, velocity, faces):
        # NumPy arrays: one type for all states, so that nothing is compiled twice.
        zero = np.zeros_like(position)
        particles = ParticleState(position, None, velocity, zero[:, :1], (), (), zero, zero)
        return FluidState(faces, np.zeros((CELLS, CELLS)), np.asarray(self.void_fraction(position))), particles

    def _void_fraction(self, position):
        weights = kernel_weights(self.grid, self.coupling.deposition.half_width, position)
        return 1.0 - solid_fraction(self.grid, weights, self.parameters.bodies.volume)

    def even(self):
        shapes = [self.grid.face_shape(axis) for axis in range(2)]
        faces = tuple(np.full(shape, u) for shape, u in zip(shapes, (0.4, 0.1), strict=True))
        velocity = np.tile([0.13, -0.05], (len(self.lattice), 1))
        return self.state(self.lattice, velocity, faces)

    def stirred(self):
        random = np.random.default_rng(0)
        k, h = 2 * np.pi / SIDE, SIDE / CELLS
        faces, centres = np.arange(CELLS + 1) * h, (np.arange(CELLS) + 0.5) * h
        u = 0.3 * np.sin(k * faces)[:, None] * np.cos(k * centres)[None] + 0.2
        w = -0.3 * np.cos(k * centres)[:, None] * np.sin(k * faces)[None]
        position = self.lattice + random.uniform(-0.009, 0.009, self.lattice.shape)
        velocity = random.normal(0.0, 0.05, self.lattice.shape)
        return self.state(position, velocity, (u, w))

    def momentum(self, fluid):
        flux = tuple(
            g * u for g, u in zip(face_average(self.grid, fluid.void_fraction), fluid.face_velocity, strict=True)
        )  # fmt: skip
        return 1000.0 * self.grid.cell_volume * np.array([float(x) for x in face_total(self.grid, flux)])


@pytest.fixture(scope="module")
def box():
    return Box()


def force_on_own_mesh(forces):
    """What the law gives for the fluid as the mesh itself shows it."""
    drag = law(forces.inputs)
    return np.asarray(drag.coefficient[:, None] * forces.inputs.slip_velocity + drag.remainder)


def test_an_even_flow_is_seen_as_it_is(box):
    """One particle at the same place of every cell: the averages are the values."""
    _, forces, _ = box.step(*box.even())
    np.testing.assert_allclose(forces.law, force_on_own_mesh(forces), rtol=1e-12)


def test_momentum_is_conserved_where_the_law_sees_another_velocity(box):
    """What the remainder makes up for is taken from the faces, as all drag is."""
    fluid, particles = box.stirred()
    after, forces, report = box.step(fluid, particles)
    given = DURATION * np.asarray(forces.total).sum(axis=0)
    assert np.abs(given).max() > 1e-4
    np.testing.assert_allclose(box.momentum(after) - box.momentum(fluid), -given, atol=1e-10)
    assert float(report.momentum) < 1e-10


def test_the_force_is_the_law_s_on_the_averaged_velocity(box):
    """The mean force of an interval is the law's on averaged inputs, up to what the fluid changes in it."""
    forces = box.step(*box.stirred())[1]
    own = force_on_own_mesh(forces)
    apart = np.abs(np.asarray(forces.law) - own).max()
    assert apart > 0.1 * np.abs(own).max()
    assert np.abs(np.asarray(forces.drag - forces.law)).max() < 0.2 * apart


def tables(**more):
    return {
        "domain": {"size": [0.4, 0.4]},
        "particles": {"radius": 0.01, "density": 2650.0, "position": [[0.2, 0.2]]},
        "contact": {"young_modulus": 5e6},
        "fluid": {"cells": [8, 8]},
        "coupling": {"drag_inputs_coarsened": 2},
        "time": {"end": 0.1, "output_interval": 0.1},
    } | more


def test_it_is_compiled_in_where_it_is_asked_for_only():
    """The check names the mesh; without the key the simulation has no view of another mesh."""
    assert "inputs of the drag law averaged to 4 x 4 cells" in check_scene(jaxdem.load_scene(tables())).compiled_in
    simulation, _ = jaxdem.build(jaxdem.load_scene(tables(coupling={})))
    assert simulation.coupling.drag.coarse_inputs is None


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ({"coupling": {"drag_inputs_coarsened": 9}}, "leave a single cell"),
        ({"coupling": {"drag_inputs_coarsened": 0}}, "greater than"),
        ({"output": {"samples": 0.01}}, "training samples are only written"),
    ],
)
def test_what_makes_no_sense_is_refused(more, told):
    """With the key and the reason."""
    with pytest.raises(InputError, match=told) as refused:
        jaxdem.load_scene(tables(**more))
    assert "drag_inputs_coarsened" in str(refused.value)

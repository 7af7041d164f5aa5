"""The velocity that coarse cells and kernels smoothed, given back to the drag law: waves, momentum, stability, data,
refusals."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.check.check import check_scene
from jaxdem.closures.base import Drag
from jaxdem.coupling.coupled import Mixture
from jaxdem.errors import InputError
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.grid import Grid, face_average, face_total, second_differences
from jaxdem.particles.integrate import ParticleState
from jaxdem.setup.deconvolution import deconvolution_limit
from tests.cases.tiers import tiered

CELLS, SIDE, DURATION, STRENGTH = 12, 0.24, 0.01, 0.2


def law(inputs):
    """A coefficient that grows with the slip."""
    coefficient = 0.02 + 0.2 * inputs.slip_speed
    return Drag(coefficient, None, jnp.zeros(len(coefficient), bool))


def tables(strength=STRENGTH, **coupling):
    line = (np.arange(CELLS) + 0.5) * SIDE / CELLS
    lattice = np.stack([a.ravel() for a in np.meshgrid(line, line, indexing="ij")], axis=1)
    return dict(
        precision="float64",
        domain=dict(size=[SIDE, SIDE], depth=0.04, gravity=[0.0, 0.0]),
        particles=dict(radius=0.005, density=2650.0, position=lattice.tolist()),
        contact=dict(young_modulus=1e5, speed=0.5),
        fluid=dict(cells=[CELLS, CELLS], viscosity=1e-5, time_step=DURATION),
        boundary={side: dict(kind="periodic") for side in ("left", "right", "bottom", "top")},
        coupling=dict(deconvolution=strength, kernel_width=dict(diameters=0.0, cells=1.0), **coupling),
        time=dict(end=1.0, output_interval=0.1),
    )


def deconvolving(coupling, strength):
    return dataclasses.replace(coupling, drag=dataclasses.replace(coupling.drag, deconvolution=strength))


class Box:
    """A particle in the middle of every cell of a periodic box, through one fluid step."""

    def __init__(self):
        self.scene = jaxdem.load_scene(tables())
        simulation, self.parameters = jaxdem.build(self.scene)
        self.coupling, self.grid = simulation.coupling, simulation.fluid.solver.grid
        self.position = np.asarray(tables()["particles"]["position"])
        self.step = jax.jit(self._step, static_argnums=0)

    def _step(self, coupling, fluid, particles, scale):
        p, now = self.parameters, jnp.zeros(())
        mixture = Mixture(law, scale, p.fluid, p.bodies, p.gravity)
        fluid, forces, _, report = coupling.advance(mixture, fluid, particles, now)
        return fluid, forces, report

    def shear(self, wave):
        """u = cos(k z), a crest in the first cell: no component varies along itself, so a particle sees it through the
        kernel alone."""
        phase = 2 * np.pi * wave * np.arange(CELLS) / CELLS
        u = np.broadcast_to(np.cos(phase)[None], (CELLS + 1, CELLS)).copy()
        zero = np.zeros_like(self.position)
        particles = ParticleState(self.position, None, zero, zero[:, :1], (), (), zero, zero)
        void = np.full((CELLS, CELLS), 1.0 - np.pi / 6 * 0.01**3 / (self.grid.cell_volume))
        return FluidState((u, np.zeros((CELLS, CELLS + 1))), np.zeros((CELLS, CELLS)), void), particles


@pytest.fixture(scope="module")
def box():
    return Box()


@pytest.mark.parametrize("wave", [1, 2, 3])
def test_a_wave_is_raised_by_its_second_difference(box, wave):
    """1 + a (2 - 2 cos k h) times what the kernel leaves of it: to first order what it took away."""
    fluid, particles = box.shear(wave)
    _, forces, _ = box.step(box.coupling, fluid, particles, 1.0)
    kh = 2 * np.pi * wave / CELLS
    cosine = np.cos(kh * (box.position[:, 1] / (SIDE / CELLS) - 0.5))
    seen = (
        0.75 + 0.25 * np.cos(kh)
    ) * cosine  # a triangle of a cell's half-width over its own cell and the next: 1/8, 3/4, 1/8
    shown = (1.0 + STRENGTH * (2.0 - 2.0 * np.cos(kh))) * seen
    np.testing.assert_allclose(forces.inputs.fluid_velocity[:, 0], shown, atol=1e-12)
    np.testing.assert_allclose(forces.law[:, 0], (0.02 + 0.2 * np.abs(shown)) * shown, atol=1e-12)


def test_even_and_linear_flows_are_seen_as_they_are():
    """Of these averages take nothing; beside a side the last value is continued."""
    grid = Grid((6, 4), (0.6, 0.4), 1.0, (False, True))
    x = np.arange(6.0)[:, None] * np.ones((1, 4))
    expected = np.zeros((6, 4))
    expected[0], expected[-1] = 1.0, -1.0
    np.testing.assert_allclose(second_differences(grid, jnp.asarray(x)), expected, atol=1e-12)
    np.testing.assert_allclose(second_differences(grid, jnp.full((6, 4), 3.0)), 0.0)


def test_momentum_is_conserved(box):
    """What the sharper velocity adds is taken from the faces, as all drag is."""
    fluid, particles = box.shear(2)
    fluid = fluid._replace(face_velocity=(fluid.face_velocity[0] + 0.3, fluid.face_velocity[1]))
    after, forces, report = box.step(box.coupling, fluid, particles, 1.0)

    def momentum(state):
        faces = face_average(box.grid, state.void_fraction)
        flux = tuple(g * u for g, u in zip(faces, state.face_velocity, strict=True))
        return 1000.0 * box.grid.cell_volume * np.array([float(x) for x in face_total(box.grid, flux)])

    given = DURATION * np.asarray(forces.total).sum(axis=0)
    assert abs(given[0]) > 1e-4
    np.testing.assert_allclose(momentum(after) - momentum(fluid), -given, atol=1e-10)
    assert float(report.momentum) < 1e-10


@pytest.mark.parametrize("varies", tiered([False, True], first=[True]))
def test_under_the_limit_nothing_grows_however_strong_the_drag(box, varies):
    """Drag a million times as strong: no wave grows; where the coefficient is even they do from 1 / (L T^2) on, 0.85
    here.

    The particles stand in the middle of cells, where kernels let most through, and are so heavy that the fluid cannot
    carry them along.
    """
    limit = deconvolution_limit(box.coupling.deposition.half_width, box.grid.spacing)
    heavy = box.parameters.bodies._replace(density=box.parameters.bodies.density * 1e9)
    p = box.parameters

    def even(inputs):
        return law(inputs)._replace(coefficient=jnp.full(len(box.position), 0.2))

    def after(strength, waves):
        """Largest speed after a step, over waves of size one."""
        coupling = deconvolving(box.coupling, strength)
        scale, now, particles = jnp.asarray(1e6), jnp.zeros(()), box.shear(1)[1]
        run = jax.jit(
            lambda f: coupling.advance(
                Mixture(law if varies else even, scale, p.fluid, heavy, p.gravity), f, particles, now
            )
        )
        return max(np.abs(u).max() for wave in waves for u in run(box.shear(wave)[0])[0].face_velocity)

    assert after(limit, (3, 4, 5, 6)) < 1.0
    if varies:
        assert after(0.8, (4,)) > 1.0, "worse than an even coefficient: why half of the analysis' limit is taken"
    else:
        assert after(0.8, (4,)) < 1.0 < after(0.9, (4,))


def test_limits_by_hand():
    """Without a kernel a component sees waves across it fully: L = 4 in 2-D, 8 in 3-D, and half of 1/L. A triangle of
    half a cell's half-width gives all of it to particles in the middle of cells, and over all places, of the shortest
    wave, 8/15 on average."""
    assert deconvolution_limit((0.0, 0.0), (0.1, 0.1)) == pytest.approx(0.125, rel=1e-6)
    assert deconvolution_limit((0.0,) * 3, (0.1,) * 3) == pytest.approx(0.0625, rel=1e-6)
    assert deconvolution_limit((0.05, 0.05), (0.1, 0.1)) == pytest.approx(0.5 / (4.0 * 8.0 / 15.0), rel=1e-2)
    assert deconvolution_limit((0.05,) * 3, (0.1,) * 3) == pytest.approx(1.0 / 8.0, rel=1e-6)


def test_it_is_compiled_in_where_it_is_asked_for_only(box):
    """The check names it; without the key the drag law sees what the mesh shows."""
    assert "deconvolved velocity (a = 0.2)" in check_scene(box.scene).compiled_in
    assert "deconvolved velocity" in check_scene(jaxdem.load_scene(tables(0.0))).left_out


@pytest.mark.parametrize(
    ("strength", "more", "words"),
    [
        (5.0, {}, "the limit with these cells and kernels.*Lower it"),
        (0.2, {"void_fraction": "centre"}, "the limit.*0.125"),
        (-0.1, {}, "greater than or equal to 0"),
    ],
)
def test_too_much_is_refused(strength, more, words):
    with pytest.raises(InputError, match=words) as refused:
        jaxdem.build(jaxdem.load_scene(tables(strength, **more)))
    assert "coupling.deconvolution" in str(refused.value)

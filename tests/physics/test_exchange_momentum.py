"""Particles and fluid in a periodic box: what one gains the other loses, and closed forms of even suspensions."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxdem
from jaxdem.closures import DRAG_LAWS
from jaxdem.closures.base import Drag
from jaxdem.coupling import exchange as exchange_module
from jaxdem.coupling.interpolation import kernel_weights
from jaxdem.failures import Failure, failures
from jaxdem.fluid.grid import face_average, face_total

LAWS = tuple(DRAG_LAWS)
SIDE, CELLS, RADIUS, DEPTH = 0.24, 6, 0.01, 0.04


@partial(jax.tree_util.register_dataclass, data_fields=["law", "lift"], meta_fields=[])
@dataclasses.dataclass(frozen=True, eq=False)
class AnyLaw:
    """Any correlation, chosen by a traced number, and a remainder across the slip: one compilation for all."""

    law: jax.Array
    lift: jax.Array

    def __call__(self, inputs):
        drag = lax.switch(self.law, [DRAG_LAWS[name]() for name in LAWS], inputs)
        slip = inputs.slip_velocity
        across = jnp.stack((-slip[:, 1], slip[:, 0]), axis=1)
        return Drag(drag.coefficient, self.lift * drag.coefficient[:, None] * across, drag.out_of_range)


def closure(law="stokes", lift=0.0):
    return AnyLaw(jnp.asarray(LAWS.index(law), jnp.int32), jnp.asarray(lift, jnp.float64))


class Suspension:
    """36 spheres in a box that is periodic all round; density, drag, viscosity and gravity are traced."""

    def __init__(self, model="A"):
        line = (np.arange(CELLS) + 0.5) * SIDE / CELLS
        self.lattice = np.stack([a.ravel() for a in np.meshgrid(line, line, indexing="ij")], axis=1)
        tables = dict(
            precision="float64",
            domain=dict(size=[SIDE, SIDE], depth=DEPTH, gravity=[0.0, 0.0]),
            particles=dict(radius=RADIUS, density=100.0, position=self.lattice.tolist()),
            contact=dict(young_modulus=1e5, friction=0.4, restitution=0.6, speed=0.5),
            fluid=dict(cells=[CELLS, CELLS], viscosity=1e-5, time_step=0.01, model=model),
            boundary={side: dict(kind="periodic") for side in ("left", "right", "bottom", "top")},
            coupling=dict(interval=0.01),
            time=dict(end=1.0, output_interval=0.1),
        )
        scene = jaxdem.load_scene(tables)
        self.simulation, self.parameters = jaxdem.build(scene, closure())
        self.start, self.neighbors = jaxdem.initial_state(scene, self.simulation, self.parameters)
        self.grid = self.simulation.fluid.solver.grid
        self.run = self.compiled()

    def compiled(self):
        """A fresh compilation, which sees what a test has patched."""
        return jax.jit(lambda *arguments: self._run(*arguments))

    def _run(self, parameters, state, steps):
        def body(_, carry):
            state, neighbors, code, _, worst = carry
            state, neighbors, diagnostics = self.simulation.step(parameters, state, neighbors)
            report = diagnostics.fluid
            worst = jnp.maximum(worst, jnp.stack((report.substeps * 1.0, report.momentum, report.volume)))
            return state, neighbors, code | failures(self.simulation, diagnostics), diagnostics.forces, worst

        shapes = jax.eval_shape(self.simulation.step, parameters, state, self.neighbors)[2].forces
        zeros = jax.tree.map(lambda shape: jnp.zeros(shape.shape, shape.dtype), shapes)
        carry = (state, self.neighbors, jnp.zeros((), jnp.int32), zeros, jnp.zeros(3))
        state, _, code, forces, worst = lax.fori_loop(0, steps, body, carry)
        return state, code, forces, worst

    def given(
        self,
        density=2650.0,
        drag=1.0,
        viscosity=1e-5,
        gravity=0.0,
        law="stokes",
        lift=0.0,
        radius=RADIUS,
        smagorinsky=None,
    ):
        """Parameters with these numbers, of the same types, so that nothing is compiled again but a subgrid model."""
        p, number = self.parameters, partial(jnp.asarray, dtype=jnp.float64)
        eddies = None if smagorinsky is None else number(smagorinsky)
        return p._replace(
            gravity=number([0.0, -gravity]),
            bodies=p.bodies._replace(density=number(density), radius=number(radius)),
            fluid=p.fluid._replace(viscosity=number(viscosity), smagorinsky=eddies),
            drag_scale=number(drag),
            closure=closure(law, lift),
        )

    def state(self, position=None, velocity=(0.0, 0.0), fluid=(0.0, 0.0), radius=RADIUS):
        """Particles here with these velocities (rows or one for all); fluid with a velocity or face fields."""
        particles, number = self.start.particles, partial(jnp.asarray, dtype=jnp.float64)
        position = number(self.lattice if position is None else position)
        velocity = jnp.broadcast_to(number(velocity), position.shape)
        shapes = [self.grid.face_shape(a) for a in range(2)]
        faces = tuple(jnp.broadcast_to(number(u), s) for u, s in zip(fluid, shapes, strict=True))
        weights = kernel_weights(self.grid, self.simulation.fluid.deposition.half_width, position)
        volume = number(4 / 3 * np.pi * radius**3)
        solids = exchange_module.solid_fraction(self.grid, weights, volume)
        return self.start._replace(
            particles=particles._replace(position=position, velocity=velocity),
            fluid=self.start.fluid._replace(face_velocity=faces, void_fraction=1.0 - solids),
        )

    def momentum(self, parameters, state):
        """(2,) of particles and of the fluid [kg m/s]."""
        g = face_average(self.grid, state.fluid.void_fraction)
        flux = tuple(a * u for a, u in zip(g, state.fluid.face_velocity, strict=True))
        mass = self.grid.cell_volume * parameters.fluid.density
        fluid = np.array([float(x) for x in face_total(self.grid, flux)]) * float(mass)
        return float(parameters.bodies.mass) * np.asarray(state.particles.velocity).sum(axis=0), fluid

    def stirred(self, speed, seed=0, particle_speed=None):
        """Particles at random places (apart) and speeds, an eddy with a mean stream in the fluid."""
        random, fluid_speed = np.random.default_rng(seed), speed
        speed = speed if particle_speed is None else particle_speed
        position = self.lattice + random.uniform(-0.009, 0.009, self.lattice.shape)
        velocity = random.normal(0.0, 0.3 * speed, position.shape) + [0.4 * speed, -0.2 * speed]
        k, h = 2 * np.pi / SIDE, SIDE / CELLS
        faces, centres = np.arange(CELLS + 1) * h, (np.arange(CELLS) + 0.5) * h
        speed = fluid_speed
        u = 0.5 * speed * np.sin(k * faces)[:, None] * np.cos(k * centres)[None] + 0.3 * speed
        w = -0.5 * speed * np.cos(k * centres)[:, None] * np.sin(k * faces)[None]
        return self.state(position, velocity, (u, w))

    def drift(self, parameters, state, steps=60, run=None):
        """Change of the total momentum over the sum of its parts' sizes; exchanged share; worst diagnostics."""
        end, code, _, worst = (run or self.run)(parameters, state, steps)
        before, after = self.momentum(parameters, state), self.momentum(parameters, end)
        mass = float(parameters.bodies.mass)
        size = (
            mass * np.abs(state.particles.velocity).sum() + np.abs(before[1]).sum() + np.abs(after[1]).sum()
        )
        exchanged = np.abs(after[0] - before[0]).max() / size
        return np.abs(sum(after) - sum(before)).max() / size, exchanged, int(code), np.asarray(worst)


@pytest.fixture(scope="module")
def suspension():
    return Suspension()


@pytest.fixture(scope="module")
def suspension_b():
    return Suspension("B")


STOKES_TIME = 2.0 / 9.0 * 2650.0 * RADIUS**2 / (1000.0 * 1e-5)  # m / (3 pi mu d) of the sphere as given [s]


@pytest.mark.parametrize("density", [100.0, 1001.0, 5650.0, 2.5e6])
@pytest.mark.parametrize("relaxation", [1e3, 1.0, 1e-3, 1e-6])
def test_total_momentum_is_conserved(suspension, relaxation, density):
    """Particles that move and collide, an eddy, drag from weak to stiff (relaxation time over the fluid step)."""
    drag = STOKES_TIME / 2650.0 * density / (relaxation * 0.01)
    error, exchanged, code, worst = suspension.drift(
        suspension.given(density, drag), suspension.stirred(0.2, seed=1)
    )
    assert code == 0
    # The gate. The exchange is by impulse, so that only rounding of the sums is left, 60 steps of it.
    assert error < 1e-10
    assert worst[1] < 1e-10 and worst[2] < 1e-13
    if density < 1e6 and relaxation <= 1.0:
        assert exchanged > 1e-3  # something was handed over


@pytest.mark.parametrize("relaxation", [1e3, 1.0, 1e-3, 1e-6])
def test_total_momentum_is_conserved_in_model_b(suspension_b, relaxation):
    """All of pressure and stress in the fluid: in a periodic box they sum to nothing, drag goes both ways."""
    drag = STOKES_TIME / 2650.0 * 1001.0 / (relaxation * 0.01)
    parameters = suspension_b.given(1001.0, drag, law="koch_hill", lift=0.4)
    error, exchanged, code, worst = suspension_b.drift(parameters, suspension_b.stirred(0.2, seed=1))
    assert code == 0
    assert error < 1e-10 and worst[1] < 1e-10
    if relaxation <= 1.0:
        assert exchanged > 1e-3


def test_hydrostatic_rest_in_model_b(suspension_b):
    """Neutral particles, uneven void fraction, gravity: the reduced pressure is even and nothing moves."""
    parameters = suspension_b.given(density=1000.0, gravity=9.81)
    end, code, _, _ = suspension_b.run(parameters, suspension_b.stirred(0.0, seed=3), 50)
    assert int(code) == 0
    assert float(jnp.abs(end.particles.velocity).max()) < 1e-14
    assert max(float(jnp.abs(u).max()) for u in end.fluid.face_velocity) < 1e-14


def test_even_suspension_relaxes_as_two_bodies_in_model_b(suspension_b):
    """As in model A with a drag of c / g: slip falls by 1 + t c/g (1/m + 1/M) in each step."""
    parameters, state = suspension_b.given(drag=10.0), suspension_b.state(velocity=(0.13, -0.05))
    mass, volume = float(parameters.bodies.mass), float(parameters.bodies.volume)
    cell = SIDE**2 * DEPTH / len(suspension_b.lattice)
    fluid_mass = 1000.0 * (cell - volume)
    grip = 0.01 * 10.0 * 6 * np.pi * 1000.0 * 1e-5 * RADIUS / (1.0 - volume / cell)
    end, code, _, _ = suspension_b.run(parameters, state, 50)
    assert int(code) == 0
    slip = np.array([-0.13, 0.05]) / (1.0 + grip * (1.0 / mass + 1.0 / fluid_mass)) ** 50
    together = mass * np.array([0.13, -0.05]) / (mass + fluid_mass)
    for axis in range(2):
        u = together[axis] + slip[axis] * mass / (mass + fluid_mass)
        np.testing.assert_allclose(end.fluid.face_velocity[axis], u, atol=1e-10)


def test_total_momentum_is_conserved_with_a_remainder(suspension):
    parameters = suspension.given(law="koch_hill", lift=0.4)
    error, exchanged, code, _ = suspension.drift(parameters, suspension.stirred(0.2))
    assert code == 0 and error < 1e-10 and exchanged > 1e-3


def test_total_momentum_is_conserved_with_a_subgrid_viscosity(suspension):
    """The stress that the fluid loses to the solids is the one they get, the subgrid part too: most of it here."""
    parameters, state = suspension.given(smagorinsky=0.5), suspension.stirred(0.2)
    error, exchanged, code, _ = suspension.drift(parameters, state)
    assert code == 0 and error < 1e-10 and exchanged > 1e-3
    viscous = [np.abs(suspension.run(p, state, 1)[2].viscous).max() for p in (suspension.given(), parameters)]
    assert viscous[1] > 5.0 * viscous[0]


@pytest.mark.parametrize(("speed", "substeps"), [(0.2, 1), (3.5, 2), (7.0, 4), (14.0, 8), (40.0, 8)])
def test_substeps_follow_the_courant_number_and_conserve_momentum(suspension, speed, substeps):
    """1, 2, 4 or 8 fluid steps in an interval, and a flag beyond; |u| t/h summed is 0.04 ... 8, its limit 0.7."""
    state = suspension.stirred(speed, particle_speed=0.2)
    error, _, code, worst = suspension.drift(suspension.given(), state, 50)
    assert worst[0] == substeps
    assert error < 1e-10
    assert bool(code & Failure.COURANT) == (speed > 20.0)


def test_momentum_without_the_pressure_gradient_on_particles_is_not_conserved(suspension, monkeypatch):
    """Negative control: the same scene fails the gate when the particles do not feel the pressure."""
    right = exchange_module.pressure_gradient

    def dropped(grid, boundary, pressure, continued=False):
        slope = right(grid, boundary, pressure, continued=continued)
        return tuple(0.0 * s for s in slope) if continued else slope

    monkeypatch.setattr(exchange_module, "pressure_gradient", dropped)
    error, *_ = suspension.drift(suspension.given(), suspension.stirred(0.2), 5, suspension.compiled())
    assert error > 1e-6


def test_even_suspension_relaxes_as_two_bodies(suspension):
    """A lattice moving through an even stream: fluid stays even, slip falls by implicit Euler's factor each step.

    With Stokes drag c the slip obeys s' = s / (1 + t c (1/m + 1/M)), M the fluid's mass per particle; also
    the uniform stream through a moving uniform bed.
    """
    parameters = suspension.given(drag=10.0)
    state = suspension.state(velocity=(0.13, -0.05), fluid=(-0.2, 0.1))
    mass, volume = float(parameters.bodies.mass), float(parameters.bodies.volume)
    fluid_mass = 1000.0 * (SIDE**2 * DEPTH / len(suspension.lattice) - volume)
    grip = 0.01 * 10.0 * 6 * np.pi * 1000.0 * 1e-5 * RADIUS
    end, code, _, _ = suspension.run(parameters, state, 50)
    slip = np.array([-0.33, 0.15]) / (1.0 + grip * (1.0 / mass + 1.0 / fluid_mass)) ** 50
    together = (mass * np.array([0.13, -0.05]) + fluid_mass * np.array([-0.2, 0.1])) / (mass + fluid_mass)
    assert int(code) == 0
    assert 0.1 < slip[1] / 0.15 < 0.9
    for axis in range(2):
        # The lattice keeps the void fraction even to round-off; 50 solves carry 1e-12 of U/h each.
        u = together[axis] + slip[axis] * mass / (mass + fluid_mass)
        v = together[axis] - slip[axis] * fluid_mass / (mass + fluid_mass)
        np.testing.assert_allclose(end.fluid.face_velocity[axis], u, atol=1e-10)
        np.testing.assert_allclose(end.particles.velocity[:, axis], v, atol=1e-10)


# F(s, Re) of two laws, written from the papers once more, in plain numpy; Re superficial. (All laws are tried one-way
# in test_exchange_bed.)
def _wen_yu(s, re):
    return (1.0 + 0.15 * re**0.687 if re <= 1000.0 else 0.44 * re / 24.0) * (1.0 - s) ** -2.65


def _koch_hill(s, re):
    below = 1 + 0.681 * s - 8.48 * s**2 + 8.16 * s**3
    f0 = (1 + 3 * np.sqrt(s / 2) + 135 / 64 * s * np.log(s) + 16.14 * s) / below
    f3 = 0.0673 + 0.212 * s + 0.0232 / (1 - s) ** 5
    return (1 - s) ** 2 * (f0 + f3 * re / 2)


PLAIN = {"wen_yu": _wen_yu, "koch_hill": _koch_hill}


@pytest.mark.parametrize("law", PLAIN)
@pytest.mark.parametrize(("reynolds", "radius"), [(1e-2, 0.01), (30.0, 0.0165), (3e3, 0.01)])
def test_two_way_settling_slip_is_that_of_the_law(suspension, law, reynolds, radius):
    """A lattice that settles in a periodic box, where particles and fluid speed up together.

    The drag then is W M / (m + M) with W the submerged weight, whatever the law; the slip is the law's answer at
    the solid fraction there is, 0.065 or 0.29: the weight is set so that it is known.
    """
    solid = 4 / 3 * np.pi * radius**3 / (SIDE**2 * DEPTH / 36)
    viscosity = {1e-2: 1e-3, 30.0: 1e-5, 3e3: 2e-6}[reynolds]  # for slips under the speed expected, 0.5 m/s
    slip = reynolds * viscosity / ((1 - solid) * 2 * radius)
    mass = 4 / 3 * np.pi * radius**3 * 2650.0
    fluid_mass = 1000.0 * SIDE**2 * DEPTH / 36 * (1 - solid)
    force = 6 * np.pi * 1000.0 * viscosity * radius * PLAIN[law](solid, reynolds) * slip
    weight = force * (mass + fluid_mass) / fluid_mass
    gravity = weight / (mass * (1.0 - 1.0 / 2.65))
    parameters = suspension.given(viscosity=viscosity, gravity=gravity, law=law, radius=radius)
    # It starts 30 % too fast and has to find the law's slip by itself, within five relaxation times.
    state = suspension.state(velocity=(0.0, -1.3 * slip), radius=radius)
    steps = 5 * max(8, int(mass * slip / force / 0.01))
    _, code, forces, _ = suspension.run(parameters, state, steps)
    assert int(code) == 0
    seen = np.asarray(forces.inputs.fluid_velocity - forces.inputs.particle_velocity)[:, 1]
    # The gate is 1 %: 0.3 exp(-5) = 0.2 % of the start is left, less for the quadratic laws.
    np.testing.assert_allclose(seen, slip, rtol=0.01)
    np.testing.assert_allclose(forces.drag[:, 1], force, rtol=0.01)
    np.testing.assert_allclose(forces.inputs.solid_fraction, solid, rtol=1e-6)


def test_neutral_particles_rest_in_water_under_gravity(suspension):
    """Hydrostatic rest: weight less buoyancy is nothing, pressure is reduced, so that nothing moves at all."""
    parameters = suspension.given(density=1000.0, gravity=9.81)
    state = suspension.stirred(0.0, seed=3)
    end, code, _, _ = suspension.run(parameters, state, 50)
    assert int(code) == 0
    # (m g - rho V g) is zero up to rounding of two products: 1e-16 g over 0.5 s.
    assert float(jnp.abs(end.particles.velocity).max()) < 1e-14
    assert max(float(jnp.abs(u).max()) for u in end.fluid.face_velocity) < 1e-14


def test_viscous_force_in_a_shear_wave(suspension):
    """w = W sin(k x): V_p mu w'' on every particle, in the discrete form -(2 - 2 cos kh)/h^2 of the wave seen."""
    h, k, position = SIDE / CELLS, 2 * np.pi / SIDE, suspension.stirred(0.0).particles.position
    wave = np.sin(k * (np.arange(CELLS) + 0.5) * h)
    viscosity = 1e-4
    parameters = suspension.given(viscosity=viscosity, drag=0.0)
    state = suspension.state(position, fluid=(0.0, 0.01 * np.tile(wave[:, None], (1, CELLS + 1))))
    _, code, forces, _ = suspension.run(parameters, state, 1)
    weights = kernel_weights(suspension.grid, suspension.simulation.fluid.deposition.half_width, position)
    cell = np.repeat(wave, CELLS)[np.asarray(weights.index)]
    seen = 0.01 * np.sum(np.asarray(weights.weight) * cell, axis=1)
    volume = float(parameters.bodies.volume)
    expected = -volume * 1000.0 * viscosity * (2 - 2 * np.cos(k * h)) / h**2 * seen
    assert int(code) == 0 and np.abs(expected).max() > 1e-7
    # The force is the mean over the step, in which the wave decays by nu k^2 t = 0.07 %; an uneven void fraction
    # lets pressure bend the flow by as much.
    np.testing.assert_allclose(forces.viscous[:, 1], expected, atol=2e-3 * np.abs(expected).max())


def test_viscous_force_of_the_subgrid_viscosity_in_a_shear_wave(suspension):
    """w = W sin(k x): V_p rho d/dx[(nu + nu_t) w'] on every particle, nu_t = (C_s h)^2 |w'|, by finite differences."""
    h, k, position = SIDE / CELLS, 2 * np.pi / SIDE, suspension.stirred(0.0).particles.position
    wave = 0.01 * np.sin(k * (np.arange(CELLS) + 0.5) * h)
    parameters = suspension.given(viscosity=1e-5, drag=0.0, smagorinsky=0.8)
    state = suspension.state(position, fluid=(0.0, np.tile(wave[:, None], (1, CELLS + 1))))
    _, code, forces, _ = suspension.run(parameters, state, 1)
    slope = (wave - np.roll(wave, 1)) / h  # on the side below each cell
    eddy = (0.8 * h) ** 2 * np.sqrt(0.5 * (slope**2 + np.roll(slope, -1) ** 2))
    stress = (1e-5 + 0.5 * (eddy + np.roll(eddy, 1))) * slope
    force = np.repeat((np.roll(stress, -1) - stress) / h, CELLS)
    weights = kernel_weights(suspension.grid, suspension.simulation.fluid.deposition.half_width, position)
    seen = np.sum(np.asarray(weights.weight) * force[np.asarray(weights.index)], axis=1)
    expected = float(parameters.bodies.volume) * 1000.0 * seen
    assert int(code) == 0 and eddy.max() > 10 * 1e-5
    # Over the step the wave decays by nu_t k^2 t = 0.7 % at most, and an uneven void fraction bends the flow.
    np.testing.assert_allclose(forces.viscous[:, 1], expected, atol=2e-2 * np.abs(expected).max())


def test_viscosity_number_in_model_b_is_over_the_void_fraction(suspension_b):
    """The whole stress acts on the part g of the volume: nu t sum(1/h^2) / min g."""
    state = suspension_b.stirred(0.0)
    report = jax.jit(suspension_b.simulation.step)(
        suspension_b.given(viscosity=1e-2), state, suspension_b.neighbors
    )[2].fluid
    lowest = float(state.fluid.void_fraction.min())
    expected = 1e-2 * 0.01 * 2.0 / (SIDE / CELLS) ** 2 / lowest
    assert lowest < 0.95
    assert float(report.viscous * report.substeps) == pytest.approx(expected, rel=1e-12)

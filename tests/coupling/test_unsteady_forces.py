"""Virtual mass and Basset force through the whole step, against closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from scipy.special import wofz

import jaxdem
from jaxdem.coupling.deposition import Kernel
from jaxdem.coupling.further_impulses import convective_acceleration
from jaxdem.errors import InputError
from jaxdem.fluid.grid import Grid, face_average, face_total
from jaxdem.run.restart import from_arrays, to_arrays
from jaxdem.step import advance_fluid

T, RHO, RADIUS, RAMP = 0.01, 1000.0, 0.005, 0.05
VOLUME = 4 / 3 * np.pi * RADIUS**3
NUMBER = jnp.float64


def tables(**coupling):
    """A sphere in a column that is 1e6 times as large: what it does to the fluid is nothing."""
    return dict(
        precision="float64",
        domain=dict(size=[0.16, 0.32], depth=100.0, gravity=[0.0, 0.0]),
        particles=dict(radius=RADIUS, density=100.0, position=[[0.08, 0.16]]),
        contact=dict(young_modulus=1e5, restitution=0.7, speed=0.2),
        fluid=dict(cells=[4, 8], density=RHO, viscosity=1e-20, time_step=T),
        boundary=dict(
            left=dict(kind="free_slip"),
            right=dict(kind="free_slip"),
            bottom=dict(kind="inlet", velocity=0.0, ramp_time=RAMP),
            top=dict(kind="outlet"),
        ),
        coupling=dict(drag="stokes", interval=T, **coupling),
        time=dict(end=1.0, output_interval=0.1),
    )


class Column:
    def __init__(self):
        self.scene = jaxdem.load_scene(tables(virtual_mass=0.5, basset=20))
        self.simulation, self.parameters = jaxdem.build(self.scene)
        self.state, self.neighbors = jaxdem.initial_state(self.scene, self.simulation, self.parameters)

        @jax.jit
        def run(parameters, state, count):
            def body(_, carry):
                state, neighbors, impulse, _ = carry
                state, neighbors, report = self.simulation.step(parameters, state, neighbors)
                impulse = impulse + T * jnp.abs(state.particles.contact_force)
                return state, neighbors, impulse, report.forces.further["virtual_mass"].given

            carry = (state, self.neighbors, jnp.zeros((1, 2)), jnp.zeros((1, 2)))
            state, _, impulse, given = lax.fori_loop(0, count, body, carry)
            return state, impulse, given

        self.compiled = run

    def given(self, density=100.0, viscosity=1e-20, gravity=0.0, inlet=0.0, drag=0.0):
        p, side = self.parameters, [np.zeros(2)] * 4
        side[2] = np.array([0.0, inlet])
        return p._replace(
            gravity=jnp.asarray([0.0, -gravity], NUMBER),
            bodies=p.bodies._replace(density=jnp.asarray(density, NUMBER)),
            fluid=p.fluid._replace(
                viscosity=jnp.asarray(viscosity, NUMBER), side_velocity=tuple(map(jnp.asarray, side))
            ),
            drag_scale=jnp.asarray(drag, NUMBER),
        )

    def run(self, count, height=0.16, velocity=0.0, **given):
        particles = self.state.particles._replace(
            position=jnp.asarray([[0.08, height]]), velocity=jnp.asarray([[0.0, velocity]])
        )
        # Its slip has been as it is.
        history = particles.fluid_memory["basset"]._replace(slip=-particles.velocity)
        memory = particles.fluid_memory | {"basset": history}
        state = self.state._replace(particles=particles._replace(fluid_memory=memory))
        return self.compiled(self.given(**given), state, count)


@pytest.fixture(scope="module")
def column():
    return Column()


@pytest.mark.parametrize("density", [100.0, 1001.0, 5650.0])
def test_released_sphere_accelerates_with_its_added_mass(column, density):
    """dv/dt = (rho_p - rho) g / (rho_p + C rho) without drag, at once and for good; light ones rise."""
    end, _, given = column.run(10, density=density, gravity=1.0)
    expected = (RHO - density) / (density + 0.5 * RHO)
    assert float(end.particles.velocity[0, 1]) == pytest.approx(10 * T * expected, rel=1e-4)
    given = float(given[0, 1])
    assert given == pytest.approx(-0.5 * RHO * VOLUME * expected, rel=1e-4)
    assert float(jnp.abs(end.particles.fluid_memory["virtual_mass"]).max()) < 1e-5 * abs(given) * T


@pytest.mark.parametrize("density", [100.0, 5650.0])
def test_sphere_in_an_accelerating_fluid(column, density):
    """dv/dt = rho (1 + C) / (rho_p + C rho) Du/Dt without drag: three times the fluid's where weightless, here 2.5."""
    end, _, _ = column.run(4, density=density, inlet=0.02)
    expected = 1.5 * RHO / (density + 0.5 * RHO) * 0.02 / RAMP
    assert float(end.particles.velocity[0, 1]) == pytest.approx(4 * T * expected, rel=1e-4)


def test_collision_with_a_wall_has_the_added_mass(column):
    """It rebounds with the contact's restitution 0.7, and the wall gives (m + a)(1 + e) v."""
    end, impulse, _ = column.run(12, height=RADIUS + 0.0023, velocity=-0.05)
    assert float(end.particles.velocity[0, 1]) == pytest.approx(0.7 * 0.05, rel=0.01)
    assert float(impulse[0, 1]) == pytest.approx((100.0 + 500.0) * VOLUME * 1.7 * 0.05, rel=0.01)


def settling(ratio, time):
    """v / v_Stokes of a sphere released in a fluid at rest, with virtual mass and Basset force.

    (1 + C/k) dv/dt = 1 - v - sqrt(9 / (2 k pi)) int v'(s) / sqrt(t - s) ds, k = rho_p / rho, times in m / (6 pi mu r):
    by Laplace's transform v = (f(p) - f(q)) / ((q - p) (1 + C/k)), f(p) = (1 - exp(p^2 t) erfc(p sqrt(t))) / p, with
    -p, -q the roots of (1 + C/k) x^2 + sqrt(9 / (2 k)) x + 1. (R. Clift, J. R. Grace & M. E. Weber, Bubbles, Drops and
    Particles, 1978, chapter 11.)
    """
    inertia = 1.0 + 0.5 / ratio
    p, q = -np.roots([inertia, np.sqrt(9.0 / (2.0 * ratio)), 1.0]).astype(complex)

    def f(x):
        return (1.0 - wofz(1j * x * np.sqrt(time))) / x

    return float(((f(p) - f(q)) / ((q - p) * inertia)).real)


@pytest.mark.parametrize("ratio", [0.1, 2.65])
def test_released_sphere_with_basset_force(column, ratio):
    """Through the window and far into the tail; first order in the interval, as implicit Euler's drag is."""
    assert settling(1e12, 1.0) == pytest.approx(1.0 - np.exp(-1.0), rel=1e-5)  # a heavy one feels drag only
    errors = []
    for count in (25, 50, 100):
        # t = 2 m / (6 pi mu r) after `count` intervals.
        viscosity = 2.0 * VOLUME * ratio / (6 * np.pi * RADIUS * count * T)
        terminal = 0.05 * (ratio - 1.0) * VOLUME / (6 * np.pi * viscosity * RADIUS)
        end, _, _ = column.run(count, density=ratio * RHO, gravity=0.05, viscosity=viscosity, drag=1.0)
        errors.append(float(end.particles.velocity[0, 1]) / -terminal / settling(ratio, 2.0) - 1.0)
    print(ratio, settling(ratio, 2.0), errors)
    assert abs(errors[-1]) < 0.01
    order = np.log2(np.abs(np.array(errors[:-1]) / errors[1:]))
    assert np.all(order > 0.8)


def test_convection_of_a_linear_flow():
    """u = A x has u.grad u = A A x."""
    grid = Grid((6, 5, 4), (0.6, 0.5, 0.4), 1.0, (False,) * 3)
    slope = np.random.default_rng(2).normal(size=(3, 3))
    faces = []
    for axis in range(3):
        lines = [0.1 * (np.arange(n) + (0.5 if a != axis else 0.0)) for a, n in enumerate(grid.face_shape(axis))]
        faces.append(jnp.asarray(np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1) @ slope[axis]))
    position = np.random.default_rng(3).uniform(0.15, 0.25, (9, 3))
    weights = Kernel((0.1,) * 3).weights(grid, jnp.asarray(position), jnp.asarray(0.01))
    found = jax.jit(lambda f: convective_acceleration(grid, weights, f))(tuple(faces))
    np.testing.assert_allclose(found, position @ (slope @ slope).T, atol=1e-12)


def test_total_momentum_is_conserved():
    """Spheres, light or heavy, that collide in a stream, periodic all round: with what the fluid is owed."""
    random, cells, side = np.random.default_rng(1), 4, 0.16
    line = (np.arange(cells) + 0.5) * side / cells
    lattice = np.stack([a.ravel() for a in np.meshgrid(line, line, indexing="ij")], axis=1)
    given = tables(virtual_mass=0.5, basset=3) | dict(
        domain=dict(size=[side, side], depth=0.04, gravity=[0.0, 0.0]),
        particles=dict(
            radius=0.01,
            density=100.0,
            position=(lattice + random.uniform(-0.009, 0.009, lattice.shape)).tolist(),
            velocity=random.normal(0.0, 0.1, lattice.shape).tolist(),
        ),
        fluid=dict(cells=[cells, cells], velocity=[0.05, -0.02], viscosity=1e-5, time_step=T),
        boundary={s: dict(kind="periodic") for s in ("left", "right", "bottom", "top")},
    )
    scene = jaxdem.load_scene(given)
    simulation, light = jaxdem.build(scene)
    first, neighbors = jaxdem.initial_state(scene, simulation, light)
    light = light._replace(gravity=jnp.asarray([0.0, -1.0]))  # a periodic scene may not have it
    grid, step = simulation.fluid.solver.grid, jax.jit(simulation.step)

    def momentum(state, density):
        g = face_average(grid, state.fluid.void_fraction)
        flux = tuple(a * u for a, u in zip(g, state.fluid.face_velocity, strict=True))
        fluid = np.array([float(x) for x in face_total(grid, flux)]) * grid.cell_volume * RHO
        owed = np.asarray(state.particles.fluid_memory["virtual_mass"]).sum(axis=0)
        solid = density * VOLUME * 8.0 * np.asarray(state.particles.velocity).sum(axis=0)
        return solid + fluid - owed, np.abs(owed).max()

    for density in (100.0, 2650.0):
        parameters = light._replace(bodies=light.bodies._replace(density=jnp.asarray(density)))
        state, near, size, touched = first, neighbors, 0.0, False
        start = momentum(state, density)[0]
        for k in range(1, 41):
            state, near, report = step(parameters, state, near)
            touched |= bool(np.any(state.particles.contact_force))
            # Gravity acts on what is submerged; the reduced pressure has taken the rest.
            weight = (density - RHO) * VOLUME * 8.0 * 16 * np.array([0.0, -1.0])
            total, owed = momentum(state, density)
            size = max(size, owed)
            assert np.abs(total - start - k * T * weight).max() < 1e-10 * np.abs(start).max()
            assert float(report.exchange.momentum) < 1e-12
        assert touched and size > 1e-6 * np.abs(start).max()
        assert np.abs(np.asarray(state.particles.velocity)).max() < 2.0  # none has gained much


def test_reverse_mode_gradient(column):
    """Of both forces of an interval and a face's velocity, by density, viscosity and what is owed."""
    simulation = column.simulation.reversible()
    memory = column.state.particles.fluid_memory
    random = np.random.default_rng(0)
    history = jax.tree.map(lambda x: jnp.asarray(random.normal(0.0, 0.01, x.shape)), memory["basset"])

    def observed(factor):
        parameters = column.given(density=300.0 * factor[0], viscosity=1e-3 * factor[1], gravity=1.0, drag=1.0)
        past = {"virtual_mass": 1e-6 * factor[2] * jnp.ones((1, 2)), "basset": history}
        particles = column.state.particles._replace(fluid_memory=past)
        fluid, forces, *_ = advance_fluid(simulation, parameters, column.state._replace(particles=particles))
        given = jnp.sum(sum(mean.given for mean in forces.further.values()))
        return 1e3 * given + 1e6 * fluid.face_velocity[1][1, 4]  # a face beside the sphere

    both, ones = jax.jit(jax.value_and_grad(observed)), jnp.ones(3)
    value, slope = both(ones)
    for k in range(3):
        e = jnp.zeros(3).at[k].set(1e-4)
        central = float(both(ones + e)[0] - both(ones - e)[0]) / 2e-4
        print(k, float(value), float(slope[k]), central)
        assert float(slope[k]) == pytest.approx(central, rel=1e-5)
        assert abs(central) > 1e-6 * abs(float(value))


def test_memory_goes_through_a_checkpoint(column):
    end, _, _ = column.run(30, density=300.0, gravity=1.0, viscosity=1e-3, drag=1.0)
    arrays = to_arrays(end, column.neighbors, {})
    back, _, _ = from_arrays(column.simulation, column.state, arrays)
    one, other = (column.compiled(column.given(300.0, 1e-3, 1.0, drag=1.0), s, 5)[0] for s in (end, back))
    assert jax.tree.all(jax.tree.map(lambda a, b: a.tobytes() == b.tobytes(), one, other))
    assert np.any(end.particles.fluid_memory["basset"].tail)


def test_off_compiles_nothing_of_it(column):
    """Negative control: no arrays in the state, no such forces, and a smaller program."""
    scene = jaxdem.load_scene(tables())
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    assert state.particles.fluid_memory is None
    shapes = jax.eval_shape(simulation.step, parameters, state, neighbors)[2].forces
    assert shapes.further == {}
    plain = jax.jit(simulation.step).lower(parameters, state, neighbors).as_text()
    full = jax.jit(column.simulation.step).lower(column.parameters, column.state, column.neighbors).as_text()
    assert "19x1x2x" in full and "19x1x2x" not in plain  # the changes of the slip
    assert len(plain.splitlines()) < 0.95 * len(full.splitlines())


@pytest.mark.parametrize(("key", "value"), [("virtual_mass", -0.1), ("virtual_mass", 11.0), ("basset", 1)])
def test_what_cannot_be_is_refused(key, value):
    with pytest.raises(InputError, match=rf"coupling\.{key}"):
        jaxdem.load_scene(tables(**{key: value}))

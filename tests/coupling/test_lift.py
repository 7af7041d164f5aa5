"""Lift and torque of the fluid against the papers' formulas, written out in plain mathematics."""

import importlib
import inspect
import math
import pkgutil
from functools import partial
from typing import get_args

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.coupling import forces
from jaxdem.coupling.deposition import Kernel
from jaxdem.coupling.forces.lift import Magnus, SaffmanMei
from jaxdem.coupling.forces.rotation import FlowAround, rotational_drag, vorticity
from jaxdem.fluid.grid import Grid
from jaxdem.numerics import vectors
from jaxdem.scene.coupling import Coupling
from jaxdem.setup.coupling import LIFT_LAWS
from jaxdem.step import step
from tests.cases.small_scenes import SMALL_INJECTION

D, RHO, MU = 2e-3, 1000.0, 1e-3

# Compiled as wholes: outside of `jit` every operation is a program of its own.
rotational_drag, vorticity = jax.jit(rotational_drag), jax.jit(vorticity, static_argnums=0)


@partial(jax.jit, static_argnums=0)
def force_by(law, around):
    return law.force(around)


def inputs(slip, curl, spin, viscosity=MU):
    as_vector = lambda values: tuple(jnp.asarray([v], jnp.float64) for v in values)  # noqa: E731
    return FlowAround(
        as_vector(slip),
        as_vector(curl),
        as_vector(spin),
        jnp.asarray(D),
        jnp.asarray(RHO),
        jnp.asarray(viscosity),
    )


def test_saffman_at_small_reynolds_number():
    """Saffman's 6.46 mu r^2 U sqrt(k/nu), across the flow and towards the faster fluid, as Re and b go to zero.

    Mei's factor is 1 - 0.33 sqrt(b) - Re/10: 0.998 here.
    """
    viscosity, slip, shear = 10.0, 0.02, 1e-3
    force = force_by(SaffmanMei(), inputs((slip, 0.0), (-shear,), (0.0,), viscosity))  # u = (shear y, 0)
    expected = 6.46 * viscosity * (D / 2) ** 2 * slip * math.sqrt(shear * RHO / viscosity)
    assert float(force[1][0]) == pytest.approx(expected, rel=4e-3)
    assert abs(float(force[0][0])) == 0.0


@pytest.mark.parametrize(("slip", "shear"), [(0.005, 0.5), (0.01, 2.0), (0.05, 5.0), (0.3, 60.0)])
def test_saffman_with_meis_factor(slip, shear):
    re, b = RHO * slip * D / MU, D * shear / (2 * slip)
    factor = (
        (1 - 0.3314 * math.sqrt(b)) * math.exp(-re / 10) + 0.3314 * math.sqrt(b)
        if re <= 40
        else 0.0524 * math.sqrt(b * re)
    )
    expected = 1.615 * MU * D * slip * math.sqrt(D**2 * shear * RHO / MU) * factor
    # In 3-D the same flow in another plane: u = (0, 0, shear x), slip along z; the force is along x.
    flat = force_by(SaffmanMei(), inputs((slip, 0.0), (-shear,), (0.0,)))
    solid = force_by(SaffmanMei(), inputs((0.0, 0.0, slip), (0.0, -shear, 0.0), (0.0, 0.0, 0.0)))
    assert float(flat[1][0]) == pytest.approx(expected, rel=1e-12)
    assert float(solid[0][0]) == pytest.approx(expected, rel=1e-12)


def test_magnus_at_small_reynolds_number():
    """Rubinow and Keller's pi r^3 rho omega x v, for a sphere that moves and turns in still fluid."""
    velocity, spin, viscosity = np.array([1e-3, 0.0]), 0.3, 10.0
    force = force_by(Magnus(), inputs(-velocity, (0.0,), (spin,), viscosity))
    expected = math.pi * (D / 2) ** 3 * RHO * spin * velocity[0]
    assert float(force[1][0]) == pytest.approx(expected, rel=1e-3)
    assert float(force[0][0]) == pytest.approx(0.0, abs=1e-30)


@pytest.mark.parametrize(("speed", "spin"), [(0.01, 5.0), (0.05, 100.0)])
def test_magnus_of_oesterle_and_bui_dinh(speed, spin):
    re, rotation = RHO * speed * D / MU, RHO * spin * D**2 / MU
    factor = 0.45 + (rotation / re - 0.45) * math.exp(-0.05684 * rotation**0.4 * re**0.3)
    expected = 0.5 * RHO * math.pi / 4 * D**2 * factor * speed**2
    force = force_by(Magnus(), inputs((-speed, 0.0), (0.0,), (spin,)))
    assert float(force[1][0]) == pytest.approx(expected, rel=1e-12)
    # A sphere that turns with the fluid, at half its vorticity, has none.
    assert float(force_by(Magnus(), inputs((-speed, 0.0), (2 * spin,), (spin,)))[1][0]) == 0.0


@pytest.mark.parametrize(("spin", "factor"), [(5.0, 1.0), (200.0, (12.9 * 800**0.5 + 128.4) / (64 * math.pi))])
def test_rotational_drag(spin, factor):
    """Stokes' 8 pi mu r^3 omega, Dennis' factor at Re_r = 800; and the exact decay over a long interval."""
    inertia = jnp.asarray(1e-9)
    torque = rotational_drag(inputs((0.0, 0.0), (0.0,), (spin,)), inertia, jnp.asarray(1e-9))
    assert float(torque[0][0]) == pytest.approx(-8 * math.pi * MU * (D / 2) ** 3 * spin * factor, rel=1e-6)
    long = rotational_drag(inputs((0.0, 0.0), (0.0,), (spin,)), inertia, jnp.asarray(1e3))
    assert float(long[0][0]) == pytest.approx(-1e-9 * spin / 1e3, rel=1e-9)  # all of it is taken away, no more


@pytest.mark.parametrize("law", [SaffmanMei(), Magnus()])
def test_gradients_are_finite_without_slip_and_without_rotation(law):
    def total(slip, curl):
        force = law.force(
            FlowAround((slip, slip), (curl,), (curl * 0.0,), jnp.asarray(D), jnp.asarray(RHO), jnp.asarray(MU))
        )
        return jnp.sum(force[0] + force[1])

    slopes = jax.jit(jax.grad(total, (0, 1)))
    for slip, curl in ((0.0, 0.0), (0.1, 0.0), (0.0, 1.0)):
        found = slopes(jnp.asarray([slip]), jnp.asarray([curl]))
        assert all(np.isfinite(np.asarray(g)).all() for g in found)


@pytest.mark.parametrize("dimension", [2, 3])
def test_vorticity_of_a_shear(dimension):
    """A linear flow u = A x has the curl of A everywhere, at walls too."""
    cells = (6, 5, 4)[:dimension]
    grid = Grid(cells, tuple(0.1 * n for n in cells), 0.1, (False,) * dimension)
    slope = np.random.default_rng(2).normal(size=(dimension, dimension))
    faces = []
    for axis in range(dimension):
        shape = grid.face_shape(axis)
        places = np.stack(
            np.meshgrid(
                *[0.1 * (np.arange(n) + (0.0 if a == axis else 0.5)) for a, n in enumerate(shape)],
                indexing="ij",
            ),
            axis=-1,
        )
        faces.append(jnp.asarray(places @ slope[axis]))
    position = np.random.default_rng(3).uniform(0.0, grid.size, (9, dimension))
    weights = Kernel((0.12,) * dimension).weights(grid, jnp.asarray(position), jnp.asarray(0.01))
    curl = np.stack([np.asarray(x) for x in vorticity(grid, weights, tuple(faces))], axis=1)
    if dimension == 2:
        expected = [slope[1, 0] - slope[0, 1]]
    else:
        expected = [slope[2, 1] - slope[1, 2], slope[0, 2] - slope[2, 0], slope[1, 0] - slope[0, 1]]
    np.testing.assert_allclose(curl, np.tile(expected, (9, 1)), atol=1e-12)
    assert vectors.angular_size(dimension) == curl.shape[1]


def shear_scene(tmp_path, **coupling):
    """One grain at rest in a uniform shear between a fixed and a moving wall, periodic along the flow."""
    options = "\n".join(f"{name} = {value}" for name, value in coupling.items())
    path = tmp_path / "shear.toml"
    path.write_text(f"""
precision = "float64"
[domain]
size = [0.2, 0.1]
depth = 0.1
gravity = [0.0, 0.0]
[particles]
position = [[0.1, 0.05]]
angular_velocity = [[3.0]]
radius = 0.0005
density = 1000.0
[contact]
[fluid]
cells = [16, 16]
density = 1000.0
viscosity = 1e-4
time_step = 1e-3
[boundary]
left.kind = "periodic"
right.kind = "periodic"
bottom.kind = "no_slip"
top = {{kind = "moving_wall", velocity = [0.4, 0.0], ramp_time = 0.0}}
[coupling]
drag = "stokes"
{options}
[time]
end = 0.001
output_interval = 0.001
""")
    return jaxdem.load_scene(path)


@pytest.fixture
def sheared():
    """Forces after one interval, and the momentum that it changed."""

    def run(scene):
        simulation, parameters = jaxdem.build(scene)
        state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
        heights = 0.1 * (np.arange(16) + 0.5) / 16
        flow = jnp.broadcast_to(4.0 * jnp.asarray(heights)[None], state.fluid.face_velocity[0].shape)
        fluid = state.fluid._replace(face_velocity=(flow, state.fluid.face_velocity[1]))
        new, _, report = jax.jit(lambda s, n: step(simulation, parameters, s, n))(
            state._replace(fluid=fluid), neighbors
        )
        return parameters, new, report

    return run


def test_lift_and_torque_in_a_run(tmp_path, sheared):
    """In a shear of 4/s with slip 0.2 m/s along x: both lifts across the flow, as their papers have them; the
    fluid loses what the grain gains; and the torque makes the grain turn towards half the vorticity, -2/s."""
    scene = shear_scene(tmp_path, lift='["saffman_mei", "magnus"]', rotational_drag="true")
    parameters, new, report = sheared(scene)
    d, mu, slip, shear, spin = 1e-3, 0.1, 0.2, 4.0, 3.0
    re, b = 1000 * slip * d / mu, d * shear / (2 * slip)
    mei = (1 - 0.3314 * math.sqrt(b)) * math.exp(-re / 10) + 0.3314 * math.sqrt(b)
    saffman = 1.615 * mu * d * slip * math.sqrt(d**2 * shear * 1000 / mu) * mei
    relative = -shear / 2 - spin
    rotation = 1000 * abs(relative) * d**2 / mu
    factor = 0.45 + (rotation / re - 0.45) * math.exp(-0.05684 * rotation**0.4 * re**0.3)
    magnus = math.pi / 8 * d**2 * 1000 * factor * slip**2 * math.copysign(1, relative)
    lift = sum(np.asarray(mean.given[0]) for mean in report.forces.further.values())
    assert lift[1] == pytest.approx(saffman + magnus, rel=1e-9)
    assert abs(lift[0]) < 1e-12 * abs(lift[1])
    assert float(report.exchange.momentum) < 1e-12
    torque = float(report.forces.torque[0, 0])
    inertia = float(parameters.bodies.inertia)
    decay = math.pi * mu * d**3 / inertia * 1e-3
    assert torque == pytest.approx(inertia * relative * -math.expm1(-decay) / 1e-3, rel=1e-9)
    assert float(new.particles.angular_velocity[0, 0]) == pytest.approx(spin + relative * -math.expm1(-decay), rel=1e-6)
    across = float(new.particles.velocity[0, 1]) * float(parameters.bodies.mass)
    assert across == pytest.approx(float(report.forces.total[0, 1]) * 1e-3, rel=1e-6)
    # Drag takes part of it within the interval, of two relaxation times.
    assert abs(across) > 0.3 * 1e-3 * abs(lift[1])


def test_without_the_options_there_is_neither(tmp_path, sheared):
    """Negative control: no lift, no torque, and the spin stays."""
    _, new, report = sheared(shear_scene(tmp_path))
    assert report.forces.further == {} and report.forces.torque is None
    assert float(new.particles.angular_velocity[0, 0]) == 3.0


def test_every_force_is_listed_and_written(tmp_path):
    """`FORCES` has every class of the folder; frames have the mean of each, and none of a torque."""
    for info in pkgutil.iter_modules(forces.__path__):
        importlib.import_module(f"{forces.__name__}.{info.name}")
    there, found = [forces.FluidForce], set()
    while there:
        kind = there.pop()
        there += kind.__subclasses__()
        if kind.__module__.startswith(forces.__name__) and not inspect.isabstract(kind):
            found.add(kind)
    assert found == set(forces.FORCES)
    scene = jaxdem.load_scene(
        SMALL_INJECTION
        | {
            "coupling": {"lift": ["saffman_mei"], "rotational_drag": True, "virtual_mass": 0.5},
            "time": {"end": 0.02, "output_interval": 0.02},
        }
    )
    run = jaxdem.simulate(scene, tmp_path / "run")
    first, last = run.particles(0), run.particles(-1)
    written = {name for name in last if name.endswith("_force")}
    assert written == {"drag_force", "contact_force", "saffman_mei_force", "virtual_mass_force"}
    assert not first["virtual_mass_force"].any() and np.abs(last["virtual_mass_force"]).max() > 0.0


def test_every_lift_has_a_name_in_the_scene():
    """What `coupling.lift` allows are the lifts that there are."""
    (allowed,) = {names for names in get_args(Coupling.model_fields["lift"].annotation) if names is not ...}
    assert set(get_args(allowed)) == set(LIFT_LAWS)

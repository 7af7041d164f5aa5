"""A held bed of spheres in a column: pressure drop, forces of an accelerating flow, one sphere settling in it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxdem
from jaxdem.coupling import drag as drag_module
from jaxdem.fluid.momentum import FluidSolver
from tests.cases.beds import DEPTH, INTERVAL, LAWS, RAMP, RHO, Column, H, ergun_drop, pressure_slope
from tests.cases.correlations import ROWS
from tests.cases.exchange import settled
from tests.cases.tiers import tiered


@pytest.fixture(scope="module")
def column():
    return Column()


@pytest.fixture(scope="module")
def column_b():
    return Column("B")


@pytest.mark.parametrize("speed", [1e-3, 0.05])
def test_fixed_bed_pressure_drop_is_erguns_in_model_b_too(column_b, speed):
    """The same Ergun drop; the drag carries all of it, V_p dp/L / s on a sphere, pressure and stress nothing."""
    radius, viscosity = 0.009, 1e-5
    s = column_b.solid(radius)
    fluid, _, forces = column_b.run("ergun", radius, speed, viscosity, 200)
    ergun = ergun_drop(s, 2 * radius, viscosity, speed)
    assert pressure_slope(fluid) == pytest.approx(-ergun, rel=1e-3)  # the gate is 2 %
    drop = np.asarray(fluid.pressure)[:, 0].mean()
    assert np.asarray(forces.drag)[:, 1].sum() == pytest.approx(drop * 4 * H * DEPTH, rel=2e-3)
    row = np.abs(column_b.position[:160, 1] - 0.33) < 0.02
    volume = 4 / 3 * np.pi * radius**3
    np.testing.assert_allclose(np.asarray(forces.drag)[:160][row, 1], volume * ergun / s, rtol=2e-3)
    assert not np.any(forces.pressure_gradient) and not np.any(forces.viscous)


def test_drag_that_is_not_converted_fails_the_bed_in_model_b(column_b, monkeypatch):
    """Negative control: the law of model A as it is gives g times the pressure drop."""
    monkeypatch.setattr(drag_module, "drag_of_model_b", lambda drag, solid_fraction: drag)
    fluid, _, _ = column_b.run("ergun", 0.009, 1e-3, 1e-5, 200, run=column_b.compiled())
    s = column_b.solid(0.009)
    assert pressure_slope(fluid) == pytest.approx(-(1.0 - s) * ergun_drop(s, 0.018, 1e-5, 1e-3), rel=1e-3)


def test_pressure_drives_all_of_an_accelerating_flow_in_model_b(column_b):
    """While the inlet ramps up, without drag: rho d(g u)/dt = -grad p, so grad p = -rho dU/dt whatever the bed."""
    speed = 0.02
    fluid, velocity, _ = column_b.run("stokes", 0.009, speed, 1e-5, 4, scale=0.0, density=100.0)
    assert pressure_slope(fluid) == pytest.approx(-RHO * speed / RAMP, rel=1e-3)
    assert not np.any(velocity)  # and no particle feels it


def test_square_of_the_void_fraction_would_fail_the_bed(column, monkeypatch):
    """Negative control: g^2 for g in the pressure's weight is far outside the gate."""
    right = FluidSolver.step

    def wrong(solver, *arguments):
        *others, particles = arguments
        return right(solver, *others, particles._replace(weighting=particles.weighting**2))

    monkeypatch.setattr(FluidSolver, "step", wrong)
    fluid, _, _ = column.run("ergun", 0.009, 1e-3, 1e-5, 200, run=column.compiled())
    expected = ergun_drop(column.solid(0.009), 0.018, 1e-5, 1e-3)
    assert abs(pressure_slope(fluid) / -expected - 1.0) > 0.2


def test_g_squared_for_g_cubed_in_erguns_law_would_fail_the_bed(column):
    """Negative control: the drop then misses by the factor g = 0.62."""
    s = column.solid(0.009)
    fluid, _, _ = column.run("ergun", 0.009, 1e-3, 1e-5, 200, scale=1.0 - s)
    expected = ergun_drop(s, 0.018, 1e-5, 1e-3)
    assert pressure_slope(fluid) == pytest.approx(-(1.0 - s) * expected, rel=1e-3)
    assert abs(pressure_slope(fluid) / -expected - 1.0) > 0.02  # the gate


@pytest.mark.parametrize("radius", [0.002, 0.009])
def test_pressure_gradient_force_in_an_accelerating_flow(column, radius):
    """While the inlet ramps up, without drag: grad p = -rho dU/dt / g, hence V_p rho (dU/dt) / g on a sphere.

    A light sphere is thrown ahead by it: with a tenth of the fluid's density, ten times the acceleration.
    """
    speed, s = 0.02, column.solid(radius)
    fluid, velocity, forces = column.run("stokes", radius, speed, 1e-5, 4, scale=0.0, density=100.0)
    rate = speed / RAMP / (1.0 - s)
    assert pressure_slope(fluid) == pytest.approx(-RHO * rate, rel=1e-3)
    row = np.abs(column.position[:160, 1] - 0.33) < 0.02
    expected = 4 / 3 * np.pi * radius**3 * RHO * rate
    # Convection is the same along an even bed, so that only the ramp accelerates.
    np.testing.assert_allclose(np.asarray(forces.pressure_gradient)[:160][row, 1], expected, rtol=1e-3)
    assert velocity[160, 1] == pytest.approx(10.0 * rate * 4 * INTERVAL, rel=1e-3)


def test_every_law_is_tried():
    assert set(ROWS) == set(LAWS)


@pytest.mark.parametrize("relaxation", [0.01, 0.3])
@pytest.mark.parametrize(("law", "reynolds"), [("schiller_naumann", 1e4), ("schiller_naumann", 300.0)])
def test_stiff_drag_settles_too(column, law, reynolds, relaxation):
    """Drag that grows as slip^2, or nearly, with a relaxation time of a fraction of the interval.

    With the coefficient of the interval's start a weight W gives v' = W / (k v), which has period two.
    """
    got, expected = settled(column, law, 0.004, reynolds, relaxation * INTERVAL)
    assert got == pytest.approx(expected, rel=0.01)  # the gate


@pytest.mark.parametrize("model", tiered(["A", "B"], first=["A"]))
def test_a_dilute_sphere_settles_alike_in_both_models(model):
    """One sphere in 1e10 times its volume of air: the terminal speed of Schiller and Naumann's drag.

    W = 3 pi mu d v (1 + 0.15 Re^0.687) by a fixed point; the drag's relaxation time is five steps.
    """
    d, nu, rho, density, gravity = 1e-4, 1e-4, 1.2, 2000.0, 9.81
    tables = dict(
        precision="float64",
        domain=dict(size=[0.2, 0.2], depth=1.0, gravity=[0.0, 0.0]),
        particles=dict(radius=d / 2, density=density, position=[[0.1, 0.15]]),
        contact=dict(young_modulus=1.0, speed=1e-3),
        fluid=dict(cells=[4, 4], density=rho, viscosity=nu, time_step=2e-3, model=model),
        boundary={side: dict(kind="periodic") for side in ("left", "right", "bottom", "top")},
        coupling=dict(drag="schiller_naumann", kernel_width=dict(diameters=0.0, cells=0.5)),
        time=dict(end=0.2, output_interval=0.2),
    )
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    parameters = parameters._replace(gravity=jnp.asarray([0.0, -gravity]))  # a periodic scene may not have it

    @jax.jit
    def settled(state, neighbors):
        return lax.fori_loop(0, 100, lambda _, c: simulation.step(parameters, *c)[:2], (state, neighbors))

    end, _ = settled(state, neighbors)
    stokes_speed = (density - rho) * gravity * d**2 / (18.0 * rho * nu)
    speed = stokes_speed
    for _ in range(200):
        speed = stokes_speed / (1.0 + 0.15 * (speed * d / nu) ** 0.687)
    # The air, which takes up the sphere's weight, has gained 1e-6 of its speed by now; the models differ by the
    # solid fraction, 1e-10.
    assert -float(end.particles.velocity[0, 1]) == pytest.approx(speed, rel=5e-6)

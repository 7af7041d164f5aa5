"""A sphere that drags its fluid along: the correction for its own wake, coarse; all cases in tests/cases."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from scipy.integrate import quad
from scipy.special import erfcx

import jaxdem
from jaxdem.check.check import check_scene
from jaxdem.closures import SchillerNaumann
from jaxdem.closures.base import Drag, DragInputs
from jaxdem.coupling.self_disturbance import (
    SelfDisturbance,
    brinkman_factor,
    kernel_mobility,
    oseen_factor,
)
from jaxdem.errors import InputError
from jaxdem.step import advance_fluid
from tests.cases import settling

CELLS = 12


@pytest.fixture(scope="module")
def fall():
    """Cells of one length, a kernel of half-width one cell; the diameter is traced: one program."""
    tables = settling.settling_scene(3.3, 0.01, True, (CELLS,) * 3)
    spacing = tables["domain"]["size"][0] / CELLS
    tables["coupling"]["kernel_width"] = dict(diameters=0.0, cells=1.0)
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    start, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    parameters = settling.falling(parameters, 0.01)

    @jax.jit
    def run(parameters):
        def body(_, carry):
            state, neighbors, _, good = carry
            state, neighbors, report = simulation.step(parameters, state, neighbors)
            seen = report.forces.inputs.slip_velocity[0, 2]
            good = good & report.fluid.converged & (report.exchange.momentum < 1e-12)
            return state, neighbors, seen, good

        return lax.fori_loop(0, 45, body, (start, neighbors, jnp.zeros(()), jnp.asarray(True)))

    def speeds(cell_over_diameter):
        """Speed against the mean flow and slip seen, over the undisturbed speed; images over the same."""
        diameter = spacing / cell_over_diameter
        bodies = parameters.bodies._replace(radius=jnp.asarray(0.5 * diameter))
        gravity = parameters.gravity / diameter**2  # the same speed
        state, _, seen, good = run(parameters._replace(bodies=bodies, gravity=gravity))
        assert bool(good)
        flow = float(jnp.mean(state.fluid.face_velocity[2][:, :, :-1]))
        speed = (flow - float(state.particles.velocity[0, 2])) / 0.01
        images = settling.HASIMOTO * 0.5 * diameter / (CELLS * spacing)
        return speed, float(seen) / 0.01, images, diameter / spacing

    return speeds


@pytest.mark.parametrize("cell_over_diameter", [3.3, 2.0, 1.7])
def test_sphere_settles_at_the_undisturbed_speed(fall, cell_over_diameter):
    """Two-way, Re = 0.01, in a periodic box whose images (Hasimoto) are taken off; what it sees is its wake less.

    The wake in closed form, of a Gaussian with the variance of the triangle and of the cell it is integrated over: 0.5
    d / (sqrt(pi) S) of the slip (0.28 d / S), S^2 = w^2/6 + h^2/12.
    """
    speed, seen, images, diameter = fall(cell_over_diameter)
    print(cell_over_diameter, speed + images, seen)
    assert speed + images == pytest.approx(1.0, abs=0.02 if cell_over_diameter == 3.3 else 0.05)  # the gates
    hidden = 0.5 * diameter / math.sqrt(math.pi * (1.0 / 6.0 + 1.0 / 12.0))
    assert 1.0 - seen == pytest.approx(hidden, rel=0.05)  # of one place in a cell, and in a box
    assert hidden > 0.1  # without the correction it would be off by so much


def test_mobility_of_a_wide_kernel_is_that_of_its_gaussian():
    """1 / (6 pi^1.5 S) with S^2 the variance of the triangle, w^2/6, where cells are small against it; and scaling."""
    assert kernel_mobility((4.0,) * 3, (0.5,) * 3) == pytest.approx(
        1.0 / (6.0 * math.pi**1.5 * 4.0 / math.sqrt(6.0)), rel=0.03
    )
    fine, coarse = kernel_mobility((1.0,) * 3, (1.0,) * 3), kernel_mobility((2e-3,) * 3, (2e-3,) * 3)
    assert coarse == pytest.approx(500.0 * fine, rel=1e-12)
    # Cells of another shape: between those of the cubes.
    between = kernel_mobility((1.5, 1.5, 1.5), (1.0, 1.0, 0.5))
    assert kernel_mobility((1.5,) * 3, (1.0,) * 3) < between < kernel_mobility((1.5,) * 3, (0.5,) * 3)


def test_factors_are_those_of_oseen_and_brinkman():
    screened = lambda y: 1.0 - math.sqrt(math.pi) * y * erfcx(y)  # noqa: E731
    for value in (1e-3, 0.1, 1.0, 5.0, 50.0):
        oseen = 1.5 * quad(lambda x, r=value: (1.0 - x * x) * screened(r * x), 0.0, 1.0)[0]
        assert float(oseen_factor(jnp.asarray(value))) == pytest.approx(oseen, rel=2e-3)
        assert float(brinkman_factor(jnp.asarray(value**2))) == pytest.approx(screened(value), rel=1e-2)


def test_correction_of_a_law_is_consistent_and_has_its_gradient():
    """Slip seen + velocity of the wake = undisturbed slip, Re = 5; slope against differences; finite at rest."""
    correction, one = SelfDisturbance(0.02), jnp.ones(1)

    @jax.jit
    def force(slip):
        inputs = DragInputs(-slip, 0.0 * slip, 0.0 * one, slip, slip, one[0], one[0], one[0], one[0])
        return correction(SchillerNaumann(), inputs, 0.0 * one, jnp.asarray(math.pi / 6.0)).coefficient * slip[:, 0]

    def wake(undisturbed):
        reynolds = abs(undisturbed)
        drag = 3.0 * math.pi * settling.schiller_naumann(reynolds) * undisturbed
        return drag, 0.02 * float(oseen_factor(jnp.asarray(reynolds * correction.width))) * drag

    drag, dragged = wake(5.0)
    assert dragged > 0.2
    slip = jnp.asarray([[5.0 - dragged, 0.0, 0.0]])
    assert float(force(slip)[0]) == pytest.approx(drag, rel=5e-3)  # of two evaluations of the law
    total = jax.jit(lambda s: jnp.sum(force(s)))
    gradient = jax.jit(jax.grad(total))
    step = jnp.zeros((1, 3)).at[0, 0].set(1e-5)
    slope = float((total(slip + step) - total(slip - step)) / 2e-5)
    assert float(gradient(slip)[0, 0]) == pytest.approx(slope, rel=1e-7)
    assert np.all(np.isfinite(gradient(jnp.zeros((1, 3)))))


def test_a_force_beside_the_coefficient_is_of_the_undisturbed_slip_too():
    """A law with all its drag in the remainder beside a coefficient that makes the wake, as learned ones have it."""
    correction, one = SelfDisturbance(0.02), jnp.ones(1)
    stokes = SchillerNaumann()

    def law(inputs):
        drag = stokes(inputs)
        return Drag(drag.coefficient, 0.5 * drag.coefficient[:, None] * inputs.slip_velocity, drag.out_of_range)

    slip = jnp.asarray([[2.0, -1.0, 0.5]])
    inputs = DragInputs(-slip, 0.0 * slip, 0.1 * one, slip, slip, one[0], one[0], one[0], one[0])
    volume = jnp.asarray(math.pi / 6.0)
    drag = jax.jit(lambda i: correction(law, i, 0.02 * one, volume))(inputs)
    np.testing.assert_allclose(drag.remainder, 0.5 * drag.coefficient[:, None] * slip, rtol=1e-3)  # of two evaluations


def test_off_compiles_nothing_of_it():
    """One evaluation of the law for the slip and one for its prediction; two each with the correction; and `check`."""
    powers = []
    for corrected in (False, True):
        scene = jaxdem.load_scene(settling.settling_scene(3.3, 1.0, corrected, (4, 4, 4)))
        simulation, parameters = jaxdem.build(scene)
        state, _ = jaxdem.initial_state(scene, simulation, parameters)
        program = str(jax.make_jaxpr(lambda p, s, of=simulation: advance_fluid(of, p, s))(parameters, state))
        powers.append(program.count("= pow "))
        report = check_scene(scene)
        names = report.compiled_in if corrected else report.left_out
        assert any(name.startswith("self-disturbance correction") for name in names)
    assert powers[1] == powers[0] + 2  # Schiller and Naumann's 0.687


def test_what_cannot_be_is_refused():
    tables = settling.settling_scene(3.3, 0.01, True, (CELLS,) * 3)
    with pytest.raises(InputError, match=r"coupling\.self_disturbance.*centre"):
        jaxdem.load_scene(tables | dict(coupling=tables["coupling"] | dict(void_fraction="centre")))
    with pytest.raises(InputError, match=r"coupling\.deconvolution.*own wake"):
        jaxdem.load_scene(tables | dict(coupling=tables["coupling"] | dict(deconvolution=0.05)))
    tables = settling.settling_scene(0.5, 0.01, True, (CELLS,) * 3)
    narrow = tables | dict(coupling=tables["coupling"] | dict(kernel_width=dict(diameters=0.3, cells=0.1)))
    with pytest.raises(InputError, match=r"coupling\.kernel_width.*hides"):
        jaxdem.build(jaxdem.load_scene(narrow))
    flat = tables | dict(
        domain=dict(size=[39.6, 39.6], depth=1.0, gravity=[0.0, 0.0]),
        fluid=tables["fluid"] | dict(cells=[CELLS, CELLS]),
        particles=tables["particles"] | dict(position=[[20.0, 20.0]]),
        boundary={s: dict(kind="periodic") for s in ("left", "right", "bottom", "top")},
    )
    with pytest.raises(InputError, match="Stokes' paradox"):
        jaxdem.load_scene(flat)

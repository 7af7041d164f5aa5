"""Drag laws against the formulas of the literature, as `tests/cases/correlations.py` has them."""

import csv
import math
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.closures import DRAG_LAWS, DragInputs, Ergun, KochHill, drag_law, drag_law_name
from jaxdem.errors import InputError
from tests.cases.correlations import DENSITY, DIAMETER, ROWS, VISCOSITY
from tests.cases.tiers import tiered

TERMINAL = Path(__file__).parents[1] / "data" / "settling_terminal.csv"


def make_inputs(slip, solid_fraction, diameter=DIAMETER, density=DENSITY, viscosity=VISCOSITY):
    """Particles moving at -0.3 m/s along x, slip along the last axis."""
    slip, solid_fraction = np.atleast_1d(slip), np.atleast_1d(solid_fraction)
    count = max(len(slip), len(solid_fraction))
    particle = np.tile([-0.3, 0.0], (count, 1))
    fluid = particle + np.stack([np.zeros(count), np.broadcast_to(slip, count)], axis=1)
    zeros = np.zeros((count, 2))
    inputs = DragInputs(
        particle_velocity=particle,
        fluid_velocity=fluid,
        solid_fraction=np.broadcast_to(solid_fraction, count).astype(float),
        void_fraction_gradient=zeros,
        pressure_gradient=zeros,
        diameter=np.asarray(diameter),
        filter_size=np.asarray(2 * diameter),
        fluid_density=np.asarray(density),
        dynamic_viscosity=np.asarray(viscosity),
    )
    return jax.tree.map(jnp.asarray, inputs)


@partial(jax.jit, static_argnums=0)
def evaluate(law, inputs):
    return law(inputs)


@partial(jax.jit, static_argnums=0)
def multiple(law, solid_fraction, reynolds):
    return law.stokes_multiple(solid_fraction, reynolds)


def test_every_law_has_its_row():
    """What a new law needs: `docs/architecture.md`, "Add a drag law"."""
    assert set(ROWS) == set(DRAG_LAWS)


@pytest.mark.parametrize("name", DRAG_LAWS)
def test_table_against_literature_form(name):
    """Force over Re 1e-3 ... 1e4 and void fractions 0.35 ... 0.99, to round-off."""
    slips = np.array([5e-7, 1e-4, 3e-3, 0.05, 0.7, 5.0])
    fractions = np.array([0.01, 0.1, 0.199, 0.201, 0.39, 0.41, 0.55, 0.65])
    slip, solid_fraction = (grid.ravel() for grid in np.meshgrid(slips, fractions))
    inputs = make_inputs(slip, solid_fraction)
    drag = evaluate(DRAG_LAWS[name](), inputs)
    force = drag.coefficient * slip
    expected = [ROWS[name].force(float(w), float(s)) for w, s in zip(slip, solid_fraction, strict=True)]
    np.testing.assert_allclose(force, expected, rtol=1e-12)
    assert drag.remainder is None
    assert not drag.out_of_range.any()


def test_koch_hill_by_hand():
    """F at two points worked out by hand: s = 0.08 has sqrt(s/2) = 0.2, ln s = -2.5257286."""
    value = multiple(KochHill(), jnp.array([0.08]), jnp.array([0.0]))
    numerator = 1 + 0.6 - 135 / 64 * 0.08 * 2.525728644308255 + 1.2912
    assert value[0] == pytest.approx(0.92**2 * numerator / 1.00438592, rel=1e-9)
    # s = 0.5: F = 0.25 (10 * 0.5 / 0.125 + (0.0673 + 0.106 + 0.7424) * 10 / 2)
    dense = multiple(KochHill(), jnp.array([0.5]), jnp.array([10.0]))
    assert dense[0] == pytest.approx(0.25 * (40 + 0.9157 * 5), rel=1e-12)


def test_koch_hill_keeps_its_jump():
    below, above = multiple(KochHill(), jnp.array([0.4 - 1e-12, 0.4]), jnp.zeros(2))
    assert above / below - 1 == pytest.approx(0.0104, abs=1e-4)


def test_gidaspow_switches_at_void_fraction_08():
    laws = [DRAG_LAWS[name]() for name in ("gidaspow", "wen_yu", "ergun")]
    solid, reynolds = jnp.array([0.2 - 1e-9, 0.2 + 1e-9]), jnp.array([50.0, 50.0])
    sharp, dilute, dense = (multiple(law, solid, reynolds) for law in laws)
    assert sharp[0] == dilute[0] and sharp[1] == dense[1]


def _terminal_rows():
    lines = [line for line in TERMINAL.read_text().splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


@partial(jax.jit, static_argnums=0)
def terminal_velocity(law, inputs, weight):
    """Slip at which the drag carries the weight, by bisection."""

    def halve(_, bounds):
        low, high = bounds
        middle = 0.5 * (low + high)
        fluid = inputs.particle_velocity + jnp.array([[0.0, 1.0]]) * middle
        force = law(inputs._replace(fluid_velocity=fluid)).coefficient[0] * middle
        return jnp.where(force < weight, middle, low), jnp.where(force < weight, high, middle)

    return jax.lax.fori_loop(0, 60, halve, (jnp.asarray(0.0), jnp.asarray(1000.0)))[0]


@pytest.mark.parametrize(
    ("law", "column"), [("stokes", "v_Stokes"), ("schiller_naumann", "v_SN"), ("di_felice", "v_DV")]
)
@pytest.mark.parametrize("row", _terminal_rows(), ids=lambda row: row["case"])
def test_terminal_velocity(law, column, row):
    """coefficient(v) v = (rho_p - rho_f) V g, by bisection, against the table [1e-4 of it]."""
    diameter, density, viscosity = (float(row[name]) for name in ("d_m", "rho_f", "mu_Pa_s"))
    weight = (float(row["rho_p"]) - density) * math.pi / 6 * diameter**3 * float(row["g"])
    inputs = make_inputs(1.0, 0.0, diameter, density, viscosity)
    assert float(terminal_velocity(DRAG_LAWS[law](), inputs, weight)) == pytest.approx(float(row[column]), rel=1e-4)


def test_ergun_packed_bed_pressure_drop():
    """Force on all particles of a fixed bed over the void fraction is Ergun's pressure drop (MacDonald's
    form, by U)."""
    g, superficial = 0.42, 0.013
    inputs = make_inputs(superficial / g, 1 - g)
    force = float((evaluate(Ergun(), inputs).coefficient * superficial / g)[0])
    per_volume = (1 - g) / (math.pi / 6 * DIAMETER**3)
    drop = force * per_volume / g  # g grad p = -n f in model A
    viscous = 150 * VISCOSITY * superficial * (1 - g) ** 2 / (g**3 * DIAMETER**2)
    inertial = 1.75 * DENSITY * superficial**2 * (1 - g) / (g**3 * DIAMETER)
    assert drop == pytest.approx(viscous + inertial, rel=1e-12)


@pytest.mark.parametrize("name", DRAG_LAWS)
def test_dilute_creeping_limit(name):
    """At Re = 0 and s = 0 the law is Stokes drag, as far as the correlation goes there."""
    value = multiple(DRAG_LAWS[name](), jnp.zeros(1), jnp.zeros(1))
    assert float(value[0]) == pytest.approx(ROWS[name].single_creeping, rel=1e-12)


@pytest.mark.parametrize("name", DRAG_LAWS)
@pytest.mark.parametrize("dtype", tiered([jnp.float32, jnp.float64], first=[jnp.float64]))
def test_finite_values_and_gradients_at_the_edges(name, dtype):
    """Zero slip, tiny slip, no particles, all solid, round-off below zero: finite value and gradient, dtype
    kept."""
    slip = np.array([0.0, 0.0, 0.0, 1e-30, 1e-12, 1e3, 0.0, 1.0])
    solid = np.array([0.0, 0.4, 1.0, 0.0, 1e-14, 0.999, -1e-9, -1e-9])
    inputs = jax.tree.map(lambda leaf: np.asarray(leaf, dtype), make_inputs(slip, solid))
    closure = DRAG_LAWS[name]()

    def total(inputs):
        drag = closure(inputs)
        return jnp.sum(drag.coefficient[:, None] * inputs.slip_velocity), drag

    gradient, drag = jax.jit(jax.grad(total, has_aux=True))(inputs)
    assert drag.coefficient.dtype == dtype
    assert np.isfinite(drag.coefficient).all() and (drag.coefficient >= 0).all()
    for path, leaf in jax.tree_util.tree_flatten_with_path(gradient)[0]:
        assert np.isfinite(leaf).all(), path


@pytest.mark.parametrize("name", DRAG_LAWS)
def test_gradient_against_finite_differences(name):
    """jvp of the force in slip and solid fraction against central differences [1e-7, their own error]."""
    closure = DRAG_LAWS[name]()
    slip = jnp.array([1e-3, 0.02, 0.3, 0.8])
    solid = jnp.array(ROWS[name].smooth_at)
    base = make_inputs(slip, solid)

    @jax.jit
    def force(slip, solid):
        fluid = base.particle_velocity + slip[:, None] * jnp.array([[0.6, 0.8]])
        drag = closure(base._replace(fluid_velocity=fluid, solid_fraction=solid))
        return drag.coefficient * slip

    for tangent in ((slip, jnp.zeros(4)), (jnp.zeros(4), solid)):
        exact = jax.jvp(force, (slip, solid), tangent)[1]
        step = 1e-5
        forward = force(slip + step * tangent[0], solid + step * tangent[1])
        backward = force(slip - step * tangent[0], solid - step * tangent[1])
        scale = np.abs(force(slip, solid))
        np.testing.assert_allclose(exact / scale, (forward - backward) / (2 * step) / scale, atol=1e-7)


def test_out_of_range_is_flagged():
    drag = evaluate(KochHill(), make_inputs(0.1, [0.5, 0.79, 0.81, 1.2]))
    assert drag.out_of_range.tolist() == [False, False, True, True]
    assert drag.coefficient[2] == drag.coefficient[3]


def test_laws_are_static_arguments():
    """Two instances compile once; different laws are different; a law without F cannot be made."""
    traces = []

    def coefficient(law, inputs):
        traces.append(law)
        return law(inputs).coefficient

    compiled = jax.jit(coefficient, static_argnums=0)
    for law in (KochHill(), KochHill(), Ergun()):
        compiled(law, make_inputs(0.1, 0.3))
    assert len(traces) == 2
    assert KochHill() == KochHill() and KochHill() != Ergun()
    from jaxdem.closures import Correlation

    with pytest.raises(TypeError):
        Correlation()


def test_names():
    assert all(drag_law_name(drag_law(name)) == name for name in DRAG_LAWS)
    with pytest.raises(InputError, match="koch_hil.*koch_hill"):
        drag_law("koch_hil")

"""A held bed of spheres in a column: pressure drop, forces of an accelerating flow, one sphere settling in it."""

import dataclasses
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxdem
from jaxdem.closures import DRAG_LAWS
from jaxdem.coupling import exchange as exchange_module
from jaxdem.coupling.exchange import exchange
from jaxdem.coupling.interpolation import kernel_weights

DATA = Path(__file__).parents[1] / "data"
LAWS = tuple(DRAG_LAWS)
H, DEPTH, INTERVAL, RAMP = 0.04, 0.02, 0.01, 0.05
RHO = 1000.0


@partial(jax.tree_util.register_dataclass, data_fields=["law"], meta_fields=[])
@dataclasses.dataclass(frozen=True, eq=False)
class AnyLaw:
    """Any correlation, chosen by a traced number: one compilation for all."""

    law: jax.Array

    def __call__(self, inputs):
        return lax.switch(self.law, [DRAG_LAWS[name]() for name in LAWS], inputs)


class Column:
    """160 held spheres, two by two in the cells of ten middle rows, and a tiny one among them that may move."""

    def __init__(self, model="A"):
        x, z = np.meshgrid((np.arange(8) + 0.5) * 0.02, 0.12 + (np.arange(20) + 0.5) * 0.02, indexing="ij")
        bed = np.stack((x.ravel(), z.ravel()), axis=1)
        self.position = np.concatenate((bed, [[0.08, 0.32]]))
        tables = dict(
            precision="float64",
            domain=dict(size=[4 * H, 16 * H], depth=DEPTH, gravity=[0.0, 0.0]),
            particles=dict(radius=[0.009] * 160 + [5e-5], density=2650.0, position=self.position.tolist()),
            contact=dict(speed=1.0),
            fluid=dict(cells=[4, 16], density=RHO, viscosity=1e-5, time_step=INTERVAL, model=model),
            boundary=dict(
                left=dict(kind="free_slip"),
                right=dict(kind="free_slip"),
                bottom=dict(kind="inlet", velocity=0.01, ramp_time=RAMP),
                top=dict(kind="outlet"),
            ),
            coupling=dict(interval=INTERVAL, kernel_width=dict(diameters=0.5, cells=1.0)),
            time=dict(end=1.0, output_interval=0.1),
        )
        scene = jaxdem.load_scene(tables)
        self.simulation, self.parameters = jaxdem.build(scene)
        self.start, _ = jaxdem.initial_state(scene, self.simulation, self.parameters)
        self.interval = self.simulation.fluid
        self.jitted = self.compiled()

    def compiled(self):
        """A fresh compilation, which sees what a test has patched."""
        return jax.jit(lambda *arguments: self._run(*arguments))

    def _run(self, law, scale, properties, bodies, gravity, fluid, particles, free, steps):
        """Fluid, velocities and the last forces; only the `free` ones gather velocity, nobody moves."""

        def once(k, fluid, particles):
            time = k * jnp.asarray(INTERVAL)
            return exchange(
                self.interval, AnyLaw(law), scale, properties, bodies, gravity, fluid, particles, time
            )

        def body(k, carry):
            fluid, velocity, _, good = carry
            now = particles._replace(velocity=velocity)
            fluid, forces, report = once(k, fluid, now)
            weight = (bodies.mass - properties.density * bodies.volume)[:, None] * gravity[None]
            faster = velocity + INTERVAL * (forces.total + weight) / bodies.mass[:, None]
            good = good & report.converged & (report.divergence < 1e-10)
            return fluid, jnp.where(free[:, None], faster, velocity), forces, good

        shapes = jax.eval_shape(once, 0, fluid, particles)[1]
        zeros = jax.tree.map(lambda shape: jnp.zeros(shape.shape, shape.dtype), shapes)
        return lax.fori_loop(0, steps, body, (fluid, particles.velocity, zeros, jnp.asarray(True)))

    def run(self, law, radius, velocity, viscosity, steps, scale=1.0, gravity=0.0, density=2650.0, run=None):
        """Fluid, velocities, forces at the end; bed of this radius, held by its weight of 1e12 kg/m3."""
        number = partial(jnp.asarray, dtype=jnp.float64)
        bodies = self.parameters.bodies._replace(
            radius=number([radius] * 160 + [5e-5]), density=number([1e12] * 160 + [density])
        )
        # Contacts carry the bed's weight, as they would in a column with a floor.
        held = np.zeros((161, 2))
        held[:160, 1] = gravity * float((bodies.mass - RHO * bodies.volume)[0])
        particles = self.start.particles._replace(contact_force=number(held))
        side = [np.zeros(2)] * 4
        side[2] = np.array([0.0, velocity])
        properties = self.parameters.fluid._replace(
            viscosity=number(viscosity), side_velocity=tuple(number(v) for v in side)
        )
        weights = kernel_weights(
            self.interval.solver.grid, self.interval.deposition.half_width, number(self.position)
        )
        solids = exchange_module.solid_fraction(self.interval.solver.grid, weights, bodies.volume)
        fluid = self.start.fluid._replace(void_fraction=1.0 - solids)
        fluid, speeds, forces, good = (run or self.jitted)(
            jnp.asarray(LAWS.index(law), jnp.int32),
            number(scale),
            properties,
            bodies,
            number([0.0, -gravity]),
            fluid,
            particles,
            jnp.arange(161) == 160,
            steps,
        )
        assert bool(good)
        return fluid, np.asarray(speeds), forces

    @staticmethod
    def solid(radius):
        return 4 / 3 * np.pi * radius**3 / (0.02**2 * DEPTH)


@pytest.fixture(scope="module")
def column():
    return Column()


@pytest.fixture(scope="module")
def column_b():
    return Column("B")


def pressure_slope(fluid):
    """Gradient within the bed, three cells from its ends: two kernels see each other's end there [Pa/m]."""
    rows = np.asarray(fluid.pressure).mean(axis=0)
    return (rows[9] - rows[6]) / (3 * H)


@pytest.mark.parametrize("law", ["ergun", "gidaspow"])
@pytest.mark.parametrize("speed", [1e-3, 0.05])
def test_fixed_bed_pressure_drop_is_erguns(column, law, speed):
    """dp/L = 150 mu U s^2 / (g^3 d^2) + 1.75 rho U^2 s / (g^3 d), laminar and inertial, at s = 0.38."""
    radius, viscosity = 0.009, 1e-5
    s, d, mu = column.solid(radius), 2 * radius, RHO * viscosity
    fluid, _, forces = column.run(law, radius, speed, viscosity, 200)
    g = 1.0 - s
    ergun = 150 * mu * speed * s**2 / (g**3 * d**2) + 1.75 * RHO * speed**2 * s / (g**3 * d)
    # Gate 2 %; what is left is the approach to the steady state.
    assert pressure_slope(fluid) == pytest.approx(-ergun, rel=1e-3)
    # The fluid's force on all spheres is the pressure drop of the whole column times its section; the momentum
    # that goes in and out is the same, and free-slip sides take none.
    drop = np.asarray(fluid.pressure)[:, 0].mean()
    total = np.asarray(forces.drag + forces.pressure_gradient + forces.viscous)[:, 1].sum()
    assert total == pytest.approx(drop * 4 * H * DEPTH, rel=2e-3)
    # Model A: the pressure carries the share s of it, the drag g.
    row = np.abs(column.position[:160, 1] - 0.33) < 0.02
    pressure, drag = np.asarray(forces.pressure_gradient)[:160][row, 1], np.asarray(forces.drag)[:160][row, 1]
    np.testing.assert_allclose(pressure, 4 / 3 * np.pi * radius**3 * ergun, rtol=2e-3)
    np.testing.assert_allclose(drag / pressure, g / s, rtol=2e-3)


@pytest.mark.parametrize("speed", [1e-3, 0.05])
def test_fixed_bed_pressure_drop_is_erguns_in_model_b_too(column_b, speed):
    """The same Ergun drop; the drag carries all of it, V_p dp/L / s on a sphere, pressure and stress nothing."""
    radius, viscosity = 0.009, 1e-5
    s, d, mu = column_b.solid(radius), 2 * radius, RHO * viscosity
    fluid, _, forces = column_b.run("ergun", radius, speed, viscosity, 200)
    g = 1.0 - s
    ergun = 150 * mu * speed * s**2 / (g**3 * d**2) + 1.75 * RHO * speed**2 * s / (g**3 * d)
    assert pressure_slope(fluid) == pytest.approx(-ergun, rel=1e-3)  # the gate is 2 %
    drop = np.asarray(fluid.pressure)[:, 0].mean()
    assert np.asarray(forces.drag)[:, 1].sum() == pytest.approx(drop * 4 * H * DEPTH, rel=2e-3)
    row = np.abs(column_b.position[:160, 1] - 0.33) < 0.02
    volume = 4 / 3 * np.pi * radius**3
    np.testing.assert_allclose(np.asarray(forces.drag)[:160][row, 1], volume * ergun / s, rtol=2e-3)
    assert not np.any(forces.pressure_gradient) and not np.any(forces.viscous)


def test_drag_that_is_not_converted_fails_the_bed_in_model_b(column_b, monkeypatch):
    """Negative control: the law of model A as it is gives g times the pressure drop."""
    monkeypatch.setattr(exchange_module, "drag_of_model_b", lambda drag, solid_fraction: drag)
    fluid, _, _ = column_b.run("ergun", 0.009, 1e-3, 1e-5, 200, run=column_b.compiled())
    s, d = column_b.solid(0.009), 0.018
    g = 1.0 - s
    ergun = 150 * RHO * 1e-5 * 1e-3 * s**2 / (g**3 * d**2) + 1.75 * RHO * 1e-6 * s / (g**3 * d)
    assert pressure_slope(fluid) == pytest.approx(-g * ergun, rel=1e-3)


def test_pressure_drives_all_of_an_accelerating_flow_in_model_b(column_b):
    """While the inlet ramps up, without drag: rho d(g u)/dt = -grad p, so grad p = -rho dU/dt whatever the bed."""
    speed = 0.02
    fluid, velocity, _ = column_b.run("stokes", 0.009, speed, 1e-5, 4, scale=0.0, density=100.0)
    assert pressure_slope(fluid) == pytest.approx(-RHO * speed / RAMP, rel=1e-3)
    assert not np.any(velocity)  # and no particle feels it


def test_square_of_the_void_fraction_would_fail_the_bed(column, monkeypatch):
    """Negative control: g^2 for g in the pressure's weight is far outside the gate."""
    right = exchange_module._substep

    def wrong(interval, properties, bodies, weights, drag, response, steady, g, weighting, *rest):
        return right(interval, properties, bodies, weights, drag, response, steady, g, weighting**2, *rest)

    monkeypatch.setattr(exchange_module, "_substep", wrong)
    fluid, _, _ = column.run("ergun", 0.009, 1e-3, 1e-5, 200, run=column.compiled())
    s, d = column.solid(0.009), 0.018
    ergun = 150 * RHO * 1e-5 * 1e-3 * s**2 / ((1 - s) ** 3 * d**2) + 1.75 * RHO * 1e-6 * s / (
        (1 - s) ** 3 * d
    )
    assert abs(pressure_slope(fluid) / -ergun - 1.0) > 0.2


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


def _sphere(re):
    return 1.0 + 0.15 * re**0.687 if re <= 1000.0 else 0.44 * re / 24.0


def _ergun(s, re):
    return (150.0 * s + 1.75 * re) / (18.0 * (1.0 - s))


def _wen_yu(s, re):
    return _sphere(re) * (1.0 - s) ** -2.65


def _koch_hill(s, re):
    below = 1 + 0.681 * s - 8.48 * s**2 + 8.16 * s**3
    f0 = (1 + 3 * np.sqrt(s / 2) + 135 / 64 * s * np.log(s) + 16.14 * s) / below
    f3 = 0.0673 + 0.212 * s + 0.0232 / (1 - s) ** 5
    return (1 - s) ** 2 * ((f0 if s < 0.4 else 10 * s / (1 - s) ** 3) + f3 * re / 2)


def _di_felice(s, re):
    chi = 3.7 - 0.65 * np.exp(-((1.5 - np.log10(re)) ** 2) / 2)
    return (0.63 + 4.8 / np.sqrt(re)) ** 2 * re / 24 * (1 - s) ** (1 - chi)


def _blended(s, re):
    weight = np.arctan(150 * 1.75 * (0.2 - s)) / np.pi + 0.5
    return (1 - weight) * _ergun(s, re) + weight * _wen_yu(s, re)


def _creeping(s):
    return 10 * s / (1 - s) ** 2 + (1 - s) ** 2 * (1 + 1.5 * np.sqrt(s))


def _beetstra(s, re):
    bracket = 1 / (1 - s) + 3 * s * (1 - s) + 8.4 * re**-0.343
    inertial = 0.413 * re / 24 / (1 - s) ** 2 * bracket / (1 + 10 ** (3 * s) * re ** (-0.5 - 2 * s))
    return (1 - s) * (_creeping(s) + inertial)


def _tang(s, re):
    slope = 0.169 * (1 - s) + 0.0644 / (1 - s) ** 4
    inertial = 0.11 * s * (1 + s) - 0.00456 / (1 - s) ** 4 + slope * re**-0.343
    return (1 - s) * (_creeping(s) + inertial * re)


def _rong(s, re):
    g = 1 - s
    chi = 2.65 * (g + 1) - (5.3 - 3.5 * g) * g**2 * np.exp(-((1.5 - np.log10(re)) ** 2) / 2)
    return (0.63 + 4.8 / np.sqrt(re)) ** 2 * re / 24 * g ** (1 - chi)


# F(s, Re), written from the papers once more in plain numpy, and the range (s, Re) it is tried in.
PLAIN = {
    "stokes": (lambda s, re: 1.0, (0.004,), (1e-3,)),
    "schiller_naumann": (lambda s, re: _sphere(re), (0.004,), (1e-3, 1.0, 300.0, 1e4)),
    "ergun": (_ergun, (0.45,), (1.0, 300.0)),
    "wen_yu": (_wen_yu, (0.004, 0.15), (1e-3, 30.0, 1e4)),
    "gidaspow": (lambda s, re: _ergun(s, re) if s > 0.2 else _wen_yu(s, re), (0.15, 0.45), (1e-3, 30.0, 1e4)),
    "gidaspow_blended": (_blended, (0.15, 0.25), (1e-3, 30.0, 1e4)),
    "di_felice": (_di_felice, (0.004, 0.45), (1e-2, 30.0, 1e4)),
    "koch_hill": (_koch_hill, (0.004, 0.3, 0.45), (1e-3, 30.0, 1e4)),
    "beetstra": (_beetstra, (0.15, 0.45), (1e-3, 30.0, 1e3)),
    "tang": (_tang, (0.15, 0.45), (1e-3, 30.0, 1e3)),
    "rong": (_rong, (0.15, 0.45), (1e-2, 30.0, 3e3)),
}


def test_every_law_is_tried():
    assert set(PLAIN) == set(LAWS)


def settled(column, law, s, reynolds, relaxation):
    """Speed of the grain after 40 intervals, and that of the law [m/s]."""
    multiple, radius, d = PLAIN[law][0], (s * 0.02**2 * DEPTH * 3 / 4 / np.pi) ** (1 / 3), 1e-4
    viscosity, volume = 1e-7, np.pi / 6 * d**3
    stokes = 3 * np.pi * RHO * viscosity * d
    weight = stokes * multiple(s, reynolds) * reynolds * viscosity / ((1 - s) * d)
    density = max(1.1 * RHO, stokes * multiple(s, reynolds) * relaxation / volume)
    gravity = weight / ((density - RHO) * volume)
    speed = weight / stokes
    for _ in range(500):  # damped, for the laws that grow with speed
        speed = np.sqrt(speed * weight / (stokes * multiple(s, (1 - s) * speed * d / viscosity)))
    assert (1 - s) * speed * d / viscosity == pytest.approx(reynolds, rel=1e-6)
    _, velocity, forces = column.run(law, radius, 0.0, viscosity, 40, gravity=gravity, density=density)
    assert float(forces.inputs.solid_fraction[160]) == pytest.approx(s, rel=1e-3)
    return -velocity[160, 1], speed


@pytest.mark.parametrize(
    ("law", "s", "reynolds"), [(law, s, re) for law, (_, ss, rs) in PLAIN.items() for s in ss for re in rs]
)
def test_one_sphere_settles_as_the_law_says(column, law, s, reynolds):
    """One-way: a grain of 0.1 mm in still water between held spheres of a given solid fraction.

    Viscosity and gravity are chosen for the Reynolds number; the terminal speed then comes from a fixed point in
    plain numpy. The loading of the grain is 1e-6 of a cell's, so that the water hardly moves.
    """
    # The grain is as heavy as makes its relaxation time two intervals: the next test is about stiffer ones.
    got, expected = settled(column, law, s, reynolds, relaxation=2.0 * INTERVAL)
    assert got == pytest.approx(expected, rel=0.01)  # the gate


@pytest.mark.parametrize("relaxation", [0.01, 0.3])
@pytest.mark.parametrize(("law", "reynolds"), [("schiller_naumann", 1e4), ("schiller_naumann", 300.0)])
def test_stiff_drag_settles_too(column, law, reynolds, relaxation):
    """Drag that grows as slip^2, or nearly, with a relaxation time of a fraction of the interval.

    With the coefficient of the interval's start a weight W gives v' = W / (k v), which has period two.
    """
    got, expected = settled(column, law, 0.004, reynolds, relaxation * INTERVAL)
    assert got == pytest.approx(expected, rel=0.01)  # the gate


def test_dem06_sphere_in_an_upward_stream():
    """MFIX DEM06: Schiller-Naumann sphere falling in air that rises, against its ODE, through the whole step."""
    step, table = 2e-4, np.loadtxt(DATA / "mfix_dem06_terminal_velocity.csv", delimiter=",", skiprows=2)
    tables = dict(
        precision="float64",
        domain=dict(size=[0.2, 0.2], depth=1.0, gravity=[0.0, -9.80665]),
        particles=dict(radius=5e-5, density=2000.0, position=[[0.1, 0.0925]]),
        contact=dict(young_modulus=1.0, speed=1e-3),  # touches nothing: one contact step in a fluid step
        fluid=dict(cells=[4, 4], density=1.2, viscosity=1.5e-5, velocity=[0.0, 0.4], time_step=step),
        boundary={side: dict(kind="periodic") for side in ("left", "right", "bottom", "top")},
        coupling=dict(drag="schiller_naumann", kernel_width=dict(diameters=0.0, cells=0.5)),
        time=dict(end=0.27, output_interval=0.01),
    )
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)

    @jax.jit
    def to_next_row(state, neighbors):
        def body(_, carry):
            return simulation.step(parameters, *carry)[:2]

        return lax.fori_loop(0, simulation.steps.intervals_per_output, body, (state, neighbors))

    rows = []
    for _ in range(27):
        state, neighbors = to_next_row(state, neighbors)
        rows.append([float(state.particles.velocity[0, 1]), float(state.particles.position[0, 1])])
    v, y = np.array(rows).T
    reference = table[1:28]
    print("DEM06", np.abs(v - reference[:, 1]).max() / 0.0574, np.abs(y / reference[:, 3] - 1.0).max())
    # The gate, of the terminal speed and of the height.
    np.testing.assert_allclose(v, reference[:, 1], atol=1e-3 * 0.0574)
    np.testing.assert_allclose(y, reference[:, 3], rtol=1e-3)


@pytest.mark.parametrize("model", ["A", "B"])
def test_a_dilute_sphere_settles_alike_in_both_models(model):
    """One sphere in 1e10 times its volume of air: the terminal speed of Schiller and Naumann's drag.

    W = 3 pi mu d v (1 + 0.15 Re^0.687) by a fixed point; the drag's relaxation time is five steps.
    """
    d, nu, rho, density, gravity = 1e-4, 1e-4, 1.2, 2000.0, 9.81
    tables = dict(
        precision="float64",
        domain=dict(size=[0.2, 0.2], depth=1.0, gravity=[0.0, -gravity]),
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

"""Exchange: every drag law in its range, fixed beds, what particles gain and the fluid loses."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

import jaxdem
from tests.cases.beds import DEPTH, INTERVAL, RHO, Column, H, ergun_drop, pressure_slope
from tests.cases.correlations import ROWS
from tests.cases.registry import Figure, absolute, at_least, below, case, relative, table
from tests.cases.suspensions import RADIUS, SIDE, STOKES_TIME, Suspension


@functools.cache
def column() -> Column:
    """A held bed, compiled once."""
    return Column()


@functools.cache
def suspension() -> Suspension:
    """A periodic suspension, compiled once."""
    return Suspension()


# --- one sphere -------------------------------------------------------------------------------------------


def settled(column: Column, law: str, s: float, reynolds: float, relaxation: float) -> tuple[float, float]:
    """Speed of a grain of 0.1 mm among held spheres after 40 intervals, and that of the law [m/s].

    Viscosity and gravity are chosen for the Reynolds number; the terminal speed comes from a fixed point in plain
    numpy. The loading of the grain is 1e-6 of a cell's, so that the water hardly moves.
    """
    multiple, radius, d = ROWS[law].multiple, (s * 0.02**2 * DEPTH * 3 / 4 / np.pi) ** (1 / 3), 1e-4
    viscosity, volume = 1e-7, np.pi / 6 * d**3
    stokes = 3 * np.pi * RHO * viscosity * d
    weight = stokes * multiple(s, reynolds) * reynolds * viscosity / ((1 - s) * d)
    density = max(1.1 * RHO, stokes * multiple(s, reynolds) * relaxation / volume)
    gravity = weight / ((density - RHO) * volume)
    speed = weight / stokes
    for _ in range(500):  # damped, for the laws that grow with speed
        speed = np.sqrt(speed * weight / (stokes * multiple(s, (1 - s) * speed * d / viscosity)))
    if abs((1 - s) * speed * d / viscosity / reynolds - 1.0) > 1e-6:
        raise ArithmeticError(f"no fixed point for {law} at Re {reynolds}")
    _, velocity, forces = column.run(law, radius, 0.0, viscosity, 40, gravity=gravity, density=density)
    seen = float(forces.inputs.solid_fraction[160])
    return (-velocity[160, 1] if abs(seen / s - 1.0) < 1e-3 else np.nan), speed


@case("one sphere settling, every drag law", "exchange", "each law's paper, fixed point in plain numpy")
def settling_of_one_sphere() -> list[Figure]:
    """One-way, in still water between held spheres of a given solid fraction; Re 1e-3 ... 1e4 in the range of each
    law [1 %]. The grain is as heavy as makes its relaxation time two intervals."""
    figures = []
    for law, row in ROWS.items():
        for s in row.solid_fractions:
            for reynolds in row.reynolds:
                got, expected = settled(column(), law, s, reynolds, relaxation=2.0 * INTERVAL)
                figures.append(relative(f"{law}, s {s:g}, Re {reynolds:g}", expected, got, 0.01, "m/s"))
    return figures


@case("two-way settling in a periodic box", "exchange", "Wen & Yu 1966; Koch & Hill 2001, at the slip seen")
def two_way_settling() -> list[Figure]:
    """A lattice that settles; particles and fluid speed up together [1 %].

    The drag then is W M / (m + M) with W the submerged weight, whatever the law; the slip is the law's answer at
    the solid fraction there is, 0.065 or 0.29: the weight is set so that it is known. It starts 30 % too fast and
    has to find the slip by itself, within five relaxation times: 0.3 exp(-5) = 0.2 % of the start is left.
    """
    figures = []
    for law in ("wen_yu", "koch_hill"):
        for reynolds, radius, viscosity in ((1e-2, 0.01, 1e-3), (30.0, 0.0165, 1e-5), (3e3, 0.01, 2e-6)):
            solid = 4 / 3 * np.pi * radius**3 / (SIDE**2 * 0.04 / 36)
            slip = reynolds * viscosity / ((1 - solid) * 2 * radius)
            mass = 4 / 3 * np.pi * radius**3 * 2650.0
            fluid_mass = 1000.0 * SIDE**2 * 0.04 / 36 * (1 - solid)
            force = 6 * np.pi * 1000.0 * viscosity * radius * ROWS[law].multiple(solid, reynolds) * slip
            gravity = force * (mass + fluid_mass) / fluid_mass / (mass * (1.0 - 1.0 / 2.65))
            box = suspension()
            parameters = box.given(viscosity=viscosity, gravity=gravity, law=law, radius=radius)
            start = box.state(velocity=(0.0, -1.3 * slip), radius=radius)
            steps = 5 * max(8, int(mass * slip / force / 0.01))
            _, code, forces, _ = box.run(parameters, start, steps)
            seen = np.asarray(forces.inputs.fluid_velocity - forces.inputs.particle_velocity)[:, 1]
            worst = seen[np.argmax(np.abs(seen - slip))] if int(code) == 0 else np.nan
            drag = np.asarray(forces.drag)[:, 1]
            what = f"{law}, s {solid:.3f}, Re {reynolds:g}"
            figures.append(relative(f"slip, {what}", slip, worst, 0.01, "m/s"))
            figures.append(relative(f"drag, {what}", force, drag[np.argmax(np.abs(drag - force))], 0.01, "N"))
            figures.append(relative(f"solid fraction, {what}", solid, forces.inputs.solid_fraction[0], 1e-6))
    return figures


@case("MFIX DEM06: sphere in an upward stream", "exchange", "Garg et al. 2012, its ODE")
def dem06() -> list[Figure]:
    """A sphere with Schiller and Naumann's drag falls in air that rises, through the whole step [0.1 %]."""
    step, rows = 2e-4, table("mfix_dem06_terminal_velocity.csv")
    tables = dict(
        precision="float64",
        domain=dict(size=[0.2, 0.2], depth=1.0, gravity=[0.0, 0.0]),
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
    # No scene may have it, for the box is periodic along it: the stream keeps its speed, as the ODE wants.
    parameters = parameters._replace(gravity=jnp.asarray([0.0, -9.80665]))

    @jax.jit
    def to_next_row(state, neighbors):  # type: ignore[no-untyped-def]
        def body(_, carry):  # type: ignore[no-untyped-def]
            return simulation.step(parameters, *carry)[:2]

        return lax.fori_loop(0, simulation.steps.intervals_per_output, body, (state, neighbors))

    got = []
    for _ in range(27):
        state, neighbors = to_next_row(state, neighbors)
        got.append([float(state.particles.velocity[0, 1]), float(state.particles.position[0, 1])])
    speed, height = np.array(got).T
    names = rows.dtype.names
    v, y = rows[names[1]][1:28], rows[names[3]][1:28]
    k = np.argmax(np.abs(speed - v))
    n = np.argmax(np.abs(height / y - 1.0))
    return [
        absolute(f"speed at the worst of 27 times, t = {0.01 * (k + 1):.2f} s", v[k], speed[k], 1e-3 * 0.0574, "m/s"),
        relative(f"height at the worst of 27 times, t = {0.01 * (n + 1):.2f} s", y[n], height[n], 1e-3, "m"),
    ]  # fmt: skip


# --- beds -------------------------------------------------------------------------------------------------


@case("fixed bed pressure drop", "exchange", "Ergun 1952")
def fixed_bed() -> list[Figure]:
    """dp/L = 150 mu U s^2 / (g^3 d^2) + 1.75 rho U^2 s / (g^3 d), laminar and inertial, at s = 0.38 [2 %].

    The fluid's force on all spheres is the pressure drop of the whole column times its section; in model A the
    pressure carries the share s of it, the drag g.
    """
    radius, viscosity, bed, figures = 0.009, 1e-5, column(), []
    s = bed.solid(radius)
    for law in ("ergun", "gidaspow"):
        for speed in (1e-3, 0.05):
            fluid, _, forces = bed.run(law, radius, speed, viscosity, 200)
            drop = ergun_drop(s, 2 * radius, viscosity, speed)
            what = f"{law}, U {speed:g} m/s"
            # What is left is the approach to the steady state, 1e-4; the gate of physics.md is 2 %.
            figures.append(relative(f"pressure gradient, {what}", -drop, pressure_slope(fluid), 0.02, "Pa/m"))
            total = np.asarray(forces.drag + forces.pressure_gradient + forces.viscous)[:, 1].sum()
            whole = np.asarray(fluid.pressure)[:, 0].mean() * 4 * H * DEPTH
            figures.append(relative(f"force on all spheres, {what}", whole, total, 2e-3, "N"))
            row = np.abs(bed.position[:160, 1] - 0.33) < 0.02
            pressure = np.asarray(forces.pressure_gradient)[:160][row, 1]
            drag = np.asarray(forces.drag)[:160][row, 1]
            volume = 4 / 3 * np.pi * radius**3
            figures.append(relative(f"V_p dp/L, {what}", volume * drop, pressure.mean(), 2e-3, "N"))
            figures.append(relative(f"drag over pressure force, {what}", (1 - s) / s, (drag / pressure).mean(), 2e-3))
    return figures


@case("uniform stream through a moving bed", "exchange", "two bodies, implicit Euler")
def moving_bed() -> list[Figure]:
    """A lattice moving through an even stream: the fluid stays even, slip falls by implicit Euler's factor.

    With Stokes drag c the slip obeys s' = s / (1 + t c (1/m + 1/M)), M the fluid's mass per particle [1e-10 m/s:
    50 solves carry 1e-12 of U/h each].
    """
    box = suspension()
    parameters = box.given(drag=10.0)
    state = box.state(velocity=(0.13, -0.05), fluid=(-0.2, 0.1))
    mass, volume = float(parameters.bodies.mass), float(parameters.bodies.volume)
    fluid_mass = 1000.0 * (SIDE**2 * 0.04 / len(box.lattice) - volume)
    grip = 0.01 * 10.0 * 6 * np.pi * 1000.0 * 1e-5 * RADIUS
    end, code, _, _ = box.run(parameters, state, 50)
    slip = np.array([-0.33, 0.15]) / (1.0 + grip * (1.0 / mass + 1.0 / fluid_mass)) ** 50
    together = (mass * np.array([0.13, -0.05]) + fluid_mass * np.array([-0.2, 0.1])) / (mass + fluid_mass)
    figures = [at_least("slip left of the first, for there to be something to see", 0.1, slip[1] / 0.15)]
    for axis, name in enumerate("xz"):
        u = together[axis] + slip[axis] * mass / (mass + fluid_mass)
        v = together[axis] - slip[axis] * fluid_mass / (mass + fluid_mass)
        for who, value, seen in (
            ("fluid", u, end.fluid.face_velocity[axis]),
            ("particles", v, end.particles.velocity[:, axis]),
        ):
            worst = np.ravel(seen)[np.argmax(np.abs(np.ravel(seen) - value))] if int(code) == 0 else np.nan
            figures.append(absolute(f"{who}, velocity along {name}", value, worst, 1e-10, "m/s"))
    return figures


# --- conservation -----------------------------------------------------------------------------------------


@case(
    "total momentum and volume", "exchange", "Newton's third law",
    fast={"densities": (100.0, 5650.0), "relaxations": (1e3, 1e-3, 1e-6)},
)  # fmt: skip
def momentum(
    densities: tuple[float, ...] = (100.0, 1001.0, 5650.0, 2.5e6),
    relaxations: tuple[float, ...] = (1e3, 1.0, 1e-3, 1e-6),
) -> list[Figure]:
    """Particles that move and collide in an eddy, drag from weak to stiff [1e-10 in float64; volume round-off].

    The relaxation time is given over the fluid step. Exchange is by impulse, so that only rounding of the sums is
    left, 60 steps of it.
    """
    box, figures = suspension(), []
    for density in densities:
        for relaxation in relaxations:
            drag = STOKES_TIME / 2650.0 * density / (relaxation * 0.01)
            start = box.stirred(0.2, seed=1)
            error, exchanged, code, worst = box.drift(box.given(density, drag), start)
            what = f"density {density:g}, relaxation {relaxation:g}"
            figures.append(below(f"momentum, {what}", error if code == 0 else np.nan, 1e-10))
            figures.append(below(f"volume, {what}", worst[2], 1e-13))
            if density < 1e6 and relaxation <= 1.0:
                figures.append(at_least(f"share handed over, {what}", 1e-3, exchanged))
    return figures

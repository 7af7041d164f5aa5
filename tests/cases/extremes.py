"""Stiff and extreme scenes: each must finish sound, or be refused before its first step with limit, value and
remedy."""

from __future__ import annotations

import dataclasses
import functools
import math
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxdem
from jaxdem.closures import InvariantClosure, KochHill
from jaxdem.failures import failures, first_meaning
from jaxdem.setup.boundaries import boundary_speed
from tests.cases.steps import time_steps

SCENES = Path(__file__).parents[2] / "scenes"
PERIODIC = {side: {"kind": "periodic"} for side in ("left", "right", "bottom", "top")}
TOLERANCE = {"float32": 1e-5, "float64": 1e-10}
"""Of the residuals of momentum and volume: rounding of sums over particles and faces."""


@dataclasses.dataclass
class Outcome:
    """A row.

    Attributes:
        group: what is extreme.
        name: the case.
        outcome: sound, refused, stopped (by an error while running), unsound (finished, but wrong) or traceback.
        energy: largest kinetic energy of the particles over all that they could get [-].
        volume, momentum: residuals [-].
        contact_step: as run or the stable one that was named [s].
        message: of a refusal, or a remark.
        seconds: wall time.
    """

    group: str
    name: str
    outcome: str
    energy: float = math.nan
    volume: float = math.nan
    momentum: float = math.nan
    contact_step: float = math.nan
    message: str = ""
    seconds: float = math.nan


def base(**overrides: Any) -> dict[str, Any]:
    """A cloud of 12 grains that falls through water in a box of 0.24 m x 0.24 m, with dotted keys replaced."""
    tables: dict[str, Any] = {
        "domain": {"size": [0.24, 0.24], "depth": 0.04},
        "particles": {
            "radius": 0.01,
            "density": 5650.0,
            "position": [[0.05 + 0.045 * i, 0.03 + 0.06 * j] for i in range(4) for j in range(3)],
        },
        "contact": {"young_modulus": 7e7},
        "fluid": {"cells": [6, 6], "time_step": 0.005},
        "time": {"end": 0.2, "output_interval": 0.02},
    }
    for key, value in overrides.items():
        table = tables
        *parents, last = key.split("__")
        for parent in parents:
            table = table.setdefault(parent, {})
        if value is None:
            table.pop(last, None)
        else:
            table[last] = value
    return tables


def available_energy(scene: Any, simulation: Any, parameters: Any, state: Any) -> float:
    """All the kinetic energy that particles can get: their own, weight or buoyancy over the box, the fluid's, springs'
    [J]."""
    if state.particles is None or not state.particles.position.shape[0]:
        return 0.0
    mass, volume = (
        np.broadcast_to(np.asarray(x), len(state.particles.position))
        for x in (parameters.bodies.mass, parameters.bodies.volume)
    )
    speed = np.linalg.norm(np.asarray(state.particles.velocity), axis=1)
    density = scene.fluid.density if scene.fluid is not None else 0.0
    density = density if scene.surface is None else scene.surface.density  # a grain above the liquid falls faster
    reach = sum(abs(g) * length for g, length in zip(scene.domain.gravity, scene.domain.size, strict=True))
    energy = float(np.sum(0.5 * mass * speed**2 + np.abs(mass - density * volume) * reach))
    energy += 0.5 * float(
        np.sum(
            np.asarray(parameters.bodies.inertia) * np.sum(np.asarray(state.particles.angular_velocity) ** 2, axis=1)
        )
    )
    fluid_speed = boundary_speed(scene)
    # Carried along: a grain takes up the speed of the fluid, or what the fluid of the box has.
    return energy + 0.5 * float(np.sum(mass)) * (2.0 * fluid_speed) ** 2


def finished(
    group: str, name: str, tables: dict[str, Any] | Any, closure: Any = None, overrides: Any = None
) -> Outcome:
    """Runs a scene from description to summary, as a user would, and judges it."""
    start = time.perf_counter()
    row = Outcome(group, name, "traceback")
    try:
        scene = jaxdem.load_scene(tables, overrides)
        row.contact_step = time_steps(scene).contact or math.nan
        simulation, parameters = jaxdem.build(scene, closure)
        state, _ = jaxdem.initial_state(scene, simulation, parameters)
        available = available_energy(scene, simulation, parameters, state)
        with tempfile.TemporaryDirectory() as folder:
            run = jaxdem.simulate(scene, Path(folder) / "run", closure=closure)
            summary, kinetic = run.summary, np.asarray(run.history["kinetic_energy"])
        residuals, allowed = summary["residuals"], TOLERANCE[scene.precision]
        row.volume, row.momentum = residuals["volume"], residuals["momentum"]
        if scene.particles is not None and available > 0.0:
            row.energy = float(np.max(kinetic)) / available
        if closure is not None:
            row.message = f"out of range: {summary['closure']['out_of_range_fraction']:.3g}"
        liquid_kept = True
        if scene.surface is not None:
            phase = summary["liquid_phase"]
            missing, beyond = abs(phase["missing_relative"]), phase["beyond_bounds"]
            row.message = f"liquid missing {missing:.0e}, beyond 0 and 1 by {beyond:.0e}"
            liquid_kept = max(missing, beyond) <= allowed
        finite = not np.isinf(kinetic).any() and summary["valid"]
        good = finite and liquid_kept and not row.energy > 1.001 and row.volume <= allowed and row.momentum <= allowed
        row.outcome = "sound" if good else "unsound"
    except jaxdem.InputError as error:
        row.outcome, row.message = "refused", str(error)
    except jaxdem.RunError as error:
        row.outcome, row.message = "stopped", str(error)
    except Exception as error:  # what the table is there to find
        row.message = f"{type(error).__name__}: {error}"
    row.seconds = time.perf_counter() - start
    return row


SUSPENSION = base(
    domain={"size": [0.24, 0.24], "depth": 0.04, "gravity": [0.0, 0.0]},
    particles__density=2650.0,
    particles__position=[[0.02 + 0.04 * i, 0.02 + 0.04 * j] for i in range(6) for j in range(6)],
    particles__velocity=[[0.1, -0.04]] * 36,
    contact={"young_modulus": 1e6, "speed": 0.5},
    fluid={"cells": [6, 6], "viscosity": 1e-5, "time_step": 0.01},
    boundary=PERIODIC,
    precision="float64",
)


@functools.cache
def _suspension(law: str) -> tuple[Any, ...]:
    scene = jaxdem.load_scene(SUSPENSION | {"coupling": {"drag": law}})
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    step = jax.jit(lambda p, s, n: (lambda a, b, d: (a, b, d, failures(simulation, d)))(*simulation.step(p, s, n)))
    return simulation, parameters, state, neighbors, step


def relaxation(law: str, ratio: float, gravity: float = 0.0) -> Outcome:
    """Even suspension that moves through still fluid, its drag scaled to a relaxation time of `ratio` fluid steps."""
    start = time.perf_counter()
    simulation, parameters, state, neighbors, step = _suspension(law)
    first = step(parameters, state, neighbors)[2].forces
    grip = float(jnp.linalg.norm(first.law, axis=1)[0] / jnp.linalg.norm(first.inputs.slip_velocity, axis=1)[0])
    scale = float(parameters.bodies.mass) / (grip * ratio * simulation.interval)
    parameters = parameters._replace(drag_scale=jnp.asarray(scale), gravity=jnp.asarray([0.0, -gravity]))
    slips, kinetic, momentum, volume, code = [], [], 0.0, 0.0, 0
    carried = float(parameters.bodies.mass) * float(jnp.sum(jnp.abs(state.particles.velocity)))
    for _ in range(40):
        state, neighbors, report, flags = step(parameters, state, neighbors)
        slips.append(float(jnp.linalg.norm(report.forces.inputs.slip_velocity, axis=1)[0]))
        kinetic.append(float(jnp.sum(state.particles.velocity**2)))
        # Over the momentum at the start: over a drag that has died away rounding would be everything.
        handed = float(jnp.sum(jnp.abs(report.forces.drag))) * simulation.interval
        momentum = max(momentum, float(report.exchange.momentum) * handed / carried)
        volume = max(volume, float(report.exchange.volume))
        code |= int(flags)
    energy = max(kinetic) / (36 * (0.1**2 + 0.04**2)) if not gravity else math.nan
    jump = abs(slips[-1] - slips[-2]) / max(slips[-1], slips[-2], 1e-300)
    settles = jump < 0.05 or max(slips[-2:]) < 1e-3 * slips[0] or ratio > 0.1
    good = not code and not energy > 1.001 and momentum < 1e-10 and volume < 1e-10
    outcome = "stopped" if code else ("sound" if good and settles else "unsound")
    message = first_meaning(code)[0] if code else f"slip left {slips[-1] / slips[0]:.2g} of the first"
    if not settles:
        message += f", flips by {100 * jump:.0f} % from step to step"
    name = f"{law}, relaxation time / fluid step = {ratio:.0e}{', settling' if gravity else ''}"
    return Outcome(
        "drag",
        name,
        outcome,
        energy,
        volume,
        momentum,
        simulation.steps.contact,
        message,
        time.perf_counter() - start,
    )


def far_closure() -> InvariantClosure:
    """A learned closure whose training saw dilute creeping flow only."""
    closure = InvariantClosure.initial(KochHill())
    size = closure.feature_low.shape[0]
    return dataclasses.replace(
        closure,
        feature_low=jnp.full(size, -1e-6, jnp.float32),
        feature_high=jnp.full(size, 1e-6, jnp.float32),
    )


def layer(count_x: int, count_y: int, spacing: float = 1.0) -> list[list[float]]:
    """Hexagonal rows of touching grains of 0.01 m from the lower left corner."""
    rows = [
        [0.01 + 0.02 * spacing * (i + 0.5 * (j % 2)), 0.01 + 0.02 * spacing * j * math.sqrt(0.75)]
        for j in range(count_y)
        for i in range(count_x)
    ]
    return rows


def rows() -> dict[str, Callable[[], Outcome]]:
    """Every row by name; each is run when called."""
    table: dict[str, Callable[[], Outcome]] = {}

    def add(group: str, name: str, tables: Any, **more: Any) -> None:
        table[f"{group}: {name}"] = functools.partial(finished, group, name, tables, **more)

    for modulus in (1e5, 1e6, 7e7, 7e10):
        add("Young's modulus", f"{modulus:.0e} Pa", base(contact__young_modulus=modulus, time__end=0.04))
    for ratio in (0.1, 1.001, 5.65, 2500.0):
        add("particle/fluid density", f"{ratio:g}", base(particles__density=1000.0 * ratio))
    stiff = base(particles__density=2.5e6, contact__young_modulus=7e9)
    add("particle/fluid density", "2500, 7e+09 Pa", stiff)
    add("viscosity", "0 with particles", base(fluid__viscosity=0.0))
    add(
        "viscosity",
        "0, fluid alone",
        base(
            particles=None,
            contact=None,
            domain__gravity=[0.0, 0.0],
            fluid__viscosity=0.0,
            boundary=PERIODIC,
            fluid__velocity=[0.1, 0.05],
        ),
    )
    add("viscosity", "1e-6 m2/s", base(fluid__viscosity=1e-6))
    add("viscosity", "0.1 m2/s", base(fluid__viscosity=0.1))
    add("viscosity", "10 m2/s, step 5 ms", base(fluid__viscosity=10.0))
    add(
        "viscosity",
        "10 m2/s, automatic step",
        base(fluid__viscosity=10.0, fluid__time_step="auto", time={"end": 0.02, "output_interval": 0.01}),
    )
    for law in ("stokes", "koch_hill"):
        for ratio in (1e-6, 1e-3, 1.0, 1e3):
            table[f"drag: {law} {ratio:.0e}"] = functools.partial(relaxation, law, ratio)
    for ratio in (1e-6, 1e-2, 1.0):
        table[f"drag: koch_hill settling {ratio:.0e}"] = functools.partial(relaxation, "koch_hill", ratio, 9.81)
    packed = layer(11, 12)
    packs = ((0.0174, 0.005, "0.3"), (0.0135, 0.005, "0.1"), (0.0135, 0.0025, "0.1, interval 2.5 ms"))
    for depth, interval, text in (*packs, (0.0118, 0.005, "all-solid cell")):
        add(
            "void fraction",
            text,
            base(
                particles__position=packed,
                domain__depth=depth,
                fluid__time_step=interval,
                coupling={"kernel_width": {"diameters": 0.75, "cells": 0.5}},
            ),
        )
    add(
        "void fraction",
        "up to 1",
        base(particles__radius=1e-4, particles__position=[[0.12, 0.12]]),
    )
    for cells, text in ((2, "6"), (6, "2"), (12, "1"), (24, "0.5")):
        add("cell/diameter", text, base(fluid__cells=[cells, cells], domain__depth=0.04))
    add("cell/diameter", "16", base(particles__radius=0.00125, fluid__cells=[6, 6]))
    add(
        "cell/diameter",
        "0.5, centre",
        base(fluid__cells=[24, 24], domain__depth=0.02, coupling={"void_fraction": "centre"}),
    )
    for number in (0.1, 1.0, 5.0, 20.0):
        add(
            "Courant number",
            f"{number:g} in an interval",
            base(
                fluid__velocity=[1.0, 0.0],
                boundary=PERIODIC,
                fluid__time_step=0.04 * number,
                particles__density=1000.0,
                domain__gravity=[0.0, 0.0],
                contact__speed=2.0,
                time={"end": 0.8 if number > 10 else 0.4, "output_interval": 0.8 if number > 10 else 0.2},
            ),
        )
    add(
        "impact",
        "100 m/s, 70 MPa",
        base(
            particles__position=[[0.05, 0.12], [0.15, 0.12]],
            particles__velocity=[[100.0, 0.0], [0.0, 0.0]],
            fluid=None,
            time={"end": 0.01, "output_interval": 0.001},
        ),
    )
    add(
        "impact",
        "100 m/s, 70 GPa",
        base(
            particles__position=[[0.05, 0.12], [0.15, 0.12]],
            particles__velocity=[[100.0, 0.0], [0.0, 0.0]],
            fluid=None,
            contact__young_modulus=7e10,
            time={"end": 0.01, "output_interval": 0.001},
        ),
    )
    add(
        "impact",
        "100 m/s, 70 GPa, e = 1, frictionless",
        base(
            particles__position=[[0.05, 0.12], [0.15, 0.125]],
            particles__velocity=[[100.0, 0.0], [0.0, 0.0]],
            fluid=None,
            domain__gravity=[0.0, 0.0],
            contact={"young_modulus": 7e10, "restitution": 1.0, "friction": 0.0},
            time={"end": 0.01, "output_interval": 0.001},
        ),
    )
    add(
        "impact",
        "100 m/s in water, 70 GPa",
        base(
            particles__position=[[0.05, 0.12], [0.15, 0.12]],
            particles__velocity=[[100.0, 0.0], [0.0, 0.0]],
            contact__young_modulus=7e10,
            fluid__time_step=0.0005,
            time={"end": 0.01, "output_interval": 0.001},
        ),
    )
    add("number", "0 particles", base(particles__position=None, particles__count=0))
    add("number", "1 particle", base(particles__position=[[0.12, 0.12]]))
    add("number", "2 particles", base(particles__position=[[0.12, 0.12], [0.15, 0.12]]))
    add(
        "number",
        "20,000 particles",
        SCENES / "injection.toml",
        overrides={"time.end": 0.02, "time.output_interval": 0.01},
    )
    add("start", "full overlap", base(particles__position=[[0.12, 0.12], [0.12, 0.12]]))
    add("start", "exactly touching", base(particles__position=[[0.1, 0.12], [0.12, 0.12], [0.14, 0.12]]))
    add(
        "start",
        "on cell faces and corners",
        base(particles__position=[[0.08, 0.12], [0.16, 0.10], [0.12, 0.2]]),
    )
    add(
        "start",
        "on walls and in corners",
        base(particles__position=[[0.01, 0.01], [0.23, 0.01], [0.12, 0.01], [0.01, 0.23], [0.01, 0.12]]),
    )
    add("start", "closest packing in the box", base(particles__position=layer(11, 13), fluid=None))
    add("gravity", "none", base(domain__gravity=[0.0, 0.0]))
    sizes = [0.01] * 4 + [0.001] * 40
    spots = [[0.03 + 0.045 * i, 0.02] for i in range(4)] + [[0.03 + 0.0045 * i, 0.06] for i in range(40)]
    add(
        "size ratio",
        "10",
        base(particles__radius=sizes, particles__position=spots, time={"end": 0.1, "output_interval": 0.01}),
    )
    add(
        "size ratio",
        "10, dry",
        base(
            particles__radius=sizes,
            particles__position=spots,
            fluid=None,
            time={"end": 0.1, "output_interval": 0.01},
        ),
    )
    pile = layer(11, 4)
    for e in (0.0, 1.0):
        for mu in (0.0, 10.0):
            add(
                "restitution, friction",
                f"e = {e:g}, mu = {mu:g}",
                base(
                    particles__position=pile,
                    fluid=None,
                    contact={"young_modulus": 7e7, "restitution": e, "friction": mu},
                ),
            )
    add("closure", "far outside its range", base(), closure=far_closure())
    paper = {"contact.young_modulus": 7e10, "contact.time_step": 2e-4}
    demo = {"time.end": 0.02, "time.output_interval": 0.01}
    add("the paper", "E 70 GPa, step 2e-4 s", SCENES / "injection.toml", overrides=paper)
    add(
        "the paper",
        "70 GPa, automatic step, 1,500 grains",
        SCENES / "injection_demo.toml",
        overrides=demo | {"contact.young_modulus": 7e10},
    )
    return table

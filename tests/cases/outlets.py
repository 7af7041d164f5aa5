"""Outlets: the level of the pressure, what is drawn in, eddies that leave, and the energy of a box with an open
side."""

from __future__ import annotations

import functools

import jax.numpy as jnp
import numpy as np

from jaxdem.fluid.advection import AdvectionScheme, Central, VanLeer
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.grid import face_average, face_control_volume
from tests.cases.flows import Flow, random_faces
from tests.cases.march import March
from tests.cases.registry import Figure, below, case, relative

DENSITY = 1000.0


def kinetic_energy(flow: Flow, state: FluidState) -> float:
    """Of the fluid on its faces, those of the sides standing for half a cell [J]; without a void fraction."""
    terms = zip(range(flow.grid.dimension), state.face_velocity, strict=True)
    parts = (float(jnp.sum(face_control_volume(flow.grid, a) * u**2)) for a, u in terms)
    return 0.5 * flow.density * sum(parts)


def largest_speed(state: FluidState) -> float:
    """Largest component on a face [m/s]."""
    return max(float(jnp.max(jnp.abs(u))) for u in state.face_velocity)


# --- the level of the pressure ----------------------------------------------------------------------------


@functools.cache
def open_box() -> Flow:
    """5 x 5 x 16 cm in cells of 1 cm, walls on five sides, open at the top."""
    return Flow((5, 5, 16), (0.05, 0.05, 0.16), ("no_slip",) * 5 + ("outlet",), density=DENSITY)


@case("water that comes to rest under an open top", "outlets", "no flow, no pressure", fast={"end": 1.0})
def coming_to_rest(end: float = 6.0) -> list[Figure]:
    """Begun with (0.05, 0.03, 0.02) m/s: the mean pressure is of the order of rho u^2 all along, at two steps.

    Where the old pressure's pull on the outlet is lost it is of the order of rho h u/t, and adds up: -503 Pa after 6 s.
    """
    flow, figures = open_box(), []
    for step in (0.0025, 0.01):
        state, time, worst, rise = flow.state(0.05, 0.03, 0.02), 0.0, 0.0, 0.0
        energy = kinetic_energy(flow, state)
        first = energy
        while time < end - 0.5 * step:
            state, _, sound = flow.march(flow.properties(1e-6), state, round(0.1 / step), step)
            time += 0.1
            speed, before, energy = largest_speed(state), energy, kinetic_energy(flow, state)
            level = abs(float(jnp.mean(state.pressure))) / (DENSITY * speed**2)
            worst, rise = max(worst, level if sound else np.nan), max(rise, (energy - before) / first)
        what = f"steps of {1000 * step:g} ms"
        figures += [below(f"largest mean pressure over rho u^2, {what}", worst, 1.0)]
        figures += [below(f"rise of the energy, {what}", rise, 0.0)]
        figures += [below(f"mean pressure after {end:g} s, {what}", float(jnp.mean(state.pressure)), 0.5, "Pa")]
    return figures


@case("still water under an open top", "outlets", "nothing moves", fast={"steps": 1000})
def still_water(steps: int = 10_000) -> list[Figure]:
    """Velocities of 1e-9 m/s, as rounding leaves them: at any step the mean pressure stays that of such a flow.

    The first step makes the velocity solenoidal, by a pressure of the order of rho L u/t; what is left of it after all
    steps counts.
    """
    flow, figures = open_box(), []
    start = flow.state(*(1e-9 * u for u in random_faces(flow.grid)))
    for step in (1e-4, 1e-2, 1.0):
        state, _, sound = flow.march(flow.properties(1e-6), start, steps, step)
        level = float(jnp.mean(state.pressure)) if sound else np.nan
        figures.append(
            below(f"mean pressure over rho L u/t, steps of {step:g} s", level * step / (DENSITY * 0.16e-9), 1e-4)
        )
    return figures


# --- closed forms: a tube that is open at its ends, a piston at one of them ----------------------------------

LENGTH = 1.6


@functools.cache
def tube(left: str) -> Flow:
    """A tube of 16 cells without friction; its right end is open."""
    piston = dict(times=tuple(np.linspace(0.0, 2.0, 201))) if left == "inlet" else None
    return Flow((16, 1), (LENGTH, 0.1), (left, "outlet", "periodic", "periodic"), density=DENSITY, inlet=piston)


@case("column of water in a tube with open ends", "outlets", "Torricelli; Bernoulli")
def open_tube() -> list[Figure]:
    """Water of speed u leaves as a jet at p = 0 and is drawn in at p = -rho u^2/2, so that L du/dt = -u^2/2.

    u = u_0 / (1 + u_0 t / (2 L)), and the pressure is linear in between; of second order in time.
    """
    flow, errors, figures = tube("outlet"), [], []
    exact = 1.0 / (1.0 + 1.0 / (2.0 * LENGTH))
    for steps in (80, 160):
        state, _, sound = flow.march(flow.properties(0.0), flow.state(1.0, 0.0), steps, 1.0 / steps)
        speed = float(state.face_velocity[0][8, 0]) if sound else np.nan
        errors.append(abs(speed / exact - 1.0))
    figures.append(relative("speed after 1 s from 1 m/s", exact, speed, 1e-4, "m/s"))
    figures.append(relative("error of twice the step over that of the step", 4.0, errors[0] / errors[1], 0.1))
    # The pressure is that of the middle of the last step.
    middle = 1.0 / (1.0 + (1.0 - 0.5 / 160) / (2.0 * LENGTH))
    bernoulli = -0.5 * DENSITY * middle**2 * (1.0 - flow.centres(0) / LENGTH)
    off = np.abs(np.asarray(state.pressure)[:, 0] - bernoulli).max() / (0.5 * DENSITY)
    figures.append(below("pressure along the tube, largest error over rho u_0^2/2", off, 1e-3))
    return figures


@case("piston in a tube with an open end", "outlets", "manometer: rho L dU/dt, Bernoulli at the mouth")
def piston() -> list[Figure]:
    """A piston of speed U = sin(pi t) pushes water out and draws it in again.

    p = rho (L - x) dU/dt, and less rho U^2/2 while it is drawn in: the pressure that a manometer at the piston shows.
    The error in time is of the order of (pi dt)^2 = 1e-3.
    """
    flow, figures = tube("inlet"), []
    times = np.linspace(0.0, 2.0, 201)
    speeds = np.stack([np.sin(np.pi * times), np.zeros(201)], axis=1)
    properties = flow.properties(0.0, {0: speeds})
    for count in (40, 100, 140, 180):
        state, _, sound = flow.march(properties, flow.state(), count, 0.01)
        before, now = speeds[count - 1, 0], speeds[count, 0]
        drawn = 0.25 * DENSITY * sum(min(u, 0.0) ** 2 for u in (before, now))
        expected = DENSITY * (LENGTH - flow.centres(0)) * (now - before) / 0.01 - drawn
        off = np.abs(np.asarray(state.pressure)[:, 0] - expected).max() if sound else np.nan
        figures.append(below(f"pressure at {0.01 * count:g} s, error over rho U^2/2", off / (0.5 * DENSITY), 2e-3))
    return figures


# --- flow through a narrow outlet -------------------------------------------------------------------------


@functools.cache
def narrowing(cells: int) -> Flow:
    """Water through the left side of 0.2 m and out by half of the right one."""
    sides = ("inlet", "outlet", "no_slip", "no_slip")
    return Flow((2 * cells, cells), (0.4, 0.2), sides, {1: ((0.05,), (0.15,))}, density=DENSITY)


def pressure_at_end(cells: int, step: float, end: float) -> tuple[float, float]:
    """Mean pressure of the flow from 0.5 m/s to 1 m/s at two times, half a second apart [Pa]."""
    flow = narrowing(cells)
    properties, found = flow.properties(1e-3, {0: [0.5, 0.0]}), []
    state, _, _ = flow.march(properties, flow.state(), round((end - 0.5) / step), step)
    found.append(float(jnp.mean(state.pressure)))
    state, _, sound = flow.march(properties, state, round(0.5 / step), step)
    found.append(float(jnp.mean(state.pressure)) if sound else np.nan)
    return found[0], found[1]


@case(
    "steady flow through a narrow outlet", "outlets", "steady; the same at any step; mesh twice as fine",
    fast={"cells": 8, "end": 2.0},
)  # fmt: skip
def narrow_outlet(cells: int = 16, end: float = 6.0) -> list[Figure]:
    """The mean pressure comes to rest and does not know the step; against a mesh of half the cells [2 %].

    523, 517 and 514 Pa with 16, 32 and 64 cells across. A face of the outlet that stood for a whole cell would have
    466, 494 and 511.
    """
    before, level = pressure_at_end(cells, 0.08 / cells, end)
    other = pressure_at_end(cells, 0.04 / cells, end)[1]
    finer = pressure_at_end(2 * cells, 0.04 / cells, end)[1]
    return [
        below("growth over half a second", (level - before) / level, 1e-4),
        relative("half the step", level, other, 1e-6, "Pa"),
        relative("twice the cells", finer, level, 0.02, "Pa"),
    ]


# --- an eddy that leaves ----------------------------------------------------------------------------------


def eddy(flow: Flow, strength: float) -> FluidState:
    """A stream of 1 m/s with a Gaussian eddy of radius 0.1 m and that largest speed, centred at x = 0.5 m."""
    x, z = np.meshgrid(flow.faces(0), flow.faces(1), indexing="ij")
    squares = ((x - 0.5) ** 2 + (z - 0.5) ** 2) / 0.1**2
    stream = strength * 0.1 * np.exp(0.5 - 0.5 * squares)
    stream[0] = 0.0  # nothing of it passes the inlet
    hx, hz = flow.grid.spacing
    return flow.state(1.0 + np.diff(stream, axis=1) / hz, -np.diff(stream, axis=0) / hx)


def disturbance(state: FluidState, cells: int) -> tuple[float, float]:
    """Of the first metre: sum of the squares of what differs from the stream, and its enstrophy's centre along x
    [m]."""
    u, w = (np.asarray(f) for f in state.face_velocity)
    square = np.sum((u[:cells] - 1.0) ** 2) + np.sum(w[:cells] ** 2)
    turning = np.diff(w[:cells], axis=0)[:, 1:-1] - np.diff(u[1:cells], axis=1)
    enstrophy = np.sum(turning**2, axis=1)
    return float(square), float(enstrophy @ np.arange(1, cells) / enstrophy.sum() / cells)


@case(
    "an eddy that leaves through the outlet", "outlets", "the same in a box twice as long",
    fast={"cells": 16, "strengths": (1.5,)},
)  # fmt: skip
def leaving_eddy(cells: int = 24, strengths: tuple[float, ...] = (0.5, 1.5, 3.0)) -> list[Figure]:
    """Half as strong as the stream, stronger, and so strong that a third of the outlet draws water in.

    Its energy never rises above that of the free one by more than a twelfth of the start's, its centre runs with the
    free one's to half a cell, and nothing is left when it has gone.
    """
    sides, figures = ("inlet", "outlet", "periodic", "periodic"), []
    short, long = (Flow((n * cells, cells), (float(n), 1.0), sides) for n in (1, 2))
    for strength in strengths:
        states = [eddy(short, strength), eddy(long, strength)]
        start = disturbance(states[0], cells)[0]
        apart = drag = 0.0
        for _ in range(15):
            for n, flow in enumerate((short, long)):
                properties = flow.properties(1e-4, {0: [1.0, 0.0]})
                states[n], _, sound = flow.march(properties, states[n], 20, 0.005)
                start = start if sound else np.nan
            (square, centre), (free, other) = (disturbance(state, cells) for state in states)
            apart = max(apart, abs(square - free) / start)
            if free > 0.25 * start:
                drag = max(drag, abs(centre - other) * cells)
        what = f"{strength:g} times the stream"
        figures.append(below(f"energy against the free one's, {what}", apart, 1.0 / 12.0))
        figures.append(below(f"centre against the free one's, in cells, {what}", drag, 0.5))
        figures.append(below(f"energy left after 1.5 s, {what}", square / start, 1e-3))
    return figures


# --- energy -----------------------------------------------------------------------------------------------


@case(
    "energy of a box with open sides",
    "outlets",
    "Bruneau & Fabrie 1994; Braack & Mucha 2014",
    fast={"steps": 200},
)
def energy_falls(steps: int = 2000) -> list[Figure]:
    """Random velocities without viscosity, one side open and then two that meet in a corner: the energy never rises."""
    figures = []
    both: tuple[tuple[str, AdvectionScheme], ...] = (("no_slip", VanLeer()), ("outlet", Central()))
    for side, scheme in both:
        flow = Flow((8, 12), (1.0, 1.0), ("free_slip", side, "free_slip", "outlet"), scheme=scheme)
        properties = flow.properties(0.0)
        state, _, _ = flow.march(properties, flow.state(*random_faces(flow.grid)), 1, 1e-9)
        state = state._replace(pressure=jnp.zeros_like(state.pressure))
        step = 0.15 / 12 / largest_speed(state)
        energy = [kinetic_energy(flow, state)]
        for _ in range(20):
            state, _, sound = flow.march(properties, state, steps // 20, step)
            energy.append(kinetic_energy(flow, state) if sound else np.nan)
        rise = max(0.0, *np.diff(energy)) / energy[0]
        figures.append(below(f"largest rise over the start, right {side}, {type(scheme).__name__}", rise, 0.0))
    return figures


def settling(count: int, flat: bool) -> dict[str, object]:
    """Grains of 3 mm that settle in the open box; `flat` for its 2-D slice."""
    cut = (lambda x: [x[0], x[2]]) if flat else list
    return {
        "precision": "float64",
        "domain": {"size": cut([0.05, 0.05, 0.16]), "gravity": cut([0.0, 0.0, -9.81])}
        | ({"depth": 0.003} if flat else {}),
        "particles": {
            "count": count, "radius": 0.0015, "density": 2500.0,
            "pack": {"kind": "random", "start": cut([0.0, 0.0, 0.02]), "stop": cut([0.05, 0.05, 0.14])},
        },
        "contact": {"young_modulus": 1e6, "restitution": 0.5, "maximum_overlap": 0.1, "speed": 0.5},
        "fluid": {"cells": cut([5, 5, 16]), "density": DENSITY, "viscosity": 1e-6, "time_step": 0.01,
                  "velocity": cut([0.05, 0.03, 0.02])},
        "boundary": {"top": {"kind": "outlet"}},
        "time": {"end": 1.0, "output_interval": 0.1},
    }  # fmt: skip


@case(
    "grains that settle under an open top", "outlets", "weight of the grains over the floor; conservation of energy",
    fast={"count": 100, "flat": True},
)  # fmt: skip
def settling_grains(count: int = 1500, flat: bool = False) -> list[Figure]:
    """The mean pressure is positive and under what the whole weight would make while grains fall, and goes when they
    rest.

    The energy, kinetic of both and of the grains in the field of gravity less buoyancy, only falls.
    """
    march = March(settling(count, flat))
    grid, bodies = march.simulation.fluid.solver.grid, march.parameters.bodies
    mass, volume = (np.broadcast_to(np.asarray(x), (count,)) for x in (bodies.mass, bodies.volume))
    load = (mass - DENSITY * volume) * 9.81
    floor = grid.cell_volume * np.prod(grid.cells) / grid.size[-1]

    def energy() -> float:
        fluid, grains = march.state.fluid, march.state.particles
        g = face_average(grid, fluid.void_fraction)
        parts = zip(range(grid.dimension), g, fluid.face_velocity, strict=True)
        moving = sum(float(jnp.sum(face_control_volume(grid, a) * s * u**2)) for a, s, u in parts)
        own = np.sum(mass[:, None] * np.asarray(grains.velocity) ** 2)
        return float(0.5 * DENSITY * moving + 0.5 * own + load @ march.position[:, -1])

    energies, levels = [energy()], []
    for _ in range(10):
        march.advance(0.1)
        energies.append(energy())
        levels.append(float(jnp.mean(march.state.fluid.pressure)) / (np.sum(load) / floor))
    return [
        below("largest mean pressure over weight/area", max(map(abs, levels)), 1.0),
        below("mean pressure over weight/area after 1 s", levels[-1], 0.05),
        below("largest rise of the energy over the start", max(0.0, *np.diff(energies)) / energies[0], 0.0),
    ]

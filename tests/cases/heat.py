"""Temperatures: a sphere in a stream, a bed, contacts, a heated cavity; and what the fluid carries."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from scipy import integrate, special

import jaxdem
from jaxdem.failures import failures
from tests.cases.energy import BOX, MASS, balance_of, with_tables
from tests.cases.registry import Figure, at_least, below, case, relative

AIR = {"fluid_heat_capacity": 1007.0, "fluid_conductivity": 0.026}
AIR_DENSITY, AIR_VISCOSITY = 1.1854, 1.85e-5


def advanced(tables: dict[str, Any], number: int, **extensions: Any) -> tuple[Any, Any, Any]:
    """Simulation, parameters and state after so many coupling intervals."""
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene, **extensions)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)

    @partial(jax.jit, static_argnums=2)
    def run(state: Any, neighbors: Any, count: int) -> Any:
        def body(both: Any, _: Any) -> Any:
            state, neighbors, report = simulation.step(parameters, *both)
            return (state, neighbors), failures(simulation, report)

        return lax.scan(body, (state, neighbors), None, count)

    (state, _), flags = run(state, neighbors, number)
    assert not np.any(flags), np.unique(flags)
    return simulation, parameters, state


def stream_tables(interval: float) -> dict[str, Any]:
    """A hot sphere in a stream of air that is too heavy for the stream to move it."""
    return {
        "precision": "float64",
        "domain": {"size": [0.036, 0.072], "depth": 0.072, "gravity": [0.0, 0.0]},
        "particles": {"radius": 0.0018, "density": 8850.0, "position": [[0.018, 0.036]]},
        "fluid": {
            "cells": [3, 4],
            "density": AIR_DENSITY,
            "viscosity": AIR_VISCOSITY / AIR_DENSITY,
            "velocity": [6.0, 0.0],
        },
        "boundary": {
            "left": {"kind": "inlet", "velocity": 6.0, "ramp_time": 0.0, "temperature": 298.15},
            "right": {"kind": "outlet"},
            "bottom": {"kind": "periodic"},
        },
        "coupling": {"drag_factor": 0.0, "interval": interval},
        "heat": AIR
        | {
            "fluid_temperature": 298.15,
            "exchange": "ranz_marshall",
            "particle_heat_capacity": 55.0,
            "particle_temperature": 373.15,
        },
        "time": {"end": 1.0, "output_interval": interval},
    }


@case(
    "hot sphere in a stream of air",
    "heat",
    "Ranz & Marshall (1952), lumped sphere: T - T_f = (T_0 - T_f) exp(-t/tau), tau = rho c d^2 / (6 Nu k)",
    fast={"end": 0.1},
)
def hot_sphere(end: float = 1.0) -> list[Figure]:
    """Temperature after a time; Re 1384, Nu 21.974, tau 1.8402 s: 341.71 K after 1 s. The sphere warms its own stream
    by some 0.1 % of the difference."""
    interval = 1e-3
    _, _, state = advanced(stream_tables(interval), round(end / interval))
    tau = 8850.0 * 55.0 * 0.0036**2 / (6.0 * 21.974 * 0.026)
    expected = 298.15 + 75.0 * math.exp(-end / tau)
    got = float(state.scalars.grains[0])
    figures = [relative(f"loss of temperature after {end:g} s", 373.15 - expected, 373.15 - got, 2e-3, "K")]
    return [*figures, relative(f"temperature after {end:g} s", expected, got, 1e-4, "K")]


def schumann(y: float, z: float) -> tuple[float, float]:
    """Temperatures of the gas and of the solid in a bed, T_f and T_s from 0 (cold) to 1 (gas that comes in).

    dT_f/dy = T_s - T_f, dT_s/dz = T_f - T_s: T_f = J(y, z), T_s = 1 - J(z, y) with
    J(a, b) = 1 - exp(-b) int_0^a exp(-s) I_0(2 sqrt(s b)) ds.

    Source: T. E. W. Schumann, J. Franklin Inst. 208 (1929) 405-416.
    """

    def j(a: float, b: float) -> float:
        def kernel(s: float) -> float:
            root = 2.0 * math.sqrt(s * b)
            return float(special.ive(0, root)) * math.exp(root - s - b)

        return 1.0 - float(integrate.quad(kernel, 0.0, a, epsabs=1e-10)[0])

    return j(y, z), 1.0 - j(z, y)


def constant_nusselt(reynolds: Any, prandtl: Any, void_fraction: Any) -> Any:
    """Nu = 2.4 at any speed."""
    return jnp.full_like(reynolds, 2.4)


@case(
    "fixed bed with hot gas in",
    "heat",
    "T. E. W. Schumann, J. Franklin Inst. 208 (1929) 405-416",
    fast={"layers": 60, "intervals": 400},
)
def fixed_bed(layers: int = 240, intervals: int = 1600) -> list[Figure]:
    """A column of spheres on a lattice, through which hot gas goes: temperatures of the grains along it.

    A constant Nusselt number stands for the law, so that the bed is the one of the closed form.
    """
    diameter, solid, speed = 2e-3, 0.3, 0.5
    pitch = diameter * (math.pi / 6.0 / solid) ** (1.0 / 3.0)
    columns = 4
    length, width = layers * pitch, columns * pitch
    places = np.stack(np.meshgrid(*(np.arange(n) for n in (layers, columns)), indexing="ij"), -1)
    interval, density, heat_capacity = 2e-3 * 60 / layers, 100.0, 100.0
    tables = {
        "precision": "float64",
        "domain": {"size": [length, width], "depth": pitch, "gravity": [0.0, 0.0]},
        "particles": {
            "radius": 0.5 * diameter,
            "density": density,
            "position": ((places.reshape(-1, 2) + 0.5) * pitch).tolist(),
        },
        "fluid": {
            "cells": [layers, 1],
            "density": AIR_DENSITY,
            "viscosity": AIR_VISCOSITY / AIR_DENSITY,
            "velocity": [speed / (1.0 - solid), 0.0],
        },
        "boundary": {
            "left": {"kind": "inlet", "velocity": speed, "ramp_time": 0.0, "temperature": 1.0},
            "right": {"kind": "outlet"},
            "bottom": {"kind": "periodic"},
        },
        "contact": {"young_modulus": 1e4, "friction": 0.0, "speed": 0.01},
        "coupling": {"drag_factor": 0.0, "interval": interval, "void_fraction": "centre"},
        "heat": AIR
        | {
            "fluid_temperature": 0.0,
            "particle_heat_capacity": heat_capacity,
            "particle_temperature": 0.0,
            "bed_conductivity": "kuipers",
        },
        "time": {"end": interval * intervals, "output_interval": interval},
    }
    _, _, state = advanced(tables, intervals, nusselt=constant_nusselt)
    transfer = 2.4 * AIR["fluid_conductivity"] / diameter * 6.0 * solid / diameter  # h a [W/(m3 K)]
    found = np.asarray(state.scalars.grains).reshape(layers, -1).mean(axis=1)
    figures = []
    for share in (0.1, 0.3, 0.5, 0.7):
        layer = round(share * layers)
        x = (layer + 0.5) * pitch
        time = interval * intervals - x * (1.0 - solid) / speed
        y = transfer * x / (AIR_DENSITY * AIR["fluid_heat_capacity"] * speed)
        z = transfer * time / (density * heat_capacity * solid)
        expected = schumann(y, z)[1]
        what = f"temperature of the grains at {share:g} of the bed (y = {y:.2f}, z = {z:.2f})"
        figures.append(Figure(what, expected, float(found[layer]), abs(float(found[layer]) - expected), 0.02))
    return figures


def chain_tables(number: int, conductivity: float, interval: float, **sides: Any) -> dict[str, Any]:
    """Spheres of 10 mm in a row between two walls that press them together."""
    diameter = 0.01
    length = number * diameter * (1.0 - 2e-4)
    places = [[length * (k + 0.5) / number, 0.01] for k in range(number)]
    return {
        "precision": "float64",
        "domain": {"size": [length, 0.02], "gravity": [0.0, 0.0]},
        "particles": {
            "radius": 0.5 * diameter,
            "density": 2000.0,
            "position": places,
        },
        "contact": {"young_modulus": 1e6, "poisson_ratio": 0.3, "restitution": 0.1, "friction": 0.0},
        "boundary": sides,
        "coupling": {"interval": interval},
        "heat": {
            "particle_heat_capacity": 500.0,
            "particle_temperature": 20.0,
            "particle_conductivity": conductivity,
            "true_young_modulus": 64e6,
        },
        "time": {"end": 100.0 * interval, "output_interval": interval},
    }


def squeezed(number: int) -> tuple[float, float]:
    """Radius of the contacts of `chain_tables` [m]: between spheres and with a wall, at rest and with the true modulus.

    The overlaps of all contacts add up to what the walls press in. With Hertz's law equal forces are at overlaps
    d_w = d_p (E*_p sqrt(R*_p) / (E*_w sqrt(R*_w)))^(2/3); moduli of wall and sphere are equal, R*_w = 2 R*_p.
    """
    radius, pressed = 0.005, number * 0.01 * 2e-4
    share = (0.5**0.5) ** (2.0 / 3.0)
    overlap = pressed / (number - 1 + 2.0 * share)
    softened = (1e6 / 64e6) ** (1.0 / 3.0)
    return softened * math.sqrt(0.5 * radius * overlap), softened * math.sqrt(radius * share * overlap)


@case(
    "two touching spheres",
    "heat",
    "Batchelor & O'Brien (1977): the difference decays with 2 k a (1/C1 + 1/C2); a from Hertz at equal force",
    fast={},
)
def two_spheres() -> list[Figure]:
    """Two spheres of different heat capacity between walls that conduct nothing: their difference, and their heat."""
    conductivity, interval, number = 400.0, 0.01, 60
    tables = chain_tables(2, conductivity, interval)
    tables["particles"]["density"] = [2000.0, 1000.0]
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    grains = jnp.asarray([80.0, 20.0])

    @jax.jit
    def run(state: Any, neighbors: Any) -> Any:
        def body(both: Any, _: Any) -> Any:
            return simulation.step(parameters, *both)[:2], None

        return lax.scan(body, (state, neighbors), None, number)[0]

    state, neighbors = run(state, neighbors)  # to rest
    state = state._replace(scalars=state.scalars._replace(grains=grains))
    state, _ = run(state, neighbors)
    volume = math.pi / 6.0 * 0.01**3
    capacities = np.array([2000.0, 1000.0]) * 500.0 * volume
    rate = 2.0 * conductivity * squeezed(2)[0] * np.sum(1.0 / capacities)
    found = np.asarray(state.scalars.grains)
    kept = np.dot(capacities, found) / np.dot(capacities, grains) - 1.0
    expected = 60.0 * math.exp(-rate * number * interval)
    return [
        relative("difference of the temperatures", expected, found[0] - found[1], 0.01, "K"),
        below("heat gained or lost", abs(kept), 1e-13),
    ]


@case(
    "ten spheres between two walls",
    "heat",
    "conduction in series: conductances 2 k a between spheres and with walls of the same material",
    fast={},
)
def ten_spheres() -> list[Figure]:
    """Ten 10 mm spheres between walls of 0 and 50 C, in the end: a straight line, and the heat that passes."""
    conductivity, interval, number = 4e5, 0.01, 800
    sides = {"left": {"temperature": 50.0}, "right": {"temperature": 0.0}}
    _, _, state = advanced(chain_tables(10, conductivity, interval, **sides), number)
    between, with_wall = (2.0 * conductivity * a for a in squeezed(10))
    flow = 50.0 / (9.0 / between + 2.0 / with_wall)
    expected = 50.0 - flow / with_wall - flow / between * np.arange(10)
    found = np.asarray(state.scalars.grains)
    figures = [relative(f"temperature of sphere {k + 1}", expected[k], found[k], 0.01, "C") for k in (0, 3, 6, 9)]
    steps = np.diff(found)
    return [*figures, below("bend of the line, over its steps", np.max(np.abs(steps / steps.mean() - 1.0)), 1e-3)]


@case(
    "natural convection in a cavity",
    "heat",
    "G. de Vahl Davis, Int. J. Numer. Meth. Fluids 3 (1983) 249-264: Nu of air between a warm and a cold wall",
    fast={"numbers": (1e4,), "coarse": 12, "fine": 20},
)
def cavities(numbers: tuple[float, ...] = (1e3, 1e4, 1e5, 1e6), coarse: int = 32, fine: int = 64) -> list[Figure]:
    """Mean Nusselt number of a square cavity with closed floor and lid, extrapolated from two meshes with an error
    of second order; the references are good to 1 %."""
    reference = {1e3: 1.118, 1e4: 2.243, 1e5: 4.519, 1e6: 8.800}
    figures = []
    for rayleigh in numbers:
        found = [nusselt(rayleigh, cells) for cells in (coarse, fine)]
        limit = found[1] + (found[1] - found[0]) / ((fine / coarse) ** 2 - 1.0)
        what = f"Nu at Ra = {rayleigh:g}, from {coarse}^2 and {fine}^2 cells"
        figures.append(relative(what, reference[rayleigh], limit, 0.01))
    return figures


def nusselt(rayleigh: float, cells: int) -> float:
    """Mean heat through the middle of the cavity, by flow and conduction, in units of that by conduction alone.

    In units of the side and of the thermal diffusivity; beta dT = 0.01, so that g is Ra nu alpha / 0.01.
    """
    prandtl, expansion = 0.71, 0.01
    fastest = max(4.0, 0.7 * math.sqrt(rayleigh * prandtl))
    interval = min(0.5 / cells / fastest, 0.1 / cells**2)
    count = math.ceil((0.5 if rayleigh < 1e5 else 0.25) / interval)
    tables = {
        "precision": "float64",
        "domain": {"size": [1.0, 1.0], "depth": 1.0, "gravity": [0.0, -rayleigh * prandtl / expansion]},
        "fluid": {"cells": [cells, cells], "density": 1.0, "viscosity": prandtl, "time_step": interval},
        "boundary": {"left": {"temperature": 1.0}, "right": {"temperature": 0.0}},
        "heat": {
            "fluid_heat_capacity": 1.0,
            "fluid_conductivity": 1.0,
            "fluid_temperature": 0.5,
            "expansion": expansion,
        },
        "time": {"end": interval * count, "output_interval": interval},
    }
    _, _, state = advanced(tables, count)
    left, right = np.asarray(state.scalars.fields[0])[cells // 2 - 1 : cells // 2 + 1]
    flow = np.asarray(state.fluid.face_velocity[0])[cells // 2]
    return float(np.mean(flow * 0.5 * (left + right) - (right - left) * cells))


def ring(cells: int) -> tuple[float, float]:
    """Heat from the inner to the outer of two cylinders per length, and what is not kept over that."""
    interval = 0.1 / cells**2
    number = math.ceil(0.2 / interval)
    walls = [
        {"kind": "cylinder", "center": [0.503, 0.498], "radius": radius, "inside": radius > 0.3, "fluid": "no_slip",
         "temperature": value}
        for radius, value in ((0.2, 1.0), (0.45, 0.0))
    ]  # fmt: skip
    tables = {
        "precision": "float64",
        "domain": {"size": [1.0, 1.0], "depth": 1.0, "gravity": [0.0, 0.0]},
        "fluid": {"cells": [cells, cells], "density": 1.0, "viscosity": 1.0, "time_step": interval},
        "walls": walls,
        "heat": {"fluid_heat_capacity": 1.0, "fluid_conductivity": 1.0, "fluid_temperature": 0.0},
        "time": {"end": interval * number, "output_interval": interval},
    }
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    state, _ = jaxdem.initial_state(scene, simulation, parameters)

    @jax.jit
    def run(state: Any, count: Any) -> Any:
        return lax.fori_loop(0, count, lambda _, state: simulation.step(parameters, state, None)[0], state)

    passed = []
    for count in (number, 10):
        state = run(state, count)
        passed.append(np.asarray(state.scalars.supplied.sides)[0][4:])
    cut = parameters.fluid.cut
    share = np.where(np.asarray(cut.open_cells) > 0.0, cut.open_cells + parameters.scalars.walls.lent, 0.0)
    held = float(np.sum(share * np.asarray(state.scalars.fields[0]))) / cells**2
    inner = (passed[1] - passed[0])[0] / (10.0 * interval)
    return inner, (held - float(np.sum(passed[1]))) / float(np.sum(np.abs(passed[1])))


@case(
    "fluid between two cylinders",
    "heat",
    "conduction through a ring: 2 pi k (T_1 - T_2) / ln(r_2/r_1), of cylinders within the mesh",
    fast={"coarse": 12, "fine": 24},
)
def between_cylinders(coarse: int = 20, fine: int = 40) -> list[Figure]:
    """Heat that passes from a cylinder of radius 0.2 m to one of 0.45 m, through cells that they cut."""
    exact = 2.0 * math.pi / math.log(0.45 / 0.2)
    found = [ring(cells) for cells in (coarse, fine)]
    errors = [abs(passed / exact - 1.0) for passed, _ in found]
    return [
        relative(f"heat through the ring, {fine}^2 cells", exact, found[1][0], 0.005 * (40.0 / fine) ** 2, "W/m"),
        at_least("order of its error", 1.5, math.log(errors[0] / errors[1]) / math.log(fine / coarse)),
        below("heat gained or lost, over that of the walls", max(abs(kept) for _, kept in found), 1e-12),
    ]


@case(
    "heat of friction in a closed box",
    "heat",
    "conservation: kinetic, potential, elastic and thermal energy together",
    fast={"end": 0.002},
)
def friction(end: float = 0.02) -> list[Figure]:
    """Four grains that fall, slide and roll until they lie almost still, with springs against rolling."""
    options = {"contact": {"rolling_friction": 0.1, "rolling_model": "epsd"}}
    heat = {"particle_heat_capacity": 500.0, "particle_temperature": 0.0, "friction": True}
    tables = with_tables(BOX, **options, heat=heat, time={"end": end, "output_interval": end})
    found = balance_of(tables)
    thermal = 500.0 * MASS * float(np.sum(np.asarray(found["state"].scalars.grains)))
    turned_over = found["gained"] / found["gained_relative"]
    taken = sum(found["dissipated"].values())
    gained = sum(found["end"].values()) - sum(found["start"].values()) + thermal
    return [
        below("all energies together, change over what is turned over", abs(gained) / turned_over, 1e-6),
        below("heat less what contacts took, the same", abs(thermal - taken) / turned_over, 1e-11),
        at_least("part of it that became heat", 0.01, thermal / turned_over),
    ]

"""Two fluids beside walls that the fluid sees: rest, waves, forces, and the volume of what moves."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxdem
from jaxdem.failures import failures
from jaxdem.setup.cut_liquid import liquid_beside_walls
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State
from tests.cases.registry import Figure, below, case, relative

LIQUID, GRAVITY = 1000.0, 9.81
SIDES_2D = ("left", "right", "bottom", "top")

BEACH = {"kind": "plane", "point": [0.3, 0.0], "normal": [-0.8, 1.0], "fluid": "no_slip"}
TILTED_BOX = {
    "kind": "mesh", "points": [[0.15, 0.2], [0.45, 0.05], [0.7, 0.4], [0.3, 0.55]],
    "closed": True, "inside": True, "fluid": "no_slip",
}  # fmt: skip
BODY = {"kind": "cylinder", "center": [0.41, 0.28], "radius": 0.12, "inside": False, "fluid": "free_slip"}


def tank(walls: list[dict[str, Any]], cells: tuple[int, ...] = (24, 18), **changes: Any) -> dict[str, Any]:
    """Water under air of a thousandth of its density up to 0.31 m, in a box of 0.8 m by 0.6 m with walls in it."""
    scene: dict[str, Any] = {
        "precision": "float64",
        "domain": {"size": [0.8, 0.6], "gravity": [0.0, -GRAVITY], "depth": 1.0},
        "fluid": {"cells": list(cells), "density": LIQUID, "viscosity": 1e-6, "time_step": 0.002},
        "surface": {"density": 1.0, "viscosity": 1.5e-5, "level": 0.31},
        "walls": walls,
        "time": {"end": 1.0, "output_interval": 0.02},
    }
    for key, value in changes.items():
        scene[key] = {**scene[key], **value} if isinstance(scene.get(key), dict) else value
    return scene


class Ended(NamedTuple):
    """A run: what was built, where it began and ended, and its worst figures.

    Attributes:
        codes: of the failures; 0 for none.
        beyond: how far a fraction was beyond 0 and 1 [-].
        iterations: most of a pressure solve.
        load: (S, D, 1 + D) of the last step, see `surface_loads`; empty without walls.
        seen: what was watched after every step.
    """

    simulation: Simulation
    parameters: Parameters
    start: State
    end: State
    codes: int
    beyond: float
    iterations: int
    load: np.ndarray
    seen: np.ndarray

    @property
    def speed(self) -> float:
        """Largest velocity of both fluids on a face at the end [m/s]."""
        return max(float(jnp.abs(u).max()) for u in self.end.fluid.face_velocity)

    def liquid(self, state: State) -> float:
        """Volume of the liquid [m3]."""
        fluid, grid = state.fluid, self.simulation.fluid.solver.grid
        gaps = 1.0 if fluid.void_fraction is None else fluid.void_fraction
        cut = self.parameters.flow.cut
        share = gaps if cut is None else cut.open_cells * gaps
        return float(jnp.sum(share * fluid.liquid_fraction)) * grid.cell_volume

    @property
    def missing(self) -> float:
        """Liquid that is lost, over that of the start [-]."""
        return abs(self.liquid(self.end) / self.liquid(self.start) - 1.0)


def _nothing(state: State) -> Any:
    return jnp.zeros(())


@functools.cache
def marched(simulation: Simulation, steps: int, seen: Callable[[State], Any]) -> Callable[..., Any]:
    """The program of so many intervals; scenes of the same structure share it."""

    def all_of_them(parameters: Parameters, start: Any) -> Any:
        def one(carry: Any, _: Any) -> Any:
            state, neighbors, told = simulation.step(parameters, *carry)
            c = state.fluid.liquid_fraction
            beyond = jnp.maximum(-jnp.min(c), jnp.max(c) - 1.0)
            found = failures(simulation, told), beyond, told.fluid.iterations, told.fluid.surface_load, seen(state)
            return (state, neighbors), found

        return jax.lax.scan(one, start, None, steps)

    return jax.jit(all_of_them)


def run(
    tables: dict[str, Any],
    steps: int,
    seen: Callable[[State], Any] = _nothing,
    change: Callable[[Simulation], Simulation] = lambda simulation: simulation,
) -> Ended:
    """So many intervals of a scene."""
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    start, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    simulation = change(simulation)
    (end, _), (codes, beyond, iterations, loads, watched) = marched(simulation, steps, seen)(
        parameters, (start, neighbors)
    )
    worst = int(np.bitwise_or.reduce(np.asarray(codes)))
    load = np.asarray([] if loads is None else loads[-1])
    figures = float(beyond.max()), int(iterations.max()), load, np.asarray(watched)
    return Ended(simulation, parameters, start, end, worst, *figures)


@case("lakes beside walls at rest", "surface", "the level stays: largest speed 0", fast={"steps": 20})
def lakes_at_rest(steps: int = 200) -> list[Figure]:
    """Water under air at a density ratio of 1,000 on a slope, in a box that is tilted in the mesh, round a cylinder."""
    figures = []
    for name, wall in (("a slope", BEACH), ("a tilted box", TILTED_BOX), ("a cylinder", BODY)):
        found = run(tank([wall]), steps)
        assert found.codes == 0
        figures.append(below(f"{name}: speed", found.speed, 1e-12, "m/s"))
    return figures


@case(
    "forces of a lake on walls", "surface", "hydrostatic pressure; Archimedes", fast={"cells": (24, 18), "gate": 0.04}
)
def forces_of_a_lake(cells: tuple[int, ...] = (64, 48), gate: float = 0.012) -> list[Figure]:
    """A cylinder that floats half under water, and a slope that comes out of it.

    The load is of the reduced pressure: the weight of the liquid in place of the walls is added. The error of the lift
    is that of the cylinder of flat parts above the water, of an order of one and a half; a slope has flat parts.
    """
    level, air = 0.31, 1.0
    found = run(tank([BODY], cells), 2)
    height, radius = level - BODY["center"][1], BODY["radius"]
    under = radius**2 * (0.5 * math.pi + math.asin(height / radius)) + height * math.sqrt(radius**2 - height**2)
    whole = math.pi * radius**2
    lift = float(found.load[0, 1, 0]) + LIQUID * GRAVITY * whole
    displaced = GRAVITY * (LIQUID * under + air * (whole - under))
    figures = [relative("lift of the cylinder", displaced, lift, gate, "N")]
    found = run(tank([BEACH], cells), 2)
    x0, nx, nz = BEACH["point"][0], *BEACH["normal"]
    slope = -nx / nz
    top, per_height = slope * (0.8 - x0), math.hypot(slope, 1.0) / slope  # length of the slope by its height
    own = float(found.end.fluid.pressure[0, 0])  # reduced, in the liquid
    # Pressure over that of the surface; reduced by the weight of the liquid, and by its value there.
    weight = LIQUID * GRAVITY * (level * top - 0.5 * top**2) * per_height
    normal = np.array([nx, nz]) / math.hypot(nx, nz)
    push = -float(found.load[0, :, 0] @ normal) - own * top * per_height + weight
    above = top - level
    exact = GRAVITY * (0.5 * LIQUID * level**2 - 0.5 * air * above**2) * per_height
    figures.append(relative("push on the slope", exact, push, 0.25 * gate, "N"))
    # Its moment about the foot of the slope, by the distance along it.
    arm_weight = LIQUID * GRAVITY * (level * top**2 / 2.0 - top**3 / 3.0) * per_height**2
    load = found.load[0]
    about = load[:, 1:] - load[:, :1] * np.array([[x0, 0.0]])
    moment = float(about[0, 1] - about[1, 0]) - own * 0.5 * (top * per_height) ** 2 + arm_weight
    exact = GRAVITY * per_height**2 * (LIQUID * level**3 / 6.0 - air * above**2 * (level / 2.0 + above / 3.0))
    return [*figures, relative("its moment about the foot of the slope", exact, moment, 0.25 * gate, "N m")]


def waves(walls: list[dict[str, Any]], cells: tuple[int, ...], size: list[float], shape: Any, period: float) -> Any:
    """A scene of water without viscosity below a line, with 4 steps a cell in a period."""
    step = period / (4 * cells[0])
    return tank(
        walls, cells, domain={"size": size}, fluid={"viscosity": 0.0, "time_step": step},
        surface={"viscosity": 0.0, "level": None, "regions": [{"shape": "polygon", "vertices": shape}]},
        boundary={name: {"kind": "free_slip"} for name in SIDES_2D}, time={"end": 1000 * step, "output_interval": step},
    )  # fmt: skip


def measured_period(found: Ended, mean: float, time_step: float) -> float:
    """From the first zero of what was seen, less its value at rest, to the third [s]."""
    values = found.seen - mean
    zeros = np.flatnonzero(values[1:] * values[:-1] <= 0.0)
    times = (zeros + values[zeros] / (values[zeros] - values[zeros + 1])) * time_step
    return float(times[2] - times[0])


def mode_of(parameters: Parameters, weight: np.ndarray) -> Callable[[State], Any]:
    """Sum of the liquid in the cells times a weight."""
    shares = jnp.asarray(np.asarray(parameters.flow.cut.open_cells) * weight)
    return lambda state: jnp.sum(shares * state.fluid.liquid_fraction)


def period_in_a_tank(cells: int) -> tuple[float, Ended]:
    """Period over that of Lamb, art. 228, of the first mode between two walls 1 m apart and above a floor, all of them
    within the mesh."""
    width = 1.25
    h = width / cells
    left, floor = 0.1 + 0.37 * h, 0.1 + 0.41 * h
    level = (round(0.62 / h) + 0.5) * h  # in the middle of a row
    k, depth = math.pi, level - floor
    period = 2.0 * math.pi / math.sqrt(GRAVITY * k * math.tanh(k * depth))
    planes = (([left, 0.0], [1.0, 0.0]), ([left + 1.0, 0.0], [-1.0, 0.0]), ([0.0, floor], [0.0, 1.0]))
    walls = [{"kind": "plane", "point": p, "normal": n, "fluid": "free_slip"} for p, n in planes]
    x = np.linspace(left + 1.1, left - 0.1, 61)
    top = np.stack([x, level + 0.01 * np.cos(k * (x - left))], -1).tolist()
    scene = waves(walls, (cells, cells), [width, width], [[-0.5, -0.5], [2.0, -0.5], *top], period)
    return _period(scene, np.cos(k * ((np.arange(cells) + 0.5) * h - left))[:, None], level, period)


def period_in_a_canal(cells: int) -> tuple[float, Ended]:
    """Period over 2 pi sqrt(H/g) of the swaying of water in a canal of two slopes of 45 degrees, H deep.

    The velocity potential x z satisfies both slopes, and the surface stays plane: H. Lamb, Hydrodynamics, art. 258.
    """
    width = 1.3
    h = width / cells
    rows = round(0.8 / h)
    middle, foot = 0.5 * width + 0.31 * h, 0.05 + 0.23 * h
    level = (round(0.53 / h) + 0.5) * h
    period = 2.0 * math.pi * math.sqrt((level - foot) / GRAVITY)
    walls = [
        {"kind": "plane", "point": [middle, foot], "normal": [way, 1.0], "fluid": "free_slip"} for way in (-1.0, 1.0)
    ]
    line = [[x, level + 0.02 * (x - middle)] for x in (3.0, -1.0)]
    scene = waves(walls, (cells, rows), [width, rows * h], [[-1.0, -1.0], [3.0, -1.0], *line], period)
    return _period(scene, ((np.arange(cells) + 0.5) * h - middle)[:, None], level, period)


def _period(scene: dict[str, Any], weight: np.ndarray, level: float, period: float) -> tuple[float, Ended]:
    parameters = jaxdem.build(jaxdem.load_scene(scene))[1]
    step, cells, size = scene["fluid"]["time_step"], scene["fluid"]["cells"], scene["domain"]["size"]
    h = size[1] / cells[1]
    flat = np.broadcast_to(np.clip(level / h - np.arange(cells[1]), 0.0, 1.0), cells)
    cut = jax.tree.map(np.asarray, parameters.flow.cut)
    mean = float(np.sum(cut.open_cells * weight * liquid_beside_walls(cut, flat)))
    found = run(scene, int(1.4 * period / step), mode_of(parameters, weight))
    return measured_period(found, mean, step) / period, found


@case(
    "waves between walls in the mesh",
    "surface",
    "H. Lamb, Hydrodynamics, arts. 228 and 258",
    fast={"cells": (20, 26), "gate": 0.012},
)
def waves_between_walls(cells: tuple[int, ...] = (40, 52), gate: float = 0.005) -> list[Figure]:
    """Water under air of a thousandth of its density, without viscosity: the first mode of a tank, and the swaying of a
    canal of 45 degrees, whose edges run up and down its slopes."""
    figures = []
    for name, measure, n in zip(("tank", "canal"), (period_in_a_tank, period_in_a_canal), cells, strict=True):
        ratio, found = measure(n)
        assert found.codes == 0
        figures += [
            relative(f"{name}: period over the closed form, {n} cells across the box", 1.0, ratio, gate),
            below(f"{name}: liquid lost", found.missing, 1e-12),
            below(f"{name}: fraction beyond 0 and 1", found.beyond, 1e-10),
        ]
    return figures


def broken_dam(cells: tuple[int, int] = (32, 24)) -> dict[str, Any]:
    """A column of water that falls upon a slope and a round body."""
    body = {"kind": "cylinder", "center": [0.37, 0.07], "radius": 0.05, "inside": False, "fluid": "no_slip"}
    column = [{"shape": "box", "start": [0.0, 0.0], "stop": [0.3, 0.4]}]
    return tank([BEACH, body], cells, surface={"level": None, "regions": column})


@case("a column that breaks on walls", "surface", "the volume of the liquid is kept", fast={"steps": 60})
def column_on_walls(steps: int = 600) -> list[Figure]:
    """Ratio 1,000: the liquid that is lost, and how far a fraction is beyond 0 and 1."""
    found = run(broken_dam(), steps)
    assert found.codes == 0
    return [
        below("liquid lost", found.missing, 1e-12),
        below("fraction beyond 0 and 1", found.beyond, 1e-10),
        below("iterations of the pressure beyond 15", max(0, found.iterations - 15), 0.5),
    ]

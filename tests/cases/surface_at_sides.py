"""Two fluids that come in and go out by the sides of the box: a hole in the floor, streams along walls, a weir."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxdem.errors import required
from jaxdem.state import State
from tests.cases.registry import Figure, below, case, relative
from tests.cases.surface_beside_walls import GRAVITY, LIQUID, Ended, run

AIR = 1.0
"""Density of the second fluid [kg/m3]."""

HOLE, HEIGHT, DEPTH = 0.05, 0.6, 0.45
"""Half the width of the hole, height of the tank and of the water in it [m]."""


def drained_tank(cells: int, tanks: int = 8, level: float = 0.0, thickness: int = 0) -> dict[str, Any]:
    """Half of a tank that is `tanks` times as wide as the hole in the middle of its floor, `cells` on half the hole.

    In 2-D, or with `thickness` cells along the hole, which is a slot over the whole of it. Beyond the hole there is
    air, or liquid of a level.
    """
    h = HOLE / cells
    size, numbers = [tanks * HOLE, HEIGHT], [tanks * cells, round(HEIGHT / h)]
    sides = {name: {"kind": "free_slip"} for name in ("left", "right")}
    slot = {"from": [0.0], "to": [HOLE]}
    domain: dict[str, Any] = {"depth": 1.0}
    if thickness:
        size.insert(1, thickness * h)
        numbers.insert(1, thickness)
        sides |= {name: {"kind": "free_slip"} for name in ("front", "back")}
        slot, domain = {"from": [0.0, 0.0], "to": [HOLE, thickness * h]}, {}
    step = 0.25 * h / math.sqrt(2.0 * GRAVITY * DEPTH)
    return {
        "precision": "float64",
        "domain": {"size": size, "gravity": [0.0] * (len(size) - 1) + [-GRAVITY], **domain},
        "fluid": {"cells": numbers, "density": LIQUID, "viscosity": 0.0, "time_step": step},
        "surface": {"density": AIR, "viscosity": 0.0, "level": DEPTH},
        "boundary": {**sides, "top": {"kind": "outlet"}, "bottom": {"kind": "outlet", **slot, "level": level}},
        "time": {"end": 1000 * step, "output_interval": step},
    }  # fmt: skip


def at_the_hole(state: State) -> Any:
    """Sum of the liquid in the cells, speed out of the hole in its middle, and sums of what comes in by the floor and
    by the top."""
    up = state.fluid.face_velocity[-1]
    middle = up[(0,) * up.ndim]
    return jnp.stack([jnp.sum(state.fluid.liquid_fraction), -middle, jnp.sum(up[..., 0]), -jnp.sum(up[..., -1])])


def drained(tables: dict[str, Any], end: float) -> tuple[Ended, float, np.ndarray]:
    """A tank that has run out for so long, the volume of its cells, and what was seen of its last step but one: level,
    speed in the middle of the hole, speed of the level."""
    step, size, numbers = tables["fluid"]["time_step"], tables["domain"]["size"], tables["fluid"]["cells"]
    found = run(tables, round(end / step), at_the_hole)
    over = HEIGHT / math.prod(numbers)  # level by the sum of the liquid
    liquid = found.seen[:, 0]
    falls = over * (liquid[-3] - liquid[-1]) / (2.0 * step)
    volume = math.prod(size) * (1.0 if len(size) == 3 else tables["domain"]["depth"]) / math.prod(numbers)
    return found, volume, np.array([over * liquid[-2], found.seen[-2, 1], falls])


def outflow(head: float, falls: float, tanks: int) -> tuple[float, float]:
    """Speed in the middle of the hole, and speed of the level, of an ideal fluid [m/s].

    Bernoulli along the middle gives U = sqrt(2 g h + V^2), V the speed of the level. All of the hole has the pressure
    of the air, so the fluid passes it at U everywhere, and along the floor at its ends. The complex velocity with this
    condition is U [(q^2 - t^2)/(1 - t^2 q^2)]^(1/2) at z, with sin(pi z/W) = s (q + 1/q)/2 and s = sin(pi b/2W): far up
    it is V = U t, t = tan(pi b/4W), b the width of the hole and W that of the tank. In a wide one that is a flow of
    pi/4 b U, where a jet that narrows below its slot has pi/(pi + 2) b U. Derived here.
    """
    weight = GRAVITY * (1.0 - AIR / LIQUID)
    t = math.tan(math.pi / (4.0 * tanks))
    return math.sqrt(2.0 * weight * head + falls**2), t * math.sqrt(2.0 * weight * head / (1.0 - t**2))


def gas_lost(tables: dict[str, Any], found: Ended, volume: float) -> float:
    """Second fluid that is in the box less what came in through its sides, over the volume of the box [-].

    What passes a side is that of both fluids by the velocity at the start of the steps, less the liquid.
    """
    step, area = tables["fluid"]["time_step"], volume / (tables["domain"]["size"][-1] / tables["fluid"]["cells"][-1])
    both = step * area * float(np.sum(found.seen[:-1, 2:]))
    change = found.liquid(found.start) - found.liquid(found.end)
    came = both - float(jnp.sum(found.end.fluid.liquid_supplied[1:]))
    return abs(change - came) / (volume * math.prod(tables["fluid"]["cells"]))


@case(
    "a hole in the floor of a tank", "surface", "sqrt(2 g h + V^2); flow between walls by conformal mapping (tests)",
    fast={"meshes": ((4, 0),), "end": 0.24},
)  # fmt: skip
def hole_in_the_floor(
    meshes: tuple[tuple[int, int], ...] = ((4, 0), (8, 0), (4, 3)), end: float = 0.36
) -> list[Figure]:
    """Water under air of a thousandth of its density runs out of a slot, in 2-D and in 3-D, into air and into water
    that stands up to 0.2 m; the level falls for so long. The closed form is of a steady flow: a level that falls makes
    it faster by half of t^2, 0.5 %."""
    figures = []
    for cells, thickness in meshes:
        for level in (0.0, 0.2) if thickness == 0 else (0.0,):
            tables = drained_tank(cells, level=level, thickness=thickness)
            found, volume, (height, speed, falls) = drained(tables, end)
            assert found.codes == 0
            name = f"{3 if thickness else 2}-D, {2 * cells} cells in the hole, {'water' if level else 'air'} beyond"
            jet, flow = outflow(height - level, falls, 8)
            figures += [
                relative(f"{name}: speed in its middle", jet, speed, 0.05, "m/s"),
                relative(f"{name}: speed of the level", flow, falls, 0.05, "m/s"),
                below(f"{name}: liquid lost, over that of the start", liquid_lost(found), 1e-12),
                below(f"{name}: second fluid lost, over the box", gas_lost(tables, found, volume), 1e-12),
                below(f"{name}: fraction beyond 0 and 1", found.beyond, 1e-10),
            ]
    return figures


def liquid_lost(found: Ended) -> float:
    """Liquid that was there and came in through the sides less that of the end, over that of the start [-]."""
    supplied = np.asarray(found.end.fluid.liquid_supplied)
    return float(supplied.sum() - found.liquid(found.end)) / float(supplied[0])


CANAL = [
    {"kind": "plane", "point": [0.0, 0.15, 0.1], "normal": [0.0, 1.0, 0.3], "fluid": "free_slip"},
    {"kind": "plane", "point": [0.0, 0.45, 0.1], "normal": [0.0, -1.0, 0.5], "fluid": "free_slip"},
    {"kind": "plane", "point": [0.0, 0.0, 0.12], "normal": [0.0, 0.1, 1.0], "fluid": "free_slip"},
]
"""Along the first axis between two slopes and above a floor that leans, within the mesh."""
FLOOR = [{"kind": "plane", "point": [0.0, 0.31], "normal": [0.0, 1.0], "fluid": "free_slip"}]
"""Of a stream of less than a cell."""


def even_stream(dimension: int, level: float) -> dict[str, Any]:
    """Water and air at 1 m/s along walls from an inlet to an outlet, at one level; cells of 5 cm, steps of a fifth."""
    names = ("front", "back", "bottom", "top") if dimension == 3 else ("bottom", "top")
    sides: dict[str, Any] = {name: {"kind": "free_slip"} for name in names}
    sides["left"] = {"kind": "inlet", "velocity": 1.0, "level": level, "ramp_time": 0.0}
    sides["right"] = {"kind": "outlet", "level": level}
    along = [0.0] * (dimension - 1)
    domain: dict[str, Any] = {"size": [0.2, 0.6, 0.6][: dimension - 1] + [0.6], "gravity": [*along, -GRAVITY]}
    return {
        "precision": "float64",
        "domain": domain | ({"depth": 1.0} if dimension == 2 else {}),
        "fluid": {"cells": [4, 12, 12][: dimension - 1] + [12], "density": LIQUID, "viscosity": 0.0, "time_step": 0.01,
                  "velocity": [1.0, *along]},
        "surface": {"density": AIR, "viscosity": 0.0, "level": level},
        "boundary": sides,
        "walls": CANAL if dimension == 3 else FLOOR,
        "time": {"end": 1.0, "output_interval": 0.01},
    }  # fmt: skip


@case(
    "a stream along walls through the sides", "surface", "an even stream stays even",
    fast={"streams": ((2, 0.34),), "steps": 6},
)  # fmt: skip
def stream_along_walls(
    streams: tuple[tuple[int, float], ...] = ((2, 0.34), (3, 0.325), (3, 0.35)), steps: int = 60
) -> list[Figure]:
    """Through inlet and outlet run a floor in the row of the level, and the slopes of a canal with the level within a
    row and on a face of the mesh."""
    figures = []
    for dimension, level in streams:
        found = run(even_stream(dimension, level), steps)
        assert found.codes == 0
        came = np.asarray(found.end.fluid.liquid_supplied)
        across = max(float(jnp.abs(u).max()) for u in found.end.fluid.face_velocity[1:])
        figures += [
            below(f"{dimension}-D, level {level} m: speed across the stream", across, 1e-10, "m/s"),
            below(f"{dimension}-D, level {level} m: part of the liquid that stays", 1.0 + came[2] / came[1], 1e-10),
        ]
    return figures


def weir(cells: int, discharge: float, crest: float, level: float) -> dict[str, Any]:
    """A channel of 2 m by 0.6 m with a sill of free slip: a ramp of 0.3 m up to the crest, which goes on for 1 m to an
    outlet into air. Water comes in at the left, evenly over its depth; `cells` in a metre."""
    h, length, rise = 1.0 / cells, 2.0, 0.3
    foot = length - 1.0 - rise
    over = (discharge**2 / GRAVITY) ** (1.0 / 3.0)
    sill = [[foot, -0.2], [length + 0.2, -0.2], [length + 0.2, crest], [foot + rise, crest], [foot, 0.0]]
    inlet = {"kind": "inlet", "velocity": discharge / level, "level": level, "ramp_time": 0.5}
    return {
        "precision": "float64",
        "domain": {"size": [length, 0.6], "gravity": [0.0, -GRAVITY], "depth": 1.0},
        "fluid": {"cells": [round(length * cells), round(0.6 * cells)], "density": LIQUID, "viscosity": 1e-6,
                  "time_step": 0.125 * h},
        "surface": {"density": AIR, "viscosity": 1.5e-5, "regions": [
            {"shape": "box", "start": [-1.0, -1.0], "stop": [foot + rise, level]},
            {"shape": "box", "start": [-1.0, -1.0], "stop": [9.0, crest + over]}]},
        "boundary": {"bottom": {"kind": "free_slip"}, "left": inlet, "right": {"kind": "outlet"},
                     "top": {"kind": "outlet"}},
        "walls": [{"kind": "mesh", "points": sill, "closed": True, "fluid": "free_slip"}],
        "time": {"end": 1000.0 * h, "output_interval": 0.125 * h},
    }  # fmt: skip


@functools.cache
def before_the_weir(cells: int) -> Callable[[State], Any]:
    """Depth of the water between 0.35 m and 0.63 m, and minus the liquid that has left through the outlet."""
    columns = slice(round(0.35 * cells), round(0.63 * cells))

    def seen(state: State) -> Any:
        depth = jnp.mean(jnp.sum(state.fluid.liquid_fraction[columns], axis=1)) / cells
        return jnp.stack([depth, required(state.fluid.liquid_supplied, "liquid_supplied")[2]])

    return seen


@case(
    "a broad-crested weir", "surface", "q = (2/3)^(3/2) g^(1/2) H^(3/2), critical flow over the crest",
    fast={"cells": 20, "end": 3.0, "gate": 0.1},
)  # fmt: skip
def broad_crested_weir(cells: int = 40, end: float = 6.0, gate: float = 0.05) -> list[Figure]:
    """A stream over a sill in the mesh, from an inlet with a level to an outlet into air. H is the energy of the water
    before the sill over the crest, y - P + (q/y)^2/2g, and q what leaves: means over the last quarter of the time, in
    which the pool still falls."""
    discharge, crest = 0.1, 0.2 + 0.37 / cells
    head = 1.5 * (discharge**2 / GRAVITY) ** (1.0 / 3.0)
    level = crest + head
    for _ in range(50):
        level = crest + head - (discharge / level) ** 2 / (2.0 * GRAVITY)
    tables = weir(cells, discharge, crest, level)
    step = tables["fluid"]["time_step"]
    found = run(tables, round(end / step), before_the_weir(cells))
    assert found.codes == 0
    late = found.seen[-len(found.seen) // 4 :]
    depth, leaves = float(late[:, 0].mean()), float(late[0, 1] - late[-1, 1]) / (step * (len(late) - 1))
    head = depth - crest + (leaves / depth) ** 2 / (2.0 * GRAVITY)
    return [
        relative("discharge", (head / 1.5) ** 1.5 * math.sqrt(GRAVITY), leaves, gate, "m2/s"),
        below("liquid lost, over that of the start", liquid_lost(found), 1e-12),
        below("fraction beyond 0 and 1", found.beyond, 1e-10),
    ]

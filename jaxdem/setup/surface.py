"""Two fluids of a scene: the numbers of the second one, the liquid at the start, and what limits the time step."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from jax import Array
from jax.typing import DTypeLike

from jaxdem.fluid.cut_cells import CutCells
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.second_fluid import SecondFluid
from jaxdem.numerics.host import on_device
from jaxdem.particles.regions import Region
from jaxdem.scene import Scene
from jaxdem.setup.regions import region_space
from jaxdem.solids.clipping import positive_part

PARTS = {2: 32, 3: 8}
"""Parts of the side of a cell in which the boundary of a region is plane, by the dimension."""

WAVE_SHARE = 0.5
"""Of the step at which the shortest waves of a surface grow, that a fluid step may take."""


@dataclasses.dataclass(frozen=True, eq=False)
class KeptLiquid:
    """The liquid of a run that a scene goes on with.

    Attributes:
        fraction: on the cells of that run [-].
        speed: largest component of the velocity of both fluids [m/s].
    """

    fraction: np.ndarray
    speed: float


def second_fluid(scene: Scene, number: Callable[[float | list[float]], Array]) -> SecondFluid | None:
    """The numbers of the second fluid; None in a scene with one."""
    table = scene.surface
    if table is None:
        return None
    levels = [scene.boundary[name].level or 0.0 for name in scene.sides]
    return SecondFluid(number(table.density), number(table.viscosity), number(table.tension), number(levels))


def with_liquid(
    fluid: FluidState, grid: Grid, fraction: np.ndarray, dtype: DTypeLike, cut: CutCells | None = None
) -> FluidState:
    """The fluid with this liquid fraction, whose balance begins now; `cut` are surfaces within the mesh."""
    share = 1.0 if fluid.void_fraction is None else np.asarray(fluid.void_fraction, float)
    if cut is not None:
        share = share * np.asarray(cut.open_cells, float)
    supplied = [grid.cell_volume * float(np.sum(share * fraction)), *[0.0] * (2 * grid.dimension)]
    return fluid._replace(liquid_fraction=on_device(fraction, dtype), liquid_supplied=on_device(supplied, dtype))


def first_fraction(scene: Scene, grid: Grid) -> np.ndarray:
    """Liquid fraction of the cells at the start. In a cell that several parts of the liquid reach into, the largest.

    Raises:
        InputError: of a region that has no meaning in this box.
    """
    table = scene.surface
    found = np.zeros(grid.cells)
    if table is None:
        return found
    if table.level is not None:
        h = grid.spacing[-1]
        found = found + np.clip((table.level - h * np.arange(grid.cells[-1])) / h, 0.0, 1.0)
    # Points of a cell that the boundary of a region cuts are no farther from it than the diagonal.
    depth = float(np.linalg.norm(grid.spacing))
    for k, region in enumerate(table.regions):
        found = np.maximum(found, cells_within(region_space(f"surface.regions.{k}", region, scene.box, depth), grid))
    return found


def cells_within(space: Region, grid: Grid) -> np.ndarray:
    """Part of every cell that lies in a region; of one that reaches beyond a periodic side its images count too."""
    found = np.zeros(grid.cells)
    ends = zip(grid.periodic, space.wraps, strict=True)
    images = [(-1, 0, 1) if periodic and not wraps else (0,) for periodic, wraps in ends]
    for image in itertools.product(*images):
        found = np.maximum(found, _of_image(space, grid, np.asarray(image) * np.asarray(grid.size)))
    return found


def _of_image(space: Region, grid: Grid, shift: np.ndarray) -> np.ndarray:
    """The same of the region moved by a vector [m]."""
    h = np.asarray(grid.spacing)
    middles = np.stack(np.meshgrid(*[(np.arange(n) + 0.5) * s for n, s in zip(grid.cells, h, strict=True)],
                                   indexing="ij"), axis=-1)  # fmt: skip
    distance = space.signed_distance((middles - shift).reshape(-1, grid.dimension)).reshape(grid.cells)
    found = (distance < 0.0).astype(float)
    # Only cells that the boundary may cut are divided.
    cut = np.argwhere(np.abs(distance) <= 0.5 * float(np.linalg.norm(h)) * (1.0 + 1e-9))
    if not len(cut):
        return found
    parts = PARTS[grid.dimension]
    steps = np.stack(np.meshgrid(*[np.arange(parts + 1) / parts] * grid.dimension, indexing="ij"), axis=-1)
    points = (cut.reshape(len(cut), *[1] * grid.dimension, -1) + steps[None]) * h - shift
    corners: Any = -space.signed_distance(points.reshape(-1, grid.dimension)).reshape(points.shape[:-1])
    part = positive_part(corners, tuple(range(1, grid.dimension + 1))).fraction
    found[tuple(cut.T)] = np.asarray(part).mean(axis=tuple(range(1, grid.dimension + 1)))
    return found


def surface_limits(scene: Scene, spacing: tuple[float, ...]) -> dict[str, float]:
    """Longest fluid steps for the waves of the surface, by what drives them [s]; {} in a scene with one fluid.

    The step is a leapfrog step for waves, stable up to 2 over their angular frequency. With the shortest wave of the
    mesh, k = pi/h, that is

        gravity:    2 sqrt((rho_1 + rho_2) / ((rho_1 - rho_2) g k))
        tension:    sqrt((rho_1 + rho_2) h^3 / (4 pi sigma)),

    the second after J. U. Brackbill, D. B. Kothe, C. Zemach, J. Comput. Phys. 100 (1992) 335-354, eq. 61; of the first
    a part of `WAVE_SHARE` is taken.
    """
    table, fluid = scene.surface, scene.fluid
    if table is None or fluid is None:
        return {}
    h, total = min(spacing), fluid.density + table.density
    pull = (fluid.density - table.density) * math.hypot(*scene.domain.strongest_gravity) * math.pi / h
    waves = WAVE_SHARE * 2.0 * math.sqrt(total / pull) if pull > 0.0 else math.inf
    tension = table.tension
    capillary = math.sqrt(total * h**3 / (4.0 * math.pi * tension)) if tension > 0.0 else math.inf
    return {name: step for name, step in (("surface_waves", waves), ("capillary", capillary)) if step < math.inf}


def fall_speed(scene: Scene, grid: Grid, kept: KeptLiquid | None = None) -> float:
    """Speed of liquid that has fallen from its highest place at the start, or beyond a side that it comes in by, to
    where the surface of that of the start will be at rest, or to the lowest outlet [m/s]: what the automatic fluid step
    has to expect. Liquid that is kept from a run has its energy of motion too, u^2/2. 0 in a scene with one fluid.
    """
    if scene.surface is None:
        return 0.0
    fraction = first_fraction(scene, grid) if kept is None else kept.fraction
    layers, speed = fraction.shape[-1], 0.0 if kept is None else kept.speed
    wet = np.flatnonzero(fraction.reshape(-1, layers).max(axis=0) > 0.5)
    height = grid.size[-1]
    highest = max(height / layers * (wet[-1] + 1) if len(wet) else 0.0, _highest_inflow(scene))
    lowest = min(float(fraction.mean()) * height, _lowest_outflow(scene))
    gravity = math.hypot(*scene.domain.strongest_gravity)
    return math.sqrt(speed**2 + 2.0 * gravity * max(highest - lowest, 0.0))


def _highest_inflow(scene: Scene) -> float:
    """Height that liquid which comes in through the sides falls from: where it comes in, or its level beyond an outlet;
    0 where none does [m]."""
    found = 0.0
    for name in scene.sides:
        side, level, (lower, upper) = scene.boundary[name], scene.boundary[name].level or 0.0, _heights(scene, name)
        if level > lower and side.kind in ("inlet", "outlet"):
            found = max(found, level if side.kind == "outlet" else min(level, upper))
    return found


def _lowest_outflow(scene: Scene) -> float:
    """Lowest height, or level beyond it, of an outlet; infinite without [m]."""
    outlets = [name for name in scene.sides if scene.boundary[name].kind == "outlet"]
    return min((max(scene.boundary[name].level or 0.0, _heights(scene, name)[0]) for name in outlets), default=math.inf)


def _heights(scene: Scene, name: str) -> tuple[float, float]:
    """Of the lower and the upper end of a side or of its patch [m]."""
    side, height, number = scene.boundary[name], scene.domain.size[-1], scene.sides.index(name)
    if number // 2 == scene.dimension - 1:
        return (height, height) if number % 2 else (0.0, 0.0)
    return (side.from_ or (0.0,))[-1], (side.to or (height,))[-1]

"""One frame of a run as a picture: particles as discs of their true radius over the fluid's speed."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from matplotlib.colors import LinearSegmentedColormap

from jaxdem.errors import InputError
from jaxdem.io import Run
from jaxdem.report.force_lines import ForceLines
from jaxdem.report.runs import Array, domain_size
from jaxdem.report.walls import INLET, OUTLET, Opening, Solid, openings, solid

WATER = LinearSegmentedColormap.from_list("water", ["#FFFFFF", "#CFE3F3", "#86B9DE", "#3D86BF", "#0B4A85"])
GRAINS = LinearSegmentedColormap.from_list("grains", ["#2B1408", "#7A3B12", "#C9661B", "#F39A1E", "#FFD23F"])
"""Dark at rest, so that a pack shows on still water, and bright in motion, so that grains show in a jet."""

WALL = LinearSegmentedColormap.from_list("wall", ["#A9AFB700", "#A9AFB7C8"])
"""Not quite opaque: the fluid need not see these walls, and its speed behind them is part of the result then."""
WALL_EDGE = "#2E3338"
OPENINGS = {INLET: "#009E73", OUTLET: "#CC79A7"}

PALE = 0.12
"""Part of the top of the scale that liquid at rest is shown as."""

LONG_BOX = 2.0
"""Runs side by side stand in fewer columns from this ratio of length to height on."""
TALL_BOX = 0.5
"""Times stand side by side up to this ratio of length to height."""

TOP_PERCENTILE = 99.5
"""The top of a scale is this percentile: one stray grain or one cell at an edge does not darken all others."""


class Quantity(NamedTuple):
    """What has a colour: the size of this array of a frame, on a scale from zero."""

    array: str
    label: str
    colors: LinearSegmentedColormap


QUANTITIES = {
    "velocity": Quantity("velocity", "particle speed [m/s]", GRAINS),
    "drag": Quantity("drag_force", "drag force [N]", GRAINS),
}
"""What particles may be coloured by."""
FLUID = Quantity("velocity", "fluid speed [m/s]", WATER)

Tops = dict[str, float]
"""Tops of the colour scales of "fluid" and of `QUANTITIES`, those that the pictures have."""


@dataclass(frozen=True)
class Picture:
    """What one panel shows; (x, vertical) plane.

    Attributes:
        time: of the frame [s].
        centres: (N, 2) [m], those nearest the viewer last; radius: (N,) [m].
        values: (N,) of each of `QUANTITIES` that the frame has.
        speed: fluid speed (nx, nz) [m/s], in 3-D averaged over the depth; None without fluid.
        walls: beside the box's sides; None without.
        openings: where fluid or grains come in or leave.
        forces: in contacts, drawn as lines; None for none.
        liquid: liquid fraction (nx, nz), in 3-D averaged over the depth; None where there is one fluid [-].
    """

    time: float
    centres: Array
    radius: Array
    values: dict[str, Array]
    speed: Array | None
    walls: Solid | None = None
    openings: Sequence[Opening] = ()
    forces: ForceLines | None = None
    liquid: Array | None = None

    @property
    def kinds_of_openings(self) -> list[str]:
        """`INLET` or `OUTLET` of each of the openings, then of each of those of walls."""
        of_walls = () if self.walls is None else self.walls.openings
        return [*(opening.kind for opening in self.openings), *(kind for kind, _ in of_walls)]

    def shown_speed(self, top: float) -> Array | None:
        """Speed (nx, nz) as a picture has it, with this top of its scale [m/s]; None without fluid.

        Of two fluids that of the liquid, whose speed is shown as a part of `PALE` of the top at least: so it stands out
        from the other fluid, which has none.
        """
        if self.speed is None or self.liquid is None:
            return self.speed
        return np.where(self.liquid >= 0.5, np.maximum(self.speed, PALE * top), 0.0)


def nearest(run: Run, time: float, until: float) -> int | None:
    """Number of the frame nearest to `time`; None where the run has none within half an output interval of it.

    Args:
        until: a run that is shown nowhere later than this [s] may use a frame up to half an interval off.
    """
    frames = np.asarray(run.times, dtype=np.float64)[: run.number_of_frames]
    if not len(frames):
        return None
    i = int(np.argmin(np.abs(frames - time)))
    slack = 0.51 * float(np.max(np.diff(frames))) if len(frames) > 1 else 1e-6 + 0.01 * until
    return i if abs(frames[i] - time) <= slack else None


def take_nearest(run: Run, time: float, until: float) -> Picture | None:
    """The frame that `nearest` finds."""
    index = nearest(run, time, until)
    return None if index is None else take(run, index)


def take(run: Run, index: int) -> Picture:
    """Frame `index` as a picture."""
    flow = run.fluid(index)
    particles, speed = _project(_drawn(run, index), run.dimension), _speed(flow, run.dimension)
    box = domain_size(run)
    time = float(run.times[index])
    borders = (solid(run.scene, box, time, run.history, run.path), openings(run.scene, box)) if box else ()
    picture = Picture(time, *particles, speed, *borders)
    if flow is not None and "liquid_fraction" in flow:
        liquid = np.asarray(flow["liquid_fraction"], dtype=np.float64)
        plane = liquid.mean(axis=1) if run.dimension == 3 else liquid.reshape(liquid.shape[0], -1)
        picture = dataclasses.replace(picture, liquid=plane)
    return picture


def _drawn(run: Run, index: int) -> Mapping[str, Array]:
    """The particles of a frame; of clumps their members, each with the values of its body."""
    particles, spheres = run.particles(index) or {}, run.spheres(index) or {}
    if not spheres or spheres.keys() == particles.keys():
        return particles
    names = {quantity.array for quantity in QUANTITIES.values()} & particles.keys()
    return {name: spheres[name] for name in ("position", "radius", "active") if name in spheres} | {
        name: particles[name][spheres["id"]] for name in names
    }


def _project(particles: Mapping[str, Array], dimension: int) -> tuple[Array, Array, dict[str, Array]]:
    position = particles.get("position")
    if position is None or not len(position):
        return np.empty((0, 2)), np.empty(0), {}
    xyz = np.asarray(position, dtype=np.float64)
    radius = np.broadcast_to(np.asarray(particles.get("radius", np.nan), dtype=np.float64), (len(xyz),))
    visible = np.isfinite(xyz).all(axis=1) & np.isfinite(radius) & (particles.get("active", 1) != 0)
    order = np.flatnonzero(visible)
    if dimension == 3:  # the viewer stands at y = 0, in front
        order = order[np.argsort(-xyz[order, 1], kind="stable")]
    values = {
        name: np.linalg.norm(np.asarray(particles[quantity.array], dtype=np.float64)[order], axis=1)
        for name, quantity in QUANTITIES.items()
        if quantity.array in particles
    }
    return xyz[order][:, [0, dimension - 1]], radius[order], values


def _speed(fluid: Mapping[str, Array] | None, dimension: int) -> Array | None:
    if not fluid or fluid.get("velocity") is None:
        return None
    speed: Array = np.linalg.norm(np.asarray(fluid["velocity"], dtype=np.float64), axis=-1)
    plane: Array = speed.mean(axis=1) if dimension == 3 else speed.reshape(speed.shape[0], -1)
    return plane


def view(run: Run, picture: Picture) -> str:
    """How a 3-D run is seen, for a title; empty in 2-D."""
    if run.dimension == 2:
        return ""
    averaged = ["fluid speed"] * (picture.speed is not None) + ["walls"] * (picture.walls is not None)
    return "seen from the front" + (f", {' and '.join(averaged)} averaged over the depth" if averaged else "")


def require(run: Run, quantity: str) -> None:
    """Refuse a run without frames, and a quantity that its particles do not have.

    Raises:
        InputError: naming the run or the quantity.
    """
    if quantity not in QUANTITIES:
        raise InputError("--color", quantity, "is not known", f"Known: {', '.join(QUANTITIES)}.")
    if not run.number_of_frames:
        limit = "has no output that can be read yet"
        raise InputError("RUN", str(run.path), limit, "Wait for its first output, or run the scene again.")
    if quantity == "drag" and (run.fluid(0) is None or not run.particles(0)):
        limit = f"{run.path} has no drag, because it has no particles or no fluid"
        raise InputError("--color", quantity, limit, "Colour by velocity.")


def scale_tops(pictures: Sequence[Picture]) -> Tops:
    """The largest of the pictures' `TOP_PERCENTILE` of the finite values."""
    found: Tops = {}
    for picture in pictures:
        speed = picture.speed
        if speed is not None and picture.liquid is not None:
            speed = speed[picture.liquid >= 0.5]  # the other fluid is faster, and is not shown
        fluid = {} if speed is None else {"fluid": speed}
        for name, values in (fluid | picture.values).items():
            finite = values[np.isfinite(values)]
            top = float(np.percentile(finite, TOP_PERCENTILE)) if finite.size else 0.0
            found[name] = max(found.get(name, 0.0), top)
    return found


def common_tops(runs: Iterable[Sequence[Picture | None]]) -> Tops:
    """One scale for all runs, by the first that has the quantity, which is the reference as a rule.

    So a run that blew up does not hide all others; what is above the scale has its last colour.
    """
    found: Tops = {}
    for pictures in runs:
        own = scale_tops([picture for picture in pictures if picture])
        found = {name: top for name, top in own.items() if top > 0.0} | found
    return found

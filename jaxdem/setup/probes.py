"""The probes of a scene, and when they measure."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np

from jaxdem.errors import InputError, required
from jaxdem.numerics.axes import AXES
from jaxdem.observables.walls import measuring_walls
from jaxdem.probes.base import Probe, Schedule, ScheduledProbe
from jaxdem.probes.contacts import ContactsProbe
from jaxdem.probes.plane import PlaneProbe
from jaxdem.probes.point import PointProbe
from jaxdem.probes.profile import ProfileProbe
from jaxdem.probes.wall import WallProbe
from jaxdem.scene import Scene
from jaxdem.scene import probes as described
from jaxdem.scene.fluid_walls import seen_by_fluid
from jaxdem.scene.probe_places import measured_at, number_of, torque_axes
from jaxdem.setup.walls import surfaces_of
from jaxdem.simulation import Simulation
from jaxdem.structure import Clock, TimeSteps

MOST_NUMBERED = 2**24
"""Whole numbers up to this are exact in float32."""


def scene_probes(
    scene: Scene, steps: TimeSteps, clock: Clock | None = None, particles: int = 0
) -> tuple[ScheduledProbe, ...]:
    """The probes of a scene.

    Args:
        scene: the scene.
        steps: of it.
        clock: from which its intervals are counted; see `Structure`.
        particles: number of all that there ever are.

    Raises:
        InputError: a time of a probe is no multiple of the coupling interval, or its window none of its samples; or the
            numbers of the particles are too large for the contacts in float32.
    """
    for k, probe in enumerate(scene.probes):
        if probe.kind == "contacts" and scene.precision == "float32" and particles > MOST_NUMBERED:
            limit = f"in float32 it can number {MOST_NUMBERED} particles, and the scene has {particles}"
            raise InputError(f"probes.{k}.kind", probe.kind, limit, 'set precision = "float64", or remove the probe')
    return tuple(
        ScheduledProbe(BUILDERS[probe.kind](scene, probe), _schedule(f"probes.{k}", probe, steps.interval, clock))
        for k, probe in enumerate(scene.probes)
    )


def _schedule(key: str, probe: described.Probe, interval: float, clock: Clock | None) -> Schedule:
    start, step = (0.0, 0) if clock is None else (clock.start, clock.step)

    def intervals(name: str, time: float | None, default: int) -> int:
        if time is None:
            return default
        number = round(time / interval)
        if abs(number * interval - time) > 1e-6 * time or (number == 0 and name != "begin"):
            near = max(number, 1) * interval
            limit = f"must be a multiple of the coupling interval, {interval:.6g} s"
            raise InputError(f"{key}.{name}", time, limit, f"use, for example, {near:.6g}")
        return number

    every = intervals("interval", probe.interval, 1)
    window = intervals("window", probe.window, every) if probe.average else 1
    sample = intervals("sample_interval", probe.sample_interval, 1)
    if window % sample:
        limit = f"must divide the time over which is averaged, {window * interval:.6g} s"
        near = max(number for number in range(1, sample) if window % number == 0)
        raise InputError(
            f"{key}.sample_interval", probe.sample_interval, limit, f"use, for example, {near * interval:.6g}"
        )
    begin = None if probe.begin is None else max(probe.begin - start, 0.0)
    return Schedule(step + intervals("begin", begin, 0), every, window, sample)


def _plane(scene: Scene, probe: described.Probe) -> PlaneProbe:
    axes = AXES[scene.dimension]
    has = scene.particles is not None, scene.fluid is not None
    if probe.normal is not None and probe.point is not None:
        size = math.hypot(*probe.normal)
        normal = tuple(component / size for component in probe.normal)
        offset = sum(n * x for n, x in zip(normal, probe.point, strict=True))
        return PlaneProbe(probe.name, axes, None, normal, offset, None, None, True, False)
    axis = axes.index(probe.axis or "")
    normal = tuple(float(k == axis) for k in range(scene.dimension))
    return PlaneProbe(probe.name, axes, axis, normal, probe.at or 0.0, probe.from_, probe.to, *has)


def _profile(scene: Scene, probe: described.Probe) -> ProfileProbe:
    axes, size = AXES[scene.dimension], scene.domain.size
    start, stop = probe.from_ or (0.0,) * len(size), probe.to or size
    lower, upper = [low for low, _ in probe.regions or ()], [high for _, high in probe.regions or ()]
    if probe.axis is not None:
        axis = axes.index(probe.axis)
        edges = probe.edges or tuple(np.linspace(start[axis], stop[axis], (probe.cells or 1) + 1).tolist())
        for low, high in itertools.pairwise(edges):
            lower.append((*start[:axis], low, *start[axis + 1 :]))
            upper.append((*stop[:axis], high, *stop[axis + 1 :]))
    cut = tuple(
        k
        for k, length in enumerate(size)
        if any(low[k] > 0.0 or high[k] < length for low, high in zip(lower, upper, strict=True))
    )
    has = scene.particles is not None, scene.fluid is not None
    return ProfileProbe(probe.name, axes, tuple(lower), tuple(upper), cut, scene.domain.depth or 1.0, *has)


def _point(scene: Scene, probe: described.Probe) -> PointProbe:
    return PointProbe(probe.name, AXES[scene.dimension], probe.points or ())


def _wall(scene: Scene, probe: described.Probe) -> WallProbe:
    axes, turning = AXES[scene.dimension], torque_axes(scene.periodic)
    has = scene.particles is not None, scene.fluid is not None
    if probe.wall is not None:
        number = required(number_of(probe.wall, scene.walls), "wall of the probe")
        before = [surface for wall in scene.walls[:number] for surface in surfaces_of(wall)]
        wall = scene.walls[number]
        own = tuple(range(len(before), len(before) + len(surfaces_of(wall))))
        about = probe.about or wall.point or wall.center or wall.apex or wall.translate or (0.0,) * scene.dimension
        mesh = None
        if wall.kind == "mesh":
            mesh = sum(one.kind == "mesh" for one in scene.walls[:number])
        in_fluid = _surfaces_in_fluid(scene, number)
        given = has[0], bool(in_fluid), wall.moves
        return WallProbe(probe.name, axes, None, own, about, turning, *given, mesh, in_fluid)
    name = probe.side or ""
    axis, upper = scene.box.normal_of(name)
    middle = [0.5 * length for length in scene.domain.size]
    middle[axis] = scene.domain.size[axis] if upper else 0.0
    about, has = probe.about or tuple(middle), measured_at(scene.boundary[name], *has)
    moves = scene.boundary[name].kind == "moving_wall"
    return WallProbe(probe.name, axes, (axis, upper), (), about, turning, *has, moves)


def _surfaces_in_fluid(scene: Scene, number: int) -> tuple[int, ...]:
    """Numbers of the surfaces of a wall among those that the fluid sees."""
    seen = seen_by_fluid(scene.walls)
    owners = [k for k, wall in seen for _ in range(1 if wall.kind == "mesh" else len(surfaces_of(wall)))]
    return tuple(k for k, owner in enumerate(owners) if owner == number)


def with_measured_walls(simulation: Simulation, probes: tuple[ScheduledProbe, ...]) -> Simulation:
    """The simulation that measures the loads on those walls that probes need."""
    found = [one.probe for one in probes if isinstance(one.probe, WallProbe)]
    if not found:
        return simulation
    walls = tuple(wall for probe in found for wall in probe.walls(simulation))
    sides = tuple(2 * probe.side[0] + probe.side[1] for probe in found if probe.with_fluid and probe.side is not None)
    return measuring_walls(simulation, walls, sides)


BUILDERS: dict[str, Callable[[Scene, described.Probe], Probe]] = {
    "plane": _plane,
    "profile": _profile,
    "point": _point,
    "wall": _wall,
    "contacts": lambda scene, probe: ContactsProbe(probe.name, AXES[scene.dimension]),
}
"""By kind, what makes the probe of a scene."""

"""The sides of the box from a scene, and whether a fluid can flow through them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from jaxdem.errors import InputError
from jaxdem.fluid.boundary import Boundary, Side, net_inflow, open_fraction
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.inlet import InletProfile, LinearTable, Parabola
from jaxdem.fluid.openings import Opening
from jaxdem.fluid.side_conditions import SideCondition
from jaxdem.scene import Scene
from jaxdem.scene.boundary import parabolic_axes
from jaxdem.scene.fluid_walls import seen_by_fluid
from jaxdem.setup.drive import bulk_speed
from jaxdem.setup.fluid_surfaces import wall_speed_in_fluid

BALANCED = 1e-5
"""Net inflow over all that comes and goes, up to which a box without an outlet is in balance [-]."""


def scene_boundary(
    scene: Scene,
    profiles: Mapping[str, Sequence[InletProfile | None]] | None,
    conditions: Mapping[str, SideCondition] | None,
) -> Boundary:
    """The sides of the box.

    Args:
        scene: the scene.
        profiles: of inlets in place of the scene's, by the side's name.
        conditions: in place of the scene's kinds, by the side's name.

    Raises:
        InputError: of a profile or condition that does not fit its side.
    """
    profiles, conditions = profiles or {}, conditions or {}
    _check_conditions(scene, conditions)
    _check_profiles(scene, profiles)
    sides = []
    for number, name in enumerate(scene.sides):
        table = scene.boundary[name]
        side = Side(
            axis=number // 2,
            upper=bool(number % 2),
            kind=table.kind,
            start=table.from_,
            stop=table.to,
            ramp_time=(table.ramp_time or 0.0) if table.velocity or table.times else 0.0,
            profile=tuple(profiles[name]) if name in profiles else inlet_profiles(scene, name),
            times=table.times,
            own=conditions.get(name),
        )
        sides.append(side)
    return Boundary(tuple(sides))


def inlet_profiles(scene: Scene, name: str) -> tuple[InletProfile | None, ...] | None:
    """Profile of a side for each of its axes, None where it is even; None if it is so in all."""
    side = scene.boundary[name]
    if side.profile == "parabolic":
        return tuple(Parabola() if zero else None for zero in parabolic_axes(scene.boundary, scene.box, name))
    if side.positions is not None and side.values is not None:
        return (None,) * (scene.dimension - 2) + (LinearTable(side.positions, side.values),)
    return None


def boundary_speed(scene: Scene) -> float:
    """Largest speed that a boundary, or the initial fluid, imposes [m/s]."""
    speeds = [0.0]
    for name, side in scene.boundary.items():
        peak = math.prod(profile.peak for profile in inlet_profiles(scene, name) or () if profile is not None)
        for velocity in (side.velocity, *(side.velocities or ())):
            if isinstance(velocity, tuple):
                speeds.append(peak * math.hypot(*velocity))
    if scene.fluid is not None and scene.fluid.velocity is not None:
        speeds.append(math.hypot(*scene.fluid.velocity))
    if scene.fluid is not None:
        speeds += [bulk_speed(scene.fluid), wall_speed_in_fluid(scene)]
        openings = [one for _, wall in seen_by_fluid(scene.walls) for one in wall.opening or () if one.by_velocity]
        speeds += [abs(velocity) for one in openings for velocity in one.amounts]
    return max(speeds)


def _check_profiles(scene: Scene, profiles: Mapping[str, Sequence[InletProfile | None]]) -> None:
    inlets = [side for side in scene.sides if scene.boundary[side].kind == "inlet"]
    for name, given in profiles.items():
        if name not in inlets:
            raise InputError(
                "inlet_profiles", name, "is not an inlet", f"the inlets are: {', '.join(inlets) or 'none'}"
            )
        if len(given) != scene.dimension - 1:
            raise InputError(
                f"inlet_profiles.{name}",
                len(given),
                f"a side has {scene.dimension - 1} axes",
                "give a profile, or None, for each of them",
            )


def _check_conditions(scene: Scene, conditions: Mapping[str, SideCondition]) -> None:
    ends = [side for number, side in enumerate(scene.sides) if not scene.periodic[number // 2]]
    for name in conditions:
        if name not in ends:
            known = f"sides: {', '.join(ends) or 'none'}"
            raise InputError("side_conditions", name, "is not a side at which the fluid ends", known)
        if scene.boundary[name].from_ is not None:
            limit = "a condition of the user holds on the whole side, and this side has a patch"
            raise InputError(f"boundary.{name}.from", scene.boundary[name].from_, limit, "remove from and to")


def check_flow(scene: Scene, grid: Grid, boundary: Boundary, openings: Sequence[Opening] = ()) -> None:
    """Refuses sides that no incompressible fluid can flow through. With `openings` of walls see also
    `openings.check_balance`.

    Raises:
        InputError: an outlet that no face of the mesh is open at; more comes in than goes out without an outlet;
            particles come in without one.
    """
    for name, side in zip(scene.sides, boundary.sides, strict=True):
        if side.condition.sets_pressure and not open_fraction(grid, side).any():
            raise InputError(
                f"boundary.{name}.from",
                scene.boundary[name].from_,
                "the outlet covers less than half of every face of this mesh, and a face is open or closed as a whole",
                "widen the outlet to at least one cell, or use smaller cells",
            )
    if boundary.has_outlet or any(side.own is not None for side in boundary.sides):
        return
    if any(one.given == "nothing" for one in openings):
        return
    if scene.particles is not None and scene.particles.inlet:
        raise InputError(
            "particles.inlet",
            f"{len(scene.particles.inlet)} inlet(s)",
            "entering particles displace fluid, and no side lets fluid out",
            'make a side an outlet: boundary.<side>.kind = "outlet"',
        )
    if openings:
        return
    for time, net, gross in inflow_of_sides(scene, grid, boundary):
        if abs(net) > BALANCED * gross:
            key = next(name for name in scene.sides if scene.boundary[name].kind == "inlet")
            raise imbalance(
                f"boundary.{key}.velocity", net, time, 'make a side an outlet (boundary.<side>.kind = "outlet")'
            )


def inflow_of_sides(
    scene: Scene, grid: Grid, boundary: Boundary, further: Iterable[float] = ()
) -> Iterator[tuple[float, float, float]]:
    """What comes in through the sides at times of the run, see `net_inflow`: the time, net and gross.

    The times are such that the net of ramps times tables that are linear between their times is zero at all times if it
    is zero at these: at three points of every piece. `further` are bends of what comes in elsewhere [s].
    """
    sides = [scene.boundary[name] for name in scene.sides]
    velocities = [np.asarray(one.velocities or one.velocity or (0.0,) * scene.dimension) for one in sides]
    bends = {0.0, scene.time.end, *(one.ramp_time or 0.0 for one in sides), *further}
    bends.update(time for one in sides for time in one.times or ())
    ends = sorted(time for time in bends if 0.0 <= time <= scene.time.end)
    middles = [0.5 * (a + b) for a, b in itertools.pairwise(ends)]
    for time in sorted((*ends, *middles)):
        yield time, *net_inflow(grid, boundary, velocities, time)


def imbalance(key: str, net: float, time: float, remedy: str) -> InputError:
    """The refusal of an inflow that exceeds the outflow at a time in a box without an outlet."""
    return InputError(
        key,
        f"the inflow exceeds the outflow by {net:.4g} m3/s at t = {time:g} s",
        "an incompressible fluid without an outlet needs equal inflow and outflow",
        f"{remedy}, or let the inlets remove as much as they bring",
    )

"""Whether the probes of a scene fit its box, its walls and its time."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from jaxdem.errors import InputError
from jaxdem.numerics.axes import AXES
from jaxdem.scene.base import nearest
from jaxdem.scene.boundary import BoundarySide
from jaxdem.scene.domain import Box
from jaxdem.scene.probes import CLOSED, MEANS, Probe, is_file_name
from jaxdem.scene.walls import Wall


@dataclass(frozen=True)
class ProbePlace:
    """What probes are checked against.

    Attributes:
        box: of the scene.
        end: of the run [s].
        output_interval: of the run [s].
        with_particles, with_fluid: what the scene has.
        walls: of the scene.
        boundary: sides of the box by name.
        every_wall: whether each of the walls has a probe.
    """

    box: Box
    end: float
    output_interval: float
    with_particles: bool
    with_fluid: bool
    walls: tuple[Wall, ...]
    boundary: Mapping[str, BoundarySide]
    every_wall: bool = False

    @property
    def axes(self) -> str:
        """Names of the axes."""
        return AXES[len(self.box.size)]


def completed_probes(probes: tuple[Probe, ...], place: ProbePlace) -> tuple[Probe, ...]:
    """The probes with their interval and average written in, checked.

    Raises:
        InputError: two have one name, or one does not fit the box or the time.
    """
    result, names = [], set[str]()
    for k, probe in enumerate(_with_every_wall(probes, place) if place.every_wall else probes):
        key = f"probes.{k}"
        # Some file systems do not tell capital letters from small ones.
        if probe.name.lower() in names:
            raise InputError(f"{key}.name", probe.name, "is the name of another probe", "give each its own name")
        names.add(probe.name.lower())
        PLACES[probe.kind](key, probe, place)
        result.append(_timed(key, probe, place))
    return tuple(result)


def _with_every_wall(probes: tuple[Probe, ...], place: ProbePlace) -> tuple[Probe, ...]:
    """The probes, and one of every wall that none of them measures."""
    measured = {number_of(probe.wall, place.walls) for probe in probes if probe.wall is not None}
    taken = {probe.name.lower() for probe in probes}
    added = []
    for number, wall in enumerate(place.walls):
        if number not in measured:
            own = wall.name if wall.name is not None and is_file_name(wall.name) else ""
            name = own if own and own.lower() not in taken else f"wall_{number}"
            if name.lower() in taken:
                limit = f"walls.{number} gets a probe of the name {name}, which another probe has"
                raise InputError("output.walls", True, limit, f"give walls.{number} a name, or a probe of kind wall")
            taken.add(name.lower())
            added.append(Probe(name=name, kind="wall", wall=number))
    return (*probes, *added)


def _timed(key: str, probe: Probe, place: ProbePlace) -> Probe:
    """The probe with its interval, checked against the end of the run."""
    interval = place.output_interval if probe.interval is None else probe.interval
    if probe.begin + interval > place.end * (1.0 + 1e-9):
        name = "begin" if probe.interval is None else "interval"
        limit = f"the first row would be at begin + interval = {probe.begin + interval:g} s, after the end of the run"
        raise InputError(f"{key}.{name}", getattr(probe, name), f"{limit}, time.end = {place.end:g} s", "lower it")
    for name in ("window", "sample_interval"):
        value = getattr(probe, name)
        if value is not None and value > interval * (1.0 + 1e-9):
            raise InputError(f"{key}.{name}", value, f"is more than the interval of {interval:g} s", "lower it")
    average = probe.kind in MEANS if probe.average is None else probe.average
    return probe.model_copy(update={"interval": interval, "average": average})


def _axis(key: str, probe: Probe, place: ProbePlace) -> int:
    name = probe.axis or ""
    if name not in place.axes:
        raise InputError(f"{key}.axis", name, "the box has no such axis", nearest(name, place.axes))
    return place.axes.index(name)


def _check_plane(key: str, probe: Probe, place: ProbePlace) -> None:
    if probe.normal is not None:
        if not place.with_particles:
            raise InputError(f"{key}.normal", probe.normal, "needs particles", "give axis and at")
        place.box.check_same_along_periodic_axes(f"{key}.normal", probe.normal)
        _check_inside(f"{key}.point", probe.point or (), place.box.size)
        return
    axis = _axis(key, probe, place)
    length = place.box.size[axis]
    if probe.at is None or not 0.0 <= probe.at <= length:
        raise InputError(f"{key}.at", probe.at, f"the plane must lie in the box, between 0 and {length:g} m", "move it")
    if probe.from_ is not None and probe.to is not None:
        others = [side for k, side in enumerate(place.box.size) if k != axis]
        check_corners((f"{key}.from", f"{key}.to"), probe.from_, probe.to, others)


def _check_profile(key: str, probe: Probe, place: ProbePlace) -> None:
    size = place.box.size
    for k, (lower, upper) in enumerate(probe.regions or ()):
        check_corners((f"{key}.regions.{k}.0", f"{key}.regions.{k}.1"), lower, upper, list(size))
    if probe.axis is None:
        return
    axis = _axis(key, probe, place)
    if probe.from_ is not None and probe.to is not None:
        check_corners((f"{key}.from", f"{key}.to"), probe.from_, probe.to, list(size))
    edges = probe.edges or ()
    if any(b <= a for a, b in itertools.pairwise(edges)):
        raise InputError(f"{key}.edges", edges, "must increase", "sort them")
    if edges:
        low = 0.0 if probe.from_ is None else probe.from_[axis]
        high = size[axis] if probe.to is None else probe.to[axis]
        if edges[0] < low or edges[-1] > high:
            limit = f"must lie between {low:g} and {high:g} m"
            raise InputError(f"{key}.edges", edges, limit, "move them")


def _check_point(key: str, probe: Probe, place: ProbePlace) -> None:
    if not place.with_fluid:
        raise InputError(f"{key}.kind", probe.kind, "measures the fluid, and the scene has none", "remove the probe")
    for k, point in enumerate(probe.points or ()):
        _check_inside(f"{key}.points.{k}", point, place.box.size)


def _check_contacts(key: str, probe: Probe, place: ProbePlace) -> None:
    if not place.with_particles:
        raise InputError(f"{key}.kind", probe.kind, "needs particles, and the scene has none", "remove the probe")


def _check_wall(key: str, probe: Probe, place: ProbePlace) -> None:
    if (probe.side is None) == (probe.wall is None):
        raise InputError(
            f"{key}.side", probe.side, "a probe of kind wall needs either side or wall", "give one of them"
        )
    if probe.wall is not None and number_of(probe.wall, place.walls) is None:
        number, names = len(place.walls), [wall.name for wall in place.walls if wall.name is not None]
        limit = f"the scene has {number} tables [[walls]]" + (f", numbered 0 to {number - 1}" if number else "")
        if isinstance(probe.wall, str):
            limit = f"no wall has this name; named are {', '.join(names) or 'none'}"
        raise InputError(f"{key}.wall", probe.wall, limit, "give the name or the number of one of them, or a side")
    if probe.side is not None:
        _check_side(f"{key}.side", probe.side, place)
    if probe.about is not None and not torque_axes(place.box.periodic):
        limit = "there is no torque to measure: it needs axes across it that are not periodic"
        raise InputError(f"{key}.about", probe.about, limit, "remove this key")


def number_of(wall: int | str, walls: tuple[Wall, ...]) -> int | None:
    """Number of the wall of a scene that has a name, or is known by its number; None where there is none."""
    if isinstance(wall, str):
        return next((k for k, one in enumerate(walls) if one.name == wall), None)
    return wall if wall < len(walls) else None


def _check_side(key: str, side: str, place: ProbePlace) -> None:
    sides = place.box.sides
    if side not in sides:
        raise InputError(key, side, "the box has no such side", f"sides: {', '.join(sides)}")
    if place.box.periodic[place.box.normal_of(side)[0]]:
        raise InputError(key, side, "is periodic, and no wall", "choose another side")
    if not any(measured_at(place.boundary[side], place.with_particles, place.with_fluid)):
        limit = "is no wall: the fluid passes through it, and no particle touches it"
        raise InputError(key, side, limit, "choose another side, or a probe of kind plane")


def measured_at(side: BoundarySide, with_particles: bool, with_fluid: bool) -> tuple[bool, bool]:
    """Whether the forces of particles and of the fluid on a side are measured, in a scene that has these."""
    return with_particles and side.particles == "screen", with_fluid and side.kind in CLOSED


def torque_axes(periodic: tuple[bool, ...]) -> tuple[int, ...]:
    """Components of a torque whose arms do not lie along a periodic axis; see `observables.wall_load`."""
    if len(periodic) == 2:
        return () if any(periodic) else (0,)
    return tuple(k for k in range(3) if not any(wraps for axis, wraps in enumerate(periodic) if axis != k))


def check_corners(
    keys: tuple[str, str], lower: tuple[float, ...], upper: tuple[float, ...], lengths: list[float]
) -> None:
    """Refuses two corners that enclose nothing, or lie outside.

    Args:
        keys: of the two corners.
        lower, upper: the corners [m].
        lengths: of the box, along the axes of the corners [m].

    Raises:
        InputError: they do.
    """
    for key, corner in zip(keys, (lower, upper), strict=True):
        if len(corner) != len(lengths):
            limit = f"needs {len(lengths)} number{'s' if len(lengths) > 1 else ''}, got {len(corner)}"
            raise InputError(key, corner, limit, "give one for each of these axes")
        _check_inside(key, corner, lengths)
    if not all(low < high for low, high in zip(lower, upper, strict=True)):
        raise InputError(keys[1], upper, f"must be above {keys[0]} = {lower} in every axis", "exchange them")


def _check_inside(key: str, point: tuple[float, ...], lengths: tuple[float, ...] | list[float]) -> None:
    if not all(0.0 <= x <= length for x, length in zip(point, lengths, strict=True)):
        raise InputError(key, point, f"must lie in the box, which ends at {tuple(lengths)} m", "move it")


PLACES: dict[str, Callable[[str, Probe, ProbePlace], None]] = {
    "plane": _check_plane,
    "profile": _check_profile,
    "point": _check_point,
    "wall": _check_wall,
    "contacts": _check_contacts,
}
"""Check of each kind: key, probe, place."""

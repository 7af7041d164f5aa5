"""Particles that come and go: where inlets of a scene lie, and where particles may leave."""

from __future__ import annotations

from collections.abc import Mapping

from jaxdem.errors import InputError
from jaxdem.scene.boundary import BoundarySide
from jaxdem.scene.domain import Box
from jaxdem.scene.inlets import ParticleInlet
from jaxdem.scene.particles import Particles, largest_arrival, outer_factor

Region = tuple[tuple[float, ...], tuple[float, ...]]


def completed_inlets(particles: Particles, box: Box, end: float) -> tuple[ParticleInlet, ...]:
    """The inlets with their region, velocity and end [s] written in, checked.

    Raises:
        InputError: a key does not fit the box or the time.
    """
    result = []
    for k, inlet in enumerate(particles.inlet):
        key = f"particles.inlet.{k}"
        largest = outer_factor(particles, len(box.size)) * largest_arrival(particles, inlet)
        is_box = inlet.region is None or inlet.region.shape == "box"
        corners = _region(key, inlet, box, largest) if is_box else None
        velocity = _velocity(key, inlet, box)
        last = end if inlet.end is None else inlet.end
        if last <= inlet.begin:
            raise InputError(f"{key}.end", last, f"must be after begin = {inlet.begin} s", "raise the end")
        found: dict[str, object] = {"velocity": velocity, "end": last}
        if corners is not None:
            _check_room(f"{key}.stop" if inlet.region is None else f"{key}.region", corners, box.size, largest)
            found |= {"start": corners[0], "stop": corners[1], "region": None}
            found |= {"side": None, "from_": None, "to": None}
        result.append(inlet.model_copy(update=found))
    return tuple(result)


def _region(key: str, inlet: ParticleInlet, box: Box, largest: float) -> Region:
    """Corners of the box in which the particles come in."""
    if inlet.region is not None and inlet.region.start is not None and inlet.region.stop is not None:
        return inlet.region.start, inlet.region.stop
    if inlet.start is not None and inlet.stop is not None:
        return inlet.start, inlet.stop
    side = inlet.side or ""
    if side not in box.sides:
        raise InputError(f"{key}.side", side, "there is no such side", f"known: {', '.join(box.sides)}")
    normal, upper = box.normal_of(side)
    if box.periodic[normal]:
        raise InputError(f"{key}.side", side, "is a periodic side", "give start and stop of a box")
    lower, higher = [0.0] * len(box.size), list(box.size)
    if inlet.from_ is not None and inlet.to is not None:
        along = box.along(side)
        if len(inlet.from_) != len(along) or len(inlet.to) != len(along):
            raise InputError(f"{key}.from", inlet.from_, f"from and to need {len(along)} number(s)", "correct them")
        for axis, first, last in zip(along, inlet.from_, inlet.to, strict=True):
            lower[axis], higher[axis] = first, last
    # Room for rounding: a layer of exactly one diameter might not hold it.
    if upper:
        lower[normal] = box.size[normal] - 2.001 * largest
    else:
        higher[normal] = 2.001 * largest
    return tuple(lower), tuple(higher)


def _check_room(key: str, region: Region, size: tuple[float, ...], largest: float) -> None:
    for low, high, length in zip(*region, size, strict=True):
        if not (low >= 0.0 and high <= length):
            raise InputError(key, region, "the inlet must lie inside the box", "move the inlet")
        if high - low < 2.0 * largest:
            limit = f"holds no particle of radius {largest:.4g} m: it needs {2 * largest:.4g} m along every axis"
            raise InputError(key, region, limit, "enlarge the inlet, or use smaller particles")


def _velocity(key: str, inlet: ParticleInlet, box: Box) -> tuple[float, ...]:
    velocity = inlet.velocity
    if inlet.side is None:
        return velocity if isinstance(velocity, tuple) else (velocity,)
    vector = velocity if isinstance(velocity, tuple) else box.inward(inlet.side, velocity)
    normal, upper = box.normal_of(inlet.side)
    if vector[normal] >= 0.0 if upper else vector[normal] <= 0.0:
        limit = f"does not point into the box at side {inlet.side}"
        raise InputError(f"{key}.velocity", vector, limit, "reverse its direction")
    return vector


def check_exits(boundary: Mapping[str, BoundarySide], with_particles: bool, with_fluid: bool) -> None:
    """Refuses to remove particles where that is not built or means nothing."""
    stays = 'set it to "screen"'
    for name, side in boundary.items():
        reason, remedy = None, stays
        if side.particles == "screen":
            continue
        if not with_particles:
            reason, remedy = "needs [particles]", f"{stays}, or add [particles]"
        elif side.kind == "periodic":
            reason = "particles cannot leave through a periodic side"
            remedy = f"{stays}, or give both sides of this axis another kind"
        elif with_fluid and side.kind != "outlet":
            reason = f"with a fluid, particles can leave only through an outlet, and this side is {side.kind}"
            remedy = (
                f'{stays}, or make the side an outlet (kind = "outlet"), out of which the fluid flows too; in a later '
                f"stage start.remove takes particles out of a region"
            )
        elif side.from_ is not None:
            reason = "particles can leave only through a whole side, and this outlet is a patch"
            remedy = f"{stays}, or remove from and to, so that the outlet is the whole side"
        if reason is not None:
            raise InputError(f"boundary.{name}.particles", side.particles, reason, remedy)

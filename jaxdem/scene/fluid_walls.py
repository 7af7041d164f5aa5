"""Walls that the fluid sees, `[[walls]] fluid`: what they cannot do. Each refusal names the key."""

from __future__ import annotations

import math

from jaxdem.errors import InputError
from jaxdem.scene.coupling import Coupling
from jaxdem.scene.fluid import Fluid
from jaxdem.scene.wall_motion import WallMotion
from jaxdem.scene.walls import Wall

PARALLEL = 1e-9
"""Sine of the angle up to which two directions are taken for parallel."""


def seen_by_fluid(walls: tuple[Wall, ...]) -> list[tuple[int, Wall]]:
    """Number and table of the walls that the fluid sees."""
    return [(number, wall) for number, wall in enumerate(walls) if wall.seen_by_fluid]


def check_fluid_walls(walls: tuple[Wall, ...], fluid: Fluid | None, coupling: Coupling | None) -> None:
    """Refuses walls that the fluid cannot see, and what does not work beside them.

    Args:
        walls: of the scene.
        fluid: its table; None without a fluid.
        coupling: its table; None unless there are particles and a fluid.

    Raises:
        InputError: naming key and remedy.
    """
    seen = seen_by_fluid(walls)
    for number, wall in seen:
        key = f"walls.{number}.fluid"
        if fluid is None:
            raise InputError(key, wall.fluid, "the scene has no fluid", "remove this key, or add [fluid]")
        if wall.piston is not None and coupling is None:
            limit = "a piston that the fluid sees is part of the motion of the particles, and the scene has none"
            raise InputError(f"walls.{number}.piston", "...", limit, "add [particles], or give the wall a motion")
    if seen and fluid is not None:
        _check_models(fluid, coupling)


def check_openings(walls: tuple[Wall, ...], two_fluids: bool, carries: str) -> None:
    """Refuses openings of walls that cannot have any, and parts of the scene that do not know of them.

    Args:
        walls: of the scene.
        two_fluids: whether there is a second fluid.
        carries: table of what the fluid carries; empty for nothing.

    Raises:
        InputError: naming key and remedy.
    """
    for number, wall in enumerate(walls):
        if wall.opening is None:
            continue
        key = f"walls.{number}"
        if not wall.seen_by_fluid:
            limit = "is one for the fluid, which does not see this wall"
            raise InputError(f"{key}.opening", "...", limit, 'set fluid = "no_slip", or remove it')
        for name in ("piston", "begin", "end"):
            if getattr(wall, name) is not None:
                limit = "does not go together with an opening of the wall"
                remedy = "remove it, or put the opening into a wall of its own"
                raise InputError(f"{key}.{name}", "...", limit, remedy)
        if two_fluids:
            limit = "does not go together with openings of walls (walls.opening): nothing says which fluid comes in"
            raise InputError("surface", "...", limit, "take an inlet or outlet on a side of the box")
        changing = [k for k, other in enumerate(walls) if other.seen_by_fluid and _changes_place(other)]
        if carries and changing:
            limit = f"changes the cells of the fluid; beside openings (walls.{number}.opening) that carries nothing"
            remedy = f"remove [{carries}], or let all walls keep their place"
            raise InputError(f"walls.{changing[0]}", "...", limit, remedy)


def _changes_place(wall: Wall) -> bool:
    return (wall.moves and not keeps_place(wall)) or wall.begin is not None or wall.end is not None


def keeps_place(wall: Wall) -> bool:
    """Whether the surface of a wall stays where it is while the wall moves: a plane that moves in its own directions or
    turns about its normal, a cylinder about or along its axis, a wedge along its edge. Never a mesh's or a piston's."""
    return (
        wall.kind != "mesh" and wall.piston is None and all(_along_itself(wall, motion) for motion in wall.motion or ())
    )


def _along_itself(wall: Wall, motion: WallMotion) -> bool:
    if not motion.turns:
        way = motion.velocity or motion.direction or ()
        if wall.kind == "plane":
            return abs(_cosine(way, wall.normal or ())) < PARALLEL
        if wall.kind == "cylinder":
            return wall.axis is not None and _sine(way, wall.axis) < PARALLEL
        return all(abs(_cosine(way, _across(wall, k))) < PARALLEL for k in (0, 1))
    axis = motion.axis or wall.axis
    if wall.kind == "plane":
        return axis is not None and _sine(axis, wall.normal or ()) < PARALLEL
    if wall.kind != "cylinder" or wall.center is None:
        return False
    apart = tuple(a - b for a, b in zip(motion.center or wall.center, wall.center, strict=True))
    on_axis = math.hypot(*apart) <= PARALLEL * (wall.radius or 0.0)
    if wall.axis is None:
        return on_axis
    parallel = axis is not None and _sine(axis, wall.axis) < PARALLEL
    return parallel and (on_axis or _sine(apart, wall.axis) < PARALLEL)


def _across(wall: Wall, which: int) -> tuple[float, ...]:
    """Normal of a plane of a wedge: the part of the other direction across its own."""
    first, second = wall.directions or ((), ())
    a, b = (first, second) if which == 0 else (second, first)
    along = sum(x * y for x, y in zip(a, b, strict=True)) / sum(x * x for x in a)
    return tuple(y - along * x for x, y in zip(a, b, strict=True))


def _cosine(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    size = math.hypot(*a) * math.hypot(*b)
    return sum(x * y for x, y in zip(a, b, strict=True)) / size if size > 0.0 else 0.0


def _sine(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    return math.sqrt(max(0.0, 1.0 - _cosine(a, b) ** 2)) if abs(_cosine(a, b)) < 1.0 - 1e-15 else 0.0


def _check_models(fluid: Fluid, coupling: Coupling | None) -> None:
    """Refuses models that do not know of surfaces."""
    given: dict[str, tuple[object, str]] = {
        "fluid.subgrid": (fluid.subgrid, "it was learned from whole cells, and knows no part of one"),
        "fluid.bed_mixing": (fluid.bed_mixing, "its mixing length counts heights from the lower side of the box alone"),
    }
    if coupling is not None:
        coarse = coupling.drag_inputs_coarsened if coupling.drag_inputs_coarsened > 1 else None
        given |= {
            "coupling.deconvolution": (
                coupling.deconvolution or None,
                "its limit of stability is known for the kernels of whole cells alone",
            ),
            "coupling.drag_inputs_coarsened": (coarse, "its blocks of cells count closed cells as open ones"),
        }
    for key, (value, why) in given.items():
        if value is not None:
            limit = f"does not work beside a wall that the fluid sees: {why}"
            raise InputError(key, value, limit, 'leave it out, or set fluid = "none" for all walls')

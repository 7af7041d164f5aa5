"""Two fluids beside walls that the fluid sees: what they cannot do. Each refusal names the key."""

from __future__ import annotations

from jaxdem.errors import InputError
from jaxdem.scene.fluid_walls import seen_by_fluid
from jaxdem.scene.surface import Surface
from jaxdem.scene.walls import Wall


def check_surface_beside_walls(
    surface: Surface | None, walls: tuple[Wall, ...], has_heat: bool, has_scalars: bool
) -> None:
    """Refuses what does not go together with a second fluid and walls that the fluid sees.

    Args:
        surface: the table; None without.
        walls: of the scene.
        has_heat: whether it has temperatures.
        has_scalars: whether something is dissolved.

    Raises:
        InputError: naming key and remedy.
    """
    seen = seen_by_fluid(walls)
    if surface is None or not seen:
        return
    given: dict[str, tuple[object, str]] = {
        "surface.tension": (surface.tension or None, "its curvature is that of whole cells"),
        "heat": ("..." if has_heat else None, "two fluids carry heat between whole cells"),
        "scalars": ("..." if has_scalars else None, "two fluids carry what is dissolved between whole cells"),
    }
    for number, wall in seen:
        moves = "the transport of the surface is between walls at rest"
        given |= {
            f"walls.{number}.motion": ("..." if wall.motion else None, moves),
            f"walls.{number}.piston": ("..." if wall.piston is not None else None, moves),
            f"walls.{number}.begin": (wall.begin or None, moves),
            f"walls.{number}.end": (wall.end or None, moves),
        }
    for key, (value, why) in given.items():
        if value is not None:
            limit = f"does not go together with [surface] and a wall that the fluid sees: {why}"
            raise InputError(key, value, limit, 'leave it out, or set fluid = "none" for all walls')

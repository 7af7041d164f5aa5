"""The walls beside the sides of the box: surfaces of the scene, and functions of the user."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from jax import Array

from jaxdem.particles.surfaces import Cylinder, DistanceFunction, Plane, Surface, wedge
from jaxdem.scene import Scene
from jaxdem.scene.walls import Wall


def surfaces_of(wall: Wall) -> tuple[Surface, ...]:
    """The surfaces of a wall of the scene: two of a wedge, none of a mesh, else one."""
    if wall.kind == "mesh":
        return ()
    if wall.point is not None and wall.normal is not None:
        return (Plane(wall.point, wall.normal),)
    if wall.center is not None and wall.radius is not None:
        return (Cylinder(wall.center, wall.radius, wall.axis, wall.inside is not False),)
    return wedge(wall.apex or (), wall.directions or ())


def scene_surfaces(scene: Scene, functions: Sequence[Callable[[Array], Array]]) -> tuple[Surface, ...]:
    """The walls of the scene, then those given as functions.

    Args:
        scene: the scene.
        functions: signed distances, looked at by `wall_functions`.
    """
    surfaces = [surface for wall in scene.walls for surface in surfaces_of(wall)]
    return (*surfaces, *map(DistanceFunction, functions))


def wall_keys(scene: Scene) -> list[tuple[str, str]]:
    """Key and kind of the wall of the scene that each of its surfaces belongs to."""
    return [(f"walls.{k}", wall.kind) for k, wall in enumerate(scene.walls) for _ in surfaces_of(wall)]

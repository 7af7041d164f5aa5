"""What a program of the user may give to `jaxdem.build`, `jaxdem.simulate` and their like: another kind is refused
before any work.

Without that a law given by its name, say, is found hours later, or as an error deep inside of a compiled step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import cast

from jaxdem.coupling.forces.protocol import FluidForce
from jaxdem.errors import InputError, require_kinds
from jaxdem.scene import Scene
from jaxdem.scene.stages import StagedScene
from jaxdem.setup.extensions import Extensions
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters


def _is_law(value: object) -> bool:
    return callable(value) and not isinstance(value, type)


def _is_profile(value: object) -> bool:
    return value is None or _has(value, "peak", "integral")


def _is_condition(value: object) -> bool:
    return _has(value, "sets_pressure", "normal", "ghosts")


def _has(value: object, *names: str) -> bool:
    return not isinstance(value, type) and all(hasattr(value, name) for name in names)


def _all_are(test: Callable[[object], bool]) -> Callable[[object], bool]:
    return lambda value: isinstance(value, Sequence) and not isinstance(value, str) and all(map(test, value))


def _each_is(test: Callable[[object], bool]) -> Callable[[object], bool]:
    return lambda value: isinstance(value, Mapping) and all(map(test, value.values()))


_WANTED: dict[str, tuple[Callable[[object], bool], str, str]] = {
    "closure": (
        _is_law,
        "is no drag law",
        "give an object: jaxdem.closures.drag_law(NAME), or jaxdem.closures.load_closure(FILE)[0] for a learned one",
    ),
    "subgrid": (_is_law, "is no subgrid closure", "give an object, for a file jaxdem.closures.load_subgrid(FILE)[0]"),
    "contact_law": (
        _is_law,
        "is no contact law",
        "give an object such as jaxdem.particles.contact.HertzMindlin(), or name it in the scene: contact.law",
    ),
    "cohesion": (
        lambda value: _is_law(value) and _has(value, "memory", "sudden", "reach"),
        "is no kind of cohesion",
        "give an object as in examples/extending/cohesion.py, or name it in the scene: contact.cohesion.kind",
    ),
    "nusselt": (_is_law, "is no law of heat transfer", "give a function, or name the law in the scene: heat.exchange"),
    "walls": (
        _all_are(_is_law),
        "is no list of functions of a point",
        "give a list with the signed distance of each wall, as walls=[distance]",
    ),
    "forces": (
        _all_are(lambda value: isinstance(value, FluidForce)),
        "is no list of forces of the fluid",
        "give a list of objects whose class derives from FluidForce, as in examples/extending/force.py",
    ),
    "inlet_profiles": (
        _each_is(_all_are(_is_profile)),
        "is no table of profiles",
        "give for each inlet a list with a profile or None for each axis of the side, as {'bottom': [profile]}",
    ),
    "side_conditions": (
        _each_is(_is_condition),
        "is no table of conditions",
        "give an object with sets_pressure, normal and ghosts for each side, as {'right': condition}",
    ),
}
"""The test of each argument, what a value is that fails, and the remedy."""


_READ_BY: dict[str, tuple[str, ...]] = {
    "closure": ("fluid", "particles"),
    "forces": ("fluid", "particles"),
    "subgrid": ("fluid",),
    "inlet_profiles": ("fluid",),
    "side_conditions": ("fluid",),
    "walls": ("particles",),
    "contact_law": ("particles",),
    "cohesion": ("particles",),
}
"""Tables that a scene has where something reads the argument; the others are judged beside what reads them."""


def require_scene(scene: object) -> None:
    """Refuses what is no scene, such as the path of one.

    Raises:
        InputError: it is none.
    """
    if not isinstance(scene, Scene):
        shown = scene if isinstance(scene, str) else type(scene).__name__
        raise InputError("scene", shown, "is no scene", "give what jaxdem.load_scene makes of a file or of its tables")


def require_one_stage(scene: object) -> None:
    """Refuses what is no scene, and a scene with stages where only one of them can be meant.

    Raises:
        InputError: it is none, or has stages.
    """
    require_scene(scene)
    if isinstance(scene, StagedScene):
        names = ", ".join(stage.name for stage in scene.stages)
        limit = "are scenes of their own, and one is needed here"
        remedy = "give one of them, such as scene.stages[0].scene; jaxdem.simulate runs all"
        raise InputError("stages", names, limit, remedy)


def require_built(simulation: object, parameters: object) -> None:
    """Refuses what `jaxdem.build` does not make, such as both in the wrong order.

    Raises:
        InputError: one is of another kind.
    """
    remedy = "give both as jaxdem.build makes them: simulation, parameters"
    require_kinds(remedy, simulation=(simulation, Simulation), parameters=(parameters, Parameters))


def parts_given(closure: object, extensions: Mapping[str, object]) -> Extensions:
    """The parts of the user that are given, each of a kind that can work.

    Raises:
        InputError: a part is of another kind.
        TypeError: an extension of another name; Python checks no keyword that is caught by `**`.
    """
    for name in extensions.keys() - Extensions.__annotations__.keys():
        known = ", ".join(("closure", *Extensions.__annotations__))
        raise TypeError(f"build() got an unexpected keyword argument {name!r}; known: {known}")
    given = {name: part for name, part in extensions.items() if part is not None}
    of_all = given if closure is None else {"closure": closure, **given}
    for name, part in of_all.items():
        fits, limit, remedy = _WANTED[name]
        if not fits(part):
            raise InputError(name, part, limit, remedy)
    return cast(Extensions, given)


def lacking(scene: Scene, given: Mapping[str, object]) -> dict[str, str]:
    """The tables that are not there of each part that nothing in a scene reads, such as a drag law for dry grains.

    Args:
        scene: the scene.
        given: parts of the user by their names, the closure among them.
    """
    missing = {
        name: " and ".join(f"[{table}]" for table in _READ_BY.get(name, ()) if getattr(scene, table) is None)
        for name, part in given.items()
        if part
    }
    return {name: tables for name, tables in missing.items() if tables}


def require_read(scene: Scene, closure: object, given: Mapping[str, object]) -> None:
    """Refuses what nothing in the scene reads.

    Args:
        scene: the scene.
        closure: drag law; None without.
        given: see `parts_given`.

    Raises:
        InputError: a part needs a table that the scene has not.
    """
    for name, tables in lacking(scene, {"closure": closure, **given}).items():
        limit = f"needs {tables}, which the scene has not"
        raise InputError(name, "given", limit, "leave it out, or add what is missing")

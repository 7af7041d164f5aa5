"""Scenes in stages: tables that are laid one after the other over a scene, or one scene file after the other."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

from pydantic import Field

from jaxdem.errors import InputError
from jaxdem.scene.checked import scene_of_tables
from jaxdem.scene.scene import Scene

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+=-]{0,99}")
"""What names a folder on every system."""

OF_ONE_STAGE = ("name", "start")
"""Keys of a stage that do not hold for those after it."""


class Stage(NamedTuple):
    """One of several scenes that follow each other.

    Attributes:
        name: of its run directory, in that of the whole.
        scene: what runs.
    """

    name: str
    scene: Scene


class StagedScene(Scene):
    """A scene with `[[stages]]`. Its own keys are those of the first stage.

    Attributes:
        stages: all of them in order, the first included.
    """

    stages: tuple[Stage, ...] = Field(exclude=True)


class Layer(NamedTuple):
    """Tables of a stage, before they are checked.

    Attributes:
        name: of the stage.
        tables: of its scene.
        own: those that the stage gives itself; None where it is a file of its own.
    """

    name: str
    tables: dict[str, Any]
    own: Mapping[str, Any] | None


def layers_of(tables: Mapping[str, Any]) -> list[Layer]:
    """The tables of every stage of a scene: those of the stage before with its own laid over them.

    Tables are merged key by key, everything else is replaced, and a table given as false is left out from there on.

    Raises:
        InputError: a stage has no name, no `time.end`, or a name that is no folder's or that another has.
    """
    given, below = tables["stages"], {key: value for key, value in tables.items() if key != "stages"}
    if not isinstance(given, list) or not given or not all(isinstance(stage, dict) for stage in given):
        raise InputError("stages", given, "must be a list of tables", "write [[stages]] above the keys of each")
    layers: list[Layer] = []
    for k, own in enumerate(given):
        name, key = own.get("name"), f"stages.{k}"
        _check_name(f"{key}.name", name, [layer.name for layer in layers])
        time = own.get("time")
        if not isinstance(time, dict) or "end" not in time:
            limit = "is missing: every stage says when it ends, counted from the start of the first"
            raise InputError(f"{key}.time.end", None, limit, "add time.end")
        if own.get("particles") is False:
            limit = "cannot be left out: a stage goes on with the particles of the one before"
            remedy = "remove this key; [stages.start] can take particles away: remove = [...]"
            raise InputError(f"{key}.particles", False, limit, remedy)
        changes = {name: value for name, value in own.items() if name != "name"}
        merged = _laid_over(below, changes)
        layers.append(Layer(name, merged, changes))
        below = {key: value for key, value in merged.items() if key not in OF_ONE_STAGE}
    return layers


def chain_of(layers: Sequence[Layer]) -> tuple[Stage, ...]:
    """The scenes of stages, all checked; each begins from the end of the one before.

    Raises:
        InputError: naming the key of the stage.
    """
    stages: list[Stage] = []
    for k, layer in enumerate(layers):
        try:
            stages.append(Stage(layer.name, _scene(layer, stages)))
        except InputError as error:
            raise _of_stage(error, k, layer) from None
    return tuple(stages)


def staged(stages: tuple[Stage, ...]) -> StagedScene:
    """The scene of several stages."""
    first = stages[0].scene
    fields = {name: getattr(first, name) for name in type(first).model_fields if name != "stages"}
    return StagedScene.model_construct(**fields, stages=stages)


def scenes_of(scene: Scene) -> list[Scene]:
    """The scenes of its stages; itself without."""
    return [stage.scene for stage in scene.stages] if isinstance(scene, StagedScene) else [scene]


def _scene(layer: Layer, before: Sequence[Stage]) -> Scene:
    if not before:
        return scene_of_tables(layer.tables)
    start, last = layer.tables.get("start", {}), before[-1]
    for name in ("from", "time"):
        if isinstance(start, dict) and name in start:
            limit = f"a stage begins from the end of the one before, {last.name}"
            raise InputError(f"start.{name}", start[name], limit, "remove this key")
    begun = {**start, "from": last.name} if isinstance(start, dict) else start
    scene = scene_of_tables({**layer.tables, "start": begun}, last.scene.tables())
    scene.time.check_outputs(Fraction(repr(last.scene.time.end)))
    if scene.precision != last.scene.precision:
        limit = f"{last.name} has {last.scene.precision}, and the precision is the same in all runs of a process"
        raise InputError("precision", scene.precision, limit, "give it once, for all stages")
    return scene


def _check_name(key: str, name: object, taken: Sequence[str]) -> None:
    if not isinstance(name, str) or not NAME.fullmatch(name):
        limit = "must be the name of a folder, of letters, digits and _ . + = -"
        raise InputError(key, name, limit, 'write, for example, name = "fill"')
    # Some file systems do not tell capital letters from small ones.
    if name.casefold() in map(str.casefold, taken):
        raise InputError(key, name, "is the name of another stage", "give every stage a name of its own")
    from jaxdem.io.chain import CHAIN  # with h5py, which other scenes do without

    if name.casefold() == CHAIN:
        raise InputError(key, name, "is the name of a file beside the stages", "give the stage another name")


def _laid_over(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Tables merged key by key; a table given as false is left out."""
    found = dict(below)
    for key, value in above.items():
        if value is False and isinstance(below.get(key), dict):
            del found[key]
        elif isinstance(value, dict) and isinstance(below.get(key), dict):
            found[key] = _laid_over(below[key], value)
        else:
            found[key] = value
    return found


def _of_stage(error: InputError, number: int, layer: Layer) -> InputError:
    """The error with the key of the stage where the stage gives that key itself, and its name where it does not."""
    if layer.own is None:
        return InputError(error.key, error.value, f"in the scene {layer.name}: {error.limit}", error.remedy)
    place: object = layer.own
    for part in error.key.split("."):
        if isinstance(place, Mapping) and part in place:
            place = place[part]
        elif isinstance(place, list) and part.isdecimal() and int(part) < len(place):
            place = place[int(part)]
        elif place is layer.own:
            return InputError(error.key, error.value, f"in the stage {layer.name}: {error.limit}", error.remedy)
        else:
            break
    return InputError(f"stages.{number}.{error.key}", error.value, error.limit, error.remedy)

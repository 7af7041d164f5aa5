"""What pydantic found wrong with a scene, in the words of the scene file."""

from __future__ import annotations

import difflib
import re
from typing import Any

from pydantic import BaseModel, ValidationError

from jaxdem.errors import InputError
from jaxdem.scene.base import (
    refuse_unknown,
)
from jaxdem.scene.boundary import BoundarySide
from jaxdem.scene.domain import SIDES_3D
from jaxdem.scene.scene import Scene


def as_input_error(error: ValidationError, tables: dict[str, Any]) -> InputError:
    """The first problem that pydantic found, in the words of the scene file."""
    problems = [(_path_of(problem, tables), problem) for problem in error.errors(include_url=False)]
    problems.sort(key=lambda found: found[1]["type"] != "extra_forbidden")
    # Where a number or a list may stand, what is wrong inside the list tells more.
    start = problems[0][0]
    path, first = max((p for p in problems if p[0][: len(start)] == start), key=lambda found: len(found[0]))
    key = ".".join(str(part) for part in path)
    value = first.get("input")
    if path[:1] == ("boundary",) and len(path) > 1 and path[1] not in SIDES_3D:
        refuse_unknown(f"boundary.{path[1]}", str(path[1]), SIDES_3D)
    if first["type"] == "extra_forbidden":
        allowed = _known_keys(list(path[:-1]))
        near = difflib.get_close_matches(str(path[-1]), allowed, n=1)
        remedy = f"did you mean {near[0]!r}?" if near else f"known here: {', '.join(allowed)}"
        return InputError(key, value, "unknown key", remedy)
    if first["type"] == "missing":
        return InputError(key, None, "is missing", "add this key to the scene")
    reasons = dict.fromkeys(_in_plain_words(found["msg"]) for place, found in problems if place == path)
    return InputError(key, value, " or ".join(reasons), "correct the value")


def _in_plain_words(message: str) -> str:
    for theirs, ours in (
        ("Value error, ", ""),
        ("Input should be a valid tuple", "must be a list"),
        ("Input should be a valid dictionary", "must be a table"),
        ("Input should be", "must be"),
        ("Tuple should have", "must have"),
        (" after validation", ""),
    ):
        message = message.replace(theirs, ours)
    return re.sub(r" or instance of \w+", "", message)


def _path_of(problem: Any, tables: dict[str, Any]) -> tuple[str | int, ...]:
    """Keys and indices of the place of a problem.

    pydantic puts the branches of a union between them; these are no keys of the tables, though a key may be called `float`.
    """
    value: Any = tables
    path: list[str | int] = []
    *parents, last = problem["loc"]
    for part in parents:
        if _holds(value, part):
            value = value[part]
            path.append(part)
    # A branch is what is wrong with the value itself, which is then the input.
    of_value = problem["type"] not in ("missing", "extra_forbidden") and problem["input"] is value
    if not of_value and (problem["type"] == "missing" or _holds(value, last)):
        path.append(last)
    return tuple(path)


def _holds(value: Any, part: str | int) -> bool:
    if isinstance(value, dict):
        return part in value
    return isinstance(value, list) and isinstance(part, int) and part < len(value)


def _known_keys(path: list[Any]) -> list[str]:
    model: Any = Scene
    for part in path:
        if isinstance(part, int):  # of a list of tables
            continue
        if not hasattr(model, "model_fields"):
            return []
        fields = {info.alias or name: info for name, info in model.model_fields.items()}
        if part in SIDES_3D and model is None:
            continue
        if part not in fields:
            return []
        if part == "boundary":
            model = BoundarySide
            return [info.alias or name for name, info in BoundarySide.model_fields.items()]
        candidates = [fields[part].annotation, *getattr(fields[part].annotation, "__args__", ())]
        model = next((c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), None)
    return [info.alias or name for name, info in getattr(model, "model_fields", {}).items()]

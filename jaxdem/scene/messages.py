"""What pydantic found wrong with a scene, in the words of the scene file."""

from __future__ import annotations

import math
from collections.abc import Mapping

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from jaxdem.errors import InputError
from jaxdem.scene.base import MISSING, NO_SUCH_MATERIAL, UNKNOWN_KEY

WORDS = (
    ("Value error, ", ""),
    ("Input should be a valid tuple", "must be a list"),
    ("Input should be a valid dictionary", "must be a table"),
    ("Input should be a valid integer", "must be a whole number"),
    ("Input should be a valid string", "must be text"),
    ("Input should be a valid boolean", "must be true or false"),
    ("Input should be a valid", "must be a"),
    ("Input should be", "must be"),
    ("Tuple should have", "must have"),
    (" after validation", ""),
)
"""pydantic's words and ours."""

Path = tuple[str | int, ...]


def as_input_error(error: ValidationError, tables: Mapping[str, object]) -> InputError:
    """The first problem that pydantic found: unknown keys before all others, and names of materials last."""
    problems = [(_place(problem, tables), problem) for problem in error.errors(include_url=False)]
    ranks = {UNKNOWN_KEY: 0, NO_SUCH_MATERIAL: 2}
    ranked = {place: ranks.get(_own(problem).get("limit", ""), 1) for place, problem in reversed(problems)}
    problems.sort(key=lambda found: ranked[found[0]])
    # Where a number or a list may stand, what is wrong inside the list tells more.
    start = problems[0][0]
    path, first = max((p for p in problems if p[0][: len(start)] == start), key=lambda found: len(found[0]))
    key = ".".join(str(part) for part in path)
    if first["type"] == "missing":
        return InputError(key, None, MISSING, _add(key))
    here = [problem for place, problem in problems if place == path]
    for problem in here:
        if own := _own(problem):
            remedy = own["remedy"]
            if own["limit"] == UNKNOWN_KEY:
                remedy = _elsewhere(path) or remedy
            elif own["limit"] == MISSING:
                remedy = _add(key)
            return InputError(key, own["value"], own["limit"], remedy)
    reasons = dict.fromkeys(_in_plain_words(problem["msg"]) for problem in here)
    return InputError(key, first["input"], " or ".join(reasons), _remedy(path, list(reasons), first["input"]))


def _add(key: str) -> str:
    """The remedy for a key that is missing: what it is."""
    from jaxdem.scene.hints import meaning_of

    meaning = meaning_of(key)
    return f"add it to the scene: {meaning}" if meaning else "add this key to the scene"


def _elsewhere(path: Path) -> str:
    """The remedy for a key that stands in the wrong table; empty for one that no table has."""
    from jaxdem.scene.hints import tables_with

    found = tables_with(str(path[-1]))
    return f"move it to {' or '.join(found)}, where there is a key of this name, or remove it" if found else ""


def _own(problem: ErrorDetails) -> dict[str, str]:
    """Value, limit and remedy from `scene.base.wrong`; empty for what pydantic found by itself."""
    return problem["ctx"] if problem["type"] == "wrong" else {}


def _in_plain_words(message: str) -> str:
    for theirs, ours in WORDS:
        message = message.replace(theirs, ours)
    return message.partition(" or instance of ")[0]


def _remedy(path: Path, reasons: list[str], value: object) -> str:
    table = ".".join(part for part in path if isinstance(part, str))
    if value is False and reasons == ["must be a list of tables"]:
        return f"to leave them out, write {path[-1]} = []"
    if value is False and reasons == ["must be a table"]:
        return "remove this key: there is no such table here that could be left out"
    if reasons == ["must be a list of tables"] or (reasons == ["must be a table"] and isinstance(path[-1], int)):
        return f"write [[{table}]] above the keys of each"
    if reasons == ["must be a table"]:
        return f"write [{table}] above its keys"
    if reasons == ["must be a list"] and isinstance(value, int | float) and abs(value) <= 1e20:
        return f"write it in brackets: [{value}]"
    if reasons == [f"must be less than {0.5 * math.pi}"] and isinstance(value, int | float):
        return f"it is in rad: for {value:g} degrees write {math.radians(value):.4g}"
    return "correct the value"


def _place(problem: ErrorDetails, tables: Mapping[str, object]) -> Path:
    """Keys and indices of the place of a problem, without the branches of a union that pydantic puts between them."""
    value: object = tables
    path: list[str | int] = []
    for part in problem["loc"]:
        if value is problem["input"]:  # what follows are branches of its type
            break
        if isinstance(value, Mapping) and part in value:
            value = value[part]
            path.append(part)
        elif isinstance(value, list) and part in range(len(value)):
            value = value[int(part)]
            path.append(part)
    if problem["type"] == "missing":
        path.append(problem["loc"][-1])
    if key := _own(problem).get("key"):
        path.append(key)
    return tuple(path)

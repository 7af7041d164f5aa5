"""The keys of a scene file, read from the schema: type, limits, unit, default and meaning of each.

The meaning is the key's entry under `Attributes:` in the docstring of its table, the unit what stands in brackets
at its end. `jaxdem scene` and the page `docs/scene.md` are made from it.
"""

from __future__ import annotations

import difflib
import inspect
import re
import textwrap
import types
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import annotated_types
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from jaxdem.errors import InputError
from jaxdem.scene.base import Section
from jaxdem.scene.scene import Scene
from jaxdem.scene.unread import conditions

NAMES = {float: "number", int: "whole number", str: "text", bool: "true or false"}
LIMITS = {
    annotated_types.Gt: "> ",
    annotated_types.Ge: "≥ ",
    annotated_types.Lt: "< ",
    annotated_types.Le: "≤ ",
}
TOP = "Before the first table"
"""Heading of the keys that belong to no table: TOML has them before the first one."""
KEY, UNIT = re.compile(r"^    (\w+): (.*)"), re.compile(r" ?\[([^\[\]]+)\]\.?$")


def meanings(model: type[BaseModel]) -> dict[str, str]:
    """Name of a field -> what the docstring of its class says about it."""
    found: dict[str, str] = {}
    name = ""
    _, _, attributes = inspect.cleandoc(model.__doc__ or "").partition("Attributes:\n")
    for line in attributes.splitlines():
        if match := KEY.match(line):
            name, found[match[1]] = match[1], match[2]
        elif name and line.strip():
            found[name] += " " + line.strip()
    return found


def tables(model: type[BaseModel] = Scene, path: str = "") -> Iterator[tuple[str, type[BaseModel]]]:
    """The tables of a scene file, depth first, each with its heading; one that is used twice stands once."""
    seen: set[type[BaseModel]] = set()

    def visit(model: type[BaseModel], path: str, heading: str) -> Iterator[tuple[str, type[BaseModel]]]:
        if model in seen:
            return
        seen.add(model)
        yield heading, model
        for name, field in model.model_fields.items():
            for inner, form in nested(field.annotation):
                below = f"{path}{field.alias or name}"
                below += ".<side>" if form == "dict" else ""
                yield from visit(inner, f"{below}.", f"[[{below}]]" if form == "list" else f"[{below}]")

    yield from visit(model, path, TOP)


def nested(annotation: Any, form: str = "table") -> list[tuple[type[BaseModel], str]]:
    """The tables in a type, each with how it is held: as a table, in a list or in a dict."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [(annotation, form)]
    form = {tuple: "list", dict: "dict"}.get(get_origin(annotation), form)  # type: ignore[arg-type]
    return [found for part in get_args(annotation) for found in nested(part, form)]


def words(annotation: Any, metadata: list[Any]) -> str:
    """A type in the words of a scene file, limits included."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return words(parts[0], [*parts[1:], *metadata])
    if origin is Literal:
        return " or ".join(f'`"{value}"`' for value in parts)
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(words(part, metadata) for part in parts if part is not type(None)))
    if origin is tuple and parts[-1] is Ellipsis:
        return f"list of {plural(words(parts[0], []))}{length(metadata)}"
    if origin is tuple:
        return f"list of {len(parts)} {plural(words(parts[0], []))}"
    if origin is dict:
        return "tables"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "table"
    limits = [f"{LIMITS[type(m)]}{bound(m)}" for m in flat(metadata) if type(m) in LIMITS]
    return NAMES[annotation] + (f" {', '.join(limits)}" if limits else "")


def bound(limit: Any) -> str:
    """The number of a limit."""
    number = next(getattr(limit, name) for name in ("gt", "ge", "lt", "le") if hasattr(limit, name))
    return f"{number:,d}" if isinstance(number, int) else f"{number:g}"


def flat(metadata: list[Any]) -> list[Any]:
    """Limits, also those that stand in a `Field(...)`."""
    return [inner for m in metadata for inner in (m.metadata if isinstance(m, FieldInfo) else [m])]


def length(metadata: list[Any]) -> str:
    """How many entries a list must have."""
    least = next((m.min_length for m in flat(metadata) if isinstance(m, annotated_types.MinLen)), None)
    most = next((m.max_length for m in flat(metadata) if isinstance(m, annotated_types.MaxLen)), None)
    if least and most:
        return f", {least} or {most} of them" if most == least + 1 else f", {least} to {most} of them"
    return f", {least} at least" if least else ""


def plural(name: str) -> str:
    """The plural of a type's name; a list within a list is a row."""
    if " or " in name:
        return f"entries, each {name}"
    if name.startswith("list of "):
        return "rows of " + name.removeprefix("list of ")
    for singular, several in (("whole number", "whole numbers"), ("number", "numbers"), ("table", "tables")):
        if name.startswith(singular):
            return several + name[len(singular) :]
    return name


def default(field: FieldInfo) -> str:
    """The default as TOML; nothing where there is none or where the meaning tells it."""
    value = field.default
    if field.is_required():
        return "required"
    if isinstance(value, Section):
        given = ", ".join(f"{key} = {number}" for key, number in value.model_dump(exclude_none=True).items())
        return f"`{{ {given} }}`" if given else ""
    if value is None or value == {}:
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, str):
        return f'`"{value}"`'
    return "`[]`" if value == () else f"`{value}`"


def rows(model: type[BaseModel]) -> Iterator[tuple[str, str, str, str, str]]:
    """Key, type, unit, default and meaning of every key of a table.

    Raises:
        ValueError: a key has no meaning in the docstring of its table, or the docstring has one that is no key.
    """
    described = meanings(model)
    if set(described) != set(model.model_fields):
        names = ", ".join(sorted(set(described) ^ set(model.model_fields)))
        raise ValueError(f"{model.__name__}: the docstring's Attributes and the keys differ: {names}")
    for name, field in model.model_fields.items():
        meaning = described[name]
        unit = UNIT.search(meaning)
        text = UNIT.sub("", meaning).rstrip(" .,;")
        if not text:
            raise ValueError(f"{model.__name__}.{name} has a unit and no meaning")
        text = text[0].upper() + text[1:] + "."
        if read := ", and with ".join(map(str, conditions(field))):
            text += f" Read with {read}."
        key = field.alias or name
        yield key, words(field.annotation, field.metadata), unit[1] if unit else "", default(field), text


WIDTH = 100
"""Characters of a line in the terminal."""


def explain(key: str = "") -> str:
    """What a key or the keys of a table are, as text for a terminal; all tables without a key.

    Raises:
        InputError: a scene has no such key; the nearest names are given.
    """
    named = {re.sub(r"[\[\]]", "", heading): (heading, model) for heading, model in tables()}
    if not key:
        width = max(len(heading) for heading, _ in named.values())
        return "\n".join(_entry(heading, width, summary(model)) for heading, model in named.values())
    key = re.sub(r"^boundary\.(left|right|bottom|top|front|back)\b", "boundary.<side>", key.strip("[]"))
    if key in named:
        heading, model = named[key]
        names = [(name, text) for name, _, _, _, text in rows(model)]
        width = max(len(name) for name, _ in names)
        entries = [(name, width, text) for name, text in names]
        return "\n".join([heading, textwrap.fill(summary(model), WIDTH), "", *(_entry(*one) for one in entries)])
    keys = {
        row[0] if table == TOP else f"{table}.{row[0]}": (heading, model, row)
        for table, (heading, model) in named.items()
        for row in rows(model)
    }
    if key not in keys:
        near = (
            difflib.get_close_matches(key, list(dict.fromkeys([*keys, *named])), n=3)
            or [name for name in keys if name.rpartition(".")[2] == key.rpartition(".")[2]][:3]
        )
        hint = f"Did you mean {' or '.join(near)}? " if near else ""
        remedy = f"{hint}`jaxdem scene` lists the tables, `jaxdem scene TABLE` the keys of one"
        raise InputError(key, None, "a scene has no such key or table", remedy)
    heading, model, (_, kind, unit, preset, text) = keys[key]
    facts = (("type", kind), ("unit", unit), ("default", preset), ("table", f"{heading}  {summary(model)}"))
    return "\n".join([key, textwrap.fill(text, WIDTH), "", *(f"{n:8} {v.replace('`', '')}" for n, v in facts if v)])


def _entry(name: str, width: int, text: str) -> str:
    """A name and what it is, with further lines under the first one."""
    return textwrap.fill(text, WIDTH, initial_indent=f"{name:{width}}  ", subsequent_indent=" " * (width + 2))


def summary(model: type[BaseModel]) -> str:
    """What a table is, in a line."""
    return " ".join(inspect.cleandoc(model.__doc__ or "").split("\n\n")[0].split())

"""Keys that only some models read: said once, beside the key, and told where a scene gives one that nothing reads.

Such a key is not refused: a sweep over the models of a scene keeps all its keys.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic.fields import FieldInfo

from jaxdem.scene.base import Section

NOTHING: tuple[object, ...] = (None, 0.0, False, "none", ())
"""Values that ask for nothing, whoever reads them."""

EVERY = "K"
"""In the key of a condition: every table of a list."""


class ReadWith:
    """In the `Annotated` of a key: what a scene must have for it to be read. Of several each must hold.

    Attributes:
        any_of: conditions, one of which is enough: "KEY = VALUE", or "KEY" for one that has another value than its
            default, or a table that is there. KEY is dotted, from the top of the scene, with K for every table of a
            list; ".KEY" is of the same table.
    """

    def __init__(self, *any_of: str) -> None:
        self.any_of = any_of

    def __str__(self) -> str:
        """The conditions, as one reads them beside the key."""
        names = [one.removeprefix(".") if "." in one or " " in one else f"[{one}]" for one in self.any_of]
        return " or ".join(filter(None, (", ".join(names[:-1]), names[-1])))

    def holds(self, scene: Section, table: str) -> bool:
        """Whether it does, for a key of a table with a dotted name that ends in a dot."""
        return any(_holds(condition, scene, table) for condition in self.any_of)


def conditions(field: FieldInfo) -> list[ReadWith]:
    """What must hold for a key to be read; [] for one that always is."""
    return [one for one in field.metadata if isinstance(one, ReadWith)]


def unread_keys(scene: Section) -> tuple[str, ...]:
    """A sentence for every key of a scene that asks for something, and that nothing reads."""
    found = []
    for table, key, field, value in _keys(scene, ""):
        if value in NOTHING or value == field.default:
            continue
        missing = next((one for one in conditions(field) if not one.holds(scene, table)), None)
        if missing is not None:
            found.append(f"{table}{key} = {_text(value)} has no effect here: it is read with {missing}")
    return tuple(found)


def _holds(condition: str, scene: Section, table: str) -> bool:
    key, _, wanted = condition.partition(" = ")
    names = (table + key[1:] if key.startswith(".") else key).split(".")
    for value, default in _values(scene, names, None):
        if str(value) == wanted if wanted else value not in NOTHING and value != default:
            return True
    return False


def _values(holder: Any, names: list[str], default: object) -> Iterator[tuple[Any, object]]:
    """The values that a dotted key has, each with its default; none where a table of it is not there."""
    if not names or holder is None:
        yield from [] if names else [(holder, default)]
    elif isinstance(holder, Section):
        name = next(name for name, field in type(holder).model_fields.items() if (field.alias or name) == names[0])
        yield from _values(getattr(holder, name), names[1:], type(holder).model_fields[name].default)
    elif isinstance(holder, Mapping):
        yield from _values(holder.get(names[0]), names[1:], None)
    else:
        chosen = holder if names[0] == EVERY else (holder[int(names[0])],)
        for one in chosen:
            yield from _values(one, names[1:], None)


def _keys(table: Section, path: str) -> Iterator[tuple[str, str, FieldInfo, Any]]:
    """Every key below a table: the path of its table, its name, its declaration and its value."""
    for name, field in type(table).model_fields.items():
        value, key = getattr(table, name), field.alias or name
        yield path, key, field, value
        for below, one in _tables(value):
            yield from _keys(one, f"{path}{key}.{below}")


def _tables(value: object) -> Iterator[tuple[str, Section]]:
    """The tables in a value, each with its number or name."""
    if isinstance(value, Section):
        yield "", value
    entries = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, tuple) else ()
    for number, one in entries:
        if isinstance(one, Section):
            yield f"{number}.", one


def _text(value: object) -> str:
    """A value as a scene file has it, in short."""
    if isinstance(value, Section):
        return "{ " + ", ".join(f"{name} = {_text(entry)}" for name, entry in value) + " }"
    return f"{value:g}" if isinstance(value, float) else str(value)

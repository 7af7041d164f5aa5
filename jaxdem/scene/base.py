"""What the tables of a scene file are made of: checked numbers, vectors and names, and the base of the tables."""

from __future__ import annotations

import difflib
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Annotated, Any, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    model_validator,
)
from pydantic_core import PydanticCustomError

WALL = "wall"
"""Name of the material of walls that have no other: the `contact.wall_*` keys."""

UNKNOWN_KEY, MISSING, NO_SUCH_MATERIAL = "unknown key", "is missing", "there is no such material in [[materials]]"


def wrong(key: str, value: object, limit: str, remedy: str) -> PydanticCustomError:
    """What a validator raises: pydantic adds the table, and `scene/messages.py` makes an InputError of it.

    Args:
        key: of the table, or below the key that is validated; empty for that key or table itself.
        value: that was given.
        limit: what is allowed.
        remedy: what to do.
    """
    return PydanticCustomError("wrong", "{limit}", {"key": key, "value": value, "limit": limit, "remedy": remedy})


def shown_key(name: object) -> str:
    """A key as messages name it: an empty one in quotes, as TOML has it."""
    return str(name) or '""'


def nearest(name: str, known: Iterable[str]) -> str:
    """The remedy for a name that is none of those known: the one most like it, or all."""
    near = difflib.get_close_matches(name, list(known), n=1)
    return f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known) or 'none'}"


def _sensible(value: float) -> float:
    """Refuse numbers whose powers would leave the range of floats."""
    if value != 0.0 and not 1e-20 <= abs(value) <= 1e20:
        raise ValueError("a number that is not zero must lie between 1e-20 and 1e20 in size")
    return value


def per_axis(value: tuple[float, ...], info: ValidationInfo) -> tuple[float, ...]:
    """A validator: as many numbers as the box has axes."""
    dimension = (info.context or {}).get("dimension", len(value))
    if len(value) != dimension:
        raise wrong("", value, f"needs {dimension} numbers, got {len(value)}", f"give {dimension} numbers")
    return value


def _no_zero(value: tuple[float, ...]) -> tuple[float, ...]:
    if math.hypot(*value) == 0.0:
        raise wrong("", value, "a direction must not be zero", "give a vector that is not zero")
    return value


def _known_material(name: str, info: ValidationInfo, more: tuple[str, ...] = ()) -> str:
    known = (*(info.context or {}).get("materials", (name,)), *more)
    if name not in known:
        raise wrong("", name, NO_SUCH_MATERIAL, nearest(name, known))
    return name


def _of_walls_too(name: str, info: ValidationInfo) -> str:
    return _known_material(name, info, (WALL,))


def one_number(value: object) -> object:
    """A validator: a number alone for a list of one."""
    return (value,) if isinstance(value, int | float) and not isinstance(value, bool) else value


def row_or_rows(value: object) -> str:
    """Whether a list is one row, or one for each of several times."""
    return "rows" if isinstance(value, list | tuple) and value and isinstance(value[0], list | tuple) else "row"


def at_all_times(value: Sequence[object] | None) -> tuple[tuple[float | str, ...], ...]:
    """The values of a key at all its times: one row where it has none, none where it is not given."""
    if value is None:
        return ()
    return tuple(value) if isinstance(value[0], tuple) else (tuple(value),)  # type: ignore[arg-type, return-value]


def named_once(reserved: str, what: str) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    """A validator of a list of tables: no two have one `name`, and none that which is `reserved`.

    Args:
        reserved: a name.
        what: why it is, in words.
    """

    def check(tables: tuple[Any, ...]) -> tuple[Any, ...]:
        names = [table.name for table in tables]
        for k, name in enumerate(names):
            if name == reserved or name in names[:k]:
                raise wrong(f"{k}.name", name, what if name == reserved else "is used twice", "give another name")
        return tables

    return check


def _list_of_tables(value: object) -> object:
    if not isinstance(value, list | tuple):
        raise ValueError("must be a list of tables")
    return value


# Strict: neither true nor "1" is a number; a whole number is taken for a float.
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False, strict=True), AfterValidator(_sensible)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False, strict=True), AfterValidator(_sensible)]
Fraction = Annotated[float, Field(ge=0, le=1, strict=True), AfterValidator(_sensible)]
Finite = Annotated[float, Field(allow_inf_nan=False, strict=True), AfterValidator(_sensible)]
Poisson = Annotated[float, Field(gt=-1.0, le=0.5, strict=True)]
Rows = tuple[tuple[Finite, ...], ...]
Vector = Annotated[tuple[Finite, ...], AfterValidator(per_axis)]
"""As many numbers as the box has axes."""
Direction = Annotated[Vector, AfterValidator(_no_zero)]
"""A vector of any length but zero."""
Corner = Annotated[tuple[Finite, ...], BeforeValidator(one_number)]
"""A place on a side, in the other axes; in 2-D a number is enough."""
VectorOverTime = Annotated[
    Annotated[Vector, Tag("row")] | Annotated[tuple[Vector, ...], Tag("rows")], Discriminator(row_or_rows)
]
"""A vector, or one for each of several times."""
Abscissae = Annotated[tuple[NonNegative, ...], Field(min_length=2)]
"""Arguments of a table; see `check_table`."""
Name = Annotated[str, Field(min_length=1)]
MaterialName = Annotated[Name, AfterValidator(_known_material)]
WallMaterialName = Annotated[Name, AfterValidator(_of_walls_too)]

Table = TypeVar("Table")
Tables = Annotated[tuple[Table, ...], BeforeValidator(_list_of_tables)]


def check_table(name: str, arguments: tuple[float, ...] | None, other: str, values: Sequence[object] | None) -> None:
    """Arguments that increase, and as many values."""
    if arguments is None and values is None:
        return
    if arguments is None or values is None:
        there, lacking = (name, other) if values is None else (other, name)
        raise wrong(there, arguments or values, f"needs {lacking} as well", f"add the key {lacking}")
    if len(arguments) != len(values):
        limit = f"needs {len(arguments)} entries, as many as {name}"
        raise wrong(other, values, limit, "give lists of the same length")
    for a, b in itertools.pairwise(arguments):
        if b <= a:
            raise wrong(name, arguments, f"must increase, but {b} follows {a}", "sort the entries")


def check_over_time(times_name: str, times: tuple[float, ...] | None, name: str, value: Sequence[object]) -> None:
    """One row for each of the times; without times one row alone."""
    rows = value if isinstance(value[0], tuple) else None
    if (rows is None) != (times is None):
        limit = f"is a list of lists with {times_name}, and a list of numbers without"
        raise wrong(name, value, limit, f"give one list for each of {times_name}, or remove {times_name}")
    check_table(times_name, times, name, rows)


class Section(BaseModel):
    """A table of the scene file: immutable, unknown keys refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @model_validator(mode="before")
    @classmethod
    def _only_known_keys(cls, table: object) -> object:
        known = [field.alias or name for name, field in cls.model_fields.items()]
        for name, value in table.items() if isinstance(table, dict) else ():
            if name not in known:
                raise wrong(shown_key(name), value, UNKNOWN_KEY, nearest(str(name), known))
        return table

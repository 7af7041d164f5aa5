"""What the tables of a scene file are made of: numbers that are checked, and the base of the tables."""

from __future__ import annotations

import difflib
from typing import Annotated, Any, NoReturn

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from jaxdem.errors import InputError


def _sensible(value: float) -> float:
    """Refuse numbers whose powers would leave the range of floats."""
    if value != 0.0 and not 1e-20 <= abs(value) <= 1e20:
        raise ValueError("a number that is not zero must lie between 1e-20 and 1e20 in size")
    return value


# Strict: neither true nor "1" is a number; a whole number is taken for a float.
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False, strict=True), AfterValidator(_sensible)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False, strict=True), AfterValidator(_sensible)]
Fraction = Annotated[float, Field(ge=0, le=1, strict=True), AfterValidator(_sensible)]
Finite = Annotated[float, Field(allow_inf_nan=False, strict=True), AfterValidator(_sensible)]
Rows = tuple[tuple[Finite, ...], ...]


class Section(BaseModel):
    """A table of the scene file: immutable, unknown keys refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def check_entries(key: str, value: tuple[Any, ...], count: int) -> None:
    """Refuses a list that has not `count` numbers."""
    if len(value) != count:
        raise InputError(key, value, f"needs {count} number(s), got {len(value)}", f"give {count} number(s)")


def refuse_unknown(key: str, name: str, allowed: tuple[str, ...]) -> NoReturn:
    """Refuses a name that is none of those allowed, with the one that is most like it."""
    near = difflib.get_close_matches(name, allowed, n=1)
    remedy = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(sorted(allowed))}"
    raise InputError(key, name, "unknown key", remedy)

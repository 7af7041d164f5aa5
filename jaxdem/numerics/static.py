"""What is compiled in and what is traced, told apart by one decorator."""

from __future__ import annotations

import dataclasses
from typing import TypeVar, dataclass_transform

import jax

Class = TypeVar("Class")


@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field,))
def static(cls: type[Class]) -> type[Class]:
    """A frozen dataclass that JAX compiles in: equal by value, hashable, and without a leaf where it is an argument.

    What JAX traces is a NamedTuple or a dataclass of `jax.tree_util.register_dataclass`.
    """
    return jax.tree_util.register_static(dataclasses.dataclass(frozen=True)(cls))

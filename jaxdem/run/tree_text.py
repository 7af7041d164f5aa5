"""The structure of a tree of arrays as text, and back: a file can make trees of jaxdem's classes, no more."""

from __future__ import annotations

import dataclasses
import importlib
import json
from collections.abc import Iterator
from typing import Any

from jax import Array

Tree = Any
"""A pytree of arrays; JAX has no type for it."""


def describe(tree: Tree) -> str:
    """The structure as JSON: tuples, lists, dicts, Nones, and jaxdem's named tuples and dataclasses by name.

    Raises:
        TypeError: there is something else in it.
    """
    return json.dumps(_described(tree))


def build(text: str, leaves: Iterator[Array]) -> Tree:
    """The tree of a description with these leaves, in the order of `jax.tree.flatten`."""
    return _built(json.loads(text), leaves)


def _described(tree: Tree) -> Any:
    if tree is None:
        return None
    if isinstance(tree, tuple) and hasattr(tree, "_fields"):
        return {"named": _name(type(tree)), "parts": [_described(part) for part in tree]}
    if dataclasses.is_dataclass(tree) and not isinstance(tree, type):
        static = {field.name for field in dataclasses.fields(tree) if field.metadata.get("static")}
        parts = {field.name: getattr(tree, field.name) for field in dataclasses.fields(tree)}
        fixed = {name: parts.pop(name) for name in static}
        return {"data": _name(type(tree)), "fixed": fixed, "parts": {k: _described(v) for k, v in parts.items()}}
    if isinstance(tree, tuple | list):
        return {type(tree).__name__: [_described(part) for part in tree]}
    if isinstance(tree, dict):
        return {"dict": {name: _described(tree[name]) for name in sorted(tree)}}
    if hasattr(tree, "shape"):
        return "leaf"
    raise TypeError(f"{type(tree).__name__} is no part of a tree of arrays")


def _built(found: Any, leaves: Iterator[Array]) -> Tree:
    if found is None:
        return None
    if found == "leaf":
        return next(leaves)
    if "named" in found:
        return _class(found["named"])(*(_built(part, leaves) for part in found["parts"]))
    if "data" in found:
        parts = {name: _built(part, leaves) for name, part in found["parts"].items()}
        return _class(found["data"])(**parts, **found["fixed"])
    if "dict" in found:
        return {name: _built(part, leaves) for name, part in found["dict"].items()}
    kind, parts = next(iter(found.items()))
    return {"tuple": tuple, "list": list}[kind](_built(part, leaves) for part in parts)


def _name(kind: type) -> str:
    return f"{kind.__module__}:{kind.__qualname__}"


def _class(name: str) -> Any:
    """A class of jaxdem that holds arrays; nothing else can be named in a file."""
    module, _, own = name.partition(":")
    if module.split(".")[0] != "jaxdem":
        raise ValueError(f"{name} is not of jaxdem")
    kind = getattr(importlib.import_module(module), own)
    if not (hasattr(kind, "_fields") or dataclasses.is_dataclass(kind)):
        raise ValueError(f"{name} holds no arrays")
    return kind

"""Compiled programs whose trace is kept on disk, so that a start with other numbers does not trace and lower anew."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
from jax import Array
from jax.export import Exported, deserialize, export

from jaxdem.run.fingerprint import UnknownKind, fingerprint
from jaxdem.run.tree_text import build, describe

_folder: list[Path] = []


def keep_in(folder: Path | None) -> None:
    """Keep what is traced from now on in a folder; None for nowhere, which is what a library does."""
    _folder[:] = [] if folder is None else [folder]


class _Traced(NamedTuple):
    """A program of flat lists of arrays, and the structure of its result as text."""

    program: Exported
    structure: str


def compiled(function: Callable[..., Any], static: object, *arguments: Any) -> Callable[..., Any]:
    """`function(static, *arguments)` as a compiled function of the arguments, for arrays of these shapes and types.

    Args:
        function: of jaxdem; pure.
        static: what is compiled in.
        arguments: trees of arrays.
    """
    traced = _traced(function, static, arguments)
    if traced is None:
        return jitted(function, static).lower(*arguments).compile()
    run = jax.jit(traced.program.call).lower(*jax.tree.leaves(arguments)).compile()
    return lambda *given: build(traced.structure, iter(run(*jax.tree.leaves(given))))


def jitted(function: Callable[..., Any], static: object) -> Any:
    """`in_memory`, or plain `jit` where what is static has no hash, such as a law of the user's with a list in it."""
    try:
        hash(static)
    except TypeError:
        return jax.jit(partial(function, static))
    return in_memory(function, static)


@functools.lru_cache(maxsize=8)
def in_memory(function: Callable[..., Any], static: object) -> Any:
    """`function(static, ...)` under `jit`, the same object for equal arguments.

    JAX keeps with it what it has traced and compiled: a further run of the same structure in one process does neither.
    """
    return jax.jit(partial(function, static))


def _traced(function: Callable[..., Any], static: object, arguments: tuple[Any, ...]) -> _Traced | None:
    """From the folder, or made and put there; None where nothing is kept, or it has no fingerprint or cannot be
    kept."""
    if not _folder:
        return None
    try:
        key = fingerprint((function.__module__, function.__qualname__, static), arguments)
    except UnknownKind:  # a function of the user's, say
        return None
    path = _folder[0] / key
    found = _read(path)
    if found is None:
        try:
            found = _exported(function, static, arguments)
        except (ValueError, TypeError):  # jax.export refuses some calls of libraries, `describe` trees of others
            return None
        _write(path, found)
    return found


def _exported(function: Callable[..., Any], static: object, arguments: tuple[Any, ...]) -> _Traced:
    leaves, structure = jax.tree.flatten(arguments)
    structures: list[str] = []

    def flat(*leaves: Array) -> list[Array]:
        result = function(static, *jax.tree.unflatten(structure, leaves))
        structures.append(describe(result))
        return jax.tree.leaves(result)

    return _Traced(export(jax.jit(flat))(*leaves), structures[0])


def _read(path: Path) -> _Traced | None:
    """What is kept in a file; None where it is not there, or not whole."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    digest, body = content[:32], content[32:]
    if hashlib.sha256(body).digest() != digest:
        return None
    structure, _, program = body.partition(b"\n")
    return _Traced(deserialize(bytearray(program)), structure.decode())


def _write(path: Path, traced: _Traced) -> None:
    """Kept for others, whole or not at all; a disk that is full is no reason to stop a run."""
    body = traced.structure.encode() + b"\n" + bytes(traced.program.serialize())
    aside = path.with_name(f".{path.name}.{os.getpid()}")
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        aside.write_bytes(hashlib.sha256(body).digest() + body)
        aside.replace(path)

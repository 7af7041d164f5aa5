"""Scenes from TOML files and from tables, with single keys changed."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from jaxdem.errors import InputError
from jaxdem.files.reading import parse_toml, read_text
from jaxdem.scene.messages import as_input_error
from jaxdem.scene.scene import Scene, completed

DEEPEST = 20
"""Tables and lists inside each other."""


FILE_KEYS = (
    ("particles", "radius"),
    ("particles", "density"),
    ("particles", "position"),
    ("particles", "velocity"),
    ("particles", "angular_velocity"),
    ("particles", "file"),
    ("closure", "file"),
    ("fluid", "subgrid"),
)
"""Tables and keys that may name a file."""


def load_scene(source: str | Path | dict[str, Any], overrides: dict[str, Any] | None = None) -> Scene:
    """A scene from a TOML file, or from the tables as a dict.

    Args:
        source: path, or tables.
        overrides: dotted key -> value, set after reading.

    Raises:
        InputError: naming key, value, limit and remedy.
    """
    folder = Path(".")
    if isinstance(source, dict):
        tables = _copy(source)
    else:
        folder = Path(source).parent
        tables = _read_toml(Path(source))
    for key, value in (overrides or {}).items():
        _set(tables, key, value)
    _check_depth(tables)
    tables = _absolute_files(tables, folder)
    try:
        scene = Scene.model_validate(tables, context=_context(tables))
    except ValidationError as error:
        raise as_input_error(error, tables) from None
    return completed(scene)


def _context(tables: dict[str, Any]) -> dict[str, Any]:
    """What keys of several tables are checked against: the number of axes, and the names of the materials."""
    domain, materials = tables.get("domain"), tables.get("materials")
    size = domain.get("size") if isinstance(domain, dict) else None
    given = materials if isinstance(materials, list) else []
    names = [material.get("name") for material in given if isinstance(material, dict)]
    dimension = {"dimension": len(size)} if isinstance(size, list) and len(size) in (2, 3) else {}
    return {"materials": tuple(name for name in names if isinstance(name, str)), **dimension}


def named_files(tables: dict[str, Any]) -> list[str]:
    """Files that the tables of a scene name."""
    values = [holder.get(key) for holder, key, _ in _file_keys(tables)]
    return [value for value in values if isinstance(value, str)]


def _file_keys(tables: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str, str]]:
    """Table, key and dotted key of everything that may name a file; where a table may stand for it, its key `name`."""
    for table, key in FILE_KEYS:
        holder = tables.get(table)
        if isinstance(holder, dict) and isinstance(holder.get(key), dict):
            yield holder[key], "name", f"{table}.{key}.name"
        elif isinstance(holder, dict):
            yield holder, key, f"{table}.{key}"


def parse_override(text: str, option: str = "--set") -> tuple[str, Any]:
    """`key=value` of an option of the command line, the value as TOML; a word needs no quotes."""
    key, separator, value = text.partition("=")
    key = key.strip()
    if not separator or not key:
        raise InputError(option, text, "must have the form key=value", f"use, for example, {option} time.end=1.0")
    try:
        return key, tomllib.loads(f"value = {value}")["value"]
    except (tomllib.TOMLDecodeError, RecursionError, ValueError):
        if any(mark in value for mark in "[]{}=\"'"):
            remedy = f"quote strings: {option} coupling.drag='\"koch_hill\"'"
            raise InputError(f"{option} {key}", value, "must be a TOML value", remedy) from None
        return key, value.strip()


def _check_depth(tables: dict[str, Any]) -> None:
    """Refuses tables in tables without end, at which Python's own stack would: no key of a scene lies so deep."""
    level: list[Any] = [tables]
    for _ in range(DEEPEST):
        entries = [inner for outer in level for inner in (outer.values() if isinstance(outer, dict) else outer)]
        level = [inner for inner in entries if isinstance(inner, dict | list)]
    if level:
        limit = f"has tables or lists nested more than {DEEPEST} deep, where no key exists"
        raise InputError("SCENE", "...", limit, "correct the dotted keys and brackets")


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return parse_toml(read_text(path))
    except FileNotFoundError:
        limit, remedy = "no such file", "give the path of a scene file"
    except OSError as error:
        limit, remedy = f"cannot be read ({error.strerror})", "correct the path or the permissions"
    except UnicodeDecodeError:
        limit, remedy = "is not UTF-8 text", "save the scene as UTF-8"
    except tomllib.TOMLDecodeError as error:
        limit, remedy = f"is not valid TOML: {error}", "correct that line"
    except ValueError as error:
        limit, remedy = str(error), "correct the scene"
    raise InputError("SCENE", str(path), limit, remedy)


def _set(tables: dict[str, Any], key: str, value: Any) -> None:
    *parents, last = key.split(".")
    holder: Any = tables
    for part in parents:
        number = int(part) if part.isdecimal() else -1
        entries = holder if isinstance(holder, list) else []
        if part.isdecimal() or isinstance(holder, list):
            if not 0 <= number < len(entries):
                table = f"[[{key.partition(f'.{part}')[0]}]]"
                limit = (
                    f"there are {len(entries)} tables {table}" if len(entries) != 1 else f"there is one table {table}"
                )
                raise InputError(f"--set {key}", value, limit, "give the number of one of them, from 0")
            holder = entries[number]
        else:
            holder = holder.setdefault(part, {})
        if not isinstance(holder, dict | list):
            raise InputError(f"--set {key}", value, f"{part} is not a table", "correct the dotted key")
    if isinstance(holder, list):
        remedy = f"name a key of one of them: --set {key}.KEY=VALUE"
        raise InputError(f"--set {key}", value, f"{parents[-1]} is a list of tables", remedy)
    holder[last] = value


def _absolute_files(tables: dict[str, Any], folder: Path) -> dict[str, Any]:
    """File names in a scene are relative to it; the scene as run holds absolute ones."""
    tables = _copy(tables)
    for holder, key, dotted in _file_keys(tables):
        if isinstance(holder.get(key), str):
            try:
                holder[key] = str((folder / holder[key]).resolve())
            except (OSError, ValueError, RuntimeError) as error:
                limit = f"cannot be the name of a file ({error})"
                raise InputError(dotted, holder[key], limit, "correct the name") from None
    return tables


def _copy(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _copy(v) for k, v in value.items()}
    if hasattr(value, "tolist"):  # an array; NumPy is not imported for those that a scene has not
        return value.tolist()
    return [_copy(v) for v in value] if isinstance(value, list | tuple) else value

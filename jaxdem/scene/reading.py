"""Scenes from TOML files and from tables, with single keys changed."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from jaxdem.errors import InputError
from jaxdem.files.reading import parse_toml, read_text
from jaxdem.scene.checked import scene_of_tables
from jaxdem.scene.scene import Scene
from jaxdem.scene.stages import Layer, StagedScene, chain_of, layers_of, staged

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
    ("start", "from"),
)
"""Tables and keys that may name a file or a folder."""


def load_scene(
    source: str | Path | dict[str, Any],
    overrides: dict[str, Any] | None = None,
    former: Mapping[str, Any] | None = None,
) -> Scene:
    """A scene from a TOML file, or from the tables as a dict.

    Args:
        source: path, or tables.
        overrides: dotted key -> value, set after reading.
        former: of a scene with `[start]`: tables of the scene of the run that it begins from, as that run stores
            them. Read from its folder where they are not given.

    Raises:
        InputError: naming key, value, limit and remedy; or an argument is of another kind.
    """
    if not isinstance(source, (dict, str, os.PathLike)):
        remedy = "give the path of a scene file, or its tables as a dict"
        raise InputError("scene", type(source).__name__, "is neither a path nor a dict of tables", remedy)
    named = isinstance(overrides, Mapping) and all(isinstance(key, str) for key in overrides)
    if overrides is not None and not named:
        limit, remedy = "is no dict of dotted keys", 'give, for example, {"time.end": 1.0}'
        raise InputError("overrides", overrides, limit, remedy)
    if isinstance(source, dict):
        tables = _prepared(_copy(source), Path("."), overrides)
    else:
        tables = _prepared(_read_toml(Path(source)), Path(source).parent, overrides)
    if "stages" in tables:
        return staged(chain_of(layers_of(tables)))
    return scene_of_tables(tables, former)


def load_chain(sources: Sequence[Path], overrides: dict[str, Any] | None = None) -> StagedScene:
    """Scene files as the stages of one scene, named as the files: each begins from the end of the one before.

    Args:
        sources: paths.
        overrides: dotted key -> value, set in each after reading.

    Raises:
        InputError: naming the scene, key, value, limit and remedy; or two files have the same name.
    """
    layers: list[Layer] = []
    for source in sources:
        tables = _prepared(_read_toml(source), source.parent, overrides)
        if "stages" in tables:
            raise InputError("SCENE", str(source), "has stages of its own", "give it alone")
        if source.stem in [layer.name for layer in layers]:
            raise InputError("SCENE", str(source), "has the name of another scene", "rename one of the two files")
        layers.append(Layer(source.stem, tables, None))
    return staged(chain_of(layers))


def _prepared(tables: dict[str, Any], folder: Path, overrides: Mapping[str, Any] | None) -> dict[str, Any]:
    """Tables with single keys changed, and absolute names of files."""
    for key, value in (overrides or {}).items():
        _check_depth({key: value})
        _set(tables, key, _copy(value))  # further keys may be set within it
    _check_depth(tables)
    return _absolute_files(tables, folder)


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
    walls = tables.get("walls")
    for number, wall in enumerate(walls if isinstance(walls, list) else ()):
        if isinstance(wall, dict):
            yield wall, "file", f"walls.{number}.file"
    bonds = tables.get("bonds")
    for number, bond in enumerate(bonds if isinstance(bonds, list) else ()):
        if isinstance(bond, dict):
            yield bond, "pairs", f"bonds.{number}.pairs"
    yield from _files_of_regions(tables)
    particles = tables.get("particles")
    shapes = particles.get("shapes") if isinstance(particles, dict) else None
    for number, shape in enumerate(shapes if isinstance(shapes, list) else ()):
        if isinstance(shape, dict):
            yield shape, "file", f"particles.shapes.{number}.file"
    start = tables.get("start")
    added = start.get("add") if isinstance(start, dict) else None
    if isinstance(added, dict):
        yield from ((holder, key, f"start.add{dotted[9:]}") for holder, key, dotted in _file_keys({"particles": added}))


def _files_of_regions(tables: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str, str]]:
    """As `_file_keys`, of the regions that are meshes."""
    held: list[tuple[str, Any]] = []
    for table, names in (("particles", ("pack", "inlet")), ("bonds", ())):
        holder = tables.get(table)
        if isinstance(holder, list):
            held.append((table, holder))
        elif isinstance(holder, dict):
            held += [(f"{table}.{name}", holder.get(name)) for name in names]
    for key, values in held:
        several = values if isinstance(values, list) else [values]
        for number, one in enumerate(several):
            region = one.get("region") if isinstance(one, dict) else None
            if isinstance(region, dict):
                where = f"{key}.{number}" if isinstance(values, list) else key
                yield region, "file", f"{where}.region.file"
    for table, key in (("start", "remove"), ("surface", "regions")):
        holder = tables.get(table)
        regions = holder.get(key) if isinstance(holder, dict) else None
        for number, region in enumerate(regions if isinstance(regions, list) else ()):
            if isinstance(region, dict):
                yield region, "file", f"{table}.{key}.{number}.file"


def require_files(tables: dict[str, Any]) -> None:
    """Refuses tables with absolute names of files that name one that is not there.

    Raises:
        InputError: naming the key.
    """
    for holder, key, dotted in _file_keys(tables):
        name = holder.get(key)
        if isinstance(name, str) and key != "from" and not Path(name).exists():
            raise InputError(dotted, name, "no such file", "give a name relative to the scene file")


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
        limit, remedy = f"is not valid TOML: {error}{_line_of(path, str(error))}", "correct that line"
    except ValueError as error:
        limit, remedy = str(error), "correct the scene"
    raise InputError("SCENE", str(path), limit, remedy)


def _line_of(path: Path, message: str) -> str:
    """The line that a message of the TOML parser names."""
    number = re.search(r"at line (\d+)", message)
    lines = read_text(path).splitlines()
    if number is None or int(number[1]) > len(lines):
        return ""
    return f": {lines[int(number[1]) - 1].strip()}"


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
    for number, stage in enumerate(tables["stages"] if isinstance(tables.get("stages"), list) else ()):
        if isinstance(stage, dict):
            tables["stages"][number] = _absolute_files(stage, folder)
    for holder, key, dotted in _file_keys(tables):
        if isinstance(holder.get(key), str):
            _refuse_quoted_number(dotted, holder[key])
            try:
                holder[key] = str((folder / holder[key]).resolve())
            except (OSError, ValueError, RuntimeError) as error:
                limit = f"cannot be the name of a file ({error})"
                raise InputError(dotted, holder[key], limit, "correct the name") from None
    return tables


def _refuse_quoted_number(key: str, value: str) -> None:
    try:
        float(value)
    except ValueError:
        return
    raise InputError(key, value, "is a number in quotes, which would be the name of a file", "remove the quotes")


def _copy(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _copy(v) for k, v in value.items()}
    if hasattr(value, "tolist"):  # an array; NumPy is not imported for those that a scene has not
        return value.tolist()
    return [_copy(v) for v in value] if isinstance(value, list | tuple) else value

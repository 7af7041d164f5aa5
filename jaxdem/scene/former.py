"""What a scene with `[start]` takes from the scene of the run that it begins from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jaxdem.errors import InputError, cut, number_of_tables
from jaxdem.files.reading import parse_toml, read_text

OWN_KEYS = ("inlet",)
"""Of `[particles]`, what a scene has of its own."""

WHO_IS_BONDED = ("gap", "region")
"""Of a table of `[[bonds]]`, what only new bonds are made by. `pairs` are compared with the bonds that there are."""

MERGED = "coarse_grain"
"""Key of `[particles]` that may be larger than in the run: its particles are merged into parcels at the start."""


def with_former(tables: dict[str, Any], former: Mapping[str, Any]) -> dict[str, Any]:
    """The tables of a scene with what it takes from the scene of the former run: its particles, its depth,
    and its bonds unless it has tables of its own.

    Args:
        tables: of the scene, with a table `[start]`.
        former: tables of the scene of the run that it begins from, every default written out.

    Raises:
        InputError: another number of dimensions, a key of `[particles]` or of who is bonded that differs, or materials
            that its particles have not.
    """
    from jaxdem.io.scene_text import comes_and_goes  # with h5py, which other scenes do without

    start, domain, before = tables["start"], tables.get("domain"), former.get("domain", {})
    name = start.get("from")
    if isinstance(domain, dict) and isinstance(domain.get("size"), list):
        if len(domain["size"]) != len(before.get("size", [])):
            limit = f"the run {name} has the box {before.get('size')}, and the number of axes cannot change"
            raise InputError("domain.size", domain["size"], limit, "give as many sides as that run has")
        if len(domain["size"]) == 2 and "depth" in before:
            domain = {"depth": before["depth"], **domain}
    materials = tables.get("materials")
    if isinstance(materials, list) and materials and former.get("particles") and not former.get("materials"):
        limit = f"the particles of the run {name} have no material"
        raise InputError("materials", number_of_tables(materials), limit, "remove [[materials]]")
    particles = _particles(tables.get("particles"), former.get("particles"), name)
    known = {"domain": domain, "particles": particles}
    if former.get("bonds"):
        known["bonds"] = tables.get("bonds", former["bonds"])
        _check_bonds(known["bonds"], former["bonds"], name)
    # Parcels that are made at the start are all there.
    ratios = [table.get(MERGED, 1.0) for table in (particles, former.get("particles")) if isinstance(table, dict)]
    merging = len(ratios) == 2 and ratios[0] != ratios[1]
    absent = (comes_and_goes(former) and not merging) or bool(start.get("remove"))
    return {**tables, **{key: value for key, value in known.items() if value is not None}} | {
        "start": {"absent": absent, **start}
    }


def scene_of(folder: object) -> dict[str, Any]:
    """Tables of the scene of a run.

    Raises:
        InputError: there is none in the folder, or it cannot be read.
    """
    from jaxdem.io.run_folder import SCENE

    remedy = "give the folder that `jaxdem run` wrote, relative to the scene file"
    if not isinstance(folder, str):
        raise InputError("start.from", folder, "must name a run directory", remedy)
    try:
        return parse_toml(read_text(Path(folder) / SCENE))
    except FileNotFoundError:
        raise InputError("start.from", folder, f"is no run directory: it has no {SCENE}", remedy) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError("start.from", folder, f"its {SCENE} cannot be read ({reason})", remedy) from None


def remembered(own: Mapping[str, Any]) -> dict[str, Any]:
    """The former scene as far as a scene that began from it, and was stored with its run, still knows it.

    So a run is resumed when the run that it began from has been deleted.
    """
    particles = {key: value for key, value in own.get("particles", {}).items() if key not in OWN_KEYS}
    known: dict[str, Any] = {"domain": own.get("domain", {}), "start": {"absent": own["start"].get("absent", False)}}
    kept = {name: own[name] for name in ("bonds", "materials") if own.get(name)}
    return known | ({"particles": particles} if particles else {}) | kept


def _particles(given: object, before: Mapping[str, Any] | None, name: object) -> object:
    """The table `[particles]`: that of the former run, with the inlets of this scene."""
    if before is None or not isinstance(given, dict | None):
        return given
    kept = {key: value for key, value in before.items() if key not in OWN_KEYS}
    own = (*OWN_KEYS, MERGED)
    _check_merge(given or {}, before, name)
    for key, value in (given or {}).items():
        if key not in own and not _agrees(value, kept.get(key)):
            there = cut(repr(kept.get(key, "(not set)")), 100)
            limit = f"the particles are those of the run {name}, whose scene has {there}"
            remedy = f"remove particles.{key}; [start.add] adds particles, and inlets have keys of their own"
            raise InputError(f"particles.{key}", cut(repr(value), 100), limit, remedy)
    return kept | {key: value for key, value in (given or {}).items() if key in own}


def _check_bonds(given: object, before: Sequence[Mapping[str, Any]], name: object) -> None:
    """Refuses other keys for who is bonded than those by which the bonds that go on were made, and further tables.

    Raises:
        InputError: naming the key.
    """
    own = [table for table in given if isinstance(table, dict)] if isinstance(given, list) else []
    remedy = "give it as there: bonds are made once, and their other keys may change"
    for number, (table, made) in enumerate(zip(own, before, strict=False)):
        for key in WHO_IS_BONDED:
            if not (key in table or key in made) or _agrees(table.get(key), made.get(key)):
                continue
            there = cut(repr(made.get(key, "(not set)")), 100)
            limit = f"the bonds are those of the run {name}, whose scene has {there}"
            raise InputError(f"bonds.{number}.{key}", cut(repr(table.get(key)), 100), limit, remedy)
    if len(own) > len(before):
        limit = f"the bonds are those of the run {name}, which has {number_of_tables(before)}"
        remedy = "remove the further ones: a run with bonds makes no new ones"
        raise InputError("bonds", number_of_tables(own), limit, remedy)


def _check_merge(given: Mapping[str, Any], before: Mapping[str, Any], name: object) -> None:
    """Refuses parcels smaller than those of the run.

    Raises:
        InputError: naming both.
    """
    ratio, former = given.get(MERGED), before.get(MERGED, 1.0)
    if isinstance(ratio, int | float) and ratio < former:
        limit = f"the run {name} has parcels of l = {former:g}, and a parcel cannot be divided into smaller ones"
        raise InputError(f"particles.{MERGED}", ratio, limit, f"set it to {former:g} or more")


def _agrees(given: object, stored: object) -> bool:
    """Whether a value is the stored one, whose tables have every default written out."""
    if isinstance(given, dict) and isinstance(stored, dict):
        return all(_agrees(value, stored.get(key)) for key, value in given.items())
    if isinstance(given, list) and isinstance(stored, list):
        return len(given) == len(stored) and all(map(_agrees, given, stored))
    return given == stored and isinstance(given, bool) == isinstance(stored, bool)

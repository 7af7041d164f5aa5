"""From tables to a scene, checked as a whole."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from jaxdem.scene.completed import completed
from jaxdem.scene.former import scene_of, with_former
from jaxdem.scene.messages import as_input_error
from jaxdem.scene.scene import Scene


def scene_of_tables(tables: dict[str, Any], former: Mapping[str, Any] | None = None) -> Scene:
    """The scene of tables whose files are named by absolute paths; see `load_scene`."""
    if isinstance(tables.get("start"), dict):
        tables = with_former(tables, scene_of(tables["start"].get("from")) if former is None else former)
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
    known = tuple(name for name in names if isinstance(name, str))
    return {"materials": known, "begins_later": tables.get("start") is not None, **dimension}

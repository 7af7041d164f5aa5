"""Writes the keys of a scene file, from `jaxdem/scene/reference.py`, into `docs/scene.md`; a test compares the two."""

from __future__ import annotations

import inspect
from pathlib import Path

from jaxdem.scene.reference import rows, tables

PAGE = Path(__file__).parents[1] / "scene.md"
MARK = "<!-- written by docs/tools/scene_reference.py from here on -->"


def markdown() -> str:
    """All tables."""
    lines = []
    for heading, model in tables():
        lines += [f"## {heading if heading[0] != '[' else f'`{heading}`'}", ""]
        lines += [inspect.cleandoc(model.__doc__ or "").split("\n\n")[0], ""]
        lines += ["| key | type | unit | default | meaning |", "| --- | --- | --- | --- | --- |"]
        for key, kind, unit, preset, text in rows(model):
            cells = (
                f"`{key}`",
                kind,
                unit.replace("m2", "m²").replace("m3", "m³").replace("s2", "s²"),
                preset,
                text,
            )
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
        lines.append("")
    return "\n".join(lines)


def filled(page: str) -> str:
    """The page with its tables written anew."""
    return page[: page.index(MARK)] + f"{MARK}\n\n{markdown()}"


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")

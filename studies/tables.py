"""Tables of a study's results: as numbers in results.json, as text in tables.md."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from jaxdem.errors import InputError
from jaxdem.files.durable import write_bytes
from jaxdem.files.reading import parse_json, read_text
from jaxdem.io.access import reason_of
from jaxdem.report.page import PageSection, PageTable

Cell = str | float | int | None
"""A word, a number, or None for what is missing."""


@dataclasses.dataclass
class Table:
    """A table.

    Attributes:
        title: what it shows, with units.
        headings: one a column.
        rows: cells.
        note: what one must know to read it.
        digits: of numbers in the text.
    """

    title: str
    headings: list[str]
    rows: list[list[Cell]]
    note: str = ""
    digits: int = 3

    @classmethod
    def of(cls, title: str, rows: Sequence[Mapping[str, Cell]], note: str = "", digits: int = 3) -> Table:
        """The table of rows heading -> cell, which all have the same headings."""
        headings = list(rows[0]) if rows else []
        return cls(title, headings, [[row[heading] for heading in headings] for row in rows], note, digits)

    def markdown(self) -> str:
        """The table as Markdown."""
        lines = [f"**{self.title}**", "", _line(self.headings), _line(["---"] * len(self.headings))]
        lines += [_line([shown(cell, self.digits) for cell in row]) for row in self.rows]
        return "\n".join([*lines, *(["", self.note] if self.note else []), ""])

    def page(self) -> PageTable:
        """The table for a report."""
        rows = [[shown(cell, self.digits) for cell in row] for row in self.rows]
        return PageTable(self.title, self.headings, rows, self.note)


@dataclasses.dataclass
class Section:
    """What one part of a study found.

    Attributes:
        name: of the part.
        title: heading.
        text: sentences.
        tables: of numbers.
        missing: what the part needed and did not get, name -> why.
    """

    name: str
    title: str
    text: list[str] = dataclasses.field(default_factory=list)
    tables: list[Table] = dataclasses.field(default_factory=list)
    missing: dict[str, str] = dataclasses.field(default_factory=dict)

    def markdown(self) -> str:
        """The section as Markdown."""
        blocks = [f"## {self.title}", "\n".join(f"- {sentence}" for sentence in self.text)]
        blocks += [table.markdown() for table in self.tables if table.rows]
        if self.missing:
            reasons: dict[str, list[str]] = {}
            for name, why in self.missing.items():
                reasons.setdefault(why, []).append(name)
            lines = [f"- {why}: {', '.join(names)}" for why, names in reasons.items()]
            blocks.append("Missing:\n\n" + "\n".join(lines))
        return "\n\n".join(block for block in blocks if block) + "\n"

    def page(self) -> PageSection:
        """The section for a report."""
        missing = [f"Missing: {', '.join(self.missing)}."] if self.missing else []
        return PageSection(self.title, [*self.text, *missing], [table.page() for table in self.tables if table.rows])


def shown(cell: Cell, digits: int = 3) -> str:
    """A cell as text; a dash for what is missing."""
    if isinstance(cell, str):
        return cell
    if cell is None or not math.isfinite(cell):
        return "-"
    return str(cell) if isinstance(cell, int) else f"{cell:,.0f}" if abs(cell) >= 1000 else f"{cell:.{digits}g}"


def write_results(
    out: Path, sections: Iterable[Section], about: Mapping[str, Any], order: Iterable[str]
) -> list[Section]:
    """results.json and tables.md; parts of an earlier call that are not among `sections` are kept.

    Args:
        out: the study's folder.
        sections: of the parts looked at now.
        about: how they were made.
        order: of the parts.

    Returns:
        All sections, those kept among them.
    """
    file, found = out / "results.json", {}
    if file.is_file():
        try:
            found = parse_json(read_text(file))["parts"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            limit = f"cannot be read ({reason_of(error)})"
            raise InputError(file.name, str(file), limit, "Remove it; it is written anew.") from error
    found |= {section.name: _plain(dataclasses.asdict(section) | {"about": dict(about)}) for section in sections}
    parts = {name: found[name] for name in order if name in found}
    write_bytes(file, (json.dumps({"parts": parts}, indent=1) + "\n").encode())
    every = []
    for part in parts.values():
        tables = [Table(**table) for table in part["tables"]]
        every.append(Section(**{name: part[name] for name in ("name", "title", "text", "missing")}, tables=tables))
    write_bytes(out / "tables.md", "\n".join(section.markdown() for section in every).encode())
    return every


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _plain(value: Any) -> Any:
    """What JSON can hold: numbers that are not finite become null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, str | int | bool) else float(value)

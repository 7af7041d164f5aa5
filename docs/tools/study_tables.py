"""The tables of docs/results/injection_study.md, from the study's numbers in benchmarks/results/injection_study.json.

    python docs/tools/study_tables.py

A table follows a line `<!-- table: PART: TITLE -->`. With `: HEADING; HEADING` it has these columns only, and with a
further `: CELL; CELL` only the rows that begin with one of these.
The numbers are `results.json` of `python -m studies injection`.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))  # run as a script from anywhere

from studies.tables import Table  # noqa: E402

PAGE = ROOT / "docs" / "results" / "injection_study.md"
NUMBERS = ROOT / "benchmarks" / "results" / "injection_study.json"

MARKED = re.compile(r"<!-- table: (?P<spec>[^\n]*?) -->\n(?:\n(?:\|[^\n]*\n)+)?")

SHORT = {
    "mean drag force": "drag force",
    "mean particle speed": "grain speed",
    "mean collision force": "collision force",
    "mean fluid pressure": "pressure",
    "mean fluid speed": "fluid speed",
    "median fluid speed": "its median",
}
"""Headings that would make tables of nine metrics too wide."""


def filled(page: str, parts: dict[str, Any]) -> str:
    """The page with the tables of `parts`, the entry of that name in results.json."""
    return MARKED.sub(lambda match: _marked(match["spec"], parts), page)


def _marked(spec: str, parts: dict[str, Any]) -> str:
    part, title, *chosen = spec.split(": ")
    columns, first = (words.split("; ") for words in (*chosen, "", "")[:2])
    table = next((one for one in parts[part]["tables"] if one["title"] == title), None)
    if table is None:
        raise SystemExit(f"{spec}: the part has {[one['title'] for one in parts[part]['tables']]}")
    headings = table["headings"]
    places = [headings.index(heading) for heading in columns] if columns != [""] else range(len(headings))
    kept = [row for row in table["rows"] if first == [""] or row[0] in first]
    chosen_rows = [[row[place] for place in places] for row in kept]
    names = [SHORT.get(headings[place], headings[place]) for place in places]
    lines = Table("", names, chosen_rows).markdown().split("\n\n", 1)[1]
    return f"<!-- table: {spec} -->\n\n{lines}"


def main() -> None:
    """Writes the page."""
    page = PAGE.read_text(encoding="utf-8")
    numbers = json.loads(NUMBERS.read_text(encoding="utf-8"))["parts"]
    PAGE.write_text(filled(page, numbers), encoding="utf-8")


if __name__ == "__main__":
    main()

"""What helps with a key that is missing or stands in the wrong table; read from the description of the keys."""

from __future__ import annotations

import re

from jaxdem.scene.reference import TOP, rows, tables


def tables_with(name: str) -> list[str]:
    """Headings of the tables that have a key of this name, or of the table itself where it is one at the top."""
    found = []
    for heading, model in tables():
        fields = {field.alias or key for key, field in model.model_fields.items()}
        if name in fields:
            found.append(f"[{name}]" if heading == TOP else heading)
    return found


def meaning_of(key: str) -> str:
    """What a dotted key is, in short, with its unit; empty for one that is not known."""
    key = re.sub(r"\.\d+(?=\.|$)", "", key)
    table, _, name = re.sub(r"^boundary\.\w+\.", "boundary.<side>.", key).rpartition(".")
    for heading, model in tables():
        if table != ("" if heading == TOP else heading.strip("[]")):
            continue
        for row, _, unit, _, meaning in rows(model):
            if row == name:
                short = re.split(r"[.;:](?: |$)| \(", meaning)[0]
                return short[0].lower() + short[1:] + (f" [{unit}]" if unit else "")
    return ""

"""Text with a row of names, then one row for each particle: CSV, or columns separated by blanks."""

from __future__ import annotations

from jaxdem.errors import cut
from jaxdem.files.text_table import Line, fields_of, lines_of, number_of
from jaxdem.particle_files.raw import Raw, refusal


def read_text_table(name: str, text: str) -> Raw:
    """The columns of a text file; # begins a comment, blank lines do not count.

    Raises:
        InputError: it has no row of names, no other row, or a row of another number of columns.
    """
    lines = lines_of(text, "#")
    if not lines:
        raise refusal(name, "holds nothing", "give a row of names, then one row for each particle")
    head, *rows = lines
    names = fields_of(head.text)
    if any(number_of(field) is not None for field in names):
        limit = f"{cut(repr(head.text), 100)} is no row of names"
        remedy = "begin the file with the names of its columns, such as x,y,z,radius"
        raise refusal(f"line {head.number} of {name}", limit, remedy)
    if not rows:
        raise refusal(name, "has names of columns and no particle", "give one row for each particle")
    split = split_rows(name, names, rows)
    return Raw(
        names=names,
        values=[list(column) for column in zip(*split, strict=True)],
        header=f"line {head.number} of {name}",
        place=lambda row: f"line {rows[row].number} of {name}",
        strict=True,
    )


def split_rows(name: str, names: list[str], rows: list[Line]) -> list[list[str]]:
    """The fields of every row, as many as there are names.

    Raises:
        InputError: a row has another number of columns.
    """
    split = [fields_of(line.text) for line in rows]
    for line, fields in zip(rows, split, strict=True):
        if len(fields) != len(names):
            expected = f"{len(names)}: {cut(' '.join(names), 160)}"
            limit = f"{cut(repr(line.text), 100)} has {len(fields)} column(s), expected are {expected}"
            remedy = "give every row all columns, separated by commas or blanks, with decimal points"
            raise refusal(f"line {line.number} of {name}", limit, remedy)
    return split

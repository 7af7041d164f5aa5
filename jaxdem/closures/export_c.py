"""A closure as one C header: float32, static weights, nothing but <math.h>."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxdem.closures.base import DragClosure, asked_inputs
from jaxdem.closures.export_trace import OPERATIONS, UNITS, VECTORS, ExportedDrag, Result, moved, trace, walk

UNROLLED = 8
"""Up to this size every element is a statement of its own; beyond it there is a loop."""

HEADER = """\
/* Drag closure exported by jaxdem {version}; float32, SI units, no dependencies but <math.h>.

{about}

   {name}_drag(&inputs) gives the drag on one particle; the force is in the result, and so are its two parts for a
   solver that treats the coefficient implicitly. Do not compile with -ffast-math: out_of_range relies on comparisons
   with infinities and NaN. */
#ifndef {guard}
#define {guard}

#include <math.h>

typedef struct {{
{inputs}
}} {name}_inputs;

typedef struct {{
{outputs}
}} {name}_result;

{tables}static inline {name}_result {name}_drag(const {name}_inputs *in)
{{
    {name}_result out;
{body}
    return out;
}}

#endif
"""


def c_header(closure: DragClosure, dimension: int, name: str, about: str, version: str) -> str:
    """Text of a C header (C99, also C++) with the function `NAME_drag`.

    Args:
        closure: drag closure.
        dimension: D, components of the vectors.
        name: C identifier that all names begin with.
        about: description for the comment at the top.
        version: of jaxdem.
    """
    writer = CWriter(name)
    inputs = [
        np.array([f"in->{field}[{i}]" for i in range(dimension)], object)
        if field in VECTORS
        else np.array(f"in->{field}", object)
        for field in asked_inputs(closure)
    ]
    results = ExportedDrag(*walk(trace(closure, dimension), inputs, writer.apply))
    for field, value in results._asdict().items():
        for index, element in np.ndenumerate(expressions(value)):
            place = f"out.{field}" + "".join(f"[{i}]" for i in index)
            writer.lines.append((None, f"{place} = {element};"))
    used = writer.used_lines()
    body = "\n".join(f"    {line}" for line in used)
    tables = [text for table, text in writer.tables.items() if re.search(rf"\b{table}\b", body)]
    return HEADER.format(
        version=version,
        about="\n".join(f"   {line}".rstrip() for line in about.replace("*/", "* /").splitlines()),
        name=name,
        guard=f"{name.upper()}_H",
        inputs=_members(asked_inputs(closure), dimension),
        outputs=_members(ExportedDrag._fields, dimension),
        tables="".join(f"{table}\n\n" for table in tables),
        body=body,
    )


class CWriter:
    """Statements of the function; a value is a numpy array of C expressions, one for each element.

    Moving elements about (reshape, slice, concatenate, ...) is then done by numpy and needs no statement.
    """

    def __init__(self, name: str):
        self.name = name
        self.lines: list[tuple[str | None, str]] = []
        self.tables: dict[str, str] = {}
        self.known: dict[str, str] = {}
        self.numbers = itertools.count(1)

    def apply(
        self, operation: str, operands: Sequence[np.ndarray], settings: dict[str, Any], result: Result
    ) -> np.ndarray:
        """One operation; see `jaxdem.closures.export_trace.Apply`."""
        if operation == "dot_general":
            return self._product(operands[0], operands[1], result.shape)
        values = [expressions(value) for value in operands]
        if operation in OPERATIONS:
            return self._elementwise(OPERATIONS[operation].c, values, result)
        if operation in ("reduce_sum", "reduce_and"):
            return self._reduced(" + " if operation == "reduce_sum" else " && ", values[0], settings, result)
        if operation == "convert_element_type":
            return values[0]
        value = moved(operation, values, settings, result.shape)
        if value is not None:
            return value
        raise NotImplementedError(f"no C for the operation {operation}")

    def used_lines(self) -> list[str]:
        """The statements that the result depends on."""
        needed: set[str] = set()
        kept = []
        for name, text in reversed(self.lines):
            if name is None or name in needed:
                needed |= set(re.findall(r"\bt\d+\b", text))
                kept.append(text)
        return kept[::-1]

    def _elementwise(self, form: str, operands: list[np.ndarray], result: Result) -> np.ndarray:
        kind = "int" if result.dtype == bool else "float"
        operands = [np.broadcast_to(value, result.shape) for value in operands]
        if result.size <= UNROLLED:
            made = np.empty(result.shape, object)
            for index in np.ndindex(result.shape):
                expression = form.format(*(value[index] for value in operands))
                if expression not in self.known:
                    self.known[expression] = name = self._fresh()
                    self.lines.append((name, f"const {kind} {name} = {expression};"))
                made[index] = self.known[expression]
            return made
        name = self._fresh()
        expression = form.format(*(self._at(value, "i") for value in operands))
        self.lines.append((name, f"{kind} {name}[{result.size}];"))
        self.lines.append((name, f"for (int i = 0; i < {result.size}; ++i) {name}[i] = {expression};"))
        return elements(name, result.shape)

    def _reduced(self, joint: str, value: np.ndarray, settings: dict[str, Any], result: Result) -> np.ndarray:
        axes = settings["axes"]
        rows = np.moveaxis(value, axes, range(-len(axes), 0)).reshape(*result.shape, -1)
        form = joint.join(f"{{{i}}}" for i in range(rows.shape[-1]))
        return self._elementwise(form, [rows[..., i] for i in range(rows.shape[-1])], result)

    def _product(self, rows: np.ndarray, matrix: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        """(R, K) times a constant (K, M): a layer of a network."""
        if matrix.dtype != object:
            table = self._table(matrix.T)
            return np.concatenate([self._row_product(row, table, matrix.shape) for row in rows]).reshape(shape)
        raise NotImplementedError("no C for a product other than with constant weights")

    def _row_product(self, row: np.ndarray, table: str, sizes: tuple[int, ...]) -> np.ndarray:
        """(K,) times the transpose of a table (M, K)."""
        inputs, outputs = sizes
        name, sums = self._fresh(), self._at(row, "i")
        self.lines.append((name, f"float {name}[{outputs}];"))
        loop = (
            f"for (int j = 0; j < {outputs}; ++j) {{\n        float sum = 0.0f;\n"
            f"        for (int i = 0; i < {inputs}; ++i) sum += {table}[j][i] * {sums};\n"
            f"        {name}[j] = sum;\n    }}"
        )
        self.lines.append((name, loop))
        return elements(name, (outputs,))

    def _at(self, value: np.ndarray, index: str) -> str:
        """C expression of element `index` of a value, which is laid down as an array if it is none yet."""
        flat = expressions(value).ravel()
        if all(element == flat[0] for element in flat):
            return flat[0]
        name = flat[0].split("[")[0]
        if list(flat) == list(elements(name, flat.shape)) and not name.startswith("in->"):
            return f"{name}[{index}]"
        if not any(re.match(r"[a-z]", element) for element in flat):
            return f"{self._table(flat)}[{index}]"
        name = self._fresh()
        self.lines.append((name, f"const float {name}[{len(flat)}] = {{{', '.join(flat)}}};"))
        return f"{name}[{index}]"

    def _table(self, numbers: np.ndarray) -> str:
        """A static array of constants."""
        name = f"{self.name}_w{len(self.tables) + 1}"
        rows = expressions(numbers)
        sizes = "".join(f"[{size}]" for size in rows.shape)
        text = _braces(rows)
        self.tables[name] = f"static const float {name}{sizes} = {text};"
        return name

    def _fresh(self) -> str:
        return f"t{next(self.numbers)}"


def _members(fields: Sequence[str], dimension: int) -> str:
    """Members of a struct, each with its unit."""
    lines = []
    for field in fields:
        vector = field in VECTORS or field in ("remainder", "force")
        kind = "int" if field == "out_of_range" else "float"
        member = f"{kind} {field}{f'[{dimension}]' if vector else ''};"
        lines.append(f"    {member:<34}/* {UNITS[field]} */")
    return "\n".join(lines)


def elements(name: str, shape: tuple[int, ...]) -> np.ndarray:
    """C expressions of the elements of an array of this shape that lies flat under a name."""
    size = int(np.prod(shape))
    return np.array([f"{name}[{i}]" for i in range(size)], object).reshape(shape)


def expressions(value: np.ndarray) -> np.ndarray:
    """C expressions of a value; numbers become literals that give the same float32."""
    if value.dtype == object:
        return value
    made = np.empty(value.shape, object)
    for index, number in np.ndenumerate(value):
        made[index] = str(int(number)) if value.dtype == bool else _literal(float(np.float32(number)))
    return made


def _literal(number: float) -> str:
    if np.isnan(number):
        return "NAN"
    if np.isinf(number):
        return "INFINITY" if number > 0 else "-INFINITY"
    text = f"{number:.9g}"
    return text + ("f" if any(mark in text for mark in ".e") else ".0f")


def _braces(rows: np.ndarray) -> str:
    if rows.ndim > 1:
        return "{\n" + ",\n".join(_braces(row) for row in rows) + "}"
    lines = ["    " + ", ".join(rows[start : start + 8]) for start in range(0, len(rows), 8)]
    return "{\n" + ",\n".join(lines) + "}"

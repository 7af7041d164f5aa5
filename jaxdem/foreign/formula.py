"""Formulas of `variable NAME equal ...`, `$(...)` and `if`: numbers, + - * / ^, comparisons, functions; nothing of a
running simulation."""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable

from jaxdem.foreign.notes import Unknown

MOST_CHARACTERS = 1000
BINARY: dict[type, Callable[[float, float], float]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
    ast.Div: operator.truediv, ast.Pow: operator.pow, ast.Mod: math.fmod,
}  # fmt: skip
COMPARED: dict[type, Callable[[float, float], bool]] = {
    ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Lt: operator.lt,
    ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge,
}  # fmt: skip
FUNCTIONS: dict[str, Callable[..., float]] = {
    "sqrt": math.sqrt, "exp": math.exp, "ln": math.log, "log": math.log10, "abs": abs, "sin": math.sin,
    "cos": math.cos, "tan": math.tan, "asin": math.asin, "acos": math.acos, "atan": math.atan, "atan2": math.atan2,
    "ceil": math.ceil, "floor": math.floor, "round": round,
}  # fmt: skip
WORDS = re.compile(r"""\s*["']?([^"'=!<>&|]+?)["']?\s*(==|!=)\s*["']?([^"'=!<>&|]+?)["']?\s*""")
"""A comparison of two words."""


def evaluate(text: str, variables: dict[str, str]) -> float:
    """The value of a formula; v_NAME is a variable. A comparison is 1 or 0.

    Raises:
        Unknown: it holds anything else, such as a quantity of the running simulation.
    """
    plain = text[:MOST_CHARACTERS].strip().strip('"').replace("^", "**")
    plain = re.sub(r"!(?!=)", " not ", plain.replace("&&", " and ").replace("||", " or "))
    try:
        return float(_value(ast.parse(plain.strip(), mode="eval").body, variables, 0))
    except (SyntaxError, ValueError, ArithmeticError, TypeError, RecursionError, MemoryError):
        raise Unknown(f"the formula {text[:60]!r} cannot be computed from numbers alone") from None


def holds(text: str, variables: dict[str, str]) -> bool:
    """Whether the condition of an `if` holds: a formula that is not 0, or two words that are equal or not.

    Raises:
        Unknown: it is neither.
    """
    words = WORDS.fullmatch(text)
    try:
        return evaluate(text, variables) != 0.0
    except Unknown:
        if words is None or any("_" in word or "(" in word for word in (words[1], words[3])):
            raise
        return (words[1] == words[3]) == (words[2] == "==")


def _value(node: ast.expr, variables: dict[str, str], depth: int) -> float:
    if depth > 100:
        raise ValueError
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    if isinstance(node, ast.BinOp) and type(node.op) in BINARY:
        left, right = (_value(side, variables, depth + 1) for side in (node.left, node.right))
        return BINARY[type(node.op)](left, right)
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in COMPARED:
        left, right = (_value(side, variables, depth + 1) for side in (node.left, node.comparators[0]))
        return float(COMPARED[type(node.ops[0])](left, right))
    if isinstance(node, ast.BoolOp):
        parts = [_value(one, variables, depth + 1) != 0.0 for one in node.values]
        return float(all(parts) if isinstance(node.op, ast.And) else any(parts))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd | ast.Not):
        value = _value(node.operand, variables, depth + 1)
        return (
            float(value == 0.0) if isinstance(node.op, ast.Not) else -value if isinstance(node.op, ast.USub) else value
        )
    if isinstance(node, ast.Name) and node.id == "PI":
        return math.pi
    if isinstance(node, ast.Name) and node.id.startswith("v_") and node.id[2:] in variables:
        return float(variables[node.id[2:]])
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in FUNCTIONS:
        return FUNCTIONS[node.func.id](*(_value(one, variables, depth + 1) for one in node.args))
    raise ValueError

"""Formulas of `variable NAME equal ...`: numbers, + - * / ^, functions; nothing of a running simulation."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable

from jaxdem.foreign.notes import Unknown

MOST_CHARACTERS = 1000
BINARY: dict[type, Callable[[float, float], float]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
    ast.Div: operator.truediv, ast.Pow: operator.pow, ast.Mod: math.fmod,
}  # fmt: skip
FUNCTIONS: dict[str, Callable[..., float]] = {
    "sqrt": math.sqrt, "exp": math.exp, "ln": math.log, "log": math.log10, "abs": abs, "sin": math.sin,
    "cos": math.cos, "tan": math.tan, "asin": math.asin, "acos": math.acos, "atan": math.atan, "atan2": math.atan2,
    "ceil": math.ceil, "floor": math.floor, "round": round,
}  # fmt: skip


def evaluate(text: str, variables: dict[str, str]) -> float:
    """The value of a formula; v_NAME is a variable.

    Raises:
        Unknown: it holds anything else, such as a quantity of the running simulation.
    """
    try:
        tree = ast.parse(text[:MOST_CHARACTERS].strip().strip('"').replace("^", "**"), mode="eval")
        return float(_value(tree.body, variables, 0))
    except (SyntaxError, ValueError, ArithmeticError, TypeError, RecursionError, MemoryError):
        raise Unknown(f"the formula {text[:60]!r} cannot be computed from numbers alone") from None


def _value(node: ast.expr, variables: dict[str, str], depth: int) -> float:
    if depth > 100:
        raise ValueError
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    if isinstance(node, ast.BinOp) and type(node.op) in BINARY:
        left, right = (_value(side, variables, depth + 1) for side in (node.left, node.right))
        return BINARY[type(node.op)](left, right)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        sign = -1.0 if isinstance(node.op, ast.USub) else 1.0
        return sign * _value(node.operand, variables, depth + 1)
    if isinstance(node, ast.Name) and node.id == "PI":
        return math.pi
    if isinstance(node, ast.Name) and node.id.startswith("v_") and node.id[2:] in variables:
        return float(variables[node.id[2:]])
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in FUNCTIONS:
        return FUNCTIONS[node.func.id](*(_value(one, variables, depth + 1) for one in node.args))
    raise ValueError

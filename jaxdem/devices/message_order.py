"""Messages between devices in one order, given by data.

XLA runs a program on a processor as a graph: what does not depend on each other goes on at once. Messages of one level
of the program are started in their order, but a loop or a branch counts as started when its first part is: a message
behind it may overtake those within it on one device and not on another, and both wait for ever. Here such a message
depends on what the loop gives, and the loop on what is before it, through a value that XLA cannot know to have no
effect.
Results are the same bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any
from weakref import WeakKeyDictionary

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn, Literal, Var

MESSAGES = frozenset({"psum", "pmax", "pmin", "ppermute", "all_gather", "all_to_all", "reduce_scatter"})
"""Names of primitives that are messages."""

CALLS = frozenset({"jit", "closed_call"})
"""Names of primitives that are nothing but what they call."""

CONTROL_FLOW = {"while": ("cond_jaxpr", "body_jaxpr"), "scan": ("jaxpr",), "cond": ("branches",)}
"""Names of primitives that run others as one part of the graph, and of their parameters."""

SOLVE = "custom_linear_solve"
"""A primitive of which only the part `solve` is run."""


def in_one_order(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function, whose messages follow each other in the order in which it sends them.

    Messages within `jax.checkpoint`, and those of a reverse pass over the function, are not ordered.

    Args:
        function: of arrays or trees of them, for the inside of `jax.shard_map`.
    """

    def ordered(*arguments: Any) -> Any:
        closed, shape = jax.make_jaxpr(function, return_shape=True)(*arguments)
        values = _run(closed.jaxpr, closed.consts, jax.tree.leaves(arguments))
        return jax.tree.unflatten(jax.tree.structure(shape), values)

    return ordered


class _Order:
    """What the next message has to wait for: flags, () bool, that are False and that XLA cannot know to be."""

    def __init__(self) -> None:
        self._control_flow: Array | None = None
        self._since: list[Array] = []

    def before_message(self) -> Array | None:
        return self._control_flow

    def before_control_flow(self) -> Array | None:
        flags = self._since if self._control_flow is None else [self._control_flow, *self._since]
        return jnp.any(jnp.stack(flags)) if flags else None

    def sent(self, value: Array) -> None:
        self._since.append(_flag(value))

    def left(self, value: Array) -> None:
        self._control_flow, self._since = _flag(value), []


def _run(jaxpr: Jaxpr, consts: Sequence[Any], arguments: Sequence[Any], order: _Order | None = None) -> list[Any]:
    """Values of the outputs; a call goes on in the order of its caller."""
    order = _Order() if order is None else order
    values: dict[Var, Any] = dict(zip([*jaxpr.constvars, *jaxpr.invars], [*consts, *arguments], strict=True))

    def of(name: Var | Literal) -> Any:
        return name.val if isinstance(name, Literal) else values[name]

    for equation in jaxpr.eqns:
        with equation.ctx.manager:
            found = _equation(equation, [of(name) for name in equation.invars], order)
        values.update(zip(equation.outvars, found, strict=True))
    return [of(name) for name in jaxpr.outvars]


def _equation(equation: JaxprEqn, given: list[Any], order: _Order) -> list[Any]:
    name, parameters = equation.primitive.name, equation.params
    if not _sends(equation):
        return _bound(equation, given, parameters)
    if name in CALLS:
        inner = parameters["jaxpr" if "jaxpr" in parameters else "call_jaxpr"]
        return _run(inner.jaxpr, inner.consts, given, order)
    if name in MESSAGES:
        given[0] = _tied(given[0], order.before_message())
        found = _bound(equation, given, parameters)
        order.sent(found[0])
        return found
    if name not in CONTROL_FLOW and name != SOLVE:
        return _bound(equation, given, parameters)
    flag = order.before_control_flow()
    for number in _entries(equation):
        given[number] = _tied(given[number], flag)
    found = _bound(equation, given, parameters | _ordered_parts(equation))
    order.left(found[_exit(equation)])
    return found


def _bound(equation: JaxprEqn, given: list[Any], parameters: dict[str, Any]) -> list[Any]:
    found = equation.primitive.bind(*given, **equation.primitive.get_bind_params(parameters))
    return list(found) if equation.primitive.multiple_results else [found]


def _tied(value: Any, flag: Array | None) -> Any:
    """The value, for which the flag is needed."""
    if flag is None:
        return value
    value = jnp.asarray(value)
    other = ~value if value.dtype == bool else value + jnp.ones((), value.dtype)
    return lax.select(jnp.broadcast_to(flag, value.shape), other, value)


def _flag(value: Array) -> Array:
    """() bool, False: that a number is and is not itself holds of none."""
    one = lax.index_in_dim(value.reshape(-1), 0, keepdims=False).astype(jnp.float32)
    return (one != one) & (one == one)


def _parts(equation: JaxprEqn) -> Iterator[ClosedJaxpr | Jaxpr]:
    """What an equation runs."""
    if equation.primitive.name == SOLVE:
        yield equation.params["jaxprs"].solve
        return
    for parameter in equation.params.values():
        for one in parameter if isinstance(parameter, tuple | list) else (parameter,):
            if isinstance(one, ClosedJaxpr | Jaxpr):
                yield one


def _sends(equation: JaxprEqn) -> bool:
    """Whether it is or contains a message."""
    return equation.primitive.name in MESSAGES or any(_has_messages(_open(part)) for part in _parts(equation))


def _has_messages(jaxpr: Jaxpr) -> bool:
    if jaxpr not in _seen:
        _seen[jaxpr] = any(map(_sends, jaxpr.eqns))
    return _seen[jaxpr]


_seen: WeakKeyDictionary[Jaxpr, bool] = WeakKeyDictionary()
"""Which have messages: those of loops within loops are asked once for each."""


def _open(part: ClosedJaxpr | Jaxpr) -> Jaxpr:
    return part.jaxpr if isinstance(part, ClosedJaxpr) else part


def _ordered_parts(equation: JaxprEqn) -> dict[str, Any]:
    """Parameters of a loop, branch or solve whose own messages follow each other."""
    if equation.primitive.name == SOLVE:
        jaxprs = equation.params["jaxprs"]
        return {"jaxprs": jaxprs._replace(solve=_ordered(jaxprs.solve))}
    found: dict[str, Any] = {}
    for name in CONTROL_FLOW[equation.primitive.name]:
        parameter = equation.params[name]
        found[name] = tuple(map(_ordered, parameter)) if isinstance(parameter, tuple) else _ordered(parameter)
    return found


def _ordered(closed: ClosedJaxpr) -> ClosedJaxpr:
    if not any(_sends(equation) and equation.primitive.name not in MESSAGES for equation in closed.jaxpr.eqns):
        return closed
    given = [jax.ShapeDtypeStruct(x.shape, x.dtype, weak_type=x.weak_type) for x in closed.in_avals]
    return jax.make_jaxpr(lambda *values: _run(closed.jaxpr, closed.consts, values))(*given)


def _entries(equation: JaxprEqn) -> list[int]:
    """Which operands a loop, branch or solve cannot do without.

    Of a branch its number; of a loop the smallest that a message in it needs; all of a solve, whose messages are run as
    if they stood outside.
    """
    name, parameters = equation.primitive.name, equation.params
    if name == "cond":
        return [0]
    if name == SOLVE:
        avals: list[Any] = [x.aval for x in equation.invars]
        return [k for k, aval in enumerate(avals) if aval.size and np.issubdtype(aval.dtype, np.inexact)]
    body = parameters["body_jaxpr" if name == "while" else "jaxpr"].jaxpr
    needed: set[Var] = set()
    for inner in reversed(body.eqns):
        if _sends(inner) or any(x in needed for x in inner.outvars):
            needed.update(x for x in inner.invars if isinstance(x, Var))
    first = parameters["cond_nconsts"] if name == "while" else 0
    return [first + _smallest([x.aval if x in needed else None for x in body.invars])]


def _exit(equation: JaxprEqn) -> int:
    """Which result of a loop, branch or solve needs its messages: the smallest that one of them changes."""
    if equation.primitive.name == SOLVE:
        return 0
    changed = [False] * len(equation.outvars)
    for part in _parts(equation):
        body, later = _open(part), set()
        for inner in body.eqns:
            if _sends(inner) or any(x in later for x in inner.invars if isinstance(x, Var)):
                later.update(inner.outvars)
        if len(body.outvars) == len(changed):
            changed = [one or x in later for one, x in zip(changed, body.outvars, strict=True)]
    return _smallest([x.aval if one else None for x, one in zip(equation.outvars, changed, strict=True)])


def _smallest(arrays: Sequence[Any]) -> int:
    """Number of the array with the fewest elements but some, of fractions before others; None are left out.

    Raises:
        ValueError: there is none.
    """
    some = [k for k, x in enumerate(arrays) if x is not None and x.size]
    return min(some, key=lambda k: (not np.issubdtype(arrays[k].dtype, np.inexact), arrays[k].size))

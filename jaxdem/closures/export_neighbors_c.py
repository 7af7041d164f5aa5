"""A closure of neighbours as a C header: what a neighbour adds to sums, and what force and torque the sums give."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.export_c import CWriter, elements, expressions
from jaxdem.closures.export_trace import walk
from jaxdem.closures.moments import Offset, carried_moments
from jaxdem.closures.neighbors import NeighborClosure, Response, conditions, presence

HEADER = """\
/* Closure of neighbours exported by jaxdem {version}; float32, no dependencies but <math.h>.

{about}

   What the neighbours of a sphere add to its mean force. F is the mean force of the whole fluid on it at this Re and
   solid fraction, d the diameter. Offsets are in diameters, neighbour less sphere, in a right-handed frame of the
   sphere whose first axis is along its slip (fluid less sphere). For each sphere:

     1. set {name}_SUMS sums to zero;
        {name}_add(offset, sums) for every neighbour within {reach:g} diameters;
{second}     {last}. {name}_response(sums, {handed}reynolds, solid_fraction, response):
        response[0] is the force along the slip, [1] and [2] that along the other two axes, over F; [3] to [5] the
        torque about the three axes, over F d; [6] is 1 in the range of the data and 0 far from it, and is a factor of
        the others already.

   In model A the mean drag is times 1 + response[0] / void fraction, in model B times 1 + response[0]. Re is that of
   the superficial slip. Do not compile with -ffast-math. */
#ifndef {guard}
#define {guard}

#include <math.h>

#define {name}_SUMS {sums}
{size}
{body}
#endif
"""

SECOND = """\
     2. {name}_force(sums, reynolds, solid_fraction, force): what the sphere hands on to its neighbours;
     3. set {name}_CARRIED sums to zero; {name}_carry(offset, force, carried) for every neighbour, with the force of the
        neighbour from step 2 turned into the frame of the sphere;
"""


def neighbor_header(closure: NeighborClosure, name: str, about: str, version: str) -> str:
    """Text of a C header (C99, also C++); what its functions are is said in it.

    Args:
        closure: of one level or two.
        name: C identifier that all names begin with.
        about: description for the comment at the top.
        version: of jaxdem.
    """
    sums = _sizes(lambda place: closure.moments(_one(place), _THERE), 3)
    carried = [] if closure.carried is None else _sizes(lambda both: _carried(closure, both[:3], both[3:]), 6)
    length, further = (sum(int(np.prod(shape)) for shape in shapes) for shapes in (sums, carried))
    flow = {"reynolds": (), "solid_fraction": ()}

    def add(offset: Array) -> Array:
        return _flat(closure.moments(_one(offset), _THERE))

    def force(values: Array, reynolds: Array, solid_fraction: Array) -> Array:
        found = _cut(values, sums)
        level = closure.levels[0].values(
            closure.levels[0].mixed(found), conditions(reynolds[None], solid_fraction[None])
        )
        return presence(found[0][:, 0, 0]) * level[0, :3]

    def carry(offset: Array, vector: Array) -> Array:
        return _flat(_carried(closure, offset, vector))

    def response(values: Array, *rest: Array) -> Array:
        found, level = _cut(values, sums), closure.levels[-1]
        mixed = level.mixed(found)
        if carried:
            more = level.mixed(_cut(rest[0], carried), further=True)
            mixed = (*(one + other for one, other in zip(mixed, more, strict=False)), *mixed[len(more) :])
        flows = rest[-2][None], rest[-1][None]
        return _row(closure.response(level.values(mixed, conditions(*flows)), found[0][:, 0, 0], *flows))

    both = {"sums": (length,), **({"carried": (further,)} if carried else {}), **flow}
    functions = [_function(f"{name}_add", add, {"offset": (3,)}, "sums", length, "+=")]
    if carried:
        functions.append(_function(f"{name}_force", force, {"sums": (length,), **flow}, "force", 3))
        functions.append(_function(f"{name}_carry", carry, {"offset": (3,), "force": (3,)}, "carried", further, "+="))
    functions.append(_function(f"{name}_response", response, both, "response", 7))
    return HEADER.format(
        version=version,
        about="\n".join(f"   {line}".rstrip() for line in about.replace("*/", "* /").splitlines()),
        name=name,
        guard=f"{name.upper()}_H",
        reach=closure.reach,
        second=SECOND.format(name=name) if carried else "",
        last=4 if carried else 2,
        handed="carried, " if carried else "",
        sums=length,
        size=f"#define {name}_CARRIED {further}\n" if carried else "",
        body="\n".join(functions),
    )


_THERE: Any = np.ones((1, 1), bool)
"""One sphere with one neighbour."""


def _one(place: Array) -> Offset:
    """Offset of one neighbour of one sphere."""
    return place[0:1][None], place[1:2][None], place[2:3][None]


def _carried(closure: NeighborClosure, place: Array, vector: Array) -> tuple[Array, ...]:
    assert closure.carried is not None
    return carried_moments(closure.carried, _one(place), _THERE, _one(vector))


def _sizes(function: Callable[[Array], tuple[Array, ...]], inputs: int) -> list[tuple[int, ...]]:
    """Shapes of the moments of each order."""
    return [one.shape for one in jax.eval_shape(function, jax.ShapeDtypeStruct((inputs,), jnp.float32))]


def _flat(parts: Sequence[Array]) -> Array:
    return jnp.concatenate([part.reshape(-1) for part in parts])


def _cut(values: Array, shapes: Sequence[tuple[int, ...]]) -> tuple[Array, ...]:
    """The inverse of `_flat`."""
    found, first = [], 0
    for shape in shapes:
        size = int(np.prod(shape))
        found.append(values[first : first + size].reshape(shape))
        first += size
    return tuple(found)


def _row(found: Response) -> Array:
    return jnp.concatenate([found.along, found.across[0], found.torque[0], found.weight])


def _function(
    name: str,
    function: Callable[..., Array],
    inputs: dict[str, tuple[int, ...]],
    output: str,
    size: int,
    assign: str = "=",
) -> str:
    """A C function that assigns or adds what a function of arrays gives to an array of this size."""
    shapes = [jax.ShapeDtypeStruct(shape, jnp.float32) for shape in inputs.values()]
    writer = CWriter(name)
    given = [elements(field, shape) if shape else np.array(field, object) for field, shape in inputs.items()]
    (value,) = walk(jax.make_jaxpr(function)(*shapes), given, writer.apply)
    for number, element in enumerate(expressions(value)):
        writer.lines.append((None, f"{output}[{number}] {assign} {element};"))
    body = "\n".join(f"    {line}" for line in writer.used_lines())
    tables = "".join(f"{text}\n\n" for table, text in writer.tables.items() if re.search(rf"\b{table}\b", body))
    fields = [f"const float {field}[{shape[0]}]" if shape else f"float {field}" for field, shape in inputs.items()]
    signature = f"static inline void {name}({', '.join(fields)}, float {output}[{size}])"
    return f"{tables}{signature}\n{{\n{body}\n}}\n"

"""A closure of neighbours as a C header: what a neighbour adds to sums, and what force and torque the sums give."""

from __future__ import annotations

import re
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures.export_c import CWriter, elements, expressions
from jaxdem.closures.export_neighbors_parts import (
    THERE,
    carried_of_pair,
    cut,
    flat,
    handed_on,
    one_neighbor,
    response_of,
    shapes_of,
)
from jaxdem.closures.export_trace import walk
from jaxdem.closures.neighbors import NeighborClosure, Response

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
    sums = shapes_of(lambda place: closure.moments(one_neighbor(place), THERE), 3)
    carried = [] if closure.carried is None else shapes_of(lambda both: carried_of_pair(closure, both[:3], both[3:]), 6)
    length, further = (sum(int(np.prod(shape)) for shape in shapes) for shapes in (sums, carried))
    flow = {"reynolds": (), "solid_fraction": ()}

    def add(offset: Array) -> Array:
        return flat(closure.moments(one_neighbor(offset), THERE))

    def force(values: Array, reynolds: Array, solid_fraction: Array) -> Array:
        return handed_on(closure, cut(values, sums), reynolds[None], solid_fraction[None])

    def carry(offset: Array, vector: Array) -> Array:
        return flat(carried_of_pair(closure, offset, vector))

    def response(values: Array, *rest: Array) -> Array:
        more = cut(rest[0], carried) if carried else None
        return _row(response_of(closure, cut(values, sums), more, rest[-2][None], rest[-1][None]))

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

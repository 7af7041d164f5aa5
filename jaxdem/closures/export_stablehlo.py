"""A closure as StableHLO: an artifact of `jax.export`, and the same as text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

import jax
from jax import export

from jaxdem.closures.base import DragClosure
from jaxdem.closures.export_trace import ExportedDrag, input_shapes, one_particle

LOCATION = re.compile(r" loc\([^()]*(\([^()]*\))*[^()]*\)|^#loc.*\n", re.MULTILINE)
"""Marks of places in the text of a module; without the lines of the source they only name values."""


def stablehlo_module(closure: DragClosure, dimension: int) -> tuple[bytes, str]:
    """The closure for any number of particles: (artifact, text of the module).

    `jax.export.deserialize(artifact).call(*inputs)` takes the `asked_inputs` of the closure, vectors
    (particles, D), all else (particles,), float32, and gives the fields of `ExportedDrag` as a tuple. The module
    uses no operation of one platform and may be called on any.

    Args:
        closure: drag closure.
        dimension: D.
    """
    single = one_particle(closure)

    def drag(*values: jax.Array) -> tuple[jax.Array, ...]:
        # A plain tuple: the artifact then needs no class of jaxdem to be read.
        result: ExportedDrag = jax.vmap(single)(*values)
        return tuple(result)

    batch = export.symbolic_shape("particles")
    anywhere = [export.DisabledSafetyCheck.platform()]
    with without_source_lines():
        exported = export.export(jax.jit(drag), platforms=("cpu",), disabled_checks=anywhere)(
            *input_shapes(closure, dimension, batch)
        )
    return bytes(exported.serialize()), LOCATION.sub("", exported.mlir_module())


@contextmanager
def without_source_lines() -> Iterator[None]:
    """Programs that are made meanwhile do not name the files of this machine."""
    before = jax.config.jax_traceback_in_locations_limit  # type: ignore[attr-defined]
    jax.config.update("jax_traceback_in_locations_limit", 0)
    try:
        yield
    finally:
        jax.config.update("jax_traceback_in_locations_limit", before)

"""Processes of one run wait for each other, through the coordination service of JAX.

Not through collectives: their participants give each other up after 30 s
(https://github.com/jax-ml/jax/issues/40831), and processes that compile, or work on the host, need unequal times.
"""

from __future__ import annotations

import itertools
from typing import Any

import jax

LONGEST_WAIT = 24 * 3600.0
"""For each other, while compiling and writing [s]: the heartbeat ends a wait for one that is gone."""

_meetings = itertools.count()


def meet() -> None:
    """Waits until all processes are here, before a collective that follows work on the host. Every process calls this
    in the same order; in a run of one process nothing happens.

    Raises:
        jax.errors.JaxRuntimeError: one did not come.
    """
    if jax.process_count() > 1:
        coordination_client().wait_at_barrier(f"jaxdem/meeting/{next(_meetings)}", int(1000 * LONGEST_WAIT))


def coordination_client() -> Any:
    """Of the coordination service. JAX has no public name for it."""
    from jax._src import distributed

    client = distributed.global_state.client
    if client is None:
        raise RuntimeError("jax.distributed is not initialized")
    return client

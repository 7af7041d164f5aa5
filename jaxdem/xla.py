"""Settings of the compiler."""

from __future__ import annotations

import os

_OPTIONS = "--xla_backend_extra_options="
_FUSION = "xla_cpu_use_multi_output_fusion=true"


def fuse_loops() -> None:
    """Lets XLA compute several arrays in one loop over the contacts on a CPU: steps in about half the time.

    By default a loop of XLA:CPU has one result, and what several results need is written to memory between
    loops. Joining them is an option that XLA has switched off, and for good reason: compiling a reverse-mode
    gradient of a simulation with it ends the process (jaxlib 0.10). So it is for programs that only run
    forward, as `jaxdem run` does; it is not for `jax.grad`.

    It has an effect in a process that has not used JAX yet, and none on a GPU. It leaves the environment
    variable XLA_FLAGS alone where that sets `xla_backend_extra_options` already.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if _OPTIONS not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} {_OPTIONS}{_FUSION}".strip()

"""Where compiled programs are kept between processes."""

from __future__ import annotations

import os
from pathlib import Path


def use_compilation_cache() -> None:
    """Compiled programs are kept in the user's cache folder between calls of the command line."""
    import jax

    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        jax.config.update("jax_compilation_cache_dir", str(Path(base) / "jaxdem" / "xla"))
    # Small programs too: a start has many.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)

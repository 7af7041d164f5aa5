"""jax_md.partition and jax_md.space without the rest of jax-md.

`import jax_md` imports all of the package, which takes about 6 s and 500 MB, and needs packages that nothing here uses.
The two modules need some small neighbours of theirs only. While they load a bare package stands in for the real one,
for there is no other way to name the parent of a submodule; afterwards it is taken away again, so that whoever imports
jax_md then has the real one.
"""

from __future__ import annotations

import importlib
import importlib.machinery
import sys
import types
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def light_jax_md() -> Iterator[types.ModuleType]:
    """Within, `from jax_md import partition, space` imports these two modules alone."""
    spec = importlib.machinery.PathFinder.find_spec("jax_md")
    assert spec is not None and spec.submodule_search_locations is not None, "jax-md is not installed"
    real = sys.modules.get("jax_md")
    bare = types.ModuleType("jax_md")
    bare.__path__ = list(spec.submodule_search_locations)
    sys.modules["jax_md"] = bare
    try:
        for name in ("space", "partition"):
            setattr(bare, name, importlib.import_module(f"jax_md.{name}"))
        yield bare
    finally:
        del sys.modules["jax_md"]
        if real is not None:
            sys.modules["jax_md"] = real

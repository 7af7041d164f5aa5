"""jaxdem: particles in a fluid (unresolved CFD-DEM), differentiable end to end.

Public names are imported when they are first asked for: `import jaxdem` alone does not import JAX, so that the command line
answers `--help` and refuses wrong input at once.
"""

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from jaxdem.build import build, initial_state
    from jaxdem.errors import InputError, RunError
    from jaxdem.io import load_run
    from jaxdem.rollout import Rollout, rollout
    from jaxdem.scene import Scene, load_scene
    from jaxdem.simulate import simulate
    from jaxdem.simulation import Simulation

__all__ = [
    "InputError",
    "Rollout",
    "RunError",
    "Scene",
    "Simulation",
    "build",
    "initial_state",
    "load_run",
    "load_scene",
    "rollout",
    "simulate",
]

_MODULES = {
    "InputError": "errors",
    "Rollout": "rollout",
    "RunError": "errors",
    "Scene": "scene",
    "Simulation": "simulation",
    "build": "build",
    "initial_state": "build",
    "load_run": "io",
    "load_scene": "scene",
    "rollout": "rollout",
    "simulate": "simulate",
}
"""The module that each public name comes from."""


def __getattr__(name: str) -> Any:
    """A public name, or a module of the package, at its first use."""
    if name in _MODULES:
        value = getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
        setattr(sys.modules[__name__], name, value)
        return value
    module = f"{__name__}.{name}"
    try:
        if not name.startswith("_"):
            return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:
            raise
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _Package(ModuleType):
    """`jaxdem.simulate` is the function, also after Python has put the module of that name in its place."""

    def __setattr__(self, name: str, value: Any) -> None:
        # After loading jaxdem/simulate.py Python sets the package's attribute `simulate` to that module.
        if name in _MODULES and isinstance(value, ModuleType):
            value = getattr(value, name)
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package

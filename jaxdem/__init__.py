"""jaxdem: particles in a fluid (unresolved CFD-DEM), differentiable end to end.

Public names are imported when they are first asked for: `import jaxdem` alone does not import JAX, so that the command
line answers `--help` and refuses wrong input at once.
"""

import importlib
from typing import TYPE_CHECKING, Any

from jaxdem.version import __version__

if TYPE_CHECKING:
    from jaxdem.errors import InputError, RunError
    from jaxdem.external import ExternalFluid, ExternalStep, FluidFields, FluidSources
    from jaxdem.io import load_run
    from jaxdem.run.differentiable import Rollout, rollout
    from jaxdem.run.scene_run import simulate
    from jaxdem.scene import Scene, load_scene
    from jaxdem.setup.builder import build, initial_state
    from jaxdem.setup.external import external_fluid
    from jaxdem.simulation import Simulation, neighbors_from_jax_md

__all__ = [
    "ExternalFluid",
    "ExternalStep",
    "FluidFields",
    "FluidSources",
    "InputError",
    "Rollout",
    "RunError",
    "Scene",
    "Simulation",
    "__version__",
    "build",
    "external_fluid",
    "initial_state",
    "load_run",
    "load_scene",
    "neighbors_from_jax_md",
    "rollout",
    "simulate",
]

_MODULES = {
    "ExternalFluid": "external",
    "ExternalStep": "external",
    "FluidFields": "external",
    "FluidSources": "external",
    "InputError": "errors",
    "Rollout": "run.differentiable",
    "RunError": "errors",
    "Scene": "scene",
    "Simulation": "simulation",
    "build": "setup.builder",
    "external_fluid": "setup.external",
    "initial_state": "setup.builder",
    "load_run": "io",
    "load_scene": "scene",
    "neighbors_from_jax_md": "simulation",
    "rollout": "run.differentiable",
    "simulate": "run.scene_run",
}
"""The module that each public name comes from."""


def __getattr__(name: str) -> Any:
    """A public name, or a module of the package, at its first use."""
    if name in _MODULES:
        value = getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
        globals()[name] = value
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

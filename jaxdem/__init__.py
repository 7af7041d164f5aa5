"""jaxdem: particles in a fluid (unresolved CFD-DEM), differentiable end to end."""

__version__ = "0.1.0"

from jaxdem.errors import InputError, RunError
from jaxdem.scene import Scene, load_scene
from jaxdem.build import build, initial_state
from jaxdem.simulation import Simulation
from jaxdem.io import load_run
from jaxdem.rollout import Rollout, rollout
from jaxdem.simulate import simulate

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

"""What is compiled in and what is traced: no class is both, and a simulation is an argument like others."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import pkgutil

import jax
import jax.numpy as jnp
import pytest

import jaxdem
from tests.cases.small_scenes import SMALL_INJECTION

ROOMS = (
    "particles",
    "fluid",
    "coupling",
    "closures",
    "numerics",
    "state",
    "structure",
    "simulation",
    "observables",
    "probes",
    "external",
)

OF_ONE_TRACE = {
    "Exchange",
    "FurtherImpulses",
    "IntervalStart",
    "IntervalEnd",
    "Insertion",
    "_Coming",
    "ContactStep",
    "StepLoads",
    "MomentumStep",
    "Verlet",
}
"""Objects that are made and used up inside of one trace: they hold both."""


PLAIN = {"Mixing", "Perceptron"}
"""A description that must not import JAX; and a module of flax, which makes its weights and is not kept."""


def classes():
    """Every class of arrays or of descriptions in the rooms below a scene."""
    for room in ROOMS:
        module = importlib.import_module(f"jaxdem.{room}")
        names = [module.__name__]
        names += [info.name for info in pkgutil.walk_packages(getattr(module, "__path__", []), f"{module.__name__}.")]
        for name in names:
            for value in vars(importlib.import_module(name)).values():
                is_record = hasattr(value, "_fields") or dataclasses.is_dataclass(value)
                if inspect.isclass(value) and value.__module__ == name and is_record and not inspect.isabstract(value):
                    yield value


def kind(cls):
    """`traced`, `static`, or `neither` for what JAX takes as one opaque leaf."""
    if hasattr(cls, "_fields"):
        return "traced"
    blank = object.__new__(cls)
    try:
        leaves = jax.tree.leaves(blank)
    except AttributeError:  # it looks for its arrays
        return "traced"
    return "static" if leaves == [] else "neither"


@pytest.mark.parametrize("cls", list(classes()), ids=lambda cls: cls.__name__)
def test_a_class_is_static_or_traced(cls):
    """Static: frozen, compared and hashed by value, without arrays. Traced: with arrays."""
    annotations = [str(a) for c in cls.__mro__ for a in vars(c).get("__annotations__", {}).values()]
    if cls.__name__ in OF_ONE_TRACE | PLAIN:
        assert kind(cls) == "neither"
    elif kind(cls) == "static":
        assert cls.__hash__ is not object.__hash__
        assert not [a for a in annotations if "Array" in a.replace("Callable[[Array], Array]", "") or "ndarray" in a]
    else:
        assert kind(cls) == "traced"


def test_a_simulation_passes_through_jit_and_vmap():
    """Two builds of one scene are one key of JAX's cache: the step is compiled once for both."""
    scene = jaxdem.load_scene(
        SMALL_INJECTION | {"precision": "float64", "time": {"end": 0.02, "output_interval": 0.02}}
    )
    traces = []

    @jax.jit
    def step(simulation, parameters, state, neighbors):
        traces.append(1)
        return simulation.step(parameters, state, neighbors)[0]

    ends = []
    for _ in range(2):
        simulation, parameters = jaxdem.build(scene)
        assert jax.tree.leaves(simulation) == []
        state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
        ends.append(step(simulation, parameters, state, neighbors))
    assert len(traces) == 1
    assert jax.tree.all(jax.tree.map(jnp.array_equal, *ends))
    many = jax.tree.map(lambda x: jnp.stack([x, x]), (parameters, state))
    batched = jax.vmap(step, (None, 0, 0, None))(simulation, *many, neighbors)
    assert jax.tree.all(jax.tree.map(lambda a, b: jnp.allclose(a[1], b, rtol=1e-10, atol=1e-12), batched, ends[0]))

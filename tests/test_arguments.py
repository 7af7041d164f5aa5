"""Arguments of another kind, from Python: each is refused by its name, with what it is and what is expected."""

import jax
import jax.numpy as jnp
import pytest

from jaxdem import InputError, build, initial_state, load_scene, observables
from jaxdem.closures import EnsembleClosure, InvariantClosure, NeighborClosure, SubgridClosure
from jaxdem.closures.moments import MomentBasis
from jaxdem.closures.neighbor_level import Width

SCENE = {
    "precision": "float64",
    "domain": {"size": [0.4, 0.4], "depth": 0.02},
    "fluid": {"cells": [4, 4], "density": 1000.0, "viscosity": 1e-4},
    "boundary": {"top": {"kind": "outlet"}},
    "particles": {"radius": 0.008, "density": 2000.0, "position": [[0.15, 0.2], [0.25, 0.22]]},
    "contact": {"young_modulus": 1e7},
    "time": {"end": 0.02, "output_interval": 0.02},
}


def refused(function, *given):
    with pytest.raises(InputError) as caught:
        function(*given)
    assert caught.value.remedy
    return str(caught.value)


def test_methods_of_a_simulation_and_observables_name_the_argument():
    """For every argument one of another: two in the wrong order, and a number."""
    scene = load_scene(SCENE)
    simulation, parameters = build(scene)
    state, neighbors = initial_state(scene, simulation, parameters)
    given = {"parameters": parameters, "state": state, "neighbors": neighbors, "structure": simulation}
    given |= {
        "before": state,
        "after": state,
        "particles": state.particles,
        "plane": observables.Plane.across(0, 0.2, 2),
    }
    given |= {
        "boxes": observables.slices((0.4, 0.4), 0, (0.0, 0.4)),
        "room": simulation.room(parameters, state.particles),
    }
    functions = {
        simulation.step: ("parameters", "state", "neighbors"),
        simulation.allocate: ("parameters", "particles"),
        simulation.room: ("parameters", "particles"),
        simulation.with_room: ("state", "neighbors", "room"),
        observables.particle_flow: ("structure", "parameters", "plane", "before", "after"),
        observables.fluid_flow: ("structure", "parameters", "plane", "state"),
        observables.particle_profile: ("structure", "parameters", "boxes", "state", "neighbors"),
        observables.fluid_profile: ("structure", "parameters", "boxes", "state"),
        observables.contacts: ("structure", "parameters", "state", "neighbors"),
        observables.contact_rows: ("structure", "parameters", "state", "neighbors"),
    }
    for function, names in functions.items():
        for place, name in enumerate(names):
            for other in (5, given[names[place - 1]]):
                if type(other) is type(given[name]):
                    continue
                arguments = [given[one] for one in names]
                arguments[place] = other
                text = refused(function, *arguments)
                assert text.startswith(f"{name} = {type(other).__name__!r}: is no "), (function, text)
    assert refused(observables.fluid_at, simulation, parameters, jnp.zeros((1, 2))).startswith("state = 'Parameters'")
    assert refused(observables.measuring_walls, parameters).startswith("simulation = 'Parameters'")
    assert refused(observables.side_walls, parameters, 0, True).startswith("structure = 'Parameters'")
    assert refused(observables.fluid_force, state, 0, True).startswith("diagnostics = 'State'")
    assert refused(observables.Plane, 5, 0.1).startswith("normal = 5")


BASIS = MomentBasis(2.5, 4, 4, 3)
WIDTH = Width(5, 3, (6,))


@pytest.mark.parametrize(
    ("make", "given", "key"),
    [
        (EnsembleClosure, (5,), "members = 5"),
        (EnsembleClosure, ([InvariantClosure.initial()],), "members"),
        (EnsembleClosure.of, (5,), "ensemble = 5"),
        (NeighborClosure.initial, (5,), "basis = 'int': is no MomentBasis"),
        (NeighborClosure.initial, (BASIS, 5), "carried = 'int'"),
        (NeighborClosure.initial, (BASIS, BASIS), "carried"),
        (NeighborClosure.initial, (BASIS, None, 5), "widths = 5"),
        (NeighborClosure.initial, (BASIS, None, (5,)), "widths"),
        (NeighborClosure.initial, (BASIS, None, (WIDTH,), -1), "seed = -1"),
        (NeighborClosure.initial, (BASIS, None, (WIDTH,), 0, "tang"), "base = 'tang'"),
        (NeighborClosure.initial, (BASIS, None, (WIDTH,), 0, None, 5), "wake = 'int'"),
        (MomentBasis, ("x", 4, 4, 3), "reach = 'x'"),
        (MomentBasis, (0.9, 4, 4, 3), "reach = 0.9"),
        (MomentBasis, (2.5, 4.0, 4, 3), "radial = 4.0"),
        (MomentBasis, (2.5, 4, 2, 3), "order = 3"),
        (MomentBasis, (2.5, 4, 4, 3, 1.0, 3), "decay = 3"),
        (InvariantClosure.initial, (None, (8,), "elu", 5), "terms = 5"),
        (InvariantClosure.initial, (None, (8,), "elu", (), 0, None), "features"),
        (InvariantClosure.initial, (None, (8,), "elu", (), 0, InvariantClosure.initial().features, 5), "bounded = 5"),
        (SubgridClosure.constant, ("x", 0.05), "viscosity = 'x'"),
        (SubgridClosure.constant, (0.0, None), "gradient"),
    ],
)  # fmt: skip
def test_closures_name_the_argument(make, given, key):
    assert refused(make, *given).startswith(key)


def test_a_closure_is_a_tree_whatever_its_leaves_are():
    """JAX makes trees of shapes, of None and of things of its own in the place of arrays."""
    ensemble = EnsembleClosure.of([InvariantClosure.initial(seed=0), InvariantClosure.initial(seed=1)])
    assert jax.tree.map(lambda leaf: None, ensemble).members is not None
    for other in (jax.eval_shape(lambda: ensemble), jax.tree.map(lambda leaf: leaf.shape, ensemble)):
        assert isinstance(other, EnsembleClosure)
    leaves, structure = jax.tree.flatten(ensemble, is_leaf=lambda part: isinstance(part, InvariantClosure))
    assert len(leaves) == 1 and isinstance(jax.tree.unflatten(structure, [object()]), EnsembleClosure)

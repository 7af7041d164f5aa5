"""Every product of matrices keeps all digits on devices that would multiply with fewer: read from the traced
programs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from jax.extend import core

import jaxdem
from jaxdem.closures import InvariantClosure, PaperNetwork, save_closure
from jaxdem.closures.ensemble import EnsembleClosure
from jaxdem.numerics.products import along_axis
from jaxdem.step import step
from jaxdem.train.fit_network import network_columns
from tests.cases.tiers import tiered

HIGHEST = (lax.Precision.HIGHEST, lax.Precision.HIGHEST)


def products(program):
    """Precisions of all products of floating-point numbers in a traced program and the programs in it."""
    for equation in program.eqns:
        floating = all(jnp.issubdtype(x.aval.dtype, jnp.floating) for x in equation.invars)
        if equation.primitive.name == "dot_general" and floating:
            yield equation.params["precision"]
        for inner in jax.tree.leaves(
            tuple(equation.params.values()), is_leaf=lambda x: isinstance(x, core.Jaxpr | core.ClosedJaxpr)
        ):
            if isinstance(inner, core.ClosedJaxpr):
                inner = inner.jaxpr
            if isinstance(inner, core.Jaxpr):
                yield from products(inner)


def scene(**coupling):
    return dict(
        precision="float32",
        domain=dict(size=[0.4, 0.4], depth=0.04),
        particles=dict(radius=0.01, density=2500.0, position=[[0.1, 0.1], [0.2, 0.2], [0.3, 0.15]]),
        contact=dict(young_modulus=1e6, restitution=0.7),
        fluid=dict(cells=[8, 8], density=1000.0, viscosity=1e-6, time_step=0.005),
        boundary=dict(left=dict(kind="inlet", velocity=0.1), right=dict(kind="outlet")),
        coupling=dict(drag="koch_hill", **coupling),
        time=dict(end=0.1, output_interval=0.05),
    )


CLOSURES = {
    "paper": PaperNetwork.initial(2),
    "invariant": InvariantClosure.initial(),
    "ensemble": EnsembleClosure.of([InvariantClosure.initial()] * 2),
}

SCENES = {
    "correlation": {},
    "smoothing": dict(void_fraction="diffusion"),
    "history": dict(basset=20, virtual_mass=0.5),
    "coarse inputs": dict(drag_inputs_coarsened=2),
    "deconvolution": dict(deconvolution=0.1),
}


@pytest.mark.parametrize("name", tiered([*SCENES, *CLOSURES], first=["correlation", "history", "invariant"]))
def test_products_of_a_step_keep_all_digits(name, tmp_path):
    tables = scene(**SCENES.get(name, {}))
    if name in CLOSURES:
        save_closure(tmp_path / "closure.h5", CLOSURES[name], {})
        tables["closure"] = dict(file=str(tmp_path / "closure.h5"))
    read = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(read)
    state, neighbors = jaxdem.initial_state(read, simulation, parameters)
    found = list(products(jax.make_jaxpr(lambda s, n: step(simulation, parameters, s, n)[0])(state, neighbors).jaxpr))
    assert len(found) >= 4
    assert set(found) == {HIGHEST}


def test_products_of_training_keep_all_digits():
    weights = PaperNetwork.initial(2).weights
    columns = jnp.ones((len(next(iter(weights.values()))["kernel"]), 5), jnp.float32)
    gradient = jax.grad(lambda w, c: jnp.sum(network_columns(w, "elu", c)), argnums=(0, 1))
    found = list(products(jax.make_jaxpr(gradient)(weights, columns).jaxpr))
    assert len(found) >= 8
    assert set(found) == {HIGHEST}


def test_a_matrix_along_an_axis_is_numpys_product():
    generator = np.random.default_rng(0)
    matrix, field = generator.normal(size=(3, 5)), generator.normal(size=(2, 5, 4))
    expected = np.einsum("mn,anb->amb", matrix, field)
    np.testing.assert_allclose(along_axis(matrix, jnp.asarray(field), 1), expected, rtol=1e-14)
    assert along_axis(matrix, jnp.asarray(field, jnp.float32), 1).dtype == jnp.float32

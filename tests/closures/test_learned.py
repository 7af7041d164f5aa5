"""The learned closures: identity when untrained, invariances, positivity, fallback, files."""

import dataclasses
import subprocess
import sys
from functools import partial
from types import SimpleNamespace

import h5py
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem import load_scene, simulate
from jaxdem.cli.terminal import print_run
from jaxdem.closures import (
    DragInputs,
    EnsembleClosure,
    Ergun,
    InvariantClosure,
    KochHill,
    PaperNetwork,
    SubgridClosure,
    drag_law,
    load_closure,
    load_subgrid,
    save_closure,
)
from jaxdem.closures.flax_module import flax_module
from jaxdem.closures.invariant import FEATURES, TERMS, WITHOUT_PRESSURE
from jaxdem.closures.network import initial_weights, perceptron
from jaxdem.errors import InputError
from jaxdem.study import SCENES


def make_inputs(count=40, dimension=2, seed=0, filter_size=0.08):
    generator = np.random.default_rng(seed)
    return DragInputs(
        particle_velocity=jnp.asarray(generator.normal(size=(count, dimension))),
        fluid_velocity=jnp.asarray(generator.normal(size=(count, dimension))),
        solid_fraction=jnp.asarray(generator.uniform(0.05, 0.5, count)),
        void_fraction_gradient=jnp.asarray(generator.normal(size=(count, dimension)) * 3),
        pressure_gradient=jnp.asarray(generator.normal(size=(count, dimension)) * 1e4),
        diameter=jnp.asarray(0.02),
        filter_size=jnp.asarray(filter_size),
        fluid_density=jnp.asarray(1000.0),
        dynamic_viscosity=jnp.asarray(1e-3),
    )


# Everything goes through compiled calls: one by one, each small operation would be compiled on its own.
prepare = jax.jit(lambda closure, inputs: closure.prepare(inputs))


@jax.jit
def evaluate(closure, inputs):
    return closure(inputs)


@partial(jax.jit, static_argnums=0)
def evaluate_base(law, inputs):
    return law(inputs)


def shaken(closure, seed=1, size=0.3):
    """The closure with random weights everywhere, its last layer included."""
    leaves, structure = jax.tree.flatten(closure.weights)
    generator = np.random.default_rng(seed)
    moved = [leaf + size * generator.normal(size=leaf.shape).astype(leaf.dtype) for leaf in leaves]
    return dataclasses.replace(closure, weights=jax.tree.unflatten(structure, moved))


def normalised(closure, inputs):
    """The invariant closure with the normalisation and range that these inputs would give it."""
    features = np.asarray(prepare(closure, inputs).features)
    return dataclasses.replace(
        closure,
        feature_mean=features.mean(axis=0),
        feature_scale=features.std(axis=0) + 1e-3,
        feature_low=features.min(axis=0),
        feature_high=features.max(axis=0),
    )


def force(drag, inputs):
    along = drag.coefficient[:, None] * inputs.slip_velocity
    return along if drag.remainder is None else along + drag.remainder


def rotated(inputs, rotation):
    turn = {
        name: getattr(inputs, name) @ rotation.T
        for name in ("particle_velocity", "fluid_velocity", "void_fraction_gradient", "pressure_gradient")
    }
    return inputs._replace(**turn)


def rotation_matrix(dimension, seed=3):
    matrix, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(dimension, dimension)))
    return jnp.asarray(matrix)


@pytest.mark.parametrize("activation", ["elu", "softplus"])
def test_weights_are_those_of_a_flax_network(activation):
    """flax's own layers give what runs compute from the same weights; and its `init` makes weights of that layout."""
    values = jnp.asarray(np.random.default_rng(0).normal(size=(6, 5)))
    closure = SimpleNamespace(weights=initial_weights(5, (7, 3), 2, activation, seed=1), activation=activation)
    module, variables = flax_module(closure)
    variables = jax.tree.map(lambda leaf: leaf.astype(values.dtype), variables)
    found = jax.jit(partial(perceptron, activation=activation))(closure.weights, values=values)
    np.testing.assert_allclose(found, jax.jit(module.apply)(variables, values), rtol=1e-14)
    drawn = jax.eval_shape(module.init, jax.random.key(0), values)
    assert jax.tree.map(jnp.shape, drawn) == jax.tree.map(jnp.shape, variables)


def test_a_flax_network_has_its_layers_in_order_beyond_the_tenth():
    widths = (2, *range(3, 15))
    weights = initial_weights(widths[0], widths[1:-1], widths[-1], "elu", seed=0)
    closure = SimpleNamespace(weights=weights, activation="elu")
    assert flax_module(closure)[0].widths == widths[1:]


def test_a_stored_network_is_used_without_flax():
    """What JAX does not need to have when it is imported costs a second of every start."""
    use = (
        "import sys, jax, jax.numpy as jnp\n"
        "from jaxdem.closures import DragInputs, KochHill, load_closure\n"
        f"closure, _ = load_closure({str(SCENES / 'filtered.closure.h5')!r})\n"
        "row, one = jnp.ones((1, 2)), jnp.ones(())\n"
        "inputs = DragInputs(row, row, jnp.ones(1), row, row, one, one, one, one)\n"
        "jax.eval_shape(closure, inputs), jax.eval_shape(KochHill(), inputs)\n"
        "assert not {'flax', 'optax', 'jax_md'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", use], check=True)


@pytest.mark.parametrize("terms", [(), TERMS])
def test_untrained_invariant_closure_is_its_base_law(terms):
    inputs = make_inputs()
    drag, base = evaluate(InvariantClosure.initial(terms=terms), inputs), evaluate_base(KochHill(), inputs)
    np.testing.assert_allclose(drag.coefficient, base.coefficient, rtol=1e-14)
    assert (drag.remainder is None) == (not terms)
    if terms:
        np.testing.assert_array_equal(drag.remainder, 0.0)
    assert not drag.out_of_range.any()


@pytest.mark.parametrize("dimension", [2, 3])
def test_rotation_reflection_and_moving_frame(dimension):
    inputs = make_inputs(dimension=dimension)
    closure = shaken(normalised(InvariantClosure.initial(terms=TERMS), inputs))
    before = force(evaluate(closure, inputs), inputs)
    base = evaluate_base(KochHill(), inputs)
    assert np.abs(before - base.coefficient[:, None] * inputs.slip_velocity).max() > 1e-3  # it does correct
    scale = np.abs(before).max()
    rotation = rotation_matrix(dimension)
    for turn in (rotation, rotation.at[0].multiply(-1.0)):  # a rotation and a reflection, in this order or the other
        turned = rotated(inputs, turn)
        np.testing.assert_allclose(force(evaluate(closure, turned), turned), before @ turn.T, atol=1e-6 * scale)
    frame = jnp.full((1, dimension), 0.7)
    moving = inputs._replace(
        particle_velocity=inputs.particle_velocity + frame, fluid_velocity=inputs.fluid_velocity + frame
    )
    np.testing.assert_allclose(force(evaluate(closure, moving), moving), before, atol=1e-6 * scale)


def test_factor_is_positive_and_bounded_whatever_the_weights():
    inputs = make_inputs(200)
    base = evaluate_base(KochHill(), inputs).coefficient
    closures = [shaken(InvariantClosure.initial(), seed, size=30.0) for seed in range(8)]
    factor = np.array([evaluate(closure, inputs).coefficient / base for closure in closures])
    assert factor.min() >= 0.1 and factor.max() <= 10
    assert factor.min() < 0.5 and factor.max() > 2  # the weights were large enough to say something


def test_a_bounded_factor_is_at_most_one():
    """Whatever the weights; untrained it is next to one."""
    inputs = make_inputs(200)
    base, start = evaluate_base(KochHill(), inputs).coefficient, InvariantClosure.initial(bounded=True)
    untrained = evaluate(start, inputs).coefficient / base
    assert untrained.min() > 0.95 and untrained.max() < 1.0
    factor = np.array([evaluate(shaken(start, seed, size=30.0), inputs).coefficient / base for seed in range(8)])
    assert factor.min() >= 0.1 and factor.max() < 1.0 + 1e-14  # the two programs round in their own ways
    assert factor.min() < 0.5 and factor.max() > 0.99


def test_correction_vanishes_with_the_filter():
    """At filter/d = 1e-3 the gate is 2.5e-4, so that no bounded log factor exceeds 6e-4."""
    inputs = make_inputs(filter_size=0.02e-3)
    closure = shaken(InvariantClosure.initial(), size=30.0)
    np.testing.assert_allclose(
        evaluate(closure, inputs).coefficient, evaluate_base(KochHill(), inputs).coefficient, rtol=6e-4
    )


def ensemble_of(inputs, count=3):
    """Invariant closures of random weights with the terms, as one; one range for all."""
    start = normalised(InvariantClosure.initial(hidden=(4,), terms=TERMS), inputs)
    return EnsembleClosure.of([shaken(start, seed) for seed in range(count)])


def test_ensemble_of_one_network_is_that_network():
    inputs = make_inputs()
    closure = shaken(normalised(InvariantClosure.initial(hidden=(4,), terms=TERMS), inputs))
    far = inputs._replace(fluid_velocity=inputs.fluid_velocity.at[0].set(1e4))
    alone, together = evaluate(closure, far), evaluate(EnsembleClosure.of([closure] * 3), far)
    for one, mean in zip(alone, together, strict=True):
        np.testing.assert_allclose(mean, one, rtol=1e-12)
    assert together.out_of_range.tolist() == [True] + [False] * 39
    spread = jax.jit(EnsembleClosure.spread)(EnsembleClosure.of([closure] * 3), far)
    np.testing.assert_allclose(spread / np.abs(force(alone, far)).max(), 0.0, atol=1e-12)


THREE_GRAINS = {
    "precision": "float64",
    "domain": {"size": [0.4, 0.4], "depth": 0.04},
    "particles": {"count": 3, "radius": 0.01, "density": 2650.0} | {"position": [[0.1, 0.2], [0.2, 0.25], [0.3, 0.2]]},
    "contact": {"young_modulus": 5e6},
    "fluid": {"cells": [5, 5], "time_step": 0.005},
    "coupling": {"drag": "koch_hill"},
    "time": {"end": 0.02, "output_interval": 0.01},
}
"""Grains that begin to fall in still water."""


def test_a_run_tells_how_far_its_ensemble_is_apart(tmp_path):
    """Two members with constant factors exp(+-G b): spread over mean force is sqrt(2) tanh(G b), at all outputs."""
    start, bias = InvariantClosure.initial(hidden=(4,)), 0.3
    members = []
    for sign in (1.0, -1.0):
        last = start.weights["Dense_1"] | {"bias": jnp.asarray([sign * bias], jnp.float32)}
        members.append(dataclasses.replace(start, weights=start.weights | {"Dense_1": last}))
    run = simulate(load_scene(THREE_GRAINS), tmp_path / "run", closure=EnsembleClosure.of(members))
    gate, bounded = 1.0 - np.exp(-0.08 / 0.02 / 4.0), np.log(10.0) * np.tanh(bias / np.log(10.0))
    found = run.summary["closure"]["ensemble_spread"]
    assert found == pytest.approx(np.sqrt(2.0) * np.tanh(gate * bounded), rel=1e-6)


@pytest.mark.parametrize("others_to_come", [0, 5])
def test_a_run_tells_which_part_of_its_particles_is_out_of_range(others_to_come, tmp_path, capsys):
    """One of three grains is faster than the data in all intervals. Rows of grains to come do not count."""
    thrown = {"velocity": [[0.0, 0.0], [0.0, 0.0], [0.0, 1.5]]}
    tables = THREE_GRAINS | {"particles": THREE_GRAINS["particles"] | thrown}
    if others_to_come:
        later = {"side": "left", "velocity": 0.1, "rate": 1e5, "total": others_to_come, "begin": 0.0199}
        tables["particles"] |= {"inlet": [later]}
        tables |= {"boundary": {"right": {"kind": "outlet"}}}
    start = InvariantClosure.initial(hidden=(4,))
    number = FEATURES.index("log1p_reynolds")
    low, high = np.full(len(FEATURES), -np.inf), np.full(len(FEATURES), np.inf)
    low[number], high[number] = 0.0, np.log1p(0.2 * 0.02 / 1e-6)  # up to 0.2 m/s, with the margin 0.46 m/s
    closure = dataclasses.replace(start, feature_low=low, feature_high=high)
    run = simulate(load_scene(tables), tmp_path / "run", closure=closure)
    assert run.summary["counts"]["particles"] == 3 + others_to_come
    assert run.summary["closure"]["out_of_range_fraction"] == pytest.approx(1 / 3, rel=1e-9)
    print_run(run)
    assert "33 % of its evaluations outside the range of the law" in capsys.readouterr().out


def test_the_closure_that_comes_with_the_scenes():
    """Better than its base law and the regression on a run that it has not seen, on every coarse mesh.

    In range on grains and water like those that it was trained on, and the base law far from them.
    """
    closure, metadata = load_closure(SCENES / "filtered.closure.h5")
    assert metadata["datasets"][-1] == "fine" and metadata["split"].startswith("by run: fine held out")
    for factor in ("2", "3", "4", "8"):
        scores = metadata["r2"][factor]
        assert scores["closure"] > max(scores["base"], scores["regression"])
    wild = make_inputs()
    inputs = wild._replace(
        solid_fraction=0.5 * wild.solid_fraction,
        void_fraction_gradient=0.2 * wild.void_fraction_gradient,
        pressure_gradient=0.3 * wild.pressure_gradient,
        filter_size=jnp.asarray(0.16),
    )
    drag, base = evaluate(closure, inputs), evaluate_base(KochHill(), inputs)
    factor = np.asarray(drag.coefficient / base.coefficient)
    inside = ~np.asarray(drag.out_of_range)
    assert inside.sum() > 10 and np.ptp(factor[inside]) > 0.05 and (factor > 0.0).all()
    np.testing.assert_allclose(factor[~inside], 1.0, rtol=1e-15)  # of two programs
    for solid_fraction in (0.002, 0.6):  # a suspension of grains far apart, a pack in three dimensions
        far = evaluate(closure, inputs._replace(solid_fraction=jnp.full(40, solid_fraction)))
        assert np.asarray(far.out_of_range).all()


def test_ensemble_is_positive_and_the_same_under_rotation_and_in_a_moving_frame():
    inputs = make_inputs()
    ensemble = ensemble_of(inputs)
    drag = evaluate(ensemble, inputs)
    assert (drag.coefficient > 0).all()
    members = [force(evaluate(ensemble.member(number), inputs), inputs) for number in range(3)]
    before = force(drag, inputs)
    scale = np.abs(before).max()
    np.testing.assert_allclose(before, np.mean(members, axis=0), atol=1e-12 * scale)
    spread = jax.jit(EnsembleClosure.spread)(ensemble, inputs)
    np.testing.assert_allclose(spread, np.sqrt(np.var(members, axis=0, ddof=1).sum(axis=-1)), rtol=1e-9)
    rotation, frame = rotation_matrix(2), jnp.full((1, 2), 0.7)
    turned = rotated(inputs, rotation)
    moving = turned._replace(
        particle_velocity=turned.particle_velocity + frame, fluid_velocity=turned.fluid_velocity + frame
    )
    np.testing.assert_allclose(force(evaluate(ensemble, moving), moving), before @ rotation.T, atol=1e-6 * scale)
    apart = jax.jit(lambda inputs: ensemble.one_by_one()(inputs))(inputs)
    np.testing.assert_allclose(force(apart, inputs), before, atol=1e-12 * scale)


def test_ensembles_have_one_structure():
    with pytest.raises(InputError, match="one kind"):
        EnsembleClosure.of([InvariantClosure.initial(hidden=(width,)) for width in (3, 4)])
    with pytest.raises(InputError, match="at least two"):
        EnsembleClosure.of([InvariantClosure.initial()])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: InvariantClosure.initial("koch_hill"), "base = 'koch_hill': is no drag law"),
        (lambda: InvariantClosure.initial(KochHill), "base = .*is no drag law"),
        (lambda: InvariantClosure.initial(hidden=8), "hidden = 8: is no list"),
        (lambda: InvariantClosure.initial(hidden=(8.0,)), r"hidden = \(8\.0,\)"),
        (lambda: InvariantClosure.initial(seed=-1), "seed = -1"),
        (lambda: InvariantClosure.initial(activation=["elu"]), "activation = .*is not known"),
        (lambda: PaperNetwork.initial(5), "dimension = 5: is neither 2 nor 3"),
        (lambda: PaperNetwork.initial(KochHill()), "dimension = .*is neither 2 nor 3"),
        (lambda: SubgridClosure.initial("8, 8"), "hidden = '8, 8'"),
        (lambda: EnsembleClosure.of(["a.h5", "b.h5"]), "ensemble = 'a.h5': has a member"),
        (lambda: drag_law(["stokes"]), "no drag law has this name"),
    ],
)
def test_what_is_of_another_kind_is_refused_at_once(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize("make", [InvariantClosure.initial, lambda: PaperNetwork.initial(2)])
def test_gradients_at_zero_slip_and_even_void_fraction(make):
    inputs = make_inputs(4)
    inputs = inputs._replace(
        fluid_velocity=inputs.particle_velocity,
        void_fraction_gradient=jnp.zeros((4, 2)),
        pressure_gradient=inputs.pressure_gradient.at[:2].set(0.0),
        solid_fraction=jnp.array([0.0, 0.2, 0.4, 0.9]),
    )
    closure = shaken(make())
    gradients = jax.jit(jax.grad(lambda c, i: jnp.sum(force(c(i), i)), argnums=(0, 1)))(closure, inputs)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradients))


@pytest.mark.parametrize("kind", ["invariant", "paper"])
def test_weight_gradient_against_finite_differences(kind):
    """Weights have the gradient of central differences [1e-6], normalisation and range have none."""
    inputs = make_inputs(8)
    start = normalised(InvariantClosure.initial(terms=TERMS), inputs) if kind == "invariant" else None
    closure = shaken(start or PaperNetwork.initial(2, hidden=(8, 8)))
    closure = jax.tree.map(lambda leaf: np.asarray(leaf, np.float64), closure)

    @jax.jit
    def total(closure):
        return jnp.sum(force(closure(inputs), inputs) ** 2)

    gradient = jax.jit(jax.grad(total))(closure)
    direction = shaken(closure, seed=5).weights
    step = 1e-6
    ahead, behind = (
        dataclasses.replace(
            closure,
            weights=jax.tree.map(
                lambda w, d, s=sign: np.asarray(w) + s * step * np.asarray(d), closure.weights, direction
            ),
        )
        for sign in (1, -1)
    )
    slope = sum(jax.tree.leaves(jax.tree.map(lambda g, d: np.sum(np.asarray(g) * d), gradient.weights, direction)))
    assert float(slope) == pytest.approx(float(total(ahead) - total(behind)) / (2 * step), rel=1e-6)
    for field in dataclasses.fields(closure):
        if field.name not in ("weights", "base", "hidden", "activation", "terms", "features"):
            np.testing.assert_array_equal(getattr(gradient, field.name), 0.0)


def test_invariant_falls_back_outside_its_range():
    inputs = make_inputs()
    closure = shaken(normalised(InvariantClosure.initial(terms=TERMS), inputs))
    assert not evaluate(closure, inputs).out_of_range.any()
    far = inputs._replace(fluid_velocity=inputs.fluid_velocity.at[0].set(1e4))
    drag, base = evaluate(closure, far), evaluate_base(KochHill(), far)
    assert drag.out_of_range.tolist() == [True] + [False] * 39
    assert drag.coefficient[0] == pytest.approx(float(base.coefficient[0]), rel=1e-14)
    np.testing.assert_array_equal(drag.remainder[0], 0.0)
    other_mesh = inputs._replace(filter_size=jnp.asarray(0.32))
    assert evaluate(closure, other_mesh).out_of_range.all()


def test_range_has_a_margin():
    """Constant inputs of the training data may differ by 1 %, others by 10 % of their range and that."""
    inputs = make_inputs()
    closure = normalised(InvariantClosure.initial(), inputs)
    low, high = (np.asarray(getattr(closure, f"feature_{side}")) for side in ("low", "high"))
    index = FEATURES.index("solid_fraction")
    margin = 0.1 * (high[index] - low[index]) + 0.01 * high[index]
    middle = prepare(closure, inputs)
    features = jnp.tile(jnp.asarray((low + high) / 2)[None], (40, 1))
    values = jnp.array([high[index] + 0.99 * margin, high[index] + 1.01 * margin, jnp.nan])
    features = features.at[:3, index].set(values)
    assert closure.evaluate(middle._replace(features=features)).out_of_range[:4].tolist() == [
        False,
        True,
        True,
        False,
    ]


def test_paper_network_gives_its_force_through_the_base_coefficient():
    inputs = make_inputs()
    closure = PaperNetwork.initial(2, base=Ergun(), seed=4)
    drag, base = evaluate(closure, inputs), evaluate_base(Ergun(), inputs)
    np.testing.assert_allclose(drag.coefficient, base.coefficient, rtol=1e-14)
    network_force = closure.normalised_force(closure.features(inputs))
    np.testing.assert_allclose(force(drag, inputs), network_force, atol=1e-12)
    assert closure.features(inputs).shape == (40, 5)


@pytest.mark.parametrize("dimension", [2, 3])
def test_paper_network_falls_back_outside_its_range(dimension):
    inputs = make_inputs(dimension=dimension)
    values = np.asarray(PaperNetwork.features(inputs))
    closure = dataclasses.replace(
        PaperNetwork.initial(dimension), input_low=values.min(axis=0), input_high=values.max(axis=0)
    )
    assert not evaluate(closure, inputs).out_of_range.any()
    far = inputs._replace(particle_velocity=inputs.particle_velocity.at[3].multiply(20.0))
    drag = evaluate(closure, far)
    assert np.flatnonzero(drag.out_of_range).tolist() == [3]
    np.testing.assert_array_equal(drag.remainder[3], 0.0)


def test_learned_closures_are_traced_arguments_with_static_structure():
    """New weights of the same structure do not compile again; the dtype is that of the inputs."""
    traces = []

    @jax.jit
    def coefficient(closure, inputs):
        traces.append(1)
        return closure(inputs).coefficient

    inputs = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), make_inputs())
    first = InvariantClosure.initial(seed=0)
    assert coefficient(first, inputs).dtype == jnp.float32
    coefficient(shaken(first), inputs)
    assert len(traces) == 1
    coefficient(InvariantClosure.initial(base=Ergun()), inputs)
    assert len(traces) == 2


CLOSURES = {
    "invariant": lambda: shaken(InvariantClosure.initial(Ergun(), (5, 4), "softplus", TERMS)),
    "bounded": lambda: shaken(InvariantClosure.initial(hidden=(4,), bounded=True)),
    "paper": lambda: shaken(PaperNetwork.initial(3, hidden=(7, 3), activation="selu")),
    "ensemble": lambda: EnsembleClosure.of([PaperNetwork.initial(3, hidden=(7,), seed=n) for n in (0, 1)]),
    "subgrid": lambda: shaken(SubgridClosure.initial((5, 4), "softplus")),
}


def read_as(kind, path):
    return (load_subgrid if kind == "subgrid" else load_closure)(path)


@pytest.mark.parametrize("kind", CLOSURES)
def test_file_round_trip_is_exact(kind, tmp_path):
    closure, path = CLOSURES[kind](), tmp_path / "closure.h5"
    metadata = {"recipe": kind, "r2": {"8": {"closure": np.float32(0.5)}}, "loss_history": [0.1] * 20_000}
    save_closure(path, closure, metadata)
    loaded, read = read_as(kind, path)
    assert jax.tree.structure(loaded) == jax.tree.structure(closure)
    for before, after in zip(jax.tree.leaves(closure), jax.tree.leaves(loaded), strict=True):
        assert before.dtype == after.dtype
        np.testing.assert_array_equal(before, after)
    assert read == {"recipe": kind, "r2": {"8": {"closure": 0.5}}, "loss_history": [0.1] * 20_000}
    assert list(tmp_path.iterdir()) == [path]


def test_files_that_name_no_features_have_those_without_pressure(tmp_path):
    """As the first versions wrote them."""
    closure, path = InvariantClosure.initial(hidden=(4,), features=WITHOUT_PRESSURE), tmp_path / "closure.h5"
    save_closure(path, closure, {})
    with h5py.File(path, "a") as file:
        del file.attrs["features"]
    assert jax.tree.structure(load_closure(path)[0]) == jax.tree.structure(closure)


def test_pressure_features_are_bounded_and_vanish_without_a_gradient():
    inputs = make_inputs()
    closure = InvariantClosure.initial()
    features = dict(zip(FEATURES, prepare(closure, inputs).features.T, strict=True))
    along, size = (features[f"pressure_gradient_{name}"] for name in ("along_slip", "size"))
    assert (np.abs(along) <= size).all() and (size < 1).all() and size.max() > 0.5
    cosine = jnp.sum(inputs.pressure_gradient * inputs.slip_velocity, axis=-1) / (
        jnp.linalg.norm(inputs.pressure_gradient, axis=-1) * inputs.slip_speed
    )
    np.testing.assert_allclose(along / size, cosine * inputs.reynolds / (1 + inputs.reynolds), rtol=1e-9)
    still = inputs._replace(pressure_gradient=jnp.zeros((40, 2)), fluid_velocity=inputs.particle_velocity)
    np.testing.assert_array_equal(prepare(closure, still).features[:, -2:], 0.0)


def test_features_on_request_follow_the_others():
    """ln(s + 0.01); a file keeps it by its name, and the names have one order."""
    inputs, names = make_inputs(), ("solid_fraction", "log_solid_fraction", "log_wide_solid_fraction")
    inputs = inputs._replace(wide_solid_fraction=0.7 * inputs.solid_fraction)
    seen = prepare(InvariantClosure.initial(features=names), inputs).features
    for column, share in ((1, 1.0), (2, 0.7)):
        expected = np.log(share * np.asarray(inputs.solid_fraction) + 0.01)
        np.testing.assert_allclose(seen[:, column], expected, rtol=1e-12)
    with pytest.raises(InputError, match="in this order"):
        InvariantClosure.initial(features=names[::-1])


def test_failed_write_keeps_the_old_file(tmp_path):
    path = tmp_path / "closure.h5"
    save_closure(path, CLOSURES["paper"](), {"round": 1})
    with pytest.raises(ValueError):
        save_closure(path, CLOSURES["paper"](), {"round": 2, "circular": (loop := [])} | {"x": loop.append(loop)})
    assert load_closure(path)[1] == {"round": 1}
    with pytest.raises(InputError, match="cannot be written"):
        save_closure(tmp_path / "nowhere" / "closure.h5", CLOSURES["paper"](), {})


def test_what_could_not_be_read_back_is_not_written(tmp_path):
    """A correlation, and weights that are not numbers: as `load_closure` would refuse them."""
    path, broken = tmp_path / "closure.h5", jax.tree.map(lambda x: x * jnp.nan, CLOSURES["paper"]())
    for closure, words in ((KochHill(), "is no learned closure"), (broken, "not finite numbers")):
        with pytest.raises(InputError, match=words):
            save_closure(path, closure, {})
    assert not path.exists()


@pytest.mark.parametrize(
    ("kind", "key", "words"),
    [
        ("subgrid", "closure.file", "subgrid stress.*fluid.subgrid"),
        ("paper", "fluid.subgrid", "drag closure"),
    ],
)
def test_a_closure_of_the_other_kind_is_refused(kind, key, words, tmp_path):
    path = tmp_path / "closure.h5"
    save_closure(path, CLOSURES[kind](), {})
    with pytest.raises(InputError, match=f"^{key}.*{words}"):
        read_as("paper" if kind == "subgrid" else "subgrid", path)


def break_truncate(path):
    path.write_bytes(path.read_bytes()[:3000])


def break_foreign(path):
    path.write_text("not HDF5")


def break_format(path):
    with h5py.File(path, "a") as file:
        file.attrs["format"] = "something else"


def break_version(path):
    with h5py.File(path, "a") as file:
        file.attrs["version"] = 99


def break_shape(path):
    with h5py.File(path, "a") as file:
        file.attrs["hidden"] = np.array([5, 3])


def break_array(path):
    with h5py.File(path, "a") as file:
        del file["arrays/weights/Dense_1/bias"]


def break_law(path):
    with h5py.File(path, "a") as file:
        file.attrs["base"] = "nobody"


def break_attribute(path):
    with h5py.File(path, "a") as file:
        del file.attrs["hidden"]


def break_metadata(path):
    with h5py.File(path, "a") as file:
        del file["metadata"]
        file["metadata"] = "{cut"


def break_missing(path):
    path.unlink()


BROKEN = [
    (break_truncate, "cannot be read"),
    (break_foreign, "cannot be read"),
    (break_format, "not a closure file"),
    (break_version, "version 99"),
    (break_shape, "shape"),
    (break_array, "weights/Dense_1/bias is missing"),
    (break_law, "nobody"),
    (break_attribute, "cannot be read"),
    (break_metadata, "cannot be read"),
    (break_missing, "is not a file"),
]


@pytest.mark.parametrize(
    ("kind", "damage", "message"),
    [
        (kind, *broken)
        for kind in ("invariant", "subgrid")
        for broken in BROKEN
        if (kind, broken[0]) != ("subgrid", break_law)  # it has no base law
    ],
)
def test_broken_files_are_refused(kind, damage, message, tmp_path):
    path = tmp_path / "closure.h5"
    save_closure(path, CLOSURES[kind](), {})
    damage(path)
    with pytest.raises(InputError, match=message) as caught:
        read_as(kind, path)
    if damage is not break_law:
        assert caught.value.key == ("fluid.subgrid" if kind == "subgrid" else "closure.file")


def test_bad_structure_is_refused():
    with pytest.raises(InputError, match="activation"):
        PaperNetwork.initial(2, activation="swish")
    with pytest.raises(InputError, match="hidden"):
        InvariantClosure.initial(hidden=(8, 0))
    with pytest.raises(InputError, match="terms"):
        InvariantClosure.initial(terms=("lift",))
    with pytest.raises(InputError, match="features"):
        InvariantClosure.initial(features=("log1p_reynolds", "solid_fraction"))

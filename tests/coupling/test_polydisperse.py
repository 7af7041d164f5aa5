"""Drag in mixtures of sizes (van der Hoef, Beetstra & Kuipers), in a bed with the same grains in every cell."""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem import InputError
from jaxdem.closures.registry import DRAG_LAWS
from jaxdem.coupling.polydisperse import sauter_mean
from jaxdem.setup.builder import build_case

SIDE, SPEED, VISCOSITY, DENSITY = 0.03034, 0.02, 1e-5, 1000.0
CELLS = 3
SOLIDS = 2 * 4.0 / 3.0 * np.pi * 0.01**3 / SIDE**3
"""Of either size half of it: 0.3."""


def bed(polydisperse, model="A", law="koch_hill", radius=(0.01, 0.005)):
    """In every cell one large grain in the middle and eight small ones round the corners; half of the solids each."""
    corner = np.array([*itertools.product((-0.005, 0.005), repeat=3)])
    cell = np.concatenate([[[0.5 * SIDE] * 3], np.mod(corner, SIDE)])
    places = np.array([*itertools.product(range(CELLS), repeat=3)]) * SIDE
    position = (places[:, None] + cell[None]).reshape(-1, 3)
    periodic = {side: {"kind": "periodic"} for side in ("left", "front", "bottom")}
    return jaxdem.load_scene(
        {
            "domain": {"size": [CELLS * SIDE] * 3, "gravity": [0.0, 0.0, 0.0]},
            "particles": {
                "position": position.tolist(),
                "radius": np.tile([radius[0], *[radius[1]] * 8], CELLS**3).tolist(),
                "density": 2500.0,
            },
            "contact": {"young_modulus": 1e6, "speed": 0.1},
            "fluid": {
                "cells": [CELLS] * 3, "viscosity": VISCOSITY, "density": DENSITY, "model": model, "time_step": 1e-3,
                "velocity": [SPEED, 0.0, 0.0],
            },
            "boundary": periodic,
            "coupling": {
                "drag": law, "polydisperse": polydisperse, "kernel_width": {"diameters": 0.5, "cells": 0.5},
            },
            "time": {"end": 0.001, "output_interval": 0.001},
            "precision": "float64",
        }
    )  # fmt: skip


def drag_of(scene, solid_fraction=None):
    """What the law gives, what it saw, the local mean diameters, and the law; as one program."""
    case, closure = build_case(scene), DRAG_LAWS[scene.coupling.drag]()
    coupling = case.simulation.coupling

    @jax.jit
    def evaluated(mixture, state):
        sampled = coupling.sample(mixture, state.fluid, state.particles)
        start, inputs = coupling.start(mixture, state.fluid, state.particles, sampled), sampled.inputs
        if solid_fraction is not None:
            inputs = inputs._replace(solid_fraction=jnp.full_like(inputs.solid_fraction, solid_fraction))
        return coupling.drag.law(closure, jnp.ones(()), start)(inputs), inputs, sauter_mean(start)

    drag, inputs, mean = evaluated(case.parameters.mixture, case.first_state()[0])
    return drag, inputs, np.asarray(mean), closure


def mean_law(closure, mean):
    """F of equal grains of the mean diameter in the bed."""
    reynolds = (1.0 - SOLIDS) * SPEED * mean / VISCOSITY
    return float(closure.stokes_multiple(jnp.asarray(SOLIDS), jnp.asarray(reynolds)))


@pytest.mark.parametrize(("model", "law"), [("A", "koch_hill"), ("B", "beetstra")])
def test_shares_of_two_sizes_are_the_published_ones_and_add_up_to_the_mean_law(model, law):
    """d 1 : 2 with half of the solids each has <d> = 4/3 and y = 0.75 and 1.5: by hand, at s = 0.3, y of the drag of
    model A, and 0.7 y + 0.3 y^2 of the whole force, 0.694 and 1.725.

    Force on the solids of a volume: 18 mu s F U / <d>^2. Negative control: the law at each grain's own diameter does
    not add up to it.
    """
    drag, inputs, mean, closure = drag_of(bed(True, model, law))
    found = np.asarray(drag.coefficient)
    assert not np.any(drag.out_of_range)
    np.testing.assert_allclose(inputs.solid_fraction, SOLIDS, rtol=1e-12)
    np.testing.assert_allclose(mean, 0.01 * 4.0 / 3.0, rtol=1e-12)
    own, multiple = np.asarray(inputs.diameter), mean_law(closure, mean[0])
    share = {"A": {0.01: 0.75, 0.02: 1.5}, "B": {0.01: 0.69375 / (1 - SOLIDS), 0.02: 1.725 / (1 - SOLIDS)}}[model]
    expected = 3.0 * np.pi * VISCOSITY * DENSITY * own * np.where(own > 0.015, share[0.02], share[0.01]) * multiple
    # SOLIDS is 0.3 to 1e-4.
    np.testing.assert_allclose(found, expected, rtol=1e-12 if model == "A" else 2e-4)
    of_volume = 18.0 * VISCOSITY * DENSITY * SOLIDS * multiple / mean[0] ** 2 / (1.0 if model == "A" else 1.0 - SOLIDS)
    assert np.sum(found) / (CELLS * SIDE) ** 3 == pytest.approx(of_volume, rel=1e-12)
    plain = drag_of(bed(False, model, law))[0].coefficient
    assert abs(np.sum(plain) / (CELLS * SIDE) ** 3 / of_volume - 1.0) > 0.03


def test_equal_sizes_have_the_law_itself():
    """To rounding where each grain has a radius; with one radius for all nothing is looked up."""
    given = {"radius": (0.006, 0.006)}
    plain, shared = (drag_of(bed(on, **given))[0].coefficient for on in (False, True))
    np.testing.assert_allclose(shared, plain, rtol=1e-13)


def test_range_is_that_of_the_law_and_closures_of_neighbours_are_refused():
    """The flag is the law's own; closures of neighbours are refused by name."""
    assert np.all(drag_of(bed(True), solid_fraction=0.9)[0].out_of_range)
    tables = bed(True, radius=(0.005, 0.005)).tables() | {"closure": {"file": "scenes/neighbours_short.closure.h5"}}
    tables["coupling"].pop("drag", None)
    with pytest.raises(InputError, match="polydisperse"):
        jaxdem.build(jaxdem.load_scene(tables))

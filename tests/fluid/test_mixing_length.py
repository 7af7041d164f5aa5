"""Mixing length of a stream over a bed: its integral, the logarithmic law that follows, and what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.errors import InputError
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.mixing_length import BedMixing, mixing_length_over_bed

KAPPA, PACKED = 0.41, 0.6
NUMBERS = BedMixing(jnp.asarray(KAPPA), jnp.asarray(PACKED))
GRID = Grid((2, 3, 8), (0.2, 0.3, 0.8), 1.0, (True, True, False))
HEIGHT, CELLS, SLOPE, DENSITY = 0.1, 24, 0.02, 900.0


def test_length_over_no_grains_a_packed_bed_and_a_loose_one():
    """kappa z; zero within a bed of the packed fraction and kappa (z - z_b) above; half as steep in half of it."""
    z = (np.arange(8) + 0.5) * 0.1
    alone = mixing_length_over_bed(GRID, NUMBERS, None)
    np.testing.assert_allclose(alone, np.broadcast_to(KAPPA * z, GRID.cells), rtol=1e-12)
    for part, below in ((1.0, 0.0), (1.2, 0.0), (0.5, 0.5)):
        solid = np.where(z < 0.4, part * PACKED, 0.0)
        found = mixing_length_over_bed(GRID, NUMBERS, jnp.broadcast_to(1.0 - solid, GRID.cells))
        expected = KAPPA * np.where(z < 0.4, below * z, below * 0.4 + z - 0.4)
        np.testing.assert_allclose(found, np.broadcast_to(expected, GRID.cells), atol=1e-12)


def test_slopes_of_the_length():
    """By kappa it is l / kappa; by phi_m, with phi = 0.3 up to 0.4 m, kappa phi z / phi_m^2 below the surface."""
    z = (np.arange(8) + 0.5) * 0.1
    void = jnp.broadcast_to(1.0 - np.where(z < 0.4, 0.3, 0.0), GRID.cells)

    def mean(numbers):
        return jnp.mean(mixing_length_over_bed(GRID, numbers, void))

    length, slopes = jax.value_and_grad(mean)(NUMBERS)
    assert float(slopes.von_karman) == pytest.approx(float(length) / KAPPA)
    below = KAPPA * 0.3 / PACKED**2 * np.minimum(z, 0.4)
    assert float(slopes.packed_solid_fraction) == pytest.approx(below.mean())


def stream(**tables):
    """An open channel of water that gravity drives; 2-D."""
    return {
        "precision": "float64",
        "domain": {"size": [0.05, HEIGHT], "depth": 0.01, "gravity": [SLOPE, -9.81]},
        "fluid": {
            "cells": [3, CELLS],
            "density": DENSITY,
            "viscosity": 1e-9,
            "time_step": 0.02,
            "bed_mixing": {"von_karman": KAPPA},
        },
        "boundary": {"left": {"kind": "periodic"}, "top": {"kind": "free_slip"}},
        "time": {"end": 80.0, "output_interval": 1.0},
    } | tables


def test_open_channel_has_the_logarithmic_law():
    """With tau = rho g_x (H - z) and l = kappa z: u = u_*/kappa [2 s + ln((1 - s)/(1 + s))] + const, s^2 = 1 - z/H.

    And a larger kappa makes the stream slower: with the roughness given by the mesh, u is as 1/kappa.
    """
    scene = jaxdem.load_scene(stream())
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)

    def profile(kappa):
        mixing = parameters.fluid.bed_mixing._replace(von_karman=kappa)
        changed = parameters._replace(fluid=parameters.fluid._replace(bed_mixing=mixing))
        end = jaxdem.rollout(simulation, changed, state, neighbors, 4000, reversible=False)
        return end.state.fluid.face_velocity[0][0]

    run = jax.jit(profile)
    u = np.asarray(run(jnp.asarray(KAPPA)))
    z = (np.arange(CELLS) + 0.5) * HEIGHT / CELLS
    s = np.sqrt(1.0 - z / HEIGHT)
    shear_velocity = np.sqrt(SLOPE * HEIGHT)
    exact = shear_velocity / KAPPA * (2.0 * s + np.log((1.0 - s) / (1.0 + s)))
    # From the third cell on, where the mesh resolves 1/z.
    np.testing.assert_allclose(u[3:] - u[3], exact[3:] - exact[3], atol=0.02 * shear_velocity / KAPPA)
    np.testing.assert_allclose(np.asarray(run(jnp.asarray(2.0 * KAPPA))), 0.5 * u, rtol=1e-3)


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        ({"fluid.smagorinsky": 0.1}, "fluid.bed_mixing", "same unresolved eddies"),
        ({"boundary.top.kind": "no_slip"}, "boundary.top.kind", "below a free surface"),
        ({"boundary.bottom": {"kind": "free_slip"}}, "boundary.bottom.kind", "over a floor"),
        ({"fluid.bed_mixing.von_karman": 0.0}, "fluid.bed_mixing.von_karman", "greater than 0"),
        ({"fluid.bed_mixing.packed_solid_fraction": 1.2}, "packed_solid_fraction", "less than or equal to 1"),
    ],
)
def test_what_cannot_be_is_refused(changes, key, words):
    with pytest.raises(InputError, match=key) as refused:
        jaxdem.load_scene(stream(), changes)
    assert words in str(refused.value)


def test_it_is_in_no_program_of_a_scene_without_it():
    """Nothing of it is in the parameters; with it the numbers of the scene are."""
    fluid = {key: value for key, value in stream()["fluid"].items() if key != "bed_mixing"}
    without = jaxdem.build(jaxdem.load_scene(stream(fluid=fluid)))[1]
    assert without.fluid.bed_mixing is None
    found = jaxdem.build(jaxdem.load_scene(stream()))[1].fluid.bed_mixing
    assert float(found.von_karman) == KAPPA and float(found.packed_solid_fraction) == 0.61

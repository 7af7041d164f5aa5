"""The solid fraction that parcels see, with the volume of one grain in place of their own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import KDTree

import jaxdem
from jaxdem.coupling.interpolation import deposit, interpolate
from jaxdem.coupling.kernel import kernel_weights
from jaxdem.coupling.own_volume import scatter_of_discs, scatter_of_spheres
from jaxdem.coupling.presence import present_weights
from jaxdem.coupling.self_disturbance import own_solid_fraction
from jaxdem.fluid.grid import Grid
from tests.cases.tiers import tiered

DIAMETER = 1e-3


def suspension(dimension, fraction, ratio, **coupling):
    """Parcels at random places in a periodic box of cells of 4 parcels, with kernels of 3 parcels."""
    cells = [50, 50] if dimension == 2 else [11, 11, 11]
    size = [4.0 * ratio * DIAMETER * n for n in cells]
    solids = fraction * np.prod(size) * (DIAMETER if dimension == 2 else 1.0)
    count = round(solids / (ratio**dimension * np.pi / 6.0 * DIAMETER**3))
    sides = ("left", "bottom", "front")[:dimension]
    return {
        "domain": {"size": size, "gravity": [0.0] * dimension} | ({"depth": DIAMETER} if dimension == 2 else {}),
        "particles": {
            "radius": DIAMETER / 2.0,
            "density": 2500.0,
            "position": random_places(count, ratio * DIAMETER, size).tolist(),
            "coarse_grain": ratio,
        },
        "contact": {"young_modulus": 1e6, "speed": 1.0},
        "boundary": {name: {"kind": "periodic"} for name in sides},
        "fluid": {"cells": cells, "density": 1.0, "viscosity": 1e-5},
        "coupling": {"interval": 1e-3, "kernel_width": {"diameters": 3.0, "cells": 0.0}} | coupling,
        "time": {"end": 1e-3, "output_interval": 1e-3},
    }


def random_places(count, diameter, size):
    """Places in a periodic box of spheres that are added one after the other where there is room, (count, D) [m]."""
    generator, placed = np.random.default_rng(5), np.empty((0, len(size)))
    while len(placed) < count:
        tried = generator.uniform(0.0, size, (count, len(size)))
        if len(placed):
            tried = tried[KDTree(placed, boxsize=size).query(tried)[0] > diameter]
        late = KDTree(tried, boxsize=size).query_pairs(diameter, output_type="ndarray").max(axis=1, initial=-1)
        placed = np.concatenate((placed, np.delete(tried, late[late >= 0], axis=0)))
    return placed[:count]


def sample(tables):
    """The fluid at the particles at the start, the own part of the solid fraction of each, and the mean of the box."""
    scene = jaxdem.load_scene({"precision": "float64"} | tables)
    simulation, parameters = jaxdem.build(scene)
    state, _ = jaxdem.initial_state(scene, simulation, parameters)
    coupling, mixture = simulation.coupling, parameters.mixture
    sampled = jax.jit(coupling.sample)(mixture, state.fluid, state.particles)
    grid = coupling.interval.solver.grid
    own = own_solid_fraction(grid, sampled.weights, mixture.bodies.volume)
    return sampled, np.asarray(own), float(sampled.solids.mean())


@pytest.mark.parametrize("dimension, fraction", tiered([(2, 0.02), (2, 0.08), (3, 0.05)], first=[(2, 0.08)]))
def test_parcels_at_random_places_see_the_mean_that_grains_see(dimension, fraction):
    """s + S s_o/l^D in the mean, by the equation of state at the true mean; with their own volume it is s + S s_o.

    Of this box the mean over particles has an error by chance of 3 to 5 % of s_o.
    """
    ratio = 4.0 if dimension == 2 else 2.0
    sampled, own, mean = sample(suspension(dimension, fraction, ratio, own_volume="grain"))
    whole, law = (np.asarray(x.solid_fraction) for x in (sampled.inputs, sampled.law_inputs))
    scatter = scatter_of_discs(1.5 * mean) if dimension == 2 else scatter_of_spheres(mean)
    excess = float(scatter) * own.mean()
    assert whole.mean() - mean == pytest.approx(excess, rel=0.15)
    assert law.mean() - mean == pytest.approx(excess / ratio**dimension, abs=0.15 * excess)
    assert (law > 0.0).all()


def test_the_same_holds_on_a_coarser_view():
    """With `drag_inputs_coarsened` the own part is that of the coarser cells."""
    found = [sample(suspension(2, 0.02, 4.0, drag_inputs_coarsened=2, own_volume=kind)) for kind in ("parcel", "grain")]
    (whole, _, mean), (law, _, _) = found
    excess = float(whole.law_inputs.solid_fraction.mean()) - mean
    assert excess > 0.005
    assert float(law.law_inputs.solid_fraction.mean()) - mean == pytest.approx(excess / 16.0, abs=0.15 * excess)


def test_grains_see_what_they_saw():
    """Without parcels the key changes nothing, not even the program."""
    sampled, _, _ = sample(suspension(2, 0.001, 1.0, own_volume="grain"))
    np.testing.assert_array_equal(sampled.law_inputs.solid_fraction, sampled.inputs.solid_fraction)


def test_the_own_part_is_what_a_lone_particle_sees():
    """Also at walls and in corners, where what is mirrored comes into cells that the kernel reaches anyway."""
    grid, volume = Grid((5, 4, 3), (0.5, 0.4, 0.3), 1.0, (False, False, True)), 1e-4
    places = np.random.default_rng(0).uniform(0.0, 1.0, (20, 3)) * np.asarray(grid.size)
    places[0] = 0.001
    weights = kernel_weights(grid, (0.12, 0.15, 0.09), jnp.asarray(places))
    own = np.asarray(own_solid_fraction(grid, weights, jnp.asarray(volume)))
    for k, part in enumerate(own):
        alone = weights._replace(index=weights.index[k : k + 1], weight=weights.weight[k : k + 1])
        solids = deposit(grid, alone, jnp.asarray([volume])) / grid.cell_volume
        assert part == pytest.approx(float(interpolate(alone, (solids,))[0, 0]), rel=1e-12)
    there = np.arange(20) > 9  # those that are not present see nothing, of themselves neither
    some = own_solid_fraction(grid, present_weights(weights, jnp.asarray(there)), jnp.asarray(volume))
    np.testing.assert_array_equal(some, np.where(there, own, 0.0))


@pytest.mark.parametrize("kind", ["divided", "diffusion"])
def test_points_in_place_of_a_kernel_are_refused(kind):
    tables = suspension(2, 0.02, 4.0, own_volume="grain", void_fraction=kind) | {"precision": "float64"}
    with pytest.raises(jaxdem.InputError, match="coupling.own_volume"):
        jaxdem.build(jaxdem.load_scene(tables))

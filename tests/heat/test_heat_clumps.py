"""Clumps with temperatures: one of the whole body, contacts by its members."""

import math

import numpy as np
import pytest

from tests.cases.energy import MASS, balance_of, with_tables
from tests.cases.energy_of_bodies import RODS
from tests.cases.heat import advanced, chain_tables, stream_tables
from tests.cases.tiers import COMBINATION

PAIR = {"name": "pair", "centres": [[-1.0, 0.0], [1.0, 0.0]], "radii": [1.0, 1.0]}


def test_a_pair_of_spheres_in_one_is_warmed_by_the_wall_that_one_of_them_touches():
    """T = T_w - (T_w - T_0) exp(-H t/C): H = 2 k a of a sphere of 10 mm, C of both."""
    number, interval, conductivity = 60, 0.01, 400.0
    tables = chain_tables(2, conductivity, interval, left={"temperature": 60.0})
    grains = tables["particles"]
    del grains["position"]
    tables["particles"] = grains | {
        "radius": 0.005 * 2.0 ** (1.0 / 3.0), "shape": "pair", "shapes": [PAIR], "orientation": [0.0],
        "position": [[0.01 * (1.0 - 2e-4), 0.01]],
    }  # fmt: skip
    scalars = advanced(tables, number)[2].scalars
    # Pressed in by the same at either wall; the true modulus is 64 times that of the scene.
    touched = (1.0 / 64.0) ** (1.0 / 3.0) * math.sqrt(0.005 * 0.01 * 2e-4)
    capacity = 2.0 * 2000.0 * 500.0 * math.pi / 6.0 * 0.01**3
    # One interval passes before it lies still in the middle of what presses it.
    expected = 40.0 * -math.expm1(-2.0 * conductivity * touched * (number - 1) * interval / capacity)
    assert float(scalars.grains[0]) - 20.0 == pytest.approx(expected, rel=0.02)
    assert float(scalars.supplied.walls) == pytest.approx(capacity * (float(scalars.grains[0]) - 20.0), rel=1e-12)


def test_what_contacts_of_bodies_take_and_what_walls_give_is_their_heat():
    tables = with_tables(
        RODS,
        heat={
            "particle_heat_capacity": 500.0, "particle_temperature": 0.0, "friction": True,
            "particle_conductivity": 1.0, "true_young_modulus": 1e8,
        },
        boundary={"bottom": {"temperature": 5.0}},
        coupling={"interval": 2e-4},
        time={"end": 0.012, "output_interval": 0.012},
    )  # fmt: skip
    found = balance_of(tables)
    scalars = found["state"].scalars
    taken, made = sum(found["dissipated"].values()), float(scalars.supplied.friction)
    turned_over = found["gained"] / found["gained_relative"]
    assert made == pytest.approx(taken, abs=1e-11 * turned_over) and taken > 0.02 * turned_over
    grains = 500.0 * 1.5**3 * MASS * np.asarray(scalars.grains)
    assert float(scalars.supplied.walls) > 0.0
    assert np.sum(grains) == pytest.approx(made + float(scalars.supplied.walls), rel=1e-12)


@COMBINATION
def test_the_fluid_takes_heat_through_the_surface_of_the_body():
    """A pair of spheres that touch has 2^(1/3) times the surface of the sphere of its volume."""
    loss = []
    for shaped in (False, True):
        tables = stream_tables(1e-3)
        if shaped:
            tables["particles"] |= {"shape": "pair", "shapes": [PAIR], "orientation": [0.3]}
        loss.append(373.15 - float(advanced(tables, 3)[2].scalars.grains[0]))
    assert loss[1] / loss[0] == pytest.approx(2.0 ** (1.0 / 3.0), rel=0.01)

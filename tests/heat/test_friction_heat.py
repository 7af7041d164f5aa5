"""Heat of friction: what contacts take from the motion warms the grains, and nothing is lost on the way."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem import InputError, load_scene
from jaxdem.run.parts.scalars import heat_balance
from jaxdem.setup.builder import build_case
from tests.cases.energy import BOX, MASS, OPTIONS, balance_of, with_tables
from tests.cases.tiers import tiered

HEAT = {"particle_heat_capacity": 500.0, "particle_temperature": 0.0, "friction": True}
SHORT = {"end": 0.004, "output_interval": 0.004}


def warmed(**changes):
    """The balance of energy of four grains in a box, and the heat of each."""
    found = balance_of(with_tables(BOX, heat=HEAT, **({"time": SHORT} | changes)))
    scalars = found["state"].scalars
    return found, 500.0 * MASS * np.asarray(scalars.grains), float(scalars.supplied.friction)


MORE = OPTIONS["rolling, epsd"] | OPTIONS["plane that oscillates"]


@pytest.mark.parametrize("changes", tiered([{}, MORE], first=[MORE]))
def test_what_contacts_take_becomes_heat(changes):
    """Kinetic, potential, elastic and thermal energy together change by the work of the walls alone."""
    found, grains, made = warmed(**changes)
    taken = sum(found["dissipated"].values())
    turned_over = found["gained"] / found["gained_relative"]
    assert taken > 0.02 * turned_over
    assert made == pytest.approx(taken, abs=1e-11 * turned_over)
    assert np.sum(grains) == pytest.approx(made, rel=1e-12)
    change = sum(found["end"].values()) - sum(found["start"].values()) - sum(found["work"].values())
    assert abs(change + made) < 1e-6 * turned_over
    assert np.all(grains[:3] > 0.0) and grains[3] >= 0.0


def test_two_grains_share_it_evenly():
    """A head-on impact without gravity: m (1 - e^2) v^2 / 4 of two grains that meet at v, half to each."""
    speed = 0.2
    found, grains, made = warmed(
        domain={"size": [0.02, 0.02], "gravity": [0.0, 0.0]},
        particles={"position": [[0.0089, 0.01], [0.01095, 0.01]], "velocity": [[speed, 0.0], [0.0, 0.0]],
                   "angular_velocity": [[0.0], [0.0]]},
        contact={"restitution": 0.6},
        time={"end": 2e-3, "output_interval": 2e-3},
    )  # fmt: skip
    assert grains[0] == pytest.approx(grains[1], rel=1e-12)
    restitution = math.sqrt(1.0 - 4.0 * made / (MASS * speed**2))
    assert restitution == pytest.approx(0.6, rel=0.01)
    assert found["dissipated"]["sliding"] == pytest.approx(0.0, abs=1e-20)


def test_what_is_missing_is_told_over_the_heat_of_friction():
    """With temperatures from 0 there is no heat at the start to tell it over."""
    case = build_case(load_scene(with_tables(BOX, heat=HEAT)))
    state = case.initial_state()[0]
    scalars = state.scalars._replace(grains=jnp.ones(4), supplied=state.scalars.supplied._replace(friction=2000 * MASS))
    balance = heat_balance(case, state._replace(scalars=scalars), 0.0, np.zeros(4))
    assert balance["missing_relative"] == pytest.approx(0.0, abs=1e-12)
    scalars = scalars._replace(grains=jnp.full(4, 1.001))
    balance = heat_balance(case, state._replace(scalars=scalars), 0.0, np.zeros(4))
    assert balance["missing_relative"] == pytest.approx(1e-3, rel=1e-9)


def test_it_needs_particles():
    tables = {
        "domain": {"size": [0.1, 0.1]},
        "fluid": {"cells": [4, 4], "density": 1.0, "viscosity": 1e-3},
        "heat": {"fluid_heat_capacity": 1.0, "fluid_conductivity": 1.0, "fluid_temperature": 1.0, "friction": True},
        "time": {"end": 1.0, "output_interval": 1.0},
    }
    with pytest.raises(InputError) as caught:
        load_scene(tables)
    assert caught.value.key == "heat.friction"

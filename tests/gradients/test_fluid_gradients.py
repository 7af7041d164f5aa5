"""Gradients through fluid steps by the numbers of its options, against central differences."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.closures import SubgridClosure
from tests.cases.tiers import tiered

TIMES = (0.0, 0.02, 0.05)


@pytest.mark.parametrize("learned", tiered([False, True], first=[True]))
def test_gradient_by_subgrid_coefficients_and_velocities_in_time(learned):
    """Of the kinetic energy after four steps of a jet into still water.

    By the inlet's speed at each time, and by C_s, or by the last biases of a learned subgrid stress.
    """
    tables = dict(
        precision="float64",
        domain=dict(size=[0.4, 0.3], depth=1.0),
        fluid=dict(cells=[6, 5], viscosity=1e-5, time_step=0.005, smagorinsky=0.0 if learned else 0.3),
        boundary=dict(
            left={
                "kind": "inlet",
                "times": list(TIMES),
                "velocities": [0.5, 1.5, 0.7],
                "profile": "parabolic",
                "from": 0.05,
                "to": 0.2,
            },
            right=dict(kind="outlet"),
        ),
        time=dict(end=0.05, output_interval=0.05),
    )
    scene = jaxdem.load_scene(tables)
    closure = SubgridClosure.initial(hidden=())
    kernel = closure.weights["Dense_0"]["kernel"]
    simulation, parameters = jaxdem.build(scene, subgrid=closure if learned else None)
    start = jaxdem.initial_state(scene, simulation, parameters)[0].fluid
    interval = simulation.reversible().fluid

    @jax.jit
    def energy(numbers):
        fluid = parameters.fluid
        speeds = jnp.stack((numbers[:3], jnp.zeros(3)), axis=1)
        fluid = fluid._replace(side_velocity=(speeds, *fluid.side_velocity[1:]))
        if learned:
            weights = {"Dense_0": {"kernel": kernel, "bias": numbers[3:]}}
            fluid = fluid._replace(subgrid=dataclasses.replace(closure, weights=weights))
        else:
            fluid = fluid._replace(smagorinsky=numbers[3])

        def body(state, k):
            return interval.advance(fluid, state, k * interval.duration)[0], None

        state, _ = jax.lax.scan(body, start, jnp.arange(4.0))
        return sum(jnp.sum(u**2) for u in state.face_velocity)

    numbers = np.array([0.5, 1.5, 0.7, *([-0.2, 0.4] if learned else [0.3])])
    gradient = np.asarray(jax.jit(jax.grad(energy))(jnp.asarray(numbers)))
    for n in range(len(numbers)):
        shift = 1e-5 * np.eye(len(numbers))[n]
        difference = (float(energy(numbers + shift)) - float(energy(numbers - shift))) / 2e-5
        # The limiter has kinks; away from them the differences are good to 1e-8 or so.
        np.testing.assert_allclose(gradient[n], difference, rtol=1e-5, atol=1e-9)
    # By then the table is read between its first two times: the last one does not matter.
    assert np.all(gradient[[0, 1, *range(3, len(numbers))]] != 0.0) and gradient[2] == 0.0

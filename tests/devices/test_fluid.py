"""Scenes with a fluid on several devices, through the front door, against one device."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem import InputError, devices
from tests.cases.fluid_slabs import ALONG_X, FLUIDS, compared, coupled_scene, places
from tests.cases.tiers import COMBINATION, tiered

SIZE = [0.4, 0.2]


def crowd(**changes):
    """Grains that fly through a fluid in a box that is periodic along x, and collide."""
    tables = coupled_scene(2, ALONG_X, virtual_mass=0.5, lift=["magnus"], rotational_drag=True)
    tables["particles"]["position"] = places(SIZE, count=60)
    return jaxdem.load_scene(tables, changes)


def stirred(state, speed=1.0):
    """The state with random velocities and spins of the grains."""
    draw, particles = np.random.default_rng(5), state.particles
    velocity = speed * draw.normal(size=particles.velocity.shape)
    spin = 20.0 * draw.normal(size=particles.angular_velocity.shape)
    return state._replace(
        particles=particles._replace(velocity=jnp.asarray(velocity), angular_velocity=jnp.asarray(spin))
    )


def test_grains_in_a_fluid_move_as_on_one_device(number=4):
    """After 20 coupling intervals with collisions, grains that change slabs, leave through an outlet and come in, with
    forces that remember: everything within 1e-11."""
    inlet = [{"start": [0.02, 0.16], "stop": [0.38, 0.2], "rate": 1000.0, "velocity": [0.5, 2.0]}]
    scene = crowd(**{"boundary.top": {"kind": "outlet", "particles": "remove"}, "particles.inlet": inlet})
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    state = stirred(state)
    divided, _ = jaxdem.build(scene, devices=number)
    assert divided.undivided() == simulation and divided.slabs.axis == 0
    slabs, lists = devices.distributed(divided, parameters, state, neighbors)
    step = jax.jit(simulation.step)
    many = jax.jit(divided.step).lower(parameters, slabs, lists).compile()
    assert "all-gather" not in many.as_text()
    for _ in range(20):
        state, neighbors, report = step(parameters, state, neighbors)
        slabs, lists, figures = many(parameters, slabs, lists)
        assert not report.particles.overflow and not figures.particles.overflow and figures.fluid.converged
        assert figures.exchange.momentum < 1e-13 and figures.exchange.volume < 1e-13
    whole, _ = devices.gathered(divided, slabs, lists)
    assert devices.counts(lists).migrations > 0 and report.particles.collision_force > 0.0
    assert np.max(compared(divided.slabs, slabs.fluid, state.fluid)) < 1e-11
    there = np.asarray(state.particles.active)
    np.testing.assert_array_equal(whole.particles.active, there)
    came = int(state.particles.inserted[0])
    assert came > 0 and there.sum() < 60 + came, "some have come, and some have left"
    memory = whole.particles.fluid_memory["virtual_mass"], state.particles.fluid_memory["virtual_mass"]
    names = ("position", "velocity", "angular_velocity", "contact_force", "fluid_force")
    pairs = [(getattr(whole.particles, name), getattr(state.particles, name)) for name in names]
    for one, other in [*pairs, memory]:
        one, other = np.asarray(one)[there], np.asarray(other)[there]
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-11 * np.abs(other).max())
    for part in ("fluid", "exchange"):
        one, other = getattr(figures, part), getattr(report, part)
        for name in ("courant", "iterations", "void_fraction", "out_of_range", "substeps"):
            if hasattr(one, name):
                np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-10)


@pytest.mark.parametrize("coupled", tiered([False, True], first=[False]))
def test_gradient_is_that_of_one_device(coupled):
    """Of the kinetic energy of the fluid, and of grains, after 20 intervals in a stream from an inlet to an outlet, on
    two devices, by viscosity, inlet velocity, gravity, and by every constant of the contacts and of the grains, whose
    sizes differ: within 1e-10. Grains collide on both sides of the border and across it."""
    tables = coupled_scene(2, {"left": {"kind": "inlet", "velocity": 0.2}, "right": {"kind": "outlet"}})
    if coupled:
        radius = np.where(np.arange(60) % 3, 0.006, 0.005).tolist()
        tables["particles"] |= {"position": places(SIZE, count=60), "radius": radius}
    else:
        tables = {name: table for name, table in tables.items() if name not in ("particles", "contact", "coupling")}
    scene = jaxdem.load_scene(tables, {"fluid.advection": "upwind"})
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    state = stirred(state) if coupled else state
    divided, _ = jaxdem.build(scene, devices=2)
    slabs, lists = devices.distributed(divided, parameters, state, neighbors)

    def energy(simulation, numbers, state, neighbors):
        sides = (numbers["inlet"], *parameters.fluid.side_velocity[1:])
        fluid = parameters.fluid._replace(viscosity=numbers["viscosity"], side_velocity=sides)
        own = {name: numbers[name] for name in ("bodies", "contact", "gravity") if name in numbers}
        own = parameters._replace(fluid=fluid, **own)
        end = jaxdem.rollout(simulation, own, state, neighbors, 20).state
        upward = end.fluid.face_velocity[1]
        if end.particles is None:
            return jnp.sum(upward**2) + jnp.sum(end.fluid.pressure**2)
        moving, active = end.particles.velocity, end.particles.active
        if active is not None:
            moving = jnp.where(active[..., None], moving, 0.0)
        return jnp.sum(moving**2) + jnp.sum(upward**2)

    numbers = {"viscosity": parameters.fluid.viscosity, "inlet": parameters.fluid.side_velocity[0]}
    if coupled:
        numbers |= {"bodies": parameters.bodies, "contact": parameters.contact, "gravity": parameters.gravity}
    found = []
    for which, start in ((simulation, (state, neighbors)), (divided, (slabs, lists))):
        by_numbers = jax.value_and_grad(lambda numbers, *start, which=which: energy(which, numbers, *start))
        found.append(jax.jit(by_numbers)(numbers, *start))
    by = found[0][1]
    felt = [by["viscosity"], by["inlet"]]
    if coupled:
        assert devices.counts(lists).particles.min() > 0
        felt += [by["gravity"], by["bodies"].density, by["contact"].young_modulus]
        assert np.all(np.asarray(by["bodies"].radius) != 0.0)
    assert all(np.any(np.asarray(one) != 0.0) for one in felt)
    for one, other in zip(jax.tree.leaves(found[1]), jax.tree.leaves(found[0]), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10 * np.abs(other).max())


@COMBINATION
def test_a_fluid_alone_goes_into_slabs_and_on():
    """From `build` to `gathered` without particles; and back onto one device."""
    scene = jaxdem.load_scene(FLUIDS["stream"])
    simulation, parameters = jaxdem.build(scene)
    state, _ = jaxdem.initial_state(scene, simulation, parameters)
    divided, _ = jaxdem.build(scene, devices=2)
    slabs, lists = jaxdem.initial_state(scene, divided, parameters)
    assert lists is None
    one, many = jax.jit(simulation.step), jax.jit(divided.step)
    for _ in range(3):
        state, _, _ = one(parameters, state, None)
        slabs, _, _ = many(parameters, slabs, None)
    assert np.max(compared(divided.slabs, slabs.fluid, state.fluid)) < 1e-12
    whole, contacts = devices.gathered(divided, slabs, None)
    again, _ = devices.on_one_device(divided, parameters, whole, contacts)
    assert again.step == 3
    np.testing.assert_array_equal(again.fluid.pressure, whole.fluid.pressure)


@pytest.mark.parametrize(
    ("changes", "number", "words"),
    [
        ({"fluid.cells": [9, 5]}, 2, ["along x the 9 cells of fluid.cells are no multiple of it (such as 8 or 10)"]),
        ({}, 3, ["no multiple of it", "Use 2 devices"]),
        ({"coupling.kernel_width": 2.2}, 4, ["slabs of 2 cells would be narrower", "coupling.kernel_width", "Use 2"]),
    ],
)
def test_slabs_that_cannot_be_are_refused(changes, number, words):
    with pytest.raises(InputError) as refused:
        jaxdem.build(crowd(**changes), devices=number)
    for word in words:
        assert word in str(refused.value)

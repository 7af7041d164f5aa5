"""Walls that are meshes on several devices, against one device: one that moves and wears, one held by a force, one in
space, and the gradient."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxdem
from jaxdem import devices
from jaxdem.devices.contacts import contacts_of_list
from jaxdem.failures import Failure, failures
from jaxdem.particles.energy import EnergyFlow
from jaxdem.run.placement import Slabs
from jaxdem.setup.builder import build_case
from tests.cases.slabs import apart
from tests.cases.surfaces import grains_scene, plane_mesh, saved
from tests.devices.test_particles import PARTS, scene_of

ARCHARD = {"model": "archard", "coefficient": 1e-3, "hardness": 1e9}


def bowl():
    """Grains that fly to the right over the edges of a floor that shakes, under a lid on which all of them press."""
    floor = {
        "kind": "mesh", "points": [[-0.05, 0.03], [0.05, 0.004], [0.1, 0.02], [0.15, 0.004], [0.25, 0.03]],
        "motion": [{"kind": "oscillation", "direction": [1.0, 0.3], "amplitude": 0.004, "frequency": 20.0}],
        "wear": ARCHARD,
    }  # fmt: skip
    lid = {
        "kind": "mesh", "points": [[0.25, 0.115], [-0.05, 0.115]],
        "piston": {"direction": [0.0, -1.0], "force": 5.0, "mass": 1.0, "damping": 1.0},
    }  # fmt: skip
    particles = scene_of().tables()["particles"]
    particles["position"] = (np.asarray(particles["position"]) * [1.0, 0.9] + [0.0, 0.021]).tolist()
    particles["velocity"] = (np.asarray(particles["velocity"]) + [0.8, 0.0]).tolist()
    size = {"size": [0.2, 0.13], "depth": 0.02}
    return scene_of(domain=size, walls=[floor, lid], particles=particles, output={"energy": True})


def stepped(simulation, parameters, state, neighbors, count, flows=None):
    """After so many intervals, with more room where it is needed; `flows` gets their balances of energy."""
    step = jax.jit(lambda s, n: simulation.step(parameters, s, n))
    assert "all-gather" not in step.lower(state, neighbors).compile().as_text()
    for _ in range(count):
        new = step(state, neighbors)
        if int(failures(simulation, new[2])) & Failure.OVERFLOW:
            state, neighbors = devices.enlarged(simulation, parameters, state, neighbors, new[1])
            new = step(state, neighbors)
        state, neighbors, report = new
        assert int(failures(simulation, report)) == 0
        if flows is not None:
            flows.append(np.asarray(report.particles.energy))
    return state, neighbors


def require_same_memory(one, other):
    """What contacts with meshes keep, by grain."""
    assert len(one.meshes) == len(other.meshes) > 0
    for expected, found in zip(one.meshes, other.meshes, strict=True):
        for x, y in zip(jax.tree.leaves(expected), jax.tree.leaves(found), strict=True):
            assert np.abs(x - y).max() <= 1e-10 * np.abs(x).max()
        assert np.any(np.asarray(expected.spring) != 0.0)


def test_grains_on_meshes_that_move(intervals=14):
    case = build_case(bowl())
    simulation, parameters = case.simulation, case.parameters
    divided, _ = jaxdem.build(bowl(), devices=2)
    start = case.initial_state()
    slabs, lists = devices.distributed(divided, parameters, *start)
    flows = [], []
    state, neighbors = stepped(simulation, parameters, *start, intervals, flows[0])
    slabs, lists = stepped(divided, parameters, slabs, lists, intervals, flows[1])
    assert devices.counts(lists).migrations > 0
    assert apart(*flows) < 1e-10
    assert np.sum(flows[0], axis=0)[EnergyFlow._fields.index("walls")] != 0.0
    whole, kept = devices.gathered(divided, slabs, lists)
    for name in (*PARTS, "pistons", "mesh_wear"):
        pairs = (jax.tree.leaves(getattr(s.particles, name)) for s in (state, whole))
        for x, y in zip(*pairs, strict=True):
            assert apart(x, y) < 1e-10, name
    own = contacts_of_list(state.particles.contact_spring, jax.device_get(neighbors), state.particles.mesh_memory)
    require_same_memory(own, kept)
    back, listed = devices.on_one_device(divided, parameters, whole, kept)
    again = contacts_of_list(back.particles.contact_spring, jax.device_get(listed), back.particles.mesh_memory)
    require_same_memory(own, again)

    # A checkpoint gives back the same bits.
    place = Slabs(case, divided)
    saved = place.saved(slabs, lists, {})
    restored = place.restored(case.unsettled_state()[0], dict(saved.same), saved.attributes)[:2]
    for x, y in zip(jax.tree.leaves((slabs, lists)), jax.tree.leaves(restored), strict=True):
        np.testing.assert_array_equal(x, y)


def test_grains_on_a_mesh_in_space(tmp_path, intervals=10):
    """Two rows of grains that slide, roll and spin over the waves of a floor of triangles, along and across its edges,
    and over the border. Those behind are of another material than those ahead."""
    waves = plane_mesh(14, -0.02, 0.26, warp=0.3)
    waves.vertices[:, 2] = 0.02 + 0.003 * np.sin(60.0 * waves.vertices[:, 0]) * np.cos(50.0 * waves.vertices[:, 1])
    number = np.arange(12)
    place = np.column_stack([0.03 + 0.022 * (number // 2), 0.035 + 0.024 * (number % 2), 0.034 + 0.001 * (number % 3)])
    grains = {
        "position": place, "velocity": np.column_stack([1.2 + 0.0 * number, 0.2 * np.cos(number), -0.3 + 0.0 * number]),
        "spin": 20.0 * np.column_stack([np.sin(number), np.cos(3 * number), np.sin(5 * number)]),
    }  # fmt: skip
    tables = grains_scene(
        [{"kind": "mesh", "file": saved(waves, tmp_path / "waves.ply"), "wear": ARCHARD}], **grains,
        domain={"size": [0.24, 0.09, 0.1]}, particles={"radius": 0.01, "material": ["slick"] * 6 + ["rough"] * 6},
        contact={"young_modulus": 2e6, "speed": 2.0, "skin": 0.2, "wall_material": "rough"},
        materials=[{"name": "slick", "friction": 0.0}, {"name": "rough", "friction": 0.6}],
        time={"end": 0.05, "output_interval": 0.005},
    )  # fmt: skip
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    start = jaxdem.initial_state(scene, simulation, parameters)
    divided, _ = jaxdem.build(scene, devices=2)
    slabs, lists = stepped(divided, parameters, *devices.distributed(divided, parameters, *start), intervals)
    state, neighbors = stepped(simulation, parameters, *start, intervals)
    assert devices.counts(lists).migrations > 0
    whole, kept = devices.gathered(divided, slabs, lists)
    for name in (*PARTS, "mesh_wear"):
        pairs = (jax.tree.leaves(getattr(s.particles, name)) for s in (state, whole))
        for x, y in zip(*pairs, strict=True):
            assert apart(x, y) < 1e-10, name
    own = contacts_of_list(state.particles.contact_spring, jax.device_get(neighbors), state.particles.mesh_memory)
    require_same_memory(own, kept)


def test_the_gradient_over_a_mesh_is_that_on_one_device():
    """Grains that slide down a valley of two lines on both sides of the border, by the constants of their contacts,
    their density and gravity."""
    row = np.arange(6)
    particles = {
        "position": np.stack((0.045 + 0.021 * row, 0.0145 + 0.0017 * np.abs(row - 2.5)), axis=1).tolist(),
        "radius": 0.01, "density": 2500.0, "velocity": np.stack((0.3 - 0.12 * row, -0.1 + 0.0 * row), axis=1).tolist(),
    }  # fmt: skip
    valley = {"kind": "mesh", "points": [[-0.05, 0.018], [0.0975, 0.004], [0.25, 0.018]]}
    scene = scene_of(particles=particles, walls=[valley])
    simulation, parameters = jaxdem.build(scene)
    one = jaxdem.initial_state(scene, simulation, parameters)
    divided, _ = jaxdem.build(scene, devices=2)
    many = devices.distributed(divided, parameters, *one)
    assert devices.counts(many[1]).particles.min() > 0

    def objective(simulation, numbers, state, neighbors):
        contact, density, gravity = numbers
        bodies = parameters.bodies._replace(density=density)
        own = parameters._replace(contact=contact, bodies=bodies, gravity=gravity)
        rows = jaxdem.rollout(simulation, own, state, neighbors, 4).state.particles
        value = rows.velocity**2 + jnp.sin(20.0 * rows.position)
        return jnp.sum(value if rows.active is None else jnp.where(rows.active[..., None], value, 0.0))

    numbers = parameters.contact, parameters.bodies.density, parameters.gravity
    gradient = [
        jax.jit(jax.grad(lambda n, *given, s=s: objective(s, n, *given)))(numbers, *start)
        for s, start in ((simulation, one), (divided, many))
    ]
    for expected, found in zip(*map(jax.tree.leaves, gradient), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * max(np.abs(expected).max(), 1e-12))
    assert float(gradient[0][0].friction) != 0.0 and float(gradient[0][0].young_modulus) != 0.0

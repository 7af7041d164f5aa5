"""Clumps in slabs against one device: motion, contacts of members, walls, who comes and goes, a fluid, gradients."""

import shutil

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem import devices
from jaxdem.check.check import check_scene
from jaxdem.devices.contacts import contacts_of_list
from jaxdem.particles import slab_steps
from jaxdem.particles.energy import EnergyFlow
from tests.cases.clumps import momenta
from tests.cases.fluid_slabs import ALONG_X, coupled_scene
from tests.cases.slabs import apart
from tests.cases.surfaces import plane_mesh, saved
from tests.cases.tiers import COMBINATION
from tests.devices.test_particles import PERIODIC, pair_of, run, touching

PARTS = ("position", "velocity", "angular_velocity", "orientation", "contact_force")
ROD = {"name": "rod", "centres": [[-0.7, 0.0], [0.7, 0.0]], "radii": [1.0, 0.8]}
BENT = {"name": "bent", "centres": [[0.0, 0.0], [1.0, 0.0], [0.4, 0.8]], "radii": [1.0, 0.8, 0.7]}
ARCHARD = {"model": "archard", "coefficient": 1e-3, "hardness": 1e9}
IN_SPACE = {"name": "bent", "centres": [[0.0, 0.0, 0.0], [1.1, 0.0, 0.0], [1.1, 0.8, 0.3]], "radii": [1.0, 0.8, 0.6]}


def scene_of(count=(10, 4), apart=0.026, drift=(0.0, 0.0), seed=1, **changes):
    """Rods, bent bodies and spheres that turn, on a lattice in 2-D."""
    places = [apart * (0.5 + np.arange(n)) for n in count]
    position = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1).reshape(-1, 2)
    draw, number = np.random.default_rng(seed), len(position)
    tables = {
        "precision": "float64",
        "domain": {"size": [apart * n for n in count], "depth": 0.02, "gravity": [0.0, 0.0]},
        "particles": {
            "position": position.tolist(),
            "radius": 0.008,
            "density": 2500.0,
            "velocity": (np.asarray(drift) + 0.2 * draw.normal(size=position.shape)).tolist(),
            "angular_velocity": draw.normal(0.0, 10.0, number).tolist(),
            "shapes": [ROD, BENT],
            "species": [{"share": 0.4, "shape": "rod"}, {"share": 0.4, "shape": "bent"}, {"share": 0.2}],
        },
        "contact": {
            "young_modulus": 2e6, "friction": 0.4, "restitution": 0.6, "speed": 1.5, "skin": 0.2,
            "maximum_overlap": 0.3, "rolling_friction": 0.1, "rolling_model": "epsd",
        },
        "boundary": PERIODIC,
        "time": {"end": 0.1, "output_interval": 0.005},
    }  # fmt: skip
    for key, value in changes.items():
        if isinstance(value, dict):
            value = {name: one for name, one in {**tables.get(key, {}), **value}.items() if one is not None}
        tables[key] = value
    return jaxdem.load_scene(tables)


def require_same(state, neighbors, whole, contacts, tolerance=1e-10):
    """The same motion, and contacts that keep the same."""
    there = np.ones(len(whole.position), bool) if state.active is None else np.asarray(state.active)
    for name in PARTS:
        one, other = (np.asarray(getattr(s, name))[there] for s in (state, whole))
        assert apart(one, other) < tolerance, name
    for one, other in zip(state.wall_spring, whole.wall_spring, strict=True):
        rows = np.tile(there, one.shape[1] // len(there))
        assert apart(np.asarray(one)[:, rows], np.asarray(other)[:, rows]) < tolerance
    own = contacts_of_list(state.contact_spring, jax.device_get(neighbors), state.mesh_memory)
    assert touching(own) == touching(contacts)
    in_order = [c.values[:, np.lexsort((c.second, c.first))] for c in (own, contacts)]
    assert apart(*in_order) < tolerance
    for one, other in zip(jax.tree.leaves(own.meshes), jax.tree.leaves(contacts.meshes), strict=True):
        assert apart(one, other) < tolerance
    return own


HEAT = {
    "particle_heat_capacity": 500.0, "particle_temperature": 20.0, "particle_conductivity": 1e4,
    "true_young_modulus": 2e6, "friction": True,
}  # fmt: skip


def warm_slab():
    """Bodies of three shapes that collide, turn, roll, rub and conduct heat, and go by most of the box along both
    periodic axes in 90 intervals; in two slabs, those of one as warm. What `pair_of` gives, and the temperatures."""
    scene = scene_of(drift=(2.4, 1.0), heat=HEAT, coupling={"interval": 1e-3})
    simulation, divided, parameters, one, _ = pair_of(scene, 2)
    ahead = np.asarray(one[0].particles.position)[:, 0] > 0.5 * simulation.box[0]
    first = np.where(ahead, 80.0, 20.0)
    one = one[0]._replace(scalars=one[0].scalars._replace(grains=jnp.asarray(first))), one[1]
    return simulation, divided, parameters, one, devices.distributed(divided, parameters, *one), first


def test_a_pack_drifts_over_all_borders(intervals=90):
    """All is as on one device, and heat crosses both planes between the two slabs. More slabs differ by who their
    neighbours are, as those of spheres do: test_particles.py."""
    simulation, divided, parameters, one, slabs, first = warm_slab()
    start, ahead = one[0].particles, first > 50.0
    state, neighbors, _ = run(simulation, parameters, *one, intervals)
    many, lists, _ = run(divided, parameters, *slabs, intervals)
    whole, contacts = devices.gathered(divided, many, lists)
    own = require_same(state.particles, neighbors, whole.particles, contacts)
    assert len(touching(own)) > 0
    count = len(start.position)
    assert any((own.first // count > 0) | (own.second // count > 0)), "members after the first touch too"
    figures = devices.counts(lists)
    assert figures.particles.sum() == count and figures.migrations > 4
    moved = np.asarray(whole.particles.position - start.position)
    assert np.all(moved.mean(axis=0) > 0.8 * np.asarray(simulation.box))
    assert apart(state.scalars.grains, whole.scalars.grains) < 1e-11
    gained = np.asarray(state.scalars.grains) - first
    assert gained[ahead].sum() < -0.1 and gained[~ahead].sum() > 0.1, "heat has crossed the borders"
    energies = [momenta(parameters.bodies, p) for p in (start, state.particles, whole.particles)]
    mass = np.broadcast_to(np.asarray(parameters.bodies.mass), count)[:, None]
    scale = np.sum(mass * np.abs(np.asarray(start.velocity)))
    assert np.abs(energies[2][1] - energies[0][1]).max() < 1e-13 * scale, "momentum is kept"
    assert abs(energies[2][0] / energies[1][0] - 1.0) < 1e-12
    assert energies[1][0] < 0.999 * energies[0][0], "collisions take energy"


@COMBINATION
def test_without_the_angles_that_the_neighbours_send_all_is_different(monkeypatch, intervals=90):
    """So the comparison above would tell that they are missing."""
    simulation, divided, parameters, one, slabs, _ = warm_slab()
    state, _, _ = run(simulation, parameters, *one, intervals)

    def silent(division, neighbors, motion, *rest):
        new, *others = slab_steps.refreshed(division, neighbors, motion, *rest)
        return new._replace(orientation=motion.orientation), *others

    monkeypatch.setattr("jaxdem.particles.verlet.refreshed", silent)
    step = jax.jit(lambda p, s, n: divided.step(p, s, n))
    for _ in range(intervals):
        slabs = step(parameters, *slabs)[:2]
    without, _ = devices.gathered(divided, *slabs)
    assert apart(state.particles.angular_velocity, without.particles.angular_velocity) > 1e-3


@COMBINATION
def test_walls_a_mesh_and_materials_in_space(tmp_path):
    """Bent bodies and spheres of two materials slide, roll and spin in a box, over a wavy sheet of triangles that
    wears, along and across its edges, and over the border; with the balance of energy."""
    number = np.arange(12)
    place = np.column_stack([0.03 + 0.028 * (number // 2), 0.026 + 0.03 * (number % 2), 0.039 + 0.001 * (number % 3)])
    draw, waves = np.random.default_rng(4), plane_mesh(10, -0.02, 0.22, warp=0.3)
    waves.vertices[:, 2] = 0.02 + 0.003 * np.sin(60.0 * waves.vertices[:, 0]) * np.cos(50.0 * waves.vertices[:, 1])
    scene = scene_of(
        domain={"size": [0.2, 0.084, 0.1], "depth": None, "gravity": [0.0, 0.0, -9.81]},
        boundary=dict.fromkeys(PERIODIC),
        walls=[{"kind": "mesh", "file": saved(waves, tmp_path / "waves.ply"), "wear": ARCHARD}],
        particles={
            "position": place.tolist(), "radius": 0.0085, "shapes": [IN_SPACE],
            "species": [
                {"share": 0.4, "shape": "bent", "material": "slick"},
                {"share": 0.4, "shape": "bent", "material": "rough"},
                {"share": 0.2, "material": "rough"},
            ],
            "velocity": (np.array([1.2, 0.0, -0.4]) + 0.1 * draw.normal(size=place.shape)).tolist(),
            "angular_velocity": (20.0 * draw.normal(size=place.shape)).tolist(),
        },
        contact={"friction": None, "rolling_friction": 0.05, "wall_material": "rough"},
        materials=[{"name": "slick", "friction": 0.0}, {"name": "rough", "friction": 0.6}],
        output={"energy": True},
    )  # fmt: skip
    simulation, divided, parameters, one, slabs = pair_of(scene, 2)
    flows, ways = ([], []), ([], [])
    for kept, way, which, (state, lists) in zip(flows, ways, (simulation, divided), (one, slabs), strict=True):
        step = jax.jit(which.step)
        for _ in range(14):
            state, lists, report = step(parameters, state, lists)
            kept.append(report.particles.energy)
            way.append((state, lists))
    alone = ways[0][-1]
    assert devices.counts(lists).migrations > 0
    whole, contacts = devices.gathered(divided, state, lists)
    require_same(alone[0].particles, alone[1], whole.particles, contacts)
    # When most contacts with the mesh keep something.
    number = [np.count_nonzero(then.particles.mesh_memory[0].spring) for then, _ in ways[0]]
    (then, listed), of_slabs = (way[int(np.argmax(number))] for way in ways)
    middle, contacts = devices.gathered(divided, *of_slabs)
    require_same(then.particles, listed, middle.particles, contacts)
    assert max(number) > 0
    worn = [jax.tree.leaves(of.mesh_wear) for of in (alone[0].particles, whole.particles)]
    for expected, found in zip(*worn, strict=True):
        assert apart(expected, found) < 1e-10 and np.any(np.asarray(expected) != 0.0)
    sums = [{f: sum(float(getattr(flow, f)) for flow in kept) for f in EnergyFlow._fields} for kept in flows]
    scale = max(abs(value) for value in sums[0].values())
    assert sums[0]["damping"] != 0.0 and sums[0]["turning"] != 0.0
    for name, value in sums[0].items():
        assert abs(sums[1][name] - value) < 1e-11 * scale, name


@COMBINATION
def test_what_a_state_has_comes_back_unchanged():
    """Single precision, members that are not in all bodies, some of which are still to come."""
    inlet = {"side": "top", "rate": 40.0, "velocity": 0.5}
    scene = scene_of(precision="float32", particles={"inlet": [inlet]}, boundary=dict.fromkeys(PERIODIC))
    _, divided, parameters, (state, neighbors), _ = pair_of(scene, 2)
    draw, particles = np.random.default_rng(0), state.particles

    def marked(array):
        return jnp.asarray(draw.normal(size=array.shape), array.dtype)

    listed = np.asarray(neighbors.pairs.first != neighbors.pairs.second)
    springs = tuple(jnp.where(listed, marked(x), 0.0) for x in particles.contact_spring)
    names = ("velocity", "angular_velocity", "contact_force", "wall_spring")
    there = np.asarray(particles.active)
    assert 0 < there.sum() < len(there) and len(particles.wall_spring[0]) == 4
    others = jax.tree.map(marked, {name: getattr(particles, name) for name in names})
    others["wall_spring"] = tuple(x * np.tile(there, 3)[None] for x in others["wall_spring"])
    for name in ("velocity", "angular_velocity", "contact_force"):
        others[name] = others[name] * there[:, None]
    state = state._replace(particles=particles._replace(contact_spring=springs, **others))
    slabs = devices.distributed(divided, parameters, state, neighbors)
    again, _ = devices.on_one_device(divided, parameters, *devices.gathered(divided, *slabs))
    assert np.any(np.asarray(particles.orientation_low) != 0.0)
    for name in (*names, "orientation", "orientation_low", "contact_spring", "inserted", "active"):
        for one, other in zip(*(jax.tree.leaves(getattr(s.particles, name)) for s in (state, again)), strict=True):
            np.testing.assert_array_equal(np.asarray(other), np.asarray(one), err_msg=name)


def rods_over_a_concave_edge():
    """Four rods in pairs across the planes of two slabs, which meet by their ends as they turn; those in the middle
    fall on two lines that meet there."""
    particles = {
        "position": [[0.118, 0.03], [0.142, 0.031], [0.016, 0.07], [0.244, 0.071]],
        "velocity": [[0.3, -0.3], [-0.3, -0.25], [-0.3, 0.0], [0.3, 0.02]],
        "orientation": [0.9, 2.0, 0.5, 2.5],
        "angular_velocity": [40.0, -30.0, 25.0, 45.0],
        "radius": 0.0085,
        "species": None,
        "shape": "rod",
    }
    sheet = {"kind": "mesh", "points": [[0.06, 0.018], [0.1275, 0.012], [0.2, 0.018]]}
    return scene_of(particles=particles, walls=[sheet])


@COMBINATION
def test_the_gradient_is_that_on_one_device():
    """Of rods that collide across the borders and with a mesh on both sides of one, by every constant of bodies and
    contacts and by gravity."""
    simulation, divided, parameters, one, slabs = pair_of(rods_over_a_concave_edge(), 2)

    def objective(simulation, numbers, state, neighbors):
        bodies, contact, gravity = numbers
        own = parameters._replace(bodies=bodies, contact=contact, gravity=gravity)
        rows = jaxdem.rollout(simulation, own, state, neighbors, 8).state.particles
        there = jnp.ones(rows.position.shape[:-1], bool) if rows.active is None else rows.active
        value = jnp.sum(rows.velocity**2 + jnp.sin(20.0 * rows.position), axis=-1)
        value = value + jnp.sum(jnp.sin(rows.orientation), axis=-1)
        return jnp.sum(jnp.where(there, value, 0.0)), rows.velocity

    numbers = parameters.bodies, parameters.contact, parameters.gravity
    (gradient, velocity), (found, _) = (
        jax.jit(jax.grad(lambda n, *given, s=s: objective(s, n, *given), has_aux=True))(numbers, *start)
        for s, start in ((simulation, one), (divided, slabs))
    )
    for expected, other in zip(*map(jax.tree.leaves, (gradient, found)), strict=True):
        np.testing.assert_allclose(other, expected, rtol=0, atol=1e-10 * max(np.abs(expected).max(), 1e-12))
    bodies, contact, gravity = gradient
    assert float(bodies.density) != 0.0 and np.any(np.asarray(bodies.clumps.inertia[0]) != 0.0)
    assert float(contact.friction) != 0.0 and float(contact.young_modulus) != 0.0 and np.all(np.asarray(gravity) != 0.0)
    upward = np.asarray(velocity)[:, 1] - np.asarray(one[0].particles.velocity)[:, 1]
    assert np.all(upward[:2] > 0.1), "both have met the mesh, on either side of the border"


def in_a_fluid():
    """Rods and bent bodies in a stream, whose drag feels their shape; some come in, turned each in its own way, and
    leave with the fluid through the top."""
    top = {"kind": "outlet", "particles": "remove"}
    tables = coupled_scene(2, ALONG_X | {"top": top}, drag="haider_levenspiel")
    count = len(tables["particles"]["position"])
    tables["particles"] |= {
        "radius": 0.008, "shapes": [ROD, BENT],
        "species": [{"share": 0.5, "shape": "rod"}, {"share": 0.5, "shape": "bent"}],
        "angular_velocity": np.random.default_rng(2).normal(0.0, 5.0, count).tolist(),
        "velocity": np.column_stack([np.full(count, 0.1), 0.6 * (-1.0) ** np.arange(count)]).tolist(),
        "inlet": [{"start": [0.02, 0.12], "stop": [0.38, 0.19], "rate": 450.0, "velocity": [0.4, 1.5], "total": 8}],
    }  # fmt: skip
    tables["contact"] |= {"skin": 0.2, "speed": 2.0}
    tables["time"] = {"end": 0.04, "output_interval": 0.01}
    return tables


@COMBINATION
def test_bodies_in_a_stream_are_resumed_on_other_numbers_of_devices(tmp_path):
    """Bit for bit on as many, to rounding on one; and the same as on one device from the start, also who is there."""
    tables = in_a_fluid()
    whole = jaxdem.load_scene(tables)
    half = jaxdem.load_scene(tables | {"time": {"end": 0.02, "output_interval": 0.01}})
    one = jaxdem.simulate(whole, tmp_path / "one")
    two = jaxdem.simulate(whole, tmp_path / "two", devices=2)
    jaxdem.simulate(half, tmp_path / "again", devices=2)
    shutil.copytree(tmp_path / "again", tmp_path / "alone")
    again = jaxdem.simulate(whole, tmp_path / "again", devices=2, resume=True)
    alone = jaxdem.simulate(whole, tmp_path / "alone", resume=True)
    assert two.summary["devices"]["migrations"] > 0
    there = one.particles(-1)["active"] == 1
    assert one.history["removed"][-1] > 0 and there[-8:].any(), "some have left, and some have come"
    for kind in ("particles", "spheres", "fluid"):
        expected, first, *others = (getattr(run_, kind)(-1) for run_ in (one, two, alone, again))
        rows = slice(None) if kind == "fluid" else expected["active"] == 1
        for name in expected:
            np.testing.assert_array_equal(others[1][name], first[name], err_msg=name)
            for found in (first, others[0]):
                assert apart(expected[name][rows], found[name][rows]) < 1e-10, f"{kind}: {name}"


def test_figures_before_a_run():
    """Ghosts reach farther by two arms, and how they lie is sent."""
    tables = scene_of().tables()
    scene = jaxdem.load_scene(tables)
    simulation, _ = jaxdem.build(scene)
    report = check_scene(scene, devices=2).devices
    search = simulation.search
    assert search.body_reach == pytest.approx(search.reach + 2.0 * search.arm)
    along = np.asarray(tables["particles"]["position"])[:, 0]
    length = simulation.box[0]
    ends = np.abs(along[:, None] - np.array([0.0, 0.5, 1.0]) * length) < search.body_reach
    assert sum(report.ghosts) == int(ends.sum())
    assert report.sent[0] % (8 * 2) == 8 and (report.sent[0] - 8) // 16 % 8 == 0, "eight numbers of each ghost in 2-D"

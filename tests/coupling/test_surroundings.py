"""The closure of neighbours in the solver: the same as in training, in both models, with exact exchange."""

import copy
import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.closures import NeighborClosure
from jaxdem.closures.moments import MomentBasis
from jaxdem.closures.neighbor_level import Width
from jaxdem.closures.neighbor_places import axes_along
from jaxdem.coupling import surroundings
from jaxdem.errors import InputError
from jaxdem.step import advance_fluid
from jaxdem.train.sphere_moments import group_moments, predicted, with_carried
from jaxdem.train.spheres import SphereGroup
from tests.cases.small_scenes import SMALL_INJECTION
from tests.cases.tiers import COMBINATION

D, SIDE, COUNT = 0.01, 6.0, 50
"""Diameter [m], side of the box in diameters, number of spheres: solid fraction 0.12."""
RHO, MU, RE = 1000.0, 1e-3, 10.0


def places(seed=4):
    """Centres in diameters of spheres that do not overlap in the periodic box."""
    generator, found = np.random.default_rng(seed), np.zeros((0, 3))
    while len(found) < COUNT:
        one = generator.uniform(0, SIDE, 3)
        apart = found - one
        apart -= SIDE * np.round(apart / SIDE)
        if (np.sum(apart**2, axis=1) > 1.0).all():
            found = np.vstack([found, one])
    return found


def scene(model="A", **changes):
    sides = ("left", "right", "bottom", "top", "front", "back")
    tables = dict(
        precision="float64",
        domain=dict(size=[SIDE * D] * 3, gravity=[0.0, 0.0, 0.0]),
        particles=dict(radius=D / 2, density=2500.0, position=(places() * D).tolist()),
        contact=dict(young_modulus=1e5, friction=0.3, speed=0.05),
        fluid=dict(cells=[4, 4, 4], viscosity=MU / RHO, density=RHO, time_step=0.01, model=model),
        boundary={side: dict(kind="periodic") for side in sides},
        coupling=dict(interval=0.01, kernel_width=dict(diameters=0.5, cells=0.5)),
        time=dict(end=0.1, output_interval=0.1),
    )
    for table, keys in changes.items():
        tables[table] = tables.get(table, {}) | keys
    return jaxdem.Scene.model_validate(tables)


@pytest.fixture(scope="module")
def closure():
    """Two levels with random weights, and a scatter as in the data."""
    found = NeighborClosure.initial(
        MomentBasis(2.6, 4, 3, 3), MomentBasis(2.2, 3, 3, 2), [Width(5, 3, (6,))] * 2, seed=2
    )
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float64), found)


class World:
    """A scene of fixed forces: what the first interval gives, for any velocity of the particles."""

    def __init__(self, closure, /, **changes):
        self.simulation, self.parameters = jaxdem.build(scene(**changes), closure=closure)
        self.state, _ = jaxdem.initial_state(scene(**changes), self.simulation, self.parameters)

    def begin(self, closure, velocity):
        state = self.state
        moved = state.particles._replace(velocity=jnp.broadcast_to(velocity, state.particles.velocity.shape))
        mixture = self.parameters._replace(closure=closure).mixture
        return self.simulation.coupling, mixture, state.fluid, moved

    def effect(self, closure, velocity):
        """What the neighbours add, and the inputs of the law: of an even fluid, at the solid fraction of the box."""
        coupling, mixture, fluid, particles = self.begin(closure, velocity)
        sampled = coupling.sample(mixture, fluid, particles)
        start = coupling.start(mixture, fluid, particles, sampled)
        even = jnp.full(COUNT, COUNT * np.pi / 6 / SIDE**3)
        inputs = sampled.law_inputs._replace(solid_fraction=even)
        return coupling.drag.neighbors(closure, mixture.drag_scale, start, inputs), inputs


@pytest.fixture(scope="module")
def world(closure):
    return World(closure)


@pytest.fixture(scope="module")
def effect(world):
    return jax.jit(world.effect)


def slip_of(direction):
    """Velocity of the particles for which Re is about `RE` with the slip along a direction."""
    return -jnp.asarray(direction, jnp.float64) * (RE * MU / (RHO * D)) / (1 - COUNT * np.pi / 6 / SIDE**3)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_solver_and_training_give_the_same(effect, closure, axis):
    """A stream along each axis: the effect is that of the array turned so that its stream is along the first one."""
    found, inputs = effect(closure, slip_of(np.eye(3)[axis]))
    turn = np.roll(np.eye(3), axis, axis=1)  # rows: the stream, and the next axes
    local = places() @ turn.T
    zeros = np.zeros((COUNT, 3))
    start = np.array([0, COUNT])
    box = np.full((1, 3), SIDE)
    re, s = float(inputs.reynolds[0]), float(inputs.solid_fraction[0])
    group = SphereGroup("", re, s, start, local, zeros, zeros, box)
    np.testing.assert_allclose(inputs.reynolds, RE, rtol=1e-6)
    given = predicted(closure, group, with_carried(closure, group, group_moments(closure.basis, group)))
    void = 1 - inputs.solid_fraction
    along = (found.multiple - 1) * void
    mean = closure.base(inputs).coefficient * inputs.slip_speed / void
    across, torque = (np.asarray(part / mean[:, None]) @ turn.T for part in (found.across, found.torque / D))
    np.testing.assert_allclose(across[:, 0], 0.0, atol=1e-12)
    assert np.abs(along).max() > 1e-3 and np.abs(across).max() > 1e-3
    # In training numbers have single precision.
    np.testing.assert_allclose(along, given.along, atol=1e-6)
    np.testing.assert_allclose(across[:, 1:], given.across, atol=1e-6)
    np.testing.assert_allclose(torque, given.torque, atol=1e-6)


def test_axes_are_right_handed_and_slopes_are_finite():
    vectors = jnp.asarray([[1.0, 2.0, 3.0], [0.0, 0.0, -1.0], [0.0, 0.0, 2.0], [1.0, -1.0, 0.0], [0.0, 0.0, 0.0]])
    along = jax.jit(axes_along)
    axes = np.stack(along(vectors), axis=1)
    np.testing.assert_allclose(axes @ axes.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (5, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(axes), 1.0)
    size = np.linalg.norm(vectors, axis=1)
    np.testing.assert_allclose(axes[:4, 0] * size[:4, None], vectors[:4], atol=1e-12)
    assert np.isfinite(jax.jit(jax.jacobian(lambda v: jnp.stack(along(v))))(vectors)).all()


def test_momentum_is_exact_and_torques_reach_the_grains(world, closure):
    """In a step of the solver the faces lose what the grains get, term by term; the torque is that of the closure."""
    moving = world.state._replace(particles=world.begin(closure, slip_of([0.6, 0.8, 0.0]))[3])

    @jax.jit
    def first(parameters, state):
        _, forces, _, exchange = advance_fluid(world.simulation, parameters, state)
        return forces, exchange

    forces, exchange = first(world.parameters, moving)
    plain, _ = first(
        world.parameters._replace(closure=dataclasses.replace(closure, scale=jnp.full((4, 6), -1e3))), moving
    )
    assert float(exchange.momentum) < 1e-14
    assert int(exchange.out_of_range) == 0
    np.testing.assert_allclose(plain.torque, 0.0, atol=1e-20)
    assert float(jnp.abs(forces.torque).max()) > 0
    assert float(jnp.abs(forces.law - plain.law).max()) > 1e-3 * float(jnp.abs(plain.law).max())


def test_slopes_by_the_places_are_those_of_differences(world, closure):
    """Across the search, the blocks and both levels."""
    way = jnp.asarray(np.random.default_rng(5).normal(size=(COUNT, 3))) * D

    def total(shift):
        coupling, mixture, fluid, particles = world.begin(closure, slip_of([1.0, 0.3, -0.2]))
        sampled = coupling.sample(mixture, fluid, particles)
        moved = particles._replace(position=particles.position + shift * way)
        start = coupling.start(mixture, fluid, moved, sampled)
        found = coupling.drag.neighbors(closure, mixture.drag_scale, start, sampled.law_inputs)
        force = RHO * (RE * MU / (RHO * D)) ** 2 * D**2
        return jnp.sum(found.multiple**2) + jnp.sum(found.across**2) / force**2 + jnp.sum(found.torque[:, 0]) / force

    both, step = jax.jit(jax.value_and_grad(total)), 1e-6
    (ahead, _), (behind, _), (_, slope) = (both(shift) for shift in (step, -step, 0.0))
    assert float(slope) == pytest.approx(float(ahead - behind) / (2 * step), rel=1e-5)


@COMBINATION
def test_model_b_has_the_same_force_of_the_whole_fluid(effect, closure):
    """Of the force F (1 + r): in model A drag is g F (1 + r/g), in model B F (1 + r)."""
    velocity = slip_of([1.0, 0.0, 0.0])
    found, inputs = effect(closure, velocity)
    other = jax.jit(World(closure, fluid=dict(model="B")).effect)(closure, velocity)[0]
    void = np.asarray(1 - inputs.solid_fraction)
    np.testing.assert_allclose((found.multiple - 1) * void, other.multiple - 1, atol=1e-12)
    np.testing.assert_allclose(found.across, other.across, atol=1e-18)


def test_without_room_the_mean_law_acts_and_all_are_told(closure, world, monkeypatch):
    coupling = world.simulation.coupling
    narrow = dataclasses.replace(coupling.drag.surroundings, slots=3, cell_slots=4)
    drag = dataclasses.replace(coupling.drag, surroundings=narrow)
    monkeypatch.setattr(surroundings, "AT_ONCE", 7)  # the last block is not full

    def effect(model, mixture, fluid, particles):
        sampled = coupling.sample(mixture, fluid, particles)
        start = coupling.start(mixture, fluid, particles, sampled)
        return model.neighbors(closure, mixture.drag_scale, start, sampled.law_inputs)

    given = world.begin(closure, slip_of([1.0, 0.0, 0.0]))[1:]
    effects = jax.jit(lambda *given: [effect(model, *given) for model in (drag, coupling.drag)])(*given)
    assert np.asarray(effects[0].out_of_range).all()
    np.testing.assert_array_equal(effects[0].multiple, 1.0)
    np.testing.assert_array_equal(effects[0].across, 0.0)
    assert not np.asarray(effects[1].out_of_range).any()
    assert np.abs(np.asarray(effects[1].multiple) - 1).max() > 1e-3


def test_what_the_neighbours_add_is_held(closure, effect):
    """With hold = 2 the first interval finds what each interval finds without, the second has it still, the third finds
    it anew."""
    world, velocity = World(closure, closure=dict(hold=2)), slip_of([1.0, 0.2, 0.0])
    first, inputs = jax.jit(world.effect)(closure, velocity)
    fresh, _ = effect(closure, velocity)
    np.testing.assert_allclose(first.multiple, fresh.multiple, rtol=1e-12)
    np.testing.assert_allclose(first.torque, fresh.torque, rtol=1e-9, atol=1e-20)
    state = world.state._replace(particles=world.begin(closure, velocity)[3])
    _, neighbors = jaxdem.initial_state(scene(closure=dict(hold=2)), world.simulation, world.parameters)
    step, rows = jax.jit(world.simulation.step), []
    for _ in range(3):
        state, neighbors, _ = step(world.parameters, state, neighbors)
        rows.append(np.asarray(state.particles.fluid_memory["neighbors"]))
    assert [row[0, -1] for row in rows] == [1.0, 0.0, 1.0]
    np.testing.assert_array_equal(rows[1][:, :-1], rows[0][:, :-1])
    assert np.abs(rows[2][:, :-1] - rows[0][:, :-1]).max() > 1e-6


@COMBINATION
def test_what_is_held_does_not_turn_over_with_the_axes(closure):
    """The axes across a slip along x turn over when its vertical part changes its sign; force and torque do not."""
    world = World(closure, closure=dict(hold=3))

    @jax.jit
    def effect(velocity, memory):
        particles = world.state.particles._replace(fluid_memory={"neighbors": memory})
        own = copy.copy(world)
        own.state = world.state._replace(particles=particles)
        return own.effect(closure, velocity)[0]

    up, down = slip_of([1.0, 0.0, 1e-6]), slip_of([1.0, 0.0, -1e-6])
    first = effect(up, world.state.particles.fluid_memory["neighbors"])
    second = effect(down, first.memory)
    assert float(second.memory[0, -1]) == 1.0
    for name in ("across", "torque"):
        size = float(jnp.abs(getattr(first, name)).max())
        assert size > 0.0
        np.testing.assert_allclose(getattr(second, name), getattr(first, name), rtol=0.0, atol=1e-5 * size)


def test_holding_is_refused_for_other_laws():
    with pytest.raises(InputError, match=r"closure\.hold.*closures of neighbours"):
        jaxdem.build(scene(closure=dict(hold=2)))


def test_a_crowd_elsewhere_does_not_matter(closure):
    """Where a cell is too full, those around it are told, and none farther away: their neighbours are all found."""
    long, reach = 4.0 * SIDE, closure.reach
    pair = np.array([[2.5 * SIDE, 1.0, 1.0], [2.5 * SIDE, 2.5, 1.0]])
    centres = np.vstack([places(), pair])
    world = World(
        closure, domain=dict(size=[long * D, SIDE * D, SIDE * D]), particles=dict(position=(centres * D).tolist())
    )
    coupling = world.simulation.coupling
    narrow = dataclasses.replace(coupling.drag.surroundings, cell_slots=4)

    @jax.jit
    def listed(mixture, fluid, particles):
        sampled = coupling.sample(mixture, fluid, particles)
        axis = jnp.zeros_like(particles.position).at[:, 0].set(1.0)
        return narrow.neighbors(coupling.start(mixture, fluid, particles, sampled), axis)

    found = listed(world.parameters.mixture, world.state.fluid, world.state.particles)
    others, full = (np.asarray(part) for part in found)
    assert full[:COUNT].any() and not full[COUNT:].any()
    apart = centres[:, None] - centres[None]
    apart -= np.array([long, SIDE, SIDE]) * np.round(apart / np.array([long, SIDE, SIDE]))
    near = np.linalg.norm(apart, axis=2) < reach
    for i in np.flatnonzero(~full):
        assert set(others[i]) == set(np.flatnonzero(near[i]))


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        (dict(particles=dict(coarse_grain=2.0, radius=D / 4)), "particles.coarse_grain", "parcel"),
        (
            dict(coupling=dict(self_disturbance=True, kernel_width=dict(diameters=3.0, cells=0.5))),
            "coupling",
            "no rule",
        ),
        (dict(domain=dict(size=[SIDE * D, SIDE * D, 5.0 * D])), "domain.size", "twice the reach"),
    ],
)
def test_scenes_that_it_is_not_for_are_refused(closure, changes, key, words):
    with pytest.raises(InputError) as error:
        jaxdem.build(scene(**changes), closure=closure)
    assert key in str(error.value) and words in str(error.value)


def test_a_scene_in_two_dimensions_is_refused(closure):
    walls = {side: {"kind": "wall"} for side in ("left", "right", "bottom", "top")}
    domain = SMALL_INJECTION["domain"] | {"gravity": [0.0, -9.81]}
    tables = {**SMALL_INJECTION, "domain": domain, "boundary": walls, "coupling": {}}
    tables |= {"time": {"end": 1.0, "output_interval": 1.0}}
    flat = jaxdem.Scene.model_validate(tables)
    with pytest.raises(InputError, match="spheres in 3-D"):
        jaxdem.build(flat, closure=closure)

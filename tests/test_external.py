"""Particles in a fluid that another program solves: what they get the fluid loses; our own fluid as the other one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxdem
from jaxdem.errors import InputError
from jaxdem.fluid.fluid_state import FaceExchange, ParticleFields
from jaxdem.fluid.grid import face_control_volume, face_total
from jaxdem.fluid.projection import pressure_slope

RADIUS, DEPTH = 0.01, 0.04
CELL = 0.04**2 * DEPTH
ALL_FORCES = {"lift": ["saffman_mei", "magnus"], "virtual_mass": 0.5, "rotational_drag": True}


def scene(**coupling):
    """Four grains, two of which collide, between walls below and above; periodic along x."""
    return jaxdem.load_scene(
        {
            "precision": "float64",
            "domain": {"size": [0.24, 0.2], "depth": DEPTH, "gravity": [0.0, 0.0]},
            "particles": {
                "radius": RADIUS,
                "density": 2650.0,
                "position": [[0.1, 0.1], [0.1205, 0.1], [0.2, 0.15], [0.05, 0.04]],
                "velocity": [[0.2, 0.0], [-0.1, 0.1], [0.0, 0.0], [0.3, 0.1]],
                "angular_velocity": [[1.0], [0.0], [0.0], [-2.0]],
            },
            "contact": {"young_modulus": 1e6, "friction": 0.4, "speed": 1.0},
            "fluid": {"cells": [6, 5], "viscosity": 1e-4, "time_step": 2e-3, "velocity": [0.3, 0.0]},
            "boundary": {"left": {"kind": "periodic"}, "right": {"kind": "periodic"}},
            "coupling": {"interval": 2e-3, **coupling},
            "time": {"end": 0.2, "output_interval": 0.02},
        }
    )


def momentum(parameters, particles):
    return np.asarray(parameters.bodies.mass * particles.velocity.sum(axis=0))


def cell_fields(seed=0):
    """Any fluid in the cells."""
    draw = np.random.default_rng(seed).normal(size=(3, 6, 5, 2))
    return jaxdem.FluidFields(0.3 * draw[0] + [0.5, 0.0], 300.0 * draw[1], 200.0 * draw[2])


class World:
    """Particles of a scene, whose two halves of a step are compiled once."""

    def __init__(self, scene, **options):
        self.particles, self.parameters = jaxdem.external_fluid(scene, **options)
        self.state, self.neighbors = jaxdem.initial_state(scene, self.particles, self.parameters)
        self.exchange = jax.jit(self.particles.exchange)
        self.advance = jax.jit(self.particles.advance)


@pytest.fixture(scope="module")
def cells():
    return World(scene(**ALL_FORCES))


def test_what_the_particles_get_the_fluid_loses(cells):
    """Drag, lift, virtual mass, pressure gradient and stress, in any flow, over a collision."""
    state, neighbors, got = cells.state, cells.neighbors, np.zeros(2)
    before = momentum(cells.parameters, state.particles)
    start, contact = cell_fields(), 0.0
    for number in range(1, 9):
        end = cell_fields(number)
        step = cells.advance(cells.parameters, state, neighbors, start, end)
        lost = (step.force_on_fluid + step.stress_force_on_fluid).sum(axis=(0, 1)) * CELL * cells.particles.interval
        size = np.abs(step.force_on_fluid).sum() * CELL * cells.particles.interval
        np.testing.assert_allclose(lost, -step.impulse, atol=1e-12 * size, rtol=0.0)
        assert float(step.diagnostics.exchange.momentum) < 1e-14 and int(step.failures) == 0
        state, neighbors, start, got = step.state, step.neighbors, end, got + np.asarray(step.impulse)
        contact = max(contact, float(jnp.abs(state.particles.contact_force).max()))
        # What contacts have changed of the virtual mass the fluid loses in the next interval.
        pending = np.asarray(state.particles.fluid_memory["virtual_mass"]).sum(axis=0)
        now = momentum(cells.parameters, state.particles) - pending
        np.testing.assert_allclose(now - before, got, atol=1e-12 * np.abs(got).max(), rtol=0.0)
    assert contact > 0.1 and np.abs(got).min() > 1e-4


def test_forces_of_the_two_halves_are_one(cells):
    """F(u) of `exchange` at the velocity of the end is what `advance` says that the fluid has got."""
    start, end = cell_fields(), cell_fields(1)
    sources = cells.exchange(cells.parameters, cells.state, start)
    force = sources.drag_source - sources.drag_coefficient[..., None] * end.velocity
    step = cells.advance(cells.parameters, cells.state, cells.neighbors, start, end)
    np.testing.assert_allclose(step.force_on_fluid, force, rtol=0.0, atol=1e-12 * np.abs(force).max())
    assert float(sources.drag_coefficient.min()) >= 0.0 and float(sources.drag_coefficient.max()) > 0.0


def test_void_fraction_and_solid_velocity_hold_the_particles(cells):
    sources = cells.exchange(cells.parameters, cells.state, cell_fields())
    solids, volume = 1.0 - sources.void_fraction, float(cells.parameters.bodies.volume)
    assert float(solids.sum()) * CELL == pytest.approx(4 * volume, rel=1e-12)
    carried = (solids[..., None] * sources.solid_velocity).sum(axis=(0, 1)) * CELL
    np.testing.assert_allclose(carried, volume * cells.state.particles.velocity.sum(axis=0), rtol=1e-12)


def test_our_own_fluid_as_the_other_solver():
    """The staggered solver of jaxdem, driven through the arrays alone, moves the particles as a coupled run does."""
    case = scene(**ALL_FORCES)
    simulation, parameters = jaxdem.build(case)
    state, neighbors = jaxdem.initial_state(case, simulation, parameters)
    outer = World(case, placement="faces")
    solver, interval = simulation.fluid.solver, simulation.interval
    volumes = [face_control_volume(solver.grid, axis) for axis in range(2)]

    def fields(fluid, acceleration=None):
        stress = None if acceleration is None else tuple(parameters.fluid.density * a for a in acceleration)
        slope = pressure_slope(solver.grid, solver.boundary, fluid, continued=True)
        return jaxdem.FluidFields(fluid.face_velocity, slope, stress)

    @jax.jit
    def other(fluid, old, sources, time):
        resistance = tuple(c * v * interval for c, v in zip(sources.drag_coefficient, volumes, strict=True))
        forcing = tuple(f * v * interval for f, v in zip(sources.drag_source, volumes, strict=True))
        fluid = fluid._replace(void_fraction=old)
        step = jnp.asarray(interval)
        new = sources.void_fraction
        result = solver.step(
            parameters.fluid, fluid, time, step, ParticleFields(new, FaceExchange(resistance, forcing), new)
        )
        return result.state, fields(result.state, result.viscous_acceleration)

    coupled, outer_state, outer_neighbors = jax.jit(simulation.step), outer.state, outer.neighbors
    fluid, start = state.fluid, fields(state.fluid)
    for number in range(3):
        sources = outer.exchange(parameters, outer_state, start)
        fluid, end = other(fluid, fluid.void_fraction, sources, jnp.asarray(number * interval))
        moved = outer.advance(parameters, outer_state, outer_neighbors, start, end)
        state, neighbors, report = coupled(parameters, state, neighbors)
        assert int(report.fluid.substeps) == 1
        np.testing.assert_allclose(moved.state.particles.velocity, state.particles.velocity, rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(moved.state.particles.position, state.particles.position, rtol=0.0, atol=1e-15)
        lost = [np.asarray(f * v) for f, v in zip(moved.force_on_fluid, volumes, strict=True)]
        lost = np.stack(face_total(solver.grid, lost)) * interval
        stress = [np.asarray(f * v) for f, v in zip(moved.stress_force_on_fluid, volumes, strict=True)]
        lost = lost + np.stack(face_total(solver.grid, stress)) * interval
        np.testing.assert_allclose(lost, -moved.impulse, rtol=0.0, atol=1e-12 * np.abs(moved.impulse).max())
        outer_state, outer_neighbors, start = moved.state, moved.neighbors, end
    assert np.abs(np.asarray(fluid.face_velocity[1])).max() > 1e-3


def test_a_grain_relaxes_to_the_given_stream():
    """By the drag of Stokes the slip falls by 1 / (1 + T c / m) an interval, c / m = 9 mu / (2 r^2 rho)."""
    world = World(scene(drag="stokes"))
    fields = jaxdem.FluidFields(np.broadcast_to([0.5, 0.0], (6, 5, 2)), np.zeros((6, 5, 2)))
    place = jnp.asarray([[0.1, 0.1], [0.16, 0.1], [0.2, 0.15], [0.05, 0.04]])
    moving = jnp.asarray([[0.1, 0.02]] * 4)
    state = world.state._replace(particles=world.state.particles._replace(position=place, velocity=moving))
    neighbors = world.particles.allocate(world.parameters, state.particles)
    rate = 9.0 * 1000.0 * 1e-4 / (2.0 * RADIUS**2 * 2650.0)
    step = world.advance(world.parameters, state, neighbors, fields)
    slip = np.array([0.4, -0.02]) / (1.0 + rate * world.particles.interval)
    left = np.array([0.5, 0.0]) - np.asarray(step.state.particles.velocity)
    np.testing.assert_allclose(left, np.tile(slip, (4, 1)), rtol=1e-12)


def test_total_and_reduced_pressure_are_one_fluid(cells):
    """The gradient of p is that of p - rho g.x plus rho g, and the buoyancy goes with it."""
    start = cell_fields()
    hydrostatic = np.array([0.0, -9.81 * 1000.0])
    whole = start._replace(pressure_gradient=start.pressure_gradient + hydrostatic)
    parameters = cells.parameters._replace(gravity=jnp.asarray([0.0, -9.81]))
    reduced = cells.advance(parameters, cells.state, cells.neighbors, start, start)
    with_weight = World(scene(**ALL_FORCES), pressure="total")
    total = with_weight.advance(parameters, cells.state, cells.neighbors, whole, whole)
    np.testing.assert_allclose(total.state.particles.velocity, reduced.state.particles.velocity, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(total.force_on_fluid, reduced.force_on_fluid, rtol=0.0, atol=1e-9)
    displaced = 4 * float(parameters.bodies.volume) * hydrostatic * 2e-3
    np.testing.assert_allclose(total.impulse - reduced.impulse, -displaced, rtol=1e-9, atol=1e-12)
    more = (total.stress_force_on_fluid - reduced.stress_force_on_fluid).sum(axis=(0, 1)) * CELL * 2e-3
    np.testing.assert_allclose(more, displaced, rtol=1e-9, atol=1e-12)


def test_derivatives_by_the_fluid_and_the_drag(cells):
    """Reverse mode through both halves, against central differences: what the particles get, and what goes back."""
    particles, start, end = cells.particles.reversible(), cell_fields(), cell_fields(1)

    def seen(faster, drag):
        parameters = cells.parameters._replace(drag_scale=drag)
        first = start._replace(velocity=start.velocity * faster)
        source = particles.exchange(parameters, cells.state, first).drag_source
        step = particles.advance(parameters, cells.state, cells.neighbors, first, end)
        return 1e-3 * jnp.sum(source**2) + jnp.sum(step.state.particles.velocity**2)

    seen_at = jax.jit(jax.value_and_grad(seen, argnums=(0, 1)))
    point, small = (jnp.asarray(1.0), jnp.asarray(1.0)), 1e-5
    _, found = seen_at(*point)
    for number in range(2):
        up, down = (seen_at(*(p + s * small * (k == number) for k, p in enumerate(point)))[0] for s in (1, -1))
        assert float(found[number]) == pytest.approx(float(up - down) / (2 * small), rel=1e-5)
        assert abs(float(found[number])) > 1e-4


def test_what_cannot_work_is_refused(cells):
    fields = cell_fields()
    turned = fields._replace(velocity=np.swapaxes(fields.velocity, 0, 1))
    with pytest.raises(InputError, match=r"start.velocity = \(5, 6, 2\).*shape \(6, 5, 2\)"):
        cells.particles.exchange(cells.parameters, cells.state, turned)
    on_faces, parameters = jaxdem.external_fluid(scene(), placement="faces")
    for wrong, name in (
        ((cells.parameters, cells.state, fields.velocity), "start = 'ndarray': is no FluidFields"),
        ((cells.state, cells.parameters, fields), "parameters = 'State': is no Parameters"),
    ):
        with pytest.raises(InputError, match=name):
            cells.particles.exchange(*wrong)
    with pytest.raises(InputError, match="end = 'ndarray': is no FluidFields"):
        cells.particles.advance(cells.parameters, cells.state, cells.neighbors, fields, fields.velocity)
    with pytest.raises(InputError, match=r"\(7, 5\), \(6, 6\)"):
        on_faces.exchange(parameters, cells.state, fields)
    with pytest.raises(InputError, match=r"end\.stress_divergence: is missing, and the start has one"):
        without = fields._replace(stress_divergence=None)
        cells.particles.advance(cells.parameters, cells.state, cells.neighbors, fields, without)
    with pytest.raises(InputError, match="must be a tuple of arrays of the faces"):
        on_faces.exchange(parameters, cells.state, jaxdem.FluidFields([[0.0]], 0.0))
    with pytest.raises(InputError, match="advance"):
        jaxdem.rollout(cells.particles, cells.parameters, cells.state, cells.neighbors, steps=1)
    with pytest.raises(InputError, match="coupling.drag_inputs_coarsened = 2"):
        jaxdem.external_fluid(scene(drag_inputs_coarsened=2, void_fraction="centre"))
    with pytest.raises(InputError, match="placement = 'nodes'"):
        jaxdem.external_fluid(scene(), placement="nodes")
    dry = scene().model_dump(exclude={"fluid", "coupling"}, exclude_none=True, by_alias=True)
    del dry["boundary"]
    with pytest.raises(InputError, match=r"Add \[particles\] and \[fluid\]"):
        jaxdem.external_fluid(jaxdem.load_scene(dry))


def test_fields_in_three_dimensions():
    """Shapes of what goes out, by tracing alone."""
    tables = scene(**ALL_FORCES).model_dump(exclude={"boundary"}, exclude_none=True, by_alias=True)
    tables["domain"] = {"size": [0.24, 0.2, 0.2]}
    tables["particles"] |= {"position": [[0.1, 0.1, 0.1]], "velocity": [[0.0] * 3], "angular_velocity": [[0.0] * 3]}
    tables["fluid"] |= {"cells": [6, 5, 4], "velocity": [0.3, 0.0, 0.0]}
    case = jaxdem.load_scene(tables)
    for placement, vector in (("cells", (6, 5, 4, 3)), ("faces", ((7, 5, 4), (6, 6, 4), (6, 5, 5)))):
        world = World(case, placement=placement)
        field = jnp.zeros(vector) if placement == "cells" else tuple(map(jnp.zeros, vector))
        fields = jaxdem.FluidFields(field, field, field)
        sources = jax.eval_shape(world.particles.exchange, world.parameters, world.state, fields)
        step = jax.eval_shape(world.particles.advance, world.parameters, world.state, world.neighbors, fields)
        for out in (sources.solid_velocity, sources.drag_source, step.force_on_fluid, step.stress_force_on_fluid):
            assert jax.tree.map(lambda a: a.shape, out) == vector
        assert sources.void_fraction.shape == (6, 5, 4) and step.impulse.shape == (3,)
        scalar = (6, 5, 4) if placement == "cells" else vector
        assert jax.tree.map(lambda a: a.shape, sources.drag_coefficient) == scalar

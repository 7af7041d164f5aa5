"""The fluid alone against invariants and closed forms; those of the verification page: `tests/cases/fluid.py`."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxdem
from jaxdem.fluid.advection import Central, CentralFourth, Superbee, Upwind, VanLeer, advection
from jaxdem.fluid.boundary import Boundary, Side, Sides
from jaxdem.fluid.grid import Grid, divergence, face_average
from jaxdem.fluid.inlet import LinearTable
from tests.cases.flows import PERIODIC, Flow, random_faces
from tests.cases.fluid import VISCOSITY, flow_rates, poiseuille
from tests.cases.tiers import tiered


@pytest.fixture(scope="module")
def vortex():
    return Flow((16, 16), (1.0, 1.0), PERIODIC)


def test_uniform_stream_stays_uniform(vortex):
    flow = vortex
    state, _, _ = flow.march(flow.properties(VISCOSITY), flow.state(0.7, -0.4), 20, 0.01)
    for u, speed in zip(state.face_velocity, (0.7, -0.4), strict=True):
        np.testing.assert_allclose(u, speed, atol=1e-14)


def test_momentum_is_conserved_and_a_translated_start_gives_a_translated_end(vortex):
    flow = vortex
    faces = random_faces(flow.grid)

    def rolled(f, axis):
        core = np.roll(np.delete(np.asarray(f), -1, axis), (3, 5), (0, 1))
        return np.concatenate((core, np.take(core, [0], axis)), axis)

    run = [
        flow.march(flow.properties(VISCOSITY), flow.state(*start), 5, 0.002)[0].face_velocity
        for start in (faces, [rolled(f, a) for a, f in enumerate(faces)])
    ]
    for axis in range(2):
        # Round-off through five solves whose tolerance is 2e-12 of the largest divergence.
        np.testing.assert_allclose(run[1][axis], rolled(run[0][axis], axis), atol=1e-10)
        total = [np.delete(np.asarray(f), -1, axis).sum() for f in (faces[axis], run[0][axis])]
        assert total[0] == pytest.approx(total[1], abs=1e-11)


@pytest.mark.parametrize(
    "scheme", [Upwind(), Superbee(), Central(), CentralFourth()], ids=lambda one: type(one).__name__
)
def test_advection_takes_no_momentum_whatever_the_flux(scheme):
    """Random flux and velocity in a periodic box: what leaves a control volume enters the next, to round-off."""
    grid = Grid((7, 6), (1.0, 1.0), 1.0, (True, True))
    boundary = Boundary(tuple(Side(n // 2, bool(n % 2), "periodic") for n in range(4)))
    flux, velocity = (tuple(map(jnp.asarray, random_faces(grid, seed))) for seed in (1, 2))
    rates = advection(grid, Sides(boundary, (jnp.zeros(2),) * 4, jnp.asarray(0.0)), scheme, flux, velocity)
    for axis, rate in enumerate(rates):
        inner = np.delete(np.asarray(rate), -1, axis)
        assert abs(inner.sum()) < 1e-13 * np.abs(inner).sum()


def test_central_advection_between_inlet_outlet_and_walls():
    """A plug flow between slippery walls is kept to round-off; a jet between rough ones stays as fast as its inlet
    allows."""
    scheme = CentralFourth()
    plug = Flow((12, 8), (1.2, 0.8), ("inlet", "outlet", "free_slip", "free_slip"), scheme=scheme)
    state, _, _ = plug.march(plug.properties(1e-3, {0: [1.0, 0.0]}), plug.state(1.0, 0.0), 40, 0.02)
    np.testing.assert_allclose(state.face_velocity[0], 1.0, atol=1e-12)
    jet = Flow((24, 8), (2.4, 0.8), ("inlet", "outlet", "no_slip", "no_slip"), {0: ((0.2,), (0.5,))}, scheme=scheme)
    state, worst, sound = jet.march(jet.properties(1e-6, {0: [1.0, 0.0]}), jet.state(), 800, 0.02)
    assert bool(sound) and float(worst) < 1e-9
    fastest = max(float(np.abs(np.asarray(u)).max()) for u in state.face_velocity)
    assert 1.0 <= fastest < 2.5
    outflow = float(np.sum(np.asarray(state.face_velocity[0])[-1]) * 0.1)
    assert outflow == pytest.approx(0.3, rel=1e-9)


# --- walls ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def couette():
    return Flow((3, 8), (0.3, 1.0), ("periodic", "periodic", "no_slip", "moving_wall"))


def test_couette_flow_with_subgrid_viscosity_stays_linear_under_a_larger_stress(couette):
    """nu_t = (C_s Delta)^2 a is even in plane shear, so that the profile is the same and the wall's stress
    rho (nu + nu_t) a: what the fluid loses to the floor when the lid is let go (made free to slip)."""
    numbers = dict(velocity={3: [2.0, 0.0]}, smagorinsky=0.4)
    properties = couette.properties(0.05, **numbers)
    state, _, _ = couette.march(properties, couette.state(), 4000, 0.01)
    u = np.asarray(state.face_velocity[0])
    np.testing.assert_allclose(u, np.broadcast_to(2.0 * couette.centres(1), (4, 8)), atol=1e-11)
    eddy = 0.4**2 * 0.1 * 0.125 * 2.0
    assert eddy == pytest.approx(0.004)
    slippery = Flow((3, 8), (0.3, 1.0), ("periodic", "periodic", "no_slip", "free_slip"))
    after, _, _ = slippery.march(slippery.properties(0.05, smagorinsky=0.4), state, 1, 1e-6)
    stress = (u[0].sum() - float(after.face_velocity[0][0].sum())) * 0.125 / 1e-6
    # Over the step the top row slows down by nu a t / h, which changes the floor's stress in nothing.
    assert stress == pytest.approx((0.05 + eddy) * 2.0, rel=1e-6)


def test_free_slip_walls_take_no_momentum():
    flow = Flow((3, 4), (0.3, 0.4), ("periodic", "periodic", "free_slip", "free_slip"))
    state, _, _ = flow.march(flow.properties(1.0), flow.state(0.5, 0.0), 20, 0.001)
    np.testing.assert_allclose(state.face_velocity[0], 0.5, atol=1e-14)


def test_a_uniform_inlet_would_fail_the_poiseuille_flow():
    """Negative control: it pays for the entrance as well."""
    drift, drop = poiseuille("uniform")
    assert drift > 0.3 and drop > 1.05


@pytest.fixture(scope="module")
def channel():
    flow = Flow((32, 12), (4.0, 1.0), ("inlet", "outlet", "no_slip", "no_slip"), density=3.0)
    return flow, flow.march(flow.properties(0.2, {0: [1.0, 0.0]}), flow.state(), 1200, 0.005)


def test_channel_flow_becomes_the_parabola(channel):
    flow, (state, worst, _) = channel
    z, h = flow.centres(1), flow.grid.spacing[1]
    middle = np.asarray(state.face_velocity[0])[20]
    # Closed form 6 U z (1 - z); on n cells the discrete profile is the parabola plus a constant, 1.5/n^2 relative.
    assert np.abs(middle - 6.0 * z * (1.0 - z)).max() < 0.01 * 1.5
    # The discrete profile itself: second differences constant, mirrored at the walls, scaled to the flux.
    matrix = -2.0 * np.eye(12) + np.eye(12, k=1) + np.eye(12, k=-1)
    matrix[0, 0] = matrix[-1, -1] = -3.0
    profile = np.linalg.solve(matrix, -np.ones(12))
    profile /= profile.mean()
    # Half-way the entrance disturbance has died to exp(-4.2 x/H ...) of its size: 1e-4 is left of 1.
    np.testing.assert_allclose(middle, profile, atol=1e-4)
    assert float(worst) < 1e-10
    # And the pressure falls by 12 rho nu U / H^2 per length, in the discrete form.
    p = np.asarray(state.pressure)
    slope = (p[24] - p[16]).mean() / (8 * flow.grid.spacing[0])
    assert slope == pytest.approx(-12.0 * 3.0 * 0.2, rel=0.02)
    force = 2.0 * (profile[0] + profile[-1]) / h * 0.2 * 3.0  # of both walls, which mirror the profile
    assert slope == pytest.approx(-force, rel=1e-3)


def test_channel_conserves_mass(channel):
    flow, (state, _, _) = channel
    flux = np.asarray(state.face_velocity[0]).sum(axis=1) * flow.grid.spacing[1]
    # Every cross-section: round-off of the solves along the channel.
    np.testing.assert_allclose(flux, 1.0, rtol=1e-9)


def test_flow_rate_of_a_table_is_the_same_on_every_mesh():
    """As the verification page has it for the parabola; a table with a part that flows out."""
    profile = LinearTable((0.0, 0.2, 0.5), (0.3, 2.0, -0.5))
    exact = 0.1 * (1.15 + 2.0) / 2 + 0.27 * (2.0 - 0.25) / 2
    for entering, leaving in flow_rates(profile):
        assert entering == pytest.approx(exact * 0.8, rel=1e-14)
        assert leaving == pytest.approx(entering, rel=1e-9)


# --- no new extrema, symmetries ---------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", [VanLeer(), Superbee(), Upwind()], ids=["limited", "superbee", "upwind"])
def test_a_front_makes_no_new_extrema(scheme):
    """A step carried once around: stays within its values; superbee's front is the narrowest, and does not spread
    on."""
    grid = Grid((40, 1), (1.0, 1.0), 1.0, (True, True))
    boundary = Boundary(tuple(Side(n // 2, bool(n % 2), "periodic") for n in range(4)))
    flux = (jnp.ones((41, 1)), jnp.zeros((40, 2)))
    start = jnp.asarray(np.tile(np.where(np.abs(np.arange(40) - 20) < 8, 1.0, 0.0)[:, None], 2))
    still = (jnp.zeros(2),) * 4

    @jax.jit
    def once_around(w):
        def rate(w):
            velocity = (flux[0], w)
            return advection(grid, Sides(boundary, still, jnp.asarray(0.0)), scheme, flux, velocity)[1]

        def body(_, carry):
            w, low, high = carry
            first = w + 0.0125 * rate(w)
            w = 0.5 * (w + first + 0.0125 * rate(first))
            return w, jnp.minimum(low, w.min()), jnp.maximum(high, w.max())

        return lax.fori_loop(0, 80, body, (w, w.min(), w.max()))

    end, low, high = once_around(start)
    assert float(low) >= -1e-14 and float(high) <= 1.0 + 1e-14
    smear = float(jnp.abs(end - start).mean())
    print("front", smear)
    low, high = {VanLeer: (0.05, 0.1), Superbee: (0.0, 0.05), Upwind: (0.15, 1.0)}[type(scheme)]
    assert low < smear < high
    spread = float(jnp.abs(once_around(once_around(end)[0])[0] - start).mean()) / smear
    assert spread < 1.02 if isinstance(scheme, Superbee) else spread > 1.2


def energy_of(state):
    """Sum of the squares of the face velocities in a periodic box."""
    faces = enumerate(state.face_velocity)
    return sum(float(np.sum(np.delete(np.asarray(f), -1, axis) ** 2)) for axis, f in faces)


@pytest.mark.parametrize(
    ("scheme", "low", "high"),
    tiered(
        [(Central(), 0.99, 1.0), (CentralFourth(), 0.98, 1.0), (VanLeer(), 0.3, 0.9)],
        first=[(CentralFourth(), 0.98, 1.0)],
    ),
    ids=["central", "central_4", "limited"],
)
def test_eddies_of_few_cells_live_on_without_numerical_viscosity(scheme, low, high):
    """Taylor-Green eddies six cells wide, no viscosity: a steady flow of constant energy. In some turns van Leer's
    limiter takes a good part of it, central advection what the time steps lose, and of fourth order a hundredth
    more."""
    flow = Flow((12, 12), (1.0, 1.0), PERIODIC, scheme=scheme)
    x, y = (2 * np.pi * flow.faces(0)[:, None], 2 * np.pi * flow.centres(1)[None, :])
    start = flow.state(np.sin(x) * np.cos(y), -(np.sin(x) * np.cos(y)).T)
    state, _, sound = flow.march(flow.properties(0.0), start, 120, 0.02)
    assert bool(sound) and low < energy_of(state) / energy_of(start) < high


@pytest.mark.parametrize(
    "scheme", tiered([Central(), CentralFourth()], first=[CentralFourth()]), ids=["central", "central_4"]
)
def test_waves_of_two_cells_do_not_grow_on_central_advection(scheme):
    """Random velocities without viscosity for 400 steps: with Heun's method they grow at any time step."""
    flow = Flow((12, 12), (1.0, 1.0), PERIODIC, scheme=scheme)
    start, _, _ = flow.march(flow.properties(0.0), flow.state(*random_faces(flow.grid)), 1, 1e-9)
    start = start._replace(pressure=jnp.zeros_like(start.pressure))
    fastest = max(float(jnp.max(jnp.abs(u))) for u in start.face_velocity)
    state, _, _ = flow.march(flow.properties(0.0), start, 400, 0.25 / (12 * fastest))
    assert 0.5 < energy_of(state) / energy_of(start) <= 1.0


@pytest.mark.parametrize(
    "scheme", tiered([CentralFourth(), Upwind()], first=[CentralFourth()]), ids=["central_4", "upwind"]
)
def test_a_step_is_of_second_order_in_time(scheme):
    """Eddies that are carried along, on one mesh: halving the step takes the difference from a step 16 times as short
    to a quarter. The pressure of the step before makes it so, also where three stages carry the momentum to third
    order."""
    flow, ends = Flow((12, 12), (1.0, 1.0), PERIODIC, scheme=scheme), {}
    x, y = (2 * np.pi * flow.faces(0)[:, None], 2 * np.pi * flow.centres(1)[None, :])
    start = flow.state(1.0 + np.sin(x) * np.cos(y), 0.5 - (np.sin(x) * np.cos(y)).T)
    for count in (8, 16, 256):
        state, _, _ = flow.march(flow.properties(0.01), start, count, 0.16 / count)
        ends[count] = np.asarray(state.face_velocity[0])
    ratio = np.abs(ends[8] - ends[256]).max() / np.abs(ends[16] - ends[256]).max()
    assert 3.0 < ratio < 5.0


@pytest.mark.parametrize(("scheme", "order"), [(Central(), 2), (CentralFourth(), 4)], ids=["central", "central_4"])
def test_order_of_central_advection(scheme, order):
    """The rate at which a uniform stream carries the means over cells of a sine, against the exact one: the error falls
    by 2^order from 16 to 32 cells."""
    errors = []
    for cells in (16, 32):
        grid = Grid((cells, 1), (1.0, 1.0), 1.0, (True, True))
        boundary = Boundary(tuple(Side(n // 2, bool(n % 2), "periodic") for n in range(4)))
        edges = 2 * np.pi * np.arange(cells + 1) / cells
        mean = np.diff(-np.cos(edges)) * cells / (2 * np.pi)
        exact = -np.diff(np.sin(edges)) * cells
        carried = jnp.asarray(np.tile(mean[:, None], 2))
        flux = (jnp.ones((cells + 1, 1)), jnp.zeros((cells, 2)))
        velocity, still = (flux[0], carried), (jnp.zeros(2),) * 4
        rate = advection(grid, Sides(boundary, still, jnp.asarray(0.0)), scheme, flux, velocity)[1]
        errors.append(float(np.abs(np.asarray(rate)[:, 0] - exact).max()))
    assert errors[0] / errors[1] == pytest.approx(2.0**order, rel=0.05)


def test_layer_and_rotation():
    """A 2-D flow, the same in a 3-D layer one cell thick, and turned by 90 degrees."""
    flat = Flow((5, 4), (0.5, 0.3), ("inlet", "outlet", "moving_wall", "no_slip"), {0: ((0.05,), (0.22,))})
    # x -> z, z -> -x turned by 90 degrees: bottom becomes right ... here as a mirror: axes exchanged.
    turned = Flow((4, 5), (0.3, 0.5), ("moving_wall", "no_slip", "inlet", "outlet"), {2: ((0.05,), (0.22,))})
    layer = Flow(
        (5, 1, 4),
        (0.5, 0.07, 0.3),
        ("inlet", "outlet", "free_slip", "free_slip", "moving_wall", "no_slip"),
        {0: ((0.0, 0.05), (0.07, 0.22))},
    )
    u, w = random_faces(flat.grid)
    g = np.random.default_rng(2).uniform(0.5, 1.0, (5, 4))
    later = 0.98 * g + 0.01

    def run(flow, faces, g, later, velocity):
        state = flow.state(*faces, void_fraction=g)
        state, worst, ok = flow.march(flow.properties(0.01, velocity), state, 1, 0.01, later)
        state, worst, ok = flow.march(flow.properties(0.01, velocity), state, 4, 0.01, later)
        assert bool(ok) and float(worst) < 1e-10
        return [np.asarray(f) for f in state.face_velocity] + [np.asarray(state.pressure)]

    a = run(flat, (u, w), g, later, {0: [0.6, 0.0], 2: [0.3, 0.0]})
    b = run(turned, (w.T, u.T), g.T, later.T, {2: [0.0, 0.6], 0: [0.0, 0.3]})
    c = run(
        layer,
        (u[:, None], np.zeros((5, 2, 4)), w[:, None]),
        g[:, None],
        later[:, None],
        {0: [0.6, 0.0, 0.0], 4: [0.3, 0.0, 0.0]},
    )
    # Tolerances of the solves, 2e-12 of U/h, times the number of steps and of cells.
    for ours, other in ((a[0], b[1].T), (a[1], b[0].T), (a[2], b[2].T)):
        np.testing.assert_allclose(ours, other, atol=1e-9)
    for ours, other in ((a[0], c[0][:, 0]), (a[1], c[2][:, 0]), (a[2], c[3][:, 0])):
        np.testing.assert_allclose(ours, other, atol=1e-9)
    assert np.abs(c[1]).max() < 1e-12


# --- void fraction, inlet and outlet ----------------------------------------------------------------------


@pytest.fixture(scope="module")
def jets():
    """A jet through a patch into a box with an outlet, on three meshes, after one change of void fraction."""
    result = {}
    for n in (4, 8, 16):
        sides = ("inlet", "outlet", "no_slip", "no_slip")
        flow = Flow((n, n), (1.0, 1.0), sides, {0: ((0.1,), (0.47,))}, density=1000.0)
        random = np.random.default_rng(n)
        g = random.uniform(0.5, 1.0, (n, n))
        result[n] = flow, g, g + random.uniform(-0.005, 0.005, (n, n))
    return result


@pytest.mark.parametrize("n", [4, 8, 16])
def test_jet_flow_rate_is_the_same_on_every_mesh_and_leaves(jets, n):
    flow, g, later = jets[n]
    properties = flow.properties(1e-3, {0: [0.8, 0.0]})
    state, worst, ok = flow.march(properties, flow.state(void_fraction=g), 3, 0.01, later)
    assert bool(ok) and float(worst) < 1e-10
    flux = [np.asarray(gu * u) for gu, u in zip(face_average(flow.grid, later), state.face_velocity, strict=True)]
    inflow = flux[0][0].sum() / n
    assert inflow == pytest.approx(0.37 * 0.8, rel=1e-14)
    # In what goes in, out goes the same (the void fraction stood still in the last step), to the divergence's 1e-10.
    assert flux[0][-1].sum() / n == pytest.approx(inflow, rel=1e-9)


def test_continuity_holds_while_the_void_fraction_changes(jets):
    """d(g)/dt + div(g u) = 0 in every cell, and the outlet carries off what the particles displace."""
    flow, g, later = jets[8]
    step, properties = 0.01, flow.properties(1e-3, {0: [0.8, 0.0]})

    def left_over(start):
        state, _, _ = flow.march(properties, flow.state(void_fraction=start), 1, step, later)
        flux = tuple(a * u for a, u in zip(face_average(flow.grid, later), state.face_velocity, strict=True))
        speed = max(float(jnp.abs(f).max()) for f in flux)
        growth = (later - g) / step
        return float(jnp.abs(divergence(flow.grid, flux) + growth).max()) * flow.grid.spacing[0] / speed

    assert left_over(g) < 1e-10
    # Negative control: without d(g)/dt the same check fails by far.
    assert left_over(later) > 1e-3


def test_outlet_backflow_is_not_amplified(jets):
    """Eddies across the outlet, nothing driven: the energy only falls."""
    flow, _, _ = jets[16]
    x, z = np.meshgrid(flow.faces(0), flow.faces(1), indexing="ij")
    stream = np.sin(np.pi * x / 0.8) * np.sin(2 * np.pi * z)  # an eddy pair cut by the outlet at x = 1
    u = np.diff(stream, axis=1) / flow.grid.spacing[1]
    w = -np.diff(stream, axis=0) / flow.grid.spacing[0]
    assert u[-1].min() < -1.0  # it does flow in
    state, ones = flow.state(0.05 * u, 0.05 * w, void_fraction=np.ones((16, 16))), np.ones((16, 16))
    energy = []
    for _ in range(8):
        energy.append(sum(float(jnp.sum(f**2)) for f in state.face_velocity))
        state, _, ok = flow.march(flow.properties(1e-4), state, 25, 0.02, ones)
        assert bool(ok)
    print("backflow", energy)
    # What leaves takes energy along, and nothing comes back with more of it.
    assert all(b < a for a, b in zip(energy, energy[1:], strict=False))


def test_an_oblique_stream_leaves_by_two_sides_and_their_corner():
    """Through an even bed: the stream of 1 m/s to the right and 0.5 m/s up stays as it is, without a pressure."""
    flow = Flow((6, 5), (0.6, 0.4), ("inlet", "outlet", "inlet", "outlet"))
    stream, bed = np.array([1.0, 0.5]), np.full((6, 5), 0.6)
    properties = flow.properties(1e-3, {0: 0.6 * stream * [1.0, 1.0 / 0.6], 2: 0.6 * stream * [1.0 / 0.6, 1.0]})
    state, _, ok = flow.march(properties, flow.state(*stream, void_fraction=bed), 50, 0.02, bed)
    assert bool(ok)
    for u, speed in zip(state.face_velocity, stream, strict=True):
        np.testing.assert_allclose(u, speed, atol=1e-11)
    np.testing.assert_allclose(state.pressure, 0.0, atol=1e-11)


@pytest.mark.parametrize("scheme", tiered([VanLeer(), Central()], first=[Central()]), ids=["limited", "central"])
def test_a_step_is_of_second_order_in_time_where_fluid_comes_in_by_an_outlet(scheme):
    """As in a periodic box, for an eddy that the open side cuts: halving the step takes the difference from a step 16
    times as short to a quarter. It needs the flux through the outlet at the time of each stage."""
    flow, ends = (
        Flow((12, 12), (1.0, 1.0), ("free_slip", "outlet", "free_slip", "free_slip"), scheme=scheme),
        {},
    )
    x, z = np.meshgrid(flow.faces(0), flow.faces(1), indexing="ij")
    stream = 0.1 * np.sin(np.pi * x / 0.8) * np.sin(2.0 * np.pi * z)
    start = flow.state(np.diff(stream, axis=1) * 12.0, -np.diff(stream, axis=0) * 12.0)
    # What the pressure is at the start, the first step of a run does not know.
    start, _, _ = flow.march(flow.properties(0.01), start, 40, 0.001)
    for count in (8, 16, 256):
        state, _, _ = flow.march(flow.properties(0.01), start, count, 0.32 / count)
        ends[count] = np.asarray(state.face_velocity[0])
    assert float(ends[256][-1].min()) < -0.1
    ratio = np.abs(ends[8] - ends[256]).max() / np.abs(ends[16] - ends[256]).max()
    assert 3.0 < ratio < 5.0


def test_slopes_through_an_outlet_that_draws_fluid_in_are_those_of_differences():
    """Of the mean pressure and the energy after eight steps of an eddy that the outlet cuts, by its strength and the
    viscosity."""
    flow = Flow((6, 6), (1.0, 1.0), ("no_slip", "outlet", "no_slip", "no_slip"), scheme=Upwind())
    x, z = np.meshgrid(flow.faces(0), flow.faces(1), indexing="ij")
    stream = 0.1 * np.sin(np.pi * x / 0.8) * np.sin(2.0 * np.pi * z)
    u, w = np.diff(stream, axis=1) * 6.0, -np.diff(stream, axis=0) * 6.0

    @jax.jit
    def outcome(numbers):
        state, properties = flow.state(numbers[0] * u, numbers[0] * w), flow.properties(numbers[1])

        def body(state, _):
            return flow.solver.step(properties, state, jnp.asarray(0.0), jnp.asarray(0.02)).state, None

        state, _ = lax.scan(body, state, None, length=8)
        return jnp.mean(state.pressure) + sum(jnp.sum(f**2) for f in state.face_velocity)

    numbers = np.array([1.0, 1e-2])
    slopes = np.asarray(jax.jit(jax.grad(outcome))(jnp.asarray(numbers)))
    for n in range(2):
        shift = 1e-5 * np.eye(2)[n] * numbers[n]
        difference = float(outcome(numbers + shift) - outcome(numbers - shift)) / (2.0 * shift[n])
        assert slopes[n] == pytest.approx(difference, rel=1e-6) and slopes[n] != 0.0


@pytest.mark.parametrize("across", ["no_slip", "periodic"])
def test_one_cell_thick_axis(across):
    flow = Flow((6, 1), (0.6, 0.1), ("inlet", "outlet", across, across))
    properties = flow.properties(1e-3, {0: [0.5, 0.0]})
    state, _, ok = flow.march(properties, flow.state(), 10, 0.01)
    # Continuity leaves no choice: the inlet's velocity everywhere.
    np.testing.assert_allclose(state.face_velocity[0], 0.5, atol=1e-12)
    np.testing.assert_allclose(state.face_velocity[1], 0.0, atol=1e-12)
    drop = float(state.pressure[0, 0] - state.pressure[-1, 0])
    # Friction of two walls half a cell away: 2 * 2 nu U / h^2 per length, over five cells; none if periodic.
    wall = 0.0 if across == "periodic" else 4.0 * 1e-3 * 0.5 / 0.1**2 * 0.5
    assert bool(ok) and drop == pytest.approx(wall, abs=1e-9)


def test_an_inlet_follows_its_velocities_in_time():
    """From the scene on: the flow rate at the end of every interval is that of the table, to round-off."""
    times, speeds = [0.02, 0.05, 0.11], [0.3, 1.2, 0.6]
    tables = dict(
        precision="float64",
        domain=dict(size=[1.0, 0.5], depth=1.0),
        fluid=dict(cells=[4, 6], viscosity=1e-3, time_step=0.01),
        boundary=dict(
            right=dict(kind="inlet", times=times, velocities=speeds, profile="parabolic", **{"from": 0.1, "to": 0.4}),
            left=dict(kind="outlet"),
        ),
        time=dict(end=0.15, output_interval=0.01),
    )
    scene = jaxdem.load_scene(tables)
    assert scene.boundary["right"].velocities[1] == (-1.2, 0.0) and scene.boundary["right"].ramp_time == 0.0
    simulation, parameters = jaxdem.build(scene)
    state, _ = jaxdem.initial_state(scene, simulation, parameters)
    step = jax.jit(lambda s: simulation.step(parameters, s, None)[::2])
    for k in range(1, 16):
        state, diagnostics = step(state)
        rate = -np.asarray(state.fluid.face_velocity[0]) @ np.full(6, 0.5 / 6)
        exact = 0.3 * np.interp(0.01 * k, times, speeds)
        assert rate[-1] == pytest.approx(exact, rel=1e-13)
        # What it lets in leaves at once: incompressible.
        assert rate[0] == pytest.approx(exact, rel=1e-9)
        # 1.5 * 1.2 m/s is 0.072 cells in 0.01 s: the peak of the profile counts.
        assert float(diagnostics.fluid.courant) >= 1.5 * np.interp(0.01 * k, times, speeds) * 0.01 / 0.25


@pytest.mark.parametrize(
    ("grain", "patch"), tiered([(False, False), (True, False), (True, True)], first=[(True, False)])
)
def test_a_jet_that_is_switched_on_counts_for_the_fluid_step(grain, patch):
    """4 m/s at once, 1 cm cells, intervals of 10 ms: 4 cells, so 8 steps; between grains it is faster, not beside
    them."""
    tables = dict(
        domain=dict(size=[0.2, 0.1], depth=0.02),
        fluid=dict(cells=[20, 10], viscosity=1e-6, time_step=0.01, courant_limit=0.6, advection="upwind"),
        boundary=dict(
            left=dict(kind="inlet", times=[0.0, 0.001, 1.0], velocities=[0.0, 4.0, 4.0]), right=dict(kind="outlet")
        ),
        time=dict(end=0.01, output_interval=0.01),
    )  # fmt: skip
    if patch:
        tables["boundary"]["left"] |= {"from": 0.0, "to": 0.03}
    if grain:
        tables["particles"] = dict(radius=1e-3, density=2500.0, position=[[0.005, 0.055]])
        tables["coupling"] = dict(interval=0.01)
    scene = jaxdem.load_scene(tables)
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    state, _, diagnostics = jax.jit(lambda s, n: simulation.step(parameters, s, n))(state, neighbors)
    fastest = float(jnp.max(jnp.abs(state.fluid.face_velocity[0][0])))
    assert int(diagnostics.fluid.substeps) == 8 and bool(diagnostics.fluid.converged)
    assert 8 * float(diagnostics.fluid.courant) >= fastest * 0.01 / 0.01 * (1 - 1e-5) >= 4.0 * (1 - 1e-5)
    assert (fastest > 4.0 * (1 + 1e-5)) == (grain and not patch)
    if patch:
        assert 8 * float(diagnostics.fluid.courant) == pytest.approx(4.0, rel=1e-5)

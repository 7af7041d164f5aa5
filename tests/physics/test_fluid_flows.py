"""The fluid alone against closed forms, tables and invariants."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxdem
from jaxdem.fluid.advection import Upwind, VanLeer, advection
from jaxdem.fluid.boundary import Boundary, Side
from jaxdem.fluid.grid import Grid, divergence, face_average
from jaxdem.fluid.inlet import LinearTable, Parabola
from jaxdem.fluid.momentum import FluidProperties, FluidSolver, FluidState

DATA = Path(__file__).parents[1] / "data"


class Flow:
    """A fluid in a box: one compilation for any numbers of steps and time step."""

    def __init__(self, cells, size, kinds, patches=None, scheme=None, density=1.0, depth=1.0, inlet=None):
        periodic = tuple(kinds[2 * a] == "periodic" for a in range(len(cells)))
        patches, inlet = patches or {}, inlet or {}
        sides = (
            Side(n // 2, bool(n % 2), k, *patches.get(n, (None, None)), **(inlet if k == "inlet" else {}))
            for n, k in enumerate(kinds)
        )
        self.grid = Grid(cells, size, depth, periodic)
        self.solver = FluidSolver(self.grid, Boundary(tuple(sides)), scheme or VanLeer(), True)
        self.density = density
        self.still = np.zeros(len(cells))
        self.march = jax.jit(self._march)

    def properties(self, viscosity, velocity=None, dtype=jnp.float64, smagorinsky=None):
        """Numbers of the fluid; `velocity` maps the number of a side to its velocity."""
        velocity = velocity or {}
        speeds = (velocity.get(n, self.still) for n in range(2 * len(self.still)))
        numbers = (jnp.asarray(self.density, dtype), jnp.asarray(viscosity, dtype))
        coefficient = None if smagorinsky is None else jnp.asarray(smagorinsky, dtype)
        return FluidProperties(*numbers, tuple(jnp.asarray(v, dtype) for v in speeds), coefficient)

    def state(self, *faces, void_fraction=None, dtype=jnp.float64):
        """Fluid with these face velocities (at rest without), zero pressure."""
        grid = self.grid
        shapes = [grid.face_shape(a) for a in range(grid.dimension)]
        faces = faces or [np.zeros(s) for s in shapes]
        faces = tuple(jnp.broadcast_to(jnp.asarray(f, dtype), s) for f, s in zip(faces, shapes, strict=True))
        g = None if void_fraction is None else jnp.asarray(void_fraction, dtype)
        return FluidState(faces, jnp.zeros(grid.cells, dtype), g)

    def _march(self, properties, state, steps, time_step, void_fraction=None):
        """State after the steps, and the largest divergence reported and iterations taken."""

        def body(k, carry):
            state, worst, ok = carry
            # Once moved, the void fraction stays.
            result = self.solver.step(properties, state, void_fraction, k * time_step, time_step)
            return result.state, jnp.maximum(worst, result.divergence), ok & result.solver.converged

        zero = jnp.zeros((), state.pressure.dtype)
        return lax.fori_loop(0, steps, body, (state, zero, jnp.asarray(True)))

    def centres(self, axis):
        """Cell centres along an axis."""
        return (np.arange(self.grid.cells[axis]) + 0.5) * self.grid.spacing[axis]

    def faces(self, axis):
        """Faces along their own axis."""
        return np.arange(self.grid.cells[axis] + 1) * self.grid.spacing[axis]


def random_faces(grid, seed=0):
    """A random velocity field, zero on walls, doubled on periodic axes."""
    random, result = np.random.default_rng(seed), []
    for axis in range(grid.dimension):
        f = random.normal(size=grid.face_shape(axis))
        view = np.moveaxis(f, axis, 0)
        view[-1] = view[0] if grid.periodic[axis] else 0.0
        if not grid.periodic[axis]:
            view[0] = 0.0
        result.append(f)
    return result


PERIODIC = ("periodic",) * 4

# --- Taylor-Green vortices carried by a mean stream -------------------------------------------------------

STREAM = np.array([0.7, -0.4])
NU = 0.01


def taylor_green(flow, time):
    """Decaying vortices u' = (cos kx sin kz, -sin kx cos kz) exp(-2 nu k^2 t), k = 2 pi, moving with a stream."""
    k, decay = 2.0 * np.pi, np.exp(-2.0 * NU * (2.0 * np.pi) ** 2 * time)

    def at(x, z):
        x, z = x - STREAM[0] * time, z - STREAM[1] * time
        return np.cos(k * x) * np.sin(k * z) * decay, -np.sin(k * x) * np.cos(k * z) * decay

    u = at(*np.meshgrid(flow.faces(0), flow.centres(1), indexing="ij"))[0] + STREAM[0]
    w = at(*np.meshgrid(flow.centres(0), flow.faces(1), indexing="ij"))[1] + STREAM[1]
    return u, w


@pytest.fixture(scope="module")
def vortices():
    """Flows of 16, 32 and 64 cells with a Courant number that stays the same."""
    return {n: Flow((n, n), (1.0, 1.0), PERIODIC) for n in (16, 32, 64)}


def rms(a, b):
    return np.sqrt(np.mean([np.mean((np.asarray(x) - y) ** 2) for x, y in zip(a, b, strict=True)]))


def test_taylor_green_is_of_second_order_in_space_and_time(vortices):
    error = []
    for n, flow in vortices.items():
        steps = n // 2  # time 0.1, Courant number 0.35 in the sum over both axes
        state, worst, ok = flow.march(
            flow.properties(NU), flow.state(*taylor_green(flow, 0.0)), steps, 0.2 / n
        )
        assert bool(ok) and float(worst) < 1e-10  # the gate of the divergence in float64, units of U/h
        error.append(rms(state.face_velocity, taylor_green(flow, 0.1)))
    order = np.log2(np.array(error[:-1]) / error[1:])
    # Asked: 1.9. The limiter flattens extrema, a higher-order error that makes the order seem larger.
    print("Taylor-Green", error, order)
    assert np.all(order >= 1.9)
    assert error[-1] < 2e-3


def test_taylor_green_is_of_second_order_in_time_alone(vortices):
    """Steps of T/8, T/16, T/32 on one mesh against T/256: what is left is the error in time."""
    flow = vortices[16]
    properties, start = flow.properties(NU), flow.state(*taylor_green(flow, 0.0))
    runs = {n: flow.march(properties, start, n, 0.16 / n)[0].face_velocity for n in (8, 16, 32, 256)}
    error = np.array([rms(runs[n], runs[256]) for n in (8, 16, 32)])
    # The limiter's kinks and the finite reference move the order by a few hundredths.
    print("order in time", error, np.log2(error[:-1] / error[1:]))
    assert np.all(np.log2(error[:-1] / error[1:]) >= 1.9)


def test_uniform_stream_stays_uniform(vortices):
    flow = vortices[16]
    state, _, _ = flow.march(flow.properties(NU), flow.state(0.7, -0.4), 20, 0.01)
    for u, speed in zip(state.face_velocity, (0.7, -0.4), strict=True):
        np.testing.assert_allclose(u, speed, atol=1e-14)


def test_momentum_is_conserved_and_a_translated_start_gives_a_translated_end(vortices):
    flow = vortices[16]
    faces = random_faces(flow.grid)

    def rolled(f, axis):
        core = np.roll(np.delete(np.asarray(f), -1, axis), (3, 5), (0, 1))
        return np.concatenate((core, np.take(core, [0], axis)), axis)

    run = [
        flow.march(flow.properties(NU), flow.state(*start), 5, 0.002)[0].face_velocity
        for start in (faces, [rolled(f, a) for a, f in enumerate(faces)])
    ]
    for axis in range(2):
        # Round-off through five solves whose tolerance is 2e-12 of the largest divergence.
        np.testing.assert_allclose(run[1][axis], rolled(run[0][axis], axis), atol=1e-10)
        total = [np.delete(np.asarray(f), -1, axis).sum() for f in (faces[axis], run[0][axis])]
        assert total[0] == pytest.approx(total[1], abs=1e-11)


def test_divergence_in_float32(vortices):
    flow = vortices[16]
    state = flow.state(*random_faces(flow.grid), dtype=jnp.float32)
    step = jnp.asarray(0.002, jnp.float32)
    state, worst, ok = flow.march(flow.properties(NU, dtype=jnp.float32), state, 5, step)
    assert state.pressure.dtype == jnp.float32 and bool(ok)
    left = np.abs(divergence(flow.grid, [np.asarray(u, np.float64) for u in state.face_velocity])).max()
    speed = max(float(jnp.abs(u).max()) for u in state.face_velocity)
    assert left * flow.grid.spacing[0] / speed < 1e-5  # the gate in float32, units of U/h
    assert float(worst) < 1e-5


# --- walls ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def couette():
    return Flow((3, 8), (0.3, 1.0), ("periodic", "periodic", "no_slip", "moving_wall"))


def test_couette_flow_is_linear(couette):
    """Exact on any mesh: the stress of a linear profile is constant, and the ghosts mirror about the wall."""
    properties = couette.properties(1.0, {3: [2.0, 0.0]})
    state, _, _ = couette.march(properties, couette.state(), 1000, 0.003)
    profile = np.broadcast_to(2.0 * couette.centres(1), (4, 8))
    # After three diffusion times what is left of the start is exp(-3 pi^2) = 1e-13.
    np.testing.assert_allclose(state.face_velocity[0], profile, atol=1e-11)


def test_couette_start_up_follows_the_series(couette):
    """u/U = z/H + sum_n 2/(n pi) (-1)^n exp(-n^2 pi^2 nu t/H^2) sin(n pi z/H) at nu t/H^2 = 0.1."""
    state, _, _ = couette.march(couette.properties(1.0, {3: [2.0, 0.0]}), couette.state(), 50, 0.002)
    z, n = couette.centres(1)[:, None], np.arange(1, 60)[None]
    series = np.sum(
        2 / (n * np.pi) * (-1.0) ** n * np.exp(-(n**2) * np.pi**2 * 0.1) * np.sin(n * np.pi * z), 1
    )
    # Second order: the slowest mode decays too slowly by (pi h/H)^2/12 = 1.3 % per unit exponent on 8 cells.
    np.testing.assert_allclose(state.face_velocity[0][0], 2.0 * (z[:, 0] + series), atol=0.02)


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


@pytest.mark.parametrize("profile", ["parabolic", "uniform"])
def test_poiseuille_flow_keeps_its_profile_from_a_parabolic_inlet(profile):
    """Pressure falls by 12 mu U L / H^2 and the profile stays 6 U s (1 - s) from the first cell on.

    The discrete flow is 6 U [s (1 - s) + h^2/4] / (1 + 2 h^2) in units of H, its drop 12 mu U L / (1 + 2 h^2):
    0.8 % off on 16 cells. A uniform inlet, as the negative control, pays for the entrance as well.
    """
    inlet = dict(profile=(Parabola(),)) if profile == "parabolic" else None
    flow = Flow((12, 16), (1.5, 0.5), ("inlet", "outlet", "no_slip", "no_slip"), density=3.0, inlet=inlet)
    speed, nu, height, length = 0.4, 0.02, 0.5, 11 * 0.125
    state, worst, ok = flow.march(flow.properties(nu, {0: [speed, 0.0]}), flow.state(), 1500, 0.01)
    assert bool(ok) and float(worst) < 1e-10
    s = flow.centres(1) / height
    u, p = np.asarray(state.face_velocity[0]), np.asarray(state.pressure)
    assert u[0].mean() == pytest.approx(speed, rel=1e-14)
    drift = np.abs(u - 6.0 * speed * (s * (1.0 - s))[None]).max() / (1.5 * speed)
    drop = (p[0] - p[-1]).mean() / (12.0 * 3.0 * nu * speed * length / height**2)
    discrete = 1.0 / (1.0 + 2.0 / 16**2)
    print("Poiseuille", profile, drift, drop, discrete)
    if profile == "parabolic":
        assert drift < 0.01
        assert drop == pytest.approx(1.0, abs=0.01)
    else:
        assert drift > 0.3 and drop > 1.05


@pytest.mark.parametrize("profile", [Parabola(), LinearTable((0.0, 0.2, 0.5), (0.3, 2.0, -0.5))], ids=str)
def test_flow_rate_of_a_profile_is_the_same_on_every_mesh(profile):
    """Through a patch that fits no mesh, over an uneven void fraction; what goes in goes out."""
    exact = 0.37 if isinstance(profile, Parabola) else 0.1 * (1.15 + 2.0) / 2 + 0.27 * (2.0 - 0.25) / 2
    for cells in ((4, 4), (7, 9)):
        sides = ("inlet", "outlet", "no_slip", "no_slip")
        flow = Flow(cells, (1.0, 1.0), sides, {0: ((0.1,), (0.47,))}, inlet=dict(profile=(profile,)))
        g = np.random.default_rng(1).uniform(0.5, 1.0, cells)
        properties = flow.properties(1e-3, {0: [0.8, 0.0]})
        state, _, ok = flow.march(properties, flow.state(void_fraction=g), 3, 0.01, g)
        flux = np.asarray(face_average(flow.grid, g)[0] * state.face_velocity[0]).sum(axis=1) / cells[1]
        assert bool(ok) and flux[0] == pytest.approx(exact * 0.8, rel=1e-14)
        assert flux[-1] == pytest.approx(flux[0], rel=1e-9)


def test_lid_driven_cavity_at_reynolds_100():
    """Small twin of the 128^2 gate (0.01): 32^2 cells, error of second order, against Ghia, Ghia & Shin 1982."""
    n = 32
    flow = Flow((n, n), (1.0, 1.0), ("no_slip", "no_slip", "no_slip", "moving_wall"))
    properties = flow.properties(0.01, {3: [1.0, 0.0]})
    state, _, _ = flow.march(properties, flow.state(), 1500, 0.012)
    u, w = (np.asarray(f) for f in state.face_velocity)
    error = []
    for name, line, column in (("ghia_u", u[n // 2], 0), ("ghia_v", w[:, n // 2], 0)):
        table = np.loadtxt(DATA / f"{name}.csv", delimiter=",", skiprows=2)
        inside = (table[:, 0] > 0) & (table[:, 0] < 1)
        ends = (0.0, 1.0) if name == "ghia_u" else (0.0, 0.0)
        x = np.r_[0.0, flow.centres(column), 1.0]
        here = np.interp(table[inside, 0], x, np.r_[ends[0], line, ends[1]])
        error.append(np.abs(here - table[inside, 1]).max())
    print("cavity", error)
    # 0.01 at 128^2 with an error of second order would allow 0.16 here; the linear interpolation of the
    # boundary layer makes most of what is seen.
    assert max(error) < 0.02


# --- no new extrema, symmetries ---------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", [VanLeer(), Upwind()], ids=["limited", "upwind"])
def test_a_front_makes_no_new_extrema(scheme):
    """A step carried once around: stays within its values; the limited front is a third as wide."""
    grid = Grid((40, 1), (1.0, 1.0), 1.0, (True, True))
    boundary = Boundary(tuple(Side(n // 2, bool(n % 2), "periodic") for n in range(4)))
    flux = (jnp.ones((41, 1)), jnp.zeros((40, 2)))
    start = jnp.asarray(np.tile(np.where(np.abs(np.arange(40) - 20) < 8, 1.0, 0.0)[:, None], 2))
    still = (jnp.zeros(2),) * 4

    @jax.jit
    def once_around(w):
        def rate(w):
            velocity = (flux[0], w)
            return advection(grid, boundary, scheme, still, flux, velocity, jnp.asarray(0.0))[1]

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
    assert smear < 0.1 if isinstance(scheme, VanLeer) else smear > 0.15


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
    flux = [
        np.asarray(gu * u) for gu, u in zip(face_average(flow.grid, later), state.face_velocity, strict=True)
    ]
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


def test_fluid_at_rest_stays_at_rest_over_an_uneven_void_fraction(jets):
    flow, g, _ = jets[8]
    state, _, _ = flow.march(flow.properties(1e-3), flow.state(void_fraction=g), 10, 0.01, g)
    assert not any(np.any(u) for u in state.face_velocity)
    assert not np.any(state.pressure)


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
            right=dict(
                kind="inlet", times=times, velocities=speeds, profile="parabolic", **{"from": 0.1, "to": 0.4}
            ),
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

"""Flows beside surfaces that the fluid sees, against closed forms and published figures."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import brentq
from scipy.special import j1, y1

from jaxdem.coupling.open_parts import corner_points, face_points
from jaxdem.coupling.surface_velocity import swept
from jaxdem.fluid.advection import Central
from jaxdem.fluid.drive import Drive, DriveParameters
from jaxdem.fluid.inlet import Parabola
from jaxdem.setup.cut_cells import FluidSurface, cut_cells_of
from jaxdem.solids.clipping import positive_part
from jaxdem.solids.grid_distance import grid_distance
from jaxdem.solids.mesh_files import polyline
from jaxdem.solids.motion import Rotation, Translation, Uniform
from tests.cases.flows import Flow
from tests.cases.registry import Figure, absolute, at_least, case, relative

SAMPLES = 41
"""Points over a face at which a closed form is averaged."""


class ChannelFlow(NamedTuple):
    """Root of the mean square error over the largest speed, and flow over that of the closed form."""

    error: float
    flow: float


def averaged(grid, axis, formula):
    """Mean over the open part of every face of an axis of a 2-D flow; `formula`: points -> (value, inside)."""
    points, total, count = face_points(grid, axis), 0.0, 0
    for k in range(SAMPLES):
        moved = points.copy()
        moved[..., 1 - axis] += ((k + 0.5) / SAMPLES - 0.5) * grid.spacing[1 - axis]
        value, inside = formula(moved)
        total, count = total + np.where(inside, value, 0.0), count + inside
    return total / np.maximum(count, 1)


def error_of(cut, velocity, exact):
    """Root of the mean square over the open parts."""
    squares = area = 0.0
    for a, u, e in zip(cut.open_faces, velocity, exact, strict=True):
        a = np.asarray(a)
        squares, area = squares + np.sum(a * (np.asarray(u) - e) ** 2), area + np.sum(a)
    return math.sqrt(squares / area)


def laminar_channel(gap, force, viscosity):
    """Speed at y between walls that are `gap` apart, and the flow over the gap."""
    return lambda y: 0.5 * force / viscosity * y * (gap - y), force * gap**3 / 12.0 / viscosity


def eddying_channel(gap, force, viscosity, length):
    """The same with a mixing length l: nu s + l^2 s^2 = force (gap/2 - y) for the shear s = du/dy in the lower half."""
    y = np.linspace(0.0, 0.5 * gap, 2001)
    rate = (-viscosity + np.sqrt(viscosity**2 + 4.0 * length**2 * force * (0.5 * gap - y))) / (2.0 * length**2)
    speed = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(y))])
    flow = 2.0 * np.sum(0.5 * (speed[1:] + speed[:-1]) * np.diff(y))
    return lambda x: np.interp(np.minimum(x, gap - x), y, speed), flow


def tilted_channel(n, slope, width=0.6, decay=4.0, length=None):
    """Channels of a slope (rise, run) across a periodic box of side 1, n cells a side, driven along themselves; with a
    mixing length in gaps."""
    rise, run = slope
    diagonal = math.hypot(rise, run)
    along, normal = np.array([run, rise]) / diagonal, np.array([-rise, run]) / diagonal
    period = 1.0 / diagonal
    gap, viscosity, offset = width * period, 1.0, 0.137

    def height(x):
        return np.mod(x @ normal - offset, period)

    def distance(x):
        y = height(x)
        return np.where(y < 0.5 * (gap + period), np.minimum(y, gap - y), y - period)

    flow = Flow((n, n), (1.0, 1.0), ("periodic",) * 4)
    cut = jax.tree.map(jnp.asarray, cut_cells_of(flow.grid, [FluidSurface(distance)])[0])
    solver = dataclasses.replace(flow.solver, drive=Drive((True, True), (False, False)), surfaces=1)
    force = 8.0 * viscosity / gap**2
    if length is None:
        speed, total = laminar_channel(gap, force, viscosity)
    else:
        speed, total = eddying_channel(gap, force, viscosity, length * gap)

    def exact(axis):
        def formula(x):
            y = height(x)
            return speed(np.clip(y, 0.0, gap)) * along[axis], y < gap

        return averaged(flow.grid, axis, formula) * (np.asarray(cut.open_faces[axis]) > 0.0)

    profile = [exact(axis) for axis in range(2)]
    drive = DriveParameters(jnp.asarray(-force * along))
    coefficient = None if length is None else length * gap / flow.grid.filter_size
    properties = flow.properties(viscosity, smagorinsky=coefficient)
    properties = properties._replace(cut=cut, drive=drive, gravity=jnp.zeros(2))
    state = flow.state(*profile)._replace(mean_gradient=jnp.asarray(-force * along))
    # At the walls the eddy viscosity is l^2 s < l sqrt(force gap/2).
    largest = viscosity if length is None else viscosity + length * gap * math.sqrt(0.5 * force * gap)
    step = 0.28 / n**2 / 2.0 / largest
    count = int(decay * gap**2 / math.pi**2 / viscosity / step) + 1
    velocity = marched(solver, properties, state, step, count)[0].face_velocity
    flux = [np.mean((np.asarray(a) * np.asarray(u))[:n, :n]) for a, u in zip(cut.open_faces, velocity, strict=True)]
    return ChannelFlow(error_of(cut, velocity, profile), float(np.dot(flux, along) / (total / period)))


def marched(solver, properties, state, step, count):
    """The state after so many steps, and the load on the surfaces in the last one."""
    shape = (solver.surfaces, solver.grid.dimension, 1 + solver.grid.dimension)

    @jax.jit
    def march(properties, state):
        def body(k, carry):
            result = solver.step(properties, carry[0], k * step, jnp.asarray(step, state.pressure.dtype))
            return result.state, result.surface_load

        return jax.lax.fori_loop(0, count, body, (state, jnp.zeros(shape, state.pressure.dtype)))

    return march(properties, state)


class CouetteFlow(NamedTuple):
    """Root of the mean square error over the wall's speed; torques over the closed form, inner and outer."""

    error: float
    torques: tuple[float, float]


INNER, OUTER, MIDDLE = 0.2, 0.42, np.array([0.503, 0.491])
"""Radii and middle of two cylinders in a box of side 1, of which the inner turns at 1 rad/s [m]."""


def steady_couette(r):
    """Speed round the middle at a distance r from it [m/s]."""
    return INNER**2 / (OUTER**2 - INNER**2) * (OUTER**2 / r - r)


def starting_couette(r, diffusion, terms=60):
    """The same at the time t after the inner cylinder has begun, with nu t = `diffusion` [m2].

    The difference from the steady flow is a series of J1(k r) Y1(k b) - J1(k b) Y1(k r), zero on both cylinders, that
    decay as exp(-k^2 nu t); its coefficients are such that there is no flow at t = 0.
    """

    def wave(k, r):
        return j1(k * r) * y1(k * OUTER) - j1(k * OUTER) * y1(k * r)

    scale = math.pi / (OUTER - INNER)
    roots = [brentq(lambda k: wave(k, INNER), (n - 0.3) * scale, (n + 0.3) * scale) for n in range(1, terms + 1)]
    found, fine = steady_couette(r), np.linspace(INNER, OUTER, 8001)
    for k in roots:
        own = wave(k, fine)
        share = np.trapezoid(fine * own * steady_couette(fine), fine) / np.trapezoid(fine * own**2, fine)
        found = found - share * np.exp(-(k**2) * diffusion) * wave(k, r)
    return found


def couette(n, decay=3.0, corners=None, started=None):
    """Between cylinders, n cells a side.

    Args:
        n: cells a side.
        decay: from the steady flow on, in units of gap^2 / (pi^2 nu).
        corners: of a polygon of the inner cylinder's area in its place; None for the cylinder.
        started: nu t after a start from rest, in place of `decay` [m2].

    Returns:
        the figures, and the velocity on the open faces.
    """
    rate, viscosity = 1.0, 0.05
    flow = Flow((n, n), (1.0, 1.0), ("no_slip",) * 4)

    def radius(x):
        return np.hypot(x[..., 0] - MIDDLE[0], x[..., 1] - MIDDLE[1])

    def from_inner(x):
        if corners is None:
            return radius(x) - INNER
        angle = 2.0 * np.pi * (np.arange(corners) + 0.37) / corners
        reach = INNER * math.sqrt(2.0 * np.pi / (corners * math.sin(2.0 * np.pi / corners)))
        points = MIDDLE + reach * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return grid_distance(polyline(points, True), flow.grid.spacing, (n + 1, n + 1), 4.0 / n).distance

    turning = Rotation(tuple(MIDDLE), None, Uniform()).at({"rate": np.asarray(rate)}, (np.zeros(()), None))
    surfaces = [FluidSurface(from_inner, True, turning), FluidSurface(lambda x: OUTER - radius(x))]
    cut = jax.tree.map(jnp.asarray, cut_cells_of(flow.grid, surfaces)[0])
    solver = dataclasses.replace(flow.solver, surfaces=2)
    reached = np.linspace(INNER, OUTER, 2001)
    speed = steady_couette(reached) if started is None else starting_couette(reached, started)

    def exact(axis):
        def formula(x):
            r = radius(x)
            arm = (MIDDLE[1] - x[..., 1]) if axis == 0 else (x[..., 0] - MIDDLE[0])
            inside = (r > INNER) & (r < OUTER)
            return np.interp(r, reached, speed) / np.maximum(r, 1e-9) * arm, inside

        return averaged(flow.grid, axis, formula) * (np.asarray(cut.open_faces[axis]) > 0.0)

    profile = [exact(axis) for axis in range(2)]
    step = 0.28 / n**2 / 2.0 / viscosity
    count = int(decay * (OUTER - INNER) ** 2 / math.pi**2 / viscosity / step) + 1
    if started is not None:
        count = round(started / viscosity / step)
        step = started / viscosity / count
    properties = flow.properties(viscosity)._replace(cut=cut)
    state, load = marched(solver, properties, flow.state(*(profile if started is None else ())), step, count)
    velocity = [np.where(np.asarray(f) > 0.0, u, 0.0) for f, u in zip(cut.open_faces, state.face_velocity, strict=True)]
    torque = load[:, 1, 1] - MIDDLE[0] * load[:, 1, 0] - load[:, 0, 2] + MIDDLE[1] * load[:, 0, 0]
    expected = 4.0 * math.pi * viscosity * rate * INNER**2 * OUTER**2 / (OUTER**2 - INNER**2)
    ratios = float(-torque[0] / expected), float(torque[1] / expected)
    return CouetteFlow(error_of(cut, velocity, profile) / (rate * INNER), ratios), (cut, velocity)


@case(
    "Poiseuille flow in channels tilted in the mesh",
    "fluid",
    "closed form",
    fast={"cells": (16, 32), "slopes": ((1, 2),)},
)
def tilted_channels(cells=(20, 28, 40, 56), slopes=((0, 1), (1, 3), (1, 2), (1, 1))):
    """Order of the error, fitted through all meshes, and the flow on the finest, in channels that rise by 0 to 45
    degrees."""
    found: list[Figure] = []
    for slope in slopes:
        flows = [tilted_channel(n, slope) for n in cells]
        angle = f"{math.degrees(math.atan2(*slope)):.3g} degrees"
        order = -np.polyfit(np.log(cells), np.log([flow.error for flow in flows]), 1)[0]
        across = 0.6 / math.hypot(*slope) * cells[-1]
        found.append(at_least(f"order, {angle}", 1.5, order))
        gate = 0.01 if across > 16.0 else 0.03
        found.append(relative(f"flow, {angle}, {across:.3g} cells across", 1.0, flows[-1].flow, gate))
    return found


@case(
    "Channels tilted in the mesh with Smagorinsky's viscosity",
    "fluid",
    "closed form of a constant mixing length",
    fast={"cells": (16, 32)},
)
def tilted_channels_with_eddies(cells=(16, 32, 64), slope=(1, 2), length=0.4):
    """Order of the error and the flow, with a mixing length of 0.4 gaps: at the walls the eddies have 0.44
    of the molecular viscosity."""
    flows = [tilted_channel(n, slope, length=length) for n in cells]
    across = 0.6 / math.hypot(*slope) * cells[-1]
    return [
        at_least("order", 1.5, math.log2(flows[0].error / flows[-1].error) / math.log2(cells[-1] / cells[0])),
        relative(f"flow, {across:.3g} cells across", 1.0, flows[-1].flow, 0.01 if across > 16.0 else 0.03),
    ]


class SlowFlow(NamedTuple):
    """Pressure on the inner cylinder over mu U / radius; drag over the closed form."""

    pressure: float
    drag: float


def slow_flow(n, decay=3.0):
    """Stokes's flow round a cylinder of radius 0.15 within one of radius 0.45 that slides along x, n cells a side.

    The stream function is (A r^3 + B r ln r + C r + E/r) U sin(angle), the pressure mu (8 A r - 2 B/r) U cos(angle),
    the drag 4 pi mu B U.
    """
    inner, outer, speed, middle = 0.15, 0.45, 1e-3, np.array([0.503, 0.491])
    radii = [(r**3, r * math.log(r), r, 1.0 / r) for r in (inner, outer)]
    slopes = [(3.0 * r**2, math.log(r) + 1.0, 1.0, -1.0 / r**2) for r in (inner, outer)]
    a, b, _, _ = np.linalg.solve(np.array(radii + slopes), [0.0, outer, 0.0, 1.0])
    flow = Flow((n, n), (1.0, 1.0), ("no_slip",) * 4)

    def radius(x):
        return np.hypot(x[..., 0] - middle[0], x[..., 1] - middle[1])

    sliding = Translation((1.0, 0.0), Uniform()).at({"rate": np.asarray(speed)}, (np.zeros(()), None))
    surfaces = [FluidSurface(lambda x: radius(x) - inner), FluidSurface(lambda x: outer - radius(x), True, sliding)]
    cut, _ = cut_cells_of(flow.grid, surfaces)
    corners = corner_points(flow.grid)
    alone, both = (np.min([s.distance(corners) for s in given], axis=0) for given in (surfaces[:1], surfaces))
    still = tuple(positive_part(alone, (1 - axis,)).fraction for axis in range(2))
    # The outer one is always where it is: what it sweeps is what flows through it.
    cut = cut._replace(swept=swept(flow.grid, cut, still, [(both, [1], sliding)], both))
    cut = jax.tree.map(jnp.asarray, cut)
    step = 0.28 / n**2 / 2.0
    count = int(decay * (outer - inner) ** 2 / math.pi**2 / step) + 1
    solver = dataclasses.replace(flow.solver, surfaces=2)
    state, load = marched(solver, flow.properties(1.0)._replace(cut=cut), flow.state(), step, count)
    points = (np.arange(n) + 0.5) / n
    x, y = np.meshgrid(points - middle[0], points - middle[1], indexing="ij")
    r, pressure = np.hypot(x, y), np.asarray(state.pressure)
    beside = (np.asarray(cut.open_cells) >= 1.0) & (r < inner + 1.5 / n)
    wave = ((8.0 * a * r - 2.0 * b / r) * x / r)[beside]
    amplitude = np.sum(pressure[beside] * wave) / np.sum(wave**2)
    return SlowFlow(float(amplitude / speed), float(load[0, 0, 0]) / (4.0 * math.pi * b * speed))


@case("Slow flow round a cylinder within another one", "fluid", "Stokes, closed form", fast={"cells": (20, 40)})
def slow_flow_between_cylinders(cells=(32, 64)):
    """Drag, and the pressure in the cells beside the inner cylinder: its part along the closed form, over that."""
    flows, found = [slow_flow(n) for n in cells], []
    across = 0.3 * cells[-1]
    for name in SlowFlow._fields:
        errors = [abs(getattr(one, name) - 1.0) for one in flows]
        found.append(relative(f"{name}, {across:.3g} cells a diameter", 1.0, getattr(flows[-1], name), 4.0 / across**2))
        found.append(at_least(f"order of the {name}", 1.5, math.log2(errors[0] / errors[1])))
    return found


@case("Couette flow round a turning cylinder", "fluid", "closed form", fast={"n": 32})
def turning_cylinder(n=64):
    """Velocity, and the torques of both cylinders, whose arms are right to the size of a cell."""
    flow, _ = couette(n)
    return [
        absolute(f"velocity, {n} cells", 0.0, flow.error, 0.01),
        relative(f"torque on the outer cylinder, {n} cells", 1.0, flow.torques[1], 1.0 / n / 0.42),
        relative(f"torque on the inner cylinder, {n} cells", 1.0, flow.torques[0], 1.0 / n / 0.2),
    ]


@case(
    "Couette flow round a cylinder that begins to turn", "fluid", "series of Bessel functions", fast={"cells": (16, 32)}
)
def starting_cylinder(cells=(32, 64), started=3e-3):
    """Velocity when the layer at the cylinder is a third of the gap, and the order of its error."""
    errors = [couette(n, started=started)[0].error for n in cells]
    return [
        absolute(f"velocity, {cells[1]} cells", 0.0, errors[1], 0.01),
        at_least("order", 1.5, math.log2(errors[0] / errors[1])),
    ]


@case(
    "Polygon of 48 corners in place of a turning cylinder", "fluid", "the field of the cylinder", fast={"cells": (32,)}
)
def turning_polygon(cells=(32, 64)):
    """Root of the mean square of the difference in velocity, over the speed of the wall. The polygon is off the circle
    of its area by R/12 (2 pi/48)^2 either way, 0.14 % of R, and du/dr there is -3 U/R."""
    found = []
    for n in cells:
        (_, (cut, of_polygon)), (_, (_, of_cylinder)) = couette(n, corners=48), couette(n)
        difference = error_of(cut, of_polygon, of_cylinder) / INNER
        found.append(absolute(f"velocity, {n} cells", 0.0, difference, 3 * 0.0014))
    return found


@case(
    "Cylinder in a channel at Re = 20 (2D-1)",
    "fluid",
    "M. Schaefer, S. Turek, Notes Numer. Fluid Mech. 52 (1996) 547-566; digits of c_D, c_L and the pressure difference "
    "as given for DFG 2D-1",
    fast={"rows": 41, "end": 3.0, "gates": (0.01, 0.008, 0.006)},
)
def cylinder_in_channel(rows=82, end=6.0, gates=(0.01, 0.003, 0.003)):
    """Drag, lift and pressure difference of a cylinder of diameter 0.1 m in a channel of 0.41 m.

    Args:
        rows: cells across the channel.
        end: time from rest [s].
        gates: of the drag (relative), the lift and the pressure difference (absolute, Pa).
    """
    columns, height, viscosity = round(2.2 / 0.41 * rows), 0.41 / rows, 1e-3
    kinds = ("inlet", "outlet", "no_slip", "no_slip")
    flow = Flow((columns, rows), (2.2, 0.41), kinds, inlet={"profile": (Parabola(),)}, scheme=Central())
    cylinder = FluidSurface(lambda x: np.hypot(x[..., 0] - 0.2, x[..., 1] - 0.2) - 0.05)
    cut = jax.tree.map(jnp.asarray, cut_cells_of(flow.grid, [cylinder])[0])
    solver = dataclasses.replace(flow.solver, surfaces=1)
    properties = flow.properties(viscosity, {0: np.array([0.2, 0.0])})._replace(cut=cut)
    step = min(0.4 * height / 0.45, 0.3 * height**2 / 2.0 / viscosity)
    state, load = marched(solver, properties, flow.state(), step, int(end / step))
    drag, lift = 2.0 * np.asarray(load)[0, :, 0] / (0.2**2 * 0.1)
    front, rear = (_at_stagnation(flow, state, viscosity, *point) for point in ((0.15, -1), (0.25, 1)))
    difference = front - rear
    of_mesh = f"{0.1 / height:.3g} cells a diameter"
    return [
        relative(f"drag coefficient, {of_mesh}", 5.5795, drag, gates[0]),
        absolute(f"lift coefficient, {of_mesh}", 0.0106, lift, gates[1]),
        absolute(f"pressure difference, {of_mesh}", 0.1175, difference, gates[2], "Pa"),
    ]


def _at_stagnation(flow, state, viscosity, x, outward):
    """Reduced pressure at a stagnation point of a surface, at the height 0.2 and at x [Pa].

    From the nearest whole cell to the wall by what Hiemenz's flow has on its stagnation line,
    p + u^2/2 - nu du/dx = const, with density 1. There the pressure rises by nu du/dx within a layer of
    sqrt(nu/(dU/dx)), a few cells, which a polynomial of the pressures before it does not know of.
    """
    pressure, (hx, hy) = np.asarray(state.pressure, float), flow.grid.spacing
    velocity = np.asarray(state.face_velocity[0], float)
    row = 0.2 / hy - 0.5
    low = math.floor(row)
    share = row - low
    on_line = [(1.0 - share) * field[:, low] + share * field[:, low + 1] for field in (pressure, velocity)]
    # Whole is a cell that ends at the surface or before it.
    cell = math.floor(x / hx + 1e-9) - 1 if outward < 0 else math.ceil(x / hx - 1e-9)
    before, after = on_line[1][cell], on_line[1][cell + 1]
    return float(on_line[0][cell] + 0.5 * (0.5 * (before + after)) ** 2 - viscosity * (after - before) / hx)


@case("Poiseuille flow in a round pipe", "fluid", "Hagen and Poiseuille, closed form", fast={"cells": (12, 24)})
def round_pipe(cells=(16, 32)):
    """Flow and its order, of a pipe along the third axis that a gradient drives."""
    flows = [_pipe_flow(n) for n in cells]
    order = math.log2(abs(flows[0] - 1.0) / abs(flows[1] - 1.0)) / math.log2(cells[1] / cells[0])
    return [
        relative(f"flow, {0.9 * cells[1]:.3g} cells across", 1.0, flows[1], 0.01),
        at_least("order of the flow", 1.5, order),
    ]


def _pipe_flow(n):
    """Flow through a pipe of radius 0.45 in a box of side 1 with n cells a side, over pi G R^4 / (8 mu)."""
    radius, viscosity = 0.45, 1.0
    flow = Flow((n, n, 2), (1.0, 1.0, 2.0 / n), ("no_slip",) * 4 + ("periodic",) * 2)
    pipe = FluidSurface(lambda x: radius - np.hypot(x[..., 0] - 0.503, x[..., 1] - 0.491))
    cut = jax.tree.map(jnp.asarray, cut_cells_of(flow.grid, [pipe])[0])
    solver = dataclasses.replace(flow.solver, drive=Drive((False, False, True), (False,) * 3), surfaces=1)
    gradient = jnp.asarray([0.0, 0.0, -1.0])
    properties = flow.properties(viscosity)
    properties = properties._replace(cut=cut, drive=DriveParameters(gradient), gravity=jnp.zeros(3))
    step = 0.28 / n**2 / 3.0 / viscosity
    count = int(8.0 * radius**2 / 5.78 / viscosity / step)
    state, _ = marched(solver, properties, flow.state()._replace(mean_gradient=gradient), step, count)
    flux = float(jnp.sum((cut.open_faces[2] * state.face_velocity[2])[:, :, 0])) / n**2
    return flux / (math.pi * radius**4 / 8.0 / viscosity)

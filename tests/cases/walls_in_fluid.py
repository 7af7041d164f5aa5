"""Flows beside surfaces that the fluid sees, against closed forms and published figures."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxdem import build, initial_state, load_scene
from jaxdem.coupling.open_parts import face_points
from jaxdem.fluid.advection import Central
from jaxdem.fluid.drive import Drive, DriveParameters
from jaxdem.fluid.inlet import Parabola
from jaxdem.setup.cut_cells import FluidSurface, cut_cells_of
from jaxdem.solids.motion import Rotation, Uniform
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


def tilted_channel(n, slope, width=0.6, decay=4.0):
    """Channels of a slope (rise, run) across a periodic box of side 1, n cells a side, driven along themselves."""
    rise, run = slope
    length = math.hypot(rise, run)
    along, normal = np.array([run, rise]) / length, np.array([-rise, run]) / length
    period = 1.0 / length
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

    def exact(axis):
        def formula(x):
            y = height(x)
            return 0.5 * force / viscosity * y * (gap - y) * along[axis], y < gap

        return averaged(flow.grid, axis, formula) * (np.asarray(cut.open_faces[axis]) > 0.0)

    profile = [exact(axis) for axis in range(2)]
    drive = DriveParameters(jnp.asarray(-force * along))
    properties = flow.properties(viscosity)._replace(cut=cut, drive=drive, gravity=jnp.zeros(2))
    state = flow.state(*profile)._replace(mean_gradient=jnp.asarray(-force * along))
    step = 0.28 / n**2 / 2.0 / viscosity
    count = int(decay * gap**2 / math.pi**2 / viscosity / step) + 1
    velocity = marched(solver, properties, state, step, count)[0].face_velocity
    flux = [np.mean((np.asarray(a) * np.asarray(u))[:n, :n]) for a, u in zip(cut.open_faces, velocity, strict=True)]
    return ChannelFlow(error_of(cut, velocity, profile), float(np.dot(flux, along) / (2.0 / 3.0 * gap / period)))


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


def couette(n, decay=3.0):
    """Between cylinders of radii 0.2 and 0.42, of which the inner turns, in a box of side 1 with n cells a side."""
    inner, outer, rate, viscosity, middle = 0.2, 0.42, 1.0, 0.05, np.array([0.503, 0.491])
    flow = Flow((n, n), (1.0, 1.0), ("no_slip",) * 4)

    def radius(x):
        return np.hypot(x[..., 0] - middle[0], x[..., 1] - middle[1])

    turning = Rotation(tuple(middle), None, Uniform()).at({"rate": np.asarray(rate)}, (np.zeros(()), None))
    surfaces = [
        FluidSurface(lambda x: radius(x) - inner, True, turning),
        FluidSurface(lambda x: outer - radius(x)),
    ]
    cut = jax.tree.map(jnp.asarray, cut_cells_of(flow.grid, surfaces)[0])
    solver = dataclasses.replace(flow.solver, surfaces=2)
    a = -rate * inner**2 / (outer**2 - inner**2)
    b = rate * inner**2 * outer**2 / (outer**2 - inner**2)

    def exact(axis):
        def formula(x):
            r = radius(x)
            arm = (middle[1] - x[..., 1]) if axis == 0 else (x[..., 0] - middle[0])
            return (a + b / np.maximum(r, 1e-9) ** 2) * arm, (r > inner) & (r < outer)

        return averaged(flow.grid, axis, formula) * (np.asarray(cut.open_faces[axis]) > 0.0)

    profile = [exact(axis) for axis in range(2)]
    step = 0.28 / n**2 / 2.0 / viscosity
    count = int(decay * (outer - inner) ** 2 / math.pi**2 / viscosity / step) + 1
    properties = flow.properties(viscosity)._replace(cut=cut)
    state, load = marched(solver, properties, flow.state(*profile), step, count)
    velocity = [np.where(np.asarray(f) > 0.0, u, 0.0) for f, u in zip(cut.open_faces, state.face_velocity, strict=True)]
    torque = load[:, 1, 1] - middle[0] * load[:, 1, 0] - load[:, 0, 2] + middle[1] * load[:, 0, 0]
    expected = 4.0 * math.pi * viscosity * b
    ratios = float(-torque[0] / expected), float(torque[1] / expected)
    return CouetteFlow(error_of(cut, velocity, profile) / (rate * inner), ratios)


@case(
    "Poiseuille flow in channels tilted in the mesh",
    "fluid",
    "closed form",
    fast={"cells": (16, 32), "slopes": ((1, 2),)},
)
def tilted_channels(cells=(16, 32, 64), slopes=((0, 1), (1, 3), (1, 2), (1, 1))):
    """Order of the error and the flow, in channels that rise by 0 to 45 degrees."""
    found: list[Figure] = []
    for slope in slopes:
        flows = [tilted_channel(n, slope) for n in cells]
        angle = f"{math.degrees(math.atan2(*slope)):.3g} degrees"
        order = math.log2(flows[0].error / flows[-1].error) / math.log2(cells[-1] / cells[0])
        across = 0.6 / math.hypot(*slope) * cells[-1]
        found.append(at_least(f"order, {angle}", 1.5, order))
        gate = 0.01 if across > 16.0 else 0.03
        found.append(relative(f"flow, {angle}, {across:.3g} cells across", 1.0, flows[-1].flow, gate))
    return found


@case("Couette flow round a turning cylinder", "fluid", "closed form", fast={"n": 32})
def turning_cylinder(n=64):
    """Velocity, and the torques of both cylinders, whose arms are right to the size of a cell."""
    flow = couette(n)
    return [
        absolute(f"velocity, {n} cells", 0.0, flow.error, 0.01),
        relative(f"torque on the outer cylinder, {n} cells", 1.0, flow.torques[1], 1.0 / n / 0.42),
        relative(f"torque on the inner cylinder, {n} cells", 1.0, flow.torques[0], 1.0 / n / 0.2),
    ]


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
    difference = _continued(flow.grid, state.pressure, 0.15, -1) - _continued(flow.grid, state.pressure, 0.25, 1)
    of_mesh = f"{0.1 / height:.3g} cells a diameter"
    return [
        relative(f"drag coefficient, {of_mesh}", 5.5795, drag, gates[0]),
        absolute(f"lift coefficient, {of_mesh}", 0.0106, lift, gates[1]),
        absolute(f"pressure difference, {of_mesh}", 0.1175, difference, gates[2], "Pa"),
    ]


def _continued(grid, pressure, x, outward):
    """Pressure at the height 0.2 and at x on the surface, by a parabola through three whole cells beside it [Pa]."""
    p, (hx, hy) = np.asarray(pressure, float), grid.spacing
    row = 0.2 / hy - 0.5
    low = math.floor(row)
    place = x / hx - 0.5
    first = math.floor(place - 0.75) if outward < 0 else math.ceil(place + 0.75)
    columns = first + outward * np.arange(3)
    values = (low + 1 - row) * p[columns, low] + (row - low) * p[columns, low + 1]
    return float(np.polyval(np.polyfit(columns, values, 2), place))


def bed_drop(walls, side, layers, cells, positions, diameter):
    """Pressure drop of a bed of grains that stand still in a stream along z, between two heights [Pa/m].

    Args:
        walls: tables of the scene.
        side: width of the box [m].
        layers: height of the box over the distance of the layers of grains.
        cells: of the mesh across the box.
        positions: (N, 3) [m].
        diameter: of the grains [m].
    """
    height = layers * BED_SPACING
    given = {
        "precision": "float64",
        "domain": {"size": [side, side, height], "gravity": [0.0, 0.0, 0.0]},
        "fluid": {"cells": [cells, cells, 2 * cells], "density": 1000.0, "viscosity": 1e-6, "time_step": 2e-3},
        "particles": {"radius": 0.5 * diameter, "density": 1e9, "position": np.asarray(positions).tolist()},
        "contact": {"young_modulus": 1e9, "maximum_overlap": 0.5, "time_step": 1e-4},
        "coupling": {"drag": "ergun"},
        "walls": walls,
        "boundary": {name: {"kind": "free_slip"} for name in ("left", "right", "front", "back")}
        | {"bottom": {"kind": "inlet", "velocity": [0.0, 0.0, BED_SPEED]}, "top": {"kind": "outlet"}},
        "time": {"end": 0.02, "output_interval": 0.02},
    }
    scene = load_scene(given)
    simulation, parameters = build(scene)
    state, _ = initial_state(scene, simulation, parameters)
    advance = jax.jit(lambda fluid: simulation.coupling.advance(parameters.mixture, fluid, state.particles, 1.0)[0])
    fluid = state.fluid
    for _ in range(12):
        fluid = advance(fluid)
    pressure, cut = np.asarray(fluid.pressure), parameters.fluid.cut
    weight = np.ones(pressure.shape) if cut is None else np.asarray(cut.open_cells)
    profile = (pressure * weight).sum(axis=(0, 1)) / weight.sum(axis=(0, 1))
    first, last = len(profile) // 4, 3 * len(profile) // 4
    return (profile[first] - profile[last]) / ((last - first) * height / len(profile))


BED_SPACING, BED_SPEED = 0.006, 0.02
"""Distance of the layers of grains [m]; superficial velocity of the stream [m/s]."""


@case(
    "Fixed bed in a round pipe and in a square duct",
    "exchange",
    "Ergun's equation, and the same area",
    fast=None,
    tested=False,
)
def bed_in_pipe(cells=16, layers=16, count=14):
    """The pressure drop in both, against each other and against Ergun's equation for the superficial velocity."""
    diameter = (6.0 * 0.3 / math.pi) ** (1.0 / 3.0) * BED_SPACING
    duct = count * BED_SPACING
    radius = duct / math.sqrt(math.pi)
    heights = (np.arange(layers) + 0.5) * BED_SPACING
    grid = (np.arange(count) + 0.5) * BED_SPACING
    in_duct = np.stack([x.ravel() for x in np.meshgrid(grid, grid, heights, indexing="ij")], axis=-1)
    # As many in the pipe, evenly: on a spiral with the golden angle, which turns from layer to layer.
    k = np.arange(count**2)
    spread, angle = radius * np.sqrt((k + 0.5) / count**2), math.pi * (3.0 - math.sqrt(5.0)) * k
    side = 2.04 * radius
    layer = np.stack([0.5 * side + spread * np.cos(angle), 0.5 * side + spread * np.sin(angle)], axis=-1)
    in_pipe = np.concatenate([np.column_stack([layer, np.full(count**2, z)]) for z in heights])
    axis = {"kind": "cylinder", "center": [0.5 * side, 0.5 * side, 0.0], "radius": radius, "axis": [0.0, 0.0, 1.0]}
    drop = bed_drop([axis | {"fluid": "free_slip"}], side, layers, cells, in_pipe, diameter)
    of_duct = bed_drop([], duct, layers, cells, in_duct, diameter)
    solids, g = 0.3, 0.7
    viscous = 150.0 * 1e-3 * solids**2 / (g**3 * diameter**2) * BED_SPEED
    ergun = viscous + 1.75 * 1000.0 * solids / (g**3 * diameter) * BED_SPEED**2
    return [
        relative("pressure drop of the pipe over that of the duct", 1.0, drop / of_duct, 0.01),
        relative("pressure drop of the pipe", ergun, drop, 0.01, "Pa/m"),
    ]


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

"""Grains of jaxdem in the fluid of another solver: a fluidised bed whose water is solved here, in NumPy and SciPy.

`Water` stands for your solver. It knows nothing of jaxdem; what goes to and fro are arrays in SI units. The pressure
drop of the bed is compared with the submerged weight of the grains over the area, and with that in jaxdem's own fluid.

Run: python examples/external_solver.py [PICTURE]
"""

from __future__ import annotations

import math

import jax
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import EllipseCollection
from pictures import save
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

import jaxdem
from jaxdem.failures import first_meaning
from jaxdem.report.pictures import GRAINS, WATER

FLUID, SOLID, GRAVITY, RADIUS, INFLOW = 1000.0, 2500.0, 9.81, 1e-3, 0.06
SCENE = {
    "domain": {"size": [0.04, 0.12], "depth": 2 * RADIUS, "gravity": [0.0, -GRAVITY]},
    "particles": {
        "count": 240,
        "radius": RADIUS,
        "density": SOLID,
        "pack": {"kind": "lattice", "start": [0.0, 0.0], "stop": [0.04, 0.06], "jitter": 0.005},
    },
    "contact": {"young_modulus": 1e6, "restitution": 0.7, "friction": 0.3, "speed": 0.3},
    "fluid": {"cells": [10, 30], "density": FLUID, "viscosity": 1e-6, "velocity": [0.0, INFLOW]},
    "boundary": {
        "left": {"kind": "periodic"},
        "right": {"kind": "periodic"},
        "bottom": {"kind": "inlet", "velocity": INFLOW},
        "top": {"kind": "outlet"},
    },
    "coupling": {"drag": "gidaspow", "interval": 2e-3},
    "time": {"end": 3.0, "output_interval": 0.1},
}


class Water:
    """Water in cells [x, z]: periodic along x, inflow at the bottom, p = 0 at the top. A projection method.

        rho [d(g u)/dt + div(g u u)] = -g grad p + S - B u,    dg/dt + div(g u) = 0

    g is the void fraction, p the reduced pressure, S and B are `drag_source` and `drag_coefficient` of jaxdem. The drag
    is implicit. Momentum is carried upwind. There is no viscous stress.
    """

    def __init__(self, cells: tuple[int, int], size: tuple[float, float], step: float) -> None:
        self.step, self.spacing = step, (size[0] / cells[0], size[1] / cells[1])
        self.velocity, self.gradient = np.zeros((*cells, 2)), np.zeros((*cells, 2))
        self.velocity[..., 1] = INFLOW
        self.flux = [np.zeros((cells[0] + 1, cells[1])), np.full((cells[0], cells[1] + 1), INFLOW)]
        self.pressure, self.void_fraction = np.zeros(cells), None

    def advance(self, void_fraction: np.ndarray, coefficient: np.ndarray, source: np.ndarray) -> None:
        """One time step, at whose end the void fraction is the given one."""
        g, old = void_fraction, void_fraction if self.void_fraction is None else self.void_fraction
        mass = FLUID * g / self.step + coefficient
        gain = [self.divergence([f * u for f, u in zip(self.flux, self.upwind(a), strict=True)]) for a in (0, 1)]
        momentum = FLUID * (old[..., None] * self.velocity / self.step - np.stack(gain, axis=-1))
        predicted = (momentum + source) / mass[..., None]
        push = g / mass  # change of the velocity by a pressure gradient
        flux = [self.on_faces(g * predicted[..., a], a) for a in (0, 1)]
        flux[1][:, 0], conductance = INFLOW, [self.on_faces(g * push, a) for a in (0, 1)]
        conductance[1][:, 0] = 0.0
        self.pressure = self.solve(conductance, self.divergence(flux) + (g - old) / self.step)
        slope = self.slope(self.pressure)
        self.flux = [f - c * s for f, c, s in zip(flux, conductance, slope, strict=True)]
        slope[1][:, 0] = slope[1][:, 1]
        self.gradient = np.stack((slope[0][1:] + slope[0][:-1], slope[1][:, 1:] + slope[1][:, :-1]), axis=-1) / 2
        self.velocity = predicted - push[..., None] * self.gradient
        self.void_fraction = g

    def on_faces(self, cells: np.ndarray, axis: int) -> np.ndarray:
        """Mean of the two cells of every face; on the bottom and the top the cell's own value."""
        wide = np.pad(cells, ((1, 1), (0, 0)), "wrap") if axis == 0 else np.pad(cells, ((0, 0), (1, 1)), "edge")
        return (wide[1:] + wide[:-1]) / 2 if axis == 0 else (wide[:, 1:] + wide[:, :-1]) / 2

    def upwind(self, component: int) -> list[np.ndarray]:
        """The velocity component that the flux carries through every face."""
        u = self.velocity[..., component]
        x, z = np.pad(u, ((1, 1), (0, 0)), "wrap"), np.pad(u, ((0, 0), (1, 1)), "edge")
        return [
            np.where(self.flux[0] > 0, x[:-1], x[1:]),
            np.where(self.flux[1] > 0, z[:, :-1], z[:, 1:]),
        ]

    def divergence(self, faces: list[np.ndarray]) -> np.ndarray:
        """Of a face field, in the cells."""
        return np.diff(faces[0], axis=0) / self.spacing[0] + np.diff(faces[1], axis=1) / self.spacing[1]

    def slope(self, pressure: np.ndarray) -> list[np.ndarray]:
        """Gradient on the faces: none through the bottom, to p = 0 half a cell away on the top."""
        x = np.diff(np.pad(pressure, ((1, 1), (0, 0)), "wrap"), axis=0) / self.spacing[0]
        z = np.pad(pressure, ((0, 0), (1, 1)), "edge")
        z[:, -1] *= -1.0
        return [x, np.diff(z, axis=1) / self.spacing[1]]

    def solve(self, conductance: list[np.ndarray], source: np.ndarray) -> np.ndarray:
        """Pressure with div(c grad p) = source."""
        cell = np.arange(source.size).reshape(source.shape)
        x, z = conductance[0][1:] / self.spacing[0] ** 2, conductance[1][:, 1:-1] / self.spacing[1] ** 2
        pairs = [(cell, np.roll(cell, -1, axis=0), x), (cell[:, :-1], cell[:, 1:], z)]
        entries = [(i, j, c) for a, b, c in pairs for i, j, c in ((a, b, c), (b, a, c), (a, a, -c), (b, b, -c))]
        entries.append((cell[:, -1], cell[:, -1], -2.0 * conductance[1][:, -1] / self.spacing[1] ** 2))
        rows, columns, values = (np.concatenate([np.ravel(e[k]) for e in entries]) for k in range(3))
        matrix = coo_array((values, (rows, columns)), shape=(source.size,) * 2).tocsr()
        return spsolve(matrix, source.ravel()).reshape(source.shape)


def coupled(scene: jaxdem.Scene, seconds: float):
    """What `measured` gives after every interval, and the last grains and water.

    In every interval the grains tell what they do to the water, the water takes its step, and the grains take theirs.
    """
    grains, parameters = jaxdem.external_fluid(scene)
    state, neighbors = jaxdem.initial_state(scene, grains, parameters)
    exchange, advance = jax.jit(grains.exchange), jax.jit(grains.advance)
    water = Water(scene.fluid.cells, scene.domain.size, grains.interval)
    seen, start = [], jaxdem.FluidFields(water.velocity, water.gradient)
    for _ in range(round(seconds / grains.interval)):
        given = exchange(parameters, state, start)
        water.advance(*(np.asarray(a, float) for a in (given.void_fraction, given.drag_coefficient, given.drag_source)))
        end = jaxdem.FluidFields(water.velocity, water.gradient)
        step = advance(parameters, state, neighbors, start, end)
        stop_if_unsound(step.failures)
        state, neighbors, start = step.state, step.neighbors, end
        seen.append(measured(water.pressure, state.particles))
    return np.array(seen), state.particles, water


def alone(scene: jaxdem.Scene, seconds: float) -> np.ndarray:
    """What `measured` gives after every interval in jaxdem's own fluid."""
    simulation, parameters = jaxdem.build(scene)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    steps = round(seconds / simulation.interval)

    def seen(state):
        return measured(state.fluid.pressure, state.particles)

    @jax.jit
    def run(state, neighbors):
        return jaxdem.rollout(simulation, parameters, state, neighbors, steps, seen, reversible=False)

    result = run(state, neighbors)
    stop_if_unsound(result.failures)
    return np.stack(result.observations, axis=1)


def measured(pressure, particles):
    """Pressure on the bottom [Pa], what the bottom carries of the grains [N], mean height of the grains [m].

    The pressure is on a line through the two lowest rows of cells. Contact forces between grains add up to nothing.
    """
    bottom = (1.5 * pressure[:, 0] - 0.5 * pressure[:, 1]).mean()
    return bottom, particles.contact_force[:, 1].sum(), particles.position[:, 1].mean()


def stop_if_unsound(failures: jax.Array) -> None:
    """A message and the end of the program if a flag is up."""
    if code := int(failures):
        raise SystemExit(". ".join(first_meaning(code)))


def submerged_weight(scene: jaxdem.Scene) -> float:
    """Weight of all grains less that of the water that they displace [N]."""
    return scene.particles.count * 4.0 / 3.0 * math.pi * RADIUS**3 * (SOLID - FLUID) * GRAVITY


def main() -> None:
    """Run both, print their pressure drops over the weight, and draw them."""
    scene = jaxdem.load_scene(SCENE)
    weight, area = submerged_weight(scene), scene.domain.size[0] * scene.domain.depth
    units = [weight / area, weight, 1e-3]
    found, particles, water = coupled(scene, scene.time.end)
    found, own = found / units, alone(scene, scene.time.end) / units
    for name, seen in (("solver of this example", found), ("jaxdem's own fluid", own)):
        drop, carried, height = seen[len(seen) // 3 :].mean(axis=0)
        print(
            f"{name}: pressure drop {drop:.3f} of the weight, the bottom carries {carried:.3f}, height {height:.1f} mm"
        )
    save(picture(found[:, [0, 2]], own[:, [0, 2]], particles, water), "external_solver")


def picture(found: np.ndarray, own: np.ndarray, particles, water: Water) -> plt.Figure:
    """Pressure drops over the weight and mean heights [mm] of both over time, and the last grains and water."""
    figure = plt.figure(figsize=(9.6, 4.6), layout="constrained")
    axes = figure.subplot_mosaic([["drop", "frame"], ["height", "frame"]], width_ratios=(1.6, 1))
    times = SCENE["coupling"]["interval"] * np.arange(1, len(found) + 1)
    for name, column, label in (
        ("drop", 0, "pressure drop\nover weight [-]"),
        ("height", 1, "mean height of\ngrains [mm]"),
    ):
        axes[name].plot(times, own[:, column], lw=1, label="jaxdem's own fluid")
        axes[name].plot(times, found[:, column], lw=1, label="solver of this example")
        axes[name].set(ylabel=label)
    axes["drop"].axhline(1.0, color="k", lw=0.8, ls="--", label="submerged weight")
    axes["drop"].set(ylim=(0.8, 1.2))
    axes["drop"].legend()
    axes["height"].set(xlabel="time [s]")
    width, height = SCENE["domain"]["size"]
    frame = axes["frame"]
    frame.set(xlim=(0, width), ylim=(0, height), aspect="equal", xlabel="x [m]", ylabel="height [m]", xticks=(0, width))
    speed = np.linalg.norm(water.velocity, axis=-1)
    shown = frame.imshow(speed.T, origin="lower", extent=(0, width, 0, height), cmap=WATER, vmin=0)
    diameter = np.full(len(particles.position), 2 * RADIUS)
    places = {"offsets": particles.position, "transOffset": frame.transData, "units": "xy"}
    grains = EllipseCollection(diameter, diameter, 0 * diameter, cmap=GRAINS, linewidths=0, **places)
    grains.set_array(np.linalg.norm(particles.velocity, axis=1))
    frame.add_collection(grains)
    figure.colorbar(shown, ax=frame, label="water speed [m/s]", shrink=0.8)
    figure.colorbar(grains, ax=frame, label="grain speed [m/s]", shrink=0.8)
    return figure


if __name__ == "__main__":
    main()

"""Two fluids in stiff and extreme cases: time-step limits found by trial, density ratios, drops, beds at rest."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

import jaxdem
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.grid import face_average
from jaxdem.fluid.second_fluid import mixture_density
from jaxdem.fluid.volume_of_fluid import SURFACE_COURANT, surface_courant
from jaxdem.particles.regions import ball
from jaxdem.setup.surface import cells_within
from tests.cases.extremes import PERIODIC, Outcome, base, finished
from tests.cases.grains_in_two_fluids import after, dry_bed_and_a_column, layer_under_a_lake, liquid
from tests.cases.stability import GROWTH, Limit, largest_stable
from tests.cases.steps import time_steps
from tests.cases.two_fluids import TwoFluids, drop_at_rest, largest

CELLS, STEPS = 16, 200
"""Cells a side and fluid steps of a trial."""

RATIOS = (1.0, 30.0, 1000.0)
"""Density of the liquid over that of the other fluid."""

RIPPLE = 1e-6
"""Velocity of the noise that a flat surface at rest is given [m/s]: so small that waves stay linear while they grow by
`GROWTH`, and far above what rounding leaves of weight and pressure in balance."""


class _Trial(NamedTuple):
    """A scene of two fluids with noise in its velocity.

    Attributes:
        scene: the scene.
        solver: of the fluids.
        properties: their numbers.
        state: at the start, free of divergence.
    """

    scene: Any
    solver: Any
    properties: Any
    state: FluidState

    def energy(self, state: FluidState) -> Array:
        """Kinetic energy of the motion about the centre of mass, over the cells [J/m3]."""
        properties, total = self.properties, jnp.zeros(())
        density = mixture_density(properties.second, properties.density, state.liquid_fraction)
        for m, u in zip(face_average(self.solver.grid, density), state.face_velocity, strict=True):
            total = total + jnp.sum(m * (u - jnp.sum(m * u) / jnp.sum(m)) ** 2)
        return total

    def largest_stable(self, predicted: float, growth: float) -> float:
        """Largest step with which the energy grows by no more than a factor in `STEPS`, and the fraction stays
        between 0 and 1 to a millionth [s]."""
        most = growth * self.energy(self.state)

        def one(step: Array) -> Array:
            def going(carry: Any) -> Array:
                return (carry[0] < STEPS) & carry[2]

            def body(carry: Any) -> Any:
                k, state, _ = carry
                state = self.solver.step(self.properties, state, k * step, step).state
                beyond = jnp.max(jnp.abs(state.liquid_fraction - 0.5)) - 0.5
                return k + 1, state, (self.energy(state) < most) & (beyond < 1e-6)

            return lax.while_loop(going, body, (jnp.zeros((), jnp.int32), self.state, jnp.asarray(True)))[2]

        return largest_stable(jax.jit(lambda steps: lax.map(one, steps)), predicted, 0.5, 8.0)

    @property
    def automatic(self) -> float:
        """Step that a run would take [s]."""
        steps = time_steps(self.scene)
        return steps.interval / steps.fluid_substeps


def _trial(tables: dict[str, Any], noise: float) -> _Trial:
    """A scene of these tables; `noise` is the velocity [m/s]."""
    scene = jaxdem.load_scene({"precision": "float64", "time": {"end": 1.0, "output_interval": 1.0}} | tables)
    simulation, parameters = jaxdem.build(scene)
    state = jaxdem.initial_state(scene, simulation, parameters)[0].fluid
    solver, rng, faces = simulation.fluid.solver, np.random.default_rng(0), []
    for axis, u in enumerate(state.face_velocity):
        shaken = np.moveaxis(np.array(u + rng.normal(0.0, noise, u.shape)), axis, 0)
        if solver.grid.periodic[axis]:
            shaken[-1] = shaken[0]
        faces.append(jnp.asarray(np.moveaxis(shaken, 0, axis)))
    # A tiny step only makes the noise free of divergence.
    shaken_state, zero = state._replace(face_velocity=tuple(faces)), jnp.zeros(())
    projected = jax.jit(solver.step)(parameters.flow, shaken_state, zero, jnp.asarray(1e-9)).state
    return _Trial(scene, solver, parameters.flow, state._replace(face_velocity=projected.face_velocity))


def wave_limit(ratio: float, tension: float) -> Limit:
    """A flat surface with noise, without viscosity: by its tension, or without one by gravity.

    With tension it lies on faces of the mesh, where one velocity moves it: within cells, where it moves with the mean
    of two, the shortest waves are slower. By gravity it lies within cells: on faces the velocity of the gas beside it
    grows by and by at any step, see docs/limits.md.
    """
    level = 0.5 if tension else 0.53
    tables = {
        "domain": {"size": [1.0, 1.0], "gravity": [0.0, 0.0 if tension else -9.81]},
        "fluid": {"cells": [CELLS, CELLS], "density": 1000.0, "viscosity": 0.0},
        "surface": {"density": 1000.0 / ratio, "viscosity": 0.0, "tension": tension, "level": level},
        "boundary": {name: {"kind": "periodic"} for name in ("left", "right")}
        | {name: {"kind": "free_slip"} for name in ("bottom", "top")},
    }
    trial = _trial(tables, RIPPLE)
    predicted = time_steps(trial.scene).limits["capillary" if tension else "surface_waves"]
    kind = "capillary" if tension else "gravity"
    name = f"{kind} waves, density ratio {ratio:g}"
    return Limit("surface", name, predicted, trial.largest_stable(predicted, GROWTH), trial.automatic)


def stream_limit(ratio: float) -> Limit:
    """A drop in a stirred oblique stream: energy about the centre of mass may grow by a tenth, and no more."""
    drop = {"shape": "sphere", "center": [0.5, 0.5], "radius": 0.27}
    tables = {
        "domain": {"size": [1.0, 1.0], "gravity": [0.0, 0.0]},
        "fluid": {"cells": [CELLS, CELLS], "density": 1000.0, "viscosity": 0.0, "velocity": [1.0, 1.0]},
        "surface": {"density": 1000.0 / ratio, "viscosity": 0.0, "regions": [drop]},
        "boundary": PERIODIC,
    }
    trial = _trial(tables, 0.05)
    rate = float(surface_courant(trial.solver.grid, trial.state.face_velocity, jnp.ones(())))
    predicted = SURFACE_COURANT / rate
    found = trial.largest_stable(predicted, 1.1)
    name = f"drop in an oblique stream, density ratio {ratio:g}"
    note = f"stable to a Courant number of {found * rate:.2f}"
    return Limit("surface", name, predicted, found, trial.automatic, note)


def _row(name: str, begin: float, sound: bool, message: str, volume: float = math.nan) -> Outcome:
    """An outcome of fluids that are marched without a run."""
    outcome = "sound" if sound else "unsound"
    return Outcome("surface", name, outcome, volume=volume, message=message, seconds=time.perf_counter() - begin)


CORNER_STEPS = 120


def over_the_corner(cells: int = 24) -> tuple[float, float, float]:
    """A drop with tension, a thousand times as heavy, that an oblique stream carries once round a periodic box over
    its corner, and the same half a box away, which does not cross it when the first does.

    Returns:
        largest difference of both fractions, one moved onto the other; change of volume over it; part of the area
        that has moved out of place, over that of the drop.
    """
    box = TwoFluids((cells, cells), (1.0, 1.0), ("periodic",) * 4, tension=True)
    properties = box.properties(1000.0, (1e-3, 1e-2), (0.0, 0.0), 1.0)
    middle = cells_within(ball((0.46, 0.53), 0.27), box.grid)
    half = (cells // 2, cells // 2)
    starts = [middle, np.roll(middle, half, (0, 1))]
    ends = []
    for start in starts:
        state = box.state(start, 1.0, 1.0)
        ends.append(np.asarray(box.march(properties, state, CORNER_STEPS, 1.0 / CORNER_STEPS).state.liquid_fraction))
    apart = float(np.abs(np.roll(ends[1], half, (0, 1)) - ends[0]).max())
    misplaced = float(np.abs(ends[0] - middle).sum() / middle.sum())
    return apart, float(ends[1].sum() / middle.sum() - 1.0), misplaced


def _corner() -> Outcome:
    begin = time.perf_counter()
    apart, volume, misplaced = over_the_corner()
    message = f"half a box away the same to {apart:.0e}; {100 * misplaced:.1f} % of its area out of place after a turn"
    sound = apart < 1e-4 and abs(volume) < 1e-12 and misplaced < 0.05
    return _row("drop over the corner of a periodic box", begin, sound, message, abs(volume))


def _still_drop(cells: int = 32) -> Outcome:
    begin = time.perf_counter()
    figures = drop_at_rest(cells=(cells,))
    capillary = next(figure.got for figure in figures if figure.what.startswith("capillary"))
    message = f"capillary number of what flows {capillary:.0e} on {cells} cells"
    return _row("drop at rest, density ratio 1000", begin, all(figure.passed for figure in figures), message)


def _lake() -> Outcome:
    begin = time.perf_counter()
    _, _, _, end = after(layer_under_a_lake(0.0647), 1600)
    speed = max(largest(end.fluid.face_velocity), float(jnp.abs(end.particles.velocity).max()))
    return _row("grains at rest under a still lake", begin, speed < 1e-12, f"largest speed {speed:.0e} m/s")


def _dry_bed() -> Outcome:
    begin = time.perf_counter()
    simulation, _, start, end = after(dry_bed_and_a_column(), 700)
    volume = abs(liquid(simulation, end) / liquid(simulation, start) - 1.0)
    beyond = float(jnp.max(jnp.abs(end.fluid.liquid_fraction - 0.5))) - 0.5
    wet, open_part = float(end.fluid.liquid_fraction[:, 0].max()), float(start.fluid.void_fraction.min())
    message = f"open to {100 * open_part:.0f} %; liquid sinks in to {wet:.2f}, beyond 0 and 1 by {max(beyond, 0.0):.0e}"
    sound = wet > 0.5 and beyond < 1e-13 and volume < 1e-13
    return _row("a dry cell full of grains, liquid let go above", begin, sound, message, volume)


def limits() -> dict[str, Callable[[], Limit]]:
    """Time-step limits by name; each is run when called."""
    table: dict[str, Callable[[], Limit]] = {}
    for ratio in RATIOS:
        table[f"surface: capillary waves, {ratio:g}"] = functools.partial(wave_limit, ratio, 1.0)
    for ratio in RATIOS[1:]:  # at a ratio of one there are no waves by gravity
        table[f"surface: gravity waves, {ratio:g}"] = functools.partial(wave_limit, ratio, 0.0)
    for ratio in RATIOS:
        table[f"surface: stream, {ratio:g}"] = functools.partial(stream_limit, ratio)
    return table


def rows() -> dict[str, Callable[[], Outcome]]:
    """Extreme cases by name; those of `surface` compute in float64."""
    table: dict[str, Callable[[], Outcome]] = {
        "surface: corner": _corner,
        "surface: still drop": _still_drop,
        "surface: lake": _lake,
        "surface: dry bed": _dry_bed,
    }
    column = [{"shape": "box", "start": [-1.0, -1.0], "stop": [0.12, 0.2]}]
    for ratio in RATIOS:
        name = f"a column breaks over grains, density ratio {ratio:g}"
        tables = base(surface={"density": 1000.0 / ratio, "regions": column})
        table[f"two fluids: {name}"] = functools.partial(finished, "two fluids", name, tables)
    none = base(surface={"density": 1.2, "level": 0.0})
    table["two fluids: no liquid"] = functools.partial(finished, "two fluids", "no liquid anywhere", none)
    return table

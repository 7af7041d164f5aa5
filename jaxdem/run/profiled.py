"""Fluid and particles of an interval as programs of their own, timed one by one: what `--profile` runs."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from jaxdem.devices import DividedSimulation
from jaxdem.devices.mesh import DIAGNOSTICS, SAME, SLABS, STATE, on_slabs, put
from jaxdem.devices.parameters import spread
from jaxdem.errors import required
from jaxdem.failures import failures
from jaxdem.fluid.interval import FluidDiagnostics
from jaxdem.particles.moving_walls import PistonNumbers, PistonState
from jaxdem.particles.neighbors import Neighbors
from jaxdem.probes.base import Interval
from jaxdem.run.chunk import Chunk, Records, identity_of, probed_in_slabs, records_of
from jaxdem.run.probing import Probed, Watch, nothing_yet, probed
from jaxdem.scalar_step import FlowOfInterval, advance_scalars
from jaxdem.simulation import Simulation
from jaxdem.state import Diagnostics, Parameters, State
from jaxdem.step import advance_fluid, advance_particles


class ProfiledProgram:
    """See `Program`; the stages are `fluid_part` and `particle_part`. On several devices each part is a program over
    all of them."""

    most = 1

    def __init__(
        self,
        simulation: Simulation,
        parameters: Parameters,
        state: State,
        neighbors: Neighbors | None,
        timed: Callable[[str], AbstractContextManager[None]],
        watch: Watch | None = None,
    ) -> None:
        self._mesh = simulation.mesh if isinstance(simulation, DividedSimulation) else None
        self._timed, own = timed, simulation.of_slab() if isinstance(simulation, DividedSimulation) else simulation
        keeps_flux = own.fluid is not None and own.fluid.solver.keeps_flux
        report: Any = SAME
        if keeps_flux:
            report = FluidDiagnostics(*(SAME,) * len(FluidDiagnostics._fields))
            report = report._replace(flux=SLABS, heat=SLABS, dissolved=SLABS, cut=SLABS)
        flow: Any = FlowOfInterval(SLABS, SLABS, report)
        self._placed = simulation.on_devices if isinstance(simulation, DividedSimulation) else _as_they_are
        parameters = self._placed(parameters)
        numbers: Any = SAME if self._mesh is None else spread(parameters)
        fluid = self._part(partial(advance_fluid, own), (numbers, STATE), (SLABS, SLABS, report, SAME))
        forces = jax.eval_shape(fluid, parameters, state)[1]
        self._fluid = fluid.lower(parameters, state).compile()
        moved = (SLABS, SLABS, SAME, SLABS, SLABS)
        particles = self._part(partial(advance_particles, own), (numbers, STATE, SLABS, SLABS, SLABS), moved)
        self._particles = particles.lower(parameters, state, neighbors, forces, state.scalars).compile()
        self._scalars = self._part(partial(advance_scalars, own), (numbers, STATE, SLABS, flow), (SLABS, SAME))
        self._carries_scalars = own.scalars is not None
        self._loads_pistons = own.walls_in_fluid is not None and bool(own.walls_in_fluid.pistons)
        self._loaded = self._part(partial(_loaded_pistons, own), (numbers, STATE, report), (SAME, SLABS))
        self._closed = self._part(partial(_closed, own), (DIAGNOSTICS, SAME), (SAME, SAME, SAME))
        given: Any = (numbers, SAME, Interval(STATE, STATE, SLABS, DIAGNOSTICS))
        self._probe = self._part(partial(_seen, own), given, probed_in_slabs(watch))

    def _part(self, function: Callable[..., Any], given: Any, result: Any) -> Any:
        """A part, compiled when it is called; how its arguments and results are spread over slabs."""
        return jax.jit(function if self._mesh is None else on_slabs(self._mesh, function, given, result))

    def _same(self, tree: Any) -> Any:
        return tree if self._mesh is None else put(self._mesh, tree, SAME)

    def __call__(
        self, parameters: Parameters, state: State, neighbors: Neighbors | None, count: int, watch: Watch | None = None
    ) -> Chunk:
        """See `Program`."""
        parameters = self._placed(parameters)
        with self._timed("fluid_part"):
            fluid, forces, of_fluid, of_exchange = jax.block_until_ready(self._fluid(parameters, state))
        scalars, flow = None, FlowOfInterval(fluid, forces, of_fluid)
        with self._timed("particle_part"):
            if self._carries_scalars:
                scalars, of_fluid = self._scalars(parameters, state, neighbors, flow)
            loaded, held = parameters, state
            if self._loads_pistons:
                given, pistons = self._loaded(parameters, state, of_fluid)
                particles = required(state.particles, "particles")._replace(pistons=pistons)
                loaded, held = parameters._replace(pistons=given), state._replace(particles=particles)
            moved = jax.block_until_ready(self._particles(loaded, held, neighbors, forces, scalars))
            particles, neighbors, of_particles, places, scalars = moved
        diagnostics = Diagnostics(of_particles, of_fluid, of_exchange, forces, places)
        records, code, step = self._closed(diagnostics, state.step)
        new, seen = State(particles, fluid, step, scalars), None
        if watch is not None:
            seen = self._probe(parameters, self._same(watch), Interval(state, new, neighbors, diagnostics))
        return Chunk(new, neighbors, diagnostics, records, code, jnp.int32(1), seen, identity_of(state))


def _as_they_are(parameters: Parameters) -> Parameters:
    return parameters


def _loaded_pistons(
    simulation: Simulation, parameters: Parameters, state: State, report: FluidDiagnostics
) -> tuple[tuple[PistonNumbers, ...], PistonState | None]:
    """Numbers and state of the pistons with what the fluid does to them."""
    loaded, held = simulation.with_loaded_pistons(parameters, state, report)
    return loaded.pistons, required(held.particles, "particles").pistons


def _closed(simulation: Simulation, diagnostics: Diagnostics, step: Array) -> tuple[Records, Array, Array]:
    """Figures and flags of an interval, and the number of the next."""
    records: Records = jax.tree.map(lambda value: value[None], records_of(diagnostics))
    return records, failures(simulation, diagnostics), step + 1


def _seen(simulation: Simulation, parameters: Parameters, watch: Watch, interval: Interval) -> Probed:
    """What the probes find in an interval."""
    before = nothing_yet(watch, interval.after, interval.neighbors, ProfiledProgram.most)
    return probed(simulation, parameters, watch.probing, interval, before)

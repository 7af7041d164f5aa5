"""Coarse runs that are nudged to a fine one, and the samples that a drag closure can be fitted to.

A closure that is fitted to averaged fields of a fine run knows nothing of the coarse solver, its parcels and its
scheme. Here the coarse run itself is drawn to the fine one, and what that takes is what the drag law lacks. With c(w) w
the force of the law on a grain of mass m for the slip w = u - v that it sees, the gas gives a grain

    F = k c(w) w + s c(w) (w - w_r) + m (a - mean(a)),   a = (v_r - v_m) / tau,

and loses it. Of the fine run, averaged to the coarse mesh and seen at the grain at this time, v_r is the mean velocity
of the grains and w_r the velocity of the gas less v_r; v_m is the same mean in the coarse run. s and tau are given. k
is 1, or it is what gives the whole box the slip of the fine run:

    d ln k / dt = ln(W . W_r / |W_r|^2) / t_k,

W the velocity of the gas, mean by its volume, less that of the grains, W_r that of the fine run. Gas is light, so its
slip follows the drag at once, and the drag alone can correct it. The mean of a is left out: the sum of all forces stays
what it is, and so does the momentum of grains and gas together.

A sample is what the law sees in this run, as input, and F, as target. Nothing is differentiated.

Sources: nudging as data assimilation: A. Azouani, E. Olson & E. S. Titi, J. Nonlinear Sci. 24 (2014) 277-304; closures
from the nudging term: A. Suriyanarayanan, M. Adrian, D. Chakraborty & R. Maulik, arXiv 2604.23874 (2026). There the
velocity itself is nudged. Between gas and grains it is their exchange, so that the term is a drag.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxdem.closures.nudged import NudgedDrag
from jaxdem.coupling.coupled import Coupling
from jaxdem.coupling.interpolation import Weights, deposit, interpolate
from jaxdem.coupling.member_weights import body_weights
from jaxdem.errors import InputError, RunError, required
from jaxdem.failures import failures
from jaxdem.fluid.grid import FaceField, cell_average
from jaxdem.io.samples import Samples
from jaxdem.particles.integrate import ParticleProperties, ParticleState, as_column, centres_in_box
from jaxdem.particles.neighbors import Neighbors
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State
from jaxdem.train.dataset import COLUMNS, CoarseView

LEAST_SOLIDS = 1e-3
"""Part of the mean solid fraction below which the fine run has no grains at a place to draw others to [-]."""
RATIOS = (0.1, 10.0)
"""Between which W . W_r / |W_r|^2 is taken to be: k stays finite where the slip changes its sign [-]."""


class Nudging(NamedTuple):
    """How a run is nudged.

    Attributes:
        stiffness: s: nudging force over the force of the law, for a slip that is wrong by its own size [-].
        relaxation: tau of the grains [s].
        control: t_k of the factor for the slip of the whole box; infinite keeps it at 1 [s].
    """

    stiffness: float
    relaxation: float
    control: float = math.inf

    def check(self) -> None:
        """Raises InputError for a number out of its range."""
        if not self.stiffness >= 0.0:
            raise InputError("stiffness", self.stiffness, "must be 0 or more", "Raise it.")
        for name in ("relaxation", "control"):
            if not getattr(self, name) > 0.0:
                raise InputError(name, getattr(self, name), "must be positive", "Raise it.")


class Mixed(NamedTuple):
    """Gas and grains on the cells of a mesh, or a series of them in time with a first axis.

    Attributes:
        gas: (cells..., D) interstitial velocity [m/s].
        solids: (cells...) solid fraction [-].
        flux: (cells..., D) solid fraction times mean velocity of the grains [m/s].
    """

    gas: Array
    solids: Array
    flux: Array

    @property
    def slip(self) -> Array:
        """(D,) W: mean velocity of the gas less that of the grains [m/s]."""
        rows, void = tuple(range(self.solids.ndim)), 1.0 - self.solids
        gas = jnp.sum(void[..., None] * self.gas, rows) / jnp.sum(void)
        return gas - jnp.sum(self.flux, rows) / jnp.sum(self.solids)


class Reference(NamedTuple):
    """A fine run on the coarse mesh.

    Attributes:
        times: (T,) increasing [s].
        fields: at these times.
    """

    times: Array
    fields: Mixed

    def at(self, time: Array) -> Mixed:
        """The fields at a time [s], between two of `times` in proportion; beyond the ends those of the end."""
        upper = jnp.clip(jnp.searchsorted(self.times, time), 1, len(self.times) - 1)
        start, end = self.times[upper - 1], self.times[upper]
        part = jnp.clip((time - start) / (end - start), 0.0, 1.0)
        return jax.tree.map(lambda f: (1.0 - part) * f[upper - 1] + part * f[upper], self.fields)


def reference_of(samples: Samples, view: CoarseView) -> Reference:
    """The samples of a fine run, averaged to the coarse mesh of `view`, which has the grains of the fine run.

    Raises:
        InputError: fewer than two samples.
    """
    if len(samples.times) < 2:
        raise InputError("samples", len(samples.times), "are too few to follow", "Sample the fine run more often.")

    @jax.jit
    def mixed(position: Array, velocity: Array, faces: FaceField) -> Mixed:
        particles = ParticleState(position, None, velocity, velocity[:, :0], (), (), velocity, None)
        gas = jnp.stack(cell_average(faces), axis=-1)
        return _on_cells(view.coupling, view.bodies, particles, gas)[0]

    series = []
    for number, now in enumerate(samples.times):
        sample = samples.frame(number)
        faces = view.fluid(sample, float(now)).face_velocity
        position, velocity = (jnp.asarray(sample[n], faces[0].dtype) for n in ("position", "particle_velocity"))
        series.append(mixed(position, velocity, faces))
    fields = jax.tree.map(lambda *frames: jnp.stack(frames), *series)
    return Reference(jnp.asarray(samples.times, fields.gas.dtype), fields)


class _Carry(NamedTuple):
    """What a nudged run carries: `log_factor` is ln k, `flags` those of `jaxdem.failures`."""

    state: State
    neighbors: Neighbors
    log_factor: Array
    flags: Array


_Given = tuple[Nudging, Parameters, Reference]


class NudgedRun:
    """A coarse run with grains or parcels of one size, drawn to a fine one; see the module."""

    def __init__(self, simulation: Simulation, parameters: Parameters, reference: Reference):
        """Args: `simulation` and `parameters` of `jaxdem.build` with a `NudgedDrag` as its closure.

        Raises:
            InputError: another closure, several masses, or model B, whose drag is not that of the samples.
        """
        closure = parameters.closure
        if not isinstance(closure, NudgedDrag):
            remedy = "Give NudgedDrag.of(law, ...) to jaxdem.build."
            raise InputError("parameters.closure", type(closure).__name__, "cannot be nudged", remedy)
        self.simulation, self.parameters, self.closure = simulation, parameters, closure
        self.reference = reference
        self.coupling = required(simulation.coupling, "coupling")
        if not self.coupling.interval.solver.shares_stress:
            raise InputError("coupling.form", "B", "is not for nudged runs", "Use model A.")
        self.grid = self.coupling.interval.solver.grid
        bodies = required(parameters.bodies, "bodies")
        if np.ptp(bodies.mass):  # the mean of a would have to be that by mass
            raise InputError("particles", "of several masses", "are not for nudged runs", "Give one size and density.")
        self.grains = bodies.of_all_grains(jnp.ones((), closure.slip.dtype))
        self.grain_mass = bodies.mass / self.grains
        self._run = jax.jit(self._all, static_argnums=(0, 1))

    def samples(
        self, nudging: Nudging, state: State, neighbors: Neighbors, outputs: int, every: int
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Rows of a dataset (outputs * N, ...), and the series of slips and of k.

        The series are `time` (outputs,) [s], `slip` and `fine_slip` (outputs, D) W and W_r [m/s], `factor` k, and
        `correlation` of the solid fractions of the two runs over the cells [-].

        Args:
            nudging: how strongly.
            state, neighbors: to start from.
            outputs: times at which all particles are taken.
            every: coupling intervals between these.

        Raises:
            InputError: a number of `nudging` is out of its range.
            RunError: a step was not sound.
        """
        nudging.check()
        dtype = self.closure.slip.dtype
        start = _Carry(state, neighbors, jnp.zeros((), dtype), jnp.zeros((), jnp.int32))
        nudging, reference = jax.tree.map(lambda x: jnp.asarray(x, dtype), (nudging, self.reference))
        end, (rows, series) = self._run(outputs, every, (nudging, self.parameters, reference), start)
        if int(end.flags):
            remedy = "Give a longer relaxation or control, or a list with more room."
            raise RunError(f"failures {int(end.flags)} in a nudged run", "its end", 0.0, remedy)
        flat = {name: np.asarray(values).reshape(-1, *values.shape[2:]) for name, values in rows.items()}
        return flat, {name: np.asarray(values) for name, values in series.items()}

    def _all(self, outputs: int, every: int, given: _Given, start: _Carry) -> Any:
        def output(carry: _Carry, _: None) -> Any:
            def interval(_: int, own: tuple[_Carry, Any]) -> tuple[_Carry, Any]:
                return self._step(given, own[0])

            none = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(self._step, given, carry)[1])
            return lax.fori_loop(0, every, interval, (carry, none))

        return lax.scan(output, start, None, length=outputs)

    def _step(self, given: _Given, carry: _Carry) -> tuple[_Carry, tuple[dict[str, Array], dict[str, Array]]]:
        """A coupling interval, and the rows and the series at its end."""
        nudging, parameters, reference = given
        now = self.simulation.time(parameters, carry.state)
        fine, own, weights = reference.at(now), *self._own(parameters, carry.state)
        ratio = jnp.clip(own.slip @ fine.slip / jnp.sum(fine.slip**2), *RATIOS)
        log_factor = carry.log_factor + self.simulation.interval / nudging.control * jnp.log(ratio)
        slip, acceleration = self._drawn(fine, own, weights)
        even = jnp.mean(acceleration, axis=0, keepdims=True)
        push = as_column(self.grain_mass) / nudging.relaxation * (acceleration - even)
        factor, stiffness = jnp.exp(log_factor), jnp.asarray(nudging.stiffness, push.dtype)
        law = dataclasses.replace(self.closure, factor=factor, stiffness=stiffness, slip=slip, push=push)
        state, neighbors, report = self.simulation.step(parameters._replace(closure=law), carry.state, carry.neighbors)
        forces = required(report.forces, "exchange")
        inputs, count = forces.inputs, len(push)
        rows = {name: getattr(inputs, name) for name in COLUMNS} | {
            "time": jnp.full(count, now),
            "diameter": jnp.broadcast_to(inputs.diameter, count),
            "drag_force": as_column(self.closure.base(inputs).coefficient) * inputs.slip_velocity,
            "target_force": forces.drag / self.grains,
        }
        series = {"time": now, "slip": own.slip, "fine_slip": fine.slip, "factor": factor}
        series["correlation"] = jnp.corrcoef(own.solids.ravel(), fine.solids.ravel())[0, 1]
        flags = carry.flags | failures(self.simulation, report)
        return _Carry(state, required(neighbors, "neighbors"), log_factor, flags), (rows, series)

    def _own(self, parameters: Parameters, state: State) -> tuple[Mixed, Weights]:
        """The coarse run on its mesh, and the weights of its particles."""
        particles, fluid = required(state.particles, "particles"), required(state.fluid, "fluid")
        gas = jnp.stack(cell_average(fluid.face_velocity), axis=-1)
        return _on_cells(self.coupling, required(parameters.bodies, "bodies"), particles, gas)

    def _drawn(self, fine: Mixed, own: Mixed, weights: Weights) -> tuple[Array, Array]:
        """w_r and v_r - v_m at the particles, (N, D) each [m/s]."""
        d, content = self.grid.dimension, (own.solids, fine.solids)
        vectors = [part[..., axis] for part in (own.flux, fine.flux, fine.gas) for axis in range(d)]
        seen = interpolate(weights, (*content, *vectors))
        mine = seen[:, 2 : 2 + d] / seen[:, :1]
        there = seen[:, 1:2] > LEAST_SOLIDS * jnp.mean(fine.solids)
        wanted = jnp.where(there, seen[:, 2 + d : 2 + 2 * d] / jnp.where(there, seen[:, 1:2], 1.0), mine)
        return seen[:, 2 + 2 * d :] - wanted, wanted - mine


def _on_cells(
    coupling: Coupling, bodies: ParticleProperties, particles: ParticleState, gas: Array
) -> tuple[Mixed, Weights]:
    """The fields of particles beside those of the gas (cells..., D) [m/s], and the weights they are made with."""
    grid, velocity = coupling.interval.solver.grid, particles.velocity
    centres = centres_in_box(particles, grid.size, grid.periodic)
    weights = body_weights(coupling.deposition, grid, particles, centres, bodies)
    volume = jnp.broadcast_to(bodies.volume / grid.cell_volume, velocity.shape[:1])
    flux = [deposit(grid, weights, volume * velocity[:, axis]) for axis in range(grid.dimension)]
    return Mixed(gas, deposit(grid, weights, volume), jnp.stack(flux, axis=-1)), weights

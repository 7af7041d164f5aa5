"""A perfect drag closure on a coarse mesh: what error is left is the coarse fluid's own.

The particles of a fine run are led along their trajectories (cubic Hermite between the samples, by positions and
velocities), without contacts, and the coarse fluid gets the force that a closure would have to give,

    F = F_target + c (u - u_target),

F_target as in the training data (`jaxdem.train.dataset`), u_target the averaged fine velocity at the particle and c the
base law's coefficient for it, both linear in time. Where the coarse fluid is right its drag is the true one, and where
it departs the base law holds it back. Without this term (c = 0) what sampling loses of F adds up over time: on the fine
mesh itself that doubles the replay's error, on a mesh four times as coarse it hardly matters.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.closures import DRAG_LAWS
from jaxdem.closures.base import Drag, DragInputs
from jaxdem.coupling.coupled import Mixture
from jaxdem.errors import InputError
from jaxdem.fluid.grid import cell_average
from jaxdem.io import Run
from jaxdem.metrics import history_row
from jaxdem.particles.integrate import ParticleState
from jaxdem.scene import Scene, load_scene
from jaxdem.setup.time_steps import simulated_time
from jaxdem.study import read_stored
from jaxdem.train.dataset import CoarseView

FLUID_METRICS = ("fluid_pressure_mean", "fluid_velocity_mean", "fluid_velocity_median")
"""What a replay has of the nine metrics."""

HEAVY = 1e6
"""Factor on the particles' mass: a trajectory that is given does not yield to the force."""


@partial(jax.tree_util.register_dataclass, data_fields=["coefficient", "remainder"], meta_fields=[])
@dataclasses.dataclass(frozen=True, eq=False)
class GivenDrag:
    """A drag closure that gives what it was made with, whatever it sees.

    Attributes:
        coefficient: (N,) [kg/s].
        remainder: (N, D) [N].
    """

    coefficient: Array
    remainder: Array

    def __call__(self, inputs: DragInputs) -> Drag:
        """The drag."""
        return Drag(self.coefficient, self.remainder, jnp.zeros(self.coefficient.shape, bool))


@dataclasses.dataclass(frozen=True)
class Replay:
    """The coarse fluid over time.

    Attributes:
        time: (T,) [s].
        velocity: (T, cells..., D) interstitial, at the centres [m/s].
        pressure: (T, cells...) [Pa].
        void_fraction: (T, cells...) [-].
        momentum: largest difference between the impulses of particles and faces, over their size [-].
    """

    time: np.ndarray
    velocity: np.ndarray
    pressure: np.ndarray
    void_fraction: np.ndarray
    momentum: float

    def history(self) -> dict[str, np.ndarray]:
        """The fluid's metrics over time, columns (T,)."""
        rows = [
            history_row(float(t), fluid_pressure=p, fluid_velocity=u)
            for t, p, u in zip(self.time, self.pressure, self.velocity, strict=True)
        ]
        return {name: np.array([row[name] for row in rows]) for name in ("time", *FLUID_METRICS)}

    def peak_speed(self, until: float | None) -> float:
        """Mean over the outputs up to a time of the largest speed of a cell [m/s]."""
        kept = self.time <= (np.inf if until is None else until)
        speed = np.linalg.norm(self.velocity[kept], axis=-1)
        return float(np.mean(speed.reshape(len(speed), -1).max(axis=1)))


def replay(run: Run, factor: int, report: Callable[[float], None] | None = None) -> Replay:
    """A fine run's particles and forces in the fluid of a coarser mesh.

    Args:
        run: the fine run, with samples.
        factor: of the mesh; 1 is the run's own, and shows what sampling loses.
        report: called with the simulated time [s].

    Raises:
        InputError: the run has no samples, or not two at least.
    """
    if run.samples is None or len(run.samples.times) < 2:
        raise InputError("RUN", str(run.path), "holds no samples", "run it with output.samples")
    return _Track(run, load_scene(run.scene), factor).follow(report or (lambda time: None))


class _Track:
    """The replay of one run on one mesh."""

    def __init__(self, run: Run, scene: Scene, factor: int):
        assert run.samples is not None and scene.fluid is not None and scene.coupling is not None
        self.samples = run.samples
        self.outputs, self.end = scene.time.output_interval, scene.time.end
        self.view = CoarseView(scene, factor)
        self.simulation, self.parameters = self.view.simulation, self.view.parameters
        self.law = DRAG_LAWS[scene.coupling.drag]()
        self._advance = jax.jit(self._advanced)
        self._coefficient = jax.jit(lambda inputs: self.law(inputs).coefficient)

    def knot(self, number: int) -> dict[str, np.ndarray]:
        """Position, velocity and the drag to give at a sample."""
        sample, time = self.samples.frame(number), float(self.samples.times[number])
        rows = self.view.rows(sample, time)
        velocity, force = rows["particle_velocity"], rows["target_force"]
        coefficient = np.asarray(self._coefficient(self._inputs(rows)))
        # F = F_target + c (u - u_target) as c (u - v) + remainder
        remainder = force - coefficient[:, None] * (rows["fluid_velocity"] - velocity)
        return {
            "position": sample["position"], "velocity": velocity, "coefficient": coefficient, "remainder": remainder,
        }  # fmt: skip

    def follow(self, report: Callable[[float], None]) -> Replay:
        """All intervals from the first sample on, which is where the coarse fluid is the average of the fine one."""
        interval, times = self.simulation.interval, np.asarray(self.samples.times, float)
        first, last = round(times[0] / interval), round(self.end / interval)
        every = round(self.outputs / interval)
        state = self.view.fluid(self.samples.frame(0), float(times[0]))
        before, after, number = self.knot(0), self.knot(1), 0
        frames, momentum = [], 0.0
        for step in range(first, last):
            time = simulated_time(self.outputs, step, every)
            while number + 2 < len(times) and time >= times[number + 1] - 1e-6 * interval:
                number, before = number + 1, after
                after = self.knot(number + 1)
            moment = _between(before, after, (time - times[number], times[number + 1] - times[number]), interval)
            state, mismatch = self._advance(state, *moment, jnp.asarray(time, moment[0].dtype))
            momentum = max(momentum, float(mismatch))
            if (step + 1) % every == 0:
                frames.append(self._frame(simulated_time(self.outputs, step + 1, every), state))
            report(time + interval)
        fields = [np.stack(column) for column in zip(*frames, strict=True)]
        return Replay(fields[0], fields[1], fields[2], fields[3], momentum)

    def _inputs(self, rows: dict[str, np.ndarray]) -> DragInputs:
        fluid = self.parameters.fluid
        assert fluid is not None
        given: dict[str, Any] = {name: rows[name] for name in DragInputs._fields if name in rows}
        return DragInputs(
            **given,
            filter_size=jnp.asarray(self.view.coarse.filter_size, rows["fluid_velocity"].dtype),
            fluid_density=fluid.density,
            dynamic_viscosity=fluid.density * fluid.viscosity,
        )

    def _advanced(
        self, fluid: Any, position: Array, velocity: Array, coefficient: Array, remainder: Array, time: Array
    ) -> tuple[Any, Array]:
        """The fluid after an interval, and the mismatch of momentum."""
        p, coupling = self.parameters, self.simulation.coupling
        assert coupling is not None and p.bodies is not None and p.fluid is not None and p.drag_scale is not None
        nothing = jnp.zeros_like(velocity)
        particles = ParticleState(position, None, velocity, nothing[:, :0], (), (), nothing, nothing)
        bodies = p.bodies._replace(density=p.bodies.density * HEAVY)
        drag = GivenDrag(coefficient, remainder)
        mixture = Mixture(drag, p.drag_scale, p.fluid, bodies, jnp.zeros_like(p.gravity))
        fluid, _, _, report = coupling.advance(mixture, fluid, particles, time)
        return fluid, report.momentum

    def _frame(self, time: float, fluid: Any) -> tuple[Any, ...]:
        velocity = np.stack([np.asarray(u) for u in cell_average(fluid.face_velocity)], axis=-1)
        return np.asarray(time), velocity, np.asarray(fluid.pressure), np.asarray(fluid.void_fraction)


def _between(
    before: dict[str, np.ndarray], after: dict[str, np.ndarray], place: tuple[float, float], interval: float
) -> tuple[Array, ...]:
    """Position and velocity at the start of an interval, the drag at its middle; beyond the last knot as at it.

    Args:
        before, after: knots.
        place: time since the first knot, and from it to the second [s].
        interval: [s].
    """
    since, span = place
    x0, x1, v0, v1 = before["position"], after["position"], before["velocity"], after["velocity"]
    s = since / span
    if s < 1.0:
        position = (
            (1 + 2 * s) * (1 - s) ** 2 * x0
            + s**2 * (3 - 2 * s) * x1
            + span * (s * (1 - s) ** 2 * v0 - s**2 * (1 - s) * v1)
        )
        velocity = 6 * s * (1 - s) * (x1 - x0) / span + (1 - s) * (1 - 3 * s) * v0 + s * (3 * s - 2) * v1
    else:
        position, velocity = x1 + (since - span) * v1, v1
    middle = min(1.0, (since + 0.5 * interval) / span)
    drag = [(1 - middle) * before[name] + middle * after[name] for name in ("coefficient", "remainder")]
    kind = x0.dtype
    return tuple(jnp.asarray(array, kind) for array in (position, velocity, *drag))


def replay_to_file(run: Run, factor: int, out: Path, report: Callable[[float], None]) -> None:
    """`replay` written to an .npz file."""
    result = replay(run, factor, report)
    aside = out.with_suffix(".part")
    with aside.open("wb") as file:
        np.savez_compressed(file, **dataclasses.asdict(result))
    aside.replace(out)


def read_replay(path: Path) -> Replay:
    """What `replay_to_file` wrote."""
    arrays: dict[str, Any] = read_stored(path)
    return Replay(**{**arrays, "momentum": float(arrays["momentum"])})

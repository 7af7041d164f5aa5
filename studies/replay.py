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
from scipy.interpolate import CubicHermiteSpline

from jaxdem.closures import DRAG_LAWS
from jaxdem.closures.base import Drag, DragInputs
from jaxdem.errors import InputError, required
from jaxdem.fluid.fluid_state import FluidState
from jaxdem.fluid.grid import cell_average
from jaxdem.io import Run
from jaxdem.io.samples import Samples
from jaxdem.metrics import Quantities, history_row
from jaxdem.particles.integrate import ParticleState
from jaxdem.scene import Scene, load_scene
from jaxdem.setup.time_steps import simulated_time
from jaxdem.study import read_stored
from jaxdem.train.dataset import CoarseView

FLUID_METRICS = ("fluid_pressure_mean", "fluid_velocity_mean", "fluid_velocity_median")
"""What a replay has of the nine metrics."""

HEAVY = 1e6
"""Factor on the particles' mass: the fluid moves past trajectories that the force does not change."""


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
            history_row(float(t), Quantities(fluid_pressure=p, fluid_velocity=u))
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
    return _Track(run.samples, load_scene(run.scene), factor).follow(report or (lambda time: None))


class _Track:
    """The replay of one run on one mesh."""

    def __init__(self, samples: Samples, scene: Scene, factor: int):
        self.samples = samples
        self.outputs, self.end = scene.time.output_interval, scene.time.end
        self.view = CoarseView(scene, factor)
        self.interval = self.view.simulation.interval
        law = DRAG_LAWS[required(scene.coupling, "coupling").drag]()
        self._advance = jax.jit(self._advanced)
        self._coefficient = jax.jit(lambda inputs: law(inputs).coefficient)

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
        interval, times = self.interval, np.asarray(self.samples.times, float)
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
            place = (time - times[number], times[number + 1] - times[number])
            track, drag = _between(before, after, place, interval)
            state, mismatch = self._advance(state, track, drag, jnp.asarray(time, track[0].dtype))
            momentum = max(momentum, float(mismatch))
            if (step + 1) % every == 0:
                frames.append(self._frame(simulated_time(self.outputs, step + 1, every), state))
            report(time + interval)
        fields = [np.stack(column) for column in zip(*frames, strict=True)]
        return Replay(fields[0], fields[1], fields[2], fields[3], momentum)

    def _inputs(self, rows: dict[str, np.ndarray]) -> DragInputs:
        fluid = self.view.properties
        known: dict[str, Any] = {name: rows[name] for name in DragInputs._fields if name in rows}
        return DragInputs(
            **known,
            filter_size=jnp.asarray(self.view.coarse.filter_size, rows["fluid_velocity"].dtype),
            fluid_density=fluid.density,
            dynamic_viscosity=fluid.density * fluid.viscosity,
        )

    def _advanced(
        self, fluid: FluidState, track: tuple[Array, Array], drag: GivenDrag, time: Array
    ) -> tuple[FluidState, Array]:
        """The fluid after an interval, and the mismatch of momentum; `track` is position and velocity."""
        position, velocity = track
        nothing = jnp.zeros_like(velocity)
        particles = ParticleState(position, None, velocity, nothing[:, :0], (), (), nothing, nothing)
        given = self.view.parameters.mixture
        bodies = self.view.bodies._replace(density=self.view.bodies.density * HEAVY)
        mixture = given._replace(closure=drag, bodies=bodies, gravity=jnp.zeros_like(given.gravity))
        fluid, _, _, report = self.view.coupling.advance(mixture, fluid, particles, time)
        return fluid, report.momentum

    def _frame(self, time: float, fluid: FluidState) -> tuple[np.ndarray, ...]:
        velocity = np.stack([np.asarray(u) for u in cell_average(fluid.face_velocity)], axis=-1)
        return np.asarray(time), velocity, np.asarray(fluid.pressure), np.asarray(fluid.void_fraction)


def _between(
    before: dict[str, np.ndarray], after: dict[str, np.ndarray], place: tuple[float, float], interval: float
) -> tuple[tuple[Array, Array], GivenDrag]:
    """Position and velocity at the start of an interval, the drag at its middle; beyond the last knot as at it.

    Args:
        before, after: knots.
        place: time since the first knot, and from it to the second [s].
        interval: [s].
    """
    since, span = place
    if since < span:
        ends = [[knot[name] for knot in (before, after)] for name in ("position", "velocity")]
        spline = CubicHermiteSpline([0.0, span], *ends)
        position, velocity = spline(since), spline(since, 1)
    else:
        position, velocity = after["position"] + (since - span) * after["velocity"], after["velocity"]
    middle, kind = min(1.0, (since + 0.5 * interval) / span), before["position"].dtype
    drag = (jnp.asarray((1 - middle) * before[n] + middle * after[n], kind) for n in ("coefficient", "remainder"))
    return (jnp.asarray(position, kind), jnp.asarray(velocity, kind)), GivenDrag(*drag)


def replay_to_file(run: Run, factor: int, out: Path, report: Callable[[float], None]) -> None:
    """`replay` written to an .npz file."""
    result = replay(run, factor, report)
    aside = out.with_suffix(".part")
    with aside.open("wb") as file:
        np.savez_compressed(file, **dataclasses.asdict(result))
    aside.replace(out)


def read_replay(path: Path) -> Replay:
    """What `replay_to_file` wrote."""
    arrays = read_stored(path)
    momentum = float(arrays.pop("momentum"))
    return Replay(**arrays, momentum=momentum)

"""A frame of a run as arrays of a checkpoint, as far as it holds them."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from jaxdem.errors import InputError
from jaxdem.io import Run, load_run
from jaxdem.numerics.axes import AXES

NEAR = 1e-6
"""Of the output interval, by which a time may miss that of a frame."""

OF_PARTICLES = ("position", "velocity", "contact_force")


def arrays_of_frame(
    folder: Path, time: float, arrays: Mapping[str, np.ndarray], attributes: Mapping[str, Any]
) -> dict[str, Any]:
    """Arrays and attributes of a `StartPoint` at a frame.

    The cells' means of the fluid, and what it carries, stand under `cells/`: what the faces had is not in a frame.

    Args:
        folder: of the run.
        time: of the frame [s].
        arrays, attributes: of its checkpoint, which tells what the particles are.

    Raises:
        InputError: there is no frame at that time, or it does not tell which particles have come in.
    """
    run = load_run(folder)
    index = _frame_at(run, time)
    found = {name: value for name, value in arrays.items() if name.startswith(("rows/", "inlet/"))}
    reached = float(Fraction(str(attributes["time"])))
    back = round((reached - float(run.times[index])) / float(attributes["interval"]))
    found["state.step"] = np.asarray(int(arrays["state.step"]) - back, np.int32)
    dimension = len(run.scene["domain"]["size"])
    if run.has_particles:
        found |= _particles(run, index, dimension, arrays)
    flow = run.fluid(index)
    if flow is not None:
        found |= {f"cells/{name}": np.asarray(value, float) for name, value in flow.items()}
        names = [f"pressure_gradient_{axis}" for axis in AXES[dimension]]
        gradient = [run.history[name][index] if name in run.history else 0.0 for name in names]
        found["cells/gradient"] = np.asarray(gradient, float)
    exact = Fraction(repr(float(run.times[index])))
    return {"arrays": found, "attributes": {**attributes, "time": str(exact)}}


def _frame_at(run: Run, time: float) -> int:
    times = np.asarray(run.times, float)
    spacing = float(np.diff(times).min()) if len(times) > 1 else 1.0
    index = int(np.argmin(np.abs(times - time))) if len(times) else -1
    if index < 0 or abs(times[index] - time) > NEAR * spacing:
        there = f"from {times[0]:g} to {times[-1]:g} s" if len(times) else "none"
        near = f"; the nearest is at {times[index]:.9g} s" if index >= 0 else ""
        limit = f"the run {run.path} has no frame at this time: there are {len(times)}, {there}{near}"
        raise InputError("start.time", time, limit, "give the time of a frame, or leave it out for the checkpoint")
    return index


def _particles(run: Run, index: int, dimension: int, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    frame = run.particles(index)
    count = len(frame["position"])
    found = {f"state.particles.{name}": frame[name][:, :dimension] for name in OF_PARTICLES}
    spin = frame["angular_velocity"]
    found["state.particles.angular_velocity"] = spin if dimension == 3 else spin[:, 2:]
    if frame["position"].dtype != np.float64:
        found["state.particles.position_low"] = np.zeros((count, dimension), frame["position"].dtype)
    if "temperature" in frame:
        found["state.scalars.grains"] = frame["temperature"]
    if "active" in frame:
        found["state.particles.active"] = frame["active"].astype(bool)
    inserted = arrays.get("state.particles.inserted")
    if inserted is not None:
        found["state.particles.inserted"] = _inserted(run, index, count, arrays, len(inserted))
    return found


def _inserted(run: Run, index: int, count: int, arrays: Mapping[str, np.ndarray], inlets: int) -> np.ndarray:
    """How many had come in through each inlet: those seen up to the frame are all, or it cannot be told."""
    seen = np.zeros(count, bool)
    for number in range(index + 1):
        active = run.particles(number)["active"].astype(bool)
        seen[: len(active)] |= active
    found, coming = [], np.zeros(count, bool)
    for k in range(inlets):
        rows = arrays[f"inlet/{k}/rows"]
        rows = rows[rows < count]
        coming[rows] = True
        there = np.flatnonzero(seen[rows])
        found.append(int(there[-1]) + 1 if len(there) else 0)
    known = run.history["present"][index] + run.history["removed"][index] - np.count_nonzero(~coming)
    if sum(found) != round(known):
        limit = "some particles came and left between two frames, so that a frame does not tell which have come"
        raise InputError("start.time", float(run.times[index]), limit, "leave start.time out, or take another frame")
    return np.asarray(found, np.int32)

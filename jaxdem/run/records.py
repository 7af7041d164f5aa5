"""What a run writes at an output: a frame and a row of history.csv. Host side."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem import metrics
from jaxdem.closures.ensemble import EnsembleClosure
from jaxdem.coupling.exchange_result import FluidForces
from jaxdem.errors import required
from jaxdem.fluid.grid import cell_average
from jaxdem.run.instant import Instant, open_cells, wrapped_position
from jaxdem.run.parts import PARTS
from jaxdem.run.parts.clumps import inertia_of
from jaxdem.run.totals import Means
from jaxdem.setup.builder import Case

Frame = dict[str, dict[str, np.ndarray]]
"""Arrays of an output frame by name, of each series; a series that the scene has not is left out."""


def frame_of(case: Case, instant: Instant) -> Frame:
    """The output frame of an instant."""
    state, bodies, frame = instant.state, case.parameters.bodies, Frame()
    if state.particles is not None and bodies is not None:
        count = len(state.particles.position)
        frame["particles"] = {
            "position": wrapped_position(case.simulation, state.particles),
            "velocity": np.asarray(state.particles.velocity),
            "angular_velocity": np.asarray(state.particles.angular_velocity),
            "contact_force": np.asarray(state.particles.contact_force),
            "radius": np.broadcast_to(np.asarray(bodies.radius), count).copy(),
        }
    if state.fluid is not None:
        pressure, void_fraction = np.asarray(state.fluid.pressure), state.fluid.void_fraction
        faces = jax.tree.map(np.asarray, state.fluid.face_velocity)  # on the host, where nothing is compiled
        frame["fluid"] = {
            "velocity": np.stack(cell_average(faces), axis=-1),
            "pressure": pressure,
            "void_fraction": np.ones_like(pressure) if void_fraction is None else np.asarray(void_fraction),
        }
    for part in PARTS:
        for series, arrays in part.arrays(case, instant).items():
            if arrays:
                frame.setdefault(series, {}).update(arrays)
    return frame


def history_of(case: Case, instant: Instant, frame: Frame, means: Means) -> dict[str, float]:
    """The row of history.csv of an instant.

    Args:
        case: that runs.
        instant: of the frame.
        frame: the arrays that go into the metrics.
        means: since the last output.
    """
    particles, fluid, bodies = frame.get("particles"), frame.get("fluid"), case.parameters.bodies
    arrays: dict[str, np.ndarray] = {}
    collision = means.collision_force
    if particles is not None and bodies is not None:
        present = particles["active"].astype(bool) if "active" in particles else slice(None)
        names = ("position", "velocity", "angular_velocity", *(() if fluid is None else ("drag_force",)))
        arrays = {name: particles[name][present] for name in names}
        bodies = jax.tree.map(np.asarray, bodies)
        inertia = inertia_of(case, required(instant.state.particles, "particles"), bodies.inertia)
        for name, value in (("mass", bodies.mass), ("inertia", inertia)):
            arrays[name] = value[present] if value.ndim else value
        if bodies.parcels is not None:  # forces of a grain: its share of that on the parcel, as of its momentum
            if "drag_force" in arrays:
                arrays["drag_force"] = arrays["drag_force"] / bodies.parcels.grains
            collision = collision / float(bodies.parcels.grains)
    if fluid is not None:
        arrays |= {"fluid_pressure": fluid["pressure"], "fluid_velocity": fluid["velocity"]}
        room = open_cells(case, instant)
        if room is not None:  # cells that are more open than solid
            is_open = room >= 0.5
            arrays |= {name: arrays[name][is_open] for name in ("fluid_pressure", "fluid_velocity")}
    known = metrics.Quantities(collision_force=None if particles is None else collision, **arrays)
    row = metrics.history_row(instant.time, known)
    for part in PARTS:
        row |= part.columns(case, instant, means)
    return row


@jax.jit
def ensemble_spread(closure: EnsembleClosure, forces: FluidForces) -> tuple[Array, Array]:
    """Mean over the particles of the spread of the members' forces, and of the size of the ensemble's [N].

    As the closure gives them: before a drag scale, and of model A.
    """
    drag = closure(forces.inputs)
    force = drag.coefficient[:, None] * forces.inputs.slip_velocity
    if drag.remainder is not None:
        force = force + drag.remainder
    return jnp.mean(closure.spread(forces.inputs)), jnp.mean(jnp.linalg.norm(force, axis=1))

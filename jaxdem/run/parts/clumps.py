"""What a run writes of clumps beside their bodies: how they lie, and their members as spheres. Host side."""

from __future__ import annotations

import numpy as np

from jaxdem.particles.integrate import ParticleState
from jaxdem.run.instant import Instant, wrapped_position
from jaxdem.run.parts.part import Arrays, Part
from jaxdem.setup.builder import Case
from jaxdem.setup.orientations import as_given
from jaxdem.setup.shapes import ShapeTable
from jaxdem.setup.turns import turned


class ClumpBodies(Part):
    """Clumps of spheres."""

    def arrays(self, case: Case, instant: Instant) -> dict[str, Arrays]:
        """`orientation` of the axes in which the shapes are given: (N, 4) quaternion (w, x, y, z), in 2-D (N,) angle
        [rad]; and the members as particles of a series of their own."""
        table = None if case.particles is None else case.particles.shapes
        state = instant.state.particles
        if table is None or state is None or state.orientation is None:
            return {}
        shape = np.broadcast_to(case.bodies.shape, len(state.position))
        found = as_given(table, shape, _axes(state)).astype(state.position.dtype)
        orientation = found[:, 0] if table.dimension == 2 else found
        members = _spheres(table, case, state, wrapped_position(case.simulation, state))
        return {"particles": {"orientation": orientation}, "spheres": members}


def _spheres(table: ShapeTable, case: Case, state: ParticleState, centres: np.ndarray) -> Arrays:
    """The members as particles of a frame, `id` is that of their body.

    Args:
        table: the shapes.
        case: that runs.
        state: now.
        centres: (N, D) of the bodies, in the box along periodic axes; members may stand outside [m].
    """
    count = len(centres)
    bodies = type(case.bodies)(*(np.broadcast_to(column, count) for column in case.bodies))
    position, radius, body = table.placed(bodies, np.asarray(centres, float), _axes(state))
    arm = position - np.asarray(centres, float)[body]
    spin, dtype = np.asarray(state.angular_velocity, float)[body], centres.dtype
    around = (
        np.cross(spin, arm) if table.dimension == 3 else np.stack((-spin[:, 0] * arm[:, 1], spin[:, 0] * arm[:, 0]), 1)
    )
    found = {
        "id": body,
        "position": position.astype(dtype),
        "radius": radius.astype(dtype),
        "velocity": (np.asarray(state.velocity, float)[body] + around).astype(dtype),
    }
    return found if state.active is None else found | {"active": np.asarray(state.active).astype(np.uint8)[body]}


def inertia_of(case: Case, state: ParticleState, inertia: np.ndarray) -> np.ndarray:
    """() or (N,) moment of inertia about the axis of the spin, w.I w / w^2; `inertia` of spheres [kg m2]."""
    table, bodies = None if case.particles is None else case.particles.shapes, case.parameters.bodies
    if table is None or bodies is None or state.orientation is None or table.dimension == 2:
        return inertia
    return inertia_about(table, case, state)


def inertia_about(table: ShapeTable, case: Case, state: ParticleState) -> np.ndarray:
    """The same in 3-D."""
    shape = np.broadcast_to(case.bodies.shape, len(state.position))
    radius, density = (np.broadcast_to(column, len(shape)) for column in case.bodies[:2])
    size = 4.0 / 3.0 * np.pi * radius**5 * density
    moments = np.stack([one.inertia for one in table.templates])[shape] * size[:, None]
    own = turned(_axes(state) * np.asarray([1.0, -1.0, -1.0, -1.0]), np.asarray(state.angular_velocity, float)[:, None])
    squared = np.sum(own[:, 0] ** 2, axis=1)
    weighed = np.sum(moments * own[:, 0] ** 2, axis=1)
    return np.where(squared > 0.0, weighed / np.where(squared > 0.0, squared, 1.0), moments.mean(axis=1))


def _axes(state: ParticleState) -> np.ndarray:
    """Orientations of the principal axes in float64."""
    high = np.asarray(state.orientation, float)
    return high if state.orientation_low is None else high + np.asarray(state.orientation_low, float)

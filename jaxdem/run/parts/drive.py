"""What drives a periodic stream, in the history of a run. Host side."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from jaxdem.fluid.drive import bulk_velocity
from jaxdem.fluid.grid import face_average
from jaxdem.fluid.projection import open_section
from jaxdem.numerics.axes import AXES
from jaxdem.run.instant import Instant
from jaxdem.run.parts.part import Part
from jaxdem.run.totals import Means
from jaxdem.setup.builder import Case


class Drive(Part):
    """A stream along periodic axes."""

    def columns(self, case: Case, instant: Instant, means: Means) -> dict[str, float]:
        """Mean gradient of the pressure since the last output, and bulk velocity, along the axes that are driven."""
        interval, fluid = case.simulation.fluid, instant.state.fluid
        if interval is None or interval.solver.drive is None or fluid is None or fluid.mean_gradient is None:
            return {}
        grid, drive, gradient = interval.solver.grid, interval.solver.drive, means.pressure_gradient
        if gradient is None:  # gravity is that of the interval in which the gradient acted
            parameters = case.simulation.during(case.parameters, jnp.maximum(instant.state.step - 1, 0))
            gradient = np.asarray(fluid.mean_gradient + parameters.flow.density * parameters.gravity)
        whole = (1.0,) * grid.dimension
        on_faces = whole if fluid.void_fraction is None else face_average(grid, fluid.void_fraction)
        cut = case.parameters.flow.cut
        if cut is not None:
            on_faces = cut.opened(on_faces)
        bulk = np.asarray(bulk_velocity(grid, drive, fluid.face_velocity, on_faces))
        if cut is not None:  # over the open part of the cross-section
            bulk = bulk / np.asarray(open_section(grid, cut))
        axes = [(axis, name) for axis, name in enumerate(AXES[grid.dimension]) if drive.driven[axis]]
        found = {f"pressure_gradient_{name}": float(gradient[axis]) for axis, name in axes}
        return found | {f"bulk_velocity_{name}": float(bulk[axis]) for axis, name in axes}

"""The coupling interval and the fluid steps in it: the automatic ones chosen, given ones checked."""

from __future__ import annotations

import math

from jaxdem.errors import InputError
from jaxdem.fluid.interval import SUBSTEPS, VISCOUS_LIMIT
from jaxdem.scene import Scene
from jaxdem.setup import stability
from jaxdem.setup.fluid import FluidSetup, courant_limit, fluid_velocity
from jaxdem.setup.surface import fall_speed, surface_limits

LONGEST_INTERVAL = 0.01
"""Longest automatic fluid step, and interval without a fluid [s]."""

AUTO_COURANT = 0.5
"""Courant number of the automatic fluid step at the largest boundary speed."""


def given_interval(scene: Scene) -> float | None:
    """`coupling.interval` [s], None where it is automatic.

    Raises:
        InputError: it is longer than the time between outputs.
    """
    interval = "auto" if scene.coupling is None else scene.coupling.interval
    if interval == "auto":
        return None
    if interval > scene.time.output_interval * (1.0 + 1e-9):
        limit = f"must not exceed time.output_interval = {scene.time.output_interval} s"
        raise InputError("coupling.interval", interval, limit, "lower the interval")
    return interval


def fluid_steps(fluid: FluidSetup, boundary_speed: float) -> tuple[float, int, dict[str, float]]:
    """Coupling interval [s], the smallest number of fluid steps in it, and named limits of a fluid step [s].

    Args:
        fluid: of the scene.
        boundary_speed: largest that a boundary or the initial fluid imposes [m/s].

    Raises:
        InputError: a given step or interval is too long.
    """
    table, spacing, output = fluid.table, fluid.grid.spacing, fluid.scene.time.output_interval
    courant, viscosity = courant_limit(fluid.scene), table.viscosity
    if fluid.scene.surface is not None:
        viscosity = max(viscosity, fluid.scene.surface.viscosity)
    limits = {
        "courant": stability.courant_time(boundary_speed, spacing, courant),
        "viscous": stability.viscous_time(viscosity, spacing, VISCOUS_LIMIT),
    } | surface_limits(fluid.scene, spacing)
    stable, what = min((limit, name.replace("_", " ")) for name, limit in limits.items() if name != "courant")
    if table.time_step != "auto":
        step = table.time_step
    else:
        speed = max(boundary_speed, fall_speed(fluid.scene, fluid.grid, fluid.kept))
        automatic = stability.courant_time(speed, spacing, min(AUTO_COURANT, courant))
        step = min(automatic, stable, output, LONGEST_INTERVAL)
    interval = given_interval(fluid.scene)
    if interval is None:
        if step > output * (1.0 + 1e-9):
            limit = f"must not exceed time.output_interval = {output} s"
            raise InputError("fluid.time_step", step, limit, "lower the fluid step")
        interval = output / whole(output / step)
    substeps = _substeps_for(interval, step, stable, what)
    _check_courant(fluid, interval)
    return interval, substeps, limits


def whole(ratio: float) -> int:
    """The ratio rounded up to a whole number, unless it is one up to round-off."""
    return max(1, math.ceil(ratio - 1e-9 * max(ratio, 1.0)))


def _substeps_for(interval: float, fluid_step: float, stable: float, what: str) -> int:
    """Smallest number of fluid steps in an interval; refuses what 8 of them cannot do.

    `stable` is the longest step by what limits it, the viscosity or the waves of a surface [s].
    """
    longest = min(fluid_step, stable)
    for count in SUBSTEPS:
        if count >= interval / longest - 1e-6:
            return count
    allowed = SUBSTEPS[-1] * longest
    raise InputError(
        "fluid.time_step" if stable < fluid_step else "coupling.interval",
        interval,
        f"a coupling interval has at most {SUBSTEPS[-1]} fluid steps, so it is at most {allowed:.4g} s here "
        f"({what} limit {stable:.4g} s)",
        f"set coupling.interval or fluid.time_step to {allowed:.3g} or less, or use larger cells",
    )


def _check_courant(fluid: FluidSetup, interval: float) -> None:
    """Refuses an interval in which the initial fluid, or an inlet, certainly passes more cells than 8 steps may."""
    scene, spacing = fluid.scene, fluid.grid.spacing
    rates = [sum(abs(u) / h for u, h in zip(fluid_velocity(scene), spacing, strict=True))]
    for number, name in enumerate(scene.sides):
        side, axis = scene.boundary[name], number // 2
        others = [h for a, h in enumerate(spacing) if a != axis]
        # A patch of two cells holds one whole face of a cell; a profile or a table may be anything in between.
        patch = side.from_ is None or side.to is None
        holds_face = patch or all(
            b - a >= 2.0 * h for a, b, h in zip(side.from_ or (), side.to or (), others, strict=True)
        )
        velocity = side.velocity
        even = side.kind == "inlet" and side.profile == "uniform" and scene.time.end >= (side.ramp_time or 0.0)
        if holds_face and even and isinstance(velocity, tuple):
            rates.append(abs(velocity[axis]) / spacing[axis])
    courant = courant_limit(scene)
    limit = SUBSTEPS[-1] * courant
    allowed = limit / max(*rates, 1e-300)
    if interval > allowed * (1.0 + 5e-4):
        raise InputError(
            "coupling.interval" if given_interval(scene) is not None else "fluid.time_step",
            interval,
            f"the fluid crosses {interval * max(rates):.3g} cells in this time; {SUBSTEPS[-1]} fluid steps with a "
            f"Courant number of {courant} allow {limit:.3g}",
            f"set it to {allowed:.3g} or less, or use larger cells",
        )

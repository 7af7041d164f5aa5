"""The probes of a scene, and when they measure."""

from __future__ import annotations

import math
from collections.abc import Callable

from jaxdem.errors import InputError
from jaxdem.probes.base import Probe, Schedule, ScheduledProbe
from jaxdem.probes.plane import PlaneProbe
from jaxdem.scene import Scene
from jaxdem.scene import probes as described
from jaxdem.scene.probes import AXIS_NAMES
from jaxdem.structure import TimeSteps


def scene_probes(scene: Scene, steps: TimeSteps) -> tuple[ScheduledProbe, ...]:
    """The probes of a scene.

    Args:
        scene: the scene.
        steps: of it.

    Raises:
        InputError: a time of a probe is no multiple of the coupling interval.
    """
    return tuple(
        ScheduledProbe(BUILDERS[probe.kind](scene, probe), _schedule(f"probes.{k}", probe, steps.interval))
        for k, probe in enumerate(scene.probes)
    )


def _schedule(key: str, probe: described.Probe, interval: float) -> Schedule:
    def intervals(name: str, time: float | None, default: int) -> int:
        if time is None:
            return default
        number = round(time / interval)
        if abs(number * interval - time) > 1e-6 * time or (number == 0 and name != "begin"):
            near = max(number, 1) * interval
            limit = f"must be a multiple of the coupling interval, {interval:.6g} s"
            raise InputError(f"{key}.{name}", time, limit, f"use, for example, {near:.6g}")
        return number

    every = intervals("interval", probe.interval, 1)
    window = intervals("window", probe.window, every) if probe.average else 1
    return Schedule(
        intervals("begin", probe.begin, 0), every, window, intervals("sample_interval", probe.sample_interval, 1)
    )


def _plane(scene: Scene, probe: described.Probe) -> PlaneProbe:
    axes = AXIS_NAMES[scene.dimension]
    has = scene.particles is not None, scene.fluid is not None
    if probe.normal is not None and probe.point is not None:
        size = math.hypot(*probe.normal)
        normal = tuple(component / size for component in probe.normal)
        offset = sum(n * x for n, x in zip(normal, probe.point, strict=True))
        return PlaneProbe(probe.name, axes, None, normal, offset, None, None, True, False)
    axis = axes.index(probe.axis or "")
    normal = tuple(float(k == axis) for k in range(scene.dimension))
    return PlaneProbe(probe.name, axes, axis, normal, probe.at or 0.0, probe.from_, probe.to, *has)


BUILDERS: dict[str, Callable[[Scene, described.Probe], Probe]] = {"plane": _plane}
"""By kind, what makes the probe of a scene."""

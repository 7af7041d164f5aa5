"""Particles of a scene for the fluid of another program."""

from __future__ import annotations

import dataclasses
from typing import Literal, Unpack

from jaxdem.closures.base import DragClosure
from jaxdem.coupling.coupled import Coupling
from jaxdem.errors import InputError
from jaxdem.external import ExternalFluid
from jaxdem.fluid.external import ExternalInterval
from jaxdem.scene import Scene
from jaxdem.setup.builder import build_case
from jaxdem.setup.extensions import Extensions
from jaxdem.setup.given import require_one_stage
from jaxdem.state import Parameters


def external_fluid(
    scene: Scene,
    placement: Literal["cells", "faces"] = "cells",
    pressure: Literal["reduced", "total"] = "reduced",
    closure: DragClosure | None = None,
    **extensions: Unpack[Extensions],
) -> tuple[ExternalFluid, Parameters]:
    """The particles of a scene, to be coupled to a fluid that another program solves; and the parameters.

    `[fluid]` gives the mesh of the fields, the model of the equations, density and viscosity; `coupling.interval` is
    the time from one exchange to the next. The state to start from is that of
    `jaxdem.initial_state(scene, fluid, parameters)`; it has no fluid.

    Args:
        scene: from `jaxdem.load_scene`.
        placement: "cells" or "faces": where vector fields stand, see `ExternalFluid`.
        pressure: "reduced" or "total": what `FluidFields.pressure_gradient` is the gradient of, see `ExternalFluid`.
        closure: as of `jaxdem.build`.
        extensions: as of `jaxdem.build`.

    Raises:
        InputError: the scene lacks particles or a fluid, or asks for what needs the fluid of jaxdem.
    """
    require_one_stage(scene)
    for name, value, known in (
        ("placement", placement, ("cells", "faces")),
        ("pressure", pressure, ("reduced", "total")),
    ):
        if value not in known:
            raise InputError(name, value, f"is none of {' and '.join(known)}", "use one of them")
    if scene.surface is not None:
        limit = "is of a fluid that jaxdem solves, and this one is not"
        raise InputError("surface", "...", limit, "remove [surface]")
    if scene.heat is not None or scene.scalars:
        key = "heat" if scene.heat is not None else "scalars"
        raise InputError(key, "...", "needs the fluid of jaxdem, which carries it", f"remove [{key}]")
    case = build_case(scene, closure, **extensions)
    simulation = case.simulation
    if simulation.coupling is None:
        raise InputError("scene", None, "has no exchange between fluid and particles", "add [particles] and [fluid]")
    if simulation.coupling.drag.coarse_inputs is not None:
        factor = None if scene.coupling is None else scene.coupling.drag_inputs_coarsened
        limit = "averages the flux and the pressure over cells, which needs the fluid of jaxdem"
        raise InputError("coupling.drag_inputs_coarsened", factor, limit, "set it to 1")
    parts = {field.name: getattr(simulation, field.name) for field in dataclasses.fields(simulation)}
    parts |= {"fluid": None, "coupling": _without_steps(simulation.coupling, collocated=placement == "cells")}
    return ExternalFluid(**parts, placement=placement, pressure=pressure), case.parameters


def _without_steps(coupling: Coupling, collocated: bool) -> Coupling:
    """The exchange with a fluid that takes no steps here, whose vector fields stand in the cells or on the faces."""
    interval = coupling.interval
    solver = dataclasses.replace(
        interval.solver, grid=dataclasses.replace(interval.solver.grid, collocated=collocated), drive=None
    )
    given = ExternalInterval(solver, interval.duration, 1, interval.courant_limit)
    return dataclasses.replace(coupling, interval=given)

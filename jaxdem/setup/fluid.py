"""The fluid of a scene: its mesh, and the steps of an interval on it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from jaxdem.fluid.advection import AdvectionScheme, Central, CentralFourth, Superbee, Upwind, VanLeer
from jaxdem.fluid.boundary import Boundary
from jaxdem.fluid.cut_two_fluids import CutTwoFluidSolver
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.interval import FluidInterval
from jaxdem.fluid.momentum import FluidSolver
from jaxdem.fluid.openings import Opening
from jaxdem.fluid.two_fluids import TwoFluidSolver
from jaxdem.fluid.volume_of_fluid import SURFACE_COURANT
from jaxdem.scene import Scene
from jaxdem.scene.fluid import Fluid
from jaxdem.setup.boundaries import check_flow
from jaxdem.setup.drive import drive_of
from jaxdem.setup.surface import KeptLiquid
from jaxdem.structure import TimeSteps

ADVECTION: dict[str, Callable[[], AdvectionScheme]] = {
    "limited": VanLeer,
    "superbee": Superbee,
    "central": Central,
    "central_4": CentralFourth,
    "upwind": Upwind,
}


@dataclasses.dataclass(frozen=True)
class FluidSetup:
    """The fluid of a scene, and what several builders need of it.

    Attributes:
        scene: that it belongs to.
        table: its table `[fluid]`.
        grid: its mesh.
        kept: liquid of the run that it goes on with; None where it begins anew, or there is one fluid.
    """

    scene: Scene
    table: Fluid
    grid: Grid
    kept: KeptLiquid | None = None


def fluid_setup(scene: Scene, kept: KeptLiquid | None = None) -> FluidSetup | None:
    """The fluid of a scene, with the liquid that it keeps of a run; None in a scene without."""
    if scene.fluid is None:
        return None
    depth = scene.domain.depth if scene.dimension == 2 else 1.0
    return FluidSetup(
        scene, scene.fluid, Grid(scene.fluid.cells, scene.domain.size, depth or 1.0, scene.periodic), kept
    )


def fluid_velocity(scene: Scene) -> tuple[float, ...]:
    """(D,) velocity of the fluid at the start, zero in a scene without one [m/s]."""
    velocity = None if scene.fluid is None else scene.fluid.velocity
    return velocity or (0.0,) * scene.dimension


def fluid_interval(
    fluid: FluidSetup, boundary: Boundary, steps: TimeSteps, surfaces: int = 0, openings: tuple[Opening, ...] = ()
) -> FluidInterval:
    """Solver and fluid steps of a coupling interval; `surfaces` is the number of surfaces that the fluid sees,
    `openings` are the inlets and outlets on them.

    Raises:
        InputError: no incompressible fluid can flow through these sides.
    """
    table = fluid.table
    check_flow(fluid.scene, fluid.grid, boundary, openings)
    viscous = table.viscosity > 0.0 or table.smagorinsky > 0.0 or table.bed_mixing is not None
    drive = drive_of(fluid.scene, table)
    parts = fluid.grid, boundary, ADVECTION[table.advection](), viscous, table.model, drive
    if fluid.scene.surface is not None:
        oblique = fluid.scene.domain.oblique_gravity
        if surfaces:
            beside_walls = CutTwoFluidSolver(*parts, surfaces=surfaces, oblique_gravity=oblique)
            return FluidInterval(beside_walls, steps.interval, steps.fluid_substeps, courant_limit(fluid.scene))
        two = TwoFluidSolver(*parts, has_tension=fluid.scene.surface.tension > 0.0, oblique_gravity=oblique)
        return FluidInterval(two, steps.interval, steps.fluid_substeps, courant_limit(fluid.scene))
    solver = FluidSolver(
        *parts,
        surfaces=surfaces,
        keeps_flux=fluid.scene.heat is not None or bool(fluid.scene.scalars),
        openings=openings,
    )
    return FluidInterval(solver, steps.interval, steps.fluid_substeps, table.courant_limit)


def courant_limit(scene: Scene) -> float:
    """Largest Courant number of a fluid step; with two fluids also that of the transport of their surface [-]."""
    given = 1.0 if scene.fluid is None else scene.fluid.courant_limit
    return given if scene.surface is None else min(given, SURFACE_COURANT)

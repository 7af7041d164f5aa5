"""The table `[fluid]`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from jaxdem.scene.base import (
    Abscissae,
    Finite,
    Fraction,
    NonNegative,
    Positive,
    Section,
    Vector,
    VectorOverTime,
    check_over_time,
    per_axis,
    row_or_rows,
    wrong,
)
from jaxdem.scene.bed_mixing import BedMixing

Cells = Annotated[
    tuple[Annotated[int, Field(ge=1, le=100_000, strict=True)], ...],
    Field(min_length=2, max_length=3),
    AfterValidator(per_axis),
]


Held = Annotated[tuple[Finite | Literal["free"], ...], AfterValidator(per_axis)]


Bulk = Annotated[Annotated[Held, Tag("row")] | Annotated[tuple[Held, ...], Tag("rows")], Discriminator(row_or_rows)]


class Fluid(Section):
    """The fluid and its mesh.

    Attributes:
        cells: number of cells per axis.
        density: density of the fluid [kg/m3].
        viscosity: kinematic viscosity [m2/s].
        model: volume-averaged equations. "A": pressure gradient and viscous stress act on fluid and particles, in
            proportion to their volumes. "B": they act on the fluid alone, and the drag is divided by the void fraction.
        smagorinsky: coefficient of Smagorinsky's subgrid viscosity, usually 0.1 to 0.2; 0 for none [-].
        bed_mixing: table with the mixing length of a turbulent stream over a bed of grains or a rough floor, whose
            eddies are all modelled: {von_karman, packed_solid_fraction}; {} for its defaults. Default: none.
        subgrid: file of a learned subgrid stress, written by `jaxdem finetune --subgrid`.
        time_step: fluid step. "auto" is a Courant number of 0.5 at the largest boundary speed, but at most 0.01 s [s].
        advection: advection scheme. "limited" is second order with van Leer's limiter. "superbee" has less numerical
            diffusion. "central" (second order) has no numerical diffusion and "central_4" (fourth order) very little,
            but both make waves beside steep gradients. These three are for meshes that hardly resolve the flow.
            "upwind" is first order.
        courant_limit: largest Courant number of a fluid step. A longer step is halved, up to three times [-].
        velocity: initial interstitial velocity, one number per axis. Default: at rest [m/s].
        pressure_gradient: mean gradient of the pressure along periodic axes, one number per axis: a negative one drives
            the fluid forwards. With `drive_times` one such list for each time. Gravity along a periodic axis drives the
            fluid as well. Default: 0 [Pa/m].
        bulk_velocity: volume flow over the cross-section along periodic axes, one number per axis, or "free" for an
            axis that is not held. The pressure gradient that holds it is a result: `pressure_gradient_x` and so on of
            history.csv. With `drive_times` one such list for each time [m/s].
        drive_times: increasing times for `pressure_gradient` and `bulk_velocity`. Linear between them, constant before
            the first and after the last [s].
    """

    cells: Cells
    density: Positive = 1000.0
    viscosity: NonNegative = 1e-6
    model: Literal["A", "B"] = "A"
    smagorinsky: Fraction = 0.0
    bed_mixing: BedMixing | None = None
    subgrid: str | None = None
    time_step: Positive | Literal["auto"] = "auto"
    advection: Literal["limited", "superbee", "central", "central_4", "upwind"] = "limited"
    courant_limit: Annotated[float, Field(gt=0.0, le=1.0, strict=True)] = 0.7
    velocity: Vector | None = None
    pressure_gradient: VectorOverTime | None = None
    bulk_velocity: Bulk | None = None
    drive_times: Abscissae | None = None

    @model_validator(mode="after")
    def _drive(self) -> Fluid:
        """One value for each axis; with times one such list for each."""
        given = {name: getattr(self, name) for name in ("pressure_gradient", "bulk_velocity")}
        given = {name: value for name, value in given.items() if value is not None}
        for name, value in given.items():
            check_over_time("drive_times", self.drive_times, name, value)
        if self.drive_times is not None and not given:
            remedy = "give one of them, or remove drive_times"
            raise wrong("drive_times", self.drive_times, "needs pressure_gradient or bulk_velocity", remedy)
        return self

    @model_validator(mode="after")
    def _one_model_of_eddies(self) -> Fluid:
        """Smagorinsky's viscosity, the mixing length over a bed and the learned stress model the same eddies."""
        given = [self.bed_mixing is not None, self.smagorinsky > 0.0, self.subgrid is not None]
        keys = ("bed_mixing", "smagorinsky", "subgrid")
        first, *others = [key for key, there in zip(keys, given, strict=True) if there] or [""]
        if others:
            limit = f"models the same unresolved eddies as fluid.{others[0]}"
            raise wrong(first, getattr(self, first), limit, f"remove fluid.{first} or fluid.{others[0]}")
        if self.subgrid is not None and self.viscosity == 0.0:
            limit = "the inputs of fluid.subgrid include a Reynolds number of the cells, which needs a viscosity"
            raise wrong("viscosity", 0.0, limit, "set fluid.viscosity to a value above 0")
        return self

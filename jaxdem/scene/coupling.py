"""The tables `[coupling]` and `[closure]`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, field_validator, model_validator

from jaxdem.errors import InputError
from jaxdem.scene.base import Abscissae, NonNegative, Positive, Section, check_table, wrong
from jaxdem.scene.unread import ReadWith


def _window(value: int) -> int:
    if value == 1:
        limit = "the window of the Basset force must have at least 2 intervals"
        raise ValueError(f"{limit}; with 20 the error of the remaining history is small")
    return value


BassetWindow = Annotated[int, Field(ge=0, le=1000, strict=True), AfterValidator(_window)]
"""Number of coupling intervals, 0 for no Basset force."""


class Width(Section):
    """Half-width of the deposition kernel, per axis: the larger of a multiple of the diameter d and of the cell side h.

    Attributes:
        diameters: multiple of the diameter d, see `coupling.kernel_diameter` [-].
        cells: multiple of the cell side h [-].
    """

    diameters: NonNegative = 1.5
    cells: Annotated[float, Field(ge=0.0, le=20.0, strict=True)] = 1.0

    @model_validator(mode="after")
    def _positive(self) -> Width:
        if self.diameters == 0.0 and self.cells == 0.0:
            raise ValueError("diameters and cells must not both be zero")
        return self


class Coupling(Section):
    """Exchange of forces between particles and fluid.

    Attributes:
        drag: name of the drag law, one of `jaxdem.closures.DRAG_LAWS`.
        drag_factor: factor on the drag law, 1 for the law as it is, 0 for no drag; with `drag_times` one for each time.
            The other forces of the fluid and the void fraction stay as they are [-].
        drag_times: increasing times for `drag_factor`. Linear between them, constant before the first and after the
            last [s].
        void_fraction: how the volume of particles is distributed over the cells: "kernel" (triangular kernel), "centre"
            (all in the cell of the centre), "divided" (by the volume in each cell) or "diffusion" (divided, then
            smoothed).
        kernel_width: half-width of the kernel: {diameters, cells}, or one number for both multiples; see
            `kernel_diameter`. For "diffusion": half-width of the triangular kernel that has the same variance as the
            Gaussian.
        kernel_diameter: whose diameter the kernel's width counts: that of the "largest" grain, so that all grains have
            one kernel, or each grain's "own".
        polydisperse: whether the drag law is taken at the local mean diameter (Sauter's) and shared out among the sizes
            (van der Hoef, Beetstra & Kuipers). Without it each grain has the law at its own diameter.
        interval: coupling interval, the time between two exchanges; particles enter and leave at its end. It must
            divide `time.output_interval`. "auto" is the fluid step. In a scene without [fluid] this is the only key of
            the table, and "auto" divides `time.output_interval` into equal parts of at most 0.01 s [s].
        lift: list of lift forces: "saffman_mei" (in a shear flow), "magnus" (of a rotating particle).
        rotational_drag: whether the fluid exerts a torque on the particles.
        virtual_mass: coefficient of the virtual mass; 0 for none, 0.5 for a sphere.
        basset: number of coupling intervals for which the Basset force uses the exact kernel; 0 for no Basset force.
        self_disturbance: whether the particle's own wake is removed from the slip that the drag law receives (3-D, with
            void_fraction = "kernel").
        own_volume: what a parcel (`particles.coarse_grain`) sees of its own volume in the solid fraction that the drag
            law receives: "parcel", all of it; "grain", as much as one of its grains, so that at random places the mean
            is that of the grains.
        drag_inputs_coarsened: the drag law receives the fluid averaged to a mesh with this many times fewer cells per
            axis, through the kernel of that mesh; 1 for the mesh of the fluid.
        deconvolution: coefficient a of the velocity u - a h^2 lap(u) that the drag law receives. It restores a part of
            what coarse cells and kernels filter out; 0 for the filtered velocity.
    """

    drag: str = "koch_hill"
    drag_factor: NonNegative | tuple[NonNegative, ...] = 1.0
    drag_times: Abscissae | None = None
    void_fraction: Literal["kernel", "centre", "divided", "diffusion"] = "kernel"
    kernel_width: Annotated[Width, ReadWith(".void_fraction = kernel", ".void_fraction = diffusion")] = Width()
    kernel_diameter: Annotated[Literal["largest", "own"], ReadWith(".void_fraction = kernel")] = "largest"
    interval: Positive | Literal["auto"] = "auto"
    lift: tuple[Literal["saffman_mei", "magnus"], ...] = ()
    rotational_drag: bool = Field(default=False, strict=True)
    virtual_mass: Annotated[NonNegative, Field(le=10.0)] = 0.0
    basset: BassetWindow = 0
    self_disturbance: bool = Field(default=False, strict=True)
    polydisperse: bool = Field(default=False, strict=True)
    own_volume: Annotated[Literal["parcel", "grain"], ReadWith("particles.coarse_grain")] = "parcel"
    drag_inputs_coarsened: Annotated[int, Field(ge=1, le=1000, strict=True)] = 1
    deconvolution: NonNegative = 0.0

    @field_validator("lift")
    @classmethod
    def _each_once(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(value)) < len(value):
            raise ValueError("names a lift law twice; name each once")
        return value

    @field_validator("kernel_width", mode="before")
    @classmethod
    def _one_number(cls, value: object) -> object:
        if isinstance(value, int | float) and not isinstance(value, bool):
            return {"diameters": value, "cells": value}
        return value

    @field_validator("drag", mode="before")
    @classmethod
    def _spelling(cls, value: object) -> object:
        return value.strip().lower().replace("-", "_").replace(" ", "_") if isinstance(value, str) else value

    @model_validator(mode="after")
    def _factor_over_time(self) -> Coupling:
        """One factor, or one for each of the times."""
        given = self.drag_factor if isinstance(self.drag_factor, tuple) else None
        check_table("drag_times", self.drag_times, "drag_factor", given)
        return self

    @model_validator(mode="after")
    def _one_kernel_where_it_counts(self) -> Coupling:
        """What stands on the filter of one kernel knows no other."""
        if self.kernel_diameter == "own":
            for key in ("self_disturbance", "deconvolution"):
                if getattr(self, key):
                    limit = f"with coupling.{key}, which is for one kernel of all grains"
                    raise wrong("kernel_diameter", "own", limit, f'set it to "largest", or remove coupling.{key}')
        return self

    @model_validator(mode="after")
    def _wake_is_known(self) -> Coupling:
        """The correction by a particle's own wake, only where that is known."""
        if not self.self_disturbance:
            return self
        if self.deconvolution > 0.0:
            limit = "would amplify a particle's own wake, which coupling.self_disturbance removes"
            remedy = "set coupling.deconvolution = 0 or coupling.self_disturbance = false"
            raise wrong("deconvolution", self.deconvolution, limit, remedy)
        if self.void_fraction != "kernel":
            limit = f'is only possible with coupling.void_fraction = "kernel", here it is "{self.void_fraction}"'
            raise wrong("self_disturbance", True, limit, "change one of the two keys")
        if self.drag_inputs_coarsened > 1:
            limit = "the wake of a particle is not known on averaged fields"
            remedy = "set coupling.self_disturbance = false"
            raise wrong("drag_inputs_coarsened", self.drag_inputs_coarsened, limit, remedy)
        return self


class Closure(Section):
    """A learned drag closure.

    Attributes:
        file: closure file written by `jaxdem train`, of any recipe; it is used in place of `coupling.drag`.
        hold: of a closure of neighbours, coupling intervals for which what the neighbours add is held; 1 finds it anew
            in each, a larger number takes so many times less time [-].
    """

    file: str | None = None
    hold: Annotated[int, Field(ge=1, le=1000, strict=True)] = 1

    def given(self) -> list[str]:
        """Names of the keys that differ from their defaults."""
        return [name for name, field in type(self).model_fields.items() if getattr(self, name) != field.default]


def check_on_mesh(coupling: Coupling, cells: tuple[int, ...], samples: float) -> None:
    """Refuses what the mesh, or the samples of a run, leave no sense to."""
    factor, key = coupling.drag_inputs_coarsened, "coupling.drag_inputs_coarsened"
    if coupling.self_disturbance and len(cells) == 2:
        limit = "needs three dimensions: in 2-D a steady wake grows with the box (Stokes' paradox)"
        raise InputError("coupling.self_disturbance", True, limit, "set it to false, or make the scene 3-D")
    if factor > max(cells):
        limit = f"would leave a single cell of the mesh {cells}"
        raise InputError(key, factor, limit, f"lower it to at most {max(cells)}")
    if coupling.drag_factor != 1.0 and samples > 0.0:
        limit = "training samples are only written for a drag law as it is"
        raise InputError("coupling.drag_factor", coupling.drag_factor, limit, "set output.samples = 0")
    if factor > 1 and samples > 0.0:
        limit = "training samples are only written for a drag law that uses the mesh of the fluid"
        raise InputError(key, factor, limit, "set output.samples = 0")


def coupling_without_fluid(coupling: Coupling | None) -> Coupling:
    """What is left of the coupling in a scene of particles alone: the interval."""
    coupling = coupling or Coupling()
    for name in sorted(coupling.model_fields_set - {"interval"}):
        limit = "needs [fluid]; without a fluid the only key of [coupling] is coupling.interval"
        raise InputError(f"coupling.{name}", getattr(coupling, name), limit, "remove this key, or add [fluid]")
    return coupling

"""How fluid and particles of a scene act on each other: deposition, corrections of the drag law, further forces."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import jax
import numpy as np

from jaxdem.coupling.coarse_inputs import CoarseInputs
from jaxdem.coupling.coupled import Coupling
from jaxdem.coupling.deposition import Centre, Deposition, Diffusion, Divided, Kernel, OwnKernel
from jaxdem.coupling.drag import DragModel
from jaxdem.coupling.forces import FORCES, Basset, FluidForce, RotationalDrag, VirtualMass
from jaxdem.coupling.forces.lift import Lift
from jaxdem.coupling.kernel import KernelWidth, cells_under
from jaxdem.coupling.self_disturbance import LARGEST_STOKES_SHARE, SelfDisturbance, kernel_mobility
from jaxdem.coupling.surroundings import Surroundings
from jaxdem.errors import InputError
from jaxdem.fluid.boundary import Boundary
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.interval import FluidInterval
from jaxdem.fluid.remap import coarsened
from jaxdem.scene.coupling import Coupling as CouplingTable
from jaxdem.setup.deconvolution import deconvolution_limit

LIFT_LAWS: dict[str, Callable[[], FluidForce]] = {kind.name: kind for kind in FORCES if issubclass(kind, Lift)}
MOST_KERNEL_CELLS = 8000
"""A cube of 20: each takes some operations of the program, which would not be compiled within minutes."""


def fluid_coupling(
    table: CouplingTable,
    fluid: FluidInterval,
    diameter: float,
    surroundings: Surroundings | None = None,
    own: Sequence[FluidForce] = (),
    wide: bool = False,
) -> Coupling:
    """The exchange between fluid and particles.

    Args:
        table: `[coupling]` of the scene.
        fluid: solver and its steps.
        diameter: of the largest particle [m].
        surroundings: finds the neighbours for a drag law that asks for them.
        own: forces of the user beside those of the scene.
        wide: whether the drag law asks for the solid fraction of three cells along every axis.

    Raises:
        InputError: the kernel is too wide or too narrow for what is wanted, or two forces have one name.
    """
    if table.polydisperse and surroundings is not None:
        limit = "a closure of neighbours has learned what grains of one size do to each other"
        raise InputError("coupling.polydisperse", True, limit, "remove this key, or take a correlation")
    grid = fluid.solver.grid
    deposition = _deposition(table, grid, diameter)
    drag = DragModel(
        fluid.solver.model,
        _self_disturbance(table, deposition, grid, diameter) if table.self_disturbance else None,
        _coarse_inputs(table, grid, fluid.solver.boundary, diameter, wide) if table.drag_inputs_coarsened > 1 else None,
        _deconvolution(table, deposition, grid),
        surroundings,
        table.polydisperse,
        table.own_volume == "grain",
        wide,
    )
    return Coupling(fluid, deposition, drag, _named_once((*_further_forces(table), *own)))


ROWS = 7
"""Particles for which the memory of a force of the user is looked at."""


def check_own_forces(own: Sequence[FluidForce], dimension: int, has_surface: bool) -> None:
    """Refuses forces of the user among two fluids, and those whose memory could not move with the particles.

    Args:
        own: the forces.
        dimension: of the scene.
        has_surface: whether it has two fluids.

    Raises:
        InputError: the scene has two fluids, or an array that a force remembers has not the shape (..., N, C).
    """
    if own and has_surface:
        limit = "know the density and viscosity of one fluid alone, and the scene has two"
        raise InputError("forces", [force.name for force in own], limit, "leave them out, or remove [surface]")
    for force in own:
        kept = jax.eval_shape(force.start, jax.ShapeDtypeStruct((ROWS, dimension), np.float32))
        for path, leaf in jax.tree_util.tree_leaves_with_path(kept):
            if len(leaf.shape) < 2 or leaf.shape[-2] != ROWS:
                name = f"forces.{force.name}.start{jax.tree_util.keystr(path)}"
                limit = f"what a force remembers of N particles is of the shape (..., N, C); for N = {ROWS} it is this"
                raise InputError(name, leaf.shape, limit, "give one number a particle as an array (N, 1)")


def _named_once(forces: tuple[FluidForce, ...]) -> tuple[FluidForce, ...]:
    """Forces whose means and memories can be told apart."""
    names = [force.name for force in forces]
    for k, name in enumerate(names):
        if name in ("drag", "contact", *names[:k]):
            raise InputError("forces", name, "is the name of another force", "give the class another name")
    return forces


def _further_forces(table: CouplingTable) -> tuple[FluidForce, ...]:
    """The forces beside drag, pressure gradient and viscous force."""
    forces: list[FluidForce] = [LIFT_LAWS[name]() for name in table.lift]
    if table.rotational_drag:
        forces.append(RotationalDrag())
    if table.virtual_mass > 0.0:
        forces.append(VirtualMass(table.virtual_mass))
    if table.basset:
        forces.append(Basset(table.basset))
    return tuple(forces)


def _deposition(table: CouplingTable, grid: Grid, diameter: float) -> Deposition:
    if table.void_fraction == "centre":
        return Centre((0.0,) * grid.dimension)
    if table.void_fraction == "divided":
        return Divided((0.5 * diameter,) * grid.dimension)
    width = KernelWidth(table.kernel_width.diameters, table.kernel_width.cells)
    half_width = width.half_widths(grid, diameter)
    for axis, (half, length) in enumerate(zip(half_width, grid.size, strict=True)):
        # Two cells and a half-width on either side must not meet themselves round a periodic box.
        if grid.periodic[axis] and 2.0 * half + 2.0 * grid.spacing[axis] > length:
            raise _width_error(
                table,
                f"the kernel is {2.0 * half:.4g} m wide, too much for a periodic side of {length:.4g} m",
                "narrow the kernel, or use more cells along that side",
            )
    if table.void_fraction != "kernel":
        return Diffusion(half_width)
    reached = math.prod(cells_under(half, h) for half, h in zip(half_width, grid.spacing, strict=True))
    if reached > MOST_KERNEL_CELLS:
        raise _width_error(
            table,
            f"the kernel of a particle reaches {reached:.3g} cells, and may reach {MOST_KERNEL_CELLS:,}",
            'narrow the kernel, use fewer cells, or set coupling.void_fraction = "diffusion", which allows any width',
        )
    if table.kernel_diameter == "own":
        return OwnKernel(half_width, width)
    return Kernel(half_width)


def _self_disturbance(table: CouplingTable, deposition: Deposition, grid: Grid, diameter: float) -> SelfDisturbance:
    correction = SelfDisturbance(kernel_mobility(deposition.half_width, grid.spacing))
    hidden = 3.0 * math.pi * diameter * correction.mobility
    if hidden > LARGEST_STOKES_SHARE:
        needed = hidden / LARGEST_STOKES_SHARE * max(deposition.half_width)
        raise _width_error(
            table,
            f"the wake of a particle hides {100 * hidden:.3g} % of its slip with Stokes drag, and "
            f"coupling.self_disturbance corrects up to {100 * LARGEST_STOKES_SHARE:.3g} %",
            f"widen the kernel to a half-width of about {needed:.3g} m",
        )
    return correction


def _width_error(table: CouplingTable, limit: str, remedy: str) -> InputError:
    width = table.kernel_width
    return InputError("coupling.kernel_width", {"diameters": width.diameters, "cells": width.cells}, limit, remedy)


def _coarse_inputs(table: CouplingTable, grid: Grid, boundary: Boundary, diameter: float, wide: bool) -> CoarseInputs:
    coarse = coarsened(grid, table.drag_inputs_coarsened)
    deposition = _deposition(table, coarse, diameter)
    of_grain = table.own_volume == "grain"
    return CoarseInputs(coarse, boundary, deposition, _deconvolution(table, deposition, coarse), of_grain, wide)


def _deconvolution(table: CouplingTable, deposition: Deposition, grid: Grid) -> float:
    """The strength of the deconvolution, if it is stable with these kernels on this mesh [-]."""
    if table.deconvolution == 0.0:
        return 0.0
    width = deposition.half_width if table.void_fraction == "kernel" else (0.0,) * grid.dimension
    limit = deconvolution_limit(width, grid.spacing)
    if table.deconvolution > limit:
        raise InputError(
            "coupling.deconvolution",
            table.deconvolution,
            "in a dense pack the flow would grow from step to step; the limit with these cells and kernels is "
            f"{limit:.3g}",
            "lower it, or widen coupling.kernel_width",
        )
    return table.deconvolution

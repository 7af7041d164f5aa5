"""Along which axis a box is cut into slabs, and what makes an axis unfit. Host, numpy."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxdem.coupling.coupled import Coupling
from jaxdem.coupling.halo import halo_layers
from jaxdem.errors import InputError
from jaxdem.fluid.grid import Grid
from jaxdem.fluid.two_fluids import TwoFluidSolver
from jaxdem.numerics.axes import AXES
from jaxdem.numerics.blocks import Blocks
from jaxdem.particles.migration import NARROWEST
from jaxdem.simulation import Simulation

STRAY = 0.5
"""How far particles may be out of their slab at the end of an interval, over the largest diameter."""

EVEN = 1.25
"""Axes are as good as each other whose fullest slabs have numbers of particles up to this ratio apart."""

LEAST_CELLS = 2
"""Cells of a slab along the cut axis, at least: advection looks two cells beyond its ends."""

OF_TWO_FLUIDS = 4
"""Cells of a slab along the cut axis, of two fluids, are a multiple of it: two levels of the multigrid cycle after the
finest one stay in slabs, and the columns of the curvature reach no farther than the next slab."""


def slabs_of(simulation: Simulation, number: int, position: np.ndarray | None, axis: int | None = None) -> Blocks:
    """The slabs of a box.

    Without a fluid the axis along which the particles reach farthest is cut, at planes that move. With one all slabs
    have equally many cells: of the axes that can be so cut it is one along which the fullest slab has few particles,
    and among these the one with the most cells, so that few cells stand at borders.

    Args:
        simulation: on one device.
        number: of slabs.
        position: (N, D) of the particles at the start; None for none [m].
        axis: that is to be cut, None for the best.

    Raises:
        InputError: no axis can be cut into so many slabs.
    """
    names, axes = AXES[len(simulation.box)], range(len(simulation.box)) if axis is None else [axis]
    reasons = {a: _unfit(simulation, number, a) for a in axes}
    fit = [a for a in axes if reasons[a] is None]
    if not fit:
        found = "; ".join(f"along {names[a]} {reason[0]}" for a, reason in reasons.items() if reason is not None)
        counts = sorted({most for reason in reasons.values() if reason is not None for most in reason[1]}, reverse=True)
        possible = f"use {counts[0]} devices" if counts and counts[0] > 1 else "use one device"
        raise InputError("devices", number, f"the box cannot be cut into {number} slabs: {found}", possible)
    if simulation.fluid is None:
        extent = np.asarray(simulation.box)
        if position is not None and len(position) > 1:
            extent = np.ptp(position, axis=0)
        chosen = max(fit, key=lambda a: extent[a])
    else:
        cells = simulation.fluid.solver.grid.cells
        fullest = {a: _fullest(simulation, number, position, a) for a in fit}
        even = [a for a in fit if fullest[a] <= EVEN * min(fullest.values())]
        chosen = max(even, key=lambda a: cells[a])
    return Blocks(number, chosen, simulation.periodic[chosen])


def drift_of(simulation: Simulation) -> float:
    """How far particles, of clumps their members, may stand outside of their slab when an interval begins [m]."""
    return 0.0 if simulation.contact is None else STRAY * simulation.search.geometry.cutoff + simulation.search.arm


def ghosts_by_size(simulation: Simulation) -> bool:
    """Whether ghosts are chosen by their sizes: with a list by levels of size. Bonds may be longer than such a list
    reaches; with them grains are ghosts as far as the largest ones reach."""
    return simulation.contact is not None and simulation.search.levels is not None and not simulation.search.bonds


def _fullest(simulation: Simulation, number: int, position: np.ndarray | None, axis: int) -> int:
    """Most particles in one of the slabs of equal width across an axis."""
    if position is None or not len(position):
        return 0
    slab = np.clip(np.floor(position[:, axis] / simulation.box[axis] * number), 0, number - 1).astype(int)
    return int(np.bincount(slab).max())


def _unfit(simulation: Simulation, number: int, axis: int) -> tuple[str, list[int]] | None:
    """Why an axis cannot be cut into so many slabs, with numbers that it can be cut into; None where it can."""
    others = [n for n in range(2, number) if _reason(simulation, n, axis) is None]
    reason = _reason(simulation, number, axis)
    return None if reason is None else (reason, others)


def _reason(simulation: Simulation, number: int, axis: int) -> str | None:
    if number == 1:
        return None
    if simulation.contact is not None:
        search, width = simulation.search, simulation.box[axis] / number
        least, contacts = NARROWEST * search.body_reach, search.geometry.cutoff
        if width < least:
            arms = f", the arms of clumps {2.0 * search.arm:.4g} m" if search.arm else ""
            return (
                f"slabs of {width:.4g} m would be narrower than {least:.4g} m, twice as far as particles are looked "
                f"for: contacts of the largest reach {contacts:.4g} m, contact.skin adds "
                f"{search.body_reach - contacts - 2.0 * search.arm:.4g} m{arms}"
            )
    if simulation.fluid is None:
        return None
    solver = simulation.fluid.solver
    reason = _uneven(solver.grid, number, axis, "fluid.cells")
    if reason is None and isinstance(solver, TwoFluidSolver) and solver.grid.cells[axis] // number % OF_TWO_FLUIDS:
        reason = (
            f"the {solver.grid.cells[axis]} cells of fluid.cells are no multiple of {OF_TWO_FLUIDS * number}: with two "
            f"fluids the cells of every slab are one of {OF_TWO_FLUIDS}"
        )
    coupling = simulation.coupling
    if reason is not None or coupling is None:
        return reason
    reason = _too_far(simulation, coupling, number, axis)
    if reason is not None:
        return reason
    return _too_narrow(simulation.fluid.solver.grid, coupling, number, axis, drift_of(simulation))


def _uneven(grid: Grid, number: int, axis: int, key: str) -> str | None:
    """Why the cells of a mesh cannot be divided evenly."""
    cells = grid.cells[axis]
    if cells % number:
        nearest = sorted({max(LEAST_CELLS, cells // number) * number, (cells // number + 1) * number})
        return f"the {cells} cells of {key} are no multiple of it (such as {' or '.join(map(str, nearest))})"
    if cells // number < LEAST_CELLS:
        return f"the {cells} cells of {key} are fewer than {LEAST_CELLS} for each slab"
    return None


def _too_far(simulation: Simulation, coupling: Coupling, number: int, axis: int) -> str | None:
    """Why a drag law would look at particles beyond the neighbouring slab; of two slabs none is beyond."""
    around = coupling.drag.surroundings
    if around is None or number == 2:
        return None
    width, least = simulation.box[axis] / number, around.reach + 2.0 * drift_of(simulation)
    if width >= least:
        return None
    return f"slabs of {width:.4g} m would be narrower than the {least:.4g} m within which closure.file sees neighbours"


def _too_narrow(grid: Grid, coupling: Coupling, number: int, axis: int, drift: float) -> str | None:
    """Why particles would reach beyond the neighbouring slab, on the mesh or on the coarser one of the drag law."""
    meshes = [(grid, coupling.deposition)]
    coarse = coupling.drag.coarse_inputs
    if coarse is not None:
        reason = _uneven(coarse.grid, number, axis, "the mesh of coupling.drag_inputs_coarsened")
        if reason is not None:
            return reason
        meshes.append((coarse.grid, coarse.deposition))
    for mesh, deposition in meshes:
        layers = halo_layers(dataclasses.replace(mesh, drift=drift), deposition.half_width, axis)
        if layers > mesh.cells[axis] // number:
            return (
                f"slabs of {mesh.cells[axis] // number} cells would be narrower than the {layers} cells beyond them "
                "that particles reach with coupling.kernel_width"
            )
    return None

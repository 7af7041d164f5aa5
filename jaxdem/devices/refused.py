"""Which axis of a box is cut, and what does not work on several devices: refused by name before work starts."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from jaxdem.errors import InputError
from jaxdem.numerics.blocks import Blocks
from jaxdem.particles.migration import NARROWEST
from jaxdem.simulation import Simulation


def require_divisible(simulation: Simulation) -> None:
    """Refuses a simulation with something that does not work on several devices.

    Raises:
        InputError: naming it.
    """
    found = None
    if simulation.contact is not None and simulation.contact.model.meshes:
        found = "walls", "kind = mesh", "with walls that are meshes"
    if simulation.population is not None:
        found = "particles.inlet", "given", "with particles that come in or leave"
    elif simulation.contact is not None and simulation.contact.model.wet:
        found = "contact.cohesion.kind", "capillary", "with liquid bridges"
    if found is not None:
        key, value, what = found
        raise InputError(key, value, f"several devices do not work {what} yet", "run it on one device")


def chosen_blocks(simulation: Simulation, number: int, position: np.ndarray | None, axis: int | None) -> Blocks:
    """The slabs of a box.

    Args:
        simulation: on one device.
        number: of slabs.
        position, axis: see `divided`.

    Raises:
        InputError: no axis can be cut so often.
    """
    box = np.asarray(simulation.box)
    extent = box
    if simulation.fluid is None and position is not None and len(position) > 1:
        extent = np.ptp(position, axis=0)
    possible = [a for a in range(len(box)) if axis in (None, a)]
    order = sorted(possible, key=lambda a: -extent[a])
    if simulation.fluid is not None:
        cells = simulation.fluid.solver.grid.cells
        even = [a for a in order if cells[a] % number == 0]
        if not even:
            longest = order[0]
            near = sorted({number * max(1, math.floor(cells[longest] / number)), number * -(-cells[longest] // number)})
            limit = f"along axis {longest} the cells must be a multiple of the number of devices, {number}"
            raise InputError("fluid.cells", cells, limit, f"use {' or '.join(map(str, near))} there, or other devices")
        order = even
        if position is not None and len(position):  # the slabs have equal numbers of cells
            order = sorted(even, key=lambda a: _fullest(position[:, a], float(box[a]), number))
    chosen = order[0]
    least = _least_width(simulation, chosen)
    most = max(1, int(box[chosen] / least)) if least else number
    if number > most:
        limit = f"a slab must be {least:.4g} m wide, so that axis {chosen} can be cut for {most} devices"
        raise InputError("devices", number, limit, f"use {most} devices, or a box that is longer there")
    return Blocks(number, chosen, simulation.periodic[chosen])


def _fullest(along: np.ndarray, length: float, number: int) -> int:
    """Most particles of a slab, of slabs of one width."""
    return int(np.bincount(np.floor(along * (number / length)).astype(int).clip(0, number - 1)).max())


def _least_width(simulation: Simulation, axis: int) -> float:
    """A slab must be so wide that what is in it meets particles and cells of the two neighbours alone [m]."""
    if simulation.contact is None:
        return 0.0
    least = NARROWEST * simulation.search.reach
    if simulation.half_width is not None:
        least = max(least, simulation.half_width[axis] + simulation.search.geometry.cutoff)
    return least


def require_plain_run(asked: Mapping[str, tuple[bool, object, str]]) -> None:
    """Refuses what a run does beside its steps, and cannot do on several devices.

    Args:
        asked: by key or option, whether the run asks for it, its value, and a remedy.

    Raises:
        InputError: it asks for one.
    """
    for key, (given, value, remedy) in asked.items():
        if given:
            limit = "does not work on several devices yet"
            raise InputError(key, value, limit, f"{remedy}, or run on one device")

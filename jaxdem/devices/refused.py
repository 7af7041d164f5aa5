"""Which axis of a box is cut, and what does not work on several devices: refused by name before work starts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from jaxdem.coupling.forces.protocol import FluidForce
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
    coupling, contact = simulation.coupling, simulation.contact
    remembers = None if coupling is None else next((f.label for f in coupling.forces if _remembers(f)), None)
    if simulation.population is not None and remembers is not None:
        found = "particles.inlet", remembers, "where particles come in or leave and a force of the fluid has a memory"
    elif contact is not None and contact.model.meshes:
        found = "walls", "kind = mesh", "with walls that are meshes"
    elif contact is not None and contact.model.wet:
        found = "contact.cohesion.kind", "capillary", "with liquid bridges, which share the liquid of a grain"
    if found is not None:
        key, value, what = found
        raise InputError(key, value, f"several devices do not work {what}", "run it on one device")


def _remembers(force: FluidForce) -> bool:
    return type(force).start is not FluidForce.start


def chosen_blocks(simulation: Simulation, number: int, position: np.ndarray | None, axis: int | None) -> Blocks:
    """The slabs of a box.

    Args:
        simulation: on one device.
        number: of slabs.
        position, axis: see `divided`.

    Raises:
        InputError: no axis can be cut so often.
    """
    box, fluid = np.asarray(simulation.box), simulation.fluid
    places = np.zeros((0, len(box))) if position is None else position
    extent = np.ptp(places, axis=0) if len(places) > 1 and fluid is None else box
    order = sorted((a for a in range(len(box)) if axis in (None, a)), key=lambda a: -extent[a])
    slabs = {a: _most_slabs(simulation, a, number) for a in order}
    wide = [a for a in order if slabs[a] >= number]
    if not wide:
        best = max(order, key=lambda a: slabs[a])
        limit = (
            f"a slab must be {_least_width(simulation, best):.4g} m wide, so axis {best} can be cut for {slabs[best]}"
        )
        raise InputError("devices", number, limit, f"use at most {slabs[best]} devices, or a larger box")
    if fluid is None:
        return Blocks(number, wide[0], simulation.periodic[wide[0]])
    cells = fluid.solver.grid.cells
    even = [a for a in wide if cells[a] % number == 0]
    if not even:
        near = sorted({number * max(1, cells[wide[0]] // number), number * -(-cells[wide[0]] // number)})
        limit = f"along axis {wide[0]} the cells must be a multiple of the number of devices, {number}"
        raise InputError("fluid.cells", cells, limit, f"use {' or '.join(map(str, near))} there, or other devices")
    chosen = even[0]
    if len(places):  # the slabs have equal numbers of cells
        chosen = min(even, key=lambda a: _fullest(places[:, a], float(box[a]), number))
    return Blocks(number, chosen, simulation.periodic[chosen])


def _most_slabs(simulation: Simulation, axis: int, number: int) -> int:
    """Most slabs that an axis can be cut into; `number` where nothing limits them."""
    least = _least_width(simulation, axis)
    return max(1, int(simulation.box[axis] / least)) if least else number


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

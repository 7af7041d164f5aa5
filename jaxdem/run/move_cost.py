"""What it costs to send particles to other slabs and make the lists anew, as a move of the cut planes does."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from jaxdem.devices import DividedSimulation, counts
from jaxdem.devices.mesh import on_host, put
from jaxdem.errors import required
from jaxdem.particles.neighbors import Neighbors
from jaxdem.run.chunk import Program, SlabProgram
from jaxdem.run.probing import Watch
from jaxdem.state import State

TRIES = 3
"""The least of them is taken."""

FAR = 2.5
"""By so much more than particles may be out of their slab the planes are moved."""


def with_move_cost(
    summary: dict[str, Any], program: Program, state: State, neighbors: Neighbors | None, watch: Watch | None
) -> dict[str, Any]:
    """The summary with the seconds of one move, and of all moves of the cut planes so far; as it is where no plane
    moves, or no particle stands where the planes are put for this.

    The program of the run does an interval of a single contact step, once as it is and once with all planes beside
    where they are, so that particles have to go; the difference is what a move takes. Nothing of it is kept.

    Args:
        summary: of a run.
        program: of the run; every process must call this.
        state, neighbors: after an interval.
        watch: the probes that the program was made with.
    """
    if not isinstance(program, SlabProgram) or neighbors is None or "devices" not in summary:
        return summary
    simulation = program.simulation
    if simulation.contact is None or simulation.slabs.number == 1 or not simulation.division.balanced:
        return summary
    cuts = counts(neighbors).cuts
    _, state, neighbors = program.one_step(state, neighbors, watch)  # who was about to go has gone
    beside, before = _planes_moved(simulation, neighbors), counts(neighbors).migrations

    def tried(lists: Neighbors) -> tuple[float, int]:
        """Seconds, and how often particles went; the state is let go, as there may be no memory for several."""
        seconds, _, then = program.one_step(state, lists, watch)
        return seconds, counts(then).migrations - before

    took = [(tried(neighbors), tried(beside)) for _ in range(TRIES)]
    (_, stray), (_, sent) = took[-1]
    if stray or not sent:
        return summary
    least = [min(seconds for seconds, _ in tries) for tries in zip(*took, strict=True)]
    move = max(least[1] - least[0], 0.0)
    return summary | {"devices": summary["devices"] | {"move_s": move, "cuts_s": move * cuts}}


def _planes_moved(simulation: DividedSimulation, neighbors: Neighbors) -> Neighbors:
    """The list of slabs whose cut planes are elsewhere by `FAR`."""
    ghosts, mesh = required(neighbors.ghosts, "ghosts of a list"), required(simulation.mesh, "mesh")
    way = FAR * simulation.division.stray * simulation.search.geometry.cutoff
    planes = np.asarray(on_host(ghosts.planes))
    moved: Any = put(mesh, (planes + way).astype(planes.dtype))
    return dataclasses.replace(neighbors, ghosts=dataclasses.replace(ghosts, planes=moved))

"""How long the program of a run takes to compile with an empty cache, from what is in it. Host side, plain numbers."""

from __future__ import annotations

import math

from jaxdem.fluid.two_fluids import TwoFluidSolver
from jaxdem.simulation import Simulation

GRAINS = {2: 4.0, 3: 16.0}
"""The contact steps and the neighbour list, by dimension [s of a core]."""

FURTHER_WALLS = 0.5
"""Each further set of walls that are there together, over the first [-]: it has a contact loop of its own."""

ENERGY = 1.4
"""With the balance of energy over without [-]."""

FLUID, SECOND_FLUID, CUT_MESH, EXCHANGE = 8.0, 10.0, 14.0, 13.0
"""The steps of one fluid, what a second fluid adds, the mesh that walls cut, the exchange with grains [s of a core]."""


def compile_seconds(simulation: Simulation) -> float:
    """About the processor time that XLA needs for the program of a run [s].

    A sum over its parts, from the processor time of runs of one coupling interval (one busy core of an AMD EPYC): chute
    4 s, cavity 8, dam break 19, injection 25, pier 39, slide into a lake 55; 3-D grains 16, with a gate 25, with the
    balance of energy 22, with a fluid 38. Learned closures, meshes, bonds, clumps, heat and a pack that settles first
    add to it.
    """
    dimension, found = len(simulation.box), 0.0
    contact, fluid = simulation.contact, simulation.fluid
    if contact is not None:
        times = contact.model.wall_times
        sets = 1 if times is None else len(set(times.phases))
        found += GRAINS[dimension] * (1.0 + FURTHER_WALLS * (sets - 1)) * (ENERGY if contact.model.energy else 1.0)
    if fluid is not None:
        solver = fluid.solver
        found += FLUID + SECOND_FLUID * isinstance(solver, TwoFluidSolver) + CUT_MESH * (solver.surfaces > 0)
        found += EXCHANGE * (simulation.coupling is not None)
    return math.ceil(found)

"""How long a run will take, from costs that were measured. Host side, plain numbers."""

from __future__ import annotations

import dataclasses
import math

import jax

from jaxdem.check.compile_cost import compile_seconds
from jaxdem.fluid.two_fluids import TwoFluidSolver
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.usual_room import USUAL_PAIRS, USUAL_SLOTS
from jaxdem.simulation import Simulation


@dataclasses.dataclass(frozen=True)
class Costs:
    """Measured costs of a kind of device [s].

    Attributes:
        launch: of a contact step, whatever its size.
        particle, pair, slot: of a contact step, for each particle, each pair of the list and each slot of a particle,
        by
            dimension.
        fluid_launch: of a fluid step, whatever its size.
        cell: of a fluid step, for each cell, by dimension.
        exchange: of a coupling interval, for each particle.
        among_grains: of a fluid step among grains over one without: more iterations, and further fluid steps where it
            is fast.
        output: of a frame, its files and its share of checkpoints.
        compiling: over what `compile_seconds` says of a processor [-].
        basis: where the figures are from.
    """

    launch: float
    particle: dict[int, float]
    pair: dict[int, float]
    slot: dict[int, float]
    fluid_launch: float
    cell: dict[int, float]
    exchange: float
    among_grains: float
    output: float
    compiling: float
    basis: str


TWO_FLUIDS = 1.9
"""A fluid step with two fluids over one with one fluid, on a processor: `benchmarks/surface.py`."""

CPU = Costs(
    launch=40e-6,
    particle={2: 35e-9, 3: 60e-9},
    pair={2: 18e-9, 3: 50e-9},
    slot={2: 1.1e-9, 3: 3e-9},
    fluid_launch=0.2e-3,
    cell={2: 100e-9, 3: 350e-9},
    exchange=1e-6,
    among_grains=2.0,
    output=0.1,
    compiling=1.0,
    basis="one core of an AMD EPYC, AVX2",
)

GPU = Costs(
    launch=37e-6,
    particle={2: 0.2e-9, 3: 0.25e-9},
    pair={2: 0.1e-9, 3: 0.15e-9},
    slot={2: 0.01e-9, 3: 0.02e-9},
    fluid_launch=0.3e-3,
    cell={2: 0.5e-9, 3: 0.9e-9},
    exchange=1e-9,
    among_grains=2.0,
    output=0.1,
    compiling=1.2,
    basis="an NVIDIA H100",
)

FACTOR = 3.0
"""Within which the estimate lies; machines, load, lists that are renewed and solves that take longer make it up."""


@dataclasses.dataclass(frozen=True)
class RunCost:
    """Estimated times [s], without compiling.

    Attributes:
        contacts: of all contact steps.
        fluid: of all fluid steps and exchanges.
        output: of all frames.
        compiling: before, with an empty cache, about.
        over_equal: cost of a contact step over that of as many equal grains, from the pairs that the list holds [-].
        slots: neighbours of one grain that the list has room for.
        basis: machine of the measured costs.
    """

    contacts: float
    fluid: float
    output: float
    compiling: float
    over_equal: float
    slots: int
    basis: str

    @property
    def total(self) -> float:
        """Of the run [s]."""
        return self.contacts + self.fluid + self.output


def run_cost(simulation: Simulation, neighbors: Neighbors | None) -> RunCost:
    """The estimate for a run on the device that JAX has.

    Args:
        simulation: of the scene.
        neighbors: its first list, which says how many pairs a step goes through.
    """
    costs = CPU if jax.default_backend() == "cpu" else GPU
    steps, dimension = simulation.steps, len(simulation.box)
    intervals = steps.outputs * steps.intervals_per_output
    contacts, fluid, over_equal, slots, count = 0.0, 0.0, 1.0, 0, 0
    if neighbors is not None:
        count = neighbors.reference[0].shape[0]
        slots = neighbors.room.slots

        def of_step(pairs: float, places: float) -> float:
            lists = costs.particle[dimension] * count + costs.pair[dimension] * pairs
            return costs.launch + lists + costs.slot[dimension] * places * count

        rows = neighbors.room.rows
        places = slots if rows is None else rows.width * (1.0 + rows.further / count)
        step = of_step(neighbors.room.pairs, places)
        everyone = 0.5 * count * (count - 1)
        equal = of_step(min(USUAL_PAIRS[dimension] * count, everyone), min(USUAL_SLOTS[dimension], count - 1))
        contacts, over_equal = intervals * steps.contacts_per_interval * step, step / equal
    if simulation.fluid is not None:
        cells = math.prod(simulation.fluid.solver.grid.cells)
        step = steps.fluid_substeps * (costs.fluid_launch + costs.cell[dimension] * cells)
        step *= TWO_FLUIDS if isinstance(simulation.fluid.solver, TwoFluidSolver) else 1.0
        fluid = intervals * (step * (costs.among_grains if count else 1.0) + costs.exchange * count)
    output = costs.output * (steps.outputs + 1)
    compiling = costs.compiling * compile_seconds(simulation)
    return RunCost(contacts, fluid, output, compiling, over_equal, slots, costs.basis)

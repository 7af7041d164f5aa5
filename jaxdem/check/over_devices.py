"""What a scene will be on several devices, before it runs: who has what, what is sent, and whether it pays."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Mapping

import jax
import numpy as np

from jaxdem.check.run_cost import CPU, GPU, RunCost, run_cost
from jaxdem.check.walls_in_fluid import OF_BODIES, OF_CELLS, bytes_of, sent_for_walls
from jaxdem.devices.bonds import require_in_reach
from jaxdem.devices.cut import ghosts_by_size, slabs_of
from jaxdem.devices.rooms import SlabRoom, equal_planes, ghosts_of, listed_spheres, needed_room, slab_of
from jaxdem.errors import InputError, required
from jaxdem.fluid.multigrid import FEW, STEPS
from jaxdem.fluid.two_fluids import TwoFluidSolver
from jaxdem.numerics.blocks import Blocks
from jaxdem.particles.ghosts import Division
from jaxdem.particles.integrate import ParticleState
from jaxdem.particles.list_room import list_room
from jaxdem.particles.migration import NARROWEST
from jaxdem.particles.neighbors import Neighbors
from jaxdem.setup.builder import Case
from jaxdem.state import State

WORKING_COPIES = 3
"""Copies of a state that a compiled step is taken to need: before, after, and in between."""

LATENCY = {"cpu": 0.15e-3, "gpu": 20e-6}
"""Of the messages of a contact step, both directions [s]: measured between two processes over gloo, and assumed between
cards of one host."""

BANDWIDTH = {"cpu": 1e9, "gpu": 50e9}
"""At which they go on [B/s]; the same."""

WORTH = 0.8
"""More devices do not help where a step does not become shorter than so much of that on half of them."""

MOST = 1024
"""Numbers of devices up to this one are looked at."""

LONG = 120.0
"""A run is long enough to tell that several processes are faster if its contacts take so long [s]."""


@dataclasses.dataclass(frozen=True)
class DeviceReport:
    """A scene on several devices; estimates.

    Attributes:
        number: of devices.
        axis: of the box that is cut.
        particles: of every device at the start.
        ghosts: of every device: particles of its neighbours.
        cells: of every device; 0 without a fluid.
        sent: by every device in a contact step, in an iteration of the pressure, and at most in an interval to cut the
            mesh of the fluid anew, where walls change their place in it [B].
        memory: of every device while running [B].
        imbalance: particles of the fullest device at the start over their mean number; 1 is even [-].
        shorter: a contact step on one device over one on these [-]; None without particles.
        useful: number of devices up to which twice as many are worth it; None without particles.
    """

    number: int
    axis: int
    particles: tuple[int, ...]
    ghosts: tuple[int, ...]
    cells: int
    sent: tuple[int, int, int]
    memory: int
    imbalance: float
    shorter: float | None
    useful: int | None


def check_devices(
    case: Case, number: int, state: State, neighbors: Neighbors | None, memory: Mapping[str, int]
) -> DeviceReport:
    """The report on so many devices.

    Args:
        case: the scene.
        number: of devices.
        state, neighbors: at the start; of the list shapes are enough.
        memory: of the parts of the state on one device [B].

    Raises:
        InputError: something in the scene does not work on several devices, or no axis can be cut so often.
    """
    listed = neighbors
    one_reach = case.simulation.contact is not None and case.simulation.search.levels is None
    if neighbors is not None and one_reach and case.simulation.search.members == 1 and neighbors.radius.ndim:
        listed = _list_of_slabs(case, required(state.particles, "state.particles"))
        memory = {**memory, "neighbour list": bytes_of(listed.without_surfaces())}
    simulation = case.simulation
    position = None if case.particles is None else case.particles.position
    blocks = slabs_of(simulation, number, position)
    cells = 0
    if simulation.fluid is not None:
        cells = math.prod(simulation.fluid.solver.grid.cells) // number
    of_fluid = _pressure_bytes(case, blocks), sent_for_walls(case, blocks, state)
    if state.particles is None or neighbors is None or listed is None:
        each = _memory(case, memory, 0.0, number)
        return DeviceReport(number, blocks.axis, (), (), cells, (0, *of_fluid), each, 1.0, None, None)
    counts, ghosts, room = _spread(case, blocks, state)
    require_in_reach(simulation.search, required(case.parameters.bodies, "parameters.bodies"), state.particles.bonds)
    sent = 2 * (room.ghosts * _ghost_bytes(state.particles) + 4)
    rows = (room.rows + 2 * room.ghosts) / max(len(state.particles.position), 1)
    lists, most = (neighbors, listed), max(ghosts)  # lists on one device, and in slabs
    times = {
        devices: _step_time(case, lists[devices > 1], sent, most, devices, _fullest(case, blocks, state, devices))
        for devices in (1, number, *(2**k for k in range(int(math.log2(MOST)) + 1)))
    }
    widest = simulation.box[blocks.axis] / (NARROWEST * simulation.search.body_reach)
    useful = 1
    while 2 * useful <= min(MOST, widest) and times[2 * useful] < WORTH * times[useful]:
        useful *= 2
    return DeviceReport(
        number,
        blocks.axis,
        tuple(map(int, counts)),
        tuple(map(int, ghosts)),
        cells,
        (sent, *of_fluid),
        _memory(case, memory, rows, number),
        float(max(counts) * number / max(sum(counts), 1)),
        float(times[1] / times[number]),
        useful,
    )


def _ghost_bytes(particles: ParticleState) -> int:
    """What is sent of a ghost in a contact step: position, velocity, spin, how it lies, the velocity that a contact
    step expects, and one number [B]."""
    dimension, bonds = particles.position.shape[1], particles.bonds
    low = 0 if particles.position_low is None else dimension
    turned = 0 if bonds is None else len(jax.tree.leaves((bonds.orientation, bonds.orientation_low)))
    turned += sum(x.shape[1] for x in jax.tree.leaves((particles.orientation, particles.orientation_low)))
    values = 3 * dimension + particles.angular_velocity[0].size + low + turned
    return int(values * particles.position.dtype.itemsize)


def processes_that_pay(
    case: Case, state: State, neighbors: Neighbors | None, memory: Mapping[str, int], cost: RunCost
) -> DeviceReport | None:
    """The scene in as many processes as are worth it on the cores of this machine.

    Returns:
        None where one process is as good: a short run, one of which the fluid is the larger part, one core, another
        device than a CPU, or a scene that does not work on several devices.
    """
    if jax.default_backend() != "cpu" or cost.contacts < max(LONG, cost.fluid):
        return None
    if not hasattr(os, "sched_setaffinity"):  # with which processes are bound to cores
        return None
    number, report = len(os.sched_getaffinity(0)), None
    while number > 1 and report is None:
        try:
            report = check_devices(case, number, state, neighbors, memory)
        except InputError:  # not on so many: too narrow slabs, cells that are no multiple
            number //= 2
            continue
        useful = report.useful or 1
        if useful < number:
            number, report = useful, None
    return report


def _list_of_slabs(case: Case, particles: ParticleState) -> Neighbors:
    """Shapes of the list on one device with the pairs that slabs have: all that the largest grains would have in
    reach."""
    spheres = listed_spheres(case.simulation, case.parameters, particles)
    wide = list_room(case.simulation.search, spheres.position, spheres.active)
    room = dataclasses.replace(wide, mesh=case.simulation.room(case.parameters, particles).mesh)
    return case.simulation.list_shapes(case.parameters, particles, room)


def _spread(case: Case, blocks: Blocks, state: State) -> tuple[np.ndarray, np.ndarray, SlabRoom]:
    """Particles and ghosts of every slab at the start, and the room for them."""
    simulation, search = case.simulation, case.simulation.search
    particles = required(state.particles, "state.particles")
    balanced, by_size = simulation.fluid is None, ghosts_by_size(simulation)
    division = Division(blocks, simulation.box[blocks.axis], 0.0, balanced, by_size)
    position = np.asarray(particles.position, float)
    if particles.active is not None:
        position = position[np.asarray(particles.active)]
    position = np.where(simulation.periodic, np.mod(position, simulation.box), position)
    along = position[:, blocks.axis]
    planes = division.length * np.arange(1, blocks.number) / blocks.number
    if division.balanced:
        planes = equal_planes(division, search, along)
    counts = np.bincount(slab_of(planes, along), minlength=blocks.number)
    spheres = listed_spheres(simulation, case.parameters, particles)
    ghosts = ghosts_of(division, spheres, along, planes)
    return counts, ghosts, needed_room(division, spheres, position, planes, spheres.whole_room())


def _memory(case: Case, memory: Mapping[str, int], rows: float, number: int) -> int:
    """Of every device while running [B]: of particles so many rows over all that there are, of fluid, scalars and the
    mesh that walls cut its share, and in whole the meshes, and what particles are where they differ."""
    of_rows, of_cells, of_each = (
        sum(memory.get(part, 0) for part in parts)
        for parts in (
            ("particles", "neighbour list", "kernel weights"), ("fluid", "scalars", OF_CELLS), ("meshes", OF_BODIES)
        )
    )  # fmt: skip
    own = WORKING_COPIES * (rows * of_rows + of_cells / number + of_each)
    sizes = [leaf for leaf in jax.tree.leaves(case.parameters.bodies) if leaf.ndim]
    return int(own + sum(leaf.size * leaf.dtype.itemsize for leaf in sizes))


def _fullest(case: Case, blocks: Blocks, state: State, number: int) -> float:
    """Share of the particles on the fullest of so many devices at the start: an even one where the slabs move."""
    particles = required(state.particles, "state.particles")
    along = np.asarray(particles.position, float)[:, blocks.axis]
    if particles.active is not None:
        along = along[np.asarray(particles.active)]
    if case.simulation.fluid is None or not len(along):
        return 1.0 / number
    length = case.simulation.box[blocks.axis]
    slab = np.clip(np.floor(np.mod(along, length) / length * number), 0, number - 1).astype(int)
    return float(np.bincount(slab).max() / len(along))


def _pressure_bytes(case: Case, blocks: Blocks) -> int:
    """Sent by a device in an iteration of the pressure: the layer beside each border, and the slab for the transform
    along the cut axis, there and back; of two fluids the layers of all levels at most, and a level as a whole [B]."""
    fluid = case.simulation.fluid
    if fluid is None:
        return 0
    cells = math.prod(fluid.solver.grid.cells)
    item = np.dtype(case.scene.precision).itemsize
    layer = cells // fluid.solver.grid.cells[blocks.axis]
    slab = cells // blocks.number
    if isinstance(fluid.solver, TwoFluidSolver):
        finer = 2 ** (fluid.solver.grid.dimension - 1)  # cells of a layer over those of the next level's
        return item * (2 * layer * (1 + 2 * STEPS * finer // (finer - 1)) + FEW)
    return item * (2 * layer + 2 * slab * (blocks.number - 1) // blocks.number)


def _step_time(case: Case, neighbors: Neighbors, sent: int, ghosts: int, number: int, fullest: float) -> float:
    """Of a contact step on so many devices, with as many ghosts on each, by the share of the fullest [s]."""
    steps, gpu = case.simulation.steps, jax.default_backend() != "cpu"
    whole = run_cost(case.simulation, neighbors).contacts
    step = whole / (steps.outputs * steps.intervals_per_output * steps.contacts_per_interval)
    launch = (GPU if gpu else CPU).launch
    if number == 1:
        return step
    kind = "gpu" if gpu else "cpu"
    count = neighbors.reference[0].shape[0] // case.simulation.search.members
    share = fullest + ghosts / max(count, 1)
    return launch + (step - launch) * share + LATENCY[kind] + sent / BANDWIDTH[kind]

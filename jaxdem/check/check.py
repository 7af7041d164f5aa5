"""What a scene will be before it runs: limits, resolution, memory, and what is compiled in or left out."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import numpy as np

from jaxdem.check.bond_numbers import bond_numbers
from jaxdem.check.cautions import cautions
from jaxdem.check.clump_rows import clump_rows
from jaxdem.check.drive import drive_cautions
from jaxdem.check.engineering import Number, ScreenLoad, engineering_numbers, screen_load
from jaxdem.check.grain_figures import particle_figures
from jaxdem.check.heat import heat_numbers
from jaxdem.check.mesh_rows import mesh_cautions, mesh_rows
from jaxdem.check.opening_rows import opening_cautions, opening_rows
from jaxdem.check.over_devices import WORKING_COPIES, DeviceReport, check_devices, processes_that_pay
from jaxdem.check.packs import bond_rows, pack_rows
from jaxdem.check.probe_rows import probe_cautions, probe_rows
from jaxdem.check.program import compiled_parts, population_rows
from jaxdem.check.run_cost import RunCost, run_cost
from jaxdem.check.unit_warnings import unit_warnings
from jaxdem.check.walls_in_fluid import bytes_of, wall_memory
from jaxdem.closures.subgrid import LARGEST_GRADIENT, LARGEST_VISCOSITY
from jaxdem.fluid.interval import VISCOUS_LIMIT
from jaxdem.particles.neighbors import Neighbors, Room
from jaxdem.run.samples import samples_every
from jaxdem.scene import Scene
from jaxdem.setup import stability
from jaxdem.setup.boundaries import boundary_speed
from jaxdem.setup.builder import Case, build_case
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.start_point import StartPoint
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State

Told = TypeVar("Told")
Said = TypeVar("Said")

RUNNING = "total while running"
"""Name of the sum of the memory."""


@dataclasses.dataclass(frozen=True)
class CheckReport:
    """Plain data about a scene; lengths in m, times in s, memory in bytes. None where a part does not exist.

    Attributes:
        precision: of the arrays.
        size: of the box.
        periodic: whether each axis is periodic.
        particles: number of particles.
        grains_per_parcel: grains that one particle stands for; None where that is one.
        cells: of the mesh, per axis.
        spacing: size of a cell.
        cells_per_diameter: smallest and largest cell side over the largest diameter [-].
        kernel_half_width: of the deposition, per axis.
        void_fraction: initial minimum and mean [-].
        closed_pockets: number of cells that walls enclose and that are left out of the fluid.
        time_steps: contact, contacts_per_interval, interval, fluid, fluid_substeps, outputs, intervals.
        limits: named time-step limits.
        expected_speed: of particles, that the contact limits stand on [m/s].
        speed_limit: at which a particle stops the run, for an impact then overlaps by `maximum_overlap` [m/s].
        expected_overlap: at the expected speed, over the diameter [-].
        maximum_overlap: that is accepted, over the diameter [-].
        restitution_error: to expect from the contact step's length [-].
        slip_error: the same, of the slip after an oblique impact over that before [-].
        resting_overlap: of a grain under its own weight, over the diameter [-].
        overlap_resolution: rounding of a listed pair's overlap over the resting overlap [-].
        relaxation_time: of the lightest particle by Stokes drag.
        numbers: what an engineer knows the scene by.
        screen_load: of the stream on a side that holds grains; None where there is none.
        cost: estimated wall time.
        warnings: sentences on what looks like another unit, or seldom does what was meant.
        memory: estimates by name.
        population: what is known beforehand of particles that come and go, as (name, text).
        probes: of each probe its name, and what it costs and writes.
        packs: of the start, columns of its file that are not read, and bonds, as (name, text).
        meshes: walls that are meshes, as (key, text).
        openings: inlets and outlets on walls that the fluid sees, as (key, text).
        start: what the scene begins from, see `Case.start_figures`; {} where it begins at t = 0.
        devices: what it will be on several devices; None where none are asked for.
        processes: what it would be in as many processes as this machine has cores for and are worth it; None for one,
            and where devices are asked for.
        compiled_in: parts of the model that are in the program.
        left_out: parts that are not.
    """

    precision: str
    size: tuple[float, ...]
    periodic: tuple[bool, ...]
    particles: int | None
    grains_per_parcel: float | None
    cells: tuple[int, ...] | None
    spacing: tuple[float, ...] | None
    cells_per_diameter: tuple[float, float] | None
    kernel_half_width: tuple[float, ...] | None
    void_fraction: tuple[float, float] | None
    closed_pockets: int
    time_steps: dict[str, float]
    limits: dict[str, float]
    expected_speed: float | None
    speed_limit: float | None
    expected_overlap: float | None
    maximum_overlap: float | None
    restitution_error: float | None
    slip_error: float | None
    resting_overlap: float | None
    overlap_resolution: float | None
    relaxation_time: float | None
    numbers: tuple[Number, ...]
    screen_load: ScreenLoad | None
    cost: RunCost
    warnings: tuple[str, ...]
    memory: dict[str, int]
    population: tuple[tuple[str, str], ...]
    probes: tuple[tuple[str, str], ...]
    packs: tuple[tuple[str, str], ...]
    meshes: tuple[tuple[str, str], ...]
    openings: tuple[tuple[str, str], ...]
    start: dict[str, object]
    devices: DeviceReport | None
    processes: DeviceReport | None
    compiled_in: tuple[str, ...]
    left_out: tuple[str, ...]


NUMBERS: tuple[Callable[[Case], Iterable[Number]], ...] = (engineering_numbers, bond_numbers, heat_numbers)
"""What an engineer knows the parts of a scene by, in the order of the report."""

ROWS: tuple[Callable[[ParticleSetup | None], Iterable[tuple[str, str]]], ...] = (clump_rows, pack_rows, bond_rows)
"""What is told of the particles at the start, in the order of the report."""

CAUTIONS: tuple[Callable[[Case], Iterable[str]], ...] = (
    lambda case: unit_warnings(case.scene),
    lambda case: case.unread,
    probe_cautions,
    mesh_cautions,
    opening_cautions,
    drive_cautions,
)
"""What is said of what seldom does what was meant, in the order of the report."""


def check_scene(scene: Scene, start: StartPoint | None = None, devices: int | None = None) -> CheckReport:
    """Look a scene over without running it; programs are compiled only for walls beside the box.

    Args:
        scene: the scene.
        start: state that it begins from, of a scene with `[start]`; read from the run that it names if not given.
        devices: number of devices that it is to run on; None for one.

    Raises:
        InputError: whatever `simulate` would refuse before its first step.
    """
    case = build_case(scene, start=start)
    simulation, parameters, steps = case.simulation, case.parameters, case.simulation.steps
    samples_every(scene, simulation)
    state, room = case.first_state()
    neighbors = _list_shapes(case, state, room)
    spacing = None if simulation.fluid is None else simulation.fluid.solver.grid.spacing
    grains = 1.0 if scene.particles is None else scene.particles.coarse_grain**scene.dimension
    count = None if state.particles is None else len(state.particles.position)
    load = screen_load(scene, simulation, parameters, case.grains, (count or 0) * grains)
    cost, memory = run_cost(simulation, neighbors), _memory(simulation, parameters, state, neighbors)
    void = _void_fraction(state)
    over, processes = _over_devices(case, devices, state, neighbors, memory, cost)
    compiled_in, left_out = compiled_parts(scene, simulation, parameters)
    return CheckReport(
        precision=scene.precision,
        size=scene.domain.size,
        periodic=scene.periodic,
        particles=count,
        grains_per_parcel=grains if grains > 1.0 else None,
        cells=None if scene.fluid is None else scene.fluid.cells,
        spacing=spacing,
        cells_per_diameter=_cells_per_diameter(case, spacing),
        kernel_half_width=simulation.half_width,
        void_fraction=void,
        closed_pockets=case.fluid_walls.closed_pockets,
        time_steps=_time_steps(simulation),
        limits=dict(steps.limits) | _model_viscous_limit(scene, simulation, None if void is None else void[0]),
        expected_speed=steps.expected_speed,
        speed_limit=steps.speed_limit,
        expected_overlap=steps.expected_overlap,
        maximum_overlap=None if scene.contact is None else scene.contact.maximum_overlap,
        numbers=_told(NUMBERS, case),
        screen_load=load,
        cost=cost,
        warnings=(*_told(CAUTIONS, case), *cautions(scene, case.bodies, spacing, load, cost)),
        memory=memory,
        population=population_rows(scene, simulation, state),
        probes=probe_rows(case, state, neighbors),
        packs=_told(ROWS, case.particles),
        meshes=mesh_rows(case),
        openings=opening_rows(case),
        start=case.start_figures,
        devices=over,
        processes=processes,
        compiled_in=compiled_in,
        left_out=left_out,
        **particle_figures(case),
    )


def _list_shapes(case: Case, state: State, room: Room | None) -> Neighbors | None:
    """The neighbour list at the start, shapes alone; None without particles."""
    if room is None or state.particles is None:
        return None
    return case.simulation.list_shapes(case.parameters, state.particles, room)


def _cells_per_diameter(case: Case, spacing: tuple[float, ...] | None) -> tuple[float, float] | None:
    """Smallest and largest side of a cell over the largest diameter [-]; None without fluid or particles."""
    if case.scene.particles is None or not spacing:
        return None
    diameter = case.bodies.largest_diameter
    return (min(spacing) / diameter, max(spacing) / diameter) if diameter else None


def _told(parts: Iterable[Callable[[Told], Iterable[Said]]], about: Told) -> tuple[Said, ...]:
    """What all parts say, in their order."""
    return tuple(said for of_part in parts for said in of_part(about))


def _over_devices(
    case: Case,
    devices: int | None,
    state: State,
    neighbors: Neighbors | None,
    memory: dict[str, int],
    cost: RunCost,
) -> tuple[DeviceReport | None, DeviceReport | None]:
    """What the scene will be on so many devices; where no number is asked for, in the processes that pay."""
    if devices is None:
        return None, processes_that_pay(case, state, neighbors, memory, cost)
    return (check_devices(case, devices, state, neighbors, memory) if devices > 1 else None), None


def _time_steps(simulation: Simulation) -> dict[str, float]:
    """Steps [s] and their numbers, of the parts that there are."""
    steps = simulation.steps
    found: dict[str, float] = {
        "interval": steps.interval,
        "intervals": steps.outputs * steps.intervals_per_output,
        "outputs": steps.outputs,
    }
    if steps.contact is not None:
        found |= {"contact": steps.contact, "contacts_per_interval": steps.contacts_per_interval}
    if simulation.fluid is not None:
        found |= {"fluid": steps.interval / steps.fluid_substeps, "fluid_substeps": steps.fluid_substeps}
    return found


def _void_fraction(state: State) -> tuple[float, float] | None:
    """Minimum and mean [-]; None without fluid or particles."""
    if state.fluid is None or state.fluid.void_fraction is None:
        return None
    void = np.asarray(state.fluid.void_fraction)
    return float(void.min()), float(void.mean())


def _model_viscous_limit(scene: Scene, simulation: Simulation, lowest: float | None) -> dict[str, float]:
    """Viscous limit [s] with what a subgrid viscosity and model B add to nu, as far as that is known beforehand.

    nu_t = (C_s Delta)^2 sqrt(2 S:S) for a shear of the largest boundary speed over the smallest cell side, where
    sqrt(2 S:S) = U/h; model B: over the smallest void fraction of the start. A learned stress is taken at its bounds,
    over that void fraction in either model. Over a bed: the largest of an open channel, 2/(3 sqrt(3)) kappa u_* H, with
    H the height of the box and a shear velocity u_* of U/5. While running, the true ones decide.
    """
    fluid = scene.fluid
    model_b = simulation.fluid is not None and not simulation.fluid.solver.shares_stress and lowest is not None
    eddies_modelled = fluid is not None and (fluid.smagorinsky > 0.0 or fluid.subgrid or fluid.bed_mixing)
    if fluid is None or simulation.fluid is None or not (eddies_modelled or model_b):
        return {}
    grid = simulation.fluid.solver.grid
    width = math.prod(grid.spacing) ** (1.0 / grid.dimension)
    shear = boundary_speed(scene) / min(grid.spacing)
    eddies = (fluid.smagorinsky * width) ** 2 * shear
    if fluid.bed_mixing is not None:
        shear_velocity = boundary_speed(scene) / 5.0
        eddies = 2.0 / math.sqrt(27.0) * fluid.bed_mixing.von_karman * shear_velocity * scene.domain.size[-1]
    viscosity = (fluid.viscosity + eddies) / (lowest if model_b and lowest else 1.0)
    if fluid.subgrid is not None:
        largest = LARGEST_VISCOSITY * width**2 + 2.0 * LARGEST_GRADIENT * max(grid.spacing) ** 2
        viscosity += largest * shear / (lowest or 1.0)
    return {"viscous_model": stability.viscous_time(viscosity, grid.spacing, VISCOUS_LIMIT)}


def _memory(
    simulation: Simulation, parameters: Parameters, state: State, neighbors: Neighbors | None
) -> dict[str, int]:
    """Estimates in bytes."""
    listed = neighbors if neighbors is None or not neighbors.meshes else neighbors.without_surfaces()
    memory = {"particles": bytes_of(state.particles), "neighbour list": bytes_of(listed)}
    memory["meshes"] = 0 if neighbors is None else bytes_of(neighbors.surfaces)
    coupling = simulation.coupling
    memory["fluid"] = bytes_of(state.fluid)
    memory["scalars"] = 0 if state.scalars is None else bytes_of(state.scalars)
    memory |= wall_memory(simulation, parameters)
    memory["kernel weights"] = 0
    if coupling is not None and state.particles is not None:
        count, dimension = state.particles.position.shape
        grid, real = coupling.interval.solver.grid, np.dtype(state.particles.position.dtype)
        place: Any = np.zeros((1, dimension), real)
        of_one = coupling.deposition.weights(grid, place, np.ones((), real))  # type: ignore[arg-type]
        memory["kernel weights"] = count * of_one.index.size * (of_one.index.itemsize + real.itemsize)
    memory = {name: size for name, size in memory.items() if size}
    return memory | {RUNNING: WORKING_COPIES * sum(memory.values())}

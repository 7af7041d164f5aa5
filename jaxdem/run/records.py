"""What a run writes at an output: a frame and a row of history.csv. Host side."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem import metrics
from jaxdem.closures.ensemble import EnsembleClosure
from jaxdem.coupling.exchange import FluidForces
from jaxdem.errors import required
from jaxdem.fluid.drive import bulk_velocity
from jaxdem.fluid.grid import cell_average, face_average
from jaxdem.fluid.projection import open_section
from jaxdem.numerics.axes import AXES
from jaxdem.particles.integrate import ParticleState
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.regions import into_period
from jaxdem.run.bonds import bond_arrays, bond_counts
from jaxdem.run.clump_records import inertia_of, orientation_of, spheres_of
from jaxdem.run.scalar_figures import scalar_arrays, scalar_columns
from jaxdem.run.wear import wear_figures
from jaxdem.setup.builder import Case
from jaxdem.simulation import Simulation
from jaxdem.state import State


@dataclasses.dataclass(frozen=True)
class Instant:
    """Where a run has got to.

    Attributes:
        time: simulated time [s].
        state: at that time.
        neighbors: its list, None without particles.
        forces: of the fluid in the interval before, None at the start and without fluid or particles.
        identity: on several devices, of the particles that the rows of the forces belong to.
    """

    time: float
    state: State
    neighbors: Neighbors | None
    forces: FluidForces | None
    identity: Array | None = None


class Frame(NamedTuple):
    """Arrays of an output frame by name, of particles, fluid, bonds and members of clumps; None for a part that the
    scene has not."""

    particles: dict[str, np.ndarray] | None
    fluid: dict[str, np.ndarray] | None
    bonds: dict[str, np.ndarray] | None = None
    spheres: dict[str, np.ndarray] | None = None


def frame_of(case: Case, instant: Instant) -> Frame:
    """The output frame of an instant."""
    state, bodies = instant.state, case.parameters.bodies
    particles = fluid = bonds = spheres = None
    if state.particles is not None and bodies is not None:
        count, dimension = state.particles.position.shape
        drag = np.zeros((count, dimension)) if instant.forces is None else np.asarray(instant.forces.drag)
        particles = {
            "position": wrapped_position(case.simulation, state.particles),
            "velocity": np.asarray(state.particles.velocity),
            "angular_velocity": np.asarray(state.particles.angular_velocity),
            "drag_force": drag.astype(state.particles.velocity.dtype),
            "contact_force": np.asarray(state.particles.contact_force),
            "radius": np.broadcast_to(np.asarray(bodies.radius), count).copy(),
        }
        bonds = bond_arrays(case, state.particles, particles["position"])
        particles |= orientation_of(case, state.particles)
        spheres = spheres_of(case, state.particles, particles["position"])
        further = _further_forces(case, instant, drag)
        particles |= further
        if state.particles.active is not None:
            particles["active"] = np.asarray(state.particles.active).astype(np.uint8)
            # Those removed at the end of the interval had a force within it.
            for name in ("drag_force", *further):
                particles[name] = np.where(particles["active"][:, None], particles[name], 0)
    if state.fluid is not None:
        pressure, void_fraction = np.asarray(state.fluid.pressure), state.fluid.void_fraction
        faces = jax.tree.map(np.asarray, state.fluid.face_velocity)  # on the host, where nothing is compiled
        fluid = {
            "velocity": np.stack(cell_average(faces), axis=-1),
            "pressure": pressure,
            "void_fraction": np.ones_like(pressure) if void_fraction is None else np.asarray(void_fraction),
        }
    of_grains, of_fluid = scalar_arrays(state, case)
    return Frame(particles and particles | of_grains, fluid and fluid | of_fluid, bonds, spheres)


def _further_forces(case: Case, instant: Instant, like: np.ndarray) -> dict[str, np.ndarray]:
    """Mean of each further force of the fluid over the last interval [N], zero at the start."""
    coupling, forces = case.simulation.coupling, instant.forces
    found = {}
    for force in () if coupling is None else coupling.forces:
        if force.acts_on_velocity:
            given = np.zeros_like(like) if forces is None else np.asarray(forces.further[force.name].given)
            found[f"{force.name}_force"] = given.astype(case.parameters.gravity.dtype)
    return found


def history_of(
    case: Case, instant: Instant, frame: Frame, collision: float, gradient: np.ndarray | None
) -> dict[str, float]:
    """The row of history.csv of an instant.

    Args:
        case: that runs.
        instant: of the frame.
        frame: the arrays that go into the metrics.
        collision: mean collision force since the last output [N].
        gradient: (D,) mean gradient of the pressure since then, see `Totals`; None for that of the state [Pa/m].
    """
    particles, fluid, bodies = frame.particles, frame.fluid, case.parameters.bodies
    arrays: dict[str, np.ndarray] = {}
    if particles is not None and bodies is not None:
        present = particles["active"].astype(bool) if "active" in particles else slice(None)
        names = ("position", "velocity", "angular_velocity", *(() if fluid is None else ("drag_force",)))
        arrays = {name: particles[name][present] for name in names}
        bodies = jax.tree.map(np.asarray, bodies)
        inertia = inertia_of(case, required(instant.state.particles, "particles"), bodies.inertia)
        for name, value in (("mass", bodies.mass), ("inertia", inertia)):
            arrays[name] = value[present] if value.ndim else value
        if bodies.parcels is not None:  # forces of a grain: its share of that on the parcel, as of its momentum
            if "drag_force" in arrays:
                arrays["drag_force"] = arrays["drag_force"] / bodies.parcels.grains
            collision = collision / float(bodies.parcels.grains)
    if fluid is not None:
        arrays |= {"fluid_pressure": fluid["pressure"], "fluid_velocity": fluid["velocity"]}
        open_cells = case.fluid_walls.open_cells(case.scene, instant.time)
        if open_cells is not None:  # cells that are more open than solid
            is_open = open_cells >= 0.5
            arrays |= {name: arrays[name][is_open] for name in ("fluid_pressure", "fluid_velocity")}
    known = metrics.Quantities(collision_force=None if particles is None else collision, **arrays)
    row = metrics.history_row(instant.time, known)
    counts = particle_counts(case.simulation, instant.state)
    state = instant.state
    numbers: dict[str, float] = {name: counts[name] for name in ("present", "removed") if name in counts}
    numbers |= bond_counts(state.particles)
    of_walls = piston_figures(case, state) | wear_figures(case, state)
    return row | numbers | drive_figures(case, state, gradient) | of_walls | scalar_columns(state, case)


def piston_figures(case: Case, state: State) -> dict[str, float]:
    """How far every piston has moved along its direction [m]; {} without."""
    pistons = None if state.particles is None else state.particles.pistons
    if pistons is None:
        return {}
    displacement = np.asarray(pistons.displacement, np.float64)
    names = [f"wall_{k}_displacement" for k, wall in enumerate(case.scene.walls) if wall.piston is not None]
    return {name: float(displacement[k]) for k, name in enumerate(names)}


def drive_figures(case: Case, state: State, gradient: np.ndarray | None) -> dict[str, float]:
    """Mean gradient of the pressure and bulk velocity along the periodic axes; {} where nothing drives the fluid."""
    interval, fluid = case.simulation.fluid, state.fluid
    if interval is None or interval.solver.drive is None or fluid is None or fluid.mean_gradient is None:
        return {}
    grid, drive = interval.solver.grid, interval.solver.drive
    if gradient is None:  # gravity is that of the interval in which the gradient acted
        parameters = case.simulation.during(case.parameters, jnp.maximum(state.step - 1, 0))
        gradient = np.asarray(fluid.mean_gradient + parameters.flow.density * parameters.gravity)
    whole = (1.0,) * grid.dimension
    on_faces = whole if fluid.void_fraction is None else face_average(grid, fluid.void_fraction)
    cut = case.parameters.flow.cut
    if cut is not None:
        on_faces = cut.opened(on_faces)
    bulk = np.asarray(bulk_velocity(grid, drive, fluid.face_velocity, on_faces))
    if cut is not None:  # over the open part of the cross-section
        bulk = bulk / np.asarray(open_section(grid, cut))
    axes = [(axis, name) for axis, name in enumerate(AXES[grid.dimension]) if drive.driven[axis]]
    found = {f"pressure_gradient_{name}": float(gradient[axis]) for axis, name in axes}
    return found | {f"bulk_velocity_{name}": float(bulk[axis]) for axis, name in axes}


@jax.jit
def ensemble_spread(closure: EnsembleClosure, forces: FluidForces) -> tuple[Array, Array]:
    """Mean over the particles of the spread of the members' forces, and of the size of the ensemble's [N].

    As the closure gives them: before a drag scale, and of model A.
    """
    drag = closure(forces.inputs)
    force = drag.coefficient[:, None] * forces.inputs.slip_velocity
    if drag.remainder is not None:
        force = force + drag.remainder
    return jnp.mean(closure.spread(forces.inputs)), jnp.mean(jnp.linalg.norm(force, axis=1))


def particle_counts(simulation: Simulation, state: State) -> dict[str, int]:
    """How many there were at the start, have come in, have been removed and are present; {} where none comes or goes.

    initial + inserted = removed + present, for a row of the state is used once.
    """
    population, particles = simulation.population, state.particles
    if population is None or particles is None or particles.active is None:
        return {}
    coming = sum(len(inlet.due) for inlet in population.inlets) + population.never
    initial = particles.position.shape[0] - coming
    inserted = 0 if particles.inserted is None else int(np.sum(np.asarray(particles.inserted)))
    present = int(np.sum(np.asarray(particles.active)))
    removed = initial + inserted - present
    return {"initial": initial, "inserted": inserted, "removed": removed, "present": present}


def wrapped_position(simulation: Simulation, particles: ParticleState) -> np.ndarray:
    """(N, D) centres, inside the box along its periodic axes [m]."""
    position = np.asarray(particles.position)
    if not any(simulation.periodic):
        return position
    # In float64: far from the box the leading part alone is off by more than what grains overlap.
    low = particles.position_low
    centre = position.astype(np.float64) + (0.0 if low is None else np.asarray(low, np.float64))
    inside = into_period(centre, np.asarray(simulation.box)).astype(position.dtype)
    return np.where(simulation.periodic, inside, position)

"""The balance of energy of the particles of a run, for its summary. Host side."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from jaxdem.devices.mesh import SAME, SLABS, STATE, on_host, on_slabs
from jaxdem.devices.parameters import spread
from jaxdem.devices.simulation import DividedSimulation
from jaxdem.errors import required
from jaxdem.numerics.blocks import total
from jaxdem.numerics.host import on_device
from jaxdem.particle_step import stored as stored_in_particles
from jaxdem.particles.energy import EnergyFlow
from jaxdem.particles.integrate import Motion, ParticleState
from jaxdem.particles.materials import ContactParameters
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.stored_energy import StoredEnergy, knows_energy, spin_energies
from jaxdem.run.instant import InSlabs, Instant
from jaxdem.run.parts.part import Part
from jaxdem.run.parts.springs import is_plain, springs_of
from jaxdem.run.totals import Totals
from jaxdem.setup.builder import Case
from jaxdem.state import Parameters, State

TOLD = 0.01
"""Energy that no force explains, over what was turned over, from which on the summary says so [-]."""

TAKEN = ("damping", "liquid", "adhesion", "tangential_damping", "bond_damping", "breaking")
"""Fields of `EnergyFlow` that are dissipated as they are."""

MOTION = ("translation", "rotation", "potential")
"""What is known of every run: the first fields of `StoredEnergy`."""


class Energy(Part):
    """The energy of the particles, with the balance of its parts where the scene asks for it."""

    name = "energy"

    def start(self, case: Case, instant: Instant) -> tuple[float, ...]:
        """What is stored in the particles [J]."""
        return energy_now(case, instant)

    def summary(self, case: Case, instant: Instant, totals: Totals) -> dict[str, Any]:
        """Entry `energy` [J]; {} in a scene without particles. Without `output.energy` it has `taken`, see there.

        `gained` is what no force and no source explains: `time_step`, the error of the contact step in the springs, and
        `missing`, which is zero but for rounding. Positive where there is more energy than there should be.
        """
        end = energy_now(case, instant)
        if not end:
            return {}
        names = StoredEnergy._fields if len(end) > len(MOTION) else MOTION
        at_end: dict[str, float] = dict(zip(names, end, strict=True))
        kept = totals.at_start.get(self.name)
        start = kept if isinstance(kept, tuple) and len(kept) == len(end) else ()
        at_start = dict(zip(names, start, strict=True)) if start else None
        figures: dict[str, Any] = {"start": at_start, "end": at_end}
        if at_start is None or len(end) == len(MOTION):
            return {"energy": figures}
        if not case.scene.output.energy:
            return {"energy": figures | taken(at_start, at_end, _givers(case))}
        flow = totals.energy or (0.0,) * len(EnergyFlow._fields)
        changes = case.simulation.gravity_times is not None
        figures |= balance(at_start, at_end, dict(zip(EnergyFlow._fields, flow, strict=True)), changes)
        return {"energy": figures}


def energy_now(case: Case, instant: Instant) -> tuple[float, ...]:
    """What is stored in the particles, the fields of `StoredEnergy` [J].

    Only `MOTION` where the contact law or the cohesion does not say what it stores, and on several devices without
    `output.energy`; empty in a scene without particles.
    """
    particles, neighbors, contact = instant.state.particles, instant.neighbors, case.simulation.contact
    if particles is None:
        return ()
    if instant.slabs is not None and case.scene.output.energy:
        return tuple(float(x) for x in _stored_in_slabs(case.parameters, instant.slabs))
    if neighbors is None or contact is None or not knows_energy(contact.model):
        return _of_motion(case, particles, instant)
    bodies, material = case.parameters.bodies, case.parameters.materials
    if (
        not case.scene.output.energy
        and bodies is not None
        and isinstance(material, ContactParameters)
        and is_plain(contact.model, bodies)
    ):
        springs = springs_of(contact.model, material, bodies, particles, neighbors)
        rest = (0.0,) * (len(StoredEnergy._fields) - len(MOTION) - len(springs))
        return (*_of_motion(case, particles, instant), *springs, *rest)
    stored = _stored(case.simulation, case.parameters, particles, neighbors, instant.state.step)
    return tuple(float(x) for x in stored)


# It runs twice: the time is that of compiling it.
QUICKLY = {"xla_backend_optimization_level": 0}

_stored = jax.jit(stored_in_particles, compiler_options=QUICKLY)


def _stored_in_slabs(parameters: Parameters, slabs: InSlabs) -> StoredEnergy:
    """The same of a state in slabs; every process must call it."""
    simulation = slabs.simulation
    found: StoredEnergy = on_host(
        _stored_of_slabs(simulation, simulation.on_devices(parameters), slabs.state, slabs.neighbors)
    )
    return found


def _of_slabs(
    simulation: DividedSimulation, parameters: Parameters, state: State, neighbors: Neighbors
) -> StoredEnergy:
    own = simulation.of_slab()

    def of_all(parameters: Parameters, state: State, neighbors: Neighbors) -> StoredEnergy:
        return total(
            own.cut,
            stored_in_particles(own, parameters, required(state.particles, "state.particles"), neighbors, state.step),
        )

    mesh = required(simulation.mesh, "mesh")
    found: StoredEnergy = on_slabs(mesh, of_all, (spread(parameters), STATE, SLABS), SAME)(parameters, state, neighbors)
    return found


_stored_of_slabs = jax.jit(_of_slabs, compiler_options=QUICKLY)


def _givers(case: Case) -> list[str]:
    """What beside contacts and bonds gives energy to the particles, or takes it from them."""
    simulation, contact = case.simulation, case.simulation.contact
    model = None if contact is None else contact.model
    moving = any(side.kind == "moving_wall" for side in simulation.boundary.sides)
    found = {
        "fluid": simulation.coupling is not None,
        "moving walls": moving or (model is not None and bool(model.motions)),
        "walls that come and go": model is not None and model.wall_times is not None,
        "particles that come and go": simulation.population is not None,
        "gravity that changes": simulation.gravity_times is not None,
    }
    return [name for name, there in found.items() if there]


def taken(start: dict[str, float], end: dict[str, float], givers: list[str]) -> dict[str, Any]:
    """What the particles have less at the end than at the start [J].

    Without other givers that is what contacts and bonds have dissipated: a remainder, and no sum of its own as in
    `balance`. It cannot be negative but for the error of the contact step, and the remark says so where it is.

    Args:
        start, end: what is stored, see `StoredEnergy`.
        givers: what beside contacts and bonds gives and takes.
    """
    less = sum(start.values()) - sum(end.values())
    # The zero of the potential energy is anywhere; what else is held counts whole: rounding in a pile at rest is small.
    turned_over = sum(abs(moment[name]) for moment in (start, end) for name in start if name != "potential")
    turned_over += abs(end["potential"] - start["potential"])
    remark = ""
    if not givers and less < -TOLD * turned_over:
        remark = (
            f"the particles have gained {-less:.3g} J, {-100.0 * less / turned_over:.3g} % of the energy turned over, "
            "that no force explains: the contact step is too long for these contacts"
        )
    by = ["contacts", *givers]
    return {"taken": less, "taken_by": by, "turned_over": turned_over, "remark": remark}


def _of_motion(case: Case, particles: ParticleState, instant: Instant) -> tuple[float, ...]:
    """By NumPy: nothing is compiled for it but the rotation of clumps."""
    bodies = jax.tree.map(np.asarray, case.parameters.bodies)
    there = slice(None) if particles.active is None else np.asarray(particles.active)
    count = particles.velocity.shape[0]
    mass, inertia = (np.broadcast_to(np.asarray(x, float), (count,))[there] for x in (bodies.mass, bodies.inertia))
    centre = np.asarray(particles.position, float)
    if particles.position_low is not None:
        centre = centre + np.asarray(particles.position_low, float)
    velocity, spin = (np.asarray(x, float)[there] for x in (particles.velocity, particles.angular_velocity))
    turning = 0.5 * inertia * np.sum(spin**2, axis=1)
    if bodies.clumps is not None:  # with the principal moments
        own = spin_energies(Motion.of(particles), required(case.parameters.bodies, "parameters.bodies"))
        turning = np.asarray(own).astype(float)[there]
    gravity = _gravity(case, instant)
    translation = 0.5 * float(np.sum(mass * np.sum(velocity**2, axis=1)))
    return translation, float(np.sum(turning)), -float(np.sum(mass * (centre[there] @ gravity)))


def _gravity(case: Case, instant: Instant) -> np.ndarray:
    """Of the interval before an instant [m/s2]."""
    gravity = np.asarray(case.parameters.gravity, float)
    if case.simulation.gravity_times is None:
        return gravity
    step = max(int(instant.state.step) - 1, 0)
    return np.asarray(case.simulation.during(case.parameters, on_device(step, np.int32)).gravity, float)


def balance(
    start: dict[str, float], end: dict[str, float], flow: dict[str, float], gravity_changes: bool = False
) -> dict[str, Any]:
    """Works, dissipations and what is left [J].

    Args:
        start, end: what is stored, see `StoredEnergy`.
        flow: between the two, see `EnergyFlow`.
        gravity_changes: whether gravity changes with time.
    """
    change = {name: end[name] - start[name] for name in start}
    work = {name: flow[name] for name in ("walls", "fluid", "population", "wall_changes")}
    # Where gravity changes with time, so does the potential energy of particles at rest.
    work["gravity_change"] = change["potential"] + flow["gravity"] if gravity_changes else 0.0
    dissipated = {name: flow[name] for name in TAKEN}
    kept = change["tangential"] - flow["carried_tangential"]
    dissipated["sliding"] = flow["tangential"] - flow["tangential_damping"] - kept
    dissipated["rolling"] = flow["rolling"] - (change["rolling"] - flow["carried_rolling"])
    in_springs = change["normal"] + change["surface"] + change["bonds"] - flow["carried_normal"]
    time_step = flow["conservative"] + in_springs + flow["adhesion"] + flow["breaking"] + flow["turning"]
    gained = sum(change.values()) - sum(work.values()) + sum(dissipated.values())
    kinetic = start["translation"] + start["rotation"], end["translation"] + end["rotation"]
    springs = sum(abs(moment[name]) for moment in (start, end) for name in ("normal", "surface", "bonds"))
    turned_over = sum(kinetic) + abs(flow["gravity"]) + springs
    turned_over += sum(map(abs, work.values())) + sum(map(abs, dissipated.values()))
    relative = gained / turned_over if turned_over else 0.0
    remark = ""
    if abs(relative) > TOLD:
        side = "gained" if relative > 0.0 else "lost"
        remark = (
            f"the particles have {side} {abs(gained):.3g} J, {100.0 * abs(relative):.3g} % of the energy turned over, "
            "that no force explains: the contact step is too long for these contacts"
        )
    return {
        "work": work,
        "dissipated": dissipated,
        "time_step": time_step,
        "missing": gained - time_step,
        "gained": gained,
        "gained_relative": relative,
        "remark": remark,
    }

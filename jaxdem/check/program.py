"""What of the model a scene's program has and has not, and which particles come and go."""

from __future__ import annotations

import jax
import numpy as np

from jaxdem.check.heat import scalar_parts
from jaxdem.coupling.forces import FORCES
from jaxdem.fluid.two_fluids import TwoFluidSolver
from jaxdem.scene import Scene
from jaxdem.scene.inlets import ParticleInlet
from jaxdem.scene.walls import Wall
from jaxdem.simulation import Simulation
from jaxdem.state import Parameters, State

UNITS = {"rate": "1/s", "mass_flow": "kg/s"}
"""Of the keys of an inlet that say how much comes."""


Parts = list[tuple[str, bool]]
"""Names of parts of the model, and whether the program has them."""


def compiled_parts(
    scene: Scene, simulation: Simulation, parameters: Parameters
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Parts of the model that the compiled program has, and those that it has not."""
    parts = [part for of_kind in KINDS for part in of_kind(scene, simulation, parameters)]
    return tuple(name for name, there in parts if there), tuple(name for name, there in parts if not there)


def _contact_parts(scene: Scene, simulation: Simulation, parameters: Parameters) -> Parts:
    """What acts on particles but the fluid."""
    if simulation.contact is None:
        return [("particles", False)]
    model, bodies = simulation.contact.model, parameters.bodies
    return [
        ("particles", True),
        (f"contact law {type(model.law).__name__}", True),
        (_cohesion(scene), model.cohesion is not None),
        ("clumps of spheres", bodies is not None and bodies.clumps is not None),
        ("bonds between particles", model.bonds is not None),
        ("lubrication", model.lubrication is not None),
        ("friction by the film between particles", model.wet_friction),
        ("balance of energy", model.energy),
        ("rolling friction", model.rolling is not None),
        ("rolling springs", model.rolling is not None and model.rolling.has_spring),
        ("radius per particle", bodies is not None and bodies.radius.ndim > 0),
        ("density per particle", bodies is not None and bodies.density.ndim > 0),
        (f"contact with {len(model.sides)} walls", bool(model.sides)),
        (_walls_beside_the_box(scene), bool(model.surfaces or model.meshes)),
        ("positions in pairs of floats", scene.precision == "float32"),
    ]


def _gravity_part(scene: Scene, simulation: Simulation, parameters: Parameters) -> Parts:
    return [("gravity over time", simulation.gravity_times is not None)]


def _fluid_parts(scene: Scene, simulation: Simulation, parameters: Parameters) -> Parts:
    """The solver and what it solves for."""
    if simulation.fluid is None or parameters.fluid is None:
        return [("fluid", simulation.fluid is not None)]
    solver = simulation.fluid.solver
    return [
        ("fluid", True),
        (f"advection {type(solver.advection).__name__}", True),
        ("viscous stress", solver.viscous),
        ("drive along periodic axes", solver.drive is not None),
        ("Smagorinsky subgrid viscosity", parameters.fluid.smagorinsky is not None),
        ("mixing length over a bed", parameters.fluid.bed_mixing is not None),
        ("learned subgrid stress", parameters.fluid.subgrid is not None),
        (f"mesh cut by {solver.surfaces or 'the'} surfaces", solver.surfaces > 0),
        ("inlets and outlets on walls", bool(solver.openings)),
        ("a second fluid with a sharp surface", isinstance(solver, TwoFluidSolver)),
        ("surface tension", isinstance(solver, TwoFluidSolver) and solver.has_tension),
        ("weight at an oblique surface", isinstance(solver, TwoFluidSolver) and solver.oblique_gravity),
        ("inlet profile", any(side.profile is not None for side in solver.boundary.sides)),
        ("velocity of a side over time", any(side.times is not None for side in solver.boundary.sides)),
        ("coupling of particles and fluid", simulation.coupling is not None),
        ("factor on the drag over time", simulation.drag_times is not None),
        ("model B", simulation.coupling is not None and solver.model == "B"),
    ]


def _side_parts(scene: Scene, simulation: Simulation, parameters: Parameters) -> Parts:
    """The sides of the box, axis by axis."""
    parts = []
    for axis, wraps in enumerate(scene.periodic):
        pair = scene.sides[2 * axis : 2 * axis + 2]
        kinds = sorted({scene.boundary[name].kind for name in pair})
        parts.append((f"{pair[0]}-{pair[1]}: {'periodic' if wraps else ', '.join(kinds)}", True))
    return parts


def _population_parts(scene: Scene, simulation: Simulation, parameters: Parameters) -> Parts:
    """Materials, and particles that come and go."""
    if simulation.contact is None:
        return []
    population = simulation.population
    return [
        (_materials(scene), simulation.contact.model.materials is not None),
        ("removal of particles", population is not None and bool(population.exits)),
        ("particle inlets", population is not None and bool(population.inlets)),
    ]


def _cohesion(scene: Scene) -> str:
    """What pulls particles together, in words."""
    table = None if scene.contact is None else scene.contact.cohesion
    return "cohesion" if table is None else f"cohesion {table.kind}"


def _coupling_parts(scene: Scene, simulation: Simulation, parameters: Parameters) -> Parts:
    """How fluid and particles act on each other: what there is and what there is not."""
    coupling, closure = simulation.coupling, parameters.closure
    if coupling is None:
        return []
    drag, there = coupling.drag, {type(force): force for force in coupling.forces}
    wake, correction = "self-disturbance correction", drag.self_disturbance
    if correction is not None:
        wake = f"{wake} (mobility {correction.mobility:.4g}/m over viscosity)"
    view, averaged = drag.coarse_inputs, "inputs of the drag law averaged"
    if view is not None:
        averaged = f"{averaged} to {' x '.join(str(count) for count in view.grid.cells)} cells"
    sharper = "deconvolved velocity"
    if drag.deconvolution > 0.0:
        sharper = f"{sharper} (a = {drag.deconvolution:g})"
    learned = bool(jax.tree.leaves(closure))
    law = f"{'learned drag' if learned else 'drag law'} {type(closure).__name__}"
    return [
        (f"void fraction {type(coupling.deposition).__name__}", True),
        *((str(there[kind]) if kind in there else kind.label, kind in there) for kind in FORCES),
        (sharper, drag.deconvolution > 0.0),
        (wake, correction is not None),
        ("volume of one grain at a parcel", drag.grain_volume),
        (averaged, view is not None),
        (law, True),
        *(() if learned else (("learned drag", False),)),
    ]


KINDS = (
    _contact_parts,
    scalar_parts,
    _gravity_part,
    _fluid_parts,
    _coupling_parts,
    _side_parts,
    _population_parts,
)
"""Each gives the parts of its kind; the report has them in this order."""


def population_rows(scene: Scene, simulation: Simulation, state: State) -> tuple[tuple[str, str], ...]:
    """Who is there at the start, who comes in and when, and where they leave."""
    population, particles = simulation.population, state.particles
    if population is None or particles is None:
        return ()
    rows = [("present at the start", str(int(np.sum(np.asarray(particles.active)))))]
    tables = scene.particles.inlet if scene.particles is not None else ()
    for inlet, table in zip(population.inlets, tables, strict=True):
        times = (int(inlet.due[0]) * simulation.interval, int(inlet.due[-1]) * simulation.interval)
        text = f"{len(inlet.due)} particles at {_flow_of(table)}, due from {times[0]:.4g} to {times[1]:.4g} s"
        rows.append((f"inlet {len(rows) - 1}", f"{text}, up to {inlet.batch} at once"))
    sides = [name for name in scene.sides if scene.boundary[name].particles == "remove"]
    return (*rows, ("removed at", ", ".join(sides) or "no side"))


def _flow_of(inlet: ParticleInlet) -> str:
    """Its rate or mass flow with the unit; the smallest and largest of one that changes."""
    name, given = inlet.flow
    values = sorted(given) if isinstance(given, tuple) else [given]
    return f"{' to '.join(f'{value:.4g}' for value in dict.fromkeys((values[0], values[-1])))} {UNITS[name]}"


def _materials(scene: Scene) -> str:
    names = ", ".join(material.name for material in scene.materials)
    return f"materials by pair: {names}" if names else "materials by pair"


def _walls_beside_the_box(scene: Scene) -> str:
    if not scene.walls:
        return "additional walls"
    words = (wall.kind + _times_of(wall) + _motion_of(wall) + _in_fluid(wall) for wall in scene.walls)
    kinds = f"additional walls: {', '.join(words)}"
    if scene.fluid is None or any(wall.seen_by_fluid for wall in scene.walls):
        return kinds
    return f"{kinds} (for particles only; they do not affect the fluid)"


def _in_fluid(wall: Wall) -> str:
    """What a wall is to the fluid, in words; empty where it does not see it."""
    return f", {wall.fluid} for the fluid" if wall.seen_by_fluid else ""


def _times_of(wall: Wall) -> str:
    """When a wall is there, in words; empty where it always is."""
    begin = "" if wall.begin is None else f" from {wall.begin:g}"
    end = "" if wall.end is None else f" until {wall.end:g}"
    return f"{begin}{end} s" if begin or end else ""


def _motion_of(wall: Wall) -> str:
    """How a wall moves, in words; empty where it is at rest."""
    kinds = [motion.kind for motion in wall.motion or ()] + ["piston"] * (wall.piston is not None)
    return f" moved by {', '.join(kinds)}" if kinds else ""

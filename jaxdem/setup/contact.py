"""The contacts of a scene: neighbour list, walls, laws of contact and rolling."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from jaxdem.errors import InputError
from jaxdem.particles.adhesion import (
    AT_TOUCH,
    DerjaguinMullerToporov,
    JohnsonKendallRoberts,
    SimplifiedJKR,
    VanDerWaals,
)
from jaxdem.particles.bond_state import Bonding
from jaxdem.particles.capillary_bridge import CapillaryBridge
from jaxdem.particles.cohesion import Cohesion
from jaxdem.particles.contact import ContactLaw, HertzMindlin, LinearSpringDashpot
from jaxdem.particles.contact_interval import ContactInterval
from jaxdem.particles.contact_model import ContactModel, MaterialIndex, MeshWall
from jaxdem.particles.lubrication import Lubrication
from jaxdem.particles.neighbor_search import NeighborSearch
from jaxdem.particles.neighbors import NeighborGeometry
from jaxdem.particles.population import Population
from jaxdem.particles.rolling import ConstantDirectionalTorque, ElasticPlasticSpringDashpot, RollingFriction
from jaxdem.particles.walls import BoxSide, box_sides
from jaxdem.setup.attraction import longest_gap
from jaxdem.setup.cohesion import check_bridges
from jaxdem.setup.coincident_walls import check_coincident
from jaxdem.setup.energy import check_energy
from jaxdem.setup.extensions import Extensions
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.piston_travel import piston_travel
from jaxdem.setup.size_levels import list_skin, size_levels
from jaxdem.setup.wall_motion import surface_motions
from jaxdem.setup.wall_times import wall_times
from jaxdem.setup.walls import scene_surfaces
from jaxdem.setup.wear import wear_law
from jaxdem.structure import TimeSteps

CONTACT_LAWS: dict[str, Callable[[], ContactLaw]] = {
    "hertz_mindlin": HertzMindlin,
    "linear_spring_dashpot": LinearSpringDashpot,
}
ROLLING_MODELS: dict[str, Callable[[], RollingFriction]] = {
    "cdt": ConstantDirectionalTorque,
    "epsd": ElasticPlasticSpringDashpot,
}

COHESIONS: dict[str, Callable[[], Cohesion]] = {
    "jkr": JohnsonKendallRoberts,
    "dmt": DerjaguinMullerToporov,
    "van_der_waals": VanDerWaals,
    "capillary": CapillaryBridge,
    "sjkr": SimplifiedJKR,
}


def contact_interval(
    particles: ParticleSetup,
    steps: TimeSteps,
    population: Population | None,
    extensions: Extensions,
    dtype: np.dtype[np.floating],
) -> ContactInterval:
    """Contacts of the particles over a coupling interval.

    Args:
        particles: of the scene.
        steps: of the scene.
        population: how their number changes.
        extensions: walls and contact law of the user.
        dtype: of the positions.

    Raises:
        InputError: the box is too small for the neighbour list, or two walls are one.
    """
    scene, search, sides = particles.scene, _search(particles), _box_walls(particles, population)
    functions = extensions.get("walls") or ()
    surfaces = scene_surfaces(scene, functions)
    times = wall_times(particles, functions, steps.interval)
    check_coincident(scene, sides, surfaces, times, 2.0 * particles.spheres.smallest_radius)
    motions, pistons = surface_motions(scene, len(functions), len(sides))
    cohesion, film = _cohesion(particles, extensions), particles.contact.lubrication
    if particles.meshes:
        _check_own_cohesion(particles, extensions)
    rubs = scene.heat is not None and scene.heat.friction
    model = ContactModel(
        law=extensions.get("contact_law") or CONTACT_LAWS[particles.contact.law](),
        rolling=_rolling(particles),
        sides=sides,
        surfaces=surfaces,
        materials=_materials(particles, len(sides), len(surfaces)),
        wall_times=times,
        measured=tuple(sorted(wall for piston in pistons for wall in piston.walls)),
        cohesion=cohesion,
        motions=motions,
        pistons=pistons,
        travel=piston_travel(scene, sides, particles.meshes),
        meshes=tuple(
            MeshWall(number, mesh.usual, wear_law(mesh.wall), len(mesh.mesh.cells))
            for number, mesh in enumerate(particles.meshes)
        ),
        lists=len(particles.meshes),
        bonds=None if particles.bonds is None else Bonding(scene.domain.size, scene.periodic),
        lubrication=None if film is None else Lubrication(film.shear),
        wet_friction=film is not None and film.wet_friction is not None,
        energy=scene.output.energy or rubs,
        heats=rubs,
    )
    check_energy(scene, model)
    return ContactInterval(model, search, steps.contacts_per_interval, reversible=False)


def _search(particles: ParticleSetup) -> NeighborSearch:
    geometry = neighbor_geometry(particles)
    moving = tuple(mesh.moves for mesh in particles.meshes)
    levels = size_levels(geometry, particles.contact, particles.spheres.radius, particles.members)
    bonds = levels is not None and particles.bonds is not None
    return NeighborSearch(geometry, _typical_radius(particles), moving, particles.members, levels, particles.arm, bonds)


def _materials(particles: ParticleSetup, sides: int, surfaces: int) -> MaterialIndex | None:
    """Who is of which material, walls included; None where there is one only."""
    table = particles.materials
    if table is None:
        return None
    walls = table.of_walls(sides, surfaces, len(particles.meshes))
    return MaterialIndex.of(particles.contact_material, walls, table.pair)


def _check_own_cohesion(particles: ParticleSetup, extensions: Extensions) -> None:
    """Refuses, in a scene with walls that are meshes, a cohesion of the user's that may act over a gap where the kind
    of the table does not.

    Raises:
        InputError: it may.
    """
    kind, own = particles.contact.cohesion_kind, extensions.get("cohesion")
    if own is not None and not isinstance(own, AT_TOUCH) and isinstance(COHESIONS[str(kind)](), AT_TOUCH):
        limit = f"may act over a gap, and lists of walls that are meshes reach as far as the kind of the table, {kind}"
        raise InputError("cohesion", type(own).__name__, limit, "name a kind there that acts over as long a gap")


def neighbor_geometry(particles: ParticleSetup) -> NeighborGeometry:
    """Reach of the neighbour list: largest diameter and reach of cohesion or lubrication; its skin is `list_skin`."""
    scene, diameter = particles.scene, particles.spheres.largest_diameter
    skin = list_skin(particles.contact, particles.spheres.radius, scene.dimension, particles.members)
    cutoff = diameter + longest_gap(particles)
    for axis, wraps in enumerate(scene.periodic):
        needed = 3.0 * (cutoff + skin)
        if wraps and scene.domain.size[axis] < needed:
            raise InputError(
                "domain.size",
                scene.domain.size,
                f"a periodic side must be at least {needed:.4g} m, three times the reach of the neighbour list",
                "enlarge the box, or make that side a wall",
            )
    return NeighborGeometry(scene.domain.size, scene.periodic, cutoff, skin, gap=particles.gap_at_meshes)


def _typical_radius(particles: ParticleSetup) -> float:
    """Of the particle of the mean volume, in 2-D area; of clumps of an even part of theirs for every member [m]."""
    dimension = particles.scene.dimension
    return (float(np.mean(np.power(particles.bodies.radius, dimension))) / particles.members) ** (1.0 / dimension)


def _box_walls(particles: ParticleSetup, population: Population | None) -> tuple[BoxSide, ...]:
    """The sides of the box, without those at which particles leave."""
    exits = () if population is None else population.exits
    without = tuple((side.axis, -1 if side.upper else 1) for side in exits)
    return box_sides(particles.scene.domain.size, particles.scene.periodic, without)


def _cohesion(particles: ParticleSetup, extensions: Extensions) -> Cohesion | None:
    """What pulls particles together; None where nothing does.

    Raises:
        InputError: the user's kind is given no numbers, or bridges could take more liquid than there is.
    """
    table, own = particles.contact.cohesion, extensions.get("cohesion")
    check_bridges(particles)
    if table is None:
        if own is not None:
            limit = "the kind of cohesion that is given in Python takes its numbers and its reach from this table"
            raise InputError("contact.cohesion", None, limit, "add the table, with the kind that is most like it")
        return None
    return own or COHESIONS[table.kind]()


def _rolling(particles: ParticleSetup) -> RollingFriction | None:
    """The model of rolling friction; None where no contact has any."""
    contact, table = particles.contact, particles.materials
    largest = contact.rolling_friction if table is None else table.rolling_friction.max()
    return ROLLING_MODELS[contact.rolling_model]() if largest > 0.0 else None

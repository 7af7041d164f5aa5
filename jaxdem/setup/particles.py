"""The particles of a scene, and what several builders need of them, computed once."""

from __future__ import annotations

import dataclasses
from functools import cached_property

import numpy as np

from jaxdem.errors import InputError
from jaxdem.scene import Contact, Particles, Scene
from jaxdem.scene.rows import Numbers, rows_of
from jaxdem.setup.arrivals import Arrivals, Queue, arrivals
from jaxdem.setup.attraction import longest_gap
from jaxdem.setup.bodies import Bodies, joined, particle_bodies
from jaxdem.setup.bonds import BondList, bond_list
from jaxdem.setup.materials import MaterialTable, material_table
from jaxdem.setup.meshes import WallMesh, wall_meshes
from jaxdem.setup.orientations import orientations
from jaxdem.setup.packs import PackSetup, packs_of
from jaxdem.setup.parcels import check_parcels, parcel_contact
from jaxdem.setup.shape_checks import check_shapes
from jaxdem.setup.shapes import ShapeTable, shape_table


@dataclasses.dataclass(frozen=True)
class ParticleSetup:
    """The particles of a scene; every property is computed when it is first asked for, and kept.

    Attributes:
        scene: that they belong to.
        table: its table `[particles]`.
        contact: its table `[contact]`, as it is between spheres of the size of the particles.
    """

    scene: Scene
    table: Particles
    contact: Contact

    @cached_property
    def packs(self) -> tuple[PackSetup, ...]:
        """The packs that the particles of the start lie in; () where positions are given."""
        return packs_of(self.scene, self.table)

    @property
    def count(self) -> int:
        """Number of particles at the start; a pack of a given number, which takes seconds, is not laid out for it."""
        return sum(pack.count for pack in self.packs) if self.packs else len(self.position)

    @property
    def is_started(self) -> bool:
        """Whether they are those of another run."""
        return False

    @property
    def placed(self) -> int:
        """Number of rows that another run has placed."""
        return 0

    @property
    def active(self) -> np.ndarray:
        """() or (N,) bool, which of the rows at the start are present."""
        return np.ones((), bool)

    @property
    def total(self) -> int:
        """Number of particles that there ever are."""
        return self.count + sum(len(coming.time) for coming in self.arrivals)

    @cached_property
    def position(self) -> np.ndarray:
        """(N, D) centres at the start [m]; not yet checked against each other.

        Raises:
            InputError: the pack cannot hold the particles, or the rows are wrong in shape or number.
        """
        if self.packs:
            return np.concatenate([pack.position for pack in self.packs])
        count, dimension = self.table.count, self.scene.dimension
        position = rows_of("particles.position", self.table.rows("position", dimension), dimension, of_frame=True)
        if position is None:
            return np.zeros((0, dimension))  # all come through inlets
        if count is not None and len(position) != count:
            limit = f"there are {len(position)} positions"
            raise InputError("particles.count", count, limit, "give as many positions as particles")
        if self.table.file is not None:  # programs let particles stand outside along periodic axes
            size = np.asarray(self.scene.domain.size)
            position = np.where(self.scene.periodic, position - size * np.floor(position / size), position)
        return position

    @property
    def given_velocity(self) -> str | Numbers | None:
        """Velocities at the start, as `rows_of` takes them: of `[particles]`, or of its packs."""
        dimension = self.scene.dimension
        if not any(pack.pack.velocity for pack in self.packs):
            return self.table.rows("velocity", dimension)
        each = [pack.pack.velocity or (0.0,) * dimension for pack in self.packs]
        return np.repeat(np.asarray(each), [pack.count for pack in self.packs], axis=0)

    @cached_property
    def present(self) -> Bodies:
        """Size, density and material of the particles at the start; those of a counted pack have room in it."""
        if len(self.packs) > 1:
            return joined([_each(pack.bodies, pack.count) for pack in self.packs])
        if self.packs:
            return self.packs[0].bodies
        names = tuple(material.name for material in self.scene.materials)
        return particle_bodies(self.table, names, self.count, self.scene.seed)

    @property
    def settles(self) -> bool:
        """Whether the particles come to rest before the run begins."""
        return any(pack.pack.kind == "settled" for pack in self.packs) and self.count > 0

    @cached_property
    def arrivals(self) -> tuple[Arrivals, ...]:
        """The particles of every inlet."""
        return arrivals(self.scene, self.table)

    @property
    def queues(self) -> tuple[Queue, ...]:
        """The rows of every inlet's particles: after those of the start, inlet by inlet."""
        found, first = [], self.count
        for coming in self.arrivals:
            found.append(Queue(first + np.arange(len(coming.time)), coming.time))
            first += len(coming.time)
        return tuple(found)

    @property
    def never(self) -> int:
        """Number of rows of particles that have not come in and never will."""
        return 0

    @cached_property
    def bodies(self) -> Bodies:
        """Size, density and material of all particles that there ever are."""
        if not self.arrivals:
            return self.present
        return joined([_each(self.present, self.count), *(coming.bodies for coming in self.arrivals)])

    @cached_property
    def shapes(self) -> ShapeTable | None:
        """The shapes; None where all particles are spheres."""
        return shape_table(self.table, self.scene.dimension)

    @cached_property
    def spheres(self) -> Bodies:
        """What touches: the particles, or the members of clumps."""
        return self.bodies if self.shapes is None else self.shapes.spheres(self.bodies)

    @property
    def members(self) -> int:
        """Rows of contacts and lists of a particle: most members of a clump, 1 of spheres."""
        return 1 if self.shapes is None else self.shapes.members(self.bodies.shape)

    @property
    def arm(self) -> float:
        """Farthest that the centre of a member of a clump is from that of its body, 0 of spheres [m]."""
        return 0.0 if self.shapes is None else self.shapes.arm(self.bodies)

    @property
    def contact_material(self) -> np.ndarray:
        """() or (m N,) material of every row of contacts."""
        material = self.bodies.material
        return material if material.ndim == 0 else np.tile(material, self.members)

    @cached_property
    def orientation(self) -> np.ndarray | None:
        """(N, 4) or, in 2-D, (N, 1) of all particles that there ever are; None of spheres."""
        if self.shapes is None:
            return None
        shape = np.broadcast_to(self.bodies.shape, self.total)
        return orientations(self.shapes, self.table, shape, self.count, self.scene.seed)

    @cached_property
    def meshes(self) -> tuple[WallMesh, ...]:
        """The walls that are meshes."""
        return wall_meshes(self.scene, self.contact, self.spheres.radius, self.members, self.gap_at_meshes)

    @cached_property
    def gap_at_meshes(self) -> float | None:
        """Gap up to which grains are in contact with a mesh; None where they touch, and without meshes [m]."""
        if not any(wall.kind == "mesh" for wall in self.scene.walls):
            return None
        return longest_gap(self) or None

    @cached_property
    def bonds(self) -> BondList | None:
        """The bonds that there ever are; None without."""
        return bond_list(self.scene, self.position, self.present.radius, self.active) if self.scene.bonds else None

    @cached_property
    def materials(self) -> MaterialTable | None:
        """Constants of the materials; None where there is one only."""
        return material_table(self.scene)


def _each(bodies: Bodies, count: int) -> Bodies:
    """The same with numbers for every one of `count` particles."""
    return Bodies(*(np.broadcast_to(column, count) for column in bodies))


def particle_setup(scene: Scene) -> ParticleSetup | None:
    """The particles of a scene; None in a scene without."""
    if scene.particles is None or scene.contact is None:
        return None
    check_parcels(scene, scene.particles)
    check_shapes(scene, scene.particles)
    return ParticleSetup(scene, scene.particles, parcel_contact(scene.contact, scene.particles.coarse_grain))

"""Which contacts a scene has: law, walls and materials; static."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxdem.numerics import vectors
from jaxdem.numerics.static import static
from jaxdem.particles import walls
from jaxdem.particles.adhesion import AT_TOUCH
from jaxdem.particles.bond_state import Bonding
from jaxdem.particles.capillary_bridge import CapillaryBridge
from jaxdem.particles.cohesion import Cohesion
from jaxdem.particles.contact import ContactLaw, ContactMaterial
from jaxdem.particles.lubrication import Lubrication
from jaxdem.particles.moving_walls import Piston, SurfaceMotion
from jaxdem.particles.pairs import Pairs
from jaxdem.particles.piston_travel import PistonTravel
from jaxdem.particles.rolling import RollingFriction
from jaxdem.particles.surfaces import Surface
from jaxdem.particles.wall_times import WallTimes
from jaxdem.particles.wear import WearLaw


@static
class MaterialIndex:
    """Which contact is of which pair of materials; static.

    Attributes:
        particle: material of all particles, or of each of the N.
        wall: of each of the S walls.
        pair: M x M, number of the pair that two materials make.
    """

    particle: int | tuple[int, ...]
    wall: tuple[int, ...]
    pair: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, particle: np.ndarray, wall: np.ndarray, pair: np.ndarray) -> MaterialIndex:
        """The same from arrays: () or (N,), (S,) and (M, M)."""
        own = particle.tolist()
        return cls(tuple(own) if particle.ndim else own, tuple(wall.tolist()), tuple(map(tuple, pair.tolist())))

    def between_particles(self, table: ContactMaterial, pairs: Pairs, identity: Array | None) -> ContactMaterial:
        """Numbers () or (P,) of the contacts between particles; `identity` (N,) of rows that are not in order."""
        if isinstance(self.particle, int):
            return _entries(table, np.asarray(self.pair)[self.particle, self.particle])
        own = jnp.asarray(self.particle)
        if identity is not None:
            own = own[jnp.maximum(identity, 0)]
        return _entries(table, jnp.asarray(self.pair)[own[pairs.first], own[pairs.second]])

    def with_walls(self, table: ContactMaterial, identity: Array | None, count: int) -> ContactMaterial:
        """Numbers (S, 1) or (S, N) of the contacts of all particles with the first `count` walls, S of them."""
        pair, wall = np.asarray(self.pair), np.asarray(self.wall)[:count]
        if identity is not None and not isinstance(self.particle, int):
            own = jnp.asarray(self.particle)[jnp.maximum(identity, 0)]
            return _entries(table, jnp.asarray(pair)[wall[:, None], own[None]])
        return _entries(table, pair[wall[:, None], np.atleast_1d(self.particle)[None]])

    def with_wall(self, table: ContactMaterial, wall: int, row: Array, identity: Array | None) -> ContactMaterial:
        """Numbers () or (1, M) of the contacts of M particles with one wall; `row` says which rows these are in."""
        of_wall = np.asarray(self.pair)[self.wall[wall]]
        if isinstance(self.particle, int):
            return _entries(table, of_wall[self.particle])
        if identity is not None:
            row = jnp.maximum(identity[jnp.minimum(row, len(identity) - 1)], 0)
        own = jnp.asarray(self.particle)[jnp.minimum(row, len(self.particle) - 1)]
        return _entries(table, jnp.asarray(of_wall)[own][None])


def _entries(table: ContactMaterial, number: Array | np.ndarray) -> ContactMaterial:
    found: ContactMaterial = jax.tree.map(lambda column: column if column.ndim == 0 else column[number], table)
    return found


@static
class MeshWall:
    """A wall that is a mesh; static.

    Attributes:
        number: of its list in `Neighbors.meshes`, and of what its contacts keep.
        usual: room that its list should have from the start, `MeshRoom.numbers`.
        wear: what contacts take from it; None for nothing: then no such term is compiled.
        cells: number of its triangles in the file.
    """

    number: int
    usual: tuple[int, ...] = ()
    wear: WearLaw | None = None
    cells: int = 0


@static
class ContactModel:
    """Which contacts a scene has; static.

    Attributes:
        law: between bodies that touch.
        rolling: rolling friction, or None: then no such term is compiled.
        sides: walls of the box.
        surfaces: further walls; none: then no such term is compiled.
        materials: None where all particles, and all walls, are of one material: then nothing is looked up.
        wall_times: when the surfaces are there; None where all always are.
        measured: numbers of the walls whose loads are summed; none: then no such term is compiled.
        cohesion: what pulls bodies together, or None: then no such term is compiled.
        motions: how each surface, and then each mesh, moves, None for one at rest; empty where all are at rest.
        pistons: walls that a force holds; their loads are measured.
        travel: where pistons meet walls; None where that is not looked at.
        meshes: walls that are meshes; none: then no such term is compiled.
        lists: number of meshes of the scene, those included that are not there now.
        bonds: where bonded grains are, or None: then no such term is compiled.
        lubrication: what the liquid in gaps does, or None: then no such term is compiled.
        wet_friction: whether friction depends on the film between bodies.
        energy: whether what contacts take and give is summed; without it no such term is compiled.
        heats: whether what they take is told of every particle too, to become heat.
    """

    law: ContactLaw
    rolling: RollingFriction | None
    sides: tuple[walls.BoxSide, ...]
    surfaces: tuple[Surface, ...] = ()
    materials: MaterialIndex | None = None
    wall_times: WallTimes | None = None
    measured: tuple[int, ...] = ()
    cohesion: Cohesion | None = None
    motions: tuple[SurfaceMotion | None, ...] = ()
    pistons: tuple[Piston, ...] = ()
    travel: PistonTravel | None = None
    meshes: tuple[MeshWall, ...] = ()
    lists: int = 0
    bonds: Bonding | None = None
    lubrication: Lubrication | None = None
    wet_friction: bool = False
    energy: bool = False
    heats: bool = False

    @property
    def walls(self) -> int:
        """Number of walls: the sides first, then the surfaces, then the meshes."""
        return self.analytic_walls + len(self.meshes)

    @property
    def analytic_walls(self) -> int:
        """Number of the sides and surfaces."""
        return len(self.sides) + len(self.surfaces)

    @property
    def measured_analytic(self) -> tuple[int, ...]:
        """Those of the measured walls that are sides or surfaces."""
        return tuple(k for k in self.measured if k < self.analytic_walls)

    def with_walls(self, kept: tuple[int, ...]) -> ContactModel:
        """The model with these of its walls, the sides among them, at all times."""
        sides, analytic = len(self.sides), self.analytic_walls
        surfaces = tuple(self.surfaces[k - sides] for k in kept if sides <= k < analytic)
        meshes = tuple(self.meshes[k - analytic] for k in kept if k >= analytic)
        materials = self.materials
        if materials is not None:
            materials = dataclasses.replace(materials, wall=tuple(materials.wall[k] for k in kept))
        measured = tuple(kept.index(k) for k in self.measured if k in kept)
        motions = tuple(self.motions[k - sides] for k in kept if k >= sides) if self.motions else ()
        pistons = tuple(
            dataclasses.replace(piston, walls=tuple(kept.index(k) for k in piston.walls)) for piston in self.pistons
        )
        return dataclasses.replace(
            self,
            surfaces=surfaces,
            materials=materials,
            wall_times=None,
            measured=measured,
            motions=motions if any(motions) else (),
            pistons=pistons,
            meshes=meshes,
        )

    @property
    def worn_cells(self) -> tuple[int | None, ...]:
        """Number of triangles of each mesh, None of one that does not wear."""
        return tuple(None if mesh.wear is None else mesh.cells for mesh in self.meshes)

    @property
    def wears(self) -> bool:
        """Whether a mesh wears."""
        return any(mesh.wear is not None for mesh in self.meshes)

    def history_size(self, dimension: int) -> int:
        """Number of components that a contact keeps: the tangential spring, the rolling spring and what cohesion
        remembers, each if there is any."""
        springs = 2 if self.rolling is not None and self.rolling.has_spring else 1
        return springs * vectors.angular_size(dimension) + self.memory

    @property
    def memory(self) -> int:
        """Number of components that cohesion keeps, the last ones."""
        return 0 if self.cohesion is None else self.cohesion.memory

    @property
    def attracts_over_gaps(self) -> bool:
        """Whether cohesion acts on bodies that do not overlap."""
        return self.cohesion is not None and not isinstance(self.cohesion, AT_TOUCH)

    @property
    def tracks_meshes(self) -> bool:
        """Whether contacts with meshes keep their overlap, from which the balance of energy has what a contact stored
        that is none of the next step; see `mesh_cohesion.lost_at_once`."""
        return self.energy

    @property
    def wet(self) -> bool:
        """Whether grains hold a film of liquid, from which bridges are made."""
        return isinstance(self.cohesion, CapillaryBridge)

"""The particles of a scene, and what several builders need of them, computed once."""

from __future__ import annotations

import dataclasses
from functools import cached_property

import numpy as np

from jaxdem.scene import Contact, Pack, Particles, Scene
from jaxdem.setup.arrivals import Arrivals, arrivals
from jaxdem.setup.bodies import Bodies, joined, particle_bodies
from jaxdem.setup.materials import MaterialTable, material_table
from jaxdem.setup.packs import check_random_pack, positions_of, random_positions
from jaxdem.setup.parcels import check_parcels, parcel_contact


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

    @property
    def count(self) -> int:
        """Number of particles at the start; a random pack, which takes seconds, is not laid out for it."""
        return len(self.position) if self._random_pack is None else self.table.count or 0

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
        if self._random_pack is None:
            return positions_of(self.scene, self.table)
        return random_positions(self.scene, self._random_pack, np.broadcast_to(self.present.radius, self.count))

    @cached_property
    def present(self) -> Bodies:
        """Size, density and material of the particles at the start; those of a random pack have room in it."""
        names = tuple(material.name for material in self.scene.materials)
        bodies = particle_bodies(self.table, names, self.count, self.scene.seed)
        if self._random_pack is not None:
            check_random_pack(self.scene, self._random_pack, np.broadcast_to(bodies.radius, self.count))
        return bodies

    @cached_property
    def arrivals(self) -> tuple[Arrivals, ...]:
        """The particles of every inlet."""
        return arrivals(self.scene, self.table)

    @cached_property
    def bodies(self) -> Bodies:
        """Size, density and material of all particles that there ever are."""
        if not self.arrivals:
            return self.present
        present = Bodies(*(np.broadcast_to(column, self.count) for column in self.present))
        return joined([present, *(coming.bodies for coming in self.arrivals)])

    @cached_property
    def materials(self) -> MaterialTable | None:
        """Constants of the materials; None where there is one only."""
        return material_table(self.scene)

    @property
    def _random_pack(self) -> Pack | None:
        """The pack, if it is random and holds particles."""
        pack = self.table.pack
        return pack if pack is not None and pack.kind == "random" and self.table.count else None


def particle_setup(scene: Scene) -> ParticleSetup | None:
    """The particles of a scene; None in a scene without."""
    if scene.particles is None or scene.contact is None:
        return None
    check_parcels(scene, scene.particles)
    return ParticleSetup(scene, scene.particles, parcel_contact(scene.contact, scene.particles.coarse_grain))

"""The packs of a scene: what their particles are and where they lie. Host, numpy."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from jaxdem.errors import InputError
from jaxdem.particles import growth, packing, random_packing, regions
from jaxdem.scene import Pack, Particles, Scene
from jaxdem.scene.domain import Box
from jaxdem.scene.particles import outer_factor, radius_range
from jaxdem.setup.bodies import Bodies, particle_bodies
from jaxdem.setup.regions import refuse_crossing, region_space, require_in_box
from jaxdem.setup.shapes import shape_table
from jaxdem.setup.solid_fraction import count_for, require_reachable

MOST_PLACES = 20_000_000
"""Places that a pack may have; more would fill the memory before the first particle stands."""


@dataclasses.dataclass(frozen=True)
class PackSetup:
    """A pack of a scene; every property is computed when it is first asked for, and kept.

    Attributes:
        scene: that it belongs to.
        pack: the table.
        table: what its particles are; see `Particles.of_pack`.
        key: of the pack in the scene.
        number: of the pack, the first is 0.
    """

    scene: Scene
    pack: Pack
    table: Particles
    key: str
    number: int

    @cached_property
    def count(self) -> int:
        """Number of particles; a pack with a given number, which takes seconds, is not laid out for it.

        Raises:
            InputError: see `position`.
        """
        if self.pack.solid_fraction is not None:
            return count_for(self)
        given = self.table.count
        return given if given is not None and (self.pack.is_counted or given == 0) else len(self.position)

    @cached_property
    def bodies(self) -> Bodies:
        """Size, density and material of its particles; those of a counted pack have room in it as far as one can tell.

        Raises:
            InputError: see `particle_bodies`; or the particles fill the pack to more than is possible.
        """
        bodies = self.bodies_of(self.count)
        if self.pack.is_counted and self.count:
            require_reachable(self, np.broadcast_to(self._outer(bodies), self.count))
        return bodies

    def bodies_of(self, count: int) -> Bodies:
        """What so many particles of this pack would be."""
        names = tuple(material.name for material in self.scene.materials)
        return particle_bodies(self.table, names, count, self.seed)

    def _outer(self, bodies: Bodies) -> np.ndarray:
        """() or (N,) radius of what is packed: of the particles, or of the spheres that hold clumps [m]."""
        shapes = shape_table(self.table, self.scene.dimension)
        return bodies.radius if shapes is None else shapes.outer(bodies)

    @property
    def seed(self) -> int | list[int]:
        """Of the random numbers of this pack: that of the scene for the first."""
        return self.scene.seed if self.number == 0 else [self.scene.seed, 5, self.number]

    @cached_property
    def space(self) -> regions.Region:
        """Where it lies. A grown pack goes round the box along periodic axes that it spans, others have sides there.

        Raises:
            InputError: its keys do not fit the box.
        """
        pack, box = self.pack, self.scene.box
        closed = box if pack.kind == "grown" else Box(box.size, (False,) * len(box.size))
        if pack.region is not None:
            largest = radius_range(self.table)[1] * outer_factor(self.table, self.scene.dimension)
            found = region_space(f"{self.key}.region", pack.region, closed, largest)
            require_in_box(f"{self.key}.region", found, box)
            return found
        if pack.kind == "polygon":
            across = None if len(box.size) == 2 else (0.0, box.size[1])
            return regions.polygon(_corners(self.key, pack), across)
        start, stop = (_corner(f"{self.key}.{name}", getattr(pack, name), len(box.size)) for name in ("start", "stop"))
        if pack.is_counted:
            self._check_box(start, stop)
        whole = [
            wraps and b - a >= side for a, b, side, wraps in zip(start, stop, box.size, closed.periodic, strict=True)
        ]
        return regions.box(start.tolist(), stop.tolist(), whole)

    @cached_property
    def position(self) -> np.ndarray:
        """(N, D) centres [m]; not yet checked against each other. Those of a settled pack have not fallen yet.

        Raises:
            InputError: the pack cannot hold the particles, or its keys do not fit the box.
        """
        if self.table.count == 0:
            return np.zeros((0, self.scene.dimension))
        if self.pack.is_counted:
            return self._made()
        packed, count = self._filled(), self.table.count
        if count is not None and len(packed) < count:
            limit = f"the pack holds {len(packed)} particles"
            remedy = f"enlarge the pack, lower {self.key}.spacing, or lower the count"
            raise InputError(self.count_key, count, limit, remedy)
        if len(packed) == 0:
            remedy = f"enlarge the pack (all lengths are in m), or set {self.count_key} = 0"
            remedy += " for a scene that starts empty" if self.number == 0 else ""
            raise InputError(self.key, self.pack.kind, "holds no particle", remedy)
        # Rows are filled from below, so a pack that is not full has a level top.
        return packed[:count]

    @property
    def count_key(self) -> str:
        """The key that gives its number of particles."""
        if self.pack.solid_fraction is not None:
            return f"{self.key}.solid_fraction"
        own = (
            self.pack.count is not None or self.scene.particles is None or isinstance(self.scene.particles.pack, tuple)
        )
        return f"{self.key}.count" if own else "particles.count"

    @property
    def radius_key(self) -> str:
        """The key that gives the radii of its particles."""
        for place, given in ((self.key, self.pack), ("particles", self.table)):
            if any(one.radius is not None for one in given.species or ()):
                return f"{place}.species"
            for name in ("distribution", "radius"):
                if getattr(given, name) is not None:
                    return f"{place}.{name}"
        return "particles.radius"

    @property
    def solid_fraction(self) -> float:
        """Volume of its particles over that of its region, before it settles; in 2-D area of the discs [-]."""
        return random_packing.random_solid_fraction(self.space, np.broadcast_to(self.bodies.radius, self.count), 1.0)

    def _check_box(self, start: np.ndarray, stop: np.ndarray) -> None:
        box = self.scene.domain.size
        if (stop <= start).any():
            limit = f"must be above start = {self.pack.start}"
            raise InputError(f"{self.key}.stop", self.pack.stop, limit, "exchange start and stop")
        if (start < 0.0).any() or (stop > np.asarray(box)).any():
            limit = f"start and stop must lie in the box, 0 ... {box} m"
            raise InputError(f"{self.key}.stop", self.pack.stop, limit, "move them into the box")

    def _made(self) -> np.ndarray:
        """Centres of a pack whose particles are known."""
        radius = np.broadcast_to(self._outer(self.bodies), self.count)
        if self.pack.kind == "grown":
            position, part = growth.grown_pack(self.space, radius, self.pack.gap, self.seed)
            if part < 1.0:
                reached = self.solid_fraction * part**self.scene.dimension
                limit = f"the particles would fill the region to {self.solid_fraction:.4g}; {reached:.4g} was reached"
                remedy = "lower it to that, enlarge the region, or lower the spacing"
                raise InputError(self.count_key, self.pack.solid_fraction or self.count, limit, remedy)
            return position
        position, placed = random_packing.random_pack(self.space, radius, self.pack.gap, self.seed)
        if not placed.all():
            fraction = random_packing.random_solid_fraction(self.space, radius, self.pack.gap)
            limit = (
                f"only {int(placed.sum())} of them have room in the region of the {self.pack.kind} pack, which they "
                f"would fill to {100 * fraction:.4g} % with their spacing; a narrow region holds less"
            )
            remedy = f'use a lattice ({self.key}.kind = "lattice"), or enlarge the box'
            raise InputError(self.count_key, self.pack.solid_fraction or self.count, limit, remedy)
        return position

    def _filled(self) -> np.ndarray:
        """All centres of a lattice or a polygon."""
        smallest, largest = radius_range(self.table)
        largest *= outer_factor(self.table, self.scene.dimension)
        spacing, jitter = 2.0 * largest * self.pack.gap, (self.pack.jitter or 0.0) * smallest
        box = self.scene.domain.size
        if self.pack.kind == "polygon":
            vertices = np.asarray(_corners(self.key, self.pack), float)
            _check_places(f"{self.key}.vertices", (*np.ptp(vertices, axis=0), *box[1:-1]), spacing)
            points = packing.polygon_pack(vertices, box, largest, spacing, jitter)
        else:
            sides = np.subtract(*self.space.bounds[::-1])
            name = "stop" if self.pack.region is None else "region"
            _check_places(f"{self.key}.{name}", tuple(sides), spacing)
            points = packing.lattice_pack(self.space, largest, spacing, jitter)
        return packing.jittered(points, jitter, self.seed)


def packs_of(scene: Scene, particles: Particles) -> tuple[PackSetup, ...]:
    """The packs of a scene; refuses regions that overlap.

    Raises:
        InputError: naming the two packs.
    """
    found = tuple(
        PackSetup(scene, pack, particles.of_pack(pack), particles.pack_key(k), k)
        for k, pack in enumerate(particles.packs)
    )
    for first, second in itertools.combinations(found, 2):
        if regions.meet(first.space, second.space, scene.seed):
            limit = f"its region overlaps that of {first.key}"
            raise InputError(second.key, second.pack.kind, limit, "move the packs apart, or make one smaller")
    return found


def _corners(key: str, pack: Pack) -> tuple[tuple[float, ...], ...]:
    corners = pack.vertices or ()
    if len(corners) < 3 or any(len(corner) != 2 for corner in corners):
        limit = "needs at least three corners (x, vertical)"
        raise InputError(f"{key}.vertices", pack.vertices, limit, "add corners to the polygon")
    refuse_crossing(f"{key}.vertices", corners)
    return corners


def _corner(key: str, corner: tuple[float, ...] | None, dimension: int) -> np.ndarray:
    if corner is None or len(corner) != dimension:
        raise InputError(key, corner, f"needs {dimension} numbers", f"give {dimension} numbers")
    return np.asarray(corner)


def _check_places(key: str, sides: Sequence[float], spacing: float) -> None:
    """Refuses a pack between whose sides [m] lie too many places."""
    places = math.prod(max(side, 0.0) / spacing + 1.0 for side in sides)
    if places > MOST_PLACES:
        raise InputError(
            key,
            f"sides of {', '.join(f'{side:.4g}' for side in sides)} m",
            f"the pack has about {places:.3g} places {spacing:.3g} m apart, the limit is {MOST_PLACES}",
            "make the pack smaller, or raise particles.radius or particles.pack.spacing",
        )

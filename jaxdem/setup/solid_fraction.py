"""How many particles fill a region to a solid fraction, and how far a pack can be filled. Host, numpy."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from jaxdem.errors import InputError
from jaxdem.particles import growth, random_packing
from jaxdem.particles.close_packing import close_packing
from jaxdem.particles.regions import Region, ball_size
from jaxdem.scene import Pack, Particles
from jaxdem.setup.bodies import Bodies

TRIALS = 20
"""Numbers of particles that are tried for a solid fraction; each gives the next by the mean size of its particles."""

ALIKE = 1.05
"""Largest over smallest radius up to which particles are taken for equal."""

DENSEST_DISCS = 0.95
"""Solid fraction above which discs of several sizes are refused without a trial."""

UNSURE = 0.02
"""By how much spheres of several sizes may be denser than `close_packing` says before they are refused without a
trial: it agrees with simulated packings to 0.01."""

MOST = 20_000_000
"""Particles that a pack may have; more is a slip of a unit."""


class Fillable(Protocol):
    """What this module needs of a `PackSetup`."""

    @property
    def pack(self) -> Pack:
        """The table."""
        ...

    @property
    def table(self) -> Particles:
        """What its particles are."""
        ...

    @property
    def key(self) -> str:
        """Of the pack in the scene."""
        ...

    @property
    def space(self) -> Region:
        """Its region."""
        ...

    @property
    def count_key(self) -> str:
        """The key that gives the number of particles."""
        ...

    @property
    def radius_key(self) -> str:
        """The key that gives the radii of the particles."""
        ...

    def bodies_of(self, count: int) -> Bodies:
        """What so many particles would be."""
        ...


def count_for(pack: Fillable) -> int:
    """The number of particles that comes nearest to the solid fraction of a pack; their sizes change with it.

    Raises:
        InputError: it is less than one particle, or far too many.
    """
    fraction = pack.pack.solid_fraction or 0.0
    wanted, dimension = fraction * pack.space.volume, pack.space.dimension
    best, count, error = 0, 1000, np.inf
    for _ in range(TRIALS):
        sizes = np.broadcast_to(pack.bodies_of(count).radius, count)
        volume = ball_size(dimension) * float(np.sum(sizes**dimension))
        if abs(volume - wanted) < error:
            best, error = count, abs(volume - wanted)
        following = max(round(count * wanted / volume), 1)
        if following > MOST:
            limit = f"needs about {following:.3g} particles, the limit is {MOST}"
            raise InputError(pack.count_key, fraction, limit, "make the region smaller, or the particles larger")
        if following == count:
            break
        count = following
    if error > 0.5 * wanted:
        limit = "is less than that of a single particle in the region"
        raise InputError(pack.count_key, fraction, limit, "raise it, or use smaller particles")
    return best


def _densest(dimension: int, radius: np.ndarray) -> float:
    """Solid fraction above which particles of radii (N,) [m] certainly have no disordered pack without overlaps."""
    if float(radius.max() / radius.min()) <= ALIKE:
        return growth.DISORDERED[dimension]
    return DENSEST_DISCS if dimension == 2 else min(close_packing(radius) + UNSURE, 1.0)


def require_reachable(pack: Fillable, radius: np.ndarray) -> None:
    """Refuses a pack that certainly cannot hold particles of these radii, (N,) [m]."""
    table, space, ratio = pack.pack, pack.space, pack.table.coarse_grain
    fraction = random_packing.random_solid_fraction(space, radius, table.gap)
    sides = np.where(space.wraps, np.inf, np.subtract(*space.bounds[::-1]))
    if 2.0 * float(radius.max()) > sides.min():
        limit = f"a particle of radius {radius.max():.4g} m does not fit into the region, {sides.min():.4g} m wide"
        grain = float(f"{radius.max() / ratio:.4g}")
        smaller = "use smaller particles" if ratio == 1.0 else f"lower particles.coarse_grain, which is {ratio:g}"
        raise InputError(pack.radius_key, grain, limit, f"{smaller}, or enlarge the region")
    if table.kind == "grown":
        largest = _densest(space.dimension, radius)
        remedy = "enlarge the region"
    else:
        largest = random_packing.REACHABLE[space.dimension]
        remedy = f'use a lattice ({pack.key}.kind = "lattice") or kind = "grown", enlarge the box'
    if fraction > largest:
        limit = (
            f"the particles, with their spacing, fill {100 * fraction:.3g} % of the region of the {table.kind} pack; "
            f"the limit is {100 * largest:.3g} %"
        )
        fewer = f"lower {pack.count_key}"
        if ratio != 1.0 and table.solid_fraction is None:
            fewer += f" (of parcels, {ratio**space.dimension:.6g} grains each)"
        remedy = f"{fewer}, {remedy}, or lower {pack.key}.spacing"
        raise InputError(pack.count_key, table.solid_fraction or len(radius), limit, remedy)

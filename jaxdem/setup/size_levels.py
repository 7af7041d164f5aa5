"""Whether grains are looked for by levels of size, the levels, and the skin of their list. Host side, plain numbers."""

from __future__ import annotations

import numpy as np

from jaxdem.particles.neighbors import NeighborGeometry
from jaxdem.particles.size_levels import SizeLevels
from jaxdem.scene import Contact

SKIN = 0.4
"""The automatic skin, in mean diameters. Measured in discs of 1 : 10: with 0.2 the list is made twice as often and has
room for as many pairs, 6 % slower; with 0.8 it is longer, 25 % slower."""

LEVEL_RATIO = 2.0
"""Largest over smallest diameter within a level."""

LEVELS_PAY = 1.5
"""Levels are used where a cell as wide as the largest grain holds so many times the grains of a cell of equal ones: at
least as many are looked at when one table is made. That a list then has so many times the pairs is true of clumps, and
of slabs: on one device one table lists pairs by the sizes of both."""


def pairs_over_equal(radius: np.ndarray, dimension: int) -> float:
    """Grains within reach of the largest grain's diameter, over those of equal grains, in a dense pack [-]: what cells
    as wide hold, and pairs in a list that reaches so far.

    (largest radius / radius of the mean volume)^D: as many grains of the mean volume as fit into that reach.
    """
    if radius.size == 0:
        return 1.0
    return float(np.max(radius) ** dimension / np.mean(np.power(radius, dimension)))


def by_levels(radius: np.ndarray, dimension: int, members: int) -> bool:
    """Whether spheres of radius () or (N,) [m], `members` of a body, are looked for by levels: spheres alone."""
    return members == 1 and pairs_over_equal(radius, dimension) >= LEVELS_PAY


def list_skin(contact: Contact, radius: np.ndarray, dimension: int, members: int) -> float:
    """Skin of the neighbour list [m]: in largest diameters, the automatic one of spheres in mean ones, where each pair
    is listed by its own sizes."""
    if contact.skin == "auto" and members == 1 and radius.size:
        return SKIN * 2.0 * float(np.mean(radius))
    return single_skin(contact, radius)


def single_skin(contact: Contact, radius: np.ndarray) -> float:
    """Skin of a list in which all reach as far as the largest [m]: of clumps. In largest diameters; in mean ones it
    would be shorter, and made more often: not measured. With bonds it says how wide slabs are at least, and how
    long bonds may be there."""
    return (SKIN if contact.skin == "auto" else contact.skin) * 2.0 * float(np.max(radius, initial=0.0))


def size_levels(geometry: NeighborGeometry, contact: Contact, radius: np.ndarray, members: int) -> SizeLevels | None:
    """The levels, or None where one table serves all grains as well.

    Args:
        geometry: of the list.
        contact: table of the scene.
        radius: () or (N,) of all spheres that there ever are [m].
        members: of a body.
    """
    if not by_levels(radius, len(geometry.box), members):
        return None
    gap = geometry.cutoff - 2.0 * float(np.max(radius, initial=0.0))
    ordered, found = np.unique(radius), []
    while ordered.size:
        found.append(float(ordered[-1]))
        ordered = ordered[ordered < ordered[-1] / LEVEL_RATIO]
    return SizeLevels.of(tuple(found[::-1]), gap, geometry.skin, geometry.box, single_skin(contact, radius))

"""Whether grains are looked for by levels of size, the levels, and the skin of their list. Host side, plain numbers."""

from __future__ import annotations

import numpy as np

from jaxdem.particles.neighbors import NeighborGeometry
from jaxdem.particles.size_levels import SizeLevels
from jaxdem.scene import Contact

SKIN = 0.4
"""The automatic skin, in mean diameters: the widest at which a dense layer of equal grains still has fewer neighbours
than `USUAL_SLOTS`. The list is rebuilt half as often as with 0.2, and no wider."""

LEVEL_RATIO = 2.0
"""Largest over smallest diameter within a level."""

LEVELS_PAY = 1.5
"""Levels are used where a list of a dense pack that reaches as far as the largest grain would have so many times the
pairs of equal grains."""


def pairs_over_equal(radius: np.ndarray, dimension: int) -> float:
    """Pairs in a list that reaches as far as the largest grain, over those of equal grains, in a dense pack [-].

    (largest radius / radius of the mean volume)^D: as many grains of the mean volume as fit into that reach.
    """
    if radius.size == 0:
        return 1.0
    return float(np.max(radius) ** dimension / np.mean(np.power(radius, dimension)))


def by_levels(radius: np.ndarray, dimension: int, members: int) -> bool:
    """Whether spheres of radius () or (N,) [m], `members` of a body, are looked for by levels: spheres alone."""
    return members == 1 and pairs_over_equal(radius, dimension) >= LEVELS_PAY


def list_skin(contact: Contact, radius: np.ndarray, dimension: int, members: int) -> float:
    """Skin of the neighbour list [m]: in largest diameters, the automatic one of spheres in mean ones."""
    if contact.skin == "auto" and members == 1 and radius.size:
        return SKIN * 2.0 * float(np.mean(radius))
    return single_skin(contact, radius)


def single_skin(contact: Contact, radius: np.ndarray) -> float:
    """Skin of a list without levels [m]."""
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

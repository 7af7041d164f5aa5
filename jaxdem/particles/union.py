"""Volume, centre, inertia and surface of a union of spheres, by exact integration. Host, numpy.

The union is cut by planes z = const. A cut is a union of discs, whose area and moments are sums over the arcs of its
edge (Green's theorem),

    A = 1/2 oint x dy - y dx, int x dA = 1/2 oint x^2 dy, int x^2 dA = 1/3 oint x^3 dy, int x y dA = 1/2 oint x^2 y dy,

and its integral over z runs from one plane to the next at which spheres begin, end or meet. Between two such planes the
integrand is analytic but for square roots at the ends, which a substitution takes away, so that a Gauss rule converges
to rounding. The surface of a sphere between two planes is r dz times the angle that the others leave open (Archimedes).
What spheres share counts once.
"""

from __future__ import annotations

import functools
import itertools
import math
from typing import NamedTuple

import numpy as np

SLICES = 24
"""Points of the rule between two planes."""

ON_ARC = 20
"""Points of the rule on an arc; the integrands are sums of sines and cosines of up to four times the angle."""

CHUNK = 400
"""Planes that are cut at once."""


class Union(NamedTuple):
    """Geometry of a union of spheres of density 1.

    Attributes:
        volume: [m3].
        surface: [m2].
        centre: (3,) of mass [m].
        moments: (3, 3) of inertia about the centre, over the volume [m2].
    """

    volume: float
    surface: float
    centre: np.ndarray
    moments: np.ndarray

    @property
    def radius(self) -> float:
        """Of the sphere of the same volume [m]."""
        return float((0.75 * self.volume / math.pi) ** (1.0 / 3.0))

    @property
    def sphericity(self) -> float:
        """Surface of the sphere of the same volume over that of the union [-]."""
        return float(4.0 * math.pi * self.radius**2 / self.surface)


def covered(centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """(M,) bool, spheres that lie within another one, of equal ones the later: the union is the same without them.

    Args:
        centres: (M, 3) [m].
        radii: (M,) [m].
    """
    apart = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    inside = apart + radii[:, None] <= radii[None] * (1.0 + 1e-12)
    same = inside & inside.T
    number = np.arange(len(radii))
    return np.any(inside & (~same | (number[:, None] > number[None])), axis=1)


def union_of_spheres(centres: np.ndarray, radii: np.ndarray) -> Union:
    """Volume, surface, centre and inertia of a union of spheres, which may overlap or lie apart.

    Args:
        centres: (M, 3) [m].
        radii: (M,) positive [m].
    """
    shift, scale = centres.mean(axis=0), float(np.max(radii))
    kept = ~covered(centres, radii)
    found = np.zeros(11)
    centres, radii = (centres[kept] - shift) / scale, radii[kept] / scale
    heights, weights = _planes(centres, radii)
    for first in range(0, len(heights), CHUNK):
        part = slice(first, first + CHUNK)
        found += weights[part] @ _cuts(centres, radii, heights[part])
    volume, surface = found[0], found[1]
    centre = found[2:5] / volume
    second = np.empty((3, 3))
    second[np.triu_indices(3)] = found[5:] / volume
    second = np.triu(second) + np.triu(second, 1).T - np.outer(centre, centre)
    moments = np.trace(second) * np.eye(3) - second
    return Union(volume * scale**3, surface * scale**2, shift + scale * centre, scale**2 * moments)


def _planes(centres: np.ndarray, radii: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Heights and weights of the rule along z.

    z = a + (b - a) (1 - cos t) / 2 from a to b: square roots at the ends become analytic in t.
    """
    ends = _events(centres, radii)
    steps = np.diff(ends)
    keep = steps > 1e-13
    low, steps = ends[:-1][keep], steps[keep]
    t, weight = np.polynomial.legendre.leggauss(SLICES)
    t = 0.5 * math.pi * (t + 1.0)
    heights = low[:, None] + steps[:, None] * 0.5 * (1.0 - np.cos(t))[None]
    weights = steps[:, None] * (0.25 * math.pi * np.sin(t) * weight)[None]
    return heights.ravel(), weights.ravel()


def _events(centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Heights, in order, at which a sphere begins or ends, or two or three of their surfaces meet."""
    z = centres[:, 2]
    found = [z - radii, z + radii]
    meeting: list[tuple[int, int]] = []
    for i, j in itertools.combinations(range(len(radii)), 2):
        apart = centres[j] - centres[i]
        distance = float(np.linalg.norm(apart))
        if not abs(radii[i] - radii[j]) < distance < radii[i] + radii[j]:
            continue
        meeting.append((i, j))
        along = 0.5 * (distance + (radii[i] ** 2 - radii[j] ** 2) / distance)
        across = math.sqrt(max(radii[i] ** 2 - along**2, 0.0))
        normal = apart / distance
        middle = z[i] + along * normal[2]
        reach = across * math.hypot(normal[0], normal[1])
        found.append(np.asarray([middle - reach, middle + reach]))
    near = set(meeting)
    for (i, j), k in itertools.product(meeting, range(len(radii))):
        if k > j and (i, k) in near and (j, k) in near:
            found.append(_triple(centres[[i, j, k]], radii[[i, j, k]]))
    return np.unique(np.concatenate(found))


def _triple(centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Heights of the two points that lie on three spheres; none where there is none."""
    one, other = centres[1] - centres[0], centres[2] - centres[0]
    normal = np.cross(one, other)
    size = float(normal @ normal)
    if size < 1e-24:
        return np.zeros(0)
    right = 0.5 * (radii[0] ** 2 - radii[1:] ** 2 + np.asarray([one @ one, other @ other]))
    base = (right[0] * np.cross(other, normal) + right[1] * np.cross(normal, one)) / size
    rest = radii[0] ** 2 - float(base @ base)
    if rest < 0.0:
        return np.zeros(0)
    away = math.sqrt(rest / size) * normal[2]
    middle = centres[0, 2] + base[2]
    return np.asarray([middle - away, middle + away])


def _cuts(centres: np.ndarray, radii: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """(Z, 11) of the cuts at heights (Z,): area, surface per height, first and second moments."""
    squared = radii[None] ** 2 - (heights[:, None] - centres[None, :, 2]) ** 2
    disc = np.sqrt(np.maximum(squared, 0.0))
    begin, end = _open_arcs(centres, disc)
    angle = end - begin
    cut, sphere, arc = np.nonzero(angle > 0.0)
    node, weight = np.polynomial.legendre.leggauss(ON_ARC)
    half = 0.5 * angle[cut, sphere, arc][:, None]
    theta = begin[cut, sphere, arc][:, None] + half * (node + 1.0)
    rho = disc[cut, sphere][:, None]
    cosine, sine = np.cos(theta), np.sin(theta)
    x = centres[sphere, 0][:, None] + rho * cosine
    y = centres[sphere, 1][:, None] + rho * sine
    dx, dy = -rho * sine * half * weight, rho * cosine * half * weight

    def around(terms: np.ndarray) -> np.ndarray:
        return np.bincount(cut, terms.sum(axis=1), len(heights))

    area = 0.5 * around(x * dy - y * dx)
    first_x, first_y = 0.5 * around(x**2 * dy), -0.5 * around(y**2 * dx)
    second = around(x**3 * dy) / 3.0, 0.5 * around(x**2 * y * dy), -around(y**3 * dx) / 3.0
    surface = (radii[None] * angle.sum(axis=2) * (squared > 0.0)).sum(axis=1)
    z = heights
    return np.stack(
        (
            area, surface, first_x, first_y, z * area,
            second[0], second[1], z * first_x, second[2], z * first_y, z**2 * area,
        ),
        axis=1,
    )  # fmt: skip


def _open_arcs(centres: np.ndarray, disc: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the arcs begin and end that are left of every disc, (Z, M, 2 M + 1) each; equal where there is none.

    Args:
        centres: (M, 3).
        disc: (Z, M) radii of the discs, 0 for none.
    """
    count = len(centres)
    apart = centres[None, :, :2] - centres[:, None, :2]
    distance = np.hypot(apart[..., 0], apart[..., 1])
    direction = np.arctan2(apart[..., 1], apart[..., 0])[None]
    own, other, between = disc[:, :, None], disc[:, None, :], distance[None]
    safe = np.where((own > 0.0) & (between > 0.0), 2.0 * own * between, 1.0)
    cosine = (own**2 + between**2 - other**2) / safe
    half = np.arccos(np.clip(cosine, -1.0, 1.0))
    within = (between + own <= other) & ~np.eye(count, dtype=bool)[None]
    half = np.where(within, math.pi, np.where((own > 0.0) & (other > 0.0) & (between > 0.0), half, 0.0))
    half = np.where(own > 0.0, half, math.pi)  # no disc: nothing is open
    half = np.where(np.eye(count, dtype=bool)[None] & (own > 0.0), 0.0, half)
    turn = 2.0 * math.pi
    begin = np.mod(direction - half, turn)
    end = begin + 2.0 * half
    # An arc that goes beyond a whole turn is two.
    starts = np.concatenate((begin, np.zeros_like(begin)), axis=2)
    ends = np.concatenate((np.minimum(end, turn), np.maximum(end - turn, 0.0)), axis=2)
    order = np.argsort(starts, axis=2)
    starts, ends = np.take_along_axis(starts, order, 2), np.take_along_axis(ends, order, 2)
    closed = np.maximum.accumulate(ends, axis=2)
    open_from = np.concatenate((np.zeros_like(closed[..., :1]), closed), axis=2)
    open_to = np.concatenate((starts, np.full_like(closed[..., :1], turn)), axis=2)
    return open_from, np.maximum(open_to, open_from)


def shadows(centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """(3,) areas of the projections of a union of spheres along the three axes [m2]."""
    found = []
    for axis in range(3):
        turned = np.roll(np.asarray(centres, float), 2 - axis, axis=1)  # the axis becomes z
        flat = turned * np.asarray([1.0, 1.0, 0.0])
        kept = ~covered(flat, radii)
        found.append(float(_cuts(flat[kept], radii[kept], np.zeros(1))[0, 0]))
    return np.asarray(found)


@functools.lru_cache(maxsize=256)
def union_of(centres: tuple[tuple[float, ...], ...], radii: tuple[float, ...]) -> Union:
    """`union_of_spheres` of numbers, found once."""
    return union_of_spheres(np.asarray(centres, float), np.asarray(radii, float))


def outer_radius(centres: tuple[tuple[float, ...], ...], radii: tuple[float, ...]) -> float:
    """Radius of the sphere about the centre of mass that holds a union, over that of the sphere of its volume [-]."""
    found = union_of(centres, radii)
    reach = np.linalg.norm(np.asarray(centres, float) - found.centre, axis=1) + np.asarray(radii, float)
    return 1.0 if len(radii) == 1 else float(reach.max()) / found.radius

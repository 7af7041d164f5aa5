"""What the bonds of a scene add to the stability of its contact step. Host side."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from jaxdem.setup.particles import ParticleSetup

SAFETY = 0.5
"""Automatic contact step over the stability limit of the bonds alone: the stiffest vibration then has twelve steps a
period, and its frequency is 5 % off [-]."""


def bond_growth(particles: ParticleSetup) -> Callable[[float], float] | None:
    """A bound on dt^2 omega^2 of the grains on their bonds alone, by the contact step dt [s]; None without bonds.

    Each grain's mass and moment of inertia are shared out among its bonds by their stiffness. A structure vibrates at
    most as fast as the fastest of its bonds with these shares (Irons), and a bond between two bodies has closed forms:
    stretching, twisting, and the two roots of shear with bending. A dashpot counts 4 dt c beside dt^2 k at most, see
    `contact_limit.contact_stability_limit`.

    Source: B. M. Irons, Int. J. Numer. Methods Eng. 2 (1970) 5-12.
    """
    bonds, scene = particles.bonds, particles.scene
    if bonds is None or len(bonds.first) == 0:
        return None
    radius, density = (np.broadcast_to(x, particles.total) for x in (particles.bodies.radius, particles.bodies.density))
    mass = 4.0 / 3.0 * np.pi * radius**3 * density
    inertia = 0.4 * mass * radius**2
    ends = bonds.first, bonds.second
    normal, shear, factor, ratio = (
        np.asarray([getattr(bond, name) or 0.0 for bond in scene.bonds])[bonds.table]
        for name in ("normal_stiffness", "shear_stiffness", "radius_factor", "damping")
    )
    young, across = np.asarray([bond.moduli for bond in scene.bonds])[bonds.table].T
    normal, shear = normal + young / bonds.length, shear + across / bonds.length
    squared = (factor * np.minimum(radius[ends[0]], radius[ends[1]])) ** 2
    area = np.pi * squared
    springs = normal * area, shear * area, 0.25 * squared * normal * area, 0.5 * squared * shear * area
    excess = 0.5 * (radius[ends[0]] - radius[ends[1]])
    arms = 0.5 * bonds.length + excess, 0.5 * bonds.length - excess

    masses = _inverse_shares(mass, ends, np.maximum(springs[0], springs[1]))
    lever = 0.25 * bonds.length**2
    inertias = _inverse_shares(inertia, ends, np.maximum(springs[2], springs[3]) + lever * springs[1])
    own_mass, own_inertia = (1.0 / (1.0 / x[ends[0]] + 1.0 / x[ends[1]]) for x in (mass, inertia))
    dashpots = [2.0 * ratio * np.sqrt(own_mass * k) for k in springs[:2]]
    dashpots += [2.0 * ratio * np.sqrt(own_inertia * k) for k in springs[2:]]

    # Times by which the dashpots are longer than the springs are stiff.
    late = [c / k for c, k in zip(dashpots, springs, strict=True)]
    turned = arms[0] ** 2 * inertias[0] + arms[1] ** 2 * inertias[1]
    slide, bend = springs[1] * (masses[0] + masses[1] + turned), springs[2] * (inertias[0] + inertias[1])
    cross = np.sqrt(springs[1] * springs[2]) * (arms[1] * inertias[1] - arms[0] * inertias[0])
    modes = [
        (springs[0] * (masses[0] + masses[1]), late[0]),
        (0.5 * (slide + bend) + np.hypot(0.5 * (slide - bend), cross), np.maximum(late[1], late[2])),
    ]
    if scene.dimension == 3:
        modes.append((springs[3] * (inertias[0] + inertias[1]), late[3]))
    squares, delays = (np.concatenate(columns) for columns in zip(*modes, strict=True))

    def growth(step: float) -> float:
        return float(np.max(squares * (step**2 + 4.0 * step * delays)))

    return growth


def _inverse_shares(
    whole: np.ndarray, ends: tuple[np.ndarray, np.ndarray], weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(B,) of either end: one over the share of (N,) that the bond has of its grain."""
    total = sum(np.bincount(end, weight, len(whole)) for end in ends)
    return tuple(total[end] / (weight * whole[end]) for end in ends)  # type: ignore[return-value, index]


def bond_limit(growth: Callable[[float], float] | None) -> float:
    """Stability limit of the contact step for the bonds alone; infinite without [s]."""
    if growth is None:
        return float("inf")
    low, high = 0.0, 1.0
    while growth(high) < 4.0:
        high *= 2.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if growth(middle) <= 4.0 else (low, middle)
        if high - low < 1e-12 * high:
            break
    return low

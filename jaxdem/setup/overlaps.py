"""How deep particles may overlap each other and walls at the start, and the refusal of what is deeper. Host side."""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import numpy as np
from jax import Array

from jaxdem.errors import InputError
from jaxdem.numerics import vectors
from jaxdem.particles import packing
from jaxdem.particles.integrate import ParticleState, split_low
from jaxdem.particles.surfaces import Surface, surface_contacts
from jaxdem.scene import Scene
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.walls import wall_keys
from jaxdem.structure import TimeSteps

INSERTION_OVERLAP = 0.01
"""Two particles may overlap by this part of the smaller diameter at the start, whatever the contact; see `Overlap`."""

DEEPER = "or raise contact.speed: overlaps as deep as an impact at that speed are allowed"
"""Remedy for overlaps that are meant."""


class Overlap(NamedTuple):
    """How deep particles may overlap at the start.

    As deep as an impact at the largest speed expected: a bed that runs has such overlaps too, the contact step is made
    for them, and two particles that are let go from one part no faster than that speed. A pack is laid out and not a
    state that a run was in: no speed allows more in it.

    Attributes:
        part: of the smaller diameter [-].
        reason: that says where it is from, for messages.
        key: of the scene that places the particles, for messages.
    """

    part: float = INSERTION_OVERLAP
    reason: str = ""
    key: str = "particles.position"

    def remedy(self, move: str) -> str:
        """What to do about a deeper one."""
        return f"{move}, {DEEPER}" if self.key != "particles.pack" else "change the pack"

    def __str__(self) -> str:
        return f"the limit is {100 * self.part:.3g} %{self.reason}"


LEAST_OVERLAP = Overlap()
"""What any scene allows."""


def allowed_overlap(particles: ParticleSetup, steps: TimeSteps) -> Overlap:
    """The overlap that is accepted at the start: that of an impact at the expected speed where positions are given."""
    if particles.table.position is None and particles.table.file is None:
        return Overlap(key="particles.pack")
    key = "particles.position" if particles.table.file is None else "particles.file"
    speed, overlap = steps.expected_speed, steps.expected_overlap
    if speed is None or overlap is None or overlap <= INSERTION_OVERLAP:
        return LEAST_OVERLAP._replace(key=key)
    return Overlap(overlap, f", the overlap expected at contact.speed = {speed:.3g} m/s", key)


def check_initial_positions(particles: ParticleSetup, allowed: Overlap = LEAST_OVERLAP) -> None:
    """Refuses particles that overlap each other or a side of the box by more than is allowed, or lie outside the box.

    Raises:
        InputError: naming the particles.
    """
    scene, position = particles.scene, particles.position
    radius = np.broadcast_to(particles.present.radius, len(position))
    depth = np.maximum(radius[:, None] - position, position + radius[:, None] - np.asarray(scene.domain.size))
    depth = np.where(scene.periodic, -np.inf, depth) / (2.0 * radius[:, None])
    if len(position) and depth.max() > allowed.part:
        index, axis = np.unravel_index(np.argmax(depth), depth.shape)
        raise InputError(
            allowed.key,
            f"particle {index} at {_point(position[index])} m",
            f"it reaches {_percent(depth[index, axis])} of its diameter into the "
            f"{scene.sides[2 * axis]} or {scene.sides[2 * axis + 1]} wall, {allowed}",
            allowed.remedy("move the particle into the box"),
        )
    worst, first, second = packing.deepest_overlap(position, radius, scene.domain.size, scene.periodic)
    if worst > allowed.part:
        owners = np.repeat(np.arange(len(particles.packs)), [pack.count for pack in particles.packs])
        if len(owners) and owners[first] != owners[second]:
            one, other = sorted((int(owners[first]), int(owners[second])))
            raise InputError(
                particles.packs[other].key,
                f"particles at {_point(position[first])} and {_point(position[second])} m",
                f"one is of {particles.packs[one].key}; they overlap by {100 * worst:.3g} % of a diameter, {allowed}",
                "move the packs apart, or make one smaller",
            )
        raise InputError(
            allowed.key,
            f"particles {first} and {second} at {_point(position[first])} and {_point(position[second])} m",
            f"they overlap by {100 * worst:.3g} % of a diameter, {allowed}",
            allowed.remedy("move the particles apart")
            if particles.table.pack is None
            else "raise particles.pack.spacing, or lower particles.pack.jitter",
        )


def check_surfaces(
    scene: Scene,
    surfaces: tuple[Surface, ...],
    present: np.ndarray | None,
    particles: ParticleState,
    radius: Array,
    allowed: Overlap,
) -> None:
    """Refuses particles that overlap a wall beside the sides of the box, or lie behind it.

    Args:
        scene: that the walls belong to.
        surfaces: the walls, those given as functions last.
        present: (W,) bool, which of them are there at the start; None for all.
        particles: at the start; those still to come are checked when they come.
        radius: () or (N,) [m].
        allowed: overlap at the start.

    Raises:
        InputError: naming the particle and the wall.
    """
    if not surfaces:
        return
    at, at_low = jax.device_get((particles.position, particles.position_low))
    position, low = vectors.components(at), split_low(at_low, at.shape[1])
    # As one program: operation by operation it takes seconds to compile.
    overlap, _ = jax.jit(functools.partial(surface_contacts, surfaces))(position, low, radius)
    depth = np.asarray(overlap) / (2.0 * np.asarray(radius))
    inside = ~(depth <= allowed.part)  # an overlap that is not a number too
    if present is not None:
        inside &= present[:, None]
    if particles.active is not None:
        inside &= np.asarray(particles.active)
    if inside.any():
        wall, index = np.unravel_index(np.argmax(np.where(inside, depth, -np.inf)), depth.shape)
        names = [f"{key} ({kind})" for key, kind in wall_keys(scene)]
        name = names[int(wall)] if wall < len(names) else "a wall given as a function"
        raise InputError(
            allowed.key,
            f"particle {index} at {_point(np.asarray(particles.position[index]))} m",
            f"it reaches {_percent(depth[wall, index])} of its diameter into {name}, {allowed}",
            allowed.remedy("move the particle or the wall")
            + ("; the normal of a wall points to the particles" if depth[wall, index] > 1.0 else ""),
        )


def _point(row: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.5g}" for value in row) + ")"


def _percent(part: float) -> str:
    return f"{100 * part:.3g} %" if part < 10.0 else f"{100 * part:,.0f} %"

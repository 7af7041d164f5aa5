"""How deep particles may overlap each other and the sides of the box at the start; more is refused. Host side."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jaxdem.errors import InputError, required
from jaxdem.particles import packing
from jaxdem.scene import Scene
from jaxdem.setup.bodies import Bodies
from jaxdem.setup.particles import ParticleSetup

ADDED = "start.add"
"""Key of particles that are added to those of another run."""

INSERTION_OVERLAP = 0.01
"""Two particles of a pack may overlap by this part of the smaller diameter."""


class Overlap(NamedTuple):
    """How deep particles may overlap at the start.

    A pack is laid out: more than a slip of rounding and jitter is a mistake. Positions that are given, and particles of
    another run, may be a state that a run was in: a run goes on until impacts are faster than its limit, at which they
    overlap by `contact.maximum_overlap`. So much is a state, and more is none.

    Attributes:
        part: of the smaller diameter [-].
        reason: that says where it is from, for messages.
        key: of the scene that places the particles, for messages.
        move: what to do about a deeper one.
        placed: number of rows that another run has placed; those behind them are of `start.add`. None where all are
            of one key.
    """

    part: float
    reason: str = ""
    key: str = "particles.pack"
    move: str = "change the pack"
    placed: int | None = None

    def __str__(self) -> str:
        return f"the limit is {100 * self.part:.3g} %{self.reason}"

    def of_row(self, row: int) -> Overlap:
        """The same with key and remedy of a particle, for messages."""
        if self.placed is None or row < self.placed:
            return self
        return self._replace(key=ADDED, move="add the particles elsewhere")


PACKED = Overlap(INSERTION_OVERLAP)
"""What a pack may have."""


def allowed_overlap(particles: ParticleSetup) -> Overlap:
    """The overlap that is accepted at the start."""
    reason = ", contact.maximum_overlap"
    if particles.is_started:
        remedy = "remove particles there (start.remove), or move them apart (start.relax = true)"
        return Overlap(particles.contact.maximum_overlap, reason, "start.from", remedy, particles.placed)
    if particles.table.position is None and particles.table.file is None:
        return PACKED
    key = "particles.position" if particles.table.file is None else "particles.file"
    return Overlap(particles.contact.maximum_overlap, reason, key, "move the particles apart or into the box")


def check_initial_positions(particles: ParticleSetup) -> None:
    """Refuses particles that overlap each other or a side of the box by more than is allowed, or lie outside the box.

    Raises:
        InputError: naming the particles.
    """
    if particles.shapes is not None:
        return _check_clumps(particles)
    allowed = allowed_overlap(particles)
    rows = np.flatnonzero(np.broadcast_to(particles.active, particles.count))
    scene, position = particles.scene, particles.position[rows]
    radius = np.broadcast_to(particles.present.radius, particles.count)[rows]
    index, part, sides = _deepest_in_sides(scene, position, radius)
    if part > allowed.part:
        allowed = allowed.of_row(rows[index])
        raise InputError(
            allowed.key,
            f"particle {rows[index]} at {at_text(position[index])} m",
            f"its centre lies outside of the box, beyond the {sides} wall"
            if part > 0.5
            else f"it reaches {percent_text(part)} of its diameter into the {sides} wall, {allowed}",
            allowed.move,
        )
    if not particles.is_started:
        return _check_pairs(particles, rows, allowed, None)
    added = rows >= particles.placed
    _check_pairs(particles, rows[~added], allowed, None)
    packed = PACKED._replace(key=ADDED, move="add the particles elsewhere, or remove those that are there")
    return _check_pairs(particles, rows, packed, added)


def _deepest_in_sides(scene: Scene, position: np.ndarray, radius: np.ndarray) -> tuple[int, float, str]:
    """Of the sphere that is deepest in a side of the box: its row, the depth over its diameter, and the sides of the
    axis; no depth without spheres. A side that removes particles is no wall to one whose centre is in the box."""
    if not len(position):
        return 0, -np.inf, ""
    beyond = np.stack([-position, position - np.asarray(scene.domain.size)], axis=2)
    removes = [scene.boundary[name].particles == "remove" for name in scene.sides]
    passes = np.reshape(removes, (-1, 2)) & (beyond <= 0.0)
    depth = np.max(np.where(passes, -np.inf, beyond + radius[:, None, None]), axis=2)
    depth = np.where(scene.periodic, -np.inf, depth) / (2.0 * radius[:, None])
    index, axis = np.unravel_index(np.argmax(depth), depth.shape)
    sides = f"{scene.sides[2 * axis]} or {scene.sides[2 * axis + 1]}"
    return int(index), float(depth[index, axis]), sides


def _check_pairs(particles: ParticleSetup, rows: np.ndarray, allowed: Overlap, some: np.ndarray | None) -> None:
    """Refuses pairs of `rows`, at least one of them among `some`, that overlap by more than is allowed."""
    scene, position = particles.scene, particles.position[rows]
    radius = np.broadcast_to(particles.present.radius, particles.count)[rows]
    worst, *pair = packing.deepest_overlap(position, radius, scene.domain.size, scene.periodic, some)
    if worst > allowed.part:
        first, second = pair
        owners = np.repeat(np.arange(len(particles.packs)), [pack.count for pack in particles.packs])
        if len(owners) and owners[first] != owners[second]:
            one, other = sorted((int(owners[first]), int(owners[second])))
            raise InputError(
                particles.packs[other].key,
                f"particles at {at_text(position[first])} and {at_text(position[second])} m",
                f"one is of {particles.packs[one].key}; they overlap by {100 * worst:.3g} % of a diameter, {allowed}",
                "move the packs apart, or make one smaller",
            )
        spread = "raise particles.pack.spacing, or lower particles.pack.jitter"
        raise InputError(
            allowed.key,
            f"particles {rows[first]} and {rows[second]} at {at_text(position[first])} and "
            f"{at_text(position[second])} m",
            f"they overlap by {100 * worst:.3g} % of a diameter, {allowed}",
            spread if allowed.key == "particles.pack" else allowed.move,
        )


def _check_clumps(particles: ParticleSetup) -> None:
    """The same of the members of clumps."""
    allowed, scene, table = allowed_overlap(particles), particles.scene, particles.shapes
    assert table is not None
    count = particles.count
    orientation = required(particles.orientation, "orientation")[:count]
    present = Bodies(*(np.broadcast_to(column, count) for column in particles.present))
    position, radius, body = table.placed(present, particles.position, orientation)
    index, part, sides = _deepest_in_sides(scene, position, radius)
    if part > allowed.part:
        raise InputError(
            allowed.key,
            f"clump {body[index]} at {at_text(particles.position[body[index]])} m",
            f"one of its spheres reaches {percent_text(part)} of its diameter into the {sides} wall, {allowed}",
            allowed.move,
        )
    worst, *pair = packing.deepest_overlap(position, radius, scene.domain.size, scene.periodic, body=body)
    if worst > allowed.part:
        first, second = body[pair]
        raise InputError(
            allowed.key,
            f"clumps {first} and {second} at {at_text(particles.position[first])} and "
            f"{at_text(particles.position[second])} m",
            f"two of their spheres overlap by {100 * worst:.3g} % of a diameter, {allowed}",
            allowed.move,
        )


def at_text(row: np.ndarray) -> str:
    """A position as messages have it."""
    return "(" + ", ".join(f"{value:.5g}" for value in row) + ")"


def percent_text(part: float) -> str:
    """A part of a diameter as messages have it."""
    return f"{100 * part:.3g} %" if part < 10.0 else f"{100 * part:,.0f} %"

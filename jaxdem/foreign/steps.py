"""Whether the time step of a deck is stable here: stiffness by restitution and friction differ between programs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from jaxdem.errors import InputError
from jaxdem.foreign.model import Deck
from jaxdem.foreign.notes import DIFFERS
from jaxdem.foreign.stages import Part
from jaxdem.scene.scene import Scene
from jaxdem.setup.contact_step import contact_step
from jaxdem.setup.particles import particle_setup


def check_steps(deck: Deck, parts: list[Part], load: Callable[[dict[str, Any]], Scene]) -> None:
    """Give every part whose time step is too long the automatic one, with a note on the line of the time step. What
    `jaxdem check` would refuse else has a note too.

    Args:
        deck: with the notes.
        parts: of the run; their tables are changed.
        load: makes a scene of tables.

    Raises:
        InputError: the tables are no scene.
    """
    for part in parts:
        scene = load({**part.tables, "time": {"end": part.end, "output_interval": part.end}})
        particles = particle_setup(scene)
        if particles is None:
            continue
        try:
            for pack in particles.packs:
                _ = pack.bodies
            contact_step(particles, 0.0)
        except InputError as error:
            if error.key != "contact.time_step":
                deck.notes.say("jaxdem check", DIFFERS, f"it refuses the scene: {error}")
                continue
            part.tables = {**part.tables, "contact": {**part.tables["contact"], "time_step": "auto"}}
            deck.notes.amend(
                part.step_line, DIFFERS, f'contact.time_step = "auto": {error.value} s is too long, {error.limit}'
            )

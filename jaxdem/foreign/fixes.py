"""What each fix of LIGGGHTS and LAMMPS says of the model."""

from __future__ import annotations

import math
from collections.abc import Callable

from jaxdem.foreign.contact_liggghts import PROPERTIES
from jaxdem.foreign.ends import GRAVITY, end
from jaxdem.foreign.faces import read_face
from jaxdem.foreign.insertions import distribution, insert, template
from jaxdem.foreign.model import Deck, Insertion
from jaxdem.foreign.notes import DIFFERS, LEFT, NOTHING, TAKEN, Answer, Unknown
from jaxdem.foreign.pour import pour
from jaxdem.foreign.walls import NO_TRIANGLES, wall
from jaxdem.foreign.words import integer, numbers

Handler = Callable[[Deck, list[str]], Answer]

ROUNDING = 1e-12
"""Part of gravity that is the rounding of an angle."""

MOVES = ("nve/sphere", "nve/sphere/omp", "nve", "nve/granular")
NO_EFFECT = ("check/timestep/gran", "print", "ave/time", "ave/atom", "ave/spatial", "ave/chunk", "ave/histo",
             "ave/euler", "couple/cfd", "couple/cfd/force", "couple/cfd/force/implicit", "property/atom",
             "property/atom/tracer", "property/atom/tracer/stream", "store/state",
             "massflow/mesh", "massflow/mesh/sieve", "enforce2d", "contacthistory", "balance", "dt/reset")  # fmt: skip
"""Fixes about output and what a scene does by itself."""

REASONS = {
    "mesh/surface": NO_TRIANGLES, "mesh/surface/stress": NO_TRIANGLES, "mesh/surface/stress/servo": NO_TRIANGLES,
    "mesh/surface/stress/6dof": NO_TRIANGLES,
    "move/mesh": 'walls do not move, but for boundary.SIDE.kind = "moving_wall"',
    "move": "particles cannot be moved by hand; make a wall of them",
    "freeze": "particles cannot be held; make a wall of them",
    "deposit": "it puts in points and takes their size from set; use fix pour, or write [[particles.inlet]]",
    "nve/limit": "particles do not move by a limited distance; use start.relax for those that overlap",
    "viscous": "there is no drag without a fluid; add [fluid] and coupling.drag",
    "heat/gran": "there is no heat", "heat/gran/conduction": "there is no heat", "multisphere": "particles are spheres",
    "rigid": "particles are spheres, not bound to each other",
    "adapt": "constants do not change within a run; write a stage with [stages.contact]",
}  # fmt: skip


def fix(deck: Deck, words: list[str]) -> Answer:
    """`fix ID group STYLE ...`."""
    style = words[3]
    before = deck.fixes.pop(words[1], None)
    if isinstance(before, list | Insertion):  # a fix of a name that is there takes its place
        end(deck, before)
    deck.fixes[words[1]] = style
    if style in MOVES:
        return NOTHING, "a scene does this by itself"
    if style in NO_EFFECT:
        return NOTHING, "output, or what a scene does by itself"
    if style in REASONS:
        return LEFT, _reason(deck, words)
    handler = HANDLERS.get(style)
    if handler is None:
        raise Unknown(f"fix {style} has no counterpart")
    kind, reason = handler(deck, words)
    if style in OF_ALL and words[2] != "all" and deck.groups.get(words[2], [""])[0] not in ("region", ""):
        return DIFFERS, f"{reason}; acts on all particles, not on the group {words[2]} alone"
    return kind, reason


def _reason(deck: Deck, words: list[str]) -> str:
    """Why a fix is left out; a mesh may yet be the face of a stream, and is kept for it."""
    if words[3].startswith("mesh/surface") and "file" in words:
        try:
            name = words[words.index("file") + 1]
            deck.fixes[words[1]] = read_face(deck.folder / name, words, deck.unit.length, deck.line)
        except Unknown as error:
            deck.fixes[words[1]] = str(error)
    return REASONS[words[3]]


def planar(deck: Deck, words: list[str]) -> Answer:
    """`fix ID all mesh/surface/planar file NAME type 1`: a face for insert/stream."""
    name = words[words.index("file") + 1]
    deck.fixes[words[1]] = read_face(deck.folder / name, words, deck.unit.length, deck.line)
    return NOTHING, "a face that no insert/stream of the deck has taken"


def unfix(deck: Deck, words: list[str]) -> Answer:
    """`unfix ID`."""
    found = deck.fixes.pop(words[1], None)
    if found == GRAVITY:
        deck.model.gravity = None
        return TAKEN, "domain.gravity is zero from here on"
    if isinstance(found, list | Insertion):
        return end(deck, found)
    if found in MOVES:
        return LEFT, "particles go on to move here"
    if found == "property/global":
        return NOTHING, "the constant stays as it is"
    return NOTHING, "nothing of that fix is in the scene"


def property_global(deck: Deck, words: list[str]) -> Answer:
    """`fix ID all property/global NAME peratomtype|peratomtypepair [N] values`."""
    name, kind, values = words[4], words[5], words[6:]
    if name not in PROPERTIES:
        raise Unknown(f"the property {name} has no counterpart")
    if kind == "peratomtypepair":
        types = integer(values[0])
        found = numbers(values[1:], types * types)
    else:
        found = numbers(values, len(values))
    units = {"youngsModulus": deck.unit.pressure, "cohesionEnergyDensity": deck.unit.pressure}
    factor = (units | {"characteristicVelocity": deck.unit.speed}).get(name, 1.0)
    deck.model.properties[name] = [value * factor for value in found]
    return TAKEN, "[contact], or [[materials]] and [[material_pairs]]"


def gravity(deck: Deck, words: list[str]) -> Answer:
    """`fix ID all gravity G vector x y z`, `chute ANGLE` or `spherical PHI THETA`."""
    size = numbers(words[4:], 1)[0] * deck.unit.acceleration
    if words[5] == "vector":
        direction = numbers(words[6:], 3)
        length = math.hypot(*direction)
    elif words[5] == "chute":
        angle = math.radians(numbers(words[6:], 1)[0])
        direction, length = [math.sin(angle), 0.0, -math.cos(angle)], 1.0
        if deck.dimension == 2:
            direction = [math.sin(angle), -math.cos(angle), 0.0]
    elif words[5] == "spherical" and deck.dimension == 3:
        phi, theta = (math.radians(value) for value in numbers(words[6:], 2))
        direction, length = [math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)], 1.0
    else:
        raise Unknown(f"gravity of style {words[5]} has no counterpart; use vector")
    found = [0.0 if size == 0.0 or abs(c) < ROUNDING * length else size * c / length for c in direction]
    if deck.dimension == 2 and found[2]:
        raise Unknown("gravity across the plane of a two-dimensional deck has no counterpart")
    deck.model.gravity, deck.fixes[words[1]] = found, GRAVITY
    return TAKEN, "domain.gravity"


HANDLERS: dict[str, Handler] = {
    "property/global": property_global, "gravity": gravity, "wall/gran": wall, "wall/gran/region": wall,
    "particletemplate/sphere": template, "mesh/surface/planar": planar, "pour": pour,
    "particledistribution/discrete": distribution, "particledistribution/discrete/massbased": distribution,
    "particledistribution/discrete/numberbased": distribution, "insert/pack": insert, "insert/rate/region": insert,
    "insert/stream": insert,
}  # fmt: skip
OF_ALL = ("gravity", "wall/gran", "wall/gran/region")
"""Fixes that act on a group in the deck, and on all particles here."""

FIXES: dict[str, Handler] = {"fix": fix, "unfix": unfix}

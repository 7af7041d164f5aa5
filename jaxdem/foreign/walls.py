"""Walls of a deck: `fix wall/gran` of LIGGGHTS and of LAMMPS."""

from __future__ import annotations

from jaxdem.foreign.contact_lammps import LammpsContact
from jaxdem.foreign.contact_liggghts import LiggghtsContact, contact_words
from jaxdem.foreign.ends import goes_on
from jaxdem.foreign.gran_models import granular_model, old_model
from jaxdem.foreign.model import Deck, DeckWall
from jaxdem.foreign.notes import DIFFERS, TAKEN, Answer, Unknown
from jaxdem.foreign.region import AXES
from jaxdem.foreign.words import numbers

NO_TRIANGLES = "walls are planes, cylinders and wedges here, no triangles; write [[walls]] in their place"
TARGET = "a side of the box, or [[walls]]"
"""What a wall becomes, before the box is known."""

SHAPES = ("xplane", "yplane", "zplane", "xcylinder", "ycylinder", "zcylinder", "region")
OLD = ("hooke", "hooke/history", "hertz/history")


def wall(deck: Deck, words: list[str]) -> Answer:
    """`fix ID GROUP wall/gran ...` of both programs."""
    if words[4] == "model":
        if "primitive" not in words:
            raise Unknown(NO_TRIANGLES)
        return _liggghts(deck, words)
    return _lammps(deck, words)


def _liggghts(deck: Deck, words: list[str]) -> Answer:
    """`... model hertz ... primitive type T xplane C` or `zcylinder R c1 c2`, `shear x v`."""
    at = words.index("primitive")
    given = dict(zip(words[4:at:2], words[5:at:2], strict=False))
    kind, reason = contact_words(given)
    material, shape, rest = int(words[at + 2]), words[at + 3], words[at + 4 :]
    axis, unit = AXES.index(shape[0]), deck.unit
    if shape[1:] == "plane":
        made = _plane(deck, axis, numbers(rest, 1)[0] * unit.length)
        more = rest[1:]
    elif shape[1:] == "cylinder":
        radius, *middle = (value * unit.length for value in numbers(rest, 3))
        made = DeckWall(deck.line, "cylinder", axis, middle=(middle[0], middle[1]), radius=radius, begin=deck.time)
        more = rest[3:]
    else:
        raise Unknown(f"walls of shape {shape} have no counterpart")
    made.material = material
    of_pairs = deck.model.contact
    alike = isinstance(of_pairs, LiggghtsContact) and of_pairs.words == given
    different = [] if alike or kind == TAKEN else [reason.removeprefix("contact.law; ")]
    different += _moving(deck, [made], more)
    deck.walls.append(made)
    goes_on(deck, made)
    deck.fixes[words[1]] = [made]
    return (DIFFERS, "; ".join([TARGET, *different])) if different else (TAKEN, TARGET)


def _lammps(deck: Deck, words: list[str]) -> Answer:
    """`... hertz/history Kn Kt gn gt xmu flag xplane lo hi`, `... granular MODEL zcylinder R`."""
    at = next((k for k, word in enumerate(words[5:], start=5) if word in SHAPES), 0)
    if not at:
        raise Unknown("its shape has no counterpart; use xplane, yplane, zplane or zcylinder")
    style, shape, rest = words[4], words[at], words[at + 1 :]
    if style[0].isdigit():  # an old form, whose style is that of the particles
        pairs = deck.model.contact.pairs if isinstance(deck.model.contact, LammpsContact) else {}
        style = "hooke/history" if pairs and pairs[1, 1].normal == "hooke" else "hertz/history"
        words = [*words[:4], style, *words[4:]]
        at += 1
    if style == "granular":
        model = granular_model(words[5:at], deck.unit)
    elif style in OLD:
        model = old_model(style, words[5:at], deck.unit)
    else:
        raise Unknown(f"wall/gran {style} has no counterpart; use granular, hertz/history or hooke/history")
    if shape == "region" or words[3] == "wall/gran/region":
        made, more = _of_region(deck, rest[0]), rest[1:]
    elif shape[1:] == "plane":
        made, more = [], rest[2:]
        for upper, word in enumerate(rest[:2]):
            if word != "NULL":
                made.append(_plane(deck, AXES.index(shape[0]), numbers([word], 1)[0] * deck.unit.length, bool(upper)))
    else:
        middle = (0.0, 0.0)
        radius = numbers(rest, 1)[0] * deck.unit.length
        made = [DeckWall(deck.line, "cylinder", AXES.index(shape[0]), middle=middle, radius=radius, begin=deck.time)]
        more = rest[1:]
    different = _moving(deck, made, more)
    deck.walls += made
    for one in made:
        goes_on(deck, one)
    deck.fixes[words[1]] = made
    deck.wall_models.append((deck.line, model))
    return (DIFFERS, "; ".join([TARGET, *different])) if different else (TAKEN, TARGET)


def _plane(deck: Deck, axis: int, coordinate: float, upper: bool | None = None) -> DeckWall:
    return DeckWall(deck.line, "plane", axis, coordinate=coordinate, upper=upper, begin=deck.time)


def _of_region(deck: Deck, name: str) -> list[DeckWall]:
    """The walls of `region ID`: a block has six planes, a cylinder its tube and two ends."""
    where = deck.region(name)
    if where.shape == "sphere" or (where.shape == "block" and not where.inside):
        raise Unknown("a wall round a sphere, or outside of a block, has no counterpart")
    axes = range(3) if where.shape == "block" else (where.axis,)
    made = [
        _plane(deck, axis, corner[axis], upper)
        for axis in axes
        for corner, upper in ((where.lower, False), (where.upper, True))
        if where.inside
    ]
    if where.shape == "cylinder":
        others = [where.center[k] for k in range(3) if k != where.axis]
        tube = DeckWall(deck.line, "cylinder", where.axis, middle=(others[0], others[1]), radius=where.radius)
        tube.inside, tube.begin = where.inside, deck.time
        made.append(tube)
    return made


def _moving(deck: Deck, walls: list[DeckWall], words: list[str]) -> list[str]:
    """What is left out of the options after the shape; a plane that moves along itself is taken."""
    if words[:1] == ["shear"] and all(one.shape == "plane" for one in walls):
        axis, speed = AXES.index(words[1]), numbers(words[2:], 1)[0] * deck.unit.speed
        for one in walls:
            if one.axis != axis:
                one.shear = tuple(speed if k == axis else 0.0 for k in range(3))
        words = words[3:]
    return [f"{' '.join(words)} left out: the wall does not move"] if words else []

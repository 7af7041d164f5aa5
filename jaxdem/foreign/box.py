"""The box of a scene: between the plane walls of a deck; and the walls that are no sides of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from jaxdem.foreign.model import SIDES, Deck, DeckWall
from jaxdem.foreign.notes import DIFFERS, LEFT, NOTHING, TAKEN
from jaxdem.foreign.region import AXES, Region, around, plain, together

MIDDLE = (0.1, 0.9)
"""A plane between these parts of the extent of the particles has them on both sides."""

AT_THE_END = 1e-9
"""Part of the box by which a plane may lie off a side and stands on it."""


@dataclass
class Box:
    """The box of a scene, in the coordinates of the deck.

    Attributes:
        lower, upper: corners [m].
        boundary: table of the sides that are no walls at rest.
        walls: planes and cylinders that are no sides.
        side_material: type of the material of the sides; 0 where the deck does not say.
        is_mesh: whether it is that of the mesh of a fluid, whose sides stay where they are.
    """

    lower: list[float]
    upper: list[float]
    boundary: dict[str, Any] = field(default_factory=dict)
    walls: list[DeckWall] = field(default_factory=list)
    side_material: int = 0
    is_mesh: bool = False

    @property
    def shift(self) -> list[float]:
        """What is added to places of the deck [m]."""
        return [0.0 - value for value in self.lower]


def occupied(deck: Deck) -> Region | None:
    """The block in which particles are put; None where none are known."""
    parts = [one.region for one in deck.insertions if one.region.inside]
    for atoms in deck.atoms.values():
        placed = atoms.position[atoms.waiting < 0]
        parts += [around(placed)] if len(placed) else []
        parts += [where for where, _ in atoms.regions]
    return together(parts)


def box_of(deck: Deck, is_mesh: bool = False) -> Box:
    """The box between the plane walls. Each wall has a note on what it has become."""
    found = Box(list(deck.lower), list(deck.upper), is_mesh=is_mesh)
    content = occupied(deck)
    for one in deck.walls:
        if one.axis not in deck.axes and one.shape == "plane":
            deck.notes.amend(one.line, NOTHING, "the scene has two axes, and no wall across the third")
        elif one.shape == "cylinder" and deck.dimension == 2 and one.axis != 2:
            deck.notes.amend(one.line, LEFT, "a cylinder across z has no counterpart in a plane")
        elif one.shape == "cylinder":
            found.walls.append(one)
    for axis in deck.axes:
        planes = [one for one in deck.walls if one.shape == "plane" and one.axis == axis]
        _along(deck, found, axis, planes, content)
    types = [one.material for one in deck.walls if one.material]
    found.side_material = found.side_material or (types[0] if types else 0)
    return found


def _along(deck: Deck, box: Box, axis: int, planes: list[DeckWall], content: Region | None) -> None:
    """Sides and planes across one axis."""
    names = SIDES[deck.dimension][axis]
    tubes = [one for one in box.walls if one.shape == "cylinder" and one.axis != axis]
    if deck.boundary[axis].startswith("p") and not box.is_mesh and tubes:
        reason = "the deck is periodic there, but a tube stands across it: the sides are walls behind the tube"
        deck.notes.say(" and ".join(names), DIFFERS, reason)
        return
    if deck.boundary[axis].startswith("p") and not box.is_mesh:
        box.boundary[names[0]] = {"kind": "periodic"}
        for one in planes:
            deck.notes.amend(one.line, LEFT, f"the deck is periodic along {AXES[axis]}: no wall can stand across it")
        return
    where = content or Region("block", deck.lower, deck.upper)
    low, high = where.lower[axis], where.upper[axis]
    ends: tuple[list[DeckWall], list[DeckWall]] = ([], [])
    for one in planes:
        part = (one.coordinate - low) / (high - low) if high > low else 0.5 + (one.coordinate - low)
        if one.upper is None and MIDDLE[0] < part < MIDDLE[1] and high > low:
            reason = "particles lie on both sides of this plane, and a wall of a scene has one; run two scenes"
            deck.notes.amend(one.line, LEFT, reason)
            continue
        ends[part > 0.5 if one.upper is None else one.upper].append(one)
    for upper, found in enumerate(ends):
        _end(deck, box, axis, bool(upper), found)


def _end(deck: Deck, box: Box, axis: int, upper: bool, planes: list[DeckWall]) -> None:
    """One end of the box along an axis, with the planes that the particles lie on one side of."""
    name = SIDES[deck.dimension][axis][upper]
    corner = box.upper if upper else box.lower
    if box.is_mesh:
        _end_of_mesh(deck, box, axis, upper, planes)
        return
    near = AT_THE_END * (deck.upper[axis] - deck.lower[axis])
    reach = corner[axis] if deck.boundary[axis][upper] == "f" else None
    lasting = []
    for one in planes:
        beyond = 0.0 if reach is None else (one.coordinate - reach if upper else reach - one.coordinate)
        if beyond > near:
            reason = f"it stands outside of the box, which ends at {reach:g} m: no particle reaches it"
            deck.notes.amend(one.line, LEFT, reason)
        elif one.is_permanent:
            lasting.append(one)
        else:
            box.walls.append(one)
    if not lasting:
        vanishes = any(one.end is not None and one in box.walls for one in planes)
        _open(deck, box, axis, upper, vanishes)
        return
    inner = (min if upper else max)(lasting, key=lambda one: one.coordinate)
    corner[axis] = inner.coordinate
    _side(deck, box, inner, name)
    for one in lasting:
        if one is not inner:
            deck.notes.amend(one.line, NOTHING, f"it stands behind the plane at {inner.coordinate:g} m")
    for one in [one for one in box.walls if one in planes]:
        outwards = one.coordinate - inner.coordinate if upper else inner.coordinate - one.coordinate
        if outwards >= -near:
            box.walls.remove(one)
            deck.notes.amend(one.line, NOTHING, f"it stands at or behind the plane at {inner.coordinate:g} m")


def _side(deck: Deck, box: Box, one: DeckWall, name: str) -> None:
    """A plane as a side of the box."""
    note, moving = deck.notes[one.line], any(one.shear)
    target = f"boundary.{name}, at {one.coordinate:g} m"
    if moving:
        velocity = [plain(one.shear[k]) for k in deck.axes]
        box.boundary[name] = {"kind": "moving_wall", "velocity": velocity}
        target = f'boundary.{name}.kind = "moving_wall", at {one.coordinate:g} m'
    box.side_material = box.side_material or one.material
    deck.notes.amend(one.line, note.kind, _replaced(note.reason, target))
    if one.material and one.material != box.side_material:
        deck.notes.differ(one.line, f"its material is that of the other sides, type{box.side_material}")


def _replaced(reason: str, target: str) -> str:
    """The reason of a wall with what it has become in place of what it might; two planes of a line are both named."""
    first, _, rest = reason.partition("; ")
    first = target if first.startswith("a side of the box") else f"{first}, and {target}"
    return "; ".join(part for part in (first, rest) if part)


def _open(deck: Deck, box: Box, axis: int, upper: bool, vanishes: bool) -> None:
    """An end of the box without a wall that stays."""
    name = SIDES[deck.dimension][axis][upper]
    if deck.boundary[axis][upper] == "f" and (deck.lost == "ignore" or vanishes):
        box.boundary[name] = {"particles": "remove"}
        deck.notes.say(name, TAKEN, f"no wall along {AXES[axis]} there: particles that leave are removed")
        return
    if any(one.shape == "cylinder" and one.inside and one.axis != axis for one in box.walls):
        deck.notes.say(name, NOTHING, "the side stands behind a tube")
        return
    reason = f"the deck has no wall along {AXES[axis]} there; a side of a scene is one, and stays where it is"
    deck.notes.say(name, DIFFERS, reason)


def _end_of_mesh(deck: Deck, box: Box, axis: int, upper: bool, planes: list[DeckWall]) -> None:
    """Planes at a side of the mesh of a fluid, which holds the particles back itself."""
    name, end = SIDES[deck.dimension][axis][upper], (box.upper if upper else box.lower)[axis]
    near = AT_THE_END * (deck.upper[axis] - deck.lower[axis])
    for one in planes:
        inwards = end - one.coordinate if upper else one.coordinate - end
        if inwards > near:
            box.walls.append(one)
        elif inwards < -near:
            reason = (
                f"it stands outside of the mesh of the fluid; boundary.{name} holds the particles back, at {end:g} m"
            )
            deck.notes.amend(one.line, DIFFERS, reason)
        elif one.is_permanent:
            _side(deck, box, one, name)
        else:
            deck.notes.amend(one.line, DIFFERS, f"boundary.{name} is a wall all the time")


def wall_tables(deck: Deck, box: Box, several: bool) -> list[dict[str, Any]]:
    """The tables `[[walls]]`.

    Args:
        deck: with the notes.
        box: of `box_of`.
        several: whether the scene has `[[materials]]`.
    """
    tables = []
    for one in box.walls:
        table = _cylinder(deck, box, one) if one.shape == "cylinder" else _plane(deck, box, one)
        table |= {"material": f"type{one.material}"} if several and one.material else {}
        table |= {"begin": plain(one.begin)} if one.begin else {}
        table |= {"end": plain(one.end)} if one.end is not None else {}
        tables.append(table)
        note = deck.notes[one.line]
        deck.notes.amend(one.line, note.kind, _replaced(note.reason, _target(one)))
        if any(one.shear):
            deck.notes.differ(one.line, "its motion is left out: it is no side of the box")
    return tables


def _plane(deck: Deck, box: Box, one: DeckWall) -> dict[str, Any]:
    upper = one.upper if one.upper is not None else _is_upper(deck, one)
    place = [plain(one.coordinate + box.shift[k]) if k == one.axis else 0.0 for k in deck.axes]
    normal = [(-1.0 if upper else 1.0) if k == one.axis else 0.0 for k in deck.axes]
    return {"kind": "plane", "point": place, "normal": normal}


def _target(one: DeckWall) -> str:
    when = [f"{name} = {value:g} s" for name, value in (("begin", one.begin or None), ("end", one.end)) if value]
    return ", ".join([f'[[walls]], kind = "{one.shape}"', *when])


def _is_upper(deck: Deck, one: DeckWall) -> bool:
    """Whether the particles lie below a plane."""
    where = occupied(deck) or Region("block", deck.lower, deck.upper)
    return one.coordinate > 0.5 * (where.lower[one.axis] + where.upper[one.axis])


def _cylinder(deck: Deck, box: Box, one: DeckWall) -> dict[str, Any]:
    others = [k for k in range(3) if k != one.axis]
    center = [0.0, 0.0, 0.0]
    for k, value in zip(others, one.middle, strict=True):
        center[k] = plain(value + box.shift[k])
    table: dict[str, Any] = {"kind": "cylinder", "center": [center[k] for k in deck.axes], "radius": plain(one.radius)}
    if deck.dimension == 3:
        table["axis"] = [float(k == one.axis) for k in range(3)]
    return table | ({} if one.inside else {"inside": False})

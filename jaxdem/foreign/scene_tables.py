"""From what a deck describes to the tables of a scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from jaxdem.foreign.model import AXES, SIDES, Deck, Insertion
from jaxdem.foreign.notes import DIFFERS, LEFT, TAKEN

Say = Callable[[str, str, str], None]
"""Adds a note on the scene as a whole: what, kind, reason."""

CONSTANTS = {
    "youngsModulus": "young_modulus", "poissonsRatio": "poisson_ratio", "coefficientRestitution": "restitution",
    "coefficientFriction": "friction", "coefficientRollingFriction": "rolling_friction",
}  # fmt: skip
PAIRS = ("coefficientRestitution", "coefficientFriction", "coefficientRollingFriction")
LAST_DIGITS = 12
"""Significant digits of numbers that are computed: sums of decimal fractions are decimal again."""


def scene_tables(deck: Deck, data_name: str, say: Say) -> dict[str, Any]:
    """The tables of a scene; what differs from the deck as a whole goes to `say`."""
    lower, upper, boundary = _box(deck, say)
    shift = [0.0 - value for value in lower]
    tables: dict[str, Any] = {"domain": {"size": [_plain(b - a) for a, b in zip(lower, upper, strict=True)]}}
    tables["domain"]["gravity"] = [_plain(c) for c in deck.gravity or [0.0, 0.0, 0.0]]
    if any(shift):
        moved = ", ".join(f"{value:g}" for value in shift)
        say("origin", DIFFERS, f"all places are moved by ({moved}) m: the box of a scene begins at 0")
    tables["particles"] = _particles(deck, data_name, shift, say)
    tables["contact"], materials, pairs = _contact(deck)
    if materials:
        tables["materials"] = materials
    if pairs:
        tables["material_pairs"] = pairs
    walls = [_cylinder(wall, shift, materials) for wall in deck.cylinders]
    if walls:
        tables["walls"] = walls
    if boundary:
        tables["boundary"] = boundary
    tables["time"] = _time(deck, say)
    return tables


def _plain(value: float) -> float:
    return float(f"{value:.{LAST_DIGITS}g}") + 0.0


def _box(deck: Deck, say: Say) -> tuple[list[float], list[float], dict[str, Any]]:
    """The box between the plane walls, and the sides that are no walls."""
    lower, upper, boundary = list(deck.lower), list(deck.upper), {}
    for axis in range(3):
        middle = 0.5 * (deck.lower[axis] + deck.upper[axis])
        ends = ([c for c, _ in deck.planes[axis] if c <= middle], [c for c, _ in deck.planes[axis] if c > middle])
        lower[axis], upper[axis] = max(ends[0], default=lower[axis]), min(ends[1], default=upper[axis])
        if deck.boundary[axis].startswith("p"):
            boundary[SIDES[axis][0]] = {"kind": "periodic"}
            continue
        for side, given in zip(SIDES[axis], ends, strict=True):
            if given:
                continue
            if deck.lost == "ignore" and "f" in deck.boundary[axis]:
                boundary[side] = {"particles": "remove"}
                say(side, TAKEN, f"no wall along {AXES[axis]} there: particles that leave are removed")
            else:
                reason = (
                    f"the deck has no wall along {AXES[axis]} there; a side of a scene is one, and stays where it is"
                )
                say(side, DIFFERS, reason)
    return lower, upper, boundary


def _contact(deck: Deck) -> tuple[dict[str, Any], list[dict[str, Any]], list[dict[str, Any]]]:
    """`[contact]`, and the materials and pairs of a deck with several types."""
    contact: dict[str, Any] = {"law": "hertz_mindlin"}
    given = {key: deck.properties[name] for name, key in CONSTANTS.items() if name in deck.properties}
    contact |= {key: values[0] for key, values in given.items()}
    rolling = deck.contact.get("rolling_friction", "off")
    if rolling == "off":
        contact["rolling_friction"] = 0.0
        given.pop("rolling_friction", None)
    elif rolling.startswith("epsd"):
        contact["rolling_model"] = "epsd"
    if "coefficientFriction" not in deck.properties or deck.contact.get("tangential") == "off":
        contact["friction"] = 0.0
        given.pop("friction", None)
    if deck.contact.get("model") == "hooke":
        contact |= {"law": "linear_spring_dashpot", "normal_stiffness": _plain(_hooke(deck))}
    if deck.time_step:
        contact["time_step"] = deck.time_step
    if deck.types == 1:
        return contact, [], []
    materials: list[dict[str, Any]] = [{"name": f"type{k + 1}"} for k in range(deck.types)]
    pairs: list[dict[str, Any]] = []
    for name, key in CONSTANTS.items():
        if key not in given:
            continue
        step = deck.types + 1 if name in PAIRS else 1
        for k, material in enumerate(materials):
            material[key] = given[key][k * step]
    for a in range(deck.types):
        for b in range(a + 1, deck.types):
            found = {CONSTANTS[n]: given[CONSTANTS[n]][a * deck.types + b] for n in PAIRS if CONSTANTS[n] in given}
            if found:
                pairs.append({"materials": [f"type{a + 1}", f"type{b + 1}"], **found})
    walls = [material for planes in deck.planes for _, material in planes]
    contact["wall_material"] = f"type{walls[0] if walls else 1}"
    return contact, materials, pairs


def _hooke(deck: Deck) -> float:
    """Stiffness of LIGGGHTS' hooke of two equal particles, the largest: 16/15 sqrt(R) E (15 m v^2 / (16 sqrt(R) E))^0.2
    with R, E and m those of the pair."""
    largest = max(deck.templates.values(), key=lambda one: one.radius)
    modulus = deck.properties["youngsModulus"][0] / (2.0 * (1.0 - deck.properties["poissonsRatio"][0] ** 2))
    radius, mass, speed = 0.5 * largest.radius, 0.5 * largest.mass, deck.properties["characteristicVelocity"][0]
    base = math.sqrt(radius) * modulus
    return 16.0 / 15.0 * base * (15.0 * mass * speed**2 / (16.0 * base)) ** 0.2


def _cylinder(
    wall: tuple[int, float, tuple[float, float], int], shift: list[float], materials: list[dict[str, Any]]
) -> dict[str, Any]:
    axis, radius, middle, material = wall
    others = [k for k in range(3) if k != axis]
    center = [0.0, 0.0, 0.0]
    for k, value in zip(others, middle, strict=True):
        center[k] = _plain(value + shift[k])
    table: dict[str, Any] = {"kind": "cylinder", "center": center, "radius": radius}
    table["axis"] = [float(k == axis) for k in range(3)]
    return table | ({"material": f"type{material}"} if materials else {})


def _particles(deck: Deck, data_name: str, shift: list[float], say: Say) -> dict[str, Any]:
    table: dict[str, Any] = {}
    if data_name:
        table["file"] = {"name": data_name}
        if deck.units != "si":
            table["file"]["units"] = deck.units
        if any(shift):
            table["file"]["translate"] = [_plain(value) for value in shift]
        if deck.types > 1:
            table["file"]["types"] = {str(k + 1): f"type{k + 1}" for k in range(deck.types)}
    packs = [one for one in deck.insertions if one.rate is None and one.mass_rate is None]
    if packs and data_name:
        say("insert/pack", LEFT, "a scene has its first particles from a file or from packs; the file is taken")
        packs = []
    if packs:
        table["pack"] = [_pack(deck, one, shift) for one in packs]
    inlets = [one for one in deck.insertions if one.rate is not None or one.mass_rate is not None]
    if inlets:
        table["inlet"] = [_inlet(deck, one, shift) for one in inlets]
    return table


def _pack(deck: Deck, one: Insertion, shift: list[float]) -> dict[str, Any]:
    table: dict[str, Any] = {"kind": "random", "spacing": 1.0}
    table["region"] = {k: _rounded(v) for k, v in one.region.table(shift).items()}
    if one.count is not None:
        table["count"] = one.count
    else:
        table["solid_fraction"] = one.solid_fraction
    return table | _kinds(deck, one.distribution)


def _inlet(deck: Deck, one: Insertion, shift: list[float]) -> dict[str, Any]:
    where = one.region.table(shift)
    table: dict[str, Any] = {"start": _rounded(where["start"]), "stop": _rounded(where["stop"])}
    table |= {"rate": one.rate} if one.rate is not None else {"mass_flow": one.mass_rate}
    table["velocity"] = list(one.velocity)
    table |= {"begin": _plain(one.begin)} if one.begin else {}
    table |= {"total": one.count} if one.count else {}
    return table | _kinds(deck, one.distribution)


def _rounded(value: Any) -> Any:
    return [_plain(one) for one in value] if isinstance(value, list) else value


def _kinds(deck: Deck, name: str) -> dict[str, Any]:
    """Radius, density and material of the particles of a distribution, or its species with shares by number."""
    parts = deck.distributions[name]
    kinds = []
    for label, part, by_mass in parts:
        made = deck.templates[label]
        kind: dict[str, Any] = {"radius": made.radius, "density": made.density}
        kind |= {"material": f"type{made.type}"} if deck.types > 1 else {}
        kinds.append((part / made.mass if by_mass else part, kind))
    if len(kinds) == 1:
        return kinds[0][1]
    total = sum(share for share, _ in kinds)
    return {"species": [{"share": share / total, **kind} for share, kind in kinds]}


def _time(deck: Deck, say: Say) -> dict[str, Any]:
    steps = deck.steps
    outputs = max(1, round(steps / (deck.output_steps or max(1, steps // 10))))
    if not deck.output_steps:
        say("output", DIFFERS, "the deck writes no particles: ten frames")
    elif steps % deck.output_steps:
        say("output", DIFFERS, f"{outputs} frames: the output interval must divide the time of the run")
    end = _plain(steps * deck.time_step)
    return {"end": end, "output_interval": _plain(end / outputs)}

"""From what a deck describes to the tables of a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from jaxdem.foreign.atoms import Atoms
from jaxdem.foreign.box import Box, wall_tables
from jaxdem.foreign.model import Deck, Insertion, Kind, Model
from jaxdem.foreign.notes import DIFFERS, LEFT, Unknown
from jaxdem.foreign.region import plain
from jaxdem.particles.random_packing import REACHABLE, random_pack
from jaxdem.particles.regions import ball_size


class Written:
    """Files that are written beside the scene, by name."""

    def __init__(self, stem: str):
        self.stem = stem
        self.texts: dict[str, str] = {}

    def add(self, segment: int, text: str) -> str:
        """Take up the particles of a segment; the name of their file."""
        name = f"{self.stem}.particles.csv" if not segment else f"{self.stem}.particles_{segment + 1}.csv"
        self.texts[name] = text
        return name


def shared_tables(deck: Deck, box: Box, written: Written, data_name: str) -> dict[str, Any]:
    """What holds in all stages: `domain`, `particles`, `walls` and `boundary`.

    Args:
        deck: all of it.
        box: of it.
        written: takes up the files of particles.
        data_name: name of the data file, relative to the scene; "" without.
    """
    axes = deck.axes
    tables: dict[str, Any] = {"domain": {"size": [plain(box.upper[k] - box.lower[k]) for k in axes]}}
    if any(box.shift[k] for k in axes):
        moved = ", ".join(f"{box.shift[k]:g}" for k in axes)
        deck.notes.say("origin", DIFFERS, f"all places are moved by ({moved}) m: the box of a scene begins at 0")
    largest = deck.largest()
    if deck.dimension == 2 and largest is not None:
        tables["domain"]["depth"] = plain(2.0 * largest[0])
        reason = "domain.depth is the largest diameter; particles are discs with the mass of spheres, as in LAMMPS"
        deck.notes.say("dimension 2", DIFFERS, f"{reason}; LIGGGHTS gives them that of discs 1 m thick")
    tables["particles"] = _first_particles(deck, box, written, data_name)
    walls = wall_tables(deck, box, deck.types > 1)
    if walls:
        tables["walls"] = walls
    if box.boundary:
        tables["boundary"] = dict(box.boundary)
    return tables


def model_tables(deck: Deck, box: Box, model: Model) -> dict[str, Any]:
    """What may change between two runs: `domain.gravity`, `contact`, `materials`, `material_pairs`."""
    gravity = model.gravity or [0.0, 0.0, 0.0]
    tables: dict[str, Any] = {"domain": {"gravity": [plain(gravity[k]) for k in deck.axes]}}
    if model.contact is None:
        raise Unknown("there is no contact model")
    tables |= model.contact.tables(deck, model)
    if model.time_step:
        tables["contact"]["time_step"] = plain(model.time_step)
    if deck.types > 1:
        tables["contact"]["wall_material"] = f"type{box.side_material or 1}"
    return tables


def inlet_tables(deck: Deck, box: Box, end: float) -> list[dict[str, Any]]:
    """The inlets that have begun before a time [s]."""
    return [_inlet(deck, one, box) for one in deck.insertions if one.is_inlet and one.begin < end]


def added_tables(deck: Deck, box: Box, written: Written, segment: int) -> dict[str, Any]:
    """`start` of a stage: particles that are removed and added when it begins; empty without."""
    start: dict[str, Any] = {}
    if segment in deck.removals:
        start["remove"] = [where.table(box.shift, deck.axes) for where in deck.removals[segment]]
    packs, atoms = _packs(deck, segment), deck.atoms.get(segment)
    if atoms is not None and len(atoms):
        _left_out(deck, packs)
        start["add"] = {"file": _written(deck, box, written, segment, atoms)}
    elif packs:
        start["add"] = {"pack": [_pack(deck, one, box) for one in packs]}
    return start


def _packs(deck: Deck, segment: int) -> list[Insertion]:
    return [one for one in deck.insertions if not one.is_inlet and one.segment == segment]


def _left_out(deck: Deck, packs: list[Insertion]) -> None:
    for one in packs:
        reason = "particles come from a file or from packs, and the file is taken; begin a stage with the pack"
        deck.notes.amend(one.line, LEFT, reason)


def _first_particles(deck: Deck, box: Box, written: Written, data_name: str) -> dict[str, Any]:
    table: dict[str, Any] = {}
    atoms, packs = deck.atoms.get(0), _packs(deck, 0)
    if atoms is not None and len(atoms):
        _left_out(deck, packs)
        if atoms.from_file:
            table["file"] = _of_data_file(deck, box, data_name)
        else:
            table["file"] = _written(deck, box, written, 0, atoms)
    elif packs:
        table["pack"] = [_pack(deck, one, box) for one in packs]
    else:  # all come through inlets, whose particles stand for those that others would be
        table |= kinds_table([replace(deck.insertions[0].kinds[0], share=1.0)], deck.types > 1)
    return table


def _of_data_file(deck: Deck, box: Box, data_name: str) -> dict[str, Any]:
    """The file of the deck as it is."""
    table: dict[str, Any] = {**(deck.data_file or {}), "name": data_name}
    if deck.unit.name != "si":
        table["units"] = deck.unit.name
    if any(box.shift[k] for k in deck.axes) or "frame" in table:
        table["translate"] = [plain(box.shift[k]) for k in deck.axes]
    if deck.dimension == 2:
        table["plane"] = "xy"
    return table | _types(deck)


def _types(deck: Deck) -> dict[str, Any]:
    return {"types": {str(k + 1): f"type{k + 1}" for k in range(deck.types)}} if deck.types > 1 else {}


def _written(deck: Deck, box: Box, written: Written, segment: int, atoms: Atoms) -> dict[str, Any]:
    """Particles that the deck has made or changed, in a file of their own whose coordinates are those of the scene."""
    _draw_places(deck, atoms)
    moved = Atoms(**{name: getattr(atoms, name) for name in Atoms.COLUMNS})
    moved.position = atoms.position + np.asarray(box.shift)
    name = written.add(segment, moved.as_csv(deck.axes, deck.types > 1))
    return {"name": name} | _types(deck)


def _draw_places(deck: Deck, atoms: Atoms) -> None:
    """Give those that lie at random their places, now that their sizes are known."""
    axes = list(deck.axes)
    for number, (where, seed) in enumerate(atoms.regions):
        rows = np.flatnonzero(atoms.waiting == number)
        if not len(rows):
            continue
        places, placed = random_pack(where.space(deck.axes), 0.5 * atoms.diameter[rows], 1.0, abs(seed))
        if not placed.all():
            count, name = int(placed.sum()), "particles at random places"
            deck.notes.say(name, DIFFERS, f"{count} of {len(rows)} have room; the others are left out")
        atoms.position[np.ix_(rows[placed], axes)] = places[placed]
        atoms.waiting[rows[placed]] = -1
    atoms.keep(atoms.waiting < 0)


def _pack(deck: Deck, one: Insertion, box: Box) -> dict[str, Any]:
    table: dict[str, Any] = {"kind": "random", "spacing": 1.0, "region": one.region.table(box.shift, deck.axes)}
    if _fraction(deck, one) > REACHABLE[deck.dimension]:
        table["kind"] = "grown"
        deck.notes.differ(one.line, 'kind = "grown", because a random pack is not so dense')
    if one.count is not None:
        table["count"] = one.count
    else:
        table["solid_fraction"] = one.solid_fraction
    if any(one.velocity):
        table["velocity"] = [plain(one.velocity[k]) for k in deck.axes]
    return table | kinds_table(one.kinds, deck.types > 1)


def _fraction(deck: Deck, one: Insertion) -> float:
    """Solid fraction of a pack [-]."""
    if one.solid_fraction is not None:
        return one.solid_fraction
    power = deck.dimension
    size = sum(
        kind.share * (kind.mean_cube if power == 3 and kind.mean_cube else kind.radius**power) for kind in one.kinds
    )
    return (one.count or 0) * ball_size(power) * size / one.region.space(deck.axes).volume


def _inlet(deck: Deck, one: Insertion, box: Box) -> dict[str, Any]:
    where = one.region.table(box.shift, deck.axes)
    table: dict[str, Any] = {"start": where["start"], "stop": where["stop"]} if where["shape"] == "box" else {
        "region": where
    }  # fmt: skip
    table |= {"rate": plain(one.rate)} if one.rate is not None else {"mass_flow": plain(one.mass_rate or 0.0)}
    table["velocity"] = [plain(one.velocity[k]) for k in deck.axes]
    table |= {"begin": plain(one.begin)} if one.begin else {}
    table |= {"end": plain(one.end)} if one.end is not None else {}
    table |= {"total": one.count} if one.count else {}
    return table | kinds_table(one.kinds, deck.types > 1)


def kinds_table(kinds: list[Kind], several: bool) -> dict[str, Any]:
    """Radius or distribution, density and material of particles, or their species with shares by number."""
    tables = []
    for kind in kinds:
        table: dict[str, Any] = {"density": plain(kind.density)}
        table |= {"radius": plain(kind.radius)} if kind.distribution is None else {"distribution": kind.distribution}
        table |= {"material": f"type{kind.type}"} if several else {}
        tables.append(table)
    if len(tables) == 1:
        return tables[0]
    return {"species": [{"share": kind.share, **table} for kind, table in zip(kinds, tables, strict=True)]}


def merged(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    """Two tables as one, key by key."""
    found = dict(first)
    for key, value in second.items():
        known = found.get(key)
        found[key] = merged(known, value) if isinstance(value, dict) and isinstance(known, dict) else value
    return found

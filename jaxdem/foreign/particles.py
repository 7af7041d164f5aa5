"""Commands that create, change, move and remove single particles."""

from __future__ import annotations

import numpy as np

from jaxdem.foreign.atoms import DEFAULT_DENSITY, DEFAULT_DIAMETER, Atoms
from jaxdem.foreign.lattices import lattice_of
from jaxdem.foreign.model import Deck
from jaxdem.foreign.notes import DIFFERS, NOTHING, TAKEN, Answer, Unknown
from jaxdem.foreign.region import block
from jaxdem.foreign.words import integer, numbers

TARGET = "particles.file, written beside the scene"
NOT_PLACED = ("basis", "var", "set", "rotate", "subset", "ratio", "mol")
"""Options of `create_atoms` that are not carried out."""

AFTER_A_RUN = "after a run the particles are as it has left them; only [stages.start] changes them: remove, add, relax"


def lattice(deck: Deck, words: list[str]) -> Answer:
    """`lattice sc 0.01`."""
    deck.lattice = lattice_of(words, deck.unit.length)
    return TAKEN, "the places of create_atoms, and the unit of regions"


def create_atoms(deck: Deck, words: list[str]) -> Answer:
    """`create_atoms TYPE box | region ID | single x y z | random N SEED ID`."""
    kind, style = integer(words[1]), words[2]
    odd = [word for word in words[3:] if word in NOT_PLACED]
    if odd:
        raise Unknown(f"{odd[0]} is not carried out; write the particles into a text file with named columns")
    if not deck.lower:
        raise Unknown("there is no box before it; add create_box")
    unit, atoms = deck.unit, deck.atoms.setdefault(deck.segment, Atoms())
    diameter, density = DEFAULT_DIAMETER * unit.length, DEFAULT_DENSITY * unit.density
    if style == "single":
        place = np.asarray(numbers(words[3:], 3))
        in_box = "units" in words and words[words.index("units") + 1] == "box"
        scale = np.full(3, unit.length) if in_box or deck.lattice is None else np.asarray(deck.lattice.spacing)
        atoms.add((place * scale)[None], kind, diameter, density)
        return TAKEN, f"one particle of {TARGET}"
    if style == "random":
        count, seed = integer(words[3]), integer(words[4])
        where = block(deck.lower, deck.upper) if words[5] == "NULL" else deck.region(words[5])
        where.space(deck.axes)
        atoms.regions.append((where, seed))
        atoms.add(np.zeros((count, 3)), kind, diameter, density, waiting=len(atoms.regions) - 1)
        return DIFFERS, f"{count} particles of {TARGET}; the places are drawn anew, wholly inside and without overlaps"
    if style not in ("box", "region"):
        raise Unknown(f"create_atoms {style} is not carried out; write the particles into a text file")
    if deck.lattice is None:
        raise Unknown("there is no lattice before it; add lattice")
    where = block(deck.lower, deck.upper) if style == "box" else deck.region(words[3])
    low, high = (np.asarray(corner) for corner in (deck.lower, deck.upper))
    places = deck.lattice.places(low.tolist(), high.tolist(), deck.dimension)
    places = places if style == "box" else places[where.holds(places, deck.axes)]
    if not len(places):
        raise Unknown("the lattice has no place there")
    atoms.add(places, kind, diameter, density)
    return TAKEN, f"{len(places)} particles of {TARGET}"


def group(deck: Deck, words: list[str]) -> Answer:
    """`group NAME type|id|region ...`: particles that other commands name."""
    deck.groups[words[1]] = words[2:]
    return NOTHING, "a selection; set, velocity, delete_atoms and displace_atoms heed it, everything else acts on all"


def _now(deck: Deck) -> Atoms:
    """The particles that a command changes."""
    found = deck.atoms.get(deck.segment)
    if found is None or not len(found):
        raise Unknown(AFTER_A_RUN if deck.segment else "there are no particles of a file or of create_atoms before it")
    found.from_file = False
    return found


def _in_group(deck: Deck, atoms: Atoms, name: str, depth: int = 0) -> np.ndarray:
    """(N,) which particles belong to a group."""
    if name == "all":
        return np.ones(len(atoms), bool)
    if name not in deck.groups or depth > 10:
        raise Unknown(f"the group {name} is not known")
    style, *rest = deck.groups[name]
    if style in ("type", "id"):
        found = np.zeros(len(atoms), bool)
        for word in rest:
            found |= _in_range(getattr(atoms, style), word)
        return found
    if style == "region":
        return deck.region(rest[0]).holds(atoms.position, deck.axes)
    parts = [_in_group(deck, atoms, other, depth + 1) for other in rest]
    if style == "union" and parts:
        return np.logical_or.reduce(parts)
    if style == "intersect" and parts:
        return np.logical_and.reduce(parts)
    if style == "subtract" and parts:
        return parts[0] & ~np.logical_or.reduce([np.zeros(len(atoms), bool), *parts[1:]])
    raise Unknown(f"the group {name} of style {style} is not carried out")


def _in_range(values: np.ndarray, word: str) -> np.ndarray:
    """Which values lie in a range such as 3, 2*5, 2:5 or *."""
    word = word.replace(":", "*")
    first, star, last = word.partition("*")
    low = integer(first) if first else -np.inf
    high = low if not star else integer(last) if last else np.inf
    return (values >= low) & (values <= high)


def set_values(deck: Deck, words: list[str]) -> Answer:
    """`set type|atom|group|region ID KEYWORD VALUES ...`.

    As in LAMMPS a new diameter leaves the mass as it is; a new density changes the mass.
    """
    atoms, style, rest = _now(deck), words[1], words[3:]
    if style in ("type", "atom"):
        rows = _in_range(atoms.type if style == "type" else atoms.id, words[2])
    elif style == "region":
        rows = deck.region(words[2]).holds(atoms.position, deck.axes)
    elif style == "group":
        rows = _in_group(deck, atoms, words[2])
    else:
        raise Unknown(f"set {style} is not carried out; use type, atom, group or region")
    taken = []
    while rest:
        used = _set_one(deck, atoms, rows, rest)
        taken.append(rest[0])
        rest = rest[used:]
    return TAKEN, f"{', '.join(taken)} of {int(rows.sum())} particles of {TARGET}"


def _set_one(deck: Deck, atoms: Atoms, rows: np.ndarray, words: list[str]) -> int:
    """Carry out one keyword, and say how many words it has."""
    key, unit = words[0], deck.unit
    if key in ("x", "y", "z", "vx", "vy", "vz"):
        scale = unit.length if len(key) == 1 else unit.speed
        column = atoms.position if len(key) == 1 else atoms.velocity
        column[rows, "xyz".index(key[-1])] = numbers(words[1:], 1)[0] * scale
        return 2
    if key == "omega":
        atoms.spin[rows] = np.asarray(numbers(words[1:], 3)) / unit.time
        return 4
    if key in ("omegax", "omegay", "omegaz"):
        atoms.spin[rows, "xyz".index(key[-1])] = numbers(words[1:], 1)[0] / unit.time
        return 2
    if key == "type":
        atoms.type[rows] = integer(words[1])
        return 2
    if key not in ("diameter", "density", "mass"):
        raise Unknown(f"set ... {key} is not carried out; write the values into the file of particles")
    value = numbers(words[1:], 1)[0]
    if value <= 0.0:
        raise Unknown(f"{key} must be above 0")
    if key == "diameter":
        atoms.density[rows] *= (atoms.diameter[rows] / (value * unit.length)) ** 3
        atoms.diameter[rows] = value * unit.length
    elif key == "density":
        atoms.density[rows] = value * unit.density
    else:
        atoms.density[rows] = value * unit.mass / (np.pi / 6.0 * atoms.diameter[rows] ** 3)
    return 2


def velocity(deck: Deck, words: list[str]) -> Answer:
    """`velocity GROUP set vx vy vz` and `velocity GROUP zero linear|angular`."""
    if words[2] not in ("set", "zero"):
        raise Unknown(f"velocity {words[2]} draws or scales; give columns vx vy vz in a file of particles")
    atoms = _now(deck)
    rows = _in_group(deck, atoms, words[1])
    if words[2] == "zero":
        mass = (atoms.density * atoms.diameter**3)[rows, None]
        column = atoms.velocity if words[3] == "linear" else atoms.spin
        if words[3] != "linear" and column.any():
            raise Unknown("velocity zero angular is not carried out; give columns wx wy wz in a file of particles")
        if rows.any():
            column[rows] -= (mass * column[rows]).sum(axis=0) / mass.sum()
        return TAKEN, f"velocities of {TARGET}"
    if set(words[6:]) & {"sum", "mom", "rot", "lattice"}:
        raise Unknown("options of velocity set are not carried out; give columns vx vy vz in a file of particles")
    for axis, word in enumerate(words[3:6]):
        if word != "NULL":
            atoms.velocity[rows, axis] = numbers([word], 1)[0] * deck.unit.speed
    return TAKEN, f"velocities of {int(rows.sum())} particles of {TARGET}"


def delete_atoms(deck: Deck, words: list[str]) -> Answer:
    """`delete_atoms group|region ID`."""
    if deck.segment and words[1] == "region":
        where = deck.region(words[2])
        where.space(deck.axes)
        deck.removals.setdefault(deck.segment, []).append(where)
        return TAKEN, "stages.start.remove"
    atoms = _now(deck)
    if words[1] == "group":
        rows = _in_group(deck, atoms, words[2])
    elif words[1] == "region":
        rows = deck.region(words[2]).holds(atoms.position, deck.axes)
    else:
        raise Unknown(f"delete_atoms {words[1]} is not carried out; remove the rows from the file of particles")
    if (atoms.waiting >= 0).any():
        raise Unknown("particles at random places are not removed; lower their number")
    atoms.keep(~rows)
    return TAKEN, f"{int(rows.sum())} particles are not in {TARGET}"


def displace_atoms(deck: Deck, words: list[str]) -> Answer:
    """`displace_atoms GROUP move dx dy dz`."""
    if words[2] != "move":
        raise Unknown(f"displace_atoms {words[2]} is not carried out; move the particles in their file")
    atoms = _now(deck)
    in_box = "units" in words and words[words.index("units") + 1] == "box"
    scale = np.full(3, deck.unit.length) if in_box or deck.lattice is None else np.asarray(deck.lattice.spacing)
    rows = _in_group(deck, atoms, words[1])
    atoms.position[rows] += np.asarray(numbers(words[3:], 3)) * scale
    return TAKEN, f"places of {int(rows.sum())} particles of {TARGET}"

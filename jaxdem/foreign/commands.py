"""What each command of LIGGGHTS says of the model. A handler gives the kind of note and its reason."""

from __future__ import annotations

import math
from collections.abc import Callable

from jaxdem.errors import InputError
from jaxdem.foreign.model import AXES, Deck, Region
from jaxdem.foreign.notes import DIFFERS, LEFT, NOTHING, TAKEN, Unknown

Answer = tuple[str, str]
Handler = Callable[[Deck, list[str]], Answer]

NO_EFFECT = {
    "atom_modify", "communicate", "comm_modify", "newton", "processors", "neighbor", "neigh_modify", "compute",
    "compute_modify", "thermo_style", "echo", "log", "print", "shell", "group", "pair_coeff", "dump_modify", "restart",
    "write_restart", "write_data", "thermo_log", "info", "partition", "undump", "uncompute", "label", "clear",
}  # fmt: skip
"""Commands about output and parallel work, which a scene does by itself."""

REASONS = {
    "read_restart": "restart files are binary and of one version; write a dump or a data file from it, and name it in "
    "particles.file",
    "if": "conditions are not carried out; write the commands that hold into the deck",
    "jump": "loops are not carried out; use `jaxdem sweep` for several runs",
    "next": "loops are not carried out; use `jaxdem sweep` for several runs",
    "set": "write the values into the file of particles, or into [particles] of the scene",
    "create_atoms": "write the particles into a text file with named columns, for particles.file",
    "unfix": "a scene keeps its parts from the start to the end; give walls and inlets an end",
    "velocity": "give particles.velocity in the scene, or columns vx vy vz in its file",
    "displace_atoms": "move the particles in their file (particles.file.translate)",
    "change_box": "the box of a scene does not change; write its last size into domain.size",
    "dimension": "a plane of LIGGGHTS has discs; make a scene with two numbers in domain.size by hand",
}


def numbers(words: list[str], count: int) -> list[float]:
    """The first `count` words as finite numbers.

    Raises:
        Unknown: they are not.
    """
    try:
        found = [float(word) for word in words[:count]]
    except ValueError:
        found = []
    if len(found) < count or not all(math.isfinite(value) for value in found):
        raise Unknown(f"needs {count} number(s), got {' '.join(words[:count]) or 'nothing'}")
    return found


def units(deck: Deck, words: list[str]) -> Answer:
    """`units si`."""
    if words[1] not in ("si", "cgs"):
        limit = "all numbers of a scene are in SI units; only si and cgs are converted"
        raise InputError("units", words[1], limit, "convert the deck to si")
    deck.units = words[1]
    return TAKEN, "SI" if words[1] == "si" else "all numbers converted to SI"


def boundary(deck: Deck, words: list[str]) -> Answer:
    """`boundary p f m`."""
    deck.boundary = [(word * 2)[:2] for word in words[1:4]]
    return TAKEN, "periodic axes; the ends of the others are walls of the deck, or noted at the end"


def region(deck: Deck, words: list[str]) -> Answer:
    """`region ID block|cylinder|sphere ...`."""
    name, style, rest = words[1], words[2], words[3:]
    unit = deck.length
    if style == "block":
        ends = [_end(deck, word, k // 2, k % 2) for k, word in enumerate(rest[:6])]
        deck.regions[name] = Region("block", [v * unit for v in ends[::2]], [v * unit for v in ends[1::2]])
    elif style == "cylinder":
        axis = AXES.index(rest[0])
        first, second, radius, low, high = (value * unit for value in numbers(rest[1:], 5))
        others = [k for k in range(3) if k != axis]
        center = [0.0] * 3
        center[others[0]], center[others[1]] = first, second
        lower, upper = [c - radius for c in center], [c + radius for c in center]
        lower[axis], upper[axis] = low, high
        deck.regions[name] = Region("cylinder", lower, upper, center, radius, axis)
    elif style == "sphere":
        *center, radius = (value * unit for value in numbers(rest, 4))
        deck.regions[name] = Region(
            "sphere", [c - radius for c in center], [c + radius for c in center], center, radius
        )
    else:
        raise Unknown(f"regions of style {style} have no counterpart; use block, cylinder or sphere")
    return TAKEN, f"region {name}"


def _end(deck: Deck, word: str, axis: int, upper: int) -> float:
    if word in ("INF", "EDGE"):
        if not deck.lower:
            raise Unknown(f"{word} needs a box before it; write the number")
        return (deck.upper if upper else deck.lower)[axis] / deck.length
    return numbers([word], 1)[0]


def create_box(deck: Deck, words: list[str]) -> Answer:
    """`create_box N region-ID`."""
    deck.types = int(numbers(words[1:], 1)[0])
    box = deck.regions.get(words[2])
    if box is None or box.shape != "block":
        raise Unknown("the box must be a block region that stands before it")
    deck.lower, deck.upper = list(box.lower), list(box.upper)
    return TAKEN, "domain.size; the origin is moved to the lower corner"


def timestep(deck: Deck, words: list[str]) -> Answer:
    """`timestep DT`."""
    deck.time_step = numbers(words[1:], 1)[0]
    return TAKEN, f"contact.time_step; at most {deck.time_step:g} s, so that steps divide the interval"


def pair_style(deck: Deck, words: list[str]) -> Answer:
    """`pair_style gran model hertz tangential history rolling_friction cdt`."""
    if words[1:3] != ["gran", "model"]:
        raise Unknown("only pair_style gran model ... is known; write the contact law into [contact] by hand")
    given = dict(zip(words[2::2], words[3::2], strict=False))
    answer = contact_words(given)
    deck.contact = given
    return answer


def contact_words(given: dict[str, str]) -> Answer:
    """What a contact model of LIGGGHTS becomes.

    Raises:
        Unknown: its normal law has no counterpart.
    """
    model, different = given.get("model", ""), []
    if model not in ("hertz", "hooke"):
        raise Unknown(f"the model {model} has no counterpart; use hertz or hooke")
    if model == "hooke":
        different.append("the stiffness from characteristicVelocity is one number, that of the largest particles")
    if given.get("tangential") not in ("history",):
        different.append("tangential springs keep their history here; it is off in the deck")
    rolling = given.get("rolling_friction", "off")
    if rolling not in ("off", "cdt"):
        different.append(f"rolling friction {rolling} becomes 'epsd', with contact.rolling_damping at its default")
    if given.get("cohesion", "off") != "off":
        different.append("cohesion is left out")
    others = set(given) - {"model", "tangential", "rolling_friction", "cohesion"}
    if others:
        different.append(f"{', '.join(sorted(others))} left out")
    return (DIFFERS, "; ".join(different)) if different else (TAKEN, "contact.law and its parts")


def run(deck: Deck, words: list[str]) -> Answer:
    """`run N`, `run N upto`."""
    steps = int(numbers(words[1:], 1)[0])
    before = deck.steps
    deck.steps = max(before, steps) if "upto" in words else before + steps
    if before > 1 and deck.steps > before:
        return DIFFERS, "added to the runs before it: a scene is one run, with the state of the deck at its end"
    return TAKEN, "time.end"


def dump(deck: Deck, words: list[str]) -> Answer:
    """`dump ID group style N file ...`: the first that writes particles gives the output interval."""
    if words[3].startswith("mesh") or deck.output_steps:
        return NOTHING, "output of a mesh, or a further dump"
    deck.output_steps = int(numbers(words[4:], 1)[0])
    return TAKEN, "time.output_interval; frames have all columns"


def thermo_modify(deck: Deck, words: list[str]) -> Answer:
    """`thermo_modify lost ignore`."""
    if "lost" in words[:-1]:
        deck.lost = words[words.index("lost") + 1]
        return TAKEN, "whether particles may leave through ends of the box without a wall"
    return NOTHING, "output"


def thermo(deck: Deck, words: list[str]) -> Answer:
    """`thermo N`."""
    return NOTHING, "output; history.csv has a row for each frame"


def atom_style(deck: Deck, words: list[str]) -> Answer:
    """`atom_style granular`."""
    if words[1] not in ("granular", "sphere"):
        raise Unknown(f"particles of style {words[1]} have no counterpart; a scene has spheres")
    return TAKEN, "spheres"


def read_data(deck: Deck, words: list[str]) -> Answer:
    """`read_data FILE`."""
    deck.data_file = words[1]
    return TAKEN, "particles.file, and the box of that file"


HANDLERS: dict[str, Handler] = {
    "units": units, "boundary": boundary, "region": region, "create_box": create_box, "timestep": timestep,
    "pair_style": pair_style, "run": run, "dump": dump, "thermo_modify": thermo_modify, "thermo": thermo,
    "atom_style": atom_style, "read_data": read_data,
}  # fmt: skip


def apply(deck: Deck, words: list[str], fix: Handler) -> Answer:
    """Carry out one command; `fix` does those that begin with fix."""
    name = words[0]
    if name == "dimension" and words[1:] == ["3"]:
        return TAKEN, "three axes"
    if name == "unfix" or name in REASONS:
        return LEFT, REASONS[name]
    if name in NO_EFFECT:
        return NOTHING, "output, groups or parallel work"
    handler = fix if name == "fix" else HANDLERS.get(name)
    if handler is None:
        return LEFT, "there is no counterpart"
    try:
        return handler(deck, words)
    except Unknown as error:
        return LEFT, str(error)
    except (IndexError, ValueError):
        return LEFT, "the command has not the form that is expected; correct the line"

"""What each command of LIGGGHTS and LAMMPS says of the model. A handler gives the kind of note and its reason."""

from __future__ import annotations

import re
from collections.abc import Callable

from jaxdem.foreign import region as shapes
from jaxdem.foreign.contact_lammps import gran_style, granular_style, pair_coefficients
from jaxdem.foreign.contact_liggghts import LiggghtsContact, contact_words
from jaxdem.foreign.ends import end_of_script
from jaxdem.foreign.files import read_data, read_dump
from jaxdem.foreign.model import Deck, Segment
from jaxdem.foreign.notes import LEFT, NOTHING, TAKEN, Answer, Unknown, joined_answer
from jaxdem.foreign.particles import create_atoms, delete_atoms, displace_atoms, group, lattice, set_values, velocity
from jaxdem.foreign.region import AXES
from jaxdem.foreign.units import units_of
from jaxdem.foreign.words import integer, numbers, positive

Handler = Callable[[Deck, list[str]], Answer]

NO_EFFECT = {
    "atom_modify", "communicate", "comm_modify", "comm_style", "newton", "processors", "neighbor", "neigh_modify",
    "compute", "compute_modify", "thermo_style", "thermo", "echo", "log", "print", "shell", "dump_modify", "restart",
    "write_restart", "write_data", "write_dump", "thermo_log", "info", "partition", "undump", "uncompute", "label",
    "clear", "package", "suffix", "timer", "balance", "reset_timestep", "reset_atoms",
    "soft_particles", "hard_particles", "fix_modify", "run_style", "mass",
}  # fmt: skip
"""Commands about output and parallel work, which a scene does by itself."""

REASONS = {
    "rerun": "a rerun computes nothing; name its dump in particles.file (with frame), or in start.from of a run",
    "jump": "loops are not carried out; use `jaxdem sweep` for several runs",
    "next": "loops are not carried out; use `jaxdem sweep` for several runs",
    "change_box": "the box of a scene does not change; write its last size into domain.size",
    "minimize": "nothing is minimised; particles of a file that overlap are moved apart by start.relax",
    "coarsegraining": "write particles.coarse_grain into the scene; it scales radii and laws by itself",
    "replicate": "write the replicated particles into a data file",
    "quit": "the script goes on here; remove what follows it",
    "kspace_style": "spheres have no charges", "bond_style": "particles have no bonds", "bond_coeff": "no bonds",
}  # fmt: skip
NAME = re.compile(r"[^A-Za-z0-9_+=-]+")
LONGEST_NAME = 40


def units(deck: Deck, words: list[str]) -> Answer:
    """`units si`."""
    deck.units = units_of(words[1])
    return TAKEN, "SI" if words[1] == "si" else "all numbers converted to SI"


def dimension(deck: Deck, words: list[str]) -> Answer:
    """`dimension 2|3`."""
    deck.dimension = integer(words[1])
    if deck.dimension not in (2, 3):
        raise Unknown("a scene has two or three axes")
    if deck.dimension == 3:
        return TAKEN, "domain.size, three axes"
    return TAKEN, "domain.size, two axes: x, and y upwards; domain.depth is the largest diameter"


def boundary(deck: Deck, words: list[str]) -> Answer:
    """`boundary p f m`."""
    found = [(word * 2)[:2] for word in words[1:4]]
    if len(found) != 3 or not all(set(ends) <= set("pfsm") and len(ends) == 2 for ends in found):
        raise Unknown("needs three of p, f, s, m or pairs of them")
    deck.boundary = found
    return TAKEN, 'boundary.SIDE.kind = "periodic" where it is p; other ends are walls of the deck, or noted at the end'


def region(deck: Deck, words: list[str]) -> Answer:
    """`region ID block|cylinder|sphere ...`."""
    name, style, rest = words[1], words[2], words[3:]
    in_box = "units" in words and words[words.index("units") + 1] == "box"
    scale = [deck.unit.length] * 3 if in_box or deck.lattice is None else list(deck.lattice.spacing)
    if style == "block":
        ends = [_end(deck, word, k // 2, k % 2, scale) for k, word in enumerate(rest[:6])]
        if len(ends) < 6:
            raise Unknown("a block needs six numbers")
        made, more = shapes.block(ends[::2], ends[1::2]), rest[6:]
    elif style == "cylinder":
        axis = AXES.index(rest[0])
        others = [k for k in range(3) if k != axis]
        first, second, radius = numbers(rest[1:], 3)
        ends = [_end(deck, word, axis, upper, scale) for upper, word in enumerate(rest[4:6])]
        middle = [first * scale[others[0]], second * scale[others[1]]]
        made, more = shapes.cylinder(axis, middle, radius * scale[others[0]], ends), rest[6:]
    elif style == "sphere":
        *center, radius = numbers(rest, 4)
        made = shapes.sphere([c * s for c, s in zip(center, scale, strict=True)], radius * scale[0])
        more = rest[4:]
    else:
        raise Unknown(f"regions of style {style} have no counterpart; use block, cylinder or sphere")
    options = dict(zip(more[::2], more[1::2], strict=False))
    if set(options) & {"move", "rotate"}:
        raise Unknown("a region that moves has no counterpart")
    if not all(low < high for low, high in zip(made.lower, made.upper, strict=True)):
        raise Unknown("its upper ends must be above its lower ends")
    made.inside = options.get("side", "in") != "out"
    deck.regions[name] = made
    return TAKEN, f"the region {name} of what names it"


def _end(deck: Deck, word: str, axis: int, upper: int, scale: list[float]) -> float:
    """The end of a region along an axis [m]."""
    if word in ("INF", "EDGE"):
        if not deck.lower:
            raise Unknown(f"{word} needs a box before it; write the number")
        return (deck.upper if upper else deck.lower)[axis]
    return numbers([word], 1)[0] * scale[axis]


def create_box(deck: Deck, words: list[str]) -> Answer:
    """`create_box N region-ID`."""
    box = deck.regions.get(words[2])
    if box is None or box.shape != "block":
        raise Unknown("the box must be a block region that stands before it")
    deck.types = int(positive([str(integer(words[1]))], 1)[0])
    deck.lower, deck.upper = list(box.lower), list(box.upper)
    return TAKEN, "domain.size; the origin is moved to the lower corner"


def timestep(deck: Deck, words: list[str]) -> Answer:
    """`timestep DT`."""
    deck.model.time_step = positive(words[1:], 1)[0] * deck.unit.time
    deck.model.time_step_line = deck.line
    return TAKEN, f"contact.time_step; at most {deck.model.time_step:g} s, so that steps divide the interval"


def pair_style(deck: Deck, words: list[str]) -> Answer:
    """`pair_style gran model ...`, `granular`, or `gran/hertz/history ...`."""
    style = words[1].removesuffix("/omp").removesuffix("/gpu").removesuffix("/kk")
    if words[1:3] == ["gran", "model"]:
        given = dict(zip(words[2::2], words[3::2], strict=False))
        answer = contact_words(given)
        deck.model.contact = LiggghtsContact(given, deck.line)
        return answer
    if style == "granular":
        return granular_style(deck, words)
    if style in ("gran/hertz/history", "gran/hooke/history", "gran/hooke"):
        return gran_style(deck, style, words[2:])
    raise Unknown(f"pair_style {style} has no counterpart; write the contact law into [contact] by hand")


def pair_coeff(deck: Deck, words: list[str]) -> Answer:
    """`pair_coeff I J ...`: the constants of `pair_style granular`."""
    return pair_coefficients(deck, words)


def run(deck: Deck, words: list[str]) -> Answer:
    """`run N`, `run N upto`: a part of the scene, which ends then."""
    steps = integer(words[1])
    more = max(0, steps - deck.steps) if "upto" in words else steps
    if not more:
        return NOTHING, "no step is made"
    if deck.model.time_step <= 0.0:
        raise Unknown("there is no time step before it; add timestep")
    if deck.model.contact is None:
        raise Unknown("there is no contact model before it; add pair_style")
    duration = more * deck.model.time_step
    deck.steps += more
    if not deck.has_particles and not deck.segments:
        return NOTHING, "there are no particles yet; the clock of the scene begins after it"
    name = NAME.sub("_", deck.comment.strip())[:LONGEST_NAME].strip("_")
    deck.segments.append(Segment(deck.line, name, deck.time, deck.time + duration, deck.frozen_model()))
    deck.time += duration
    return TAKEN, "time.end"


def read_restart(deck: Deck, words: list[str]) -> Answer:
    """`read_restart FILE`: the state that another script has written; that script has been carried out before."""
    if len(words) < 3 or not deck.has_particles:
        reason = "restart files are binary and of one version, and no script beside this one writes it"
        raise Unknown(f"{reason}; write a dump or a data file from it, and name it in read_data or in particles.file")
    end_of_script(deck)
    return TAKEN, f"the particles as {words[-1]} leaves them: its lines are carried out before"


def dump(deck: Deck, words: list[str]) -> Answer:
    """`dump ID group style N file ...`: the first that writes particles gives the output interval."""
    if words[3].startswith(("mesh", "euler", "image", "movie")) or deck.model.output_steps:
        return NOTHING, "output of a mesh or an image, or a further dump"
    deck.model.output_steps = integer(words[4])
    return TAKEN, "time.output_interval; frames have all columns"


def thermo_modify(deck: Deck, words: list[str]) -> Answer:
    """`thermo_modify lost ignore`."""
    if "lost" in words[:-1]:
        deck.lost = words[words.index("lost") + 1]
        return TAKEN, "boundary.SIDE.particles: whether particles may leave through ends of the box without a wall"
    return NOTHING, "output"


def atom_style(deck: Deck, words: list[str]) -> Answer:
    """`atom_style granular`."""
    if words[1] not in ("granular", "sphere"):
        deck.odd_particles = words[1]
        raise Unknown(f"particles of style {words[1]} have no counterpart; a scene has spheres")
    return TAKEN, "spheres, as [particles] has them"


HANDLERS: dict[str, Handler] = {
    "units": units, "dimension": dimension, "boundary": boundary, "region": region, "create_box": create_box,
    "timestep": timestep, "pair_style": pair_style, "pair_coeff": pair_coeff, "run": run, "dump": dump,
    "thermo_modify": thermo_modify, "atom_style": atom_style, "read_data": read_data, "read_dump": read_dump,
    "lattice": lattice, "create_atoms": create_atoms, "set": set_values, "velocity": velocity, "group": group,
    "delete_atoms": delete_atoms, "displace_atoms": displace_atoms, "read_restart": read_restart,
}  # fmt: skip


def apply(deck: Deck, words: list[str], fixes: dict[str, Handler]) -> Answer:
    """Carry out one command; `fixes` has those that the room of fixes does, `fix` and `unfix`."""
    name = words[0]
    if name in REASONS:
        return LEFT, REASONS[name]
    if name in NO_EFFECT:
        return NOTHING, "output or parallel work"
    if name == "variable":
        return TAKEN, f"{words[1]} is defined"
    handler = fixes.get(name) or HANDLERS.get(name)
    if handler is None:
        return LEFT, "there is no counterpart"
    try:
        return handler(deck, words)
    except Unknown as error:
        return LEFT, str(error)
    except (IndexError, ValueError, KeyError, ArithmeticError):
        return LEFT, "the command has not the form that is expected; correct the line"


def apply_all(deck: Deck, parts: list[list[str]], fixes: dict[str, Handler]) -> Answer:
    """Carry out the commands of a line."""
    return joined_answer([apply(deck, part, fixes) for part in parts])

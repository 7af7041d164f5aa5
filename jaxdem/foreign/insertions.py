"""Insertion of particles by LIGGGHTS: templates, distributions, `insert/pack`, `insert/rate/region`, `insert/stream`.

Source: LIGGGHTS-PUBLIC documentation, the pages of these fixes.
"""

from __future__ import annotations

import math

from jaxdem.foreign.faces import Face
from jaxdem.foreign.model import Deck, Insertion, Kind
from jaxdem.foreign.notes import DIFFERS, TAKEN, Answer, Unknown
from jaxdem.foreign.region import Region
from jaxdem.foreign.words import integer, numbers, option, positive

SPREAD, SMALLEST = 3, 0.1
"""Standard deviations at which a normal distribution is cut, and least part of the mean of a radius."""

LAYER = 2.002
"""Thickness of the layer at the face of a stream, over the largest radius: a diameter, and room for rounding."""


def template(deck: Deck, words: list[str]) -> Answer:
    """`fix ID all particletemplate/sphere SEED atom_type T density constant RHO radius constant R`."""
    options = dict(zip(words[5:], words[6:], strict=False))
    at, unit = words.index("density"), deck.unit
    if words[at + 1] != "constant":
        raise Unknown(f"density {words[at + 1]} is not taken; write particles.density in the scene")
    density = positive(words[at + 2 :], 1)[0] * unit.density
    kind, at = int(options.get("atom_type", "1")), words.index("radius")
    if words[at + 1] == "constant":
        deck.templates[words[1]] = Kind(1.0, density, kind, positive(words[at + 2 :], 1)[0] * unit.length)
        return TAKEN, "radius and density of [particles], or of a species"
    if words[at + 1 : at + 3] != ["gaussian", "number"]:
        raise Unknown(f"radius {words[at + 1]} is not taken; write [particles.distribution] in the scene")
    mean, deviation = (value * unit.length for value in positive(words[at + 3 :], 2))
    low, high = max(mean - SPREAD * deviation, SMALLEST * mean), mean + SPREAD * deviation
    table = {"kind": "normal", "by": "number", "mean": mean, "standard_deviation": deviation}
    table |= {"lower": low, "upper": high}
    deck.templates[words[1]] = Kind(1.0, density, kind, high, table, mean**3 + 3.0 * mean * deviation**2)
    return DIFFERS, f"distribution of [particles]; it is cut at {SPREAD} standard deviations"


def distribution(deck: Deck, words: list[str]) -> Answer:
    """`fix ID all particledistribution/discrete SEED N t1 w1 ...`: parts by mass, or by number if it says so."""
    count = integer(words[5])
    pairs = words[6 : 6 + 2 * count]
    by_mass = not words[3].endswith("numberbased")
    missing = [name for name in pairs[::2] if name not in deck.templates]
    if missing:
        raise Unknown(f"the template {missing[0]} was not taken")
    kinds = []
    for name, part in zip(pairs[::2], pairs[1::2], strict=True):
        made = deck.templates[name]
        share = positive([part], 1)[0] / (made.mass if by_mass else 1.0)
        kinds.append(Kind(share, made.density, made.type, made.radius))
        if made.distribution is not None and count > 1:
            raise Unknown("a species has one radius; write [particles.distribution] in the scene")
        kinds[-1].distribution, kinds[-1].mean_cube = made.distribution, made.mean_cube
    total = sum(kind.share for kind in kinds)
    for kind in kinds:
        kind.share /= total
    deck.distributions[words[1]] = kinds
    return TAKEN, "shares by number, from those by mass" if by_mass and count > 1 else "species"


def insert(deck: Deck, words: list[str]) -> Answer:
    """`fix ID group insert/pack|insert/rate/region|insert/stream ...`."""
    name = words[words.index("distributiontemplate") + 1]
    if name not in deck.distributions:
        raise Unknown(f"the distribution {name} was not taken")
    kinds, style = deck.distributions[name], words[3].removeprefix("insert/")
    velocity, different = _velocity(deck, words)
    if style == "stream":
        where = _layer(deck, words, kinds, velocity)
    else:
        where = deck.region(words[words.index("region") + 1])
        where.space(deck.axes)  # whether it has a counterpart
    made = Insertion(deck.line, kinds, where, deck.segment, velocity=velocity, begin=deck.time)
    if "omega" in words:
        different.append("omega is left out, the particles do not spin")
    if style == "pack":
        different += _fill(deck, words, made)
        target = '[[particles.pack]], kind = "random"' if not deck.segment else "stages.start.add.pack"
        if deck.segment:
            different.append("the region must be free of other particles then")
    else:
        _flow(deck, words, made)
        target = "[[particles.inlet]]; particles come one by one, not in batches"
        if style == "stream":
            different.append("they begin in a layer of one diameter at the face")
    deck.insertions.append(made)
    deck.fixes[words[1]] = made
    return (DIFFERS if different else TAKEN), "; ".join([target, *different])


def _velocity(deck: Deck, words: list[str]) -> tuple[tuple[float, ...], list[str]]:
    """The velocity [m/s], and what is left out of it."""
    if "vel" not in words:
        return (0.0, 0.0, 0.0), []
    at = words.index("vel")
    found = tuple(v * deck.unit.speed for v in numbers(words[at + 2 :], 3))
    return found, [] if words[at + 1] == "constant" else [f"the spread of vel {words[at + 1]} is left out"]


def _fill(deck: Deck, words: list[str], made: Insertion) -> list[str]:
    """How many particles a pack has; what is left out."""
    every = words[words.index("insert_every") + 1] if "insert_every" in words else "once"
    count = option(words, "particles_in_region")
    made.count, made.solid_fraction = None if count is None else int(count), option(words, "volumefraction_region")
    mass = option(words, "mass_in_region", deck.unit.mass)
    if mass is not None and made.count is None and made.solid_fraction is None:
        mean = sum(kind.share * kind.mass for kind in made.kinds)
        made.count = max(1, round(mass / mean))
    if made.count is None and made.solid_fraction is None:
        raise Unknown("only particles_in_region, mass_in_region and volumefraction_region are taken")
    if every in ("once", "0"):
        return []
    return [f"it is filled once; that it is filled again every {every} steps is left out (use [[particles.inlet]])"]


def _flow(deck: Deck, words: list[str], made: Insertion) -> None:
    """How fast and how long particles come."""
    made.rate = option(words, "particlerate", 1.0 / deck.unit.time)
    made.mass_rate = option(words, "massrate", deck.unit.mass / deck.unit.time)
    if made.rate is None and made.mass_rate is None:
        raise Unknown("an inlet needs particlerate or massrate")
    if "nparticles" in words and words[words.index("nparticles") + 1] != "INF":
        made.count = int(option(words, "nparticles") or 0)
    elif "mass" in words and words[words.index("mass") + 1] != "INF":
        mean = sum(kind.share * kind.mass for kind in made.kinds)
        made.count = max(1, round((option(words, "mass", deck.unit.mass) or 0.0) / mean))
    start = option(words, "start")
    if start is not None and deck.model.time_step:
        made.begin = max(made.begin, (start - deck.steps) * deck.model.time_step + deck.time)


def _layer(deck: Deck, words: list[str], kinds: list[Kind], velocity: tuple[float, ...]) -> Region:
    """The layer at the face of a stream, on the side to which the particles move."""
    name = words[words.index("insertion_face") + 1]
    face = deck.fixes.get(name)
    if not isinstance(face, Face):
        why = f" ({face})" if isinstance(face, str) and " " in face else ""
        raise Unknown(f"its face {name} was not taken{why}; write [[particles.inlet]] with start and stop of a box")
    along = velocity[face.axis]
    if along == 0.0:
        raise Unknown("its particles do not move away from the face; give vel constant across it")
    deck.notes.amend(face.line, TAKEN, "the face of an inlet: start and stop of [[particles.inlet]]")
    largest = max(kind.radius for kind in kinds)
    return face.layer(LAYER * largest, int(math.copysign(1, along)))

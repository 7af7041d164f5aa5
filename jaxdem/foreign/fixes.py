"""What each fix of LIGGGHTS says of the model."""

from __future__ import annotations

import math
from collections.abc import Callable

from jaxdem.foreign.commands import Answer, contact_words, numbers
from jaxdem.foreign.model import AXES, Deck, Insertion, Template
from jaxdem.foreign.notes import DIFFERS, LEFT, NOTHING, TAKEN, Unknown

Fix = Callable[[Deck, list[str]], Answer]

PROPERTIES = (
    "youngsModulus", "poissonsRatio", "coefficientRestitution", "coefficientFriction", "coefficientRollingFriction",
    "characteristicVelocity",
)  # fmt: skip
NO_EFFECT = ("nve/sphere", "check/timestep/gran", "print", "ave/time", "ave/atom", "ave/spatial", "couple/cfd",
             "couple/cfd/force", "couple/cfd/force/implicit", "property/atom", "store/state")  # fmt: skip
REASONS = {
    "mesh/surface": "walls are planes, cylinders and wedges here, no triangles; write [[walls]] in their place",
    "mesh/surface/stress": "walls are planes, cylinders and wedges here, no triangles; write [[walls]] in their place",
    "move/mesh": 'walls do not move, but for boundary.SIDE.kind = "moving_wall"',
    "enforce2d": "a scene with two numbers in domain.size is a plane",
    "freeze": "particles cannot be held; make a wall of them",
    "insert/stream": "its face is a mesh; write [[particles.inlet]] with start and stop of a box",
}


def fix(deck: Deck, words: list[str]) -> Answer:
    """`fix ID group STYLE ...`."""
    style = words[3]
    if style in NO_EFFECT:
        return NOTHING, "a scene does this by itself"
    if style in REASONS:
        return LEFT, REASONS[style]
    handler = HANDLERS.get(style)
    if handler is None:
        raise Unknown(f"fix {style} has no counterpart")
    return handler(deck, words)


def property_global(deck: Deck, words: list[str]) -> Answer:
    """`fix ID all property/global NAME peratomtype|peratomtypepair [N] values`."""
    name, kind, values = words[4], words[5], words[6:]
    if name not in PROPERTIES:
        raise Unknown(f"the property {name} has no counterpart")
    if kind == "peratomtypepair":
        types = int(numbers(values, 1)[0])
        found = numbers(values[1:], types * types)
    else:
        found = numbers(values, len(values))
    pascal = deck.mass / deck.length  # kg/(m s2)
    factor = {"youngsModulus": pascal, "characteristicVelocity": deck.length}.get(name, 1.0)
    deck.properties[name] = [value * factor for value in found]
    return TAKEN, "[contact], or [[materials]] and [[material_pairs]]"


def gravity(deck: Deck, words: list[str]) -> Answer:
    """`fix ID all gravity G vector x y z` or `chute ANGLE`."""
    size = numbers(words[4:], 1)[0] * deck.length
    if words[5] == "vector":
        direction = numbers(words[6:], 3)
        length = math.hypot(*direction)
        deck.gravity = [0.0 if size == 0.0 or not c else size * c / length for c in direction]
    elif words[5] == "chute":
        angle = math.radians(numbers(words[6:], 1)[0])
        deck.gravity = [size * math.sin(angle), 0.0, -size * math.cos(angle)]
    else:
        raise Unknown(f"gravity of style {words[5]} has no counterpart; use vector")
    return TAKEN, "domain.gravity"


def wall(deck: Deck, words: list[str]) -> Answer:
    """`fix ID all wall/gran model ... primitive type T xplane C` or `zcylinder R c1 c2`."""
    if "primitive" not in words:
        raise Unknown(REASONS["mesh/surface"])
    at = words.index("primitive")
    kind, reason = contact_words(dict(zip(words[4:at:2], words[5:at:2], strict=False)))
    material, shape, rest = int(words[at + 2]), words[at + 3], words[at + 4 :]
    axis = AXES.index(shape[0])
    if shape[1:] == "plane":
        deck.planes[axis].append((numbers(rest, 1)[0] * deck.length, material))
        more, target = rest[1:], f"an end of the box along {AXES[axis]}"
    elif shape[1:] == "cylinder":
        radius, first, second = (value * deck.length for value in numbers(rest, 3))
        deck.cylinders.append((axis, radius, (first, second), material))
        more, target = rest[3:], '[[walls]], kind = "cylinder"'
    else:
        raise Unknown(f"walls of shape {shape} have no counterpart")
    if more:
        return DIFFERS, f"{target}; {' '.join(more)} left out: the wall does not move"
    return (TAKEN, target) if kind == TAKEN else (DIFFERS, f"{target}; {reason}")


def template(deck: Deck, words: list[str]) -> Answer:
    """`fix ID all particletemplate/sphere SEED atom_type T density constant RHO radius constant R`."""
    options = dict(zip(words[5:], words[6:], strict=False))
    made = Template(type=int(options.get("atom_type", "1")))
    for name, unit in (("radius", deck.length), ("density", deck.mass / deck.length**3)):
        at = words.index(name)
        if words[at + 1] != "constant":
            raise Unknown(f"{name} {words[at + 1]} is not taken; write [particles.distribution] in the scene")
        setattr(made, name, numbers(words[at + 2 :], 1)[0] * unit)
    deck.templates[words[1]] = made
    return TAKEN, "radius and density of [particles], or of a species"


def distribution(deck: Deck, words: list[str]) -> Answer:
    """`fix ID all particledistribution/discrete SEED N t1 w1 ...`: parts by mass, or by number if it says so."""
    count = int(words[5])
    pairs = words[6 : 6 + 2 * count]
    by_mass = not words[3].endswith("numberbased")
    deck.distributions[words[1]] = [
        (name, numbers([part], 1)[0], by_mass) for name, part in zip(pairs[::2], pairs[1::2], strict=True)
    ]
    missing = [name for name in pairs[::2] if name not in deck.templates]
    if missing:
        raise Unknown(f"the template {missing[0]} was not taken")
    return TAKEN, "shares by number, from those by mass" if by_mass and count > 1 else "species"


def insert(deck: Deck, words: list[str]) -> Answer:
    """`fix ID group insert/pack ...` and `insert/rate/region ...`."""
    rate = words[3] == "insert/rate/region"
    name = words[words.index("distributiontemplate") + 1]
    if name not in deck.distributions:
        raise Unknown(f"the distribution {name} was not taken")
    where = deck.regions.get(words[words.index("region") + 1])
    if where is None:
        raise Unknown("its region was not taken")
    made = Insertion(words[1], name, where, begin=deck.steps * deck.time_step)

    def option(key: str, unit: float = 1.0) -> float | None:
        return numbers(words[words.index(key) + 1 :], 1)[0] * unit if key in words else None

    if "vel" in words and words[words.index("vel") + 1] == "constant":
        made.velocity = tuple(v * deck.length for v in numbers(words[words.index("vel") + 2 :], 3))
    if rate:
        made.rate, made.mass_rate = option("particlerate"), option("massrate", deck.mass)
        total = option("nparticles")
        made.count = None if total is None else int(total)
        if made.rate is None and made.mass_rate is None or where.shape != "block":
            raise Unknown("an inlet needs particlerate or massrate and a block region")
        deck.insertions.append(made)
        return TAKEN, "[[particles.inlet]]; particles come one by one, not in batches"
    if "insert_every" in words and words[words.index("insert_every") + 1] != "once":
        raise Unknown("a pack that is filled again and again has no counterpart; use insert/rate/region")
    count = option("particles_in_region")
    made.count, made.solid_fraction = None if count is None else int(count), option("volumefraction_region")
    if count is None and made.solid_fraction is None:
        raise Unknown("only particles_in_region and volumefraction_region are taken")
    deck.insertions.append(made)
    if any(made.velocity):
        return DIFFERS, '[[particles.pack]], kind = "random"; its velocity is left out, the particles start at rest'
    return TAKEN, '[[particles.pack]], kind = "random"'


HANDLERS: dict[str, Fix] = {
    "property/global": property_global, "gravity": gravity, "wall/gran": wall, "particletemplate/sphere": template,
    "particledistribution/discrete": distribution, "particledistribution/discrete/massbased": distribution,
    "particledistribution/discrete/numberbased": distribution, "insert/pack": insert, "insert/rate/region": insert,
}  # fmt: skip

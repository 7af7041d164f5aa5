"""`fix pour` of LAMMPS: particles that fall from a region, as many at once as it has room for.

A batch fills the region to the volume fraction of the option vol, 0.25 by default; the next one comes when the last one
has left it in free fall, after t with H = (-v) t + g t^2 / 2, H the height of the region and v the vertical velocity.
A scene brings the same number of particles a second, one after the other. Source: LAMMPS documentation, `fix pour`; the
size of a batch and its interval as in fix_pour.cpp, but for a thickness along y under 1, which it takes for 1.
"""

from __future__ import annotations

import math

from jaxdem.foreign.model import Deck, Insertion, Kind
from jaxdem.foreign.notes import DIFFERS, Answer, Unknown
from jaxdem.foreign.region import Region
from jaxdem.foreign.words import integer, numbers, positive

OPTIONS = {"region": 1, "var": 1, "set": 2, "id": 1, "ignore": 0, "mol": 1, "rigid": 1, "shake": 1, "vol": 2, "rate": 1,
           "dens": 2, "molfrac": 1, "units": 1}  # fmt: skip
VOLUME_FRACTION = 0.25


def pour(deck: Deck, words: list[str]) -> Answer:
    """`fix ID group pour N TYPE SEED region ID diam ... dens lo hi vol f n vel ...`."""
    count, kind = integer(words[4]), integer(words[5])
    given = _options(words[7:], deck.dimension)
    if given.get("rate") and numbers(given["rate"], 1)[0]:
        raise Unknown("a region that moves (rate) has no counterpart; use a region at rest")
    for name in ("var", "mol", "rigid", "shake"):
        if name in given:
            raise Unknown(f"{name} is not carried out; write [[particles.inlet]] by hand")
    where, unit, different = deck.region(given["region"][0]), deck.unit, list[str]()
    where.space(deck.axes)
    low, high = (value * unit.density for value in positive(given.get("dens", ["1", "1"]), 2))
    if low != high:
        different.append("all have the mean density")
    kinds = _kinds(given.get("diam", ["one", "1"]), unit.length, 0.5 * (low + high), kind)
    velocity, spread = _velocity(given.get("vel"), deck)
    if spread:
        different.append("all have the mean velocity")
    fraction = numbers(given.get("vol", [str(VOLUME_FRACTION)]), 1)[0]
    rate = _rate(deck, kinds, where, fraction, velocity)
    made = Insertion(deck.line, kinds, where, deck.segment, count=count, rate=rate, velocity=velocity, begin=deck.time)
    deck.insertions.append(made)
    deck.fixes[words[1]] = made
    different.append(
        f"{rate:.4g} particles a second, as batches of the deck give in free fall, but one after the other"
    )
    return DIFFERS, "; ".join(["[[particles.inlet]]", *different])


def _options(words: list[str], dimension: int) -> dict[str, list[str]]:
    """The options by name, with their values."""
    found: dict[str, list[str]] = {}
    while words:
        name, count = words[0], OPTIONS.get(words[0])
        if name == "diam":
            many = integer(words[2]) if words[1] == "poly" else 0
            count = {"one": 2, "range": 3, "poly": 2 + 2 * many}.get(words[1], 2)
        elif name == "vel":
            count = 5 if dimension == 3 else 3
        elif count is None:
            raise Unknown(f"the option {name} is not known")
        found[name], words = words[1 : 1 + count], words[1 + count :]
    return found


def _kinds(words: list[str], unit: float, density: float, kind: int) -> list[Kind]:
    """`one D`, `range D1 D2` evenly by number, or `poly N D1 P1 ...` by number."""
    if words[0] == "one":
        return [Kind(1.0, density, kind, 0.5 * unit * positive(words[1:], 1)[0])]
    if words[0] != "poly":  # an old form has the two numbers alone
        low, high = (0.5 * unit * value for value in positive(words[-2:], 2))
        if low == high:
            return [Kind(1.0, density, kind, low)]
        table = {"kind": "table", "by": "number", "radii": [low, high], "cumulative": [0.0, 1.0]}
        return [Kind(1.0, density, kind, high, table, (high**4 - low**4) / (4.0 * (high - low)))]
    values = positive(words[2:], 2 * integer(words[1]))
    total = sum(values[1::2])
    pairs = zip(values[::2], values[1::2], strict=True)
    return [Kind(part / total, density, kind, 0.5 * unit * size) for size, part in pairs]


def _velocity(words: list[str] | None, deck: Deck) -> tuple[tuple[float, ...], bool]:
    """The mean velocity [m/s], and whether the deck has a spread round it."""
    if words is None:
        return (0.0, 0.0, 0.0), False
    values = [value * deck.unit.speed for value in numbers(words, 5 if deck.dimension == 3 else 3)]
    means = [0.5 * (a + b) for a, b in zip(values[:-1:2], values[1:-1:2], strict=True)]
    spread = any(a != b for a, b in zip(values[:-1:2], values[1:-1:2], strict=True))
    found = (*means, values[-1])
    return (found if deck.dimension == 3 else (*found, 0.0)), spread


def _rate(deck: Deck, kinds: list[Kind], where: Region, fraction: float, velocity: tuple[float, ...]) -> float:
    """Particles a second [1/s]."""
    axis = deck.dimension - 1
    gravity = -(deck.model.gravity or [0.0, 0.0, 0.0])[axis]
    if gravity <= 0.0:
        raise Unknown("there is no gravity downwards before it, by which the region would empty; add fix gravity")
    height = where.upper[axis] - where.lower[axis]
    down = -velocity[axis]
    time = (-down + math.sqrt(down**2 + 2.0 * gravity * height)) / gravity
    power = deck.dimension
    one = sum(kind.share * kind.radius**power for kind in kinds) * (4.0 / 3.0 * math.pi if power == 3 else math.pi)
    batch = int(fraction * where.space(deck.axes).volume / one)
    if batch < 1:
        raise Unknown("its region has no room for a particle at that volume fraction; enlarge it")
    return batch / time

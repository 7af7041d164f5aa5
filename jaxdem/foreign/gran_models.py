"""The contact models of LAMMPS as its scripts write them: of a pair of types, or of a wall.

Source: LAMMPS documentation, `pair_style gran` and `pair_style granular`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from jaxdem.foreign.notes import Unknown
from jaxdem.foreign.units import Units
from jaxdem.foreign.words import numbers

NORMAL = {"hooke": 2, "hertz": 2, "hertz/material": 3, "jkr": 4, "dmt": 4}
ADHESIVE = ("jkr", "dmt")
"""Normal laws that are hertz/material with adhesion."""

TANGENTIAL = ("mindlin", "mindlin/force", "mindlin_rescale", "mindlin_rescale/force", "linear_history")
BY_RESTITUTION = ("tsuji", "coeff_restitution")
"""Damping models whose constant is a coefficient of restitution."""

USUAL_POISSON = 0.3
"""Taken where the two stiffnesses of a deck belong to no Poisson's ratio between -1 and 0.5."""
KEYWORDS = ("tangential", "rolling", "twisting", "damping", "cutoff", "limit_damping", "heat")


class GranModel(NamedTuple):
    """The contact model of one pair of types, or of a wall.

    Attributes:
        normal: "hooke", "hertz" or "hertz/material".
        stiffness: k_n of the first two [N/m], [Pa]; E of the third [Pa].
        poisson: of the third [-].
        damping: "velocity", "mass_velocity", "viscoelastic", "tsuji" or "coeff_restitution".
        eta: its constant: [kg/s], [1/s], [1/(m s)], [-].
        tangential: k_t [N/m] of hooke, [Pa] of hertz; None where it follows from E and nu.
        friction, rolling: coefficients [-].
        different: what is not as in the deck.
        adhesion: "jkr" or "dmt"; None without.
        work: of adhesion, twice the surface energy in the deck [J/m2].
    """

    normal: str
    stiffness: float
    poisson: float
    damping: str
    eta: float
    tangential: float | None
    friction: float
    rolling: float
    different: tuple[str, ...]
    adhesion: str | None = None
    work: float = 0.0


def old_model(style: str, words: Sequence[str], unit: Units) -> GranModel:
    """The model of an old style: `hertz/history`, `hooke/history` or `hooke`.

    Raises:
        Unknown: the words are not six numbers, of which two may be NULL.
    """
    hooke = not style.startswith("hertz")
    stiffness, damping = (unit.stiffness, 1.0 / unit.time) if hooke else (unit.pressure, 1.0 / unit.time / unit.length)
    given = ["0" if word == "NULL" else word for word in words[:6]]
    normal, tangential, gamma, gamma_t, friction, flag = numbers(given, 6)
    tangential = 2.0 / 7.0 * normal if words[1] == "NULL" else tangential
    different = ["the tangential dashpot follows from the restitution"] if flag else []
    if style == "hooke":
        different.append("tangential springs keep their history here; gran/hooke has none")
    name = "mass_velocity" if hooke else "viscoelastic"
    return GranModel(
        "hooke" if hooke else "hertz", normal * stiffness, USUAL_POISSON, name, gamma * damping,
        tangential * stiffness, friction, 0.0, tuple(different),
    )  # fmt: skip


def granular_model(words: Sequence[str], unit: Units) -> GranModel:
    """The model of `pair_style granular`: a normal law, and what follows the keywords.

    Raises:
        Unknown: it has no counterpart.
    """
    normal = words[0]
    if normal not in NORMAL:
        raise Unknown(f"the normal law {normal} has no counterpart; use hooke, hertz, hertz/material, jkr or dmt")
    given = numbers(list(words[1:]), NORMAL[normal])
    parts: dict[str, list[str]] = {}
    for word in words[1 + NORMAL[normal] :]:
        if word in KEYWORDS:
            parts[word] = []
        elif parts:
            parts[list(parts)[-1]].append(word)
        else:
            raise Unknown(f"{word} is not expected after the normal law")
    damping = parts.get("damping", ["viscoelastic"])[0]
    scales = {"velocity": unit.mass / unit.time, "mass_velocity": 1.0 / unit.time,
              "viscoelastic": 1.0 / unit.time / unit.length}  # fmt: skip
    if damping not in (*scales, *BY_RESTITUTION):
        raise Unknown(f"the damping {damping} has no counterpart; use tsuji or coeff_restitution")
    different: list[str] = []
    stiffness = unit.stiffness if normal == "hooke" else unit.pressure
    tangential, friction = _tangential(parts.get("tangential", []), normal, stiffness, different)
    rolling = _rolling(parts.get("rolling", ["none"]), different)
    left = [
        name for name in ("twisting", "cutoff", "limit_damping", "heat") if parts.get(name, ["none"])[:1] != ["none"]
    ]
    different += [f"{', '.join(left)} left out"] if left else []
    material, adhesion, work = normal == "hertz/material", None, 0.0
    if normal in ADHESIVE:
        material, adhesion, work = True, normal, 2.0 * given[3] * unit.mass / unit.time**2
    poisson = given[2] if material else USUAL_POISSON
    eta = given[1] * scales.get(damping, 1.0)
    return GranModel(
        "hertz/material" if material else normal, given[0] * stiffness, poisson, damping, eta, tangential, friction,
        rolling, tuple(different), adhesion, work,
    )  # fmt: skip


def _tangential(words: list[str], normal: str, unit: float, different: list[str]) -> tuple[float | None, float]:
    """k_t in SI units, None where it follows from E and nu; and the coefficient of friction."""
    if not words or words[0] == "none":
        return None, 0.0
    if words[0] == "linear_nohistory":
        different.append("tangential springs keep their history here; it is off in the deck")
        return None, numbers(words[2:], 1)[0]
    if words[0] not in TANGENTIAL:
        raise Unknown(f"the tangential law {words[0]} has no counterpart; use mindlin or linear_history")
    if (words[0] == "linear_history") != (normal == "hooke"):
        fits = "linear_history" if normal == "hooke" else "mindlin"
        different.append(f"tangential {words[0]} becomes {fits}, which belongs to {normal}")
        return None, numbers(words[3:], 1)[0]
    different.append("the tangential dashpot follows from the restitution")
    stiffness = None if words[1] == "NULL" else numbers(words[1:], 1)[0] * unit
    return stiffness, numbers(words[3:], 1)[0]


def _rolling(words: list[str], different: list[str]) -> float:
    """Coefficient of rolling friction."""
    if words[0] == "none":
        return 0.0
    if words[0] != "sds":
        raise Unknown(f"rolling {words[0]} has no counterpart; use sds")
    different.append("rolling sds becomes contact.rolling_model = \"epsd\": its spring follows from the contact, "
                     "with contact.rolling_damping at its default")  # fmt: skip
    return numbers(words[3:], 1)[0]

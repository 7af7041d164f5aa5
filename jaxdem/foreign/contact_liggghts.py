"""Contact laws of LIGGGHTS: `pair_style gran model ...` with the constants of `fix property/global`.

Source: LIGGGHTS-PUBLIC documentation, `pair_style gran` and the pages of the models that it lists.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from jaxdem.foreign.model import Deck, Model
from jaxdem.foreign.notes import DIFFERS, TAKEN, Answer, Unknown
from jaxdem.foreign.region import plain

CONSTANTS = {
    "youngsModulus": "young_modulus", "poissonsRatio": "poisson_ratio", "coefficientRestitution": "restitution",
    "coefficientFriction": "friction", "coefficientRollingFriction": "rolling_friction",
    "cohesionEnergyDensity": "energy_density",
}  # fmt: skip
PAIRS = ("coefficientRestitution", "coefficientFriction", "coefficientRollingFriction", "cohesionEnergyDensity")
PROPERTIES = (*CONSTANTS, "characteristicVelocity")


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
    cohesion = given.get("cohesion", "off")
    if cohesion == "sjkr2":
        different.append("cohesion sjkr2 becomes sjkr, whose contact area is that of the intersection")
    elif cohesion not in ("off", "sjkr"):
        different.append(f"cohesion {cohesion} is left out")
    others = set(given) - {"model", "tangential", "rolling_friction", "cohesion"}
    if others:
        different.append(f"{', '.join(sorted(others))} left out")
    return (DIFFERS, "; ".join(["contact.law", *different])) if different else (TAKEN, "contact.law and its parts")


@dataclass
class LiggghtsContact:
    """A contact model: the words of the pair style.

    Attributes:
        words: by key.
        line: number of its note.
    """

    words: dict[str, str]
    line: int

    @property
    def coheres(self) -> bool:
        """Whether particles attract each other in a way that has a counterpart."""
        return self.words.get("cohesion", "off") in ("sjkr", "sjkr2")

    def lacking(self, deck: Deck, model: Model) -> list[str]:
        """See `ContactModel`."""
        hooke = self.words["model"] == "hooke"
        needed = ["youngsModulus", "poissonsRatio", "coefficientRestitution"]
        needed += ["characteristicVelocity"] if hooke else []
        needed += ["cohesionEnergyDensity"] if self.coheres else []
        found = [f"{name} (fix property/global)" for name in needed if name not in model.properties]
        for name, values in model.properties.items():
            count = deck.types**2 if name in PAIRS else deck.types
            if len(values) < count and name != "characteristicVelocity":
                found.append(f"{count} numbers of {name} (fix property/global) for {deck.types} types")
        if hooke and deck.largest() is None:
            found.append("a size for the stiffness of hooke (particletemplate/sphere)")
        return found

    def tables(self, deck: Deck, model: Model) -> dict[str, Any]:
        """See `ContactModel`."""
        properties = model.properties
        contact: dict[str, Any] = {"law": "hertz_mindlin"}
        given = {key: properties[name] for name, key in CONSTANTS.items() if name in properties}
        density = given.get("energy_density")
        if not self.coheres:
            given.pop("energy_density", None)
        contact |= {key: values[0] for key, values in given.items() if key != "energy_density"}
        if self.coheres and density is not None:
            contact["cohesion"] = {"kind": "sjkr", "energy_density": density[0]}
        rolling = self.words.get("rolling_friction", "off")
        if rolling == "off":
            contact["rolling_friction"] = 0.0
            given.pop("rolling_friction", None)
        elif rolling.startswith("epsd"):
            contact["rolling_model"] = "epsd"
        if "coefficientFriction" not in properties or self.words.get("tangential") == "off":
            contact["friction"] = 0.0
            given.pop("friction", None)
        if self.words["model"] == "hooke":
            stiffness = plain(hooke_stiffness(properties, deck.largest() or (0.0, 0.0)))
            contact |= {"law": "linear_spring_dashpot", "normal_stiffness": stiffness}
        if deck.types == 1:
            return {"contact": contact}
        materials = _materials(deck.types, given)
        return {"contact": contact, "materials": materials} | _pairs(deck.types, given)


def _materials(types: int, given: dict[str, list[float]]) -> list[dict[str, Any]]:
    materials: list[dict[str, Any]] = [{"name": f"type{k + 1}"} for k in range(types)]
    for name, key in CONSTANTS.items():
        if key in given:
            step = types + 1 if name in PAIRS else 1
            for k, material in enumerate(materials):
                material[key] = given[key][k * step]
    return materials


def _pairs(types: int, given: dict[str, list[float]]) -> dict[str, list[dict[str, Any]]]:
    pairs: list[dict[str, Any]] = []
    for a in range(types):
        for b in range(a + 1, types):
            found = {CONSTANTS[n]: given[CONSTANTS[n]][a * types + b] for n in PAIRS if CONSTANTS[n] in given}
            if found:
                pairs.append({"materials": [f"type{a + 1}", f"type{b + 1}"], **found})
    return {"material_pairs": pairs} if pairs else {}


def hooke_stiffness(properties: dict[str, list[float]], largest: tuple[float, float]) -> float:
    """Stiffness of LIGGGHTS' hooke of two equal particles: 16/15 sqrt(R) E (15 m v^2 / (16 sqrt(R) E))^0.2 with R, E
    and m those of the pair [N/m].

    Args:
        properties: of the deck.
        largest: radius [m] and density [kg/m3] of the particles.
    """
    size, density = largest
    modulus = properties["youngsModulus"][0] / (2.0 * (1.0 - properties["poissonsRatio"][0] ** 2))
    radius, mass = 0.5 * size, 0.5 * density * 4.0 / 3.0 * math.pi * size**3
    speed = properties["characteristicVelocity"][0]
    base = math.sqrt(radius) * modulus
    return 16.0 / 15.0 * base * (15.0 * mass * speed**2 / (16.0 * base)) ** 0.2

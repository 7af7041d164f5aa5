"""Contact laws of LAMMPS: `pair_style granular`, `gran/hertz/history`, `gran/hooke/history`, `gran/hooke`.

The old styles have forces per mass, stiffness and friction alone: F = (k d - m* g v) of hooke, and sqrt(R* d) times
that of hertz. Source: LAMMPS documentation, `pair_style gran` and `pair_style granular`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from jaxdem.foreign.gran_models import BY_RESTITUTION, USUAL_POISSON, GranModel, granular_model, old_model
from jaxdem.foreign.impact import hertz_duration, linear_duration, restitution
from jaxdem.foreign.model import Deck, Model
from jaxdem.foreign.notes import DIFFERS, TAKEN, Answer, Unknown
from jaxdem.foreign.region import plain
from jaxdem.foreign.words import integer

IMPACT = "of an impact after a fall through one diameter"


@dataclass
class LammpsContact:
    """The contact models of all pairs of types.

    Attributes:
        line: number of the note of the pair style.
        pairs: by two types, the smaller first.
        lines: number of the note of each.
    """

    line: int
    pairs: dict[tuple[int, int], GranModel] = field(default_factory=dict)
    lines: dict[tuple[int, int], int] = field(default_factory=dict)

    def lacking(self, deck: Deck, model: Model) -> list[str]:
        """See `ContactModel`."""
        found = [f"pair_coeff {k} {k}" for k in range(1, deck.types + 1) if (k, k) not in self.pairs]
        return found if deck.largest() is not None else [*found, "the size of the particles"]

    def tables(self, deck: Deck, model: Model) -> dict[str, Any]:
        """See `ContactModel`."""
        own = {}
        for k in range(1, deck.types + 1):
            own[k], remarks = constants(self.pairs[k, k], deck, model)
            for remark in remarks:
                deck.notes.differ(self.lines[k, k], remark)
        law = "linear_spring_dashpot" if self.pairs[1, 1].normal == "hooke" else "hertz_mindlin"
        contact: dict[str, Any] = {"law": law} | own[1]
        kinds = {model.adhesion for model in self.pairs.values()}
        works = {key: model.work for key, model in self.pairs.items()}
        if kinds != {None}:
            kind = next(kind for kind in ("jkr", "dmt") if kind in kinds)
            contact["cohesion"] = {"kind": kind, "work_of_adhesion": works[1, 1]}
            if len(kinds - {None}) > 1:
                deck.notes.differ(
                    self.line, "a scene has one kind of cohesion: jkr, with the work of dmt where that is"
                )
            own = {k: values | {"work_of_adhesion": works[k, k]} for k, values in own.items()}
        if any(values["rolling_friction"] for values in own.values()):
            contact["rolling_model"] = "epsd"
        self._walls(deck, contact)
        if deck.types == 1:
            return {"contact": contact}
        stiff = {key: contact[key] for key in ("normal_stiffness", "tangential_stiffness") if key in contact}
        if any({key: value[key] for key in stiff} != stiff for value in own.values()):
            deck.notes.differ(self.line, "the linear law has one stiffness, that of type 1")
        materials = [
            {"name": f"type{k}"} | {key: v for key, v in values.items() if key not in stiff}
            for k, values in own.items()
        ]
        pairs = []
        for (a, b), given in sorted(self.pairs.items()):
            if a != b and b <= deck.types:
                values, _ = constants(given, deck, model)
                some = {key: values[key] for key in ("restitution", "friction", "rolling_friction")}
                some |= {"work_of_adhesion": works[a, b]} if kinds != {None} else {}
                pairs.append({"materials": [f"type{a}", f"type{b}"], **some})
        return {"contact": contact, "materials": materials} | ({"material_pairs": pairs} if pairs else {})

    def _walls(self, deck: Deck, contact: dict[str, Any]) -> None:
        """The friction of walls, and a note on those that differ from the particles in more."""
        own = self.pairs[1, 1]
        frictions = {model.friction for _, model in deck.wall_models}
        if frictions - {own.friction} and deck.types == 1:
            contact["wall_friction"] = min(frictions - {own.friction})
        works = {model.work if model.adhesion else 0.0 for _, model in deck.wall_models}
        even = own.adhesion is not None and own.work > 0.0 and deck.types == 1 and len(works) == 1
        if even:
            contact["cohesion"]["wall_factor"] = plain(works.pop() / own.work)
        for line, model in deck.wall_models:
            names = [
                n
                for n in ("normal", "stiffness", "poisson", "eta", "rolling", *(() if even else ("adhesion", "work")))
                if getattr(model, n) != getattr(own, n)
            ]
            kept = contact.get("wall_friction", own.friction)
            names += ["friction"] if model.friction != kept else []
            if names:
                deck.notes.differ(line, f"in {', '.join(names)} the wall is as the particles here")
            if model.damping not in BY_RESTITUTION:
                deck.notes.differ(line, "at the wall the restitution is that of two particles")


def granular_style(deck: Deck, words: list[str]) -> Answer:
    """`pair_style granular`: its constants follow in `pair_coeff`."""
    deck.model.contact = LammpsContact(deck.line)
    return TAKEN, "contact.law"


def gran_style(deck: Deck, style: str, words: list[str]) -> Answer:
    """`pair_style gran/hertz/history Kn Kt gamma_n gamma_t xmu dampflag`."""
    model = old_model(style.removeprefix("gran/"), words, deck.unit)
    found = LammpsContact(deck.line)
    for a in range(1, deck.types + 1):
        for b in range(a, deck.types + 1):
            found.pairs[a, b], found.lines[a, b] = model, deck.line
    deck.model.contact = found
    return _answer("contact.law, young_modulus, poisson_ratio, restitution, friction", model)


def pair_coefficients(deck: Deck, words: list[str]) -> Answer:
    """`pair_coeff I J hertz/material E e nu tangential mindlin NULL x mu ... damping tsuji`."""
    contact = deck.model.contact
    if not isinstance(contact, LammpsContact) or len(words) <= 3:
        return TAKEN, "the pairs of pair_style"
    model = granular_model(words[3:], deck.unit)
    others = {known.normal == "hooke" for known in contact.pairs.values()}
    if others and others != {model.normal == "hooke"}:
        raise Unknown("a scene has one contact law for all pairs, and the line before has another")
    for a in _types(words[1], deck.types):
        for b in _types(words[2], deck.types):
            contact.pairs[min(a, b), max(a, b)] = model
            contact.lines[min(a, b), max(a, b)] = deck.line
    return _answer("[contact], or [[materials]] and [[material_pairs]]", model)


def _answer(target: str, model: GranModel) -> Answer:
    return (DIFFERS, "; ".join([target, *model.different])) if model.different else (TAKEN, target)


def _types(word: str, types: int) -> range:
    """Types that a word such as 2, *, 2*3 names."""
    first, star, last = word.partition("*")
    if not star:
        return range(integer(first), integer(first) + 1)
    return range(integer(first) if first else 1, (integer(last) if last else types) + 1)


def constants(model: GranModel, deck: Deck, now: Model) -> tuple[dict[str, Any], list[str]]:
    """Constants of a scene, and what has been computed for them.

    Args:
        model: of two equal particles, the largest of the deck.
        deck: with their sizes.
        now: with the gravity, from which the speed of an impact follows.
    """
    found: dict[str, Any] = {"friction": model.friction, "rolling_friction": model.rolling}
    remarks: list[str] = []
    radius, density = deck.largest() or (1.0, 1.0)
    mass = 0.5 * density * 4.0 / 3.0 * math.pi * radius**3
    if model.normal == "hooke":
        found |= {"normal_stiffness": plain(model.stiffness)}
        if model.tangential is not None:
            found["tangential_stiffness"] = plain(model.tangential)
        modulus = model.stiffness
    elif model.normal == "hertz":
        poisson = USUAL_POISSON
        if model.tangential:
            ratio = model.tangential / model.stiffness
            poisson = (3.0 - 2.0 * ratio) / (3.0 - ratio)
        if not -1.0 < poisson <= 0.5:
            remarks.append(f"k_t/k_n belongs to no Poisson's ratio, {USUAL_POISSON} is taken")
            poisson = USUAL_POISSON
        found |= {"young_modulus": plain(1.5 * model.stiffness * (1.0 - poisson**2)), "poisson_ratio": plain(poisson)}
        modulus = model.stiffness
    else:
        found |= {"young_modulus": model.stiffness, "poisson_ratio": model.poisson}
        modulus = 2.0 / 3.0 * model.stiffness / (1.0 - model.poisson**2)
    if model.damping in BY_RESTITUTION:
        found["restitution"] = model.eta
        return found, remarks
    gravity = math.hypot(*(now.gravity or [0.0])) or 9.81
    speed = math.sqrt(4.0 * gravity * radius)
    found["restitution"] = plain(round(_restitution(model, modulus, mass, 0.5 * radius, speed), 4))
    shown = f"restitution = {found['restitution']:g} {IMPACT}, {speed:.3g} m/s"
    remarks.append(f"{shown}; in the deck it depends on the speed and on the masses")
    return found, remarks


def _restitution(model: GranModel, modulus: float, mass: float, radius: float, speed: float) -> float:
    """Of two particles with effective mass [kg] and radius [m]; `modulus` is k of hooke, 4/3 E* of hertz."""
    linear = model.normal == "hooke"
    factor = modulus if linear else modulus * math.sqrt(radius)

    def elastic(overlap: float) -> float:
        return factor * overlap if linear else factor * overlap**1.5

    def damping(overlap: float) -> float:
        if model.damping == "velocity":
            return model.eta
        return model.eta * mass * (1.0 if model.damping == "mass_velocity" else math.sqrt(radius * overlap))

    duration = linear_duration(mass, factor) if linear else hertz_duration(mass, factor, speed)
    return restitution(mass, elastic, damping, speed, duration)

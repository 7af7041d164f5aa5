"""The runs of a deck as one scene: alike ones are one run, others are its stages."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from jaxdem.foreign.model import Deck, Segment
from jaxdem.foreign.notes import DIFFERS, TAKEN
from jaxdem.foreign.region import plain

CLOSE = 0.02
"""Part by which the time between two outputs may differ without a word on it."""

FEW_STEPS, LONGEST = 10, "0.01"
"""Least number of contact steps in a coupling interval, and the longest one that a dry scene has by itself [s]."""

FRAMES = 10
"""Of a run whose deck writes no particles."""


@dataclass
class Part:
    """A part of the run with one set of tables.

    Attributes:
        name: of the stage.
        tables: without `time`.
        end: [s].
        begin: [s].
        output: time between two outputs that the deck asks for; 0 without [s].
        start: of the stage: what is done to the particles when it begins.
        lines: numbers of the notes of its runs.
        step_line: number of the note on its time step.
    """

    name: str
    tables: dict[str, Any]
    begin: float
    end: float
    output: float
    start: dict[str, Any] = field(default_factory=dict)
    lines: list[int] = field(default_factory=list)
    step_line: int = 0


def part_of(segment: Segment, tables: dict[str, Any], start: dict[str, Any]) -> Part:
    """A run as a part."""
    output = segment.model.output_steps * segment.model.time_step
    line = segment.model.time_step_line
    return Part(segment.name, tables, segment.begin, segment.end, output, start, [segment.line], line)


def joined(parts: list[Part]) -> list[Part]:
    """The parts with alike ones that follow each other as one; names are given to those that have none."""
    found: list[Part] = []
    for part in parts:
        last = found[-1] if found else None
        if last is not None and not part.start and last.tables == part.tables:
            last.end, last.output = part.end, part.output or last.output
            last.lines += part.lines
        else:
            found.append(part)
    names: list[str] = []
    for number, part in enumerate(found, start=1):
        name = part.name or f"run_{number}"
        names.append(name if name not in names else f"{name}_{number}")
        part.name = names[-1]
    return found


def staged(deck: Deck, parts: list[Part]) -> dict[str, Any]:
    """The tables of a scene of these parts; every run has a note on what it has become."""
    times = [_time(deck, part) for part in parts]
    interval = _interval(deck, parts, times)
    if interval is not None:
        for part in parts:
            part.tables = {**part.tables, "coupling": {"interval": interval}}
    for number, part in enumerate(parts):
        for line in part.lines:
            target = "time.end" if len(parts) == 1 else f"stages.{number}, {part.name}: time.end"
            reason = f"{target} = {plain(part.end):g} s"
            if line != part.lines[-1]:
                reason = f"{target}, with the run after it: nothing changes between them"
            if line >= 0:
                deck.notes.amend(line, TAKEN, reason)
    base = {**parts[0].tables, "time": times[0]}
    if len(parts) == 1:
        return base
    stages: list[dict[str, Any]] = [{"name": parts[0].name, "time": {"end": times[0]["end"]}}]
    for number in range(1, len(parts)):
        before = {**parts[number - 1].tables, "time": times[number - 1]}
        change = difference(before, {**parts[number].tables, "time": times[number]})
        start = {"start": parts[number].start} if parts[number].start else {}
        stages.append({"name": parts[number].name, **change, **start})
    return {**base, "stages": stages}


def difference(before: dict[str, Any], after: dict[str, Any]) -> dict[str, Any]:
    """The tables that, laid over the first, give the second."""
    found: dict[str, Any] = {}
    for key, value in after.items():
        known = before.get(key)
        if isinstance(value, dict) and isinstance(known, dict):
            inner = difference(known, value)
            found |= {key: inner} if inner else {}
        elif value != known:
            found[key] = value
    for key, value in before.items():
        if key not in after:
            found[key] = [] if isinstance(value, list) else False
    return found


def _interval(deck: Deck, parts: list[Part], times: list[dict[str, Any]]) -> float | None:
    """A coupling interval that divides the times at which walls appear and vanish, and the outputs; None where no wall
    does, where a fluid has its own, or where there is no such interval of some contact steps [s]."""
    walls = [wall for part in parts for wall in part.tables.get("walls", [])]
    changes = {wall[key] for wall in walls for key in ("begin", "end") if key in wall}
    if not changes or any("fluid" in part.tables for part in parts):
        return None
    exact = [Fraction(repr(value)) for value in (*changes, *(time["output_interval"] for time in times))]
    common = exact[0]
    for one in exact[1:]:
        scale = math.lcm(common.denominator, one.denominator)
        common = Fraction(math.gcd(int(common * scale), int(one * scale)), scale)
    if common < FEW_STEPS * deck.model.time_step:
        reason = "walls appear and vanish with the coupling interval that is nearest to their times"
        deck.notes.say("coupling.interval", DIFFERS, reason)
        return None
    interval = plain(float(common / math.ceil(common / Fraction(LONGEST))))
    deck.notes.say("coupling.interval", TAKEN, f"{interval:g} s, so that walls appear and vanish at their times")
    return interval


def _time(deck: Deck, part: Part) -> dict[str, Any]:
    """`[time]` of a part."""
    duration = part.end - part.begin
    outputs = max(1, round(duration / part.output)) if part.output else FRAMES
    if not part.output:
        if not any(note.text == "output" for note in deck.notes):
            deck.notes.say("output", DIFFERS, f"the deck writes no particles: {FRAMES} frames of each run")
    elif abs(duration / part.output - outputs) > 1e-6:
        close = abs(duration / part.output / outputs - 1.0) < CLOSE
        reason = f"time.output_interval is {duration / outputs:.6g} s, so that it divides the run of {duration:g} s"
        deck.notes.say("output", TAKEN if close else DIFFERS, reason)
    return {"end": plain(part.end), "output_interval": plain(duration / outputs)}

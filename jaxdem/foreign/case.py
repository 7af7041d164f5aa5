"""The fluid of a CFDEM case: mesh, sides, properties, coupling and time from its OpenFOAM dictionaries."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jaxdem.foreign.coupling_models import coupling_of
from jaxdem.foreign.foam import Sheet, read_foam
from jaxdem.foreign.mesh import read_mesh
from jaxdem.foreign.model import Deck
from jaxdem.foreign.notes import DIFFERS, LEFT, NOTHING, TAKEN, Note, Notes, unreadable
from jaxdem.foreign.region import plain
from jaxdem.foreign.sides import Fields, sides_of

OF_CONTROL = (
    "application", "purgeWrite", "writeFormat", "writePrecision", "writeCompression", "timeFormat", "timePrecision",
    "runTimeModifiable", "functions", "libs", "graphFormat", "OptimisationSwitches", "DebugSwitches",
)  # fmt: skip
SMAGORINSKY = 0.168
"""Coefficient of OpenFOAM's Smagorinsky model with its defaults: sqrt(C_k sqrt(C_k/C_e)), C_k = 0.094, C_e = 1.048."""

OF_PARTICLES = ("voidfraction", "Us", "Ksl", "uParticle", "alpha.particles")
"""Fields that follow from the particles."""


@dataclass
class FluidCase:
    """What a case adds to its script.

    Attributes:
        tables: `fluid`, `boundary`, `coupling`.
        duration: of the coupled run [s].
        output: time between two outputs; 0 where the case does not say [s].
        line: number of the note on its end.
    """

    tables: dict[str, Any]
    duration: float
    output: float
    line: int


def coupling_file(case: Path) -> Path | None:
    """`constant/couplingProperties` of a case or of its folder CFD."""
    places = (folder / "constant" / "couplingProperties" for folder in (case, case / "CFD"))
    return next((place for place in places if place.is_file()), None)


def script_of(properties: Path) -> Path:
    """The LIGGGHTS script that a case names.

    Raises:
        InputError: it names none.
    """
    found = read_foam(properties)
    for name in (
        "twoWayMPIProps",
        "twoWayMPI",
        "twoWayM2MProps",
        "M2MProps",
        "twoWayMany2ManyProps",
        "twoWayFilesProps",
    ):
        named = found.matching(name)
        if isinstance(named, dict) and "liggghtsPath" in named:
            return Path(properties.parents[1] / named["liggghtsPath"]).resolve()
    raise unreadable(str(properties), "names no script (liggghtsPath)", "add it to twoWayMPIProps")


def read_case(root: Path, deck: Deck) -> FluidCase:
    """The fluid of the case in a folder. The box of the deck becomes that of the mesh, and every entry has a note.

    Raises:
        InputError: the mesh is no box of equal cells, or density or viscosity are missing.
    """
    try:
        return _case(root, deck)
    except (KeyError, ValueError, TypeError, IndexError, AttributeError) as error:
        limit = f"has not the form that is expected ({type(error).__name__}: {error})"
        raise unreadable(str(root), limit, "correct the dictionaries") from None


def _case(root: Path, deck: Deck) -> FluidCase:
    notes = deck.notes
    mesh = read_mesh(root, notes)
    deck.lower, deck.upper, deck.dimension = list(mesh.lower), list(mesh.upper), 3
    control = Sheet(root / "system" / "controlDict", notes)
    step, start = float(control.entries["deltaT"]), float(control.get("startTime", 0.0))
    fluid: dict[str, Any] = {"cells": mesh.cells, "time_step": step} | _properties(root, notes)
    _runs_before(deck)
    found = _times(control, deck, step, start)
    zero = _first_fields(root, start, notes)
    velocity, pressure = Sheet(zero / "U", notes), Sheet(zero / "p", notes)
    boundary = sides_of(Fields(mesh, velocity, pressure, lambda time: time - start + deck.time))
    _internal(velocity, fluid)
    for sheet in (velocity, pressure):
        sheet.say("boundaryField", TAKEN, "[boundary], a note on each patch")
        sheet.finish(("dimensions", "internalField"))
    largest = deck.largest()
    properties = Sheet(root / "constant" / "couplingProperties", notes)
    diameter = None if largest is None else 2.0 * largest[0]
    coupling = coupling_of(properties, fluid, deck.model.time_step, diameter)
    _others(root, zero, notes)
    found.tables = {"fluid": fluid, "boundary": boundary, "coupling": coupling}
    return found


def _runs_before(deck: Deck) -> None:
    """Runs of the script itself: they are done before the fluid is there. One of a single step only sets things up."""
    if deck.segments and deck.steps <= 1:
        for segment in deck.segments:
            reason = "sets up the script; controlDict says how long the coupled run is"
            deck.notes.amend(segment.line, NOTHING, reason)
        deck.segments, deck.time, deck.steps = [], 0.0, 0
        for one in deck.insertions:
            one.segment, one.begin = 0, 0.0
        for wall in deck.walls:
            wall.begin = 0.0


def _times(control: Sheet, deck: Deck, step: float, start: float) -> FluidCase:
    """When the coupled run ends, and when it writes."""
    end = float(control.entries["endTime"])
    after = f", after the {deck.time:g} s that the script runs by itself" if deck.time else ""
    if control.get("stopAt", "endTime") != "endTime":
        control.say("stopAt", LEFT, "the run ends at endTime")
    control.say("deltaT", TAKEN, "fluid.time_step")
    line = control.say("endTime", TAKEN, "")
    kind, every = str(control.get("writeControl", "timeStep")), float(control.get("writeInterval", 0.0))
    output = every * step if kind == "timeStep" else every
    if "clock" in kind.lower() or "cpu" in kind.lower():
        control.say("writeControl", DIFFERS, "outputs by computer time have no counterpart: ten frames")
        output = 0.0
    for key in ("writeControl", "writeInterval"):
        control.say(key, TAKEN, "time.output_interval") if output else None
    if control.get("startFrom", "startTime") == "startTime":
        control.say("startFrom", NOTHING, "the clock of a scene begins at 0")
    else:
        control.say("startFrom", DIFFERS, "the fields of startTime are taken, or those of the folder 0")
    control.say("startTime", TAKEN, "endTime and all tables count from it")
    if str(control.get("adjustTimeStep", "no")) in ("yes", "on", "true"):
        control.say("adjustTimeStep", DIFFERS, "fluid.time_step is fixed; a step that is too long is halved")
    control.finish((*OF_CONTROL, "stopAt", "adjustTimeStep", "maxCo", "maxDeltaT", "maxAlphaCo"))
    deck.notes.amend(line, TAKEN, f"time.end{after}")
    return FluidCase({}, end - start, min(output, end - start), line)


def _properties(root: Path, notes: Notes) -> dict[str, Any]:
    """Density, viscosity and subgrid model."""
    sheet = Sheet(root / "constant" / "transportProperties", notes)
    found: dict[str, Any] = {}
    if sheet.get("nu") is None:
        raise unreadable(str(root), "gives no viscosity (nu in transportProperties)", "add it")
    density = root / "0" / "rho"
    if density.is_file():
        field = Sheet(density, notes)
        found["density"] = _last(field.entries["internalField"])
        field.say("internalField", TAKEN, "fluid.density")
        field.finish(("dimensions", "boundaryField"))
    elif sheet.get("rho") is not None:
        found["density"] = _last(sheet.get("rho"))
        sheet.say("rho", TAKEN, "fluid.density")
    else:
        raise unreadable(str(root), "gives no density of the fluid (0/rho)", "add it")
    found["viscosity"] = _last(sheet.get("nu"))
    sheet.say("nu", TAKEN, "fluid.viscosity")
    if sheet.get("transportModel", "Newtonian") != "Newtonian":
        sheet.say("transportModel", LEFT, "the fluid is Newtonian")
    sheet.finish(("transportModel", "rho"))
    for name in ("turbulenceProperties", "momentumTransport", "RASProperties", "LESProperties"):
        path = root / "constant" / name
        if path.is_file():
            found |= _turbulence(Sheet(path, notes))
    return found


def _turbulence(sheet: Sheet) -> dict[str, Any]:
    kind, model = str(sheet.get("simulationType", "")), str(sheet.get("LESModel", sheet.get("model", "")))
    if isinstance(sheet.get("LES"), dict):
        model = str(sheet.get("LES").get("LESModel", sheet.get("LES").get("model", "")))
    if model == "Smagorinsky" and kind in ("", "LES", "LESModel"):
        sheet.say("LES" if "LES" in sheet.entries else "LESModel", TAKEN, f"fluid.smagorinsky = {SMAGORINSKY}")
        sheet.finish(("simulationType", "delta", "printCoeffs", "turbulence"))
        return {"smagorinsky": SMAGORINSKY}
    if kind in ("laminar", ""):
        sheet.finish(tuple(sheet.entries))
        return {}
    sheet.say("simulationType", LEFT, "there is no RAS model, and of LES Smagorinsky's alone; the fluid is laminar")
    sheet.finish(tuple(sheet.entries))
    return {}


def _first_fields(root: Path, start: float, notes: Notes) -> Path:
    """The folder of the fields at the start."""
    for place in sorted(root.iterdir()):
        try:
            if place.is_dir() and float(place.name) == start and (place / "U").is_file():
                return place
        except ValueError:
            continue
    notes.say("fields at the start", DIFFERS, f"there is no folder {start:g}: those of the folder 0 are taken")
    return root / "0"


def _internal(velocity: Sheet, fluid: dict[str, Any]) -> None:
    """The velocity at the start."""
    value = velocity.get("internalField")
    if isinstance(value, list) and value[:1] == ["uniform"]:
        vector = [float(c) for c in value[1]]
        if any(vector):
            fluid["velocity"] = vector
        velocity.say("internalField", TAKEN, "fluid.velocity")
    else:
        velocity.say("internalField", LEFT, "it is not uniform: the fluid begins at rest")


def _others(root: Path, zero: Path, notes: Notes) -> None:
    """A note on every other file of the case."""
    for path in sorted(zero.iterdir()):
        if path.is_file() and path.name not in ("U", "p", "rho"):
            known = path.name in OF_PARTICLES
            reason = "it follows from the particles" if known else "a field that the fluid of a scene has not"
            notes.append(Note(f"{zero.name}/{path.name}", "the whole file", NOTHING, reason))
    told = {"couplingProperties", "transportProperties", "turbulenceProperties", "momentumTransport", "RASProperties",
             "LESProperties", "polyMesh"}  # fmt: skip
    for path in sorted((root / "constant").iterdir()):
        if path.name == "g":
            reason = "domain.gravity is that of the script; it acts on the fluid too, as a part of the pressure"
            notes.append(Note("constant/g", "the whole file", NOTHING, reason))
        elif path.name == "liggghtsCommands":
            reason = "the coupled run calls the particles by itself; commands in it are not carried out"
            notes.append(Note("constant/liggghtsCommands", "the whole file", NOTHING, reason))
        elif path.is_file() and path.name not in told:
            notes.append(Note(f"constant/{path.name}", "the whole file", LEFT, "there is no counterpart"))
    for name in ("fvSchemes", "fvSolution", "decomposeParDict"):
        if (root / "system" / name).is_file():
            notes.append(Note(f"system/{name}", "the whole file", NOTHING, "numerical settings of OpenFOAM"))


def _last(value: Any) -> float:
    """The number of an entry, after a name and dimensions."""
    return plain(float(value[-1] if isinstance(value, list) else value))

"""The fluid of a CFDEM case: mesh, sides, properties and coupling from its OpenFOAM dictionaries."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from jaxdem.foreign.foam import read_foam
from jaxdem.foreign.model import SIDES
from jaxdem.foreign.notes import DIFFERS, LEFT, NOTHING, TAKEN, unreadable

Say = Callable[[str, str, str], None]

DRAGS = {
    "KochHillDrag": "koch_hill", "GidaspowDrag": "gidaspow", "BeetstraDrag": "beetstra", "DiFeliceDrag": "di_felice",
    "RongDrag": "rong", "SchillerNaumannDrag": "schiller_naumann",
}  # fmt: skip
INHERENT = ("gradPForce", "viscForce", "Archimedes", "ArchimedesIB")
"""Forces that the equations of jaxdem have by themselves."""

VOID_FRACTIONS = {"centre": "centre", "divided": "divided"}
OUTLETS = ("zeroGradient", "inletOutlet", "pressureInletOutletVelocity", "fluxCorrectedVelocity")


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
    for name in ("twoWayMPIProps", "twoWayM2MProps", "twoWayMany2ManyProps"):
        if isinstance(found.get(name), dict) and "liggghtsPath" in found[name]:
            return Path(properties.parents[1] / found[name]["liggghtsPath"]).resolve()
    raise unreadable(str(properties), "names no script (liggghtsPath)", "add it to twoWayMPIProps")


def fluid_tables(root: Path, time_step: float, say: Say) -> tuple[dict[str, Any], list[float], list[float]]:
    """`[fluid]`, `[boundary]`, `[coupling]` and `[time]` of the case in folder `root`, and the corners of its mesh [m].

    Raises:
        InputError: the mesh is no box of equal cells, or density or viscosity are missing.
    """
    lower, upper, cells, patches = _mesh(root)
    say("blockMeshDict", TAKEN, "domain.size and fluid.cells")
    control = read_foam(root / "system" / "controlDict")
    fluid: dict[str, Any] = {"cells": cells, "density": _density(root), "viscosity": _viscosity(root)}
    fluid["time_step"] = float(control["deltaT"])
    say("transportProperties, 0/rho, controlDict", TAKEN, "fluid.viscosity, fluid.density, fluid.time_step, [time]")
    boundary = _sides(root, patches, say)
    coupling = _coupling(read_foam(root / "constant" / "couplingProperties"), fluid, time_step, say)
    end, every = float(control["endTime"]), float(control.get("writeInterval", control["endTime"]))
    if control.get("writeControl") == "timeStep":
        every *= fluid["time_step"]
    outputs = max(1, round(end / every))
    time = {"end": end, "output_interval": float(f"{end / outputs:.12g}")}
    return {"fluid": fluid, "boundary": boundary, "coupling": coupling, "time": time}, lower, upper


def _mesh(root: Path) -> tuple[list[float], list[float], list[int], dict[str, tuple[str, str]]]:
    """Corners [m], cells, and type and side of each patch."""
    places = (root / "system" / "blockMeshDict", root / "constant" / "polyMesh" / "blockMeshDict")
    path = next((place for place in places if place.is_file()), places[0])
    found = read_foam(path)
    scale = float(found.get("scale", found.get("convertToMeters", 1.0)))
    vertices = [[scale * float(value) for value in vertex] for vertex in found["vertices"]]
    blocks = found["blocks"]
    lower, upper = ([pick(v[k] for v in vertices) for k in range(3)] for pick in (min, max))
    if blocks.count("hex") != 1 or found.get("edges") or len(vertices) != 8:
        limit = "the mesh is not one block with straight edges; the mesh of a scene is a box of equal cells"
        raise unreadable(str(path), limit, "write a box round the geometry, and its walls as [[walls]], by hand")
    cells = [int(value) for value in blocks[blocks.index("hex") + 2]]
    patches: dict[str, tuple[str, str]] = {}
    entries = iter(found.get("boundary", []))
    for name, patch in zip(entries, entries, strict=False):
        for face in patch["faces"]:
            corners = [vertices[int(number)] for number in face]
            for axis, end in itertools.product(range(3), (0, 1)):
                if all(corner[axis] == (lower, upper)[end][axis] for corner in corners):
                    patches[SIDES[axis][end]] = (name, patch.get("type", "patch"))
    return lower, upper, cells, patches


def _density(root: Path) -> float:
    for path, key in ((root / "0" / "rho", "internalField"), (root / "constant" / "transportProperties", "rho")):
        value = read_foam(path).get(key) if path.is_file() else None
        if value is not None:
            return float(value[-1] if isinstance(value, list) else value)
    raise unreadable(str(root), "gives no density of the fluid (0/rho)", "add it")


def _viscosity(root: Path) -> float:
    value = read_foam(root / "constant" / "transportProperties").get("nu")
    if value is None:
        raise unreadable(str(root), "gives no viscosity (nu in transportProperties)", "add it")
    return float(value[-1] if isinstance(value, list) else value)


def _sides(root: Path, patches: dict[str, tuple[str, str]], say: Say) -> dict[str, Any]:
    fields = [read_foam(root / "0" / name)["boundaryField"] for name in ("U", "p")]
    sides: dict[str, Any] = {}
    for side, (name, kind) in patches.items():
        velocity, pressure = (field.get(name, {}) for field in fields)
        given = velocity.get("type", kind)
        what = f"0/U, patch {name}: {given}"
        if kind in ("cyclic", "cyclicAMI"):
            if side in {lower for lower, _ in SIDES}:
                sides[side] = {"kind": "periodic"}
        elif given in ("slip", "symmetry", "symmetryPlane", "empty"):
            sides[side] = {"kind": "free_slip"}
        elif given == "noSlip":
            sides[side] = {"kind": "no_slip"}
        elif given in OUTLETS and pressure.get("type") == "fixedValue":
            sides[side] = {"kind": "outlet"}
        elif given in ("fixedValue", "uniformFixedValue") and (value := _velocity(velocity)) is not None:
            if kind == "wall" and _moves(value):
                say(what, LEFT, f"boundary.{side} is a no-slip wall; give kind = 'moving_wall' by hand")
                continue
            sides[side] = {"kind": "inlet", **value} if _moves(value) else {"kind": "no_slip"}
        else:
            say(what, LEFT, f"boundary.{side} is a no-slip wall; give its kind by hand")
            continue
        if given == "empty":
            say(what, DIFFERS, f"boundary.{side} is a free-slip side: the scene has three axes")
        else:
            say(what, TAKEN, f"boundary.{side}")
    return sides


def _velocity(entry: dict[str, Any]) -> dict[str, Any] | None:
    """Velocity of a side, or its table in time; None for any other form."""
    value = entry.get("uniformValue", entry.get("value"))
    if not isinstance(value, list) or len(value) < 2:
        return None
    if value[0] == "table":
        rows = [(float(time), [float(c) for c in vector]) for time, vector in value[1]]
        return {"times": [time for time, _ in rows], "velocities": [vector for _, vector in rows]}
    vector = value[1] if value[0] in ("uniform", "constant") else value
    return {"velocity": [float(c) for c in vector], "ramp_time": 0.0}


def _moves(value: dict[str, Any]) -> bool:
    return any(any(vector) for vector in value.get("velocities", [value.get("velocity", [])]))


def _coupling(found: dict[str, Any], fluid: dict[str, Any], time_step: float, say: Say) -> dict[str, Any]:
    model = str(found.get("modelType", "A"))
    fluid["model"] = "A" if model == "A" else "B"
    say(f"modelType {model}", TAKEN if model in "AB" else DIFFERS, f"fluid.model = {fluid['model']}")
    void = str(found.get("voidFractionModel", ""))
    coupling: dict[str, Any] = {"interval": float(f"{int(found.get('couplingInterval', 1)) * time_step:.12g}")}
    say("couplingInterval", TAKEN, "coupling.interval = couplingInterval times the time step of the script")
    if void in VOID_FRACTIONS:
        coupling["void_fraction"] = VOID_FRACTIONS[void]
        say(f"voidFractionModel {void}", TAKEN, "coupling.void_fraction")
    else:
        say(f"voidFractionModel {void}", DIFFERS, "coupling.void_fraction is 'kernel'")
    for name in found.get("forceModels", []):
        if name in DRAGS:
            coupling["drag"] = DRAGS[name]
            say(name, TAKEN, "coupling.drag")
        elif name == "virtualMassForce":
            coupling["virtual_mass"] = 0.5
            say(name, TAKEN, "coupling.virtual_mass")
        elif name == "MeiLift":
            coupling["lift"] = ["saffman_mei"]
            say(name, TAKEN, "coupling.lift")
        elif name in INHERENT:
            say(name, NOTHING, "the equations have it by themselves")
        else:
            say(name, LEFT, "there is no counterpart")
    if "drag" not in coupling:
        say("forceModels", DIFFERS, "no drag law is taken: coupling.drag is koch_hill")
    return coupling

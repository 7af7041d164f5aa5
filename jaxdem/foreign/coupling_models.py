"""`[coupling]` of a CFDEM case: the models of couplingProperties. Source: CFDEMcoupling-PUBLIC documentation."""

from __future__ import annotations

import math
from typing import Any

from jaxdem.foreign.foam import Sheet
from jaxdem.foreign.notes import DIFFERS, LEFT, NOTHING, TAKEN
from jaxdem.foreign.region import plain

DRAGS = {
    "KochHillDrag": "koch_hill", "GidaspowDrag": "gidaspow", "BeetstraDrag": "beetstra", "DiFeliceDrag": "di_felice",
    "RongDrag": "rong", "SchillerNaumannDrag": "schiller_naumann", "WenYuDrag": "wen_yu", "ErgunDrag": "ergun",
    "TangDrag": "tang", "StokesDrag": "stokes",
}  # fmt: skip
INHERENT = ("gradPForce", "viscForce", "Archimedes", "ArchimedesIB", "gradPForceSmooth")
"""Forces that the equations of jaxdem have by themselves."""

OUTPUTS = ("particleCellVolume", "fieldStore", "fieldTimeAverage", "volWeightedAverage", "totalMomentumExchange",
           "dSauter", "granKineticEnergy", "averageSlipVel", "fieldBound", "getParticlePosV")  # fmt: skip
VOID_FRACTIONS = {"centre": "centre", "divided": "divided"}
NO_EFFECT = (
    "locateModel", "meshMotionModel", "regionModel", "IOModel", "probeModel", "dataExchangeModel", "averagingModel",
    "clockModel", "momCoupleModels", "turbulenceModelType", "checkPeriodicCells", "depth", "verbose",
    "useDDTvoidfraction", "liggghtsCommandModels", "otherForceModels", "chemistryModels", "energyModels",
    "thermCondModel", "debugMode", "solveFlow", "imExSplitFactor", "treatVoidCellsAsExplicitForce",
    "allowCFDsubTimestep", "multisphere",
)  # fmt: skip


def coupling_of(sheet: Sheet, fluid: dict[str, Any], time_step: float, diameter: float | None) -> dict[str, Any]:
    """`[coupling]`; `fluid.model` is set.

    Args:
        sheet: couplingProperties.
        fluid: the table of the fluid.
        time_step: of the script [s].
        diameter: of the largest particles [m]; None where it is not known.
    """
    model = str(sheet.get("modelType", "A"))
    fluid["model"] = "A" if model == "A" else "B"
    sheet.say("modelType", TAKEN if model in "AB" else DIFFERS, f'fluid.model = "{fluid["model"]}"')
    coupling: dict[str, Any] = {"interval": plain(int(sheet.get("couplingInterval", 1)) * time_step)}
    sheet.say("couplingInterval", TAKEN, "coupling.interval = couplingInterval times the time step of the script")
    coupling |= _void_fraction(sheet, diameter)
    coupling |= _forces(sheet)
    parts = [key for key in sheet.entries if key.rstrip(")").endswith("Props")]
    for key in parts:
        used = "liggghtsPath" in sheet.get(key, {})
        reason = "names the script" if used else "numbers of a model: names of fields, limits and interpolation"
        scale = sheet.get(key, {}).get("scale") if isinstance(sheet.get(key), dict) else None
        if scale is not None and float(scale) != 1.0:
            sheet.say(
                key, LEFT, f"its scale {scale} (coarse graining) is left out; give particles.coarse_grain by hand"
            )
        else:
            sheet.say(key, TAKEN if used else NOTHING, reason)
    sheet.finish(NO_EFFECT)
    return coupling


def _void_fraction(sheet: Sheet, diameter: float | None) -> dict[str, Any]:
    """How the volume of particles is distributed.

    `constDiffSmoothing` solves one implicit step of diffusion over the length L, whose kernel has the variance 2 L^2
    along each axis; the triangular kernel of half-width w has w^2/6, so w = sqrt(12) L. From memory of its source.
    """
    name, smoothing = str(sheet.get("voidFractionModel", "")), str(sheet.get("smoothingModel", "off"))
    if smoothing == "constDiffSmoothing" and diameter:
        length = float((sheet.entries.matching("constDiffSmoothingProps") or {}).get("smoothingLength", 0.0))
        sheet.say("voidFractionModel", TAKEN, 'coupling.void_fraction = "diffusion", which divides and then smooths')
        if length > 0.0:
            sheet.say("smoothingModel", TAKEN, "coupling.kernel_width, sqrt(12) smoothingLength")
            width = {"diameters": plain(math.sqrt(12.0) * length / diameter), "cells": 0.0}
            return {"void_fraction": "diffusion", "kernel_width": width}
        sheet.say("smoothingModel", DIFFERS, "coupling.kernel_width has its default: there is no smoothingLength")
        return {"void_fraction": "diffusion"}
    if smoothing == "off":
        sheet.say("smoothingModel", NOTHING, "nothing is smoothed")
    else:
        sheet.say("smoothingModel", LEFT, 'there is no counterpart but coupling.void_fraction = "diffusion"')
    if name in VOID_FRACTIONS:
        sheet.say("voidFractionModel", TAKEN, "coupling.void_fraction")
        return {"void_fraction": VOID_FRACTIONS[name]}
    sheet.say("voidFractionModel", DIFFERS, 'there is no counterpart: coupling.void_fraction = "kernel"')
    return {}


def _forces(sheet: Sheet) -> dict[str, Any]:
    """Drag, lift and other forces; one note on each."""
    found: dict[str, Any] = {}
    names, line = sheet.get("forceModels", []), sheet.entries.lines.get("forceModels", 1)
    names = names if isinstance(names, list) else [names]
    for name in names:
        if name in DRAGS:
            answer = (TAKEN, f'coupling.drag = "{DRAGS[name]}"')
            if "drag" in found:
                answer = (LEFT, f"coupling.drag is {found['drag']} already")
            found.setdefault("drag", DRAGS[name])
        elif name == "noDrag":
            found["drag_factor"], answer = 0.0, (TAKEN, "coupling.drag_factor = 0")
        elif name == "virtualMassForce":
            found["virtual_mass"], answer = 0.5, (TAKEN, "coupling.virtual_mass = 0.5")
        elif name == "MeiLift":
            found["lift"], answer = ["saffman_mei"], (TAKEN, "coupling.lift")
        elif name == "viscousTorque":
            found["rotational_drag"], answer = True, (TAKEN, "coupling.rotational_drag")
        elif name in INHERENT:
            answer = (NOTHING, "the equations have it by themselves")
        elif name in OUTPUTS:
            answer = (NOTHING, "output")
        else:
            answer = (LEFT, "there is no counterpart")
        sheet.note(line, f"forceModels {name}", *answer)
    if "drag" not in found and "drag_factor" not in found:
        sheet.note(line, "forceModels", DIFFERS, "no drag law is taken: coupling.drag is koch_hill")
    if not any(name.startswith("Archimedes") for name in names) and names:
        sheet.note(line, "forceModels", DIFFERS, "there is no Archimedes, but in a scene particles are buoyant")
    sheet.say("forceModels", TAKEN, "[coupling], a note on each before this one")
    return found

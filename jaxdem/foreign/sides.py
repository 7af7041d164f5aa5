"""The sides of a case: what the patches of 0/U and 0/p become."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from jaxdem.errors import InputError
from jaxdem.files.reading import read_text
from jaxdem.foreign.foam import Sheet, read_foam
from jaxdem.foreign.mesh import Mesh, PatchFace
from jaxdem.foreign.model import SIDES
from jaxdem.foreign.notes import DIFFERS, LEFT, NOTHING, TAKEN, Answer, Unknown
from jaxdem.foreign.region import plain

OUTLETS = ("zeroGradient", "inletOutlet", "pressureInletOutletVelocity", "fluxCorrectedVelocity", "outletInlet")
SLIPPING = ("slip", "symmetry", "symmetryPlane", "empty")
STILL = ("noSlip", "movingWallVelocity")
FIXED = ("fixedValue", "uniformFixedValue", "interstitialInletVelocity", "surfaceNormalFixedValue",
         "flowRateInletVelocity", "timeVaryingUniformFixedValue")  # fmt: skip
SAME = 1e-6
"""Part of a side's area by which patches may not fill it."""

Table = dict[str, Any]


class Fields(NamedTuple):
    """What the sides are made of.

    Attributes:
        mesh: the box and its patches.
        velocity, pressure: 0/U and 0/p.
        clock: from times of the case to those of the scene [s].
    """

    mesh: Mesh
    velocity: Sheet
    pressure: Sheet
    clock: Callable[[float], float]


def sides_of(fields: Fields) -> dict[str, Table]:
    """`[boundary]`, with a note on every patch."""
    patches = fields.velocity.get("boundaryField", {})
    tables: dict[str, Table] = {}
    told: set[str] = set()
    for axis, names in enumerate(SIDES[3]):
        for side in names:
            faces = fields.mesh.sides.get(side, [])
            found = {face.name: _table(fields, face.name, side) for face in faces}
            answers = {name: answer for name, (_, answer) in found.items()}
            kinds = {name: table for name, (table, _) in found.items()}
            table, clash = _side(fields.mesh, axis, side, faces, kinds)
            if table and not (table == {"kind": "periodic"} and side == names[1]):
                tables[side] = table
            for name, (kind, reason) in answers.items():
                if name in told:
                    continue
                told.add(name)
                where = f"boundary.{side}: {reason}"
                fields.velocity.note(_line(patches, name), f"{name} {_type(patches, name)}",
                                     LEFT if clash else kind, clash or where)  # fmt: skip
    for name in patches:
        if not any(patches.matching(patch) is patches[name] for patch in told):
            fields.velocity.note(_line(patches, name), name, NOTHING, "no side of the mesh has this patch")
    pressures = fields.pressure.get("boundaryField", {})
    for name in pressures:
        reason = "the pressure follows from the kind of the side"
        fields.pressure.note(_line(pressures, name), f"{name} {_type(pressures, name)}", NOTHING, reason)
    return tables


def _line(patches: Any, name: str) -> int:
    return patches.lines.get(name, 1) if hasattr(patches, "lines") else 1


def _type(patches: Any, name: str) -> str:
    found = patches.matching(name) if hasattr(patches, "matching") else None
    return str(found.get("type", "")) if isinstance(found, dict) else ""


def _side(mesh: Mesh, axis: int, side: str, faces: list[PatchFace], kinds: dict[str, Table]) -> tuple[Table, str]:
    """The table of a side, and why it cannot have one; the table of a no-slip wall is empty."""
    if not faces:
        return ({"kind": "free_slip"} if mesh.default == "empty" else {}), ""
    area = mesh.area(side)
    different = {name: table for name, table in kinds.items() if table}
    covered = sum(face.area for face in faces if face.name in different)
    tables = list(different.values())
    if not tables:
        return {}, ""
    if covered >= area * (1.0 - SAME) and all(table == tables[0] for table in tables):
        return tables[0], ""
    if len(different) > 1:
        return {}, f"boundary.{side} has several patches that are no walls, and a scene one; it is a no-slip wall"
    mine = [face for face in faces if face.name in different]
    low = [min(column) for column in zip(*(face.lower for face in mine), strict=True)]
    high = [max(column) for column in zip(*(face.upper for face in mine), strict=True)]
    if abs(PatchFace("", tuple(low), tuple(high)).area / covered - 1.0) > SAME:
        return {}, f"the patch on boundary.{side} is no rectangle; the side is a no-slip wall"
    if tables[0]["kind"] not in ("inlet", "outlet", "moving_wall"):
        return {}, f"a part of boundary.{side} cannot be {tables[0]['kind']}; the side is a no-slip wall"
    origin = [value for k, value in enumerate(mesh.lower) if k != axis]
    corners = [[plain(a - b) for a, b in zip(row, origin, strict=True)] for row in (low, high)]
    return tables[0] | {"from": corners[0], "to": corners[1]}, ""


def _table(fields: Fields, name: str, side: str) -> tuple[Table, Answer]:
    """What a patch is; an empty table for a no-slip wall."""
    kind = fields.mesh.types.get(name, "patch")
    velocity, pressure = (
        sheet.get("boundaryField", {}).matching(name) or {} for sheet in (fields.velocity, fields.pressure)
    )
    given = str(velocity.get("type", kind))
    if kind.startswith("cyclic") or given.startswith("cyclic"):
        return {"kind": "periodic"}, (TAKEN, 'kind = "periodic"')
    if given in SLIPPING:
        if given == "empty":
            return {"kind": "free_slip"}, (DIFFERS, 'kind = "free_slip"; the scene has three axes')
        return {"kind": "free_slip"}, (TAKEN, 'kind = "free_slip"')
    if given in STILL:
        return {}, (TAKEN, 'kind = "no_slip"')
    if given in OUTLETS:
        if pressure.get("type") in ("fixedValue", "totalPressure", "prghPressure", "fixedMean"):
            return {"kind": "outlet"}, (TAKEN, 'kind = "outlet"')
        return {}, (LEFT, f"{given} without a fixed pressure is no outlet; the side is a no-slip wall")
    if given not in FIXED:
        return {}, (LEFT, f"{given} has no counterpart; the side is a no-slip wall, give its kind by hand")
    try:
        found = _velocity(fields, name, side, given, velocity)
    except Unknown as error:
        return {}, (LEFT, f"{error}; the side is a no-slip wall")
    except (KeyError, ValueError, TypeError, IndexError):
        return {}, (LEFT, f"{given} has not the form that is expected; the side is a no-slip wall")
    if not _moves(found):
        return {}, (TAKEN, 'kind = "no_slip"')
    axis = next(k for k, names in enumerate(SIDES[3]) if side in names)
    rows = found.get("velocities", [found.get("velocity")])
    across = any(isinstance(row, float) or row[axis] for row in rows)
    word = "inlet" if across else "moving_wall"
    return {"kind": word, **found}, (TAKEN, f'kind = "{word}", velocity')


def _velocity(fields: Fields, name: str, side: str, kind: str, entry: Table) -> Table:
    """Velocity of a side, or its table in time.

    Raises:
        Unknown: it is given in a way that has no counterpart.
    """
    if kind == "surfaceNormalFixedValue":
        return {"velocity": plain(-_number(entry["refValue"])), "ramp_time": 0.0}
    if kind == "flowRateInletVelocity":
        if "volumetricFlowRate" not in entry:
            raise Unknown("massFlowRate is not converted; give volumetricFlowRate")
        area = sum(face.area for face in fields.mesh.sides[side] if face.name == name)
        return {"velocity": plain(_number(entry["volumetricFlowRate"]) / area), "ramp_time": 0.0}
    if kind == "timeVaryingUniformFixedValue":
        return _over_time(fields, _rows_of_file(fields, str(entry.get("fileName", entry.get("file")))))
    value = entry.get("uniformValue", entry.get("inletVelocity", entry.get("value")))
    if isinstance(value, dict):
        value = [value.get("type"), value.get("values", value.get("value", value.get("file")))]
    if value == "tableFile":
        return _over_time(fields, _rows_of_file(fields, str(entry["uniformValueCoeffs"]["file"])))
    if not isinstance(value, list) or len(value) < 2:
        raise Unknown(f"the value of {kind} is not uniform")
    if value[0] == "table":
        return _over_time(fields, value[1])
    vector = value[1] if value[0] in ("uniform", "constant") else value
    if value[0] in ("nonuniform", "tableFile", "csvFile", "sine", "square", "coded", "polynomial"):
        raise Unknown(f"{value[0]} is not carried out; write times and velocities by hand")
    return {"velocity": [float(c) for c in vector], "ramp_time": 0.0}


def _over_time(fields: Fields, rows: list[Any]) -> Table:
    """A table of times and vectors."""
    pairs = [(plain(fields.clock(float(time))), [float(c) for c in vector]) for time, vector in rows]
    if any(time < 0.0 for time, _ in pairs):
        raise Unknown("its table begins before the run; cut it there")
    return {"times": [time for time, _ in pairs], "velocities": [vector for _, vector in pairs]}


def _rows_of_file(fields: Fields, name: str) -> list[Any]:
    """The rows of a table in a file of its own, ((t (x y z)) ...)."""
    root = fields.velocity.path.parents[1]
    place = Path(name.replace("$FOAM_CASE", str(root)).replace("<case>", str(root)).replace("<constant>", "constant"))
    try:
        text = read_text(place if place.is_absolute() else root / place)
    except (OSError, ValueError):
        raise Unknown(f"its file {place.name} cannot be read") from None
    aside = f"rows {text.strip().rstrip(';')};"
    return _parsed(aside, place.name)


def _parsed(text: str, name: str) -> list[Any]:
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_text(text, encoding="utf-8")
        try:
            found = read_foam(path)["rows"]
        except InputError:
            raise Unknown(f"its file {name} is no table of times and vectors") from None
    return list(found)


def _number(value: Any) -> float:
    """A number that may stand after `uniform` or `constant`."""
    return float(value[-1] if isinstance(value, list) else value)


def _moves(value: Table) -> bool:
    rows = value.get("velocities", [value.get("velocity", [])])
    return any(bool(row) if isinstance(row, float) else any(row) for row in rows)

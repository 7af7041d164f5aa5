"""Where a run has got to, as another begins from it: arrays of its checkpoint or of a frame, and what they mean."""

from __future__ import annotations

import dataclasses
import itertools
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from jaxdem.errors import InputError
from jaxdem.io.checkpoint import content_hash, read_checkpoint
from jaxdem.io.run_folder import CHECKPOINT
from jaxdem.scene import Scene
from jaxdem.scene.domain import SIDES
from jaxdem.scene.walls import Wall
from jaxdem.setup.arrivals import Queue
from jaxdem.setup.bodies import Bodies
from jaxdem.setup.bonds import STORED
from jaxdem.setup.meshes import WallMesh
from jaxdem.setup.start_frame import arrays_of_frame
from jaxdem.setup.start_slabs import on_one_device
from jaxdem.setup.time_steps import clock_of
from jaxdem.setup.walls import surfaces_of
from jaxdem.simulation import Simulation
from jaxdem.structure import Clock

ABOUT = ("domain", "boundary", "materials", "walls", "contact", "fluid", "surface", "coupling", "heat", "scalars")
"""Tables of its scene that a checkpoint knows."""

NOT_OF_PLACE = ("name", "material", "opening", "temperature", "heat_flux", "wear")
"""Keys of a wall that say nothing about where it is."""

MAY_CHANGE = (*NOT_OF_PLACE, "motion", "piston", "fluid", "begin", "end")
"""Keys of a wall that a scene may change of a wall of the run that it begins from, which is then the same wall: what is
kept at it goes on."""

OF_CONTENT = ("file", "points", "scale", "rotate", "translate", "spacing", "closed", "repair")
"""Keys of a mesh from which its triangles are made, which tell it apart, wherever the file lies."""


@dataclasses.dataclass(frozen=True, eq=False)
class StartPoint:
    """Where a run has got to.

    Attributes:
        source: its folder.
        arrays: of the checkpoint; of a frame without list, springs and face velocities.
        attributes: of the checkpoint.
        foreseen: whether the run has yet to run, so that the places of its particles are not known.
        merged: whether its particles are not those of the run but parcels of them.
    """

    source: str
    arrays: Mapping[str, np.ndarray]
    attributes: Mapping[str, Any]
    foreseen: bool = False
    merged: bool = False

    @property
    def time(self) -> Fraction:
        """Simulated time [s]."""
        return Fraction(str(self._about("time")))

    @property
    def step(self) -> int:
        """Number of coupling intervals since the very first run began."""
        return int(self.arrays["state.step"])

    def clock(self, interval: float) -> Clock | None:
        """The clock of a run that begins here; that of the run before goes on with the same coupling interval.

        Args:
            interval: coupling interval of the run that begins [s].
        """
        if interval == self.attributes.get("interval"):
            before = json.loads(str(self.attributes.get("clock", "null")))
            if before is not None:
                return Clock(*before)
        return clock_of(self.time, self.step, interval)

    @property
    def tables(self) -> dict[str, Any]:
        """Tables `ABOUT` of its scene."""
        found: dict[str, Any] = json.loads(str(self._about("tables")))
        return found

    @property
    def reach(self) -> list[float]:
        """Cutoff and skin of its neighbour list [m]; empty without particles."""
        found: list[float] = json.loads(str(self._about("reach")))
        return found

    @property
    def walls(self) -> list[str]:
        """What tells its walls apart, in the order in which contacts remember them."""
        return self._texts("walls")

    @property
    def pistons(self) -> list[str]:
        """What tells its pistons apart, in their order."""
        return self._texts("pistons")

    @property
    def meshes(self) -> list[str]:
        """What tells its walls that are meshes apart, in their order."""
        return self._texts("meshes")

    @property
    def sha256(self) -> str:
        """Of all that it holds."""
        return content_hash(self.arrays, self.attributes)

    @property
    def box(self) -> tuple[np.ndarray, tuple[bool, ...]]:
        """Side lengths of its box [m], and which axes are periodic."""
        tables = self.tables
        size, sides = np.asarray(tables["domain"]["size"]), tables.get("boundary", {})
        return size, tuple(sides[lower]["kind"] == "periodic" for lower in SIDES[len(size)][::2])

    @property
    def coarse_grain(self) -> float:
        """Radius of its particles over that of their grains; 1 where they are grains [-]."""
        return float(self.attributes.get("coarse_grain", 1.0))

    @property
    def has_particles(self) -> bool:
        """Whether there are any."""
        return "state.particles.position" in self.arrays

    @property
    def bodies(self) -> Bodies:
        """What its particles are, those that have left or have still to come included."""
        names = (name for name in Bodies._fields if f"rows/{name}" in self.arrays)
        return Bodies(**{name: self.arrays[f"rows/{name}"] for name in names})

    @property
    def queues(self) -> list[Queue]:
        """Its inlets."""
        inserted = self.arrays.get("state.particles.inserted")
        found: list[Queue] = []
        while f"inlet/{len(found)}/rows" in self.arrays and inserted is not None:
            k = len(found)
            rows, time = (self.arrays[f"inlet/{k}/{name}"] for name in ("rows", "time"))
            found.append(Queue(rows, time, int(inserted[k])))
        return found

    def _texts(self, name: str) -> list[str]:
        """The texts of walls without what `MAY_CHANGE`, which earlier versions counted too.

        Raises:
            InputError: such a version told meshes apart by the names of their files.
        """
        found = []
        for text in json.loads(str(self.attributes.get(name, "[]"))):
            if text.startswith("{"):
                own, end = json.JSONDecoder().raw_decode(text)
                if own.get("kind") == "mesh" and "content" not in own:
                    limit = "its checkpoint was written by an earlier version, which told meshes apart by their files"
                    raise InputError("start.from", self.source, limit, "run that scene again")
                kept = {key: value for key, value in own.items() if key not in MAY_CHANGE}
                text = json.dumps(kept, sort_keys=True) + text[end:]
            found.append(text)
        return found

    def _about(self, name: str) -> Any:
        if name not in self.attributes:
            limit = "its checkpoint was written by a version of jaxdem that could not be started from"
            raise InputError("start.from", self.source, limit, "run that scene again")
        return self.attributes[name]


def of_deposit(tables: Mapping[str, Any]) -> dict[str, Any]:
    """What the volume of particles in the cells depends on, beside the particles, of the tables of a scene."""
    domain, coupling = tables["domain"], tables.get("coupling", {})
    walls = [wall for wall in tables.get("walls", []) if wall.get("fluid", "none") != "none"]
    return {
        "box": [domain["size"], domain.get("depth"), tables.get("fluid", {}).get("cells")],
        "periodic": {name: side["kind"] == "periodic" for name, side in tables.get("boundary", {}).items()},
        "kernel": [
            coupling.get("void_fraction"),
            coupling.get("kernel_width"),
            coupling.get("kernel_diameter", "largest"),
        ],
        "walls": [{key: value for key, value in wall.items() if key not in NOT_OF_PLACE} for wall in walls],
    }


def wall_texts(scene: Scene, meshes: Sequence[WallMesh] = (), some: Callable[[Wall], bool] | None = None) -> list[str]:
    """What tells each wall of a scene from the others: its place, and of a mesh its triangles. A further one at the
    same place has a number behind it.

    Args:
        scene: the scene.
        meshes: its walls that are meshes; without them texts of meshes tell nothing.
        some: whether a wall is asked for; all by default.
    """
    content = {mesh.key: mesh.content for mesh in meshes}
    found: list[str] = []
    for number, wall in enumerate(scene.walls):
        left_out = {*MAY_CHANGE, *(OF_CONTENT if wall.kind == "mesh" else ())}
        own = wall.model_dump(mode="json", exclude_none=True, exclude=left_out)
        if wall.kind == "mesh":
            own["content"] = content.get(f"walls.{number}")
        text = json.dumps(own, sort_keys=True)
        found.append(next(name for name in _with_numbers(text) if name not in found))
    return [text for wall, text in zip(scene.walls, found, strict=True) if some is None or some(wall)]


def mesh_texts(scene: Scene, meshes: Sequence[WallMesh]) -> list[str]:
    """The texts of its walls that are meshes, in their order."""
    return wall_texts(scene, meshes, lambda wall: wall.kind == "mesh")


def piston_texts(scene: Scene, meshes: Sequence[WallMesh]) -> list[str]:
    """The texts of its walls that a force holds, in their order."""
    return wall_texts(scene, meshes, lambda wall: wall.piston is not None)


def _with_numbers(text: str) -> Iterator[str]:
    yield text
    yield from (f"{text} {number}" for number in itertools.count(2))


def walls_of(scene: Scene, simulation: Simulation) -> list[str]:
    """What tells the walls of a scene apart: the side, or the place of the wall, or the number of a function."""
    if simulation.contact is None:
        return []
    model = simulation.contact.model
    found = [scene.sides[2 * side.axis + (side.inward < 0)] for side in model.sides]
    for wall, text in zip(scene.walls, wall_texts(scene), strict=True):
        found += [f"{text} {part}" for part in range(len(surfaces_of(wall)))]
    functions = range(model.analytic_walls - len(found))
    return found + [f"function {k}" for k in functions]


def read_start(scene: Scene) -> StartPoint | None:
    """The state that a scene begins from, read from the run that it names; None without `[start]`.

    Raises:
        InputError: that run has no checkpoint, or no frame at the time.
    """
    start = scene.start
    if start is None:
        return None
    path = Path(start.from_) / CHECKPOINT
    if not path.is_file():
        limit = f"has no {CHECKPOINT}, which a run writes when it begins"
        raise InputError("start.from", start.from_, limit, "give the folder of a run that has been started")
    try:
        point = stored_start(path, start.from_)
    except InputError as error:
        raise InputError("start.from", start.from_, f"its {error.key}: {error.limit}", error.remedy) from error
    if start.time is None:
        return point
    if point.pistons:
        limit = "cannot begin from a frame of a run with walls that a force holds: frames do not hold their speed"
        raise InputError("start.time", start.time, limit, "remove this key: begin from the end of the run")
    if f"{STORED}.status" in point.arrays:
        limit = "cannot begin from a frame of a run with bonds: frames do not hold how the grains are turned"
        raise InputError("start.time", start.time, limit, "remove this key: begin from the end of the run")
    if any(name.startswith("state.particles.mesh_wear") for name in point.arrays):
        limit = "cannot begin from a frame of a run with walls that wear: frames do not hold what has been taken"
        raise InputError("start.time", start.time, limit, "remove this key: begin from the end of the run")
    return dataclasses.replace(point, **arrays_of_frame(Path(start.from_), start.time, point.arrays, point.attributes))


def stored_start(path: Path, source: str) -> StartPoint:
    """The state in the file of a checkpoint."""
    return StartPoint(source, *on_one_device(*read_checkpoint(path)))

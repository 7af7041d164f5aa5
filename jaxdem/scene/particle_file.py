"""The table `[particles.file]`: the particles at the start from a file with named columns."""

from __future__ import annotations

import hashlib
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from jaxdem.errors import InputError
from jaxdem.scene.base import MaterialName, Name, NonNegative, Section, Vector, wrong

if TYPE_CHECKING:
    import numpy as np

    from jaxdem.particle_files import Columns
    from jaxdem.scene.rows import Numbers

KEY = "particles.file"
PLANES = {"xz": ("x", "z", "y"), "xy": ("x", "y", "z")}
"""First axis, vertical axis and the axis across of a 2-D scene, by the value of the key `plane`."""

ALIKE = 1e-9
"""Places across the plane of a 2-D scene may differ by this part of the extent in it."""

TypeName = Annotated[str, Field(pattern=r"^-?[0-9]+$")]


class ParticleFile(Section):
    """Particles at the start from a file with named columns, sorted by id where there are ids. `file = "NAME"` stands
    for a table with this name alone.

    Attributes:
        name: text with a row of names (CSV or separated by blanks), .npz with arrays by name, a dump or data file of
            LAMMPS or LIGGGHTS, a VTK file (.vtk, .vtp, .vtu; needs the package `vtk`), or a run directory. Columns: x y
            z (in 2-D x z), radius or diameter, vx vy vz, wx wy wz (or omegax ...), density or mass, id, type, material.
            What the file has no column for is given by the other keys of `[particles]`. With `coarse_grain` radius,
            density and mass are those of the grains; a run of parcels is read so.
        frame: number of the time step of a dump or run, from 0, or from -1 backwards. Default: the last.
        time: time of the time step, in place of its number [s].
        units: units of the columns that state none: "si", "cgs" or "micro", as LAMMPS defines them. Default: those that
            the file states, otherwise SI.
        translate: is added to all positions. Needed for a file whose box does not begin at 0, because the box of a
            scene does [m].
        plane: plane of a 2-D scene in a file with three coordinates; all particles must have the same third one.
            Default: "xz".
        types: name of one of `[[materials]]` for each number of the column `type`: {1 = "glass", 2 = "steel"}.
        ignore: names of columns of the file that are not read. In text and .npz files an unknown column is an error.
    """

    name: Name
    frame: Annotated[int, Field(strict=True)] | None = None
    time: NonNegative | None = None
    units: Literal["si", "cgs", "micro"] | None = None
    translate: Vector | None = None
    plane: Literal["xz", "xy"] | None = None
    types: dict[TypeName, MaterialName] = {}
    ignore: tuple[Name, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _name_alone(cls, value: object) -> object:
        return {"name": value} if isinstance(value, str) else value

    @field_validator("plane")
    @classmethod
    def _of_two_axes(cls, plane: str | None, info: ValidationInfo) -> str | None:
        if plane is not None and (info.context or {}).get("dimension") == 3:
            raise wrong("", plane, "is for 2-D scenes only", "remove this key")
        return plane

    @model_validator(mode="after")
    def _one_step(self) -> ParticleFile:
        if self.frame is not None and self.time is not None:
            raise wrong("time", self.time, "the time step is already given by frame", "remove one of the two keys")
        return self

    @cached_property
    def columns(self) -> Columns:
        """What the file holds, in SI units, when it is first asked for: a run may go on in it meanwhile."""
        from jaxdem.particle_files import Source, read_columns

        return read_columns(Source(self.name, self.frame, self.time, self.units, self.ignore))

    def values(self, name: str, dimension: int) -> np.ndarray | None:
        """`position` or `velocity` (N, D), or `angular_velocity` (N, 1 or 3); None where the file has none.

        Raises:
            InputError: a component is missing, or one across the plane of a 2-D scene is not what it has to be.
        """
        import numpy as np

        columns = self.columns
        prefix = {"position": "", "velocity": "v", "angular_velocity": "w"}[name]
        given = {axis: columns.numbers[prefix + axis] for axis in "xyz" if prefix + axis in columns.numbers}
        if name == "angular_velocity" and dimension == 2:
            return self._spin(given)
        if not given:
            return None
        axes = self._axes(given, prefix) if dimension == 2 else ("x", "y", "z")
        missing = [axis for axis in axes if axis not in given]
        if missing:
            limit = f"has no column {prefix}{missing[0]}, which a scene with {dimension} axes needs"
            raise InputError(KEY, self.name, limit, "add the column, or correct domain.size")
        found = np.stack([given[axis] for axis in axes], axis=1)
        return found + self._shift(axes) if name == "position" else found

    def _axes(self, given: dict[str, np.ndarray], prefix: str) -> tuple[str, str]:
        """The two axes of a 2-D scene among those of the file; nothing may lie or move across them."""
        import numpy as np

        first, up, across = PLANES[self._plane]
        if across in given:
            values = given[across]
            reference = values[0] if not prefix else 0.0
            extent = max(float(np.ptp(given[axis])) for axis in (first, up) if axis in given) if given else 0.0
            if np.abs(values - reference).max() > ALIKE * max(extent, abs(float(reference))):
                row = int(np.argmax(np.abs(values - reference)))
                what = "be the same for all particles" if not prefix else "be 0"
                limit = f"in a 2-D scene {prefix}{across} must {what}, but particle {row} has {values[row]:.6g}"
                other = "xy" if across == "y" else "xz"
                remedy = f'make the scene 3-D, or set {KEY}.plane = "{other}" if that is the plane of the file'
                raise InputError(KEY, self.name, limit, remedy)
        return first, up

    def _spin(self, given: dict[str, np.ndarray]) -> np.ndarray | None:
        """(N, 1) from the first axis to the vertical one: w of a 2-D file, -wy in the x-z plane, wz in the x-y one."""
        import numpy as np

        columns = self.columns
        if "w" in columns.numbers:
            return columns.numbers["w"][:, None]
        if not given:
            return None
        across = PLANES[self._plane][2]
        for axis, values in given.items():
            if axis != across and values.any():
                row = int(np.argmax(values != 0.0))
                limit = f"in a 2-D scene w{axis} must be 0, but particle {row} has {values[row]:.6g}"
                raise InputError(KEY, self.name, limit, "make the scene 3-D")
        if across not in given:
            return None
        return (0.0 - given[across] if across == "y" else given[across])[:, None]

    @property
    def _plane(self) -> str:
        return self.plane or ("xz" if "z" in self.columns.numbers else "xy")

    def _shift(self, axes: tuple[str, ...]) -> np.ndarray:
        """What is added to the positions [m].

        Raises:
            InputError: none is given, and the box of the file does not begin at 0.
        """
        import numpy as np

        if self.translate is not None:
            return np.asarray(self.translate)
        lower = [self.columns.lower.get(axis, 0.0) for axis in axes]
        if any(lower):
            shown = ", ".join(f"{axis} = {value:g}" for axis, value in zip(axes, lower, strict=True))
            limit = f"the box of {self.name} begins at {shown} m, and that of a scene at 0"
            remedy = f"set {KEY}.translate = {[-value if value else 0.0 for value in lower]} to move it there, or zeros"
            raise InputError(f"{KEY}.translate", None, limit, remedy)
        return np.zeros(len(axes))

    def materials_of(self, known: tuple[str, ...]) -> tuple[str, ...] | None:
        """The name of the material of every particle; None where the file does not say, or the scene has no materials.

        Raises:
            InputError: a name or a number stands for no material of the scene.
        """
        import numpy as np

        columns = self.columns
        if columns.materials is not None:
            for row, name in enumerate(columns.materials):
                if name not in known:
                    limit = f"the material of particle {row} is {name!r}, the scene has {', '.join(known) or 'none'}"
                    remedy = f'add it to [[materials]], or ignore the column: {KEY}.ignore = ["material"]'
                    raise InputError(KEY, self.name, limit, remedy)
            return columns.materials
        if columns.types is None or not self.types:
            if columns.types is None and self.types:
                raise InputError(f"{KEY}.types", self.types, f"{self.name} has no column type", "remove this key")
            return None
        kinds, number = np.unique(columns.types, return_inverse=True)
        for kind in kinds:
            if str(kind) not in self.types:
                limit = f"has no material for type {kind} of {self.name}"
                raise InputError(f"{KEY}.types", self.types, limit, f'add {kind} = "NAME"')
        names = [self.types[str(kind)] for kind in kinds]
        return tuple(names[k] for k in number)

    def digest(self) -> str:
        """A fingerprint of what the file holds now."""
        columns, found = self.columns, hashlib.sha256()
        for name, values in sorted(columns.numbers.items()):
            found.update(f"{name} {len(values)}\n".encode() + values.tobytes())
        found.update(repr((None if columns.types is None else columns.types.tolist(), columns.materials)).encode())
        return found.hexdigest()


class StartOfFile(Section):
    """What `[particles]` gives of the particles at the start: the columns of its file, or its keys."""

    file: ParticleFile | None = None

    def own(self, name: Literal["radius", "density"]) -> float | tuple[float, ...] | str | np.ndarray | None:
        """Radii or densities."""
        found = None if self.file is None else self.file.columns.numbers.get(name)
        value: float | tuple[float, ...] | str | None = getattr(self, name)
        return value if found is None else found

    def own_materials(self, known: tuple[str, ...]) -> str | tuple[str, ...] | None:
        """Names of materials; `known` are those of the scene."""
        found = None if self.file is None else self.file.materials_of(known)
        value: str | tuple[str, ...] | None = getattr(self, "material")  # noqa: B009
        return value if found is None else found

    def rows(self, name: Literal["position", "velocity", "angular_velocity"], dimension: int) -> str | Numbers | None:
        """Positions, velocities or spins."""
        found = None if self.file is None else self.file.values(name, dimension)
        value: str | Numbers | None = getattr(self, name)
        return value if found is None else found

    def digest(self, dimension: int) -> str:
        """A fingerprint of the files from which the first state is read; empty where the keys hold all of it."""
        found = [] if self.file is None else [self.file.digest()]
        for name, width in (("position", dimension), ("velocity", dimension), ("angular_velocity", 2 * dimension - 3)):
            source = getattr(self, name)
            if isinstance(source, str):
                from jaxdem.scene.rows import given_rows

                rows = given_rows(f"particles.{name}", source, width, of_frame=True)
                found.append(f"{name} {rows.shape} {hashlib.sha256(rows.tobytes()).hexdigest()}")
        return "\n".join(found)

    def has_column(self, name: str) -> bool:
        """Whether the file gives a quantity."""
        return self.file is not None and name in self.file.columns.numbers

    @model_validator(mode="after")
    def _given_once(self) -> StartOfFile:
        """Nothing is given by the file and by a key too."""
        if self.file is None:
            return self
        columns = self.file.columns
        held: set[str] = {"radius", "density"} & set(columns.numbers)
        held |= {"velocity"} if {"vx", "vy", "vz"} & set(columns.numbers) else set()
        held |= {"angular_velocity"} if {"wx", "wy", "wz", "w"} & set(columns.numbers) else set()
        held |= {"material"} if columns.materials is not None or self.file.types else set()
        held |= {"species"} if held & {"radius", "density", "material"} else set()
        held |= {"distribution"} if "radius" in held else set()
        for name in sorted(held):
            if getattr(self, name):
                limit = f"is given by a column of {self.file.name} too"
                remedy = "remove this key, or name the column in particles.file.ignore"
                raise wrong(name, getattr(self, name), limit, remedy)
        return self

"""The tables `[[particles.shapes]]` of a scene: clumps of overlapping spheres."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from pydantic import AfterValidator, Field, ValidationInfo, model_validator

from jaxdem.errors import InputError
from jaxdem.files.reading import TABLE_BYTES, read_text
from jaxdem.files.text_table import fields_of, lines_of, number_of
from jaxdem.scene.base import Name, Positive, Rows, Section, Tables, named_once, wrong

if TYPE_CHECKING:
    from jaxdem.particles.union import Union

SPHERE = "sphere"
"""Name of the shape that every scene has."""

MOST = 20
"""Spheres of a shape: the time to integrate their union grows with the fourth power of their number."""


class Shape(Section):
    """A rigid body that is a clump of spheres, which may overlap. It has the volume of their union.

    The unit of length does not matter: a particle is the shape scaled to the volume of a sphere of its radius.

    Attributes:
        name: name that `particles.shape` and species refer to.
        centres: of the spheres, one row each with one number per axis; in 2-D (x, z), in the plane.
        radii: of the spheres, as many.
        file: name of a text file with a row x y z radius for every sphere, in 2-D x z radius, in place of `centres` and
            `radii`. A first row of names is passed over.
    """

    name: Name
    centres: Rows | None = None
    radii: tuple[Positive, ...] | None = None
    file: str | None = None

    @model_validator(mode="after")
    def _spheres(self, info: ValidationInfo) -> Shape:
        if (self.file is None) == (self.centres is None) or (self.centres is None) != (self.radii is None):
            limit = "a shape needs centres and radii, or a file"
            raise wrong("centres", self.centres, limit, "give centres and radii, or file alone")
        dimension = (info.context or {}).get("dimension")
        if self.centres is None or self.radii is None:
            return self
        if len(self.centres) != len(self.radii) or not self.radii:
            limit = f"there are {len(self.centres)} centres and {len(self.radii)} radii"
            raise wrong("radii", self.radii, limit, "give one radius for each centre")
        for row in self.centres:
            if len(row) != (dimension or len(self.centres[0])):
                limit = f"a centre needs {dimension or len(self.centres[0])} numbers"
                raise wrong("centres", row, limit, "give one number per axis")
        _check_number("radii", len(self.radii))
        return self

    def spheres(self, dimension: int) -> tuple[tuple[tuple[float, ...], ...], tuple[float, ...]]:
        """Centres, three numbers each, and radii.

        Raises:
            InputError: the file cannot be read, or holds something else.
        """
        centres, radii = self.centres, self.radii
        if self.file is not None:
            rows = _rows(f"particles.shapes.{self.name}.file", self.file, dimension)
            centres, radii = tuple(row[:-1] for row in rows), tuple(row[-1] for row in rows)
        if dimension == 2:
            centres = tuple((row[0], 0.0, row[1]) for row in centres or ())
        return centres or (), radii or ()

    def union(self, dimension: int) -> Union:
        """Volume, centre and inertia of the union of the spheres."""
        from jaxdem.particles.union import union_of  # with NumPy, which other scenes do without

        return union_of(*self.spheres(dimension))

    def outer_radius(self, dimension: int) -> float:
        """Of the sphere about the centre of mass that holds it, over that of the sphere of the same volume [-]."""
        from jaxdem.particles.union import outer_radius

        return outer_radius(*self.spheres(dimension))

    def digest(self, dimension: int) -> str:
        """A fingerprint of the file; empty without."""
        return "" if self.file is None else hashlib.sha256(repr(self.spheres(dimension)).encode()).hexdigest()


def _check_number(key: str, number: int) -> None:
    if number > MOST:
        limit = f"a shape has at most {MOST} spheres"
        raise wrong(key, f"{number} spheres", limit, "use fewer, larger spheres")


def _rows(key: str, name: str, dimension: int) -> list[tuple[float, ...]]:
    """Rows of a file."""
    names = "x y z radius" if dimension == 3 else "x z radius"
    try:
        lines = lines_of(read_text(Path(name), TABLE_BYTES), "#")
    except FileNotFoundError:
        raise InputError(key, name, "no such file", "give a name relative to the scene file") from None
    except (OSError, ValueError) as error:
        limit = f"cannot be read ({getattr(error, 'strerror', None) or error})"
        raise InputError(key, name, limit, f"give a text file with rows {names}") from None
    if lines and all(number_of(field) is None for field in fields_of(lines[0].text)):
        lines = lines[1:]
    found = []
    for number, text in lines:
        values = [number_of(field) for field in fields_of(text)]
        row = tuple(value for value in values if value is not None)
        if len(row) != len(values) or len(row) != dimension + 1 or not row[-1] > 0.0:
            limit = f"line {number} of {name} is {text[:80]!r}; a row needs {names}, and a radius above 0"
            raise InputError(key, name, limit, "correct the line")
        found.append(row)
    if not 0 < len(found) <= MOST:
        raise InputError(key, name, f"holds {len(found)} spheres; a shape has 1 to {MOST}", "correct the file")
    return found


Shapes = Annotated[
    Tables[Shape], AfterValidator(named_once(SPHERE, "is the name of a single sphere")), Field(max_length=100)
]

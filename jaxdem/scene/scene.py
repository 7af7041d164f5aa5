"""What is simulated: a validated, immutable description. SI units throughout."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import Field, ValidationInfo, field_validator

from jaxdem.errors import InputError
from jaxdem.scene.base import UNKNOWN_KEY, Section, Tables, nearest, shown_key, wrong
from jaxdem.scene.bonds import Bond, bonds_digest
from jaxdem.scene.boundary import BoundarySide
from jaxdem.scene.contact import Contact
from jaxdem.scene.coupling import Closure, Coupling
from jaxdem.scene.domain import SIDES, Box, Domain, Output, Time
from jaxdem.scene.fluid import Fluid
from jaxdem.scene.heat import Heat, Scalar
from jaxdem.scene.materials import MaterialPairs, Materials
from jaxdem.scene.particles import Particles
from jaxdem.scene.probes import Probe
from jaxdem.scene.start import Start
from jaxdem.scene.surface import Surface
from jaxdem.scene.walls import Wall


class Scene(Section):
    """A scene. Without `[fluid]` it has contact mechanics only; without `[particles]` it has a fluid only.

    Attributes:
        seed: seed of all random numbers: jitter, random packs, order of species, sizes by a distribution, positions at
            inlets.
        precision: floating-point precision of all arrays; float64 is meant for verification.
        domain: the box.
        particles: the particles.
        contact: contacts of particles with each other and with walls.
        materials: materials other than that of `[contact]`.
        material_pairs: constants of contacts between two different materials.
        bonds: bonds between particles, made when the scene begins.
        walls: walls other than the sides of the box.
        fluid: the fluid and its mesh.
        surface: a second fluid, with a sharp surface to that of `[fluid]`.
        boundary: the sides of the box by name: left, right, bottom, top; in 3-D also front and back. Default: no-slip
            walls.
        coupling: exchange of forces between particles and fluid.
        closure: a learned drag closure.
        heat: temperatures of fluid and particles.
        scalars: what else the fluid carries.
        start: a run from whose state the scene begins.
        time: duration and output.
        output: optional output.
        probes: what is measured while the scene runs, see the page on probes.
    """

    seed: Annotated[int, Field(ge=0, lt=2**32, strict=True)] = 0
    precision: Literal["float32", "float64"] = "float32"
    domain: Domain
    particles: Particles | None = None
    contact: Contact | None = None
    materials: Materials = ()
    material_pairs: MaterialPairs = ()
    bonds: Tables[Bond] = ()
    walls: Tables[Wall] = ()
    fluid: Fluid | None = None
    surface: Surface | None = None
    boundary: dict[str, BoundarySide] = {}
    coupling: Coupling | None = None
    closure: Closure = Closure()
    heat: Heat | None = None
    scalars: Tables[Scalar] = ()
    start: Start | None = None
    time: Time
    output: Output = Output()
    probes: Tables[Probe] = ()

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return len(self.domain.size)

    @property
    def box(self) -> Box:
        """Size and periodic axes."""
        return Box(self.domain.size, self.periodic)

    @property
    def sides(self) -> tuple[str, ...]:
        """Names of the sides, axis by axis."""
        return SIDES[self.dimension]

    @property
    def periodic(self) -> tuple[bool, ...]:
        """Whether each axis is periodic."""
        return tuple(self.boundary[lower].kind == "periodic" for lower in self.sides[::2])

    @property
    def comes_and_goes(self) -> bool:
        """Whether the number of particles changes while the scene runs."""
        if self.particles is None:
            return False
        if self.particles.inlet or (self.start is not None and self.start.absent):
            return True
        return any(side.particles == "remove" for side in self.boundary.values())

    @property
    def content(self) -> str:
        """A fingerprint of the files that the first state is read from and that are not in the parameters."""
        own = "" if self.particles is None else self.particles.digest(self.dimension)
        return "\n".join(text for text in (own, bonds_digest(self.bonds), self._regions_digest) if text)

    @property
    def _regions_digest(self) -> str:
        """A fingerprint of the files of regions; empty without."""
        inlets, packs = ((), ()) if self.particles is None else (self.particles.inlet, self.particles.packs)
        held = [one.region for one in packs] + [one.region for one in inlets] + [one.region for one in self.bonds]
        held += self.start.remove if self.start else ()
        held += self.surface.regions if self.surface else ()
        return " ".join(region.digest for region in held if region is not None and region.file is not None)

    @field_validator("boundary", mode="before")
    @classmethod
    def _known_sides(cls, sides: object, info: ValidationInfo) -> object:
        known = SIDES[(info.context or {}).get("dimension", 3)]
        for name in sides if isinstance(sides, dict) else ():
            if name not in known:
                raise wrong(shown_key(name), str(name), UNKNOWN_KEY, nearest(str(name), known))
        return sides

    def tables(self) -> dict[str, Any]:
        """The scene as tables of plain values, every default written out, as `load_scene` takes them."""
        tables = self.model_dump(by_alias=True, mode="json")
        if self.coupling is not None and self.fluid is None:
            tables["coupling"] = {"interval": self.coupling.interval}  # the one key that it takes
        return _without_none(tables)

    def defaults(self) -> dict[str, object]:
        """Defaults by dotted key, of the tables that the scene has."""
        found: dict[str, object] = {}
        tables = {name: getattr(self, name) for name in type(self).model_fields}
        tables |= {f"boundary.{name}": side for name, side in self.boundary.items()}
        for table, section in tables.items():
            if isinstance(section, Section):
                fields = {field.alias or name: field for name, field in type(section).model_fields.items()}
                given = {name: field.default for name, field in fields.items() if not field.is_required()}
                # As the file has them: an empty list of tables is a tuple here.
                found |= {f"{table}.{name}": [] if value == () else value for name, value in given.items()}
            elif section == ():
                found[table] = []
        return found

    def to_toml(self) -> str:
        """The scene as TOML, every default written out."""
        return tomli_w.dumps(self.tables())


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    if isinstance(value, list | tuple):
        return [_without_none(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError("scene", value, "must be finite", "correct the value")
    return value

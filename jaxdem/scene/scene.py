"""What is simulated: a validated, immutable description. SI units throughout."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import Field, ValidationInfo, field_validator

from jaxdem.errors import InputError
from jaxdem.scene.base import UNKNOWN_KEY, Section, Tables, nearest, wrong
from jaxdem.scene.bed_mixing import check_bed_mixing
from jaxdem.scene.bonds import Bond, bonds_digest, check_bonds
from jaxdem.scene.boundary import BoundarySide, completed_boundary
from jaxdem.scene.cohesion import check_strengths, check_together
from jaxdem.scene.contact import Contact
from jaxdem.scene.coupling import Closure, Coupling, check_on_mesh, coupling_without_fluid
from jaxdem.scene.domain import SIDES, Box, Domain, Output, Time, check_output
from jaxdem.scene.drive import check_drive, check_own_gravity
from jaxdem.scene.fluid import Fluid
from jaxdem.scene.fluid_walls import check_fluid_walls
from jaxdem.scene.heat import Heat, Scalar, check_heat, check_reference
from jaxdem.scene.lubrication import check_lubrication
from jaxdem.scene.materials import MaterialPairs, Materials
from jaxdem.scene.packs import check_settling
from jaxdem.scene.particles import Particles, largest_radius
from jaxdem.scene.population import check_exits, completed_inlets
from jaxdem.scene.probe_places import ProbePlace, completed_probes
from jaxdem.scene.probes import Probe
from jaxdem.scene.start import Start
from jaxdem.scene.surface import Surface, check_surface, check_surface_heat, of_one_fluid
from jaxdem.scene.walls import Wall, check_walls


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
                raise wrong(str(name), str(name), UNKNOWN_KEY, nearest(str(name), known))
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


def completed(scene: Scene) -> Scene:
    """The scene with every default that depends on other tables written in, and checked as a whole."""
    _check_tables(scene)
    boundary, box = completed_boundary(scene.boundary, scene.domain.size, scene.particles is not None)
    update: dict[str, object] = {"domain": _completed_domain(scene), "boundary": boundary}
    check_walls(scene.walls, box)
    if scene.particles is not None:
        inlets = completed_inlets(scene.particles, box, scene.time.end)
        update["particles"] = scene.particles.model_copy(update={"inlet": inlets})
        update["contact"] = scene.contact or Contact()
        update["coupling"] = scene.coupling if scene.fluid is not None else coupling_without_fluid(scene.coupling)
    if scene.fluid is not None:
        velocity = scene.fluid.velocity or (0.0,) * scene.dimension
        update["fluid"] = scene.fluid.model_copy(update={"velocity": velocity})
    if scene.fluid is not None and scene.particles is not None:
        update["coupling"] = coupling = scene.coupling or Coupling()
        check_on_mesh(coupling, scene.fluid.cells, scene.output.samples)
        if scene.fluid.viscosity == 0.0:
            remedy = "set fluid.viscosity to a value above 0"
            raise InputError("fluid.viscosity", 0.0, "drag needs a positive viscosity", remedy)
    found = scene.model_copy(update=update)
    for name, side in scene.boundary.items():
        if side.kind == "inlet" and scene.fluid is None:
            limit = "is an inlet of fluid, and the scene has no fluid"
            raise InputError(f"boundary.{name}.kind", "inlet", limit, 'add [fluid], or set kind = "no_slip"')
    check_output(found.output, found.particles is not None, bool(found.walls))
    _check_gaps(found)
    _check_bonds(found)
    if found.particles is not None:
        check_settling(found.particles.packs, found.domain, found.periodic)
    check_exits(found.boundary, found.particles is not None, found.fluid is not None)
    if found.fluid is not None:
        check_own_gravity(scene.domain.gravity, found.periodic)
        check_drive(found.fluid, found.domain, found.periodic)
        if found.fluid.bed_mixing is not None:
            check_bed_mixing(found.boundary)
    check_fluid_walls(found.walls, found.fluid, found.coupling if found.fluid is not None else None)
    has_fluid, several = found.fluid is not None, bool(found.materials)
    check_heat(found.heat, found.scalars, found.boundary, found.walls, found.particles, has_fluid, several)
    check_reference(found.heat, found.surface.expansion if found.surface else 0.0)
    has = found.particles is not None, found.fluid is not None
    _check_surface(found)
    time = found.time
    place = ProbePlace(found.box, time.end, time.output_interval, *has, found.walls, found.boundary, found.output.walls)
    found = found.model_copy(update={"probes": completed_probes(found.probes, place)})
    if found.coupling is not None and found.coupling.basset and found.comes_and_goes:
        limit = "its history is kept only for particles that are present from the start to the end"
        remedy = "set it to 0, or use a scene in which no particle enters or leaves"
        raise InputError("coupling.basset", found.coupling.basset, limit, remedy)
    return found


def _check_surface(scene: Scene) -> None:
    """Refuses a second fluid that does not fit the rest of the scene."""
    walls = [f"walls.{k}" for k, wall in enumerate(scene.walls) if wall.seen_by_fluid]
    others: dict[str, tuple[bool, object, str]] = {
        "scalars": (
            bool(scene.scalars),
            f"{len(scene.scalars)} tables",
            "what is dissolved in one fluid has no rule",
        ),
        f"{walls[0]}.fluid" if walls else "walls": (bool(walls), "...", "walls within the mesh of the fluid do not"),
    }
    if scene.particles is not None:
        others |= of_one_fluid(scene.coupling or Coupling(), scene.contact, scene.output.samples)
    goes_on = scene.start is not None and scene.start.fluid == "keep"
    check_surface(scene.surface, scene.fluid, scene.domain, scene.boundary, others, goes_on)
    check_surface_heat(scene.surface, scene.heat is not None)


def _check_gaps(scene: Scene) -> None:
    """Refuses a cohesion, or a lubrication, that does not fit the rest of the scene."""
    table = None if scene.contact is None else scene.contact.cohesion
    check_strengths(table, {"materials": scene.materials, "material_pairs": scene.material_pairs})
    if table is not None and scene.particles is not None:
        others = {
            "particles that enter or leave": scene.comes_and_goes,
            "walls that have begin or end": any(wall.begin or wall.end for wall in scene.walls),
            "[start]": scene.start is not None,
        }
        check_together(table, bool(scene.materials), scene.particles.coarse_grain, others)
    if scene.contact is not None and scene.contact.lubrication is not None and scene.particles is not None:
        liquid = {
            f"parcels (particles.coarse_grain = {scene.particles.coarse_grain:g}), for which it has no rule": (
                scene.particles.coarse_grain != 1.0
            ),
            "liquid bridges (contact.cohesion.kind = capillary): particles are within liquid, or hold some": (
                scene.contact.cohesion_kind == "capillary"
            ),
        }
        check_lubrication(scene.contact.lubrication, scene.fluid is not None, liquid)


def _check_bonds(scene: Scene) -> None:
    """Refuses what does not go together with bonds."""
    particles = scene.particles
    if particles is None or not scene.bonds:
        return
    settled = scene.start is None and any(pack.kind == "settled" for pack in particles.packs)
    before = "bonds are made before it has settled; settle it in a stage of its own, and bond in the next"
    parcels = "there is no rule for the strength of a parcel"
    others: dict[str, tuple[bool, object, str]] = {
        "particles.coarse_grain": (particles.coarse_grain != 1.0, particles.coarse_grain, parcels),
        "particles.pack.kind": (settled, "settled", before),
    }
    check_bonds(scene.bonds, others)


def _check_tables(scene: Scene) -> None:
    """Refuses tables that need another one."""
    if scene.particles is None:
        for name in ("walls", "materials", "material_pairs", "bonds"):
            if name == "walls" and all(wall.seen_by_fluid for wall in scene.walls):
                continue
            if getattr(scene, name):
                remedy = f"remove [[{name}]], or add [particles]"
                raise InputError(name, f"{len(getattr(scene, name))} tables", "need [particles]", remedy)
        for name in ("contact", "coupling"):
            if getattr(scene, name) is not None:
                raise InputError(name, "...", "needs [particles]", f"add [particles] or remove [{name}]")
        if scene.fluid is None:
            raise InputError(
                "particles", None, "a scene needs particles, a fluid or both", "add [particles] or [fluid]"
            )
    start = scene.start
    if start is not None and scene.particles is None and (start.remove or start.add or start.relax):
        name = next(name for name in ("remove", "add", "relax") if getattr(start, name))
        limit = "the run that the scene begins from has no particles"
        raise InputError(f"start.{name}", "...", limit, f"remove start.{name}; [particles] places the first ones")
    if start is not None and start.add is not None and scene.particles is not None:
        ratio = scene.particles.coarse_grain
        if start.add.coarse_grain != ratio:
            limit = f"all particles stand for as many grains, and particles.coarse_grain is {ratio:g}"
            raise InputError("start.add.coarse_grain", start.add.coarse_grain, limit, f"set it to {ratio:g}")
    if scene.particles is None or scene.fluid is None:
        for name in scene.closure.given():
            value = getattr(scene.closure, name)
            raise InputError(f"closure.{name}", value, "needs both [fluid] and [particles]", "remove [closure]")


def _completed_domain(scene: Scene) -> Domain:
    gravity, depth = scene.domain.gravity, scene.domain.depth
    if gravity is None:
        gravity = (0.0,) * (scene.dimension - 1) + (-9.81,)
    if scene.dimension == 2 and depth is None:
        depth = 2.0 * largest_radius(scene.particles) / scene.particles.coarse_grain if scene.particles else 1.0
    return scene.domain.model_copy(update={"gravity": gravity, "depth": depth})


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    if isinstance(value, list | tuple):
        return [_without_none(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError("scene", value, "must be finite", "correct the value")
    return value

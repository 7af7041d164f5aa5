"""What is simulated: a validated, immutable description. SI units throughout."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import Field

from jaxdem.errors import InputError
from jaxdem.scene.base import (
    Section,
    check_entries,
)
from jaxdem.scene.boundary import BoundarySide, check_inlets, completed_boundary
from jaxdem.scene.contact import Contact, completed_contact
from jaxdem.scene.coupling import (
    Closure,
    Coupling,
    check_coarse_inputs,
    check_self_disturbance,
    coupling_of_one,
)
from jaxdem.scene.domain import SIDES_2D, SIDES_3D, Domain, Output, Time, check_times
from jaxdem.scene.drive import check_drive
from jaxdem.scene.fluid import Fluid, check_subgrid
from jaxdem.scene.materials import Material, MaterialPair, check_materials, check_particle_materials
from jaxdem.scene.particles import Particles, check_particles, completed_pack, largest_radius
from jaxdem.scene.population import check_exits, check_history, completed_inlets
from jaxdem.scene.walls import Wall, completed_walls


class Scene(Section):
    """A scene. Without `[fluid]` it has contact mechanics only; without `[particles]` it has a fluid only.

    Attributes:
        seed: seed of all random numbers: jitter, random packs, order of species, positions at inlets.
        precision: floating-point precision of all arrays; float64 is meant for verification.
        domain: the box.
        particles: the particles.
        contact: contacts of particles with each other and with walls.
        materials: materials other than that of `[contact]`.
        material_pairs: constants of contacts between two different materials.
        walls: walls other than the sides of the box.
        fluid: the fluid and its mesh.
        boundary: the sides of the box by name: left, right, bottom, top; in 3-D also front and back. Default: no-slip walls.
        coupling: exchange of forces between particles and fluid.
        closure: a learned drag closure.
        time: duration and output.
        output: optional output.
    """

    seed: Annotated[int, Field(ge=0, lt=2**32, strict=True)] = 0
    precision: Literal["float32", "float64"] = "float32"
    domain: Domain
    particles: Particles | None = None
    contact: Contact | None = None
    materials: tuple[Material, ...] = ()
    material_pairs: tuple[MaterialPair, ...] = ()
    walls: tuple[Wall, ...] = ()
    fluid: Fluid | None = None
    boundary: dict[str, BoundarySide] = {}
    coupling: Coupling | None = None
    closure: Closure = Closure()
    time: Time
    output: Output = Output()

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return len(self.domain.size)

    @property
    def sides(self) -> tuple[str, ...]:
        """Names of the sides, axis by axis."""
        return SIDES_2D if self.dimension == 2 else SIDES_3D

    @property
    def periodic(self) -> tuple[bool, ...]:
        """Whether each axis is periodic."""
        return tuple(self.boundary[self.sides[2 * axis]].kind == "periodic" for axis in range(self.dimension))

    def tables(self) -> dict[str, Any]:
        """The scene as tables of plain values, every default written out, as `load_scene` takes them."""
        tables = self.model_dump(by_alias=True, mode="json")
        if self.coupling is not None and self.fluid is None:
            tables["coupling"] = {"interval": self.coupling.interval}  # the one key that it takes
        return _without_none(tables)

    def to_toml(self) -> str:
        """The scene as TOML, every default written out."""
        return tomli_w.dumps(self.tables())


def completed(scene: Scene) -> Scene:
    """The scene with every default that depends on other keys written in, and checked as a whole."""
    dimension = scene.dimension
    domain = scene.domain
    if domain.depth is not None and dimension == 3:
        raise InputError("domain.depth", domain.depth, "is for 2-D scenes only", "remove this key")
    gravity = domain.gravity if domain.gravity is not None else (0.0,) * (dimension - 1) + (-9.81,)
    check_entries("domain.gravity", gravity, dimension)
    depth = domain.depth
    if scene.particles is not None:
        check_particles(scene.particles)
    if dimension == 2 and depth is None:
        depth = 2.0 * largest_radius(scene.particles) if scene.particles else 1.0
    boundary = completed_boundary(scene)
    scene = scene.model_copy(update={"boundary": boundary})
    if scene.fluid is not None:
        check_drive("domain.gravity", gravity, scene.periodic)
    update: dict[str, Any] = {"domain": domain.model_copy(update={"gravity": gravity, "depth": depth})}
    if scene.particles is not None:
        contact = completed_contact(scene.contact or Contact())
        update["contact"] = contact
        check_materials(scene.materials, scene.material_pairs)
        names = tuple(material.name for material in scene.materials)
        check_particle_materials(scene.particles, scene.walls, contact, names)
        inlets = completed_inlets(
            scene.particles, scene.domain.size, scene.sides, scene.periodic, scene.time.end, names
        )
        update["particles"] = completed_pack(scene.particles).model_copy(update={"inlet": inlets})
        update["walls"] = completed_walls(scene.walls, dimension, scene.periodic)
    elif scene.walls:
        raise InputError("walls", f"{len(scene.walls)} walls", "need [particles]", "remove [[walls]]")
    elif scene.contact is not None:
        raise InputError("contact", "...", "needs [particles]", "add [particles] or remove [contact]")
    elif scene.materials or scene.material_pairs:
        name = "materials" if scene.materials else "material_pairs"
        raise InputError(name, "...", "need [particles]", f"remove [[{name}]], or add [particles]")
    if scene.fluid is not None:
        check_entries("fluid.cells", scene.fluid.cells, dimension)
        velocity = scene.fluid.velocity or (0.0,) * dimension
        check_entries("fluid.velocity", velocity, dimension)
        update["fluid"] = scene.fluid.model_copy(update={"velocity": velocity})
        check_subgrid(scene.fluid)
    if scene.fluid is not None and scene.particles is not None:
        update["coupling"] = scene.coupling or Coupling()
        check_self_disturbance(update["coupling"], dimension)
        check_coarse_inputs(update["coupling"], scene.fluid.cells, scene.output.samples)
        if scene.fluid.viscosity == 0.0:
            raise InputError(
                "fluid.viscosity",
                0.0,
                "drag needs a positive viscosity",
                "set fluid.viscosity to a value above 0",
            )
    else:
        update["coupling"] = coupling_of_one(scene)
    if scene.fluid is None and scene.particles is None:
        raise InputError("particles", None, "a scene needs particles, a fluid or both", "add [particles] or [fluid]")
    check_inlets(scene)
    check_times(scene.time)
    check_exits(scene)
    check_history(scene)
    return scene.model_copy(update=update)


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    if isinstance(value, list | tuple):
        return [_without_none(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError("scene", value, "must be finite", "correct the value")
    return value

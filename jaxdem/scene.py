"""What is simulated: a validated, immutable description, read from and written to TOML. SI units throughout.

Longer than other modules, so that the keys of the scene file, their defaults, the checks between them and the
words in which a mistake is answered stand in one place: one cannot be changed without the others in sight. What
stands in `scene_*.py` are tables that have more of their own.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tomli_w
from pydantic import BaseModel, Field, ValidationError, field_validator, model_validator

from jaxdem.bodies import column, largest_radius
from jaxdem.drive import check_drive
from jaxdem.errors import InputError
from jaxdem.files import parse_toml, read_text
from jaxdem.scene_base import (
    Finite,
    Fraction,
    NonNegative,
    Positive,
    Rows,
    Section,
    check_entries,
    refuse_unknown,
)
from jaxdem.scene_boundary import BoundarySide, check_inlets, completed_boundary
from jaxdem.scene_coupling import BassetWindow, check_coarse_inputs, check_self_disturbance
from jaxdem.scene_materials import (
    WALL,
    Material,
    MaterialPair,
    Species,
    check_materials,
    check_particle_materials,
)
from jaxdem.scene_population import ParticleInlet, check_exits, check_history, completed_inlets
from jaxdem.scene_walls import Wall, completed_walls

SIDES_2D = ("left", "right", "bottom", "top")
SIDES_3D = ("left", "right", "front", "back", "bottom", "top")
"""Sides in the order axis by axis, lower before upper; the last axis is up."""

PerParticle = Annotated[tuple[Positive, ...], Field(min_length=1)]

DEEPEST = 20
"""Tables and lists inside each other."""

MOST_OUTPUTS = 1_000_000
"""Frames that a run may write; more is a slip of the output interval's unit."""


class Domain(Section):
    """The box.

    Attributes:
        size: side lengths, two or three numbers; the last axis points up [m].
        depth: extent in the third direction, in 2-D only. Default: one (largest) diameter, or 1 m without particles [m].
        gravity: acceleration, one number per axis. Default: 9.81 downwards. With a fluid it must be zero along periodic
            axes [m/s2].
    """

    size: tuple[Positive, ...] = Field(min_length=2, max_length=3)
    depth: Positive | None = None
    gravity: tuple[Finite, ...] | None = None


class Pack(Section):
    """The arrangement of the particles at the start.

    Attributes:
        kind: "polygon" fills a polygon in the plane of the first and the vertical axis with rows, from below. "lattice" fills a
            box. "random" puts particles at random positions in a box; where there is no more room, it pushes overlapping
            particles apart.
        vertices: corners (x, vertical) of the polygon. In 3-D the polygon extends over the whole second axis [m].
        start: lower corner of the box of a lattice or random pack [m].
        stop: upper corner of this box [m].
        spacing: distance of neighbouring centres over the (largest) diameter. In a random pack: smallest distance of two centres
            over the sum of their radii [-].
        jitter: largest random displacement over the (smallest) radius. Default: 0.005. A random pack has no jitter [-].
    """

    kind: Literal["polygon", "lattice", "random"]
    vertices: Rows | None = None
    start: tuple[Finite, ...] | None = None
    stop: tuple[Finite, ...] | None = None
    spacing: Annotated[float, Field(ge=1.0, le=100.0, strict=True)] = 1.01
    jitter: Annotated[float, Field(ge=0.0, le=0.5, strict=True)] | None = None


class Particles(Section):
    """The particles: spheres; in 2-D discs with the mass and inertia of a sphere.

    Attributes:
        count: number of particles at the start. With `position` it must equal the number of positions. Default: a polygon or
            lattice is filled.
        radius: radius of all particles, one number per particle, or the name of a file (.npy or text) with one per particle [m].
        density: density of all particles, one number per particle, or the name of a file with one per particle [kg/m3].
        material: name of one of `[[materials]]`, or one name per particle. Only in a scene with `[[materials]]`.
        species: kinds of particles with their own radius, density or material, mixed at random with the seed.
        pack: arrangement at the start. Give either this or `position`.
        position: centres of the particles, as rows or as the name of a file (.npy or text) of rows. The first row of a text file
            may name the columns. In 2-D also in the form of a run's frames, (x, z, 0) [m].
        velocity: velocities at the start, as rows or as the name of a file of rows, in the same forms. Default: at rest [m/s].
        angular_velocity: at the start, one number per particle in 2-D, rows of three in 3-D, or the name of a file. In 2-D also
            in the form of a run's frames, (0, 0, scalar). Default: no rotation [rad/s].
        inlet: inlets through which particles enter during the run.
    """

    count: Annotated[int, Field(ge=0, le=100_000_000, strict=True)] | None = None
    radius: Positive | PerParticle | str | None = None
    density: Positive | PerParticle | str | None = None
    material: str | tuple[str, ...] | None = None
    species: tuple[Species, ...] = ()
    pack: Pack | None = None
    position: Rows | str | None = None
    velocity: Rows | str | None = None
    angular_velocity: Rows | tuple[Finite, ...] | str | None = None
    inlet: tuple[ParticleInlet, ...] = ()


class Contact(Section):
    """Contacts of particles with each other and with walls.

    Attributes:
        law: contact law, "hertz_mindlin" or "linear_spring_dashpot".
        young_modulus: Young's modulus of the particles [Pa].
        poisson_ratio: Poisson's ratio of the particles [-].
        restitution: coefficient of restitution, rebound speed over approach speed [-].
        friction: coefficient of sliding (Coulomb) friction [-].
        rolling_friction: coefficient of rolling friction; 0 for none [-].
        rolling_model: "cdt" (constant directional torque) or "epsd" (elastic-plastic spring and dashpot).
        rolling_damping: damping ratio of the spring of "epsd"; 1 is critical [-].
        wall_young_modulus: Young's modulus of the walls, or "rigid". Default: that of the particles [Pa].
        wall_poisson_ratio: Poisson's ratio of the walls. Default: that of the particles [-].
        wall_friction: coefficient of friction between particles and walls. Default: that of the particles [-].
        wall_material: name of one of `[[materials]]` for the walls, in place of the three `wall_` keys above.
        normal_stiffness: normal stiffness of the linear law [N/m].
        tangential_stiffness: tangential stiffness of the linear law. Default: 2/7 of the normal stiffness [N/m].
        time_step: contact step. "auto" takes a step that is stable and resolves an impact [s].
        speed: largest expected speed, for the automatic time step and the expected overlap. "auto" computes it from the inlets,
            the initial velocities and a fall through the box [m/s].
        maximum_overlap: largest expected overlap that is accepted, over the diameter [-].
        skin: additional reach of the neighbour list over the (largest) diameter. "auto" is 0.4 [-].
    """

    law: Literal["hertz_mindlin", "linear_spring_dashpot"] = "hertz_mindlin"
    young_modulus: Positive = 7e7
    poisson_ratio: Annotated[float, Field(gt=-1.0, le=0.5, strict=True)] = 0.3
    restitution: Annotated[float, Field(ge=0.0, le=1.0, strict=True)] = 0.7
    friction: NonNegative = 0.5
    rolling_friction: NonNegative = 0.0
    rolling_model: Literal["cdt", "epsd"] = "cdt"
    rolling_damping: Annotated[float, Field(ge=0.0, le=1.0, strict=True)] = 0.3
    wall_young_modulus: Positive | Literal["rigid"] | None = None
    wall_poisson_ratio: Annotated[float, Field(gt=-1.0, le=0.5, strict=True)] | None = None
    wall_friction: NonNegative | None = None
    wall_material: str | None = None
    normal_stiffness: Positive | None = None
    tangential_stiffness: NonNegative | None = None
    time_step: Positive | Literal["auto"] = "auto"
    speed: Positive | Literal["auto"] = "auto"
    maximum_overlap: Annotated[float, Field(gt=0.0, le=0.5, strict=True)] = 0.2
    skin: Annotated[float, Field(gt=0.0, le=2.0, strict=True)] | Literal["auto"] = "auto"

    def of_walls(self, name: str) -> Any:
        """A constant of the walls; the particles' where none is given."""
        own = getattr(self, f"wall_{name}")
        return getattr(self, name) if own is None else own


class Fluid(Section):
    """The fluid and its mesh.

    Attributes:
        cells: number of cells per axis.
        density: density of the fluid [kg/m3].
        viscosity: kinematic viscosity [m2/s].
        model: volume-averaged equations. "A": pressure gradient and viscous stress act on fluid and particles, in proportion to
            their volumes. "B": they act on the fluid alone, and the drag is divided by the void fraction.
        smagorinsky: coefficient of Smagorinsky's subgrid viscosity, usually 0.1 to 0.2; 0 for none [-].
        subgrid: file of a learned subgrid stress, written by `jaxdem finetune --subgrid`.
        time_step: fluid step. "auto" is a Courant number of 0.5 at the largest boundary speed, but at most 0.01 s [s].
        advection: advection scheme. "limited" is second order with van Leer's limiter. "superbee" has less numerical diffusion.
            "central" (second order) has no numerical diffusion and "central_4" (fourth order) very little, but both make waves
            beside steep gradients. These three are for meshes that hardly resolve the flow. "upwind" is first order.
        courant_limit: largest Courant number of a fluid step. A longer step is halved, up to three times [-].
        velocity: initial interstitial velocity, one number per axis. Default: at rest [m/s].
    """

    cells: tuple[Annotated[int, Field(ge=1, le=100_000, strict=True)], ...] = Field(
        min_length=2, max_length=3
    )
    density: Positive = 1000.0
    viscosity: NonNegative = 1e-6
    model: Literal["A", "B"] = "A"
    smagorinsky: Fraction = 0.0
    subgrid: str | None = None
    time_step: Positive | Literal["auto"] = "auto"
    advection: Literal["limited", "superbee", "central", "central_4", "upwind"] = "limited"
    courant_limit: Annotated[float, Field(gt=0.0, le=1.0, strict=True)] = 0.7
    velocity: tuple[Finite, ...] | None = None


class Width(Section):
    """Half-width of the deposition kernel: the larger of a multiple of the diameter d and a multiple of the cell side h, per axis.

    Attributes:
        diameters: multiple of the (largest) diameter d [-].
        cells: multiple of the cell side h [-].
    """

    diameters: NonNegative = 1.5
    cells: Annotated[float, Field(ge=0.0, le=20.0, strict=True)] = 1.0

    @model_validator(mode="after")
    def _positive(self) -> Width:
        if self.diameters == 0.0 and self.cells == 0.0:
            raise ValueError("diameters and cells must not both be zero")
        return self


class Coupling(Section):
    """Exchange of forces between particles and fluid.

    Attributes:
        drag: name of the drag law, one of `jaxdem.closures.DRAG_LAWS`.
        void_fraction: how the volume of particles is distributed over the cells: "kernel" (triangular kernel), "centre" (all in
            the cell of the centre), "divided" (by the volume in each cell) or "diffusion" (divided, then smoothed).
        kernel_width: half-width of the kernel: {diameters, cells}, or one number for both multiples. For "diffusion": half-width
            of the triangular kernel that has the same variance as the Gaussian.
        interval: coupling interval, the time between two exchanges; particles enter and leave at its end. It must divide
            `time.output_interval`. "auto" is the fluid step. In a scene without [fluid] this is the only key of the table, and
            "auto" divides `time.output_interval` into equal parts of at most 0.01 s [s].
        lift: list of lift forces: "saffman_mei" (in a shear flow), "magnus" (of a rotating particle).
        rotational_drag: whether the fluid exerts a torque on the particles.
        virtual_mass: coefficient of the virtual mass; 0 for none, 0.5 for a sphere.
        basset: number of coupling intervals for which the Basset force uses the exact kernel; 0 for no Basset force.
        self_disturbance: whether the particle's own wake is removed from the slip that the drag law receives (3-D, with
            void_fraction = "kernel").
        drag_inputs_coarsened: the drag law receives the fluid averaged to a mesh with this many times fewer cells per axis, through
            the kernel of that mesh; 1 for the mesh of the fluid.
        deconvolution: coefficient a of the velocity u - a h^2 lap(u) that the drag law receives. It restores a part of what
            coarse cells and kernels filter out; 0 for the filtered velocity.
    """

    drag: str = "koch_hill"
    void_fraction: Literal["kernel", "centre", "divided", "diffusion"] = "kernel"
    kernel_width: Width = Width()
    interval: Positive | Literal["auto"] = "auto"
    lift: tuple[Literal["saffman_mei", "magnus"], ...] = ()
    rotational_drag: bool = Field(default=False, strict=True)
    virtual_mass: Annotated[NonNegative, Field(le=10.0)] = 0.0
    basset: BassetWindow = 0
    self_disturbance: bool = Field(default=False, strict=True)
    drag_inputs_coarsened: Annotated[int, Field(ge=1, le=1000, strict=True)] = 1
    deconvolution: NonNegative = 0.0

    @field_validator("lift")
    @classmethod
    def _each_once(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(value)) < len(value):
            raise ValueError("names a lift law twice; name each once")
        return value

    @field_validator("kernel_width", mode="before")
    @classmethod
    def _one_number(cls, value: Any) -> Any:
        if isinstance(value, int | float) and not isinstance(value, bool):
            return {"diameters": value, "cells": value}
        return value

    @field_validator("drag", mode="before")
    @classmethod
    def _spelling(cls, value: Any) -> Any:
        return value.strip().lower().replace("-", "_").replace(" ", "_") if isinstance(value, str) else value


class Closure(Section):
    """A learned drag closure.

    Attributes:
        file: closure file written by `jaxdem train`; it is used in place of `coupling.drag`.
    """

    file: str | None = None


class Time(Section):
    """Duration and output.

    Attributes:
        end: end of the simulation [s].
        output_interval: time between two frames and between two rows of `history.csv`; it must divide `end` [s].
    """

    end: Positive
    output_interval: Positive


class Output(Section):
    """Optional output.

    Attributes:
        samples: time between two samples of the inputs and results of the drag law; 0 for none [s].
        checkpoint_interval: wall time between two checkpoints; a checkpoint is written at the first output after it [s].
    """

    samples: NonNegative = 0.0
    checkpoint_interval: NonNegative = 60.0


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


FILE_KEYS = (
    ("particles", "radius"),
    ("particles", "density"),
    ("particles", "position"),
    ("particles", "velocity"),
    ("particles", "angular_velocity"),
    ("closure", "file"),
    ("fluid", "subgrid"),
)
"""Tables and keys that may name a file."""


def load_scene(source: str | Path | dict[str, Any], overrides: dict[str, Any] | None = None) -> Scene:
    """A scene from a TOML file, or from the tables as a dict.

    Args:
        source: path, or tables.
        overrides: dotted key -> value, set after reading.

    Raises:
        InputError: naming key, value, limit and remedy.
    """
    folder = Path(".")
    if isinstance(source, dict):
        tables = _copy(source)
    else:
        folder = Path(source).parent
        tables = _read_toml(Path(source))
    for key, value in (overrides or {}).items():
        _set(tables, key, value)
    _check_depth(tables)
    tables = _absolute_files(tables, folder)
    try:
        scene = Scene.model_validate(tables)
    except ValidationError as error:
        raise _as_input_error(error, tables) from None
    return _completed(scene)


def named_files(tables: dict[str, Any]) -> list[str]:
    """Files that the tables of a scene name."""
    values = [tables[table].get(key) for table, key in FILE_KEYS if tables.get(table)]
    return [value for value in values if isinstance(value, str)]


def _check_depth(tables: dict[str, Any]) -> None:
    """Refuses tables in tables without end, at which Python's own stack would: no key of a scene lies so deep."""
    level: list[Any] = [tables]
    for _ in range(DEEPEST):
        level = [
            inner
            for outer in level
            for inner in (outer.values() if isinstance(outer, dict) else outer)
            if isinstance(inner, dict | list)
        ]
    if level:
        limit = f"has tables or lists nested more than {DEEPEST} deep, where no key exists"
        raise InputError("SCENE", "...", limit, "correct the dotted keys and brackets")


def parse_override(text: str, option: str = "--set") -> tuple[str, Any]:
    """`key=value` of an option of the command line, the value as TOML; a word needs no quotes."""
    key, separator, value = text.partition("=")
    if not separator or not key.strip():
        raise InputError(
            option, text, "must have the form key=value", f"use, for example, {option} time.end=1.0"
        )
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except (tomllib.TOMLDecodeError, RecursionError, ValueError):
        if any(mark in value for mark in "[]{}=\"'"):
            raise InputError(
                f"{option} {key}",
                value,
                "must be a TOML value",
                f"quote strings: {option} coupling.drag='\"koch_hill\"'",
            ) from None
        return key.strip(), value.strip()


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return parse_toml(read_text(path))
    except FileNotFoundError:
        raise InputError("SCENE", str(path), "no such file", "give the path of a scene file") from None
    except OSError as error:
        raise InputError(
            "SCENE", str(path), f"cannot be read ({error.strerror})", "correct the path or the permissions"
        ) from None
    except UnicodeDecodeError:
        raise InputError("SCENE", str(path), "is not UTF-8 text", "save the scene as UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError("SCENE", str(path), f"is not valid TOML: {error}", "correct that line") from None
    except ValueError as error:
        raise InputError("SCENE", str(path), str(error), "correct the scene") from None


def _completed(scene: Scene) -> Scene:
    """The scene with every default that depends on other keys written in, and checked as a whole."""
    dimension = scene.dimension
    domain = scene.domain
    if domain.depth is not None and dimension == 3:
        raise InputError("domain.depth", domain.depth, "is for 2-D scenes only", "remove this key")
    gravity = domain.gravity if domain.gravity is not None else (0.0,) * (dimension - 1) + (-9.81,)
    check_entries("domain.gravity", gravity, dimension)
    depth = domain.depth
    if scene.particles is not None:
        _check_particles(scene)
    if dimension == 2 and depth is None:
        depth = 2.0 * largest_radius(scene.particles) if scene.particles else 1.0
    boundary = completed_boundary(scene)
    scene = scene.model_copy(update={"boundary": boundary})
    if scene.fluid is not None:
        check_drive("domain.gravity", gravity, scene.periodic)
    update: dict[str, Any] = {"domain": domain.model_copy(update={"gravity": gravity, "depth": depth})}
    if scene.particles is not None:
        contact = _completed_contact(scene.contact or Contact())
        update["contact"] = contact
        check_materials(scene.materials, scene.material_pairs)
        names = tuple(material.name for material in scene.materials)
        check_particle_materials(scene.particles, scene.walls, contact, names)
        inlets = completed_inlets(
            scene.particles, scene.domain.size, scene.sides, scene.periodic, scene.time.end, names
        )
        update["particles"] = _completed_pack(scene.particles).model_copy(update={"inlet": inlets})
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
        _check_subgrid(scene.fluid)
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
        update["coupling"] = _coupling_of_one(scene)
    if scene.fluid is None and scene.particles is None:
        raise InputError(
            "particles", None, "a scene needs particles, a fluid or both", "add [particles] or [fluid]"
        )
    check_inlets(scene)
    _check_times(scene)
    check_exits(scene)
    check_history(scene)
    return scene.model_copy(update=update)


def _coupling_of_one(scene: Scene) -> Coupling | None:
    """What is left of the coupling in a scene of particles or of a fluid alone: of particles, the interval."""
    if scene.closure.file is not None:
        raise InputError(
            "closure.file", scene.closure.file, "needs both [fluid] and [particles]", "remove [closure]"
        )
    if scene.particles is None:
        if scene.coupling is not None:
            raise InputError("coupling", "...", "needs [particles]", "remove [coupling]")
        return None
    coupling = scene.coupling or Coupling()
    for name in sorted(coupling.model_fields_set - {"interval"}):
        raise InputError(
            f"coupling.{name}", getattr(coupling, name), "needs [fluid]; without a fluid the only key of [coupling] is coupling.interval",
            "remove this key, or add [fluid]",
        )  # fmt: skip
    return coupling


def _check_subgrid(fluid: Fluid) -> None:
    """The learned subgrid stress scales with the viscosity, and has an eddy viscosity of its own."""
    if fluid.subgrid is None:
        return
    if fluid.smagorinsky > 0.0:
        raise InputError(
            "fluid.smagorinsky",
            fluid.smagorinsky,
            "models the same unresolved eddies as the learned stress of fluid.subgrid",
            "set fluid.smagorinsky to 0, or remove fluid.subgrid",
        )
    if fluid.viscosity == 0.0:
        raise InputError(
            "fluid.viscosity",
            0.0,
            "the inputs of fluid.subgrid include a Reynolds number of the cells, which needs a viscosity",
            "set fluid.viscosity to a value above 0",
        )


def _completed_contact(contact: Contact) -> Contact:
    """The contact with the walls' material by one name, checked.

    What follows another key where it is not given (constants of the walls, the tangential stiffness) is not written in: it
    would be a number of its own, to be changed and differentiated by apart from the one that it follows.
    """
    if contact.law == "linear_spring_dashpot" and contact.normal_stiffness is None:
        raise InputError(
            "contact.normal_stiffness",
            None,
            "is needed by contact.law = linear_spring_dashpot",
            "set a stiffness [N/m]",
        )
    if contact.wall_material == WALL:
        # The name of walls without a material.
        contact = contact.model_copy(update={"wall_material": None})
    for name in ("young_modulus", "poisson_ratio", "friction"):
        if contact.wall_material is not None and getattr(contact, f"wall_{name}") is not None:
            raise InputError(
                f"contact.wall_{name}",
                getattr(contact, f"wall_{name}"),
                f"the walls already have this constant from contact.wall_material = {contact.wall_material!r}",
                "remove one of the two keys",
            )
    return contact


def _check_particles(scene: Scene) -> None:
    particles = scene.particles
    assert particles is not None
    for name in ("radius", "density"):
        if getattr(particles, name) is None and not particles.species:
            raise InputError(f"particles.{name}", None, "is missing", "add this key to the scene")
        if isinstance(getattr(particles, name), str):
            column(f"particles.{name}", getattr(particles, name))
    ways = [name for name in ("pack", "position") if getattr(particles, name) is not None]
    if particles.count and not ways and particles.inlet:
        raise InputError(
            "particles.count",
            particles.count,
            "is the number of particles at the start, but neither particles.pack nor particles.position is given",
            "add one of these, or remove particles.count, which does not count the particles of inlets",
        )
    if len(ways) != 1 and particles.count != 0 and (ways or not particles.inlet):
        raise InputError(
            "particles.pack",
            ways,
            "the start needs either a pack or positions",
            "give one of particles.pack and particles.position",
        )


def _completed_pack(particles: Particles) -> Particles:
    """The particles with the default of their pack that depends on its kind."""
    pack = particles.pack
    if pack is None:
        return particles
    needed = {"polygon": ("vertices",), "lattice": ("start", "stop"), "random": ("start", "stop")}[pack.kind]
    for name in ("vertices", "start", "stop"):
        if (getattr(pack, name) is None) == (name in needed):
            raise InputError(
                f"particles.pack.{name}",
                getattr(pack, name),
                f"a {pack.kind} pack needs {' and '.join(needed)}",
                "give only these of the keys vertices, start and stop",
            )
    if pack.kind != "random":
        jitter = 0.005 if pack.jitter is None else pack.jitter
        return particles.model_copy(update={"pack": pack.model_copy(update={"jitter": jitter})})
    if pack.jitter is not None:
        raise InputError(
            "particles.pack.jitter", pack.jitter, "a random pack has no jitter", "remove this key"
        )
    if particles.count is None:
        raise InputError(
            "particles.count", None, "is needed by a random pack", "give the number of particles"
        )
    return particles


def _check_times(scene: Scene) -> None:
    end, interval = scene.time.end, scene.time.output_interval
    frames = end / interval
    if frames > MOST_OUTPUTS:
        raise InputError(
            "time.output_interval",
            interval,
            f"makes {frames:.3g} outputs up to time.end = {end} s, the limit is {MOST_OUTPUTS}",
            f"raise it to at least {end / MOST_OUTPUTS:.3g} s",
        )
    if frames < 1.0 - 1e-9 or abs(frames - round(frames)) > 1e-6 * frames:
        nearest = end / max(1, round(frames))
        raise InputError(
            "time.output_interval",
            interval,
            f"must divide time.end = {end} s",
            f"use, for example, time.output_interval = {nearest:.6g}",
        )


def _as_input_error(error: ValidationError, tables: dict[str, Any]) -> InputError:
    """The first problem that pydantic found, in the words of the scene file."""
    problems = [(_path_of(problem, tables), problem) for problem in error.errors(include_url=False)]
    problems.sort(key=lambda found: found[1]["type"] != "extra_forbidden")
    # Where a number or a list may stand, what is wrong inside the list tells more.
    start = problems[0][0]
    path, first = max((p for p in problems if p[0][: len(start)] == start), key=lambda found: len(found[0]))
    key = ".".join(str(part) for part in path)
    value = first.get("input")
    if path[:1] == ("boundary",) and len(path) > 1 and path[1] not in SIDES_3D:
        refuse_unknown(f"boundary.{path[1]}", str(path[1]), SIDES_3D)
    if first["type"] == "extra_forbidden":
        allowed = _known_keys(list(path[:-1]))
        near = difflib.get_close_matches(str(path[-1]), allowed, n=1)
        remedy = f"did you mean {near[0]!r}?" if near else f"known here: {', '.join(allowed)}"
        return InputError(key, value, "unknown key", remedy)
    if first["type"] == "missing":
        return InputError(key, None, "is missing", "add this key to the scene")
    reasons = dict.fromkeys(_in_plain_words(found["msg"]) for place, found in problems if place == path)
    return InputError(key, value, " or ".join(reasons), "correct the value")


def _in_plain_words(message: str) -> str:
    for theirs, ours in (
        ("Value error, ", ""),
        ("Input should be a valid tuple", "must be a list"),
        ("Input should be a valid dictionary", "must be a table"),
        ("Input should be", "must be"),
        ("Tuple should have", "must have"),
        (" after validation", ""),
    ):
        message = message.replace(theirs, ours)
    return re.sub(r" or instance of \w+", "", message)


def _path_of(problem: Any, tables: dict[str, Any]) -> tuple[str | int, ...]:
    """Keys and indices of the place of a problem.

    pydantic puts the branches of a union between them; these are no keys of the tables, though a key may be called `float`.
    """
    value: Any = tables
    path: list[str | int] = []
    *parents, last = problem["loc"]
    for part in parents:
        if _holds(value, part):
            value = value[part]
            path.append(part)
    # A branch is what is wrong with the value itself, which is then the input.
    of_value = problem["type"] not in ("missing", "extra_forbidden") and problem["input"] is value
    if not of_value and (problem["type"] == "missing" or _holds(value, last)):
        path.append(last)
    return tuple(path)


def _holds(value: Any, part: str | int) -> bool:
    if isinstance(value, dict):
        return part in value
    return isinstance(value, list) and isinstance(part, int) and part < len(value)


def _known_keys(path: list[Any]) -> list[str]:
    model: Any = Scene
    for part in path:
        if isinstance(part, int):  # of a list of tables
            continue
        if not hasattr(model, "model_fields"):
            return []
        fields = {info.alias or name: info for name, info in model.model_fields.items()}
        if part in SIDES_3D and model is None:
            continue
        if part not in fields:
            return []
        if part == "boundary":
            model = BoundarySide
            return [info.alias or name for name, info in BoundarySide.model_fields.items()]
        candidates = [fields[part].annotation, *getattr(fields[part].annotation, "__args__", ())]
        model = next((c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), None)
    return [info.alias or name for name, info in getattr(model, "model_fields", {}).items()]


def _set(tables: dict[str, Any], key: str, value: Any) -> None:
    *parents, last = key.split(".")
    table = tables
    for part in parents:
        if isinstance(table, list):
            if not part.isdecimal() or int(part) >= len(table):
                raise InputError(
                    f"--set {key}",
                    value,
                    f"there are {len(table)} tables, with numbers from 0",
                    "give the number of one of them",
                )
            table = table[int(part)]
        else:
            table = table.setdefault(part, {})
        if not isinstance(table, dict | list):
            raise InputError(f"--set {key}", value, f"{part} is not a table", "correct the dotted key")
    if isinstance(table, list):
        raise InputError(
            f"--set {key}",
            value,
            f"{parents[-1]} is a list of tables",
            f"name a key of one of them: --set {key}.KEY=VALUE",
        )
    table[last] = value


def _absolute_files(tables: dict[str, Any], folder: Path) -> dict[str, Any]:
    """File names in a scene are relative to it; the scene as run holds absolute ones."""
    tables = _copy(tables)
    for table, key in FILE_KEYS:
        holder = tables.get(table)
        if isinstance(holder, dict) and isinstance(holder.get(key), str):
            try:
                holder[key] = str((folder / holder[key]).resolve())
            except (OSError, ValueError, RuntimeError) as error:
                raise InputError(
                    f"{table}.{key}",
                    holder[key],
                    f"cannot be the name of a file ({error})",
                    "correct the name",
                ) from None
    return tables


def _copy(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _copy(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [_copy(v) for v in value] if isinstance(value, list | tuple) else value


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    if isinstance(value, list | tuple):
        return [_without_none(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError("scene", value, "must be finite", "correct the value")
    return value

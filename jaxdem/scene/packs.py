"""The tables `[particles.pack]`: where the particles of the start lie."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from jaxdem.errors import InputError
from jaxdem.scene.base import Finite, MaterialName, Positive, Rows, Section, Tables, Vector, wrong
from jaxdem.scene.distribution import Distribution, check_no_radius
from jaxdem.scene.domain import Domain
from jaxdem.scene.materials import Mixture
from jaxdem.scene.regions import Region

Kind = Literal["polygon", "lattice", "random", "grown", "settled"]

CORNERS: dict[str, tuple[str, ...]] = {"polygon": ("vertices",)}
"""Keys that say where a pack of each kind lies; the others have `start` and `stop`, or a region."""

COUNTED = ("random", "grown", "settled")
"""Kinds that are made of a given number of particles, whose sizes are known before their places."""

WHERE = ("vertices", "start", "stop", "region")


class Pack(Section):
    """An arrangement of particles at the start; one table, or several with `[[particles.pack]]`.

    Radius, density and material that a pack does not give are those of `[particles]`.

    Attributes:
        kind: "polygon" fills a polygon in the plane of the first and the vertical axis with rows, from below. "lattice"
            fills a region with a square or cubic lattice. "random" puts particles at random positions; where there is
            no more room, it pushes overlapping particles apart. "grown" makes a dense disordered pack: the particles
            begin small and grow to their sizes while they push each other apart. "settled" puts them at random
            positions and lets all particles of the scene fall and come to rest before the run begins.
        region: where the particles lie, in place of `start` and `stop`; not for kind = "polygon".
        vertices: of kind = "polygon": corners (x, vertical). In 3-D the polygon extends over the whole second axis [m].
        start: lower corner of a box in which the particles lie [m].
        stop: upper corner of this box [m].
        count: number of particles. Default: `particles.count` where there is one pack; a polygon or lattice is filled.
        solid_fraction: volume of the particles over that of the region, in place of `count`; in 2-D area of the discs
            over that of the region. Not for a polygon or lattice, whose spacing decides it [-].
        spacing: distance of neighbouring centres over the (largest) diameter. In a random, grown or settled pack:
            smallest distance of two centres over the sum of their radii; of a settled one before it falls. Default:
            1.01; of a grown pack 1 [-].
        jitter: largest random displacement over the (smallest) radius, of a polygon or lattice. Default: 0.005 [-].
        settling_time: longest time that a settled pack may take to come to rest. Default: the time of ten falls through
            the box, and of 200 falls through a diameter [s].
        velocity: velocity of all particles of this pack at the start, one number per axis; not of a settled pack.
            Default: that of `[particles]` [m/s].
        radius: radius of the particles of this pack [m].
        distribution: distribution of their radii, in place of `radius`.
        density: density of the particles of this pack [kg/m3].
        material: name of one of `[[materials]]`.
        species: kinds of particles with their own radius, density or material, mixed at random with the seed.
    """

    kind: Kind
    region: Region | None = None
    vertices: Rows | None = None
    start: tuple[Finite, ...] | None = None
    stop: tuple[Finite, ...] | None = None
    count: Annotated[int, Field(ge=0, le=100_000_000, strict=True)] | None = None
    solid_fraction: Annotated[float, Field(gt=0.0, lt=1.0, strict=True)] | None = None
    spacing: Annotated[float, Field(ge=1.0, le=100.0, strict=True)] | None = None
    jitter: Annotated[float, Field(ge=0.0, le=0.5, strict=True)] | None = None
    settling_time: Positive | None = None
    velocity: Vector | None = None
    radius: Positive | None = None
    distribution: Distribution | None = None
    density: Positive | None = None
    material: MaterialName | None = None
    species: Mixture | None = None

    @property
    def gap(self) -> float:
        """`spacing`, its default written in [-]."""
        return 1.0 if self.spacing is None else self.spacing

    @property
    def is_counted(self) -> bool:
        """Whether the number of particles is known before their places."""
        return self.kind in COUNTED

    @property
    def has_own(self) -> bool:
        """Whether what its particles are is not all from `[particles]`."""
        own = (self.radius, self.distribution, self.density, self.material)
        return bool(self.species) or any(value is not None for value in own)

    @model_validator(mode="after")
    def _place_of_its_kind(self) -> Pack:
        needed = CORNERS.get(self.kind, ("start", "stop") if self.region is None else ("region",))
        for name in WHERE:
            if (getattr(self, name) is None) == (name in needed):
                others = "" if self.kind == "polygon" else ", or region"
                limit = f"a {self.kind} pack needs {' and '.join(needed)}{others if 'region' not in needed else ''}"
                remedy = "give only these of the keys vertices, start, stop and region"
                raise wrong(name, getattr(self, name), limit, remedy)
        return self

    @model_validator(mode="after")
    def _keys_of_its_kind(self) -> Pack:
        for name, there in (
            ("jitter", not self.is_counted),
            ("solid_fraction", self.is_counted),
            ("settling_time", self.kind == "settled"),
            ("velocity", self.kind != "settled"),
        ):
            if getattr(self, name) is not None and not there:
                remedy = "remove this key"
                if name == "solid_fraction":
                    remedy = 'lower or raise spacing in its place, or use kind = "random" or "grown"'
                raise wrong(name, getattr(self, name), f"a {self.kind} pack has no {name}", remedy)
        if self.count is not None and self.solid_fraction is not None:
            remedy = "give one of the two keys"
            raise wrong("solid_fraction", self.solid_fraction, "cannot be given together with count", remedy)
        update: dict[str, object] = {}
        if self.spacing is None:
            update["spacing"] = 1.0 if self.kind == "grown" else 1.01
        if self.jitter is None and not self.is_counted:
            update["jitter"] = 0.005
        return self.model_copy(update=update) if update else self

    @model_validator(mode="after")
    def _what_they_are(self) -> Pack:
        if self.species and (self.radius or self.density or self.material):
            remedy = "remove radius, density and material of the pack"
            raise wrong("species", "...", "has what the pack gives as well", remedy)
        given = {"radius": self.radius} | {
            f"species.{k}.radius": one.radius for k, one in enumerate(self.species or ())
        }
        check_no_radius(self.distribution, given)
        return self


def _form(value: object) -> str:
    return "several" if isinstance(value, list | tuple) else "one"


Packs = Annotated[
    Annotated[Pack, Tag("one")] | Annotated[Tables[Pack], Tag("several")],
    Discriminator(_form),
]
"""One table, or several."""


def check_settling(packs: tuple[Pack, ...], domain: Domain, periodic: tuple[bool, ...]) -> None:
    """Refuses a pack that should settle where nothing falls, where it falls without end, or where gravity changes.

    Raises:
        InputError: there is no gravity, it has a component along a periodic axis, or it changes with time.
    """
    if not any(pack.kind == "settled" for pack in packs):
        return
    gravity, remedy = domain.gravity, 'or use kind = "random" or "grown"'
    if domain.gravity_times is not None:
        limit = "changes with time, and a settled pack comes to rest before time 0"
        remedy = f"remove gravity_times, let the particles settle in a stage of its own ([[stages]]), {remedy}"
        raise InputError("domain.gravity_times", domain.gravity_times, limit, remedy)
    if not any(domain.gravity_along):
        limit = "is zero, and the particles of a settled pack fall by it"
        raise InputError("domain.gravity", gravity, limit, f"give a gravity, {remedy}")
    if any(wraps and part != 0.0 for wraps, part in zip(periodic, domain.gravity_along, strict=True)):
        limit = "has a component along a periodic axis, along which the particles of a settled pack fall without end"
        raise InputError("domain.gravity", gravity, limit, f"make that side a wall, {remedy}")

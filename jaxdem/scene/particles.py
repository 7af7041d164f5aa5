"""The table `[particles]` with its pack."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, model_validator

from jaxdem.scene.base import Finite, MaterialName, Positive, Rows, Section, Tables, wrong
from jaxdem.scene.distribution import Distribution, check_no_radius
from jaxdem.scene.inlets import ParticleInlet
from jaxdem.scene.materials import Mixture, Species

PerParticle = Annotated[tuple[Positive, ...], Field(min_length=1)]

CORNERS: dict[str, tuple[str, ...]] = {
    "polygon": ("vertices",),
    "lattice": ("start", "stop"),
    "random": ("start", "stop"),
}
"""Keys that say where a pack of each kind lies."""


class Pack(Section):
    """The arrangement of the particles at the start.

    Attributes:
        kind: "polygon" fills a polygon in the plane of the first and the vertical axis with rows, from below. "lattice"
            fills a box. "random" puts particles at random positions in a box; where there is no more room, it pushes
            overlapping particles apart.
        vertices: corners (x, vertical) of the polygon. In 3-D the polygon extends over the whole second axis [m].
        start: lower corner of the box of a lattice or random pack [m].
        stop: upper corner of this box [m].
        spacing: distance of neighbouring centres over the (largest) diameter. In a random pack: smallest distance of
            two centres over the sum of their radii [-].
        jitter: largest random displacement over the (smallest) radius. Default: 0.005. A random pack has no jitter [-].
    """

    kind: Literal["polygon", "lattice", "random"]
    vertices: Rows | None = None
    start: tuple[Finite, ...] | None = None
    stop: tuple[Finite, ...] | None = None
    spacing: Annotated[float, Field(ge=1.0, le=100.0, strict=True)] = 1.01
    jitter: Annotated[float, Field(ge=0.0, le=0.5, strict=True)] | None = None

    @model_validator(mode="after")
    def _keys_of_its_kind(self) -> Pack:
        needed = CORNERS[self.kind]
        for name in ("vertices", "start", "stop"):
            if (getattr(self, name) is None) == (name in needed):
                limit = f"a {self.kind} pack needs {' and '.join(needed)}"
                remedy = "give only these of the keys vertices, start and stop"
                raise wrong(name, getattr(self, name), limit, remedy)
        if self.kind == "random" and self.jitter is not None:
            raise wrong("jitter", self.jitter, "a random pack has no jitter", "remove this key")
        if self.kind != "random" and self.jitter is None:
            return self.model_copy(update={"jitter": 0.005})
        return self


class Particles(Section):
    """The particles: spheres; in 2-D discs with the mass and inertia of a sphere.

    Attributes:
        count: number of particles at the start. With `position` it must equal the number of positions. Default: a
            polygon or lattice is filled.
        radius: radius of all particles, one number per particle, or the name of a file (.npy or text) with one per
            particle [m].
        distribution: distribution of the radii, in place of `radius`. It also holds for species and inlets that give
            no radius.
        density: density of all particles, one number per particle, or the name of a file with one per particle [kg/m3].
        material: name of one of `[[materials]]`, or one name per particle. Only in a scene with `[[materials]]`.
        species: kinds of particles with their own radius, density or material, mixed at random with the seed.
        pack: arrangement at the start. Give either this or `position`.
        position: centres of the particles, as rows or as the name of a file (.npy or text) of rows. The first row of a
            text file may name the columns. In 2-D also in the form of a run's frames, (x, z, 0) [m].
        velocity: velocities at the start, as rows or as the name of a file of rows, in the same forms. Default: at
            rest [m/s].
        angular_velocity: at the start, one number per particle in 2-D, rows of three in 3-D, or the name of a file. In
            2-D also in the form of a run's frames, (0, 0, scalar). Default: no rotation [rad/s].
        coarse_grain: l: every particle is a parcel of l^D grains in D dimensions, a sphere of l times their radius.
            `radius`, `distribution` and `density` are those of the grains; `count`, `position`, packs, and `rate` and
            `total` of inlets are of parcels; see docs/theory.md, "Parcels" [-].
        inlet: inlets through which particles enter during the run.
    """

    count: Annotated[int, Field(ge=0, le=100_000_000, strict=True)] | None = None
    radius: Positive | PerParticle | str | None = None
    distribution: Distribution | None = None
    density: Positive | PerParticle | str | None = None
    material: MaterialName | tuple[MaterialName, ...] | None = None
    species: Mixture = ()
    pack: Pack | None = None
    position: Rows | str | None = None
    velocity: Rows | str | None = None
    angular_velocity: Rows | tuple[Finite, ...] | str | None = None
    coarse_grain: Annotated[float, Field(ge=1.0, le=100.0, strict=True)] = 1.0
    inlet: Tables[ParticleInlet] = ()

    @model_validator(mode="after")
    def _sizes(self) -> Particles:
        """Files of numbers are read here for the first time."""
        given = {"radius": self.radius} | {f"species.{k}.radius": one.radius for k, one in enumerate(self.species)}
        check_no_radius(self.distribution, given)
        for name, value in (("radius", self.radius), ("density", self.density)):
            if value is None and not self.species and not (name == "radius" and self.distribution):
                raise wrong(name, None, "is missing", "add this key to the scene")
            if isinstance(value, str):
                _column(f"particles.{name}", value)
        return self

    @model_validator(mode="after")
    def _one_start(self) -> Particles:
        ways = [name for name in ("pack", "position") if getattr(self, name) is not None]
        if self.count and not ways and self.inlet:
            limit = (
                "is the number of particles at the start, but neither particles.pack nor particles.position is given"
            )
            remedy = "add one of these, or remove particles.count, which does not count the particles of inlets"
            raise wrong("count", self.count, limit, remedy)
        if len(ways) != 1 and self.count != 0 and (ways or not self.inlet):
            remedy = "give one of particles.pack and particles.position"
            raise wrong("pack", ways, "the start needs either a pack or positions", remedy)
        if self.pack is not None and self.pack.kind == "random" and self.count is None:
            raise wrong("count", None, "is needed by a random pack", "give the number of particles")
        return self

    @model_validator(mode="after")
    def _species_are_whole(self, info: ValidationInfo) -> Particles:
        """Every species has a radius, a density and, where there are materials, one of them."""
        materials = (info.context or {}).get("materials", ())
        starts = self.pack is not None or self.position is not None
        if materials and not self.species and not self.material and starts:
            raise wrong(
                "material", None, "is missing, but the scene has [[materials]]", f"known: {', '.join(materials)}"
            )
        for name, kind in (("radius", float), ("density", float), ("material", str)):
            if self.species and not isinstance(getattr(self, name), kind | None):
                limit = "cannot be given per particle in a scene with [[particles.species]]"
                remedy = "give one value for all particles or none, or remove [[particles.species]]"
                raise wrong(name, "one per particle", limit, remedy)
        for key, one, distribution in self._every_species():
            for name in ("radius", "density"):
                if name == "radius" and distribution is not None:
                    continue
                if getattr(one, name) is None and not isinstance(getattr(self, name), float):
                    limit = f"is missing, and particles.{name} is not a single number"
                    remedy = f"give it here, or give particles.{name} for all particles"
                    raise wrong(f"{key}.{name}", None, limit, remedy)
            if materials and not isinstance(one.material or self.material, str):
                raise wrong(f"{key}.material", None, "is missing", f"known: {', '.join(materials)}")
        return self

    def _every_species(self) -> Iterator[tuple[str, Species, Distribution | None]]:
        """Key, species, and the distribution of its radius if it has none of its own."""
        yield from ((f"species.{k}", one, self.distribution) for k, one in enumerate(self.species))
        for k, inlet in enumerate(self.inlet):
            for j, one in enumerate(inlet.species_of(self.species)):
                key = f"inlet.{k}" + (f".species.{j}" if inlet.species else "")
                yield key, one, inlet.distribution or self.distribution


def radius_key(particles: Particles) -> str:
    """The key that gives the radii of the particles at the start."""
    return "particles.distribution" if particles.distribution is not None else "particles.radius"


def radius_range(particles: Particles) -> tuple[float, float]:
    """Smallest and largest radius of the particles, parcels or grains; the cut-offs of a distribution, whatever is
    drawn [m]."""
    if particles.distribution is not None:
        bounds = particles.distribution.bounds
        return particles.coarse_grain * bounds[0], particles.coarse_grain * bounds[1]
    sizes = [one.radius for one in particles.species if one.radius is not None]
    if not particles.species or len(sizes) < len(particles.species):
        sizes += _column("particles.radius", particles.radius)
    return particles.coarse_grain * min(sizes), particles.coarse_grain * max(sizes)


def _column(key: str, value: float | tuple[float, ...] | str | None) -> list[float]:
    """See `sizes.column`. It needs NumPy, which other scenes, and a look at the keys, do without."""
    from jaxdem.scene.sizes import column

    numbers: list[float] = column(key, value).ravel().tolist()
    return numbers


def largest_arrival(particles: Particles, inlet: ParticleInlet) -> float:
    """Largest radius of the particles of an inlet, parcels or grains; the cut-off of a distribution, whatever is drawn
    [m]."""
    distribution = inlet.distribution or particles.distribution
    others = particles.radius if isinstance(particles.radius, float) else 0.0
    others = others if distribution is None else distribution.bounds[1]
    return particles.coarse_grain * max(one.radius or others for one in inlet.species_of(particles.species))


def largest_radius(particles: Particles) -> float:
    """Largest radius of all particles that there ever are, parcels or grains [m]."""
    given = (particles.radius, particles.distribution) != (None, None) or particles.species
    sizes = [radius_range(particles)[1]] if given else []
    return max(sizes + [largest_arrival(particles, inlet) for inlet in particles.inlet])

"""The table `[particles]` with its pack."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, ValidationInfo, model_validator

from jaxdem.scene.base import Finite, MaterialName, Name, Positive, Rows, Tables, nearest, wrong
from jaxdem.scene.distribution import Distribution, check_no_radius
from jaxdem.scene.inlets import ParticleInlet
from jaxdem.scene.materials import Mixture, Species
from jaxdem.scene.packs import Pack, Packs
from jaxdem.scene.particle_file import StartOfFile
from jaxdem.scene.shapes import SPHERE, Shapes

if TYPE_CHECKING:
    import numpy as np

PerParticle = Annotated[tuple[Positive, ...], Field(min_length=1)]


class Particles(StartOfFile):
    """The particles: spheres, or clumps of spheres; in 2-D their centres are in the plane.

    Attributes:
        count: number of particles at the start. With `position` it must equal the number of positions. Not with several
            packs, which have their own. Default: a polygon or lattice is filled.
        radius: radius of all particles, one number per particle, or the name of a file (.npy or text) with one per
            particle; of a clump that of the sphere of the same volume [m].
        distribution: distribution of the radii, in place of `radius`. It also holds for species and inlets that give
            no radius.
        density: density of all particles, one number per particle, or the name of a file with one per particle [kg/m3].
        material: name of one of `[[materials]]`, or one name per particle. Only in a scene with `[[materials]]`.
        species: kinds of particles with their own radius, density or material, mixed at random with the seed.
        file: name of a file with named columns for the particles at the start, or a table with more keys. What the file
            has a column for cannot be given by another key too.
        pack: arrangement at the start, one table or several. Give one of this, `position` and `file`.
        position: centres of the particles, as rows or as the name of a file (.npy or text) of rows. The first row of a
            text file may name the columns. In 2-D also in the form of a run's frames, (x, z, 0) [m].
        velocity: velocities at the start, as rows or as the name of a file of rows, in the same forms. Default: at
            rest [m/s].
        angular_velocity: at the start, one number per particle in 2-D, rows of three in 3-D, or the name of a file. In
            2-D also in the form of a run's frames, (0, 0, scalar). Default: no rotation [rad/s].
        coarse_grain: l: every particle is a parcel of l^D grains in D dimensions, a sphere of l times their radius.
            `radius`, `distribution` and `density` are those of the grains; `count`, `position`, packs, and `rate` and
            `total` of inlets are of parcels; see docs/theory.md, "Parcels". In a scene with `[start]` it may be larger
            than in the run, whose particles are then merged; see docs/how-to/stages.md [-].
        inlet: inlets through which particles enter during the run.
        shapes: clumps of overlapping spheres.
        shape: name of one of `[[particles.shapes]]`, for all particles whose species has none.
        orientation: of clumps at the start: "random" with the seed, "aligned" with the axes in which the shape is
            given, or rows: unit quaternions (w, x, y, z), in 2-D angles [rad].
    """

    count: Annotated[int, Field(ge=0, le=100_000_000, strict=True)] | None = None
    radius: Positive | PerParticle | str | None = None
    distribution: Distribution | None = None
    density: Positive | PerParticle | str | None = None
    material: MaterialName | tuple[MaterialName, ...] | None = None
    species: Mixture = ()
    pack: Packs | None = None
    position: Rows | str | None = None
    velocity: Rows | str | None = None
    angular_velocity: Rows | tuple[Finite, ...] | str | None = None
    coarse_grain: Annotated[float, Field(ge=1.0, le=100.0, strict=True)] = 1.0
    inlet: Tables[ParticleInlet] = ()
    shapes: Shapes = ()
    shape: Name | None = None
    orientation: Literal["random", "aligned"] | Rows | tuple[Finite, ...] = "random"

    @property
    def packs(self) -> tuple[Pack, ...]:
        """The packs; () without."""
        return self.pack if isinstance(self.pack, tuple) else () if self.pack is None else (self.pack,)

    def pack_key(self, number: int) -> str:
        """The key of a pack in the scene."""
        return f"particles.pack.{number}" if isinstance(self.pack, tuple) else "particles.pack"

    def of_pack(self, pack: Pack) -> Particles:
        """What the particles of a pack are: this table with the keys that the pack gives in place of its own."""
        found: dict[str, object] = {"pack": pack, "inlet": ()}
        if pack.count is not None or isinstance(self.pack, tuple):
            found["count"] = pack.count
        if pack.has_own:
            found["species"] = pack.species or ()
        if pack.radius is not None or pack.distribution is not None:
            found |= {"radius": pack.radius, "distribution": pack.distribution}
        found |= {name: getattr(pack, name) for name in ("density", "material") if getattr(pack, name) is not None}
        return self.model_copy(update=found)

    @model_validator(mode="after")
    def _sizes(self) -> Particles:
        """Files of numbers are read here for the first time."""
        given = {"radius": self.radius} | {f"species.{k}.radius": one.radius for k, one in enumerate(self.species)}
        check_no_radius(self.distribution, given)
        for name, value in (("radius", self.radius), ("density", self.density)):
            if self.has_column(name):
                continue
            if value is None and not self.species and not self._packs_give(name) and not self._is_drawn(name):
                raise wrong(name, None, "is missing", "add this key to the scene")
            if isinstance(value, str):
                _column(f"particles.{name}", value)
        return self

    def _is_drawn(self, name: str) -> bool:
        return name == "radius" and self.distribution is not None

    def _packs_give(self, name: str) -> bool:
        """Whether every pack says by itself what its particles are in this."""
        own = [bool(one.species) or getattr(one, name) or (name == "radius" and one.distribution) for one in self.packs]
        return bool(own) and all(own)

    @model_validator(mode="after")
    def _known_shapes(self) -> Particles:
        known = (SPHERE, *(shape.name for shape in self.shapes))
        given = {"shape": self.shape} | {f"{key}.shape": one.shape for key, one, _ in self._every_species()}
        for key, name in given.items():
            if name is not None and name not in known:
                raise wrong(key, name, "there is no such shape in [[particles.shapes]]", nearest(name, known))
        if not self.has_clumps and self.orientation != "random":
            raise wrong("orientation", "...", "spheres have none", "remove this key, or give particles.shape")
        return self

    @property
    def has_clumps(self) -> bool:
        """Whether some particle may be a clump."""
        named = [self.shape, *(one.shape for _, one, _ in self._every_species())]
        return any(name not in (None, SPHERE) for name in named)

    @model_validator(mode="after")
    def _one_start(self) -> Particles:
        ways = [name for name in ("pack", "position", "file") if getattr(self, name) is not None]
        if self.count and not ways and self.inlet:
            limit = "is the number of particles at the start, but none of particles.pack, .position and .file is given"
            remedy = "add one of these, or remove particles.count, which does not count the particles of inlets"
            raise wrong("count", self.count, limit, remedy)
        if len(ways) != 1 and self.count != 0 and (ways or not self.inlet):
            remedy = "give one of particles.pack, particles.position and particles.file"
            raise wrong("pack", ways, "the start needs either a pack, positions or a file", remedy)
        return self

    @model_validator(mode="after")
    def _packs(self) -> Particles:
        """The number of particles of every pack, and what packs cannot be given with."""
        several = isinstance(self.pack, tuple)
        if several and not self.packs:
            raise wrong("pack", [], "is an empty list", "give a pack, or remove this key")
        for k, one in enumerate(self.packs):
            key, given = self.pack_key(k).removeprefix("particles."), (one.count, one.solid_fraction) != (None, None)
            if self.count is not None and (several or given):
                limit = "cannot be given with several packs, or with count or solid_fraction of a pack"
                remedy = f"remove it, and give the number of particles of every pack: particles.{key}.count"
                raise wrong("count", self.count, limit, remedy)
            if one.is_counted and not given and self.count is None:
                limit = f"is needed by a {one.kind} pack"
                remedy = f"give the number of particles, or particles.{key}.solid_fraction"
                raise wrong(f"{key}.count" if several else "count", None, limit, remedy)
            if several or one.solid_fraction is not None:
                self._check_no_lists("several packs" if several else "particles.pack.solid_fraction")
            for name in ("velocity", "angular_velocity"):
                if one.kind == "settled" and getattr(self, name) is not None:
                    limit = "cannot be given with a settled pack, whose particles come to rest"
                    raise wrong(name, "...", limit, "remove this key")
            if one.velocity is not None and self.velocity is not None:
                limit = f"is given by particles.{key}.velocity too"
                raise wrong("velocity", "...", limit, "remove one of the two keys")
        return self

    def _check_no_lists(self, beside: str) -> None:
        for name in ("radius", "density", "material"):
            if isinstance(getattr(self, name), tuple) or (name != "material" and isinstance(getattr(self, name), str)):
                limit = f"cannot be given per particle with {beside}"
                raise wrong(name, "one per particle", limit, "give one value, or one in every pack")

    @model_validator(mode="after")
    def _species_are_whole(self, info: ValidationInfo) -> Particles:
        """Every species has a radius, a density and, where there are materials, one of them."""
        materials = (info.context or {}).get("materials", ())
        starts = (self.packs and not self._packs_give("material")) or (self.position, self.file) != (None, None)
        if materials and not self.species and not self.own_materials(materials) and starts:
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
        for k, pack in enumerate(self.packs):
            key = self.pack_key(k).removeprefix("particles.")
            distribution = pack.distribution or (self.distribution if pack.radius is None else None)
            own = Species.model_construct(share=1.0, radius=pack.radius, density=pack.density, material=pack.material)
            if pack.species:
                yield from ((f"{key}.species.{j}", one, distribution) for j, one in enumerate(pack.species))
            elif pack.has_own:
                yield key, own, distribution
        for k, inlet in enumerate(self.inlet):
            for j, one in enumerate(inlet.species_of(self.species)):
                key = f"inlet.{k}" + (f".species.{j}" if inlet.species else "")
                yield key, one, inlet.distribution or self.distribution


def outer_factor(particles: Particles, dimension: int) -> float:
    """Largest radius of a sphere that holds a particle, over the radius of the particle [-]."""
    if not particles.has_clumps:
        return 1.0
    return max(1.0, *(shape.outer_radius(dimension) for shape in particles.shapes))


def radius_key(particles: Particles) -> str:
    """The key that gives the radii of the particles at the start."""
    if particles.has_column("radius"):
        return "particles.file"
    own = [k for k, pack in enumerate(particles.packs) if pack.radius is not None or pack.distribution is not None]
    if own and particles.radius is None and particles.distribution is None:
        pack = particles.packs[own[0]]
        return f"{particles.pack_key(own[0])}.{'radius' if pack.distribution is None else 'distribution'}"
    return "particles.distribution" if particles.distribution is not None else "particles.radius"


def radius_range(particles: Particles) -> tuple[float, float]:
    """Smallest and largest radius of the particles, parcels or grains; the cut-offs of a distribution, whatever is
    drawn [m]."""
    tables = [particles.of_pack(pack) for pack in particles.packs] or [particles]
    ends = [_radii_of(table) for table in tables]
    return particles.coarse_grain * min(low for low, _ in ends), particles.coarse_grain * max(high for _, high in ends)


def _radii_of(particles: Particles) -> tuple[float, float]:
    """The same of the grains of one table, whatever its packs give."""
    sizes = [one.radius for one in particles.species if one.radius is not None]
    if len(sizes) < len(particles.species) or not sizes:
        drawn = particles.distribution
        sizes += _column("particles.radius", particles.own("radius")) if drawn is None else list(drawn.bounds)
    return min(sizes), max(sizes)


def _column(key: str, value: float | tuple[float, ...] | str | np.ndarray | None) -> list[float]:
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
    given = particles.own("radius") is not None or particles.distribution or particles.species or particles.packs
    sizes = [radius_range(particles)[1]] if given else []
    return max(sizes + [largest_arrival(particles, inlet) for inlet in particles.inlet])

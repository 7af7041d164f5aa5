"""The table `[particles]` with its pack."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from jaxdem.errors import InputError
from jaxdem.scene.base import (
    Finite,
    Positive,
    Rows,
    Section,
)
from jaxdem.scene.materials import Species
from jaxdem.scene.population import ParticleInlet
from jaxdem.scene.sizes import column

PerParticle = Annotated[tuple[Positive, ...], Field(min_length=1)]


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


def check_particles(particles: Particles) -> None:
    """Refuse particles without sizes, or without a way to start; files of numbers are read here for the first time."""
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


def completed_pack(particles: Particles) -> Particles:
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
        raise InputError("particles.pack.jitter", pack.jitter, "a random pack has no jitter", "remove this key")
    if particles.count is None:
        raise InputError("particles.count", None, "is needed by a random pack", "give the number of particles")
    return particles


def radius_range(particles: Particles) -> tuple[float, float]:
    """Smallest and largest radius of the particles [m]."""
    sizes = [one.radius for one in particles.species if one.radius is not None]
    if not particles.species or len(sizes) < len(particles.species):
        sizes += np.atleast_1d(column("particles.radius", particles.radius)).tolist()
    return min(sizes), max(sizes)


def largest_radius(particles: Particles) -> float:
    """Largest radius of all particles that there ever are [m]."""
    sizes = [radius_range(particles)[1]] if particles.radius is not None or particles.species else []
    for inlet in particles.inlet:
        sizes += [one.radius for one in inlet.species_of(particles) if one.radius is not None]
    return max(sizes)

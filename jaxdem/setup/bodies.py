"""Size, density and material of every particle. Host, numpy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jaxdem.errors import InputError
from jaxdem.scene import Particles
from jaxdem.scene.materials import Species
from jaxdem.scene.shapes import SPHERE
from jaxdem.scene.sizes import column
from jaxdem.setup.distribution import radii


class Bodies(NamedTuple):
    """What the particles are; () where all are alike, else (N,).

    Attributes:
        radius: of the particles, parcels or grains [m].
        density: [kg/m3].
        material: number in the table of materials; 0 in a scene without.
        shape: number in the table of shapes, 0 for a sphere.
    """

    radius: np.ndarray
    density: np.ndarray
    material: np.ndarray
    shape: np.ndarray = np.zeros((), np.int32)

    @property
    def smallest_radius(self) -> float:
        """Of all particles [m]."""
        return float(np.min(self.radius))

    @property
    def largest_diameter(self) -> float:
        """Of all particles [m]."""
        return 2.0 * float(np.max(self.radius))

    def scaled(self, factor: float) -> Bodies:
        """The same with `factor` times the radius."""
        return self._replace(radius=factor * self.radius)


NO_BODIES = Bodies(np.zeros(0), np.zeros(0), np.zeros(0, np.int32), np.zeros(0, np.int32))
"""Those of a scene without particles."""


def particle_bodies(particles: Particles, names: tuple[str, ...], count: int, seed: int | list[int]) -> Bodies:
    """Size, density and material of the `count` particles that a scene starts with.

    Args:
        particles: table of the scene.
        names: of the materials.
        count: number of particles.
        seed: of the scene, or numbers that begin with it, for the order of species and sizes.

    Raises:
        InputError: a list or a file has another number of entries, or a number in a file is not positive, or
            a distribution lies outside its cut-offs.
    """
    drawn = _spread_radii(particles, count, seed)
    if particles.species:
        kind = np.repeat(np.arange(len(particles.species)), shares_of(particles.species, count))
        np.random.default_rng([*np.atleast_1d(seed), 1]).shuffle(kind)
        kind = kind if count else np.zeros(1, int)  # no particle at all: the numbers of any species
        mixed = species_bodies(particles.species, particles, names, kind, drawn)
        return collapsed(mixed.scaled(particles.coarse_grain))
    material = particles.own_materials(names)
    if isinstance(material, tuple):
        if len(material) != count:
            raise InputError(
                "particles.material", f"{len(material)} names", f"there are {count} particles",
                f"give one name or {count}",
            )  # fmt: skip
        numbers = np.asarray([names.index(name) for name in material], np.int32)
    else:
        numbers = np.asarray(names.index(material) if names and material else 0, np.int32)
    radius = column("particles.radius", particles.own("radius"), count) if drawn is None else drawn
    density = column("particles.density", particles.own("density"), count)
    shape = np.asarray(shape_number(particles, particles.shape), np.int32)
    return Bodies(radius, density, numbers, shape).scaled(particles.coarse_grain)


def _spread_radii(particles: Particles, count: int, seed: int | list[int]) -> np.ndarray | None:
    """(N,) radii by the distribution of `[particles]` in random order [m]; None without one.

    One is drawn from each of N parts of the distribution that are equal by number, so that few particles follow it as
    well as they can. For no particle there is one radius.
    """
    if particles.distribution is None:
        return None
    generator, some = np.random.default_rng([*np.atleast_1d(seed), 3]), max(count, 1)
    u = (np.arange(some) + generator.uniform(size=some)) / some
    found = radii("particles.distribution", particles.distribution, generator.permutation(u))
    return found if count else found.reshape(())


def species_bodies(
    species: tuple[Species, ...],
    particles: Particles,
    names: tuple[str, ...],
    kind: np.ndarray,
    drawn: np.ndarray | None,
) -> Bodies:
    """What grains are whose species are `kind` (N,), with what a species has not from `particles`.

    `drawn` (N,) has the radii of those whose species has none [m], if they come from a distribution.
    """

    def of(name: str, others: object) -> np.ndarray:
        own = np.asarray([getattr(one, name) or np.nan for one in species], float)[kind]
        return np.where(np.isnan(own), others if isinstance(others, float | np.ndarray) else np.nan, own)

    material = [names.index(one.material or str(particles.material)) for one in species] if names else [0]
    number = np.resize(np.asarray(material, np.int32), len(species))[kind]
    radius = of("radius", particles.radius if drawn is None else drawn)
    shape = [shape_number(particles, one.shape or particles.shape) for one in species]
    return Bodies(radius, of("density", particles.density), number, np.asarray(shape, np.int32)[kind])


def shape_number(particles: Particles, name: str | None) -> int:
    """Of a shape in `ShapeTable`."""
    names = (SPHERE, *(shape.name for shape in particles.shapes))
    return names.index(name or SPHERE)


def collapsed(bodies: Bodies) -> Bodies:
    """() for what all particles share: per particle it would cost memory and time."""
    return Bodies(*(a.flat[0].reshape(()) if a.size and (a == a.flat[0]).all() else a for a in bodies))


def joined(parts: list[Bodies]) -> Bodies:
    """Several groups of particles as one, in their order; each with numbers for every particle."""
    return collapsed(Bodies(*(np.concatenate(columns) for columns in zip(*parts, strict=True))))


def shares_of(species: tuple[Species, ...], count: int) -> np.ndarray:
    """How many of `count` particles each species gets: its share, rounded so that the numbers add up."""
    exact = np.asarray([one.share for one in species]) * count
    numbers = np.floor(exact + 1e-9).astype(int)
    left = np.argsort(numbers - exact, kind="stable")[: count - int(numbers.sum())]
    numbers[left] += 1
    return numbers

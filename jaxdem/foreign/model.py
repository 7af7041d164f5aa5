"""What a deck describes, before it is a scene: in SI units and in the deck's own coordinates."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from jaxdem.foreign.atoms import Atoms
from jaxdem.foreign.lattices import Lattice
from jaxdem.foreign.notes import Notes, Unknown
from jaxdem.foreign.region import Region
from jaxdem.foreign.units import SI, Units

SIDES = {
    3: (("left", "right"), ("front", "back"), ("bottom", "top")),
    2: (("left", "right"), ("bottom", "top")),
}
"""Names of the two sides of each axis in a scene, by the number of axes."""


@dataclass
class Kind:
    """A kind of particle that comes in: its share by number, and what it is.

    Attributes:
        share: by number; those of all kinds add up to 1.
        density: [kg/m3].
        type: of the deck.
        radius: [m]; the largest where there is a distribution.
        distribution: of the radii, as a table of a scene; None for one radius.
        mean_cube: of the radii of a distribution [m3]; 0 for one radius.
    """

    share: float
    density: float
    type: int
    radius: float
    distribution: dict[str, Any] | None = None
    mean_cube: float = 0.0

    @property
    def mass(self) -> float:
        """Mean of its particles [kg]."""
        return 4.0 / 3.0 * math.pi * (self.mean_cube or self.radius**3) * self.density


@dataclass
class Insertion:
    """Particles that a deck inserts: at once (`rate` and `mass_rate` None) or over time.

    Attributes:
        line: number of its note.
        kinds: what comes in.
        region: where.
        segment: in which part of the run, from 0.
        count: of particles, over all time; None if it is not given.
        solid_fraction: in place of the count [-].
        rate: [1/s].
        mass_rate: [kg/s].
        velocity: [m/s].
        begin, end: of an insertion over time; None: to the end of the run [s].
    """

    line: int
    kinds: list[Kind]
    region: Region
    segment: int
    count: int | None = None
    solid_fraction: float | None = None
    rate: float | None = None
    mass_rate: float | None = None
    velocity: tuple[float, ...] = (0.0, 0.0, 0.0)
    begin: float = 0.0
    end: float | None = None

    @property
    def is_inlet(self) -> bool:
        """Whether the particles come over time."""
        return self.rate is not None or self.mass_rate is not None


@dataclass
class DeckWall:
    """A wall of a deck.

    Attributes:
        line: number of its note.
        shape: "plane" or "cylinder".
        axis: number of the axis that a plane is normal to, or along which a cylinder lies.
        coordinate: of a plane [m].
        middle: of a cylinder: its coordinates along the other axes [m].
        radius: of a cylinder [m].
        inside: of a cylinder: whether the particles are inside.
        upper: of a plane: whether the particles lie below it; None if the deck does not say.
        material: type of the deck; 0 without.
        shear: velocity of a plane along itself [m/s]; zero at rest.
        begin, end: when it is there; `end` None: to the end of the run [s].
    """

    line: int
    shape: str
    axis: int
    coordinate: float = 0.0
    middle: tuple[float, float] = (0.0, 0.0)
    radius: float = 0.0
    inside: bool = True
    upper: bool | None = None
    material: int = 0
    shear: tuple[float, ...] = (0.0, 0.0, 0.0)
    begin: float = 0.0
    end: float | None = None

    @property
    def place(self) -> tuple[object, ...]:
        """Where it is, of what material, and how it moves."""
        where = (self.shape, self.axis, self.coordinate, self.middle, self.radius, self.inside, self.upper)
        return (*where, self.material, self.shear)

    @property
    def is_permanent(self) -> bool:
        """Whether it is there all the time."""
        return self.begin == 0.0 and self.end is None


class ContactModel(Protocol):
    """The contact law of a deck."""

    def lacking(self, deck: Deck, model: Model) -> list[str]:
        """What it needs and the deck does not give."""
        ...

    def tables(self, deck: Deck, model: Model) -> dict[str, Any]:
        """`contact`, and `materials` and `material_pairs` of a deck with several types. Differences that are known only
        now go to the notes of its lines."""
        ...


@dataclass
class Model:
    """What may change between two runs.

    Attributes:
        gravity: [m/s2]; None for none.
        contact: the contact law; None before it is given.
        properties: by name of LIGGGHTS: values for each type, or for each pair of types.
        time_step: [s].
        time_step_line: number of the note on it.
        output_steps: steps between two outputs; 0 without.
    """

    gravity: list[float] | None = None
    contact: ContactModel | None = None
    properties: dict[str, list[float]] = field(default_factory=dict)
    time_step: float = 0.0
    time_step_line: int = 0
    output_steps: int = 0


@dataclass
class Segment:
    """A `run` of a deck: the number of its note, when it ends, and the model during it.

    Attributes:
        line: number of its note.
        name: from a comment, or "".
        begin, end: [s].
        model: during it.
    """

    line: int
    name: str
    begin: float
    end: float
    model: Model


@dataclass
class Deck:
    """All of a deck that a scene can take.

    Attributes:
        notes: on its lines.
        folder: in which it lies.
        units: system of units; None before it is given.
        dimension: 2 or 3.
        boundary: kinds of both ends of each axis, such as "ff".
        lower, upper: corners of the box [m]; empty before it is known.
        types: number of types of particles.
        odd_particles: style of the particles if they are no spheres.
        lost: "error" or "ignore": what happens to particles that leave the box.
        walls: of the grains, in the order of the deck.
        wall_models: number of the note of each wall of LAMMPS, and its contact model.
        model: what may change between two runs, as it is at the line that is read.
        segments: the runs so far.
        time, steps: since the first of them [s], [-].
        regions, groups, templates, distributions: by name.
        lattice: of `create_atoms` and of regions in its units; None without.
        fixes: what each fix has become, by its name.
        insertions: of particles, in the order of the deck.
        atoms: that commands create or that a file gives, by segment.
        removals: regions of which particles are removed, by segment.
        data_file: from which the first particles come, as particles.file takes it; None without.
        line: number of the note on the line that is read.
        comment: in that line or above it.
    """

    notes: Notes
    folder: Path
    units: Units | None = None
    dimension: int = 3
    boundary: list[str] = field(default_factory=lambda: ["pp", "pp", "pp"])
    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    types: int = 1
    odd_particles: str = ""
    lost: str = "error"
    walls: list[DeckWall] = field(default_factory=list)
    wall_models: list[tuple[int, Any]] = field(default_factory=list)
    model: Model = field(default_factory=Model)
    segments: list[Segment] = field(default_factory=list)
    time: float = 0.0
    steps: int = 0
    regions: dict[str, Region] = field(default_factory=dict)
    groups: dict[str, list[str]] = field(default_factory=dict)
    templates: dict[str, Kind] = field(default_factory=dict)
    distributions: dict[str, list[Kind]] = field(default_factory=dict)
    lattice: Lattice | None = None
    fixes: dict[str, Any] = field(default_factory=dict)
    insertions: list[Insertion] = field(default_factory=list)
    atoms: dict[int, Atoms] = field(default_factory=dict)
    removals: dict[int, list[Region]] = field(default_factory=dict)
    data_file: dict[str, Any] | None = None
    line: int = 0
    comment: str = ""

    @property
    def unit(self) -> Units:
        """The system of units; SI where none is given yet."""
        return self.units or SI

    @property
    def axes(self) -> tuple[int, ...]:
        """Axes of the deck that the scene has."""
        return tuple(range(self.dimension))

    @property
    def segment(self) -> int:
        """Number of the run that follows, from 0."""
        return len(self.segments)

    @property
    def has_particles(self) -> bool:
        """Whether anything has been put into the box so far."""
        return bool(self.data_file or self.insertions or any(len(atoms) for atoms in self.atoms.values()))

    def region(self, name: str) -> Region:
        """The region of that name.

        Raises:
            Unknown: it was not taken.
        """
        if name not in self.regions:
            raise Unknown(f"the region {name} was not taken")
        return self.regions[name]

    def frozen_model(self) -> Model:
        """The model as it is now."""
        return copy.deepcopy(self.model)

    def sizes(self) -> list[tuple[float, float]]:
        """Radius [m] and density [kg/m3] of all kinds of particles that are known."""
        kinds = [kind for one in self.insertions for kind in one.kinds] or list(self.templates.values())
        found = [(kind.radius, kind.density) for kind in kinds]
        for atoms in self.atoms.values():
            found += sorted({(0.5 * d, rho) for d, rho in zip(atoms.diameter, atoms.density, strict=True)})
        return found

    def largest(self) -> tuple[float, float] | None:
        """Radius [m] and density [kg/m3] of the largest particles; None where none are known."""
        return max(self.sizes(), default=None)

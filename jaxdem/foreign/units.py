"""Systems of units of LAMMPS and LIGGGHTS, in SI units. Source: LAMMPS documentation, `units` command."""

from __future__ import annotations

from typing import NamedTuple

from jaxdem.errors import InputError


class Units(NamedTuple):
    """A system of units.

    Attributes:
        name: as particle files know it.
        length: [m].
        mass: [kg].
        time: [s].
    """

    name: str
    length: float
    mass: float
    time: float

    @property
    def speed(self) -> float:
        """[m/s]."""
        return self.length / self.time

    @property
    def acceleration(self) -> float:
        """[m/s2]."""
        return self.length / self.time**2

    @property
    def density(self) -> float:
        """[kg/m3]."""
        return self.mass / self.length**3

    @property
    def pressure(self) -> float:
        """[Pa]."""
        return self.mass / (self.length * self.time**2)

    @property
    def stiffness(self) -> float:
        """Force over length [N/m]."""
        return self.mass / self.time**2


SI = Units("si", 1.0, 1.0, 1.0)
SYSTEMS = {"si": SI, "cgs": Units("cgs", 1e-2, 1e-3, 1.0), "micro": Units("micro", 1e-6, 1e-15, 1e-6)}


def units_of(name: str) -> Units:
    """The system of that name.

    Raises:
        InputError: it is not converted.
    """
    if name not in SYSTEMS:
        limit = f"all numbers of a scene are in SI units; only {', '.join(SYSTEMS)} are converted"
        remedy = "convert the deck to si"
        if name == "lj":
            remedy = "lj has no metre and no second: choose a length, a mass and a time, and write the deck in si"
        raise InputError("units", name, limit, remedy)
    return SYSTEMS[name]

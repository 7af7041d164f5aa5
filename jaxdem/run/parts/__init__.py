"""The parts of a scene in what a run writes, each a module with a class that derives from `Part`; host side."""

from jaxdem.run.parts.beginning import Packs, RunBefore
from jaxdem.run.parts.bonds import Bonds
from jaxdem.run.parts.clumps import ClumpBodies
from jaxdem.run.parts.drive import Drive
from jaxdem.run.parts.energy import Energy
from jaxdem.run.parts.fluid_forces import FluidForcesOnParticles
from jaxdem.run.parts.liquid import Liquid
from jaxdem.run.parts.part import Part
from jaxdem.run.parts.passages import Passages
from jaxdem.run.parts.population import Population
from jaxdem.run.parts.scalars import Contents, Temperatures
from jaxdem.run.parts.two_fluids import TwoFluids
from jaxdem.run.parts.unread import UnreadKeys
from jaxdem.run.parts.walls import Pistons, WallsInFluid
from jaxdem.run.parts.wear import Wear

PARTS: tuple[Part, ...] = (
    Packs(),
    FluidForcesOnParticles(),
    Population(),
    ClumpBodies(),
    Liquid(),
    Bonds(),
    Contents(),
    Temperatures(),
    TwoFluids(),
    Passages(),
    RunBefore(),
    Drive(),
    Pistons(),
    WallsInFluid(),
    Wear(),
    Energy(),
    UnreadKeys(),
)
"""In the order of their entries in summary.json."""

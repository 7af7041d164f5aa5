"""A coupling interval seen by the particles: what is compiled of it, and its means."""

from __future__ import annotations

from typing import NamedTuple

from jax import Array

from jaxdem.numerics.static import static
from jaxdem.particles.contact_model import ContactModel
from jaxdem.particles.contact_sums import WallLoads
from jaxdem.particles.energy import EnergyFlow
from jaxdem.particles.ghosts import Division
from jaxdem.particles.integrate import ParticleProperties, ParticleState
from jaxdem.particles.neighbor_search import NeighborSearch
from jaxdem.particles.neighbors import Neighbors
from jaxdem.particles.slab_steps import seen_in_slab


@static
class ContactInterval:
    """A coupling interval seen by the particles; static.

    Attributes:
        model: contact laws and walls.
        search: builder of the neighbour list; without one the list that is given serves for good.
        steps: number of contact steps.
        reversible: loops that reverse-mode differentiation can run backwards. Without it the loop skips
            what the interval does not need, and is faster; the numbers are the same.
        division: of a box that is cut into slabs; None on one device.
    """

    model: ContactModel
    search: NeighborSearch | None
    steps: int
    reversible: bool
    division: Division | None = None

    def seen(
        self, bodies: ParticleProperties, particles: ParticleState, neighbors: Neighbors
    ) -> tuple[ParticleState, ParticleProperties]:
        """The particles that the pairs of a list are of, and what they are: on several devices those of a slab with the
        ghosts of its neighbours behind them, which are not active.

        Args:
            bodies: of all particles, by identity.
            particles: state, of the slab.
            neighbors: its list.
        """
        own = bodies.of_rows(particles.identity)
        if self.division is None:
            return particles, own
        own, particles = seen_in_slab(self.division, neighbors, own, particles)
        return particles, own


class ContactMeans(NamedTuple):
    """Means over the contact steps of an interval.

    Attributes:
        collision_force: () over particles present and steps, of |sum of contact forces| [N].
        walls: force and torque on every wall, NaN where it is not measured; None where none is.
        energy: a sum and not a mean, what contacts and the given forces have given and taken, the latter under `fluid`;
            None where no balance is kept [J].
        heat: a sum too, (N,) what contacts took, see `energy.heat_of_step`; None where it warms nothing [J].
    """

    collision_force: Array
    walls: WallLoads | None
    energy: EnergyFlow | None = None
    heat: Array | None = None
